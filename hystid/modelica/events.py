"""Pass 2: everything that happens at instants is given a name.

Relations outside noEvent become frozen variables with an indicator function; when-conditions, ``sample`` and the values
assigned in when-clauses become discrete variables with one defining equation each.
"""

from __future__ import annotations

from collections.abc import Iterator, Set
from dataclasses import replace

from hystid.errors import ModelicaError
from hystid.modelica.event_model import (
    BEGIN,
    HOMOTOPY,
    INITIAL,
    Delay,
    EventModel,
    Reinit,
    Relation,
    Sampler,
    der,
    pre,
)  # fmt: skip
from hystid.modelica.expr import ONE, RELATIONS, ZERO, Expr, Num, Op, Ref, Text, nodes, op, rebuild, refs
from hystid.modelica.flat import Action, Assertion, Branch, Place
from hystid.modelica.matching import matching
from hystid.modelica.scalar import ScalarEquation, ScalarModel

_ROUNDING = frozenset({"floor", "ceil", "integer", "div", "mod", "rem"})
_RUNNING = ("der", "pre", "edge", "change", "sample", "delay", "initial")  # operators on a model that runs


def name_events(scalar: ScalarModel, corners: Set[Expr] = frozenset()) -> EventModel:
    """The model with named events. Raises ModelicaError for what has no meaning at events.

    corners: relations inside ``smooth(0, ...)`` and ``noEvent`` that make events; the others there make none.
    """
    return _Namer(scalar, corners).run()


def is_cornered(node: Op) -> bool:
    """Whether relations inside may be corners of a loop, which make events where it is linear between them."""
    return node.name == "noEvent" or (node.name == "smooth" and node.args[0] == ZERO)


def mark_corners(scalar: ScalarModel) -> tuple[EventModel, tuple[Expr, ...]]:
    """The model in which the k-th relation inside ``smooth(0, ...)`` and ``noEvent`` stands as an operation "corner" of
    it and k, and these relations."""
    namer = _Namer(scalar, None)
    return namer.run(), tuple(namer.marked)


