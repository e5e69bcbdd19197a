"""What a diagnosis says: plain data, and the JSON that stands in ``diagnosis.json``."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from hystid.diagnosis.decide.answer import Verdict
from hystid.diagnosis.decide.criterion import Posterior
from hystid.diagnosis.decide.selection import Choice
from hystid.diagnosis.fit.hypothesis import Fit
from hystid.diagnosis.fit.periodic import PeriodicForce
from hystid.diagnosis.fit.problem import Problem
from hystid.diagnosis.fit.value import Value
from hystid.diagnosis.model.catalogue import Catalogue
from hystid.diagnosis.prove.unchanged import Unchanged
from hystid.diagnosis.tell.dependence import Dependence
from hystid.numeric import Array
from hystid.results import Result
from hystid.rotation import turned_text

_LISTED_CANDIDATES = 8  # candidates


@dataclass(frozen=True)
class Where:
    """Where an effect acts. x [m], v [m/s]: range of the motion in which it does; t: intervals [s] per recording;
    begins: displacements [m] beyond which it acts, where it has a gap."""

    text: str
    x: tuple[float, float]
    v: tuple[float, float]
    t: Mapping[str, Sequence[tuple[float, float]]]
    amplitude: Mapping[str, float]
    harmonics: str
    begins: tuple[float, ...] = ()

    def as_dict(self) -> dict[str, Any]:
        """For JSON; ``t`` holds the intervals of the recording in which the effect is strongest."""
        first = next(iter(self.t.values()), [])
        return {
            "text": self.text, "x": list(self.x), "v": list(self.v), "t": [list(span) for span in first],
            "t_per_recording": {name: [list(span) for span in spans] for name, spans in self.t.items()},
            "amplitude": dict(self.amplitude), "harmonics": self.harmonics,
        }  # fmt: skip


@dataclass(frozen=True)
class Finding:
    """One named effect. id and what cannot be told from it; confidence 0..1; evidence: figures behind the name.

    title: the display name of it and what cannot be told from it. sentence: what its block says of itself.
    roles: meaning -> name of the parameter, as declared.
    """

    effect: str
    alike: tuple[str, ...]
    confidence: float
    parameters: Mapping[str, Value]
    where: Where
    evidence: Mapping[str, Any]
    explained: float = float("nan")
    title: str = ""
    roles: Mapping[str, str] = field(default_factory=dict)
    sentence: str = ""

    @property
    def threshold(self) -> Value | None:
        """Displacement at which the effect sets in, None where it has none."""
        return self.parameters.get(self.roles.get("threshold", ""))

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        return {
            "effect": self.effect, "title": self.title, "sentence": self.sentence,
            "class": list(self.alike), "confidence": self.confidence,
            "parameters": {name: value.as_dict() for name, value in self.parameters.items()},
            "where": self.where.as_dict(), "evidence": dict(self.evidence),
            "explained": self.explained if np.isfinite(self.explained) else None,
        }  # fmt: skip


@dataclass(frozen=True)
class Errors:
    """Error of one recording before (refitted baseline) and after (with what was found); None where it has no
    answer."""

    name: str
    force: tuple[float, float]
    free_run: tuple[float | None, float | None]


@dataclass(frozen=True)
class Traces:
    """Signals of one recording for tables and plots, shape (n,) each, SI units.

    residual: what the refitted baseline leaves of the balance; left: what is left in the end; effect: force of the
    laws that were named, which with ``left`` is what the baseline of the final fit lacks.
    free_before, free_after: displacement in free run, None where there is none.
    """

    name: str
    t: Array
    x: Array
    v: Array
    R: Array
    residual: Array
    left: Array
    effect: Array
    score: Array
    noise: float
    free_before: Array | None = None
    free_after: Array | None = None
    held_out: bool = False


@dataclass(frozen=True)
class Diagnosis(Result, report="diagnosis", json="diagnosis.json"):
    """The answer. findings: strongest first. unknown: location and laws of a mismatch without a name.

    dependence: further columns of the recordings on which what is left depends, the strongest first. catalogue: what
    the effects declare of themselves. values: parameters of the baseline in the end, fitted together with what was
    found. rotational: whether the rig turns, x in rad, forces in N.m and the mass in kg.m2.
    misread: labels of the recordings that cannot be right, and how they were read instead. doubts: filters,
    drift and clocks of channels, which may look like physics.
    changed: what differs between recordings that each agree with the model by themselves.
    as_given: errors of an FMU before anything is fitted, those of ``validate``. lines: periodic forces that nobody
    measured, taken out of the balance and no part of the free runs. extended: text of the extended model.
    """

    verdict: Verdict
    headline: str
    model: str
    nominal: Mapping[str, float]
    refit: Mapping[str, Value]
    findings: tuple[Finding, ...] = ()
    errors: tuple[Errors, ...] = ()
    holdout: tuple[Errors, ...] = ()
    untestable: tuple[str, ...] = ()
    next_experiment: str = ""
    force_nrmse: tuple[float, float] = (float("nan"), float("nan"))
    noise_floor: float = float("nan")
    unknown: Where | None = None
    notes: tuple[str, ...] = ()
    chain: Mapping[str, Any] = field(default_factory=dict)
    traces: tuple[Traces, ...] = field(default=(), repr=False)
    choice: Choice | None = field(default=None, repr=False)
    problem: Problem | None = field(default=None, repr=False)
    final: Fit | None = field(default=None, repr=False)
    posterior: Posterior | None = field(default=None, repr=False)
    folder: Path | None = None
    dependence: tuple[Dependence, ...] = ()
    catalogue: Catalogue = field(default_factory=Catalogue, repr=False)
    values: Mapping[str, Value] = field(default_factory=dict)
    rotational: bool = False
    misread: tuple[str, ...] = ()
    doubts: tuple[str, ...] = ()
    as_given: tuple[Unchanged, ...] = ()
    lines: tuple[PeriodicForce, ...] = ()
    changed: str = ""
    extended: str | None = field(default=None, repr=False)

    def _write(self, folder: Path) -> None:
        import_module("hystid.diagnosis.tell.written").written(self, folder)  # which knows this type

    def sentence(self) -> str:
        """The verdict and what stands behind it, in one line."""
        return f"{self.verdict}: {self.headline}"

    def as_dict(self) -> dict[str, Any]:
        """Content of ``diagnosis.json``."""
        runs = [e.free_run for e in self.errors]
        both = [(b, a) for b, a in runs if b is not None and a is not None]
        return {
            "verdict": self.verdict,
            "headline": self.headline,
            "baseline": {
                "model": self.model,
                "parameters": dict(self.nominal),
                "refit": {name: value.as_dict() for name, value in self.refit.items()},
                "force_nrmse": self.force_nrmse[0],
                "noise_floor": self.noise_floor,
                "as_given": [
                    {"name": one.name, "force_nrmse": one.force, "free_run_x_nrmse": one.free_run}
                    for one in self.as_given
                ],
            },
            "findings": [finding.as_dict() for finding in self.findings],
            "final": {"parameters": {name: value.as_dict() for name, value in self.final_values().items()}},
            "unknown": self.unknown.as_dict() if self.unknown else None,
            "fit": {
                "force_nrmse": {"before": self.force_nrmse[0], "after": self.force_nrmse[1]},
                "free_run_x_nrmse": {
                    "before": float(np.mean([b for b, _ in both])) if both else None,
                    "after": float(np.mean([a for _, a in both])) if both else None,
                    "per_recording": [_errors(e) for e in self.errors],
                },
                "holdout": [_errors(e) for e in self.holdout],
            },
            **self._probabilities(),
            "untestable": list(self.untestable),
            "next_experiment": self.next_experiment,
            "chain": dict(self.chain),
            "unmeasured_forces": [line.as_dict() for line in self.lines],
            "dependence": [one.as_dict() for one in self.dependence],
            "misread": list(self.misread),
            "doubts": list(self.doubts),
            "notes": list(self.notes),
        }

    def final_values(self) -> dict[str, Value]:
        """Every parameter of model and findings in the end; those of a finding as ``effect.parameter``."""
        found = {f"{f.effect}.{name}": value for f in self.findings for name, value in f.parameters.items()}
        return {**(self.values or self.refit), **found}

    def title_of(self, names: Sequence[str]) -> str:
        """Display name of some ids that act together, each under the name of its class."""
        shown = {alike: finding.title for finding in self.findings for alike in finding.alike if finding.title}
        told = (shown.get(name) or self.catalogue.class_title([name, *self._equal(name, names)]) for name in names)
        joined = " and ".join(dict.fromkeys(told))
        return turned_text(joined) if self.rotational else joined

    def _equal(self, name: str, beside: Sequence[str]) -> tuple[str, ...]:
        return tuple(other for other in self.catalogue.equal(name, beside) if other != name)

    def candidates(self) -> list[dict[str, Any]]:
        """What it could be, most probable first: one entry, and one display name, for what is one class."""
        merged: dict[str, dict[str, Any]] = {}
        for c in self.posterior.candidates if self.posterior is not None else ():
            title = self.title_of(c.names)
            new = {"effect": " + ".join(c.names), "title": title, "probability": 0.0, "explained": c.explained}
            known = merged.setdefault(title, new)
            known["probability"] = min(1.0, known["probability"] + c.probability)
        return sorted(merged.values(), key=lambda one: -one["probability"])[:_LISTED_CANDIDATES]

    def _probabilities(self) -> dict[str, Any]:
        """How probable it is that something is missing, and what; nothing where no selection was made."""
        if self.posterior is None:
            return {}
        p = self.posterior
        told = {"something_missing": p.something, "nothing_missing": p.nothing, "unknown": p.unknown}
        return {"probability": told, "candidates": self.candidates()}


def _errors(e: Errors) -> dict[str, Any]:
    return {
        "name": e.name, "before": e.free_run[0], "after": e.free_run[1],
        "force_before": e.force[0], "force_after": e.force[1],
    }  # fmt: skip
