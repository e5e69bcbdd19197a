"""Passes 3 to 5: aliases, the order of evaluation, initialisation -> ``HybridModel``."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

from hystid.errors import ModelicaError
from hystid.modelica.blocks import (
    Assign,
    Solve,
    Step,
    components,
    preference,
    solve_order,
    sources,
    targets,
)
from hystid.modelica.corners import corners_in_loops
from hystid.modelica.delays import room
from hystid.modelica.events import HOMOTOPY, INITIAL, EventModel, Relation, der, name_events, pre
from hystid.modelica.expr import ONE, ZERO, Expr, Num, Op, Ref, Text, evaluate, op, rebuild, refs, substitute
from hystid.modelica.flat import Assertion, FlatModel
from hystid.modelica.hybrid import HybridModel
from hystid.modelica.index import reduce_index
from hystid.modelica.matching import augment, matching
from hystid.modelica.scalar import ScalarEquation, ScalarVariable
from hystid.modelica.silence import expressions, silenced
from hystid.modelica.structure import Incidence, structural_error
from hystid.modelica.vanishing import scalarise_without_vanished


def causalise(flat: FlatModel, parameters: Mapping[str, float]) -> HybridModel:
    """The flat model with ``parameters`` set, sorted for evaluation. Raises ModelicaError."""
    scalar = scalarise_without_vanished(flat, parameters)  # every variable and equation is scalar
    corners = corners_in_loops(scalar, lambda events: _derivatives(*_sortable(events)))
    events = name_events(scalar, corners)  # everything that acts at instants has a name
    events, aliases = _sortable(events)
    running = _replaced(events, {HOMOTOPY: ONE})  # after the start homotopy means what it is meant to
    derivatives = _derivatives(running, aliases)  # each unknown once, after what it needs
    event = _event_order(running, derivatives)
    start = _Start(events, aliases).run()
    return _assemble(running, aliases, derivatives, event, start)


def _sortable(events: EventModel) -> tuple[EventModel, dict[str, str]]:
    events, aliases = _without_aliases(events)  # no equation says that two unknown variables are equal
    events = silenced(events)  # no event without effect
    _counted(events, aliases)  # as many equations as unknowns
    return reduce_index(events, aliases, _unknowns), aliases  # no equation ties states alone


def _counted(events: EventModel, aliases: Mapping[str, str]) -> None:
    """Raises ModelicaError where equations and unknowns differ in number. A state counts once, whether an equation
    speaks of it or of its derivative: states tied by equations are no fault of the count."""
    unknowns = _unknowns(events, aliases)
    if len(events.equations) != len(unknowns):
        states = {der(s): s for s in events.states}
        names = {states.get(u, u) for u in unknowns}
        found = (preference(e, {*unknowns, *names}) for e in events.equations)
        options = [list(dict.fromkeys(states.get(n, n) for n in each)) for each in found]
        owner, left = matching(options, sorted(names))
        unmatched = sorted(names - owner.keys())
        raise _singular(events, Incidence(events.equations, options, owner, left, unmatched))


def _of_kind(events: EventModel, *kinds: str) -> list[str]:
    return [v.name for v in events.scalar.variables.values() if v.kind in kinds]


def _discrete(events: EventModel) -> list[str]:
    return [*events.hidden, *(n for n in events.discrete if n not in events.hidden), *events.from_when]


def _unknowns(events: EventModel, aliases: Mapping[str, str]) -> list[str]:
    """Derivatives and algebraic variables."""
    gone = {*events.states, *_discrete(events), *aliases}
    return [der(s) for s in events.states] + [n for n in _of_kind(events, "unknown") if n not in gone]


# -- aliases


def _without_aliases(events: EventModel) -> tuple[EventModel, dict[str, str]]:
    """Equations a = b between unknowns are dropped and b is written for a everywhere.

    A state stays itself; outputs stay apart from inputs, because the standard gives them separate references.
    """
    variables = events.scalar.variables
    fixed = {n for n, v in variables.items() if v.fixed}
    keep = {*events.states, *_discrete(events)}
    aliases: dict[str, str] = {}

    def root(name: str) -> str:
        while name in aliases:
            name = aliases[name]
        return name

    def free(name: str) -> bool:
        v = variables.get(name)
        return bool(v) and v.kind == "unknown" and name not in keep and name not in fixed  # type: ignore[union-attr]  # v is none where bool(v) is false

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


def _pair(e: ScalarEquation, root: object) -> tuple[str, str] | None:
    if isinstance(e.left, Ref) and isinstance(e.right, Ref):
        a, b = root(e.left.name), root(e.right.name)  # type: ignore[operator]
        return (a, b) if a != b else None
    return None


def _choose(
    pair: tuple[str, str], variables: Mapping[str, ScalarVariable], free: object, states: Iterable[str]
) -> str | None:
    """The one of two equal variables that may go; outputs and shallow names stay rather."""
    allowed = []
    for name, other in (pair, pair[::-1]):
        if not free(name) or other not in variables:  # type: ignore[operator]
            continue
        v, o = variables[name], variables[other]
        if o.kind == "input" and v.flat.causality == "output" and "." not in name:
            continue
        if (o.kind in ("unknown", "input") and o.flat.type == v.flat.type == "Real") and (
            o.kind == "input" or other in states or free(other)  # type: ignore[operator]
        ):
            allowed.append((v.flat.causality == "output", -name.count("."), name))
    return min(allowed)[2] if allowed else None


def _renamed(events: EventModel, aliases: Mapping[str, str]) -> EventModel:
    return _replaced(events, {a: Ref(b) for a, b in aliases.items()})


def _replaced(events: EventModel, values: Mapping[str, Expr]) -> EventModel:
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


# -- order of evaluation


def _derivatives(events: EventModel, aliases: Mapping[str, str]) -> tuple[Step, ...]:
    unknowns = _unknowns(events, aliases)
    equations = [_running(e) for e in events.equations]
    wanted = set(unknowns)
    options = [preference(e, wanted) for e in equations]
    owner, left = matching(options, unknowns)
    if left or len(owner) < len(unknowns):
        unmatched = [u for u in unknowns if u not in owner]
        raise _tied_states(events, Incidence(equations, options, owner, left, unmatched))
    return tuple(solve_order(equations, owner, _guessed(events)))


def _guessed(events: EventModel) -> set[str]:
    """Unknowns with a start value; the front end gives 0 where none is stated."""
    return {v.name for v in events.scalar.variables.values() if v.kind == "unknown" and v.start not in (None, ZERO)}


def _running(e: ScalarEquation) -> ScalarEquation:
    """initial() is false after the start."""
    return _with_initial(e, ZERO)


def _with_initial(e: ScalarEquation, value: Num) -> ScalarEquation:
    return ScalarEquation(substitute(e.left, {INITIAL: value}), substitute(e.right, {INITIAL: value}), e.place)


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


# -- start


@dataclass(frozen=True)
class _Initial:
    steps: tuple[Step, ...]
    solved: frozenset[str]
    starts: Mapping[str, float]
    dependent: tuple[Step, ...]
    relations: tuple[Expr, ...]
    guesses: tuple[Assign, ...]
    surplus: tuple[ScalarEquation, ...]


class _Start:
    """Everything is unknown at the start but time, inputs, settable parameters and what has a plain start value."""

    def __init__(self, events: EventModel, aliases: Mapping[str, str]) -> None:
        self.events = events
        self.variables = events.scalar.variables
        self.aliases = aliases
        self.discrete = [n for n in _discrete(events) if n not in {s.flag for s in events.samplers}]
        self.before = {pre(n): n for n in self.discrete}

    def run(self) -> _Initial:
        free = self._parameters_known_later()
        dependent, bindings = self._bindings(free)
        initial = self._initial_equations()
        equations = [self._at_start(e) for e in self.events.equations] + bindings
        equations += [self._at_start(e) for e in self._discrete_equations()]
        certain = len(equations)
        equations += [self._at_start(e) for e in initial]
        timed = set(self.discrete)  # for these, fixed is about pre()
        fixed = [n for n in _of_kind(self.events, "unknown") if self.variables[n].fixed and n not in timed]
        kept = {n for n in fixed if self._number(n) is not None and n in self.events.states}
        unknowns = self._unknown_names(free) - kept
        equations += [self._start_equation(n) for n in dict.fromkeys(fixed) if n not in kept]
        owner, equations, defaults, surplus = self._matched(equations, unknowns, certain)
        steps = solve_order(equations, owner, _guessed(self.events))
        steps = [s for s in steps if not (isinstance(s, Assign) and s.variable in defaults and self._plain(s))]
        solved = frozenset(t for s in steps for t in targets(s))
        relations = tuple(self._value_at_start(r.value) for r in self.events.relations)
        guesses = tuple(self._guesses(steps, {n for s in dependent for n in targets(s)}))
        return _Initial(tuple(steps), solved, self._starts(), tuple(dependent), relations, guesses, surplus)

    def _guesses(self, steps: Iterable[Step], known: set[str]) -> Iterator[Assign]:
        """Where Newton's method begins, of variables whose start value is no number but follows from parameters."""
        known = known | {*_of_kind(self.events, "parameter", "constant")}
        for name in (n for s in steps if isinstance(s, Solve) and not s.linear for n in s.variables):
            value = self._start_value(name)
            if not isinstance(value, Num) and refs(value) <= known:
                yield Assign(name, value, self.variables[name].place)

    def _plain(self, step: Assign) -> bool:
        """A state that starts from a number keeps what is in the block, so that a user may set it."""
        return step.variable in self.events.states and isinstance(step.value, Num)

    def _unknown_names(self, free: Iterable[str]) -> set[str]:
        return {*_unknowns(self.events, self.aliases), *self.events.states, *self.discrete, *free}

    def _parameters_known_later(self) -> list[str]:
        """Parameters with fixed=false and those that depend on them."""
        later = {n for n in _of_kind(self.events, "free")}
        dependents = _of_kind(self.events, "dependent")
        while True:
            more = {n for n in dependents if n not in later and refs(self._binding(n)) & later}
            if not more:
                return [n for n in self.variables if n in later]
            later |= more

    def _binding(self, name: str) -> Expr:
        binding = self.variables[name].binding
        assert binding is not None
        return binding

    def _bindings(self, later: Sequence[str]) -> tuple[list[Step], list[ScalarEquation]]:
        """Steps for the dependent parameters known from the start, equations for those that initialisation finds."""
        names = _of_kind(self.events, "dependent")
        made = {n: ScalarEquation(Ref(n), _without_events(self._binding(n)), self.variables[n].place) for n in names}
        early = [made[n] for n in names if n not in later]
        owner = {e.left.name: k for k, e in enumerate(early) if isinstance(e.left, Ref)}
        return solve_order(early, owner), [made[n] for n in names if n in later]

    def _initial_equations(self) -> list[ScalarEquation]:
        return [e for e in self.events.initial if self._stated_before(e) is None]

    def _stated_before(self, e: ScalarEquation) -> tuple[str, Expr] | None:
        """pre(v) and its value, where an initial equation states it for a v that a when-clause assigns at the start."""
        for side, other in ((e.left, e.right), (e.right, e.left)):
            name = self.before.get(side.name) if isinstance(side, Ref) else None
            if name in self.events.from_when and INITIAL in refs(self.events.from_when[name].right):
                return pre(name), other
        return None

    def _discrete_equations(self) -> Iterator[ScalarEquation]:
        """Discrete variables at the start: their equations hold; when-clauses act only under initial()."""
        yield from self.events.discrete.values()
        stated = {n for e in self.events.initial for n in refs(e.left) | refs(e.right)}
        for name, e in self.events.from_when.items():
            if INITIAL in refs(e.right):
                yield e
            elif name not in stated and pre(name) not in stated:
                yield self._start_equation(name)

    def _at_start(self, e: ScalarEquation) -> ScalarEquation:
        left, right = self._value_at_start(e.left), self._value_at_start(e.right)
        if isinstance(e.left, Ref) and e.left.name in self.before:
            left = Ref(self.before[e.left.name])  # an initial equation for pre(v)
        return ScalarEquation(left, _never_new(right, self.events.hidden), e.place)

    def _value_at_start(self, expr: Expr) -> Expr:
        """initial() is true; when-conditions have not just become true; pre() is the start value."""
        return substitute(rebuild(expr, self._undelayed), self._before_start)

    def _undelayed(self, node: Expr) -> Expr | None:
        """delay(u, T) is u at the start."""
        if not (isinstance(node, Op) and node.name == "delayed"):
            return None
        return next(rebuild(d.value, self._undelayed) for d in self.events.delays if Text(d.name) == node.args[0])

    @cached_property
    def _before_start(self) -> dict[str, Expr]:
        values: dict[str, Expr] = {INITIAL: ONE}
        for before, name in self.before.items():
            if name in self.events.hidden:
                values[before] = Ref(name)  # c and not pre(c) is false
            elif name in self.events.from_when:
                values[before] = (
                    self._start_value(name) if INITIAL in refs(self.events.from_when[name].right) else Ref(name)
                )
            else:
                values[before] = self._start_value(name)
        for s in self.events.samplers:
            values[s.flag] = values[pre(s.flag)] = ZERO
        values.update(found for e in self.events.initial if (found := self._stated_before(e)) is not None)
        return values

    def _start_value(self, name: str) -> Expr:
        v = self.variables.get(name)
        start = v.start if v is not None else None
        return _without_events(start) if start is not None else ZERO

    def _number(self, name: str) -> float | None:
        value = self._start_value(name)
        return value.value if isinstance(value, Num) else None

    def _start_equation(self, name: str) -> ScalarEquation:
        return ScalarEquation(Ref(name), self._start_value(name), self.variables[name].place)

    def _matched(
        self, equations: list[ScalarEquation], unknowns: set[str], certain: int
    ) -> tuple[dict[str, int], list[ScalarEquation], set[str], tuple[ScalarEquation, ...]]:
        """A complete matching; variables without an initial equation start from their start values. Of the equations
        behind the ``certain`` ones, which are conditions of the start alone, some may say what follows from others."""
        ordered = sorted(unknowns)
        running = len(self.events.equations)  # these come first
        options = [self._options(e, unknowns, k < running) for k, e in enumerate(equations)]
        owner, left = matching(options[:certain], ordered)
        left += [k for k in range(certain, len(equations)) if not augment(k, options, unknowns, owner)]
        surplus = tuple(equations[k] for k in left)
        wrong = [e for k, e in zip(left, surplus, strict=True) if k < certain or self._contradicts(e)]
        if wrong:
            raise ModelicaError(
                f"{wrong[0].place}: too many initial conditions: this equation finds nothing left to determine at the "
                "start; remove it, or a fixed=true"
            )
        defaults: set[str] = set()
        known = set(ordered)
        for name in self._defaultable():
            if len(owner) == len(known):
                break
            if name in known:
                equations.append(self._start_equation(name))
                options.append([name])
                if augment(len(equations) - 1, options, known, owner):
                    defaults.add(name)
        missing = sorted(known - set(owner))
        if missing:
            v = self.variables.get(missing[0].removeprefix("der(").removesuffix(")"))
            raise ModelicaError(
                f"{v.place if v else self.events.scalar.flat.name}: nothing determines '{missing[0]}' at the start: "
                "give it a start value with fixed=true, or an initial equation"
            )
        return owner, equations, defaults, surplus

    def _contradicts(self, e: ScalarEquation) -> bool:
        """Whether an equation of known start values does not hold; one that holds only for these numbers does, too."""
        read = refs(e.left) | refs(e.right)
        kept = {n for n in self.events.states if self.variables[n].fixed and self._number(n) is not None}
        return bool(read) and read <= kept and evaluate(op("-", e.left, e.right), self._starts()) != 0

    def _options(self, e: ScalarEquation, unknowns: set[str], running: bool) -> list[str]:
        """A discrete variable is determined by the equation that defines it or states it at the start, by no other."""
        options = preference(e, unknowns)
        discrete = set(self.discrete)
        if running:
            return [n for n in options if n not in discrete]
        if isinstance(e.left, Ref) and e.left.name in discrete:
            return [e.left.name]
        if isinstance(e.right, Ref) and e.right.name in discrete:
            return [e.right.name]
        return [n for n in options if n not in discrete]

    def _defaultable(self) -> list[str]:
        named = [*self.events.states, *self.discrete, *_of_kind(self.events, "free")]
        present = [n for n in named if n in self.variables]
        return sorted(present, key=lambda n: self.variables[n].start is None)

    def _starts(self) -> dict[str, float]:
        """Numbers in the block before anything is computed."""
        found = {}
        for name, v in self.variables.items():
            source = v.binding if v.kind in ("parameter", "constant") else v.start
            if isinstance(source, Num):
                found[name] = source.value
        relations = {r.name for r in self.events.relations}
        for name, e in self.events.discrete.items():  # a mode that is to be tried first
            turned = isinstance(e.right, Op) and e.right.name == "not"
            relation = e.right.args[0] if isinstance(e.right, Op) and turned else e.right
            if isinstance(relation, Ref) and relation.name in relations and name in found:
                found[relation.name] = float((found[name] == 0) == turned)
        return found


