"""Rigs with one textbook effect each, simulated apart from the library and from the proof: is it named?

    python -m benchmarks.textbook_rigs --seed S --cases N [--kind cubic mass ...] [--channels a va] [--let-go struck]
    python -m benchmarks.textbook_rigs --seed S --cases N [--recorder "bad samples" "integrators 1" ...]

A mass on a spring and a damper takes a force of six kinds; one effect is added that its user does not know, as a
textbook writes it, or none. 0.1 to 300 kg, 2 to 200 Hz; any of x, v and a, with 28 dB of noise to none. With --let-go
the rig is let go in one of five ways, once to three times, and nobody records a force; laws alone show then. With
--recorder the channels, of 34 to 60 dB, are changed as laboratories do (``benchmarks.recorders``). Prints
each case that is not right, and the counts: right (the effect, or one that the recordings cannot tell from it), near
(another of its family or its class, or another beside it), unknown, missed, wrong, alarm, refused.
"""

from __future__ import annotations

import argparse
import math
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
from scipy.signal import butter, sosfiltfilt

from benchmarks.proof.decoys import CALM
from benchmarks.recorders import RECORDERS, Bench
from hystid import diagnose
from hystid.errors import HystidError
from hystid.numeric import Array
from hystid.recording import Recording

State = Sequence[float]  # x, v, and states of the effect
Law = Callable[[State, float], tuple[float, tuple[float, ...]]]  # force, and rates of these states, at a time
# Recordings, what their user believes, and the case in words.
Case = tuple[Recording | list[Recording], dict[str, float], str]
_CHANNELS = ("x", "a", "xv", "xa", "va", "xva")
_SNR = (28, 34, 34, 40, 60, 80, np.inf)  # dB
_STEPS = 6  # of Runge and Kutta's method (order 4) per sample; frequencies reach a fifteenth of the sample rate


@dataclass(frozen=True)
class Rig:
    """m [kg], c [N s/m], k [N/m], w [rad/s]; X [m] and V [m/s]: what the rig alone reaches; s: size of the effect."""

    m: float
    c: float
    k: float
    w: float
    X: float
    s: float

    @property
    def V(self) -> float:
        return self.w * self.X

    def way(self, v: float) -> float:
        """Direction of motion; friction turns over a hundredth of the speed."""
        return math.tanh(v / (0.01 * self.V))


def _plain(force: Callable[[float, float, float], float]) -> tuple[int, Law]:
    return 0, lambda y, t: (force(y[0], y[1], t), ())


def _friction(r: Rig, constant: float = 0.0, falls: float = 0.0) -> tuple[int, Law]:
    size = (0.5 if falls else 0.3) * r.s * r.c * r.V

    def force(x: float, v: float, t: float) -> float:
        return size * (r.way(v) * (1 + falls * math.exp(-((v / (0.12 * r.V)) ** 2))) + constant)

    return _plain(force)


def _bouc_wen(r: Rig) -> tuple[int, Law]:
    yields = 0.25 * r.X * r.s

    def law(y: State, t: float) -> tuple[float, tuple[float, ...]]:
        _, v, z = y
        return 0.3 * r.k * yields * z, ((v - 0.5 * abs(v) * z * abs(z) - 0.5 * v * z * z) / yields,)

    return 1, law


def _maxwell(r: Rig) -> tuple[int, Law]:
    return 1, lambda y, t: (y[2], (0.3 * r.s * r.k * y[1] - y[2] * r.w / 0.6,))


def _absorber(r: Rig) -> tuple[int, Law]:
    m, w = 0.15 * r.s * r.m, 1.3 * r.w

    def law(y: State, t: float) -> tuple[float, tuple[float, ...]]:
        x, v, x2, v2 = y
        force = m * w**2 * (x - x2) + 0.04 * m * w * (v - v2)
        return force, (v2, force / m)

    return 2, law


