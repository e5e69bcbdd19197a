"""Every construct of the language subset, one small model each, against an answer found without the compiler."""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from hystid.compiled import CompiledModel
from hystid.errors import ModelicaError
from hystid.modelcode import ModelCode
from hystid.modelica import compile_model

MODELS = Path(__file__).parent / "models"


@cache
def code(name: str, **parameters: float) -> ModelCode:
    file = name.partition(".")[0]
    return compile_model(f"{MODELS / file}.mo:{name}", parameters=parameters)


def run(name: str, outputs: str, stop: float = 1.0, dt: float = 1e-3, **inputs: np.ndarray) -> Mapping[str, np.ndarray]:
    model = CompiledModel(code(name))
    rows = None if inputs else round(stop / dt) + 1
    return model.simulate(inputs, dt, outputs=outputs.split(), rows=rows)


def grid(stop: float = 1.0, dt: float = 1e-3) -> np.ndarray:
    return np.arange(round(stop / dt) + 1) * dt


def close(a: np.ndarray | float, b: np.ndarray | float, tolerance: float) -> None:
    np.testing.assert_allclose(a, b, rtol=tolerance, atol=tolerance)


# Runge-Kutta of order four at 1 ms on signals of a few rad/s leaves errors below (3e-3)^4.
SMOOTH = 1e-9


def test_dependent_parameters_and_der_on_either_side():
    got = run("MassSpringDamper", "x", stop=2.0)
    w, zeta = 2 * math.pi * 3, 0.1
    wd, t = w * math.sqrt(1 - zeta**2), grid(2.0)
    exact = 0.01 * np.exp(-zeta * w * t) * (np.cos(wd * t) + zeta * w / wd * np.sin(wd * t))
    close(got["x"], exact, 1e-8)  # (w dt)^4 = 1.3e-7 of the amplitude 0.01


def test_dependent_parameters_are_calculated_and_independent_ones_can_be_set():
    made = code("MassSpringDamper")
    assert made.variable("k").causality == "calculatedParameter"
    assert made.variable("m").causality == "parameter" and made.variable("m").min == 0.0
    quick = CompiledModel(made).simulate({"F": np.zeros(11)}, 1e-3, outputs=["k"], parameters={"m": 3.0})
    close(quick["k"], 3 * (2 * math.pi * 3) ** 2, 1e-12)


def test_pendulum_keeps_its_energy():
    got = run("Pendulum", "phi energy", stop=5.0)
    close(got["energy"], got["energy"][0], 1e-8)
    assert got["phi"].min() < -2.4


def test_van_der_pol_and_lorenz_against_scipy():
    def van_der_pol(t, x):
        return [x[1], 1.5 * (1 - x[0] ** 2) * x[1] - x[0]]

    def lorenz(t, s):
        return [10 * (s[1] - s[0]), s[0] * (28 - s[2]) - s[1], s[0] * s[1] - 8 / 3 * s[2]]

    for name, f, start, outputs, stop in (
        ("VanDerPol", van_der_pol, [2, 0], "x1 x2", 10.0),
        ("Lorenz", lorenz, [1, 1, 1], "x y z", 2.0),
    ):
        got = run(name, outputs, stop=stop)
        exact = solve_ivp(f, (0, stop), start, method="DOP853", rtol=1e-12, atol=1e-12, t_eval=[stop]).y[:, 0]
        close(np.array([got[n][-1] for n in outputs.split()]), exact, 1e-6)  # chaos multiplies (L dt)^4 by e^(0.9 stop)


def test_bouncing_ball():
    got = run("BouncingBall", "h v bounces", stop=1.2)
    first = math.sqrt(2 / 9.81)
    second = first + 2 * 0.8 * first
    t = grid(1.2)
    flight = (t > first) & (t < second)
    v0 = 0.8 * 9.81 * first
    exact = v0 * (t - first) - 4.905 * (t - first) ** 2
    close(got["h"][flight], exact[flight], 1e-9)  # parabolas are exact for Runge-Kutta, impacts located to 1e-16 s
    assert got["bounces"][-1] == 2 and got["bounces"][t < first].max() == 0
    experiment = code("BouncingBall").experiment
    assert (experiment.stop, experiment.step, experiment.tolerance) == (1.2, 1e-3, 1e-6)


