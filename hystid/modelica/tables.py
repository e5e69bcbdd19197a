"""The lookup tables of the Modelica Standard Library: its external objects and functions become curves.

A table is built in: its numbers are known when the model is built.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping

import numpy as np

from hystid.modelica import curves
from hystid.modelica.curves import Spline
from hystid.modelica.expr import ONE, ZERO, Expr, Num, Op, Text, op
from hystid.modelica.values import Interpreter, Value, array
from hystid.numeric import Array

# the front end names a neighbour as the block beside it does
_FUNCTION = re.compile(r"(?:(?:^|\.)Tables\.Internal\.|^(?=getTable2DAbscissaU))(get\w+)$")
_OBJECT = re.compile(r"(?:^|\.)Types\.(ExternalCombi(?:TimeTable|Table1D|Table2D))$")
_ALWAYS, _AT_JUMPS, _NO_EVENTS = 1, 2, 3  # Modelica.Blocks.Types.TimeEvents


def is_table_object(name: str) -> bool:
    """Whether a class is one of the library's tables."""
    return _OBJECT.search(name) is not None


def is_table_function(name: str) -> bool:
    """Whether a function looks something up in one of them."""
    return _FUNCTION.search(name) is not None


def looked_up(expander: Interpreter, name: str, args: tuple[Expr, ...], local: Mapping[str, Value]) -> Value:
    """The value of a call of one of the library's table functions."""
    found = _FUNCTION.search(name)
    rule = _RULES.get(re.sub("NoDer2?$", "", found.group(1))) if found else None
    table = args[0] if args else ZERO
    if rule is None or not (isinstance(table, Op) and is_table_object(table.name.removeprefix("call "))):
        expander.refuse(f"the table function {name}() is not supported: use CombiTable1Ds or CombiTimeTable")
    return rule(_Table(expander, table, local), args[1:])


class _Table:
    """A table as its constructor states it; what stands for numbers must be known when the model is built."""

    def __init__(self, expander: Interpreter, made: Op, local: Mapping[str, Value]) -> None:
        self.expander, self.local = expander, local
        found = _OBJECT.search(made.name.removeprefix("call "))
        self.kind = found.group(1).removeprefix("ExternalCombi") if found else ""
        self._args = dict(zip(_ARGUMENTS[self.kind], made.args, strict=False))

    def number(self, name: str, default: float) -> float:
        """A number among the arguments."""
        expr = self._args.get(name)
        return default if expr is None else self.expander.number(expr, self.local, f"'{name}' of a table")

    def scalar(self, expr: Expr) -> Expr:
        """An argument of a lookup."""
        return self.expander.scalar(expr, self.local)

    def numbers(self, name: str) -> Array:
        """An array among the arguments."""
        return np.array(self.expander.numbers(self._args[name], self.local, "a table"), float)

    def column(self, number: Expr) -> Spline:
        """The curve of an output."""
        rows, columns = self.numbers("table"), self.numbers("columns").ravel()
        which = int(self.expander.number(number, self.local, "the number of a table's output"))
        if rows.size == 0 or not 1 <= which <= len(columns) or not 1 <= columns[which - 1] <= rows.shape[1]:
            shape = f"{rows.shape[0]} rows and {rows.shape[1] if rows.ndim > 1 else 0} columns"
            self.expander.refuse(f"output {which} of a table with {shape} does not exist")
        try:
            made = curves.curve(rows[:, 0], rows[:, int(columns[which - 1]) - 1], *self._manner())
        except ValueError as error:
            self.expander.refuse(f"this is no table: {error}")
        return self._in_time(made, rows[:, 0]) if self.kind == "TimeTable" else made

    def _manner(self) -> tuple[int, int]:
        return int(self.number("smoothness", curves.LINEAR)), int(self.number("extrapolation", curves.TANGENT))

    def _in_time(self, made: Spline, at: Array) -> Spline:
        """The curve moved to its place in time, with its events."""
        first, shift = self.number("startTime", 0.0), self.number("shiftTime", 0.0)
        wanted = int(self.number("timeEvents", _ALWAYS))
        smooth = self._manner()[0] not in (curves.LINEAR, curves.CONSTANT)
        jumps = sorted({float(t) for t in at[1:][np.diff(at) == 0]})
        every = sorted({float(t) for t in at})
        events = [] if smooth or wanted == _NO_EVENTS else jumps if wanted == _AT_JUMPS else every
        if made.outside == curves.PERIODIC and not smooth and wanted != _NO_EVENTS:
            events = sorted({*events, every[0]})  # where it begins anew
            events = [t for t in events if t < every[-1]]
        breaks = tuple(t + shift for t in made.breaks)
        return Spline(breaks, made.coefficients, made.outside, first, tuple(t + shift for t in events))

    def ends(self) -> tuple[float, float]:
        """First and last abscissa."""
        rows = self.numbers("table")
        return float(rows[0, 0]), float(rows[-1, 0])

    def corners(self) -> Array:
        """First abscissas in both directions, and last ones."""
        rows = self.numbers("table")
        return np.array([(rows[1, 0], rows[0, 1]), (rows[-1, 0], rows[0, -1])])


