"""Which channels of a motion are measurements, and which were computed from another one.

A channel that was computed repeats the noise of its source, at every frequency at which its filter lets that pass. A
measured one has noise of its own. So the coherence of the two decides, where there is noise and no motion: near 1 for
a computed channel, near 0 for a measured one, however small the difference of their values is. Motion is coherent as
well; it is told from noise by its slope: the spectrum of a mass falls as 1/f^4 in x and 1/f^2 in v, that of noise is
flat.

Where no noise is to be seen (simulations, 24 bit), a channel that follows from the other one to the last digit counts
as computed if it is not the derivative: the error of its difference quotient would be taken for noise. A sum over the
other channel is exact as a sum, a measured one is nearer to the integral.
"""

from __future__ import annotations

import itertools
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.signal import get_window

from hystid.consistency.kinematics import DIGITS, ORDER, formula
from hystid.diagnosis.prepare.differences import derivative, spectra
from hystid.numeric import Array
from hystid.recording import Recording
from hystid.smoothing.noise import is_noise_free

_BANDS = 16  # bands of the spectrum in which noise is looked for
_SEGMENTS = 24  # averaged spectra: independent noise then has a coherence of 1/24 in the mean
_SHARED = 0.5  # coherence of noise at which as much of it is shared as is not
_OWN = 0.2  # coherence that shared noise cannot have: four fifths of the power would be of its own
_EXACTLY = 0.01  # misfit of a sum over its steps: rounding, not noise of its own
_LEAK = 1e-9  # side lobes of the window, 92 dB below the largest line
_DERIVATIVE = 1e-3  # error of a derivative that the smoother, which takes v = dx/dt as exact, does not notice
_OCTAVE = np.sqrt(2)  # half of the band, as a ratio of frequencies, in which the slope of a spectrum is taken
_SCATTER = 1.0  # of the logarithm of a spectrum: lines of hum scatter that of a noise by less than a factor of e
_LINES = 8  # lines of a spectrum at least that show a slope
_COMPUTED = "computed from {0}: it repeats the noise of {0}"
_MOTION = 0.999  # share of the power of the velocity that counts as motion


@dataclass(frozen=True)
class MeasuredChannels:
    """A recording with its computed channels taken out, which channels were measured, and why the others were not."""

    recording: Recording
    measured: tuple[str, ...]
    computed: Mapping[str, str]


def measurements(recording: Recording, doubtful: Collection[str] = "xva") -> MeasuredChannels:
    """Sort the channels of the motion into measured and computed ones; computed ones are taken out of the recording.

    doubtful: channels that may be computed.

    Two channels that share their noise are one measurement: the source is the one whose own noise is the whiter.
    """
    found = recording.channels("xva")
    known = {name: values for name, values in found.items() if recording.direct(name)}
    computed = {name: "computed when it was read" for name in found if name not in known}
    for low, high in (("x", "v"), ("v", "a"), ("x", "a")):
        if low in known and high in known:
            told = _related(known[low], known[high], (ORDER[low], ORDER[high]), recording.dt)
            source, other = (low, high) if told == "higher" else (high, low)
            if told and other in doubtful and (source not in computed or len(known) - len(computed) > 1):
                quiet = is_noise_free(known[source])
                reason = f"as it follows from {source} to its last digit"
                computed.setdefault(other, reason if quiet else _COMPUTED.format(source))
    left = recording.with_channels(dict.fromkeys(computed))
    return MeasuredChannels(left, tuple(name for name in known if name not in computed), computed)


def measured_alike(recordings: Sequence[Recording], deciding: int | None = None) -> list[MeasuredChannels]:
    """The same for recordings of one rig: what was computed in half of those that hold it was computed in all of them,
    as a recording may be too short, or too quiet, to show it; in fewer, in none. No recording loses its last
    channel.

    deciding: number of recordings, the first ones, of which half are enough as well: what is held out may show that a
    channel was computed, and not that it was measured.
    """
    each = [measurements(recording) for recording in recordings]
    why = {name: reason for channels in reversed(each) for name, reason in channels.computed.items()}
    common = [name for name in why if _in_half(name, each) or _in_half(name, each[:deciding])]
    if set(why) - set(common):
        each = [measurements(recording, common) for recording in recordings]
    found = []
    for channels in each:
        for name in common:
            if name in channels.measured and len(channels.measured) > 1:
                left = tuple(one for one in channels.measured if one != name)
                without = channels.recording.with_channels({name: None})
                told = {**channels.computed, name: f"{why[name]} in the other recordings"}
                channels = MeasuredChannels(without, left, told)
        found.append(channels)
    return found


def _in_half(name: str, each: Sequence[MeasuredChannels]) -> bool:
    """Whether a channel was computed in half of the recordings that hold it."""
    computed = sum(name in channels.computed for channels in each)
    return computed > 0 and computed >= sum(name in channels.measured for channels in each)


