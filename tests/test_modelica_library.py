"""The physics of HystId: every law against an answer found without the compiler, and what each law claims."""

from __future__ import annotations

import itertools
import json
import re
import subprocess
import sys
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from hystid.compiled import CompiledModel
from hystid.modelica import compile_model
from hystid.modelica.compile import flat_from_text
from hystid.modelica.library import FOLDER, digest, library_models, library_sources, shipped
from hystid.modelica.sources import read_tree

LIBRARY = Path(__file__).parents[1] / "modelica"
DT = 1e-4


@cache
def model(name: str) -> CompiledModel:
    where = f"{LIBRARY}/HystIdTest/package.mo:{name}" if name.startswith("HystIdTest") else f"HystId.{name}"
    return CompiledModel(compile_model(where))


def motion(path: np.ndarray, rate: np.ndarray, name: str, outputs: str = "f", dt: float = DT, **parameters: float):
    """A law under given x and v; inputs run by the cubic through four samples."""
    signals = {"x": path, "v": rate}
    return model(name).simulate(
        signals, dt, outputs=outputs.split(), parameters=parameters, interpolation="cubic", substeps=1
    )


def cycles(amplitude: float = 3e-3, frequency: float = 5.0, count: float = 3, dt: float = DT):
    t = np.arange(round(count / frequency / dt) + 1) * dt
    w = 2 * np.pi * frequency
    return t, amplitude * np.sin(w * t), amplitude * w * np.cos(w * t)


# -- shipped flat models


@pytest.mark.parametrize("name", library_models())
def test_shipped_flat_model_is_what_the_front_end_makes(name):
    same = shipped(name) == flat_from_text(name)
    assert same, "run 'python -m hystid.modelica.library'"


def test_index_belongs_to_this_library():
    digests = json.loads((FOLDER / "index.json").read_text())["digests"]
    assert digests == {name: digest(name) for name in library_models()}
    stored = {p.stem for p in FOLDER.glob("HystId.*.json")}
    assert stored == set(library_models())


def test_library_models_build_without_the_front_end():
    assert shipped("HystId.Oscillators.Jenkins") is not None, "run 'python -m hystid.modelica.library'"
    script = (
        "import sys; sys.modules['rumoca'] = None\n"
        "from hystid.modelica import compile_model\n"
        "print(compile_model('HystId.Oscillators.Jenkins').token)"
    )
    out = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert out.stdout.strip() == compile_model("HystId.Oscillators.Jenkins").token


def test_every_declaration_says_what_it_is():
    """One text per variable and parameter, which states the sign; the one vendor annotation stands in effects alone."""
    for source in library_sources():
        vendors = set(re.findall(r"(__\w+)\s*\(", source.plain))
        assert vendors <= ({"__HystId_effect"} if "Effects" in source.path.parts else set()), source.path
        for line in source.text.splitlines():
            if re.match(r"\s+(?:parameter|input|output)\s", line):
                assert '"' in line, f"{source.path}: {line.strip()}"


# -- laws


def jenkins_oracle(x: np.ndarray, Ks: float, fc: float) -> np.ndarray:
    """Spring and slider: exact for motions that are monotone between samples."""
    f = np.zeros_like(x)
    for k in range(1, len(x)):
        f[k] = np.clip(f[k - 1] + Ks * (x[k] - x[k - 1]), -fc, fc)
    return f


def test_jenkins_against_spring_and_slider():
    fine = 16
    t = np.arange(20000 * fine + 1) * DT / fine
    x = 1e-3 * np.sin(2 * np.pi * 3 * t) + 7e-4 * np.sin(2 * np.pi * 11.3 * t) + 4e-4 * np.sin(2 * np.pi * 29 * t)
    w = 2 * np.pi * np.array([3, 11.3, 29])
    v = (np.array([1e-3, 7e-4, 4e-4]) * w) @ np.cos(np.outer(w, t))
    oracle = jenkins_oracle(x, 5e4, 37.5)[::fine]
    got = motion(x[::fine], v[::fine], "Forces.Jenkins")["f"]
    # the oracle misses turning points by up to a (dt/16)^2/8 = 9e-11 m, which 5e4 N/m turns into 4e-6 N
    np.testing.assert_allclose(got, oracle, atol=1e-5)
    assert np.ptp(np.sign(np.diff(oracle))) == 2


