"""Derivatives in Initialization Mode: unknowns are what the initial equations give, knowns what has a start value."""

from __future__ import annotations

from ctypes import c_bool, c_double, c_size_t, c_uint

import numpy as np
import pytest
from surrogate_harness import smooth_slider

from hystid.errors import FmuError
from hystid.fmu import build, build_model
from hystid.fmu.door import open_fmu
from hystid.fmu.native import Access, Instance
from hystid.networks import onnx as exchange
from hystid.surrogate import oscillator_code

BOTH = pytest.mark.parametrize("version", [2, 3])
START = """model Start
  parameter Real x_start(unit="m") = 0.01;
  parameter Real K = 100;
  parameter Real K3 = 1e6;
  parameter Real F0 = 3;
  parameter Real Kd = 2*K;
  parameter Real q(fixed = false, start = 1);
  input Real u(start = 0);
  Real x(start = 0), v(start = 0);
  output Real y, w;
initial equation
  K*x + K3*x^3 = F0 + u;
  v = x_start*Kd;
  q^2 = K + 1;
equation
  der(x) = v;
  der(v) = u - Kd*x - q*v;
  y = Kd*x*x + q;
  w = x_start;
end Start;
"""


def in_initialization(fmu, values=()):
    """An instance in Initialization Mode."""
    instance = Instance(fmu, "CoSimulation")
    instance.set([(fmu.model.variable(name), value) for name, value in values])
    nothing = (c_bool(False), c_double(0))
    if instance.version == 2:
        instance.call("SetupExperiment", 0, c_double(0), c_double(0), 0, c_double(0))
        instance.call("EnterInitializationMode")
    else:
        instance.call("EnterInitializationMode", *nothing, c_double(0), *nothing)
    return instance


def jacobian(instance, fmu, unknowns, knowns, name="GetDirectionalDerivative"):
    """d unknown/d known (n_unknown, n_known), one call per row or column."""
    slots = [[fmu.model.variable(n).slot if n != "time" else 0 for n in group] for group in (unknowns, knowns)]
    u, k = ((c_uint * len(group))(*group) for group in slots)
    found = np.zeros((len(unknowns), len(knowns)))
    forward = name == "GetDirectionalDerivative"
    n_seed, n_answer = (len(k), len(u)) if forward else (len(u), len(k))
    for i in range(n_seed):
        seed, answer = (c_double * n_seed)(*np.eye(n_seed)[i]), (c_double * n_answer)(*[9.0] * n_answer)
        sizes = ((c_size_t(n_seed),), (c_size_t(n_answer),)) if instance.version == 3 else ((), ())
        instance.call(name, u, c_size_t(len(u)), k, c_size_t(len(k)), seed, *sizes[0], answer, *sizes[1])
        if forward:
            found[:, i] = answer
        else:
            found[i] = answer
    return found


@BOTH
def test_initial_equations_are_differentiated(tmp_path, version):
    (tmp_path / "Start.mo").write_text(START)
    path = build_model(f"{tmp_path / 'Start.mo'}:Start", tmp_path / "s.fmu", fmi=version).path
    fmu = open_fmu(path)
    unknowns = ["Kd", "q", "x", "v", "der(x)", "der(v)", "y", "w"]
    knowns = ["x_start", "K", "K3", "F0", "u", "time"]
    x = np.real(next(r for r in np.roots([1e6, 0, 100, -3]) if abs(r.imag) < 1e-12))
    slope, v, q = 100 + 3e6 * x**2, 2.0, np.sqrt(101)
    dx = np.array([0, -x / slope, -(x**3) / slope, 1 / slope, 1 / slope, 0])
    dv, dk = np.array([200, 0.02, 0, 0, 0, 0]), np.array([0, 2, 0, 0, 0, 0])
    dq = np.array([0, 0.5 / q, 0, 0, 0, 0])
    du = np.array([0, 0, 0, 0, 1, 0])
    expected = [dk, dq, dx, dv, dv, du - dk * x - 200 * dx - dq * v - q * dv, dk * x**2 + 400 * x * dx + dq,
                np.eye(6)[0]]  # fmt: skip
    with in_initialization(fmu) as instance:
        # central differences at the cube root of the rounding error: 1e-9 of the size
        found = jacobian(instance, fmu, unknowns, knowns)
        np.testing.assert_allclose(found, expected, rtol=2e-7, atol=2e-7)
        assert found[7, 0] == 1.0 and found[0, 1] == 2.0  # what is given itself, and what is linear, to the last bit
        if version == 3:
            back = jacobian(instance, fmu, unknowns, knowns, "GetAdjointDerivative")
            np.testing.assert_allclose(back, found, rtol=1e-12, atol=1e-12)
        with pytest.raises(FmuError, match="x is not known in initialization mode"):
            jacobian(instance, fmu, ["y"], ["x"])
        value = np.zeros(1)  # the solution itself is left as it was
        Access(instance, [fmu.model.variable("x")]).get(value.ctypes.data)
        assert value[0] == pytest.approx(x, rel=1e-13)
        instance.call("ExitInitializationMode")
        if version == 2:  # co-simulation is in Step Mode now: running equations
            assert jacobian(instance, fmu, ["y"], ["x"])[0, 0] == pytest.approx(400 * x)
            with pytest.raises(FmuError, match="Kd stands after initialization mode"):
                jacobian(instance, fmu, ["Kd"], ["K"])