def _related(low: Array, high: Array, orders: tuple[int, int], dt: float) -> str:
    """Which of two channels was computed from the other one: "higher" or "lower" derivative; "" for neither.

    orders: of their derivatives of the displacement.
    """
    order = orders[1] - orders[0]
    if len(low) < 4 * _SEGMENTS or not (np.std(low) > 0 and np.std(high) > 0):
        return ""
    if _is_exact_but_no_derivative(low, high, order, dt):
        return "higher"
    if _is_sum(low, high, order, dt):  # of a simulation each sums up to the other
        return "" if is_noise_free(low) and is_noise_free(high) else "lower"
    steep = np.diff(low, order)  # a filter changes no coherence; of two slopes alike, the window leaks least
    other_steep = high[order:]
    length = int(2 ** np.floor(np.log2(2 * len(steep) / (_SEGMENTS + 1))))
    window = get_window("blackmanharris", length)
    omega, one, other, both = spectra(steep, other_steep, window, "linear")
    cross = np.abs(both) ** 2
    first = _end_of_motion(omega, np.minimum(one, other * np.max(one) / np.max(other)))
    seen = _above_floor(one, float(np.std(low))) & _above_floor(other, float(np.std(high)))
    own = one[1:] / (2 * np.sin(omega[1:] / 2)) ** (2 * order)  # spectrum of the lower channel itself
    seen[1:] &= _is_flat(omega[1:], own, 2 * (ORDER["a"] - orders[0]))
    edges = np.linspace(first, len(omega), _BANDS + 1).astype(int)
    shared = []
    for begin, end in itertools.pairwise(edges):
        inside = slice(begin, end)
        if end - begin >= 2 and np.all(seen[inside]):
            shared.append(float(np.median(cross[inside] / (one[inside] * other[inside]))))
    return "higher" if shared and min(shared) >= _OWN and float(np.median(shared)) >= _SHARED else ""


def _is_flat(omega: Array, power: Array, falls: float) -> NDArray[np.bool_]:
    """Where a spectrum is rather that of noise, which is flat, than of a motion.

    falls: power of the frequency with which that of a motion falls at least.
    """
    flat = np.zeros(len(omega), dtype=bool)
    height, place = np.log(np.maximum(power, 1e-300)), np.log(omega)
    for at in np.geomspace(omega[0], omega[-1], 4 * _BANDS):
        near = (omega >= at / _OCTAVE) & (omega <= at * _OCTAVE)
        if np.count_nonzero(near) >= _LINES:
            slope, level = np.polyfit(place[near], height[near], 1)
            scatter = float(np.std(height[near] - slope * place[near] - level))
            flat[near] |= slope > -falls / 2 and scatter < _SCATTER  # harmonics stand out of what is between them
    return flat


def _is_sum(low: Array, high: Array, order: int, dt: float) -> bool:
    """Whether the lower channel is the sum of the higher one, by trapezoids or rectangles, and not its integral: a
    derivative taken of the lower one would have smoothed the steps between its samples, or spread them. What a user
    filtered out of the sum below the motion does not count, hence second differences."""
    steps = np.diff(low, order)[1:-1]
    before, here, after, beyond = (high[k : len(high) - 3 + k] for k in range(4))
    if order == 1:
        sums, integral = [here, after, 0.5 * (here + after)], (13 * (here + after) - before - beyond) / 24
    else:
        steps, trapezoids = np.diff(low, order)[: len(here)], 0.25 * (before + 2 * here + after)
        sums, integral = [before, here, after, 0.5 * (here + after), trapezoids], (before + 10 * here + after) / 12
    misfits = [float(np.std(np.diff(steps - dt**order * one, 2))) for one in sums]
    as_integral = float(np.std(np.diff(steps - dt**order * integral, 2)))
    return min(misfits) < min(_EXACTLY * float(np.std(np.diff(steps, 2))), as_integral)


def _end_of_motion(omega: Array, power: Array) -> int:
    """First line above the motion: of the power that both channels show, all but a thousandth is below."""
    total = np.cumsum(power / np.maximum(omega, omega[1]) ** 2)
    return int(np.searchsorted(total, _MOTION * total[-1])) + 4  # lines that the window smears


def _above_floor(power: Array, size: float) -> NDArray[np.bool_]:
    """Where a spectrum stands above the rounding of text and of float32, and above what the window leaks."""
    return np.asarray(power > np.maximum(10 * (size * DIGITS / 10) ** 2 / np.pi, _LEAK * np.max(power)))


def _is_exact_but_no_derivative(low: Array, high: Array, order: int, dt: float) -> bool:
    """Whether the higher channel follows from the lower one to the last digit, by weights that are no derivative."""
    if formula(low, high, order, dt) is None:
        return False
    exact = derivative(low, order, dt)  # the one that the balance uses
    inner = slice(8, -8)
    return float(np.std(high[inner] - exact[inner])) > _DERIVATIVE * float(np.std(high))
