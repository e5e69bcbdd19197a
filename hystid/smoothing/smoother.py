"""One motion from up to three channels: Kalman smoother of x, v and a.

x, v and a are three measurements of one motion. The smoother knows v = dx/dt and a = dv/dt and takes a derivative of
the acceleration as white noise: the first one (jerk) for rough motions, a higher one for smooth ones. Which one, and
its level, are chosen by likelihood. Rauch, Tung and Striebel (1965), AIAA Journal 3(8), 1445-1450.
"""

from __future__ import annotations

import ctypes
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cache, cached_property
from itertools import pairwise
from pathlib import Path

import numpy as np
from scipy.fft import dct, idct, next_fast_len
from scipy.ndimage import maximum_filter1d, uniform_filter1d
from scipy.optimize import minimize_scalar
from scipy.signal import coherence, spectrogram, welch
from scipy.stats import norm

from hystid.errors import UsageError
from hystid.numeric import Array, Flags
from hystid.toolchain import shared_library

CHANNELS = ("x", "v", "a")
ORDERS = (3, 4, 5)
_LIKELIHOOD_SAMPLES = 4000  # enough to choose one number; keeps a record of a million samples cheap
BELOW = {"v": 0.1, "a": 0.3}  # corner over the lowest visible frequency: the motion itself changes by 1 % at most
_CLEAR = 10.0  # power of the motion over that of the noise at the lowest frequency that counts
_DROWNED = 0.5  # of the lowest frequency: noise is as large as the motion there (white in a, power over f^4 in x)
_TAPER = 0.8  # of the frequency of a cut, from which on it begins to let motion pass
_COMMON = 0.5  # coherence with the force below which most of the power is not motion, but noise
_STEADY_NOISE = 0.5  # of the mean power of noise in sections of a recording, which half of them reach; 0.9 in the mean
_SECTIONS = (8, 4)  # of a recording, for the coherence: 15 half overlapping spectra, which share 0.1 by chance, and 7,
# which part noise from a motion that is nearly as slow
_BLOCK = 100_000  # samples smoothed at a time, with an overlap far beyond the smoother's memory: bounds the memory
_OVERLAP = 2_000
_RESPONSE = 4096  # samples of an impulse response: beyond the memory of the smoother
_ONE = 0.1  # noises of x by which x and the integral of v may differ
_FINER = 2**0.5  # half an octave beyond the frequency up to which the smoother follows: its bias begins there
_BY_CHANCE = 0.001  # probability per sample that noise alone leaves so much there
_LOUDER = (4.0, 16.0, 64.0, 256.0)  # power of the noise over that of its level, where they differ by more


@dataclass(frozen=True)
class Roughness:
    """Derivative of x that is taken as white noise (3: jerk), and its density in units of the sample time.

    lowest: angular frequency [rad/s] of the motion below which a displacement that was not measured is held at zero.
    cut: angular frequency [rad/s] below which it would hold more noise than motion, and is taken out.
    """

    order: int
    level: float
    lowest: float = 0.0
    cut: float = 0.0


@dataclass(frozen=True)
class Smoothed:
    """Smoothed motion: x [m], v [m/s], a [m/s2], each of shape (n,); stderr: their standard errors in steady state."""

    x: Array
    v: Array
    a: Array
    stderr: tuple[float, float, float]
    roughness: Roughness


@dataclass(frozen=True)
class _Seen:
    """Channels (3, n) in units of the sample time, and their variances (3,), infinite where there is no channel.

    louder: factors on the variances (3, n) where the noise is louder for a while.
    """

    table: Array
    variance: Array
    louder: Array | None = None

    @cached_property
    def sizes(self) -> tuple[Array, Array]:
        """First value, and variance over time, of each channel that is there, (3,); 0 and NaN elsewhere."""
        known = np.isfinite(self.variance)
        spread = [np.nanvar(row) if here else np.nan for row, here in zip(self.table, known, strict=True)]
        return np.where(known, np.nan_to_num(self.table[:, 0]), 0.0), np.array(spread)

    def within(self, part: slice) -> _Seen:
        """The same over a stretch of samples."""
        louder = None if self.louder is None else np.ascontiguousarray(self.louder[:, part])
        return _Seen(np.ascontiguousarray(self.table[:, part]), self.variance, louder)