def test_series_circuit_with_connectors():
    got = run("Circuit.RLC", "u c.i", stop=0.5)
    R, L, C, V = 2.0, 0.1, 1e-2, 5.0
    exact = solve_ivp(
        lambda t, s: [s[1] / C, (V - s[0] - R * s[1]) / L], (0, 0.5), [1, 0], rtol=1e-11, atol=1e-12, t_eval=grid(0.5)
    )
    close(got["u"], exact.y[0], 1e-7)


def test_resistor_bridge_is_a_linear_block():
    got = run("Circuit.Bridge", "i source.i", stop=0.01)
    conductance = np.array([[1 + 1 / 2 + 1 / 7, -1 / 7], [-1 / 7, 1 / 3 + 1 / 5 + 1 / 7]])
    left, right = np.linalg.solve(conductance, [10.0, 10 / 3])
    close(got["i"], (left - right) / 7, 1e-13)
    close(got["source.i"], -(10 - left) - (10 - right) / 3, 1e-13)


@pytest.mark.parametrize("name", ["Thermostat", "ThermostatPre"])
def test_thermostat_switches_at_its_limits(name):
    got = run(name, "T on", stop=20.0, dt=1e-2)
    heat = math.log((55 - 15) / (55 - 22)) / 0.2
    cool = math.log((22 - 5) / (18 - 5)) / 0.2
    again = math.log((55 - 18) / (55 - 22)) / 0.2
    t = grid(20.0, 1e-2)
    phase = np.where(t < heat, -1.0, np.mod(t - heat, cool + again))
    expected = np.where(t < heat, 55 - 40 * np.exp(-0.2 * t), 0.0)
    falling = (phase >= 0) & (phase < cool)
    rising = phase >= cool
    expected[falling] = 5 + 17 * np.exp(-0.2 * phase[falling])
    expected[rising] = 55 - 37 * np.exp(-0.2 * (phase[rising] - cool))
    close(got["T"], expected, 1e-8)  # (0.2 dt)^4 = 1.6e-11 and located switches
    edges = np.min(
        np.abs(np.subtract.outer(t, heat + np.arange(40) // 2 * (cool + again) + np.arange(40) % 2 * cool)), 1
    )
    clear = edges > 1e-6
    np.testing.assert_array_equal(got["on"][clear], (rising | (t < heat))[clear])


def test_thermostat_counts():
    assert run("Thermostat", "switches", stop=20.0, dt=1e-2)["switches"][-1] > 5


def test_sampled_controller():
    got = run("SampledPI", "y u integral", r=np.ones(2001))
    y = integral = 0.0
    for k in range(40):
        error = 1 - y
        integral += 0.05 * error
        u = 2 * error + 4 * integral
        close(got["u"][50 * k], u, 1e-12)
        close(got["integral"][50 * k], integral, 1e-12)
        y = u + (y - u) * math.exp(-0.05)
        close(got["y"][50 * k + 50], y, 1e-9)
    assert code("SampledPI").variable("u").variability == "discrete"


def test_coulomb_friction_with_modes():
    t = grid(2.0)
    got = run("CoulombModes", "v f a stuck", F=4 * np.sin(2 * np.pi * 0.5 * t))
    start = np.arcsin(2.5 / 4) / np.pi
    slides = (t > start + 2e-3) & (t < 0.9)
    exact = 4 / np.pi * (np.cos(np.pi * start) - np.cos(np.pi * t)) - 2 * (t - start)
    close(got["v"][slides], exact[slides], 2e-6)  # the input runs linearly between samples: (pi dt)^2/12 of 4 m/s2
    close(got["f"][t < start - 2e-3], 4 * np.sin(np.pi * t[t < start - 2e-3]), 1e-12)
    assert np.all(got["v"][t < start - 2e-3] == 0)


def test_functions():
    got = run("Functions.Use", "p q r phi mean s[1] s[2] s[3] n", stop=1.0)
    t = grid()
    close(got["p"], 1 - 2 * t + 0.5 * t**2 + 0.25 * t**3, 1e-14)
    close(got["q"], np.clip(3 * t - 1, -1, 0.5), 1e-14)
    close(got["r"], np.hypot(1 + t, 2 * t), 1e-14)
    close(got["phi"], np.arctan2(2 * t, 1 + t), 1e-14)
    close(got["mean"], (3 * t + 3) / 3, 1e-14)
    close(got["s[2]"], 4 * t**2, 1e-14)
    close(got["n"], 120, 0)


def test_builtin_functions():
    names = [v.name for v in code("Builtins").variables if v.name not in ("t", "k")]
    got = run("Builtins", " ".join(["k", *names]), stop=2.0)
    t = grid(2.0) - 1.3
    exact = {
        "a1": np.abs(t), "a2": np.sign(t), "a3": np.sqrt(t**2 + 1), "a4": np.exp(-t), "a5": np.log(2 + t),
        "a6": np.log10(2 + t), "b1": np.sin(t), "b2": np.cos(t), "b3": np.tan(0.3 * t), "b4": np.arcsin(0.3 * t),
        "b5": np.arccos(0.3 * t), "b6": np.arctan(t), "b7": np.arctan2(t, 2), "c1": np.sinh(t), "c2": np.cosh(t),
        "c3": np.tanh(t), "c4": np.maximum(t, 0.5), "c5": np.minimum(t, -0.2), "d1": np.mod(t, 0.7),
        "d2": np.fmod(t, 0.7), "d3": np.floor(t / 0.3), "d4": np.ceil(t / 0.3), "d5": np.trunc(t / 0.4),
        "k": np.floor(3 * t), "e1": np.where(t >= 0, 2 * t, 3 * t), "e2": t * np.abs(t), "e3": np.where(t > 0, 1, -1),
        "e4": 31.0 + 0 * t, "e5": -(t**2), "e6": -(t**3),
    }  # fmt: skip
    jumps = np.concatenate([np.arange(-20, 20) * step for step in (0.7, 0.3, 0.4, 1 / 3)])
    clear = np.min(np.abs(np.subtract.outer(t, jumps)), axis=1) > 1e-9  # at a jump itself both sides are right
    assert set(exact) == {"k", *names}
    for name, values in exact.items():
        np.testing.assert_allclose(got[name][clear], values[clear], rtol=1e-12, atol=1e-12, err_msg=name)


def test_arrays():
    names = "x[1] x[2] total dot row last matrix[1,3] matrix[2,3] cross3[1] cross3[2] cross3[3] quad y[2]"
    got = run("Arrays", names)
    A, b, w = np.array([[-1, 2], [-3, -0.5]]), np.array([1, 0.5]), 1 / np.arange(1, 5)
    x = solve_ivp(lambda t, x: A @ x + b * np.sin(t), (0, 1), [1, 2], rtol=1e-11, atol=1e-12, t_eval=grid()).y
    close(np.array([got["x[1]"], got["x[2]"]]), x, SMOOTH)
    x = np.array([got["x[1]"], got["x[2]"]])
    y = w[:, None] * x[0] + np.arange(1, 5)[:, None]
    close(got["total"], y.sum(0) + w.prod(), 1e-13)
    close(got["dot"], b @ x, 1e-13)
    close(got["row"], A[0] @ x, 1e-13)
    close(got["last"], y[3], 1e-13)
    close(got["matrix[1,3]"], y[2], 1e-13)
    close(got["matrix[2,3]"], 2 * y[2], 1e-13)
    one = np.ones_like(x[0])
    cross = np.cross(np.array([x[0], x[1], one]).T, [1, 2, 3]).T
    close(np.array([got[f"cross3[{k}]"] for k in (1, 2, 3)]), cross, 1e-13)
    close(got["quad"], np.einsum("it,ij,jt->t", x, A, x) + x[0] + 2 * x[1] + 1 + 2, 1e-13)


def test_array_sizes_can_be_set_and_are_built_in():
    assert code("Arrays", n=6.0).variable("y[6]").causality == "local"
    assert code("Arrays").variable("n").variability == "constant"


def test_initial_equations_and_free_parameters():
    got = run("Initial", "x y z k half", stop=0.5)
    x = (-4 + math.sqrt(16 + 40)) / 2  # k = 2 x at rest and x^2 + 2 k - 7 = 3
    close(got["x"], x, 1e-12)
    close(got["k"], 2 * x, 1e-12)
    close(got["z"], x * grid(0.5) + x, 1e-12)
    assert code("Initial").variable("k").causality == "calculatedParameter"


def test_nonlinear_blocks_converge_and_follow():
    t = grid()
    force = 300 * np.sin(2 * np.pi * t)
    got = run("Nonlinear", "d p q", F=force)
    d = got["d"]
    close(100 * d + 2e4 * d**3 + 5 * np.tanh(10 * d), force, 1e-10)
    close(got["p"] ** 2 + got["q"] ** 2, 4 + force**2 / 100, 1e-10)
    close(got["p"] - got["q"], 0.5 * np.sin(t), 1e-12)
    assert got["p"].min() > 0  # the branch that the start value chose


def test_replaceable_components_and_models():
    got = run("Replaceable.Two", "a.x b.x s")
    exact = solve_ivp(
        lambda t, s: [s[1], -2 * s[0] - 3 * s[0] ** 3], (0, 1), [1, 0], rtol=1e-11, atol=1e-12, t_eval=grid()
    )
    close(got["a.x"], np.cos(grid()), SMOOTH)
    close(got["b.x"], exact.y[0], SMOOTH)
    close(got["s"], 6 * got["a.x"], 1e-14)
    t = grid()
    close(run("Replaceable.ByCubic", "f.f")["f.f"], t + 10 * t**3, 1e-13)


def test_events_of_time_are_exact():
    got = run("TimeEvents", "x y n held", stop=1.0, dt=1e-2)
    t, T = grid(1.0, 1e-2), 0.333
    exact = np.where(t < T, t, np.where(t < 2 * T, T - 2 * (t - T), -T + 0.5 * (t - 2 * T)))
    close(got["x"], exact, 1e-13)  # piecewise linear: exact when the instants are
    assert got["n"][-1] == 4
    close(got["held"][-1], -T + 0.5 * (0.85 - 2 * T), 1e-12)


def test_enumerations():
    got = run("Enumerations.Machine", "x mode", dt=1e-2)
    t = grid(1.0, 1e-2)
    close(got["x"], np.clip(2 * (t - 0.2), 0, 1), 1e-12)
    assert [got["mode"][k] for k in (10, 50, 90)] == [1, 2, 3]


def test_initial_change_and_edge():
    got = run("WhenInitial", "count edges last", dt=1e-2)
    t = grid(1.0, 1e-2)
    changes = sum((t > k * math.pi / 10).astype(int) for k in range(1, 4))
    clear = np.min(np.abs(np.subtract.outer(t, np.arange(0, 4) * math.pi / 10)), axis=1) > 1e-6
    np.testing.assert_array_equal(got["count"][clear], 6 + 1 + changes[clear])  # initial(), then up at t = 0+
    rises = 1 + (t > 2 * math.pi / 10).astype(int) + (t > 0.5)
    np.testing.assert_array_equal(got["edges"][clear & (t != 0.5)], rises[clear & (t != 0.5)])
    assert got["last"][-1] == 2 and got["last"][40] == 1


def names_of(**parameters: float) -> set[str]:
    return {v.name for v in compile_model(f"{MODELS}/Conditions.mo:Conditions.Rig", parameters=parameters).variables}


def test_parameters_that_decide_components_are_built_in():
    made = code("Conditions.Rig")
    kinds = {v.name: v.variability for v in made.variables}
    # what is built in cannot be changed in the FMU, where it would change nothing
    assert [kinds[n] for n in ("wanted", "ratio", "law", "slope")] == ["constant"] * 3 + ["tunable"]
    assert {n for n in names_of(ratio=4.0) if n.startswith("other.")} == {"other.rate", "other.y"}
    there = names_of(wanted=1.0, **{"line.count": 3.0})  # a parameter that only the other value brings in
    assert {n for n in there if n.startswith("line.parts") and n.endswith("y")} == {
        f"line.parts[{k}].y" for k in (1, 2, 3)
    }


def test_a_built_in_enumeration_is_set_by_the_number_of_its_item():
    assert {n for n in names_of(law=2.0) if n.startswith("cubed.")} == {"cubed.rate", "cubed.y"}
    with pytest.raises(ModelicaError, match=r"Conditions\.mo:18: .*'law' cannot be 3: it is one of 1 \(linear\), 2 "):
        code("Conditions.Rig", law=3.0)


def test_if_equations_of_parameters_and_conditional_components():
    got = run("Tables", "u y z offset", stop=2.0)
    u = 3 * np.sin(grid(2.0))
    close(got["z"], u + 10, 1e-13)
    close(got["y"], np.where(u < 1, u, 1), 1e-13)
    close(got["offset"], 1, 0)
    other = CompiledModel(code("Tables", mode=1.0)).simulate({}, 1e-2, outputs=["z", "u"], rows=10)
    close(other["z"], other["u"], 0)
    assert not [v for v in code("Tables", withOffset=0.0).variables if v.name == "offset"]


def test_inner_and_outer():
    close(run("InnerOuter", "body.v")["body.v"], -3 * grid(), 1e-12)


def test_type_aliases_and_constants_of_packages():
    made = code("AliasUnits.M")
    x = made.variable("x")
    assert (x.unit, x.min, x.max, x.nominal) == ("m", -1.0, 1.0, 1e-3)
    got = CompiledModel(made).simulate({"x": np.array([0.5, 1.0])}, 1.0, outputs=["y"])
    close(got["y"], [3.0, 6.0], 1e-15)


def test_parameters_without_a_value_are_told(tmp_path, caplog):
    """They are 0, or their start value, which the run then takes without a word."""
    file = tmp_path / "m.mo"
    file.write_text("model M\n  parameter Real k, q[2], d = 1, p(fixed = false);\n  Real x = k + q[1] + d*p;\n"
                    "initial equation\n  p = 3;\nend M;\n")  # fmt: skip
    compile_model(f"{file}:M")
    assert f"{file}:2: no value is given to k, q[1], q[2]: the start value counts" in caplog.text
    caplog.clear()
    compile_model(f"{file}:M", parameters={"k": 1})
    assert "given to q[1], q[2]: the" in caplog.text


def test_assertions(caplog):
    model = CompiledModel(code("Assertions"))
    model.simulate({"u": np.array([0.1, 0.7, 0.2])}, 1.0, outputs=["y"])
    assert "u = 0.7 is not below its limit" in caplog.text
    with pytest.raises(Exception, match="u is far above its limit"):
        model.simulate({"u": np.array([0.1, 1.7, 0.2])}, 1.0, outputs=["y"])


def test_control_loop_of_causal_blocks():
    got = run("Ctl.Loop", "y limiter.y")
    t = grid()
    ramp = np.minimum(2 * np.maximum(t - 0.1, 0), 1 / 3)
    late = t > 0.1 + 1 / 6
    ramp[late] = 1 - 2 / 3 * np.exp(-3 * (t[late] - 0.1 - 1 / 6))
    close(got["y"], ramp, 1e-9)


def test_slices():
    got = run("Heat", " ".join(f"T[{k}]" for k in range(1, 7)), stop=0.5)
    A = np.diag(np.full(6, -2.0)) + np.diag(np.ones(5), 1) + np.diag(np.ones(5), -1)
    A[5, 5] = -1
    A *= 0.1 * 36
    b = np.zeros(6)
    b[0] = 360.0
    exact = solve_ivp(lambda t, T: A @ T + b, (0, 0.5), np.full(6, 20.0), rtol=1e-11, atol=1e-11, t_eval=[0.5]).y[:, 0]
    close(np.array([got[f"T[{k}]"][-1] for k in range(1, 7)]), exact, 1e-8)


def test_springs_between_flanges():
    got = run("Trans.Two", "m1.s m2.s s2.f", stop=1.0)

    def rhs(t, s):
        x1, v1, x2, v2 = s
        f1, f2 = 100 * x1 + 2 * v1, 150 * (x2 - x1) + (v2 - v1)
        return [v1, f2 - f1, v2, -f2 / 2]

    exact = solve_ivp(rhs, (0, 1), [0.1, 0, 0.2, 0], rtol=1e-11, atol=1e-13, t_eval=grid()).y
    close(got["m1.s"], exact[0], SMOOTH)
    close(got["m2.s"], exact[2], SMOOTH)
    assert len(code("Trans.Two").states) == 4


def test_rigid_coupling():
    got = run("Trans.Rigid", "m1.s m2.s m2.v m2.a.f")
    exact = solve_ivp(
        lambda t, s: [s[1], -(100 * s[0] + 2 * s[1]) / 4], (0, 1), [0.1, 0], rtol=1e-11, atol=1e-13, t_eval=grid()
    ).y
    close(got["m1.s"], exact[0], SMOOTH)
    close(got["m2.s"], got["m1.s"], 0)
    assert len(code("Trans.Rigid").states) == 2


def test_pendulum_in_cartesian_coordinates():
    got = run("Trans.Pendulum", "x y vx vy tension")
    exact = solve_ivp(
        lambda t, s: [s[1], -9.81 * np.sin(s[0])],
        (0, 1),
        [math.atan2(0.6, 0.8), 0],
        rtol=1e-11,
        atol=1e-12,
        t_eval=grid(),
    ).y
    close(got["x"], np.sin(exact[0]), 1e-8)
    close(got["x"] ** 2 + got["y"] ** 2, 1, 1e-12)
    close(got["tension"], exact[1] ** 2 + 9.81 * np.cos(exact[0]), 1e-7)


def test_names_of_the_standard_library():
    got = run("Motor", "w speed i")

    def rhs(t, s):
        return [(10 * np.sin(2 * np.pi * t) - s[0] - 0.1 * s[1]) / 0.01, 0.1 * s[0] / 1e-3]

    exact = solve_ivp(rhs, (0, 1), [0, 0], rtol=1e-10, atol=1e-10, t_eval=grid()).y
    close(got["w"], exact[1], 1e-4)  # the fast mode of 89 1/s: (0.089)^4 per time constant, of 50 rad/s
    assert code("Motor").variable("J").unit == "kg.m2"


def test_parameters_that_decide_what_is_built_are_built_in():
    made = code("Sizes.M")
    built_in = {n: made.variable(n).variability for n in ("components", "chosen", "terms", "factor")}
    assert built_in == {"components": "constant", "chosen": "constant", "terms": "constant", "factor": "fixed"}
    other = code("Sizes.M", components=4.0, chosen=3.0, terms=5.0)
    assert other.variable("element[4].y").causality == "local"
    got = CompiledModel(other).simulate({}, 1.0, outputs=["y", "z"], rows=2)
    assert (got["y"][-1], got["z"][-1]) == (30, 15)


def test_directory_package_of_a_user(tmp_path):
    folder = tmp_path / "Rigs"
    folder.mkdir()
    (folder / "package.mo").write_text('package Rigs "mine"\nend Rigs;\n')
    (folder / "Law.mo").write_text(
        "within Rigs;\nblock Law\n  extends HystId.Interfaces.PartialForce;\nequation\n  f = 3*x;\nend Law;\n"
    )
    (folder / "Rig.mo").write_text(
        "within Rigs;\nmodel Rig\n  extends HystId.Interfaces.PartialOscillator;\n  Law law(x = x, v = v);\n"
        "equation\n  f_h = law.f;\nend Rig;\n"
    )
    made = compile_model(f"{folder / 'package.mo'}:Rigs.Rig")
    assert made.states == ("x", "v")
    alone = tmp_path / "user.mo"
    alone.write_text("model Mine\n  extends Rigs.Rig(m = 2);\nend Mine;\n")
    assert compile_model(f"{alone}:Mine", libraries=[folder]).variable("m").start == 2.0


MODIFIED = {
    "plain.y": 10, "given.y": 6, "base.y": 20, "base2.y": 90, "chain.y": 40, "chain2.y": 80, "chain2.q": 5,
    "short.y": 70, "short2.y": 14, "derived.a.y": 30, "derived.own": 6, "holder.a.y": 400,
    "holder.a.x": 0.25, "each3[2].y": 60, "list3[3].y": 6, "nested[2].a.y": 220, "swap.part.y": 110,
    "swap2.part.y": 120, "swap2.part.c": 1, "swap3.part.y": 143, "started.x": 3, "bound.y": 578,
}  # fmt: skip


@pytest.mark.parametrize(
    ("name", "changes"),
    [("All", {}), ("Extended", {"plain.y": 500, "bound.y": 2, "swap.part.y": 600, "list3[3].y": 18})],
)
def test_every_modifier_takes_effect(name, changes):
    expected = {**MODIFIED, **changes}
    got = CompiledModel(code(f"Modifiers.{name}")).simulate({}, 1e-3, outputs=list(expected), rows=1)
    assert {n: float(v[0]) for n, v in got.items()} == expected


def test_files_beside_a_users_file_are_not_read(tmp_path):
    (tmp_path / "a.mo").write_text("model Mine\n  parameter Real k = 1;\n  Real y = k*time;\nend Mine;\n")
    (tmp_path / "b.mo").write_text("model Mine\n  parameter Real k = 2;\n  Real y = k*time;\nend Mine;\nbroken")
    assert compile_model(f"{tmp_path / 'a.mo'}:Mine").variable("k").start == 1.0


def test_effect_of_a_user_in_a_file_of_its_own(tmp_path):
    (tmp_path / "stop.mo").write_text(
        'block MyStop "Stop"\n  extends HystId.Interfaces.PartialEffect;\n'
        '  parameter Real k(unit = "N/m") = 0 "Stiffness";\n'
        "equation\n  f = k*max(x - 2e-3, 0);\nend MyStop;\n"
    )
    (tmp_path / "rig.mo").write_text(
        "model Rig\n  extends HystId.Oscillators.Linear(f_effects = s.f);\n"
        "  MyStop s(x = x, v = v, a = a, h = f_h, k = 1e4);\nend Rig;\n"
    )
    rig = CompiledModel(compile_model(f"{tmp_path / 'rig.mo'}:Rig", libraries=[tmp_path / "stop.mo"]))
    got = rig.simulate({"F": np.full(200, 60.0)}, 1e-3, outputs=["x", "s.f"])
    close(got["s.f"], 1e4 * np.maximum(got["x"] - 2e-3, 0), 1e-12)
    assert got["s.f"].max() > 1


def test_modifiers_of_a_class_redeclaration_and_of_its_constraint_act():
    """Redeclared.mo: x'' = -(7 x^3 + 2 x) from 1, in every spelling of the redeclaration."""
    exact = solve_ivp(
        lambda t, s: [s[1], -(7 * s[0] ** 3 + 2 * s[0])], (0, 1), [1, 0], method="DOP853", rtol=1e-12, atol=1e-12
    ).y[0, -1]
    for name in ("InModifiers", "Bounded", "AsElement"):
        close(run(f"Redeclared.{name}", "x")["x"][-1], exact, SMOOTH)
    both = run("Redeclared.Components", "a[1].x a[2].x b.x", stop=1.0)
    close([both["a[1].x"][-1], both["a[2].x"][-1]], exact, SMOOTH)
    close(both["b.x"][-1], 0.5 * math.cos(math.sqrt(3)), SMOOTH)
    for name, y in (("Hold", 30), ("HoldOwn", 12), ("Held", 30), ("HoldClass", 30)):
        close(run(f"Redeclared.{name}", "f.y")["f.y"][-1], y, 1e-12)
    close(run("Redeclared.HeldInComponent", "h.f.y")["h.f.y"][-1], 8, 1e-12)


def test_value_and_attributes_together_act_in_every_place():
    for name, wanted in (
        ("Extended", {"y": (7.5, None), "m": (1.5, 0.1), "p[2]": (3, 0.5)}),
        ("Short", {"y": (2.5, None), "m": (1.5, 0.1)}),
        ("Deep", {"h.a.y": (5.5, None), "h.a.m": (1.5, 0.1), "h.a.p[1]": (2, 0.5), "s.m": (1.5, 0.1)}),
    ):
        got = run(f"Redeclared.{name}", " ".join(wanted))
        for variable, (value, low) in wanted.items():
            close(got[variable][-1], value, SMOOTH)
            assert code(f"Redeclared.{name}").variable(variable).min == low


def test_values_of_a_function_s_variables_with_either_sign(tmp_path: Path) -> None:
    file = tmp_path / "A.mo"
    file.write_text("""
model A
  function root "Of x^3 = a, by halves"
    input Real a;
    output Real x := 1;
  protected
    Real low := 0, high = max(1, a);
  algorithm
    for k in 1:50 loop
      x := (low + high)/2;
      if x^3 > a then
        high := x;
      else
        low := x;
      end if;
    end for;
  end root;
  Real y = root(8 + time);
end A;""")
    got = CompiledModel(compile_model(f"{file}:A")).simulate({}, 0.5, rows=3, outputs=["y"])
    close(got["y"], np.cbrt(8 + np.array([0, 0.5, 1])), 1e-13)  # 9 divided by 2^50
