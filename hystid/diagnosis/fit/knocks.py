"""Single knocks that nobody measured: short forces on the structure that no channel shows, and no law repeats.

The motion after a knock is measured as ever, and the balance holds again. During the knock it does not, for a small
part of a period, a few times in a recording. An impact of the structure's own comes with the motion: wherever the
motion goes further, it comes as well. A knock does not know where the motion is, which other passes of it show.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from hystid.diagnosis.fit.hypothesis import Fit
from hystid.diagnosis.fit.problem import Problem
from hystid.diagnosis.prepare.segments import Flags, Part, band

Array = NDArray[np.float64]
_WIDTH = 8  # averages in a period of the quickest motion
_CLEAR = 10.0  # robust standard deviations of these averages: noise of any colour reaches 6 in 10^5 of them
_MOST, _LONGEST = 5, 3  # knocks in a recording, and periods of the quickest motion that one lasts with what filters
# make of it: what comes more often, or lasts, belongs to the motion
_PASSES = 3  # other passes of the motion that go further and show nothing
_MAD = 0.6745  # median of the absolute value of a normal variable


@dataclass(frozen=True)
class Knock:
    """Samples of one knock in a recording, from the first one up to that after the last."""

    first: int
    last: int


def without_knocks(problem: Problem, fitted: Fit) -> tuple[list[Part], list[str]] | None:
    """Parts without the samples of knocks, and sentences about them; None where there are none."""
    rests = problem.reduce.whitened(problem.balance(fitted.hypothesis))
    found = [
        _knocks(p, rest, problem.reduce.used(i)) for i, (p, rest) in enumerate(zip(problem.parts, rests, strict=True))
    ]
    found = [
        [knock for knock in knocks if _is_no_law(problem.parts, found, i, knock)] for i, knocks in enumerate(found)
    ]
    if not any(found):
        return None
    parts = [_without(part, knocks) for part, knocks in zip(problem.parts, found, strict=True)]
    return parts, [_sentence(part, knocks) for part, knocks in zip(problem.parts, found, strict=True) if knocks]


def _knocks(part: Part, rest: Array, used: Flags) -> list[Knock]:
    """Short stretches in which a rest stands far outside all else; [] where they are many, or one is long.

    used: samples that a fit uses, (n,).
    """
    width = max(int(1 / (_WIDTH * part.dt * max(band(part)[1], 1 / (len(part) * part.dt)))), 2)
    mean = np.convolve(rest, np.ones(width) / width, mode="same")
    usual = float(np.median(np.abs(mean[used]))) / _MAD
    far = used & (np.abs(mean) > _CLEAR * usual)
    near = np.convolve(far, np.ones(4 * width + 1), mode="same") > 0  # what belongs together, and its flanks
    edges = np.flatnonzero(np.diff(np.concatenate([[0], near.astype(int), [0]])))
    found = [Knock(int(a), int(b)) for a, b in zip(edges[::2], edges[1::2], strict=True)]
    short = all(k.last - k.first < (_LONGEST * _WIDTH + 4) * width for k in found)
    return found if short and len(found) <= _MOST else []


def _is_no_law(parts: Sequence[Part], found: Sequence[Sequence[Knock]], index: int, knock: Knock) -> bool:
    """Whether the motion goes further elsewhere, on the same side, without anything there."""
    x = parts[index].x[knock.first : knock.last]
    for side in (1.0, -1.0):
        furthest, passes = float(np.max(side * x)), 0
        for part, knocks in zip(parts, found, strict=True):
            beyond = side * part.x > furthest
            starts = np.flatnonzero(np.diff(np.concatenate([[0], beyond.astype(int)])) > 0)
            passes += sum(not any(k.first <= at < k.last for k in knocks) for at in starts)
        if passes < _PASSES:
            return False
    return True


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
    return (
        f"{part.name}: {many} at t = {at} s, a force that no channel shows and the motion does not repeat: "
        f"{sum(k.last - k.first for k in knocks)} samples are left out"
    )
