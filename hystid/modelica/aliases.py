"""Pass 3: of variables that an equation makes equal one stays."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace

from hystid.modelica.event_model import EventModel, Relation
from hystid.modelica.expr import Expr, Ref, refs, substitute
from hystid.modelica.flat import Assertion
from hystid.modelica.scalar import ScalarEquation, ScalarVariable
from hystid.modelica.silence import expressions


def without_aliases(events: EventModel) -> tuple[EventModel, dict[str, str]]:
    """Equations a = b between unknowns are dropped and b is written for a everywhere.

    A state stays itself; outputs stay apart from inputs, because the standard gives them separate references.
    """
    variables = events.scalar.variables
    fixed = {n for n, v in variables.items() if v.fixed}
    keep = {*events.states, *events.all_discrete()}
    aliases: dict[str, str] = {}

    def root(name: str) -> str:
        while name in aliases:
            name = aliases[name]
        return name

    def free(name: str) -> bool:
        v = variables.get(name)
        return v is not None and v.kind == "unknown" and name not in keep and name not in fixed

    rest = []
    for e in events.equations:
        pair = _pair(e, root)
        gone = pair and _choose(pair, variables, free, events.states)
        if pair and gone:
            aliases[gone] = pair[1] if gone == pair[0] else pair[0]
        else:
            rest.append(e)
    final = {name: root(name) for name in aliases}
    return _without_twins(_renamed(replace(events, equations=tuple(rest)), final)), final


def _without_twins(events: EventModel) -> EventModel:
    """Relations that say the same of the same variables, one in each of many components, become one."""
    first: dict[Expr, Relation] = {}
    twins = {r.name: first[r.value].name for r in events.relations if first.setdefault(r.value, r) is not r}
    return _renamed(replace(events, relations=tuple(first.values())), twins)


def _pair(e: ScalarEquation, root: Callable[[str], str]) -> tuple[str, str] | None:
    if isinstance(e.left, Ref) and isinstance(e.right, Ref):
        a, b = root(e.left.name), root(e.right.name)
        return (a, b) if a != b else None
    return None


def _choose(
    pair: tuple[str, str], variables: Mapping[str, ScalarVariable], free: Callable[[str], bool], states: Iterable[str]
) -> str | None:
    """The one of two equal variables that may go; outputs and shallow names stay rather."""
    allowed = []
    for name, other in (pair, pair[::-1]):
        if not free(name) or other not in variables:
            continue
        v, o = variables[name], variables[other]
        if o.kind == "input" and v.flat.causality == "output" and "." not in name:
            continue
        if (o.kind in ("unknown", "input") and o.flat.type == v.flat.type == "Real") and (
            o.kind == "input" or other in states or free(other)
        ):
            allowed.append((v.flat.causality == "output", -name.count("."), name))
    return min(allowed)[2] if allowed else None


def _renamed(events: EventModel, aliases: Mapping[str, str]) -> EventModel:
    return replaced(events, {a: Ref(b) for a, b in aliases.items()})


def replaced(events: EventModel, values: Mapping[str, Expr]) -> EventModel:
    """The model with variables replaced everywhere; the same object where it holds none of them."""
    if not values or not any(refs(expr) & values.keys() for expr in expressions(events)):
        return events

    def new(expr: Expr) -> Expr:
        return substitute(expr, values)

    def equation(e: ScalarEquation) -> ScalarEquation:
        return ScalarEquation(new(e.left), new(e.right), e.place)

    def assertion(a: Assertion) -> Assertion:
        return replace(a, condition=new(a.condition), message=new(a.message))

    return replace(
        events,
        equations=tuple(equation(e) for e in events.equations),
        initial=tuple(equation(e) for e in events.initial),
        discrete={n: equation(e) for n, e in events.discrete.items()},
        from_when={n: equation(e) for n, e in events.from_when.items()},
        relations=tuple(
            replace(
                r,
                value=new(r.value),
                indicators=tuple(new(i) for i in r.indicators),
                deadline=new(r.deadline) if r.deadline is not None else None,
            )
            for r in events.relations
        ),
        reinits=tuple(replace(r, value=new(r.value), active=new(r.active)) for r in events.reinits),
        assertions=tuple(assertion(a) for a in events.assertions),
        checks=tuple((new(active), assertion(a)) for active, a in events.checks),
        delays=tuple(replace(d, value=new(d.value), time=new(d.time), most=new(d.most)) for d in events.delays),
    )
