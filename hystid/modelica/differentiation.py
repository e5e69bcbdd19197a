"""Derivatives of scalar expressions."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from itertools import islice

from hystid.modelica.expr import LOGICAL, ONE, ZERO, Expr, Num, Op, Ref, neg, nodes, op, refs, select
from hystid.modelica.matrix_kernels import SLOPE, TEXTS
from hystid.modelica.xorshift import GENERATORS


class Derivative:
    """d/dx of expressions for one variable x.

    Conditions are held. Functions with a jump or a kink get the derivative of the branch taken (0 for sign, floor,
    ...); where a derivative is infinite at the origin, as for sqrt, the answer there is 0: gradients stay finite.
    """

    def __init__(self, name: str) -> None:
        self.name = name
        self._memo: dict[Expr, Expr] = {}

    def __call__(self, expr: Expr) -> Expr:
        if isinstance(expr, Ref):
            return ONE if expr.name == self.name else ZERO
        if not isinstance(expr, Op):
            return ZERO
        if expr not in self._memo:
            self._memo[expr] = self._of(expr)
        return self._memo[expr]

    def _of(self, e: Op) -> Expr:
        if e.name in LOGICAL or e.name in _FLAT:
            return ZERO
        if e.name == "if":
            return select(e.args[0], self(e.args[1]), self(e.args[2]))
        if e.name in ("noEvent", "smooth"):
            return self(e.args[-1])
        d = [self(a) for a in e.args]
        if all(x == ZERO for x in d):
            return ZERO
        if e.name in _CHAIN:
            return op("*", _CHAIN[e.name](e.args[0], e), d[0])
        return _RULES_OF_SEVERAL[e.name](e, *d)


def gradient(expr: Expr) -> dict[str, Expr]:
    """Derivatives by every variable of the expression that has one; a sum is taken term by term."""
    found: dict[str, Expr] = {}
    count = sum(1 for _ in nodes(expr))
    terms = list(islice(_terms(expr), count + 1))
    if len(terms) > count:  # sums of shared sums: their terms may be without end
        terms = [(True, expr)]
    for positive, term in terms:
        for name in sorted(refs(term)):
            d = Derivative(name)(term)
            if d != ZERO:
                d = d if positive else neg(d)
                found[name] = op("+", found[name], d) if name in found else d
    return found


def _terms(expr: Expr) -> Iterator[tuple[bool, Expr]]:
    stack = [(True, expr)]
    while stack:
        positive, e = stack.pop()
        if isinstance(e, Op) and e.name in ("+", "-", "neg"):
            last = positive if e.name == "+" else not positive
            stack.append((last, e.args[-1]))
            if e.name != "neg":
                stack.append((positive, e.args[0]))
        else:
            yield positive, e


STEPS = frozenset({"sign", "floor", "ceil", "integer", "div", "curve_next", "curve3"})  # flat between their jumps
_FLAT = STEPS | {"pre", "der", "corner", "delayed"} | GENERATORS.keys() | {name + SLOPE for name in TEXTS}

_TWO = Num(2.0)
_GIVEN = 4  # arguments of an operation on a matrix before what is given: the output and three sizes

# f'(x) from x and f(x)
_CHAIN: dict[str, Callable[[Expr, Expr], Expr]] = {
    "neg": lambda x, f: Num(-1.0),
    "abs": lambda x, f: op("sign", x),
    "sqrt": lambda x, f: op("*", Num(0.5), op("hy_power_x", x, Num(0.5))),
    "exp": lambda x, f: f,
    "log": lambda x, f: op("/", ONE, x),
    "log10": lambda x, f: op("/", Num(1 / math.log(10.0)), x),
    "sin": lambda x, f: op("cos", x),
    "cos": lambda x, f: neg(op("sin", x)),
    "tan": lambda x, f: op("+", ONE, op("^", f, _TWO)),
    "asin": lambda x, f: op("/", ONE, op("sqrt", op("-", ONE, op("^", x, _TWO)))),
    "acos": lambda x, f: op("/", Num(-1.0), op("sqrt", op("-", ONE, op("^", x, _TWO)))),
    "atan": lambda x, f: op("/", ONE, op("+", ONE, op("^", x, _TWO))),
    "sinh": lambda x, f: op("cosh", x),
    "cosh": lambda x, f: op("sinh", x),
    "tanh": lambda x, f: op("-", ONE, op("^", f, _TWO)),
}


def _d_power(e: Op, da: Expr, db: Expr) -> Expr:
    a, b = e.args
    by_base = op("*", op("hy_power_x", a, b), da)
    if isinstance(b, Num):
        exponent = op("-", b, ONE)
        plain = b.value >= 1
        by_base = op("*", op("*", b, op("^", a, exponent)), da) if plain else by_base
        return by_base if plain else op("*", op("*", b, op("hy_power_x", a, b)), da)
    return op("+", op("*", b, by_base), op("*", op("hy_power_n", a, b), db))


def _d_power_x(e: Op, da: Expr, db: Expr) -> Expr:
    """Of x^(n-1): a second derivative, as in a tie that is differentiated and then solved by Newton's method."""
    x, n = e.args
    less = op("-", n, ONE)
    by_base = op("*", less, op("hy_power_x", x, less))
    return op("+", op("*", by_base, da), op("*", op("hy_power_n", x, less), db))


def _d_power_n(e: Op, da: Expr, db: Expr) -> Expr:
    """Of x^n log x."""
    x, n = e.args
    by_base = op("+", op("*", n, op("hy_power_n", x, op("-", n, ONE))), op("hy_power_x", x, n))
    by_exponent = select(op(">", x, ZERO), op("*", e, op("log", x)), ZERO)
    return op("+", op("*", by_base, da), op("*", by_exponent, db))


def _d_kernel(e: Op, *d: Expr) -> Expr:
    """Of an output of an operation on a matrix, along the way that its entries move."""
    return op(e.name + SLOPE, *e.args, *d[_GIVEN:])


_RULES_OF_SEVERAL: dict[str, Callable[..., Expr]] = {
    **dict.fromkeys(TEXTS, _d_kernel),
    "curve0": lambda e, da, *_: op("*", op("curve1", *e.args), da),
    "curve1": lambda e, da, *_: op("*", op("curve2", *e.args), da),
    "curve2": lambda e, da, *_: op("*", op("curve3", *e.args), da),
    "+": lambda e, da, db: op("+", da, db),
    "-": lambda e, da, db: op("-", da, db),
    "*": lambda e, da, db: op("+", op("*", da, e.args[1]), op("*", e.args[0], db)),
    "/": lambda e, da, db: op("/", op("-", da, op("*", e, db)), e.args[1]),
    "^": _d_power,
    "hy_power_x": lambda e, da, db: _d_power_x(e, da, db),
    "hy_power_n": lambda e, da, db: _d_power_n(e, da, db),
    "min": lambda e, da, db: select(op("<=", *e.args), da, db),
    "max": lambda e, da, db: select(op(">=", *e.args), da, db),
    "mod": lambda e, da, db: op("-", da, op("*", op("floor", op("/", *e.args)), db)),
    "rem": lambda e, da, db: op("-", da, op("*", op("div", *e.args), db)),
    "atan2": lambda e, da, db: op(
        "/",
        op("-", op("*", e.args[1], da), op("*", e.args[0], db)),
        op("+", op("^", e.args[0], _TWO), op("^", e.args[1], _TWO)),
    ),
}
