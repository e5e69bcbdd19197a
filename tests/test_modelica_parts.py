"""What parts of the standard library ask of the compiler beyond other models, each in a few lines."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
import pytest

from hystid.compiled import CompiledModel
from hystid.errors import ModelicaError, NumericalError
from hystid.modelica import compile_model

Run = Callable[..., Mapping[str, np.ndarray]]


@pytest.fixture
def run(tmp_path: Path) -> Run:
    """run(text, outputs, stop, dt): simulates class A of a text, without inputs."""

    def simulate(text: str, outputs: str, stop: float = 1.0, dt: float = 1e-2):
        path = tmp_path / "A.mo"
        path.write_text(text)
        return CompiledModel(compile_model(f"{path}:A")).simulate(
            {}, dt, rows=round(stop / dt) + 1, outputs=outputs.split()
        )

    return simulate


WALLS = """
connector Port Real T; flow Real Q; end Port;
model Wall
  Port p;
  parameter Real C = 2;
  Real T;
equation
  T = p.T; C*der(T) = p.Q;
end Wall;
model A
  Wall a(T(start = 300, fixed = true)), b(C = 3, T(start = %s, fixed = true));
equation
  connect(a.p, b.p);
  a.p.Q = 10*time;
end A;
"""


def test_two_fixed_start_values_of_one_temperature_may_agree(run: Run) -> None:
    text = WALLS.replace("a.p.Q = 10*time;", "").replace("connect(a.p, b.p);", "connect(a.p, b.p); connect(h.p, a.p);")
    text = text.replace("model A\n", "model Heat Port p; equation p.Q = -10*time; end Heat;\nmodel A\n  Heat h;\n")
    got = run(text % 300, "a.T b.T")
    t = np.arange(101) * 1e-2
    # the heat 5 t^2 goes into both; slopes are polynomials that Runge-Kutta of order four integrates exactly
    assert np.abs(got["a.T"] - (300 + 5 * t**2 / 5)).max() < 1e-9
    assert np.array_equal(got["a.T"], got["b.T"])
    with pytest.raises(ModelicaError, match=r"A\.mo:\d+: the states a\.T, b\.T .* do not fit together"):
        run(text % 301, "a.T")


BRAKES = """
connector Flange Real s; flow Real f; end Flange;
model Brake "holds up to its peak; Stuck, Forward and Backward are 0, 1 and -1"
  Flange a;
  parameter Real peak = 1;
  Real v, acc, sa, f;
  Boolean forward(start = false), backward(start = false), locked(start = false);
  Integer mode(start = 0, fixed = true);
equation
  v = der(a.s);
  acc = der(v);
  f = a.f;
  forward = pre(mode) == 0 and sa > peak;
  backward = pre(mode) == 0 and sa < -peak;
  locked = not (pre(mode) == 1 or forward or pre(mode) == -1 or backward);
  f = if locked then sa else if pre(mode) == 1 or forward then peak else -peak;
  acc = if locked then 0 else sa - f;
  mode = if (pre(mode) == 1 or forward) and v > 0 then 1 else if (pre(mode) == -1 or backward) and v < 0 then -1 else 0;
end Brake;
model Mass
  Flange a;
  parameter Real m = 2;
  Real s(start = 0, fixed = true), v(start = 0, fixed = true);
equation
  s = a.s; v = der(s); m*der(v) = a.f + 4*time;
end Mass;
model A
  Mass mass;
  Brake first, second(peak = 0.5);
equation
  connect(mass.a, first.a);
  connect(mass.a, second.a);
end A;
"""


def test_two_brakes_hold_one_mass_until_both_slip(run: Run, caplog: pytest.LogCaptureFixture) -> None:
    got = run(BRAKES, "mass.s mass.v")
    t = np.arange(101) * 1e-2
    slips = np.maximum(t - 1.5 / 4, 0)  # both are at their peaks: 1 N and 0.5 N
    # m dv/dt = 4 t - 1.5. How they share the force is open while both hold, so that one tries to start in every step;
    # slip may begin a step (0.01 s) late, which is told, and v then lacks that step's square
    assert np.abs(got["mass.v"] - slips**2).max() < 1e-4
    assert np.abs(got["mass.s"] - slips**3 / 3).max() < 1e-4
    assert np.array_equal(got["mass.v"] > 0, t > 0.375 + 1e-2)
    assert "accurate to first order" in caplog.text
    assert caplog.text.count("many solutions from t = 0 s") == 1


def test_what_two_brakes_cannot_hold_apart_stays_singular(run: Run, tmp_path: Path) -> None:
    text = """
