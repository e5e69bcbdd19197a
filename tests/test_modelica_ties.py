"""States that are tied more than once over the same variables."""

from __future__ import annotations

from pathlib import Path

import fmpy
import numpy as np
import pytest
from fmpy.fmi1 import FMICallException
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from hystid.compiled import CompiledModel
from hystid.fmu import Driver, build_model
from hystid.modelica import compile_model

GEAR = """
package Rig
  connector Flange
    Real phi;
    flow Real tau;
  end Flange;
  model Inertia
    Flange a, b;
    parameter Real J = 1;
    Real phi(start = 0), w(start = 0), acc;
  equation
    phi = a.phi;
    phi = b.phi;
    w = der(phi);
    acc = der(w);
    J*acc = a.tau + b.tau;
  end Inertia;
  model Gear "with the power at its flanges and a loss that follows the speed"
    Flange a, b, support;
    parameter Real ratio = 2, d = 0.3;
    Real phi_a, phi_b, w_a, a_a, loss, power;
  equation
    phi_a = a.phi - support.phi;
    phi_b = b.phi - support.phi;
    phi_a = ratio*phi_b;
    0 = b.tau + ratio*(a.tau - loss);
    0 = a.tau + b.tau + support.tau;
    w_a = der(phi_a);
    a_a = der(w_a);
    loss = d*w_a;
    power = a.tau*der(a.phi);
  end Gear;
  model Fixed
    Flange f;
    parameter Real phi0 = 0.5;
  equation
    f.phi = phi0;
  end Fixed;
  model Torque
    Flange f, support;
    Real phi_support;
  equation
    phi_support = support.phi;
    f.tau = -sin(time);
    f.tau + support.tau = 0;
  end Torque;
  model A
    Inertia one(J = 1, phi(start = 0.5)), two(J = 1.5);
    Gear gear;
    Fixed fixed, other;
    Torque torque;
  equation
    connect(torque.f, one.a);
    connect(torque.support, other.f);
    connect(one.b, gear.a);
    connect(gear.b, two.a);
    connect(gear.support, fixed.f);
  end A;
end Rig;
"""


def test_a_gear_that_looks_at_the_speed_of_its_flange(tmp_path: Path) -> None:
    file = tmp_path / "rig.mo"
    file.write_text(GEAR)
    t = 0.01 * np.arange(301)
    names = ["one.w", "two.w", "gear.power", "two.phi"]
    got = CompiledModel(compile_model(f"{file}:Rig.A")).simulate({}, 0.01, rows=len(t), outputs=names, substeps=4)

    def rates(at: float, y: np.ndarray) -> list[float]:
        return [y[1], (np.sin(at) - 0.3 * y[1]) / (1 + 1.5 / 4)]

    turned = solve_ivp(rates, (0, 3), [0, 0], rtol=1e-11, atol=1e-13, t_eval=t).y
    through = np.array([np.sin(s) - rates(s, y)[1] for s, y in zip(t, turned.T, strict=True)])  # torque at flange a
    wanted = {"one.w": turned[1], "two.w": turned[1] / 2, "two.phi": 0.5 + turned[0] / 2}
    for name, values in wanted.items():
        assert np.abs(got[name] - values).max() < 1e-8, name  # Runge-Kutta with 2.5 ms
    assert np.abs(got["gear.power"] - through * turned[1]).max() < 1e-8


TWO = """
model A
  Real s1(start = 0, fixed = true), v1(start = 1, fixed = true);
  Real s2(start = 1, fixed = true), v2(start = 0, fixed = true);
  Real s_rel{prefer}, v_rel{prefer}, f;
  Boolean stopped(start = false, fixed = true);
equation
  der(s1) = v1;
  der(s2) = v2;
  s_rel = s2 - s1;
  v_rel = der(s_rel);
  f = 30*(s_rel - 1) + 0.5*v_rel;
  der(v1) = if stopped then 0 else f;
  2*der(v2) = -f;
  when s1 > 0.25 then
    reinit(v1, 0);
    stopped = true;
  end when;
end A;
"""


