"""Shape of the branches between reversals: whether the stiffness, which falls along them, rises again in the middle.

Along a branch of friction that saturates the stiffness falls from one reversal to the next, however much the friction
has worn. Where it rises again, the loop is pinched, or something stiffens. The measured branches show that by
themselves, without any law.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from hystid.diagnosis.chain import turns
from hystid.diagnosis.fitting import Fit, Problem
from hystid.diagnosis.noise import noise_level

Array = NDArray[np.float64]
_LEAST = 0.1  # share of the range of the displacement that a branch must cover
_STRETCHES = 10  # of equal displacement per branch: a rise in the middle needs several before and after it
_MOST = 200  # branches that are looked at per recording


@dataclass(frozen=True)
class Branches:
    """The branches of one recording. rises: of the measured force; noise: its standard deviation per sample [N]."""

    x: Array = field(repr=False)
    spans: tuple[tuple[int, int], ...]
    rises: Array
    noise: float
    seed: int

    def of_model(self, force: Array) -> Array:
        """Rises of a predicted force, shape (branches,); with noise as the measured one has, which feigns some."""
        rng = np.random.default_rng(self.seed)
        return rises(self.x, force + self.noise * rng.standard_normal(len(force)), self.spans)


def branches(problem: Problem, fit: Fit) -> list[Branches]:
    """Branches of all recordings, of the force without inertia."""
    found = []
    for i, (part, rest) in enumerate(zip(problem.parts, problem.balance(fit.hypothesis), strict=True)):
        force = rest + problem.predicted(fit.hypothesis)[i]
        spans = [s for s in pairwise(turns(part.x, _LEAST)) if s[1] - s[0] > _STRETCHES][:_MOST]
        found.append(Branches(part.x, tuple(spans), rises(part.x, force, spans), noise_level(force), i))
    return found


def misfits(problem: Problem, fit: Fit, measured: Sequence[Branches]) -> Array:
    """Measured rise less that of a fitted hypothesis, per branch of all recordings; shares of the mean stiffness."""
    forces = problem.predicted(fit.hypothesis)
    return np.concatenate([b.rises - b.of_model(force) for b, force in zip(measured, forces, strict=True)])


def rises(x: Array, force: Array, spans: Sequence[tuple[int, int]]) -> Array:
    """Largest rise of the stiffness above its lowest value before, over the mean stiffness; one value per branch.

    x [m], force [N]: shape (n,). spans: first and last sample of each branch. The stiffness is that between the means
    of stretches of equal displacement.
    """
    found = []
    for first, last in spans:
        along, over = x[first : last + 1], force[first : last + 1]
        place = np.clip(((along - along[0]) / (along[-1] - along[0]) * _STRETCHES).astype(int), 0, _STRETCHES - 1)
        count = np.bincount(place, minlength=_STRETCHES)
        filled = count > 0
        mean_x, mean_f = (np.bincount(place, u, _STRETCHES)[filled] / count[filled] for u in (along, over))
        stiffness = np.diff(mean_f) / np.diff(mean_x)
        rise = float(np.max(stiffness - np.minimum.accumulate(stiffness)))
        found.append(rise * abs((along[-1] - along[0]) / (over[-1] - over[0])))
    return np.array(found)
