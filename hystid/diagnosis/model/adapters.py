"""What a baseline may be: a Modelica class with or without the interfaces of hystid, or an FMU.

All of them answer the same two questions: which force belongs to a motion, and which motion to a force.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from hystid.compiled import Interpolation
from hystid.errors import UsageError
from hystid.fmu.coupling import simulate_with_effects
from hystid.fmu.door import open_fmu
from hystid.fmu.driver import Driver
from hystid.modelcode import ModelCode, Variable
from hystid.numeric import Array
from hystid.simulation import SUBSTEPS, driven

_LONG = 30_000  # samples from which a foreign FMU takes one step per sample: each costs a tenth of a millisecond
_MASSES = ("m", "mass", "M")


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
    ) -> dict[str, Array]:
        """Outputs (n,) while the states follow a motion (n,)."""

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


class FmuModel:
    """An FMU with the calls of a compiled model. given: names of parameters that somebody has given, in SI units."""

    def __init__(self, path: Path | str, given: Iterable[str] = ()) -> None:
        self.driver = Driver(path)
        self.code = self.driver.model
        self.driver.check_si(("F", "x", "v", "a", "R", mass_of(self.code.variables), *given))
        self.clamp = self.driver.clamp

    @property
    def holds(self) -> bool:
        """Whether its states can be held to a motion."""
        return self.driver.is_own or "ModelExchange" in self.driver.kinds

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
        """The FMU under inputs that are cubics between their samples, as ``validate`` and compiled models have them.

        An FMU takes straight lines, so it gets the cubics on the grid of ``substeps``, of four where fewer are asked.
        A foreign FMU with Model Exchange alone is integrated here: fixed steps, cubic inputs, nothing but x.
        """
        n = len(np.asarray(next(iter(inputs.values()))))
        if self.driver.is_own or "CoSimulation" in self.driver.kinds or tuple(outputs) != ("x",):
            table = {name: np.asarray(values, np.float64) for name, values in inputs.items()}
            steps = max(substeps, SUBSTEPS) if interpolation == "cubic" else 1
            t, names = np.arange(n, dtype=np.float64) * dt, tuple(outputs)
            if steps == 1 or not table:
                return self.driver.simulate(t, table, parameters=parameters, outputs=names)
            return driven(self.driver, table, t, parameters=parameters, outputs=names, substeps=steps)
        values = dict(parameters or {})
        start = values.pop("x", 0.0), values.pop("v", 0.0)
        rig, force = open_fmu(self.driver.path), np.asarray(inputs["F"], np.float64)
        steps = 2 if n < _LONG else 1
        return {"x": simulate_with_effects(rig, None, force, dt, parameters=values, start=start, substeps=steps)}


@dataclass(frozen=True)
class Reading:
    """How the restoring force is read from a model. force: variable R, or "" where it follows from the acceleration.

    acceleration: variable that holds dv/dt. mass: name of the parameter that is the mass, "" where there is none.
    """

    force: str
    acceleration: str
    mass: str


def reading_of(name: str, code: ModelCode) -> Reading:
    """Find R, or the acceleration, and the mass of a model. Raises UsageError where it is no such thing."""
    variables = {v.name: v for v in code.variables}
    force = variables.get("F")
    if force is None or force.causality != "input" or not {"x", "v"} <= set(code.states):
        states = ", ".join(code.states) or "none"
        raise UsageError(
            f"{name}: a baseline is one mass under a force, with the input F and the states x and v; its states are "
            f"{states}. Name them so, or extend HystId.Interfaces.PartialOscillator"
        )
    mass = mass_of(code.variables)
    if mass not in ("", "m") and "m" in variables and variables["m"].causality == "parameter":
        raise UsageError(f"{name}: its mass is {mass}, and m is another parameter: give that one another name")
    if "R" in variables:
        return Reading("R", "", mass)
    rate = next((v.name for v in variables.values() if v.derivative_of == "v"), "a" if "a" in variables else "")
    if not rate:
        raise UsageError(f"{name}: neither a restoring force R nor the acceleration a can be read: add an output R")
    return Reading("", rate, mass)


def is_fmu(model: str | Path) -> bool:
    """Whether a model is named by an FMU file."""
    return Path(str(model)).suffix.lower() == ".fmu"


def mass_of(variables: Sequence[Variable]) -> str:
    """The parameter that is the mass: m, mass or M in kg or without a unit, or else the only one in kg, or else one of
    these names; "" where there is none."""
    parameters = {v.name: v for v in variables if v.causality == "parameter" and v.type == "Real"}
    named = [name for name in _MASSES if name in parameters]
    weighed = [v.name for v in parameters.values() if v.unit == "kg"]
    fitting = [name for name in named if parameters[name].unit in ("", "kg")]
    return next(iter([*fitting, *(weighed if len(weighed) == 1 else ()), *named]), "")


def own_mass(name: str, model: Model, reading: Reading) -> float:
    """Mass [kg] of a model that has no parameter for it: force over the acceleration that it makes."""
    rest = {"x": np.zeros(3), "v": np.zeros(3)}
    pulled, free = (
        model.clamp(rest, {"F": np.full(3, force)}, 1e-6, outputs=(reading.acceleration,))[reading.acceleration][0]
        for force in (1.0, 0.0)
    )
    if not pulled > free:
        raise UsageError(f"{name}: its acceleration does not grow with the input F, so that it is not one mass under F")
    return float(1.0 / (pulled - free))
