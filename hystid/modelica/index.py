"""States that are tied to each other by equations: one is computed, and its derivative by the derivative of the tie.

Example: a spring with ``s_rel = b.s - a.s; v_rel = der(s_rel)`` between masses whose positions are states. The
equations that over-determine the derivatives are solved for what they leave free, down to one equation between states;
one state of it becomes an algebraic variable, and the differentiated equation gives its derivative (Pantelides 1988
finds the same sets; choosing the states once and for all, as here, fails where the choice becomes singular on the way,
and ends the run there).
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Mapping, Sequence, Set
from dataclasses import replace

from hystid.errors import ModelicaError
from hystid.modelcode import Experiment
from hystid.modelica.blocks import Assign, isolate, preference, solve_order
from hystid.modelica.differentiation import Derivative
from hystid.modelica.event_model import HOMOTOPY, EventModel, Relation, der
from hystid.modelica.expr import ONE, ZERO, Expr, Num, Op, Ref, Text, evaluate, nodes, op, refs, substitute
from hystid.modelica.flat import Assertion
from hystid.modelica.matching import matching
from hystid.modelica.scalar import ScalarEquation, ScalarVariable

# a located turning point is off by less than this many steps of the model, also where the solver is the importer's
_STEPS_AHEAD = 10
_VANISHED = 1e-2  # of the value at the start: a solver of tolerance 1e-6 places a turning point to 1e-3


def reduce_index(events: EventModel, aliases: Mapping[str, str]) -> EventModel:
    """The model with as many states as are free. Unchanged where every equation has an unknown to determine.

    Raises ModelicaError where the states are tied in a way that needs more than this.
    """
    events = _with_preferred_velocities(events)
    former: set[str] = set()  # were states, have a derivative still
    used: dict[ScalarEquation, str] = {}  # ties, and the state that went for each
    rates: dict[str, ScalarEquation] = {}  # what determines the derivatives of those
    for _ in range(len(events.states)):
        unknowns = events.unknowns(aliases)
        known = set(unknowns)
        options = [preference(e, known) for e in events.equations]
        owner, left = matching(_settled(events.equations, options, {*events.states, *former}), unknowns)
        tie = _tie(events.equations, options, owner, left[0], {*events.states, *former}) if left else None
        if tie is not None and (tie in used or not _free(events, tie)):
            # known, or none may go but such as went: what determines those leads to states that still are
            tie = _tie(events.equations, options, owner, left[0], {*events.states})
        if tie is None or tie in used:
            further = _with_slopes(events, options, owner, left[0], former, rates) if left else None
            if further is None:
                break
            former |= {*events.states} - {*further.states}
            events = further
            continue
        used[tie] = _dependent_state(events, tie, former)
        events = _with_one_state_less(events, tie, used[tie], former)
        former.add(used[tie])
        rates[used[tie]] = events.equations[-1]
    for tie, chosen in used.items():
        events = _watched(events, tie, chosen)
    return events


def _settled(
    equations: Sequence[ScalarEquation], options: Sequence[Sequence[str]], moving: Set[str]
) -> list[list[str]]:
    """Options without what equations determine that speak of nothing ``moving``, as a support at a fixed angle: what is
    left of the others ties states openly. Otherwise they would share that support out as if it followed from states."""
    rest = [list(names) for names in options]
    still = [k for k, e in enumerate(equations) if not (refs(e.left) | refs(e.right)) & moving]
    settled: set[str] = set()
    while alone := {rest[k][0]: k for k in still if len(rest[k]) == 1 and rest[k][0] not in settled}:
        settled |= set(alone)
        makers = set(alone.values())
        rest = [names if k in makers else [n for n in names if n not in alone] for k, names in enumerate(rest)]
    return rest


def _with_preferred_velocities(events: EventModel) -> EventModel:
    """Velocities that their author prefers as states, v_rel = der(s_rel), become states where an event sets another
    velocity anew: what is a state keeps its value then, and what follows from states jumps."""
    variables = events.scalar.variables
    if not events.reinits:
        return events
    more: dict[str, None] = {}
    for e in events.equations:
        for a, b in ((e.left, e.right), (e.right, e.left)):
            rate = isinstance(a, Ref) and a.name.startswith("der(")
            v = variables.get(b.name) if isinstance(b, Ref) else None
            if rate and v is not None and v.kind == "unknown" and v.flat.preferred and v.name not in events.states:
                more[v.name] = None
    return replace(events, states=(*events.states, *more))


def _tie(
    equations: Sequence[ScalarEquation],
    options: Sequence[Sequence[str]],
    owner: Mapping[str, int],
    extra: int,
    states: Set[str],
) -> ScalarEquation | None:
    """The equation between states alone that the over-determined set around ``extra`` implies; None without one."""
    _, inside = _around(options, owner, extra, states)
    steps = solve_order(equations, inside)
    left, right = equations[extra].left, equations[extra].right
    for step in reversed(steps):
        if not isinstance(step, Assign):
            return None
        left, right = (substitute(side, {step.variable: step.value}) for side in (left, right))
    tied = (refs(left) | refs(right)) & states
    return ScalarEquation(left, right, equations[extra].place) if tied else None


def _with_slopes(
    events: EventModel,
    options: Sequence[Sequence[str]],
    owner: Mapping[str, int],
    extra: int,
    former: Set[str],
    rates: Mapping[str, ScalarEquation],
) -> EventModel | None:
    """Where the set around ``extra`` cannot be solved for a tie, as with nonlinear loops in it: each of its equations
    is differentiated, its variables get derivatives, and one of its states goes (Pantelides 1988). None without one.

    rates: of states that went before, the equations of their derivatives; those of variables in the set follow from
    its own equations now.
    """
    variables = events.scalar.variables
    members, inside = _around(options, owner, extra, {*events.states})
    known = {*events.states, *former, *inside}
    if any(name.startswith("der(") for name in inside):
        return None
    equations = [events.equations[k] for k in sorted(members)]
    speaks = frozenset(n for e in equations for n in refs(e.left) | refs(e.right))
    renewed = {r.state for r in events.reinits}
    free = [s for s in events.states if s in speaks and s not in renewed and not variables[s].fixed]
    if not free:
        return None
    chosen = max(free, key=lambda s: (variables[s].start in (None, ZERO), s.count("."), s))
    slopes = [ScalarEquation(_rate(op("-", e.left, e.right), events, e, known), ZERO, e.place) for e in equations]
    more = {der(n): _slope_variable(variables[n]) for n in (*inside, chosen) if n in variables}
    again = {n for n in inside if der(n) in variables}
    implied = {rates[n] for n in again & set(rates)} & {*events.equations}
    if len(more) != len(inside) + 1 or len(implied) != len(again) or der(chosen) in variables:
        return None
    return replace(
        events,
        scalar=replace(events.scalar, variables={**variables, **more}),
        states=tuple(s for s in events.states if s != chosen),
        equations=(*(e for e in events.equations if e not in implied), *slopes),
    )


def _around(
    options: Sequence[Sequence[str]], owner: Mapping[str, int], extra: int, states: Set[str]
) -> tuple[set[int], dict[str, int]]:
    """Numbers of the over-determined equations around ``extra``, and the variables that they determine."""
    members, inside = {extra}, {}
    queue = deque([extra])
    while queue:
        for name in options[queue.popleft()]:
            k = owner.get(name)
            if k is not None and k not in members and name not in states:
                members.add(k)
                inside[name] = k
                queue.append(k)
    return members, inside


def _with_one_state_less(events: EventModel, tie: ScalarEquation, chosen: str, former: Set[str]) -> EventModel:
    variables = events.scalar.variables
    rate = _rate(op("-", tie.left, tie.right), events, tie, former)
    slope = ScalarEquation(rate, ZERO, tie.place)
    gone = variables[chosen]
    if gone.fixed and not _free(events, tie):
        gone = replace(gone, flat=replace(gone.flat, fixed=False))  # the tie says the same at the start
    return replace(
        events,
        scalar=replace(events.scalar, variables={**variables, chosen: gone, der(chosen): _slope_variable(gone)}),
        states=tuple(s for s in events.states if s != chosen),
        equations=(*events.equations, slope),  # the others determine the state that went
    )


def _watched(events: EventModel, tie: ScalarEquation, chosen: str) -> EventModel:
    """Ends a run where a tie no longer determines the state that went, as x of a pendulum, x^2 + y^2 = L^2, at its
    lowest point: x would turn back there without a word. It is looked for before, at each step, and where the other
    states turn back, which is made an event; elsewhere ``chosen`` rests at such an event. A tie with other states that
    went is left alone: together they may be determined all the same.
    """
    constraint = op("-", tie.left, tie.right)
    pivot = Derivative(chosen)(constraint)
    moving = {*events.states, chosen}
    if not refs(pivot) & moving or any(der(n) in events.scalar.variables for n in refs(constraint) - moving):
        return events
    turning = substitute(_rate(constraint, events, tie, {chosen}), {der(chosen): ZERO})
    slope = _rate(pivot, events, tie, {chosen})
    # output may be sparse: what lies further ahead says nothing about a mechanism that turns within it
    soon = Num(_STEPS_AHEAD * min(events.scalar.flat.experiment.step, Experiment.step))
    lasts = op(">=", op("abs", pivot), op("*", soon, op("abs", slope)))
    leaves = op(">", op("*", pivot, slope), ZERO)
    # a turning point that is located to rounding gives no slope any more: 0 is divided by 0
    begin = evaluate(pivot, _guesses(refs(pivot), events.scalar.variables)) or 0.0
    stays = op("and", lasts, op(">=", op("abs", pivot), Num(_VANISHED * abs(begin))))
    message = Text(
        f"'{chosen}' no longer follows from the equation that ties it ({tie.place.short}), and which variables are "
        f"states is decided once: keep '{chosen}' as a state, by fixed = true, or describe the motion by an angle"
    )
    relation = Relation(f"$turning({chosen})", op(">", turning, ZERO), (turning,))
    at_event, at_step = (Assertion(c, message, "error", tie.place) for c in (stays, op("or", leaves, lasts)))
    return replace(
        events,
        relations=(*events.relations, relation),
        checks=(*events.checks, (ONE, at_event)),
        assertions=(*events.assertions, at_step),
    )


def _dependent_state(events: EventModel, tie: ScalarEquation, former: Set[str]) -> str:
    """The state that may go: not fixed by its author, not set by reinit; rather a velocity, first that of a state that
    went before, so that one position and its own velocity stay; stated by the tie, without a start value, far
    from where the tie cannot be solved for it at the start, deep in components. Where start values fulfil the tie, as
    of a pendulum that hangs or lies level, what it cannot be solved for there stays.
    """
    velocities = dict(_velocities(events))
    starts = dict(_numbers(events.scalar.variables))
    guesses = _guesses(refs(tie.left) | refs(tie.right), events.scalar.variables)
    renewed = {r.state for r in events.reinits}
    variables = events.scalar.variables
    tied = [s for s in events.states if s in refs(tie.left) | refs(tie.right) and s not in renewed]
    free = _free(events, tie) or (tied if _holds_at_start(tie, starts, tied) else [])
    if not free:
        names = ", ".join(s for s in events.states if s in refs(tie.left) | refs(tie.right))
        raise ModelicaError(
            f"{tie.place}: the states {names} are tied by equations, and each has a start value with fixed=true, which "
            "do not fit together (or is set by reinit): leave one of them without, it follows from the others"
        )

    # what an event sets anew takes the others along that are no states; which, says their author
    jumps = bool(renewed & (refs(tie.left) | refs(tie.right)))
    consistent = _holds_at_start(tie, guesses, tied)

    def rank(s: str) -> tuple[bool, bool, bool, bool, bool, bool, float, int, int]:
        position = velocities.get(s)
        stated = isolate(tie, s) is not None
        plain = variables[s].start in (None, ZERO)  # the front end gives 0 where no start is stated
        pivot = abs(evaluate(Derivative(s)(op("-", tie.left, tie.right)), guesses) or 0.0)
        may_go = not (jumps and variables[s].flat.preferred)
        order = s.count("."), -events.states.index(s)
        return (
            may_go,
            bool(pivot) or not consistent,
            position in former,
            position is not None,
            stated,
            plain,
            pivot,
            *order,
        )

    if jumps and any(variables[s].flat.preferred for s in free):
        free = tied  # a start value that is fixed holds for what is no state, too
    return max(free, key=rank)


def _holds_at_start(tie: ScalarEquation, starts: Mapping[str, float], tied: Sequence[str]) -> bool:
    """Whether start values that are all fixed fulfil the tie to rounding, so that one of them may be left out."""
    left, right = (evaluate(side, starts) for side in (tie.left, tie.right))
    size = max((abs(starts.get(s, 0.0)) for s in tied), default=0.0)
    return left is not None and right is not None and abs(left - right) <= 1e-12 * max(abs(left), abs(right), size)


def _free(events: EventModel, tie: ScalarEquation) -> list[str]:
    """States of a tie that are neither fixed by their author nor set by reinit."""
    kept = {r.state for r in events.reinits} | {s for s in events.states if events.scalar.variables[s].fixed}
    return [s for s in events.states if s in refs(tie.left) | refs(tie.right) and s not in kept]


def _numbers(variables: Mapping[str, ScalarVariable]) -> Iterator[tuple[str, float]]:
    """Values of parameters, start values of the others, where they are numbers."""
    for name, v in variables.items():
        value = v.binding if v.kind in ("parameter", "constant") else v.start
        if isinstance(value, Num):
            yield name, value.value


def _guesses(names: Set[str], variables: Mapping[str, ScalarVariable]) -> dict[str, float]:
    """Values of parameters and start values, those computed from other parameters too; 0 where none is known."""
    found: dict[str, float] = {}

    def guess(name: str) -> float:
        if name not in found:
            found[name] = 0.0
            v = variables.get(name)
            value = None if v is None else v.binding if v.kind in ("parameter", "constant", "dependent") else v.start
            if value is not None:
                found[name] = evaluate(value, {n: guess(n) for n in refs(value)}) or 0.0
        return found[name]

    return {name: guess(name) for name in names}


def _velocities(events: EventModel) -> Iterator[tuple[str, str]]:
    """Pairs v, x from equations der(x) = v."""
    for e in events.equations:
        for a, b in ((e.left, e.right), (e.right, e.left)):
            if isinstance(a, Ref) and isinstance(b, Ref) and a.name.startswith("der(") and b.name in events.states:
                yield b.name, a.name.removeprefix("der(").removesuffix(")")


def _rate(constraint: Expr, events: EventModel, tie: ScalarEquation, former: Set[str]) -> Expr:
    """d/dt of an expression of states and time."""
    variables = events.scalar.variables
    total: Expr = ZERO
    if any(isinstance(n, Op) and n.name == "delayed" for n in nodes(constraint)):
        raise ModelicaError(f"{tie.place}: states are tied by an equation with delay(), whose derivative is not known")
    for name in sorted(refs(constraint)):
        partial = Derivative(name)(constraint)
        v = variables.get(name)
        if partial == ZERO or (v is not None and v.kind in ("parameter", "dependent", "constant", "free")):
            continue
        if name in events.discrete or name in events.from_when or name == HOMOTOPY:
            continue  # it rests between events
        if name != "time" and name not in events.states and name not in former:
            kind = "the input" if v is not None and v.kind == "input" else "the variable"
            raise ModelicaError(
                f"{tie.place}: states are tied by an equation with {kind} '{name}', whose derivative would be needed: "
                "give the derivative as an input of its own"
            )
        speed = ONE if name == "time" else Ref(der(name))
        total = op("+", total, op("*", partial, speed))
    return total


def _slope_variable(v: ScalarVariable) -> ScalarVariable:
    """The derivative of what is no longer a state, as a variable of its own."""
    flat = replace(
        v.flat, name=der(v.name), causality="local", start=None, fixed=None, binding=None, unit="", min=None, max=None,
        nominal=None, description=f"derivative of {v.name}",
    )  # fmt: skip
    return ScalarVariable(der(v.name), "unknown", flat, None, None, None, None, None)
