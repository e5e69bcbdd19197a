"""Printed derivatives against CasADi's automatic differentiation of the same steps, and against differences."""

from __future__ import annotations

import ctypes
from pathlib import Path
from typing import ClassVar

import casadi
import numpy as np
import pytest

from hystid.compiled import SHELL
from hystid.modelica.blocks import Assign, Solve
from hystid.modelica.causalise import causalise
from hystid.modelica.compile import flat_model
from hystid.modelica.describe import model_code
from hystid.modelica.expr import Expr, Num, Op, Ref
from hystid.modelica.hybrid import HybridModel
from hystid.modelica.layout import Layout
from hystid.toolchain import shared_library

MODELS = Path(__file__).parent / "models"
HARNESS = """
#include "hy_model.h"
struct hy_duhem_methods { int none; }; /* no motion is followed here, and no table run */
struct hy_path_methods { int none; };
struct hy_stop_methods { int none; };
struct hy_strip_methods { int none; };
const struct hy_duhem_methods hy_duhem_methods = {0};
const struct hy_path_methods hy_path_methods = {0};
const struct hy_stop_methods hy_stop_methods = {0};
const struct hy_strip_methods hy_strip_methods = {0};
__attribute__((visibility("default"))) int evaluate(hy_data *m)
{ int bad = hy_the_model.parameters(m); return bad ? bad : hy_the_model.evaluate(m); }
__attribute__((visibility("default"))) int forward(hy_data *m, const double *a, double *b)
{ return hy_the_model.forward(m, a, b); }
__attribute__((visibility("default"))) int adjoint(hy_data *m, const double *a, double *b)
{ return hy_the_model.adjoint(m, a, b); }
"""
LOG = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_int, ctypes.c_char_p)


class Data(ctypes.Structure):
    _fields_ = (("v", ctypes.c_void_p), ("log", LOG), ("owner", ctypes.c_void_p))


class Block:
    """The value block of one model and the functions on it."""

    def __init__(self, hybrid: HybridModel) -> None:
        self.layout = Layout(hybrid)
        sources = dict(model_code(hybrid).sources)
        sources |= {"hy_model.h": (SHELL / "hy_model.h").read_text(), "harness.c": HARNESS}
        library = shared_library(sources, main=["model.c", "harness.c"], flags=("-O1", "-Wall", "-Wextra", "-Werror"))
        self.library = ctypes.CDLL(str(library))
        self.v = np.zeros(self.layout.size)
        for name, value in hybrid.start.starts.items():
            self.v[self.layout.slots[name]] = value
        self.log = LOG(lambda *_: None)
        self.data = Data(self.v.ctypes.data, self.log, None)

    def evaluate(self) -> None:
        assert self.library.evaluate(ctypes.byref(self.data)) == 0

    def derivative(self, kind: str, seed: np.ndarray) -> np.ndarray:
        result = np.zeros_like(seed)
        call = getattr(self.library, kind)
        pointer = ctypes.c_void_p
        assert call(ctypes.byref(self.data), pointer(seed.ctypes.data), pointer(result.ctypes.data)) == 0
        return result


def block(name: str) -> tuple[Block, HybridModel]:
    where = name if name.startswith("HystId") else f"{MODELS / name.partition('.')[0]}.mo:{name}"
    hybrid = causalise(flat_model(where), {})
    return Block(hybrid), hybrid


def at_random_point(made: Block, hybrid: HybridModel) -> None:
    rng = np.random.default_rng(7)
    for name in (*hybrid.inputs, *hybrid.states):
        made.v[made.layout.slots[name]] = rng.uniform(0.2, 1.0) * rng.choice([-1e-3, 1e-3])
    made.v[0] = 0.37
    made.evaluate()


def jacobian(made: Block, hybrid: HybridModel) -> tuple[np.ndarray, list[int], list[int]]:
    """d(dx, y)/d(p, u, x) by forward seeds, with the slots of rows and columns."""
    layout = made.layout
    columns = [layout.slots[n] for n in (*hybrid.settable, *hybrid.inputs, *hybrid.states)]
    rows = [*layout.span("dx"), *layout.span("y")]
    found = np.empty((len(rows), len(columns)))
    for k, slot in enumerate(columns):
        seed = np.zeros(layout.size)
        seed[slot] = 1
        found[:, k] = made.derivative("forward", seed)[rows]
    return found, rows, columns