def test_jenkins_stays_in_bounds_on_noisy_motion():
    rng = np.random.default_rng(1)
    _, x, v = cycles()
    x, v = x + rng.normal(0, 2e-5, len(x)), v + rng.normal(0, 0.02, len(v))
    got = model("Forces.Jenkins").simulate({"x": x, "v": v}, DT, outputs=["f", "loss"])
    assert np.abs(got["f"]).max() <= 37.5 * (1 + 1e-9)
    assert got["loss"].min() >= 0


def test_pecorari_solodov_is_the_published_formula():
    _, x, v = cycles(amplitude=1.5e-2)
    x, v = x[1:], v[1:] + 1e-9
    Ks, x0, x1 = 5e3, 2e-2, 1e-2
    s = np.sign(v)
    K = 0.5 * Ks * (1 - s * np.sign(x + x1 * s))
    exact = K * x + K * x1 * s + 0.5 * Ks * (x0 - x1) * s
    got = model("Forces.PecorariSolodov").simulate({"x": x, "v": v}, DT, outputs=["f"])["f"]
    np.testing.assert_allclose(got, exact, rtol=1e-14, atol=1e-12)


def test_pecorari_solodov_may_turn_over_a_speed():
    v_turn = 0.02
    t, x, v = cycles(amplitude=1.2e-2, frequency=1.0, count=2.0, dt=1e-3)
    sharp = motion(x, v, "Forces.PecorariSolodov", dt=1e-3)["f"]
    got = motion(x, v, "Forces.PecorariSolodov", outputs="f loss", dt=1e-3, v_turn=v_turn)
    away = np.abs(v) > 3 * v_turn
    jump = 5e3 * (2e-2 - 1e-2)
    # 1 - tanh(3) = 0.5 % of half the jump is left there
    np.testing.assert_allclose(got["f"][away], sharp[away], atol=0.0026 * jump)
    at_rest = np.argmin(np.abs(v[400:600])) + 400
    assert 0.2 * jump < np.max(np.abs(np.diff(sharp))) <= jump
    assert np.max(np.abs(np.diff(got["f"]))) < 0.05 * jump
    assert abs(got["f"][at_rest] - np.mean([sharp[at_rest - 40], sharp[at_rest + 40]])) < 0.1 * jump
    assert got["loss"].min() >= 0
    last = t >= t[-1] - 1 - 1e-9
    work, heat = (np.trapezoid(p[last], t[last]) for p in (got["f"] * v, got["loss"]))
    # what the mean of the branches stores comes back; slip and stick change inside samples of 1 ms
    assert heat == pytest.approx(work, rel=2e-3)


def test_pecorari_solodov_warns_beyond_its_amplitude(caplog):
    _, x, v = cycles(amplitude=3e-2, count=0.3)
    model("Forces.PecorariSolodov").simulate({"x": x, "v": v}, DT, outputs=["f"])
    assert "exceeds x0" in caplog.text


def test_jenkins_and_pecorari_solodov_share_their_loop_at_full_amplitude():
    x0, x1, Ks = 2e-2, 1e-2, 5e3
    t, x, v = cycles(amplitude=x0, frequency=1.0, count=2.0, dt=1e-3)
    late = t > 1.001
    jenkins = motion(x, v, "Forces.Jenkins", dt=1e-3, Ks=Ks, fc=0.5 * Ks * (x0 - x1))["f"][late]
    published = motion(x * (1 - 1e-9), v, "Forces.PecorariSolodov", dt=1e-3)["f"][late]
    moving = np.abs(v[late]) > 1e-3
    np.testing.assert_allclose(jenkins[moving], published[moving], atol=1e-3)  # cubics miss 2e-2 m by (w dt)^4/384


