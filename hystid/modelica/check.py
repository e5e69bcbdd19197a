"""Unit check over the flat equations; the front end has none.

Two sides of +, -, =, a relation, min, max or if must have one unit where both are known. Numbers and variables without
a unit fit everything, time as well, so that a model without units is never refused.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import lru_cache

from hystid.errors import ModelicaError
from hystid.modelica.expr import RELATIONS, Expr, Num, Op, Ref, Text
from hystid.modelica.flat import FlatModel, Function, Place, Statement
from hystid.units import BASES, exponents, is_modelica

_ANGLE = BASES.index("rad")


@dataclass(frozen=True)
class Dimension:
    """A known unit: factor to SI and powers of the SI base units, angles counted as numbers."""

    factor: float
    powers: tuple[Fraction, ...]

    def times(self, other: Dimension, sign: int = 1) -> Dimension:
        """Product, or quotient for sign -1."""
        powers = tuple(a + sign * b for a, b in zip(self.powers, other.powers, strict=True))
        return Dimension(self.factor * other.factor**sign, powers)

    def to(self, exponent: Fraction) -> Dimension:
        """Power."""
        return Dimension(self.factor ** float(exponent), tuple(a * exponent for a in self.powers))

    def fits(self, other: Dimension) -> bool:
        """Whether values of both may be added."""
        return self.powers == other.powers and abs(self.factor / other.factor - 1) < 1e-9


def check_units(model: FlatModel, functions: Mapping[str, Mapping[str, str]] | None = None) -> None:
    """Raises ModelicaError, with both units and the line, where units do not fit.

    functions: function -> variable -> unit.
    """
    signatures = {f.name: (f, (functions or {}).get(f.name, {})) for f in model.functions}
    units = {v.name: v.unit for v in model.variables if v.type == "Real" and v.unit}
    checker = _Checker(units, signatures)
    for v in model.variables:
        if v.type == "Real":
            for value in (v.binding, v.start, v.min, v.max, v.nominal):
                if value is not None:
                    checker.same(Op("=", (Ref(v.name), value)), v.place)
    for e in (*model.equations, *model.initial):
        checker.equation(e.residual, e.place)
    for w in model.whens:
        for b in w.branches:
            for condition in b.conditions:
                checker.unit(condition, b.place)
            for a in b.actions:
                if a.kind != "assert":
                    checker.same(Op("=", (Ref(a.target), a.value)), a.place)
    for assertion in model.assertions:
        checker.unit(assertion.condition, assertion.place)
    for function, own in signatures.values():
        _Checker(own, signatures).statements(function.body)


class _Checker:
    def __init__(self, units: Mapping[str, str], signatures: Mapping[str, tuple[Function, Mapping[str, str]]]) -> None:
        self.units = units
        self.signatures = signatures

    def statements(self, body: Sequence[Statement]) -> None:
        """Assignments of a function."""
        for s in body:
            for condition, inner in s.branches:
                self.unit(condition, s.place)
                self.statements(inner)
            if s.kind == "assign" and s.value is not None and len(s.targets) == 1 and s.targets[0] is not None:
                self.same(Op("=", (s.targets[0], s.value)), s.place)

    def equation(self, residual: Expr, place: Place) -> None:
        """A residual left - right, maybe under if."""
        if isinstance(residual, Op) and residual.name == "if":
            self.unit(residual.args[0], place)
            for branch in residual.args[1:]:
                self.equation(branch, place)
        elif isinstance(residual, Op) and residual.name == "-":
            self.same(Op("=", residual.args), place)
        else:
            self.unit(residual, place)

    def same(self, e: Op, place: Place) -> Dimension | None:
        """The common unit of the two last arguments."""
        a, b = e.args[-2], e.args[-1]
        first, second = self.unit(a, place), self.unit(b, place)
        if first and second and not first.fits(second):
            verb = {"=": "equates", "+": "adds", "-": "subtracts"}.get(e.name, "compares")
            raise ModelicaError(
                f"{place}: units do not fit: '{shown(e)}' {verb} {self.name(a, first)} and {self.name(b, second)}"
            )
        return first or second

    def name(self, expr: Expr, unit: Dimension) -> str:
        """The unit as written where the expression is a variable, else in SI base units."""
        if isinstance(expr, Ref) and expr.name in self.units:
            return self.units[expr.name]
        parts = [f"{n}{'' if p == 1 else p}" for n, p in zip(BASES, unit.powers, strict=True) if p]
        text = ".".join(parts) or "1"
        return text if abs(unit.factor - 1) < 1e-9 else f"{unit.factor:g} {text}"

    def unit(self, e: Expr, place: Place) -> Dimension | None:
        """Unit of an expression, None where it is not known."""
        if isinstance(e, Ref):
            return self._of_variable(e.name)
        if not isinstance(e, Op):
            return None
        if e.name.startswith("call "):
            return self._call(e, place)
        if e.name in _ALIKE and len(e.args) == 2:
            return self.same(e, place)
        if e.name in RELATIONS or e.name in ("atan2", "div"):
            self.same(e, place)
            return None
        if e.name == "{}":
            for first, second in itertools.pairwise(e.args):
                self.same(Op("{}", (first, second)), place)
        if e.name == "if":
            self.unit(e.args[0], place)
            return self.same(e, place)
        rule = _RULES.get(e.name)
        known = [self.unit(a, place) for a in e.args]
        if e.name in _OF_NUMBERS:
            self._number(e, e.args[-1], known[-1], place)
        return rule(e, known) if rule else None

    def _number(self, e: Op, argument: Expr, unit: Dimension | None, place: Place) -> None:
        if unit is not None and not unit.fits(_ONE):
            what = "exponent" if e.name in ("^", ".^") else "argument"
            raise ModelicaError(
                f"{place}: units do not fit: '{shown(e)}' takes a plain number as {what}, '{shown(argument)}' has "
                f"{self.name(argument, unit)}: divide by a reference value"
            )

    def _call(self, e: Op, place: Place) -> Dimension | None:
        """Arguments against the units that the function declares; the unit of its first output."""
        name = e.name.removeprefix("call ")
        known = [self.unit(a, place) for a in e.args]
        short = name.removeprefix("Modelica.Math.")
        if short in _OF_NUMBERS:
            self._number(Op(short, e.args), e.args[-1], known[-1], place)
        if name not in self.signatures:
            return None
        function, units = self.signatures[name]
        for variable, argument, unit in zip(function.inputs, e.args, known, strict=False):
            wanted = _dimension(units[variable.name]) if variable.name in units else None
            if wanted and unit and not unit.fits(wanted):
                raise ModelicaError(
                    f"{place}: units do not fit: '{shown(e)}' gives a value in {self.name(argument, unit)} to "
                    f"'{variable.name}' in {units[variable.name]}"
                )
        output = function.outputs[0].name if function.outputs else ""
        return _dimension(units[output]) if output in units else None

    def _of_variable(self, name: str) -> Dimension | None:
        return _dimension(self.units[name]) if name in self.units else None


@lru_cache(maxsize=1024)
def _dimension(unit: str) -> Dimension | None:
    """None for a unit outside Modelica's grammar, whose meaning would be a guess."""
    if not is_modelica(unit):
        return None
    factor, _, powers = exponents(unit)
    found = [Fraction(powers.get(name, 0)) for name in BASES]
    found[_ANGLE] = Fraction(0)
    return Dimension(factor, tuple(found))


