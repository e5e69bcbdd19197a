"""Columns by which any restoring force is told from inertia, made of the motion of one recording."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hystid.consistency.kinematics import ORDER, ChannelSpectrum, motion, spectrum
from hystid.consistency.spectra import REACH, derived
from hystid.recording import Array, Recording
from hystid.smoothing.noise import noise_level

_KNOTS = 7  # of the curve of the displacement: one stop on either side, a dead zone and a slope between them
_AGAIN = 1.5  # width of the kernel that all columns pass, over that of the first: 92 % at the top of the band
_MEMORY = 5  # knots of the curve of the way since the last turn
_INTEGRATED = 1e-4  # share of noise in the power of an integrated displacement: as from a sensor of 40 dB
REST = 0.01  # energy at the beginning over the largest one, from which it could tell for a tenth of the force
FEWEST = 64  # samples of a force that can be compared with a motion


@dataclass(frozen=True)
class ForceColumns:
    """Smoothed columns, shape (n,) each, of one recording; those of ``signed`` have coefficients of at least 0.

    noise: a draw of the noise in the first of these, the acceleration.
    """

    F: Array
    signed: Array
    free: Array
    memory: Array
    x: Array
    noise: Array

    def smoothed(self, width: float) -> ForceColumns:
        """The same, all smoothed alike by a kernel of a width [samples].

        A curve of the displacement has harmonics that the acceleration lost where it was differentiated: both lose
        them here.
        """
        if len(self.F) < 8 * width * REACH + 2 * FEWEST:
            return self
        each = [
            np.stack([derived(u, 0, 1.0, width, flat=True) + np.mean(u) for u in table.T], axis=1)
            for table in (self.F[:, None], self.signed, self.free, self.memory, self.x[:, None], self.noise[:, None])
        ]
        return ForceColumns(each[0][:, 0], each[1], each[2], each[3], each[4][:, 0], each[5][:, 0])

    def part(self, rows: slice) -> ForceColumns:
        """The same of a part of the recording."""
        each = (self.F, self.signed, self.free, self.memory, self.x, self.noise)
        return ForceColumns(*(column[rows] for column in each))


def columns_of(recording: Recording, curved: bool = False) -> ForceColumns | None:
    """Columns of one recording, None where they cannot be had; ``curved``: smoothed so that curves stay curves."""
    names, dt = motion(recording), recording.dt
    if recording.F is None or not names or not np.ptp(recording.F):
        return None
    last = list(names)[-1]  # the channel that the acceleration is taken from
    held = spectrum(names[last], dt)
    level = max(held.noise, noise_level(names[last], [recording.F], cautious=True))
    width = _width(held, level, dt, len(recording))
    found: dict[int, Array] = {}
    for target in (0, 1, 2):
        sources = [name for name in names if ORDER[name] <= target]
        if sources:
            source = max(sources, key=lambda name: ORDER[name])
            found[target] = derived(names[source], target - ORDER[source], dt, width, curved)
    force = derived(recording.F, 0, dt, width, curved)
    if len(force) < FEWEST:
        return None
    draw = level * np.random.default_rng(0).standard_normal(len(recording))
    noise = derived(draw, 2 - ORDER[last], dt, width, curved)
    columns = _assembled(recording, found, force, noise)
    return columns.smoothed(_AGAIN * width) if curved and columns is not None else columns


def _assembled(recording: Recording, found: dict[int, Array], force: Array, noise: Array) -> ForceColumns | None:
    dt = recording.dt
    names = motion(recording)
    if 0 not in found:  # integrals, without drift; the force is compared in the same band
        edge = _lowest(recording)
        for target in range(min(found) - 1, -1, -1):
            found[target] = _integral(found[target + 1], dt)
        kept = _settled_filter(edge * dt, found[max(found)])
        found = {target: _above(values, edge * dt)[kept] for target, values in found.items()}
        force, noise = _above(force, edge * dt)[kept], noise[kept]
    if not all(np.any(found[k]) for k in (0, 1, 2)):
        return None
    if "x" in names:
        found[0] = found[0] + np.mean(names["x"])
    inertia = np.zeros_like(found[2]) if recording.quasi_static else found[2]
    way = _sign(found[1])
    signed = np.stack([inertia, found[1], way], axis=1)
    since = way[:, None] * _hats(_since_turn(found[0], found[1]), _MEMORY)[:, 1:]
    memory = np.concatenate([(found[1] * np.abs(found[1]))[:, None], since], axis=1)
    return ForceColumns(force, signed, _curve(found[0]), memory, found[0], noise)


def _width(held: ChannelSpectrum, level: float, dt: float, samples: int) -> float:
    """Kernel that keeps what stands above the noise of the channel that the motion is taken from. level: of that noise,
    before a filter that may end it."""
    top = held.signal_band(10.0 * (level / max(held.noise, 1e-300)) ** 2)[1] * dt
    widest = max(1.5, samples / 400)
    return float(np.clip(1.2 / max(top, 1e-3), 1.5, min(widest, 60.0)))


def _lowest(recording: Recording) -> float:
    """Frequency [rad/s] above which the displacement, integrated from the motion, is motion and not noise.

    0 where it is so down to the slowest waves of the recording.
    """
    name = next(iter(motion(recording)))
    held = spectrum(motion(recording)[name], recording.dt)
    if len(held.omega) < 2:
        return 0.0
    weight = np.gradient(held.omega) / held.omega ** (2 * ORDER[name])
    noise = held.level * weight
    signal = np.maximum(held.density - held.level, 0.0) * weight
    total = np.maximum(np.cumsum(signal[::-1])[::-1], 1e-300)
    share = np.cumsum(noise[::-1])[::-1] / total
    clear = int(np.argmax(share <= max(_INTEGRATED, 2.0 * float(np.min(share)))))
    return 0.5 * float(held.omega[clear]) if clear else 0.0  # an octave lower, so that the filter leaves the motion


def _above(values: Array, edge: float) -> Array:
    """A channel without what is slower than an edge [rad per sample]."""
    if edge <= 0:
        return values
    from scipy.signal import butter, sosfiltfilt

    return np.asarray(sosfiltfilt(butter(4, edge / np.pi, "high", output="sos"), values))


def _settled_filter(edge: float, values: Array) -> slice:
    """Samples that such a filter leaves without its transients: they are a hundredth after one period of the edge.

    At an end where the structure rests there are none, and a blow may come right after it.
    """
    n = len(values)
    period = min(int(2 * np.pi / edge), n // 8) if edge > 0 else 0
    largest, short = REST * float(np.max(values**2)), max(period // 8, 1)
    first, last = (0 if np.mean(end**2) < largest else period for end in (values[:short], values[-short:]))
    return slice(first, n - last)


def _integral(values: Array, dt: float) -> Array:
    """Integral without its drift; a window keeps a tone that is cut within its period out of that."""
    k, window = np.linspace(-1, 1, len(values)), np.hanning(len(values))
    plain = values - np.average(values, weights=window)
    total = (np.cumsum(plain) - 0.5 * plain) * dt
    return np.asarray(total - np.polyval(np.polyfit(k, total, 3, w=np.sqrt(window)), k))


def _sign(v: Array) -> Array:
    return np.asarray(np.tanh(v / max(0.05 * float(np.std(v)), 1e-300)))


def _since_turn(x: Array, v: Array) -> Array:
    """Way since the velocity last changed its sign, shape (n,)."""
    turn = np.concatenate([[True], np.signbit(v[1:]) != np.signbit(v[:-1])])
    last = np.maximum.accumulate(np.where(turn, np.arange(len(x)), 0))
    return np.asarray(np.abs(x - x[last]))


def _curve(x: Array) -> Array:
    """Columns of any curve of the displacement, shape (n, _KNOTS + 2): broken lines, and a square and a cube.

    Along a resonance that a cubic spring bends the restoring force is many times the measured one, and what broken
    lines leave of it would pass for inertia.
    """
    plain = (x - np.mean(x)) / max(float(np.std(x)), 1e-300)
    return np.concatenate([_hats(x, _KNOTS), np.stack([plain**2, plain**3], axis=1)], axis=1)


def _hats(x: Array, count: int) -> Array:
    """Broken lines over the range of x, shape (n, count): any curve of it."""
    knots = np.quantile(x, np.linspace(0.0, 1.0, count))
    knots = knots + np.linspace(-1e-9, 1e-9, count) * max(float(np.ptp(x)), 1e-300)
    return np.stack([np.interp(x, knots, row) for row in np.eye(count)], axis=1)
