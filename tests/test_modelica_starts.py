"""Which of several solutions a loop takes: at the start, and where one ends."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from hystid.compiled import CompiledModel
from hystid.errors import NumericalError
from hystid.modelica import compile_model


@pytest.fixture
def run(tmp_path: Path):
    """run(text, outputs, dt, rows): simulates class A of a text, without inputs."""

    def simulate(text: str, outputs: str, dt: float = 0.1, rows: int = 2, **settings):
        path = tmp_path / "A.mo"
        path.write_text(text)
        model = CompiledModel(compile_model(f"{path}:A"))
        return model.simulate({}, dt, rows=rows, outputs=outputs.split(), **settings)

    return simulate


@pytest.mark.parametrize(("simplified", "root"), [("x + 1.2", -1.0), ("x - 1.2", 1.0), ("x - 0.1", 0.0)])
def test_homotopy_leads_to_the_solution_that_is_meant(run, simplified: str, root: float) -> None:
    text = f"model A Real x(start = 0.7); equation homotopy(x^3 - x, {simplified}) = 0; end A;"
    got = run(text, "x")["x"]
    # Newton's method stops at steps of 1e-12; and after the start the last value leads to the same solution
    np.testing.assert_allclose(got, root, atol=1e-9)


def test_homotopy_of_arguments_by_name_in_any_order_on_several_lines(run) -> None:
    text = """model A
  Real x(start = 0.7);
equation
  homotopy(
    simplified = x + 1.2,
    actual = x^3 - x) = 0;
end A;"""
    np.testing.assert_allclose(run(text, "x")["x"], -1, atol=1e-9)


def test_where_the_way_is_blocked_the_actual_equation_is_solved(run) -> None:
    text = "model A Real x(start = 0.7); equation homotopy(x^3 - x, x/(x - x)) = 0; end A;"
    np.testing.assert_allclose(run(text, "x")["x"], 1, atol=1e-9)


TRIGGER = """
model A "Schmitt trigger: y = 15 sat(1000 (u + y/3)), which has three answers while -5 < u < 5"
  parameter Real k = 1000;
  Real u = 8*sin(6.283185307179586*time), y, e;
equation
  e = u + y/3;
  y = 15*smooth(0, if k*e > 1 then 1 else if k*e < -1 then -1 else k*e);
end A;"""


def started(at: float) -> str:
    """The trigger with a start at +-15 among its three answers."""
    text = TRIGGER.replace("y = 15*smooth(0, ", f"y = homotopy(simplified = {at}, actual = 15*smooth(0, ")
    return text.replace("else k*e);", "else k*e));")


@pytest.mark.parametrize("start", [-15, 15])
def test_a_loop_with_three_answers_stays_on_one_until_that_ends(run, start: float) -> None:
    dt, rows = 1e-3, 2001
    got = run(started(start), "u y", dt, rows)
    u = 8 * np.sin(2 * np.pi * dt * np.arange(rows))
    np.testing.assert_allclose(got["u"], u, atol=1e-10)  # 50 V/s, and time is a sum
    # it switches where |u| passes 5 (but for 1/k), against the side it is on, and nowhere else
    wanted, side = np.empty(rows), start / 15
    for k in range(rows):
        side = 1.0 if u[k] > 5 else -1.0 if u[k] < -5 else side
        wanted[k] = 15 * side
    changed = np.flatnonzero(np.abs(got["y"] - wanted) > 1e-9)
    assert all(abs(abs(u[k]) - 5) < 8 * 2 * np.pi * dt for k in changed)  # one sample beside a switch
    assert len(changed) <= 4


def test_a_start_value_that_follows_from_parameters_says_which_root_is_meant(run) -> None:
    text = """model A
  parameter Real g = -0.9;
  parameter Real p(fixed = false, start = 1.1*g);
initial equation
  p^3 = p;
end A;"""
    np.testing.assert_allclose(run(text, "p")["p"], -1, atol=1e-9)  # the end of Newton's method
    np.testing.assert_allclose(run(text, "p", parameters={"g": 1.2})["p"], 1, atol=1e-9)


TWICE = """
model A "One current through two coils, each told where it starts"
  parameter Real first = 2;
  Real a, b;
initial equation
  a = first;
  b = 2;
equation
  a = b;
  der(a) = -a;
end A;"""


def test_initial_conditions_may_say_the_same_twice(run) -> None:
    np.testing.assert_allclose(run(TWICE, "b", rows=3)["b"], 2 * np.exp([0, -0.1, -0.2]), rtol=1e-6)  # one step of 0.1


def test_initial_conditions_that_do_not_fit_end_the_run(run) -> None:
    with pytest.raises(NumericalError, match=r"no answer|do not fit together"):
        run(TWICE, "b", parameters={"first": 3.0})


@pytest.mark.parametrize("start", ["true", "false"])
def test_the_start_of_a_mode_says_which_of_two_consistent_ones_is_meant(run, start: str) -> None:
    text = f"""model A
  Boolean up(start = {start}) = x > 0;
  Real x = if up then 1 + time else -1 - time;
end A;"""
    got = run(text, "x")["x"]
    np.testing.assert_array_equal(got, np.array([1, 1.1]) * (1 if start == "true" else -1))
