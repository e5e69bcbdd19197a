"""Scalar expressions: three immutable nodes, constructors that fold constants, substitution.

Truth values are the numbers 0 and 1. An operation's name is a Modelica operator ("+", "<=", "and"), a built-in
function ("sin", "pre"), or "if" with the arguments condition, value, otherwise.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field

from hystid.modelica.curves import Spline
from hystid.modelica.matrix_kernels import TEXTS
from hystid.modelica.xorshift import GENERATORS


@dataclass(frozen=True, slots=True)
class Num:
    """A number."""

    value: float


@dataclass(frozen=True, slots=True)
class Ref:
    """The value of a scalar variable."""

    name: str


@dataclass(frozen=True, slots=True)
class Text:
    """A string; lives in messages only."""

    value: str


@dataclass(frozen=True, slots=True, eq=False)
class Op:
    """An operation on expressions. The hash is kept, so that large trees compare and memoise in constant time; so are
    the names, once they were asked for."""

    name: str
    args: tuple[Expr, ...]
    key: int = field(init=False, repr=False, compare=False)
    names: frozenset[str] | None = field(default=None, init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "key", hash((self.name, self.args)))

    def __hash__(self) -> int:
        return self.key

    def __eq__(self, other: object) -> bool:
        if self is other:
            return True
        if not isinstance(other, Op) or self.key != other.key or self.name != other.name:
            return False
        if self.args is not other.args:
            if self.args != other.args:
                return False
            object.__setattr__(other, "args", self.args)  # the same from now on: shared parts are compared once
        return True


Expr = Num | Ref | Op | Text

ZERO, ONE = Num(0.0), Num(1.0)
RELATIONS = frozenset({"<", "<=", ">", ">=", "==", "<>"})
LOGICAL = frozenset({"and", "or", "not", "edge", "change", "initial", "terminal", "sample"}) | RELATIONS


def op(name: str, *args: Expr) -> Expr:
    """Operation with constants folded and neutral elements removed; exact, so values keep their last bit."""
    numbers = [a.value for a in args if isinstance(a, Num)]
    if args and len(numbers) == len(args):
        folded = _fold(name, numbers)
        if folded is not None:
            return Num(folded)
    rule = _RULES.get(name)
    return rule(*args) if rule else Op(name, args)


def _fold(name: str, values: list[float]) -> float | None:
    function = _NUMERIC.get(name)
    if function is None:
        return None
    try:
        result = float(function(*values))
    except (ArithmeticError, ValueError, TypeError):
        return None
    return result if math.isfinite(result) else None


def add(a: Expr, b: Expr) -> Expr:
    """a + b."""
    if a == ZERO:
        return b
    if b == ZERO:
        return a
    if isinstance(b, Op) and b.name == "neg":
        return op("-", a, b.args[0])
    return Op("+", (a, b))


def sub(a: Expr, b: Expr) -> Expr:
    """a - b; 0 for equal operands."""
    if b == ZERO:
        return a
    if a == ZERO:
        return neg(b)
    if a == b:
        return ZERO
    if isinstance(b, Op) and b.name == "neg":
        return op("+", a, b.args[0])
    return Op("-", (a, b))


def mul(a: Expr, b: Expr) -> Expr:
    """a b."""
    if a == ZERO or b == ZERO:
        return ZERO
    if a == ONE:
        return b
    if b == ONE:
        return a
    if a == Num(-1.0):
        return neg(b)
    if b == Num(-1.0):
        return neg(a)
    return Op("*", (a, b))


def div(a: Expr, b: Expr) -> Expr:
    """a / b."""
    if a == ZERO:
        return ZERO
    if b == ONE:
        return a
    if b == Num(-1.0):
        return neg(a)
    return Op("/", (a, b))


def neg(a: Expr) -> Expr:
    """-a."""
    if isinstance(a, Num):
        return Num(-a.value)
    if isinstance(a, Op) and a.name == "neg":
        return a.args[0]
    return Op("neg", (a,))


def power(a: Expr, b: Expr) -> Expr:
    """a ^ b."""
    if b == ONE:
        return a
    if b == ZERO:
        return ONE
    return Op("^", (a, b))


def select(condition: Expr, a: Expr, b: Expr) -> Expr:
    """if condition then a else b."""
    if isinstance(condition, Num):
        return a if condition.value else b
    if a == b:
        return a
    return Op("if", (condition, a, b))


def _and(a: Expr, b: Expr) -> Expr:
    if ZERO in (a, b):
        return ZERO
    return b if a == ONE else a if b == ONE else Op("and", (a, b))


def _or(a: Expr, b: Expr) -> Expr:
    if ONE in (a, b):
        return ONE
    return b if a == ZERO else a if b == ZERO else Op("or", (a, b))


def _lookup(order: int) -> Callable[..., Expr]:
    """A derivative of a curve, see ``curves``; the third argument is the next event of a table in time."""

    def rule(x: Expr, data: Expr, before: Expr) -> Expr:
        if isinstance(x, Num) and isinstance(before, Num) and isinstance(data, Text):
            return Num(Spline.read(data.value).value(x.value, order, before.value))
        return Op(f"curve{order}", (x, data, before))

    return rule


def _next_event(x: Expr, data: Expr) -> Expr:
    if isinstance(x, Num) and isinstance(data, Text):
        return Num(Spline.read(data.value).next_event(x.value))
    return Op("curve_next", (x, data))


CURVES = {f"curve{order}": order for order in range(4)}

_RULES: dict[str, Callable[..., Expr]] = {
    **{name: _lookup(order) for name, order in CURVES.items()},
    "curve_next": _next_event,
    "+": add,
    "-": sub,
    "*": mul,
    "/": div,
    "neg": neg,
    "^": power,
    "if": select,
    "homotopy": lambda actual, simplified: actual if actual == simplified else Op("homotopy", (actual, simplified)),
    "and": _and,
    "or": _or,
}


def _quotient(x: float, y: float) -> float:
    return math.trunc(x / y)


def _one_of(made: Callable[[Sequence[float]], list[float]]) -> Callable[..., float]:
    return lambda wanted, *state: made(state)[int(wanted)]


_NUMERIC: dict[str, Callable[..., float]] = {
    "+": lambda a, b: a + b,
    "-": lambda a, b: a - b,
    "*": lambda a, b: a * b,
    "/": lambda a, b: a / b,
    "^": lambda a, b: a**b,
    "neg": lambda a: -a,
    "<": lambda a, b: a < b,
    "<=": lambda a, b: a <= b,
    ">": lambda a, b: a > b,
    ">=": lambda a, b: a >= b,
    "==": lambda a, b: a == b,
    "<>": lambda a, b: a != b,
    "and": lambda a, b: bool(a) and bool(b),
    "or": lambda a, b: bool(a) or bool(b),
    "not": lambda a: not a,
    "if": lambda c, a, b: a if c else b,
    "noEvent": lambda a: a,
    "smooth": lambda _, a: a,
    "abs": abs,
    "sign": lambda a: (a > 0) - (a < 0),
    "min": min,
    "max": max,
    "floor": math.floor,
    "ceil": math.ceil,
    "integer": math.floor,
    "div": _quotient,
    "mod": lambda x, y: x - math.floor(x / y) * y,
    "rem": lambda x, y: x - _quotient(x, y) * y,
    "sqrt": math.sqrt,
    "exp": math.exp,
    "log": math.log,
    "log10": math.log10,
    "sin": math.sin,
    "cos": math.cos,
    "tan": math.tan,
    "asin": math.asin,
    "acos": math.acos,
    "atan": math.atan,
    "atan2": math.atan2,
    "sinh": math.sinh,
    "cosh": math.cosh,
    "tanh": math.tanh,
    "hy_power_x": lambda x, n: 0.0 if x == 0 and n < 1 else x ** (n - 1),
    "hy_power_n": lambda x, n: x**n * math.log(x) if x > 0 else 0.0,
    **{name: _one_of(made) for name, (made, _) in GENERATORS.items()},
}

# Operators and functions that the C printer and the differentiation know as numbers.
FUNCTIONS = frozenset(_NUMERIC).union(TEXTS)


def balanced_sum(terms: Sequence[Expr]) -> Expr:
    """a + b + ...: from left to right for a few terms, by halves for many, so that no tree gets deep."""
    if len(terms) > _FEW:
        middle = len(terms) // 2
        return Op("+", (balanced_sum(terms[:middle]), balanced_sum(terms[middle:])))
    result = terms[0]
    for term in terms[1:]:
        result = Op("+", (result, term))
    return result


_FEW = 16


def nodes(expr: Expr) -> Iterator[Expr]:
    """Every node, each shared subtree once, parents before children."""
    seen: set[Expr] = set()
    stack = [expr]
    while stack:
        node = stack.pop()
        if node in seen:
            continue
        seen.add(node)
        yield node
        if isinstance(node, Op):
            stack.extend(node.args)


def refs(expr: Expr) -> frozenset[str]:
    """Names of the variables that the expression reads, pre() and der() included."""
    if not isinstance(expr, Op):
        return frozenset((expr.name,)) if isinstance(expr, Ref) else frozenset()
    if expr.names is None:
        object.__setattr__(expr, "names", frozenset(_names(expr)))
    assert expr.names is not None
    return expr.names


def _names(expr: Op) -> set[str]:
    found: set[str] = set()
    seen: set[Op] = {expr}
    stack: list[Expr] = list(expr.args)
    while stack:
        node = stack.pop()
        if isinstance(node, Ref):
            found.add(node.name)
        elif isinstance(node, Op) and node.names is not None:
            found |= node.names
        elif isinstance(node, Op) and node not in seen:
            seen.add(node)
            stack.extend(node.args)
    return found


def rebuild(expr: Expr, change: Callable[[Expr], Expr | None], memo: dict[Expr, Expr] | None = None) -> Expr:
    """Copy in which ``change`` may replace a node before its arguments are looked at (None: keep and go on)."""
    memo = {} if memo is None else memo
    if expr in memo:
        return memo[expr]
    new = change(expr)
    if new is None:
        new = op(expr.name, *(rebuild(a, change, memo) for a in expr.args)) if isinstance(expr, Op) else expr
    memo[expr] = new
    return new


def substitute(expr: Expr, values: Mapping[str, Expr]) -> Expr:
    """Copy with variables replaced."""
    return rebuild(expr, lambda node: values.get(node.name) if isinstance(node, Ref) else None)


def evaluate(expr: Expr, values: Mapping[str, float]) -> float | None:
    """Value where every variable is in ``values``; None where one is missing or the operation has no finite value."""

    def number(node: Expr) -> Expr | None:
        return Num(values[node.name]) if isinstance(node, Ref) and node.name in values else None

    folded = rebuild(expr, number)
    return folded.value if isinstance(folded, Num) else None
