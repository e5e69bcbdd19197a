"""A model's variables as FMI sees them: legal attributes, aliases grouped, derivatives of all states present.

Value references are slots of the value block. The rules are those of FMI 2.0.4, section 2.2.7, and FMI 3.0.1, section
2.4.7.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property

from hystid.errors import FmuError
from hystid.fmu.arrays import ArrayOf, arrays_of
from hystid.modelcode import BuiltInText, Causality, ModelCode, Variability, Variable

_RANK = {"input": 0, "output": 1, "parameter": 2, "calculatedParameter": 3, "local": 4}
# Sizes of states in structures that vibrate, where a model declares none: too small a value costs a solver steps, too
# large a value accuracy.
_USUAL = {"m": 1e-3, "m/s": 0.1, "m/s2": 10.0, "N": 10.0, "rad": 1e-2, "rad/s": 1.0, "N.m": 1.0}
_IDENTIFIER = re.compile(r"[^A-Za-z0-9_]")


@dataclass(frozen=True)
class Interface:
    """What an importer sees of a model. ``variables`` is in declaration order, the independent variable first."""

    code: ModelCode
    variables: tuple[Variable, ...]

    @property
    def identifier(self) -> str:
        """File name of the binaries: the model's name as a C identifier."""
        name = _IDENTIFIER.sub("_", self.code.name)
        return name if not name[:1].isdigit() else f"_{name}"

    @property
    def offers_model_exchange(self) -> bool:
        """Not where each step is a sample of a memory, nor where a derivative jumps without an event: solvers try
        steps and repeat them."""
        return not (self.code.steps_are_samples or self.code.jumps)

    @property
    def needs_completed_steps(self) -> bool:
        """Whether an importer has to tell the end of each step of its solver."""
        return self.code.has_memory and self.code.sample is None

    @cached_property
    def groups(self) -> dict[int, tuple[Variable, ...]]:
        """Slot -> the variables that share it, the one to be listed first (input, output, parameter, ...) in front."""
        found: dict[int, list[Variable]] = {}
        for variable in self.variables:
            found.setdefault(variable.slot, []).append(variable)
        return {slot: tuple(sorted(group, key=_rank)) for slot, group in found.items()}

    @cached_property
    def arrays(self) -> Mapping[int, ArrayOf]:
        """Slot of the first element -> array, where inputs and outputs are listed so."""
        single = (v for v in self.variables if len(self.groups[v.slot]) == 1)
        return arrays_of(single) if self.code.arrays else {}

    @cached_property
    def first_slots(self) -> Mapping[int, int]:
        """Slot -> value reference of the variable that it belongs to: its own, or that of the array around it."""
        inside = {v.slot: first for first, array in self.arrays.items() for v in array.elements}
        return {slot: inside.get(slot, slot) for slot in self.groups}

    @cached_property
    def state_slots(self) -> tuple[int, ...]:
        """Slots of the continuous states in block order."""
        return tuple(self.named(name).slot for name in self.code.states)

    @cached_property
    def derivatives(self) -> tuple[Variable, ...]:
        """The variable that is the derivative of each state, in block order."""
        by_state = {v.derivative_of: v for v in self.variables if v.derivative_of is not None}
        missing = [name for name in self.code.states if name not in by_state]
        if missing:
            raise FmuError(f"{self.code.name}: no variable is declared as the derivative of state '{missing[0]}'")
        return tuple(by_state[name] for name in self.code.states)

    @property
    def texts(self) -> Iterator[tuple[int, BuiltInText]]:
        """Strings that are built in, with the value references that come after those of the event indicators."""
        return enumerate(self.code.texts, self.code.n_values + self.code.n_indicators)

    @property
    def outputs(self) -> tuple[Variable, ...]:
        """Variables of causality output."""
        return tuple(v for v in self.variables if v.causality == "output")

    @property
    def inputs(self) -> tuple[Variable, ...]:
        """Variables of causality input."""
        return tuple(v for v in self.variables if v.causality == "input")

    def named(self, name: str) -> Variable:
        """The named variable; FmuError when there is none."""
        for variable in self.variables:
            if variable.name == name:
                return variable
        raise FmuError(f"{self.code.name} has no variable '{name}'")

    def initial_unknowns(self) -> Iterator[Variable]:
        """What initialization computes: outputs, calculated parameters, states and derivatives that are not given."""
        needed = {*self.state_slots, *(d.slot for d in self.derivatives)}
        for variable in self.variables:
            computed = variable.initial in ("calculated", "approx")
            wanted = variable.causality in ("output", "calculatedParameter") or (
                variable.slot in needed and (variable.name in self.code.states or variable.derivative_of)
            )
            if computed and wanted:
                yield variable

    def known(self, variable: Variable, version: int) -> tuple[int, ...] | None:
        """Slots of the knowns that an output or derivative depends on; None where that is not known.

        Knowns are inputs, continuous states and time; in FMI 3.0 parameters and discrete states, too.
        """
        names = self.code.dependencies.get(variable.name)
        if names is None:
            return None
        allowed = {0, *(v.slot for v in self.inputs), *self.state_slots}
        if version == 3:
            allowed |= {v.slot for v in self.variables if v.causality == "parameter" or _is_discrete_state(v)}
        slots = {v.slot for v in self.variables if v.name in names} | ({0} if "time" in names else set())
        return tuple(sorted(slots & allowed))

    def reinitialised(self, state: str) -> bool:
        """Whether an event may set the state anew; taken as possible where the generator does not say."""
        if self.code.reinit is not None:
            return state in self.code.reinit
        return self.code.n_indicators > 0


