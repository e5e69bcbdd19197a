"""How a rig is excited: shapes of force (peak 1) on any time grid, and hand-driven motion."""

from __future__ import annotations

import numpy as np
from scipy.signal import butter, sosfilt, sosfiltfilt

from benchmarks.proof.motion import Array

FORCES = ("chirp", "multisine", "harmonic", "shaker", "burst", "hammer", "earthquake")


def force(kind: str, t: Array, f0: float, top: float, rng: np.random.Generator) -> Array:
    """A force of peak 1 over time ``t`` [s] for a rig of natural frequency ``f0`` [Hz], up to about ``top`` [Hz]."""
    shape = _SHAPES[kind](t, f0, top, rng)
    edge = min(0.5 / f0, 0.1 * (t[-1] - t[0]))
    shape = shape * np.clip((t - t[0]) / edge, 0, 1) if kind != "hammer" else shape
    return shape / np.max(np.abs(shape))


def hand(t: Array, slow: float, rng: np.random.Generator) -> tuple[Array, Array, Array]:
    """Slow motion of peak 1 driven by hand: strokes of unequal length and speed; x, v, a [1, 1/s, 1/s2].

    ``slow`` [Hz] is the pace of the strokes. The motion is smooth: twice low-passed well above the pace.
    """
    h = t[1] - t[0]
    turns = [0.0]
    while turns[-1] < t[-1] + 2 / slow:
        turns.append(turns[-1] + rng.uniform(0.3, 0.7) / slow)
    sign = np.where(np.arange(len(turns)) % 2, 1.0, -1.0)
    ends = sign * rng.uniform(0.35, 1.0, len(turns))
    ends[0] = 0.0
    x = np.interp(t, turns, ends)
    sos = butter(3, min(4 * slow * h * 2, 0.9), output="sos")
    x = sosfiltfilt(sos, x)
    v = np.gradient(x, h)
    a = np.gradient(v, h)
    return x / np.max(np.abs(x)), v / np.max(np.abs(x)), a / np.max(np.abs(x))


def _chirp(t: Array, f0: float, top: float, rng: np.random.Generator) -> Array:
    T = t[-1] - t[0]
    lo, hi = f0 * rng.uniform(0.15, 0.5), min(top, f0 * rng.uniform(1.6, 3.5))
    if rng.random() < 0.5:
        phase = 2 * np.pi * (lo * t + 0.5 * (hi - lo) / T * t**2)
    else:
        phase = 2 * np.pi * lo * T / np.log(hi / lo) * ((hi / lo) ** (t / T) - 1)
    wave = np.sin(phase)
    return wave[::-1].copy() if rng.random() < 0.3 else wave


def _multisine(t: Array, f0: float, top: float, rng: np.random.Generator) -> Array:
    base = f0 / rng.uniform(8, 20)
    lines = np.arange(1, int(top / base) + 1)
    lines = lines[(lines * base > 0.2 * f0) & (rng.random(len(lines)) < 0.8)]
    out = np.zeros_like(t)
    for line, phase in zip(lines, rng.uniform(0, 2 * np.pi, len(lines)), strict=True):
        out += np.cos(2 * np.pi * base * line * t + phase)
    return out


def _harmonic(t: Array, f0: float, top: float, rng: np.random.Generator) -> Array:
    """Tests at three to five fixed frequencies, one after another, each with a level of its own; the phase goes on."""
    n = int(rng.integers(3, 6))
    f = f0 * rng.uniform(0.4, 1.5, n)
    level = rng.uniform(0.4, 1.0, n)
    at = np.clip((t - t[0]) / (t[-1] - t[0]) * n, 0, n - 1e-9)
    h = t[1] - t[0]
    blend = max(3, int(1.0 / f0 / h))
    kernel = np.hanning(blend + 2)[1:-1]
    kernel /= kernel.sum()

    def smooth(y: Array) -> Array:
        return np.convolve(np.pad(y, (blend, blend), mode="edge"), kernel, mode="same")[blend:-blend]

    return smooth(level[at.astype(int)]) * np.sin(2 * np.pi * np.cumsum(smooth(f[at.astype(int)])) * h)


def _noise(t: Array, lo: float, hi: float, rng: np.random.Generator) -> Array:
    rate = 1 / (t[1] - t[0])
    sos = butter(3, [2 * lo / rate, 2 * hi / rate], btype="band", output="sos")
    return sosfilt(sos, rng.standard_normal(len(t)))


def _shaker(t: Array, f0: float, top: float, rng: np.random.Generator) -> Array:
    """Random force through the roll-off of an amplifier: one pole below, two above."""
    rate = 1 / (t[1] - t[0])
    wave = _noise(t, 0.1 * f0, top, rng)
    low = butter(1, 2 * rng.uniform(0.1, 0.4) * f0 / rate, btype="high", output="sos")
    high = butter(2, 2 * top * rng.uniform(0.5, 0.9) / rate, output="sos")
    return sosfilt(high, sosfilt(low, wave))


def _burst(t: Array, f0: float, top: float, rng: np.random.Generator) -> Array:
    """Bursts of random force, each followed by a free decay."""
    wave, out = _noise(t, 0.2 * f0, top, rng), np.zeros_like(t)
    n = int(rng.integers(2, 5))
    T = (t[-1] - t[0]) / n
    on = rng.uniform(0.5, 0.75)
    place = (t - t[0]) / T % 1
    out = wave * np.clip(np.minimum(place, on - place) / 0.05, 0, 1)
    return out


def _hammer(t: Array, f0: float, top: float, rng: np.random.Generator) -> Array:
    """Blows of a hammer: half sines a good deal shorter than the period, one every few periods."""
    out = np.zeros_like(t)
    width = 1 / top
    at = t[0] + 0.3 / f0
    while at < t[-1] - 2 / f0:
        inside = (t >= at) & (t <= at + width)
        out[inside] += rng.uniform(0.4, 1.0) * rng.choice([-1, 1]) * np.sin(np.pi * (t[inside] - at) / width) ** 2
        at += rng.uniform(2, 7) / f0
    return out


def _earthquake(t: Array, f0: float, top: float, rng: np.random.Generator) -> Array:
    """Ground motion after Kanai and Tajimi with an envelope after Jennings; the force is that of the moving frame."""
    h = t[1] - t[0]
    w, zeta = 2 * np.pi * f0 * rng.uniform(0.7, 1.6), rng.uniform(0.3, 0.6)
    ground = _noise(t, 0.1 * f0, top, rng)
    sos = butter(2, 2 * min(w / 2 / np.pi, top) * h, output="sos")
    ground = ground * zeta + sosfilt(sos, ground)
    T = t[-1] - t[0]
    place = (t - t[0]) / T
    rise, strong = rng.uniform(0.08, 0.2), rng.uniform(0.4, 0.6)
    envelope = np.where(place < rise, (place / rise) ** 2, np.where(place < strong, 1, np.exp(-4 * (place - strong))))
    return ground * envelope


_SHAPES = {
    "chirp": _chirp,
    "multisine": _multisine,
    "harmonic": _harmonic,
    "shaker": _shaker,
    "burst": _burst,
    "hammer": _hammer,
    "earthquake": _earthquake,
}
