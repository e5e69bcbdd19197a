"""Springs with sliders on a given motion: the closed form against a dense oracle, and against located events."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from benchmarks.closed_forms import SIZES, integrated
from hystid.compiled import CompiledModel, slopes_of
from hystid.errors import UsageError
from hystid.modelcode import ModelCode
from hystid.modelica import compile_model

Array = NDArray[np.float64]
DT = 1e-3
T = DT * np.arange(2000)
STOPS = ("Jenkins", "Iwan")


def code_of(name: str) -> ModelCode:
    return compile_model(f"HystId.Oscillators.{name}")


def oracle(name: str, v: Array, stretches: int = 200) -> Array:
    """Force of the sliders: the cubic Hermite speed in stretches, each spring clipped from one reversal to the next."""
    p, count = SIZES[name], 1 if name == "Jenkins" else 8
    number = np.arange(1, count + 1)
    stiffness = np.full(count, p["Ks"] / count)
    limit = p["fc"] * number * 2 / (count * (count + 1)) if count > 1 else np.array([p["fc"]])
    s = (np.arange(stretches) + 0.5) / stretches
    basis = np.stack([2 * s**3 - 3 * s**2 + 1, s**3 - 2 * s**2 + s, -2 * s**3 + 3 * s**2, s**3 - s**2])
    slopes = slopes_of(v, DT) * DT
    z, found = np.zeros(count), [0.0]
    for i in range(len(v) - 1):
        ways = (np.array([v[i], slopes[i], v[i + 1], slopes[i + 1]]) @ basis) * DT / stretches
        for run in np.split(ways, np.flatnonzero(np.diff(np.sign(ways))) + 1):
            z = np.clip(z + stiffness * run.sum(), -limit, limit)
        found.append(float(z.sum()))
    return np.array(found)


def motions() -> dict[str, Array]:
    rng = np.random.default_rng(5)
    smooth = 1e-3 * np.sin(2 * np.pi * 30 * T) * np.sin(2 * np.pi * 0.7 * T)
    return {
        "smooth": smooth,
        "few samples per cycle": 1e-3 * np.sin(2 * np.pi * 213 * T),
        "noise": 1e-3 * np.sin(2 * np.pi * 30 * T) + 1e-4 * rng.standard_normal(len(T)),
    }


@pytest.mark.parametrize("name", STOPS)
@pytest.mark.parametrize("kind", motions())
def test_force_is_that_of_the_oracle(name: str, kind: str) -> None:
    """The oracle finds a reversal to 1/200 of a sample: its square is what the force may differ by, 2.5e-5."""
    x = motions()[kind]
    v = np.gradient(x, DT)
    found = CompiledModel(code_of(name)).clamp({"x": x, "v": v}, {}, DT, parameters=SIZES[name], outputs=("f_h",))
    wanted = oracle(name, v)
    assert np.max(np.abs(found["f_h"] - wanted)) < 2.5e-5 * np.max(np.abs(wanted))


@pytest.mark.parametrize("name", STOPS)
def test_closed_form_and_located_events_agree(name: str) -> None:
    """Force, loss and mode: an event is located to 1e-11 of a step, which the loss multiplies by a sample's slip."""
    code = code_of(name)
    x = motions()["smooth"]
    v = np.gradient(x, DT)
    mode = "law.slips" if name == "Jenkins" else "law.element[3].slips"
    results = [
        model.clamp({"x": x, "v": v}, {}, DT, parameters=SIZES[name], outputs=("f_h", "law.loss", mode))
        for model in (CompiledModel(code), integrated(code))
    ]
    for output in ("f_h", "law.loss"):
        size = np.max(np.abs(results[1][output]))
        assert np.max(np.abs(results[0][output] - results[1][output])) < 1e-6 * size
    assert np.array_equal(results[0][mode], results[1][mode])


SLIDER = """
model Slider
  input Real v(unit = "m/s");
  parameter Real K(unit = "N/m") = 5e4;
  parameter Real c(unit = "N") = 20;
  parameter Real z0(unit = "N") = 0;
  output Real f(unit = "N");
protected
  Boolean slips;
  Real z(unit = "N", start = z0, fixed = true);
equation
  slips = (z >= c and v > 0) or (z <= -c and v < 0);
  der(z) = if slips then 0 else K*v;
  f = z;
end Slider;
"""


@pytest.fixture(scope="module")
def slider(tmp_path_factory: pytest.TempPathFactory) -> tuple[CompiledModel, CompiledModel]:
    path = tmp_path_factory.mktemp("slider") / "slider.mo"
    path.write_text(SLIDER)
    code = compile_model(f"{path}:Slider")
    return CompiledModel(code), integrated(code)


SPEEDS = st.lists(st.floats(-1, 1).filter(lambda v: v == 0 or abs(v) > 1e-6), min_size=3, max_size=30)


@given(start=st.floats(-40, 40), limit=st.floats(0, 40), speeds=SPEEDS)
def test_a_slider_of_ones_own_with_a_speed_from_outside(
    slider: tuple[CompiledModel, CompiledModel], start: float, limit: float, speeds: list[float]
) -> None:
    """Between its zeros a speed that is linear within a step leads a way of half its change times time. A force beyond
    its limit, where the start put it, rests while driven on and unloads from there. Rounding only: 1e-9 of 40 N."""
    z, wanted = start, [start]
    for before, after in pairwise(speeds):
        zero = before / (before - after) if before * after < 0 else 1.0
        for way in (0.5 * before * zero, 0.5 * after * (1 - zero)) if zero < 1 else (0.5 * (before + after),):
            if way > 0 and z < limit:
                z = min(z + 5e4 * way * DT, limit)
            elif way < 0 and z > -limit:
                z = max(z + 5e4 * way * DT, -limit)
        wanted.append(z)
    found = slider[0].clamp({}, {"v": np.array(speeds)}, DT, parameters={"c": limit, "z0": start}, outputs=("f",))["f"]
    assert np.max(np.abs(found - wanted)) < 4e-8


@given(limit=st.floats(-5, -1e-3), speeds=SPEEDS)
def test_a_negative_limit_has_no_closed_form(
    slider: tuple[CompiledModel, CompiledModel], limit: float, speeds: list[float]
) -> None:
    closed, events = (
        model.clamp({}, {"v": np.array(speeds)}, DT, parameters={"c": limit}, outputs=("f",))["f"] for model in slider
    )
    assert np.array_equal(closed, events)


def test_not_a_number_in_the_motion_is_refused() -> None:
    x = motions()["smooth"]
    v = np.gradient(x, DT)
    v[700] = np.nan
    with pytest.raises(UsageError, match="sample 700"):
        CompiledModel(code_of("Iwan")).clamp({"x": x, "v": v}, {}, DT, parameters=SIZES["Iwan"], outputs=("f_h",))


@pytest.mark.parametrize("name", ["Linear", "BoucWen", "BilinearStiffness"])
def test_other_laws_have_no_stops(name: str) -> None:
    assert "hy_stop" not in code_of(name).sources["model.c"]
