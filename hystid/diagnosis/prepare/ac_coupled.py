"""An AC-coupled channel of the motion: a high-pass of first order, found beside the other channels and taken out.

Such a sensor, or an integrator with a high-pass, shows y where the motion is y + c times the integral of y,
with c its corner [rad/s]. Integrated as often as it takes to the channel below, that is linear in c: no channel has to
be derived, whose noise is white then, and no line of a spectrum leaks into another one. A clock that is late is linear
in its lag likewise, and the two are compared. A filter that takes a hundredth of the power is seen at the door
(``consistency.filters``); this is for those below.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from itertools import combinations
from math import comb
from typing import NamedTuple

import numpy as np
from scipy.integrate import cumulative_trapezoid

from hystid.consistency.kinematics import ORDER
from hystid.diagnosis.prepare.faults import COUPLED, Fault
from hystid.diagnosis.prepare.pairs import CHANCE, LEFT, UNKNOWN, Estimate, agreed, sections
from hystid.diagnosis.prepare.segments import measured_motion
from hystid.numeric import Array
from hystid.recording import Recording


def coupled(tests: Sequence[Recording], without: Collection[str] = ()) -> Fault | None:
    """The channel of the motion that is AC-coupled in all recordings, with its corner [rad/s]; None where the
    sections of no pair of channels agree on a corner, or a late clock explains more.

    without: channels that say nothing, as they stop at a level.
    """
    channels = [measured_motion(test) for test in tests]
    names = [name for name in "xva" if all(name in motion for motion in channels) and name not in without]
    chance = CHANCE / max(1, 2 * comb(len(names), 2))  # so many channels of pairs may agree by chance
    pairs = [_corners(low, high, tests, chance) for low, high in combinations(names, 2)]
    for name in reversed(names):
        own = [pair[name] for pair in pairs if name in pair]
        found = [(corner.value, corner.stderr) for corner, _ in own if corner.agrees and corner.value > 0]
        if found and sum(odds for _, odds in own) < 0:
            values, errors = np.array(found).T
            corner, stderr = float(np.average(values, weights=errors**-2)), float(np.sum(errors**-2) ** -0.5)
            return Fault(COUPLED, name, corner, stderr, left_out=name != names[-1])
    return None


def uncoupled(recording: Recording, fault: Fault) -> Recording:
    """Copy with what an AC-coupled channel lost put back. What it had lost before the recording, and its zero, are what
    the channel below says, or none where that is not there. A channel that loses what a higher one shows has no use and
    is left out: of which order its filter is nobody knows."""
    motion = measured_motion(recording)
    if fault.channel not in motion:
        return recording
    if fault.left_out:
        return recording.with_channels({fault.channel: None})
    values, dt = motion[fault.channel], recording.dt
    whole = values + fault.size * _integral(values - np.mean(values), dt, 1)
    below = [low for low in "vx" if low in motion and ORDER[low] < ORDER[fault.channel]]
    if below:
        order, t = ORDER[fault.channel] - ORDER[below[0]], dt * np.arange(len(values))
        left = np.polynomial.Polynomial.fit(t, motion[below[0]] - _integral(whole, dt, order), order + 1)
        whole = whole + left.deriv(order)(t)
    return recording.with_channels({fault.channel: whole})


def _corners(low: str, high: str, tests: Sequence[Recording], chance: float) -> dict[str, tuple[Estimate, float]]:
    """For each of two channels its corner [rad/s], which agrees by chance with a probability, and ln of the odds of a
    lag against it."""
    fits: dict[str, list[_Fit]] = {low: [], high: []}
    odds, order = dict.fromkeys(fits, 0.0), ORDER[high] - ORDER[low]
    for test in tests:
        motion = measured_motion(test)
        for lower, upper in sections(motion[low], motion[high]):
            if np.ptp(lower) == 0 or np.ptp(upper) == 0:  # what rests has lost nothing
                continue
            swings, dt = upper - np.mean(upper), test.dt
            whole = _integral(swings, dt, order)
            late = _beside(lower, whole, _integral(swings, dt, order - 1), order)
            # what the higher channel lost is an integral of its own; what the lower one lost, likewise
            lost = {high: _integral(whole, dt, 1), low: -_integral(lower - np.mean(lower), dt, 1)}
            for name, column in lost.items():
                corner = _beside(lower, whole, column, order)
                if corner.gain > 0 and corner.left < LEFT * np.sum((lower - np.mean(lower)) ** 2):  # else two motions
                    fits[name].append(corner)
                    odds[name] += 0.5 * len(lower) * float(np.log(corner.left / late.left))
    return {name: (_agreed(found, chance), odds[name]) for name, found in fits.items()}


def _agreed(found: Sequence[_Fit], chance: float) -> Estimate:
    """What the sections say together."""
    if not found:
        return UNKNOWN
    values, variances = np.array([(one.share, one.variance) for one in found]).T
    return agreed(values, 1 / (variances + _between(values, 1 / variances)), chance=chance)


def _between(values: Array, weights: Array) -> float:
    """Variance between sections beside what their noise, of inverse variances (k,), makes (DerSimonian, Laird 1986)."""
    total = float(np.sum(weights))
    scatter = float(weights @ (values - weights @ values / total) ** 2) - (len(values) - 1)
    return max(0.0, scatter) / max(total - float(weights @ weights) / total, 1e-300)


class _Fit(NamedTuple):
    """Gain of a channel below another one, share of a further column over it, its variance, and the sum of squares that
    is left."""

    gain: float
    share: float
    variance: float
    left: float


def _beside(lower: Array, whole: Array, further: Array, order: int) -> _Fit:
    """The lower of two channels, (n,), as a gain times ``order`` integrals of the upper one, and a further column.
    Each integral has an unknown constant."""
    place = np.linspace(-1.0, 1.0, len(lower))
    columns = [further, whole, *(place**k for k in range(order + 2))]
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
