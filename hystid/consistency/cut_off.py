"""Channels that stop at a level, as a recorder repeats its last value, and what that takes from their size."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import binom

from hystid.consistency.kinematics import Pair, spectrum
from hystid.recording import Array

_LEAST_AT_LEVEL = 10  # samples at one value from which it is a level
_OFTEN = 3  # times as often as any other value in the upper half: a coarse converter repeats them all alike
_DIGITS = 1e-9  # of the level: the same number, written by another program
BELOW = 8.0  # standard deviations of the noise, over which the samples at a level scatter: four on either side
_QUIETER = (4.0, 2.0, 1.0)  # times by which the noise may be below what the spectrum shows; the narrowest level counts
_TOP_OF_A_SINE = 1 / math.sqrt(2)  # share at the top of what stands there or as far again below it
_CHANCE = 1e-3  # probability at which a sine has as many there
_TOP = 2 * (1 + math.sqrt(2))  # times as many samples at the top as next below it: twice those of a sine
_RUN = 3  # samples in a row at a level
_SECTIONS = 16  # of a recording: motion grows and falls, and most is lost where it is large
_MOST_AT_LEVEL = 0.9  # share of a section at the level: beyond it, nothing tells the size of the motion


@dataclass(frozen=True)
class CutOff:
    """Where a channel stops: the value (positive, both ways), and the share of all samples that stand there.

    width: by how much noise behind the level moves them, either way.
    """

    value: float
    share: float
    width: float = 0.0


def level(channels: Sequence[Array]) -> CutOff | None:
    """Level at which a channel stops, in one or more recordings of shape (n,); None where it takes its exact extreme
    no more often than other values.

    Values far below say nothing: a sensor at rest repeats its zero. Nor does what a recording begins and ends with: a
    test that starts at the end of its stroke rests there.
    """
    top = max((float(np.max(np.abs(values), initial=0.0)) for values in channels), default=0.0)
    touched, usual, total = 0, 1, 0
    for values in channels:
        stands = _stands(values, top)
        total += len(values)
        moving = np.flatnonzero(~stands)
        inner = slice(moving[0], moving[-1]) if len(moving) else slice(0, 0)
        touched += int(np.count_nonzero(stands[inner]))
        inside = values[~stands & (np.abs(values) > top / 2)]
        usual = max(usual, int(np.max(np.unique(inside, return_counts=True)[1], initial=1)))
    return CutOff(top, touched / total) if touched >= max(_LEAST_AT_LEVEL, _OFTEN * usual) else None


def kept_size(values: Array) -> float:
    """Share of its size that a channel keeps where it stops at a level (1 where it does not).

    Each section is taken for a sine that is cut off for as long as the section stands at the level (describing
    function of saturation: Gelb and Vander Velde 1968, section 2.3), with the weight of its power before.
    """
    found = level([values]) or _noisy_level(values)
    if found is None:
        return 1.0
    kept, power = 0.0, 0.0
    for section in np.array_split(values, _SECTIONS):
        share = min(float(np.mean(_stands(section, found.value, found.width))), _MOST_AT_LEVEL)
        angle = 0.5 * math.pi * (1.0 - share)
        before = 0.5 * (found.value / math.sin(angle)) ** 2 if share else float(np.mean(section**2))
        kept += before * 2.0 / math.pi * (angle + math.sin(angle) * math.cos(angle))
        power += before
    return kept / power


def with_full_sizes(compared: Sequence[Pair], kept: Mapping[str, float]) -> list[Pair]:
    """The pairs with the sizes that their channels had before they were cut off.

    kept: share of its size that each channel keeps. How much is missing beyond a level depends on the motion, so all of
    the correction counts as its error.
    """
    lost = {name: math.log(share) for name, share in kept.items()}
    return [
        replace(
            pair,
            gain=pair.gain * math.exp(lost[pair.low] - lost[pair.high]),
            error=math.hypot(pair.error, lost[pair.low], lost[pair.high]),
        )
        for pair in compared
    ]


def _noisy_level(values: Array) -> CutOff | None:
    """Level at which a channel, (n,), stops in front of its noise; None where it goes through all values alike.

    At the top of a wave there are more samples than below, and not so many more; and a wave of few samples stands there
    for one or two of them. Corners at the level look like noise: it may be quieter than it seems.
    """
    noise, top = spectrum(values, 1.0).noise, float(np.max(np.abs(values), initial=0.0))
    for width in (BELOW * noise / quieter for quieter in _QUIETER):
        if not 0 < 2 * width < top:
            continue
        near = np.abs(values) > top - width
        count = int(np.count_nonzero(near))
        below = int(np.count_nonzero(np.abs(values) > top - 2 * width)) - count
        runs = int(np.count_nonzero(np.diff(near.astype(np.int8), prepend=0) > 0))
        by_chance = float(binom.sf(count - 1, count + below, _TOP_OF_A_SINE))
        if count >= max(_LEAST_AT_LEVEL, _TOP * below, _RUN * runs) and by_chance < _CHANCE:
            return CutOff(float(np.median(np.abs(values[near]))), count / len(values), 0.5 * width)
    return None


def _stands(values: Array, top: float, width: float = 0.0) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
    return np.asarray(np.abs(values) >= top * (1 - _DIGITS) - width)
