"""A model in which everything that happens at instants has a name."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from hystid.modelica.expr import ZERO, Expr
from hystid.modelica.flat import Assertion, Place
from hystid.modelica.scalar import ScalarEquation, ScalarModel

INITIAL = "initial()"
BEGIN = "$begin"  # the time at which the run begins
HOMOTOPY = "homotopy()"  # at the start, the share of the actual argument in homotopy(actual, simplified)


@dataclass(frozen=True)
class Relation:
    """A frozen value, renewed at events: ``value`` computes it from current values.

    The event happens where one of ``indicators`` changes between positive and not positive. deadline: for a relation of
    time alone, the instant at which it changes (None for others), so that no search is needed.
    """

    name: str
    value: Expr
    indicators: tuple[Expr, ...]
    deadline: Expr | None = None


@dataclass(frozen=True)
class Sampler:
    """sample(start, interval); flag is the discrete variable that is 1 in the pass in which it ticks."""

    flag: str
    start: Expr
    interval: Expr


@dataclass(frozen=True)
class Reinit:
    """At an event: state := value where ``active``."""

    state: str
    value: Expr
    active: Expr
    place: Place


@dataclass(frozen=True)
class Delay:
    """``value`` as it was ``time`` ago, at most ``most``; fixed: ``time`` holds between events."""

    name: str
    value: Expr
    time: Expr
    most: Expr
    fixed: bool
    place: Place


@dataclass(frozen=True)
class EventModel:
    """Postcondition: expressions hold no sample, edge, change, initial, terminal, noEvent, smooth or rounding function
    that could make an event, and no relation of continuous variables outside noEvent other than by its frozen name.
    ``pre(name)`` and ``der(name)`` are the names of variables. The name "initial()" is 1 during initialisation,
    "homotopy()" goes from 0 to 1 in it and is 1 ever after. An operation "delayed" of the number of a delay and an
    instant is what the delay's value was then.

    discrete: name -> equation that defines it; when_start: value at the start for those defined by when-clauses.
    """

    scalar: ScalarModel
    states: tuple[str, ...]
    discrete: dict[str, ScalarEquation]
    hidden: tuple[str, ...]
    from_when: dict[str, ScalarEquation]
    equations: tuple[ScalarEquation, ...]
    initial: tuple[ScalarEquation, ...]
    relations: tuple[Relation, ...]
    samplers: tuple[Sampler, ...]
    reinits: tuple[Reinit, ...]
    assertions: tuple[Assertion, ...]
    checks: tuple[tuple[Expr, Assertion], ...] = field(default=())
    delays: tuple[Delay, ...] = ()

    def of_kind(self, *kinds: str) -> list[str]:
        """Names of the variables of some kinds."""
        return [v.name for v in self.scalar.variables.values() if v.kind in kinds]

    def all_discrete(self) -> list[str]:
        """Names of all discrete variables; those that the compiler has introduced come first."""
        return [*self.hidden, *(n for n in self.discrete if n not in self.hidden), *self.from_when]

    def unknowns(self, aliases: Mapping[str, str]) -> list[str]:
        """Derivatives and algebraic variables."""
        gone = {*self.states, *self.all_discrete(), *aliases}
        return [der(s) for s in self.states] + [n for n in self.of_kind("unknown") if n not in gone]

    def guessed(self) -> set[str]:
        """Unknowns with a start value; the front end gives 0 where none is stated."""
        return {v.name for v in self.scalar.variables.values() if v.kind == "unknown" and v.start not in (None, ZERO)}


def pre(name: str) -> str:
    """Name of the value before the event."""
    return f"pre({name})"


def der(name: str) -> str:
    """Name of the derivative."""
    return f"der({name})"