def smooth(
    channels: Mapping[str, Array],
    noise: Mapping[str, float],
    dt: float,
    roughness: Roughness | None = None,
    louder: Mapping[str, Array] | None = None,
    force: Array | None = None,
) -> Smoothed:
    """Smooth the measured channels of one motion jointly.

    channels: any of x [m], v [m/s], a [m/s2], shape (n,) each, at least one; NaN marks a gap. noise: their standard
    deviations, > 0.
    dt: sample time [s]. roughness: None for the most likely one. louder: noise of a channel over ``noise``, (n,), where
    it is not 1 throughout. force: what drives the motion (n,), where it is known.
    Without x, the position would drift away as an integrated measurement does: below the lowest frequency of the motion
    it is held at zero (a pseudo measurement x = 0, of the size that gives a corner there).
    Raises UsageError when there is no channel of a motion.
    """
    if not channels or set(channels) - set(CHANNELS):
        raise UsageError(f"smoothing needs channels out of x, v, a, got {sorted(channels) or 'none'}")
    seen = _scaled(channels, noise, dt, louder or {})
    variance = seen.variance
    lowest, cut = 0.0, 0.0
    if "x" not in channels:
        lowest, cut = (roughness.lowest, roughness.cut) if roughness else _lowest(channels, noise, dt, force)
    if lowest and "v" in channels:
        variance[0] = variance[1] / (BELOW["v"] * lowest * dt) ** 2
    elif lowest:
        variance[0] = variance[2] / (BELOW["a"] * lowest * dt) ** 4
    # what holds x at zero is no measurement, and says nothing about how rough the motion is
    measured = np.where([name in channels for name in CHANNELS], variance, np.inf)
    chosen = roughness or replace(_likely(replace(seen, variance=measured)), lowest=lowest, cut=cut)
    motion, spread = _in_blocks(seen, chosen)
    parted = roughness is None and "x" in channels and len(channels) > 1  # one channel cannot drift away from another
    for times in _LOUDER if parted else ():
        if _wander(motion) < _ONE * np.sqrt(variance[0]):
            break
        likely = _likely(replace(seen, variance=times * variance))
        chosen = replace(likely, level=likely.level / times, lowest=lowest)  # their ratio decides what is smoothed
        motion, spread = _in_blocks(seen, chosen)
    unit = np.array([1.0, dt, dt * dt])
    x, v, a = (np.ascontiguousarray(column) for column in (motion / unit).T)
    x = _above(x, cut * dt)
    v = v if "v" in channels else _above(v, cut * dt)
    error = np.sqrt(np.maximum(spread, 0.0)) / unit
    return Smoothed(x, v, a, (float(error[0]), float(error[1]), float(error[2])), chosen)


def bias(
    channels: Mapping[str, Array],
    noise: Mapping[str, float],
    dt: float,
    motion: Smoothed,
    *,
    drawn: Mapping[str, Array],
    louder: Mapping[str, Array] | None = None,
) -> tuple[Array, Array, Array]:
    """Bias of the smoother where the motion is sharper than elsewhere: x [m], v [m/s], a [m/s2], (n,) each, of the
    motion less what the smoother makes of it.

    To the smoother a motion is as rough at all times. A triangle turns, a stop is met and a hammer strikes for an
    instant, and it rounds that off. The bias begins at the frequency up to which it follows: it is seen in the half
    octave beyond, where that holds more than noise does. How that falls to the next one tells how much lies further on.
    channels, noise, dt, louder: as in ``smooth``. motion: what it made of them. drawn: channels of noise alone.
    """
    roughness = motion.roughness
    quickest, name = followed(noise, dt, roughness)
    quickest, row = max(quickest, 1 / len(motion.x)), CHANNELS.index(name)
    steps = [_FINER ** (2 * k * (roughness.order - row)) for k in (1, 2)]
    finer = [replace(roughness, level=step * roughness.level) for step in steps]

    def bands(of: Mapping[str, Array], first: Smoothed) -> list[Array]:
        runs = [first, *(smooth(of, noise, dt, one, louder) for one in finer)]
        return [_motion_of(getattr(two, name) - getattr(one, name), row, quickest, dt) for one, two in pairwise(runs)]

    seen, chance = bands(channels, motion), bands(drawn, smooth(drawn, noise, dt, roughness, louder))
    least = norm.isf(0.5 * _BY_CHANCE) * np.std(chance[0][row])
    sharp = maximum_filter1d(np.abs(seen[0][row]) > least, max(3, int(0.5 / quickest)))
    power, further = (
        float(np.mean(there[1][sharp] ** 2) - np.mean(noises[1] ** 2)) if np.any(sharp) else 0.0
        for there, noises in zip(seen, chance, strict=True)
    )
    # faded in and out as one motion: contacts would remember a way that has no way back
    share = _faded(sharp, int(1 / quickest)) * _whole(further / power if power > 0 else 0.0, roughness.order, row)
    x, v, a = seen[0]
    rises = np.gradient(share, dt)
    return share * x, share * v + rises * x, share * a + 2 * rises * v + np.gradient(rises, dt) * x


