"""Derivatives that a parameter of 0 takes away: a capacitance of 0 is an open circuit, and its voltage no state.

Modelica lets a tool use the value of a parameter when the equations are sorted where its author says so with
``annotation(Evaluate = true)`` (specification 3.6, section 18.3), or where nobody may set it (``final``). It is used
here only where a state goes by it: every other such parameter stays settable.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Mapping, Set
from dataclasses import replace

from hystid.modelica.expr import ZERO, Expr, Op, Ref, nodes, refs, substitute
from hystid.modelica.flat import FlatModel
from hystid.modelica.scalar import ScalarEquation, ScalarModel, ScalarVariable, scalarise


def scalarise_without_vanished(flat: FlatModel, parameters: Mapping[str, float]) -> ScalarModel:
    """The scalar model with ``parameters`` set, and without derivatives that are multiplied by 0 for good.

    Raises ModelicaError as ``scalarise`` does.
    """
    scalar = scalarise(flat, parameters)
    if not (moving := _derived(scalar.equations)):
        return scalar
    if not (zeros := _settled_zeros(scalar.variables)):
        return scalar
    still = _without_zeros(scalar, zeros, moving)
    if _derived(still) >= moving:
        return scalar
    used = {n for a, b in zip(scalar.equations, still, strict=True) if a is not b for n in _read(a) & zeros}
    built_in = {scalar.variables[n].flat.name for n in used}
    scalar = scalarise(flat, parameters, built_in)
    return replace(scalar, equations=_without_zeros(scalar, set(), moving))


def _derived(equations: tuple[ScalarEquation, ...]) -> set[str]:
    """Names whose derivatives the equations hold."""
    return {n for e in equations for side in (e.left, e.right) for n in _under_der(side)}


def _under_der(expr: Expr) -> Iterator[str]:
    for node in nodes(expr):
        if isinstance(node, Op) and node.name == "der":
            yield from refs(node)


def _read(e: ScalarEquation) -> frozenset[str]:
    return refs(e.left) | refs(e.right)


def _settled_zeros(variables: Mapping[str, ScalarVariable]) -> set[str]:
    """Parameters whose value of 0 may be used, and such as follow from them."""
    open_ = {
        n: v
        for n, v in variables.items()
        if not v.flat.dims and (v.kind == "dependent" or (v.kind == "parameter" and (v.flat.evaluate or v.flat.final)))
    }
    zeros: dict[str, Expr] = {n: ZERO for n, v in open_.items() if v.binding == ZERO}
    while more := {n for n, v in open_.items() if n not in zeros and v.binding and _at_zero(v.binding, zeros) == ZERO}:
        zeros |= dict.fromkeys(more, ZERO)
    return set(zeros)


def _without_zeros(scalar: ScalarModel, zeros: Set[str], moving: Set[str]) -> tuple[ScalarEquation, ...]:
    """The equations with 0 for the zeros, and for unknowns that equations then state to be 0, in those of them that
    lead to a derivative; the others as they are, the same objects."""
    equations = list(scalar.equations)
    reading: dict[str, list[int]] = {}
    for k, e in enumerate(equations):
        for read in _read(e):
            reading.setdefault(read, []).append(k)
    values: dict[str, Expr] = {n: ZERO for n in zeros}
    waiting = deque(k for k, e in enumerate(equations) if ZERO in (e.left, e.right))
    waiting.extend(k for n in zeros for k in reading.get(n, ()))
    while waiting:
        k = waiting.popleft()
        e = equations[k]
        for name, value in ((e.left, e.right), (e.right, e.left)):
            if not isinstance(name, Ref) or name.name in values or not _may_be_zero(name.name, scalar, moving):
                continue
            if _at_zero(value, values) == ZERO:
                equations[k] = e if value == ZERO else ScalarEquation(name, ZERO, e.place)
                values[name.name] = ZERO
                waiting.extend(reading[name.name])
                break
    for k in sorted({k for n in moving for k in reading[n]}):
        e = equations[k]
        if e is scalar.equations[k] and not values.keys().isdisjoint(_read(e)) and _holds_der(e):
            equations[k] = ScalarEquation(_at_zero(e.left, values), _at_zero(e.right, values), e.place)
    return tuple(equations)


def _holds_der(e: ScalarEquation) -> bool:
    return any(True for side in (e.left, e.right) for _ in _under_der(side))


def _at_zero(expr: Expr, values: Mapping[str, Expr]) -> Expr:
    return expr if values.keys().isdisjoint(refs(expr)) else substitute(expr, values)


def _may_be_zero(name: str, scalar: ScalarModel, moving: Set[str]) -> bool:
    v = scalar.variables.get(name)
    return (
        v is not None
        and v.kind == "unknown"
        and v.flat.type == "Real"
        and v.flat.variability != "discrete"
        and name not in moving
    )