def _stops(r: Rig, sides: int) -> tuple[int, Law]:
    gap = 0.35 * r.X * r.s
    return _plain(lambda x, v, t: 1.5 * r.k * (max(x - gap, 0.0) + (min(x + gap, 0.0) if sides == 2 else 0.0)))


@dataclass(frozen=True)
class Kind:
    """right: ids that are its name; near: ids of its family. law: None for a fault of the force channel, or mass."""

    right: tuple[str, ...]
    near: tuple[str, ...] = ()
    law: Callable[[Rig], tuple[int, Law]] | None = None
    mass: float = 0.0
    gain: float = 0.0
    late: float = 0.0


_SIDED = ("contact_loss", "bilinear_stiffness", "impact")
KINDS = {
    "none": Kind(()),
    "coulomb": Kind(("coulomb_friction",), ("stribeck_friction", "hysteretic_friction"), _friction),
    "stribeck": Kind(("stribeck_friction",), ("coulomb_friction",), lambda r: _friction(r, falls=1.0)),
    "one_way": Kind(
        ("asymmetric_friction",), ("coulomb_friction", "preload", "force_drift"), lambda r: _friction(r, constant=0.4)
    ),
    "cubic": Kind(
        ("cubic_stiffness",),
        ("two_sided_stop",),
        lambda r: _plain(lambda x, v, t: 0.25 * r.s * r.k * x * (x / r.X) ** 2),
    ),
    "softening": Kind(
        ("cubic_stiffness",),
        ("bilinear_stiffness",),
        lambda r: _plain(lambda x, v, t: 0.3 * r.s * r.k * x / (1 + (2 * x / r.X) ** 4)),
    ),
    "square": Kind(
        ("quadratic_stiffness", "bilinear_stiffness"),
        ("contact_loss",),
        lambda r: _plain(lambda x, v, t: 0.15 * r.s * r.k * x * x / r.X),
    ),
    "one_stop": Kind(_SIDED, (), lambda r: _stops(r, 1)),
    "two_stops": Kind(("two_sided_stop",), ("backlash", "cubic_stiffness"), lambda r: _stops(r, 2)),
    "bilinear": Kind(
        (*_SIDED[:2], "quadratic_stiffness"), (), lambda r: _plain(lambda x, v, t: 0.3 * r.s * r.k * max(x, 0.0))
    ),
    "drag": Kind(
        ("quadratic_damping",),
        ("displacement_dependent_damping",),
        lambda r: _plain(lambda x, v, t: 0.6 * r.s * r.c * abs(v) * v / r.V),
    ),
    "place": Kind(
        ("displacement_dependent_damping",),
        ("quadratic_damping",),
        lambda r: _plain(lambda x, v, t: 2 * r.s * r.c * v * (x / r.X) ** 2),
    ),
    "bouc_wen": Kind(("hysteretic_friction",), ("coulomb_friction",), _bouc_wen),
    "maxwell": Kind(("viscoelastic_relaxation",), ("hidden_mode",), _maxwell),
    "absorber": Kind(("hidden_mode",), ("added_mass",), _absorber),
    "mass": Kind(("added_mass", "force_gain"), mass=0.15),
    "gain": Kind(("force_gain", "added_mass"), gain=0.15),
    "late": Kind(("channel_delay",), late=2.3),
    # No law of the library: a stiffness that something else changes, and a damper that excites itself.
    "parametric": Kind(
        ("",), (), lambda r: _plain(lambda x, v, t: 0.2 * r.s * r.k * x * math.sin(2.3 * r.w / (2 * math.pi) * t))
    ),
    "excited": Kind(
        ("",),
        (),
        lambda r: _plain(
            lambda x, v, t: (
                -0.9 * r.s * r.c * v * math.exp(-((x / (0.4 * r.X)) ** 2))
                + 0.2 * r.k * x * math.exp(-((v / (0.3 * r.V)) ** 2))
            )
        ),
    ),
}


