"""Instants that are sums: a step reaches them to rounding only, and each must happen exactly once."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

import fmpy
import numpy as np
import pytest

from hystid.compiled import CompiledModel
from hystid.fmu import build_model
from hystid.modelica import compile_model

TEXT = """
model Sums "x grows until a + b; n counts how often that instant was met"
  parameter Real a = 0.1;
  parameter Real b = 0.05;
  Real x(start = 0, fixed = true);
  discrete Real at(start = -1, fixed = true);
  discrete Integer n(start = 0, fixed = true);
  Real y = if time < a + b then 1 else 0;
equation
  der(x) = y;
  when time >= a + b then
    n = pre(n) + 1;
    at = time;
  end when;
end Sums;
"""


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    made = tmp_path_factory.mktemp("sums") / "sums.mo"
    made.write_text(TEXT)
    return made


def test_thousands_of_sums_are_each_met_once(path: Path) -> None:
    model = CompiledModel(compile_model(f"{path}:Sums"))
    rng = np.random.default_rng(20)
    for k in range(4000):
        a, b = rng.uniform(0, 1, 2).round(2 if k % 2 else 17)
        dt = rng.choice([0.01, 0.05, 0.1, 1 / 3, 0.037])
        got = model.simulate({}, dt, rows=int(2.2 / dt) + 1, outputs=["x", "n", "at"], parameters={"a": a, "b": b})
        assert got["n"][-1] == 1, (a, b, dt)
        assert got["at"][-1] == a + b, (a, b, dt)  # the event's own instant, to the last bit
        assert abs(got["x"][-1] - (a + b)) < 1e-14 * 2.2 / dt + 1e-15, (a, b, dt)  # rounding of a sum of steps


@pytest.mark.parametrize("kind", ["CoSimulation", "ModelExchange"])
@pytest.mark.parametrize("version", [2, 3])
def test_sums_are_met_once_in_an_importer(path: Path, tmp_path: Path, kind: str, version: Literal[2, 3]) -> None:
    fmu = build_model(f"{path}:Sums", tmp_path / "sums.fmu", fmi=version).path
    for a, b in ((0.1, 0.05), (0.1, 0.2), (0.7, 0.1), (0.3, 0.6)):
        got = fmpy.simulate_fmu(
            str(fmu),
            fmi_type=kind,
            stop_time=1.0,
            output_interval=0.05,
            step_size=0.01,
            start_values={"a": a, "b": b},
            output=["x", "n"],
        )
        assert got["n"][-1] == 1
        # an importer's solver of its own keeps its own tolerance
        assert got["x"][-1] == pytest.approx(a + b, abs=1e-12 if kind == "CoSimulation" else 1e-4)


@pytest.mark.parametrize("version", [2, 3])
def test_instants_that_differ_by_rounding_are_one(tmp_path: Path, version: Literal[2, 3]) -> None:
    """0.06 s is 3*0.02 for one sampler and 0.01 + 0.05 for the other: CVode cannot step from one to the other."""
    (tmp_path / "rates.mo").write_text("""
model Rates
  discrete Real a(start = 0, fixed = true), b(start = 0, fixed = true);
  output Real y = a, z = b;
equation
  when sample(0, 0.02) then
    a = pre(a) + 1;
  end when;
  when sample(0.01, 0.05) then
    b = a;
  end when;
end Rates;""")
    fmu = build_model(f"{tmp_path}/rates.mo:Rates", tmp_path / "rates.fmu", fmi=version).path
    for kind in ("CoSimulation", "ModelExchange"):
        got = fmpy.simulate_fmu(str(fmu), fmi_type=kind, stop_time=0.2, output_interval=0.01, record_events=False)
        assert (got["y"][-1], got["z"][-1]) == (11, 9)  # b last at 0.16 s, after the ninth value of a
