"""From arrays and functions to scalars: an interpreter that computes with expressions.

``Expander.value`` returns a scalar expression or an object array of them; functions are inlined by running their
algorithm on expressions, where an ``if`` statement merges the values of its branches.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Mapping
from typing import Any, NoReturn

import numpy as np
import numpy.typing as npt

from hystid.errors import ModelicaError
from hystid.modelica.bodies import ELSE, NOTHING, WHILE
from hystid.modelica.expr import (
    FUNCTIONS,
    LOGICAL,
    ONE,
    RELATIONS,
    ZERO,
    Expr,
    Num,
    Op,
    Ref,
    Text,
    balanced_sum,
    nodes,
    op,
    rebuild,
    refs,
)
from hystid.modelica.flat import Function, FunctionVariable, Place, Statement

Array = npt.NDArray[np.object_]
Value = Expr | Array | tuple[Any, ...]

_KEPT = frozenset({"der", "pre", "edge", "change", "sample", "initial", "terminal", "String"})
_ELEMENTWISE = {".*": "*", "./": "/", ".^": "^"}
_EVENTS = RELATIONS | {"floor", "ceil", "integer", "div", "mod", "rem"}
_LOOP_LIMIT = 100_000
_WHILE_LIMIT = 10_000
_CALL_DEPTH = 50
_WORK_LIMIT = 2_000_000  # operations on scalars: some 20 s
_CALL_COST, _STATEMENT_COST = 10, 3  # in such operations


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
        self.parameters = parameters
        self.dims = dims
        self.constants = {name: Num(value) for name, value in constants.items()}
        self.functions = functions
        self.place = Place()
        self._depth = 0
        self._work = 0

    def refuse(self, what: str) -> NoReturn:
        raise ModelicaError(f"{self.place}: {what}")

    def spend(self, operations: int) -> None:
        """Counts what is written out; refuses what would never end."""
        self._work += operations
        if self._work > _WORK_LIMIT:
            self.refuse(
                f"arrays, loops and function calls need more than {_WORK_LIMIT} operations when they are written out: "
                "use a coarser discretisation, or fewer steps in functions"
            )

    # -- values

    def scalar(self, expr: Expr, local: Mapping[str, Value] | None = None) -> Expr:
        """Value that must be scalar."""
        value = self.value(expr, local or {})
        if isinstance(value, np.ndarray) and value.size == 1:
            value = _flatten(value)[0]
        if isinstance(value, np.ndarray | tuple):
            self.refuse("an array stands where a scalar is wanted")
        return value

    def flat(self, expr: Expr, local: Mapping[str, Value] | None = None) -> list[Expr]:
        """Value as a list of scalars, row by row."""
        value = self.value(expr, local or {})
        return _flatten(value)

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
            return _map(lambda a: Op(name, (a,)), self.value(expr.args[0], local))
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
        dims = self.dims.get(name)
        if not dims:
            return Ref(name)
        refs = [self.constants.get(e) or Ref(e) for e in elements(name, dims)]
        return _array(refs).reshape(dims)

    def number(self, expr: Expr, local: Mapping[str, Value], what: str) -> float:
        """Number known now, such as a size or a loop bound."""
        value = self.scalar(expr, local)
        if not isinstance(value, Num):
            if self.parameters and refs(value) <= self.parameters:
                raise NeededNow(refs(value))
            self.refuse(f"{what} must be known when the model is built, here it depends on a variable")
        return value.value

    def _broadcast(self, name: str, args: list[Value]) -> Value:
        shapes = [a.shape for a in args if isinstance(a, np.ndarray)]
        if not shapes:
            return self._quiet(op(name, *args))  # type: ignore[arg-type]
        if len(set(shapes)) > 1:
            self.refuse(f"the sizes {' and '.join(map(str, shapes))} do not fit in '{name}'")
        self.spend(int(np.prod(shapes[0])))
        columns = [_flatten(a) if isinstance(a, np.ndarray) else itertools.repeat(a) for a in args]
        made = [self._quiet(op(name, *row)) for row in zip(*columns, strict=False)]
        return _array(made).reshape(shapes[0])

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
            return _sum(op("*", x, y) for x, y in zip(a, b, strict=True))
        rows = a.reshape(-1, a.shape[-1])
        columns = b.reshape(b.shape[0], -1)
        made = [_sum(op("*", x, y) for x, y in zip(r, c, strict=True)) for r in rows for c in columns.T]
        return _array(made).reshape(a.shape[:-1] + b.shape[1:])

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
        """A variable of a component whose subscripts are computed: b[i + 1].x."""
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
        index = tuple(self._index(s, n, local) for s, n in zip(args[1:], base.shape, strict=False))
        result = base
        for axis in reversed(range(len(index))):
            result = np.take(result, index[axis], axis=axis) if index[axis] is not None else result
        return result

    def _index(self, s: Expr, size: int, local: Mapping[str, Value]) -> Any:
        if isinstance(s, Op) and s.name == ":":
            return None
        value = self.value(s, local)
        numbers = [v.value if isinstance(v, Num) else None for v in _flatten(value)]
        if None in numbers:
            needed = frozenset(n for v in _flatten(value) for n in refs(v))
            if self.parameters and needed <= self.parameters:
                raise NeededNow(needed)
            self.refuse("a subscript must be known when the model is built; choose among elements with if-expressions")
        whole = [int(v) - 1 for v in numbers if v is not None]
        if any(not 0 <= k < size for k in whole):
            self.refuse(f"subscript {max(whole, key=abs) + 1} is outside 1..{size}")
        return np.array(whole, dtype=int) if isinstance(value, np.ndarray) else whole[0]

    def _build(self, args: tuple[Expr, ...], local: Mapping[str, Value]) -> Value:
        parts = [self.value(a, local) for a in args]
        if not any(isinstance(p, np.ndarray) for p in parts):
            return _array(parts)
        if len({p.shape if isinstance(p, np.ndarray) else () for p in parts}) > 1:
            self.refuse("the rows of an array have different sizes")
        return _stacked(parts)

    def _horizontal(self, args: tuple[Expr, ...], local: Mapping[str, Value]) -> Value:
        return np.concatenate([_matrix(self.value(a, local)) for a in args], axis=1)

    def _vertical(self, args: tuple[Expr, ...], local: Mapping[str, Value]) -> Value:
        return np.concatenate([_rows(self.value(a, local)) for a in args], axis=0)

    def _range(self, args: tuple[Expr, ...], local: Mapping[str, Value]) -> Array:
        start, step, end = (self.number(a, local, "a range") for a in args)
        count = int((end - start) / step + 1e-9) + 1 if (end - start) * step >= 0 else 0
        if count > _LOOP_LIMIT:
            self.refuse(f"a range of {count} elements is too long (limit {_LOOP_LIMIT})")
        return _array([Num(start + step * k) for k in range(count)])

    def _comprehension(self, args: tuple[Expr, ...], local: Mapping[str, Value]) -> Value:
        body, name, values = args[0], args[1], args[2]
        assert isinstance(name, Ref)
        parts = []
        for v in _flatten(self.value(values, local)):
            self.spend(1)
            inner = Op("for", (body, *args[3:])) if len(args) > 3 else body
            parts.append(self.value(inner, {**local, name.name: v}))
        return _stacked(parts) if parts and isinstance(parts[0], np.ndarray) else _array(parts)

    def _extreme(self, name: str) -> Callable[..., Value]:
        def run(args: tuple[Expr, ...], local: Mapping[str, Value]) -> Value:
            values = [self.value(a, local) for a in args]
            if len(values) > 1:
                return self._broadcast(name, values)
            items = _flatten(values[0])
            if not items:
                self.refuse(f"{name}() of an empty array")
            result = items[0]
            for item in items[1:]:
                result = op(name, result, item)
            return result

        return run

    def _size(self, args: tuple[Expr, ...], local: Mapping[str, Value]) -> Value:
        base = self.value(args[0], local)
        shape = base.shape if isinstance(base, np.ndarray) else ()
        if len(args) == 1:
            return _array([Num(float(n)) for n in shape])
        axis = int(self.number(args[1], local, "the dimension of size()"))
        if not 1 <= axis <= len(shape):
            self.refuse(f"size(): there is no dimension {axis}")
        return Num(float(shape[axis - 1]))

    def _filled(self, args: tuple[Expr, ...], local: Mapping[str, Value]) -> Value:
        shape = tuple(int(self.number(a, local, "a size")) for a in args[1:])
        self.spend(int(np.prod(shape)))
        return _array([self.scalar(args[0], local)] * int(np.prod(shape))).reshape(shape)

    def _identity(self, args: tuple[Expr, ...], local: Mapping[str, Value]) -> Value:
        n = int(self.number(args[0], local, "a size"))
        self.spend(n * n)
        return _array([ONE if i == j else ZERO for i in range(n) for j in range(n)]).reshape(n, n)

    def _diagonal(self, args: tuple[Expr, ...], local: Mapping[str, Value]) -> Value:
        items = self.flat(args[0], local)
        n = len(items)
        self.spend(n * n)
        return _array([items[i] if i == j else ZERO for i in range(n) for j in range(n)]).reshape(n, n)

    def _linspace(self, args: tuple[Expr, ...], local: Mapping[str, Value]) -> Value:
        a, b = self.scalar(args[0], local), self.scalar(args[1], local)
        n = int(self.number(args[2], local, "the count of linspace()"))
        self.spend(n)
        span = op("-", b, a)
        return _array([op("+", a, op("/", op("*", span, Num(float(k))), Num(n - 1.0))) for k in range(n)])

    def _sum_of(self, args: tuple[Expr, ...], local: Mapping[str, Value]) -> Value:
        return _sum(self.flat(args[0], local))

    def _product_of(self, args: tuple[Expr, ...], local: Mapping[str, Value]) -> Value:
        result: Expr = ONE
        for item in self.flat(args[0], local):
            result = op("*", result, item)
        return result

    def _transpose(self, args: tuple[Expr, ...], local: Mapping[str, Value]) -> Value:
        return _matrix(self.value(args[0], local)).T

    def _cross(self, args: tuple[Expr, ...], local: Mapping[str, Value]) -> Value:
        a, b = self.flat(args[0], local), self.flat(args[1], local)
        pairs = ((1, 2), (2, 0), (0, 1))
        return _array([op("-", op("*", a[i], b[j]), op("*", a[j], b[i])) for i, j in pairs])

    def _concatenate(self, args: tuple[Expr, ...], local: Mapping[str, Value]) -> Value:
        axis = int(self.number(args[0], local, "the dimension of cat()")) - 1
        return np.concatenate([np.atleast_1d(np.asarray(self.value(a, local), object)) for a in args[1:]], axis=axis)

    def _vector(self, args: tuple[Expr, ...], local: Mapping[str, Value]) -> Value:
        return _array(self.flat(args[0], local))

    def _scalar_of(self, args: tuple[Expr, ...], local: Mapping[str, Value]) -> Value:
        return self.scalar(args[0], local)

    def _choice(self, args: tuple[Expr, ...], local: Mapping[str, Value]) -> Value:
        condition = self.scalar(args[0], local)
        if isinstance(condition, Num):
            return self.value(args[1] if condition.value else args[2], local)
        return merge(condition, self.value(args[1], local), self.value(args[2], local))

    def _tuple(self, args: tuple[Expr, ...], local: Mapping[str, Value]) -> Value:
        return tuple(self.value(a, local) for a in args)

    def _semi_linear(self, args: tuple[Expr, ...], local: Mapping[str, Value]) -> Value:
        x, up, down = (self.scalar(a, local) for a in args)
        return op("if", op("noEvent", op(">=", x, ZERO)), op("*", up, x), op("*", down, x))

    # -- functions

    def outputs(self, call: Op, local: Mapping[str, Value]) -> list[Value]:
        """Values of all outputs of a function call."""
        name, args = call.name.removeprefix("call "), call.args
        function = self.functions.get(name)
        if function is None or name.startswith("Modelica.Math."):
            return [self._library_function(name, args, local)]
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
    "[]": Expander._subscripted,
    "field": Expander._field,
    "{}": Expander._build,
    "[,]": Expander._horizontal,
    "[;]": Expander._vertical,
    "range": Expander._range,
    "for": Expander._comprehension,
    "tuple": Expander._tuple,
    "if": Expander._choice,
    "min": lambda self, args, local: self._extreme("min")(args, local),
    "max": lambda self, args, local: self._extreme("max")(args, local),
    "size": Expander._size,
    "fill": Expander._filled,
    "zeros": lambda self, args, local: self._filled((ZERO, *args), local),
    "ones": lambda self, args, local: self._filled((ONE, *args), local),
    "identity": Expander._identity,
    "diagonal": Expander._diagonal,
    "linspace": Expander._linspace,
    "sum": Expander._sum_of,
    "product": Expander._product_of,
    "transpose": Expander._transpose,
    "cross": Expander._cross,
    "cat": Expander._concatenate,
    "array": Expander._build,
    "vector": Expander._vector,
    "scalar": Expander._scalar_of,
    "semiLinear": Expander._semi_linear,
}


class Call:
    """One call of a function: its variables hold values (expressions), its statements are run."""

    def __init__(self, expander: Expander, function: Function, args: list[Value]) -> None:
        self.expander = expander
        self.function = function
        self.values: dict[str, Value] = {}
        for variable, value in itertools.zip_longest(function.inputs, args):
            if variable is None:
                expander.refuse(f"function '{function.name}' is given too many arguments")
            self.values[variable.name] = value if value is not None else self._default(variable)

    def run(self) -> list[Value]:
        """Values of the outputs."""
        for variable in (*self.function.outputs, *self.function.locals):
            self.values[variable.name] = self._initial(variable)
        self._statements(self.function.body)
        results = [self.values[v.name] for v in self.function.outputs]
        if any(_is_unset(e) for r in results for e in _flatten(r)):
            self.expander.refuse(f"function '{self.function.name}' leaves an output without a value on some path")
        return results

    def _default(self, variable: FunctionVariable) -> Value:
        if variable.default is None:
            self.expander.refuse(f"function '{self.function.name}' is called without '{variable.name}'")
        return self.expander.value(variable.default, self.values)

    def _initial(self, variable: FunctionVariable) -> Value:
        if variable.name.startswith(NOTHING):
            return UNSET
        if variable.default is not None:
            return self.expander.value(variable.default, self.values)
        if not variable.dims:
            return UNSET
        shape = tuple(int(self.expander.number(d, self.values, "a size")) for d in variable.dims)
        return _array([UNSET] * int(np.prod(shape))).reshape(shape)

    def _statements(self, statements: tuple[Statement, ...]) -> None:
        for statement in statements:
            _RUN[statement.kind](self, statement)

    def _assign(self, s: Statement) -> None:
        assert s.value is not None
        self.expander.spend(_STATEMENT_COST)
        if len(s.targets) == 1:
            self._set(s.targets[0], self.expander.value(s.value, self.values))
            return
        assert isinstance(s.value, Op)
        for target, part in zip(s.targets, self.expander.outputs(s.value, self.values), strict=False):
            self._set(target, part)

    def _set(self, target: Expr | None, value: Value) -> None:
        if isinstance(target, Ref):
            self.values[target.name] = value
        elif isinstance(target, Op) and target.name == "[]" and isinstance(target.args[0], Ref):
            name = target.args[0].name
            base = self.values[name]
            assert isinstance(base, np.ndarray)
            changed = base.copy()
            pairs = zip(target.args[1:], base.shape, strict=True)
            index = [self.expander._index(s, n, self.values) for s, n in pairs]
            changed[tuple(slice(None) if i is None else i for i in index)] = value
            self.values[name] = changed

    def _branch(self, s: Statement) -> None:
        self._choose(s.branches)

    def _choose(self, branches: tuple[tuple[Expr, tuple[Statement, ...]], ...]) -> None:
        if not branches:
            return
        condition = self.expander.scalar(branches[0][0], self.values)
        if isinstance(condition, Num):
            if condition.value:
                self._statements(branches[0][1])
            else:
                self._choose(branches[1:])
            return
        before = dict(self.values)
        self._statements(branches[0][1])
        taken, self.values = self.values, before
        self._choose(branches[1:])
        last = isinstance(branches[0][0], Ref) and branches[0][0].name.startswith(ELSE)
        join = _filled_in if last else merge
        self.values = {k: join(condition, taken.get(k, v), v) for k, v in self.values.items()}

    def _loop(self, s: Statement) -> None:
        assert s.value is not None
        if s.name.startswith(WHILE):
            outside, self.expander.place = self.expander.place, s.place
            self._while(s.branches[0][1])
            self.expander.place = outside
            return
        outer = self.values.get(s.name)
        for v in _flatten(self.expander.value(s.value, self.values)):
            self.values[s.name] = v
            self._statements(s.branches[0][1])
        if outer is None:
            self.values.pop(s.name, None)
        else:
            self.values[s.name] = outer

    def _while(self, body: tuple[Statement, ...]) -> None:
        """The first statement tests the condition."""
        test = body[0].targets[0]
        assert isinstance(test, Ref)
        for _ in range(_WHILE_LIMIT):
            self._assign(body[0])
            condition = self.expander.scalar(test, self.values)
            if not isinstance(condition, Num):
                self.expander.refuse(
                    "the condition of a while-loop depends on a variable, which cannot be written out: let it count by "
                    "numbers, or use for and if"
                )
            if not condition.value:
                return
            self._statements(body[1:])
        self.expander.refuse(f"a while-loop takes more than {_WHILE_LIMIT} steps, which cannot be written out")


_RUN: dict[str, Callable[[Call, Statement], None]] = {"assign": Call._assign, "if": Call._branch, "for": Call._loop}

UNSET = Op("unset", ())


def _is_unset(expr: Expr) -> bool:
    return any(node is UNSET for node in nodes(expr))


def merge(condition: Expr, a: Value, b: Value) -> Value:
    """if condition then a else b, element by element."""
    if isinstance(a, tuple) and isinstance(b, tuple):
        return tuple(merge(condition, x, y) for x, y in zip(a, b, strict=True))
    if isinstance(a, np.ndarray) or isinstance(b, np.ndarray):
        x, y = np.broadcast_arrays(_boxed(a), _boxed(b))
        made = [op("if", condition, p, q) for p, q in zip(x.flat, y.flat, strict=True)]
        return _array(made).reshape(x.shape)
    return a if a is b else op("if", condition, a, b)  # type: ignore[arg-type]


def _filled_in(condition: Expr, last: Value, before: Value) -> Value:
    """The value of the last branch where no other has set one."""
    if any(_is_unset(e) for e in _flatten(before)):
        x, y = np.broadcast_arrays(_boxed(last), _boxed(before))
        made = [rebuild(q, _instead_of_nothing(p)) for p, q in zip(x.flat, y.flat, strict=True)]
        return _array(made).reshape(x.shape) if x.shape else made[0]
    return merge(condition, last, before)


def _instead_of_nothing(value: Expr) -> Callable[[Expr], Expr | None]:
    return lambda node: value if node is UNSET else None


def _stacked(parts: list[Value]) -> Array:
    return np.stack([_boxed(p) for p in parts])


def _boxed(value: Value) -> Array:
    return value if isinstance(value, np.ndarray) else _array([value]).reshape(())


def _array(items: list[Any]) -> Array:
    made = np.empty(len(items), dtype=object)
    made[:] = items
    return made


def _flatten(value: Value) -> list[Expr]:
    if isinstance(value, np.ndarray):
        items: list[Expr] = value.reshape(-1).tolist()
        return items
    if isinstance(value, tuple):
        return [e for part in value for e in _flatten(part)]
    return [value]


def _map(function: Callable[[Expr], Expr], value: Value) -> Value:
    if isinstance(value, np.ndarray):
        return _array([function(e) for e in _flatten(value)]).reshape(value.shape)
    assert not isinstance(value, tuple)
    return function(value)


def _sum(items: Iterable[Expr]) -> Expr:
    """Sum without the terms that are 0."""
    terms = [e for e in items if e != ZERO]
    if all(isinstance(e, Num) for e in terms):
        return Num(sum(e.value for e in terms if isinstance(e, Num)))
    return balanced_sum(terms)


def _matrix(value: Value) -> Array:
    array = _boxed(value)
    return array.reshape(1, 1) if array.ndim == 0 else array.reshape(-1, 1) if array.ndim == 1 else array


def _rows(value: Value) -> Array:
    array = _boxed(value)
    return array.reshape(1, -1) if array.ndim < 2 else array
