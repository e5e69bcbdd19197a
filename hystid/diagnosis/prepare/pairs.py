"""How two channels of one motion fit together: lag and gain, from stretches of the recordings that have to agree.

A recording is cut into sections, and the band of the motion into a lower and an upper half. A clock that is late is
late by the same time everywhere, a sensor that is mis-scaled is so by the same factor; a filter, a wrong pair of
columns or noise is not. The scatter between the sections and between the halves is the error, whatever the coherence
promises.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations, pairwise

import numpy as np
from scipy.signal import get_window
from scipy.stats import t as student

from hystid.consistency.kinematics import ORDER
from hystid.diagnosis.prepare.differences import FIRST, derivative, spectra
from hystid.diagnosis.prepare.segments import measured_motion
from hystid.numeric import Array
from hystid.recording import Recording
from hystid.smoothing.noise import noise_level

_SECTIONS, _SHORTEST_SECTION = 6, 256  # sections per recording, and samples of one at least
CHANCE = 1e-3  # probability by chance of a lag, a taper or a line that is believed: one false alarm in 1000 of each
_HANN = 3 / 8  # mean square of the window
_FEWEST_SECTIONS = 1.5  # effective sections below which there is no scatter
_HIGHEST = 1.0  # rad per sample up to which the differences that derive a channel are exact to 0.1 %
_COHERENT = 0.5  # coherence from which a frequency counts
_FURTHEST = 0.25  # share of a recording over which a coarse lag is sought: three quarters still overlap
LEFT = 0.1  # share of the power beside which a shift or a factor is all: clipping or a filter leaves more
_SEEN = 0.1  # share of the power of both channels that is motion, below which noise hides how they fit together
_HALVES = 0.5  # difference of the halves of the band over their mean, from which it is a filter: phase over frequency
# falls with the square of the frequency beside a corner, and halves are apart by a factor of 1.3 at least
_AS_GOOD = 0.02  # correlation below the largest at which a smaller shift is preferred: a sine repeats itself


@dataclass(frozen=True)
class Estimate:
    """A figure that the sections agree on, or not, with the standard error that their scatter and halves show."""

    value: float
    stderr: float
    agrees: bool = False


@dataclass(frozen=True)
class ChannelPair:
    """Two channels of the motion, ``high`` the higher derivative.

    lag: how much later ``high`` is [s]. gain: logarithm of how much larger it is than what ``low`` says. Either agrees
    where it is not zero by chance. correlation: largest one in the band of the motion, at any shift, with what white
    noise of the channels takes from it put back; seen: whether noise leaves any. dt: sample time.
    """

    low: str
    high: str
    lag: Estimate
    gain: Estimate
    correlation: float
    seen: bool
    dt: float

    @property
    def is_one_motion(self) -> bool:
        """Whether both channels can be sensors of one motion."""
        return self.correlation > _COHERENT or not self.seen

    @property
    def samples(self) -> float:
        """The lag in samples."""
        return self.lag.value / self.dt


UNKNOWN = Estimate(0.0, float("inf"))


def pairs(recordings: Sequence[Recording]) -> list[ChannelPair]:
    """The measured channels of the motion that all recordings have, two by two."""
    names = [name for name in "xva" if all(name in measured_motion(r) for r in recordings)]
    return [_pair(recordings, low, high) for low, high in combinations(names, 2)]


def agreed(values: Array, weights: Array, halves: float = 0.0, chance: float = CHANCE) -> Estimate:
    """Weighted mean of what sections say, shape (k,); it agrees where it is not zero by chance (Student, two-sided).

    weights: inverse variances, up to a factor. halves: difference between the halves of the band. chance: probability.
    """
    share = weights / np.sum(weights)
    mean, count = float(share @ values), float(1 / np.sum(share**2))
    if count < _FEWEST_SECTIONS:
        return Estimate(mean, float("inf"))
    scatter = float(np.sqrt(np.sum(share**2 * (values - mean) ** 2) * count / (count - 1)))
    sure = float(student.isf(chance / 2, count - 1))
    return Estimate(
        mean, float(np.hypot(scatter, halves / 2)), abs(mean) > sure * scatter and halves < _HALVES * abs(mean)
    )


def _pair(recordings: Sequence[Recording], low: str, high: str) -> ChannelPair:
    both, dt = [_alike(recording, low, high) for recording in recordings], recordings[0].dt
    clears = [_clear(recording, two, low, high) for recording, two in zip(recordings, both, strict=True)]
    told = [k for k, clear in enumerate(clears) if clear > _SEEN] or range(len(both))  # the others say nothing
    both, recordings, clear = [both[k] for k in told], [recordings[k] for k in told], min(clears[k] for k in told)
    coarse, correlation = _coarse([(*two, r.dt) for two, r in zip(both, recordings, strict=True)])
    seen, correlation = clear > _SEEN, min(1.0, correlation / np.sqrt(max(clear, _SEEN)))
    found: list[tuple[int, float, float, float]] = []  # half, lag, gain, weight
    for (derived, measured), recording in zip(both, recordings, strict=True):
        shift, step = round(coarse / recording.dt), recording.dt
        for one, other in sections(*_moved(derived, measured, shift)):
            found += [(h, (shift + lag) * step, gain, w / step**2) for h, lag, gain, w in _spectra(one, other)]
    if not found or not seen or correlation**2 < 1 - LEFT:
        return ChannelPair(low, high, UNKNOWN, UNKNOWN, correlation, seen, dt)
    half, lag, gain, weight = np.array(found).T
    estimates = [agreed(values, weight, _between(values, weight, half)) for values in (lag, gain)]
    return ChannelPair(low, high, estimates[0], estimates[1], correlation, seen, dt)


def _between(values: Array, weights: Array, half: Array) -> float:
    """Difference between the two halves of the band."""
    if len(set(half)) < 2:
        return 0.0
    lower, upper = (float(np.average(values[half == h], weights=weights[half == h])) for h in (0, 1))
    return abs(lower - upper)


def _alike(recording: Recording, low: str, high: str) -> tuple[Array, Array]:
    """The lower channel, derived as often as the higher one is, per second each; and the higher one."""
    motion = measured_motion(recording)
    return derivative(motion[low], ORDER[high] - ORDER[low], recording.dt), motion[high]


def _coarse(pairs: Sequence[tuple[Array, Array, float]]) -> tuple[float, float]:
    """Lag [s] at which the channels correlate best, in steps of a sample, the smallest that is as good; correlation.

    Only the band of the motion is correlated: white noise of a derived displacement lies above it.
    """
    dt = min(step for _, _, step in pairs)
    furthest = int(_FURTHEST * min(len(one) * step for one, _, step in pairs) / dt)
    at = np.arange(-furthest, furthest + 1)
    total, power = np.zeros(len(at)), 0.0
    for derived, measured, step in pairs:
        one, other, _ = _in_band(derived, measured)
        found = _correlation(one, other, int(np.ceil(furthest * dt / step)))
        known = np.arange(-(len(found) // 2), len(found) // 2 + 1) * step
        total += np.interp(at * dt, known, found)
        power += float(np.sqrt(np.sum(one**2) * np.sum(other**2)))
    total /= max(power, 1e-300)
    best = int(np.argmax(total))
    if total[best] <= 0:
        return 0.0, 0.0
    peaks = np.flatnonzero((total[1:-1] >= total[:-2]) & (total[1:-1] >= total[2:])) + 1
    good = [k for k in (*peaks, best) if total[k] > total[best] - _AS_GOOD]
    return float(min((at[k] for k in good), key=abs) * dt), float(total[best])


def _clear(recording: Recording, both: tuple[Array, Array], low: str, high: str) -> float:
    """Share of the powers of both channels, in the band of the motion, that is not white noise: their product."""
    one, other, lines = _in_band(*both)
    motion = measured_motion(recording)
    band = 2 * np.pi * np.arange(lines.start, lines.stop) / len(one)
    gain = (np.abs(np.exp(1j * np.outer(band, np.arange(len(FIRST)) - len(FIRST) // 2)) @ FIRST) / recording.dt) ** (
        ORDER[high] - ORDER[low]
    )
    passed = np.array([float(np.sum(gain**2)), float(len(band))]) / (len(one) / 2)
    noise = np.array([noise_level(motion[low]), noise_level(motion[high])]) ** 2 * passed * _HANN
    power = np.array([float(np.mean(one**2)), float(np.mean(other**2))])
    return float(np.prod(np.clip(1 - noise / np.maximum(power, 1e-300), 0, 1)))


def _in_band(derived: Array, measured: Array) -> tuple[Array, Array, slice]:
    """Both channels between the frequencies that hold all but 1 % of the power of the measured one at either end;
    the lines that these are."""
    spectra = [np.fft.rfft((u - np.mean(u)) * np.hanning(len(u))) for u in (derived, measured)]
    power = np.cumsum(np.abs(spectra[0] * spectra[1]))
    low, high = np.searchsorted(power, [0.01 * power[-1], 0.99 * power[-1]])
    for spectrum in spectra:
        spectrum[:low] = 0
        spectrum[high + 1 :] = 0
    one, other = (np.fft.irfft(spectrum, len(derived)) for spectrum in spectra)
    return one, other, slice(int(low), int(high) + 1)


def _correlation(one: Array, other: Array, furthest: int) -> Array:
    """Sum over other(t + lag) one(t), for lags from -furthest to furthest samples."""
    size = 1 << int(np.ceil(np.log2(len(one) + furthest + 1)))
    found = np.fft.irfft(np.conj(np.fft.rfft(one, size)) * np.fft.rfft(other, size), size)
    return np.concatenate([found[size - furthest :], found[: furthest + 1]])


def _moved(derived: Array, measured: Array, shift: int) -> tuple[Array, Array]:
    """What both channels have in common when the measured one is moved earlier by a number of samples."""
    n = len(derived) - abs(shift)
    return (derived[:n], measured[shift:]) if shift >= 0 else (derived[-shift:], measured[:n])


def sections(*channels: Array) -> list[tuple[Array, ...]]:
    """Stretches of channels of one recording, (n,) each; at least 256 samples long where the recording is."""
    n = len(channels[0])
    edges = np.linspace(0, n, int(np.clip(n // _SHORTEST_SECTION, 1, _SECTIONS)) + 1).astype(int)
    return [tuple(channel[first:last] for channel in channels) for first, last in pairwise(edges)]


def _spectra(derived: Array, measured: Array) -> list[tuple[int, float, float, float]]:
    """(half, lag [samples], log gain, weight) in the lower and in the upper half of the band; empty where nothing
    counts. The variance of a lag falls with the square of the frequency, that of a gain with the power of the line:
    the halves are those of what counts."""
    n = max(16, min(1024, len(derived) // 4))
    omega, one, other, cross = spectra(derived, measured, get_window("hann", n), "constant")
    coherence = np.abs(cross) ** 2 / np.maximum(one * other, 1e-300)
    blocks = max(1.0, 1.8 * len(derived) / n)
    good = (omega > 0) & (omega < _HIGHEST) & (coherence > max(_COHERENT, 4 / blocks))
    if not np.any(good):
        return []
    coherence, omega, cross = np.minimum(coherence[good], 1 - 1e-6), omega[good], cross[good]
    weight, lag = 2 * blocks * coherence / (1 - coherence) * omega**2, -np.angle(cross) / omega
    found = []
    for half, (w, p) in enumerate(zip(_halves(weight), _halves(one[good]), strict=True)):
        if np.any(w > 0) and np.any(p > 0):
            gain = 0.5 * np.log(np.sum(p * other[good] / one[good]) / np.sum(p))
            found.append((half, float(w @ lag / np.sum(w)), float(gain), float(np.sum(w))))
    return found


def _halves(weight: Array) -> tuple[Array, Array]:
    """Weights of lines, split into those of the lower and of the upper half of their sum."""
    part = weight / np.sum(weight)
    lower = np.clip((0.5 - (np.cumsum(part) - part)) / np.maximum(part, 1e-300), 0, 1)  # one line is cut in two
    return weight * lower, weight * (1 - lower)


def consistency(found: Sequence[ChannelPair]) -> Mapping[str, Mapping[str, float]]:
    """Lags [s] and gains as plain numbers for the report: "v after x" -> figures with their standard errors."""
    return {
        f"{pair.high} after {pair.low}": {
            "lag_s": pair.lag.value, "lag_stderr_s": pair.lag.stderr, "gain": float(np.exp(pair.gain.value)),
            "gain_stderr": pair.gain.stderr, "correlation": pair.correlation,
        }
        for pair in found
        if np.isfinite(pair.lag.stderr)
    }  # fmt: skip
