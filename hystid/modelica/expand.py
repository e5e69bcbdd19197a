"""From arrays and functions to scalars: an interpreter that computes with expressions.

``Expander.value`` returns a scalar expression or an object array of them; functions are inlined by running their
algorithm on expressions, where an ``if`` statement merges the values of its branches.
"""

from __future__ import annotations

import functools
import itertools
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any, NoReturn

import numpy as np

from hystid.errors import ModelicaError
from hystid.limits import COMPILE_ELEMENTS, room_for
from hystid.modelica.array_functions import ARRAY_FUNCTIONS
from hystid.modelica.expr import FUNCTIONS, LOGICAL, ONE, RELATIONS, ZERO, Expr, Num, Op, Ref, Text, op, refs
from hystid.modelica.flat import Function, Place
from hystid.modelica.inlining import NO_NUMBER, Call
from hystid.modelica.matrix_functions import factored, is_matrix_function
from hystid.modelica.random_numbers import drawn, is_random_function
from hystid.modelica.tables import is_table_function, looked_up
from hystid.modelica.values import Array, Record, Value, array, flattened, mapped, merge, product, summed

_KEPT = frozenset({"der", "pre", "edge", "change", "sample", "initial", "terminal", "homotopy", "delay", "String"})
_ELEMENTWISE = {".*": "*", "./": "/", ".^": "^"}
_EVENTS = RELATIONS | {"floor", "ceil", "integer", "div", "mod", "rem"}
_CALL_DEPTH = 50
_OPERATION = 4  # elements of the budget of a compilation: an operation on scalars takes some 10 us
_CALL_COST = 10  # in such operations


def element(name: str, index: tuple[int, ...]) -> str:
    """Name of an array's element, indices from 1 as in Modelica."""
    return f"{name}[{','.join(map(str, index))}]"


def elements(name: str, dims: tuple[int, ...]) -> list[str]:
    """Names of all elements in row-major order; the name itself for a scalar."""
    if not dims:
        return [name]
    return [element(name, tuple(i)) for i in itertools.product(*(range(1, n + 1) for n in dims))]


class NeededNow(Exception):
    """Parameters whose values must be known to go on: a loop or a subscript depends on them."""

    def __init__(self, names: frozenset[str]) -> None:
        super().__init__(*sorted(names))
        self.names = names


