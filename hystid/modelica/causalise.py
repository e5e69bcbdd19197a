"""Passes 3 to 5: aliases, the order of evaluation, initialisation; a ``HybridModel`` of all of it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from hystid.errors import ModelicaError
from hystid.modelica.aliases import replaced, without_aliases
from hystid.modelica.blocks import Assign, Step, components, preference, solve_order, sources, targets
from hystid.modelica.corners import corners_in_loops
from hystid.modelica.delays import room
from hystid.modelica.event_model import HOMOTOPY, INITIAL, EventModel, der
from hystid.modelica.events import name_events
from hystid.modelica.expr import ONE, ZERO, refs, substitute
from hystid.modelica.flat import FlatModel
from hystid.modelica.hybrid import HybridModel
from hystid.modelica.index import reduce_index
from hystid.modelica.initialisation import Initial, Initialisation
from hystid.modelica.matching import matching
from hystid.modelica.scalar import ScalarEquation
from hystid.modelica.silence import silenced
from hystid.modelica.structure import Incidence, structural_error
from hystid.modelica.vanishing import scalarise_without_vanished


def causalise(flat: FlatModel, parameters: Mapping[str, float]) -> HybridModel:
    """The flat model with ``parameters`` set, sorted for evaluation. Raises ModelicaError."""
    scalar = scalarise_without_vanished(flat, parameters)  # every variable and equation is scalar
    corners = corners_in_loops(scalar, lambda events: _derivatives(*_sortable(events)))
    events = name_events(scalar, corners)  # everything that acts at instants has a name
    events, aliases = _sortable(events)
    running = replaced(events, {HOMOTOPY: ONE})  # after the start homotopy means what it is meant to
    derivatives = _derivatives(running, aliases)  # each unknown once, after what it needs
    event = _event_order(running, derivatives)
    start = Initialisation(events, aliases).run()
    return _assemble(running, aliases, derivatives, event, start)


def _sortable(events: EventModel) -> tuple[EventModel, dict[str, str]]:
    events, aliases = without_aliases(events)  # no equation says that two unknown variables are equal
    events = silenced(events)  # no event without effect
    _counted(events, aliases)  # as many equations as unknowns
    return reduce_index(events, aliases), aliases  # no equation ties states alone


def _counted(events: EventModel, aliases: Mapping[str, str]) -> None:
    """Raises ModelicaError where equations and unknowns differ in number. A state counts once, whether an equation
    speaks of it or of its derivative: states tied by equations are no fault of the count."""
    unknowns = events.unknowns(aliases)
    if len(events.equations) != len(unknowns):
        states = {der(s): s for s in events.states}
        names = {states.get(u, u) for u in unknowns}
        found = (preference(e, {*unknowns, *names}) for e in events.equations)
        options = [list(dict.fromkeys(states.get(n, n) for n in each)) for each in found]
        owner, left = matching(options, sorted(names))
        unmatched = sorted(names - owner.keys())
        raise _singular(events, Incidence(events.equations, options, owner, left, unmatched))


def _derivatives(events: EventModel, aliases: Mapping[str, str]) -> tuple[Step, ...]:
    unknowns = events.unknowns(aliases)
    equations = [_running(e) for e in events.equations]
    wanted = set(unknowns)
    options = [preference(e, wanted) for e in equations]
    owner, left = matching(options, unknowns)
    if left or len(owner) < len(unknowns):
        unmatched = [u for u in unknowns if u not in owner]
        raise _tied_states(events, Incidence(equations, options, owner, left, unmatched))
    return tuple(solve_order(equations, owner, events.guessed()))


def _running(e: ScalarEquation) -> ScalarEquation:
    """initial() is false after the start."""
    after = {INITIAL: ZERO}
    return ScalarEquation(substitute(e.left, after), substitute(e.right, after), e.place)


def _singular(events: EventModel, found: Incidence) -> ModelicaError:
    names = (u.removeprefix("der(").removesuffix(")") for u in found.unmatched)
    first = events.scalar.variables.get(next(names, ""))
    return structural_error(found, str(first.place) if first else events.scalar.flat.name)


def _tied_states(events: EventModel, found: Incidence) -> ModelicaError:
    """Of as many equations as unknowns, some determine nothing: those between states are a matter of the index."""
    equations, left = found.equations, found.left
    held = sorted((refs(equations[left[0]].left) | refs(equations[left[0]].right)) & set(events.states)) if left else []
    if not held:
        return _singular(events, found)
    missing = ", ".join(f"'{u}'" for u in found.unmatched[:4])
    return ModelicaError(
        f"{equations[left[0]].place}: this equation ties the state(s) {', '.join(held)} together, so that "
        f"{missing or 'a derivative'} would need differentiated equations (index reduction), which is not "
        "supported: state the derivatives as variables of their own and give forces x and v as inputs"
    )


def _event_order(events: EventModel, derivatives: Sequence[Step]) -> tuple[Step, ...]:
    """Continuous blocks and discrete variables in one order; a loop through both uses the continuous values of the pass
    before, which the next pass of the event iteration renews."""
    assigns = [Assign(n, _running(e).right, e.place) for n, e in {**events.discrete, **events.from_when}.items()]
    steps: list[Step] = [*derivatives, *assigns]
    count = len(derivatives)
    maker = {t: k for k, step in enumerate(steps) for t in targets(step)}
    graph = {k: [maker[n] for n in sorted(sources(step)) if n in maker] for k, step in enumerate(steps)}
    order: list[int] = []
    for members in components(graph):
        if len(members) == 1 and members[0] not in graph[members[0]]:
            order += members
            continue
        order += sorted(k for k in members if k < count)
        order += _discrete_order([k for k in members if k >= count], graph, steps)
    return tuple(steps[k] for k in order)


def _discrete_order(members: Sequence[int], graph: Mapping[int, Sequence[int]], steps: Sequence[Step]) -> list[int]:
    inside = {k: [j for j in graph[k] if j in set(members)] for k in members}
    order = []
    for loop in components(inside):
        if len(loop) > 1 or loop[0] in inside[loop[0]]:
            names = ", ".join(t for k in loop for t in targets(steps[k]))
            raise ModelicaError(f"{steps[loop[0]].place}: {names} depend on each other at one instant: use pre()")
        order += loop
    return order


def _assemble(
    events: EventModel,
    aliases: Mapping[str, str],
    derivatives: tuple[Step, ...],
    event: tuple[Step, ...],
    start: Initial,
) -> HybridModel:
    rates = {der(s) for s in events.states}
    return HybridModel(
        flat=events.scalar.flat,
        variables=events.scalar.variables,
        states=events.states,
        discrete=tuple(events.all_discrete()),
        hidden=frozenset(events.hidden),
        clocked=frozenset((*events.hidden, *events.from_when)),
        algebraic=tuple(n for n in events.unknowns(aliases) if n not in rates),
        inputs=tuple(events.of_kind("input")),
        settable=tuple(events.of_kind("parameter")),
        computed=tuple(events.of_kind("dependent", "free", "constant")),
        aliases=aliases,
        derivatives=derivatives,
        event=event,
        start=start,
        relations=events.relations,
        samplers=events.samplers,
        reinits=events.reinits,
        assertions=events.assertions,
        checks=events.checks,
        delays={d: room(d, events.scalar.flat.experiment.step, start.dependent, start.starts) for d in events.delays},
        homotopy=any(HOMOTOPY in sources(step) for step in start.steps)
        or any(HOMOTOPY in refs(r) for r in start.relations),
    )
