"""Is what a fit leaves noise, whatever its colour: independent of the motion, without lines and without shocks?

The floor of a fit is known where the noise is white. Noise that falls with frequency is louder in the band of the
motion than the level that is measured above it says, and every fit then leaves more than the floor. Such a residual is
no mismatch as long as it does not know what the structure is doing.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from hystid.diagnosis.fit.hypothesis import Fit
from hystid.diagnosis.fit.problem import Problem
from hystid.numeric import Array
from hystid.smoothing.noise import MISREAD, SMALL

Flags = NDArray[np.bool_]
_SHIFTS = 40  # circular shifts of the residual against the motion: what independent noise of the same colour shows
_CELLS = 7  # bins per axis
_KNOWN = (0.035, 0.045)  # power between cells as a share of all, and more of it where most of the residual is excess:
# mismatches of 0.08 of the floor show 0.05 and more, larger ones 0.1 to 1
_IN_CELLS = 0.5  # of an excess, which a mismatch shows between cells, by the share of the rest that is noise by level
TWO_SIDED = 1.96  # standard deviations that hold 95 % of a normal distribution
_LINE = 60.0  # power of a line over the median beside it; noise reaches 28 in some 10^5 lines, lines begin at 700
_PERIODS = 8  # in a recording, from which power is a line: its peak in the spectrum is four frequencies wide
_SHOCKS = 3.6  # kurtosis; 3 for Gaussian noise
_RARE, _LITTLE = 3.8, 0.05  # standard deviations, and share of the power beyond them that is no shock: where noise is
# louder than its level says, so is that of the motion, and a law that jumps is off by a sample here and there


def is_noise(problem: Problem, fitted: Fit) -> bool:
    """Whether the residual of a fit is shown to be independent of x, v, a and h, of the time, and has neither lines nor
    shocks. A residual that is slow beside its recording has few independent samples, and shows nothing."""
    if problem.is_held:
        return False
    signals = problem.signals(fitted.hypothesis)
    motion = [
        [problem.reduce.plain(i, column) for column in (s.x, s.v, s.a, s.h, problem.parts[i].t)]
        for i, s in enumerate(signals)
    ]
    residual = problem.reduce.evenly(fitted.residual)  # weights that follow the motion would make any noise follow it
    sure = problem.by_part(problem.reduce.sure())
    if not all(map(np.any, sure)):
        return False  # a law that is sure of nothing says nothing of what it leaves
    residuals = [_standard(residual, seen) for residual, seen in zip(problem.by_part(residual), sure, strict=True)]
    if any(_has_shocks(residual) or _has_line(residual) for residual in residuals):
        return False
    # An acceleration whose noise is louder than it seems holds noise that the residual is made of, and that of the
    # balance the noise of the force. Between the two is one that holds neither. Where any of them says that the
    # residual does not know the motion, it does not.
    balances = problem.balance_shown(fitted.hypothesis)
    floor = problem.reduce.level + problem.reduce.left_open(fitted.residual)
    force = problem.reduce.evenly(problem.reduce([part.F for part in problem.parts]))
    loud = float(np.sum(residual**2)) > SMALL * float(np.sum(force**2))
    if loud and fitted.chi2 > MISREAD**2 * floor:
        return False  # no channel is off by as much that shows less
    for i, (columns, left) in enumerate(zip(motion, balances, strict=True)):
        mass = fitted.hypothesis.mass()
        columns.append(columns[2] + problem.reduce.plain(i, left) / mass if mass else columns[2])
        columns.append(_between_two(columns[2], columns[5], residuals[i]))
    pairs = [(0, 1), (3, 1), (4, 0), (4, 1)]
    excess = max(0.0, 1.0 - floor / fitted.chi2)
    counts = np.array([np.count_nonzero(seen) for seen in sure])
    known = (_KNOWN[0] + _KNOWN[1] * excess) * float(np.sum(counts))
    # What is left in one recording alone can show there alone.
    squares = [float(np.mean(rows**2)) for rows in problem.by_part(fitted.residual)]
    own = np.array([max(0.0, 1.0 - floor / square) if square else 0.0 for square in squares])
    shown = max(known, _IN_CELLS * float(np.sum(own * (1.0 - own) * counts)))
    powers = [(residual**2 - 1.0) * seen for residual, seen in zip(residuals, sure, strict=True)]

    def unknown(pair: tuple[int, int]) -> bool:
        cells = [_cells(m[pair[0]], m[pair[1]]) for m in motion]
        return all(_independent(values, sure, cells, known, shown) for values in (residuals, powers))

    return all(map(unknown, pairs)) and any(map(unknown, [(1, 2), (1, 5), (1, 6)]))


def _between_two(one: Array, other: Array, residual: Array) -> Array:
    """The mean of two columns, (n,), with weights of 0 to 1 with which it has nothing of a residual, or next to it."""
    here, there = float(one @ residual), float(other @ residual)
    share = float(np.clip(here / (here - there), 0.0, 1.0)) if here != there else 0.5
    return (1 - share) * one + share * other


def _standard(residual: Array, sure: Flags) -> Array:
    """A residual of unit variance where the law is sure of it, and 0 elsewhere: where a jump falls, noise decides."""
    seen = residual[sure] if np.any(sure) else np.zeros(1)
    return np.where(sure, (residual - np.mean(seen)) / (float(np.std(seen)) or 1.0), 0.0)


def _cells(one: Array, other: Array) -> NDArray[np.int64]:
    """Number of the cell of each sample in a table of equal counts."""
    rows = _ranks(one, _CELLS)
    found = np.zeros(len(one), dtype=np.int64)
    for row in range(_CELLS):
        inside = rows == row
        found[inside] = row * _CELLS + _ranks(other[inside], _CELLS)
    return found


def _ranks(values: Array, bins: int) -> NDArray[np.int64]:
    order = np.argsort(values, kind="stable")
    found = np.empty(len(values), dtype=np.int64)
    found[order] = np.arange(len(values)) * bins // max(1, len(values))
    return found


def _independent(
    values: Sequence[Array], sure: Sequence[Flags], cells: Sequence[NDArray[np.int64]], known: float, shown: float
) -> bool:
    """Whether means of values differ between the cells no more than when the values are moved in time, and what moved
    ones show scatters by less than what would show.

    values: 0 where the law is not sure, and such rows count for no cell. known: power between the cells from which the
    values know them; shown: what all of the excess would show at least.
    """
    shares = np.random.default_rng(0).uniform(0.05, 0.95, (_SHIFTS, len(values)))

    def moved_by(share: Array) -> float:
        shifts = [int(one * len(seen)) for one, seen in zip(share, sure, strict=True)]
        rolled = [[np.roll(p, shift) for p, shift in zip(group, shifts, strict=True)] for group in (values, sure)]
        return _between(rolled[0], rolled[1], cells)

    moved = [moved_by(share) for share in shares]
    scatter = TWO_SIDED * float(np.std(moved))
    return _between(values, sure, cells) - float(np.median(moved)) <= max(known, scatter) and scatter <= shown


def _between(values: Sequence[Array], sure: Sequence[Flags], cells: Sequence[NDArray[np.int64]]) -> float:
    """Power between the cells, summed over the recordings."""
    total = 0.0
    for value, seen, cell in zip(values, sure, cells, strict=True):
        count = np.bincount(cell[seen], minlength=_CELLS**2)
        sums = np.bincount(cell, weights=value, minlength=_CELLS**2)
        total += float(np.sum(sums**2 / np.maximum(count, 1)))
    return total


def _has_shocks(residual: Array) -> bool:
    """Whether much of the power of a residual (unit variance) is in few samples."""
    rare = np.abs(residual) > _RARE
    return bool(np.mean(residual**4) > _SHOCKS and np.mean(residual**2 * rare) > _LITTLE)


def _has_line(residual: Array) -> bool:
    """Whether the spectrum has a line that stands out of its neighbourhood, an octave at most, and of the next: what
    wanders has more power the lower the frequency, where slow motion is not seen there is none below an edge, and
    neither is a line."""
    power = np.abs(np.fft.rfft(residual * np.hanning(len(residual)))) ** 2
    width, edges = max(8, len(power) // 60), [_PERIODS]
    while edges[-1] + _PERIODS <= len(power):
        edges.append(edges[-1] + min(edges[-1], width))
    bands = [power[first:last] for first, last in pairwise(edges)]
    usual = np.array([np.median(band) for band in bands] or [0.0])
    around = np.maximum(np.maximum(usual, np.append(usual[1:], 0.0)), 1e-12 * np.max(power))
    return any(np.max(band) > _LINE * level for band, level in zip(bands, around[: len(bands)], strict=True))
