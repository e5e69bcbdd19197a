"""The functions of ``Modelica.Math`` that call LAPACK: their calls become operations, see ``matrix_kernels.py``.

Their bodies are left out (``workarounds/matrix_bodies.py``): the front end refuses most of them.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from math import cos, pi, sin

import numpy as np

from hystid.modelica.expr import ONE, ZERO, Expr, Num, op, select
from hystid.modelica.values import Array, Interpreter, Value, array, boxed, flattened, matrix, product, summed

_FUNCTION = re.compile(
    r"(?:^|\.)(?:Matrices\.(?:Utilities\.)?|Polynomials\.|(?:FastFourierTransform\.)?Internal\.)(?P<name>\w+)$"
)
_EPSILON = Num(2.0**-52)


def is_matrix_function(name: str) -> bool:
    """Whether an external function is one of these."""
    found = _FUNCTION.search(name)
    return found is not None and found["name"] in FUNCTIONS_OF_MATRICES


def factored(expander: Interpreter, name: str, args: Sequence[Value]) -> list[Value]:
    """Outputs of such a call. args: values of all inputs."""
    try:
        return FUNCTIONS_OF_MATRICES[name.rsplit(".", 1)[-1]](*args)
    except ValueError as error:
        expander.refuse(f"{name}(): {error}")


def _outputs(
    kernel: str, sizes: tuple[int, int, int], given: Sequence[Expr], shapes: Sequence[tuple[int, ...]]
) -> list[Array]:
    """Outputs of an operation, one after the other."""
    made, first = [], 0
    for shape in shapes:
        count = int(np.prod(shape))
        numbers = (Num(float(k)) for k in range(first, first + count))
        made.append(array([op(kernel, k, *(Num(float(n)) for n in sizes), *given) for k in numbers]).reshape(shape))
        first += count
    return made


def _known(flag: Value, what: str) -> bool:
    if not isinstance(flag, Num):
        raise ValueError(f"'{what}' has to be known when the model is built")
    return bool(flag.value)


def _square(value: Value) -> Array:
    found = matrix(value)
    if found.shape[0] != found.shape[1]:
        raise ValueError(f"a square matrix is wanted, not one of {found.shape[0]} rows and {found.shape[1]} columns")
    return found


def _zeros(rows: int, columns: int) -> Array:
    return array([ZERO] * (rows * columns)).reshape(rows, columns)


def _identity(n: int) -> Array:
    return array([ONE if i == j else ZERO for i in range(n) for j in range(n)]).reshape(n, n)


def _each(name: str, a: Array, b: Array) -> Array:
    return array([op(name, x, y) for x, y in zip(flattened(a), flattened(b), strict=True)]).reshape(a.shape)


def _scaled(a: Array, by: Value) -> Array:
    (factor,) = flattened(by)
    return array([op("*", x, factor) for x in flattened(a)]).reshape(a.shape)


def _least_squares(a: Array, b: Array, limit: Expr = _EPSILON) -> tuple[Array, Expr]:
    """x of least norm, and the rank of a."""
    n, m, k = len(a), a.shape[1], b.shape[1]
    x, rank = _outputs("hy_lsq", (n, m, k), [*flattened(a), *flattened(b), limit], [(m, k), (1,)])
    return x, rank[0]


def _solved(a: Array, b: Array) -> Array:
    return _least_squares(a, b)[0]


def _eigenvalues(a: Array) -> Array:
    """Shape (n, 2)."""
    n = len(a)
    return _outputs("hy_eigen", (n, n, 0), flattened(a), [(n, 2)])[0]


def _eigen(A: Value) -> list[Value]:
    a = _square(A)
    return list(_outputs("hy_eigen", (len(a), len(a), 0), flattened(a), [(len(a), 2), a.shape]))


def _of_hessenberg(H: Value) -> list[Value]:
    return [_eigenvalues(_square(H)), ZERO]


def _eigenvalue_matrix(values: Value) -> list[Value]:
    """Blocks of one row, or of two for a pair."""
    given = matrix(values)
    n = len(given)
    made = _zeros(n, n)
    first: Expr = ZERO
    for i, (real, im) in enumerate(given):
        first = op("and", op("<>", im, ZERO), op("not", first))  # of a pair
        made[i, i] = real
        if i + 1 < n:
            made[i, i + 1] = select(first, im, ZERO)
            made[i + 1, i] = select(first, given[i + 1, 1], ZERO)
    return [made]


def _balanced(A: Value, B: Value, C: Value) -> list[Value]:
    a, b, c = _square(A), boxed(B), boxed(C)
    n, right, down = len(a), b.shape[1], c.shape[0]
    shapes = [(n,), (n, n), (n, right), (down, n)]
    return list(_outputs("hy_balance", (n, right, down), [*flattened(a), *flattened(b), *flattened(c)], shapes))


def _singular(A: Value) -> list[Value]:
    n, m = matrix(A).shape
    return list(_outputs("hy_svd", (n, m, 0), flattened(A), [(min(n, m),), (n, n), (m, m)]))


def _rank(A: Value, eps: Value) -> list[Value]:
    """Singular values above a limit, which is that of their rounding where none is given."""
    a = matrix(A)
    (given,) = flattened(eps)
    sizes = flattened(_singular(A)[0])
    rounding = op("*", Num(max(a.shape) * _EPSILON.value), sizes[0])
    limit = select(op(">", given, ZERO), given, rounding)
    return [summed(select(op(">", size, limit), ONE, ZERO) for size in sizes)]


def _fitted(A: Value, b: Value, limit: Value) -> list[Value]:
    x, rank = _least_squares(matrix(A), matrix(b), flattened(limit)[0])
    return [x.reshape(-1), rank]


def _all_fitted(A: Value, B: Value, limit: Value) -> list[Value]:
    return list(_least_squares(matrix(A), matrix(B), flattened(limit)[0]))


def _fitted_under(A: Value, a: Value, B: Value, b: Value) -> list[Value]:
    """Least |A x - a| with B x = b: one x, and the best that B does not see beside it."""
    tall, wide = matrix(A), matrix(B)
    first = _solved(wide, matrix(b))
    unseen = _each("-", _identity(tall.shape[1]), _solved(wide, wide))
    rest = _each("-", matrix(a), product(tall, first))
    more, _ = _least_squares(product(tall, unseen), rest, Num(1e-12))
    return [_each("+", first, more).reshape(-1)]


def _polynomial(u: Value, y: Value, order: Value) -> list[Value]:
    (n,) = flattened(order)
    if not isinstance(n, Num):
        raise ValueError("the order has to be known when the model is built")
    powers = [op("^", x, Num(k)) for x in flattened(u) for k in range(int(n.value), -1, -1)]
    x, _ = _least_squares(array(powers).reshape(-1, int(n.value) + 1), matrix(y))
    return [x.reshape(-1)]


def _condition(A: Value, inf: Value) -> list[Value]:
    a = _square(A)
    inverse, rank = _least_squares(a, _identity(len(a)), ZERO)
    by_row, sizes = _known(inf, "inf"), []
    for one in (a, inverse):
        sums = [summed(op("abs", x) for x in row) for row in (one if by_row else one.T)]
        largest = sums[0]
        for other in sums[1:]:
            largest = op("max", largest, other)
        sizes.append(largest)
    regular = op(">=", rank, Num(float(len(a))))
    return [select(regular, op("/", ONE, op("*", *sizes)), ZERO), ZERO]


def _qr(A: Value, pivoting: Value) -> list[Value]:
    n, m = matrix(A).shape
    if n < m:
        raise ValueError(f"a matrix with {m} columns needs as many rows, and has {n}")
    moves = int(_known(pivoting, "pivoting"))
    return list(_outputs("hy_qr", (n, m, moves), flattened(A), [(n, m), (m, m), (m,)]))


def _cholesky(A: Value, upper: Value) -> list[Value]:
    a = _square(A)
    n = len(a)
    low = _zeros(n, n)
    for j in range(n):
        for i in range(j, n):
            left = op("-", a[i, j], summed(op("*", low[i, k], low[j, k]) for k in range(j)))
            low[i, j] = op("sqrt", left) if i == j else op("/", left, low[j, j])
    return [low.T if _known(upper, "upper") else low]


def _hessenberg(A: Value) -> list[Value]:
    a = _square(A)
    return list(_outputs("hy_hessenberg", (len(a), len(a), 0), flattened(a), [a.shape, a.shape]))


def _schur(A: Value) -> list[Value]:
    a = _square(A)
    n = len(a)
    return list(_outputs("hy_schur", (n, n, 0), flattened(a), [a.shape, a.shape, (n,), (n,)]))


def _exponential(a: Array) -> Array:
    return _outputs("hy_expm", (len(a), len(a), 0), flattened(a), [a.shape])[0]


def _exp(A: Value, T: Value) -> list[Value]:
    return [_exponential(_scaled(_square(A), T))]


def _integrals(A: Value, B: Value, T: Value, count: int) -> list[Value]:
    """exp(A T) and integrals of it over T times B, from one exponential of a larger matrix (C. Van Loan, 1978)."""
    a, b = _square(A), matrix(B)
    n, k = b.shape
    whole = _zeros(n + count * k, n + count * k)
    whole[:n, :n], whole[:n, n : n + k] = a, b
    for j in range(1, count):
        whole[n + (j - 1) * k : n + j * k, n + j * k : n + (j + 1) * k] = _identity(k)
    made = _exponential(_scaled(whole, T))
    return [made[:n, :n], *(made[:n, n + j * k : n + (j + 1) * k] for j in range(count))]


def _sort(M: Value, rows: Value, ascending: Value) -> list[Value]:
    by_row = _known(rows, "sortRows")
    given = matrix(M) if by_row else matrix(M).T
    sizes = (*given.shape, int(_known(ascending, "ascending")))
    found, order = _outputs("hy_rows", sizes, flattened(given), [given.shape, (len(given),)])
    return [found if by_row else found.T, order]


def _kronecker(a: Array, b: Array) -> Array:
    """What takes X to a X b', rows of X one after the other."""
    made = [op("*", x, y) for i in range(len(a)) for k in range(len(b)) for x in a[i] for y in b[k]]
    return array(made).reshape(len(a) * len(b), -1)