_ALIKE = frozenset(("+", "-", "min", "max", "mod", "rem", "homotopy"))
_OF_NUMBERS = frozenset(
    ("sin", "cos", "tan", "asin", "acos", "atan", "sinh", "cosh", "tanh", "exp", "log", "log10", "^", ".^")
)
_ONE = Dimension(1.0, (Fraction(0),) * len(BASES))
_SECOND = Dimension(1.0, tuple(Fraction(name == "s") for name in BASES))

_Known = list[Dimension | None]


def _product(e: Op, known: _Known) -> Dimension | None:
    a, b = known
    return a.times(b) if a and b else None


def _quotient(e: Op, known: _Known) -> Dimension | None:
    a, b = known
    return a.times(b, -1) if a and b else None


def _power(e: Op, known: _Known) -> Dimension | None:
    exponent = e.args[1]
    if known[0] and isinstance(exponent, Num):
        return known[0].to(Fraction(exponent.value).limit_denominator(1000))
    return None


def _root(e: Op, known: _Known) -> Dimension | None:
    return known[0].to(Fraction(1, 2)) if known[0] else None


def _rate(e: Op, known: _Known) -> Dimension | None:
    return known[0].times(_SECOND, -1) if known[0] else None


def _like_first(e: Op, known: _Known) -> Dimension | None:
    return known[0]


