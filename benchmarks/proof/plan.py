"""Which tests a case has, and the motion of each: training at several levels, and held-out tests of every kind."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from benchmarks.proof.decoys import Decoy
from benchmarks.proof.effects import Concealed, Rng
from benchmarks.proof.excitation import FORCES, force, hand
from benchmarks.proof.motion import Array, Diverged, Motion, drive, follow
from benchmarks.proof.rig import Rig

OVER = 8  # steps of integration per sample
HOLDOUTS = ("plain", "noise_free", "other_level", "one_second", "inertia_dominated", "other_tension", "mid_motion")


class Unfit(ValueError):
    """This draw gives no usable case; another is drawn."""


@dataclass(frozen=True)
class Test:
    """One recording: excitation, samples kept, rate [Hz], peak |x| over X, samples cut away before, and its seed."""

    kind: str
    n: int
    rate: float
    level: float
    seed: int
    skip: int = 0
    top: float = 0.0
    holdout: str = ""
    shaker: float = 0.0
    changed: tuple[tuple[str, float], ...] = ()


def plan_training(rig: Rig, rng: Rng) -> list[Test]:
    """One to four tests of unequal length, level and kind; some rates are half of the others'; or all by hand."""
    by_hand = rng.random() < 0.08
    count = int(rng.choice([1, 2, 3, 4], p=[0.15, 0.3, 0.35, 0.2]))
    rate = _round(rig.f0 * rng.uniform(50, 120))
    top = rig.f0 * rng.uniform(2.0, 4.0)
    kinds = list(rng.choice(FORCES, count, p=[0.2, 0.2, 0.15, 0.15, 0.1, 0.1, 0.1]))
    if count > 1 and rng.random() < 0.15:
        kinds[-1] = "decay"
    tests = []
    for i, kind in enumerate(kinds):
        own = rate / 2 if i and rng.random() < 0.15 else rate
        n = int(rng.integers(2500, 9000))
        tests.append(
            Test(
                "hand" if by_hand else str(kind),
                n,
                own,
                1.0 if i == 0 else rng.uniform(0.35, 1.0),
                _seed(rng),
                skip=int(n * rng.uniform(0.1, 0.3)) if rng.random() < 0.2 else 0,
                top=top,
                shaker=rng.uniform(0.3, 3) * rig.parameters["B"] if rng.random() < 0.3 else 0.0,
            )
        )
    return tests


def plan_holdouts(rig: Rig, training: Sequence[Test], rng: Rng, only: str = "") -> list[Test]:
    """One or two tests of kinds that training need not have; ``only``: this one kind, or "all" in their order."""
    first = training[0]
    out = []
    kinds = (
        list(HOLDOUTS)
        if only == "all"
        else [only]
        if only
        else [str(k) for k in rng.choice(HOLDOUTS, int(rng.integers(1, 3)), replace=False)]
    )
    for holdout in kinds:
        kind = first.kind if first.kind == "hand" else str(rng.choice(["chirp", "multisine", "harmonic", "shaker"]))
        test = Test(
            kind,
            int(rng.integers(2500, 6000)),
            first.rate,
            rng.uniform(0.7, 1.0),
            _seed(rng),
            top=first.top,
            holdout=holdout,
        )
        if holdout == "other_level":
            test = replace(test, level=rng.uniform(0.2, 0.45))
        elif holdout == "one_second":
            test = replace(test, n=max(400, int(first.rate)), kind="harmonic" if kind != "hand" else kind)
        elif holdout == "inertia_dominated" and kind != "hand":
            test = replace(test, kind="fast")
        elif holdout == "other_tension":
            tight = "fc" if "fc" in rig.parameters else "Kl"
            test = replace(test, changed=((tight, rig.parameters[tight] * rng.uniform(1.1, 1.3)),))
        elif holdout == "mid_motion":
            test = replace(test, skip=int(0.4 * test.n))
        out.append(test)
    return out


def _seed(rng: Rng) -> int:
    return int(rng.integers(1 << 31))


def _round(value: float) -> float:
    """Two digits, as recorders are set."""
    digits = 10 ** np.floor(np.log10(value) - 1)
    return float(np.round(value / digits) * digits)


@dataclass(frozen=True)
class Subject:
    """A rig, what is concealed in it with its amplitudes, and a disturbance."""

    rig: Rig
    laws: tuple[Concealed, ...] = ()
    amplitudes: tuple[float, ...] = ()
    decoy: Decoy | None = None


def shape(test: Test, rig: Rig) -> tuple[Array, Array]:
    """Half-step grid of time, and the force of peak 1 (or, by hand, the displacement of peak 1)."""
    steps = (test.n + test.skip - 1) * OVER
    t = np.arange(2 * steps + 1) / (2 * OVER * test.rate)
    rng = np.random.default_rng(test.seed)
    if test.kind in ("hand", "decay"):
        return t, np.zeros_like(t)
    if test.kind == "fast":
        return t, force("multisine", t, 2.2 * rig.f0, 5 * rig.f0, rng) * 0.5 + force(
            "chirp", t, 4 * rig.f0, 6 * rig.f0, rng
        )
    return t, force(test.kind, t, rig.f0, test.top, rng)


