"""Expressions as C text."""

from __future__ import annotations

import hashlib
import math
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from itertools import islice

from hystid.modelica.curves import C_TEXT, NEXT_TEXT, literal
from hystid.modelica.expr import CURVES, LOGICAL, Expr, Num, Op, Ref, Text, nodes
from hystid.modelica.matrix_kernels import SLOPE, SLOPE_TEXT, TEXTS, work
from hystid.modelica.xorshift import C_TEXT as RANDOM_TEXT
from hystid.modelica.xorshift import C_TEXTS as RANDOM_TEXTS

# Text of small functions, put into model.c only where they are used.
HELPERS = {
    "hy_drawn": RANDOM_TEXT,
    **{text: text for texts in TEXTS.values() for text in texts},
    SLOPE: SLOPE_TEXT,
    **RANDOM_TEXTS,
    "hy_curve": C_TEXT,
    "hy_next_break": NEXT_TEXT,
    "hy_sign": "static double hy_sign(double x) { return x > 0 ? 1.0 : x < 0 ? -1.0 : 0.0; }",
    "hy_min": "static double hy_min(double a, double b) { return a <= b ? a : b; }",
    "hy_max": "static double hy_max(double a, double b) { return a >= b ? a : b; }",
    "hy_mod": "static double hy_mod(double x, double y) { return x - floor(x / y) * y; }",
    "hy_rem": "static double hy_rem(double x, double y) { return x - trunc(x / y) * y; }",
    "hy_square": "static double hy_square(double x) { return x * x; }",
    "hy_cube": "static double hy_cube(double x) { return x * x * x; }",
    "hy_limited": "/* exp, with straight lines beyond a limit that is not 0 */\n"
    "static double hy_limited(double x, double limit)\n{\n"
    "    const double near = limit != 0 ? fmin(fmax(x, -4), limit) : x;\n"
    "    return exp(near) * (1 + (x - near));\n}",
    "hy_slope": "static double hy_slope(double x, double limit)\n{\n"
    "    return exp(limit != 0 ? fmin(fmax(x, -4), limit) : x);\n}",
    "hy_power_x": "/* x^(n-1); 0 where that is infinite, so that derivatives stay finite */\n"
    "static double hy_power_x(double x, double n) { return x == 0 && n < 1 ? 0.0 : pow(x, n - 1); }",
    "hy_power_n": "/* d(x^n)/dn; its limit 0 at x = 0 */\n"
    "static double hy_power_n(double x, double n) { return x > 0 ? pow(x, n) * log(x) : 0.0; }",
}

_CALLS = {
    "sign": "hy_sign",
    "min": "hy_min",
    "max": "hy_max",
    "mod": "hy_mod",
    "rem": "hy_rem",
    "abs": "fabs",
    "integer": "floor",
    "^": "pow",
}
_WEIGHT = {"+": 4, "-": 4, "*": 5, "/": 5}
_CHEAP = frozenset({"neg", "not"})
_SHORT = 12  # nodes