def _like_last(e: Op, known: _Known) -> Dimension | None:
    return known[-1]


_RULES: dict[str, Callable[[Op, _Known], Dimension | None]] = {
    "*": _product,
    ".*": _product,
    "/": _quotient,
    "./": _quotient,
    "^": _power,
    ".^": _power,
    "sqrt": _root,
    "der": _rate,
    "noEvent": _like_last,
    "smooth": _like_last,
    **dict.fromkeys(
        ("neg", "abs", "pre", "sum", "min", "max", "[]", "{}", "transpose", "vector", "for", "delay"), _like_first
    ),
}


def shown(e: Expr) -> str:
    """A short Modelica text of an expression, for messages."""
    text = _text(e)
    return text if len(text) <= 70 else text[:67] + "..."


def equation_text(residual: Expr) -> str:
    """A whole equation as its author may have written it."""
    if isinstance(residual, Op) and residual.name == "-":
        return f"{_text(residual.args[0])} = {_text(residual.args[1])}"
    return f"0 = {_text(residual)}"


# How tightly operators bind; operands that bind less get brackets, right of those in _GROUPING the equal ones too.
_BINDING = {"if": 0, "or": 1, "and": 2, "not": 3, "<": 4, "<=": 4, ">": 4, ">=": 4, "==": 4, "<>": 4, "=": -1,
            "+": 5, "-": 5, ".+": 5, ".-": 5, "neg": 5, "*": 6, "/": 6, ".*": 6, "./": 6, "^": 7, ".^": 7}  # fmt: skip
_GROUPING = ("-", "/", ".-", "./")


def _operand(e: Expr, least: int) -> str:
    binding = 9
    if isinstance(e, Op):
        binding = _BINDING.get(e.name, 9)
    elif isinstance(e, Num) and e.value < 0:
        binding = _BINDING["neg"]
    return _text(e) if binding >= least else f"({_text(e)})"


def _text(e: Expr) -> str:
    if isinstance(e, Num):
        return f"{e.value:g}"
    if isinstance(e, Ref):
        return e.name
    if isinstance(e, Text):
        return f'"{e.value}"'
    args = [_text(a) for a in e.args]
    if e.name == "if":
        return f"if {args[0]} then {args[1]} else {args[2]}"
    if e.name in ("neg", "not"):
        return f"{'-' if e.name == 'neg' else 'not '}{_operand(e.args[0], _BINDING[e.name] + 1)}"
    if e.name == "[]":
        return f"{args[0]}[{', '.join(args[1:])}]"
    if e.name == "{}":
        return f"{{{', '.join(args)}}}"
    if len(args) == 2 and e.name in _BINDING:
        own = _BINDING[e.name]
        stricter = e.name in _GROUPING or own in (4, 7) or _is_negative(e.args[1])
        left = _operand(e.args[0], own + (own in (4, 7)))
        return f"{left} {e.name} {_operand(e.args[1], own + stricter)}"
    return f"{e.name.removeprefix('call ')}({', '.join(args)})"


def _is_negative(e: Expr) -> bool:
    return (isinstance(e, Op) and e.name == "neg") or (isinstance(e, Num) and e.value < 0)
