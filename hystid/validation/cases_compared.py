"""What a validation answers.

Two questions are kept apart. Force: does the surrogate give the right R when it is shown the reference motion? Free
run: does m a = F - R, driven by the reference force alone, follow the reference? The second is the harder one, as
errors feed back.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, Literal

import numpy as np

from hystid.comparison import Harmonics, Spectrum, loop_energy, spectrum
from hystid.networks import FurtherInput
from hystid.recording import Array, Recording
from hystid.results import Result
from hystid.validation.stability import Stability
from hystid.validation.surrogate import Kind

AUDIBLE_DB = -60.0
"""Harmonics of the reference below this level are noise, not something that a surrogate is to match."""


@dataclass(frozen=True, eq=False)
class FreeRun:
    """Closed loop m a = F - R from the reference's own start and force. x, v, a, R: shape (n,), SI.

    x_nrmse, R_nrmse: fractions; x_mse [m2], R_mse [N2].
    """

    x: Array
    v: Array
    a: Array
    R: Array
    x_nrmse: float
    R_nrmse: float
    x_mse: float
    R_mse: float


@dataclass(frozen=True, eq=False)
class Levels:
    """Harmonics of R over the second half of the case, up to the tenth; free_run is None where there is none.

    Each has order, amplitude [N], level_db re its own fundamental, all of shape (orders,); fundamental [Hz].
    """

    reference: Harmonics
    force: Harmonics
    free_run: Harmonics | None

    def worst_odd_db(self, which: Literal["force", "free_run"]) -> float | None:
        """Largest difference [dB] of an odd harmonic up to the ninth that the reference has above -60 dB."""
        other = self.force if which == "force" else self.free_run
        if other is None:
            return None
        order, level = self.reference.order, self.reference.level_db
        heard = (order % 2 == 1) & (order > 1) & (order <= 9) & (level > AUDIBLE_DB)
        return float(np.max(np.abs(other.level_db - level)[heard], initial=0.0))


@dataclass(frozen=True, eq=False)
class ValidationCase:
    """One excitation. reference: t [s], F [N], x [m], v [m/s], a [m/s2], R [N], each (n,), measured or simulated.

    force: R [N] of the surrogate on the reference motion, (n,); force_nrmse (fraction), force_mse [N2].
    free_run: closed loop, None where there is no mass or no F, or where it diverged (then ``diverged`` says when).
    levels: harmonics of R, None unless the force (the motion, where F was not recorded) is one tone.
    outside: fraction of the samples whose x or v lies outside the training range. notes: sentences for the reader.
    """

    name: str
    reference: Recording
    force: Array
    force_nrmse: float
    force_mse: float
    free_run: FreeRun | None = None
    diverged: str = ""
    levels: Levels | None = None
    outside: float = 0.0
    notes: tuple[str, ...] = ()

    @cached_property
    def energy(self) -> dict[str, float]:
        """Work done against R over the whole case [J]: ``reference``, ``force`` and, where there is, ``free_run``."""
        x, R = self.reference.channel("x"), self.reference.channel("R")
        found = {"reference": loop_energy(x, R), "force": loop_energy(x, self.force)}
        return found | ({"free_run": loop_energy(self.free_run.x, self.free_run.R)} if self.free_run else {})

    @cached_property
    def spectra(self) -> dict[str, Spectrum]:
        """Power spectral density of R [N2/Hz] by ``reference``, ``force`` and, where there is one, ``free_run``."""
        signals = {"reference": self.reference.channel("R"), "force": self.force}
        signals |= {"free_run": self.free_run.R} if self.free_run else {}
        return {name: spectrum(values, self.reference.dt) for name, values in signals.items()}

    def as_dict(self) -> dict[str, Any]:
        """Entry of ``cases`` in validation.json."""
        run = self.free_run
        errors = ("x_nrmse", "R_nrmse", "x_mse", "R_mse")
        return {
            "name": self.name,
            "samples": len(self.reference),
            "sample_rate": self.reference.sample_rate,
            "force_nrmse": self.force_nrmse,
            "force_mse": self.force_mse,
            "free_run": {key: getattr(run, key) for key in errors} if run else None,
            **({"diverged": self.diverged} if self.diverged else {}),
            "energy": self.energy,
            "harmonics": _levels_summary(self.levels) if self.levels else None,
            "outside_training_range": self.outside,
            "notes": [*self.reference.notes, *self.notes],
        }


def _levels_summary(levels: Levels) -> dict[str, Any]:
    found = {"reference": levels.reference, "force": levels.force, "free_run": levels.free_run}
    return {
        "fundamental": levels.reference.fundamental,
        "order": levels.reference.order,
        **{f"{name}_db": part.level_db for name, part in found.items() if part},
        "worst_odd_db": {"force": levels.worst_odd_db("force"), "free_run": levels.worst_odd_db("free_run")},
    }


@dataclass(frozen=True, eq=False)
class Validation(Result, report="validation", json="validation.json"):
    """A surrogate compared with its reference, case by case.

    surrogate: the file; kind of it. against: the reference FMU, None for recordings. mass [kg], 0 where there is none.
    sample_rate [Hz] and training_range (least, greatest; by signal) are None and empty where the file does not tell.
    stability: see ``Stability``; None where the file tells no range. inputs: the further inputs of the surrogate.
    """

    surrogate: Path
    kind: Kind
    against: Path | None
    mass: float
    sample_rate: float | None
    training_range: Mapping[str, tuple[float, float]]
    cases: tuple[ValidationCase, ...]
    notes: tuple[str, ...] = ()
    stability: Stability | None = None
    inputs: tuple[FurtherInput, ...] = ()
    files: Mapping[str, Path] = field(default_factory=dict)

    @property
    def rotational(self) -> bool:
        """Whether the rig turns: x in rad, forces in N.m, the mass in kg.m2."""
        return self.cases[0].reference.rotational

    def figures(self, which: Literal["force_nrmse", "x_nrmse", "R_nrmse"]) -> Array:
        """That error of each case, shape (cases,): infinite where the free run diverged, NaN where there is none."""
        if which == "force_nrmse":
            return np.array([case.force_nrmse for case in self.cases])
        without = [np.inf if case.diverged else np.nan for case in self.cases]
        pairs = zip(self.cases, without, strict=True)
        return np.array([getattr(case.free_run, which) if case.free_run else value for case, value in pairs])

    @property
    def worst_odd_db(self) -> float | None:
        """Largest difference of an odd harmonic on the reference motion [dB]; None where no case is harmonic."""
        found = [case.levels.worst_odd_db("force") for case in self.cases if case.levels]
        return max((value for value in found if value is not None), default=None)

    def as_dict(self) -> dict[str, Any]:
        """The content of validation.json; errors are fractions."""
        keys: tuple[Literal["force_nrmse", "x_nrmse", "R_nrmse"], ...] = ("force_nrmse", "x_nrmse", "R_nrmse")
        return {
            "surrogate": self.surrogate.name,
            "kind": self.kind,
            "against": self.against.name if self.against else None,
            "mass": self.mass,
            "sample_rate": self.sample_rate,
            "training_range": self.training_range,
            "inputs": [{"name": p.name, "unit": p.unit, "column": p.column} for p in self.inputs],
            "metrics": {key: _median_and_worst(self.figures(key)) for key in keys},
            "cases": [case.as_dict() for case in self.cases],
            "stability": self.stability.as_dict() if self.stability else None,
            "notes": list(self.notes),
        }


def _median_and_worst(values: Array) -> dict[str, float | None]:
    known = values[~np.isnan(values)]
    return (
        {"median": float(np.median(known)), "worst": float(np.max(known))}
        if known.size
        else {"median": None, "worst": None}
    )