def moved(rig: Rig, mass: float, added: tuple[int, Law], t: Array, force: Array) -> tuple[Array, Array, Array]:
    """x, v and a of a rig from rest, (n,) each, by Runge and Kutta's method; the force is straight in between."""
    states, law = added
    h, y, rows = float(t[1] - t[0]) / _STEPS, [0.0] * (2 + states), np.empty((len(t), 3))

    def rates(y: State, t: float, F: float) -> list[float]:
        more, own = law(y, t)
        return [y[1], (F - rig.c * y[1] - rig.k * y[0] - more) / mass, *own]

    steps = np.append(np.diff(force), 0.0) / _STEPS
    for i, (F, dF) in enumerate(zip(force.tolist(), steps.tolist(), strict=True)):
        now = float(t[i])
        rows[i] = y[0], y[1], rates(y, now, F)[1]
        for k in range(_STEPS):
            at, f = now + k * h, F + k * dF
            k1 = rates(y, at, f)
            k2 = rates([p + 0.5 * h * q for p, q in zip(y, k1, strict=True)], at + 0.5 * h, f + 0.5 * dF)
            k3 = rates([p + 0.5 * h * q for p, q in zip(y, k2, strict=True)], at + 0.5 * h, f + 0.5 * dF)
            k4 = rates([p + h * q for p, q in zip(y, k3, strict=True)], at + h, f + dF)
            y = [p + h / 6 * (a + 2 * b + 2 * c + d) for p, a, b, c, d in zip(y, k1, k2, k3, k4, strict=True)]
    return rows[:, 0], rows[:, 1], rows[:, 2]


