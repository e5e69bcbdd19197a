"""What a code generator hands to the FMU shell: variables, units, and C text that implements ``hy_model.h``.

Two generators exist: the Modelica compiler (``hystid.modelica``) and the network compiler (``hystid.surrogate``).
The shell (``hystid.fmu``) and the in-process runner (``hystid.compiled``) know only this type.
"""

from __future__ import annotations

import base64
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from math import inf
from typing import Any, Literal

Causality = Literal[
    "parameter", "calculatedParameter", "input", "output", "local", "independent", "structuralParameter"
]
Variability = Literal["constant", "fixed", "tunable", "discrete", "continuous"]


@dataclass(frozen=True)
class Enumeration:
    """A type whose values have names; the first item has the value 1."""

    name: str
    items: tuple[str, ...]


@dataclass(frozen=True)
class BuiltInText:
    """A String that is built into a model: it can be read, but what follows from it was decided by the compiler."""

    name: str
    content: str
    description: str = ""


@dataclass(frozen=True)
class Variable:
    """One variable in the words of the FMI standard.

    slot is its index in the value block of ``hy_model.h`` and its value reference; aliases share a slot.
    start is None where the standard forbids one. unit is a Modelica unit string ("N.s/m"), "" where there is none.
    derivative_of is the name of the state that this variable is the derivative of. enumeration: of an Integer whose
    values have names. shown: unit in which its author reads it, "" where nobody said.
    """

    name: str
    slot: int
    causality: Causality
    variability: Variability
    type: Literal["Real", "Integer", "Boolean"] = "Real"
    initial: Literal["exact", "approx", "calculated"] | None = None
    start: float | None = None
    min: float | None = None
    max: float | None = None
    nominal: float | None = None
    unit: str = ""
    description: str = ""
    derivative_of: str | None = None
    enumeration: Enumeration | None = field(default=None, repr=False)
    shown: str = ""

    @property
    def limits(self) -> tuple[float, float]:
        """Least and greatest value that it may have."""
        return -inf if self.min is None else float(self.min), inf if self.max is None else float(self.max)


@dataclass(frozen=True)
class Experiment:
    """Default experiment [s]."""

    start: float = 0.0
    stop: float = 1.0
    step: float = 1e-4
    tolerance: float | None = None


@dataclass(frozen=True)
class ModelCode:
    """A model ready for the shell.

    sources: file name -> C text; the one named ``model.c`` defines ``hy_the_model``.
    states: names of the continuous states in block order. n_indicators: number of event indicators.
    dependencies: name of an output or derivative -> names of what it depends on: inputs, states, parameters, "time".
    has_memory: the model has a ``completed_step``, which is called at accepted steps.
    sample: interval [s] at which that is called instead, as the clock of a sampled memory; None without one.
    jumps: a derivative jumps without an event; model exchange is not offered then, for solvers do not get past that.
    steps_are_samples: each step of co-simulation is a sample of a memory; model exchange is not offered then.
    resources: path below ``resources/`` -> bytes.
    reinit: names of the states that events may set anew; None where that is not known.
    unread: inputs that nothing in the model depends on.
    equations: what the documentation shows of the model, one line each.
    texts: Strings that are built in.
    arrays: inputs and outputs that are elements, as x[1], are listed as arrays (FMI 3.0).
    token: instantiation token (GUID), a hash of everything above.
    """

    name: str
    description: str
    variables: tuple[Variable, ...]
    sources: Mapping[str, str]
    states: tuple[str, ...] = ()
    n_indicators: int = 0
    n_values: int = 0
    dependencies: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    has_forward: bool = False
    has_adjoint: bool = False
    has_memory: bool = False
    sample: float | None = None
    steps_are_samples: bool = False
    jumps: bool = False
    experiment: Experiment = field(default_factory=Experiment)
    resources: Mapping[str, bytes] = field(default_factory=dict)
    token: str = ""
    arrays: bool = False
    reinit: tuple[str, ...] | None = None
    unread: tuple[str, ...] = field(default=(), repr=False)
    equations: tuple[str, ...] = field(default=(), repr=False)
    texts: tuple[BuiltInText, ...] = field(default=(), repr=False)

    @property
    def enumerations(self) -> tuple[Enumeration, ...]:
        """Types of its variables, each once, by name."""
        found = {v.enumeration for v in self.variables if v.enumeration is not None}
        return tuple(sorted(found, key=lambda enumeration: enumeration.name))

    def state_of(self, name: str) -> str:
        """The state that a variable is, under this name or another; "" where it is none."""
        slots = {v.name: v.slot for v in self.variables}
        return next((state for state in self.states if name in slots and slots.get(state) == slots[name]), "")

    def variable(self, name: str) -> Variable:
        """The named variable; KeyError when the model has none of that name."""
        for candidate in self.variables:
            if candidate.name == name:
                return candidate
        raise KeyError(name)


def code_data(code: ModelCode) -> dict[str, Any]:
    """What JSON can hold of a model; ``code_of`` makes an equal one of it."""
    resources = {name: base64.b64encode(content).decode() for name, content in code.resources.items()}
    return {**asdict(code), "resources": resources}


def code_of(data: Mapping[str, Any]) -> ModelCode:
    """The model that ``code_data`` was given."""
    reinit = data["reinit"]
    made = {
        "variables": tuple(map(_variable_of, data["variables"])),
        "states": tuple(data["states"]),
        "dependencies": {name: tuple(known) for name, known in data["dependencies"].items()},
        "experiment": Experiment(**data["experiment"]),
        "resources": {name: base64.b64decode(text) for name, text in data["resources"].items()},
        "reinit": None if reinit is None else tuple(reinit),
        "unread": tuple(data["unread"]),
        "equations": tuple(data.get("equations", ())),
        "texts": tuple(BuiltInText(**text) for text in data.get("texts", ())),
    }
    return ModelCode(**{**data, **made})


def _variable_of(data: Mapping[str, Any]) -> Variable:
    named = data.get("enumeration")
    return Variable(**{**data, "enumeration": named and Enumeration(named["name"], tuple(named["items"]))})