def test_breathing_crack():
    _, x, v = cycles()
    got = motion(x, v, "Forces.BilinearStiffness")["f"]
    np.testing.assert_allclose(got, np.where(x > 0, 8e3 * x, 1e4 * x), rtol=1e-14, atol=1e-15)


ODES = {
    "Dahl": lambda z, x, v: 5e4 * (v - abs(v) * z / 37.5),
    "BoucWen": lambda z, x, v: 5e4 * v - 1e3 * (0.8 * abs(v) * z - 1.1 * v * abs(z)),
    "LuGre": lambda z, x, v: v - 5e4 * abs(v) * z / (30 + 7.5 * np.exp(-((v / 0.01) ** 2))),
    "MicroSlip": lambda z, x, v: v * (
        5e4 * (1 - np.sign(v) * z / 37.5) / (1 - 0.5 * np.sign(v) * z / 37.5) - 5e3
    ),
}  # fmt: skip


@pytest.mark.parametrize("law", sorted(ODES))
def test_smooth_laws_against_scipy(law):
    a, w = 2e-3, 2 * np.pi * 5
    t, x, v = cycles(a, 5.0, 1.0)
    z = np.zeros_like(t)
    edges = [0.0, 0.05, 0.15, 0.2]  # v changes sign there, where the right-hand sides have a kink
    start = [0.0]
    for left, right in itertools.pairwise(edges):
        inside = (t >= left - 1e-12) & (t <= right + 1e-12)
        solved = solve_ivp(
            lambda s, z: [ODES[law](z[0], a * np.sin(w * s), a * w * np.cos(w * s))],
            (left, right), start, rtol=1e-11, atol=1e-15, t_eval=np.clip(t[inside], left, right), method="DOP853",
        )  # fmt: skip
        z[inside], start = solved.y[0], [solved.y[0, -1]]
    got = motion(x, v, f"Forces.{law}", outputs="f z")
    np.testing.assert_allclose(
        got["z"], z, atol=2e-6 * np.abs(z).max()
    )  # kinks inside a step cost (w dt)^2/2 of a step
    if law == "LuGre":
        np.testing.assert_allclose(got["f"], 5e4 * z + 10 * ODES[law](z, x, v), atol=2e-4)
    if law == "MicroSlip":
        np.testing.assert_allclose(got["f"], z + 5e3 * x, atol=1e-4)


RATE_INDEPENDENT = ["Jenkins", "Iwan", "BoucWen", "Dahl", "MicroSlip"]
DISSIPATIVE = [*RATE_INDEPENDENT, "LuGre"]


@pytest.mark.parametrize("law", RATE_INDEPENDENT)
def test_rate_independence(law):
    _, x, v = cycles()
    slow = motion(x, v, f"Forces.{law}", dt=DT)["f"]
    fast = motion(x, 7 * v, f"Forces.{law}", dt=DT / 7)["f"]
    np.testing.assert_allclose(fast, slow, atol=1e-9 * np.abs(slow).max())


@pytest.mark.parametrize("law", DISSIPATIVE)
def test_energy_of_a_closed_loop_is_what_is_lost(law):
    t, x, v = cycles(count=6)
    parameters = {"gamma": 0.6, "delta": 0.4} if law == "BoucWen" else {}
    got = motion(x, v, f"Forces.{law}", outputs="f loss", **parameters)
    last = t >= t[-1] - 0.2 - 1e-9
    work = np.trapezoid((got["f"] * v)[last], t[last])
    heat = np.trapezoid(got["loss"][last], t[last])
    assert work > 0
    assert got["loss"].min() >= -1e-9
    assert heat == pytest.approx(work, rel=1e-3)  # the loss jumps where slip begins: one step of a trapezoid


