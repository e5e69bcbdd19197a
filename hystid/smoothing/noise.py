"""How noisy is a channel: robust estimates that signals, jumps and outliers hardly move."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.special import binom

Array = NDArray[np.float64]
_DIFFERENCES = 6
_RESTING = 0.4  # share of samples that repeat the one before, above which a channel is a staircase
_BANDS = np.linspace(0.5, 0.98, 5)  # of the Nyquist frequency: where recordings that are sampled well hold noise alone
_SPREAD = 2.5  # standard error of the difference of two medians of windowed powers, times the root of their number
_APART = 0.9  # the estimates differ by 6 % by chance (8,000 samples); only a clear difference counts
_RESOLUTION = 1e-7  # noise below this share of a channel cannot be told from rounding in a text file
_NOISE_FREE = 2e-5  # noise over spread: below the 16 bit of any converter


def noise_level(channel: Array) -> float:
    """Standard deviation of the white noise on a channel (its unit).

    The lower of two estimates, as each can only be raised by the signal: the median absolute sixth difference (Huber's
    idea, blind to single jumps), and the median of the periodogram in the quietest part of the upper half of the band.
    White noise is assumed; noise that falls with frequency is underestimated.
    """
    floor = _RESOLUTION * float(np.std(channel))
    if len(channel) < 64:
        return float(max(floor, float(np.std(np.diff(channel, 2))) / np.sqrt(6.0)))
    differences, spectrum = _by_differences(channel), _by_spectrum(channel)
    return max(floor, _by_steps(channel), differences if differences < _APART * spectrum else spectrum)


def steps(channel: Array) -> NDArray[np.intp] | None:
    """Number of the step that each sample of a staircase stands on, shape (n,); None where the channel does not rest.

    Coarse resolution or a slow display: the error of such a channel is the same over a whole step.
    """
    resting = np.diff(channel) == 0.0
    if np.mean(resting) < _RESTING or np.all(resting):
        return None
    return np.concatenate([[0], np.cumsum(~resting)])


def _by_steps(channel: Array) -> float:
    """Error of a channel that rests between steps; 0 where it does not."""
    if steps(channel) is None:
        return 0.0
    change = np.diff(channel)
    resting = change == 0.0
    return float(np.sqrt(np.mean(change[~resting] ** 2) / 3.0))


def _by_differences(channel: Array) -> float:
    scale = np.sqrt(binom(2 * _DIFFERENCES, _DIFFERENCES))
    difference = np.diff(channel, _DIFFERENCES) / scale
    return float(np.median(np.abs(difference)) / 0.6745)


def _by_spectrum(channel: Array) -> float:
    window = np.hanning(len(channel))
    power = np.abs(np.fft.rfft((channel - np.mean(channel)) * window)) ** 2 / np.sum(window**2)
    edges = (_BANDS * (len(power) - 1)).astype(int)
    bands = [power[low:high] for low, high in pairwise(edges)]
    levels = [float(np.median(band)) for band in bands]
    # The quietest band alone would be too quiet by chance: all that may be as quiet (3 standard errors) count.
    alike = min(levels) * (1.0 + 3.0 * _SPREAD / np.sqrt(len(bands[0])))
    quiet = np.concatenate([band for band, level in zip(bands, levels, strict=True) if level <= alike])
    return float(np.sqrt(np.median(quiet) / np.log(2.0)))  # the median of an exponential variable is ln 2 of its mean


def is_noise_free(values: Array) -> bool:
    """Whether a channel (n,) shows no noise: less than the 16 bit of any converter leaves, as in a simulation."""
    return noise_level(values) <= _NOISE_FREE * float(np.std(values))