class _Namer:
    def __init__(self, scalar: ScalarModel, corners: Set[Expr] | None) -> None:
        self.scalar = scalar
        self.corners = corners
        self.marked: dict[Expr, int] = {}
        self.variables = scalar.variables
        self.states = tuple(sorted(self._find_states(), key=list(self.variables).index))
        self.assigned = {a.target for w in scalar.whens for b in w.branches for a in b.actions if a.kind == "assign"}
        self.assigned |= {e.left.name for e in scalar.held if isinstance(e.left, Ref)}
        self.hidden: dict[str, ScalarEquation] = {}
        self.relations: dict[Expr, Relation] = {}
        self.samplers: dict[Expr, Sampler] = {}
        self.delays: dict[Expr, Delay] = {}
        self.memos: dict[bool | None, dict[Expr, Expr]] = {True: {}, False: {}, None: {}}
        self.place = Place()
        self.discrete_names = self._find_discrete()

    def _find_states(self) -> set[str]:
        found = set()
        for e in self._all_equations():
            for side in (e.left, e.right):
                for node in _ops(side, "der"):
                    argument = node.args[0]
                    if not isinstance(argument, Ref):
                        raise ModelicaError(
                            f"{e.place}: der() takes one variable: give the expression a name and derive that"
                        )
                    found.add(argument.name)
        for v in self.variables.values():
            for name in (n for n in _RUNNING if v.start is not None and any(_ops(v.start, n))):
                raise ModelicaError(
                    f"{v.place}: the start value of '{v.name}' holds {name}(), which means nothing before the start: "
                    f"write an initial equation, {v.name} = ..."
                )
        for name in found:
            if self.variables[name].kind != "unknown":
                raise ModelicaError(
                    f"{self.variables[name].place}: der({name}) of an {self.variables[name].kind} is not supported: "
                    "declare the derivative as an input of its own"
                )
        return found

    def _all_equations(self) -> tuple[ScalarEquation, ...]:
        return (*self.scalar.equations, *self.scalar.initial)

    def _find_discrete(self) -> set[str]:
        """Variables that change at events only."""
        found = {
            v.name
            for v in self.variables.values()
            if v.kind == "unknown"
            and (v.flat.type != "Real" or v.flat.variability == "discrete" or v.name in self.assigned)
        } - self._boolean_without_events()
        for node in (n for expr in self._at_events() for n in _ops(expr, "pre")):
            if isinstance(node.args[0], Ref):
                found |= self._still(node.args[0].name, found) or set()
        return found

    def _at_events(self) -> Iterator[Expr]:
        """Expressions in which ``pre`` may stand."""
        for e in (*self._all_equations(), *self.scalar.held):
            yield from (e.left, e.right)
        for branch in (b for w in self.scalar.whens for b in w.branches):
            yield from branch.conditions
            yield from (part for a in branch.actions for part in (a.value, a.guard) if part is not None)

    def _still(self, name: str, known: Set[str], asked: Set[str] = frozenset()) -> set[str] | None:
        """A Real and what it follows from, where all that changes at events alone, as the input of a unit delay behind
        a sampler; None where it may run."""
        v = self.variables.get(name)
        if name in known or (v is not None and v.kind in ("parameter", "dependent", "constant", "free")):
            return set()
        if v is None or v.kind != "unknown" or v.flat.type != "Real" or name in self.states or name in asked:
            return None
        for e in self.scalar.equations:
            for this, other in ((e.left, e.right), (e.right, e.left)):
                if this != Ref(name) or any(_ops(other, "delay")):
                    continue
                parts = [self._still(n, known, {*asked, name}) for n in sorted(refs(_without_pre(other)))]
                found = [part for part in parts if part is not None]
                if len(found) == len(parts):
                    return {name}.union(*found)
        return None

    def _boolean_without_events(self) -> set[str]:
        """b = noEvent(x > 0) changes without events: it is computed like a Real. Not so where only what changes at
        events stands in noEvent, as the subscript of an array."""
        typed: dict[str, set[str]] = {}  # such variables, and what stands in their noEvent
        for e in self.scalar.equations:
            for v, other in ((e.left, e.right), (e.right, e.left)):
                if isinstance(v, Ref) and v.name in self.variables and v.name not in self.assigned:
                    inside = {name for n in _ops(other, "noEvent") for name in refs(n)}
                    if self.variables[v.name].flat.type != "Real" and inside:
                        typed.setdefault(v.name, set()).update(inside)
        running = {n for inside in typed.values() for n in inside if self._runs(n)}
        loose: set[str] = set()
        while more := {name for name, inside in typed.items() if inside & (running | loose)} - loose:
            loose |= more
        return loose

    def _runs(self, name: str) -> bool:
        """Whether it is time or a Real that may change between events."""
        v = self.variables.get(name)
        if v is None:
            return True
        still = v.kind in ("parameter", "dependent", "constant", "free") or v.flat.variability == "discrete"
        return v.flat.type == "Real" and not still and name not in self.assigned

    def run(self) -> EventModel:
        discrete, continuous = self._split()
        hidden = self.hidden
        from_when, reinits, checks = self._whens(hidden)
        equations = tuple(self._named_equation(e) for e in continuous)
        defined = {name: self._named_equation(e) for name, e in discrete.items()}
        assertions = tuple(self._assertion(a) for a in self.scalar.assertions)
        initial = tuple(self._named_equation(e, events=False) for e in self.scalar.initial)
        ticks = tuple(s.flag for s in self.samplers.values())
        return EventModel(
            self.scalar,
            self.states,
            {**hidden, **defined},
            (*ticks, *hidden),
            from_when,
            equations,
            initial,
            tuple(self.relations.values()),
            tuple(self.samplers.values()),
            tuple(reinits),
            assertions,
            tuple(checks),
            tuple(self.delays.values()),
        )

    # -- discrete equations

    def _split(self) -> tuple[dict[str, ScalarEquation], list[ScalarEquation]]:
        """Equations that state a discrete variable, and the others."""
        wanted = self.discrete_names - self.assigned
        discrete: dict[str, ScalarEquation] = {}
        equations = self.scalar.equations
        owner, _ = matching([self._may_state(e, wanted) for e in equations], sorted(wanted))
        taken = {k: name for name, k in owner.items()}
        continuous = [e for k, e in enumerate(equations) if k not in taken]
        for k, name in sorted(taken.items()):
            e = equations[k]
            assert isinstance(name, str)
            other = e.right if isinstance(e.left, Ref) and e.left.name == name else e.left
            discrete[name] = ScalarEquation(Ref(name), other, e.place)
        missing = sorted(wanted - set(discrete))
        if missing:
            v = self.variables[missing[0]]
            raise ModelicaError(
                f"{v.place}: the {v.flat.type} variable '{v.name}' has no equation of the form {v.name} = ..., "
                "and no when-clause assigns it: write one"
            )
        return discrete, continuous

    def _may_state(self, e: ScalarEquation, wanted: Set[str]) -> list[str]:
        """Discrete variables that an equation may determine; v = n with a continuous v determines v."""
        found = []
        for name in _stated(e):
            other = e.right if isinstance(e.left, Ref) and e.left.name == name else e.left
            v = self.variables.get(other.name) if isinstance(other, Ref) else None
            running = v is not None and v.kind == "unknown" and v.name not in self.discrete_names
            if name in wanted and not running:
                found.append(name)
        return found

    # -- when-clauses

    def _whens(
        self, hidden: dict[str, ScalarEquation]
    ) -> tuple[dict[str, ScalarEquation], list[Reinit], list[tuple[Expr, Assertion]]]:
        values: dict[str, Expr] = {}
        places: dict[str, Place] = {}
        reinits: list[Reinit] = []
        checks: list[tuple[Expr, Assertion]] = []
        for number, when in enumerate(self.scalar.whens, start=1):
            before: Expr = ZERO
            mine: dict[str, list[tuple[Expr, Expr]]] = {}
            for k, branch in enumerate(when.branches, start=1):
                fires = self._fires(branch, f"$when{number}.{k}", hidden)
                active = op("and", fires, op("not", before)) if before != ZERO else fires
                before = op("or", before, fires)
                for action in branch.actions:
                    self._act(action, active, mine, reinits, checks)
                    places[action.target] = action.place
            for name, cases in mine.items():
                if name in values:
                    raise ModelicaError(
                        f"{places[name]}: '{name}' is assigned in two when-clauses: join them by elsewhen"
                    )
                values[name] = _cases(cases, Ref(pre(name)))
        for e in self.scalar.held:
            assert isinstance(e.left, Ref)
            if e.left.name in values:
                raise ModelicaError(
                    f"{e.place}: '{e.left.name}' is assigned in an algorithm and in a when-clause: keep one of them"
                )
            self.place = places[e.left.name] = e.place
            values[e.left.name] = self._named(e.right)
        return {n: ScalarEquation(Ref(n), v, places[n]) for n, v in values.items()}, reinits, checks

    def _fires(self, branch: Branch, label: str, hidden: dict[str, ScalarEquation]) -> Expr:
        fires: Expr = ZERO
        self.place = branch.place
        for j, condition in enumerate(branch.conditions, start=1):
            if condition == Op("initial", ()):
                fires = op("or", fires, Ref(INITIAL))
                continue
            name = f"{label}.{j}" if len(branch.conditions) > 1 else label
            hidden[name] = ScalarEquation(Ref(name), self._named(condition), branch.place)
            fires = op("or", fires, op("and", Ref(name), op("not", Ref(pre(name)))))
        return fires

    def _act(
        self,
        action: Action,
        active: Expr,
        mine: dict[str, list[tuple[Expr, Expr]]],
        reinits: list[Reinit],
        checks: list[tuple[Expr, Assertion]],
    ) -> None:
        self.place = action.place
        if action.guard is not None:
            active = op("and", active, self._named(action.guard, events=False))
        value = self._named(action.value, events=False)
        if action.kind == "assign":
            if self.variables[action.target].kind != "unknown":
                raise ModelicaError(
                    f"{action.place}: '{action.target}' is not a variable that a when-clause may assign"
                )
            mine.setdefault(action.target, []).append((active, value))
        elif action.kind == "reinit":
            if action.target not in self.states:
                raise ModelicaError(
                    f"{action.place}: reinit({action.target}) needs a state, that is a variable whose der() appears"
                )
            reinits.append(Reinit(action.target, value, active, action.place))
        else:
            message = action.message if action.message is not None else ZERO
            checks.append((active, Assertion(value, message, action.level, action.place)))

    def _assertion(self, a: Assertion) -> Assertion:
        self.place = a.place
        message = rebuild(a.message, lambda n: self._loose(n) if isinstance(n, Op) and n.name == "String" else None)
        return replace(a, condition=self._loose(a.condition), message=message)

    def _loose(self, expr: Expr) -> Expr:
        if isinstance(expr, Op) and expr.name == "String":
            return Op("String", (self._named(expr.args[0], events=False),))
        return self._named(expr, events=False)

    # -- names inside expressions

    def _named_equation(self, e: ScalarEquation, events: bool = True) -> ScalarEquation:
        self.place = e.place
        return ScalarEquation(self._named(e.left, events), self._named(e.right, events), e.place)

    def _named(self, expr: Expr, events: bool | None = True) -> Expr:
        """The expression with derivatives, pre-values, relations and samples replaced by names. events: whether its
        relations make events; None: only those do that are wanted as corners."""

        def change(node: Expr) -> Expr | None:
            if not isinstance(node, Op):
                return None
            if node.name in ("der", "pre", "edge", "change"):
                return self._of_variable(node)
            if node.name in ("initial", "terminal"):
                return Ref(INITIAL) if node.name == "initial" else ZERO
            if node.name in ("noEvent", "smooth"):
                return self._named(node.args[-1], events=None if events is not False and is_cornered(node) else False)
            if node.name == "sample":
                return Ref(self._sampler(node).flag)
            if node.name == "delay":
                return self._delayed(node, events)
            if node.name == "homotopy":
                return _blended(self._named(node.args[0], events), self._named(node.args[1], events=False))
            if events and node.name in RELATIONS:
                return self._relation(node)
            if events is None and node.name in RELATIONS:
                return self._corner(node)
            if events and node.name in _ROUNDING:
                return self._rounding(node)
            return None

        return rebuild(expr, change, self.memos[events])

    def _of_variable(self, node: Op) -> Expr:
        argument = node.args[0]
        if node.name == "edge" and not isinstance(argument, Ref):
            name = f"$edge{len(self.hidden) + 1}"
            self.hidden[name] = ScalarEquation(Ref(name), self._named(argument), self.place)
            return op("and", Ref(name), op("not", Ref(pre(name))))
        if not isinstance(argument, Ref):
            raise ModelicaError(
                f"{self.place}: {node.name}() takes one variable: give the operand a name, Boolean b = <condition>"
            )
        name = argument.name
        if node.name == "der":
            return Ref(der(name))
        if name in self.states and node.name == "pre":
            return argument  # before reinit acts, the state still has its value from the left
        if name not in self.discrete_names:
            kind = self.variables[name].kind if name in self.variables else "variable"
            if kind in ("parameter", "dependent", "constant"):
                return argument if node.name == "pre" else ZERO
            raise ModelicaError(
                f"{self.place}: {node.name}({name}) needs a discrete variable: '{name}' changes continuously; "
                "assign it in a when-clause, or declare it Boolean or Integer"
            )
        before = Ref(pre(name))
        if node.name == "pre":
            return before
        return op("and", argument, op("not", before)) if node.name == "edge" else op("<>", argument, before)

    def _continuous(self, expr: Expr) -> bool:
        """Whether the value can change between events."""
        for name in refs(expr):
            v = self.variables.get(name)
            if name == "time" or name.startswith("der(") or (v and v.kind == "input" and v.flat.type == "Real"):
                return True
            if v and v.kind == "unknown" and name not in self.discrete_names:
                return True
        return False

    def _relation(self, node: Op) -> Expr:
        a, b = (self._named(x) for x in node.args)
        bare = op(node.name, a, b)
        if node.name in ("==", "<>") or not self._continuous(bare) or not isinstance(bare, Op):
            return bare
        opposite = {">": "<=", "<=": ">", ">=": "<", "<": ">="}
        turned = op(opposite[bare.name], *bare.args)
        if turned in self.relations:  # x <= y is the same event as x > y
            return op("not", Ref(self.relations[turned].name))
        if bare not in self.relations:
            indicator = op("-", a, b) if node.name in (">", "<=") else op("-", b, a)
            name = f"$relation{len(self.relations) + 1}"
            self.relations[bare] = self._timed(name, bare, a, b) or Relation(name, bare, (indicator,))
        return Ref(self.relations[bare].name)

    def _corner(self, node: Op) -> Expr:
        bare = op(node.name, *(self._named(x, events=None) for x in node.args))
        if node.name in ("==", "<>") or not self._continuous(bare):
            return bare
        if self.corners is None:
            return Op("corner", (bare, Num(float(self.marked.setdefault(bare, len(self.marked))))))
        return self._relation(node) if bare in self.corners else bare

    def _timed(self, name: str, node: Op, a: Expr, b: Expr) -> Relation | None:
        """A relation between time and something that holds between events has a known instant."""
        if a == Ref("time") and not self._continuous(b):
            instant, later, behind = b, node.name in (">", ">="), node.name in (">", "<=")
        elif b == Ref("time") and not self._continuous(a):
            instant, later, behind = a, node.name in ("<", "<="), node.name in ("<", ">=")
        else:
            return None
        instant = self._behind_begin(instant) if behind else instant
        passed = op("hy_passed", Ref("time"), instant)
        return Relation(name, passed if later else op("not", passed), (), instant)

    def _behind_begin(self, instant: Expr) -> Expr:
        """The instant of ``time > instant``, which does not hold at the begin of a run yet: ``if time > 0 then a/time
        else b`` is guarded there. So far behind it that the event is one of its own (``hy_is_reached``)."""
        later = op("+", Num(1e-6 * self.scalar.flat.experiment.step), op("*", Num(1e-13), op("abs", instant)))
        return op("if", op("==", instant, Ref(BEGIN)), op("+", instant, later), instant)

    def _rounding(self, node: Op) -> Expr:
        """floor, ceil, integer, div, mod, rem of continuous values: their whole-number part is frozen."""
        args = [self._named(a) for a in node.args]
        if not any(self._continuous(a) for a in args):
            return op(node.name, *args)
        if node.name in ("floor", "integer"):
            return self._frozen_floor(args[0])
        if node.name == "ceil":
            return op("neg", self._frozen_floor(op("neg", args[0])))
        x, y = args
        if node.name == "mod":
            return op("-", x, op("*", self._frozen_floor(op("/", x, y)), y))
        ratio = op("/", x, y)
        positive = self._relation(Op(">=", (ratio, ZERO)))
        whole = op("if", positive, self._frozen_floor(ratio), op("neg", self._frozen_floor(op("neg", ratio))))
        return whole if node.name == "div" else op("-", x, op("*", whole, y))

    def _frozen_floor(self, x: Expr) -> Expr:
        value = op("floor", x)
        if value not in self.relations:
            name = f"$relation{len(self.relations) + 1}"
            above, below = op("-", x, op("+", Ref(name), ONE)), op("-", Ref(name), x)
            self.relations[value] = Relation(name, value, (below, op("neg", above)))
        return Ref(self.relations[value].name)

    def _delayed(self, node: Op, events: bool | None) -> Expr:
        value, time, most = (self._named(node.args[k], events) for k in (0, 1, -1))
        key = Op("delay", (value, time, most))
        if key not in self.delays:
            name = f"$delay{len(self.delays) + 1}"
            self.delays[key] = Delay(name, value, time, most, not self._continuous(time), self.place)
        return Op("delayed", (Text(self.delays[key].name), op("-", Ref("time"), time)))

    def _sampler(self, node: Op) -> Sampler:
        if node not in self.samplers:
            if any(self._continuous(a) for a in node.args):
                raise ModelicaError(f"{self.place}: start and interval of sample() must be parameters")
            self.samplers[node] = Sampler(f"$sample{len(self.samplers) + 1}", *node.args)
        return self.samplers[node]


def _blended(actual: Expr, simplified: Expr) -> Expr:
    """Between what is easy to solve and what is meant; the latter alone, to the bit, at the end."""
    share = Ref(HOMOTOPY)
    between = op("+", op("*", share, actual), op("*", op("-", ONE, share), simplified))
    return op("if", op(">=", share, ONE), actual, between)


def _cases(cases: list[tuple[Expr, Expr]], otherwise: Expr) -> Expr:
    result = otherwise
    for active, value in reversed(cases):
        result = op("if", active, value, result)
    return result


def _stated(e: ScalarEquation) -> Iterator[str]:
    for this, other in ((e.left, e.right), (e.right, e.left)):
        if isinstance(this, Ref) and this.name not in refs(_without_pre(other)):
            yield this.name


def _without_pre(expr: Expr) -> Expr:
    return rebuild(expr, lambda n: ZERO if isinstance(n, Op) and n.name in ("pre", "edge", "change") else None)


def _ops(expr: Expr, name: str) -> Iterator[Op]:
    return (n for n in nodes(expr) if isinstance(n, Op) and n.name == name)
