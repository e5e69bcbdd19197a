"""Scalar functions that networks apply element by element: in C, in NumPy, and with their derivatives.

Adding one takes one line here and, where ONNX has an operator of its own for it, one in ``operators``.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import special

from hystid.surrogate.tensors import Kind, Values


@dataclass(frozen=True)
class Operation:
    """y = f(a, b, ...). ``c`` and ``partials`` are C expressions in {a}, {b}, {c} and, for partials, {y}.

    partials: one per operand; None, or nothing at all, where the derivative vanishes (almost) everywhere.
    kind: element type of y, None for that of a. Helpers in ``C_HELPERS`` that the expressions call come with them.
    """

    c: str
    numpy: Callable[..., Values]
    partials: tuple[str | None, ...] = ()
    kind: Kind | None = None


def _truncated_division(a: Values, b: Values) -> Values:
    """Division as ONNX has it: exact for floats, towards zero for whole numbers."""
    return np.asarray(np.trunc(a / b)) if a.dtype.kind == "i" else np.asarray(a / b)


def _float(f: Callable[..., Any]) -> Callable[..., Values]:
    def call(*operands: Values) -> Values:
        with np.errstate(all="ignore"):  # the compiled code gives inf and NaN for these as well
            return np.asarray(f(*(np.asarray(a, dtype=np.float64) for a in operands)))

    return call


FUNCTIONS: dict[str, Operation] = {
    # arithmetic
    "copy": Operation("{a}", lambda a: a, ("1.0",)),
    "neg": Operation("-{a}", np.negative, ("-1.0",)),
    "add": Operation("{a} + {b}", np.add, ("1.0", "1.0")),
    "sub": Operation("{a} - {b}", np.subtract, ("1.0", "-1.0")),
    "mul": Operation("{a} * {b}", np.multiply, ("{b}", "{a}")),
    "div": Operation("{a} / {b}", _float(np.divide), ("1.0 / {b}", "-{y} / {b}")),
    "div_int": Operation("trunc({a} / {b})", _truncated_division),
    "mod": Operation("nn_mod({a}, {b})", np.mod),
    "fmod": Operation("fmod({a}, {b})", np.fmod, ("1.0", "-trunc({a} / {b})")),
    "pow": Operation(
        "pow({a}, {b})",
        _float(np.power),
        ("{b} == 0.0 ? 0.0 : {b} * pow({a}, {b} - 1.0)", "{a} > 0.0 ? {y} * log({a}) : 0.0"),
    ),
    "reciprocal": Operation("1.0 / {a}", _float(lambda a: 1.0 / a), ("-{y} * {y}",)),
    "min": Operation(
        "{a} < {b} || {a} != {a} ? {a} : {b}", np.minimum, ("{a} < {b} ? 1.0 : 0.0", "{a} < {b} ? 0.0 : 1.0")
    ),
    "max": Operation(
        "{a} > {b} || {a} != {a} ? {a} : {b}", np.maximum, ("{a} > {b} ? 1.0 : 0.0", "{a} > {b} ? 0.0 : 1.0")
    ),
    "square": Operation("{a} * {a}", np.square, ("2.0 * {a}",)),
    # activations
    "tanh": Operation("nn_tanh({a})", _float(np.tanh), ("1.0 - {y} * {y}",)),
    "sigmoid": Operation("nn_sigmoid({a})", _float(special.expit), ("{y} * (1.0 - {y})",)),
    "relu": Operation("{a} < 0.0 ? 0.0 : {a}", lambda a: np.where(a < 0, 0, a), ("{a} > 0.0 ? 1.0 : 0.0",)),
    "leaky": Operation(
        "{a} < 0.0 ? {b} * {a} : {a}",
        lambda a, b: np.where(a < 0, b * a, a),
        ("{a} < 0.0 ? {b} : 1.0", "{a} < 0.0 ? {a} : 0.0"),
    ),
    "softplus": Operation("nn_softplus({a})", _float(lambda a: np.logaddexp(0.0, a)), ("nn_sigmoid({a})",)),
    "hard_sigmoid": Operation(
        "fmin(1.0, fmax(0.0, {b} * {a} + {c}))",
        lambda a, b, c: np.clip(b * a + c, 0.0, 1.0),
        ("{y} > 0.0 && {y} < 1.0 ? {b} : 0.0", None, None),
    ),
    # elementary functions
    "exp": Operation("exp({a})", _float(np.exp), ("{y}",)),
    "expm1": Operation("expm1({a})", _float(np.expm1), ("{y} + 1.0",)),
    "log": Operation("log({a})", _float(np.log), ("1.0 / {a}",)),
    "sqrt": Operation("sqrt({a})", _float(np.sqrt), ("{y} > 0.0 ? 0.5 / {y} : 0.0",)),
    "erf": Operation("erf({a})", _float(special.erf), ("1.1283791670955126 * exp(-{a} * {a})",)),
    "sin": Operation("sin({a})", _float(np.sin), ("cos({a})",)),
    "cos": Operation("cos({a})", _float(np.cos), ("-sin({a})",)),
    "tan": Operation("tan({a})", _float(np.tan), ("1.0 + {y} * {y}",)),
    "asin": Operation("asin({a})", _float(np.arcsin), ("1.0 / sqrt(1.0 - {a} * {a})",)),
    "acos": Operation("acos({a})", _float(np.arccos), ("-1.0 / sqrt(1.0 - {a} * {a})",)),
    "atan": Operation("atan({a})", _float(np.arctan), ("1.0 / (1.0 + {a} * {a})",)),
    "sinh": Operation("sinh({a})", _float(np.sinh), ("cosh({a})",)),
    "cosh": Operation("cosh({a})", _float(np.cosh), ("sinh({a})",)),
    "asinh": Operation("asinh({a})", _float(np.arcsinh), ("1.0 / sqrt({a} * {a} + 1.0)",)),
    "abs": Operation("fabs({a})", np.abs, ("({a} > 0.0) - ({a} < 0.0)",)),
    # steps: no derivative almost everywhere
    "sign": Operation("({a} > 0.0) - ({a} < 0.0)", np.sign),
    "floor": Operation("floor({a})", np.floor),
    "ceil": Operation("ceil({a})", np.ceil),
    "round": Operation("nearbyint({a})", np.rint),
    "trunc": Operation("trunc({a})", np.trunc),
    "truth": Operation("{a} != 0.0", lambda a: a != 0, kind="bool"),
    # relations and logic
    "less": Operation("{a} < {b}", np.less, kind="bool"),
    "less_equal": Operation("{a} <= {b}", np.less_equal, kind="bool"),
    "greater": Operation("{a} > {b}", np.greater, kind="bool"),
    "greater_equal": Operation("{a} >= {b}", np.greater_equal, kind="bool"),
    "equal": Operation("{a} == {b}", np.equal, kind="bool"),
    "isnan": Operation("{a} != {a}", np.isnan, kind="bool"),
    "not": Operation("{a} == 0.0", np.logical_not, kind="bool"),
    "and": Operation("{a} != 0.0 && {b} != 0.0", np.logical_and, kind="bool"),
    "or": Operation("{a} != 0.0 || {b} != 0.0", np.logical_or, kind="bool"),
    "xor": Operation("({a} != 0.0) != ({b} != 0.0)", np.logical_xor, kind="bool"),
    "select": Operation("{a} != 0.0 ? {b} : {c}", np.where, (None, "{a} != 0.0 ? 1.0 : 0.0", "{a} != 0.0 ? 0.0 : 1.0")),
}

_EXPM1 = """\
/* exp(s) - 1 = 2^k (1 + p) - 1 with s = k ln 2 + r, |r| <= ln 2 / 2, p = exp(r) - 1; 0 <= s <= 708.
 * The polynomial is the Chebyshev fit of (exp(r) - 1 - r) / r^2 of degree 9; its error is 4e-17 relative to p.
 * Free of branches, so that neighbouring neurons overlap in the pipeline. */
