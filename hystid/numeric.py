"""Types of the arrays that everything works on, and what is asked of them in many places."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]


def stretches(flags: Flags) -> list[tuple[int, int]]:
    """First sample of each stretch of flags, shape (n,), and the one after its last."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], flags.astype(np.int8), [0]])))
    return [(int(first), int(last)) for first, last in zip(edges[::2], edges[1::2], strict=True)]
