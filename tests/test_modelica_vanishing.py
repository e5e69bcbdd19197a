"""Derivatives that a parameter of 0 takes away: what was a state follows from the other equations."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from hystid.compiled import CompiledModel
from hystid.modelcode import ModelCode
from hystid.modelica import compile_model

CIRCUIT = """
model Capacitor "As an element of a library"
  parameter Real C;
  Real v, i;
equation
  i = C*der(v);
end Capacitor;

model A "A source of 1 + sin(t) behind 2 ohm, and a capacitor"
  parameter Real C0 = 0{note};
  parameter Real offset = 0 annotation(Evaluate = true);
  Capacitor c(C = C0);
  Real v = c.v, i = c.i;
equation
  v + 2*i = 1 + sin(time) + offset;
end A;
"""

JUNCTION = """
model A "A junction whose charge of c0 exp(v) is none, and of Tau exp(v) neither, behind 1 ohm"
  parameter Real c0 = 0 annotation(Evaluate = true), Tau = 0 annotation(Evaluate = true);
  Real c = smooth(1, c0*exp(v)), total = smooth(1, Tau*exp(v)/2 + c), v(start = 0.5), i;
equation
  i = exp(v) - 1 + total*der(v);
  v + i = 1 + sin(time);
end A;
"""


@pytest.fixture
def compiled(tmp_path: Path):
    """compiled(text, name = value ...): class A of a text."""

    def make(text: str, **parameters: float) -> ModelCode:
        path = tmp_path / "A.mo"
        path.write_text(text)
        return compile_model(f"{path}:A", parameters=parameters)

    return make


def _variables(code: ModelCode) -> dict[str, tuple[str, str]]:
    return {v.name: (v.causality, v.variability) for v in code.variables}


def test_a_capacitance_of_0_that_may_be_evaluated_is_an_open_circuit(compiled) -> None:
    code = compiled(CIRCUIT.replace("{note}", " annotation(Evaluate = true)"))
    got = CompiledModel(code).simulate({}, 0.1, rows=20, outputs=["v", "i"])
    np.testing.assert_allclose(got["v"], 1 + np.sin(0.1 * np.arange(20)), rtol=1e-13)
    np.testing.assert_array_equal(got["i"], 0)
    found = _variables(code)
    assert found["C0"] == found["c.C"] == ("local", "constant")
    assert found["offset"] == ("parameter", "tunable")  # it takes no state away


def test_so_is_one_that_nobody_may_set(compiled) -> None:
    code = compiled(CIRCUIT.replace("{note}", "").replace("c(C = C0)", "c(final C = 0)"))
    got = CompiledModel(code).simulate({}, 0.1, rows=5, outputs=["v"])
    np.testing.assert_allclose(got["v"], 1 + np.sin(0.1 * np.arange(5)), rtol=1e-13)


def test_another_value_makes_it_a_state_again(compiled) -> None:
    code = compiled(CIRCUIT.replace("{note}", " annotation(Evaluate = true)"), C0=0.5)
    assert _variables(code)["C0"] == ("parameter", "tunable")
    got = CompiledModel(code).simulate({}, 1e-3, rows=1001, outputs=["v"])
    # v' + v = 1 + sin t from v = 0
    wanted = 1 - np.exp(-1) + (np.sin(1) - np.cos(1) + np.exp(-1)) / 2
    assert got["v"][-1] == pytest.approx(wanted, rel=1e-9)


def test_a_parameter_that_may_be_set_stays_one(compiled) -> None:
    assert _variables(compiled(CIRCUIT.replace("{note}", "")))["C0"] == ("parameter", "tunable")


def test_unknowns_that_are_0_by_it_take_derivatives_away_too(compiled) -> None:
    got = CompiledModel(compiled(JUNCTION)).simulate({}, 0.1, rows=20, outputs=["v", "i", "total"])
    t = 0.1 * np.arange(20)
    np.testing.assert_allclose(got["v"] + np.exp(got["v"]) - 1, 1 + np.sin(t), rtol=1e-11)
    np.testing.assert_array_equal(got["total"], 0)
    charged = CompiledModel(compiled(JUNCTION, Tau=2.0)).simulate({}, 1e-3, rows=3, outputs=["v", "total"])
    np.testing.assert_allclose(charged["total"], np.exp(charged["v"]), rtol=1e-13)
    assert charged["v"][0] == 0.5