class Printer:
    """Prints expressions; name gives the C text of a variable. ``used`` and ``tables`` collect what they need."""

    def __init__(self, name: Callable[[str], str]) -> None:
        self.name = name
        self.used: set[str] = set()
        self.tables: dict[str, Sequence[float]] = {}
        self._temporaries: Mapping[Expr, str] = {}
        self._count = 0

    def lines(self, values: Sequence[Expr]) -> tuple[list[str], list[str]]:
        """Declarations of shared parts, and the texts of the values that use them."""
        shared = self._shared(values)
        declarations = []
        self._temporaries = {}
        made: dict[Expr, str] = {}
        for node in shared:
            text = self.value(node)
            self._count += 1
            made[node] = f"t{self._count}"
            declarations.append(f"const double {made[node]} = {text};")
            self._temporaries = made
        texts = [self.value(v) for v in values]
        self._temporaries = {}
        return declarations, texts

    def _shared(self, values: Iterable[Expr]) -> list[Expr]:
        """Operations that appear more than once and cost more than reading them back, inner ones first."""
        counts: Counter[Expr] = Counter()
        order: list[Expr] = []

        def visit(node: Expr) -> None:
            if not isinstance(node, Op):
                return
            counts[node] += 1
            if counts[node] == 1:
                for a in node.args:
                    visit(a)
                order.append(node)

        for v in values:
            visit(v)
        return [n for n in order if counts[n] > 1 and isinstance(n, Op) and self._worth_a_name(n)]

    def _worth_a_name(self, e: Op) -> bool:
        """Conditions are printed again where they are short."""
        return e.name not in _CHEAP and (e.name not in LOGICAL or len(list(islice(nodes(e), _SHORT + 1))) > _SHORT)

    def value(self, e: Expr, weight: int = 0) -> str:
        """Text of a number; parentheses where the surroundings bind at least as tightly as ``weight``."""
        if e in self._temporaries:
            return self._temporaries[e]
        if isinstance(e, Num):
            return number(e.value)
        if isinstance(e, Ref):
            return self.name(e.name)
        assert isinstance(e, Op), e
        text, own = self._operation(e)
        return f"({text})" if own < weight else text

    def _operation(self, e: Op) -> tuple[str, int]:
        if e.name in _WEIGHT:
            own = _WEIGHT[e.name]
            right = own + 1 if e.name in ("-", "/") else own
            return f"{self.value(e.args[0], own)} {e.name} {self.value(e.args[1], max(right, own + 1))}", own
        if e.name == "neg":
            return f"-{self.value(e.args[0], 6)}", 4
        if e.name == "if":
            return f"{self.truth(e.args[0], 1)} ? {self.value(e.args[1], 1)} : {self.value(e.args[2])}", 0
        if e.name in LOGICAL or e.name == "hy_passed":
            return f"{self.truth(e, 1)} ? 1.0 : 0.0", 0
        if e.name == "div":
            return f"trunc({self.value(e.args[0], 5)} / {self.value(e.args[1], 6)})", 9
        return self._call(e), 9

    def _call(self, e: Op) -> str:
        if e.name == "^" and isinstance(e.args[1], Num) and e.args[1].value in (2.0, 3.0):
            name, args = ("hy_square" if e.args[1].value == 2.0 else "hy_cube"), e.args[:1]
        else:
            name, args = _CALLS.get(e.name, e.name), e.args
        if name in CURVES or name == "curve_next":
            return self._curve(name, args)
        if name == "delayed":
            assert isinstance(args[0], Text)
            self.used.add("hy_delayed")
            return f"hy_delayed(&{self.name(args[0].value)}, {self.value(args[1])})"
        if name in RANDOM_TEXTS:
            self.used |= {"hy_drawn", name}
            wanted, *state = map(self.value, args)
            return f"{name}((int){wanted}, (const double[{len(state)}]){{{', '.join(state)}}})"
        if name.removesuffix(SLOPE) in TEXTS:
            return self._kernel(name, args)
        if name in HELPERS:
            self.used.add(name)
        return f"{name}({', '.join(self.value(a) for a in args)})"

    def _kernel(self, name: str, args: tuple[Expr, ...]) -> str:
        """An operation on a matrix, or its slope."""
        kernel = name.removesuffix(SLOPE)
        wanted, *sizes = (int(a.value) for a in args[:4] if isinstance(a, Num))
        values = [self.value(a) for a in args[4:]]
        self.used.update(TEXTS[kernel])
        shape, given = ", ".join(map(str, sizes)), ", ".join(values)
        told = f"{wanted}, (const int[3]){{{shape}}}, (const double[{len(values)}]){{{given}}}"
        if name == kernel:
            return f"{kernel}({told}, (double[{work(sizes)}]){{0}})"
        self.used.add(SLOPE)
        count = len(values) // 2
        return f"hy_slope({kernel}, {told}, {count}, (double[{work(sizes) + count}]){{0}})"

    def _curve(self, name: str, args: tuple[Expr, ...]) -> str:
        """A lookup in the numbers of a table, which the preamble prints."""
        data = args[1]
        assert isinstance(data, Text)
        key = f"hy_table_{hashlib.sha256(data.value.encode()).hexdigest()[:12]}"
        self.used.add("hy_next_break" if name == "curve_next" else "hy_curve")
        self.tables[key] = literal(data.value)
        x = self.value(args[0])
        if name == "curve_next":
            return f"hy_next_break({key}, {x})"
        return f"hy_curve({key}, {x}, {CURVES[name]}, {self.value(args[2])})"

    def truth(self, e: Expr, weight: int = 0) -> str:
        """Text of a condition."""
        if isinstance(e, Num):
            return "1" if e.value else "0"
        if isinstance(e, Op) and e.name in _TRUTH and e not in self._temporaries:
            text, own = _TRUTH[e.name](self, e.args)
            return f"({text})" if own < weight else text
        text = self.value(e, 3)
        return f"({text} != 0)" if weight > 2 else f"{text} != 0"


def _relation(sign: str) -> Callable[[Printer, tuple[Expr, ...]], tuple[str, int]]:
    return lambda p, a: (f"{p.value(a[0], 4)} {sign} {p.value(a[1], 4)}", 3)


_TRUTH: dict[str, Callable[[Printer, tuple[Expr, ...]], tuple[str, int]]] = {
    "<": _relation("<"),
    "<=": _relation("<="),
    ">": _relation(">"),
    ">=": _relation(">="),
    "==": _relation("=="),
    "<>": _relation("!="),
    "hy_passed": _relation(">="),
    "and": lambda p, a: (f"{p.truth(a[0], 3)} && {p.truth(a[1], 3)}", 2),
    "or": lambda p, a: (f"{p.truth(a[0], 3)} || {p.truth(a[1], 3)}", 1),
    "not": lambda p, a: (f"!{p.truth(a[0], 9)}", 8),
    "if": lambda p, a: (f"{p.truth(a[0], 3)} ? {p.truth(a[1], 3)} : {p.truth(a[2], 3)}", 0),
}


def number(value: float) -> str:
    """C literal with the same bits."""
    if math.isinf(value):
        return "INFINITY" if value > 0 else "(-INFINITY)"
    text = repr(float(value))
    return f"({text})" if value < 0 else text


def quoted(text: str) -> str:
    """C string literal in ASCII; other characters as octal escapes of their UTF-8 bytes."""
    escaped = ""
    for byte in text.encode():
        char = chr(byte)
        if char in '"\\':
            escaped += "\\" + char
        elif char == "?" or not 32 <= byte < 127:
            escaped += f"\\{byte:03o}"
        else:
            escaped += char
    return f'"{escaped}"'


def comment(text: str) -> str:
    """Text that may stand inside a C comment."""
    return text.replace("*/", "* /").replace("/*", "/ *").replace("\\", "/")
