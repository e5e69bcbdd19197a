"""What a force without any law explains: a smooth curve over the displacement, and one over the velocity.

Several laws together imitate any curve. Where a free curve does as well with no more parameters, the laws are no
explanation, and the answer is that the law is unknown.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from hystid.diagnosis.fit.curves import CURVE, curves
from hystid.diagnosis.fit.hypothesis import Fit
from hystid.diagnosis.fit.problem import Problem
from hystid.diagnosis.fit.search import complement
from hystid.numeric import Array

_SAME_CURVE = 1e-6  # relative singular value below which a curve is what the baseline gives already


def free_curves(problem: Problem, baseline: Fit) -> Iterator[float]:
    """Fall of the mean square by a curve over x, and by one over v, of ``CURVE`` coefficients each."""
    ones = [np.ones(len(part)) for part in problem.parts]
    yield from _falls(problem, baseline, ones, "xv")


def wrong_forms(problem: Problem, fit: Fit) -> Iterator[float]:
    """The same of what may be wrong with the forms of the laws of a fit: each times a curve over x, v or time."""
    signals = problem.signals(fit.hypothesis)
    for term in fit.hypothesis.terms:
        forces = [np.asarray(term.effect.force(signal, term.values)) for signal in signals]
        yield from _falls(problem, fit, forces, "xvt")


def _falls(problem: Problem, fit: Fit, forces: Sequence[Array], names: str) -> Iterator[float]:
    """Falls of the mean square by forces, (n,) per recording, times a curve over each of some quantities."""
    outside = complement(problem, fit)
    residual = outside(fit.residual)
    for name in names:
        tables = curves([getattr(part, name) for part in problem.parts])
        if not tables:
            continue
        made = [force[:, None] * table for force, table in zip(forces, tables, strict=True)]
        columns = np.stack([problem.reduce([table[:, k] for table in made]) for k in range(CURVE)], axis=1)
        norms = np.linalg.norm(columns, axis=0)
        left, size, _ = np.linalg.svd(outside(columns[:, norms > 0] / norms[norms > 0]), full_matrices=False)
        yield float(np.sum((left[:, size > _SAME_CURVE].T @ residual) ** 2)) / len(residual)