def _motion_of(channel: Array, row: int, slowest: float, dt: float) -> Array:
    """x, v and a, (3, n), of a channel of the motion (its row) that holds nothing slower than half of a frequency
    [cycles per sample]: what is there is noise, and its integral would grow."""
    length = next_fast_len(len(channel), real=True)
    frequency = np.fft.rfftfreq(length)
    turned = 2j * np.pi * np.maximum(frequency, 0.5 * slowest) / dt
    lines = np.fft.rfft(channel, length) * (frequency >= 0.5 * slowest)
    return np.stack([np.fft.irfft(lines * turned ** (k - row), length)[: len(channel)] for k in range(3)])


def _whole(falls: float, order: int, row: int) -> float:
    """Bias of a velocity over what is in the half octave beyond the frequency up to which the smoother follows.

    falls: power in the next half octave over that in this one; at most that of a velocity that jumps, and at least that
    of a motion as smooth as the smoother takes it to be. order: of the derivative of x that it takes for white noise;
    row: of the channel by which it follows. Both follow as Butterworth filters do.
    """
    slope = 3 - 2 * np.log2(np.clip(falls, _FINER ** (3 - 2 * order), 1 / _FINER))  # of the spectrum of x, over 1/f
    u = np.exp(np.linspace(-4, 8, 2000))  # frequency over that up to which it follows, in even steps of its logarithm
    power = u ** (3 - slope)
    coarse, fine = (1 / (1 + (u / by) ** (2 * (order - row))) for by in (1, _FINER))
    return float(np.sqrt(np.sum(power * (1 - coarse) ** 2) / np.sum(power * (fine - coarse) ** 2)))