def solution(fmu, names, values):
    with in_initialization(fmu, values.items()) as instance:
        found = np.zeros(len(names))
        Access(instance, [fmu.model.variable(n) for n in names]).get(found.ctypes.data)
        return found


def by_differences(fmu, unknowns, knowns, start):
    """The same from outside: new instances with other start values, step of the cube root of the rounding error; from a
    minimum on, which no value may pass, differences of second order to one side."""
    columns = []
    for name in knowns:
        value = start.get(name, fmu.model.variable(name).start)
        step = 6e-6 * max(abs(value), 1e-3)
        low = fmu.model.variable(name).min
        sides = (0, 1, 2) if low is not None and value - step < low else (-1, 0, 1)
        weights = (-3, 4, -1) if sides[0] == 0 else (-1, 0, 1)
        there = [solution(fmu, unknowns, {**start, name: value + side * step}) for side in sides]
        columns.append(sum(w * y for w, y in zip(weights, there, strict=True)) / (2 * step))
    return np.column_stack(columns)


def initial_unknowns(fmu):
    """Real unknowns of initialization by the description."""
    listed = [unknown.variable for unknown in fmu.raw.initialUnknowns]
    return [v.name for v in listed if v.type in ("Real", "Float64")]


@BOTH
@pytest.mark.parametrize("law", ["Jenkins", "Iwan", "BoucWen", "LuGre", "BilinearStiffness"])
def test_every_listed_unknown_has_its_derivatives(tmp_path, law, version):
    fmu = open_fmu(build_model(f"HystId.Oscillators.{law}", tmp_path / "law.fmu", fmi=version).path)
    unknowns = initial_unknowns(fmu)
    knowns = [v.name for v in fmu.model.variables if v.causality == "parameter" and v.type == "Real"] + ["F"]
    start = {"x_start": 1e-4, "v_start": 0.02, "F": 3.0}
    with in_initialization(fmu, start.items()) as instance:
        found = jacobian(instance, fmu, unknowns, knowns)
    expected = by_differences(fmu, unknowns, knowns, start)
    scale = np.maximum(np.max(np.abs(expected), axis=1, keepdims=True), 1e-9)
    # differences of values of size s carry rounding of s 2e-16/6e-6, and a value that a known does not move none
    np.testing.assert_allclose(found / scale, expected / scale, atol=2e-6)
    row = unknowns.index("x")
    assert found[row, knowns.index("x_start")] == 1.0 and found[row, knowns.index("m")] == 0.0


@BOTH
def test_a_network_with_memory_starts_with_the_rule_of_turning_points(tmp_path, version):
    """At the start the turning point moves with x_start: the slope is not that of the running equations."""
    exchange.write(smooth_slider(), tmp_path / "s.onnx")
    fmu = open_fmu(build(oscillator_code(tmp_path / "s.onnx"), tmp_path / "o.fmu", fmi=version).path)
    start, knowns = {"x_start": 1e-3, "v_start": 0.1, "F": 2.0}, ["x_start", "v_start", "m", "R_start", "F"]
    unknowns = ["x", "v", "a", "R"]
    with in_initialization(fmu, start.items()) as instance:
        found = jacobian(instance, fmu, unknowns, knowns)
    np.testing.assert_allclose(found, by_differences(fmu, unknowns, knowns, start), rtol=1e-6, atol=1e-6)
    assert found[unknowns.index("R"), 0] == pytest.approx(1e4, rel=0.05)  # the spring alone, without the slider
