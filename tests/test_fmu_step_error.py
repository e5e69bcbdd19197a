"""A Co-Simulation FMU says where its steps are too long for the model; elsewhere it says nothing."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import fmpy
import numpy as np
import pytest

from hystid import build, simulate

RIG = """model Rig
  input Real F(unit = "N");
  parameter Real m(unit = "kg") = 1;
  parameter Real k(unit = "N/m") = 1e4;
  parameter Real c(unit = "N.s/m") = {damping};
  output Real x(unit = "m", start = 0, fixed = true);
  Real v(unit = "m/s", start = 0, fixed = true);
equation
  der(x) = v;
  m*der(v) = F - c*v - k*x;
  annotation(experiment(StopTime = 0.1, Interval = 1e-3));
end Rig;
"""


def stepped(fmu: Path, step: float, stop: float, capsys: pytest.CaptureFixture[str]) -> tuple[np.ndarray, list[str]]:
    """Rows of a run under a constant force, and the sentences on its steps that were logged."""
    force = np.array([(0.0, 10.0), (stop, 10.0)], dtype=[("time", "f8"), ("F", "f8")])
    # no logger of our own: FMPy's proxy for FMI 2 keeps the last one for the whole process, even after it is gone
    rows = fmpy.simulate_fmu(
        str(fmu), fmi_type="CoSimulation", stop_time=stop, step_size=step, output_interval=step, input=force,
        output=["x"],
    )  # fmt: skip
    return rows, [line for line in capsys.readouterr().out.splitlines() if "too long for this model" in line]


@pytest.mark.parametrize("fmi", [2, 3])
def test_steps_of_a_decay_that_is_slower_are_not_told(
    tmp_path: Path, fmi: Any, capsys: pytest.CaptureFixture[str]
) -> None:
    """A decay of 0.5 ms: steps of 0.1 ms are short enough."""
    (tmp_path / "rig.mo").write_text(RIG.format(damping=2e3))
    fmu = build(f"{tmp_path / 'rig.mo'}:Rig", tmp_path / "rig.fmu", fmi=fmi).path
    rows, said = stepped(fmu, 1e-4, 0.05, capsys)
    assert not said
    fast, slow = np.roots([1.0, 2e3, 1e4])
    exact = 1e-3 * (1 - (fast * np.exp(slow * 0.05) - slow * np.exp(fast * 0.05)) / (fast - slow))
    assert rows["x"][-1] == pytest.approx(exact, rel=1e-6)  # a method of order four, five steps in the fast decay


@pytest.mark.parametrize("fmi", [2, 3])
def test_steps_of_a_decay_that_is_faster_are_told_once(
    tmp_path: Path, fmi: Any, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "rig.mo").write_text(RIG.format(damping=3e4))
    fmu = build(f"{tmp_path / 'rig.mo'}:Rig", tmp_path / "rig.fmu", fmi=fmi).path
    rows, said = stepped(fmu, 1e-3, 0.03, capsys)
    assert len(said) == 1 and "smaller steps, or Model Exchange" in said[0]
    assert abs(rows["x"][-1]) > 1e3  # nonsense, as told


@pytest.mark.parametrize("model", ["Jenkins", "BoucWen", "Iwan", "Linear", "Dahl", "BilinearStiffness"])
def test_oscillators_of_the_library_are_sound_at_their_own_steps(
    tmp_path: Path, model: str, capsys: pytest.CaptureFixture[str]
) -> None:
    fmu = build(f"HystId.Oscillators.{model}", tmp_path / f"{model}.fmu").path
    assert not stepped(fmu, 1e-4, 0.5, capsys)[1]


def test_a_force_that_jumps_at_rest_without_an_event_is_told(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The law of PecorariSolodov as published: it comes to rest, and no step is short enough there."""
    fmu = build("HystId.Oscillators.PecorariSolodov", tmp_path / "published.fmu").path
    assert stepped(fmu, 1e-4, 0.5, capsys)[1]


def test_simulate_tells_it_as_well(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    (tmp_path / "rig.mo").write_text(RIG.format(damping=3e4))
    fmu = build(f"{tmp_path / 'rig.mo'}:Rig", tmp_path / "rig.fmu")
    simulate(fmu, "harmonic:20Hz@80N,0.03s", dt=1e-3)
    assert "too long for this model" in caplog.text
