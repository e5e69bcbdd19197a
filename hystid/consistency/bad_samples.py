"""Bad samples of a data link: single ones that stand out of their neighbours as nothing else in a channel does.

Whatever moves a structure lasts, and a sensor behind its filter shows it in some samples. Each sample is compared with
the polynomial of third degree through two neighbours on either side. A bad one leaves a fourth difference there; a step
of the motion leaves a third one, and a bend a second.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import convolve1d, maximum_filter1d
from scipy.stats import chi2, norm, poisson

from hystid.numeric import Array, Flags
from hystid.recording import Recording

_CHANCE = 1e-3  # that a sound sample is taken for a bad one, or a step of the motion
_FEW_BAD = (10, 1e-3)  # samples, or share of them: more are no accidents
_OUTSIDE = 0.5  # of what any other sample leaves, by which a bad one leaves more
_ALONE = 0.9  # of its height that its neighbours do not share: a pulse of three samples shares two thirds
_SEVERAL = 3  # samples far from their neighbours that have one value by no accident
_WIDTH = 3  # samples on either side that count as neighbours
_BAD = np.array([0, 1, -4, 6, -4, 1, 0]) / 6  # what a bad sample leaves at itself and its neighbours
_STEPS = [np.roll([1, -3, 3, -1, 0, 0, 0], k)[:, None] for k in range(4)]  # what a step leaves, up to a factor
_BENDS = [np.column_stack([np.roll([1, -2, 1, 0, 0, 0, 0], k + i) for i in (0, 1)]) for k in (1, 2)]


def bad_samples(recording: Recording) -> dict[str, NDArray[np.int64]]:
    """Indices of the bad samples of each channel that has some.

    A blow or an impact lasts several samples, or shows in force and acceleration, or in acceleration and motion, alike:
    an error of the data link is in one of them.
    """
    found = {}
    channels = recording.channels("Fxva")
    for name, values in channels.items():
        if not len(bad := standing_out(values)):
            continue
        below = {c: y for c, y in channels.items() if c in "vx" or (c, name) == ("a", "F")}
        shown = {"F": [_acceleration(below)], "a": [channels.get("F"), _acceleration(below)]}
        for other in shown.get(name, []):
            bad = bad if other is None else bad[~_stands_out(other, bad)]
        if len(bad):
            found[name] = bad
    return found


def without_bad_samples(recording: Recording, found: Mapping[str, NDArray[np.int64]] | None = None) -> Recording:
    """A recording with its single bad samples bridged; notes say which. found: these samples, where they are known."""
    channels, bridged, notes = recording.channels("Fxva"), {}, []
    for name, bad in (bad_samples(recording) if found is None else found).items():
        bridged[name] = _bridged(channels[name], bad)
        told = alone(len(bad), float(recording.t[bad[0]]), of=f" of channel {name}")
        notes.append(f"{recording.name}: {told}: taken for errors of the data link, and bridged")
    return recording.with_channels(bridged, *notes)


def alone(number: int, first: float, of: str = "") -> str:
    """That so many samples, the first at a time [s], are bad: a clause."""
    if number == 1:
        return f"1 sample{of} stands alone, far from its neighbours (at {first:.6g} s)"
    return f"{number} samples{of} stand alone, far from their neighbours (the first at {first:.6g} s)"


def standing_out(values: Array) -> NDArray[np.int64]:
    """Indices of single samples of a channel, (n,), that stand out of their neighbours far beyond all others; none
    where a channel is too short to have others. Where some have one value to the last digit, as a data link puts for
    what was lost, others of that value need not stand out so far."""
    most, around = _most(len(values)), 2 * _WIDTH + 1
    if len(values) < around * (most + 1) + 4 * _WIDTH:
        return np.zeros(0, dtype=np.int64)
    left = convolve1d(values, _BAD[1:-1], mode="nearest")
    left[: 2 * _WIDTH] = left[-2 * _WIDTH :] = 0.0
    size = np.abs(left)
    noise = float(np.median(size)) / float(norm.ppf(0.75))
    largest = np.argpartition(size, -around * (most + 1))[-around * (most + 1) :]
    tops: list[int] = []
    for k in largest[np.argsort(-size[largest])].tolist():
        if len(tops) <= most and size[k] > 0:
            tops.append(k)
            size[k - _WIDTH : k + _WIDTH + 1] = 0.0
    far = [k for k in tops if abs(left[k]) > (1 + _OUTSIDE) * np.max(size)]
    least, greatest = np.min(values), np.max(values)
    within = [k for k in tops if least < values[k] < greatest]  # a channel that is cut off has many at its end
    lost = _of_one_value(values, [*within, *set(far).difference(within)])
    if len(set(far).difference(lost)) > most:
        return np.zeros(0, dtype=np.int64)
    alone = [k for k in {*far, *lost} if _is_alone(left[k - _WIDTH : k + _WIDTH + 1], noise)]
    return np.array(sorted({*alone, *lost} if _is_no_level(values, lost) else alone), dtype=np.int64)


def _of_one_value(values: Array, at: Sequence[int]) -> list[int]:
    """Single samples of a channel, away from its ends, that have a value which several of some samples have."""
    each, number = np.unique(values[at], return_counts=True)
    held = np.isin(values, each[number >= _SEVERAL])
    single = held & ~np.roll(held, 1) & ~np.roll(held, -1)
    single[: 2 * _WIDTH] = single[-2 * _WIDTH :] = False
    return np.flatnonzero(single).tolist()


def _is_no_level(values: Array, at: Sequence[int]) -> bool:
    """Whether some samples share a value that chance gives to fewer: by how many have any other value, as a converter
    has levels."""
    others = np.unique(np.delete(values, at), return_counts=True)[1]
    return bool(poisson.sf(len(at) - 1, np.max(others)) < _CHANCE)


def _acceleration(channels: Mapping[str, Array]) -> Array | None:
    """The acceleration, up to a factor; None where no channel of the motion is there."""
    for order, name in enumerate("avx"):
        if name in channels:
            return np.pad(np.diff(channels[name], order), (order // 2, order - order // 2), mode="edge")
    return None


def _stands_out(values: Array, at: NDArray[np.int64]) -> Flags:
    """Whether a channel, too, stands out of its surroundings at each of some samples, or beside them, far beyond all
    but a few others."""
    padded = np.pad(values, _WIDTH, mode="edge")
    out = np.abs(values - 0.5 * (padded[: -2 * _WIDTH] + padded[2 * _WIDTH :]))
    few = _WIDTH * _most(len(values))
    limit = max((1 + _OUTSIDE) * float(np.sort(out)[-min(few, len(out))]), np.finfo(float).tiny)
    return np.asarray(maximum_filter1d(out, 3)[at] >= limit)


def _most(samples: int) -> int:
    return max(_FEW_BAD[0], int(_FEW_BAD[1] * samples))


def _bridged(values: Array, bad: NDArray[np.int64]) -> Array:
    """Values with the bad ones on the polynomial of fifth degree through three good samples on either side."""
    out, good = values.copy(), np.setdiff1d(np.arange(len(values)), bad)
    for at in bad:
        place = np.searchsorted(good, at)
        near = good[max(0, place - _WIDTH) : place + _WIDTH]
        out[at] = np.polynomial.Polynomial.fit(near - at, values[near], len(near) - 1)(0.0)
    return out


def _is_alone(left: Array, noise: float) -> bool:
    """Whether a sample is bad, and nothing else: by what it leaves at itself and its neighbours, (7,), beside noise of
    some standard deviation."""
    as_bad = _unlike(left, _BAD[:, None])
    as_motion = min(_unlike(left, shape) for shape in (*_STEPS, *_BENDS))
    usual = noise**2 * float(chi2.isf(_CHANCE, len(left) - 1))
    return (
        as_bad < (1 - _ALONE) ** 2 * float(left @ left) + usual and as_motion - as_bad > -2 * np.log(_CHANCE) * noise**2
    )


def _unlike(left: Array, shape: Array) -> float:
    """Sum of the squares that are left of values, (n,), beside the best sum of the columns of a shape, (n, k)."""
    return float(np.sum((left - shape @ np.linalg.lstsq(shape, left, rcond=None)[0]) ** 2))
