"""Rigs that nobody tuned the door on: written in numpy, without a model of this library, with sensors of many kinds.

    python -m benchmarks.slips_by_hand [--show] [--sound-only]

Each of two dozen rigs (light and heavy damping, dry friction, play, stops, a double well, blows, an earthquake, drives,
rigs that turn) is recorded by twenty set-ups of sensors: 20 to 100 dB, 12 and 16 bits, channels that are not there or
computed from others, gains and offsets as sensors have them, a common anti-alias filter, AC coupling far below the
motion. None is to be refused. Then every slip of ``benchmarks.slips`` is made on three of the set-ups.
"""

from __future__ import annotations

import argparse
import math
import zlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from scipy.signal import butter, sosfilt, sosfiltfilt

from benchmarks.slips import Slip, _makes_sense, slips
from hystid.consistency import Examination, examine
from hystid.recording import Array, Recording

Law = Callable[[float, float, float], tuple[float, float]]  # (x, v, z) -> (R, dz/dt)
_SLIPS_ON = ("40 dB", "F a", "F x")
tanh = math.tanh


@dataclass(frozen=True)
class Rig:
    """A rig under its force: shape (n,) each, SI units; mass 0: F is the restoring force itself."""

    dt: float
    F: Array
    motion: tuple[Array, Array, Array]
    mass: float
    turns: bool = False


def integrated(law: Law, mass: float, F: Array, dt: float, substeps: int = 4, start: float = 0.0) -> Rig:
    """Runge-Kutta with a force that is linear between samples."""
    h = dt / substeps
    x, v, z = start, 0.0, 0.0
    rows = np.empty((3, len(F)))
    for k, force in enumerate(F):
        rows[:, k] = x, v, (force - law(x, v, z)[0]) / mass
        slope = (F[k + 1] - force) / substeps if k + 1 < len(F) else 0.0
        for s in range(substeps):
            f = (force + slope * s, force + slope * (s + 0.5), force + slope * (s + 1))
            r, d1 = law(x, v, z)
            a1 = (f[0] - r) / mass
            v2 = v + 0.5 * h * a1
            r, d2 = law(x + 0.5 * h * v, v2, z + 0.5 * h * d1)
            a2 = (f[1] - r) / mass
            v3 = v + 0.5 * h * a2
            r, d3 = law(x + 0.5 * h * v2, v3, z + 0.5 * h * d2)
            a3 = (f[1] - r) / mass
            v4 = v + h * a3
            r, d4 = law(x + h * v3, v4, z + h * d3)
            x += h / 6 * (v + 2 * v2 + 2 * v3 + v4)
            v += h / 6 * (a1 + 2 * a2 + 2 * a3 + (f[2] - r) / mass)
            z += h / 6 * (d1 + 2 * d2 + 2 * d3 + d4)
    return Rig(dt, np.asarray(F), (rows[0], rows[1], rows[2]), mass)


def lines(n: int, dt: float, band: tuple[float, float], rms: float, seed: int) -> Array:
    """A periodic noise in a band [Hz]."""
    f = np.fft.rfftfreq(n, dt)
    phases = np.exp(2j * np.pi * np.random.default_rng(seed).random(len(f)))
    y = np.fft.irfft(np.where((f >= band[0]) & (f <= band[1]), 1.0, 0.0) * phases, n)
    return np.asarray(rms * y / np.std(y))


def _sweep(n: int, dt: float, band: tuple[float, float], size: float) -> Array:
    t = np.arange(n) * dt
    return size * np.sin(2 * np.pi * (band[0] * t + (band[1] - band[0]) / (2 * n * dt) * t**2))


def _driven(x: Array, dt: float, force: Callable[[Array, Array, Array], Array], mass: float) -> Rig:
    """An actuator prescribes the motion, by a periodic x."""
    w = 2j * np.pi * np.fft.rfftfreq(len(x), dt)
    v, a = (np.fft.irfft(w**k * np.fft.rfft(x), len(x)) for k in (1, 2))
    return Rig(dt, force(x, v, a), (x, v, a), mass)


def _gap(x: float, gap: float) -> float:
    return x - gap if x > gap else x + gap if x < -gap else 0.0


def _damper(x: Array, v: Array, a: Array) -> Array:
    return np.asarray(900 * v / (1 + np.abs(v) / 0.1) + 250 * np.tanh(v / 0.01) + 800 * x + 60)


def _boucwen(x: float, v: float, z: float) -> tuple[float, float]:
    return 10 * v + 5e3 * x + 3e4 * z, v * (1 - (abs(z) / 1e-3) ** 1.5 * (v * z > 0))


