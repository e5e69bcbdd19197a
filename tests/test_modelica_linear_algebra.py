"""Linear equations solved by the functions of LAPACK that the Modelica Standard Library calls, written in Modelica."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from hystid.compiled import CompiledModel
from hystid.errors import ModelicaError
from hystid.modelica import compile_model

FUNCTIONS = """
function factors "PLU, as dgetrf gives it"
  input Real A[:, :];
  output Real LU[size(A, 1), size(A, 2)] = A;
  output Integer pivots[min(size(A, 1), size(A, 2))];
  output Integer info;
protected
  Integer m = size(A, 1), n = size(A, 2), lda = max(1, size(A, 1));
external "FORTRAN 77" dgetrf(m, n, LU, lda, pivots, info) annotation(Library = "lapack");
end factors;

function solved "Matrix of right hand sides"
  input Real LU[:, size(LU, 1)];
  input Integer pivots[size(LU, 1)];
  input Real B[size(LU, 1), :];
  output Real X[size(B, 1), size(B, 2)] = B;
  output Integer info;
protected
  Integer n = size(LU, 1), nrhs = size(B, 2);
  Real work[size(LU, 1), size(LU, 1)] = LU;
external "FORTRAN 77" dgetrs("N", n, nrhs, work, n, pivots, X, n, info);
end solved;

function inverse
  input Real LU[:, size(LU, 1)];
  input Integer pivots[size(LU, 1)];
  output Real inv[size(LU, 1), size(LU, 2)] = LU;
  output Integer info;
protected
  Integer n = size(LU, 1), lwork = n;
  Real work[size(LU, 1)];
external "FORTRAN 77" dgetri(n, inv, n, pivots, work, lwork, info);
end inverse;

function singular "Not written in Modelica"
  input Real A[:, :];
  output Real s[size(A, 1)];
protected
  Integer n = size(A, 1);
external "FORTRAN 77" dgesvd(n, A, s);
end singular;
"""
TURNING = """
model A "A matrix whose largest entries move, so that other pivots are the right ones"
  Real t = time, M[4, 4], B[4, 2] = {{1, t}, {2, 1}, {-1, 3}, {t, 0}};
  Real LU[4, 4], X[4, 2], inv[4, 4], wide[2, 3], back[4, 2];
  Integer p[4], q[2];
equation
  M = {{sin(5*t), 2*cos(3*t), 1, 0.3}, {cos(7*t), sin(2*t), t, -2}, {3*sin(t), 1, cos(t), 0.5}, {1, 0, 4*sin(9*t), 1}};
algorithm
  (LU, p) := factors(M);
  X := solved(LU, p, B);
  inv := inverse(LU, p);
  (wide, q) := factors({{0, t, 1}, {2, 1, 0}});
  back := M*X;
end A;
"""


def _run(tmp_path: Path, text: str, names: list[str]) -> dict[str, np.ndarray]:
    path = tmp_path / "A.mo"
    path.write_text(FUNCTIONS + text)
    return dict(CompiledModel(compile_model(f"{path}:A")).simulate({}, 0.05, rows=41, outputs=names))


def test_equations_are_solved_whichever_pivot_is_the_largest(tmp_path: Path) -> None:
    at = [(i, j) for i in range(1, 5) for j in range(1, 5)]
    names = [f"{n}[{i},{j}]" for n in ("M", "inv") for i, j in at]
    names += [f"{n}[{i},{j}]" for n in ("X", "B", "back") for i in range(1, 5) for j in (1, 2)]
    got = _run(tmp_path, TURNING, [*names, *(f"p[{k}]" for k in range(1, 5))])

    def matrix(name: str, columns: int) -> np.ndarray:
        return np.array([[got[f"{name}[{i},{j}]"] for j in range(1, columns + 1)] for i in range(1, 5)]).T.swapaxes(
            1, 2
        )

    m, b = matrix("M", 4), matrix("B", 2)
    assert np.linalg.cond(m).max() < 1e4
    np.testing.assert_allclose(matrix("X", 2), np.linalg.solve(m, b), rtol=1e-9, atol=1e-11)
    np.testing.assert_allclose(matrix("inv", 4), np.linalg.inv(m), rtol=1e-9, atol=1e-11)
    np.testing.assert_allclose(matrix("back", 2), b, atol=1e-12)
    assert len({tuple(got[f"p[{k}]"][row] for k in range(1, 5)) for row in range(41)}) > 4  # it did pivot


def test_factors_of_a_wide_matrix(tmp_path: Path) -> None:
    got = _run(tmp_path, TURNING, [f"wide[{i},{j}]" for i in (1, 2) for j in (1, 2, 3)] + ["q[1]", "q[2]"])
    np.testing.assert_array_equal(got["q[1]"], 2)
    np.testing.assert_allclose([got[f"wide[2,{j}]"][-1] for j in (1, 2, 3)], [0, 2, 1], atol=1e-15)


def test_what_is_not_written_in_modelica_is_refused_where_it_is_called(tmp_path: Path) -> None:
    model = "model A Real s[2] = singular({{1, 2}, {3, time}}); end A;"
    with pytest.raises(ModelicaError, match=r"A\.mo:\d+: external function 'singular' is not supported"):
        _run(tmp_path, model, ["s[1]"])