@pytest.mark.parametrize("preferred", [True, False])
def test_what_an_event_sets_anew_leaves_other_states_as_they_are(preferred: bool, tmp_path: Path) -> None:
    """The states are v1 and v_rel where the author prefers that, else v1 and v2 (specification 3.6, section 4.9.8)."""
    file = tmp_path / "rig.mo"
    file.write_text(TWO.replace("{prefer}", "(stateSelect = StateSelect.prefer)" if preferred else ""))
    t = 0.01 * np.arange(101)
    got = CompiledModel(compile_model(f"{file}:A")).simulate({}, 0.01, rows=101, outputs=["v1", "v2"], substeps=8)

    def rates(_: float, y: np.ndarray, held: bool = False) -> list[float]:
        f = 30 * (y[2] - y[0] - 1) + 0.5 * (y[3] - y[1])
        return [y[1], 0 if held else f, y[3], -f / 2]

    def reached(_: float, y: np.ndarray) -> float:
        return float(y[0] - 0.25)

    reached.terminal = True  # type: ignore[attr-defined]  # scipy's way
    tight = {"rtol": 1e-11, "atol": 1e-13}
    before = solve_ivp(rates, (0, 1), [0, 1, 1, 0], events=reached, dense_output=True, **tight)
    at, (s1, v1, s2, v2) = before.t[-1], before.y[:, -1]
    start = [s1, 0, s2, v2 - v1 if preferred else v2]
    after = solve_ivp(lambda s, y: rates(s, y, True), (at, 1), start, dense_output=True, **tight)
    wanted = np.where(t < at, before.sol(np.minimum(t, at))[3], after.sol(np.maximum(t, at))[3])
    assert 0.1 < at < 0.9
    assert np.abs(got["v2"] - wanted).max() < 1e-6


def test_a_coil_on_a_nonlinear_core_with_its_current_given(tmp_path: Path) -> None:
    """The flux follows from the current through equations that no formula solves; the voltage is its derivative."""
    file = tmp_path / "rig.mo"
    file.write_text("""
model A
  Real phi, i, u, iron, gap;
  discrete Real gain(start = 1, fixed = true);
equation
  i = gain*sin(3*time);
  i = iron + gap;
  phi = iron + iron^3;
  phi = 2*gap + gap^3;
  u = der(phi);
  when time > 0.505 then
    gain = 2;
  end when;
end A;
""")
    t = 0.01 * np.arange(101)
    got = CompiledModel(compile_model(f"{file}:A")).simulate({}, 0.01, rows=101, outputs=["phi", "u"], substeps=2)
    gain = np.where(t > 0.505, 2, 1)
    current, change = gain * np.sin(3 * t), 3 * gain * np.cos(3 * t)
    iron = np.array([brentq(lambda a, c=c: a + a**3 - 2 * (c - a) - (c - a) ** 3, -3, 3, xtol=1e-14) for c in current])
    phi = iron + iron**3
    u = change / (1 / (1 + 3 * iron**2) + 1 / (2 + 3 * (current - iron) ** 2))
    assert np.abs(got["phi"] - phi).max() < 1e-9
    assert np.abs(got["u"] - u).max() < 1e-9


PENDULUM = """
model Pendulum
  parameter Real L = 2;
  Real x(start = {x}), y(start = {y}), vx(start = {vx}), vy, pull;
equation
  x^2 + y^2 = L^2;
  der(x) = vx;
  der(y) = vy;
  der(vx) = -pull*x;
  der(vy) = -pull*y - 9.81;
end Pendulum;
"""


def swing(t: np.ndarray, start: list[float]) -> np.ndarray:
    """Angle of that pendulum from its lowest point; start: angle and its rate."""
    return solve_ivp(
        lambda _, s: [s[1], -9.81 / 2 * np.sin(s[0])], (0, t[-1]), start, rtol=1e-11, atol=1e-12, t_eval=t
    ).y[0]


@pytest.mark.parametrize(
    ("x", "y", "vx", "angle", "stop"),
    [
        pytest.param("0", "-L", "0.4", 0.0, 3.0, id="hangs and is pushed"),
        pytest.param("L", "0", "0", np.pi / 2, 0.7, id="is let go level"),
    ],
)
def test_a_pendulum_whose_start_leaves_one_choice_of_states(x, y, vx, angle, stop, tmp_path: Path) -> None:
    (tmp_path / "p.mo").write_text(PENDULUM.format(x=x, y=y, vx=vx))
    t = np.linspace(0, stop, 1 + round(stop / 0.01))
    found = Driver(build_model(f"{tmp_path}/p.mo:Pendulum", tmp_path / "p.fmu").path).simulate(t, outputs=["x", "y"])
    exact = solve_ivp(
        lambda _, s: [s[1], -9.81 / 2 * np.sin(s[0])],
        (0, stop),
        [angle, float(vx) / 2],
        rtol=1e-11,
        atol=1e-12,
        t_eval=t,
    ).y[0]
    # the step of the model is 1e-4 s; near the level start x follows from y without loss
    assert found["x"] == pytest.approx(2 * np.sin(exact), abs=1e-8)
    assert found["y"] == pytest.approx(-2 * np.cos(exact), abs=1e-8)


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")  # FMPy raises in calls from its solver
@pytest.mark.parametrize("kind", ["CoSimulation", "ModelExchange"])
def test_a_run_ends_where_the_choice_of_states_becomes_singular(kind, tmp_path: Path, capsys) -> None:
    """x follows from y, up to the lowest point: it came back on the side that it was on before."""
    (tmp_path / "p.mo").write_text(PENDULUM.format(x="0.6*L", y="-0.8*L, fixed = true", vx="0"))
    fmu = build_model(f"{tmp_path}/p.mo:Pendulum", tmp_path / "p.fmu", fmi=3).path
    options = {"fmi_type": kind, "output_interval": 0.01, "output": ["x"]}
    rows = fmpy.simulate_fmu(str(fmu), stop_time=0.5, relative_tolerance=1e-8, **options)
    exact = 2 * np.sin(swing(np.linspace(0, 0.5, 51), [np.arcsin(0.6), 0.0])[-1])
    assert rows["x"][-1] == pytest.approx(exact, abs=1e-5)  # the importer's solver at its tolerance
    with pytest.raises(FMICallException):
        fmpy.simulate_fmu(str(fmu), stop_time=2.0, **options)
    if kind == "CoSimulation":  # a solver with error control may look beyond the lowest point first, where no x is
        assert "'x' no longer follows from the equation that ties it (p.mo:6)" in capsys.readouterr().out


