"""Modelica text through the compiler and the shell into another importer, FMI 2 and 3, both kinds of solver."""

from __future__ import annotations

import re
from pathlib import Path

import fmpy
import numpy as np
import pytest
from fmpy.fmi1 import FMICallException
from scipy.linalg import expm

from hystid.fmu import build_model
from hystid.fmu.continuous import Continuous
from hystid.fmu.door import open_fmu
from hystid.fmu.native import Instance

MODEL = Path(__file__).parent / "models" / "Assertions.mo"


@pytest.mark.parametrize("fmi", [2, 3])
@pytest.mark.parametrize("kind", ["CoSimulation", "ModelExchange"])
def test_an_assertion_of_level_error_stops_the_run(fmi, kind, tmp_path, capsys):
    fmu = build_model(f"{MODEL}:Assertions", tmp_path / "a.fmu", fmi=fmi).path
    ramp = np.array([(0.0, 0.0), (1.0, 2.0)], dtype=[("time", float), ("u", float)])
    # no logger of our own: FMPy's proxy for FMI 2 keeps the last one for the whole process, even after it is gone
    with pytest.raises(FMICallException):
        fmpy.simulate_fmu(str(fmu), fmi_type=kind, stop_time=1.0, output_interval=0.01, input=ramp)
    assert "u is far above its limit" in capsys.readouterr().out


@pytest.mark.parametrize("fmi", [2, 3])
@pytest.mark.parametrize("kind", ["CoSimulation", "ModelExchange"])
def test_masses_springs_and_a_sampled_filter(fmi, kind, tmp_path):
    fmu = build_model(f"{MODEL.with_name('FlangeChain.mo')}:FlangeChain.Chain", tmp_path / "c.fmu", fmi=fmi).path
    rows = fmpy.simulate_fmu(
        str(fmu), fmi_type=kind, stop_time=1.0, output_interval=0.01, relative_tolerance=1e-8, output=["x", "y"]
    )
    stiffness = np.array([[300.0, -200, 0], [-200, 500, -300], [0, -300, 300]]) / 2
    a = np.block([[np.zeros((3, 3)), np.eye(3)], [-stiffness, np.zeros((3, 3))]])
    x = (expm(a) @ [0.1, 0, 0, 0, 0, 0])[2]
    y = 0.0
    for n in range(11):
        y = 0.5 * y + np.sin(0.1 * n)
    # the importer's own solver (or our step, the fastest mode being 21 rad/s) is good to some 1e-5 of 0.1 m
    assert rows["x"][-1] == pytest.approx(x, abs=1e-5)
    assert rows["y"][-1] == pytest.approx(y, abs=1e-9)


@pytest.mark.parametrize("fmi", [2, 3])
@pytest.mark.parametrize("kind", ["CoSimulation", "ModelExchange"])
def test_events_of_inputs_that_jump(fmi, kind, tmp_path):
    (tmp_path / "m.mo").write_text("""
partial model Switched
  Modelica.Blocks.Interfaces.BooleanInput b(start = true);
end Switched;
model Counter
  extends Switched;
  input Integer k(start = 3);
  output Integer rises(start = 0, fixed = true), before(start = 0, fixed = true);
equation
  when edge(b) then
    rises = pre(rises) + 1;
  end when;
algorithm
  when change(k) then
    before := pre(k);
  end when;
end Counter;
""")
    fmu = build_model(f"{tmp_path}/m.mo:Counter", tmp_path / "m.fmu", fmi=fmi).path
    rows = [(0, True, 3), (0.32, False, 3), (0.52, True, 5), (0.72, False, 5), (0.82, True, 8), (1, True, 8)]
    driven = np.array(rows, dtype=[("time", float), ("b", bool), ("k", int)])
    found = fmpy.simulate_fmu(
        str(fmu), fmi_type=kind, stop_time=1.0, output_interval=0.05, input=driven, output=["rises", "before"]
    )
    at = {t: k for k, t in enumerate(np.round(found["time"], 9))}  # FMPy steps to inputs that jump, too
    wanted = {0.0: (0, 0), 0.5: (0, 0), 0.6: (1, 3), 0.8: (1, 3), 0.9: (2, 5), 1.0: (2, 5)}
    assert {t: (found["rises"][at[t]], found["before"][at[t]]) for t in wanted} == wanted


