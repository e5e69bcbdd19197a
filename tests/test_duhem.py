"""Rate-independent states on a given motion: followed along curves over its way, against integrators of others."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicHermiteSpline

from benchmarks.closed_forms import SIZES, integrated
from hystid.compiled import CompiledModel, slopes_of
from hystid.errors import NumericalError
from hystid.modelica import compile_model

Array = NDArray[np.float64]
DT = 1e-3
T = DT * np.arange(600)
X = 2e-3 * np.sin(2 * np.pi * 11 * T) * (0.3 + 0.7 * np.sin(2 * np.pi * 1.3 * T) ** 2)
V = np.gradient(X, DT)

FOLLOWED = [
    "Oscillators.BoucWen", "Oscillators.Dahl", "Oscillators.MicroSlip", "Effects.HystereticFriction",
    "Effects.HystereticFriction__BoucWen", "Effects.HystereticFriction__Hardening",
]  # fmt: skip
INTEGRATED = ["Oscillators.LuGre", "Oscillators.Jenkins", "Oscillators.PecorariSolodov", "Effects.HiddenMode",
              "Effects.ViscoelasticRelaxation", "Effects.StiffnessDrift"]  # fmt: skip


def inner(name: str) -> set[str]:
    """Slots of rate-independent states other than the displacement, in the C text."""
    code = compile_model(f"HystId.{name}")
    text = code.sources["model.c"]
    if "hy_rate_independent[" not in text:
        return set()
    rows = text.partition("hy_rate_independent[")[2].partition("};")[0].splitlines()[1:]
    slots = {row.strip(" {},").split(",")[0] for row in rows}
    return slots - {str(v.slot) for v in code.variables if v.name == "x"}


@pytest.mark.parametrize("name", FOLLOWED)
def test_rate_independent_states_are_known(name: str) -> None:
    assert inner(name)


@pytest.mark.parametrize("name", INTEGRATED)
def test_others_are_integrated(name: str) -> None:
    """LuGre and relaxation know the time, sliders have events, a hidden mode follows another state."""
    code = compile_model(f"HystId.{name}")
    has = inner(name)
    states = {str(v.slot) for v in code.variables if v.name in code.states} - {
        str(v.slot) for v in code.variables if v.name in ("x", "v")
    }
    assert not states or states - has


def test_force_is_that_of_an_integrator_of_others() -> None:
    """scipy at 1e-11 along the same cubic Hermite speed; a curve may be 3e-8 off between its nodes, and a reversal
    takes that along: 2e-6."""
    p = SIZES["BoucWen"]
    speed = CubicHermiteSpline(T, V, slopes_of(V, DT))

    def rate(t: float, z: Array) -> Array:
        v = speed(t)
        bend = p["gamma"] * abs(v) * np.sign(z) + p["delta"] * v
        return np.asarray(p["alpha"] * v - p["beta"] * bend * np.abs(z) ** p["nu"])

    wanted = solve_ivp(rate, (0, T[-1]), [0.0], t_eval=T, rtol=1e-11, atol=1e-11, max_step=DT).y[0]
    model = CompiledModel(compile_model("HystId.Oscillators.BoucWen"))
    found = model.clamp({"x": X, "v": V}, {}, DT, parameters=p, outputs=("f_h",))["f_h"]
    assert np.max(np.abs(found - wanted)) < 2e-6 * np.max(np.abs(wanted))


@pytest.mark.parametrize("name", ["BoucWen", "Dahl", "MicroSlip"])
def test_every_output_agrees_with_steps_of_time(name: str) -> None:
    """Outputs alone, and everything else: a loss is not among what is shown and takes the longer way.

    Against 100 steps per sample; 2e-6 as above, of the largest value, twice that for a loss, a square.
    What is asked for does not change a bit of the rest.
    """
    code = compile_model(f"HystId.Oscillators.{name}")
    p, names = SIZES[name], ("R", "a", "f_h", "law.loss")
    model = CompiledModel(code)
    found = model.clamp({"x": X, "v": V}, {}, DT, parameters=p, outputs=names)
    fine = integrated(code).clamp({"x": X, "v": V}, {}, DT, parameters=p, outputs=names, substeps=100)
    for output in names:
        assert np.max(np.abs(found[output] - fine[output])) < 4e-6 * np.max(np.abs(fine[output])), output
    alone = model.clamp({"x": X, "v": V}, {}, DT, parameters=p, outputs=("R",))
    assert np.array_equal(alone["R"], found["R"])


def test_a_law_at_its_limit_rests_there() -> None:
    """Slip within 30 nm, a thousandth of a sample's way: the force is the limit, in the sense of the motion.

    Samples just behind a reversal apart. 1e-9: the curve comes to rest at 1e-12 of its first slope.
    """
    p = {"alpha": 5e7, "beta": 1.5e3, "gamma": 2.5e4, "delta": 0.0, "nu": 1.0}
    limit = p["alpha"] / (p["beta"] * p["gamma"])
    model = CompiledModel(compile_model("HystId.Oscillators.BoucWen"))
    force = model.clamp({"x": X, "v": V}, {}, DT, parameters=p, outputs=("f_h",))["f_h"]
    step, before = np.diff(X, prepend=X[0]), np.roll(V, 1)
    steady = (np.abs(step) > 1e-6) & (np.sign(step) == np.sign(V)) & (np.sign(before) == np.sign(V))
    assert np.mean(steady) > 0.5
    assert np.max(np.abs(force[steady] - limit * np.sign(V[steady]))) < 1e-9 * limit


def test_tables_side_by_side_are_those_one_by_one() -> None:
    model = CompiledModel(compile_model("HystId.Oscillators.BoucWen"))
    motions = [model.motion({"x": k * X, "v": k * V}, {}, DT) for k in (0.1, 1.0, 3.0)]
    together = model.follow(motions, SIZES["BoucWen"], ("R",))
    for motion, found in zip(motions, together, strict=True):
        assert np.array_equal(model.follow([motion], SIZES["BoucWen"], ("R",))[0]["R"], found["R"])


@settings(max_examples=40, deadline=None)
@given(
    speeds=st.lists(st.floats(-1, 1).filter(lambda v: v == 0 or abs(v) > 1e-6), min_size=3, max_size=40),
    faster=st.floats(1e-3, 1e3),
)
def test_only_the_way_counts(speeds: list[float], faster: float) -> None:
    """The same way in another time gives the same force: rounding alone, 1e-9 of full friction. It never
    exceeds that."""
    model = CompiledModel(compile_model("HystId.Effects.HystereticFriction"))
    found = []
    for factor in (1.0, faster):
        held = {"x": np.zeros(len(speeds)), "v": factor * np.array(speeds)}
        known = {name: held[name] for name in held if any(u.name == name for u in model.code.variables)}
        run = model.clamp({}, known, DT / factor, parameters={"Fc": 1.0, "x_c": 5e-4}, outputs=("f",))
        found.append(run["f"])
    assert np.max(np.abs(found[0] - found[1])) < 1e-9
    assert np.max(np.abs(found[0])) <= 1 + 1e-9


LAW = """
model {name}
  input Real v;
  parameter Real c = 1e-3;
  parameter Real z0 = 0;
  output Real f;
