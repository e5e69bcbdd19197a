"""Forces without any law: smooth curves of one quantity, and tables over the phase plane."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BSpline

from hystid.numeric import Array

CELLS = 5  # of the phase plane along x and along v: states closer than a fifth of the range share their model error
CURVE = 8  # coefficients of a cubic spline: five intervals, as the phase plane has cells
_DEGREE = 3


def curves(values: Sequence[Array]) -> list[Array]:
    """Cubic B-splines over the range of a quantity, one table (n, ``CURVE``) per recording; none where it is still."""
    low, high = min(float(np.min(u)) for u in values), max(float(np.max(u)) for u in values)
    if not high > low:
        return []
    knots = np.concatenate([[low] * _DEGREE, np.linspace(low, high, CURVE - _DEGREE + 1), [high] * _DEGREE])
    return [BSpline.design_matrix(np.clip(u, low, high), knots, _DEGREE).toarray() for u in values]


def cells(x: Array, v: Array) -> NDArray[np.int64]:
    """Number of the cell of the phase plane that each sample lies in, below ``CELLS`` squared, shape (n,)."""
    return _place(x) * CELLS + _place(v)


def _place(values: Array) -> NDArray[np.int64]:
    low, high = float(np.min(values)), float(np.max(values))
    width = (high - low) / CELLS or 1.0
    return np.asarray(np.clip(((values - low) / width).astype(np.int64), 0, CELLS - 1))