TRIGGER = """
model Oscillator "A Schmitt trigger of an amplifier with limits charges a capacitor and is switched by it"
  parameter Real gain = 1e4, limit = 15;
  Real d, out;
  output Real v(start = 8, fixed = true);
equation
  d = out/2 - v;
  out = noEvent(if gain*d > limit then limit elseif gain*d < -limit then -limit else gain*d);
  0.1*der(v) = out - v;
end Oscillator;
"""


def charged(times):
    """Voltage of the capacitor: exponentials towards -15 V and 15 V, from switch to switch at 7.4985 V."""
    side, since, at, found = -1.0, 0.0, 8.0, []
    for t in times:
        while t > (end := since + 0.1 * np.log((at - 15 * side) / (7.4985 * side - 15 * side))):
            side, since, at = -side, end, 7.4985 * side
        found.append(15 * side + (at - 15 * side) * np.exp((since - t) / 0.1))
    return np.array(found)


@pytest.mark.parametrize("fmi", [2, 3])
def test_a_limit_in_no_event_switches_when_it_is_reached(fmi, tmp_path):
    (tmp_path / "m.mo").write_text(TRIGGER)
    fmu = str(build_model(f"{tmp_path}/m.mo:Oscillator", tmp_path / "m.fmu", fmi=fmi).path)
    asked = {"stop_time": 0.9, "output_interval": 0.01, "output": ["v"], "record_events": False}
    # the errors of the steps between switches: of our own by order four, of CVode by its tolerance, over nine switches
    for kind, tolerance, most in [("CoSimulation", None, 1e-9), *(("ModelExchange", r, 200 * r) for r in (1e-4, 1e-8))]:
        rows = fmpy.simulate_fmu(fmu, fmi_type=kind, relative_tolerance=tolerance, **asked)
        np.testing.assert_allclose(rows["v"], charged(rows["time"]), rtol=0, atol=most, err_msg=f"{kind} {tolerance}")


@pytest.mark.parametrize("fmi", [2, 3])
def test_a_trial_step_beyond_a_limit_leaves_nothing(fmi, tmp_path):
    (tmp_path / "m.mo").write_text(TRIGGER)
    fmu = build_model(f"{tmp_path}/m.mo:Oscillator", tmp_path / "m.fmu", fmi=fmi).path
    model = open_fmu(fmu)
    with Instance(model, "ModelExchange") as instance:
        instance.initialise(0.0, ())
        importer = Continuous(instance, model)
        importer.begin()
        slopes = []
        for v in (-5.0, -7.0, -8.0, -20.0, -5.0, 20.0, -5.0):
            importer.x[:] = v
            importer.place(0.05)
            slopes.append(float(importer.slopes()[0]))
    assert slopes[0] == slopes[4] == slopes[6] == pytest.approx(-100, abs=1e-9)


@pytest.mark.parametrize("restitution", [0.7, 0.05])
@pytest.mark.parametrize("event_mode", [False, True])
def test_impacts_that_accumulate_end_the_run(restitution, event_mode, tmp_path, capsys):
    """Where flights become shorter than the first look behind an impact, the ball would fall through the floor."""
    fmu = build_model(f"{MODEL.with_name('BouncingBall.mo')}:BouncingBall", tmp_path / "b.fmu", fmi=3).path
    with pytest.raises(FMICallException):
        fmpy.simulate_fmu(
            str(fmu), fmi_type="CoSimulation", stop_time=4.0, output_interval=0.01, start_values={"e": restitution},
            use_event_mode=event_mode, early_return_allowed=event_mode,
        )  # fmt: skip
    found = re.search(r"Zeno: events accumulate at t = ([0-9.]+) s", capsys.readouterr().out)
    rest = np.sqrt(2 / 9.81) * (1 + 2 * restitution / (1 - restitution))  # a geometric series of free flights
    assert found and abs(float(found[1]) - rest) < 1e-3  # one step of the model
