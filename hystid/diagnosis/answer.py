"""From a selection to an answer: verdict, findings with parameters, location and confidence, and sentences."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hystid.diagnosis.baseline import Baseline
from hystid.diagnosis.chain import Fault
from hystid.diagnosis.fitting import ADDED_MASS, HYSTERESIS, Fit, Problem, Term
from hystid.diagnosis.locate import where_term
from hystid.diagnosis.result import Diagnosis, Finding, Value, Verdict, Where
from hystid.diagnosis.selection import PRELOAD, Choice
from hystid.diagnosis.sensors import DRIFT, NUISANCES, ChannelEffect, is_constant
from hystid.diagnosis.trials import DELAY
from hystid.diagnosis.windows import Windowed, edges, has_own_windows, term_for, widest

Array = NDArray[np.float64]
SENSORS = frozenset({"channel_delay", "force_gain", "force_drift", "sensor_saturation"})
GAIN = "force_gain"
PINCHING, BACKLASH = "pinching", "backlash"
_FEW = 4.0  # samples at full speed over which friction must build up to be told from one without memory,
_SMALL = 0.02  # or else this share of the stroke
_SLACK = 0.97  # share of the hysteretic force beyond which pinching is free play
_EXACT = (frozenset({"two_sided_stop", "backlash"}), frozenset({ADDED_MASS, GAIN}))
_FORCE = ("N", "kg", "J")  # beginnings of units that are proportional to a force
_RECALIBRATED = 1.15  # mean square at the nominal values over that of the refit

_SPLITS = {
    frozenset({"two_sided_stop", "backlash"}): "measure the stiffness at very small displacement: free play is soft",
    frozenset({ADDED_MASS, GAIN}): "calibrate the force channel with a known weight, or weigh the moving parts",
    frozenset({"preload", "asymmetric_friction"}): "hold it still after slow motion from either side, and tilt it",
    frozenset({"preload", "force_drift"}): "record the force channel with nothing attached, before and after a test",
    frozenset({"cubic_stiffness", "two_sided_stop"}): "record at small and large amplitudes: is there a threshold",
    frozenset({"quadratic_stiffness", "bilinear_stiffness"}): "does the second harmonic grow with the amplitude",
    frozenset({"quadratic_damping", "stribeck_friction"}): "vary the frequency at a fixed amplitude",
    frozenset({"viscoelastic_relaxation", "hidden_mode"}): "hold a step and watch the force; sweep further up",
    frozenset({"stiffness_drift", "cyclic_degradation"}): "let it rest between two tests: time passes without a path",
    frozenset({"coulomb_friction", "stribeck_friction"}): "record slow cycles through zero velocity",
    frozenset({"coulomb_friction", "hysteretic_friction"}): "record slow reversals with more samples per millimetre",
}  # fmt: skip


@dataclass(frozen=True)
class Answer:
    """The selection together with what is needed to put it into words."""

    problem: Problem
    baseline: Baseline
    choice: Choice
    nominal_chi2: float
    faults: tuple[Fault, ...]

    def verdict(self) -> Verdict:
        """The first word of the answer."""
        names = [*(fault.id for fault in self.faults), *self.names()]
        if any(name not in SENSORS for name in names):
            return "missing_physics"
        if names:
            return "sensor_fault"
        if self.choice.unknown:
            return "unknown_physics"
        return "recalibrated" if self.nominal_chi2 > _RECALIBRATED * self.choice.before.chi2 else "consistent"

    def names(self) -> tuple[str, ...]:
        """Ids of the selection, a negative added mass called by its right name."""
        return tuple(self.rename(name) for name in self.choice.named)

    def rename(self, name: str) -> str:
        """Added mass or gain of the force channel: negative is a gain; else what keeps the refit nearer to nominal.

        Pinching of friction that leaves nothing of it is slack. A force channel that is off by a constant in each
        recording, and does not drift, may as well have measured a constant force.
        """
        if name == DRIFT and self._is_constant():
            return PRELOAD
        if name == PINCHING and not self.baseline.has_h and self._vanishing() > _SLACK:
            return BACKLASH
        if name != ADDED_MASS or not self.baseline.mass:  # without a mass there is nothing that a gain could scale
            return name
        return GAIN if self.gain() < 0 or self._gain_is_nearer() else ADDED_MASS

    def _is_constant(self) -> bool:
        """Whether the named drift of the force channel is next to nothing but a constant per recording."""
        term = self.term(DRIFT)
        return term is not None and is_constant(term.values, self.problem.parts)

    def _vanishing(self) -> float:
        """Share of the hysteretic force that is missing in the middle of its range, whatever the displacement."""
        term = self.term(PINCHING)
        by_force = term is not None and any(shape.unit == "N" for shape in term.effect.shapes)
        return float(term.values[term.effect.amplitudes[0]]) if term is not None and by_force else 0.0

    def gain(self) -> float:
        """Added mass as a share of the mass."""
        term = next(term for term in self.choice.after.hypothesis.terms if term.effect.id == ADDED_MASS)
        return float(term.values[term.effect.amplitudes[0]] / self.choice.after.hypothesis.values["m"])

    def gain_error(self) -> float:
        """Standard error of ``gain``."""
        fit = self.choice.after
        index = next(i for i, term in enumerate(fit.hypothesis.terms) if term.effect.id == ADDED_MASS)
        name = fit.hypothesis.terms[index].effect.amplitudes[0]
        return float(fit.stderr((str(index), name)) / fit.hypothesis.values["m"])

    def at_the_structure(self, term: Term, stated: Mapping[str, Value]) -> dict[str, Value]:
        """Parameters of an effect behind a force channel of wrong gain: what scales with the force is fitted in units
        of the channel, and is divided by the gain. Where it may as well be added mass, the errors know either reading.
        """
        if ADDED_MASS not in self.choice.named or term.effect.id == ADDED_MASS or not self.baseline.mass:
            return dict(stated)
        gain, error = 1 + self.gain(), self.gain_error()
        divided = GAIN in self.names()
        found = dict(stated)
        for name, v in stated.items():
            if v.unit.startswith(_FORCE):
                other = abs(v.value - v.value / gain) * np.sqrt(0.5) if gain > 1 else 0.0  # one as likely as the other
                value, spread = (v.value / gain, v.stderr / gain) if divided else (v.value, v.stderr)
                by_gain = value * error / gain if divided else 0.0
                found[name] = Value(value, float(np.linalg.norm([spread, by_gain, other])), v.unit)
        return found

    def _gain_is_nearer(self) -> bool:
        fitted, nominal = self.choice.after.hypothesis.values, self.baseline.nominal
        pairs = [
            (fitted[n], nominal[n])
            for n in self.baseline.free
            if self.baseline.units.get(n, "") in ("N/m", "N", "N.s/m") and fitted[n] * nominal[n] > 0
        ]
        as_mass = sum(abs(np.log(f / n)) for f, n in pairs)
        as_gain = sum(abs(np.log(f / (1 + self.gain()) / n)) for f, n in pairs)
        return bool(as_gain < as_mass)

    def term(self, name: str) -> Term | None:
        """The fitted term of a name of the selection."""
        return next((t for t in self.choice.after.hypothesis.terms if t.effect.id == name), None)

    def terms(self) -> list[tuple[Term, Mapping[str, Value]]]:
        """Terms that belong into a model (faults of the force channel do not)."""
        fit = self.choice.after
        kept: list[tuple[Term, Mapping[str, Value]]] = []
        for i, term in enumerate(fit.hypothesis.terms):
            if isinstance(term.effect, ChannelEffect) or self.rename(term.effect.id) == GAIN:
                continue
            kept.append(self._as_written(term, self.stated(i, term)))
        return kept

    def stated(self, index: int, term: Term) -> dict[str, Value]:
        """Fitted parameters of a term with what other forms, and times at which it cannot be seen, leave open."""
        fit = self.choice.after
        found = values(fit, index, term)
        for name, value in found.items():
            spread = self.choice.left_open.get((str(index), name), 0.0)
            found[name] = replace(value, stderr=float(np.hypot(value.stderr, spread)))
        for at, (first, last) in edges(self.problem, fit.hypothesis, term).items():  # anywhere in between
            found[at] = replace(found[at], stderr=float(np.hypot(found[at].stderr, (last - first) / np.sqrt(12))))
        return found

    @staticmethod
    def _as_written(term: Term, stated: Mapping[str, Value]) -> tuple[Term, Mapping[str, Value]]:
        """A model has one window: that of the recording in which it is longest."""
        written = term_for(term)
        if written is term or not isinstance(term.effect, Windowed) or not isinstance(written.effect, Windowed):
            return term, stated
        names = dict(zip(written.effect.names(0), term.effect.names(widest(term)), strict=True))
        return written, {name: stated[names.get(name, name)] for name in written.values}

    def is_model(self) -> bool:
        """Whether one model holds everything that was found, in every recording: no fault of a channel, no window that
        differs from recording to recording."""
        terms = self.choice.after.hypothesis.terms
        return not self.faults and len(self.terms()) == len(terms) and not has_own_windows(self.choice.after.hypothesis)

    def is_beside_a_drift(self) -> bool:
        """Whether physics is named beside a drift of the force channel, and the model has everything else: a recording
        that was held out, of whose drift nothing is known, can then tell against the physics, but not for it."""
        own = has_own_windows(self.choice.after.hypothesis)
        return DRIFT in self.choice.named and bool(self.terms()) and not self.faults and not own

    def remarks(self) -> list[str]:
        """What the model file should say about the recordings."""
        told = ["Written by hystid diagnose. Standard errors stand behind the values."]
        told += [f"Taken out before fitting: {describe(fault)}." for fault in self.faults]
        hypothesis = self.choice.after.hypothesis
        if DELAY in self.choice.named:
            told.append(f"The force channel is {hypothesis.delay:.3g} samples late; the model has no delay.")
        if GAIN in self.names():
            told.append(f"The force channel reads {1 + self.gain():.4g} times the force; parameters are in its units.")
        if DRIFT in self.choice.named:
            constant = "A constant force differs from recording to recording; the model has none."
            told.append(constant if self._is_constant() else "The force channel drifts; the model does not.")
        if has_own_windows(hypothesis):
            told.append("The window of time differs from recording to recording: the model has the longest one.")
        if abs(hypothesis.weighing) > 0.01:
            told.append(f"The mass differs by {100 * hypothesis.weighing:.2g} % from the weighed one.")
        return told

    def own_blocks(self) -> dict[str, str]:
        """Texts of blocks that are not of the library: the file must be complete in itself."""
        found = {}
        for term, _ in self.terms():
            file, _, name = term.effect.class_name.rpartition(":")
            if file:
                found[name] = Path(file).read_text(encoding="utf-8")
        return found

    def acting(self) -> list[Array] | None:
        """Force of everything that was named, per recording [N]; None where nothing was."""
        if not self.choice.named and not self.faults:
            return None
        problem, hypothesis = self.problem, self.choice.after.hypothesis
        signals = problem.signals(hypothesis)
        total = [np.zeros(len(part)) for part in problem.parts]
        for term in hypothesis.terms:
            if term.effect.id in NUISANCES:
                continue
            total = [f + np.abs(term.effect.force(s, term.values)) for f, s in zip(total, signals, strict=True)]
        if DELAY in self.choice.named:
            total = [
                f + np.abs(p.F - problem.force_at(i, hypothesis.delay))
                for i, (f, p) in enumerate(zip(total, problem.parts, strict=True))
            ]
        for fault in self.faults:
            feigned = self._feigned(fault)
            total = [f + g for f, g in zip(total, feigned, strict=True)]
        return total

    def _feigned(self, fault: Fault) -> list[Array]:
        """The force that a faulty channel feigns: its error times what it is multiplied with in the balance."""
        problem, hypothesis = self.problem, self.choice.after.hypothesis
        mass = hypothesis.mass()
        stiffness = float(np.std(np.concatenate(problem.predicted(hypothesis)))) / float(np.std(problem.parts[0].x))
        weight = {"F": 1.0, "a": mass or 1.0, "x": stiffness, "v": 0.0}[fault.channel]
        found = []
        for part, force in zip(problem.parts, problem.predicted(hypothesis), strict=True):
            if fault.id == DELAY:
                moving = {
                    "x": part.v,
                    "v": part.a,
                    "a": np.gradient(part.a, part.dt),
                    "F": np.gradient(part.F, part.dt),
                }
                found.append(weight * np.abs(moving[fault.channel]) * part.dt * abs(fault.size))
            else:
                true = {"x": part.x, "v": part.v, "a": part.a, "F": mass * part.a + force}[fault.channel]
                found.append(weight * np.maximum(np.abs(true) - fault.size, 0.0))
        return found


def values(fit: Fit, index: int, term: Term) -> dict[str, Value]:
    """Fitted parameters of a term with standard errors."""
    return {
        name: Value(float(value), fit.stderr((str(index), name)), term.effect.units.get(name, ""))
        for name, value in term.values.items()
    }


def refit_values(answer: Answer, fit: Fit) -> dict[str, Value]:
    """Baseline parameters after a fit; the mass carries the weighing error, and a gain of the force channel."""
    base, found = answer.baseline, {}
    for name, value in fit.hypothesis.values.items():
        found[name] = Value(float(value), fit.stderr(("base", name)), base.units.get(name, ""))
    if "m" in found and "m" not in base.free:
        spread = fit.stderr(("chain", "weighing")) * base.mass
        mass = fit.hypothesis.mass()
        if fit is answer.choice.after and ADDED_MASS in answer.choice.named and answer.rename(ADDED_MASS) == GAIN:
            mass *= 1 + answer.gain()
        found["m"] = Value(mass, spread, base.units.get("m", "kg"))
    return found


def findings(answer: Answer) -> tuple[Finding, ...]:
    """Everything that was found, strongest first."""
    made = [_fault_finding(answer, fault) for fault in answer.faults]
    weights = [1e300] * len(made)
    signals = answer.problem.signals(answer.choice.after.hypothesis)
    for name, alike, margin in zip(answer.choice.named, answer.choice.classes, answer.choice.margins, strict=True):
        finding, weight = _finding(answer, name, alike, margin, signals)
        made.append(finding)
        weights.append(weight)
    return tuple(made[i] for i in np.argsort([-w for w in weights], kind="stable"))


def _finding(answer: Answer, name: str, alike: tuple[str, ...], margin: float, signals: Any) -> tuple[Finding, float]:
    choice, fit = answer.choice, answer.choice.after
    shown = answer.rename(name)
    together = tuple(dict.fromkeys((shown, *alike, *_equivalents(shown, answer), *_too_short(answer, name))))
    evidence = {
        "explained": choice.explained, "chi2_before": choice.before.chi2, "chi2_after": fit.chi2,
        "floor": choice.floor_after, "margin": margin,
        "tried": [
            {"effect": t.name, "form": t.form, "chi2": t.chi2, "absorbed": t.absorbed} for t in choice.trials[:12]
        ],
    }  # fmt: skip
    sure = confidence(choice, together, margin)
    term = answer.term(name)
    if term is None:
        delay = Value(fit.hypothesis.delay, fit.stderr(("chain", "delay")), "1")
        seconds = Value(delay.value * answer.problem.parts[0].dt, delay.stderr * answer.problem.parts[0].dt, "s")
        where = Where("the force channel is late as a whole", (0, 0), (0, 0), {}, {}, "no harmonics")
        return Finding(shown, together, sure, {"samples": delay, "delay": seconds}, where, evidence), 1e299
    where = where_term(answer.problem, term, signals)
    weight = float(np.sqrt(np.mean(np.concatenate([term.effect.force(s, term.values) for s in signals]) ** 2)))
    evidence |= {"form": term.effect.form, "class_name": term.effect.class_name, "rms_force": weight}
    if shown == GAIN:
        parameters = {"gain": Value(1 + answer.gain(), answer.gain_error(), "1")}
        return Finding(shown, together, sure, parameters, where, evidence), weight
    fitted = answer.at_the_structure(term, answer.stated(fit.hypothesis.terms.index(term), term))
    return Finding(shown, together, sure, fitted, where, evidence), weight


def _equivalents(name: str, answer: Answer) -> tuple[str, ...]:
    """Ids that are the same by algebra."""
    if name == GAIN and answer.gain() < 0:
        return ()
    if name == BACKLASH and PINCHING in answer.choice.named:  # slack behind friction is no free play of a spring
        return ()
    return tuple(sorted(other for group in _EXACT if name in group for other in group))


def _too_short(answer: Answer, name: str) -> tuple[str, ...]:
    """Friction that builds up within a few samples, and a trace of the stroke, might as well be without memory."""
    term = answer.term(name)
    if name != HYSTERESIS or term is None:
        return ()
    path = max(float(np.max(np.abs(part.v))) * part.dt for part in answer.problem.parts)
    stroke = max(float(np.max(np.abs(part.x))) for part in answer.problem.parts)
    return ("coulomb_friction",) if term.values.get("x_c", np.inf) < min(_FEW * path, _SMALL * stroke) else ()


def confidence(choice: Choice, alike: tuple[str, ...], margin: float) -> float:
    """0..1: how much is explained, how far the next name is, and how many names there are."""
    sure = 0.6 + 0.39 * float(np.clip((choice.explained - 0.9) / 0.1, 0, 1))
    sure *= 0.8 + 0.2 * float(np.clip(margin / 0.1, 0, 1))
    sure *= 0.85 if len(choice.named) > 1 else 1.0
    return float(np.clip(sure / (1 + 0.25 * (len(alike) - 1)), 0.05, 0.99))


def _fault_finding(answer: Answer, fault: Fault) -> Finding:
    dt = answer.problem.parts[0].dt
    if fault.id == DELAY:
        parameters = {
            "samples": Value(fault.size, fault.stderr, "1"),
            "delay": Value(fault.size * dt, fault.stderr * dt, "s"),
        }
    else:
        unit = {"x": "m", "v": "m/s", "a": "m/s2", "F": "N"}[fault.channel]
        parameters = {"level": Value(fault.size, fault.stderr, unit)}
    where = Where(describe(fault), (0, 0), (0, 0), {}, {}, "odd harmonics" if fault.id != DELAY else "no harmonics")
    evidence = {"channel": fault.channel, "share_of_samples": fault.share}
    return Finding(fault.id, (fault.id,), 0.95, parameters, where, evidence)


def describe(fault: Fault) -> str:
    """A fault in words."""
    if fault.id == DELAY:
        return f"channel {fault.channel} is {fault.size:.3g} samples late against the other channels"
    return f"channel {fault.channel} stops at {fault.size:.4g}, in {100 * fault.share:.2g} % of the samples"


def headline(diagnosis: Diagnosis) -> str:
    """One sentence: what, where, how sure, how much better."""
    if diagnosis.verdict == "consistent":
        return "The model agrees with the recordings down to their noise"
    if diagnosis.verdict == "recalibrated":
        return "The model agrees with the recordings down to their noise once its parameters are refitted"
    if diagnosis.verdict == "unknown_physics" and diagnosis.unknown:
        if diagnosis.refuted:
            return f"Something is missing: {diagnosis.unknown.text}. Not claimed: {diagnosis.refuted}"
        return f"Something is missing that no effect of the library explains: {diagnosis.unknown.text}"
    named = " and ".join(_told(finding) for finding in diagnosis.findings)
    return f"{named}; {_better(diagnosis)}"


def _told(finding: Finding) -> str:
    return f"{in_words(finding)}: {finding.where.text}, confidence {finding.confidence:.2f}"


def in_words(finding: Finding) -> str:
    """The name of a finding and its look-alikes, as they are read."""
    others = [name for name in finding.alike if name != finding.effect]
    told = finding.effect + (f" (or {', '.join(others)})" if others else "")
    return told.replace("_", " ")


def _better(diagnosis: Diagnosis) -> str:
    listed = diagnosis.holdout or diagnosis.errors
    pairs = [e.free_run for e in listed if e.free_run[0] is not None and e.free_run[1] is not None]
    kind = "held-out free-run" if diagnosis.holdout else "free-run"
    if pairs:
        before, after = (float(np.mean([pair[i] for pair in pairs])) for i in (0, 1))
        return f"{kind} error of the displacement {100 * before:.3g} % before, {100 * after:.3g} % after"
    before, after = diagnosis.force_nrmse
    return f"force error {100 * before:.3g} % before, {100 * after:.3g} % after"


def next_experiment(diagnosis: Diagnosis) -> str:
    """The test that would tell most."""
    for finding in diagnosis.findings:
        for pair, advice in _SPLITS.items():
            if pair <= set(finding.alike):
                return f"To part {' from '.join(sorted(pair)).replace('_', ' ')}: {advice}."
    if diagnosis.refuted:
        return (
            "Check that all recordings are of the structure in the same state; then record it at more amplitudes and "
            "frequencies, so that what was refuted can be tried on them."
        )
    if diagnosis.verdict == "unknown_physics":
        return (
            "Record slow cycles, and harmonic tests at three amplitudes and three frequencies, so that the amplitude "
            "and rate laws of the unknown force can be read off; add a law that suggests itself with --effects."
        )
    if diagnosis.untestable:
        listed = ", ".join(diagnosis.untestable[:4])
        return (
            f"These recordings cannot show {listed}: add slow cycles and a wider range of amplitudes and frequencies."
        )
    return "Confirm the model on a test at another amplitude that was not used here."
