"""Algorithm sections of models: run once on expressions, so that each assigned variable gets one equation.

A variable that the section reads before it assigns it holds its start value, or pre() of itself where it changes at
events only (Modelica specification 3.6, section 11.1). A ``when`` acts in the instant in which its condition becomes
true; what it assigns is kept otherwise.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field

from hystid.modelica.expand import Expander, elements
from hystid.modelica.expr import ONE, ZERO, Expr, Num, Op, Ref, op
from hystid.modelica.flat import Action, Assertion, Branch, FlatModel, FlatVariable, Function, Section, Statement, When
from hystid.modelica.inlining import Call, assigned
from hystid.modelica.values import Value, array, flattened, merge

_OUTSIDE = frozenset({"pre", "edge", "change", "der"})


@dataclass
class SectionResult:
    """values: name of a scalar -> its value. held: names of those that keep their value between events.

    whens: what is set anew or checked in when-clauses. assertions: what is checked outside of them.
    """

    values: dict[str, Expr] = field(default_factory=dict)
    held: set[str] = field(default_factory=set)
    whens: list[When] = field(default_factory=list)
    assertions: list[Assertion] = field(default_factory=list)


def run_section(section: Section, flat: FlatModel, expander: Expander) -> SectionResult:
    """What an algorithm section says. Raises ModelicaError for what cannot be written out."""
    expander.place = section.place
    names = set(assigned(section.statements))
    clocked = set(_clocked(section.statements))
    variables = [v for v in flat.variables if v.name in names]
    before = {v.name: _before(v, v.name in clocked, expander) for v in variables}
    body = _Body(expander, Function("algorithm", (), (), (), _protected(section.statements), section.place), [])
    after = body.section(before)
    made = SectionResult(whens=body.whens, assertions=body.assertions)
    for v in variables:
        scalars = elements(v.name, v.dims)
        made.values.update(zip(scalars, flattened(after[v.name]), strict=True))
        if v.name in clocked:
            made.held.update(scalars)
    return made


def _before(v: FlatVariable, clocked: bool, expander: Expander) -> Value:
    if clocked or v.type != "Real" or v.variability == "discrete":
        old: list[Expr] = [Op("pre", (Ref(e),)) for e in elements(v.name, v.dims)]
        return array(old).reshape(v.dims) if v.dims else old[0]
    start = v.start if v.start is not None else ZERO
    filled = Op("fill", (start, *(Num(float(n)) for n in v.dims)))
    value = expander.value(start, {})
    return expander.value(filled, {}) if v.dims and len(flattened(value)) == 1 else value


def _clocked(statements: Sequence[Statement], inside: bool = False) -> Iterator[str]:
    for s in statements:
        if inside and s.kind == "assign":
            yield from assigned([s])
        for _, body in s.branches:
            yield from _clocked(body, inside or s.kind == "when")


def _protected(statements: Sequence[Statement]) -> tuple[Statement, ...]:
    """pre(x) and der(x) speak of the variable, not of the value that it has at this line."""

    def expression(expr: Expr | None) -> Expr | None:
        def change(node: Expr) -> Expr:
            if isinstance(node, Op) and node.name in _OUTSIDE:
                return Op("outside", (node,))
            return Op(node.name, tuple(change(a) for a in node.args)) if isinstance(node, Op) else node

        return None if expr is None else change(expr)

    return tuple(
        Statement(
            s.kind, s.place, s.targets, expression(s.value),
            tuple((expression(c) or ZERO, _protected(body)) for c, body in s.branches), s.name,
        )
        for s in statements
    )  # fmt: skip


class _Body(Call):
    """The statements of a section."""

    def __init__(self, expander: Expander, function: Function, args: list[Value]) -> None:
        super().__init__(expander, function, args)
        self.outer = expander
        self.whens: list[When] = []
        self.assertions: list[Assertion] = []
        self._actions: list[Action] | None = None
        self._around = 0  # conditions that stand around the when-clause

    def when(self, s: Statement) -> None:
        """Runs each branch from the values before; they act in the instant in which a condition becomes true."""
        start = dict(self.values)
        taken: list[tuple[Expr, Mapping[str, Value]]] = []
        branches: list[Branch] = []
        before: Expr = ZERO
        for condition, body in s.branches:
            conditions = tuple(self.outer.flat(condition, self.values))
            fires: Expr = ZERO
            for c in conditions:
                fires = op("or", fires, c if c == Op("initial", ()) else Op("edge", (c,)))
            active = op("and", fires, op("not", before)) if before != ZERO else fires
            before = op("or", before, fires)
            self.values, self._actions = dict(start), []
            self._around = len(self._undecided)
            with self.outer.without_events():
                self._statements(body)
            taken.append((active, self.values))
            branches.append(Branch(conditions, tuple(self._actions), s.place))
            self.values, self._actions = start, None
        for active, values in reversed(taken):
            self.values = {k: merge(active, values.get(k, v), v) for k, v in self.values.items()}
        if any(b.actions for b in branches):
            self.whens.append(When(tuple(branches)))

    def check(self, s: Statement) -> None:
        """An assertion, under the conditions around it."""
        assert (s.value is not None and isinstance(s.targets[0], Op | Num | Ref)) or s.targets
        condition, message = self.outer.scalar(s.value or ONE, self.values), s.targets[0] or ZERO
        if self._actions is not None:
            self._actions.append(Action("assert", "", condition, s.place, self._guard(self._around), message, s.name))
            return
        guard = self._guard(0)
        whole = condition if guard is None else op("or", op("not", guard), condition)
        self.assertions.append(Assertion(whole, message, s.name, s.place))

    def renew(self, s: Statement) -> None:
        """A state is set anew."""
        if self._actions is None:
            self.expander.refuse("reinit() stands in when-clauses only")
        assert s.value is not None
        value = self.outer.scalar(s.value, self.values)
        self._actions.append(Action("reinit", s.name, value, s.place, self._guard(self._around)))

    def _guard(self, first: int) -> Expr | None:
        guard: Expr | None = None
        for condition in self._undecided[first:]:
            guard = condition if guard is None else op("and", guard, condition)
        return guard
