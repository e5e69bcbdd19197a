"""Relations on which nothing depends for the moment make no event.

In ``a and b`` nobody asks for a while b does not hold, in ``if b then ... a ... else ...`` neither. Event iteration
computes every relation anew, so that the value of a is there as soon as b changes, which is an event: the solution is
the same with fewer events. A slider that turns back leaves its limit without one.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from hystid.modelica.event_model import EventModel, Relation
from hystid.modelica.expr import ONE, Expr, Op, Ref, op

_Literal = tuple[str, bool]  # a relation, and whether it must hold
_Guards = frozenset[_Literal]


def silenced(events: EventModel) -> EventModel:
    """The model with indicators that rest at 1 while another relation makes their own without effect.

    Of two relations that silence each other the first is silenced; what silences is never silent itself.
    """
    guards = _guards(events)
    silent: dict[str, _Guards] = {}
    speaking = set[str]()
    for relation in events.relations:
        found = frozenset((name, holds) for name, holds in guards.get(relation.name, ()) if name not in silent)
        if found and relation.indicators and relation.name not in speaking:
            silent[relation.name] = found
            speaking |= {name for name, _ in found}
    return replace(events, relations=tuple(_resting(r, silent.get(r.name, frozenset())) for r in events.relations))


def _resting(relation: Relation, guards: _Guards) -> Relation:
    """The relation with indicators that rest at 1 where a guard is not as it must be."""
    asked: Expr = ONE
    for name, holds in sorted(guards):
        asked = op("and", asked, Ref(name) if holds else op("not", Ref(name)))
    return replace(relation, indicators=tuple(op("if", asked, one, ONE) for one in relation.indicators))


def _guards(events: EventModel) -> dict[str, _Guards]:
    """Relation -> what holds wherever its value is asked for."""
    names = {relation.name for relation in events.relations}
    found: dict[str, _Guards] = {}
    seen = set[tuple[Expr, _Guards]]()

    def visit(expr: Expr, held: _Guards) -> None:
        if isinstance(expr, Ref) and expr.name in names:
            found[expr.name] = found.get(expr.name, held) & held
        if not isinstance(expr, Op) or (expr, held) in seen:
            return
        seen.add((expr, held))
        if expr.name in ("and", "or"):
            a, b = expr.args
            visit(a, held | _literals(b, names, expr.name == "and"))
            visit(b, held | _literals(a, names, expr.name == "and"))
        elif expr.name == "if":
            condition, value, otherwise = expr.args
            visit(condition, held)
            visit(value, held | _literals(condition, names, True))
            visit(otherwise, held | _literals(condition, names, False))
        else:
            for argument in expr.args:
                visit(argument, held)

    for expr in expressions(events):
        visit(expr, frozenset())
    return found


def _literals(expr: Expr, names: set[str], holds: bool) -> _Guards:
    """Relations of which the truth follows when an expression holds, or does not."""
    if isinstance(expr, Ref):
        return frozenset({(expr.name, holds)} if expr.name in names else ())
    if isinstance(expr, Op) and expr.name == "not":
        return _literals(expr.args[0], names, not holds)
    if isinstance(expr, Op) and expr.name == ("and" if holds else "or"):
        return _literals(expr.args[0], names, holds) | _literals(expr.args[1], names, holds)
    return frozenset()


def expressions(events: EventModel) -> Iterator[Expr]:
    """Everything in which a relation may be asked for."""
    groups = (events.equations, events.initial, events.discrete.values(), events.from_when.values())
    yield from (side for group in groups for e in group for side in (e.left, e.right))
    for relation in events.relations:
        yield from (relation.value, *relation.indicators)
        if relation.deadline is not None:
            yield relation.deadline
    yield from (part for sampler in events.samplers for part in (sampler.start, sampler.interval))
    yield from (part for d in events.delays for part in (d.value, d.time, d.most))
    yield from (part for reinit in events.reinits for part in (reinit.value, reinit.active))
    yield from (part for a in events.assertions for part in (a.condition, a.message))
    yield from (part for active, a in events.checks for part in (active, a.condition, a.message))
