"""The causalised hybrid model: what the printers print."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from hystid.modelica.blocks import Solve, Step
from hystid.modelica.event_model import Delay, Reinit, Relation, Sampler
from hystid.modelica.expr import Expr
from hystid.modelica.flat import Assertion, FlatModel
from hystid.modelica.initialisation import Initial
from hystid.modelica.scalar import ScalarVariable


@dataclass(frozen=True, eq=False)
class HybridModel:
    """What the printers print. Steps are in order of evaluation.

    derivatives: der(x) and algebraic variables from time, p, u, x, d, relations. event: the same and the discrete
    variables, at an event. start: everything, at the start. aliases: variable -> the variable whose slot it shares.
    clocked: discrete variables of when-clauses, conditions among them. homotopy: whether the start goes from simplified
    to actual values. delays: with the number of points that each keeps.
    """

    flat: FlatModel
    variables: Mapping[str, ScalarVariable]
    states: tuple[str, ...]
    discrete: tuple[str, ...]
    hidden: frozenset[str]
    clocked: frozenset[str]
    algebraic: tuple[str, ...]
    inputs: tuple[str, ...]
    settable: tuple[str, ...]
    computed: tuple[str, ...]
    aliases: Mapping[str, str]
    derivatives: tuple[Step, ...]
    event: tuple[Step, ...]
    start: Initial
    relations: tuple[Relation, ...]
    samplers: tuple[Sampler, ...]
    reinits: tuple[Reinit, ...]
    assertions: tuple[Assertion, ...]
    checks: tuple[tuple[Expr, Assertion], ...]
    homotopy: bool = False
    delays: Mapping[Delay, int] = field(default_factory=dict)

    @property
    def loops(self) -> list[Solve]:
        """Simultaneous equations, wherever they are solved."""
        steps = (*self.start.dependent, *self.derivatives, *self.event, *self.start.steps)
        return [s for s in steps if isinstance(s, Solve)]


def is_output(name: str, v: ScalarVariable) -> bool:
    """Whether a variable is an output of the model as a whole."""
    return v.kind == "unknown" and v.flat.causality == "output" and "." not in name
