"""How noisy is a channel: robust estimates that signals, jumps and outliers hardly move."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter1d
from scipy.signal import coherence
from scipy.special import betainc, binom, chdtri

from hystid.numeric import Array, Flags
from hystid.smoothing.kernels import corner, kernel_of_smoothing, response

_FEWEST_SAMPLES = 64  # samples that tell a level by their sixth differences
_DIFFERENCES = 6
_SECTION, SECTIONS = 128, 24  # samples of a section at least, and sections at most, in which noise may be louder
_LOUD = 2.0  # over the median section: 4.5 standard errors of the level of a section of 128 samples
_FLANK = 1.3  # the same beside a loud section
_HIGHER, _ORDERS_APART = 9, 4.0  # order of differences, and five standard errors of the logarithm of their ratio to
# those of sixth order, times the root of the samples
_SHOCKS = 6.0  # kurtosis of differences of 128 samples of noise: one section in a thousand has more
_SHOCK = 10.0  # times the median difference: noise of any colour reaches 6
_UNRESOLVED = 0.02  # of a difference of sixth order: the sum over a haversine of two to four samples is off by 5 % of
# it in the median, and some nine samples share that
_LEVELS = 8  # of a channel with steps: fewer are noise of more than 20 dB, or a force that is switched
RESTING = 0.4  # share of samples that repeat the one before, above which a channel is a staircase
_BANDS = np.linspace(0.5, 0.98, 5)  # of the Nyquist frequency: where recordings that are sampled well hold noise alone
_WELL, _WIDER = 0.3, 1.16  # of the Nyquist frequency, above which that is so; edges of bands below that over each other
_FINE_BANDS = np.concatenate([_WELL / _WIDER ** np.arange(12.0, 0.0, -1.0), np.linspace(_WELL, 0.98, 15)])  # where a
# filter may end the noise; a short recording has fewer above _WELL
_FLAT_LINES, _CAUTIOUS = 70, 25  # lines of a band below, so that three of them tell what is flat from what falls by the
# square of the frequency, and from what a mass moves
_SHELF, _STEEP = 3, 3.0  # bands of noise before a filter, and its fall in power at least
_CLIFF = 10.0  # the same where motion may end by itself
_RARELY = 1e-3  # chance by which bands of smoothed noise are further from what their filter leaves
NOISE_ERROR = 0.05  # relative error of the noise power that is estimated from a recording, at least
_NOISE_ERROR_SHORT = 4.0  # the same over the root of the samples: white noise beside two tones, 130 to 8,000 samples
MISREAD = 2.0  # by which noise must be louder before a filter than behind it: chance, and filters of recorders near
# half the sample rate, are below
_LEAK = 1e-2  # of a response, below which a window and rounding leave more in a spectrum than noise
_ORDER = 12  # power of the frequency by which noise falls behind a filter of sixth order: what a mass moves falls by 4,
# and by 6 where a force jumps
_CORNER = 1.1  # what the corner of a filter takes from the last of them, besides chance
_PARTS, _SIGMAS = 8, 5.0  # of a recording, in which noise is as loud but for chance: standard errors by which eight
# differ at most in 99 of 100 recordings (studentized range)
_MOTION = 0.5  # coherence of what is motion for the most part; noise shares a tenth in so many parts by chance
_BRIEF = 3.7  # four standard errors of a standard deviation over that by the median, times the root of the lines
_LINES = 10  # of the spectrum in each band at least, whose median is known to 40 % then
SMALL, _HALF = 0.05, 0.5  # shares of the power of a channel that noise of 13 dB is, and noise as loud as the rest
_SPREAD = 2.5  # standard error of the difference of two medians of windowed powers, times the root of their number
# Two estimates differ by 2.5 over the root of the samples by chance. Only a clear difference counts: a tenth, which is
# 3.6 standard errors of 8,000 samples, and as many in fewer.
_APART, _APART_SHORT = 0.1, 9.0
_RESOLUTION = 1e-7  # noise below this share of a channel cannot be told from rounding in a text file
_NOISE_FREE = 2e-5  # noise over spread: below the 16 bit of any converter


class NoiseBefore(NamedTuple):
    """White noise of a channel before a filter.

    end: frequency [cycles per sample] up to which the filter passes it, 0.5 without one. level: its standard deviation,
    0 without one. kernel: of a user's smoothing, (k,), None for another filter, which leaves nothing beyond its end.
    """

    end: float = 0.5
    level: float = 0.0
    kernel: Array | None = None

    def passed(self, cycles: Array) -> Array:
        """Share of the power that the filter leaves, over frequencies [cycles per sample], (n,)."""
        return np.where(cycles <= self.end, 1.0, 0.0) if self.kernel is None else response(self.kernel, cycles)

    def behind(self, white: Array) -> Array:
        """White noise (n,) behind the filter."""
        if self.end == 0.5:
            return white
        lines = np.fft.rfft(white) * np.sqrt(self.passed(np.linspace(0, 0.5, len(white) // 2 + 1)))
        return np.asarray(np.fft.irfft(lines, len(white)))


def noise_level(channel: Array, others: Sequence[Array] = (), *, drives: bool = False, cautious: bool = False) -> float:
    """Standard deviation of the white noise on a channel (its unit): where a filter has taken its upper end away, that
    before the filter. others, drives, cautious: as in ``filtered_beyond``."""
    return max(unfiltered_level(channel), filtered_beyond(channel, others, drives=drives, cautious=cautious).level)


def noise_error(samples: int) -> float:
    """Relative error of the noise power that is estimated from so many samples."""
    return max(NOISE_ERROR, _NOISE_ERROR_SHORT / float(np.sqrt(samples)))


def unfiltered_level(channel: Array) -> float:
    """The same of noise that no filter ends.

    The lower of two estimates, as each can only be raised by the signal: the median absolute sixth difference (Huber's
    idea, blind to single jumps), and the median of the periodogram in the quietest part of the upper half of the band.
    Where a filter has taken that end away, both see what is left there.
    """
    floor = _RESOLUTION * float(np.std(channel))
    if len(channel) < _FEWEST_SAMPLES:
        return float(max(floor, float(np.std(np.diff(channel, 2))) / np.sqrt(6.0)))
    differences, spectrum = _by_differences(channel), _by_spectrum(channel)
    apart = max(_APART, _APART_SHORT / np.sqrt(len(channel)))
    lower = differences if differences < (1 - apart) * spectrum else spectrum
    return float(max(floor, _by_steps(channel), lower))


def level_between(channel: Array, stops: Flags) -> float:
    """The same of a channel that stops at a level, (n,) flags: what stands still there is no quiet noise."""
    differences = scaled_differences(channel)
    around = np.convolve(stops, np.ones(len(channel) - len(differences) + 1), mode="valid") > 0
    if np.count_nonzero(~around) < _FEWEST_SAMPLES:
        return unfiltered_level(channel)
    return float(np.median(np.abs(differences[~around])) / 0.6745)


def louder_for_a_while(channel: Array) -> tuple[float, Array] | None:
    """Level of the quiet noise of a channel (its unit), and the noise over it at each sample (n,), from sections;
    None where no section is clearly louder than the others.

    What is loud must be noise: its differences of sixth and of ninth order say the same, as those of white noise do and
    those of a motion do not, and it has no shocks. A friction that snaps, an impact, or a quick motion is none.
    """
    count = min(len(channel) // _SECTION, SECTIONS)
    if count < 4 or steps(channel) is not None:
        return None
    edges = np.linspace(0, len(channel), count + 1).astype(int)
    parts = [channel[first:last] for first, last in pairwise(edges)]
    level = np.array([_by_differences(part) for part in parts])
    base, least = float(np.quantile(level, 0.25)), _RESOLUTION * float(np.std(channel))
    if base <= least:
        return None
    base = float(np.median(level[level <= _LOUD * base]))
    loud = level > _LOUD * base
    white = [is_white(part) for part, is_loud in zip(parts, loud, strict=True) if is_loud]
    if 2 * sum(white) <= len(white):  # most of them: where noise begins, one section holds two levels
        return None
    while np.any(more := (level > _FLANK * base) & ~loud & (np.append(loud[1:], False) | np.append(False, loud[:-1]))):
        loud |= more
    base = float(np.median(level[~loud])) if np.any(~loud) else base
    if base <= least:  # what is quiet is nought: pauses of a simulated force
        return None
    over = np.where(loud, np.log(np.maximum(level / base, 1.0)), 0.0)
    return base, np.exp(np.interp(np.arange(len(channel)), 0.5 * (edges[1:] + edges[:-1]), over))


def between_samples(channel: Array) -> Array:
    """Error (n,) that is left between the samples of shocks of two or three samples, in the unit of a channel; 0 where
    its differences of sixth order are not far above those elsewhere."""
    if len(channel) < _FEWEST_SAMPLES:
        return np.zeros(len(channel))
    rough = maximum_filter1d(np.pad(np.abs(scaled_differences(channel)), _DIFFERENCES // 2), _DIFFERENCES + 1)
    return np.where(rough > _SHOCK * np.median(rough), _UNRESOLVED * rough, 0.0)


def is_white(part: Array) -> bool:
    """Whether a stretch shows white noise and no motion: differences of several orders agree, and have no shocks."""
    higher, lower = _by_differences(part, _HIGHER), _by_differences(part)
    if not higher or not lower:
        return False  # it rests for most of the time
    apart = abs(np.log(higher / lower))
    difference = np.diff(part, _DIFFERENCES)
    kurtosis = float(np.mean(difference**4) / np.mean(difference**2) ** 2)
    return apart < _ORDERS_APART / np.sqrt(len(part)) and kurtosis < _SHOCKS


def steps(channel: Array) -> NDArray[np.intp] | None:
    """Number of the step that each sample of a staircase stands on, shape (n,); None where the channel does not rest.

    Coarse resolution, which goes from one level to the next, or a slow display, which shows a new value now and then:
    the error of such a channel is the same over a whole step. A simulated force that pauses between blows rests at one
    value alone, and one that is switched jumps: they are none.
    """
    resting = np.diff(channel) == 0.0
    if np.mean(resting) < RESTING or np.all(resting):
        return None
    levels, count = np.unique(channel[1:][resting], return_counts=True)
    elsewhere = channel[1:] != levels[np.argmax(count)]
    if np.mean(resting[elsewhere]) < RESTING:
        return None
    shown = channel[np.append(True, ~resting)]
    is_coarse = len(levels) >= _LEVELS and np.median(np.abs(np.diff(np.searchsorted(levels, shown)))) <= 1
    # one value and the next are more alike than not: a correlation above one half
    is_slow = 2 * len(np.unique(shown)) > len(shown) and np.mean(np.diff(shown) ** 2) < np.var(channel)
    return np.concatenate([[0], np.cumsum(~resting)]) if is_coarse or is_slow else None


def _by_steps(channel: Array) -> float:
    """Error of a channel that rests between steps; 0 where it does not."""
    if steps(channel) is None:
        return 0.0
    change = np.diff(channel)
    resting = change == 0.0
    return float(np.sqrt(np.mean(change[~resting] ** 2) / 3.0))


def _by_differences(channel: Array, order: int = _DIFFERENCES) -> float:
    return float(np.median(np.abs(scaled_differences(channel, order))) / 0.6745)


def scaled_differences(channel: Array, order: int = _DIFFERENCES) -> Array:
    """Differences of some order, scaled to the size of white noise."""
    return np.asarray(np.diff(channel, order) / np.sqrt(binom(2 * order, order)))


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


def filtered_beyond(
    channel: Array,
    others: Sequence[Array] = (),
    *,
    drives: bool = False,
    corners: Collection[float] = (),
    cautious: bool = False,
) -> NoiseBefore:
    """White noise of a channel (n,) before a filter that ends it well below half the sample rate.

    Such noise is flat up to a corner, and falls more steeply than a motion does. It is a small part of the channel, and
    there all the time: a force that is as loud at all frequencies up to its highest is most of it, an impact is brief.
    What ``others`` share with it is motion. drives: whether the channel is such a force, which may not be seen to move
    anything; of a motion that others would share, noise may be as much as the rest. corners: such frequencies of the
    same channel in other recordings: the recorder filters here as well, and motion may hide it. cautious: rather take
    some motion for noise than noise for motion, in a recording that is too short to tell.
    """
    loudest = _HALF if others and not drives else SMALL
    window = np.hanning(len(channel))
    lines = np.fft.rfft((channel - np.mean(channel)) * window)
    told = (1 - 1 / _WIDER) * _FINE_BANDS * (len(lines) - 1) >= (_CAUTIOUS if cautious else _FLAT_LINES)
    above = _FINE_BANDS[_FINE_BANDS >= _WELL]
    most = int((above[-1] - _WELL) * (len(lines) - 1) / (_LINES + 1))  # that hold so many lines, however they are cut
    if most < len(above) - 1:
        above = np.linspace(_WELL, above[-1], most + 1)
    bands = np.concatenate([_FINE_BANDS[told & (_FINE_BANDS < _WELL)], above])
    edges = (bands * (len(lines) - 1)).astype(int)
    if len(bands) < _SHELF + 2:
        return NoiseBefore()

    def inside(first: int, end: int) -> Array:
        return _in_band(lines, first, end, window)

    found = _smoothed(channel, others, lines, window, corners)
    if found is not None and found.level**2 < loudest * float(np.var(channel)):
        return found
    for last in _ends_of_shelves(np.abs(lines) ** 2, edges, bands):
        first, end = edges[last - _SHELF], edges[last]
        shelf = inside(first, end)
        if not _is_steady(shelf, end - first):
            continue
        if any(_shared(channel, other, bands[[last - _SHELF, last]]) > _MOTION for other in others):
            continue
        level = _level(channel, shelf, first, end, len(lines))
        if level**2 < loudest * float(np.var(channel)):
            return NoiseBefore(0.5 * float(bands[last]), level)
    for last in range(1, len(edges)):
        first, end = edges[last - 1], edges[last]
        if 0.5 * bands[last] in corners:
            level = _level(channel, inside(first, end), first, end, len(lines))
            if level**2 < _HALF * float(np.var(channel)):
                return NoiseBefore(0.5 * float(bands[last]), level)
    return NoiseBefore()


def _in_band(lines: NDArray[np.complex128], first: int, end: int, window: Array) -> Array:
    """A channel in a band of its spectrum, where its window is above one half."""
    rows = np.concatenate([np.zeros(first), lines[first:end]])
    middle = window > 0.5
    return np.asarray(np.fft.irfft(rows, len(window))[middle] / window[middle])


def _smoothed(
    channel: Array, others: Sequence[Array], lines: NDArray[np.complex128], window: Array, known: Collection[float] = ()
) -> NoiseBefore | None:
    """White noise before a user's smoothing; None where the upper part of a spectrum is not that of smoothed noise.
    known: corners of kernels that other recordings show."""
    edges = (_FINE_BANDS[_FINE_BANDS >= _WELL] * (len(lines) - 1)).astype(int)
    first, end = edges[0], edges[-1]
    kernel = kernel_of_smoothing(np.abs(lines) ** 2, first, end) if np.min(np.diff(edges)) >= _LINES else None
    if kernel is None:
        return None
    passed = response(kernel, np.linspace(0, 0.5, len(lines)))
    used = passed > _LEAK * np.max(passed[first:end])
    white = np.where(used, lines / np.sqrt(np.maximum(passed, np.finfo(float).tiny)), 0.0)
    bands = [np.abs(white[low:high][used[low:high]]) ** 2 for low, high in pairwise(edges)]
    bands = [band for band in bands if len(band) >= _LINES]
    inside, count = _in_band(white, first, end, window), int(np.count_nonzero(used[first:end]))
    if corner(kernel) not in known:
        is_alike = len(bands) > _SHELF and _scatter(bands) < chdtri(len(bands) - 1, _RARELY)
        shared = (_shared(channel, other, np.array([first, end]) / len(lines)) for other in others)
        if not is_alike or not _is_steady(inside, count) or any(one > _MOTION for one in shared):
            return None
    level = float(np.std(inside) / np.sqrt(count / (len(lines) - 1)))
    return NoiseBefore(corner(kernel), level, kernel) if level > MISREAD * unfiltered_level(channel) else None


def _scatter(bands: Sequence[Array]) -> float:
    """Sum of squares by which the medians of bands of lines are apart, in units of what chance leaves."""
    apart = np.log([np.median(band) for band in bands])
    return float(np.sum(((apart - np.mean(apart)) / _SPREAD) ** 2 * [2 * len(band) for band in bands]))


def _level(channel: Array, inside: Array, first: int, end: int, count: int) -> float:
    """Level of white noise of which so many lines of a spectrum are in a band, and nothing beyond it."""
    share = (end - first) / (count - 1)
    return min(float(np.std(inside) / np.sqrt(share)), _at_most(channel, end / (count - 1)))


def _ends_of_shelves(power: Array, edges: NDArray[np.intp], bands: Array) -> Iterator[int]:
    """Bands, from the highest down, before which a spectrum is flat, and from which on it falls steeply."""
    level = np.array([float(np.median(power[low:high])) for low, high in pairwise(edges)])
    chances = _SPREAD / np.sqrt(np.diff(edges))
    for last in range(len(level) - 1, _SHELF - 1, -1):
        shelf = level[last - _SHELF : last]
        middle = 0.5 * (bands[last:-1] + bands[last + 1 :])
        least = np.minimum(1 / (_STEEP if bands[last - _SHELF] >= _WELL else _CLIFF), (bands[last] / middle) ** _ORDER)
        flat = np.max(shelf) < (_CORNER + 4 * np.max(chances[last - _SHELF : last])) * np.min(shelf)
        if flat and np.any(level[last:] * (1 + 2 * chances[last:]) < least * np.median(shelf)):
            yield last


def _is_steady(in_band: Array, lines: int) -> bool:
    """Whether a channel in a band of so many lines of its spectrum, over half of it, is as noise: as loud all the time,
    but for chance, and without shocks."""
    loudness = [float(np.mean(part**2)) for part in np.array_split(in_band, _PARTS)]
    often = float(np.median(np.abs(in_band))) / 0.6745
    even = float(np.ptp(np.log(loudness))) < _SIGMAS * np.sqrt(2 * _PARTS / lines)
    return even and float(np.std(in_band)) < float(1 + _BRIEF / np.sqrt(lines)) * often


def _shared(one: Array, other: Array, band: Array) -> float:
    """Mean coherence of two channels in a band [of half the sample rate]; 0 where one of them is constant."""
    if np.ptp(other) == 0:
        return 0.0
    _, common = coherence(one, other, nperseg=len(one) // _PARTS)
    first, end = (band * len(common)).astype(int)
    return float(np.mean(common[first:end]))


def _at_most(channel: Array, corner: float) -> float:
    """Level of white noise below a corner [of half the sample rate] that differences of sixth order allow."""
    below = betainc(_DIFFERENCES + 0.5, 0.5, np.sin(0.5 * np.pi * corner) ** 2)  # of the power of such differences
    return _by_differences(channel) / float(np.sqrt(below))


def is_noise_free(values: Array, spread: float = 0.0) -> bool:
    """Whether a channel (n,) shows no noise: less than the 16 bit of any converter leaves, as in a simulation.

    spread: of the channel in another recording, where that is larger.
    """
    return noise_level(values) <= _NOISE_FREE * max(float(np.std(values)), spread)
