"""Modelica text through the compiler and the shell into another importer, FMI 2 and 3, both kinds of solver."""

from __future__ import annotations

from pathlib import Path

import fmpy
import numpy as np
import pytest
from fmpy.fmi1 import FMICallException
from scipy.linalg import expm

from hystid.fmu import build_model

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