def _sylvester(terms: Sequence[tuple[Array, Array]], c: Array) -> Array:
    """X with the sum of a X b' = c."""
    whole = _kronecker(*terms[0])
    for a, b in terms[1:]:
        whole = _each("+", whole, _kronecker(a, b))
    regular = Num(-_EPSILON.value)  # a solution that does not exist, or is not the only one, is no number
    return _least_squares(whole, c.reshape(-1, 1), regular)[0].reshape(c.shape)


def _lyapunov(A: Value, C: Value, *_: Value) -> list[Value]:
    """X A + A' X = C."""
    a = _square(A)
    one = _identity(len(a))
    return [_sylvester([(one, a.T), (a.T, one)], matrix(C))]


def _continuous(A: Value, B: Value, C: Value, *_: Value) -> list[Value]:
    """A X + X B = C."""
    a, b = _square(A), _square(B)
    return [_sylvester([(a, _identity(len(b))), (_identity(len(a)), b.T)], matrix(C))]


def _discrete_lyapunov(A: Value, C: Value, _: Value, sign: Value, *__: Value) -> list[Value]:
    """A' X A + sgn X = C."""
    a = _square(A)
    return [_sylvester([(a.T, a.T), (_scaled(_identity(len(a)), sign), _identity(len(a)))], matrix(C))]


