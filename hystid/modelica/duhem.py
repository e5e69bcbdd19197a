"""Rate-independent states, recognised by their equations: on a given motion they follow curves over its way."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from hystid.modelica.blocks import Assign, sources, targets
from hystid.modelica.event_model import der
from hystid.modelica.expr import RELATIONS, Expr, Num, Op, Ref
from hystid.modelica.hybrid import HybridModel

_ALIKE = RELATIONS | {"+", "-", "min", "max", "atan2"}  # operations on arguments that grow alike with the speed
_DIRECTIONS = RELATIONS | {"atan2"}  # of these, those whose outcome does not grow
_UNCHANGED = frozenset({"neg", "abs", "noEvent"})


@dataclass(frozen=True)
class DuhemState:
    """A state with der(state) = g(state, sign(speed)) |speed|; speed is another state, or an input."""

    state: str
    speed: str


class _Other(Exception):
    """An expression that does not grow with a power of the speed."""


def duhem_states(model: HybridModel) -> tuple[DuhemState, ...]:
    """All rate-independent states of a model; none where something happens at instants."""
    happens = bool(model.relations or model.discrete or model.samplers or model.reinits or model.checks)
    if happens or model.assertions or model.delays:
        return ()
    return tuple(found for state in model.states for found in _speeds(model, state))


def _speeds(model: HybridModel, state: str) -> list[DuhemState]:
    parameters = {*model.settable, *model.computed}
    known = {name: frozenset({name}) for name in (*model.states, *model.inputs)} | dict.fromkeys(
        parameters, frozenset()
    )
    for step in model.derivatives:
        needs = frozenset[str]().union(*(known.get(name, {name}) for name in sources(step)))
        known |= dict.fromkeys(targets(step), needs)
    others = known[der(state)] - {state}
    if len(others) != 1 or not others <= {*model.states, *model.inputs}:
        return []
    (speed,) = others
    return [DuhemState(state, speed)] if _grows_with(model, state, speed, parameters) else []


def _grows_with(model: HybridModel, state: str, speed: str, parameters: set[str]) -> bool:
    """Whether the derivative of a state is proportional to the speed, either sense of it by itself."""
    powers: dict[str, float | None] = {**dict.fromkeys(parameters, 0.0), state: 0.0, speed: 1.0}
    for step in model.derivatives:
        if isinstance(step, Assign):
            try:
                powers[step.variable] = _power(step.value, powers)
            except _Other:
                continue
    return powers.get(der(state)) == 1.0


def _power(expr: Expr, powers: Mapping[str, float | None]) -> float | None:
    """n where the expression grows with speed^n when the speed grows and keeps its sign; None for 0, which grows with
    any. Raises _Other where there is no such n."""
    match expr:
        case Num(value):
            return 0.0 if value else None
        case Ref(name) if name in powers:
            return powers[name]
        case Op(name, args):
            return _of(name, args, [_power(a, powers) for a in args])
    raise _Other


def _of(name: str, args: tuple[Expr, ...], found: list[float | None]) -> float | None:
    if name in _UNCHANGED:
        return found[0]
    if name == "sign":
        return 0.0
    if name == "*":
        return None if None in found else sum(n for n in found if n is not None)
    if name == "/" and found[1] is not None:
        return None if found[0] is None else found[0] - found[1]
    if name == "sqrt":
        return None if found[0] is None else found[0] / 2
    if name == "^" and isinstance(args[1], Num) and found[0] is not None:
        return found[0] * args[1].value
    if name == "if" and found[0] in (0.0, None):
        return _same(found[1:])
    if name in _ALIKE:
        power = _same(found)
        return 0.0 if name in _DIRECTIONS else power
    if all(n in (0.0, None) for n in found):
        return 0.0
    raise _Other


def _same(found: list[float | None]) -> float | None:
    powers = {n for n in found if n is not None}
    if len(powers) > 1:
        raise _Other
    return powers.pop() if powers else None
