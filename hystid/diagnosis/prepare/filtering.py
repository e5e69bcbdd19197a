"""Filters without a phase; at its ends a signal goes on as its mirror image."""

from __future__ import annotations

import numpy as np
from scipy.fft import dct, idct, next_fast_len

from hystid.numeric import Array


def filtered(column: Array, response: Array) -> Array:
    """Zero-phase filter along the last axis; its mirror image continues the column, hence the cosine transform.

    response: shape (..., m + 1) for a length m that transforms quickly, at least that of the column.
    """
    samples, length = column.shape[-1], response.shape[-1] - 1
    if length > samples:
        column = np.concatenate([column, column[..., : samples - length - 1 : -1]], axis=-1)
    return np.asarray(idct(dct(column) * response[..., :-1])[..., :samples])


def quick_length(samples: int) -> int:
    """Length of a transform: a prime number takes ten times as long as one of small factors."""
    return int(next_fast_len(samples, real=True))
