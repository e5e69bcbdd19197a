"""The functions of ``Modelica.Math`` that call LAPACK: compiled C beside SciPy, and what defines each of them."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy import linalg

from hystid.compiled import CompiledModel
from hystid.errors import ModelicaError, NumericalError
from hystid.modelica import compile_model
from hystid.numeric import Array

Called = Callable[..., list[Array]]
RTOL = 1e-9  # of factorisations in double precision, of matrices whose condition is below 1e4

# inputs and outputs of each, as the standard library declares them
DECLARED = {
    "Matrices.eigenValues": "input Real A[:, size(A, 1)]; output Real e[size(A, 1), 2];"
    " output Real v[size(A, 1), size(A, 2)];",
    "Matrices.eigenValueMatrix": "input Real e[:, 2]; output Real J[size(e, 1), size(e, 1)];",
    "Matrices.singularValues": "input Real A[:, :]; output Real s[min(size(A, 1), size(A, 2))];"
    " output Real U[size(A, 1), size(A, 1)] = identity(size(A, 1)); output Real VT[size(A, 2), size(A, 2)];",
    "Matrices.rank": "input Real A[:, :]; input Real eps = 0; output Integer r;",
    "Matrices.leastSquares": "input Real A[:, :]; input Real b[size(A, 1)]; input Real rcond = 1e-13;"
    " output Real x[size(A, 2)]; output Integer rank;",
    "Matrices.leastSquares2": "input Real A[:, :]; input Real B[size(A, 1), :]; input Real rcond = 1e-13;"
    " output Real X[size(A, 2), size(B, 2)]; output Integer rank;",
    "Matrices.equalityLeastSquares": "input Real A[:, :]; input Real a[size(A, 1)]; input Real B[:, size(A, 2)];"
    " input Real b[size(B, 1)]; output Real x[size(A, 2)];",
    "Matrices.rcond": "input Real A[:, size(A, 1)]; input Boolean inf = false; output Real r; output Integer info;",
    "Matrices.QR": "input Real A[:, :]; input Boolean pivoting = true; output Real Q[size(A, 1), size(A, 2)];"
    " output Real R[size(A, 2), size(A, 2)]; output Integer p[size(A, 2)];",
    "Matrices.cholesky": "input Real A[:, size(A, 1)]; input Boolean upper = true;"
    " output Real H[size(A, 1), size(A, 2)];",
    "Matrices.hessenberg": "input Real A[:, size(A, 1)]; output Real H[size(A, 1), size(A, 2)];"
    " output Real U[size(A, 1), size(A, 2)];",
    "Matrices.realSchur": "input Real A[:, size(A, 1)]; output Real S[size(A, 1), size(A, 2)];"
    " output Real QZ[size(A, 1), size(A, 2)]; output Real re[size(A, 1)]; output Real im[size(A, 1)];",
    "Matrices.exp": "input Real A[:, size(A, 1)]; input Real T = 1; output Real phi[size(A, 1), size(A, 1)];",
    "Matrices.integralExpT": "input Real A[:, size(A, 1)]; input Real B[size(A, 1), :]; input Real T = 1;"
    " output Real phi[size(A, 1), size(A, 1)]; output Real g[size(A, 1), size(B, 2)];"
    " output Real g1[size(A, 1), size(B, 2)];",
    "Matrices.sort": "input Real M[:, :]; input Boolean sortRows = true; input Boolean ascending = true;"
    " output Real s[size(M, 1), size(M, 2)]; output Integer i[if sortRows then size(M, 1) else size(M, 2)];",
    "Matrices.balanceABC": "input Real A[:, size(A, 1)]; input Real B[size(A, 1), :]; input Real C[:, size(A, 1)];"
    " output Real scale[size(A, 1)]; output Real As[size(A, 1), size(A, 1)]; output Real Bs[size(A, 1), size(B, 2)];"
    " output Real Cs[size(C, 1), size(A, 1)];",
    "Matrices.continuousLyapunov": "input Real A[:, size(A, 1)]; input Real C[size(A, 1), size(A, 2)];"
    " input Boolean ATisSchur = false; input Real eps = 1e-14; output Real X[size(A, 1), size(A, 2)];",
    "Matrices.continuousSylvester": "input Real A[:, :]; input Real B[:, :]; input Real C[size(A, 1), size(B, 2)];"
    " input Boolean AisSchur = false; input Boolean BisSchur = false; output Real X[size(A, 1), size(B, 2)];",
    "Matrices.discreteLyapunov": "input Real A[:, size(A, 1)]; input Real C[size(A, 1), size(A, 2)];"
    " input Boolean ATisSchur = false; input Integer sgn = 1; input Real eps = 1e-14;"
    " output Real X[size(A, 1), size(A, 2)];",
    "Matrices.discreteSylvester": "input Real A[:, size(A, 1)]; input Real B[:, size(B, 1)];"
    " input Real C[size(A, 2), size(B, 1)]; input Boolean AisHess = false; input Boolean BTisSchur = false;"
    " input Integer sgn = 1; input Real eps = 1e-14; output Real X[size(A, 2), size(B, 1)];",
    "Polynomials.fitting": "input Real u[:]; input Real y[size(u, 1)]; input Integer n; output Real p[n + 1];",
    "FastFourierTransform.Internal.rawRealFFT": "input Real u[:]; output Integer info;"
    " output Real a[div(size(u, 1), 2) + 1];"
    " output Real phases[div(size(u, 1), 2) + 1];",
}  # fmt: skip

A = np.array([[1.3, 2.0, 0.5], [0.3, 4.0, 1.0], [2.0, 0.1, 3.0]])
PAIR = np.array([[1.3, 2.0, 0.5], [-3.0, 1.0, 1.0], [0.2, 0.1, -3.0]])
SPD = np.array([[4.3, 1.0, 0.5], [1.0, 3.0, 0.2], [0.5, 0.2, 2.0]])
TALL = np.array([[1.3, 2.0], [3.0, 4.0], [5.0, 7.0], [-1.0, 0.4]])
B = np.array([[1.0], [2.0], [3.0]])
RANDOM = np.random.default_rng(1).standard_normal((5, 5))


def text(value: object) -> str:
    """A matrix, a vector, or a plain value in Modelica; the first entry follows p, which is 0.3."""
    if not isinstance(value, np.ndarray):
        return str(value).lower()
    entries = [repr(float(x)) for x in value.flat]
    entries[0] = f"p + ({float(value.flat[0]) - 0.3!r})"
    rows = np.array(entries, dtype=object).reshape(value.shape)
    return "{" + ", ".join(rows) + "}" if rows.ndim == 1 else "[" + "; ".join(", ".join(row) for row in rows) + "]"


@pytest.fixture
def called(tmp_path: Path) -> Called:
    """called(name, shapes, *args): outputs of a compiled call."""
    folder = tmp_path / "lib" / "Modelica"
    (folder / "Math").mkdir(parents=True)
    (folder / "package.mo").write_text("package Modelica\nend Modelica;\n")
    packages: dict[str, list[str]] = {}
    for name, clauses in DECLARED.items():
        package, function = name.rsplit(".", 1)
        inputs, outputs = clauses.split(" output ", 1)
        packages.setdefault(package, []).append(
            f"function {function}\n{inputs}\nprotected\n Integer n = 1;\npublic\n output {outputs}\n"
            f"algorithm\n while n > 0 loop\n n := n - 1;\n end while;\n annotation (Documentation);\nend {function};"
        )
    inner = ""
    for name, made in packages.items():
        opened, closed = [f"package {part}" for part in name.split(".")], [f"end {p};" for p in name.split(".")[::-1]]
        inner += "\n".join([*opened, *made, *closed, ""])
    (folder / "Math" / "package.mo").write_text(f"within Modelica;\npackage Math\n{inner}\nend Math;\n")

    def call(name: str, shapes: list[tuple[int, ...]], *args: object) -> list[Array]:
        kinds = re.findall(r"output (\w+) ", DECLARED[name])
        each = enumerate(zip(kinds, shapes, strict=False))
        declared = "\n".join(f"{kind} y{k}{list(shape) if shape else ''};" for k, (kind, shape) in each)
        left = ", ".join(f"y{k}" for k in range(len(shapes)))
        left = f"({left})" if len(shapes) > 1 else left
        equation = f"{left} = Modelica.Math.{name}({', '.join(map(text, args))});"
        place = tmp_path / "A.mo"
        place.write_text(
            f"model A\nReal p = if time < 1 then 0.3 else time;\n{declared}\nequation\n{equation}\nend A;\n"
        )
        model = CompiledModel(compile_model(f"{place}:A", libraries=[tmp_path / "lib"]))
        names = [
            [f"y{k}[{','.join(str(i + 1) for i in index)}]" if shape else f"y{k}" for index in np.ndindex(*shape)]
            for k, shape in enumerate(shapes)
        ]
        run = model.simulate({}, 0.05, rows=3, outputs=[n for group in names for n in group])
        return [
            np.array([run[n][-1] for n in group]).reshape(shape) for group, shape in zip(names, shapes, strict=True)
        ]

    return call


def same(found: Array, expected: Array) -> None:
    np.testing.assert_allclose(found, expected, rtol=RTOL, atol=RTOL * float(np.max(np.abs(expected), initial=1.0)))


def in_order(values: Array) -> Array:
    return values[np.lexsort(np.round(values, 7).T)]


@pytest.mark.parametrize(
    "a", [A, PAIR, SPD, np.diag([2.3, 2.0, 2.0]), RANDOM], ids=["real", "pair", "symmetric", "twice", "5"]
)
def test_eigenvalues_and_their_vectors(called: Called, a: Array) -> None:
    n = len(a)
    values, vectors = called("Matrices.eigenValues", [(n, 2), (n, n)], a)
    expected = np.linalg.eigvals(a)
    same(in_order(values), in_order(np.stack([expected.real, expected.imag], axis=1)))
    (blocks,) = called("Matrices.eigenValueMatrix", [(n, n)], values)
    same(a @ vectors, vectors @ blocks)
    pair = values[:, 1] != 0
    lengths = np.linalg.norm(vectors, axis=0)
    same(lengths[~pair], np.ones(np.count_nonzero(~pair)))
    same(np.hypot(lengths[:-1], lengths[1:])[values[:-1, 1] > 0], np.ones(np.count_nonzero(values[:, 1] > 0)))
    assert np.linalg.matrix_rank(vectors) == n  # also where an eigenvalue stands twice


@pytest.mark.parametrize("a", [A, TALL, TALL.T, np.outer([1.3, 2, 3, 4], [1, 2, 1]), np.zeros((2, 3))])
def test_singular_values(called: Called, a: Array) -> None:
    n, m = a.shape
    if not a.any():
        a = a + np.eye(2, 3, dtype=float) * np.array([[0.3], [0.0]])  # the first entry moves through p
    s, u, vt = called("Matrices.singularValues", [(min(n, m),), (n, n), (m, m)], a)
    same(s, np.linalg.svd(a, compute_uv=False))
    middle = np.zeros((n, m))
    np.fill_diagonal(middle, s)
    same(u @ middle @ vt, a)
    same(u.T @ u, np.eye(n))
    same(vt @ vt.T, np.eye(m))


@pytest.mark.parametrize("a", [TALL, TALL.T, np.outer([1.3, 2, 3, 4], [1, 2, 1])], ids=["tall", "wide", "rank 1"])
def test_least_squares_of_least_norm(called: Called, a: Array) -> None:
    b = np.array([[1.3, 0.2], [-1.0, 2.0], [0.4, 0.1], [2.0, 1.0]])[: len(a)]
    x, rank = called("Matrices.leastSquares2", [(a.shape[1], 2), ()], a, b)
    same(x, np.linalg.pinv(a) @ b)
    assert rank == np.linalg.matrix_rank(a) == called("Matrices.rank", [()], a)[0]
    assert called("Matrices.rank", [()], a, 100.0)[0] == 0
    (y, _) = called("Matrices.leastSquares", [(a.shape[1],), ()], a, b[:, 1])
    same(y, np.linalg.pinv(a) @ b[:, 1])


def test_least_squares_under_a_condition(called: Called) -> None:
    a, rest, b, right = A, np.array([1.3, 2.0, 5.0]), np.array([[1.0, 1.0, 1.0]]), np.array([1.5])
    (x,) = called("Matrices.equalityLeastSquares", [(3,)], a, rest, b, right)
    whole = np.block([[a.T @ a, b.T], [b, np.zeros((1, 1))]])  # stationary, with a multiplier
    same(x, np.linalg.solve(whole, np.concatenate([a.T @ rest, right]))[:3])


@pytest.mark.parametrize("inf", [False, True])
def test_condition(called: Called, inf: bool) -> None:
    found, _ = called("Matrices.rcond", [(), ()], A, inf)
    same(found, 1 / np.asarray(np.linalg.cond(A, np.inf if inf else 1)))


@pytest.mark.parametrize("pivoting", [True, False])
@pytest.mark.parametrize("a", [A, TALL], ids=["square", "tall"])
def test_qr(called: Called, a: Array, pivoting: bool) -> None:
    m = a.shape[1]
    q, r, p = called("Matrices.QR", [a.shape, (m, m), (m,)], a, pivoting)
    expected = linalg.qr(a, mode="economic", pivoting=pivoting)
    for found, known in zip((q, r), expected, strict=False):
        same(found, known)  # signs as LAPACK has them
    assert list(p) == (list(expected[2] + 1) if pivoting else list(range(1, m + 1)))


@pytest.mark.parametrize("upper", [True, False])
def test_cholesky(called: Called, upper: bool) -> None:
    same(called("Matrices.cholesky", [(3, 3)], SPD, upper)[0], linalg.cholesky(SPD, lower=not upper))


@pytest.mark.parametrize("a", [A, PAIR, RANDOM], ids=["real", "pair", "5"])
def test_hessenberg_and_schur_forms(called: Called, a: Array) -> None:
    n = len(a)
    h, u = called("Matrices.hessenberg", [(n, n), (n, n)], a)
    same(u @ h @ u.T, a)
    assert not np.tril(h, -2).any()
    t, z, re, im = called("Matrices.realSchur", [(n, n), (n, n), (n,), (n,)], a)
    same(z @ t @ z.T, a)
    for orthogonal in (u, z):
        same(orthogonal.T @ orthogonal, np.eye(n))
    below = np.diag(t, -1)
    assert not np.tril(t, -2).any() and not np.any((below[:-1] != 0) & (below[1:] != 0))
    blocks = np.flatnonzero(below)
    same(np.diag(t)[blocks], np.diag(t)[blocks + 1])  # standard form
    expected = np.linalg.eigvals(a)
    same(in_order(np.stack([re, im], axis=1)), in_order(np.stack([expected.real, expected.imag], axis=1)))


@pytest.mark.parametrize("length", [0.3, 4.0])
def test_exponential_and_its_integrals(called: Called, length: float) -> None:
    same(called("Matrices.exp", [(3, 3)], PAIR, length)[0], linalg.expm(PAIR * length))
    phi, g, g1 = called("Matrices.integralExpT", [(3, 3), (3, 1), (3, 1)], PAIR, B, length)
    moved = linalg.expm(PAIR * length)
    inverse = np.linalg.inv(PAIR)
    same(phi, moved)
    same(g, inverse @ (moved - np.eye(3)) @ B)
    same(g1, inverse @ (inverse @ (moved - np.eye(3)) - length * np.eye(3)) @ B)  # integral of (T - t) exp(A t)


@pytest.mark.parametrize("rows", [True, False])
@pytest.mark.parametrize("ascending", [True, False])
def test_sort(called: Called, rows: bool, ascending: bool) -> None:
    m = np.array([[2.3, 1.0, 5.0], [-1.0, 4.0, 0.0], [-1.0, 0.5, 9.0], [2.0, 8.0, 7.0]])
    moved, order = called("Matrices.sort", [(4, 3), (4 if rows else 3,)], m, rows, ascending)
    lines = m if rows else m.T
    expected = sorted(range(len(lines)), key=lambda i: tuple(lines[i]), reverse=not ascending)
    assert [int(i) - 1 for i in order] == expected
    same(moved if rows else moved.T, lines[expected])


def test_balance(called: Called) -> None:
    a, c = np.array([[1.3, 1e4, 0.5], [1e-3, 4.0, 1e3], [2e-5, 0.1, 3.0]]), np.array([[1.0, 2.0, 3.0]])
    scale, moved, b_moved, c_moved = called("Matrices.balanceABC", [(3,), (3, 3), (3, 1), (1, 3)], a, B, c)
    t = np.diag(scale)
    same(moved, np.linalg.inv(t) @ a @ t)
    same(b_moved, np.linalg.inv(t) @ B)
    same(c_moved, c @ t)
    assert np.all(np.log2(scale) % 1 == 0) and np.linalg.norm(moved) < 0.1 * np.linalg.norm(a)


@pytest.mark.parametrize("sign", [1, -1])
def test_lyapunov_and_sylvester(called: Called, sign: int) -> None:
    a, c = PAIR, SPD
    (x,) = called("Matrices.continuousLyapunov", [(3, 3)], a, c)
    same(x @ a + a.T @ x, c)
    (x,) = called("Matrices.continuousSylvester", [(3, 3)], a, A, c)
    same(a @ x + x @ A, c)
    (x,) = called("Matrices.discreteLyapunov", [(3, 3)], a, c, False, sign)
    same(a.T @ x @ a + sign * x, c)
    (x,) = called("Matrices.discreteSylvester", [(3, 3)], a, A, c, False, False, sign)
    same(a @ x @ A + sign * x, c)


def test_an_equation_without_a_single_solution_has_none(called: Called) -> None:
    a = np.array([[1.3, 0.0], [0.0, -1.3]])  # X is free where two eigenvalues add up to 0
    with pytest.raises(NumericalError, match="no answer"):
        called("Matrices.continuousLyapunov", [(2, 2)], a, np.ones((2, 2)))


def test_a_polynomial_is_fitted(called: Called) -> None:
    u, y = np.array([1.3, 2.0, 3.0, 4.0, 6.0]), np.array([0.3, 4.0, 9.0, 17.0, 30.0])
    same(called("Polynomials.fitting", [(3,)], u, y, 2)[0], np.polyfit(u, y, 2))


def test_spectrum(called: Called) -> None:
    u = np.array([1.3, 2.0, 3.0, 4.0, 3.0, -2.0, 1.0, 0.0])
    name = "FastFourierTransform.Internal.rawRealFFT"
    info, sizes, phases = called(name, [(), (5,), (5,)], u)
    lines = np.fft.rfft(u)
    assert info == 0
    same(sizes, np.abs(lines) / 5)  # over half the samples and one, as ModelicaFFT.c has it
    same(np.exp(1j * phases)[sizes > 1e-9], (lines / np.abs(lines))[sizes > 1e-9])


def test_an_unknown_follows_from_a_factorisation(tmp_path: Path, called: Called) -> None:
    """Newton's method needs slopes: the stiffness at which the lowest frequency of a chain is a given one."""
    place = tmp_path / "B.mo"
    place.write_text(
        "model B\nReal k(start = 20);\nReal w[2, 2];\nequation\n"
        "w = Modelica.Math.Matrices.eigenValues([k + 10, -10; -10, 10]);\nmin(w[:, 1]) = 4 + time;\nend B;\n"
    )
    model = CompiledModel(compile_model(f"{place}:B", libraries=[tmp_path / "lib"]))
    k = model.simulate({}, 0.5, rows=3, outputs=["k"])["k"]
    lowest = [np.linalg.eigvalsh([[s + 10, -10], [-10, 10]])[0] for s in k]
    np.testing.assert_allclose(lowest, [4, 4.5, 5], rtol=1e-8)  # the tolerance of the solver


@pytest.mark.parametrize(
    ("name", "shapes", "args", "rule"),
    [
        ("Matrices.QR", [(2, 4), (4, 4), (4,)], (TALL.T, True), "4 columns needs as many rows"),
        ("FastFourierTransform.Internal.rawRealFFT", [(), (2,), (2,)], (np.array([1.3, 2.0, 3.0]),), "an even number"),
    ],
)
def test_what_has_no_answer_is_one_sentence(called: Called, name: str, shapes: Any, args: Any, rule: str) -> None:
    with pytest.raises(ModelicaError, match=rule) as refused:
        called(name, shapes, *args)
    assert "\n" not in str(refused.value)


def test_a_function_of_another_package_is_another_one(tmp_path: Path) -> None:
    place = tmp_path / "A.mo"
    place.write_text(
        "package Own\nfunction sort\ninput Real M[2];\noutput Real y;\n"
        'external "C" y = my_sort(M);\nend sort;\nend Own;\n'
        "model A\nReal y = Own.sort({time, 1});\nend A;\n"
    )
    with pytest.raises(ModelicaError, match=r"external function 'Own\.sort' is not supported"):
        compile_model(f"{place}:A")
