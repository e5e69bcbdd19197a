"""From a selection to an answer: verdict, findings with parameters, location and confidence, and sentences."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from hystid.diagnosis.decide.criterion import ACCURACY
from hystid.diagnosis.decide.limits import is_reached
from hystid.diagnosis.decide.selection import Choice
from hystid.diagnosis.fit.extended import own_texts
from hystid.diagnosis.fit.hypothesis import Fit, Term, is_mass
from hystid.diagnosis.fit.problem import Problem
from hystid.diagnosis.fit.value import Value
from hystid.diagnosis.fit.windows import Windowed, edges, has_own_windows, term_for, widest
from hystid.diagnosis.model.baseline import Baseline
from hystid.diagnosis.model.catalogue import Catalogue
from hystid.diagnosis.model.channel_effects import CHANNELS, DRIFT, NUISANCES, ChannelEffect, is_constant
from hystid.diagnosis.model.semantics import End, Semantics
from hystid.diagnosis.prepare.faults import DELAY, Fault
from hystid.numeric import Array

Verdict = Literal["consistent", "recalibrated", "missing_physics", "sensor_fault", "unknown_physics", "not_applicable"]
GAIN = "force_gain"
_FORCE = ("N", "kg", "J")  # beginnings of units that are proportional to a force
_RECALIBRATED = 1.15  # mean square at the nominal values over that of the refit


@dataclass(frozen=True)
class Answer:
    """The selection together with what is needed to put it into words."""

    problem: Problem
    baseline: Baseline
    choice: Choice
    nominal_chi2: float
    faults: tuple[Fault, ...]
    catalogue: Catalogue

    def verdict(self) -> Verdict:
        """The first word of the answer."""
        names = [*(fault.id for fault in self.faults), *self.names()]
        if any(name not in CHANNELS for name in names):
            return "missing_physics"
        if names:
            return "sensor_fault"
        if self.choice.unknown:
            return "unknown_physics"
        return "recalibrated" if self.nominal_chi2 > _RECALIBRATED * self.choice.before.chi2 else "consistent"

    def names(self) -> tuple[str, ...]:
        """Ids of the selection, laws at an end of their parameters called by their right names."""
        return tuple(self.rename(name) for name in self.choice.named)

    def rename(self, name: str) -> str:
        """A law at an end of its parameters by the name that its block declares for it.

        Mass, or a gain of the force channel: what keeps the refit nearer to nominal. Mass that comes or goes is mass: a
        gain would change with it whatever else the force channel shows. A force channel that is off by a constant in
        each recording, and does not drift, may as well have measured a constant force.
        """
        if name == DRIFT and self._is_constant():
            return next((i for i, said in self.catalogue.laws.items() if _equals_a_constant(said)), name)
        term = self.term(name)
        if term is None or isinstance(term.effect, Windowed):
            return name
        if is_mass(term.effect) and not self.baseline.mass:  # no mass that a gain could scale
            return name
        for end in self.ends(term):
            if end.fit == "renamed":
                return end.law
        return GAIN if is_mass(term.effect) and self._gain_is_nearer() else name

    def ends(self, term: Term) -> Iterator[End]:
        """Ends of its parameters that a named law has come to."""
        signals = self.problem.signals(self.choice.after.hypothesis)
        return (e for e in term.effect.semantics.becomes if is_reached(self.problem, term, e, signals))

    def _is_constant(self) -> bool:
        """Whether the named drift of the force channel is next to nothing but a constant per recording."""
        term = self.term(DRIFT)
        return term is not None and is_constant(term.values, self.problem.parts)

    @property
    def _carried(self) -> tuple[int, Term] | None:
        """Number and term of an effect that is mass all the time; None where none was named."""
        terms = enumerate(self.choice.after.hypothesis.terms)
        lasting = ((i, term) for i, term in terms if not isinstance(term.effect, Windowed))
        return next(((i, term) for i, term in lasting if is_mass(term.effect)), None)

    def gain(self) -> float:
        """Added mass as a share of the mass."""
        assert self._carried is not None
        _, term = self._carried
        return float(term.values[term.effect.semantics.mass] / self.choice.after.hypothesis.values["m"])

    def gain_error(self) -> float:
        """Standard error of ``gain``."""
        assert self._carried is not None
        fit, (index, term) = self.choice.after, self._carried
        return float(fit.stderr((str(index), term.effect.semantics.mass)) / fit.hypothesis.values["m"])

    def at_the_structure(self, term: Term, stated: Mapping[str, Value]) -> dict[str, Value]:
        """Parameters of an effect behind a force channel of wrong gain: what scales with the force is fitted in units
        of the channel, and is divided by the gain. Where it may as well be added mass, the errors know either reading.
        """
        if self._carried is None or is_mass(term.effect) or not self.baseline.mass:
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
        """Fitted parameters of a term with what other forms, and times at which it cannot be seen, leave open. None of
        the law is known better than recordings are prepared; times count from the first sample."""
        fit, law = self.choice.after, term.law.effect
        found, own = values(fit, index, term), (*law.amplitudes, *(shape.name for shape in law.shapes))
        for name, value in found.items():
            spread = self.choice.left_open.get((str(index), name), 0.0)
            least = ACCURACY * value.value if name in own else 0.0
            found[name] = replace(value, stderr=float(np.linalg.norm([value.stderr, spread, least])))
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
        if abs(hypothesis.mass_error) > 0.01:
            told.append(f"The mass differs by {100 * hypothesis.mass_error:.2g} % from the weighed one.")
        return told

    def own_blocks(self) -> dict[str, str]:
        """Texts of blocks that are not of the library, by class name."""
        return own_texts(term for term, _ in self.terms())

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
                f + np.abs(p.F - p.force_advanced(hypothesis.delay)) for f, p in zip(total, problem.parts, strict=True)
            ]
        for fault in self.faults:
            feigned = self._feigned(fault)
            total = [f + g for f, g in zip(total, feigned, strict=True)]
        return total

    def law(self) -> list[Array]:
        """The force of the laws that were named, added to R, per recording [N]: with its sign, unlike ``acting``."""
        problem, hypothesis = self.problem, self.choice.after.hypothesis
        terms = [term for term in hypothesis.terms if term.effect.id not in NUISANCES]
        return [
            np.sum([term.effect.force(s, term.values) for term in terms], axis=0) if terms else np.zeros(len(part))
            for part, s in zip(problem.parts, problem.signals(hypothesis), strict=True)
        ]

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


def _equals_a_constant(said: Semantics) -> bool:
    """Whether a law is a drift of the force channel that is constant in each recording."""
    return any(one.law == DRIFT and one.provided == "constant" for one in said.alike)


def values(fit: Fit, index: int, term: Term) -> dict[str, Value]:
    """Fitted parameters of a term with standard errors."""
    return {
        name: Value(float(value), fit.stderr((str(index), name)), term.effect.units.get(name, ""))
        for name, value in term.values.items()
    }


def refit_values(answer: Answer, fit: Fit) -> dict[str, Value]:
    """Baseline parameters after a fit; the mass carries the mass error, and a gain of the force channel."""
    base, found = answer.baseline, {}
    for name, value in fit.hypothesis.values.items():
        found[name] = Value(float(value), fit.stderr(("base", name)), base.units.get(name, ""))
    if "m" in found and "m" not in base.free:
        spread = fit.stderr(("chain", "mass_error")) * base.mass
        mass = fit.hypothesis.mass()
        if fit is answer.choice.after and GAIN in answer.names():
            mass *= 1 + answer.gain()
        found["m"] = Value(mass, spread, base.units.get("m", "kg"))
    return found


def describe(fault: Fault) -> str:
    """A fault in words."""
    if fault.id == DELAY:
        return f"channel {fault.channel} is {fault.size:.3g} samples late against the other channels"
    return f"channel {fault.channel} stops at {fault.size:.4g}, in {100 * fault.share:.2g} % of the samples"