model A
  Real x, y, u;
equation
  u = if time < 0.5 then 2 else 1;
  u*x + 3*y = 1;
  2*x + 3*y = time;
end A;"""
    # before 0.5 s both equations speak of the same sum, which cannot be 1 and time at once
    with pytest.raises(NumericalError, match="singular at t = 0 s"):
        run(text, "x")


SUPPORTED = """
connector Flange Real phi; flow Real tau; end Flange;
model Shaft
  Flange a, b;
  parameter Real J = 2;
  Real phi%s, w%s;
equation
  phi = a.phi; phi = b.phi; w = der(phi); J*der(w) = a.tau + b.tau;
end Shaft;
model Drag "on one flange, seen from a support"
  Flange a, support;
  parameter Real d = 0.3;
  Real phi, w, acc;
equation
  phi = a.phi - support.phi;
  w = der(phi); acc = der(w);
  a.tau = d*w;
  a.tau + support.tau = 0;
end Drag;
model Gear
  Flange a, b, support;
  Real phi_a, phi_b, w, acc;
equation
  phi_a = a.phi - support.phi; phi_b = b.phi - support.phi;
  phi_a = 3*phi_b;
  w = der(phi_a); acc = der(w);
  0 = b.tau + 3*a.tau;
  0 = a.tau + b.tau + support.tau;
end Gear;
model Fixed Flange f; equation f.phi = 0.2; end Fixed;
model A
  Shaft fast, slow(phi(start = 0.2, fixed = true), w(start = 1, fixed = true));
  Drag drag;
  Gear gear;
  Fixed fixed;
  Real power = gear.a.tau*der(gear.a.phi);
equation
  connect(fast.b, gear.a);
  connect(gear.b, slow.a);
  connect(drag.a, fast.a);
  connect(drag.support, fixed.f);
  connect(gear.support, fixed.f);
end A;
"""


def test_a_support_at_a_fixed_angle_leaves_each_tie_its_own(run: Run) -> None:
    got = run(SUPPORTED.replace("%s", ""), "slow.w fast.w drag.w")
    t = np.arange(101) * 1e-2
    w = np.exp(-9 * 0.3 / (2 + 9 * 2) * t)  # both inertias, and the drag of the fast shaft, as the slow one feels them
    assert np.abs(got["slow.w"] - w).max() < 1e-8  # steps of a thousandth of the decay, order four
    assert np.abs(got["fast.w"] - 3 * w).max() < 1e-8
    assert np.abs(got["drag.w"] - 3 * w).max() < 1e-8


def test_functions_of_one_name_stay_with_their_models(run: Run) -> None:
    text = """
model Two
  input Real u[2];
  output Real y;
protected
  function chosen input Real q[2]; input Real t; output Real z; algorithm z := q[1] + t; end chosen;
equation
  y = chosen(u, time);
end Two;
model Three
  input Real u[3];
  output Real y;
protected
  function chosen input Real q[3]; input Real t; output Real z; algorithm z := q[3] - t; end chosen;
equation
  y = chosen(u, time);
end Three;
model A
  Two two(u = {1, 2});
  Three three(u = {3, 4, 5});
end A;"""
    got = run(text, "two.y three.y")
    t = np.arange(101) * 1e-2
    assert np.abs(got["two.y"] - (1 + t)).max() < 1e-15  # rounding of one sum
    assert np.abs(got["three.y"] - (5 - t)).max() < 2e-15


def test_one_whole_number_may_go_to_elements_of_several_arrays(run: Run) -> None:
    text = """
connector In = input Integer;
connector Out = output Integer;
block Stairs Out y; equation y = integer(3*time); end Stairs;
block Sum
  parameter Integer n = 2;
  In u[n];
  Out y;
equation
  y = sum(u);
end Sum;
model A
  Stairs s;
  Sum twice, more(n = 3);
  Real y = more.y;
equation
  connect(s.y, twice.u[1]);
  connect(s.y, twice.u[2]);
  connect(twice.y, more.u[1]);
  connect(s.y, more.u[2]);
  connect(twice.y, more.u[3]);
end A;"""
    got = run(text, "y")["y"]
    t = np.arange(101) * 1e-2
    assert np.array_equal(got, 5 * np.floor(3 * t + 1e-9))  # a sample at the instant of a step sees it


def test_a_whole_number_looked_up_in_an_array_keeps_its_past(run: Run) -> None:
    text = """
