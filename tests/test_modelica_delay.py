"""The operator ``delay``: against closed forms, with jumps, and in an FMU that is set back."""

from __future__ import annotations

from pathlib import Path

import fmpy
import numpy as np
import pytest
from fmpy.fmi2 import FMU2Slave

from hystid.compiled import CompiledModel
from hystid.errors import ModelicaError
from hystid.fmu.build import build
from hystid.modelica import compile_model

SINE = """
model A
  parameter Real T(unit="s") = 0.3;
  Real y = delay(sin(20*time), T);
  annotation(experiment(Interval=1e-3));
end A;
"""
JUMP = """
model A
  output Real x(start=0, fixed=true);
  output Real y = delay(if time >= 0.255 then 1 + time else 0, 0.37);
equation
  der(x) = y;
  annotation(experiment(Interval=1e-2));
end A;
"""
HISTORY = """
model A
  output Real x(start=1, fixed=true);
equation
  der(x) = -delay(x, 1);
  annotation(experiment(Interval=1e-2));
end A;
"""
VARYING = """
model A
  Real T(unit="s") = 0.2 + 0.1*sin(time);
  Real y = delay(sin(5*time), T, 0.5);
  annotation(experiment(Interval=1e-3));
end A;
"""
ECHO = """
model A "Each impulse comes back at half its size"
  output Real u = (if time >= 0.1 then 1 else 0) + 0.5*delay(u, 0.25);
  output Real x(start=0, fixed=true);
equation
  der(x) = u;
  annotation(experiment(Interval=1e-2));
end A;
"""


def code(tmp_path: Path, text: str):
    path = tmp_path / "A.mo"
    path.write_text(text)
    return compile_model(f"{path}:A")


def run(tmp_path: Path, text: str, dt: float, stop: float, name: str) -> tuple[np.ndarray, np.ndarray]:
    n = round(stop / dt) + 1
    return np.arange(n) * dt, CompiledModel(code(tmp_path, text)).simulate({}, dt, rows=n, outputs=[name])[name]


def after_a_jump(t: np.ndarray) -> np.ndarray:
    s = np.maximum(t - 0.625, 0.0)
    return 1.255 * s + s**2 / 2


def steps_of_history(t: np.ndarray) -> np.ndarray:
    """x' = -x(t - 1), x = 1 before 0: a polynomial of the next order in each second (method of steps)."""
    return sum((-1) ** k * np.where(t > k - 1, (t - k + 1) ** k, 0.0) / f for k, f in enumerate((1, 1, 2, 6)))


def test_a_sine_comes_later_and_is_its_first_value_before(tmp_path):
    t, y = run(tmp_path, SINE, 1e-3, 2.0, "y")
    # cubic between points 1e-3 apart: (20 * 1e-3)^4 * 3/128
    assert y == pytest.approx(np.where(t > 0.3, np.sin(20 * (t - 0.3)), 0.0), abs=4e-9)


@pytest.mark.parametrize("dt", [0.5, 0.02, 0.004])
def test_a_jump_comes_out_at_its_own_instant(tmp_path, dt):
    t, x = run(tmp_path, JUMP, dt, 2.0, "x")
    assert x == pytest.approx(
        after_a_jump(t), abs=1e-12
    )  # Runge-Kutta is exact for it, where no step goes over the jump


def test_a_delayed_differential_equation_follows_the_method_of_steps(tmp_path):
    off = []
    for dt in (0.1, 0.05):
        t, x = run(tmp_path, HISTORY, dt, 3.0, "x")
        off.append(abs(x - steps_of_history(t)).max())
    assert off[0] < 3e-5  # a cubic over the corner at t = 0
    assert off[1] < off[0] / 7  # of third order


def test_a_step_may_be_longer_than_the_delay(tmp_path):
    _, long = run(tmp_path, HISTORY, 1.5, 3.0, "x")
    assert long[-1] == pytest.approx(steps_of_history(np.array([3.0]))[0], abs=0.02)  # three points per second, no more


def test_the_delay_may_vary_below_its_limit(tmp_path):
    t, y = run(tmp_path, VARYING, 1e-3, 3.0, "y")
    ago = t - 0.2 - 0.1 * np.sin(t)
    assert y == pytest.approx(np.where(ago > 0, np.sin(5 * ago), 0.0), abs=1e-8)  # the corner at t = 0: (5e-3)^2 / 1e4


def test_echoes_of_echoes_are_located(tmp_path):
    t, x = run(tmp_path, ECHO, 0.1, 1.5, "x")
    expected = sum(0.5**k * np.maximum(t - 0.1 - 0.25 * k, 0.0) for k in range(6))
    assert x == pytest.approx(expected, abs=1e-12)  # straight between jumps


@pytest.mark.parametrize("kind", ["ModelExchange", "CoSimulation"])
def test_the_same_in_another_importer(tmp_path, kind):
    fmu = build(code(tmp_path, JUMP), tmp_path / "a.fmu").path
    got = fmpy.simulate_fmu(
        str(fmu), fmi_type=kind, stop_time=2.0, output_interval=0.02, relative_tolerance=1e-8, output=["x"]
    )
    # FMPy's solver with its tolerance over a jump: some of them; our step is exact
    assert got["x"] == pytest.approx(after_a_jump(got["time"]), abs=1e-6 if kind == "ModelExchange" else 1e-12)


def test_a_state_that_is_set_back_holds_the_past(tmp_path):
    fmu = build(code(tmp_path, HISTORY), tmp_path / "a.fmu").path
    about = fmpy.read_model_description(str(fmu))
    x = [v.valueReference for v in about.modelVariables if v.name == "x"]
    slave = FMU2Slave(
        guid=about.guid, unzipDirectory=fmpy.extract(str(fmu), tmp_path / "u"), instanceName="a",
        modelIdentifier=about.coSimulation.modelIdentifier,
    )  # fmt: skip
    slave.instantiate()

    def begin() -> None:
        slave.setupExperiment(startTime=0.0)
        slave.enterInitializationMode()
        slave.exitInitializationMode()

    def go(first: int, last: int) -> float:
        for k in range(first, last):
            slave.doStep(0.1 * k, 0.1)
        return float(slave.getReal(x)[0])

    begin()
    go(0, 15)
    kept = slave.serializeFMUState(slave.getFMUState())
    straight = go(15, 30)
    slave.setFMUState(slave.deserializeFMUState(kept))
    assert go(15, 30) == straight
    slave.reset()
    begin()
    assert go(0, 30) == straight
    slave.terminate()
    slave.freeInstance()


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            "model A\n  Real T = 1 + time;\n  Real y = delay(time, T, T);\nend A;",
            r"A\.mo:\d: delay\(\) delayMax argument must be a parameter",
        ),
        ("model A\n  Real y = delay(time, 0.0);\nend A;", r"A\.mo:2: .* delayTime must .* positive"),
        ("model A\n  Real y = delay(time, 1000.0);\nend A;", r"A\.mo:2: a delay by 1000 s in steps of .* Interval"),
    ],
)
def test_what_is_refused(tmp_path, text, message):
    with pytest.raises(ModelicaError, match=message):
        code(tmp_path, text)


def test_a_delay_longer_than_there_is_room_for_ends_the_run(tmp_path):
    model = CompiledModel(code(tmp_path, SINE))
    assert model.simulate({}, 1e-3, rows=3, outputs=["y"], parameters={"T": 0.2})["y"][-1] == 0
    with pytest.raises(Exception, match="longer than it was when the model was built"):
        model.simulate({}, 1e-3, rows=3, outputs=["y"], parameters={"T": 2.0})