def test_loss_of_pecorari_solodov_is_the_work_of_a_loop_at_full_amplitude():
    t, x, v = cycles(amplitude=2e-2 * (1 - 1e-9), frequency=1.0, count=2.0, dt=1e-3)
    got = model("Forces.PecorariSolodov").simulate({"x": x, "v": v}, 1e-3, outputs=["f", "loss"])
    last = t >= t[-1] - 1 - 1e-9
    work, heat = (np.trapezoid(p[last], t[last]) for p in (got["f"] * v, got["loss"]))
    assert got["loss"].min() >= 0
    # 25 N over the 0.03 m that slip on each way, from -x1 to x0; slip begins inside a sample of 1 ms at up to 0.13 m/s
    assert heat == pytest.approx(25 * 0.06, abs=2 * 25 * 0.13e-3)
    assert heat == pytest.approx(work, abs=2 * 25 * 0.13e-3)


def test_loops_of_bouc_wen_with_bulging_branches_still_lose_energy():
    t, x, v = cycles(count=6)
    f = motion(x, v, "Forces.BoucWen")["f"]
    last = t >= t[-1] - 0.2 - 1e-9
    assert np.trapezoid((f * v)[last], t[last]) > 0


@pytest.mark.parametrize("law", ["Jenkins", "Iwan"])
def test_return_point_memory(law):
    """An inner loop closes, and after it the outer branch goes on as if nothing had been."""
    corners = np.array([0, 1.2, -0.9, 0.4, -0.3, 0.4, 1.2]) * 1e-3
    duration = 0.1
    t = np.arange(round(duration * (len(corners) - 1) / DT) + 1) * DT
    leg = np.minimum((t / duration).astype(int), len(corners) - 2)
    s = t / duration - leg
    span = (corners[1:] - corners[:-1])[leg]
    x = corners[leg] + span * (10 * s**3 - 15 * s**4 + 6 * s**5)
    v = span * 30 * (s**2 - 2 * s**3 + s**4) / duration
    f = motion(x, v, f"Forces.{law}")["f"]
    at = [np.searchsorted(t, duration * k - DT / 2) for k in range(len(corners))]
    assert f[at[5]] == pytest.approx(f[at[3]], abs=1e-6)  # the loop 0.4, -0.3, 0.4 closes
    assert f[at[6]] == pytest.approx(f[at[1]], abs=1e-6)  # and the outer one as well


def test_iwan_is_the_sum_of_its_sliders():
    _t, x, v = cycles()
    fc = 2 * 37.5 * np.arange(1, 9) / 72
    exact = sum(jenkins_oracle(x, 5e4 / 8, limit) for limit in fc)
    got = motion(x, v, "Forces.Iwan")["f"]
    np.testing.assert_allclose(got, exact, atol=1e-3)  # the oracle's turning points: a (w dt)^2/8 x 5e4 N/m
    stiffness = got[3] / x[3]
    assert stiffness == pytest.approx(5e4, rel=1e-6)


# -- oscillators


def simulate(name: str, dt: float, stop: float = 0.2, outputs: str = "x", **parameters: float):
    t = np.arange(round(stop / dt) + 1) * dt
    force = 60 * np.sin(2 * np.pi * 20 * t)
    slopes = "cubic" if dt < 1e-2 else "linear"
    return model(name).simulate({"F": force}, dt, outputs=outputs.split(), parameters=parameters, interpolation=slopes)


@pytest.mark.parametrize("name", [m for m in library_models() if ".Oscillators." in m])
def test_balance_of_forces(name):
    got = simulate(name.removeprefix("HystId."), DT, outputs="x v a R f_h f_effects")
    t = np.arange(len(got["x"])) * DT
    np.testing.assert_allclose(got["a"] + got["R"], 60 * np.sin(2 * np.pi * 20 * t), atol=1e-10)
    np.testing.assert_allclose(got["R"], 10 * got["v"] + 1e4 * got["x"] + got["f_h"] + got["f_effects"], atol=1e-10)


ORDERS = {"Linear": 3.8, "Jenkins": 3.5, "Iwan": 3.0, "Dahl": 1.8, "BoucWen": 1.8}


@pytest.mark.parametrize(("name", "order"), ORDERS.items())
def test_order_of_convergence(name, order):
    """Located events keep the order of Runge-Kutta; a kink inside a step (|v|) leaves two."""
    errors = []
    fine = simulate(f"Oscillators.{name}", 3.125e-5)["x"]
    for factor in (16, 8):
        x = simulate(f"Oscillators.{name}", 3.125e-5 * factor)["x"]
        errors.append(np.abs(x - fine[::factor]).max())
    assert np.log2(errors[0] / errors[1]) > order