protected
  Real z(start = z0, fixed = true);
equation
  der(z) = {rate};
  f = z;
end {name};
"""


def model_of(folder: Path, name: str, rate: str) -> CompiledModel:
    path = folder / f"{name}.mo"
    path.write_text(LAW.format(name=name, rate=rate))
    return CompiledModel(compile_model(f"{path}:{name}"))


def stepwise(z: float, speeds: Array, rate, steps: int = 400) -> Array:
    """Euler's way with 400 steps a sample along the linear speed, improved (Heun)."""
    found = [z]
    for before, after in pairwise(speeds):
        for k in range(steps):
            v = before + (after - before) * (k + 0.5) / steps
            k1 = rate(z, v)
            z += DT / steps * rate(z + 0.5 * DT / steps * k1, v)
        found.append(z)
    return np.array(found)


RATES = {
    "Rising": ("v*(1 + z^2)/c", lambda z, v: v * (1 + z * z) / 1e-3),
    "Resting": ("(v - abs(v)*z)/c", lambda z, v: (v - abs(v) * z) / 1e-3),
    "Branches": (
        "noEvent(if v > 0 then v*(2 - z) else v*(3 + z))/c",
        lambda z, v: (v * (2 - z) if v > 0 else v * (3 + z)) / 1e-3,
    ),
    "Path": ("abs(v)*(1 - z/5)/c", lambda z, v: abs(v) * (1 - z / 5) / 1e-3),
    "Root": ("sqrt(v^2)*cos(z)/c", lambda z, v: abs(v) * np.cos(z) / 1e-3),
}


@pytest.mark.parametrize("name", RATES)
@pytest.mark.parametrize("start", [0.0, 0.4, 4.0])
def test_laws_of_ones_own(tmp_path: Path, name: str, start: float) -> None:
    """Also from beyond a fixed point, where no curve through z = 0 comes. Heun at 1/400 of a sample: its square, times
    the few hundred ways per unit of z, is 2e-5 of the largest."""
    text, rate = RATES[name]
    speeds = 0.2 * np.sin(2 * np.pi * 23 * T[:150]) + 0.05 * np.sin(2 * np.pi * 61 * T[:150])
    if name == "Rising":
        start, speeds = 0.1 * start, 0.05 * speeds  # 1/(1 - s): far from where it has no answer
    model = model_of(tmp_path, name, text)
    assert "hy_duhem_state" in model.code.sources["model.c"]
    found = model.clamp({}, {"v": speeds}, DT, parameters={"z0": start}, outputs=("f",))["f"]
    wanted = stepwise(start, speeds, rate)
    assert np.max(np.abs(found - wanted)) < 2e-5 * np.max(np.abs(wanted))


@pytest.mark.parametrize(
    "rate", ["v*abs(v)/c", "v*cos(time)/c", "v*(1 + v)/c", "(v + 1)/c", "sin(v)/c", "v*(1 - z) - z", "v^2/sqrt(c)"]
)
def test_laws_that_know_the_speed_are_integrated(tmp_path: Path, rate: str) -> None:
    assert "hy_duhem_state" not in model_of(tmp_path, "Other", rate).code.sources["model.c"]


def test_a_jump_of_the_law_is_passed(tmp_path: Path) -> None:
    """A spring that breaks at a deflection of 1: the slope falls to 0 there at once, and the state stays. The last step
    before the jump is 1e-12 of the way."""
    model = model_of(tmp_path, "Breaks", "noEvent(if z < 1 then v else 0)/c")
    speeds = np.full(200, 0.1)
    found = model.clamp({}, {"v": speeds}, DT, parameters={}, outputs=("f",))["f"]
    assert np.max(np.abs(found - np.minimum(0.1 * T[:200] / 1e-3, 1.0))) < 1e-6


def test_a_law_without_answer_says_where(tmp_path: Path) -> None:
    model = model_of(tmp_path, "Ends", "v*(1 + z^2)/c")
    with pytest.raises(NumericalError, match=r"Ends.*sample 1[56]"):  # tan(s/c) has its pole at s = 1.571 mm
        model.clamp({}, {"v": np.full(60, 0.1)}, DT, parameters={}, outputs=("f",))
