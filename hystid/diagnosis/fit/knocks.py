"""Single knocks that nobody measured: short forces on the structure that no channel shows, and no law repeats.

The motion after a knock is measured as ever, and the balance holds again. During the knock it does not, for a small
part of a period, a few times in a recording. An impact of the structure's own does the same, but it comes with the
motion: it strikes where the motion goes furthest, as long as it acts at all. A knock does not know where the motion is.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.ndimage import maximum_filter1d
from scipy.stats import norm, rankdata

from hystid.diagnosis.fit.hypothesis import Fit
from hystid.diagnosis.fit.problem import Problem
from hystid.diagnosis.prepare.segments import Flags, Part, band
from hystid.numeric import Array, stretches

_WIDTH = 8  # averages in a period of the quickest motion
_CLEAR_KNOCK = 10.0  # robust standard deviations of these averages from which one is a knock
_NOISE = 6.0  # of them, which noise of any colour reaches in 10^5 averages: a few knocks stand as far beyond all else
_KNOCKS, _LASTS = 5, 3  # knocks in a recording, and periods of the quickest motion that one lasts with what filters
# make of it: what comes more often, or lasts, belongs to the motion
_STRETCH = 10  # of the longest knock: a stretch of which one knock does not move the median
_BY_CHANCE = 0.05  # probability at which knocks that do not know the motion come with its largest displacements
NO_LAW = "a force that no channel shows and the motion does not repeat"  # what a knock is, in its sentence
_DRAWS = 10_000  # of the times by which knocks are moved


@dataclass(frozen=True)
class Knock:
    """Samples of one knock in a recording, from the first one up to that after the last."""

    first: int
    last: int


@dataclass(frozen=True)
class Knocked:
    """Parts without the samples of short forces, and sentences about them; no sentence where these come with the
    motion, so that a law of the structure may have made them."""

    parts: list[Part]
    told: list[str]


def without_knocks(problem: Problem, fitted: Fit) -> Knocked | None:
    """What is left without short forces that the fit does not hold; None where there are none."""
    residuals = problem.reduce.whitened(problem.balance(fitted.hypothesis))
    found = [
        _knocks(p, residual, problem.reduce.used(i))
        for i, (p, residual) in enumerate(zip(problem.parts, residuals, strict=True))
    ]
    if not any(found):
        return None
    pairs = list(zip(problem.parts, found, strict=True))
    struck = [(part, knocks) for part, knocks in pairs if knocks]
    told = [] if _come_with_motion(struck) else [_sentence(part, knocks) for part, knocks in struck]
    return Knocked([_without(part, knocks) for part, knocks in pairs], told)


def _knocks(part: Part, residual: Array, used: Flags) -> list[Knock]:
    """Short stretches in which a residual stands far outside all else; [] where they are many, or one is long.

    residual: in units of the white noise, (n,). used: samples that a fit uses, (n,).
    """
    if not np.any(used):
        return []
    width = max(int(1 / (_WIDTH * part.dt * max(band(part)[1], 1 / (len(part) * part.dt)))), 2)
    mean = np.convolve(residual, np.ones(width) / width, mode="same")
    usual = _usual(np.abs(mean), used, _STRETCH * _LASTS * _WIDTH * width)
    size = np.abs(mean) / np.maximum(usual, 1 / np.sqrt(width))
    found = _beyond(_CLEAR_KNOCK, size, used, width)
    if len(found) > _KNOCKS:
        tops = sorted((float(np.max(size[k.first : k.last])) for k in found), reverse=True)[: _KNOCKS + 1]
        clear = [k for k in range(_KNOCKS, 0, -1) if tops[k - 1] > _CLEAR_KNOCK / _NOISE * tops[k]]
        found = _beyond(tops[clear[0]] * _CLEAR_KNOCK / _NOISE, size, used, width) if clear else []
    longest = (_LASTS * _WIDTH + 4) * width
    apart = [_apart(k, size, longest, _WIDTH * width) for k in found]
    each = [knock for knocks in apart for knock in knocks]
    return each if all(apart) and len(each) <= _KNOCKS else []


def _apart(stretch: Knock, size: Array, longest: int, period: int) -> list[Knock]:
    """The knocks of a stretch, more than one where their flanks meet; [] where it is a force that lasts.

    Of a long stretch each knock has most of what is there within a period around its peak: what a force that lasts
    leaves is spread.
    """
    if stretch.last - stretch.first < longest:
        return [stretch]
    left, found = size[stretch.first : stretch.last] ** 2, []
    while np.max(left) > _CLEAR_KNOCK**2:
        top = int(np.argmax(left))
        near = slice(max(top - longest // 2, 0), top + longest // 2)
        middle = slice(max(top - period // 2, 0), top + period // 2)
        if np.sum(left[middle]) < 0.5 * np.sum(left[near]):
            return []
        free = np.flatnonzero(left[near]) + near.start
        found.append(Knock(stretch.first + int(free[0]), stretch.first + int(free[-1]) + 1))
        left[near] = 0.0
    return sorted(found, key=lambda knock: knock.first)


def _beyond(limit: float, size: Array, used: Flags, width: int) -> list[Knock]:
    """Stretches beyond a limit, with what belongs together, and their flanks."""
    near = np.convolve(used & (size > limit), np.ones(4 * width + 1), mode="same") > 0
    return [Knock(first, last) for first, last in stretches(near)]


def _usual(sizes: Array, used: Flags, length: int) -> Array:
    """Robust standard deviation from sizes in stretches of some length and over all of them, the larger one, (n,): a
    model is off by more where the motion is large."""
    pieces = [at for at in np.array_split(np.arange(len(sizes)), max(1, len(sizes) // length)) if np.any(used[at])]
    middle = [float(np.mean(at)) for at in pieces]
    near = [float(np.median(sizes[at][used[at]])) for at in pieces]
    return np.maximum(np.interp(np.arange(len(sizes)), middle, near), np.median(sizes[used])) / norm.ppf(0.75)


def _come_with_motion(struck: Sequence[tuple[Part, Sequence[Knock]]]) -> bool:
    """Whether the motion goes further in what was struck than elsewhere, on one side or on either: all the time, or
    between the first and the last knock, as a law may act for a part of the time.

    The knocks are moved along their recordings, each recording by a time of its own, as they follow each other (a
    circular shift test): two knocks in one swing are no two witnesses.
    """
    chances = []
    for side in (np.positive, np.negative, np.abs):
        for between in (False, True):
            ranks = [_ranks(side(part.x), knocks, between=between) for part, knocks in struck]
            rng = np.random.default_rng(0)
            moved = sum((rng.choice(rank, _DRAWS) for rank in ranks), np.zeros(_DRAWS))
            chances.append(float(np.mean(moved >= sum(rank[0] for rank in ranks))))
    return min(chances) * len(chances) < _BY_CHANCE


def _ranks(x: Array, knocks: Sequence[Knock], *, between: bool) -> Array:
    """Sum of the ranks from 0 to 1 of how far a motion goes in all knocks, as they are and moved by whole lengths of a
    knock, round and round."""
    length = int(np.median([k.last - k.first for k in knocks]))
    first, last = (knocks[0].first, knocks[-1].last) if between else (0, len(x))
    furthest = maximum_filter1d(x, length, origin=-(length // 2))[first:last]
    rank = rankdata(furthest) / len(furthest)
    shifts = np.arange(0, last - first, length)
    at = np.array([k.first - first for k in knocks])
    return np.asarray(np.sum(rank[(at[:, None] + shifts) % len(rank)], axis=0))


def _without(part: Part, knocks: Sequence[Knock]) -> Part:
    if not knocks:
        return part
    valid: Flags = np.ones(len(part), dtype=bool) if part.valid is None else part.valid.copy()
    for knock in knocks:
        valid[knock.first : knock.last] = False
    return replace(part, valid=valid)


def _sentence(part: Part, knocks: Sequence[Knock]) -> str:
    at = ", ".join(f"{part.t[k.first]:.4g}" for k in knocks)
    many = f"{len(knocks)} knocks" if len(knocks) > 1 else "a knock"
    return f"{part.name}: {many} at t = {at} s, {NO_LAW}: {sum(k.last - k.first for k in knocks)} samples are left out"
