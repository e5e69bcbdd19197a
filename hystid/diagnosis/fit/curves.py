"""Free curves: forces that are smooth functions of one quantity, without any law."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BSpline

Array = NDArray[np.float64]
CURVE = 8  # coefficients of a cubic spline: five intervals, as the phase plane has cells
_DEGREE = 3


def curves(values: Sequence[Array]) -> list[Array]:
    """Cubic B-splines over the range of a quantity, one table (n, ``CURVE``) per recording; none where it is still."""
    low, high = min(float(np.min(u)) for u in values), max(float(np.max(u)) for u in values)
    if not high > low:
        return []
    knots = np.concatenate([[low] * _DEGREE, np.linspace(low, high, CURVE - _DEGREE + 1), [high] * _DEGREE])
    return [BSpline.design_matrix(np.clip(u, low, high), knots, _DEGREE).toarray() for u in values]
