"""What smoothing by a user leaves of white noise: moving means, once or twice, by a Hann window too, and Savitzky-Golay
filters.

Such noise has no edge. It falls, is nought at some frequencies, and rises again behind each of them, as no motion does.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from scipy.optimize import isotonic_regression
from scipy.signal import savgol_coeffs

from hystid.numeric import Array

_LONGEST_KERNEL = 51  # samples of a smoothing kernel
_DEGREES = (2, 4)  # of the polynomials of Savitzky and Golay (1964), Anal. Chem. 36: those of 3 and 5 are the same
_LINES = 1024  # of a spectrum at most; neighbours are averaged in longer ones
_NULL = 1e-3  # of the mean response, which is left where a response is nought: leakage, and rounding in a text file


def kernel_of_smoothing(power: Array, first: int, end: int) -> Array | None:
    """The kernel that these lines of a periodogram (n,) are most probable under.

    White noise behind a kernel has independent lines of exponential distribution (Whittle, 1953). None where white
    noise without a kernel is as probable, or a spectrum that falls in steps and never rises, as that of motion, each
    step at its cost (Schwarz 1978), or nothing is there.
    """
    width = -(-len(power) // _LINES)
    count = len(power) // width
    inside = slice(first // width, end // width)
    binned = power[: count * width].reshape(count, width).mean(axis=1)[inside]
    if not np.all(binned > 0):
        return None
    responses = _responses(count)[:, inside]
    responses = responses + _NULL * responses.mean(axis=1, keepdims=True)
    deviance = width * (len(binned) * np.log(np.mean(binned / responses, axis=1)) + np.sum(np.log(responses), axis=1))
    best = int(np.argmin(deviance))
    white = width * len(binned) * np.log(np.mean(binned))
    steps = isotonic_regression(binned, increasing=False)  # blocks: borders of its steps; a kernel has one level too
    falling = width * float(np.sum(np.log(steps.x))) + 0.5 * (len(steps.blocks) - 2) * np.log(len(binned))
    return _kernels()[best] if deviance[best] <= min(white - 2 * np.log(len(responses)), falling) else None


@lru_cache(maxsize=1)
def _kernels() -> list[Array]:
    windows = [np.ones(length) for length in range(3, _LONGEST_KERNEL + 1)]
    windows += [np.convolve(mean, mean) for mean in windows if 2 * len(mean) - 1 <= _LONGEST_KERNEL]
    windows += [np.hanning(length)[1:-1] for length in range(5, _LONGEST_KERNEL + 3)]
    polynomials = [(w, degree) for degree in _DEGREES for w in range(degree + 3, _LONGEST_KERNEL + 1, 2)]
    kernels = [window / np.sum(window) for window in windows]
    return kernels + [savgol_coeffs(window, degree) for window, degree in polynomials]


def response(kernel: Array, cycles: Array) -> Array:
    """Power response of a kernel over frequencies [cycles per sample], (n,)."""
    fine = np.abs(np.fft.rfft(kernel, 2 * _LINES)) ** 2
    return np.asarray(np.interp(cycles, np.linspace(0, 0.5, len(fine)), fine))


@lru_cache(maxsize=4)
def _responses(count: int) -> Array:
    return np.array([response(kernel, np.linspace(0, 0.5, count)) for kernel in _kernels()])


def corner(kernel: Array) -> float:
    """Frequency [cycles per sample] from which on a kernel takes half of the power."""
    cycles = np.linspace(0, 0.5, _LINES)
    return float(cycles[np.argmax(response(kernel, cycles) < 0.5)])