def _without_events(expr: Expr) -> Expr:
    def change(node: Expr) -> Expr | None:
        if isinstance(node, Op) and node.name in ("noEvent", "smooth"):
            return _without_events(node.args[-1])
        return None

    return rebuild(expr, change)


def _never_new(expr: Expr, hidden: Iterable[str]) -> Expr:
    """c and not c, what is left of an edge at the start, is false."""
    names = set(hidden)

    def change(node: Expr) -> Expr | None:
        if isinstance(node, Op) and node.name == "and" and isinstance(node.args[0], Ref) and node.args[0].name in names:
            return ZERO if node.args[1] == Op("not", (node.args[0],)) else None
        return None

    return rebuild(expr, change)


def _assemble(
    events: EventModel,
    aliases: Mapping[str, str],
    derivatives: tuple[Step, ...],
    event: tuple[Step, ...],
    start: _Initial,
) -> HybridModel:
    rates = {der(s) for s in events.states}
    return HybridModel(
        flat=events.scalar.flat,
        variables=events.scalar.variables,
        states=events.states,
        discrete=tuple(_discrete(events)),
        hidden=frozenset(events.hidden),
        clocked=frozenset((*events.hidden, *events.from_when)),
        algebraic=tuple(n for n in _unknowns(events, aliases) if n not in rates),
        inputs=tuple(_of_kind(events, "input")),
        settable=tuple(_of_kind(events, "parameter")),
        computed=tuple(_of_kind(events, "dependent", "free", "constant")),
        aliases=aliases,
        dependent=start.dependent,
        derivatives=derivatives,
        event=event,
        initialisation=start.steps,
        starts=start.starts,
        solved_at_start=start.solved,
        guesses=start.guesses,
        surplus=start.surplus,
        relations=events.relations,
        relations_at_start=start.relations,
        samplers=events.samplers,
        reinits=events.reinits,
        assertions=events.assertions,
        checks=events.checks,
        delays={d: room(d, events.scalar.flat.experiment.step, start.dependent, start.starts) for d in events.delays},
        homotopy=any(HOMOTOPY in sources(step) for step in start.steps) or any(map(_blends, start.relations)),
    )


def _blends(expr: Expr) -> bool:
    return HOMOTOPY in refs(expr)