class CasadiMirror:
    """The same steps as CasADi expressions."""

    FUNCTIONS: ClassVar = {
        "abs": casadi.fabs, "sign": casadi.sign, "exp": casadi.exp, "sqrt": casadi.sqrt, "sin": casadi.sin,
        "cos": casadi.cos, "tanh": casadi.tanh, "min": casadi.fmin, "max": casadi.fmax,
    }  # fmt: skip

    def __init__(self, made: Block, hybrid: HybridModel) -> None:
        self.symbols = {slot: casadi.SX.sym(f"v{slot}") for slot in range(made.layout.size)}
        self.slots = made.layout.slots
        self.values = dict(self.symbols)
        for step in (*hybrid.start.dependent, *hybrid.derivatives):
            self.run(step)

    def run(self, step: Assign | Solve) -> None:
        if isinstance(step, Assign):
            self.values[self.slots[step.variable]] = self.of(step.value)
            return
        assert step.linear
        unknown = [self.slots[n] for n in step.variables]
        for slot in unknown:
            self.values[slot] = casadi.SX(0)
        A = casadi.vertcat(*(casadi.horzcat(*(self.of(e) for e in row)) for row in step.jacobian))
        b = casadi.vertcat(*(self.of(r) for r in step.residuals))
        x = casadi.solve(A, -b)
        for k, slot in enumerate(unknown):
            self.values[slot] = x[k]

    def of(self, e: Expr) -> casadi.SX:
        if isinstance(e, Num):
            return casadi.SX(e.value)
        if isinstance(e, Ref):
            return self.values[self.slots[e.name]]
        assert isinstance(e, Op)
        a = [self.of(x) for x in e.args]
        table = {
            "+": lambda: a[0] + a[1], "-": lambda: a[0] - a[1], "*": lambda: a[0] * a[1], "/": lambda: a[0] / a[1],
            "^": lambda: a[0] ** a[1], "neg": lambda: -a[0], "if": lambda: casadi.if_else(a[0], a[1], a[2]),
            "<": lambda: a[0] < a[1], "<=": lambda: a[0] <= a[1], ">": lambda: a[0] > a[1], ">=": lambda: a[0] >= a[1],
            "and": lambda: casadi.logic_and(a[0], a[1]), "or": lambda: casadi.logic_or(a[0], a[1]),
            "not": lambda: casadi.logic_not(a[0]),
        }  # fmt: skip
        return table[e.name]() if e.name in table else self.FUNCTIONS[e.name](*a)

    def jacobian(self, made: Block, rows: list[int], columns: list[int]) -> np.ndarray:
        outputs = casadi.vertcat(*(self.values[r] for r in rows))
        inputs = casadi.vertcat(*(self.symbols[c] for c in columns))
        everything = casadi.vertcat(*self.symbols.values())
        return np.array(casadi.Function("J", [everything], [casadi.jacobian(outputs, inputs)])(made.v))


SMOOTH = ["Jenkins", "BoucWen", "Iwan", "Dahl", "LuGre", "MicroSlip", "PecorariSolodov", "BilinearStiffness", "Linear"]


@pytest.mark.parametrize(
    "name", [*(f"HystId.Oscillators.{n}" for n in SMOOTH), "Circuit.Bridge", "Circuit.RLC", "Pendulum"]
)
def test_forward_agrees_with_casadi_and_adjoint_with_forward(name):
    made, hybrid = block(name)
    at_random_point(made, hybrid)
    J, rows, columns = jacobian(made, hybrid)
    exact = CasadiMirror(made, hybrid).jacobian(made, rows, columns)
    np.testing.assert_allclose(J, exact, rtol=1e-11, atol=1e-13 * np.abs(exact).max())
    seeds = np.random.default_rng(3).normal(size=len(rows))
    seed = np.zeros(made.layout.size)
    seed[rows] = seeds
    back = made.derivative("adjoint", seed)
    np.testing.assert_allclose(back[columns], seeds @ J, rtol=1e-10, atol=1e-12 * np.abs(J).max())


def test_nonlinear_block_by_differences():
    made, hybrid = block("Nonlinear")
    made.v[made.layout.slots["F"]] = 120.0
    made.v[0] = 0.4
    made.evaluate()
    J, rows, columns = jacobian(made, hybrid)
    slot, step = made.layout.slots["F"], 1e-4
    sides = []
    for sign in (1, -1):
        made.v[slot] = 120.0 + sign * step
        made.evaluate()
        sides.append(made.v[rows].copy())
    made.v[slot] = 120.0
    made.evaluate()
    numeric = (sides[0] - sides[1]) / (2 * step)
    np.testing.assert_allclose(J[:, columns.index(slot)], numeric, rtol=1e-7)  # step^2 and 1e-12/step of rounding
    seed = np.zeros(made.layout.size)
    seed[rows] = 1.0
    np.testing.assert_allclose(made.derivative("adjoint", seed)[slot], J[:, columns.index(slot)].sum(), rtol=1e-10)


@pytest.mark.parametrize("nu", [1.0, 1.3, 2.0, 3.0])
def test_bouc_wen_is_finite_at_the_origin(nu):
    hybrid = causalise(flat_model("HystId.Forces.BoucWen"), {"nu": nu})
    made = Block(hybrid)
    made.v[made.layout.slots["v"]] = 0.1
    made.evaluate()
    J, rows, columns = jacobian(made, hybrid)
    assert np.all(np.isfinite(made.v)) and np.all(np.isfinite(J))
    rate = rows.index(made.layout.slots["der(z)"])
    assert J[rate, columns.index(made.layout.slots["v"])] == made.v[made.layout.slots["alpha"]]


def test_dependent_parameters_carry_seeds():
    made, hybrid = block("MassSpringDamper")
    made.v[made.layout.slots["x"]], made.v[made.layout.slots["v"]] = 0.01, 0.2
    made.evaluate()
    J, rows, columns = jacobian(made, hybrid)
    row, column = rows.index(made.layout.slots["der(v)"]), columns.index(made.layout.slots["f0"])
    w = 2 * np.pi * 3
    exact = (-2 * 0.1 * 0.2 - 2 * w * 0.01) * 2 * np.pi  # der(v) = -2 zeta w v - w^2 x without force
    np.testing.assert_allclose(J[row, column], exact, rtol=1e-12)
