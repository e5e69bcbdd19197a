"""Bad samples of a data link: single ones that stand far outside everything else."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hystid.numeric import Array
from hystid.recording import Recording

_FEW = (10, 1e-3)  # samples, or share of them: more are no accidents
_OUTSIDE = 0.5  # of the range of all other samples, by which a bad one lies beyond it
_ALONE = 0.9  # of its height that its neighbours do not share: a pulse of three samples shares two thirds
_WIDTH = 3  # samples on either side that count as neighbours


def without_spikes(test: Recording) -> Recording:
    """A recording with single samples bridged that stand alone beyond the range of all others; notes say which.

    A blow or an impact lasts several samples, or stays within what the channel shows elsewhere.
    """
    bridged: dict[str, Array] = {}
    notes = []
    for name, values in test.channels("Fxva").items():
        if len(values) >= 4 * _WIDTH and len(bad := spikes(values)):
            bridged[name] = _bridged(values, bad)
            notes.append(
                f"{test.name}: {len(bad)} samples of channel {name} stand alone far beyond all others (the first at "
                f"{test.t[bad[0]]:.6g} s): taken for errors of the data link, and bridged"
            )
    return test.with_channels(bridged, *notes)


def spikes(values: Array) -> NDArray[np.int64]:
    """Indices of single samples far beyond the range of all others."""
    most = max(_FEW[0], int(_FEW[1] * len(values)))
    centre = float(np.median(values))
    ranked = np.argsort(-np.abs(values - centre))[: most + 1]
    rest = np.abs(np.delete(values, ranked) - centre)
    limit = (1 + _OUTSIDE) * float(np.max(rest)) if len(rest) else np.inf
    far = np.sort(ranked[np.abs(values[ranked] - centre) > limit])
    if not 0 < len(far) <= most:
        return np.zeros(0, dtype=np.int64)
    return np.array([k for k in far if _is_alone(values, int(k), limit, centre)], dtype=np.int64)


def _bridged(values: Array, bad: NDArray[np.int64]) -> Array:
    """Values with the bad ones on the polynomial of fifth degree through three good samples on either side."""
    out, good = values.copy(), np.setdiff1d(np.arange(len(values)), bad)
    for at in bad:
        place = np.searchsorted(good, at)
        near = good[max(0, place - _WIDTH) : place + _WIDTH]
        out[at] = np.polynomial.Polynomial.fit(near - at, values[near], len(near) - 1)(0.0)
    return out


def _is_alone(values: Array, at: int, limit: float, centre: float) -> bool:
    near = np.delete(values[max(0, at - _WIDTH) : at + _WIDTH + 1], min(at, _WIDTH)) - centre
    return bool(np.max(np.abs(near)) < (1 - _ALONE) * abs(values[at] - centre) + limit / (1 + _OUTSIDE))
