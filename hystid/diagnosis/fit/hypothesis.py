"""A hypothesis: values of the baseline, of the recording chain and of the effects; and what its fit is."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from hystid.diagnosis.model.channel_effects import ChannelEffect
from hystid.diagnosis.model.effects import Effect
from hystid.numeric import Array

Key = tuple[str, str]


@dataclass(frozen=True)
class Term:
    """One effect with its parameters (amplitudes, shapes, choices)."""

    effect: Effect
    values: Mapping[str, float]

    @property
    def law(self) -> Term:
        """The same law, acting all the time."""
        return Term(self.effect.law, self.effect.law_values(self.values))

    @property
    def key(self) -> tuple[object, ...]:
        """What its force depends on beside the motion."""
        return self.effect.class_name, self.effect.id, self.effect.form, tuple(self.values.items())


@dataclass(frozen=True)
class Hypothesis:
    """Baseline values, delay of the force channel [samples], mass error (share of m), and effects.

    late: the delay may be larger than every rig has.
    """

    values: Mapping[str, float]
    terms: tuple[Term, ...] = ()
    delay: float = 0.0
    mass_error: float = 0.0
    late: bool = False

    def mass(self) -> float:
        """Mass in the balance [kg]."""
        return float(self.values.get("m", 0.0)) * (1.0 + self.mass_error)

    def parameters(self) -> dict[str, float]:
        """Values of the baseline, the mass as the balance has it."""
        return {**self.values, **({"m": self.mass()} if "m" in self.values else {})}

    def beside(self, *terms: Term) -> Hypothesis:
        """The same with further effects."""
        return replace(self, terms=(*self.terms, *terms))

    def without(self, at: int) -> Hypothesis:
        """The same without one of the effects."""
        terms = list(self.terms)
        del terms[at]
        return replace(self, terms=tuple(terms))

    def exchanged(self, at: int, other: Term) -> Hypothesis:
        """The same with another effect in the place of one."""
        terms = list(self.terms)
        terms[at] = other
        return replace(self, terms=tuple(terms))

    def elsewhere(self) -> Hypothesis:
        """The same without the faults of the force channel, which differ from recording to recording."""
        return replace(self, terms=tuple(term for term in self.terms if not isinstance(term.effect, ChannelEffect)))


@dataclass(frozen=True)
class Unknown:
    """One unknown: key, whether it is fitted on a logarithmic scale, its range, and its scale for steps from zero."""

    key: Key
    log: bool = False
    low: float = -np.inf
    high: float = np.inf
    linear: bool = False

    def within(self, value: float) -> float:
        """The value, or the bound that it is beyond."""
        return self.low if value < self.low else self.high if value > self.high else value


@dataclass(frozen=True)
class Fit:
    """A fitted hypothesis: rows of the residual (unit noise), their mean square, and the scaled Jacobian's
    covariance."""

    hypothesis: Hypothesis
    residual: Array = field(repr=False)
    chi2: float
    unknowns: tuple[Unknown, ...] = ()
    covariance: Array | None = field(default=None, repr=False)

    @property
    def rss(self) -> float:
        """Sum of squares of the weighted residual."""
        return float(self.residual @ self.residual)

    def stderr(self, key: Key) -> float:
        """Standard error of an unknown in its own unit; NaN where it was not fitted. Scaled by the residual level."""
        for i, unknown in enumerate(self.unknowns):
            if unknown.key == key and self.covariance is not None:
                spread = float(np.sqrt(max(self.covariance[i, i], 0.0) * max(self.chi2, 1.0)))
                return spread * abs(get(self.hypothesis, key)) if unknown.log else spread
        return float("nan")


def is_source(effect: Effect) -> bool:
    """Whether an effect is hysteresis itself, which others weaken or pinch."""
    return effect.semantics.hysteretic


def is_mass(effect: Effect) -> bool:
    """Whether an effect is mass, of which a mass error is a small case."""
    return bool(effect.semantics.mass)


def is_allowed(hypothesis: Hypothesis) -> bool:
    """Whether no amplitude is larger than its block allows."""
    return all(
        term.values[name] <= highest
        for term in hypothesis.terms
        for name, highest in term.effect.highest.items()
        if name in term.effect.amplitudes
    )


def get(hypothesis: Hypothesis, key: Key) -> float:
    """Value of an unknown."""
    kind, name = key
    if kind == "base":
        return float(hypothesis.values[name])
    if kind == "chain":
        return float(getattr(hypothesis, name))
    return float(hypothesis.terms[int(kind)].values[name])


def put(hypothesis: Hypothesis, changes: Mapping[Key, float]) -> Hypothesis:
    """Copy with some unknowns changed."""
    values, chain = dict(hypothesis.values), {"delay": hypothesis.delay, "mass_error": hypothesis.mass_error}
    terms = [dict(term.values) for term in hypothesis.terms]
    for (kind, name), value in changes.items():
        target = values if kind == "base" else chain if kind == "chain" else terms[int(kind)]
        target[name] = value
    made = tuple(replace(term, values=new) for term, new in zip(hypothesis.terms, terms, strict=True))
    return Hypothesis(values, made, chain["delay"], chain["mass_error"], hypothesis.late)