def _value(t: _Table, args: tuple[Expr, ...]) -> Expr:
    return op("curve0", t.scalar(args[1]), Text(t.column(args[0]).text), Num(float("inf")))


def _time_value(t: _Table, args: tuple[Expr, ...]) -> Expr:
    return op("curve0", t.scalar(args[1]), Text(t.column(args[0]).text), t.scalar(args[2]))


def _next_event(t: _Table, args: tuple[Expr, ...]) -> Expr:
    return op("curve_next", t.scalar(args[0]), Text(t.column(ONE).text))


def _surface(t: _Table, args: tuple[Expr, ...]) -> Expr:
    """Linear in both directions: for each row a curve along u2, and the rows joined along u1 by their weights."""
    rows = t.numbers("table")
    smoothness, outside = t._manner()
    x, y = rows[1:, 0], rows[0, 1:]
    if smoothness not in (curves.LINEAR, curves.CONSTANT) and min(len(x), len(y)) > 2:
        t.expander.refuse("a smooth table in two dimensions is not supported: use smoothness LinearSegments")
    u1, u2 = t.scalar(args[0]), t.scalar(args[1])
    total: Expr = ZERO
    for k, row in enumerate(rows[1:, 1:]):
        weight = curves.curve(x, np.eye(len(x))[k], smoothness, outside)
        along = curves.curve(y, row, smoothness, outside)
        infinity = Num(float("inf"))
        part = op("*", op("curve0", u1, Text(weight.text), infinity), op("curve0", u2, Text(along.text), infinity))
        total = op("+", total, part)
    return total


_RULES: dict[str, Callable[[_Table, tuple[Expr, ...]], Value]] = {
    "getTable1DValue": _value,
    "getTimeTableValue": _time_value,
    "getNextTimeEvent": _next_event,
    "getTable2DValue": _surface,
    "getTable2DAbscissaUmin": lambda t, _: array([Num(end) for end in t.corners()[0]]),
    "getTable2DAbscissaUmax": lambda t, _: array([Num(end) for end in t.corners()[1]]),
    "getTable1DAbscissaUmin": lambda t, _: Num(t.ends()[0]),
    "getTable1DAbscissaUmax": lambda t, _: Num(t.ends()[1]),
    "getTimeTableTmin": lambda t, _: Num(t.ends()[0]),
    "getTimeTableTmax": lambda t, _: Num(t.ends()[1]),
}

_MANNER = ("smoothness", "extrapolation")
_ARGUMENTS: dict[str, tuple[str, ...]] = {
    "TimeTable": ("tableName", "fileName", "table", "startTime", "columns", *_MANNER, "shiftTime", "timeEvents"),
    "Table1D": ("tableName", "fileName", "table", "columns", *_MANNER),
    "Table2D": ("tableName", "fileName", "table", "columns", *_MANNER),  # surface_tables.py
    "": (),
}