class Expander:
    """dims: sizes of array variables. constants: numbers known at compile time (sizes, loop bounds).

    parameters: those that may be made constants; where one is needed, NeededNow is raised.
    """

    def __init__(
        self,
        dims: Mapping[str, tuple[int, ...]],
        constants: Mapping[str, float],
        functions: Mapping[str, Function],
        parameters: frozenset[str] = frozenset(),
    ) -> None:
        self.parameters = parameters - set(dims)
        self.arrays = parameters & set(dims)
        self.dims = dims
        self.constants = {name: Num(value) for name, value in constants.items()}
        self.functions = functions
        self.place = Place()
        self._depth = 0

    def refuse(self, what: str) -> NoReturn:
        raise ModelicaError(f"{self.place}: {what}")

    def spend(self, operations: int) -> None:
        """Counts what is written out; refuses what would never end."""
        if not room_for(operations * _OPERATION):
            self.refuse(
                f"arrays, loops and function calls written out are more than {COMPILE_ELEMENTS}: "
                "use a coarser discretisation, or fewer steps in functions"
            )

    # -- values

    def scalar(self, expr: Expr, local: Mapping[str, Value] | None = None) -> Expr:
        """Value that must be scalar."""
        value = self.value(expr, local or {})
        if isinstance(value, np.ndarray) and value.size == 1:
            value = flattened(value)[0]
        if isinstance(value, np.ndarray | tuple):
            self.refuse("an array stands where a scalar is wanted")
        return value

    def flat(self, expr: Expr, local: Mapping[str, Value] | None = None) -> list[Expr]:
        """Value as a list of scalars, row by row."""
        value = self.value(expr, local or {})
        return flattened(value)

    def value(self, expr: Expr, local: Mapping[str, Value]) -> Value:
        """Scalar expression, array, or tuple of them; of a call with several outputs the first."""
        if isinstance(expr, Ref):
            return self._variable(expr.name, local)
        if isinstance(expr, Text):
            self.refuse(f'the text "{expr.value}" stands where a number is wanted')
        if not isinstance(expr, Op):
            return expr
        name = expr.name
        if name in _SPECIAL:
            return _SPECIAL[name](self, expr.args, local)
        if name.startswith("call "):
            return self.outputs(expr, local)[0]
        if name in ("der", "pre", "edge", "change"):
            return mapped(lambda a: Op(name, (a,)), self.value(expr.args[0], local))
        args = [self.value(a, local) for a in expr.args]
        if name in ("*", "^", "/") and any(isinstance(a, np.ndarray) for a in args):
            return self._product(name, *args)
        scalar = _ELEMENTWISE.get(name, name)
        if scalar not in FUNCTIONS and scalar not in LOGICAL and scalar not in _KEPT:
            self.refuse(f"the function {name}() is not supported: write it with the functions of the language subset")
        return self._broadcast(scalar, args)

    def _variable(self, name: str, local: Mapping[str, Value]) -> Value:
        if name in local:
            return local[name]
        if name in self.constants:
            return self.constants[name]
        fields = [n for n in local if n.startswith(f"{name}.")]
        if fields:
            return Record.of((n.removeprefix(f"{name}.") for n in fields), (local[n] for n in fields))
        dims = self.dims.get(name)
        if not dims:
            return Ref(name)
        refs = [self.constants.get(e) or Ref(e) for e in elements(name, dims)]
        return array(refs).reshape(dims)

    def number(self, expr: Expr, local: Mapping[str, Value], what: str) -> float:
        """Number known now, such as a size or a loop bound."""
        value = self.scalar(expr, local)
        if not isinstance(value, Num):
            if self.parameters and refs(value) <= self.parameters:
                raise NeededNow(refs(value))
            self.refuse(f"{what} must be known when the model is built, here it depends on a variable")
        return value.value

    def numbers(self, expr: Expr, local: Mapping[str, Value], what: str) -> Any:
        """Numbers known now, nested as the array is."""
        value = self.value(expr, local)
        items = flattened(value)
        numbers = [v.value for v in items if isinstance(v, Num)]
        if len(numbers) < len(items):
            needed = frozenset(n for v in items for n in refs(v))
            wanted = frozenset(n if n in self.parameters else n.rpartition("[")[0] for n in needed)
            if wanted <= self.parameters | self.arrays:
                raise NeededNow(wanted)
            self.refuse(f"{what} must be known when the model is built, here it depends on a variable")
        return np.array(numbers).reshape(value.shape if isinstance(value, np.ndarray) else ())

    def _broadcast(self, name: str, args: list[Value]) -> Value:
        shapes = [a.shape for a in args if isinstance(a, np.ndarray)]
        if not shapes:
            return self._quiet(op(name, *args))  # type: ignore[arg-type]  # no arrays are left
        if len(set(shapes)) > 1:
            self.refuse(f"the sizes {' and '.join(map(str, shapes))} do not fit in '{name}'")
        self.spend(int(np.prod(shapes[0])))
        columns = [flattened(a) if isinstance(a, np.ndarray) else itertools.repeat(a) for a in args]
        made = [self._quiet(op(name, *row)) for row in zip(*columns, strict=False)]
        return array(made).reshape(shapes[0])

    @contextmanager
    def without_events(self) -> Iterator[None]:
        """What is evaluated meanwhile makes no event."""
        self._depth += 1
        try:
            yield
        finally:
            self._depth -= 1

    def _quiet(self, expr: Expr) -> Expr:
        """Inside a function nothing makes an event."""
        loud = self._depth and isinstance(expr, Op) and expr.name in _EVENTS
        return Op("noEvent", (expr,)) if loud else expr

    def _product(self, name: str, a: Value, b: Value) -> Value:
        if name == "^":
            return self._matrix_power(a, b)
        if name == "/" or not (isinstance(a, np.ndarray) and isinstance(b, np.ndarray)):
            return self._broadcast(name, [a, b])
        if a.shape[-1] != b.shape[0]:
            self.refuse(f"the sizes {a.shape} and {b.shape} do not fit in a product")
        self.spend(a.size * (b.size // max(b.shape[0], 1)))
        if a.ndim == 1 and b.ndim == 1:
            return summed(op("*", x, y) for x, y in zip(a, b, strict=True))
        rows = a.reshape(-1, a.shape[-1])
        columns = b.reshape(b.shape[0], -1)
        return product(rows, columns).reshape(a.shape[:-1] + b.shape[1:])

    def _matrix_power(self, a: Value, b: Value) -> Value:
        if isinstance(a, np.ndarray) and isinstance(b, Num) and b.value >= 1 and b.value.is_integer():
            half, odd = divmod(int(b.value), 2)
            if not half:
                return a
            root = self._matrix_power(a, Num(float(half)))
            square = self._product("*", root, root)
            return self._product("*", square, a) if odd else square
        self.refuse("'^' of an array needs a positive whole exponent; use '.^' for each element")

    def _field(self, args: tuple[Expr, ...], local: Mapping[str, Value]) -> Value:
        """A variable of a component whose subscripts are computed, b[i + 1].x, or a field of a record, f(x).re."""
        made = args[0] if isinstance(args[0], Op) and args[0].name not in ("[]", "field") else None
        whole = self.value(made, local) if made is not None else None
        if isinstance(whole, Record) and isinstance(args[1], Text) and args[1].value in whole.names:
            found: Value = whole.field(args[1].value)
            return found
        return self._variable(self._path(Op("field", args), local), local)

    def _path(self, expr: Expr, local: Mapping[str, Value]) -> str:
        if isinstance(expr, Ref) and expr.name not in local:
            return expr.name
        if isinstance(expr, Op) and expr.name == "field" and isinstance(expr.args[1], Text):
            return f"{self._path(expr.args[0], local)}.{expr.args[1].value}"
        if isinstance(expr, Op) and expr.name == "[]":
            numbers = (int(self.number(s, local, "a subscript")) for s in expr.args[1:])
            return element(self._path(expr.args[0], local), tuple(numbers))
        self.refuse("a field of what is no component is not supported: give the record's fields names of their own")

    # -- array constructs

    def _subscripted(self, args: tuple[Expr, ...], local: Mapping[str, Value]) -> Value:
        base = self.value(args[0], local)
        if not isinstance(base, np.ndarray):
            self.refuse("a scalar is subscripted")
        return self._part(base, args[1:], local)

    def _part(self, base: Value, subscripts: tuple[Expr, ...], local: Mapping[str, Value]) -> Value:
        if not isinstance(base, np.ndarray) or not subscripts:
            return base
        for axis, s in enumerate(subscripts):
            varying = self.varying(s, local)
            if varying is not None and axis < base.ndim:
                rest = (*subscripts[:axis], *subscripts[axis + 1 :])
                return self._chosen([self._part(b, rest, local) for b in np.moveaxis(base, axis, 0)], varying)
        index = tuple(self.index(s, n, local) for s, n in zip(subscripts, base.shape, strict=False))
        result = base
        for axis in reversed(range(len(index))):
            result = np.take(result, index[axis], axis=axis) if index[axis] is not None else result
        return result

    def varying(self, s: Expr, local: Mapping[str, Value]) -> Expr | None:
        """A subscript that changes during the simulation; None for one that is known, or may be made known."""
        value = None if isinstance(s, Op) and s.name == ":" else self.value(s, local)
        if value is None or isinstance(value, np.ndarray | tuple | Num) or refs(value) <= self.parameters:
            return None
        return value

    def _chosen(self, parts: Sequence[Value], subscript: Expr) -> Value:
        """The part at a subscript that changes; outside of 1..n no number, which ends the run."""
        result: Value = mapped(lambda _: NO_NUMBER, parts[0])
        for k in reversed(range(len(parts))):
            self.spend(len(flattened(parts[k])))
            result = merge(self._is(subscript, k), parts[k], result)
        return result

    def _is(self, subscript: Expr, k: int) -> Expr:
        """Whether it means the element with offset k; no event, as what it is made of makes them."""
        return Op("noEvent", (op("==", subscript, Num(k + 1.0)),))

    def replaced(self, base: Array, subscript: Expr, value: Expr) -> Array:
        """A vector with one element changed, at a subscript that changes; outside of 1..n no number anywhere."""
        self.spend(base.size)
        outside = op("or", op("<", subscript, ONE), op(">", subscript, Num(float(base.size))))
        ends = Op("noEvent", (outside,))
        changed = [op("if", self._is(subscript, k), value, e) for k, e in enumerate(flattened(base))]
        return array([op("if", ends, NO_NUMBER, e) for e in changed])

    def ask_for(self, condition: Expr) -> None:
        """Makes the parameters known that alone decide a condition."""
        names = frozenset(n if n in self.parameters else n.rpartition("[")[0] for n in refs(condition))
        if names and names <= self.parameters | self.arrays:
            raise NeededNow(names)

    def index(self, s: Expr, size: int, local: Mapping[str, Value]) -> Any:
        if isinstance(s, Op) and s.name == ":":
            return None
        value = self.value(s, local)
        numbers = [v.value if isinstance(v, Num) else None for v in flattened(value)]
        if None in numbers:
            needed = frozenset(n for v in flattened(value) for n in refs(v))
            if self.parameters and needed <= self.parameters:
                raise NeededNow(needed)
            self.refuse("a subscript must be known when the model is built; choose among elements with if-expressions")
        whole = [int(v) - 1 for v in numbers if v is not None]
        if any(not 0 <= k < size for k in whole):
            self.refuse(f"subscript {max(whole, key=abs) + 1} is outside 1..{size}")
        return np.array(whole, dtype=int) if isinstance(value, np.ndarray) else whole[0]

    def _extreme(self, name: str, args: tuple[Expr, ...], local: Mapping[str, Value]) -> Value:
        values = [self.value(a, local) for a in args]
        if len(values) > 1:
            return self._broadcast(name, values)
        items = flattened(values[0])
        if not items:
            self.refuse(f"{name}() of an empty array")
        return functools.reduce(lambda a, b: op(name, a, b), items)

    def _choice(self, args: tuple[Expr, ...], local: Mapping[str, Value]) -> Value:
        condition = self.scalar(args[0], local)
        if isinstance(condition, Num):
            return self.value(args[1] if condition.value else args[2], local)
        if self.parameters and refs(condition) and refs(condition) <= self.parameters:
            return self._decided_if_need_be(condition, args, local)
        return merge(condition, self.value(args[1], local), self.value(args[2], local))

    def _decided_if_need_be(self, condition: Expr, args: tuple[Expr, ...], local: Mapping[str, Value]) -> Value:
        """A parameter that chooses between what can be written out and what cannot is built in."""
        try:
            return merge(condition, self.value(args[1], local), self.value(args[2], local))
        except ModelicaError:
            raise NeededNow(refs(condition)) from None

    def _tuple(self, args: tuple[Expr, ...], local: Mapping[str, Value]) -> Value:
        return tuple(self.value(a, local) for a in args)

    def _semi_linear(self, args: tuple[Expr, ...], local: Mapping[str, Value]) -> Value:
        x, up, down = (self.scalar(a, local) for a in args)
        return op("if", op("noEvent", op(">=", x, ZERO)), op("*", up, x), op("*", down, x))

    # -- functions

    def outputs(self, call: Op, local: Mapping[str, Value]) -> list[Value]:
        """Values of all outputs of a function call."""
        name, args = call.name.removeprefix("call "), call.args
        if is_table_function(name):
            return [looked_up(self, name, args, local)]
        if is_random_function(name):
            return drawn(self, name, [a if isinstance(a, Text) else self.value(a, local) for a in args])
        function = self.functions.get(name)
        if function is not None and function.external and is_matrix_function(name):
            values = Call(self, function, [self.value(a, local) for a in args]).values
            return factored(self, name, [values[v.name] for v in function.inputs])
        if function is None or (name.startswith("Modelica.Math.") and name.rsplit(".", 1)[-1] in FUNCTIONS):
            return [self._library_function(name, args, local)]
        if function.external:
            self.refuse(f"external function '{name}' is not supported: write the function in Modelica")
        if self._depth >= _CALL_DEPTH:
            self.refuse(f"function '{name}' calls itself more than {_CALL_DEPTH} deep, which cannot be inlined")
        self._depth += 1
        self.spend(_CALL_COST)
        try:
            return Call(self, function, [self.value(a, local) for a in args]).run()
        finally:
            self._depth -= 1

    def _library_function(self, name: str, args: tuple[Expr, ...], local: Mapping[str, Value]) -> Value:
        short = name.rsplit(".", 1)[-1]
        if short in FUNCTIONS:
            return self.value(Op(short, args), local)
        self.refuse(f"the function '{name}' is not known")


_SPECIAL: dict[str, Callable[..., Value]] = {
    **ARRAY_FUNCTIONS,
    "[]": Expander._subscripted,
    "field": Expander._field,
    "tuple": Expander._tuple,
    "if": Expander._choice,
    "min": lambda self, args, local: self._extreme("min", args, local),
    "max": lambda self, args, local: self._extreme("max", args, local),
    "semiLinear": Expander._semi_linear,
    "outside": lambda self, args, local: self.value(args[0], {}),
}