def _wall(x: float, v: float, z: float) -> tuple[float, float]:
    k = 1200 * (2 * math.pi * 1.4) ** 2
    return 0.1 * math.sqrt(1200 * k) * v + k * (0.4 * x + 0.6 * z), v * (1 - (z / 0.02) ** 2 * (v * z > 0))


def rigs() -> Iterator[tuple[str, Callable[[], Rig]]]:
    """Name and maker of every rig."""
    ms, t8 = 1e-3, np.arange(8000) * 1e-3
    quake = sosfilt(butter(2, [0.3, 8], "band", fs=100, output="sos"), np.random.default_rng(8).standard_normal(4000))
    quake *= (np.arange(4000) / 400) ** 2 * np.exp(-1.2 * (np.arange(4000) / 500 - 1))
    quake *= 3.5 / np.max(np.abs(quake))
    t = np.arange(8000) * 5e-4
    blow = np.where((t > 0.1) & (t < 0.106), 400 * np.sin(np.pi * (t - 0.1) / 6e-3) ** 2, 0.0)
    let_go = np.where(t8 < 0.5, 200 * np.minimum(1, t8 / 0.4), 0.0)
    sine = np.sin(2 * np.pi * 1.5 * np.arange(4096) / 512)
    cycles = np.sin(2 * np.pi * np.arange(1500) / 500) * np.sin(np.pi * np.arange(1500) / 1500) ** 2
    steps = 25 * np.repeat(np.random.default_rng(20).choice([-1.0, 1.0], 512), 16)
    yield (
        "heavy damping",
        lambda: integrated(lambda x, v, z: (443 * v + 2e4 * x, 0), 5, lines(8000, ms, (0.5, 60), 80, 1), ms),
    )
    yield (
        "light damping",
        lambda: integrated(lambda x, v, z: (0.6 * v + 28425 * x, 0), 0.8, _sweep(16000, ms / 2, (10, 60), 5), ms / 2),
    )
    yield (
        "strong friction",
        lambda: integrated(
            lambda x, v, z: (5 * v + 1e4 * x + 40 * tanh(v / ms), 0),
            3,
            60 * np.sin(8 * np.pi * t8) * np.minimum(1, t8 / 0.3),
            ms,
            40,
        ),
    )
    yield (
        "play and friction",
        lambda: integrated(
            lambda x, v, z: (8 * v + 500 * x + 3e4 * _gap(x, ms) + 6 * tanh(v / 2e-3), 0),
            2,
            lines(8000, ms, (2, 40), 40, 3),
            ms,
            20,
        ),
    )
    yield (
        "hardening",
        lambda: integrated(lambda x, v, z: (8 * v + 2e3 * x + 5e7 * x**3, 0), 1, _sweep(10000, ms, (2, 40), 30), ms),
    )
    yield (
        "double well",
        lambda: integrated(
            lambda x, v, z: (4 * v - 1500 * x + 6e6 * x**3, 0), 1, 9 * np.sin(10 * np.pi * t8), ms, 4, 0.0158
        ),
    )
    yield (
        "by hand",
        lambda: _driven(
            lines(6000, 5e-3, (0.1, 1.2), 0.04, 5),
            5e-3,
            lambda x, v, a: 1.5 * a + 25 * v + 800 * x + 12 * np.tanh(v / 5e-3),
            1.5,
        ),
    )
    yield (
        "impacts",
        lambda: integrated(
            lambda x, v, z: (6 * v + 3e3 * x + 1.5e6 * _gap(x, 2e-3), 0),
            1.2,
            lines(20000, 2e-4, (3, 40), 25, 7),
            2e-4,
            8,
        ),
    )
    yield "earthquake", lambda: integrated(_wall, 1200, -1200 * quake, 0.01, 8)
    yield "hammer", lambda: integrated(lambda x, v, z: (9.4 * v + 49348 * x + tanh(v / ms), 0), 2, blow, ms / 2, 20)
    yield "let go", lambda: integrated(lambda x, v, z: (25 * v + 4e4 * x + 4e8 * x**3, 0), 10, let_go[:5000], ms, 10)
    yield (
        "rotor",
        lambda: _turning(
            integrated(
                lambda x, v, z: (0.01 * v + 6 * x + 0.15 * tanh(v / 0.02), 0),
                0.02,
                lines(8000, ms, (0.5, 15), 0.6, 9),
                ms,
                20,
            )
        ),
    )
    yield (
        "round and round",
        lambda: _turning(
            integrated(
                lambda x, v, z: (0.004 * v + 0.02 * tanh(v / 0.05), 0),
                0.005,
                0.2 + 0.15 * np.sin(2.6 * np.pi * t8) + lines(8000, ms, (1, 20), 0.1, 10),
                ms,
                10,
            )
        ),
    )
    yield (
        "pendulum",
        lambda: _turning(
            integrated(
                lambda x, v, z: (0.05 * v + 2.2 * math.sin(x) + 0.05 * tanh(v / 0.02), 0),
                0.08,
                lines(8000, 2e-3, (0.2, 3), 0.9, 11),
                2e-3,
                10,
            )
        ),
    )
    yield (
        "50 kHz",
        lambda: integrated(
            lambda x, v, z: (11.3 * v + 1.6e6 * x, 0), 0.05, lines(40000, 2e-5, (100, 4000), 20, 12), 2e-5, 2
        ),
    )
    yield (
        "in a fluid",
        lambda: integrated(
            lambda x, v, z: (900 * v * abs(v) + 50 * v + 3e4 * x, 0), 40, lines(6000, 2e-3, (0.3, 15), 300, 13), 2e-3
        ),
    )
    yield "Bouc and Wen", lambda: integrated(_boucwen, 2, lines(8000, ms, (2, 60), 60, 14), ms, 10)
    yield "damper, sine", lambda: _driven(0.02 * sine, 1 / 512, _damper, 0)
    yield "damper, random", lambda: _driven(lines(6000, 1 / 512, (0.2, 8), 0.01, 15), 1 / 512, _damper, 0)
    yield (
        "preload",
        lambda: integrated(
            lambda x, v, z: (20 * v + 2e4 * x + 8e5 * x**2, 0), 4, 60 + lines(6000, ms, (3, 50), 25, 16), ms, 4, 0.0027
        ),
    )
    yield "two levels", lambda: integrated(lambda x, v, z: (30 * v + 8e3 * x, 0), 2, steps, ms)
    yield (
        "at resonance",
        lambda: integrated(
            lambda x, v, z: (4 * v + 15791 * x + tanh(v / 0.01), 0), 1, 5 * np.sin(40 * np.pi * t8), ms, 10
        ),
    )
    yield (
        "beats",
        lambda: integrated(
            lambda x, v, z: (14 * v + 1e4 * x + 3 * tanh(v / 5e-3), 0),
            2,
            15 * (np.sin(22 * np.pi * t8) + np.sin(24.4 * np.pi * t8)),
            ms,
            10,
        ),
    )
    yield (
        "stiff and slow",
        lambda: _driven(0.01 * cycles, 0.01, lambda x, v, a: 20 * a + 3e4 * x + 400 * np.tanh(v / 1e-4), 20),
    )
    yield (
        "short",
        lambda: integrated(lambda x, v, z: (20 * v + 8e3 * x, 0), 1, lines(300, 2e-3, (4, 60), 20, 21), 2e-3, 8),
    )
    yield (
        "tiny",
        lambda: integrated(
            lambda x, v, z: (4.5e-3 * v + 5685 * x, 0), 1e-6, lines(20000, 1e-6, (1e3, 4e4), 5e-3, 23), 1e-6, 2
        ),
    )
    yield (
        "bridge",
        lambda: integrated(lambda x, v, z: (4e4 * v + 1.01e7 * x, 0), 4e5, lines(6000, 0.02, (0.1, 6), 2e4, 24), 0.02),
    )


