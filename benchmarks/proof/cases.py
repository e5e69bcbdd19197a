"""A case: recordings, what the user knows, and the truth, written apart from each other."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.proof.chain import UNITS, Chain, draw_chain, levels, record, with_own_noise
from benchmarks.proof.decoys import CALM, DECOYS, Decoy
from benchmarks.proof.effects import NEEDS_HYSTERESIS, PHYSICS, TIME_LAWS, Concealed, Rng, draw, windowed
from benchmarks.proof.fairness import judge
from benchmarks.proof.motion import Array, Motion
from benchmarks.proof.plan import (
    HOLDOUTS,
    OVER,
    Subject,
    Test,
    Unfit,
    calibrated,
    forces,
    plan_holdouts,
    plan_training,
    share,
)
from benchmarks.proof.rig import MODELS, Rig, draw_rig, nominal
from benchmarks.proof.strangers import STRANGERS

KINDS = ("single", "pair", "part_time", "null", "decoy", "stranger", "sensor", "sensor_and_physics")
# What a deck of all kinds is made of, in this order, over and over.
MIX = (
    "single",
    "null",
    "single",
    "stranger",
    "pair",
    "single",
    "part_time",
    "decoy",
    "single",
    "sensor",
    "single",
    "null",
    "stranger",
    "single",
    "pair",
    "part_time",
    "single",
    "decoy",
    "sensor_and_physics",
    "single",
)
SNRS: tuple[float | None, ...] = (34.0, 34.0, 34.0, 34.0, 20.0, 28.0, 45.0, 60.0, 80.0, 100.0, None)
NULL_SNRS: tuple[float | None, ...] = (20.0, 34.0, 34.0, 60.0, 80.0, 100.0, None)
SENSORS = ("channel_delay", "force_gain", "force_drift", "sensor_saturation")
# A case counts as fair where the concealed force, beyond what a refit hides, has this chi-square over all samples,
# and keeps the second one beyond what any single other law takes: a Bayes factor that no prior turns, with room for
# noise that is not white (a tenth of the samples counting as independent still leaves 90 and 10).
FAIR, FAIR_OVER_RIVALS = 900.0, 100.0
# And these shares of rms R and of the hidden energy, below which textbook laws differ more among each other.
VISIBLE, DISTINCT = 0.01, 0.02
# Laws that slow motion by hand shows only where they are out of all proportion.
FAST = {"added_mass", "hidden_mode", "quadratic_damping", "displacement_dependent_damping"}
# A stranger of which one law of the library takes more than this is not strange.
STRANGE = 0.75


class NoFairCase(RuntimeError):
    """None of many draws gave a case that anyone could answer."""


@dataclass(frozen=True)
class Case:
    """Files to write: columns by recording, and what the user is told; and the truth."""

    name: str
    training: list[dict[str, Array]]
    holdout: list[dict[str, Array]]
    model: str
    parameters: dict[str, float]
    truth: dict[str, Any]


def make(kind: str, seed: int, number: int, **fixed: Any) -> Case:
    """Case ``number`` of a seed, the same on every machine.

    ``fixed``: "effect" (an id, a stranger or a decoy), "snr", "model", "channels", "holdout" (one of ``plan.HOLDOUTS``
    or "all"), to draw less at random; "sensors": "own" for any channels, each with its noise; "fair_at": dB at which
    the case would still be fair.
    """
    text = f"{kind}:{seed}:{number}:{sorted(fixed.items())}"
    rng = np.random.default_rng(int.from_bytes(hashlib.sha256(text.encode()).digest()[:8], "big"))
    reasons: dict[str, int] = {}
    for attempt in range(60):
        try:
            case = _draw(kind, f"{kind}_{seed}_{number:04d}", rng, fixed)
        except Unfit as reason:
            reasons[str(reason).split(":")[0]] = reasons.get(str(reason).split(":")[0], 0) + 1
            continue
        case.truth["draws"] = attempt + 1
        return case
    raise NoFairCase(f"no fair case of kind {kind} in 60 draws: {reasons}")


def _draw(kind: str, name: str, rng: Rng, fixed: dict[str, Any]) -> Case:
    effects = _effects(kind, rng, fixed)
    model = fixed.get("model") or str(rng.choice(MODELS))
    if any(effect in NEEDS_HYSTERESIS for effect in effects) and model == "Linear":
        model = str(rng.choice(MODELS[1:]))
    rig = draw_rig(model, rng)
    chain = _chain(kind, effects, rig, rng, fixed)
    if fixed.get("sensors") == "own" and not chain.fault:
        chain = with_own_noise(chain, rng)
    tests = plan_training(rig, rng)
    if "x" not in chain.channels and {"hand", "decay"} & {test.kind for test in tests}:
        raise Unfit("no displacement where it alone tells where the test began")
    held = plan_holdouts(rig, tests, rng, fixed.get("holdout", ""))
    T = max(test.n / test.rate for test in tests)
    scale = rig.scale(T, tests[0].top)
    laws = [
        STRANGERS[effect](scale, rng) if effect in STRANGERS else draw(effect, scale, rng)
        for effect in effects
        if effect in STRANGERS or effect in PHYSICS
    ]
    if tests[0].kind == "hand" and FAST & set(effects):
        raise Unfit("too slow for this law")
    where: dict[str, Any] = {}
    if kind == "part_time":
        laws[0], where = windowed(laws[0], scale, rng, len(tests))
    decoy = DECOYS[effects[0]](rig.f0, rng) if kind == "decoy" else None
    targets = [float(np.exp(rng.uniform(np.log(0.03 if kind == "single" else 0.08), np.log(0.6)))) for _ in laws]
    subject, motions = calibrated(Subject(rig, tuple(laws), decoy=decoy), tests, targets)
    if decoy is not None:
        chain = replace(chain, **decoy.chain)
    judged = replace(chain, snr=fixed["fair_at"]) if "fair_at" in fixed else chain
    found = _facts(subject, tests, motions, judged, kind)
    _, held_motions = calibrated(subject, held, (), rounds=4)
    level = levels(motions)
    training, holdout, oracle = [], [], []
    for motion in motions:
        columns, clean = record(motion, OVER, chain, level, rng)
        training.append(columns)
        oracle.append({"recording": f"train_{len(training)}", "force_nrmse": _oracle(columns, clean, rig, chain)})
    for test, motion in zip(held, held_motions, strict=True):
        noisy = test.holdout != "noise_free"
        columns, clean = record(motion, OVER, chain if noisy else replace(chain, bits=0), level, rng, noisy)
        holdout.append(columns)
        oracle.append({"recording": f"hold_{len(holdout)}", "force_nrmse": _oracle(columns, clean, rig, chain)})
    if decoy is not None and decoy.columns is not None:
        training = [decoy.columns(columns, rng) for columns in training]
    truth = {
        "case": name,
        "kind": kind,
        "model": f"HystId.Oscillators.{model}",
        "true_baseline": rig.parameters,
        "snr": chain.snr,
        "chain": chain.style,
        "quieter": chain.quieter,
        "decimated": chain.decimated,
        "channels": list(training[0]),
        "derived": chain.derive,
        "recordings": [
            {"kind": t.kind, "n": t.n, "rate": t.rate, "level": t.level, "mid_motion": bool(t.skip)} for t in tests
        ],
        "holdouts": [t.holdout for t in held],
        "oracle": oracle,
        "where": where,
        **_expected(kind, laws, subject, chain, decoy),
        **found,
    }
    believed = nominal(rig, rng, far=rng.random() < 0.2)
    if model == "Iwan":
        believed["N"] = 8
    return Case(name, training, holdout, f"HystId.Oscillators.{model}", believed, truth)


def _effects(kind: str, rng: Rng, fixed: dict[str, Any]) -> list[str]:
    physics = list(PHYSICS)
    if kind == "null":
        return []
    if kind in ("stranger", "decoy"):
        return [fixed.get("effect") or str(rng.choice(list(STRANGERS if kind == "stranger" else DECOYS)))]
    if kind == "sensor":
        return [fixed.get("effect") or str(rng.choice(SENSORS))]
    first = fixed.get("effect") or str(rng.choice(physics))
    if kind == "part_time":
        while first in TIME_LAWS:
            first = str(rng.choice(physics))
        return [first]
    if kind == "pair":
        # Two laws of which neither is a form or a part of the other, drawn from different families.
        second = str(rng.choice([e for e in physics if FAMILY[e] != FAMILY[first]]))
        return [first, second]
    if kind == "sensor_and_physics":
        return [first, str(rng.choice(SENSORS))]
    return [first]


FAMILY = {
    "cubic_stiffness": "spring",
    "quadratic_stiffness": "even",
    "bilinear_stiffness": "contact",
    "contact_loss": "contact",
    "impact": "contact",
    "two_sided_stop": "contact",
    "backlash": "contact",
    "coulomb_friction": "friction",
    "stribeck_friction": "friction",
    "asymmetric_friction": "friction",
    "hysteretic_friction": "friction",
    "position_dependent_friction": "friction",
    "quadratic_damping": "drag",
    "displacement_dependent_damping": "drag",
    "cyclic_degradation": "hysteresis",
    "pinching": "hysteresis",
    "viscoelastic_relaxation": "linear",
    "stiffness_drift": "time",
    "preload": "even",
    "added_mass": "linear",
    "hidden_mode": "linear",
}


def _chain(kind: str, effects: Sequence[str], rig: Rig, rng: Rng, fixed: dict[str, Any]) -> Chain:
    options = NULL_SNRS if kind in ("null", "decoy") else SNRS
    snr = fixed["snr"] if "snr" in fixed else options[int(rng.integers(len(options)))]
    style = str(rng.choice(["bench", "laboratory"])) if kind in ("null", "decoy") else None
    chain = draw_chain(snr, rig.f0, rng, style)
    if chain.style == "field":
        chain = replace(
            chain,
            gain={c: 1 + 0.002 * float(rng.standard_normal()) for c in "Fxva"},
            drift={str(rng.choice(list("Fx"))): 0.003 * float(rng.standard_normal())},
        )
    if "channels" in fixed:
        chain = replace(chain, channels=fixed["channels"], derive=None, coupling=0.0)
    faults: dict[str, tuple[str, float]] = {}
    for effect in effects:
        if effect == "channel_delay":
            faults["delay"] = ("F", rng.uniform(0.004, 0.03) / rig.f0)
        elif effect == "force_gain":
            faults["gain"] = ("F", float(rng.choice([rng.uniform(1.1, 1.6), rng.uniform(0.6, 0.9)])))
        elif effect == "force_drift":
            faults["drift"] = ("F", rng.uniform(0.05, 0.4) * float(rng.choice([-1, 1])))
        elif effect == "sensor_saturation":
            faults["saturation"] = (str(rng.choice(list("Fxa"))), rng.uniform(0.5, 0.85))
    if faults:  # a fault of F or of one motion channel shows only against another channel
        chain = replace(chain, channels="Fxva", derive=None, gain={}, drift={}, coupling=0.0, fault=faults)
    return chain


def _facts(
    subject: Subject, tests: Sequence[Test], motions: Sequence[Motion], chain: Chain, kind: str
) -> dict[str, Any]:
    """Shares of R, what a refit leaves, what noise and rivals leave; raises :class:`Unfit` for an unfair case."""
    rig, rms_R = subject.rig, float(np.sqrt(np.mean(np.concatenate([m.R for m in motions]) ** 2)))
    noise_ = _noise_of_R(rig, motions, tests, chain)
    samples = sum(test.n for test in tests)
    wrong = [_fault_force(rig, m, chain) for m in motions] if chain.fault else []
    parts: list[tuple[str, set[str], list[Array]]] = []
    for k, law in enumerate(subject.laws):
        label = law.form if law.effect == "unknown" else law.effect
        parts.append((label, {law.effect, *law.equivalent}, forces(subject, k, tests, motions)))
    if wrong:
        parts.append((NAME_OF_FAULT[next(iter(chain.fault))], {NAME_OF_FAULT[next(iter(chain.fault))]}, wrong))
    facts = []
    for name, names, force_ in parts:
        beside = [other for label, _, other in parts if label != name]
        fair = judge(rig, list(motions), OVER, force_, names, beside, "x" not in chain.channels)
        rival, taken = next(iter(fair.rivals.items()), ("", 0.0))
        strength = (fair.hidden / noise_) ** 2 * samples if noise_ > 0 else np.inf
        facts.append(
            {
                "effect": name,
                "share_of_R": share(force_, motions),
                "share_after_refit": fair.hidden / rms_R,
                "to_noise": fair.hidden / noise_ if noise_ > 0 else None,
                "rival": rival,
                "rival_takes": taken,
                "weakest_half": _weakest_half(force_, motions) / max(share(force_, motions), 1e-30),
            }
        )
        if strength < FAIR or fair.hidden < VISIBLE * rms_R:
            raise Unfit(f"{name} hidden by a refit")
        if kind == "stranger":
            if taken > STRANGE:
                raise Unfit(f"{name} looks like {rival}")
        elif name not in NAME_OF_FAULT.values() and (1 - taken < DISTINCT or (1 - taken) * strength < FAIR_OVER_RIVALS):
            raise Unfit(f"{name} cannot be told from {rival}")
        if facts[-1]["share_of_R"] > 0.7 or facts[-1]["share_of_R"] < 0.02:
            raise Unfit(f"{name} too weak or too strong")
    return {"concealed": facts, "noise_of_R": noise_ / rms_R}


NAME_OF_FAULT = {
    "delay": "channel_delay",
    "gain": "force_gain",
    "drift": "force_drift",
    "saturation": "sensor_saturation",
}


def _weakest_half(force_: Sequence[Array], motions: Sequence[Motion]) -> float:
    """The smallest share of R in any half of any test."""
    halves = [
        (f[part], m.R[part])
        for f, m in zip(force_, motions, strict=True)
        for part in (slice(0, len(f) // 2), slice(len(f) // 2, None))
    ]
    return min(float(np.sqrt(np.sum(f**2) / max(np.sum(R**2), 1e-300))) for f, R in halves)


def _fault_force(rig: Rig, motion: Motion, chain: Chain) -> Array:
    """What a fault of a sensor adds to the equation error, to first order."""
    seen = {}
    level = levels([motion])
    rate = 1 / (motion.t[1] - motion.t[0])
    for c in "Fxva":
        y = getattr(motion, c)
        seen[c] = np.zeros_like(y)
        for name, (channel, size) in chain.fault.items():
            if channel != c:
                continue
            wrong = {
                "delay": lambda y=y, s=size: np.interp(np.arange(len(y)) - s * rate, np.arange(len(y)), y),
                "gain": lambda y=y, s=size: y * s,
                "drift": lambda y=y, s=size, c=c: y + level.rms[c] * s * (0.4 + np.linspace(0, 1, len(y))),
                "saturation": lambda y=y, s=size, c=c: np.clip(y, -s * level.peak[c], s * level.peak[c]),
            }[name]()
            seen[c] = wrong - y
    return seen["F"] - rig.mass * seen["a"] - rig.parameters["Kl"] * seen["x"] - rig.parameters["B"] * seen["v"]


def _noise_of_R(rig: Rig, motions: Sequence[Motion], tests: Sequence[Test], chain: Chain) -> float:
    """rms noise of F - m a [N] per sample; where a is not measured, of the part of x'' in the band of the motion."""
    level = levels(list(motions))
    bits = 2.5 * 3 / 2**chain.bits / np.sqrt(12) if chain.bits else 0.0

    def noise_of(c: str) -> float:
        relative = 10 ** (-(chain.snr + chain.quieter.get(c, 0.0)) / 20) if chain.snr is not None else 0.0
        return level.rms[c] * float(np.hypot(relative, bits))

    if "a" in chain.channels:
        a = noise_of("a")
    else:
        band, order = 2.5 * rig.f0, 2 if "x" in chain.channels else 1
        share_of_band = np.sqrt(2 * band / tests[0].rate / (2 * order + 1))
        a = noise_of("v" if order == 1 else "x") * (2 * np.pi * band) ** order * share_of_band
    return float(np.hypot(noise_of("F"), rig.mass * a))


def _oracle(columns: dict[str, Array], clean: dict[str, Array], rig: Rig, chain: Chain) -> float | None:
    """Error of the true model against F - m a as recorded; None where a was not measured, or a sensor is at fault."""
    if "a" not in chain.channels or chain.fault:
        return None
    measured = columns["F"] - rig.mass * columns["a"]
    return float(np.std(measured - (clean["F"] - rig.mass * clean["a"])) / np.std(measured))


def _expected(
    kind: str, laws: Sequence[Concealed], subject: Subject, chain: Chain, decoy: Decoy | None
) -> dict[str, Any]:
    """Verdicts and names that are right, and names that are allowed besides."""
    names = [
        {
            "effect": law.effect,
            "form": law.form,
            "class": [law.effect, *law.equivalent],
            "parameters": law.known(amplitude),
        }
        for law, amplitude in zip(laws, subject.amplitudes, strict=False)
    ]
    for fault, (channel, size) in chain.fault.items():
        name = NAME_OF_FAULT[fault]
        same = {"force_gain": ["added_mass"], "force_drift": ["preload"]}.get(name, [])
        names.append({"effect": name, "form": channel, "class": [name, *same], "parameters": {}, "size": size})
    allowed: list[str] = []
    if chain.drift or chain.zero:
        allowed += ["preload", "force_drift"]
    if chain.gain:
        allowed += ["force_gain", "added_mass"]
    if decoy is not None:
        return {
            "expect": {"verdicts": list(decoy.verdicts), "names": [], "allowed": [*allowed, *decoy.names]},
            "decoy": decoy.name,
        }
    verdicts = {"null": list(CALM), "stranger": ["unknown_physics"], "sensor": ["sensor_fault"]}.get(
        kind, ["missing_physics"]
    )
    if kind == "sensor_and_physics":
        verdicts = ["missing_physics", "sensor_fault"]
    if kind == "sensor" and names[0]["class"] != [names[0]["effect"]]:
        verdicts = ["sensor_fault", "missing_physics"]
    if kind not in ("null", "stranger", "sensor") and any(
        "force_gain" in n["class"] or "force_drift" in n["class"] for n in names
    ):
        verdicts = ["missing_physics", "sensor_fault"]
    if kind == "stranger":
        return {"expect": {"verdicts": verdicts, "names": [], "allowed": allowed}, "stranger": laws[0].form}
    return {"expect": {"verdicts": verdicts, "names": names, "allowed": allowed}}


def write(case: Case, folder: Path) -> Path:
    """``folder/cases/NAME`` with the files of the user, ``folder/truth/NAME.json`` with the answer."""
    at = folder / "cases" / case.name
    at.mkdir(parents=True, exist_ok=True)
    (folder / "truth").mkdir(parents=True, exist_ok=True)
    for label, recordings in (("train", case.training), ("hold", case.holdout)):
        for i, columns in enumerate(recordings, 1):
            header = ",".join(f"{c} [{UNITS[c]}]" for c in columns)
            digits = "%.15g" if case.truth["snr"] is None else "%.10g"
            np.savetxt(
                at / f"{label}_{i}.csv",
                np.stack(list(columns.values()), axis=1),
                fmt=digits,
                delimiter=",",
                header=header,
                comments="",
            )
    (at / "question.json").write_text(json.dumps({"model": case.model, "parameters": case.parameters}, indent=1))
    (folder / "truth" / f"{case.name}.json").write_text(json.dumps(case.truth, indent=1))
    return at


__all__ = ["HOLDOUTS", "KINDS", "MIX", "Case", "NoFairCase", "make", "write"]
