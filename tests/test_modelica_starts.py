"""Which of several solutions a loop takes: at the start, and where one ends."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import root

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


PARTS = """
package Parts
  connector Pin
    Real v(unit = "V");
    flow Real i(unit = "A");
  end Pin;
  partial model Two
    Pin p, n;
    Real v(unit = "V") = p.v - n.v;
  equation
    p.i + n.i = 0;
  end Two;
  model Ground
    Pin p;
  equation
    p.v = 0;
  end Ground;
  model Source
    extends Two;
    parameter Real V(unit = "V");
  equation
    v = V;
  end Source;
  model Resistor
    extends Two;
    parameter Real R(unit = "Ohm");
  equation
    v = R*p.i;
  end Resistor;
  model Diode
    extends Two;
  equation
    p.i = 1e-14*(exp(v/0.025) - 1);
  end Diode;
  model NPN "After Ebers and Moll"
    Pin c, b, e;
    Real f = 1e-16*(exp((b.v - e.v)/0.025) - 1), r = 1e-16*(exp((b.v - c.v)/0.025) - 1);
  equation
    c.i = f - 2*r;
    b.i = f/100 + r;
    c.i + b.i + e.i = 0;
  end NPN;
end Parts;
"""
# Two transistors that share the current of a mirror, a follower and two diodes behind it, between +15 V and -15 V.
# Part, its value, its nodes.
AMPLIFIER = {
    "VP": ("Source", 15, "p 0"), "VN": ("Source", 15, "0 n"), "VI": ("Source", 0.005, "b1 0"),
    "R1": ("Resistor", 1e4, "p c1"), "R2": ("Resistor", 1e4, "p c2"), "RM": ("Resistor", 1.4e4, "0 m"),
    "RB": ("Resistor", 1e3, "b2 0"), "RO": ("Resistor", 1e4, "o n"), "RX": ("Resistor", 5e3, "y 0"),
    "T1": ("NPN", None, "c1 b1 e"), "T2": ("NPN", None, "c2 b2 e"), "T3": ("NPN", None, "m m n"),
    "T4": ("NPN", None, "e m n"), "T5": ("NPN", None, "p c2 o"),
    "D1": ("Diode", None, "o x"), "D2": ("Diode", None, "x y"),
}  # fmt: skip


def circuit(parts) -> str:
    """Class A: the parts, connected to the node of the same name."""
    pins = {"NPN": "c b e"}
    lines, joined = [], {"0": ["ground.p"]}
    for name, (kind, value, nodes) in parts.items():
        modifier = f"({'V' if kind == 'Source' else 'R'} = {value})" if value else ""
        lines.append(f"  Parts.{kind} {name}{modifier};")
        for pin, node in zip(pins.get(kind, "p n").split(), nodes.split(), strict=True):
            joined.setdefault(node, []).append(f"{name}.{pin}")
    lines += ["  Parts.Ground ground;", *(f"  Real v_{node} = {ends[0]}.v;" for node, ends in joined.items())]
    lines += ["equation", *(f"  connect({ends[0]}, {other});" for ends in joined.values() for other in ends[1:])]
    return "\n".join([PARTS, "model A", *lines, "end A;"])


def operating_point(parts) -> dict[str, float]:
    """Voltage of each node: currents add up to zero in each, by scipy, the supplies turned up from zero by and by."""
    nodes = sorted({n for _, _, ends in parts.values() for n in ends.split()} - {"0"})
    sources = [p for p in parts.values() if p[0] == "Source"]

    def residual(z, share):
        v = {"0": 0.0} | dict(zip(nodes, z, strict=False))
        into = dict.fromkeys(v, 0.0)
        given = iter(z[len(nodes) :])
        stated = []
        for kind, value, ends in parts.values():
            at = ends.split()
            if kind == "NPN":
                f, r = (1e-16 * np.expm1(min((v[at[1]] - v[n]) / 0.025, 60)) for n in (at[2], at[0]))
                currents = [f - 2 * r, f / 100 + r, r - f * 1.01]
            else:
                drop = v[at[0]] - v[at[1]]
                i = drop / value if kind == "Resistor" else 1e-14 * np.expm1(min(drop / 0.025, 60))
                if kind == "Source":
                    i = next(given)
                    stated.append(drop - share * value)
                currents = [i, -i]
            for node, i in zip(at, currents, strict=True):
                into[node] += 1e3 * i
        return [into[n] for n in nodes] + stated

    z = np.zeros(len(nodes) + len(sources))
    for share in np.linspace(0, 1, 201)[1:]:
        found = root(residual, z, (share,), tol=1e-13)
        z = found.x if found.success else root(residual, z, (share,), method="lm", tol=1e-15).x
    assert np.abs(residual(z, 1)).max() < 1e-9  # mA and V
    return dict(zip(nodes, z, strict=False))


def test_the_operating_point_of_an_amplifier_between_two_supplies(run) -> None:
    """Newton's method alone finds none: with all nodes at 0 the mirror would carry 1e245 A."""
    wanted = operating_point(AMPLIFIER)
    got = run(circuit(AMPLIFIER), " ".join(f"v_{n}" for n in wanted))
    for node, v in wanted.items():
        np.testing.assert_allclose(got[f"v_{node}"], v, atol=1e-8)  # both end at steps of 1e-9 of a voltage or below


def test_a_circuit_without_an_operating_point_is_told(run) -> None:
    """50 V across two junctions of 25 mV: no number holds a current of 1e420 A."""
    parts = {"V": ("Source", 50, "p 0"), "D": ("Diode", None, "p n"), "E": ("Diode", None, "n 0")}
    with pytest.raises(NumericalError, match=r"no answer"):
        run(circuit(parts), "v_n")
