"""Comparing two signals: error measures, spectra, harmonics, loop energy, tolerance tubes.

NRMSE is rms(error) / std(reference), a fraction, everywhere in hystid.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hystid.errors import NumericalError, UsageError
from hystid.numeric import Array


def nrmse(values: Array, reference: Array) -> float:
    """rms(values - reference) / std(reference), shape (n,) each.

    Raises UsageError for different lengths, NumericalError for a constant reference or values that are not finite.
    """
    error = _difference(values, reference)
    spread = float(np.std(reference))
    if spread == 0.0:
        raise NumericalError("NRMSE has no scale: the reference is constant")
    return float(np.sqrt(np.mean(error**2))) / spread


def mse(values: Array, reference: Array) -> float:
    """Mean of (values - reference)^2, in the square of their unit. Errors as for ``nrmse``."""
    return float(np.mean(_difference(values, reference) ** 2))


def _difference(values: Array, reference: Array) -> Array:
    if values.shape != reference.shape:
        raise UsageError(f"signals of {values.size} and {reference.size} samples cannot be compared")
    error = values - reference
    if not np.all(np.isfinite(error)):
        sample = int(np.flatnonzero(~np.isfinite(error))[0])
        raise NumericalError(f"the signals cannot be compared: sample {sample} is not finite (the model diverged?)")
    return np.asarray(error)


@dataclass(frozen=True)
class Spectrum:
    """One-sided power spectral density. frequency [Hz] and density [unit2/Hz], shape (bins,)."""

    frequency: Array
    density: Array

    @property
    def level_db(self) -> Array:
        """Density in dB re the largest bin."""
        return np.asarray(10 * np.log10(np.maximum(self.density / np.max(self.density), 1e-30)))


def spectrum(values: Array, dt: float, *, segment: int = 8192) -> Spectrum:
    """Power spectral density by Welch's method (1967): Hann windows of ``segment`` samples, half overlapped."""
    from scipy.signal import welch

    frequency, density = welch(values, fs=1 / dt, nperseg=min(segment, values.size), detrend="constant")
    return Spectrum(np.asarray(frequency), np.asarray(density))


@dataclass(frozen=True)
class Harmonics:
    """Harmonics of a periodic signal: values = offset + sum amplitude_k cos(2 pi k f t + phase_k) + residual.

    order 1..count; amplitude in the signal's unit, phase in rad, level_db re the first harmonic; all shape (count,).
    residual is the rms of what no harmonic describes.
    """

    fundamental: float
    order: Array
    amplitude: Array
    phase: Array
    offset: float
    residual: float

    @property
    def level_db(self) -> Array:
        """Levels in dB re the fundamental, not below -300 dB."""
        return np.asarray(20 * np.log10(np.maximum(self.amplitude / max(self.amplitude[0], 1e-300), 1e-15)))

    @property
    def even_level_db(self) -> float:
        """All even harmonics together, dB re the fundamental."""
        power = float(np.sum(self.amplitude[1::2] ** 2))
        return float(20 * np.log10(max(np.sqrt(power) / max(self.amplitude[0], 1e-300), 1e-15)))


def harmonics(values: Array, dt: float, fundamental: float, *, count: int = 10) -> Harmonics:
    """Least-squares fit of offset and harmonics at a known frequency [Hz]; no window and no whole periods are needed.

    values: shape (n,), steady and at least two periods long. Harmonics at or above the Nyquist frequency are left out.
    Raises UsageError when the signal is shorter or the frequency not resolvable.
    """
    periods = values.size * dt * fundamental
    if fundamental <= 0 or fundamental >= 0.5 / dt or periods < 2:
        raise UsageError(
            f"harmonics of {fundamental:g} Hz need two periods and two samples a period; got {periods:.3g}"
        )
    order = np.arange(1, count + 1)
    order = order[order * fundamental < 0.499 / dt]
    angle = 2 * np.pi * fundamental * dt * np.arange(values.size)
    basis = np.column_stack([np.ones(values.size), *(f(k * angle) for k in order for f in (np.cos, np.sin))])
    solution = np.linalg.lstsq(basis, values, rcond=None)[0]
    cosine, sine = solution[1::2], solution[2::2]
    residual = float(np.sqrt(np.mean((values - basis @ solution) ** 2)))
    amplitude, phase = np.hypot(cosine, sine), np.arctan2(-sine, cosine)
    return Harmonics(fundamental, order.astype(np.float64), amplitude, phase, float(solution[0]), residual)


def loop_energy(x: Array, R: Array) -> float:
    """Work done against R along x, the integral of R dx [J], by the trapezoidal rule.

    Over whole cycles this is the energy dissipated; positive for a dissipative force with hystid's sign of R.
    Raises UsageError for different lengths.
    """
    if x.shape != R.shape:
        raise UsageError(f"signals of {x.size} and {R.size} samples make no loop")
    return float(np.sum(0.5 * (R[1:] + R[:-1]) * np.diff(x)))


@dataclass(frozen=True)
class Tube:
    """A band around a reference and what lies outside. All arrays of shape (n,).

    outside: samples beyond the band. worst: largest distance beyond the band [unit of the signal], 0 inside.
    """

    lower: Array
    upper: Array
    outside: Array
    worst: float

    @property
    def holds(self) -> bool:
        """Whether every sample lies inside."""
        return not bool(self.outside.any())


def tube(values: Array, reference: Array, *, relative: float = 1e-3, absolute: float = 0.0, samples: int = 1) -> Tube:
    """Whether values stay in a band around the reference, both of shape (n,) on one grid.

    Half height: relative * (max - min of the reference) + absolute. Half width: ``samples`` samples to either side, so
    that an event located one step earlier or later by another solver does not count as a difference.
    A value that is not finite is outside; where the reference is not, the value must be the same.
    Raises UsageError for different lengths.
    """
    if values.shape != reference.shape:
        raise UsageError(f"signals of {values.size} and {reference.size} samples cannot be compared")
    finite = np.isfinite(reference)
    size = relative * reference[finite]  # its range would overflow for the largest numbers
    height = float(size.max() - size.min()) + absolute if size.size else absolute
    lower = neighbours(np.where(finite, reference, np.inf), samples).min(axis=1) - height
    upper = neighbours(np.where(finite, reference, -np.inf), samples).max(axis=1) + height
    lower[~finite] = upper[~finite] = np.nan
    beyond = np.maximum(np.maximum(lower - values, values - upper), 0.0)
    same = (values == reference) | (np.isnan(values) & np.isnan(reference))
    beyond[~finite] = np.where(same[~finite], 0.0, np.inf)
    outside = ~(beyond == 0.0)
    return Tube(lower, upper, outside, float(np.max(np.where(np.isfinite(beyond), beyond, np.inf), initial=0.0)))


def neighbours(values: NDArray[Any], samples: int) -> NDArray[Any]:
    """Each value and so many samples to either side of it, shape (n, 2 samples + 1); the ends are repeated."""
    return np.lib.stride_tricks.sliding_window_view(np.pad(values, samples, mode="edge"), 2 * samples + 1)