def test_jenkins_oscillator_against_scipy_with_events():
    """Sticking and slipping integrated apart by scipy, changes located by its root finder."""
    m, B, Kl, Ks, fc = 1.0, 10.0, 1e4, 5e4, 37.5

    def force(t):
        return 60 * np.sin(2 * np.pi * 20 * t)

    def rhs(slips):
        return lambda t, s: [s[1], (force(t) - B * s[1] - Kl * s[0] - s[2]) / m, 0.0 if slips else Ks * s[1]]

    def limit(t, s):
        return abs(s[2]) - fc

    def turn(t, s):
        return s[1]

    limit.terminal = turn.terminal = True
    limit.direction = 1
    t, state, slips, grid = 0.0, np.array([0.0, 0.0, 0.0]), False, np.arange(2001) * DT
    x = np.zeros_like(grid)
    while t < grid[-1] - 1e-12:
        event = turn if slips else limit
        solved = solve_ivp(rhs(slips), (t, grid[-1]), state, events=event, rtol=1e-11, atol=1e-14, dense_output=True)
        inside = (grid >= t) & (grid <= solved.t[-1])
        x[inside] = solved.sol(grid[inside])[0]
        t, state = solved.t[-1], solved.y[:, -1].copy()
        if t < grid[-1]:
            state[2] = np.sign(state[2]) * fc
            slips = not slips
            if not slips:
                state[1] = -np.sign(state[2]) * 1e-15  # just behind the turning point
    got = simulate("Oscillators.Jenkins", DT)["x"]
    np.testing.assert_allclose(got, x, atol=1e-8 * np.abs(x).max())


def test_effects_enter_through_f_effects():
    got = CompiledModel(compile_model("HystId.Examples.HiddenGap")).simulate(
        {"F": 60 * np.sin(2 * np.pi * 20 * np.arange(2001) * DT)}, DT, outputs=["x", "f_effects"]
    )
    np.testing.assert_allclose(got["f_effects"], 2e4 * np.maximum(got["x"] - 1e-3, 0), atol=1e-10)
    assert got["f_effects"].max() > 1


def test_every_effect_compiles_and_vanishes_at_its_defaults():
    _t, x, v = cycles(1e-3, 20, 1)
    w = 2 * np.pi * 20
    signals = {"x": x, "v": v, "a": -(w**2) * x, "h": 20 * np.sign(v)}
    for name in (m for m in library_models() if ".Effects." in m):
        code = compile_model(name)
        inputs = {v.name for v in code.variables if v.causality == "input"}
        assert inputs == set(signals), name
        got = CompiledModel(code).simulate(signals, DT, outputs=["f"])["f"]
        assert np.abs(got).max() == 0, name


# -- HystIdTest


def test_energy_balance_in_modelica():
    got = model("HystIdTest.EnergyBalance").simulate({}, DT, outputs=["work", "heat", "balance"], rows=10001)
    assert got["heat"][-1] > 0.1
    assert np.abs(got["balance"]).max() < 1e-7 * got["work"][-1]


def test_comparison_signals_exist():
    for line in (LIBRARY / "HystIdTest" / "comparisonSignals.txt").read_text().splitlines():
        name, signals = line.split(":")
        known = {v.name for v in model(name).code.variables}
        assert set(signals.split()) <= known, name
        assert model(name).code.experiment.stop == 1.0


def test_front_end_has_nothing_to_say_about_the_library():
    """No error, no warning, in any file, HystIdTest and the names of the standard library included."""
    import rumoca

    ours = [*library_sources(), *read_tree(LIBRARY / "HystIdTest"), *read_tree(FOLDER.parent / "standard" / "Modelica")]
    said = {str(s.path): rumoca.validate_source(s.text, filename=str(s.path)) for s in ours}
    assert not {path: messages for path, messages in said.items() if messages}