def _turning(rig: Rig) -> Rig:
    return Rig(rig.dt, rig.F, rig.motion, rig.mass, turns=True)


def recorded(name: str, rig: Rig) -> Iterator[Recording]:
    """The rig by every set-up of sensors; the name ends with that of the set-up."""
    rng = np.random.default_rng(zlib.crc32(name.encode()))
    F, (x, v, a), dt = rig.F, rig.motion, rig.dt
    n, rate = len(F), 1 / dt

    def made(how: str, F: Array, **motion: Array) -> Recording:
        return Recording(f"{name}: {how}", np.arange(n) * dt, F, **motion, rotational=rig.turns, units={"t": "s"})

    def noisy(values: Array, decibels: float) -> Array:
        return np.asarray(values + rng.normal(0, np.std(values) * 10 ** (-decibels / 20), n))

    def digits(values: Array, bits: int) -> Array:
        step = 2.5 * float(np.max(np.abs(values))) / 2 ** (bits - 1)
        return np.asarray(np.round(values / step) * step)

    for level in (100, 60, 40, 30, 20):
        yield made(f"{level} dB", noisy(F, level), x=noisy(x, level), v=noisy(v, level), a=noisy(a, level))
    f, X, V, A = (noisy(u, 45) for u in (F, x, v, a))
    held = {"x": X, "v": V, "a": A}
    for names in ("x", "a", "v", "xa", "va", "xv"):
        yield made(f"F {' '.join(names)}", f, **{k: held[k] for k in names})
    for bits in (16, 12):
        yield made(f"{bits} bit", digits(F, bits), x=digits(x, bits), v=digits(v, bits), a=digits(a, bits))
    speed = np.gradient(noisy(x, 60), dt)
    yield made("v computed", f, x=X, v=np.gradient(X, dt), a=A)
    yield made("v and a computed", f, x=X, v=np.gradient(X, dt), a=np.gradient(np.gradient(X, dt), dt))
    yield made("gains", 1.03 * f, x=0.98 * X, v=1.02 * V, a=0.97 * A)
    offsets = (0.2 * np.std(F), 3 * np.std(x), 0.1 * np.std(speed), 0.3)
    yield made("offsets", f + offsets[0], x=X + offsets[1], v=V + offsets[2], a=A + offsets[3])
    front = butter(4, 0.35 * rate, fs=rate, output="sos")
    through = [noisy(sosfilt(front, u), 50) for u in (F, x, v, a)]
    yield made("one filter for all", through[0], x=through[1], v=through[2], a=through[3])
    slowest = _slowest(x, dt)
    if slowest > 4 / (n * dt):
        coupled = sosfilt(butter(1, slowest / 100, "high", fs=rate, output="sos"), a)
        yield made("AC-coupled far below", f, x=X, v=V, a=noisy(coupled, 45))
    if slowest > 8 / (n * dt):
        total = np.concatenate([[0], np.cumsum(A[1:] + A[:-1]) * 0.5 * dt])
        speed = sosfiltfilt(butter(2, slowest / 10, "high", fs=rate, output="sos"), total)
        kept = slice(n // 8, n - n // 8)
        whole = made("v integrated", f, x=X, v=speed, a=A)
        yield Recording(whole.name, whole.t[kept], f[kept], X[kept], speed[kept], A[kept], rotational=rig.turns)


def _names(slip: Slip, found: Examination) -> bool:
    """Whether the slip is named, or stated beside one that the data cannot tell from it, as F in kN and a mass in g."""
    mends = " ".join(item.mend for item in found.findings)
    return slip.names(found) or slip.name in mends or (slip.rule == "wrong_mass" and "the mass is wrong" in mends)


def _slowest(x: Array, dt: float) -> float:
    """Frequency [Hz] below which a thousandth of the power of the displacement lies."""
    power = np.cumsum(np.abs(np.fft.rfft((x - x.mean()) * np.hanning(len(x)))) ** 2)
    return float(np.fft.rfftfreq(len(x), dt)[max(1, int(np.searchsorted(power, 1e-3 * power[-1])))])


def main() -> None:
    """Count findings on sound recordings, and slips that are named."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--show", action="store_true")
    parser.add_argument("--sound-only", action="store_true")
    given = parser.parse_args()
    sound = said = refused = named = told = made = 0
    for name, maker in rigs():
        rig = maker()
        assert all(np.all(np.isfinite(u)) for u in rig.motion), name
        for recording in recorded(name, rig):
            found = examine([recording], rig.mass)
            sound, said, refused = sound + 1, said + bool(found.findings), refused + bool(found.refusals)
            for item in found.findings:
                print(f"said: {item.severity}: {str(item)[:200]}", flush=True)
            if given.sound_only or not recording.name.endswith(_SLIPS_ON):
                continue
            for slip in slips(recording.rotational):
                needed = {"a AC-coupled": "x"}.get(slip.name, "")
                if not _makes_sense(slip, recording, rig.mass) or any(getattr(recording, c) is None for c in needed):
                    continue
                answer = _names(slip, examine([slip.make(recording)], rig.mass * slip.mass))
                blind = not answer and slip.undecided(found.examined[0].undecided)
                named, told, made = named + answer, told + blind, made + 1
                if given.show and not answer and not blind:
                    print(f"missed: {slip.name} on {recording.name}", flush=True)
    print(f"sound recordings: {sound}; with any finding {said} ({100 * said / sound:.2f} %), refused {refused}")
    if made:
        share = 100 * named / (made - told)
        print(f"slips named: {named} of {made - told} ({share:.1f} %); {told} more are said beforehand not to show")


if __name__ == "__main__":
    main()
