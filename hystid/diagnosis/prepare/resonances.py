"""How many resonances does the structure have? One mass on whatever law has one; a second one is another mass.

The mobility v/F of a single mass rises to one peak and falls, its phase from +90 to -90 degrees. Peaks that are parted
by a dip are resonances of several masses, which no law of x and v explains.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.signal import csd, find_peaks, peak_prominences, welch

from hystid.diagnosis.prepare.segments import Part
from hystid.numeric import Array

_SEGMENTS = 12  # averaged spectra at least: with fewer the coherence of noise alone is high
_LINES = 4096  # samples of a segment at most
_COHERENT = 0.8  # coherence at a peak: four fifths of the motion there follow the force, whatever the law
_BESIDE = 6  # lines on either side of a peak that say how coherent it is: at a sharp peak itself leakage takes most
_SIGMAS = 5.0  # standard errors of the amplitude by which a dip parts two peaks
_DIP = np.log(2.0)  # but 6 dB at least: what filters and curved laws make of one peak is less
_WIDE = 2.0  # highest over lowest frequency of the force: a narrower test, or a sine, shows one resonance at most


@dataclass(frozen=True)
class _Mobility:
    """v over F by frequency [Hz]: logarithm of its amplitude, with standard error, and coherence."""

    frequency: Array
    size: Array
    error: Array
    coherence: Array


def resonances(parts: Sequence[Part]) -> list[float]:
    """Frequencies [Hz] of the resonances between force and motion; empty where no recording shows more than one.

    The recording that shows most counts. Harmonics of a sine test are no resonances: such tests are passed over.
    """
    found: list[float] = []
    for part in parts:
        mobility = _mobility(part)
        if mobility is not None:
            peaks = _peaks(mobility)
            found = max(found, peaks, key=len)
    return found if len(found) > 1 else []


def several_masses(frequencies: Sequence[float]) -> list[str]:
    """The sentence for the notes; nothing for a single mass."""
    if len(frequencies) < 2:
        return []
    listed = ", ".join(f"{f:.3g}" for f in frequencies[:-1])
    return [f"not one mass: resonances at {listed} and {frequencies[-1]:.3g} Hz (v over F, where both are coherent)"]


def _mobility(part: Part) -> _Mobility | None:
    """None for a test with one frequency, or too short for a spectrum."""
    n = int(min(_LINES, 2 * len(part) // (_SEGMENTS + 1)))
    if n < 64:
        return None
    rate = 1 / part.dt
    frequency, force = welch(part.F, fs=rate, nperseg=n)
    power = np.cumsum(force)
    low, high = frequency[np.searchsorted(power, [0.02 * power[-1], 0.98 * power[-1]])]
    if high < _WIDE * max(low, frequency[1]):
        return None
    omega = 2 * np.pi * np.maximum(frequency, frequency[1])
    name = next(name for name in "vax" if name in part.measured)
    motion = part.measured[name]
    cross, own = csd(part.F, motion, fs=rate, nperseg=n)[1], welch(motion, fs=rate, nperseg=n)[1]
    coherence = np.clip(np.abs(cross) ** 2 / np.maximum(force * own, 1e-300), 0, 1 - 1e-9)
    size = np.log(np.maximum(np.abs(cross) / np.maximum(force, 1e-300), 1e-300)) + np.log(omega) * (
        1 - "xva".index(name)
    )
    count = 1.8 * len(part) / n
    error = np.sqrt((1 - coherence) / (2 * np.maximum(coherence, 1e-9) * count))
    band = (frequency >= low) & (frequency <= high)
    return _Mobility(frequency[band], size[band], error[band], coherence[band])


def _peaks(mobility: _Mobility) -> list[float]:
    """Peaks that are parted from each other by dips that are no chance."""
    if len(mobility.size) < 8:
        return []
    smooth = np.convolve(np.pad(mobility.size, 1, mode="edge"), [0.25, 0.5, 0.25], mode="valid")
    places = find_peaks(smooth, prominence=_DIP)[0]
    kept = []
    for place, depth in zip(places, peak_prominences(smooth, places)[0], strict=True):
        near = slice(max(place - _BESIDE, 0), place + _BESIDE + 1)
        sure = depth > _SIGMAS * float(np.median(mobility.error[near])) * np.sqrt(2)
        if sure and np.median(mobility.coherence[near]) > _COHERENT:
            kept.append(float(mobility.frequency[place]))
    return kept
