"""Instants and contacts that once ended a run: times that are sums, and a mass held between two preloaded contacts."""

from __future__ import annotations

from pathlib import Path

import fmpy
import numpy as np
import pytest
from scipy.optimize import brentq

from hystid.compiled import CompiledModel
from hystid.fmu.build import build
from hystid.modelica import compile_model

PAIRS = 40
_TERMS = "\n    + ".join(f"(if time < a{k} + b{k} then 1 else 0)" for k in range(PAIRS))
_PARAMETERS = ", ".join(f"a{k} = 0.1, b{k} = 0.05" for k in range(PAIRS))
SUMS = f"""
model A "Counts the pairs whose sum is still to come"
  parameter Real {_PARAMETERS};
  output Real y;
equation
  y = {_TERMS};
end A;
"""


def drawn(seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Pairs of round numbers: their sums are those that are rounded below what a clock of round steps shows."""
    rng = np.random.default_rng(seed)
    return rng.integers(0, 500, PAIRS) / 1000, rng.integers(0, 500, PAIRS) / rng.choice([1000.0, 700.0, 300.0], PAIRS)


def settings(seed: int) -> dict[str, float]:
    a, b = drawn(seed)
    return {f"{n}{k}": float(x) for n, values in (("a", a), ("b", b)) for k, x in enumerate(values)}


@pytest.fixture(scope="module")
def sums(tmp_path_factory: pytest.TempPathFactory):
    path = tmp_path_factory.mktemp("sums") / "A.mo"
    path.write_text(SUMS)
    return compile_model(f"{path}:A")


def counted(seed: int, t: np.ndarray) -> np.ndarray:
    a, b = drawn(seed)
    return (t[:, None] < (a + b)[None, :]).sum(1)


def test_events_at_sums_happen_once_at_their_instant(sums) -> None:
    model = CompiledModel(sums)
    t = np.arange(1001) * 2e-3
    away = slice(1, None)
    for seed in range(75):  # 3000 pairs
        got = model.simulate({}, 2e-3, rows=1001, outputs=["y"], parameters=settings(seed))["y"]
        late, early = counted(seed, t - 1e-12), counted(seed, t + 1e-12)  # the clock itself is a sum of round steps
        assert np.all((got[away] <= late[away]) & (got[away] >= early[away]))
        assert got[-1] == counted(seed, t[-1:])[0]


def test_the_same_in_model_exchange(sums, tmp_path: Path) -> None:
    fmu = build(sums, tmp_path / "sums.fmu").path
    got = fmpy.simulate_fmu(
        str(fmu), fmi_type="ModelExchange", solver="Euler", step_size=2e-3, stop_time=1.999, output=["y"],
        start_values=settings(7), relative_tolerance=1e-6,
    )  # fmt: skip
    a, b = drawn(7)
    assert got["time"][-1] == pytest.approx(1.999)
    assert got["y"][-1] == np.sum(a + b > 1.999)
    late, early = counted(7, got["time"] - 1e-12), counted(7, got["time"] + 1e-12)
    # a row before an event and one behind it: at the instant itself both values are right
    assert np.all((got["y"] <= late) & (got["y"] >= early))


HELD = """
model Contact
  parameter Real c = 1e6, n = 1.5, d = 50;
  Real s "Gap; below 0 it is closed";
  Real f "Pushes apart";
  Real v;
protected
  Boolean closed;
  Real fc, fd;
equation
  v = der(s);
  closed = s < 0;
  fc = if closed then c*abs(s)^n else 0;
  fd = if closed then -d*v else 0;
  f = if closed then (if noEvent(fc + fd <= 0) then 0 else fc + min(fd, fc)) else 0;
end Contact;
model A "A mass between two contacts, each closed by 1 mm at rest, and a force that opens one of them"
  parameter Real m = 1, F = 60;
  Real x(start = 0, fixed = true), v(start = 0, fixed = true);
  Contact left, right;
equation
  v = der(x);
  left.s = x - 1e-3;
  right.s = -x - 1e-3;
  m*der(v) = left.f - right.f + (if time < 0.2 then 20 else F);
end A;
"""


def test_a_mass_between_two_preloaded_contacts_comes_to_rest(tmp_path: Path) -> None:
    path = tmp_path / "A.mo"
    path.write_text(HELD)
    got = CompiledModel(compile_model(f"{path}:A")).simulate({}, 1e-4, rows=6001, outputs=["x", "left.f"])
    assert np.isfinite(got["x"]).all()

    def force(x: float) -> float:
        return 1e6 * (max(1e-3 + x, 0) ** 1.5 - max(1e-3 - x, 0) ** 1.5)

    rest = brentq(lambda x: force(x) - 20, 0, 1e-3)
    far = brentq(lambda x: force(x) - 60, 0, 1e-2)
    assert far < 1e-3 or got["left.f"][-1] == 0  # the force is below the preload, or opens the contact
    # contacts damp at 50 N.s/m and more: 0.2 s are five decay times of 1 kg at 2/50 s
    assert got["x"][1999] == pytest.approx(rest, abs=0.02 * rest)
    assert got["x"][-1] == pytest.approx(far, abs=0.02 * far)


GUARDED = """
model A "A mean from the begin on, which is 0/0 there; its guard is written in two ways"
  parameter Real begin = 0;
  Real a(start = 0, fixed = true), b = if time <= begin then 1 else a/(time - begin);
  output Real mean = if time > begin then a/(time - begin) else 1;
  output Real other = b;
  discrete output Real told(start = 0, fixed = true);
equation
  der(a) = 2;
  when time > begin then
    told = pre(told) + 1;
  end when;
end A;
"""


@pytest.mark.parametrize("begin", [0.0, -3.0, 12.5, 1e5])
def test_a_guard_against_the_begin_of_the_run_holds_there(tmp_path: Path, begin: float) -> None:
    path = tmp_path / "A.mo"
    path.write_text(GUARDED)
    model = CompiledModel(compile_model(f"{path}:A"))
    got = model.simulate(
        {}, 0.01, rows=5, start_time=begin, outputs=["mean", "other", "told"], parameters={"begin": begin}
    )
    # the clock itself is rounded: of 1e5 s it knows 1e-11 s
    np.testing.assert_allclose(got["mean"], [1, 2, 2, 2, 2], rtol=1e-8)
    np.testing.assert_allclose(got["other"], [1, 2, 2, 2, 2], rtol=1e-8)
    np.testing.assert_array_equal(got["told"], [0, 1, 1, 1, 1])


@pytest.mark.parametrize("how", ["CoSimulation", "CVode", "Euler"])
def test_it_holds_in_an_importer(tmp_path: Path, how: str) -> None:
    path = tmp_path / "A.mo"
    path.write_text(GUARDED)
    fmu = build(compile_model(f"{path}:A"), tmp_path / "A.fmu").path
    kind = "CoSimulation" if how == "CoSimulation" else "ModelExchange"
    got = fmpy.simulate_fmu(
        str(fmu), fmi_type=kind, solver="CVode" if kind == "CoSimulation" else how, stop_time=0.05, step_size=0.01,
        output_interval=0.01, output=["mean", "other", "told"],
    )  # fmt: skip
    assert got["mean"][0] == got["other"][0] == 1
    later = got["time"] > 1e-3
    np.testing.assert_allclose(got["mean"][later], 2, rtol=1e-6)
    np.testing.assert_allclose(got["other"][later], 2, rtol=1e-6)
    assert np.isfinite(got["mean"]).all()
    assert got["told"][-1] == 1
