"""Sorting equations: matching, strongly connected blocks, and the solution of each block.

``solve_order`` turns "these equations determine these unknowns" into a list of steps to run one after another.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterable, Iterator, Mapping, Sequence, Set
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from hystid.errors import ModelicaError
from hystid.modelica.differentiation import STEPS, Derivative
from hystid.modelica.expr import LOGICAL, ZERO, Expr, Num, Op, Ref, nodes, op, refs, substitute
from hystid.modelica.flat import Place
from hystid.modelica.scalar import ScalarEquation

Node = TypeVar("Node", bound=Hashable)

# A block is made smaller by substitution while its expressions stay below this many nodes.
_SUBSTITUTION_LIMIT = 400


@dataclass(frozen=True)
class Assign:
    """variable := value."""

    variable: str
    value: Expr
    place: Place


@dataclass(frozen=True)
class Solve:
    """Simultaneous equations residuals = 0 in variables; jacobian[i][j] = d residual i / d variable j.

    linear: the jacobian holds none of the variables, so that one Newton step from anywhere is exact.
    """

    variables: tuple[str, ...]
    residuals: tuple[Expr, ...]
    jacobian: tuple[tuple[Expr, ...], ...]
    linear: bool
    place: Place


Step = Assign | Solve


def targets(step: Step) -> tuple[str, ...]:
    """Variables that a step gives a value."""
    return (step.variable,) if isinstance(step, Assign) else step.variables


def sources(step: Step) -> frozenset[str]:
    """Variables that a step reads from outside."""
    if isinstance(step, Assign):
        return refs(step.value)
    inside = set(step.variables)
    return frozenset(n for r in step.residuals for n in refs(r) if n not in inside)


# -- strongly connected parts


def components(graph: Mapping[Node, Iterable[Node]]) -> list[list[Node]]:
    """Strongly connected components, each after those that it depends on (Tarjan, without recursion).

    graph: node -> nodes that it depends on.
    """
    index: dict[Node, int] = {}
    low: dict[Node, int] = {}
    on_stack: set[Node] = set()
    stack: list[Node] = []
    found: list[list[Node]] = []
    for root in graph:
        if root in index:
            continue
        work = [(root, iter(graph[root]))]
        index[root] = low[root] = len(index)
        stack.append(root)
        on_stack.add(root)
        while work:
            node, rest = work[-1]
            for other in rest:
                if other not in graph:
                    continue
                if other not in index:
                    index[other] = low[other] = len(index)
                    stack.append(other)
                    on_stack.add(other)
                    work.append((other, iter(graph[other])))
                    break
                if other in on_stack:
                    low[node] = min(low[node], index[other])
            else:
                work.pop()
                if work:
                    low[work[-1][0]] = min(low[work[-1][0]], low[node])
                if low[node] == index[node]:
                    found.append(_pop(node, stack, on_stack))
    return found


def _pop(node: Node, stack: list[Node], on_stack: set[Node]) -> list[Node]:
    component = []
    while True:
        member = stack.pop()
        on_stack.discard(member)
        component.append(member)
        if member == node:
            return component[::-1]


# -- solving one equation


def isolate(equation: ScalarEquation, name: str) -> Expr | None:
    """The value of variable ``name`` by undoing + - * / and sign where it stands once; None where that fails."""
    left, right = equation.left, equation.right
    here, there = _contains(left, name), _contains(right, name)
    if here and there:
        return None
    if there:
        left, right = right, left
    while not (isinstance(left, Ref) and left.name == name):
        step = _peel(left, right, name) if isinstance(left, Op) else None
        if step is None:
            return None
        left, right = step
    return right


def _peel(left: Op, right: Expr, name: str) -> tuple[Expr, Expr] | None:
    if left.name == "neg":
        return left.args[0], op("neg", right)
    if left.name not in _INVERSE or _contains(left.args[0], name) == _contains(left.args[1], name):
        return None
    first = _contains(left.args[0], name)
    inner, other = left.args if first else left.args[::-1]
    return inner, _INVERSE[left.name](right, other, first)


_INVERSE: dict[str, Callable[[Expr, Expr, bool], Expr]] = {
    "+": lambda r, o, first: op("-", r, o),
    "-": lambda r, o, first: op("+", r, o) if first else op("-", o, r),
    "*": lambda r, o, first: op("/", r, o),
    "/": lambda r, o, first: op("*", r, o) if first else op("/", o, r),
}


def _contains(expr: Expr, name: str) -> bool:
    return name in refs(expr)


def preference(equation: ScalarEquation, unknowns: frozenset[str] | set[str]) -> list[str]:
    """Unknowns of an equation in the order in which it should rather determine them.

    First those that it states (v = ..., der(v) = ...), then those to which + and - alone lead, then the others.
    """
    inside = [n for n in dict.fromkeys(_ordered_refs(equation)) if n in unknowns]
    ranked = [(_rank(equation, n), k, n) for k, n in enumerate(inside)]
    return [n for _, _, n in sorted(ranked)]


def _ordered_refs(equation: ScalarEquation) -> list[str]:
    return [n.name for side in (equation.left, equation.right) for n in nodes(side) if isinstance(n, Ref)]


def _rank(equation: ScalarEquation, name: str) -> int:
    this, other = equation.left, equation.right
    if isinstance(other, Ref) and other.name == name:
        this, other = other, this
    if isinstance(this, Ref) and this.name == name:
        return 0 if not _contains(other, name) else 4
    while isinstance(this, Op) and this.name in ("+", "-", "neg"):
        inside = [a for a in this.args if _contains(a, name)]
        if len(inside) != 1:
            break
        this = inside[0]
    if isinstance(this, Ref) and this.name == name:
        return 1
    return 2 if name.startswith("der(") else 3


# -- blocks


def solve_block(equations: Sequence[ScalarEquation], unknowns: Sequence[str], guessed: Set[str]) -> list[Step]:
    """Steps that give the unknowns of one block their values; ``guessed`` ones rather stay in the loop."""
    if len(equations) == 1:
        value = isolate(equations[0], unknowns[0])
        if value is not None:
            return [Assign(unknowns[0], value, equations[0].place)]
    rest, left, later = _reduced(list(equations), list(unknowns), guessed)
    return [*_simultaneous(rest, left), *reversed(later)]


def _reduced(
    equations: list[ScalarEquation], unknowns: list[str], guessed: Set[str]
) -> tuple[list[ScalarEquation], list[str], list[Assign]]:
    """Substitutes what an equation states explicitly, as long as one equation and small expressions remain."""
    later: list[Assign] = []
    names = [refs(e.left) | refs(e.right) for e in equations]
    while len(equations) > 1:
        others = [n for n in unknowns if n not in guessed]
        choices = _substitutable(equations, names, others, len(others) < len(unknowns))
        choice = next(choices, None) or next(_substitutable(equations, names, unknowns), None)
        if choice is None:
            break
        k, name, value = choice
        place = equations.pop(k).place
        names.pop(k)
        unknowns.remove(name)
        later.append(Assign(name, value, place))
        for j, e in enumerate(equations):
            if name in names[j]:
                left, right = (substitute(side, {name: value}) for side in (e.left, e.right))
                equations[j], names[j] = ScalarEquation(left, right, e.place), refs(left) | refs(right)
    return equations, unknowns, later


def _substitutable(
    equations: list[ScalarEquation], names: list[frozenset[str]], unknowns: list[str], turned: bool = False
) -> Iterator[tuple[int, str, Expr]]:
    """names: the variables of each equation. turned: whether the right side may state an unknown, too."""
    for k, e in enumerate(equations):
        for name in unknowns:
            sides = (e, ScalarEquation(e.right, e.left, e.place)) if turned else (e,)
            if name not in names[k] or all(_rank(side, name) > 1 for side in sides):
                continue
            value = isolate(e, name)
            if value is None or _contains(value, name):
                continue
            uses = sum(name in other for other in names) - 1
            if uses * sum(1 for _ in nodes(value)) <= _SUBSTITUTION_LIMIT:
                yield k, name, value


def _simultaneous(equations: Sequence[ScalarEquation], unknowns: Sequence[str]) -> list[Step]:
    if len(equations) == 1:
        value = isolate(equations[0], unknowns[0])
        if value is not None:
            return [Assign(unknowns[0], value, equations[0].place)]
    residuals = [op("-", e.left, e.right) for e in equations]
    by = [Derivative(name) for name in unknowns]
    jacobian = [[d(r) for d in by] for r in residuals]
    if any(all(entry == ZERO for entry in row) for row in jacobian) or _is_singular(jacobian):
        raise ModelicaError(
            f"{equations[0].place}: the equations for {', '.join(unknowns[:4])} depend on each other, so that "
            "they have no solution or many (singular)"
        )
    varies = any(set(unknowns) & refs(entry) for row in jacobian for entry in row)
    linear = not varies and not any(has_steps(r, set(unknowns)) for r in residuals)
    if linear and len(unknowns) == 1:
        constant = substitute(residuals[0], {unknowns[0]: ZERO})
        return [Assign(unknowns[0], op("/", op("neg", constant), jacobian[0][0]), equations[0].place)]
    return [Solve(tuple(unknowns), tuple(residuals), tuple(tuple(row) for row in jacobian), linear, equations[0].place)]


def has_steps(residual: Expr, unknowns: Set[str]) -> bool:
    """Whether it jumps with an unknown, as sign(i) does: no derivative tells."""
    stepped = (n for n in nodes(residual) if isinstance(n, Op) and (n.name in STEPS or n.name in LOGICAL))
    return any(refs(n) & unknowns for n in stepped)


def _is_singular(jacobian: Sequence[Sequence[Expr]]) -> bool:
    """Whether a jacobian of numbers has no inverse."""
    numbers = [[e.value for e in row if isinstance(e, Num)] for row in jacobian]
    if any(len(row) < len(jacobian) for row in numbers):
        return False
    values = np.array(numbers)
    scaled = values / np.abs(values).max(axis=1, keepdims=True)
    return bool(np.linalg.matrix_rank(scaled) < len(numbers))


def solve_order(
    equations: Sequence[ScalarEquation], owner: Mapping[str, int], guessed: Set[str] = frozenset()
) -> list[Step]:
    """Steps for a complete matching unknown -> equation, each after those whose results it reads. guessed: unknowns for
    which a start value is stated, where Newton's method may begin."""
    unknown_of = {e: u for u, e in owner.items()}
    names = [refs(e.left) | refs(e.right) for e in equations]
    graph = {k: [owner[n] for n in sorted(names[k]) if n in owner] for k in unknown_of}
    steps: list[Step] = []
    for members in components(graph):
        block = sorted(members)
        steps += solve_block([equations[k] for k in block], [unknown_of[k] for k in block], guessed)
    return steps
