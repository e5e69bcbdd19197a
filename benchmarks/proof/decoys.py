"""Healthy rigs with a disturbance: nothing is missing in the model, whatever the recording says."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from benchmarks.proof.effects import Rng
from benchmarks.proof.motion import Array

CALM = ("consistent", "recalibrated")
FAULTY = (*CALM, "sensor_fault")


@dataclass(frozen=True)
class Decoy:
    """``chain``: changes of the chain's fields; ``force``: unmeasured force over its share of the peak force;
    ``columns``: what is done to the file; ``verdicts``, ``names``: what may be said without an alarm being false."""

    name: str
    verdicts: tuple[str, ...] = CALM
    names: tuple[str, ...] = ()
    chain: dict[str, object] = field(default_factory=dict)
    force: Callable[[Array, float], Array] | None = None
    columns: Callable[[dict[str, Array], Rng], dict[str, Array]] | None = None


def draw_decoy(f0: float, rng: Rng) -> Decoy:
    """One of the disturbances below, with sizes of its own."""
    return list(DECOYS.values())[int(rng.integers(len(DECOYS)))](f0, rng)


def knocks(f0: float, rng: Rng) -> Decoy:
    """Somebody knocks at the rig: a few short pulses that the force sensor does not see."""
    seed = int(rng.integers(1 << 31))

    def force(t: Array, peak: float) -> Array:
        own = np.random.default_rng(seed)
        out = np.zeros_like(t)
        for at in own.uniform(0.1, 0.9, int(own.integers(2, 5))) * t[-1]:
            width = 0.15 / f0
            inside = (t > at) & (t < at + width)
            out[inside] += peak * own.uniform(0.3, 0.8) * np.sin(np.pi * (t[inside] - at) / width) ** 2
        return out

    return Decoy("knocks", force=force)


def hum_on_rig(f0: float, rng: Rng) -> Decoy:
    """A machine next door shakes the rig at one frequency: unknown_physics is an honest word for it."""
    f, size, phase = f0 * rng.uniform(0.6, 2.5), rng.uniform(0.02, 0.1), rng.uniform(0, 6)
    return Decoy(
        "hum_on_rig",
        (*FAULTY, "unknown_physics"),
        force=lambda t, peak: size * peak * np.cos(2 * np.pi * f * t + phase),
    )


def hum_on_channels(f0: float, rng: Rng) -> Decoy:
    """Mains in the cables of one channel."""
    channel, size, f = str(rng.choice(list("Fxa"))), rng.uniform(0.02, 0.08), float(rng.choice([50.0, 60.0]))

    def columns(data: dict[str, Array], _: Rng) -> dict[str, Array]:
        if channel not in data:
            return data
        return data | {channel: data[channel] + size * np.std(data[channel]) * np.sin(2 * np.pi * f * data["t"] + 1)}

    return Decoy("hum_on_channels", FAULTY, columns=columns)


def coloured(f0: float, rng: Rng) -> Decoy:
    """Noise that falls as 1/f throughout."""
    return Decoy("coloured", FAULTY, ("force_drift", "preload"), chain={"pink": 1.0})


def zero(f0: float, rng: Rng) -> Decoy:
    """A channel whose zero was not taken."""
    channel = str(rng.choice(list("Fxx")))
    return Decoy("zero", FAULTY, ("force_drift", "preload"), chain={"zero": {channel: rng.uniform(0.01, 0.05)}})


def drift(f0: float, rng: Rng) -> Decoy:
    """A zero that drifts while the sensor warms up."""
    return Decoy(
        "drift",
        FAULTY,
        ("force_drift", "preload"),
        chain={"drift": {str(rng.choice(list("Fx"))): rng.uniform(0.01, 0.05)}},
    )


def gain(f0: float, rng: Rng) -> Decoy:
    """Sensors calibrated to 1 %."""
    gains = {c: 1 + 0.01 * float(rng.uniform(-1, 1)) for c in "Fxva"}
    return Decoy("gain", FAULTY, ("force_gain", "added_mass"), chain={"gain": gains})


def spikes(f0: float, rng: Rng) -> Decoy:
    """Bad samples of the data link."""

    def columns(data: dict[str, Array], own: Rng) -> dict[str, Array]:
        out = dict(data)
        channel = str(own.choice([c for c in out if c != "t"]))
        y = out[channel].copy()
        y[own.integers(0, len(y), 4)] = 3 * np.max(np.abs(y))
        return out | {channel: y}

    return Decoy("spikes", FAULTY, columns=columns)


def coarse(f0: float, rng: Rng) -> Decoy:
    """A recorder of 10 bits."""
    return Decoy("coarse", chain={"bits": 10})


def clock(f0: float, rng: Rng) -> Decoy:
    """Time stamps of the computer, rounded and starting anywhere; the sampling itself is even."""

    def columns(data: dict[str, Array], own: Rng) -> dict[str, Array]:
        dt = data["t"][1] - data["t"][0]
        stamp = data["t"] + float(own.uniform(10, 5000))
        return data | {"t": stamp + dt * 0.02 * own.uniform(-1, 1, len(stamp))}

    return Decoy("clock", FAULTY, columns=columns)


def gusts(f0: float, rng: Rng) -> Decoy:
    """Noise whose level changes in time."""

    def columns(data: dict[str, Array], own: Rng) -> dict[str, Array]:
        place = np.linspace(0, 1, len(data["t"]))
        level = 0.03 * np.exp(-(((place - 0.6) / 0.15) ** 2))
        return {c: y if c == "t" else y + np.std(y) * level * own.standard_normal(len(y)) for c, y in data.items()}

    return Decoy("gusts", FAULTY, columns=columns)


DECOYS: dict[str, Callable[[float, Rng], Decoy]] = {
    "knocks": knocks,
    "hum_on_rig": hum_on_rig,
    "hum_on_channels": hum_on_channels,
    "coloured": coloured,
    "zero": zero,
    "drift": drift,
    "gain": gain,
    "spikes": spikes,
    "coarse": coarse,
    "clock": clock,
    "gusts": gusts,
}
