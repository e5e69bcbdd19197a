"""Two channels of one motion, compared band by band without differentiating noise.

A channel is never differentiated. Both are convolved with one smooth kernel, the lower one with its derivative: the
integral of x g'' equals that of x'' g for every motion, so that the pair is one and the same signal where both
channels tell the truth, and any window acts on both alike. Bands are groups of neighbouring lines of one long
spectrum, so that a test of few cycles has its motion in a band of its own.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import factorial

import numpy as np
from numpy.polynomial.hermite_e import hermeval

from hystid.recording import Array

WIDTH = 1.5  # standard deviation of the kernel [samples]: its derivatives are exact to 1e-3 up to HIGHEST
HIGHEST = 2.5  # [rad per sample], four fifths of the Nyquist frequency
REACH = 10 / WIDTH  # widths of a kernel to either side: exp(-(10 / 1.5)^2 / 2) is 2e-10
_LINES = 6  # least lines in a band: a windowed sine spreads over four
_STEPS = 8  # bands per octave where there are lines enough


@dataclass(frozen=True)
class Bands:
    """Spectra of a pair (low, high) by band, each of shape (bands,).

    omega [rad/s]: centre of power. response: high over low, complex. coherence: squared, 0 to 1. count: lines.
    low, high: power of either in the units of the higher channel.
    """

    omega: Array
    response: np.ndarray[tuple[int], np.dtype[np.complex128]]
    coherence: Array
    count: Array
    low: Array
    high: Array

    @property
    def seen(self) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
        """Bands in which both channels hold one signal: coherence above a half, and above chance.

        Chance: one band in a thousand recordings, for a single band at a high frequency outweighs all others in a lag.
        """
        rare = 1e-3 / max(len(self.count), 1)
        chance = 1.0 - rare ** (1.0 / np.maximum(self.count - 1.0, 1.0))
        return np.asarray((self.coherence > 0.5) & (self.coherence > chance))

    @property
    def variance(self) -> Array:
        """Variance of ln|response| and of its phase [rad2] (Bendat and Piersol), from the coherence alone."""
        gamma = np.clip(self.coherence, 1e-12, 1.0)
        return np.asarray((1.0 - gamma) / (2.0 * self.count * gamma))


def kernel(order: int, width: float = WIDTH) -> Array:
    """Samples of the derivative of an order of a normal density, in units of 1 / samples^order."""
    reach = int(np.ceil(REACH * width))
    k = np.arange(-reach, reach + 1) / width
    density = np.exp(-0.5 * k**2) / (width * np.sqrt(2 * np.pi))
    shape = np.zeros(order + 1)
    shape[order] = 1.0
    return np.asarray((-1.0) ** order * hermeval(k, shape) * density / width**order)


def flat_kernel(order: int, width: float) -> Array:
    """The same of a density whose response is flat: exp(-s) (1 + s + ... + s^3/6) at s = (omega width)^2 / 2.

    At omega = 1.2 / width it passes 99 % of a signal, where the normal density passes 49 %. Two channels that are
    smoothed alike stay in a linear relation at any loss, but not in a curved one.
    """
    parts = [(-0.5 * width**2) ** j / factorial(j) * kernel(order + 2 * j, width) for j in range(4)]
    return np.asarray(sum(parts))


def derived(values: Array, order: int, dt: float, width: float = WIDTH, flat: bool = False) -> Array:
    """Derivative of an order of a channel, smoothed by one of the kernels; shape (n - 2 reach,)."""
    from scipy.signal import oaconvolve

    weights = flat_kernel(order, width) if flat else kernel(order, width)
    if len(values) <= len(weights) + 2:
        return np.zeros(0)
    return np.asarray(oaconvolve(values - np.mean(values), weights, mode="valid")) / dt**order


def compare(low: Array, high: Array, order: int, dt: float) -> Bands:
    """Bands of the pair (derivative of ``low`` of an order, ``high``), both of shape (n,)."""
    return bands(derived(low, order, dt), derived(high, 0, dt), dt)


def bands(low: Array, high: Array, dt: float) -> Bands:
    """Bands of two series of one kind, shape (n,) each."""
    n = min(len(low), len(high))
    if n < 4 * _LINES:
        nothing = np.zeros(0)
        return Bands(nothing, nothing.astype(np.complex128), nothing, nothing, nothing, nothing)
    window = np.hanning(n)
    # Weighed alike: the plain mean of a tone that is cut within its period would be slow motion.
    one, other = (np.fft.rfft(window * (y[:n] - np.average(y[:n], weights=window))) for y in (low, high))
    omega = 2 * np.pi * np.arange(len(one)) / n
    kept = omega < HIGHEST
    edges = _edges(int(np.count_nonzero(kept)))
    power = [np.add.reduceat(np.abs(y[: edges[-1]]) ** 2, edges[:-1]) for y in (one, other)]
    cross = np.add.reduceat((other * np.conj(one))[: edges[-1]], edges[:-1])
    share = np.abs(one[: edges[-1]]) ** 2 + 1e-300
    centre = np.add.reduceat(omega[: edges[-1]] * share, edges[:-1]) / np.add.reduceat(share, edges[:-1])
    tiny = 1e-300
    with np.errstate(over="ignore", under="ignore", invalid="ignore"):
        coherence = np.abs(cross) ** 2 / np.maximum(power[0] * power[1], tiny)
        # between the two estimates of a response, each blind to the noise of one channel
        size = np.sqrt(power[1] / np.maximum(power[0], tiny))
    size = np.nan_to_num(size, nan=0.0, posinf=0.0)  # channels whose powers leave the numbers have no response
    response = size * np.exp(1j * np.angle(np.nan_to_num(cross)))
    coherence = np.nan_to_num(coherence)
    count = np.diff(edges).astype(float) / 1.5  # a Hann window makes neighbouring lines depend on each other
    return Bands(centre / dt, response, np.minimum(coherence, 1.0), count, *power)


def _edges(lines: int) -> np.ndarray[tuple[int], np.dtype[np.intp]]:
    """First lines of the bands, from line 1 on: at least six lines each, and eight bands an octave."""
    found = [1]
    while found[-1] + _LINES <= lines:
        found.append(max(found[-1] + _LINES, round(found[-1] * 2 ** (1 / _STEPS))))
    found[-1] = min(found[-1], lines)
    return np.asarray(found if found[-1] - found[-2] >= _LINES or len(found) < 3 else [*found[:-2], found[-1]])
