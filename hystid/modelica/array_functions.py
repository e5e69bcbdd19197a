"""Constructors of arrays, and the functions of arrays in the language: each is written out in scalars.

All take the interpreter, the arguments as they stand in the text, and the local variables.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from hystid.modelica.expr import ONE, ZERO, Expr, Num, Op, Ref, Text, op
from hystid.modelica.values import Array, Interpreter, Record, Value, array, flattened, matrix, rows, stacked, summed

_LOOP_LIMIT = 100_000
Local = Mapping[str, Value]
Args = tuple[Expr, ...]


def _build(t: Interpreter, args: Args, local: Local) -> Value:
    parts = [t.value(a, local) for a in args]
    if not any(isinstance(p, np.ndarray) for p in parts):
        return array(parts)
    if len({p.shape if isinstance(p, np.ndarray) else () for p in parts}) > 1:
        t.refuse("the rows of an array have different sizes")
    return stacked(parts)


def _horizontal(t: Interpreter, args: Args, local: Local) -> Value:
    return np.concatenate([matrix(t.value(a, local)) for a in args], axis=1)


def _vertical(t: Interpreter, args: Args, local: Local) -> Value:
    return np.concatenate([rows(t.value(a, local)) for a in args], axis=0)


def _range(t: Interpreter, args: Args, local: Local) -> Array:
    start, step, end = (t.number(a, local, "a range") for a in args)
    count = int((end - start) / step + 1e-9) + 1 if (end - start) * step >= 0 else 0
    if count > _LOOP_LIMIT:
        t.refuse(f"a range of {count} elements is too long (limit {_LOOP_LIMIT})")
    return array([Num(start + step * k) for k in range(count)])


def _comprehension(t: Interpreter, args: Args, local: Local) -> Value:
    body, name, values = args[0], args[1], args[2]
    assert isinstance(name, Ref)
    parts = []
    for v in flattened(t.value(values, local)):
        t.spend(1)
        inner = Op("for", (body, *args[3:])) if len(args) > 3 else body
        parts.append(t.value(inner, {**local, name.name: v}))
    return stacked(parts) if parts and isinstance(parts[0], np.ndarray) else array(parts)


def _record(t: Interpreter, args: Args, local: Local) -> Value:
    names = [n.value for n in args[::2] if isinstance(n, Text)]
    return Record.of(names, (t.value(a, local) for a in args[1::2]))


def _size(t: Interpreter, args: Args, local: Local) -> Value:
    base = t.value(args[0], local)
    shape = base.shape if isinstance(base, np.ndarray) else ()
    if len(args) == 1:
        return array([Num(float(n)) for n in shape])
    axis = int(t.number(args[1], local, "the dimension of size()"))
    if not 1 <= axis <= len(shape):
        t.refuse(f"size(): there is no dimension {axis}")
    return Num(float(shape[axis - 1]))


def _filled(t: Interpreter, args: Args, local: Local) -> Value:
    shape = tuple(int(t.number(a, local, "a size")) for a in args[1:])
    t.spend(int(np.prod(shape)))
    return array([t.scalar(args[0], local)] * int(np.prod(shape))).reshape(shape)


def _on_diagonal(t: Interpreter, items: Sequence[Expr]) -> Array:
    n = len(items)
    t.spend(n * n)
    return array([items[i] if i == j else ZERO for i in range(n) for j in range(n)]).reshape(n, n)


def _identity(t: Interpreter, args: Args, local: Local) -> Value:
    return _on_diagonal(t, [ONE] * int(t.number(args[0], local, "a size")))


def _diagonal(t: Interpreter, args: Args, local: Local) -> Value:
    return _on_diagonal(t, flattened(t.value(args[0], local)))


def _linspace(t: Interpreter, args: Args, local: Local) -> Value:
    a, b = t.scalar(args[0], local), t.scalar(args[1], local)
    n = int(t.number(args[2], local, "the count of linspace()"))
    t.spend(n)
    span = op("-", b, a)
    return array([op("+", a, op("/", op("*", span, Num(float(k))), Num(n - 1.0))) for k in range(n)])


def _sum(t: Interpreter, args: Args, local: Local) -> Value:
    return summed(flattened(t.value(args[0], local)))


def _product(t: Interpreter, args: Args, local: Local) -> Value:
    result: Expr = ONE
    for item in flattened(t.value(args[0], local)):
        result = op("*", result, item)
    return result


def _transpose(t: Interpreter, args: Args, local: Local) -> Value:
    return matrix(t.value(args[0], local)).T


def _cross(t: Interpreter, args: Args, local: Local) -> Value:
    a, b = (flattened(t.value(arg, local)) for arg in args)
    pairs = ((1, 2), (2, 0), (0, 1))
    return array([op("-", op("*", a[i], b[j]), op("*", a[j], b[i])) for i, j in pairs])


def _concatenate(t: Interpreter, args: Args, local: Local) -> Value:
    axis = int(t.number(args[0], local, "the dimension of cat()")) - 1
    return np.concatenate([np.atleast_1d(np.asarray(t.value(a, local), object)) for a in args[1:]], axis=axis)


def _vector(t: Interpreter, args: Args, local: Local) -> Value:
    return array(flattened(t.value(args[0], local)))


ARRAY_FUNCTIONS: dict[str, Callable[[Interpreter, Args, Local], Value]] = {
    "{}": _build,
    "[,]": _horizontal,
    "[;]": _vertical,
    "range": _range,
    "for": _comprehension,
    "record": _record,
    "size": _size,
    "fill": _filled,
    "zeros": lambda t, args, local: _filled(t, (ZERO, *args), local),
    "ones": lambda t, args, local: _filled(t, (ONE, *args), local),
    "identity": _identity,
    "diagonal": _diagonal,
    "linspace": _linspace,
    "sum": _sum,
    "product": _product,
    "transpose": _transpose,
    "cross": _cross,
    "cat": _concatenate,
    "array": _build,
    "vector": _vector,
    "scalar": lambda t, args, local: t.scalar(args[0], local),
}
