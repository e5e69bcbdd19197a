"""Stretches in which nothing moves: thousands of samples that say one thing, and must not lead a refit.

At rest the force says how a contact holds, not what a spring or a damper does: a structure that sticks off its
equilibrium holds any force up to its friction. Every sample there says the same once more.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from hystid.diagnosis.prepare.segments import Part, band
from hystid.numeric import Array, Flags, stretches
from hystid.recording import Recording
from hystid.smoothing.noise import noise_level

_WINDOW, _LEAST_LEFT = 32, 400  # samples over which a channel rests or not, and that are left at least
_MOST_REST = 0.5  # share of a recording: a longer rest is cut off, or told
_LOUDER = 1.0 + 5.0 / np.sqrt(
    2 * _WINDOW
)  # times its noise that a channel at rest shows in a window: five standard errors
_STRAYS = 3.0  # times its noise that a channel at rest shows in the long run: 1/f noise of the same power doubles it
_PERIODS = 2.0  # of the quickest motion: a reversal stands still for less
_KEPT_ENDS = 0.5  # of such a period at either end of a stretch, where the contact takes hold and lets go


def trimmed(test: Recording) -> Recording:
    """A recording without the rest after its motion and its force, where that is most of it; its notes say so.

    Before the motion is smoothed: the rest would be taken for how smooth it is. The rest before the motion stays: it
    says where laws with memory began, and windows of time count from there.
    """
    values = next(iter(test.channels("vxa").values()), None)
    if test.quasi_static or values is None or len(test) < 4 * _WINDOW:
        return test
    force = values if test.F is None else test.F  # one that swings while nothing moves is held by something
    moving = np.flatnonzero(_moving(values, noise_level(values)) | _moving(force, noise_level(force)))
    if len(moving) == 0:
        return test
    last = min(max((int(moving[-1]) + 2) * _WINDOW, _LEAST_LEFT), len(values))
    if last > (1 - _MOST_REST) * len(values):
        return test
    return test.part(
        slice(0, last),
        f"{test.name}: at rest from {test.t[last - 1]:.4g} s on; {len(test) - last} of {len(test)} samples say only "
        "what friction holds, and are left out",
    )


def resting(part: Part) -> Flags:
    """Samples of stretches at rest, (n,), but for their ends. What moves more slowly than noise shows within a window
    strays over the stretch, and does not rest."""
    name = next(name for name in "vxa" if name in part.measured)
    moving = _moving(part.measured[name], part.noise[name])
    period = 1 / (part.dt * max(band(part)[1], 1 / (len(part) * part.dt)))
    found = np.zeros(len(part), dtype=bool)
    for first, last in stretches(~np.repeat(moving, _WINDOW)):
        strays = does_more_than_noise(part.measured[name][first:last], part.noise[name])
        if last - first > max(_PERIODS * period, 4 * _WINDOW) and not strays:
            edge = max(int(_KEPT_ENDS * period), _WINDOW)
            found[first + edge : last - edge] = True
    return found


def held(part: Part) -> Flags:
    """Samples of those at rest, (n,), in which nothing moves at all, as far as its noise tells: neither at once nor in
    the long run."""
    found = np.zeros(len(part), dtype=bool)
    for first, last in stretches(found if part.rest is None else part.rest):
        channels = [(part.measured[name][first:last], part.noise[name]) for name in "xva" if name in part.measured]
        found[first:last] = all(np.std(values) < _LOUDER * noise for values, noise in channels)
    return found


def does_more_than_noise(values: Array, noise: float) -> bool:
    """Whether a channel does more in a long stretch than its noise in the long run."""
    return bool(np.std(values) > _STRAYS * noise)


def _moving(values: Array, noise: float) -> Flags:
    """Windows, one after the other, in which a channel does more than its noise."""
    count = len(values) // _WINDOW
    return np.asarray(np.std(values[: count * _WINDOW].reshape(count, _WINDOW), axis=1) > _LOUDER * noise)


def without_rest(parts: Sequence[Part]) -> tuple[list[Part], list[str]]:
    """Parts whose resting samples are left out of the balance; sentences about recordings of which that is most.

    The motion stays whole: a law with memory is followed through the rest.
    """
    made, told = [], []
    for part in parts:
        still = resting(part) if part.timed else np.zeros(len(part), dtype=bool)
        valid = np.ones(len(part), dtype=bool) if part.valid is None else part.valid
        made.append(replace(part, valid=valid & ~still, rest=valid & still) if np.any(still) else part)
        if np.mean(still) > _MOST_REST:
            told.append(
                f"{part.name}: at rest in {np.count_nonzero(still)} of {len(part)} samples; they say what friction "
                "holds, and are left out of the fit"
            )
    return made, told