static inline void nn_exp_parts(double s, double *scale, double *p)
{
    const double shifted = s * 1.4426950408889634 + 0x1.8p52; /* the low bits now hold k */
    const double k = shifted - 0x1.8p52;
    const double r = (s - k * 0x1.62e42fefa0000p-1) - k * 0x1.cf79abc9e3b3ap-40; /* ln 2 in two parts */
    const double r2 = r * r, r4 = r2 * r2;
    const double q0 = 0.5000000000000001 + 0.16666666666666669 * r, q2 = 0.04166666666662399 + 0.008333333333330051 * r;
    const double q4 = 0.0013888888917281794 + 0.00019841269863105968 * r;
    const double q6 = 2.480152119021773e-05 + 2.7557268378684192e-06 * r;
    const double q8 = 2.7620138719733994e-07 + 2.5100424157005067e-08 * r;
    uint64_t bits;
    memcpy(&bits, &shifted, sizeof bits);
    bits = (bits + 1023u) << 52;
    memcpy(scale, &bits, sizeof bits);
    *p = r + r2 * ((q0 + r2 * q2) + r4 * ((q4 + r2 * q6) + r4 * q8));
}
"""

C_HELPERS: dict[str, tuple[str, tuple[str, ...]]] = {
    "nn_exp_parts": (_EXPM1, ()),
    "nn_tanh": (
        """\