def moved(subject: Subject, test: Test, number: int, gain: float, grid: tuple[Array, Array]) -> Motion:
    """The motion of one test, with force ``gain`` times its shape; F is what the force sensor sees."""
    t, wave = grid
    rig, h = subject.rig, 2 * (t[1] - t[0])
    terms = list(rig.terms(**dict(test.changed)))
    for law, amplitude in zip(subject.laws, subject.amplitudes, strict=True):
        terms += law.at(amplitude, t, number)
    size = test.level * rig.X
    if test.kind == "hand":
        x, v, a = (size * y for y in hand(t, rig.f0 / 12, np.random.default_rng(test.seed)))
        motion = follow(terms, rig.mass, h, x, v, a)
    else:
        drive_force = gain * wave
        unseen = np.zeros_like(t)
        if subject.decoy is not None and subject.decoy.force is not None:
            peak = gain if test.kind != "decay" else rig.parameters["Kl"] * size * 0.1
            unseen = subject.decoy.force(t, peak)
        start = (size, 0.0) if test.kind == "decay" else (0.0, 0.0)
        motion = drive(terms, rig.mass, h, drive_force + unseen, start, 6 * rig.X, test.shaker)
        if np.any(unseen):
            motion = replace(motion, F=motion.F - unseen[::2])
    return motion.every(1, test.skip * OVER)


def calibrated(
    subject: Subject, tests: Sequence[Test], targets: Sequence[float], rounds: int = 5
) -> tuple[Subject, list[Motion]]:
    """Gains of the force that make each test's peak as planned, and amplitudes that give each law its share of R.

    ``targets``: rms of the law's force over rms of R, in all tests together; none for laws whose amplitude stands.
    Raises :class:`Unfit` where no such motion is found.
    """
    rig = subject.rig
    grids = [shape(test, rig) for test in tests]
    stiffness = rig.parameters["Kl"] * 1.3
    gains = [0.15 * stiffness * rig.X for _ in tests]
    amplitudes = list(subject.amplitudes) or [1e-3 * stiffness * rig.X for _ in subject.laws]
    motions: list[Motion] = []
    for round_ in range(rounds):
        subject = replace(subject, amplitudes=tuple(amplitudes))
        motions = []
        for i, test in enumerate(tests):
            for _ in range(6):
                try:
                    motions.append(moved(subject, test, i, gains[i], grids[i]))
                    break
                except Diverged:
                    gains[i] *= 0.4
            else:
                raise Unfit("no bounded motion")
        if round_ == rounds - 1:
            break
        for i, (test, motion) in enumerate(zip(tests, motions, strict=True)):
            peak = float(np.max(np.abs(motion.x)))
            gains[i] *= float(np.clip(test.level * rig.X / max(peak, 1e-30), 0.3, 3.0))
        for k, target in enumerate(targets):
            got = share(forces(subject, k, tests, motions), motions)
            amplitudes[k] *= float(np.clip(target / max(got, 1e-12), 0.1 if round_ else 1e-3, 8.0 if round_ else 1e4))
            amplitudes[k] = min(amplitudes[k], subject.laws[k].most)
    for test, motion in zip(tests, motions, strict=True):
        ratio = np.max(np.abs(motion.x)) / (test.level * rig.X)
        if not 0.5 < ratio < 1.12 + 0.2 * (rig.model != "PecorariSolodov"):
            raise Unfit(f"peak is {ratio:.2f} of the plan")
    return subject, motions


def forces(subject: Subject, k: int, tests: Sequence[Test], motions: Sequence[Motion]) -> list[Array]:
    """The force of law ``k`` alone in each test, on the step grid."""
    if len(subject.laws) == 1:
        return [motion.f for motion in motions]
    out = []
    for number, (test, motion) in enumerate(zip(tests, motions, strict=True)):
        n = 2 * ((len(motion.t) - 1) // 2) + 1
        t = test.skip / test.rate + motion.t[:n]
        law = subject.laws[k].at(subject.amplitudes[k], t, number)
        own = follow((*subject.rig.terms(), *law), 0.0, 2 * (t[1] - t[0]), motion.x[:n], motion.v[:n], motion.a[:n]).f
        out.append(np.interp(np.arange(len(motion.t)), np.arange(0, n, 2), own))
    return out


def share(force_: Sequence[Array], motions: Sequence[Motion]) -> float:
    """rms of a force over rms of R, in all tests together."""
    return float(np.sqrt(sum(np.sum(f**2) for f in force_) / sum(np.sum(m.R**2) for m in motions)))
