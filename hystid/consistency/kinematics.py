"""Do x, v and a describe one motion: gain, sign, lag, band and errors of each pair of channels."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from hystid.consistency.spectra import HIGHEST, Bands, bands, compare, derived
from hystid.recording import Array, Recording

ORDER = {"x": 0, "v": 1, "a": 2}
RESPONSE_ERROR = 0.02  # relative error of a response that a sound chain leaves in each band, beside noise
_SECTIONS = 6  # of the recording, whose lags are compared
_WHITE = 1.0  # exponent of a power spectrum over the highest octave below which it counts as white
_SAME_CHANNEL = 0.9  # squared coherence beyond which nine tenths of a channel come from another one
_SMOOTHED = 1e4  # ratio of noise powers, force over motion, that no chain of one rig shows (40 dB)
_CLEARLY = 0.1  # share of a misfit that a formula leaves when it is the right one
_TAPS = 12  # samples on either side from which a formula computes a channel
_EQUATIONS = 4000  # of it that are looked at
DIGITS = 1e-6  # error of a formula over the size of a channel: the last of the digits that text files hold
_UNDECIDED = math.log(20.0)  # odds of two signs below which the phases do not tell them apart
_PLATEAU = 1.25  # response over the gain beyond which a filter is at work (2 dB, the usual limit of a sensor's band)


@dataclass(frozen=True)
class Pair:
    """How channel ``high`` compares with the derivative of channel ``low``.

    gain: high over derivative of low (positive); error: standard error of its logarithm. sign: 1 or -1.
    lag: how much later ``high`` is [s]; lag_error: from the scatter of sections of the recording, and from the phase
    that a sound chain leaves in each band [s].
    slope, slope_error: exponent of the response over frequency (0 for a sound pair).
    band: [rad/s] in which the response stays within 2 dB of the gain; coherence: mean over these bands, by power.
    correlation: of the two after the lag was taken out. bands: the spectra themselves, after the lag.
    computed: which of the two was computed from the other one, None where both were measured.
    turn: mean sine of the phase as it stands: 1 where ``high`` leads by a quarter of a period, as a derivative does.
    """

    low: str
    high: str
    gain: float
    error: float
    sign: float
    lag: float
    lag_error: float
    slope: float
    slope_error: float
    band: tuple[float, float]
    coherence: float
    correlation: float
    bands: Bands
    computed: str | None = None
    turn: float = 0.0

    @property
    def order(self) -> int:
        """Number of derivatives between the two channels."""
        return ORDER[self.high] - ORDER[self.low]

    @property
    def level(self) -> float:
        """Share of the power, where both hold one signal, of the band in which the response is that of the gain."""
        power = np.where(self.bands.seen, self.bands.high, 0.0)
        inside = (self.bands.omega >= self.band[0]) & (self.bands.omega <= self.band[1])
        return float(np.sum(power[inside]) / max(float(np.sum(power)), 1e-300))

    @property
    def is_one_motion(self) -> bool:
        """Whether the two have anything to do with each other: one signal where either of them is strongest."""
        seen = self.bands.seen
        if not np.any(seen):
            return False
        slow = self.bands.low / np.maximum(self.bands.omega, 1e-300) ** (2 * self.order)
        return bool(any(seen[int(np.argmax(power))] for power in (self.bands.high, self.bands.low, slow)))


def pairs(recording: Recording) -> list[Pair]:
    """All pairs of motion channels that are there."""
    channels = motion(recording)
    return [
        replace(pair(channels, low, high, recording.dt), computed=_computed(recording, channels, low, high))
        for low, high in combinations(channels, 2)
    ]


def motion(recording: Recording) -> dict[str, Array]:
    """The channels of the motion that the recording holds, in the order x, v, a."""
    return recording.channels(ORDER)


def pair(channels: Mapping[str, Array], low: str, high: str, dt: float) -> Pair:
    """One pair of channels, each of shape (n,)."""
    order = ORDER[high] - ORDER[low]
    one, other = derived(channels[low], order, dt), derived(channels[high], 0, dt)
    shift, sign = alignment(one, other)
    turn = _turn(bands(one, other, dt))
    one, other = _shifted(one, other, shift)
    found = bands(one, other, dt)
    seen, weight = found.seen, 1.0 / (found.variance + RESPONSE_ERROR**2)
    weight = np.where(seen, weight, 0.0)
    if not np.any(seen):
        return Pair(low, high, np.nan, np.inf, 1.0, 0.0, np.inf, 0.0, np.inf, (0.0, 0.0), 0.0, 0.0, found)
    size = np.log(np.abs(found.response))
    centre = float(median(size, weight * found.high / np.sum(found.high)))
    lag, sign = _nearest(found, sign, weight, shift * dt)
    slope, slope_error = _slope(np.log(found.omega), size, weight)
    near = seen & (np.abs(size - centre) < np.log(_PLATEAU))
    inside = _run(near, int(np.argmax(np.where(seen, found.high, 0.0))))
    power = np.where(inside, found.high, 0.0)
    share = power[inside] / np.sum(power)
    level = float(np.sum(share * size[inside]))
    error = float(np.sqrt(np.sum(share**2 / weight[inside]) + np.sum(share * (size[inside] - level) ** 2) / len(share)))
    return Pair(
        low, high, float(np.exp(level)), error, sign, lag + shift * dt,
        math.hypot(_scatter(one, other, dt, sign), float(np.sum(weight * found.omega**2)) ** -0.5),
        slope, slope_error, (float(found.omega[inside][0]), float(found.omega[inside][-1])),
        float(np.sum(power * found.coherence) / np.sum(power)), _correlation(one, other), found, turn=turn,
    )  # fmt: skip


def _turn(found: Bands) -> float:
    weight = np.where(found.seen, 1.0 / (found.variance + RESPONSE_ERROR**2), 0.0)
    return float(np.sum(weight * np.sin(np.angle(found.response))) / max(float(np.sum(weight)), 1e-300))


def alignment(one: Array, other: Array) -> tuple[int, float]:
    """(samples by which ``other`` comes later, sign of the relation), from shifts of up to a quarter.

    A sine repeats itself: of all shifts that fit nearly as well as the best one, the smallest is taken, so that a
    reversed sign is not read as half a period.
    """
    from scipy.signal import correlate

    n = len(one)
    if n < 8 or not np.any(one) or not np.any(other):
        return 0, 1.0
    most = max(n // 4, 1)
    full = correlate(other - np.mean(other), one - np.mean(one), mode="full", method="fft")
    middle = n - 1
    lags = np.arange(-most, most + 1)
    seen = n - np.abs(lags)  # fewer samples overlap at larger shifts
    size = float(np.sqrt(np.sum((one - np.mean(one)) ** 2) * np.sum((other - np.mean(other)) ** 2)))
    values = full[middle - most : middle + most + 1] / size * np.sqrt(n / seen)
    best = float(np.max(np.abs(values)))
    near = 1.0 - np.abs(values) <= 2.0 * (1.0 - min(best, 1.0)) + 0.02
    at = np.flatnonzero(near)
    smallest = int(at[np.argmin(np.abs(lags[at]))])
    climbed = _climb(np.abs(values), smallest)
    return int(lags[climbed]), float(np.sign(values[climbed]) or 1.0)


def _climb(values: Array, start: int) -> int:
    at = start
    while 0 < at < len(values) - 1:
        step = int(np.argmax(values[at - 1 : at + 2])) - 1
        if step == 0:
            break
        at += step
    return at


def _shifted(one: Array, other: Array, shift: int) -> tuple[Array, Array]:
    if shift > 0:
        return one[:-shift], other[shift:]
    return (one[-shift:], other[:shift]) if shift < 0 else (one, other)


def _nearest(found: Bands, sign: float, weight: Array, shift: float) -> tuple[float, float]:
    """(lag after the shift [s], sign): of both signs, a reversed sine being one that comes half a period late.

    Where the phases do not tell them apart, the smaller lag counts.
    """
    both = [(*_delay(found, s, weight), s) for s in (sign, -sign)]
    total = float(np.sum(weight))
    best = max(fit for _, fit, _ in both)
    alike = [(lag, s) for lag, fit, s in both if total * (best - fit) < _UNDECIDED]
    return min(alike, key=lambda item: abs(item[0] + shift))


def _delay(found: Bands, sign: float, weight: Array) -> tuple[float, float]:
    """Lag [s] within half a period of the strongest motion, and the mean cosine that is left."""
    phase = np.angle(found.response * sign)
    omega = found.omega
    main = float(omega[int(np.argmax(weight * found.high))])
    lag = 0.0
    step = np.pi / main / 2
    for _ in range(14):  # each round halves the grid: 1e-4 of the first step in the end
        tried = lag + step * np.linspace(-1, 1, 9)
        fit = [float(np.sum(weight * np.cos(phase + omega * t))) for t in tried]
        lag, step = float(tried[int(np.argmax(fit))]), step / 2
    return lag, float(np.sum(weight * np.cos(phase + omega * lag)) / np.sum(weight))


def _scatter(one: Array, other: Array, dt: float, sign: float) -> float:
    """Standard error of the lag from sections of the recording [s]; infinite where fewer than three show one."""
    lags = []
    for a, b in zip(np.array_split(one, _SECTIONS), np.array_split(other, _SECTIONS), strict=True):
        found = bands(a, b, dt)
        weight = np.where(found.seen, 1.0 / (found.variance + RESPONSE_ERROR**2), 0.0)
        if np.any(found.seen):
            lags.append(_delay(found, sign, weight)[0])
    return float(np.std(lags, ddof=1) / np.sqrt(len(lags))) if len(lags) > 2 else np.inf


def _slope(x: Array, y: Array, weight: Array) -> tuple[float, float]:
    total = float(np.sum(weight))
    mean, level = float(np.sum(weight * x)) / total, float(np.sum(weight * y)) / total
    spread = float(np.sum(weight * (x - mean) ** 2))
    if np.count_nonzero(weight) < 3 or spread <= 0:
        return 0.0, np.inf
    slope = float(np.sum(weight * (x - mean) * (y - level))) / spread
    squares = weight * (y - level - slope * (x - mean)) ** 2
    excess = max(1.0, float(np.sum(squares)) / (np.count_nonzero(weight) - 2))
    return slope, float(np.sqrt(excess / spread))


def median(values: Array, weight: Array) -> Array:
    """Weighted medians over the last axis of values of shape (..., n); weight has shape (n,)."""
    order = np.argsort(values, axis=-1)
    total = np.cumsum(weight[order], axis=-1)
    at = np.argmax(total >= 0.5 * total[..., -1:], axis=-1)
    return np.asarray(np.take_along_axis(values, np.take_along_axis(order, at[..., None], -1), -1)[..., 0])


def _run(flags: np.ndarray[tuple[int], np.dtype[np.bool_]], at: int) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
    """The unbroken run of flags around one place (two misses in a row end it)."""
    if not flags[at]:
        at = int(np.flatnonzero(flags)[np.argmin(np.abs(np.flatnonzero(flags) - at))]) if np.any(flags) else at
    first = last = at
    while first > 0 and (flags[first - 1] or (first > 1 and flags[first - 2])):
        first -= 1
    while last < len(flags) - 1 and (flags[last + 1] or (last < len(flags) - 2 and flags[last + 2])):
        last += 1
    inside = np.zeros(len(flags), dtype=bool)
    inside[first : last + 1] = True
    kept = inside & flags
    kept[at] = True
    return kept


def _correlation(one: Array, other: Array) -> float:
    one, other = one - np.mean(one), other - np.mean(other)
    return float(one @ other / np.sqrt(max(float(one @ one) * float(other @ other), 1e-300)))


@dataclass(frozen=True)
class ChannelSpectrum:
    """Power density of one channel by band, and what of it is noise.

    omega [rad/s], density [unit2 per rad/sample]. white: whether the highest octave is flat; level: its density.
    """

    omega: Array
    density: Array
    white: bool
    exponent: float
    level: float

    @property
    def noise(self) -> float:
        """Standard deviation of white noise of that level."""
        return float(np.sqrt(self.level * np.pi))

    def signal_band(self, ratio: float = 4.0) -> tuple[float, float]:
        """Lowest and highest frequency [rad/s] whose density stands above the noise by a ratio."""
        above = np.flatnonzero(self.density > ratio * self.level)
        return (float(self.omega[above[0]]), float(self.omega[above[-1]])) if above.size else (0.0, 0.0)


def spectrum(values: Array, dt: float) -> ChannelSpectrum:
    """Spectrum of a channel of shape (n,)."""
    t, window = np.linspace(-1.0, 1.0, len(values)), np.hanning(len(values))
    plain = values - np.polyval(np.polyfit(t, values, 1, w=np.sqrt(window)), t)
    found = bands(plain, plain, dt)
    lines = np.maximum(found.count * 1.5, 1.0)
    density = found.low / lines / (np.pi * float(np.sum(window**2)))
    high = found.omega * dt > HIGHEST / 2
    if np.count_nonzero(high) < 3:
        return ChannelSpectrum(found.omega, density, False, 0.0, float(np.min(density, initial=np.inf)))
    exponent = float(np.polyfit(np.log(found.omega[high]), np.log(density[high] + 1e-300), 1)[0])
    return ChannelSpectrum(found.omega, density, abs(exponent) < _WHITE, exponent, float(np.median(density[high])))


def main_frequency(recording: Recording) -> float:
    """Angular frequency of the strongest motion [rad/s]."""
    held = spectrum(motion(recording)[next(iter(motion(recording)))], recording.dt)
    weight = held.density * np.gradient(held.omega) if len(held.omega) > 2 else held.density
    return float(held.omega[int(np.argmax(weight))]) if len(held.omega) else 0.0


def hertz(band: tuple[float, float]) -> tuple[float, float]:
    """A band from rad/s."""
    return band[0] / (2 * math.pi), band[1] / (2 * math.pi)


def _computed(recording: Recording, names: Mapping[str, Array], low: str, high: str) -> str | None:
    """Which of two channels was computed from the other one, None where both were measured.

    A measured channel has errors of its own. So where one channel shows nothing but its noise, another measured one is
    not coherent with it; a channel that was computed from it carries the very same noise, whatever formula and filter
    made it. How close the two are says nothing: good sensors agree to any number of digits.
    """
    found = compare(names[low], names[high], ORDER[high] - ORDER[low], recording.dt)
    if len(found.omega) < 8:
        return None
    one, other = spectrum(names[low], recording.dt), spectrum(names[high], recording.dt)
    quotient = _is_quotient(found, ORDER[high] - ORDER[low], recording.dt)
    for held in (one, other):
        if held.white:
            quiet = np.interp(found.omega, held.omega, held.density) < 1.5 * held.level
            if np.count_nonzero(quiet) >= 4 and np.mean(found.coherence[quiet] > 0.5) > 0.5:
                return high if quotient or held is one or abs(one.exponent) < abs(other.exponent) else low
    if quotient:
        return high
    # No channel shows its noise. Either nothing here is noisy, which the force can tell, or the motion was smoothed.
    if float(np.mean(found.coherence > _SAME_CHANNEL)) < 0.85 or recording.F is None or not np.any(recording.F):
        return None
    return high if _depth(spectrum(recording.F, recording.dt)) > _SMOOTHED * max(_depth(one), _depth(other)) else None


@dataclass(frozen=True)
class Formula:
    """A channel that follows from another one to the last digit. gain: of slow motion; where the formula smooths,
    quick motion has less."""

    gain: float
    sign: float


def formula(low: Array, high: Array, order: int, dt: float) -> Formula | None:
    """The formula by which ``high`` was computed from ``low`` and its neighbours in time; None where there is none.

    Savitzky and Golay's, and differences of smoothed values, lose quick motion: no unit, and no sensor's factor.
    """
    width = 2 * _TAPS + 1
    if len(low) < 4 * width or not (np.std(low) > 0 and np.std(high) > 0):
        return None
    rows = np.lib.stride_tricks.sliding_window_view(low - np.mean(low), width)
    step = max(1, len(rows) // _EQUATIONS)
    table, target = rows[::step], high[_TAPS : len(high) - _TAPS : step]
    scale = float(np.std(low))
    weights = np.linalg.lstsq(table / scale, target, rcond=1e-13)[0] / scale
    if float(np.std(target - table @ weights)) > DIGITS * float(np.std(high)):
        return None
    slow = float(weights @ (np.arange(-_TAPS, _TAPS + 1) * dt) ** order) / math.factorial(order)
    return Formula(abs(slow), math.copysign(1.0, slow))


def _depth(held: ChannelSpectrum) -> float:
    """Quietest of a spectrum over its peak."""
    return held.level / max(float(np.max(held.density)), 1e-300)


def _is_quotient(found: Bands, order: int, dt: float) -> bool:
    """Whether the response is that of differences between neighbouring samples instead of that of a derivative."""
    seen = found.seen & (found.coherence > _SAME_CHANNEL)
    angle = found.omega[seen] * dt
    if len(angle) < 4 or angle[-1] < 0.3:  # below, a difference quotient is a derivative to 0.4 %
        return False
    response = found.response[seen]
    weight = found.high[seen] ** 0 / (found.variance[seen] + 1e-6)
    half, whole = np.sinc(angle / 2 / np.pi), np.sinc(angle / np.pi)
    shift = np.exp(-0.5j * angle)
    forms = (half * shift, half / shift, whole, half)
    misfit = [float(np.sum(weight * np.abs(response / form**order - 1.0) ** 2)) for form in forms]
    plain = float(np.sum(weight * np.abs(response - 1.0) ** 2))
    return min(misfit) < _CLEARLY * plain and plain / float(np.sum(weight)) > 1e-5
