"""Bad samples of a data link: single ones that stand far outside everything else."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter1d

from hystid.numeric import Array, Flags
from hystid.recording import Recording

_FEW = (10, 1e-3)  # samples, or share of them: more are no accidents
_OUTSIDE = 0.5  # of the range of all other samples, by which a bad one lies beyond it
_ALONE = 0.9  # of its height that its neighbours do not share: a pulse of three samples shares two thirds
_USUAL = 0.99  # quantile of the size of all others, up to which neighbours are what the channel always shows
_WIDTH = 3  # samples on either side that count as neighbours


def without_spikes(test: Recording) -> Recording:
    """A recording with single samples bridged that stand alone beyond the range of all others; notes say which.

    A blow or an impact lasts several samples, stays within what the channel shows elsewhere, or shows in force and
    acceleration alike: an error of the data link is in one of them.
    """
    bridged: dict[str, Array] = {}
    notes = []
    channels = test.channels("Fxva")
    for name, values in channels.items():
        if len(values) < 4 * _WIDTH or not len(bad := spikes(values)):
            continue
        other = channels.get("F") if name == "a" else _acceleration(channels) if name == "F" else None
        if len(bad := bad if other is None else bad[~_stands_out(other, bad)]):
            bridged[name] = _bridged(values, bad)
            notes.append(
                f"{test.name}: {len(bad)} samples of channel {name} stand alone far beyond all others (the first at "
                f"{test.t[bad[0]]:.6g} s): taken for errors of the data link, and bridged"
            )
    return test.with_channels(bridged, *notes)


def spikes(values: Array) -> NDArray[np.int64]:
    """Indices of single samples far beyond the range of all others."""
    most = _most(len(values))
    centre = float(np.median(values))
    ranked = np.argsort(-np.abs(values - centre))[: most + 1]
    rest = np.abs(np.delete(values, ranked) - centre)
    limit = (1 + _OUTSIDE) * float(np.max(rest)) if len(rest) else np.inf
    usual = float(np.quantile(rest, _USUAL)) if len(rest) else np.inf
    far = np.sort(ranked[np.abs(values[ranked] - centre) > limit])
    if not 0 < len(far) <= most:
        return np.zeros(0, dtype=np.int64)
    return np.array([k for k in far if _is_alone(values, int(k), usual, centre)], dtype=np.int64)


def _acceleration(channels: Mapping[str, Array]) -> Array | None:
    """The acceleration, up to a factor; None where no channel of the motion is there."""
    for order, name in enumerate("avx"):
        if name in channels:
            return np.pad(np.diff(channels[name], order), (order // 2, order - order // 2), mode="edge")
    return None


def _stands_out(values: Array, at: NDArray[np.int64]) -> Flags:
    """Whether a channel, too, stands out of its surroundings at each of some samples, or beside them, as nowhere else
    but at a few."""
    padded = np.pad(values, _WIDTH, mode="edge")
    out = np.abs(values - 0.5 * (padded[: -2 * _WIDTH] + padded[2 * _WIDTH :]))
    few = _WIDTH * _most(len(values))
    limit = max(float(np.sort(out)[-min(few, len(out))]), np.finfo(float).tiny)
    return np.asarray(maximum_filter1d(out, 3)[at] >= limit)


def _most(samples: int) -> int:
    return max(_FEW[0], int(_FEW[1] * samples))


def _bridged(values: Array, bad: NDArray[np.int64]) -> Array:
    """Values with the bad ones on the polynomial of fifth degree through three good samples on either side."""
    out, good = values.copy(), np.setdiff1d(np.arange(len(values)), bad)
    for at in bad:
        place = np.searchsorted(good, at)
        near = good[max(0, place - _WIDTH) : place + _WIDTH]
        out[at] = np.polynomial.Polynomial.fit(near - at, values[near], len(near) - 1)(0.0)
    return out


def _is_alone(values: Array, at: int, usual: float, centre: float) -> bool:
    near = np.delete(values[max(0, at - _WIDTH) : at + _WIDTH + 1], min(at, _WIDTH)) - centre
    return bool(np.max(np.abs(near)) < (1 - _ALONE) * abs(values[at] - centre) + usual)