def _forced(kind: str, t: Array, f0: float, rng: np.random.Generator) -> Array:
    """A force of one of six kinds, (n,), largest 1."""
    count, last = len(t), float(t[-1])
    if kind in ("random", "burst"):
        band = butter(3, [0.2 * f0, 2.5 * f0], "bandpass", fs=1 / (t[1] - t[0]), output="sos")
        force = np.asarray(sosfiltfilt(band, rng.standard_normal(count + 400)))[200:-200]
        force *= (t / last * 4 % 1 < 0.6) if kind == "burst" else 1.0
    elif kind == "sweep":
        force = np.sin(2 * np.pi * f0 * (0.3 * t + 0.85 / last * t**2))
    elif kind == "stepped":
        steps = np.minimum(np.arange(count) * 6 // count, 5)
        phase = 2 * np.pi * np.cumsum(rng.uniform(0.5, 1.6, 6)[steps] * f0) * (t[1] - t[0])
        force = rng.uniform(0.3, 1.0, 6)[steps] * np.sin(phase)
    elif kind == "hammer":
        force = np.zeros(count)
        for start in np.linspace(0.02, 0.8, int(rng.integers(2, 6))):
            place = (t - start * last) * f0 / rng.uniform(0.15, 0.4)
            force += rng.uniform(0.4, 1.0) * np.where((place > 0) & (place < 1), np.sin(np.pi * place) ** 2, 0.0)
    else:
        third = t[: count // 3]
        chirp = np.sin(2 * np.pi * f0 * (0.4 * third + 0.6 / third[-1] * third**2))
        force = np.resize(np.concatenate([size * chirp for size in (0.3, 0.6, 1.0)]), count)
    return np.asarray(force / np.max(np.abs(force)))


def _rig(rng: np.random.Generator) -> tuple[Rig, float]:
    """A rig, and its resonance [Hz]."""
    m, f0, damping = 10 ** rng.uniform(-1, 2.5), 10 ** rng.uniform(0.3, 2.3), rng.uniform(0.008, 0.05)
    w = 2 * np.pi * f0
    return Rig(m, 2 * damping * m * w, m * w**2, w, 10 ** rng.uniform(-4, -2), rng.uniform(0.5, 1.5)), f0


def _believed(rig: Rig, rng: np.random.Generator) -> dict[str, float]:
    return {"m": rig.m, "B": rig.c * rng.uniform(0.8, 1.25), "Kl": rig.k * rng.uniform(0.93, 1.07)}


def _noisy(y: Array, snr: float, rng: np.random.Generator) -> Array:
    return np.asarray(y + 10 ** (-snr / 20) * np.std(y) * rng.standard_normal(len(y)))


def textbook_rig(
    seed: int, name: str, channels: str = "", recorder: str = ""
) -> tuple[Recording, dict[str, float], str]:
    """A recording with one effect, what its user believes, and the case in words. channels, recorder: "" for any, and
    for one that changes nothing."""
    rng, kind = np.random.default_rng([seed, 77]), KINDS[name]
    rig, f0 = _rig(rng)
    m = rig.m
    t = np.arange(int(rng.integers(5000, 12000))) / (rng.uniform(30, 90) * f0)
    excitation = str(rng.choice(["random", "burst", "sweep", "stepped", "hammer", "chirps"]))
    force = _forced(excitation, t, f0, rng)
    nothing = _plain(lambda x, v, t: 0.0)
    force *= rig.X / np.max(np.abs(moved(rig, m, nothing, t, force)[0]))
    added = kind.law(rig) if kind.law else nothing
    x, v, a = moved(rig, m * (1 + kind.mass * rig.s), added, t, force)
    seen = np.interp(t - kind.late * rig.s * t[1], t, force) * (1 + kind.gain * rig.s)
    drawn, snr = str(rng.choice(_CHANNELS)), float(rng.choice(_SNR))
    if recorder:
        needed, change = RECORDERS[recorder]
        drawn, snr = needed or drawn, float(np.clip(snr, 34, 60))
    columns = {
        c: _noisy(y, snr, rng) for c, y in (("F", seen), ("x", x), ("v", v), ("a", a)) if c in "F" + (channels or drawn)
    }
    believed = _believed(rig, rng)
    if recorder:
        columns = change(Bench(f0, 1 / float(t[1]), rng), columns)
    words = f"{excitation}, {channels or drawn}, {snr:.0f} dB, {len(t)} samples" + (recorder and f", {recorder}")
    return Recording(f"{name} {seed}", t, **columns), believed, words


RELEASES = ("pulled", "struck", "recorded", "again", "driven")


def released_rig(seed: int, name: str, how: str, channels: str = "") -> tuple[list[Recording], dict[str, float], str]:
    """Free decays of a rig with one effect, without a force. how: "pulled" slowly, and recorded from its release on;
    "struck", and recorded from the end of the blow on; with the blow "recorded"; with three blows; or "driven" at
    its resonance, and then left alone."""
    rng, kind = np.random.default_rng([seed, 99]), KINDS[name]
    rig, f0 = _rig(rng)
    rate, count = rng.uniform(30, 90) * f0, int(rng.integers(3000, 8000))
    drawn, snr = channels or str(rng.choice(_CHANNELS)), float(rng.choice(_SNR))
    tests = []
    for number in range(int(rng.integers(1, 4))):
        size = rig.X * (rng.uniform(0.4, 1) if number else 1)
        before = {"pulled": int(40 * rate / f0), "struck": int(0.15 * rate / f0)}.get(how, 0)
        t = np.arange(before + count) / rate
        force = _let_go(how, t, before, rig, rng) * size
        motion = moved(rig, rig.m, kind.law(rig) if kind.law else _plain(lambda x, v, t: 0.0), t, force)
        columns = {c: _noisy(y[before:], snr, rng) for c, y in zip("xva", motion, strict=True) if c in drawn}
        tests.append(Recording(f"{name} {seed}-{number + 1}", t[before:] - t[before], **columns))
    return tests, _believed(rig, rng), f"{how}, {drawn}, {snr:.0f} dB, {len(tests)} of {count} samples"


def _let_go(how: str, t: Array, before: int, rig: Rig, rng: np.random.Generator) -> Array:
    """The force that nobody records, (n,), for a motion of 1 m."""
    period, last = 2 * np.pi / rig.w, float(t[-1])
    if how == "pulled":
        return np.asarray(rig.k * np.where(t < t[before], np.minimum(2 * t / t[before], 1.0), 0.0))
    if how == "driven":
        return np.asarray(np.where(t < 0.35 * last, rig.c * rig.w * np.sin(rig.w * t), 0.0))
    blows = np.arange(3 if how == "again" else 1)
    starts = [0.0] if how == "struck" else rng.uniform(0.2, 10) * period + blows * last / 3
    blow = rig.m * rig.w * np.pi / (0.3 * period)  # of half a sine over 0.15 periods: its impulse is m w
    places = [(t - start) / (0.15 * period) for start in starts]
    return np.asarray(sum(np.where((u > 0) & (u < 1), blow * np.sin(np.pi * u), 0.0) for u in places))


def judged(kind: Kind, verdict: str, found: set[str], alike: Collection[str] = ()) -> str:
    """How right an answer is. alike: what it says that it cannot tell from what it found."""
    if verdict == "not_applicable":
        return "refused"
    if kind.right in ((), ("",)):
        silent = verdict == "unknown_physics" if kind.right else verdict in CALM
        return "right" if silent else "missed" if verdict in CALM else "alarm"
    if found and found <= {*kind.right, *kind.near}:
        return "right" if found <= set(kind.right) else "near"
    if found:
        return "near" if {*found, *alike} & set(kind.right) else "wrong"
    return "missed" if verdict in CALM else "unknown"


def ask(cases: Iterable[tuple[Kind, str, Case]]) -> None:
    """Diagnose cases of a kind, each with a name; prints those that are not right, and the counts."""
    counts: Counter[str] = Counter()
    for kind, name, (tests, believed, words) in cases:
        try:
            answer = diagnose(tests, model="HystId.Oscillators.Linear", parameters=believed)
        except HystidError as error:
            said, how = str(error), "refused"
        else:
            said = ", ".join(f"{f.effect} {f.confidence:.2f}" for f in answer.findings) or answer.headline
            alike = [other for f in answer.findings for other in f.alike]
            how = judged(kind, answer.verdict, {f.effect for f in answer.findings}, alike)
        counts[how] += 1
        if how != "right":
            print(f"{how}: {name} ({words}): {said}", flush=True)
    print(", ".join(f"{how}: {count}" for how, count in sorted(counts.items())))


def main() -> None:
    """See the module's text."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, required=True, help="of the first case")
    parser.add_argument("--cases", type=int, required=True, help="of each kind")
    parser.add_argument("--kind", nargs="*", choices=KINDS, default=list(KINDS))
    parser.add_argument("--channels", nargs="*", choices=("x", "v", "a", "xv", "xa", "va", "xva"), default=[""])
    parser.add_argument("--recorder", nargs="*", choices=RECORDERS, default=[""], help="what was done to the channels")
    parser.add_argument("--let-go", nargs="*", choices=RELEASES, default=[""], help="free decays without a force")
    given = parser.parse_args()
    if any(given.recorder) and (any(given.channels) or any(given.let_go)):
        parser.error("--recorder chooses channels itself, and is for forced tests: leave --channels and --let-go out")
    seeds = range(given.seed, given.seed + given.cases)
    every = product(given.kind, seeds, given.channels, given.let_go, given.recorder)
    ask(
        (KINDS[name], f"{name} {seed}", released_rig(seed, name, release, channels))
        if release
        else (KINDS[name], f"{name} {seed}", textbook_rig(seed, name, channels, recorder))
        for name, seed, channels, release, recorder in every
        if not release or KINDS[name].law is not None or not KINDS[name].right
    )


if __name__ == "__main__":
    main()
