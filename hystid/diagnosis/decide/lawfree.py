"""What a force without any law explains: a smooth curve over the displacement, and one over the velocity.

Several laws together imitate any curve. Where a free curve does as well with no more parameters, the laws are no
explanation, and the answer is that the law is unknown.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from hystid.diagnosis.fit.curves import CURVE, curves
from hystid.diagnosis.fit.hypothesis import Fit
from hystid.diagnosis.fit.problem import Problem
from hystid.diagnosis.fit.search import complement

Array = NDArray[np.float64]
_SAME = 1e-6  # relative singular value below which a curve is what the baseline gives already


def free_curves(problem: Problem, baseline: Fit) -> Iterator[float]:
    """Fall of the mean square by a curve over x, and by one over v, of ``CURVE`` coefficients each."""
    outside = complement(problem, baseline)
    residual = outside(baseline.residual)
    for name in ("x", "v"):
        values = [getattr(part, name) for part in problem.parts]
        tables = curves(values)
        if not tables:
            continue
        columns = np.stack([problem.reduce([table[:, k] for table in tables]) for k in range(CURVE)], axis=1)
        norms = np.linalg.norm(columns, axis=0)
        left, size, _ = np.linalg.svd(outside(columns[:, norms > 0] / norms[norms > 0]), full_matrices=False)
        yield float(np.sum((left[:, size > _SAME].T @ residual) ** 2)) / len(residual)
