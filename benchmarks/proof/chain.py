"""Measuring chains: what a recorder makes of a motion, and what users make of a recording."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from scipy.integrate import cumulative_trapezoid
from scipy.signal import bessel, butter, savgol_filter, sosfilt, sosfilt_zi, sosfiltfilt

from benchmarks.proof.effects import Rng
from benchmarks.proof.motion import Array, Motion

UNITS = {"t": "s", "F": "N", "x": "m", "v": "m/s", "a": "m/s2"}


@dataclass(frozen=True)
class Chain:
    """A recorder with its sensors. Sizes of noise, zero and range are those of the channel's rms in the loudest test.

    ``snr``: dB or None (no noise). ``quieter``: dB by which each channel is quieter. ``decimated``: corner of a digital
    filter over the sampling rate, behind which the noise falls too; 0 for none. ``pink``: share of the noise power that
    falls as 1/f. ``bits``: 0 for none. ``filter``: corner of the anti-alias filter over the sampling rate, the same on
    all channels; 0 for none. ``coupling``: corner of the AC-coupled accelerometer [Hz]; ``slowest``: below this [Hz]
    nothing of interest happens (users who integrate cut there). ``gain``, ``zero``, ``drift``: per channel.
    ``fault``: {"delay"|"gain"|"drift"|"saturation": (channel, size)}.
    ``derive``: how users get v and a; None where all channels are measured.
    """

    style: str
    snr: float | None
    channels: str = "Fxva"
    quieter: dict[str, float] = field(default_factory=dict)
    decimated: float = 0.0
    pink: float = 0.0
    bits: int = 0
    filter: float = 0.0
    coupling: float = 0.0
    slowest: float = 0.1
    gain: dict[str, float] = field(default_factory=dict)
    zero: dict[str, float] = field(default_factory=dict)
    drift: dict[str, float] = field(default_factory=dict)
    fault: dict[str, tuple[str, float]] = field(default_factory=dict)
    derive: str | None = None


def draw_chain(snr: float | None, f0: float, rng: Rng, style: str | None = None) -> Chain:
    """A chain in use: on the bench, in a laboratory or in the field, with all channels or some."""
    style = style or str(rng.choice(["bench", "laboratory", "field"], p=[0.35, 0.4, 0.25]))
    quiet = snr is None or snr >= 34
    channels = str(rng.choice(["Fxva", "Fxa", "Fx", "Fa", "Fxv"], p=[0.4, 0.2, 0.2, 0.1, 0.1])) if quiet else "Fxva"
    derive = None
    if channels == "Fx" and rng.random() < 0.5:
        derive = str(rng.choice(["difference", "savgol", "lowpass"]))
    elif channels == "Fa" and rng.random() < 0.4:
        derive = "integrate"
    bits = (
        0 if snr is None and rng.random() < 0.4 else int(rng.choice([16, 24] if snr is not None and snr < 70 else [24]))
    )
    if style == "bench":
        return Chain(style, snr, channels, bits=bits, slowest=0.05 * f0, derive=derive)
    return Chain(
        style,
        snr,
        channels,
        pink=rng.uniform(0.2, 0.7),
        bits=bits,
        filter=0.4 if rng.random() < 0.6 else 0.0,
        coupling=f0 * rng.uniform(0.003, 0.01) if "a" in channels and "x" in channels and rng.random() < 0.5 else 0.0,
        slowest=0.05 * f0,
        derive=derive,
    )


# Channels of motion that are recorded where not all are, besides what is derived from them.
MOTION = ("x", "v", "a", "xv", "xa", "va", "xva")


def with_own_noise(chain: Chain, rng: Rng) -> Chain:
    """The chain with any channels of motion, each sensor with a noise of its own; one recorder in three decimates."""
    return replace(
        chain,
        channels="F" + str(rng.choice(MOTION)),
        derive=None,
        coupling=0.0,
        quieter={c: rng.uniform(-8, 30) for c in "Fxva"},
        decimated=rng.uniform(0.3, 0.45) if rng.random() < 1 / 3 else 0.0,
    )


@dataclass(frozen=True)
class Levels:
    """rms and peak of each channel in the loudest test: noise and range of a sensor do not follow the signal."""

    rms: dict[str, float]
    peak: dict[str, float]


def levels(motions: list[Motion]) -> Levels:
    """Levels over all tests with this set of sensors."""
    rms = {c: max(float(np.sqrt(np.mean(getattr(m, c) ** 2))) for m in motions) for c in "Fxva"}
    peak = {c: max(float(np.max(np.abs(getattr(m, c)))) for m in motions) for c in "Fxva"}
    return Levels(rms, peak)


def record(
    motion: Motion, over: int, chain: Chain, level: Levels, rng: Rng, noisy: bool = True
) -> tuple[dict[str, Array], dict[str, Array]]:
    """The columns of the file, and all four channels as ideal sensors behind the same filter would give them."""
    fine = 1 / (motion.t[1] - motion.t[0])
    rate = fine / over
    clean, seen = {}, {}
    for c in "Fxva":
        # sensors and filters ran before the recording began
        past = motion.before.get(c, np.zeros(0))
        y = np.concatenate([past, getattr(motion, c)])
        if chain.filter:
            y = _causal(bessel(4, 2 * chain.filter * rate / fine, norm="mag", output="sos"), y)
        clean[c] = y[len(past) :: over].copy()
        if "delay" in chain.fault and chain.fault["delay"][0] == c:
            y = _delayed(y, chain.fault["delay"][1] * fine)
        if c == "a" and chain.coupling:
            y = sosfilt(butter(1, 2 * chain.coupling / fine, btype="high", output="sos"), y)  # at rest before
        seen[c] = _sensed(y[len(past) :: over].copy(), c, chain, level, rng, noisy)
    t = motion.t[::over]
    out = {c: seen[c] for c in chain.channels}
    if chain.derive:
        out |= derived(out, 1 / rate, chain)
    return {"t": t, **out}, clean


def _sensed(y: Array, c: str, chain: Chain, level: Levels, rng: Rng, noisy: bool) -> Array:
    place = np.linspace(0, 1, len(y))
    y = y * chain.gain.get(c, 1.0) + level.rms[c] * (chain.zero.get(c, 0.0) + chain.drift.get(c, 0.0) * place)
    for name, (channel, size) in chain.fault.items():
        if channel != c:
            continue
        if name == "gain":
            y = y * size
        elif name == "drift":
            y = y + level.rms[c] * size * (0.4 + place)
        elif name == "saturation":
            y = np.clip(y, -size * level.peak[c], size * level.peak[c])
    if noisy and chain.snr is not None:
        loudness = 10 ** (-(chain.snr + chain.quieter.get(c, 0.0)) / 20)
        y = y + level.rms[c] * loudness * noise(len(y), chain.pink, rng, chain.decimated)
    if chain.bits:
        step = 2.5 * level.peak[c] / 2**chain.bits
        y = np.round(y / step) * step
    return y


def noise(n: int, pink: float, rng: Rng, decimated: float = 0.0) -> Array:
    """White noise of rms 1, of which the share ``pink`` of the power falls as 1/f; white up to ``decimated`` alone."""
    white = rng.standard_normal(n)
    if decimated:
        white = sosfiltfilt(butter(5, 2 * decimated, output="sos"), white)
        white /= np.std(white)
    spectrum = np.fft.rfft(rng.standard_normal(n))
    spectrum[0] = 0
    spectrum[1:] /= np.sqrt(np.arange(1, len(spectrum)))
    coloured = np.fft.irfft(spectrum, n)
    return np.sqrt(1 - pink) * white + np.sqrt(pink) * coloured / np.std(coloured)


def derived(columns: dict[str, Array], dt: float, chain: Chain) -> dict[str, Array]:
    """What users do: v and a from x by quotients, by Savitzky and Golay, after a low-pass, or v and x from a."""
    if chain.derive == "integrate":
        cut = butter(2, 2 * chain.slowest * dt, btype="high", output="sos")
        v = sosfiltfilt(cut, cumulative_trapezoid(columns["a"], dx=dt, initial=0))
        return {"v": v, "x": sosfiltfilt(cut, cumulative_trapezoid(v, dx=dt, initial=0))}
    x = columns["x"]
    if chain.derive == "savgol":
        return {"v": savgol_filter(x, 9, 3, deriv=1, delta=dt), "a": savgol_filter(x, 9, 3, deriv=2, delta=dt)}
    if chain.derive == "lowpass":
        x = sosfiltfilt(butter(4, 0.25, output="sos"), x)
    v = np.gradient(x, dt)
    return {"x": x, "v": v, "a": np.gradient(v, dt)}


def _delayed(y: Array, samples: float) -> Array:
    at = np.arange(len(y)) - samples
    return np.interp(at, np.arange(len(y)), y)


def _causal(sos: Array, y: Array) -> Array:
    out, _ = sosfilt(sos, y, zi=sosfilt_zi(sos) * y[0])
    return out