model A
  Integer i = if time < 0.3 then 0 elseif time < 0.6 then 2 else 1;
  Integer values[2] = {4, 6};
  Integer y;
initial equation
  pre(y) = 9;
equation
  y = if i > 0 then values[i] else pre(y);
end A;"""
    got = run(text, "y")["y"]
    t = np.arange(101) * 1e-2 + 1e-9
    assert np.array_equal(got, np.select([t < 0.3, t < 0.6], [9, 6], 4))


def test_pre_may_be_stated_of_what_a_when_clause_assigns_at_the_start(run: Run) -> None:
    text = """
model A
  Boolean u = time > 0.25;
  discrete Real due, before;
  Boolean y = time >= due;
initial equation
  pre(due) = 7;
equation
  when {initial(), u} then
    before = pre(due);
    due = if initial() then 100 else time + 0.5;
  end when;
end A;"""
    got = run(text, "due before y")
    t = np.arange(101) * 1e-2 + 1e-9
    assert np.abs(got["due"] - np.where(t < 0.25, 100, 0.75)).max() < 1e-9  # the event is found to 1e-9 s
    assert np.array_equal(got["before"], np.where(t < 0.25, 7.0, 100.0))
    assert np.array_equal(got["y"] > 0.5, t > 0.75)


DELAYED = """
model A
  Real u, g, y(start = 0, fixed = true), e, seen;
equation
  when sample(0, 0.1) then
    seen = time;
  end when;
  when sample(0, 0.1) then
    y = pre(u);
  end when;
  e = seen - y;
  g = {g};
  u = g;
end A;"""


def test_a_unit_delay_takes_what_follows_from_samples_alone(run: Run) -> None:
    got = run(DELAYED.format(g="2*e"), "y u", stop=0.65, dt=0.05)
    y, u, expected = 0.0, 0.0, []
    for k in range(7):
        y, u = u, 2 * (0.1 * k - u)
        expected += [(y, u)] * 2
    np.testing.assert_allclose(np.array([got["y"], got["u"]]).T, expected, atol=1e-12)  # rounding


def test_a_unit_delay_of_what_runs_is_refused(run: Run) -> None:
    with pytest.raises(ModelicaError, match=r"pre\(u\) needs a discrete variable"):
        run(DELAYED.format(g="2*e + time"), "y")


OFFERS = """
model P parameter Real mu = 1; Real x = mu; end P;
model Q extends P; parameter Real k = 3; end Q;
model B replaceable model F = Q constrainedby P(mu = 15); F f; end B;
model C replaceable Q f(mu = 2) constrainedby P; end C;
model D replaceable model F = Q(mu = 4) constrainedby P(mu = 15); F f; end D;
model Kept extends B(redeclare model F = Q(k = 4)); end Kept;
model Own extends D(redeclare model F = P(mu = 5)); end Own;
model Inside extends D; redeclare model F = Q; end Inside;
model A
  B plain, b(redeclare model F = P);
  C asis, c(redeclare P f);
  D d;
  Kept kept;
  Own own;
  Inside inside;
end A;
"""


def test_a_constraining_clause_modifies_what_is_redeclared(run: Run) -> None:
    # Modelica 3.6, section 7.3.2: modifiers of the constraining clause go to each redeclaration that states none
    # itself, those of the default to the default alone
    wanted = {"plain": 15, "b": 15, "asis": 2, "c": 1, "d": 4, "kept": 15, "own": 5, "inside": 15}
    got = run(OFFERS, " ".join(f"{name}.f.x" for name in wanted), stop=0.01)
    assert {name: got[f"{name}.f.x"][0] for name in wanted} == wanted


def test_a_fault_is_told_in_the_file_of_the_library_and_not_in_a_copy(tmp_path: Path) -> None:
    shop = tmp_path / "lib" / "Shop" / "package.mo"
    shop.parent.mkdir(parents=True)
    shop.write_text(
        "package Shop\n  function n input Real a; output Integer k; algorithm k := integer(a); end n;\n"
        "  model Row\n    parameter Real a = 3.5;\n    parameter Integer k = n(a + sin(a));\n"
        "    Real buf[k] = fill(time, k);\n  end Row;\nend Shop;\n"
    )
    (tmp_path / "A.mo").write_text("model A\n  Shop.Row r;\nend A;\n")
    with pytest.raises(ModelicaError) as caught:
        compile_model(f"{tmp_path / 'A.mo'}:A", libraries=[tmp_path / "lib"])
    assert str(caught.value).startswith(f"{shop}:6: ")
