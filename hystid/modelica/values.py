"""Values of an interpreter that computes with expressions: scalars, object arrays of them, and tuples."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import Any, NoReturn, Protocol

import numpy as np
import numpy.typing as npt

from hystid.modelica.expr import ZERO, Expr, Num, Op, balanced_sum, nodes, op, rebuild
from hystid.modelica.flat import Place

Array = npt.NDArray[np.object_]
Value = Expr | Array | tuple[Any, ...]
UNSET = Op("unset", ())


class Record(tuple[Any, ...]):
    """Values of the fields of a record."""

    names: tuple[str, ...]

    @classmethod
    def of(cls, names: Iterable[str], values: Iterable[Any]) -> Record:
        """The record whose fields have these names and values."""
        made = cls(values)
        made.names = tuple(names)
        return made

    def field(self, name: str) -> Any:
        """Value of a field."""
        return self[self.names.index(name)]


class Interpreter(Protocol):
    """What functions and tables need of the interpreter that calls them, see ``expand.Expander``."""

    place: Place

    def refuse(self, what: str) -> NoReturn:
        """Raise ModelicaError at the present place."""

    def spend(self, operations: int) -> None:
        """Counts what is written out."""

    def scalar(self, expr: Expr, local: Mapping[str, Value] | None = None) -> Expr:
        """Value that must be scalar."""

    def value(self, expr: Expr, local: Mapping[str, Value]) -> Value:
        """Value of an expression."""

    def number(self, expr: Expr, local: Mapping[str, Value], what: str) -> float:
        """Number known now."""

    def numbers(self, expr: Expr, local: Mapping[str, Value], what: str) -> Any:
        """Numbers known now, nested as the array is."""

    def outputs(self, call: Op, local: Mapping[str, Value]) -> list[Value]:
        """Values of all outputs of a function call."""

    def ask_for(self, condition: Expr) -> None:
        """Makes the parameters known that alone decide a condition."""

    def varying(self, s: Expr, local: Mapping[str, Value]) -> Expr | None:
        """A subscript that changes during the simulation, None for others."""

    def replaced(self, base: Array, subscript: Expr, value: Expr) -> Array:
        """A vector with one element changed, at a subscript that changes during the simulation."""

    def index(self, s: Expr, size: int, local: Mapping[str, Value]) -> Any:
        """Offsets that a subscript means, None for all."""


def is_unset(expr: Expr) -> bool:
    """Whether a part of it was never given a value."""
    return any(node == UNSET for node in nodes(expr))


def merge(condition: Expr, a: Value, b: Value) -> Value:
    """if condition then a else b, element by element."""
    if isinstance(a, tuple) and isinstance(b, tuple):
        merged = (merge(condition, x, y) for x, y in zip(a, b, strict=True))
        return Record.of(a.names, merged) if isinstance(a, Record) else tuple(merged)
    if isinstance(a, np.ndarray) or isinstance(b, np.ndarray):
        x, y = np.broadcast_arrays(boxed(a), boxed(b))
        made = [op("if", condition, p, q) for p, q in zip(x.flat, y.flat, strict=True)]
        return array(made).reshape(x.shape)
    return a if a is b else op("if", condition, a, b)  # type: ignore[arg-type]  # arrays went above


def filled_in(condition: Expr, last: Value, before: Value) -> Value:
    """The value of the last branch where no other has set one."""
    if any(is_unset(e) for e in flattened(before)):
        x, y = np.broadcast_arrays(boxed(last), boxed(before))
        made = [rebuild(q, _instead_of_nothing(p)) for p, q in zip(x.flat, y.flat, strict=True)]
        return array(made).reshape(x.shape) if x.shape else made[0]
    return merge(condition, last, before)


def _instead_of_nothing(value: Expr) -> Callable[[Expr], Expr | None]:
    return lambda node: value if node == UNSET else None


def stacked(parts: list[Value]) -> Array:
    """Values of one shape, along a new first dimension."""
    return np.stack([boxed(p) for p in parts])


def boxed(value: Value) -> Array:
    """A value as an array; a scalar has no dimensions."""
    return value if isinstance(value, np.ndarray) else array([value]).reshape(())


def array(items: list[Any]) -> Array:
    """A vector of expressions or arrays, none of them unpacked."""
    made = np.empty(len(items), dtype=object)
    made[:] = items
    return made


def flattened(value: Value) -> list[Expr]:
    """Scalars of a value, row by row."""
    if isinstance(value, np.ndarray):
        items: list[Expr] = value.reshape(-1).tolist()
        return items
    if isinstance(value, tuple):
        return [e for part in value for e in flattened(part)]
    return [value]


def mapped(function: Callable[[Expr], Expr], value: Value) -> Value:
    """A value with a function applied to each scalar."""
    if isinstance(value, np.ndarray):
        return array([function(e) for e in flattened(value)]).reshape(value.shape)
    assert not isinstance(value, tuple)
    return function(value)


def summed(items: Iterable[Expr]) -> Expr:
    """Sum without the terms that are 0."""
    terms = [e for e in items if e != ZERO]
    if all(isinstance(e, Num) for e in terms):
        return Num(sum(e.value for e in terms if isinstance(e, Num)))
    return balanced_sum(terms)


def product(a: Array, b: Array) -> Array:
    """Product of two matrices."""
    made = [summed(op("*", x, y) for x, y in zip(row, column, strict=True)) for row in a for column in b.T]
    return array(made).reshape(len(a), b.shape[1])


def matrix(value: Value) -> Array:
    """A value as a matrix; a vector is a column."""
    array = boxed(value)
    return array.reshape(1, 1) if array.ndim == 0 else array.reshape(-1, 1) if array.ndim == 1 else array


def rows(value: Value) -> Array:
    """A value as a matrix; a vector is a row."""
    array = boxed(value)
    return array.reshape(1, -1) if array.ndim < 2 else array
