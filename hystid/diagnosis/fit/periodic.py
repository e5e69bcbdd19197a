"""A periodic force that nobody measured: the mains on a force channel, a fan, a pump, the press next door.

It is a line in what the refitted baseline leaves: narrow, of one phase all through a recording, at one frequency in all
of them, and no harmonic of the measured force. It is taken out, and told with its frequency and amplitude.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2, gamma

from hystid.diagnosis.fit.hypothesis import Fit, Hypothesis, Term
from hystid.diagnosis.fit.problem import Problem
from hystid.diagnosis.fit.search import try_term
from hystid.diagnosis.model.channel_effects import HUM, mains_hum
from hystid.diagnosis.prepare.pairs import CHANCE
from hystid.numeric import Array

_MAINS = (50.0, 60.0)  # Hz
_SHARE = (
    0.084  # of the misfit: less is what laws leave by their form (decide.criterion.FORM, one standard deviation up)
)
_MOST_LINES = 5  # lines that are taken out
_NEAR, _FAR = 3, 15  # distance of the neighbours from a line, in steps of the frequency resolution
_QUANTILE = 0.9  # of the neighbours that says how loud they are; of an exponential variable it is ln 10 of the mean
_SECTIONS, _STEADY = 6, 0.6  # of a recording, and the share of a line's power that is coherent over them: random phases
# leave 1/6, a sweep that runs through the line as much; a steady line of six standard errors leaves 0.9
_HARMONICS = 60  # of a sine test, whose distortion is no line of its own
_DOMINANT = 0.5  # share of the power of the force in one line that makes a sine test
_WHOLE = 0.9  # of a line of the force (amplitude) that is left where no motion answers it: no model is off by as much
_HIGHEST = 0.4  # of the rate of averaged rows: beyond, averaging has taken the line out already


@dataclass(frozen=True)
class PeriodicForce:
    """A line that was taken out. frequency [Hz]; amplitudes: (N, standard error) per recording; is_mains."""

    frequency: float
    amplitudes: tuple[tuple[float, float], ...]

    @property
    def is_mains(self) -> bool:
        """Whether it is a harmonic of 50 or 60 Hz, as near as the mains keep it (0.2 %)."""
        return any(abs(self.frequency - k * f) < 0.002 * k * f for f in _MAINS for k in (1, 2, 3))

    def sentence(self) -> str:
        """For people."""
        return f"{self.told()}, was taken out of the balance"

    def told(self) -> str:
        """What it is, for people."""
        size, error = max(self.amplitudes)
        source = "of the mains" if self.is_mains else "that no channel shows"
        return f"a periodic force {source}, {self.frequency:.4g} Hz with an amplitude of {size:.3g} ± {error:.2g} N"

    def as_dict(self) -> dict[str, Any]:
        """As in ``diagnosis.json``; amplitudes per recording in the unit of the force."""
        amplitudes = [{"value": size, "stderr": error} for size, error in self.amplitudes]
        return {"frequency_Hz": self.frequency, "amplitudes": amplitudes, "is_mains": self.is_mains}


def without_periodic_forces(problem: Problem, baseline: Fit) -> Fit:
    """The fit with every periodic force that nobody measured taken out.

    Lines of one frequency in all recordings, of any phase and amplitude in each. None where time was not measured.
    """
    if not problem.timed:
        return baseline
    fitted, frequencies = baseline, list[float]()
    while len(frequencies) < _MOST_LINES:
        frequency, tried = _line(problem, fitted.hypothesis, frequencies)
        if frequency is None:
            break
        least = _by_chance(len(problem.parts), tried)
        effect = mains_hum(len(problem.parts), frequency)
        made = try_term(problem, fitted, Term(effect, dict.fromkeys(effect.amplitudes, 0.0)))
        if made is None:
            break
        gain = fitted.chi2 - made.chi2
        is_chance = gain * len(made.residual) < least * made.chi2
        if is_chance or gain < _SHARE * (fitted.chi2 - problem.reduce.level):
            break
        if not _is_everywhere(problem, fitted, made):
            break
        fitted = made
        frequencies.append(frequency)
    return fitted


def _by_chance(recordings: int, frequencies: int) -> float:
    """What two amplitudes in each recording take of the sum of squares of noise, at the best of some frequencies."""
    return float(chi2.isf(CHANCE / frequencies, 2 * recordings))


def _is_everywhere(problem: Problem, before: Fit, after: Fit) -> bool:
    """Whether less is left in most sections of the recording in which the line is strongest: what comes and goes with
    the motion, as at a resonance, is paid for everywhere else."""
    pairs = zip(problem.by_part(before.residual), problem.by_part(after.residual), strict=True)
    gains = [np.array([np.sum(part) for part in np.array_split(u**2 - w**2, _SECTIONS)]) for u, w in pairs]
    return bool(np.median(max(gains, key=np.sum)) > 0)


def periodic_forces(fitted: Fit) -> tuple[PeriodicForce, ...]:
    """The periodic forces of a fit, but those of which it leaves no more than chance: beside a law that was missing, or
    noise that is louder at some frequencies, what looked like one may be gone."""
    found, tried = [], len(fitted.residual)  # as many frequencies as rows, at most
    for i, term in enumerate(fitted.hypothesis.terms):
        if term.effect.id != HUM:
            continue
        sizes = []
        for sine, cosine in zip(term.effect.amplitudes[::2], term.effect.amplitudes[1::2], strict=True):
            size = float(np.hypot(term.values[sine], term.values[cosine]))
            error = float(np.hypot(fitted.stderr((str(i), sine)), fitted.stderr((str(i), cosine)))) / np.sqrt(2)
            sizes.append((size, error))
        if not sum((size / error) ** 2 for size, error in sizes if error > 0) < _by_chance(len(sizes), tried):
            found.append(PeriodicForce(float(term.effect.form), tuple(sizes)))
    return tuple(found)


def _line(problem: Problem, hypothesis: Hypothesis, known: Sequence[float]) -> tuple[float | None, int]:
    """Frequency [Hz] of the clearest line that is left, None where its neighbours are about as clear; and the number of
    frequencies that were looked at."""
    spectra = [
        _Spectrum(residual, part.F, part.dt)
        for residual, part in zip(problem.balance(hypothesis), problem.parts, strict=True)
    ]
    rate = 0.5 if problem.reduce.block == 1 else _HIGHEST / problem.reduce.block
    highest = min(rate / part.dt - _FAR / s.length for part, s in zip(problem.parts, spectra, strict=True))
    grid = max(spectra, key=lambda s: s.length)
    lowest = max((_FAR + 1) / s.length for s in spectra)
    frequencies = np.arange(lowest, highest, 0.5 / grid.length)
    if len(frequencies) == 0:
        return None, 0
    free = ~np.array([s.is_excited(frequencies) for s in spectra])  # what is driven in one recording may show in others
    clear = np.sum(free * np.array([s.clearness(frequencies) for s in spectra]), axis=0)
    for s in spectra:
        for one in known:
            clear[s.is_beside(frequencies, one)] = 0.0
    needed = np.asarray(gamma.isf(CHANCE / len(frequencies), np.arange(1, len(spectra) + 1)))
    beyond = clear / needed[np.maximum(np.sum(free, axis=0), 1) - 1]
    for k in np.argsort(beyond)[::-1][:_MOST_LINES]:  # the clearest may be a sweep that passes by
        if beyond[k] < 1.0:
            break
        frequency = _refined(spectra, float(frequencies[k]), 0.5 / grid.length)
        if (
            np.average([s.steadiness(frequency) for s in spectra], weights=[s.power(frequency) for s in spectra])
            > _STEADY
        ):
            return frequency, len(frequencies)
    return None, len(frequencies)


def _refined(spectra: Sequence[_Spectrum], start: float, step: float) -> float:
    """Frequency near a start at which the power of all recordings together is largest."""
    best = start
    while step > 1e-3 / max(s.length for s in spectra):
        tried = [best - step, best, best + step]
        best = max(tried, key=lambda f: sum(s.power(f) for s in spectra))
        step *= 0.5
    return float(best)


class _Spectrum:
    """What is left of the balance of one recording, and its measured force, by frequency."""

    def __init__(self, residual: Array, force: Array, dt: float) -> None:
        self._dt, self._residual = dt, residual - np.mean(residual)
        self._window = np.hanning(len(residual))
        self.length = len(residual) * dt
        self._bins = np.arange(len(residual) + 1) / (2 * len(residual) * dt)  # zero-padded twice
        self._power = self._padded(self._residual)
        self._force = self._padded(force - np.mean(force))
        self._main = float(self._bins[int(np.argmax(self._force))])
        near = np.abs(self._bins - self._main) < 2 / self.length
        self._sine = float(np.sum(self._force[near])) > _DOMINANT * float(np.sum(self._force))
        lines = _over_neighbours(self._force, np.arange(float(len(self._bins)))) > np.log(len(self._bins) / CHANCE)
        self._tones = not self._sine and float(np.sum(self._force[lines])) > _DOMINANT * float(np.sum(self._force))

    def _padded(self, values: Array) -> Array:
        return np.abs(np.fft.rfft(values * self._window, 2 * len(values))) ** 2

    def clearness(self, frequencies: Array) -> Array:
        """Power over the mean of the neighbours; exponentially distributed where there is noise alone."""
        return _over_neighbours(self._power, np.interp(frequencies, self._bins, np.arange(len(self._bins))))

    def is_excited(self, frequencies: Array) -> NDArray[np.bool_]:
        """Whether the measured force has a line there, or a line of which it is a harmonic.

        Of a line that is in the channel alone, as hum of its cable, mass and law explain nothing: all of it is left.
        """
        at = np.interp(frequencies, self._bins, np.arange(len(self._bins)))
        left = np.interp(at, np.arange(len(self._bins)), self._power / np.maximum(self._force, 1e-300))
        lines = _over_neighbours(self._force, at) > np.log(len(self._bins) / CHANCE)
        lines &= ~((left > _WHOLE**2) & (left < 1 / _WHOLE**2))
        mains = np.array([k * f for f in _MAINS for k in (1, 2, 3)])
        others = np.min(np.abs(frequencies[:, None] - mains), axis=1) > 1 / self.length
        if self._tones:  # a curved law makes sums and differences of many tones: only the mains are known beforehand
            lines |= others
        elif not self._sine:  # nobody drives at the mains alone beside a broad force: it hums, and so may the motion
            lines &= others
        if self._sine and self._main > 0:
            order = np.rint(2 * frequencies / self._main)  # halves too: a period may double
            there = np.abs(frequencies - order * self._main / 2) < _NEAR / self.length
            lines |= there & (order > 0) & (order <= 2 * _HARMONICS)
        return np.asarray(lines)

    def is_beside(self, frequencies: Array, line: float) -> NDArray[np.bool_]:
        """Whether frequencies are that of a known line, or in a sine test what a curved law makes of both: a sum or a
        difference of the line and a harmonic."""
        found = np.abs(frequencies - line) < _NEAR / self.length
        for sign in (-1, 1) if self._sine else ():
            order = np.rint((frequencies + sign * line) / self._main)
            found |= np.abs(frequencies + sign * line - order * self._main) < _NEAR / self.length
        return np.asarray(found)

    def _sum(self, frequency: float, part: slice = slice(None)) -> complex:
        k = np.arange(len(self._residual))[part]
        return complex(np.sum((self._window * self._residual)[part] * np.exp(-2j * np.pi * frequency * self._dt * k)))

    def power(self, frequency: float) -> float:
        """Power of what is left at one frequency."""
        return abs(self._sum(frequency)) ** 2

    def steadiness(self, frequency: float) -> float:
        """Share of the power of a line that has one phase in all sections of the recording."""
        edges = pairwise(np.linspace(0, len(self._residual), _SECTIONS + 1).astype(int))
        parts = [slice(first, last) for first, last in edges]
        size = np.array([np.sum(self._window[part]) for part in parts])
        amplitudes = np.array([self._sum(frequency, part) for part in parts]) / size
        return float(abs(np.sum(size * amplitudes)) ** 2 / (np.sum(size) * np.sum(size * np.abs(amplitudes) ** 2)))


def _over_neighbours(power: Array, at: Array) -> Array:
    """Power at bins of a spectrum that was zero-padded twice, over the mean that its neighbours suggest."""
    bins = np.clip(np.rint(at).astype(int), 0, len(power) - 1)
    beside = np.concatenate([np.arange(-2 * _FAR, -2 * _NEAR + 1), np.arange(2 * _NEAR, 2 * _FAR + 1)])
    around = power[np.clip(bins[:, None] + beside, 0, len(power) - 1)]
    level = np.quantile(around, _QUANTILE, axis=1) / np.log(1 / (1 - _QUANTILE))
    return np.asarray(power[bins] / np.maximum(level, 1e-300))
