"""Channels that a user faded in and out by a window (a taper): their noise fades as well, which no sensor does."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import lru_cache

import numpy as np

from hystid.diagnosis.prepare.pairs import CHANCE
from hystid.numeric import Array
from hystid.recording import Recording
from hystid.smoothing.noise import RESTING, is_white, scaled_differences

_AS_ONE = 3.2  # differences of sixth order of white noise that say as much as one that is independent: the sum of their
# squared correlations, C(24, 12) / C(12, 6)^2
_BLOCK, _BLOCKS = 16, 256  # samples of a block at least, and blocks of a recording at most
_POINTS = 8  # of a block, at which a window is known
_FLOORS = (1e-8, 1e-5, 1e-2)  # power over that of the noise, of what rounding after the window leaves at the ends
_WINDOWS: tuple[Callable[[Array], Array], ...] = (
    lambda share: np.sin(0.5 * np.pi * share) ** 4,  # power of a cosine taper (Tukey), of half a sine, of a trapezoid
    lambda share: np.sin(0.5 * np.pi * share) ** 2,
    lambda share: share**2,
)
_ROUNDED = 1e-3  # of the largest value, that three digits leave of what a window takes away
_KNOWN = 0.1  # of a window's length, to which noise tells it: the last tenth of a cosine taper takes off 2 %
_TOLD = "{0}: {1} fades in and out with its noise, as behind a window; {2} samples at either end are left out"


def between_tapers(test: Recording, fewest: int) -> Recording:
    """A recording without the ends at which a channel was faded in and out by a window, with a note. fewest: samples
    that must remain."""
    lengths = {name: _taper(values) for name, values in test.channels("Fxva").items() if test.direct(name)}
    longest = max(lengths.values(), default=0)
    if not longest or len(test) - 2 * longest < fewest:
        return test
    faded = " and ".join(name for name, length in lengths.items() if length)
    return test.part(slice(longest, len(test) - longest), _TOLD.format(test.name, faded, longest))


def _taper(channel: Array) -> int:
    """Samples at either end over which the noise of a channel (n,) fades in, and out likewise; 0 where it does not.

    Each block of differences has a mean square; that of noise behind a window follows the window. It competes with
    noise that is as loud all the time, and with noise that begins and ends at once, as that of steps of a converter
    while a structure rests.
    """
    if len(channel) < 8 * _BLOCK:
        return 0
    size = max(_BLOCK, len(channel) // _BLOCKS)
    count, quarter = len(channel) // size, len(channel) // 4
    squares = scaled_differences(channel) ** 2
    power = np.array([float(np.mean(block)) for block in np.array_split(squares, count)])
    usual = float(np.median(power[count // 4 : -(count // 4)]))
    if not usual or not is_white(channel[quarter:-quarter]):
        return 0
    power /= usual
    windows, steps = _powers(count)
    each = _likelihood(windows, power)
    best = int(np.argmax(each))
    number, beyond = divmod(best, count // 2 - 2)
    window, length = _WINDOWS[number], 2 + beyond  # in blocks
    odds = 0.5 * size / _AS_ONE * float(each[best] - np.max(_likelihood(steps, power)))
    faded = int(length * size) if odds > math.log(len(each) / CHANCE) else 0
    return int((1 + _KNOWN) * faded) + size if faded and _fades(channel, faded, size / faded, window) else 0


@lru_cache(maxsize=4)
def _powers(count: int) -> tuple[Array, Array]:
    """Mean power of each of so many blocks: behind all windows of all lengths, from two blocks to half of them,
    (windows, count), and of noise that begins and ends at once, (lengths, count)."""
    place = (np.arange(count * _POINTS) + 0.5) / _POINTS  # in blocks
    from_end = np.minimum(place, count - place).reshape(count, _POINTS)
    lengths = np.arange(2, count // 2)[:, None, None]
    windows = [np.mean(window(np.minimum(from_end / lengths, 1.0)), axis=-1) for window in _WINDOWS]
    steps = np.mean(from_end >= np.concatenate([[[[0]]], lengths]), axis=-1)
    return np.concatenate(windows), steps


def _likelihood(shapes: Array, power: Array) -> Array:
    """Logarithm of the likelihood, up to a constant, of blocks of such a power (count,), were their mean one of the
    shapes (k, count): of the best floor, (k,)."""
    made = [np.log(shapes + least) + power / (shapes + least) for least in _FLOORS]
    return np.asarray(-np.min([np.sum(one, axis=-1) for one in made], axis=0))


def _fades(channel: Array, samples: int, block: float, window: Callable[[Array], Array]) -> bool:
    """Whether a channel itself is within its window at both ends, and does not rest there. block: share of the window
    to which it is known where it begins."""
    place = np.arange(samples) / samples / (1 - _KNOWN) + block
    within = np.sqrt(window(np.minimum(place, 1.0))) + _ROUNDED
    ends = np.stack([channel[:samples], channel[: -samples - 1 : -1]])
    return bool(np.all(np.abs(ends) <= within * np.max(np.abs(channel))) and np.mean(np.diff(ends) == 0.0) < RESTING)