def _faded(inside: Flags, width: int) -> Array:
    """1 inside, 0 further away than so many samples, and smooth between, (n,)."""
    window = np.hanning(width + 2)[1:-1]
    near = maximum_filter1d(inside, 1 + 2 * (width // 2)).astype(float)
    return np.asarray(np.convolve(near, window / np.sum(window), mode="same")[: len(near)])


def followed(noise: Mapping[str, float], dt: float, roughness: Roughness) -> tuple[float, str]:
    """Frequency [cycles per sample], up to 0.5, at which the smoother ceases to follow, as noise and motion are equal
    there; and the channel by which it follows so far. noise: of the channels that it smooths."""
    found = [(0.0, "x")]
    for row, name in enumerate(CHANNELS):
        if name in noise:
            power = max((noise[name] * dt**row) ** 2, 1e-300)
            found.append(((roughness.level / power) ** (0.5 / (roughness.order - row)) / (2 * np.pi), name))
    quickest, name = max(found)
    return min(quickest, 0.5), name


def error_of_x(noise: Mapping[str, float], dt: float, roughness: Roughness) -> Array:
    """What white noise of the channels leaves in the smoothed x, over frequencies from 0 to pi per sample [m], (m,):
    square root of its power, of which a white noise of standard deviation 1 has 1 everywhere.

    noise: standard deviations of the channels that are smoothed jointly, away from the ends of a recording.
    """
    power = np.zeros(_RESPONSE // 2 + 1)
    for one in noise:
        impulse = {name: np.zeros(_RESPONSE) for name in noise}
        impulse[one][_RESPONSE // 2] = noise[one]
        power += np.abs(np.fft.rfft(smooth(impulse, noise, dt, roughness).x)) ** 2
    return np.sqrt(power)


def _above(column: Array, cut: float) -> Array:
    """A column without what is slower than ``cut`` [rad per sample]; its mirror image continues it."""
    if not cut:
        return column
    omega = np.pi * np.arange(len(column)) / len(column)
    passed = np.clip((omega / cut - _TAPER) / (1 - _TAPER), 0.0, 1.0)
    return np.asarray(idct(dct(column) * np.sin(0.5 * np.pi * passed) ** 2))


def _wander(motion: Array) -> float:
    """Standard deviation of x from the integral of v, both smoothed (n, 3), in units of the sample time.

    The three are one motion, to a thousandth of the noise of x. Noise that is louder at low frequencies than its level
    says may be taken for roughness, and then they drift apart: the noise is to be taken as louder.
    """
    x, v, a = motion.T
    way = np.cumsum(0.5 * (v[1:] + v[:-1]) - (a[1:] - a[:-1]) / 12)
    return float(np.std(x[1:] - way))


def _lowest(
    channels: Mapping[str, Array], noise: Mapping[str, float], dt: float, force: Array | None
) -> tuple[float, float]:
    """The lowest frequency at which the motion stands clear of the noise, and that at which it drowns in it [rad/s]."""
    name = "v" if "v" in channels else "a"
    values = np.nan_to_num(channels[name] - np.nanmean(channels[name]))
    frequency, power = welch(values, fs=1.0 / dt, nperseg=max(8, len(values) // 2))
    seen = () if force is None else (_incoherent(values, force, dt, sections) for sections in _SECTIONS)
    drowned = next((found for found in seen if found), 0.0)
    told = (power > _CLEAR * 2.0 * noise[name] ** 2 * dt) & (frequency > frequency[1])  # the first line holds the mean
    clear = frequency[told & (frequency >= drowned)]
    lowest = clear[0] if len(clear) else max(frequency[1], drowned)
    return float(2 * np.pi * lowest), float(2 * np.pi * max(_DROWNED * lowest, drowned))


def _incoherent(values: Array, force: Array, dt: float, sections: int) -> float:
    """Frequency [Hz] up to which a channel holds noise that grows towards low frequencies; 0 where it does not.

    A structure under force moves less and less quickly towards low frequencies. Where the spectrum of v or a rises
    again below the motion, and shares nothing with the force, that is noise of an amplifier or of the ground. Twice
    integrated it would be a wandering displacement larger than the motion. It is there all the time: what rings for a
    while, or comes with an earthquake, shares little with the force of that time, and is motion all the same.
    """
    section = len(values) // sections
    if section < 2 * sections:
        return 0.0
    frequency, _, power_of = spectrogram(values, 1.0 / dt, "hann", section, section // 2, detrend="constant")
    power = np.mean(power_of, axis=1)
    steady = np.median(uniform_filter1d(power_of / power[:, None], 3, axis=0), axis=1) > _STEADY_NOISE
    _, common = coherence(values, force, fs=1.0 / dt, nperseg=section)
    power[0] = 0.0  # the mean was taken out
    top = int(np.argmax(power))
    least = 1 + int(np.argmin(power[1 : top + 1])) if top > 1 else top
    noisy = (common < _CLEAR / (1 + _CLEAR)) & (power > power[least]) & steady
    rises = np.flatnonzero(noisy[1:least])
    if len(rises) == 0 or rises[-1] == 0:  # ends of a section leave power of any motion in the slowest line
        return 0.0
    above = int(rises[-1]) + 2
    # noise is nowhere louder than at slower motion: what is, is motion, as the lines that a law that is not linear adds
    while above < top and common[above] < _COMMON and power[above] < _CLEAR * power[least]:
        above += 1
    return float(frequency[above])


def _scaled(channels: Mapping[str, Array], noise: Mapping[str, float], dt: float, louder: Mapping[str, Array]) -> _Seen:
    n = len(next(iter(channels.values())))
    table, variance = np.zeros((3, n)), np.full(3, np.inf)
    for row, name in enumerate(CHANNELS):
        if name in channels:
            table[row] = np.asarray(channels[name]) * dt**row
            variance[row] = max((noise[name] * dt**row) ** 2, 1e-14 * float(np.nanmean(table[row] ** 2)), 1e-300)
    factors = np.stack([louder.get(name, np.ones(n)) ** 2 for name in CHANNELS]) if louder else None
    return _Seen(table, variance, factors)


def _likely(seen: _Seen) -> Roughness:
    """The most likely roughness, from the ``_LIKELIHOOD_SAMPLES`` samples in which most moves: a long rest would be
    taken for how smooth the motion is."""
    samples = min(_LIKELIHOOD_SAMPLES, seen.table.shape[1])
    row = next(row for row in (2, 1, 0) if np.isfinite(seen.variance[row]))
    power = np.cumsum(np.nan_to_num(seen.table[row] - np.nanmean(seen.table[row])) ** 2)
    first = int(np.argmax(power[samples - 1 :] - np.concatenate([[0.0], power[:-samples]])))
    part = seen.within(slice(first, first + samples))
    found = [_likely_level(part, order) for order in ORDERS]
    return min(found, key=lambda item: item[0])[1]


def _likely_level(part: _Seen, order: int) -> tuple[float, Roughness]:
    """Negative log-likelihood and roughness of the best level: a coarse grid (there may be two optima), then
    refined."""

    def cost(level: float) -> float:
        value = -_run(part, Roughness(order, float(np.exp(level))), keep=False)[0]
        return value if np.isfinite(value) else 1e300

    grid = _upper_level(part, order) - np.arange(0.0, 34.0, 2.0)
    middle = min(grid, key=cost)
    best = minimize_scalar(cost, bounds=(middle - 2.0, middle + 2.0), method="bounded", options={"xatol": 0.1})
    return float(best.fun), Roughness(order, float(np.exp(best.x)))


def _upper_level(part: _Seen, order: int) -> float:
    """Logarithm of a level that the roughest of the channels, noise included, does not exceed."""
    row = next(i for i in (2, 1, 0) if np.isfinite(part.variance[i]))
    difference = np.diff(part.table[row], order - row)
    return float(np.log(np.nanmean(difference**2) + part.variance[row] + 1e-300)) + 3.0


def _in_blocks(seen: _Seen, roughness: Roughness) -> tuple[Array, Array]:
    """Smoothed x, v, a (n, 3) in units of the sample time, and their variances in the middle of the record."""
    n = seen.table.shape[1]
    motion = np.empty((n, 3))
    spread = np.zeros(3)
    order = roughness.order
    for first in range(0, n, _BLOCK):
        low, high = max(0, first - _OVERLAP), min(n, first + _BLOCK + _OVERLAP)
        _, beliefs = _run(seen.within(slice(low, high)), roughness, keep=True)
        last = min(n, first + _BLOCK)
        motion[first:last] = beliefs[first - low : last - low, :3]
        spread = beliefs[(high - low) // 2, [order, 2 * order + 1, 3 * order + 2]]
    return motion, spread


def _run(seen: _Seen, roughness: Roughness, *, keep: bool) -> tuple[float, Array]:
    n, order = seen.table.shape[1], roughness.order
    start = _start(seen, order)
    beliefs = np.empty((n if keep else 0, order + order * order))
    ahead = np.empty_like(beliefs)
    pointer = ctypes.POINTER(ctypes.c_double)
    value = _kernel(order)(
        n,
        seen.table.ctypes.data_as(pointer),
        seen.variance.ctypes.data_as(pointer),
        None if seen.louder is None else seen.louder.ctypes.data_as(pointer),
        roughness.level,
        start.ctypes.data_as(pointer),
        beliefs.ctypes.data_as(pointer) if keep else None,
        ahead.ctypes.data_as(pointer) if keep else None,
    )
    return float(value), beliefs


def _start(seen: _Seen, order: int) -> Array:
    """Belief before the first sample: measured states near their first value, the others wide but finite."""
    mean, spread = np.zeros(order), np.full(order, np.nan)
    first, over_time = seen.sizes
    mean[:3], spread[:3] = first, 100.0 * (over_time + seen.variance)
    spread = np.where(np.isfinite(spread), spread, np.nanmax(spread))
    return np.concatenate([mean, np.diag(spread).ravel()])


@cache
def _kernel(order: int) -> ctypes._NamedFuncPointer:
    source = Path(__file__).with_name("kernel") / "smoother.c"
    made = shared_library({"smoother.c": source.read_text()}, main=["smoother.c"], flags=("-O2", f"-DORDER={order}"))
    pointer = ctypes.POINTER(ctypes.c_double)
    function = ctypes.CDLL(str(made)).hy_smooth
    function.restype = ctypes.c_double
    function.argtypes = [ctypes.c_long, pointer, pointer, pointer, ctypes.c_double, pointer, pointer, pointer]
    return function
