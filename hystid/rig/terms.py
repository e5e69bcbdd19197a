"""A rig that recordings can be held against: one mass under a force, m a + R = F, in Modelica or as an FMU.

Where its motion, its restoring force and its mass stand, and which of its parameters a fit may move.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from difflib import get_close_matches
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from hystid.compiled import Interpolation
from hystid.errors import UsageError
from hystid.modelcode import ModelCode, Variable
from hystid.modelica_text import array_of
from hystid.numeric import Array

_MASSES = ("m", "mass", "M")
_INERTIAS = ("kg", "kg.m2")  # of a rig that moves, and of one that turns
_SAME_MASS = 1e-6  # of a mass: what rounding leaves of a force over an acceleration


class Model(Protocol):
    """What is asked of a model in this process."""

    code: ModelCode

    def clamp(
        self,
        states: Mapping[str, ArrayLike],
        inputs: Mapping[str, ArrayLike],
        dt: float,
        *,
        parameters: Mapping[str, float] | None = None,
        outputs: Iterable[str],
        substeps: int = 1,
        sensitivities: Sequence[str] = (),
    ) -> dict[str, Array]:
        """Outputs (n,) while the states follow a motion (n,), and their derivatives to parameters."""

    def simulate(
        self,
        inputs: Mapping[str, ArrayLike],
        dt: float,
        *,
        parameters: Mapping[str, float] | None = None,
        outputs: Iterable[str],
        interpolation: Interpolation = "cubic",
        substeps: int = 1,
    ) -> dict[str, Array]:
        """Outputs (n,) under inputs (n,)."""


def is_fmu(model: str | Path) -> bool:
    """Whether a model is named by an FMU file."""
    return Path(str(model)).suffix.lower() == ".fmu"


@dataclass(frozen=True)
class Reading:
    """Where the parts of m a + R = F stand in a model.

    states: names of the states that are x and v. force: variable R, or "" where it follows from the acceleration.
    acceleration: variable that holds dv/dt. mass: name of the parameter that is the mass, "" where there is none: then
    it is ``inner`` [kg], 0 for a law without inertia. heavy: parameters that it is, or follows from.
    """

    states: tuple[str, str]
    force: str
    acceleration: str
    mass: str
    inner: float = 0.0
    heavy: frozenset[str] = frozenset()

    def motion(self, x: Array, v: Array) -> dict[str, Array]:
        """A motion by the names of the states."""
        return dict(zip(self.states, (x, v), strict=True))

    def asked(self, n: int) -> tuple[str, dict[str, Array]]:
        """The variable that R is read from, and the inputs beside a motion of n samples."""
        return (self.force, {}) if self.force else (self.acceleration, {"F": np.zeros(n)})

    def factor(self, settings: Mapping[str, float]) -> float:
        """R over the variable that it is read from."""
        return 1.0 if self.force else -(self.inner or settings[self.mass])


def reading_of(name: str, model: Model, given: Mapping[str, float]) -> Reading:
    """Find the motion, R or the acceleration, and the mass of a model. Raises UsageError where it is no such thing.

    given: values of its parameters; the mass of a model without one may follow from them.
    """
    code = model.code
    variables = {v.name: v for v in code.variables}
    force, x, v = variables.get("F"), code.state_of("x"), code.state_of("v")
    if force is None or force.causality != "input" or not (x and v):
        states = ", ".join(code.states) or "none"
        raise UsageError(
            f"{name}: a rig is one mass under a force, with the input F and the states x and v; its states are "
            f"{states}. Name them so, or extend HystId.Interfaces.PartialOscillator"
        )
    rate = next((u.name for u in code.variables if u.derivative_of == v), "a")
    mass = mass_of(code.variables)
    found = Reading((x, v), "R" if "R" in variables else "", rate, mass, heavy=frozenset([mass]))
    if not (found.mass and found.force):
        found = _weighed(name, model, found, given)
    if found.mass != "m" and (found.mass or found.inner) and variables.get("m", force).causality == "parameter":
        mass = found.mass or f"{found.inner:g} kg"
        raise UsageError(f"{name}: its mass is {mass}, and m is another parameter: give that one another name")
    return found


def _weighed(name: str, model: Model, found: Reading, given: Mapping[str, float]) -> Reading:
    """A reading with the mass that the acceleration under a force tells, where its parameter is not that."""
    at = {v.name: given.get(v.name, v.start or 0.0) for v in real_parameters(model.code)}
    if found.mass:  # a rig is asked with some mass
        at[found.mass] = model.code.variable(found.mass).start or 1.0
    inner = _inertia(model, found, at)
    if not (inner or found.force):
        raise UsageError(f"{name}: its acceleration does not grow with the input F, so that it is not one mass under F")
    if not inner or np.isclose(inner, at.get(found.mass, 0.0), rtol=_SAME_MASS, atol=0):
        return found
    moved = {key: _inertia(model, found, {**at, key: 1.1 * value or 1.0}) for key, value in at.items()}
    heavy = frozenset(key for key, mass in moved.items() if not np.isclose(mass, inner, rtol=_SAME_MASS, atol=0))
    return replace(found, mass="", inner=inner, heavy=heavy)


def _inertia(model: Model, reading: Reading, values: Mapping[str, float]) -> float:
    """Mass [kg] by the force over the acceleration that it makes; 0 where it makes none."""
    rest, rate = reading.motion(np.zeros(3), np.zeros(3)), reading.acceleration
    pulled, free = (
        model.clamp(rest, {"F": np.full(3, force)}, 1e-6, parameters=values, outputs=(rate,))[rate][0]
        for force in (1.0, 0.0)
    )
    return float(1.0 / (pulled - free)) if pulled > free else 0.0


def mass_of(variables: Sequence[Variable]) -> str:
    """The parameter that is the mass: m, mass or M in kg or without a unit, or else the only one in kg, or in kg.m2 of
    a rig that turns, or else one of these names; "" where there is none."""
    parameters = {v.name: v for v in variables if v.causality == "parameter" and v.type == "Real"}
    named = [name for name in _MASSES if name in parameters]
    fitting = [name for name in named if parameters[name].unit in ("", *_INERTIAS)]
    weighed = [[v.name for v in parameters.values() if v.unit == unit] for unit in _INERTIAS]
    alone = [names[0] for names in weighed if len(names) == 1]
    return next(iter([*fitting, *alone, *named]), "")


def real_parameters(code: ModelCode) -> list[Variable]:
    """What a fit may move: start values and sizes of arrays are not among them."""
    real = [v for v in code.variables if v.causality == "parameter" and v.type == "Real"]
    return [v for v in real if not _is_start(v.name, code.states)]


def _is_start(name: str, states: Sequence[str]) -> bool:
    """Whether a parameter says where a state begins: "x_start", also of a component; "k_start" is a stiffness."""
    whole = array_of(name)
    begins = whole.removesuffix("_start")
    return begins != whole and (begins in map(array_of, states) or begins.rpartition(".")[2] in ("x", "v"))


def check_values(name: str, given: Mapping[str, float], parameters: Mapping[str, Variable | None]) -> None:
    """Raise UsageError for a value of no parameter, or beyond the limits of its own; None stands for a mass without."""
    for key in sorted(set(given) - set(parameters)):
        known = sorted(parameters)
        near = get_close_matches(key, known, 1, 0.5) or [k for k in known if k.lower() == key.lower()]
        hint = f" (did you mean '{near[0]}'?)" if near else ""
        raise UsageError(f"{name} has no parameter '{key}'{hint}; it has {', '.join(known)}")
    for key, value in given.items():
        low, high = variable.limits if (variable := parameters[key]) else (0.0, np.inf)
        if not low <= value <= high:
            raise UsageError(f"{name}: parameter {key} = {value:g} is outside its range [{low:g}, {high:g}]")


def starts_of(code: ModelCode) -> tuple[str, str]:
    """What sets where x and v begin: parameters for it, or else the states themselves."""
    known = {v.name for v in code.variables if v.causality == "parameter"}
    x, v = (f"{s}_start" if f"{s}_start" in known else s for s in (code.state_of(n) or n for n in "xv"))
    return x, v


def check_starts(name: str, code: ModelCode) -> None:
    """Free runs begin where a recording does: refuses a model that computes where it begins from something else."""
    for state in starts_of(code):
        if code.variable(state).initial == "calculated":
            raise UsageError(
                f"{name}: the start of {state} is computed, so that no recording can set it: write "
                f"{state}(start = {state}_start, fixed = true), with the parameter {state}_start"
            )