def _discrete(A: Value, B: Value, C: Value, _: Value, __: Value, sign: Value, *___: Value) -> list[Value]:
    """A X B + sgn X = C."""
    a, b = _square(A), _square(B)
    return [_sylvester([(a, b.T), (_scaled(_identity(len(a)), sign), _identity(len(b)))], matrix(C))]


def _fourier(u: Value) -> list[Value]:
    values = flattened(u)
    n = len(values)
    if n % 2:
        raise ValueError(f"an even number of samples is wanted, not {n}")
    amplitudes, phases = [], []  # as ModelicaFFT.c scales them: over n/2 + 1
    for k in range(n // 2 + 1):
        turns = [2 * pi * (k * j % n) / n for j in range(n)]
        re = summed(op("*", Num(round(cos(turn), 16)), x) for turn, x in zip(turns, values, strict=True))
        im = summed(op("*", Num(round(-sin(turn), 16)), x) for turn, x in zip(turns, values, strict=True))
        size = op("sqrt", op("+", op("^", re, Num(2.0)), op("^", im, Num(2.0))))
        amplitudes.append(op("/", size, Num(n / 2 + 1)))
        phases.append(op("atan2", im, re))
    return [ZERO, array(amplitudes), array(phases)]


FUNCTIONS_OF_MATRICES: dict[str, Callable[..., list[Value]]] = {
    "eigenValues": _eigen,
    "eigenValueMatrix": _eigenvalue_matrix,
    "balanceABC": _balanced,
    "eigenvaluesHessenberg": _of_hessenberg,
    "singularValues": _singular,
    "rank": _rank,
    "leastSquares": _fitted,
    "leastSquares2": _all_fitted,
    "equalityLeastSquares": _fitted_under,
    "fitting": _polynomial,
    "rcond": _condition,
    "QR": _qr,
    "cholesky": _cholesky,
    "hessenberg": _hessenberg,
    "realSchur": _schur,
    "exp": _exp,
    "integralExp": lambda A, B, T: _integrals(A, B, T, 1),
    "integralExpT": lambda A, B, T: _integrals(A, B, T, 2),
    "sort": _sort,
    "continuousLyapunov": _lyapunov,
    "continuousSylvester": _continuous,
    "discreteLyapunov": _discrete_lyapunov,
    "discreteSylvester": _discrete,
    "rawRealFFT": _fourier,
}
"""Last part of the name -> its outputs from its inputs."""
