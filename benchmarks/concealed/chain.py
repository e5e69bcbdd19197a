"""The measurement chain: band-limited sampling of all channels, faults, decoys, noise.

The rig runs ``OVERSAMPLING`` steps per sample. Every channel passes the same linear-phase filter before it is sampled,
as an anti-aliasing filter would do; its delay is taken out.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from scipy.signal import firwin, oaconvolve

from benchmarks.concealed.excitation import Test, force
from benchmarks.concealed.rig import Array, Rig, run

OVERSAMPLING = 16
CHANNELS = ("x", "v", "a", "F")
DECOYS = ("hold", "small_delay", "coloured_noise", "mains", "quantisation")


@dataclass(frozen=True)
class Fault:
    """A sensor fault. id as in the documentation; channel; size: samples, share or level in units of the channel."""

    id: str
    channel: str
    size: float
    law: int = 0


@dataclass(frozen=True)
class Chain:
    """How a case is measured. snr [dB] per channel; running: the recording begins in mid-motion."""

    sample_rate: float
    samples: int
    snr: float
    fault: Fault | None = None
    decoy: str = ""
    running: bool = False
    fixed_noise: bool = False

    @property
    def duration(self) -> float:
        """Length of a recording [s]."""
        return self.samples / self.sample_rate


@dataclass(frozen=True)
class Taken:
    """One recording. measured: as handed out; clean: with the fault but without noise; true: without either.

    effects: force of each concealed effect at the samples, shape (effects, n) [N].
    noise: standard deviation per channel.
    """

    t: Array
    true: dict[str, Array]
    clean: dict[str, Array]
    effects: Array
    measured: dict[str, Array] = field(default_factory=dict)
    noise: dict[str, float] = field(default_factory=dict)


def take(rig: Rig, test: Test, chain: Chain, index: int, oversampling: int = OVERSAMPLING) -> Taken:
    """Run one test and sample it, without noise. index: number of the recording (drifts differ between recordings)."""
    q, margin = oversampling, 24
    lead = chain.samples // 4 if chain.running else 0
    kept = lead + chain.samples
    total = kept + margin
    dt = 1 / (chain.sample_rate * q)
    drive = force(test, total / chain.sample_rate, 2 * q * total + 1)
    if chain.decoy == "hold":  # the amplifier holds each command for one sample; what is recorded are the commands
        drive = np.append(np.repeat(drive[: -1 : 2 * q], 2 * q), drive[-1])
    motion = run(rig, drive, dt)
    concealed = [row for row, e in zip(motion.each, rig.elements, strict=True) if e.concealed]
    fine = {"x": motion.x, "v": motion.v, "a": motion.a, "F": drive[::2]}
    cut = slice(lead, kept)
    true = {name: _sampled(y, q)[cut] for name, y in fine.items()}
    if chain.decoy == "hold":
        true["F"] = np.ascontiguousarray(drive[: -1 : 2 * q][cut])
    clean = dict(true)
    fault = chain.fault or (Fault("channel_delay", "F", 0.3) if chain.decoy == "small_delay" else None)
    if fault:
        clean[fault.channel] = _faulty(fault, fine[fault.channel], true[fault.channel], q, cut, index)
    effects = np.array([_sampled(row, q)[cut] for row in concealed]).reshape(len(concealed), chain.samples)
    return Taken(np.arange(chain.samples) / chain.sample_rate, true, clean, effects)


def measure(taken: Taken, chain: Chain, rng: np.random.Generator, reference: dict[str, float]) -> Taken:
    """Add noise, mains, quantisation, clipping. reference: standard deviations that the SNR refers to."""
    spread = {c: reference[c] * 10 ** (-chain.snr / 20) for c in CHANNELS}
    measured = {c: taken.clean[c] + spread[c] * _noise(len(taken.t), rng, chain.decoy) for c in CHANNELS}
    if chain.decoy == "mains":
        for c in CHANNELS:
            measured[c] = measured[c] + 1.0 * spread[c] * np.sin(2 * np.pi * 50 * taken.t + rng.uniform(0, 6.28))
    if chain.decoy == "quantisation":
        for c in CHANNELS:
            step = 2.5 * spread[c]
            measured[c] = step * np.round(measured[c] / step)
    if chain.fault and chain.fault.id == "sensor_saturation":
        measured[chain.fault.channel] = np.clip(measured[chain.fault.channel], -chain.fault.size, chain.fault.size)
    return Taken(taken.t, taken.true, taken.clean, taken.effects, measured, spread)


def _noise(n: int, rng: np.random.Generator, decoy: str) -> Array:
    white = rng.standard_normal(n + 200)
    if decoy != "coloured_noise":
        return white[200:]
    coloured = np.empty_like(white)
    state, pole = 0.0, 0.85
    for i, value in enumerate(white):
        state = pole * state + value
        coloured[i] = state
    return np.asarray(coloured[200:] * np.sqrt(1 - pole**2))


def _sampled(fine: Array, q: int) -> Array:
    """Low-pass at 0.45 of the sample rate (linear phase, delay removed) and take every q-th value."""
    taps = firwin(24 * q + 1, 0.9 / q)
    half = len(taps) // 2
    padded = np.concatenate([np.full(half, fine[0]), fine, np.full(half, fine[-1])])
    return np.asarray(oaconvolve(padded, taps, mode="valid")[::q])


def _faulty(fault: Fault, fine: Array, sampled: Array, q: int, cut: slice, index: int) -> Array:
    if fault.id == "channel_delay":
        shift = round(fault.size * q)
        late = np.concatenate([np.full(shift, fine[0]), fine[: len(fine) - shift]])
        return _sampled(late, q)[cut]
    if fault.id == "force_gain":
        return sampled * (1 + fault.size)
    if fault.id == "force_drift":
        u = np.linspace(0, 1, len(sampled))
        law = u if fault.law == 0 else 1 - np.exp(-3 * u)
        return np.asarray(
            sampled + fault.size * ((0.4, -0.3, 0.7, -0.6, 0.5)[index % 5] + (1, 0.6, -0.8, 1.2, 0.9)[index % 5] * law)
        )
    return np.clip(sampled, -fault.size, fault.size)
