"""An AC-coupled velocity or acceleration: a high-pass of first order, found beside the other channels and taken out.

Such a sensor shows y where the motion is y + c times the integral of y, with c its corner [rad/s]. Integrated as often
as it takes to the channel below, that is linear in c: no channel has to be derived, whose noise is white then, and no
line of a spectrum leaks into another one. A clock that is late is linear in its lag likewise, and the two are compared.
A filter that takes a hundredth of the power is seen at the door (``consistency.filters``); this is for those below.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from math import comb
from typing import NamedTuple

import numpy as np
from scipy.integrate import cumulative_trapezoid

from hystid.consistency.kinematics import ORDER
from hystid.diagnosis.prepare.faults import COUPLED, Fault
from hystid.diagnosis.prepare.pairs import CHANCE, UNKNOWN, Estimate, agreed, sections
from hystid.diagnosis.prepare.segments import measured_motion
from hystid.numeric import Array
from hystid.recording import Recording


def coupled(tests: Sequence[Recording], without: Collection[str] = ()) -> Fault | None:
    """The velocity or acceleration that is AC-coupled in all recordings, with its corner [rad/s]; None where the
    sections of no pair of channels agree on a corner, or a late clock explains more.

    without: channels that say nothing, as they stop at a level.
    """
    channels = [measured_motion(test) for test in tests]
    names = [name for name in "xva" if all(name in motion for motion in channels) and name not in without]
    for name in (high for high in "av" if high in names):
        found, against = [], 0.0
        for low in names[: names.index(name)]:
            corner, odds = _corner(low, name, tests, CHANCE / comb(len(names), 2))  # so many pairs may agree by chance
            against += odds
            found += [corner] if corner.agrees and corner.value > 0 else []
        if found and against < 0:
            weights = np.array([1 / corner.stderr**2 for corner in found])
            value = float(weights @ [corner.value for corner in found] / np.sum(weights))
            return Fault(COUPLED, name, value, float(1 / np.sqrt(np.sum(weights))))
    return None


def uncoupled(recording: Recording, fault: Fault) -> Recording:
    """Copy with what an AC-coupled channel lost put back. What it had lost before the recording, and its zero, are what
    the channel below says, or none where that is not there."""
    motion = measured_motion(recording)
    if fault.channel not in motion:
        return recording
    values, dt = motion[fault.channel], recording.dt
    whole = values + fault.size * _integral(values - np.mean(values), dt, 1)
    below = [low for low in "vx" if low in motion and ORDER[low] < ORDER[fault.channel]]
    if below:
        order, t = ORDER[fault.channel] - ORDER[below[0]], dt * np.arange(len(values))
        left = np.polynomial.Polynomial.fit(t, motion[below[0]] - _integral(whole, dt, order), order + 1)
        whole = whole + left.deriv(order)(t)
    return recording.with_channels({fault.channel: whole})


def _corner(low: str, high: str, tests: Sequence[Recording], chance: float) -> tuple[Estimate, float]:
    """Corner of the higher of two channels [rad/s], which agrees by chance with a probability, and ln of the odds of a
    lag against it."""
    values, weights, odds = [], [], 0.0
    order = ORDER[high] - ORDER[low]
    for test in tests:
        motion = measured_motion(test)
        for lower, upper in sections(motion[low], motion[high]):
            swings = upper - np.mean(upper)
            corner, late = (_beside(lower, swings, test.dt, order, order + more) for more in (1, -1))
            if corner.gain > 0:  # else the channels show two motions here
                values.append(corner.share)
                weights.append(1 / corner.variance)
                odds += 0.5 * len(lower) * float(np.log(corner.left / late.left))
    if not values:
        return UNKNOWN, 0.0
    return agreed(np.array(values), np.array(weights), chance=chance), odds


class _Fit(NamedTuple):
    """Gain of a channel below another one, share of a further column over it, its variance, and the sum of squares that
    is left."""

    gain: float
    share: float
    variance: float
    left: float


def _beside(lower: Array, upper: Array, dt: float, order: int, other: int) -> _Fit:
    """The lower of two channels, (n,), as a gain times ``order`` integrals of the upper one, and ``other`` integrals
    beside it. Each integral has a constant that nobody knows."""
    place = np.linspace(-1.0, 1.0, len(lower))
    columns = [_integral(upper, dt, other), _integral(upper, dt, order), *(place**k for k in range(order + 2))]
    table = np.column_stack(columns)
    size = np.maximum(np.linalg.norm(table, axis=0), 1e-300)
    basis, triangle = np.linalg.qr(table / size)
    inverse = np.linalg.pinv(triangle)
    share = inverse @ (basis.T @ lower)
    left = float(np.sum((lower - basis @ (basis.T @ lower)) ** 2))
    left = max(left, np.finfo(float).eps * float(lower @ lower), 1e-300)
    gain = float(share[1] / size[1])
    scale = float(size[0]) * gain or 1.0
    error = float(inverse[0] @ inverse[0]) * left / (len(lower) - len(size))
    return _Fit(gain, float(share[0]) / scale, max(error / scale**2, 1e-300), left)


def _integral(values: Array, dt: float, times: int) -> Array:
    """A channel integrated so many times, from zero."""
    for _ in range(times):
        values = cumulative_trapezoid(values, dx=dt, initial=0)
    return values
