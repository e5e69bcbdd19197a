"""Pass 5: what is computed at the start, and in which order."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

from hystid.errors import ModelicaError
from hystid.modelica.blocks import Assign, Solve, Step, preference, solve_order, targets
from hystid.modelica.event_model import INITIAL, EventModel, pre
from hystid.modelica.expr import ONE, ZERO, Expr, Num, Op, Ref, Text, evaluate, op, rebuild, refs, substitute
from hystid.modelica.matching import augment, matching
from hystid.modelica.scalar import ScalarEquation


@dataclass(frozen=True)
class Initial:
    """What gives a model its values at the start.

    dependent: parameters from parameters. steps: everything else; solved: what these give. guesses: start values of
    loops that follow from parameters. surplus: initial conditions that must follow from the others. relations: values
    of the relations.
    """

    steps: tuple[Step, ...]
    solved: frozenset[str]
    starts: Mapping[str, float]
    dependent: tuple[Step, ...]
    relations: tuple[Expr, ...]
    guesses: tuple[Assign, ...]
    surplus: tuple[ScalarEquation, ...]


class Initialisation:
    """Everything is unknown at the start but time, inputs, settable parameters and what has a plain start value."""

    def __init__(self, events: EventModel, aliases: Mapping[str, str]) -> None:
        self.events = events
        self.variables = events.scalar.variables
        self.aliases = aliases
        self.discrete = [n for n in events.all_discrete() if n not in {s.flag for s in events.samplers}]
        self.before = {pre(n): n for n in self.discrete}

    def run(self) -> Initial:
        free = self._parameters_known_later()
        dependent, bindings = self._bindings(free)
        initial = [e for e in self.events.initial if self._stated_before(e) is None]
        equations = [self._at_start(e) for e in self.events.equations] + bindings
        equations += [self._at_start(e) for e in self._discrete_equations()]
        certain = len(equations)
        equations += [self._at_start(e) for e in initial]
        timed = set(self.discrete)  # for these, fixed is about pre()
        fixed = [n for n in self.events.of_kind("unknown") if self.variables[n].fixed and n not in timed]
        kept = {n for n in fixed if self._number(n) is not None and n in self.events.states}
        unknowns = {*self.events.unknowns(self.aliases), *self.events.states, *self.discrete, *free} - kept
        equations += [self._start_equation(n) for n in dict.fromkeys(fixed) if n not in kept]
        owner, equations, defaults, surplus = self._matched(equations, unknowns, certain)
        steps = solve_order(equations, owner, self.events.guessed())
        steps = [s for s in steps if not (isinstance(s, Assign) and s.variable in defaults and self._plain(s))]
        solved = frozenset(t for s in steps for t in targets(s))
        relations = tuple(self._value_at_start(r.value) for r in self.events.relations)
        guesses = tuple(self._guesses(steps, {n for s in dependent for n in targets(s)}))
        return Initial(tuple(steps), solved, self._starts(), tuple(dependent), relations, guesses, surplus)

    def _guesses(self, steps: Iterable[Step], known: set[str]) -> Iterator[Assign]:
        """Where Newton's method begins, of variables whose start value is no number but follows from parameters."""
        known = known | {*self.events.of_kind("parameter", "constant")}
        for name in (n for s in steps if isinstance(s, Solve) and not s.linear for n in s.variables):
            value = self._start_value(name)
            if not isinstance(value, Num) and refs(value) <= known:
                yield Assign(name, value, self.variables[name].place)

    def _plain(self, step: Assign) -> bool:
        """A state that starts from a number keeps what is in the block, so that a user may set it."""
        return step.variable in self.events.states and isinstance(step.value, Num)

    def _parameters_known_later(self) -> list[str]:
        """Parameters with fixed=false and those that depend on them."""
        later = set(self.events.of_kind("free"))
        dependents = self.events.of_kind("dependent")
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
        names = self.events.of_kind("dependent")
        made = {n: ScalarEquation(Ref(n), _without_events(self._binding(n)), self.variables[n].place) for n in names}
        early = [made[n] for n in names if n not in later]
        owner = {e.left.name: k for k, e in enumerate(early) if isinstance(e.left, Ref)}
        return solve_order(early, owner), [made[n] for n in names if n in later]

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
        named = [*self.events.states, *self.discrete, *self.events.of_kind("free")]
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
