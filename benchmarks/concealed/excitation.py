"""Forces of the virtual tests at every instant: multisine, chirp, slow cycles with a sweep, stepped harmonics."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from benchmarks.concealed.rig import Array

Kind = Literal["multisine", "chirp", "slow", "harmonics"]


@dataclass(frozen=True)
class Test:
    """One test: kind, band [Hz], level [N] (peak of the force), seed of its phases; frequencies for harmonics [Hz]."""

    kind: Kind
    band: tuple[float, float]
    level: float
    seed: int
    frequencies: tuple[float, ...] = ()


def force(test: Test, duration: float, n: int) -> Array:
    """Force at n instants spread over [0, duration] (the first and the last included) [N]; it starts from zero."""
    t = np.linspace(0.0, duration, n)
    shape = {"multisine": _multisine, "chirp": _chirp, "slow": _slow, "harmonics": _harmonics}[test.kind](test, t)
    rise = np.clip(t / min(0.15, 0.05 * duration), 0, 1)
    shape = shape * rise * rise * (3 - 2 * rise)
    return np.asarray(test.level * shape / np.max(np.abs(shape)))


def _multisine(test: Test, t: Array) -> Array:
    """Random phases, equal amplitudes on every line of the record length inside the band."""
    lines = np.arange(int(np.ceil(test.band[0] * t[-1])), int(test.band[1] * t[-1]) + 1)
    phases = np.random.default_rng(test.seed).uniform(0, 2 * np.pi, len(lines))
    spectrum = np.zeros((len(t) - 1) // 2 + 1, dtype=complex)
    spectrum[lines] = np.exp(1j * phases)
    one_period = np.fft.irfft(spectrum, len(t) - 1) * (len(t) - 1) / 2
    return np.append(one_period, one_period[0])


def _chirp(test: Test, t: Array) -> Array:
    low, high = test.band
    return np.asarray(np.sin(2 * np.pi * (low * t + 0.5 * (high - low) * t * t / t[-1])))


def _slow(test: Test, t: Array) -> Array:
    """Slow cycles of growing size, then a sweep of a quarter of their force."""
    part = 0.55 * t[-1]
    cycles = np.sin(2 * np.pi * 5 * t / part) * (0.35 + 0.65 * t / part)
    rest = np.clip(t - part, 0, None)
    low, high = test.band
    sweep = 0.25 * np.sin(2 * np.pi * (low * rest + 0.5 * (high - low) * rest * rest / (t[-1] - part)))
    fade = np.clip(rest / 0.1, 0, 1)
    return np.asarray(np.where(t < part, cycles, fade * sweep))


def _harmonics(test: Test, t: Array) -> Array:
    """One frequency after the other, phase continuous."""
    index = np.minimum((t / t[-1] * len(test.frequencies)).astype(int), len(test.frequencies) - 1)
    rate = 2 * np.pi * np.asarray(test.frequencies)[index]
    return np.asarray(np.sin(np.concatenate([[0.0], np.cumsum(0.5 * (rate[1:] + rate[:-1]) * np.diff(t))])))