/* tanh(x) = sgn(x) e / (e + 2), e = exp(2 |x|) - 1: within 2 units in the last place. NaN stays NaN. */
static inline double nn_tanh(double x)
{
    double scale, p;
    const double s = fabs(x) > 20.0 ? 40.0 : 2.0 * fabs(x);
    nn_exp_parts(s, &scale, &p);
    const double e = scale * p + (scale - 1.0);
    return copysign(e / (e + 2.0), x);
}
""",
        ("nn_exp_parts",),
    ),
    "nn_tanh_all": (
        """\
static void nn_tanh_all(int n, const double *x, double *y)
{
    for (int i = 0; i < n; ++i) y[i] = nn_tanh(x[i]);
}
""",
        ("nn_tanh",),
    ),
    "nn_dense": (
        """\
/* y = weights x + bias; weights: m rows of n; bias may be NULL */
static void nn_dense(int m, int n, const double *weights, const double *x, const double *bias, double *y)
{
    for (int i = 0; i < m; ++i) {
        double sum = bias ? bias[i] : 0.0;
        for (int k = 0; k < n; ++k) sum += x[k] * weights[n * i + k];
        y[i] = sum;
    }
}
""",
        (),
    ),
    "nn_dense_back": (
        """\
/* x += weights' y; weights: m rows of n */
static void nn_dense_back(int m, int n, const double *weights, const double *y, double *x)
{
    for (int i = 0; i < m; ++i)
        for (int k = 0; k < n; ++k) x[k] += y[i] * weights[n * i + k];
}
""",
        (),
    ),
    "nn_sigmoid": (
        """\
/* 1 / (1 + exp(-x)), with exp of a negative argument only, so that it neither overflows nor cancels. */
static inline double nn_sigmoid(double x)
{
    double scale, p;
    nn_exp_parts(fabs(x) > 700.0 ? 700.0 : fabs(x), &scale, &p);
    const double e = scale + scale * p;
    return (x < 0.0 ? 1.0 : e) / (1.0 + e);
}
""",
        ("nn_exp_parts",),
    ),
    "nn_softplus": (
        """\
static inline double nn_softplus(double x) { return (x > 0.0 ? x : 0.0) + log1p(exp(-fabs(x))); }
""",
        ("nn_sigmoid",),
    ),
    "nn_mod": (
        """\
/* remainder with the sign of the divisor */
static inline double nn_mod(double a, double b) { return a - b * floor(a / b); }
""",
        (),
    ),
}
