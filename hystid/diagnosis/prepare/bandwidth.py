"""Channels that were low-passed before they were saved: how far up they count.

The noise of such a channel is white up to the corner of the filter and nothing beyond. Judged by what is beyond, the
channel would be free of noise. At a lower sample rate, whose Nyquist frequency is the corner, it is white again.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np
from scipy.signal import coherence, get_window, welch

from hystid.numeric import Array
from hystid.recording import Recording
from hystid.smoothing.noise import is_noise_free

_BANDS, _FEWEST_BANDS = 48, 24  # bands of the spectrum, each told by its median: lines do not count
_SHELF = 3  # bands that a shelf of noise takes at least
_FLAT_SHELF = 3.0  # factor within which the power of a shelf lies
_FALLS = 1e3  # factor by which the power falls beyond the corner: no sensor's noise does that by itself
_DIGITS = 100.0  # over the rounding of eight digits: what seven digits, and the ends of filters, leave
_MOTION = 0.95  # share of the power that is motion at least: noise of 20 dB holds a hundredth
_BEYOND, _STEEP = 1.5, 100.0  # frequency over the corner, and fall of the power up to there: a mass leaves a fifth,
# a filter of fourth order run both ways a thousandth
_ALIKE_COHERENCE = 0.5  # coherence from which more of a shelf is motion than noise
_SHORTEST_LEFT = 400  # samples that must remain


def corner(channel: Array, dt: float) -> float:
    """Frequency [Hz] up to which the noise of a channel is white, where it falls steeply beyond.

    Infinite where noise is the end of the spectrum, nan where there is none there and the motion hides a corner.
    """
    length = min(len(channel) // 8, 2048)
    bands = min(_BANDS, length // 4)
    if bands < _FEWEST_BANDS:
        return np.inf
    twice = np.diff(channel, 2)  # the motion falls with frequency, the noise must not drown in what the window leaks
    options: dict[str, Any] = {"nperseg": length, "window": get_window("blackmanharris", length)}
    frequency, power = welch(twice, fs=1 / dt, **options)
    omega = 2 * np.sin(np.pi * frequency * dt)
    power = power[1:] / omega[1:] ** 4
    floor = float(np.std(channel)) ** 2 * 1e-16 * dt  # rounding of text
    if float(np.median(power[-len(power) // 10 :])) > _DIGITS * floor:
        return np.inf  # a sensor's own noise is the end of the spectrum
    for zoom in (1, 2, 4):  # a corner far below the sample rate lies within a few of the bands
        near = power[: len(power) // zoom]
        top = _end_of_shelf(near, bands, floor) if len(near) >= 2 * bands else None
        if top is not None:
            return float(frequency[1 + top])
    return np.nan


def _end_of_shelf(power: Array, bands: int, floor: float) -> int | None:
    """Number of the line at which white noise above the motion ends steeply; None where it does not."""
    moving = int(np.searchsorted(np.cumsum(power), _MOTION * np.sum(power)))
    edges = np.linspace(0, len(power), bands + 1).astype(int)
    level = np.maximum([float(np.median(power[a:b])) for a, b in pairwise(edges)], floor)
    last = bands - 1
    while last > 0 and level[last - 1] < _FLAT_SHELF * level[last]:
        last -= 1  # the flat end: rounding, and what filters leave
    lowest = int(np.searchsorted(edges, moving))
    for top in range(last, lowest + _SHELF, -1):
        shelf = level[top - _SHELF : top]
        beyond = float(np.max(level[min(int(_BEYOND * top) + 1, bands - 1) :]))
        steep = beyond < np.min(shelf) / _STEEP and level[-1] < np.min(shelf) / _FALLS
        if steep and np.max(shelf) < _FLAT_SHELF * np.min(shelf):
            return int(edges[top]) - 1
    return None


def where_white(tests: Sequence[Recording]) -> list[Recording]:
    """The recordings at a sample rate at which the noise of every measured channel of the motion is white.

    Samples are left out, no filter is applied: noise that is white stays so, and what was low-passed holds nothing that
    could fold back.
    """
    if all(is_noise_free(test.channel("F")) and not _is_filtered(test) for test in tests):
        return list(tests)  # a simulation: what falls steeply is the motion
    found = [_corners(tests, name) for name in "xva"]
    return [_thinned(test, min(each)) for test, *each in zip(tests, *found, strict=True)]


def _is_filtered(test: Recording) -> bool:
    """Whether force and motion were low-passed with noise: up to a corner each, and there each has a noise of its own.
    What both have in common is motion, which may end as steeply."""
    channels = [values for name in "Fxva" if (values := getattr(test, name)) is not None]
    corners = [corner(values, test.dt) for values in channels]
    length = min(len(test) // 8, 2048)
    for values, end in zip(channels[1:], corners[1:], strict=True):
        top = min(corners[0], end)
        if np.isfinite(corners[0]) and np.isfinite(end):
            frequency, alike = coherence(channels[0], values, fs=1 / test.dt, nperseg=length)
            lowest = (1 - _SHELF / _FEWEST_BANDS) * top  # of a spectrum of the fewest bands, a shelf takes as much
            shelf = (frequency > lowest) & (frequency < top)
            if np.any(shelf) and float(np.median(alike[shelf])) < _ALIKE_COHERENCE:
                return True
    return False


def _corners(tests: Sequence[Recording], name: str) -> list[float]:
    """Corner of one channel in each recording, if most show it or may hide it: a filter is in all of them.

    A filter is set in Hz or in shares of the sample rate: the lower of both counts.
    """
    found = np.array(
        [corner(values, test.dt) if (values := getattr(test, name)) is not None else np.nan for test in tests]
    )
    seen = found[np.isfinite(found)]
    if not len(seen) or np.count_nonzero(np.isinf(found)) >= len(seen):
        return [np.inf] * len(tests)
    dt = np.array([test.dt for test in tests])
    share = float(np.median((found * dt)[np.isfinite(found)]))
    return [min(float(np.median(seen)), share / step) for step in dt]


def _thinned(test: Recording, lowest: float) -> Recording:
    every = int(np.ceil(0.5 / (test.dt * lowest))) if np.isfinite(lowest) else 1
    if every < 2 or len(test) // every < _SHORTEST_LEFT:
        return test
    told = f"a channel was low-passed at {lowest:.3g} Hz; one sample in {every} is used: there its noise is white"
    return test.part(slice(None, None, every), f"{test.name}: {told}")