@pytest.mark.parametrize("tolerance", [1e-5, 1e-9])
def test_a_turning_point_that_is_located_to_rounding(tolerance, tmp_path: Path, capsys) -> None:
    """x follows from the height on a parabola; at its lowest point the bead stayed."""
    (tmp_path / "b.mo").write_text("""
model Bead
  Real x(start = 1), y(start = 1, fixed = true), vx(start = 0), vy, push;
equation
  y = x^2;
  der(x) = vx;
  der(y) = vy;
  der(vx) = -2*x*push;
  der(vy) = push - 9.81;
end Bead;
""")
    fmu = build_model(f"{tmp_path}/b.mo:Bead", tmp_path / "b.fmu", fmi=3).path
    with pytest.raises(FMICallException):
        fmpy.simulate_fmu(str(fmu), fmi_type="ModelExchange", stop_time=1.0, relative_tolerance=tolerance)
    assert "'x' no longer follows from the equation that ties it (b.mo:5)" in capsys.readouterr().out


def test_a_quick_crank_with_sparse_output_is_far_from_singular(tmp_path: Path) -> None:
    """Its rod leans by 42 degrees at most, and turns back ten times within a tenth of a second."""
    (tmp_path / "crank.mo").write_text("""
model Crank
  Real phi(start = 0, fixed = true), w(start = 60, fixed = true), beta(start = 0), rate;
equation
  0.1*sin(phi) = 0.15*sin(beta);
  rate = der(beta);
  der(phi) = w;
  der(w) = -0.5*sin(time);
  annotation(experiment(StopTime = 1, Interval = 0.01));
end Crank;
""")
    t = np.linspace(0, 1, 101)
    found = Driver(build_model(f"{tmp_path}/crank.mo:Crank", tmp_path / "c.fmu").path).simulate(
        t, outputs=["phi", "beta"]
    )
    assert found["beta"] == pytest.approx(np.arcsin(np.sin(found["phi"]) / 1.5), abs=1e-12)


def test_two_coils_on_a_core_with_a_given_current_follow_it(tmp_path: Path) -> None:
    """The gap's flux is tied to that of the core through the leakage; then the current gives that of the core."""
    (tmp_path / "core.mo").write_text("""
model Core
  Real core(start = 0), gap(start = 0), across, z, quick, slow;
equation
  across = 2*gap*(1 + gap^2);
  across = (core - gap)*(1 + (core - gap)^2);
  z + z^3 = core + across;
  sin(time) = z + core;
  quick = der(core);
  slow = der(gap);
end Core;
""")
    got = CompiledModel(compile_model(f"{tmp_path}/core.mo:Core")).simulate(
        {}, 0.1, rows=21, outputs=["core", "gap", "quick", "slow"]
    )

    def gap(core: float) -> float:
        return brentq(lambda g: 2 * g * (1 + g**2) - (core - g) * (1 + (core - g) ** 2), -2, 2, xtol=1e-14)

    def core(t: float) -> float:
        def rest(c: float) -> float:
            z = np.sin(t) - c
            return c + 2 * gap(c) * (1 + gap(c) ** 2) - z - z**3

        return brentq(rest, -2, 2, xtol=1e-14)

    t, h = np.arange(21) * 0.1, 1e-4
    assert got["core"] == pytest.approx([core(s) for s in t], abs=1e-9)  # Newton's method
    assert got["gap"] == pytest.approx([gap(core(s)) for s in t], abs=1e-9)
    slopes = [[(f(s + h) - f(s - h)) / (2 * h) for s in t] for f in (core, lambda s: gap(core(s)))]
    assert np.array([got["quick"], got["slow"]]) == pytest.approx(np.array(slopes), abs=1e-7)  # h^2
