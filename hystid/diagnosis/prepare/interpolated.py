"""Channels that somebody interpolated to more samples than were measured: those that were measured are used."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import maximum_filter1d

from hystid.numeric import Array
from hystid.recording import Recording

_LONGEST_STRIDE = 32  # samples from one that was measured to the next one
_ZERO = 0.02  # of the differences of a channel, that is left by rounding in a text file where it has none
_REGULAR_SHARE = 0.9  # of the samples at one distance from those that were measured: shocks may be in the others
_OFTEN = (
    0.15  # share of samples without a difference, at least a quarter of those of a polynomial: noise has a hundredth
)
_CURVES = (("linear", 2), ("cubic", 4))  # kinds of interpolation, and the order of differences that it leaves none of
_TOLD = "{0} was interpolated ({1}): one sample in {2} was measured, and the others are not used"


def where_measured(test: Recording, fewest: int) -> Recording:
    """A recording at the samples at which the channel that was interpolated most was measured, with a note.

    A polynomial between samples has no differences of a higher order there, and noise that differs from that of what
    was measured. fewest: samples that must remain.
    """
    found = [(name, *one) for name, values in test.channels("Fxva").items() if (one := _knots(values)) is not None]
    if not found:
        return test
    name, kind, first, step = max(found, key=lambda one: one[3])
    if (len(test) - first) // step < fewest:
        return test
    return test.part(slice(first, None, step), f"{test.name}: {_TOLD.format(name, kind, step)}")


def _knots(values: Array) -> tuple[str, int, int] | None:
    """Kind of interpolation, the first sample that was measured, and their distance; None where all may have been."""
    if not np.all(np.isfinite(values)):
        return None
    for kind, order in _CURVES:
        difference = np.abs(np.diff(values, order))
        if np.mean(difference < _ZERO * _rms(difference)) < _OFTEN:
            continue
        for step in range(_LONGEST_STRIDE, order - 1, -1):
            phases = [difference[phase::step] for phase in range(step)]
            usual = max(float(np.median(phase)) for phase in phases)
            inside = np.array([float(np.quantile(phase, _REGULAR_SHARE)) for phase in phases]) < _ZERO * usual
            # a difference reaches ``order`` samples further: so many fewer of them lie between two knots
            if np.count_nonzero(inside) != step - order + 1:
                continue
            first = int(np.flatnonzero(inside & ~np.roll(inside, 1))[0])
            if _shows_motion(values, values[first::step]):
                return kind, first, step
    return _between_samples(values)


def _between_samples(values: Array) -> tuple[str, int, int] | None:
    """The same where what was measured lies between two samples: of three in a row on one straight line, the middle one
    has no second difference, and the one beside a bend has."""
    difference = np.abs(np.diff(values, 2))
    straight = difference < _ZERO * maximum_filter1d(difference, 2 * _LONGEST_STRIDE + 1)
    moves = np.abs(np.diff(values))[1:] > 0
    if np.mean(straight & moves) < _OFTEN:
        return None
    bends = np.flatnonzero(~straight[1:] & straight[:-1])
    apart = np.diff(bends)
    usual = np.abs(apart - np.median(apart)) <= 1 if len(apart) else np.zeros(1, dtype=bool)
    if np.mean(usual) < _REGULAR_SHARE:  # a channel with steps is straight at times, but not from time to time
        return None
    step = int(np.ceil(np.mean(apart[usual])))
    if step > _LONGEST_STRIDE or not _shows_motion(values, values[::step]):
        return None
    return "linear", 0, step


def _shows_motion(values: Array, knots: Array) -> bool:
    """Whether samples of a channel change from one to the next as a motion does that was measured there: a triangle
    goes from one end to the other, or is bent at a few of them."""
    bends = np.diff(knots, 2)
    is_bent = np.median(np.abs(bends)) > _ZERO * _rms(bends)
    return bool(is_bent and _rms(np.diff(knots)) < np.std(knots) > _ZERO * np.std(values))


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(np.square(values)))) if len(values) else 0.0