def interface(code: ModelCode) -> Interface:
    """Complete and legal list of the model's variables."""
    variables = [_legal(variable) for variable in code.variables if variable.slot != 0]
    named_time = next((v for v in code.variables if v.slot == 0), None)
    time = Variable(named_time.name if named_time else "time", 0, "independent", "continuous", unit="s")
    if any(v.name == time.name for v in variables):
        time = replace(time, name="time_of_the_simulation")
    listed = _one_unit_per_slot(_one_start_per_slot(variables))
    return Interface(code, (time, *(_with_nominal(v) if v.name in code.states else v for v in listed)))


def _with_nominal(v: Variable) -> Variable:
    """A state with a nominal value: solvers take their absolute tolerance from it, and 1 m hides a motion of 1 mm."""
    if v.nominal or v.type != "Real" or v.unit not in _USUAL:
        return v
    return replace(v, nominal=max(_USUAL[v.unit], abs(v.start or 0.0)))


def _is_discrete_state(v: Variable) -> bool:
    return v.variability == "discrete" and v.causality in ("local", "output")


def _rank(variable: Variable) -> tuple[int, bool]:
    return _RANK.get(variable.causality, 9), variable.start is None


def _legal(v: Variable) -> Variable:
    if v.enumeration:
        v = replace(v, min=1.0, max=float(len(v.enumeration.items)))
    if v.causality == "structuralParameter" or v.variability == "constant":
        causality: Causality = "output" if v.causality == "output" else "local"
        return replace(v, causality=causality, variability="constant", initial="exact", start=_start(v))
    if v.causality == "parameter":
        return replace(v, variability=_fixed_or_tunable(v), initial="exact", start=_start(v))
    if v.causality == "calculatedParameter":
        return replace(v, variability=_fixed_or_tunable(v), initial="calculated", start=None)
    variability: Variability = "discrete" if v.type != "Real" else v.variability
    if v.causality == "input":
        return replace(v, variability=variability, initial=None, start=_start(v))
    if v.variability in ("fixed", "tunable") and v.causality == "output":
        variability = "discrete"  # an output may not be a parameter
    initial = v.initial or ("exact" if v.start is not None else "calculated")
    start = None if initial == "calculated" else _start(v)
    return replace(v, variability=variability, initial=initial, start=start)


def _fixed_or_tunable(v: Variable) -> Variability:
    return "tunable" if v.variability == "tunable" else "fixed"


def _start(variable: Variable) -> float:
    return (variable.min or 0.0 if variable.enumeration else 0.0) if variable.start is None else variable.start


def _one_start_per_slot(variables: list[Variable]) -> list[Variable]:
    """Of several names of one value only the first in rank may be set; the others are computed."""
    keeper: dict[int, Variable] = {}
    for variable in sorted(variables, key=_rank):
        keeper.setdefault(variable.slot, variable)
    return [
        v
        if keeper[v.slot] is v or (v.causality != "local" and v.causality != "output")
        else _computed(v, keeper[v.slot])
        for v in variables
    ]


def _one_unit_per_slot(variables: list[Variable]) -> list[Variable]:
    """Several names of one value have one unit, of the first in rank that has one: ``Real y = w`` declares none."""
    units: dict[int, str] = {}
    for variable in sorted(variables, key=_rank):
        units[variable.slot] = units.get(variable.slot) or variable.unit
    return [replace(v, unit=units[v.slot]) for v in variables]


def _computed(v: Variable, keeper: Variable) -> Variable:
    if v.variability == "constant":
        return v
    if keeper.causality in ("parameter", "input") or keeper.start is not None:
        return replace(v, initial="calculated", start=None)
    return v
