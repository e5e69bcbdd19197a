"""Drawing one case: oscillator, effects calibrated to a visible but concealed size, tests, recordings, sealed truth."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from benchmarks.concealed import baselines, outsiders
from benchmarks.concealed.baselines import Baseline
from benchmarks.concealed.chain import CHANNELS, Chain, Fault, Taken, measure, take
from benchmarks.concealed.deck import SENSORS, CaseSpec
from benchmarks.concealed.effects import PHYSICS, Effect, Rng
from benchmarks.concealed.excitation import Kind, Test
from benchmarks.concealed.oracle import LEAST_MISMATCH, Mismatch, free_run_error, mismatch
from benchmarks.concealed.rig import Diverged, Rig

TARGETS = (0.5, 2.5)  # mismatch left after a refit, in noise units: from just visible to plain
MOST_SHARE = 0.35  # of the restoring force
LEAST_ADDED = 0.045  # of the mass
ATTEMPTS = 300  # a few draws do for most cases; an added mass beside a jump in the force took more than 30
DRAFT = 6  # coarse oversampling while sizes are being searched


@dataclass(frozen=True)
class Case:
    """One drawn case. recordings: those handed out for the diagnosis; holdout: an unseen test."""

    spec: CaseSpec
    baseline: Baseline
    effects: tuple[Effect, ...]
    chain: Chain
    tests: tuple[Test, ...]
    recordings: tuple[Taken, ...]
    holdout: Taken
    nominal: dict[str, float]
    mismatch: Mismatch
    share: float
    oracle: dict[str, float | None]

    @property
    def identifiable(self) -> bool:
        """Whether the effect leaves a mismatch that the rule calls visible; true where nothing is concealed.

        A mass that is given counts as weighed to 3.5 %: less added mass than that is no mismatch.
        """
        added = [e.element.strength for e in self.effects if e.id == "added_mass"]
        if any(abs(mass) < LEAST_ADDED * self.baseline.parameters["m"] for mass in added):
            return False
        return not self.expects_finding or self.mismatch.visible >= LEAST_MISMATCH

    @property
    def expects_finding(self) -> bool:
        """Whether something was left out of the model that the diagnosis is given."""
        return bool(self.effects) or self.chain.fault is not None or self.spec.group == "wrong_baseline"


def draw(spec: CaseSpec, rng: Rng) -> Case:
    """Draw a case, again where the effect cannot be carried or cannot be seen: every case is identifiable."""
    for _ in range(ATTEMPTS):
        try:
            case = _draw(spec, rng)
        except Diverged:
            continue
        if case.identifiable:
            return case
    raise RuntimeError(f"no usable case of {spec} in {ATTEMPTS} draws")


def _draw(spec: CaseSpec, rng: Rng) -> Case:
    chain = _chain(spec, rng)
    true = baselines.draw(spec.family, rng, chain.duration)
    tests = _tests(true, chain, rng)
    wanted = tuple(_effect(name, rng, true) for name in spec.ids if name in PHYSICS or _outside(name))
    if spec.group == "part_time":
        wanted = tuple(_gated(e, chain, rng) for e in wanted)
    target = np.exp(rng.uniform(*np.log(TARGETS)))
    effects = tuple(_calibrated(e, true, tests, chain, target) for e in wanted)
    if any(name in SENSORS for name in spec.ids):
        name = next(name for name in spec.ids if name in SENSORS)
        chain = replace(chain, fault=_fault(name, true, tests, chain, rng))
    rig = _with(true, effects)
    taken = [take(rig, test, chain, i) for i, test in enumerate(tests)]
    _refuse_excess(true, taken)
    reference = _reference(taken)
    noisy = [measure(r, chain, rng, reference if chain.fixed_noise else _deviation(r)) for r in taken]
    given = noisy[:-1] if spec.variant != "two_recordings" else [noisy[0], noisy[2]]
    believed = true if spec.given == spec.family else _stand_in(spec.given, true, rng)
    nominal = baselines.nominal(
        believed, rng, mass_error=rng.choice([-0.03, 0.03]) if spec.variant == "mass_off" else 0.0
    )
    seen = mismatch(believed, rig, given, true.parameters["m"])
    holdout = noisy[-1]
    oracle = {
        "holdout_truth": _truth_error(rig, holdout, chain.fault),
        "holdout_refit": free_run_error(baselines.rig_of(believed.family, seen.refit, true.scale.V), holdout),
    }
    return Case(spec, believed, effects, chain, tests, tuple(given), holdout, nominal, seen, _share(taken, rig), oracle)


def _refuse_excess(b: Baseline, taken: Sequence[Taken]) -> None:
    """Raise Diverged where the effect let the motion grow far beyond what the rig, or its law, is made for."""
    limit = b.parameters.get("x0", 2.5 * b.scale.X)
    if _peak(taken) > limit:
        raise Diverged("the motion is larger than the rig is made for")


def _peak(taken: Sequence[Taken]) -> float:
    return max(float(np.max(np.abs(r.true["x"]))) for r in taken)


def _truth_error(rig: Rig, holdout: Taken, fault: Fault | None) -> float | None:
    """Free run of the truth; None where a channel is wrong in a way that parameters of the model cannot express."""
    if fault and fault.id != "force_gain":
        return None
    return free_run_error(rig, holdout, 1 + fault.size if fault else 1.0)


def _chain(spec: CaseSpec, rng: Rng) -> Chain:
    return Chain(
        sample_rate=float(rng.choice([1000, 1280, 1600, 2000])),
        samples=8000,
        snr={"snr28": 28.0, "snr40": 40.0}.get(spec.variant, 34.0),
        decoy=spec.ids[0] if spec.group == "decoy" else "",
        running=spec.variant == "running",
        fixed_noise=bool(rng.random() < 0.25),
    )


def _tests(b: Baseline, chain: Chain, rng: Rng) -> tuple[Test, ...]:
    """Four tests of different size and one that is held out, each scaled to a peak displacement."""
    s = b.scale
    band, sweep = (2.0, s.f0 * rng.uniform(2.2, 3.0)), (1.0, s.f0 * rng.uniform(2.0, 2.6))
    plans: dict[str, tuple[tuple[Kind, float], ...]] = {
        "mixed": (("multisine", 0.4), ("multisine", 0.7), ("multisine", 1.0), ("slow", 0.8)),
        "chirps": (("chirp", 0.35), ("chirp", 0.55), ("chirp", 0.8), ("chirp", 1.0)),
        "both": (("chirp", 0.45), ("multisine", 0.7), ("multisine", 1.0), ("slow", 0.9)),
        "steady": (("harmonics", 0.6), ("chirp", 0.75), ("harmonics", 0.95), ("chirp", 0.9)),
    }
    name = "steady" if b.family == "pecorari" else str(rng.choice(["mixed", "chirps", "both"], p=[0.5, 0.2, 0.3]))
    unseen: tuple[Kind, float] = (
        "harmonics" if b.family == "pecorari" or rng.random() < 0.4 else "multisine",
        rng.uniform(0.82, 0.95),
    )
    tests = []
    for kind, size in (*plans[name], unseen):
        tones = tuple(float(s.f0 * r) for r in rng.permutation([0.55, 0.8, 1.15, 1.5]))
        test = Test(kind, sweep if kind == "chirp" else band, 1.0, int(rng.integers(2**31)), tones)
        tests.append(_scaled(test, b, chain, size * s.X))
    return tuple(tests)


def _scaled(test: Test, b: Baseline, chain: Chain, peak: float) -> Test:
    """The test at the level that gives the bare oscillator the wanted peak displacement (a few secant steps)."""
    test = replace(test, level=0.3 * b.scale.K * peak)
    for _ in range(4):
        reached = float(np.max(np.abs(take(b.rig(), test, replace(chain, decoy=""), 0, DRAFT).true["x"])))
        if abs(reached / peak - 1) < 0.05:
            break
        test = replace(test, level=test.level * float(np.clip(peak / reached, 0.3, 3)))
    return test


def _effect(name: str, rng: Rng, b: Baseline) -> Effect:
    if name in PHYSICS:
        return PHYSICS[name](rng, b)
    if name in outsiders.STRANGERS:
        return outsiders.STRANGERS[name](rng, b)
    return outsiders.RELATIVES[name][1](rng, b)


def _outside(name: str) -> bool:
    return name in outsiders.STRANGERS or name in outsiders.RELATIVES


def _gated(effect: Effect, chain: Chain, rng: Rng) -> Effect:
    """The effect in a window of every recording: a third to a half of it."""
    length = rng.uniform(0.33, 0.5) * chain.duration
    on = rng.uniform(0.1, 0.9) * (chain.duration - length)
    return replace(
        effect, element=replace(effect.element, gate=(on, on + length, 0.03 * chain.duration)), quantities=lambda e: {}
    )


def _calibrated(effect: Effect, b: Baseline, tests: Sequence[Test], chain: Chain, target: float) -> Effect:
    """The effect at the strength that leaves ``target`` noise units after a refit, within shares and limits."""
    for _ in range(5):
        rig = _with(b, (effect,))
        quiet = replace(chain, decoy="", fault=None)
        taken = [take(rig, t, quiet, i, DRAFT) for i, t in enumerate(tests[:-1])]
        if _peak(taken) > 10 * b.scale.X:
            effect = replace(effect, element=effect.element.scaled(0.3))
            continue
        rng = np.random.default_rng(0)
        taken = [measure(r, quiet, rng, _deviation(r)) for r in taken]
        seen = mismatch(b, rig, taken, b.parameters["m"]).visible
        room = min(effect.most / abs(effect.element.strength), MOST_SHARE / max(_share(taken, rig), 1e-9))
        factor = min(float(np.clip(target / max(seen, 1e-9), 0.15, 6)), room)
        if abs(factor - 1) < 0.2:
            break
        effect = replace(effect, element=effect.element.scaled(factor))
    if _share(taken, rig) > 1.5 * MOST_SHARE:
        raise Diverged("the effect would have to dominate the oscillator to be seen")
    return effect


def _with(b: Baseline, effects: tuple[Effect, ...]) -> Rig:
    rig = b.rig()
    return replace(rig, elements=(*rig.elements, *(e.element for e in effects)))


def _share(taken: Sequence[Taken], rig: Rig) -> float:
    """Root mean square of all concealed forces over that of the restoring force."""
    concealed = np.concatenate([np.sum(r.effects, axis=0) for r in taken])
    restoring = np.concatenate([r.true["F"] - rig.m * r.true["a"] for r in taken])
    return float(np.sqrt(np.mean(concealed**2) / np.mean(restoring**2)))


def _fault(name: str, b: Baseline, tests: Sequence[Test], chain: Chain, rng: Rng) -> Fault:
    sign = float(rng.choice([-1, 1]))
    if name == "channel_delay":
        return Fault(name, str(rng.choice(["F", "a", "x"])), float(rng.integers(10, 41)) / 16)
    if name == "force_gain":
        return Fault(name, "F", sign * rng.uniform(0.04, 0.12))
    if name == "force_drift":
        level = max(t.level for t in tests)
        return Fault(name, "F", sign * level * rng.uniform(0.008, 0.03), int(rng.integers(2)))
    channel = str(rng.choice(["x", "a", "F"]))
    peak = max(
        float(np.max(np.abs(take(b.rig(), t, replace(chain, decoy=""), 0, DRAFT).true[channel]))) for t in tests[:-1]
    )
    return Fault(name, channel, peak * rng.uniform(0.6, 0.85))


def _stand_in(family: str, true: Baseline, rng: Rng) -> Baseline:
    """A baseline of another family with the sizes of the true one: where somebody who believes in it would start."""
    other = baselines.draw(family, rng, true.scale.duration)
    p = {name: true.parameters[name] for name in ("m", "B", "Kl")}
    X, Ks = true.scale.X, true.scale.K - true.parameters["Kl"]
    fc = true.scale.friction or 0.1 * true.scale.force
    law = {"jenkins": {"Ks": Ks, "fc": fc}, "iwan": {"Ks": Ks, "fc": fc}, "linear": {}}
    if family == "boucwen":
        law["boucwen"] = {"alpha": Ks, "beta": Ks / fc, "gamma": 0.6, "delta": 0.4, "nu": 1.0}
    if family == "linear":
        p["Kl"] = true.scale.K
    return replace(other, parameters=p | law[family], scale=replace(true.scale, X=X, friction=fc))


def _deviation(r: Taken) -> dict[str, float]:
    return {c: float(np.std(r.true[c])) for c in CHANNELS}


def _reference(taken: Sequence[Taken]) -> dict[str, float]:
    return {c: float(np.median([np.std(r.true[c]) for r in taken])) for c in CHANNELS}
