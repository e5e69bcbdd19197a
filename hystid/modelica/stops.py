"""Springs in series with dry sliders, recognised by their equations: on a given motion they have a closed form."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import astuple, dataclass

from hystid.modelica.blocks import Assign, Step
from hystid.modelica.event_model import der
from hystid.modelica.expr import Expr, Num, Op, Ref
from hystid.modelica.hybrid import HybridModel


@dataclass(frozen=True)
class Stop:
    """Names of the variables of ``hy_stop`` in hy_model.h, in its order; no stiffness stands for 1."""

    force: str
    stiffness: str | None
    limit: str
    speed: str
    slips: str
    above: str
    forward: str
    below: str
    backward: str

    def names(self) -> tuple[str | None, ...]:
        """The names, in order."""
        return astuple(self)


def stops_of(model: HybridModel) -> tuple[Stop, ...]:
    """All stops of a model of which nothing else happens at instants; none where something does.

    A stop is der(z) = if slips then 0 else K*v, or v, with slips = (z >= c and v > 0) or (z <= -c and v < 0), K and c
    parameters.
    """
    derivatives, event = _values(model.derivatives), _values(model.event)
    found = tuple(s for state in model.states if (s := _stop(model, state, derivatives, event)) is not None)
    theirs = {name for stop in found for name in (stop.above, stop.forward, stop.below, stop.backward)}
    happens = bool(model.samplers or model.reinits or model.checks or model.assertions or model.delays)
    complete = {stop.slips for stop in found} == set(model.discrete) and theirs == {r.name for r in model.relations}
    return found if complete and not happens else ()


def _stop(model: HybridModel, state: str, derivatives: Mapping[str, Expr], event: Mapping[str, Expr]) -> Stop | None:
    stiffness: str | None
    match derivatives.get(der(state)):
        case Op("if", (Ref(slips), Num(0.0), Op("*", (Ref(factor), Ref(speed))))):
            stiffness = factor
        case Op("if", (Ref(slips), Num(0.0), Ref(speed))):
            stiffness = None
        case _:
            return None
    match event.get(slips):
        case Op("or", (Op("and", (Ref(above), Ref(forward))), Op("and", (Ref(below), Ref(backward))))):
            pass
        case _:
            return None
    relations = {relation.name: relation.value for relation in model.relations}
    limit = _limit(relations.get(above), state)
    stop = Stop(state, stiffness, limit, speed, slips, above, forward, below, backward)
    wanted = {
        above: Op(">=", (Ref(state), Ref(limit))),
        forward: Op(">", (Ref(speed), Num(0.0))),
        below: Op("<=", (Ref(state), Op("neg", (Ref(limit),)))),
        backward: Op("<", (Ref(speed), Num(0.0))),
    }
    parameters = {*model.settable, *model.computed}
    same = all(relations.get(name) == value for name, value in wanted.items())
    return stop if same and {stiffness or limit, limit} <= parameters else None


def _limit(value: Expr | None, state: str) -> str:
    match value:
        case Op(">=", (Ref(name), Ref(limit))) if name == state:
            return limit
    return ""


def _values(steps: tuple[Step, ...]) -> Mapping[str, Expr]:
    return {step.variable: step.value for step in steps if isinstance(step, Assign)}
