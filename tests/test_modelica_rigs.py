"""What rigs of mechanical and electrical parts ask of the compiler, each in a model of a few lines."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.interpolate import Akima1DInterpolator, PchipInterpolator
from scipy.optimize import brentq

from hystid.compiled import CompiledModel
from hystid.errors import ModelicaError
from hystid.modelica import compile_model

Run = Callable[..., Mapping[str, np.ndarray]]


@pytest.fixture
def run(tmp_path: Path) -> Run:
    """run(text, outputs, stop, dt): simulates class A of a text, without inputs."""

    def simulate(text: str, outputs: str, stop: float = 1.0, dt: float = 1e-3, **parameters: float):
        path = tmp_path / "A.mo"
        path.write_text(text)
        model = CompiledModel(compile_model(f"{path}:A"))
        rows = round(stop / dt) + 1
        return model.simulate({}, dt, rows=rows, outputs=outputs.split(), parameters=parameters)

    return simulate


def test_a_tie_through_a_power_is_differentiated_twice(run: Run) -> None:
    text = """
model A
  parameter Real n = 1.5;
  Real x(start = 1, fixed = true), w(start = 0.5, fixed = true), y, v, F;
equation
  der(x) = w; der(y) = v; y = x^n; der(w) = -x + F; der(v) = -F - y;
end A;"""

    def rates(_, s):
        x, w, n = *s, 1.5
        force = (-(x**n) - n * (n - 1) * x ** (n - 2) * w**2 + n * x**n) / (1 + n * x ** (n - 1))
        return [w, -x + force]

    got = run(text, "x y v w")
    t = np.arange(1001) * 1e-3
    x, w = solve_ivp(rates, (0, 1), [1, 0.5], rtol=1e-12, atol=1e-12, t_eval=t).y
    # Runge-Kutta of order four at 1 ms on a motion of 1 rad/s: (1e-3)^4, and rounding of the reference
    np.testing.assert_allclose(got["x"], x, atol=1e-10)
    np.testing.assert_allclose(got["v"], 1.5 * np.sqrt(x) * w, atol=1e-10)


# -- a library in a folder, of which only what is named is read


def write(folder: Path, **texts: str) -> None:
    for name, text in texts.items():
        path = folder / f"{name.replace('__', '/')}.mo"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)


SHOP = {
    "Shop__package": "package Shop import Shop.Kinds.Speed; constant Real two = 2; end Shop;",
    "Shop__Kinds": """within Shop;
package Kinds
  type Speed = Real(unit = "m/s");
end Kinds;""",
    "Shop__Parts__package": """within Shop;
package Parts
  extends Shop.Icons.Plain;
  model Deep
    model Spring Real f = 7; end Spring;
  end Deep;
end Parts;""",
    "Shop__Parts__Spring": """within Shop.Parts;
model Spring
  extends Base;
  Speed v(start = 1, fixed = true);
equation
  der(v) = -two*v;
end Spring;""",
    "Shop__Parts__Base": """within Shop.Parts;
partial model Base
  parameter Real k = 3 annotation(Dialog(group = "a;b"));
end Base;""",
    "Shop__Icons": "within Shop; package Icons partial package Plain end Plain; end Icons;",
    "Shop__Broken": "within Shop; model Broken this is not Modelica",
}


@pytest.fixture
def shop(tmp_path: Path) -> Path:
    """A library with names that mean different classes in different places, and with a file that is no Modelica."""
    write(tmp_path / "lib", **SHOP)
    return tmp_path / "lib"


def test_classes_are_found_by_dotted_name_and_scope(shop: Path, tmp_path: Path) -> None:
    write(tmp_path, Rig="model Rig import P = Shop.Parts; P.Spring a; P.Deep.Spring b; Real y = a.k*b.f; end Rig;")
    model = CompiledModel(compile_model(f"{tmp_path / 'Rig.mo'}:Rig", libraries=[shop]))
    got = model.simulate({}, 1e-3, rows=1001, outputs=["a.v", "y"])
    assert got["y"][-1] == 21  # the inner Spring's f, the outer one's inherited k
    assert got["a.v"][-1] == pytest.approx(np.exp(-2.0), rel=1e-10)  # the constant of the package around


def test_the_environment_names_folders_too(shop: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MODELICAPATH", f"{shop / 'nothing'}:{shop}")
    assert "k" in {v.name for v in compile_model("Shop.Parts.Spring").variables}


def test_a_package_folder_may_carry_its_version(shop: Path) -> None:
    (shop / "Shop").rename(shop / "Shop 1.2.0")
    assert compile_model("Shop.Parts.Spring", libraries=[shop]).states == ("v",)


def test_a_class_that_is_not_there_is_named(shop: Path) -> None:
    with pytest.raises(ModelicaError, match=r"no class 'Shop.Parts.Sprig'; did you mean 'Shop.Parts.Spring'"):
        compile_model("Shop.Parts.Sprig", libraries=[shop])


def test_a_fault_in_a_library_is_reported_at_its_line(shop: Path) -> None:
    bad = "within Shop.Parts;\nmodel Bad\n  Real y annotation(Icon(a = 1,\n b = 2));\n  Real x = nothing;\nend Bad;"
    write(shop, Shop__Parts__Bad=bad)
    with pytest.raises(ModelicaError, match=r"Bad\.mo:5.*nothing"):
        compile_model("Shop.Parts.Bad", libraries=[shop])


# -- what the text may say


def test_homotopy_means_its_actual_argument_by_name_or_place(run: Run) -> None:
    got = run("model A Real x = homotopy(simplified = 1, actual = 2*time); Real y = homotopy(x^2, x); end A;", "x y")
    np.testing.assert_array_equal(got["y"], got["x"] ** 2)
    assert got["x"][-1] == 2.0


def test_an_initial_algorithm_runs_in_order(run: Run) -> None:
    text = """
model A
  discrete Integer n; discrete Real t0; parameter Real w(fixed = false); parameter Real T = 0.3;
initial algorithm
  n := integer((time - 0.1)/T);
  t0 := 0.1 + n*T;
  w := 1;
  if T < 1 then
    for i in 1:3 loop w := w + i; end for;
  end if;
equation
  when time >= (pre(n) + 1)*T + 0.1 then
    n = pre(n) + 1; t0 = time;
  end when;
end A;"""
    got = run(text, "n t0 w")
    t = np.arange(1001) * 1e-3
    np.testing.assert_array_equal(got["n"], np.floor((t - 0.1) / 0.3 + 1e-9))
    assert got["w"][0] == 7  # 1 + 1 + 2 + 3
    assert got["t0"][-1] == (2 + 1) * 0.3 + 0.1  # the instant as the when-clause states it, to the last bit


def test_branches_of_an_if_equation_may_have_different_units(run: Run) -> None:
    text = """
model A
  Real i(unit = "A"), v(unit = "V"); parameter Real G(unit = "S") = 0.5, R(unit = "Ohm") = 1;
  Boolean off = time > 0.5, quenched = time > 0.7;
equation
  if off then
    if quenched then i = G*v; else v = 3*sign(i); end if;
  else
    v = 2*R*i;
  end if;
  v + R*i = 10;
end A;"""
    got = run(text, "i")
    assert [got["i"][k] for k in (100, 600, 900)] == pytest.approx([10 / 3, 7, 10 / 3])


def test_a_loop_through_sign_is_solved_and_not_taken_for_linear(run: Run) -> None:
    text = """
model A
  Real i, v, drive = (if time < 0.5 then 10 else -10) + cos(3*time);
equation
  v = 3*sign(i); v + i = drive;
end A;"""
    got = run(text, "i drive")
    np.testing.assert_allclose(got["i"], got["drive"] - 3 * np.sign(got["drive"]), atol=1e-12)


# -- tables, by the names that the Modelica Standard Library gives them

TABLES = {
    "Tab__package": "package Tab end Tab;",
    "Tab__Types": """within Tab;
package Types
  type Smoothness = enumeration(LinearSegments, ContinuousDerivative, ConstantSegments, MonotoneContinuousDerivative1,
    MonotoneContinuousDerivative2, ModifiedContinuousDerivative);
  type Extrapolation = enumeration(HoldLastPoint, LastTwoPoints, Periodic, NoExtrapolation);
  class ExternalCombiTable1D
    extends ExternalObject;
    function constructor
      input String tableName; input String fileName; input Real table[:, :]; input Integer columns[:];
      input Smoothness smoothness; input Extrapolation extrapolation = Extrapolation.LastTwoPoints;
      output ExternalCombiTable1D table1D;
    external "C" table1D = ModelicaStandardTables_CombiTable1D_init(tableName, fileName, table, columns);
    end constructor;
    function destructor
      input ExternalCombiTable1D table1D;
    external "C" ModelicaStandardTables_CombiTable1D_close(table1D);
    end destructor;
  end ExternalCombiTable1D;
end Types;""",
    "Tab__Tables": """within Tab;
package Tables
  package Internal
    function getTable1DValue
      input Tab.Types.ExternalCombiTable1D tableID; input Integer icol; input Real u; output Real y;
    external "C" y = ModelicaStandardTables_CombiTable1D_getValue(tableID, icol, u);
    end getTable1DValue;
  end Internal;
  model Table
    parameter Real table[:, :] = [0, 0; 0.2, 1; 0.5, 0.5; 0.7, 0.6; 1, 0];
    parameter Tab.Types.Smoothness smoothness = Tab.Types.Smoothness.LinearSegments;
    parameter Tab.Types.Extrapolation extrapolation = Tab.Types.Extrapolation.LastTwoPoints;
    final parameter Tab.Types.ExternalCombiTable1D tableID = Tab.Types.ExternalCombiTable1D(
      "NoName", "NoName", table, {2}, smoothness, extrapolation);
    final parameter Real first = Tables.Internal.getTable1DValue(tableID, 1, 0);
    Real u, y = Tables.Internal.getTable1DValue(tableID, 1, u);
  end Table;
end Tables;""",
}
X, Y = np.array([0, 0.2, 0.5, 0.7, 1]), np.array([0, 1, 0.5, 0.6, 0])


@pytest.fixture
def table(tmp_path: Path):
    """table(modifiers): y(u) for u from -0.5 to 1.5, and its derivative found by the printed C."""
    write(tmp_path, **TABLES)

    def looked_up(modifiers: str) -> tuple[np.ndarray, np.ndarray]:
        text = f"model A Tab.Tables.Table t({modifiers}); parameter Real a = 0; equation t.u = time - 0.5 + a; end A;"
        write(tmp_path, A=text)
        model = CompiledModel(compile_model(f"{tmp_path / 'A.mo'}:A", libraries=[tmp_path / "Tab"]))
        got = model.simulate({}, 0.02, rows=101, outputs=["t.u", "t.y"])
        return got["t.u"], got["t.y"]

    return looked_up


INSIDE = slice(26, 75)  # u between the first and the last point


@pytest.mark.parametrize(
    ("smoothness", "method"),
    [
        ("LinearSegments", lambda: lambda u: np.interp(u, X, Y)),
        ("ContinuousDerivative", lambda: Akima1DInterpolator(X, Y)),
        ("ModifiedContinuousDerivative", lambda: Akima1DInterpolator(X, Y, method="makima")),
    ],
)
def test_tables_interpolate_as_scipy_does(table, smoothness: str, method) -> None:
    u, y = table(f"smoothness = Tab.Types.Smoothness.{smoothness}")
    np.testing.assert_allclose(y[INSIDE], method()(u[INSIDE]), atol=1e-14)  # rounding
    slopes = np.diff(y)[[0, -1]] / np.diff(u)[[0, -1]]
    np.testing.assert_allclose(np.diff(y, 2)[[*range(0, 20), *range(80, 99)]], 0, atol=1e-14)  # straight outside
    assert slopes == pytest.approx([5, -2]) or smoothness != "LinearSegments"


def test_monotone_tables_never_overshoot_and_their_middle_is_pchip(table) -> None:
    u, y = table("smoothness = Tab.Types.Smoothness.MonotoneContinuousDerivative1")
    middle = (u > 0.2) & (u < 0.7)  # the ends are set by another rule than scipy's
    np.testing.assert_allclose(y[middle], PchipInterpolator(X, Y)(u[middle]), atol=1e-14)
    for kind in (1, 2):
        u, y = table(f"smoothness = Tab.Types.Smoothness.MonotoneContinuousDerivative{kind}")
        for a, b, low, high in zip(X[:-1], X[1:], np.minimum(Y[:-1], Y[1:]), np.maximum(Y[:-1], Y[1:]), strict=True):
            part = y[(u >= a) & (u <= b)]
            assert part.min() >= low - 1e-14 and part.max() <= high + 1e-14


def test_tables_hold_or_repeat_outside(table) -> None:
    u, y = table("extrapolation = Tab.Types.Extrapolation.HoldLastPoint")
    np.testing.assert_allclose(y, np.interp(u, X, Y), atol=1e-14)
    u, y = table("extrapolation = Tab.Types.Extrapolation.Periodic")
    np.testing.assert_allclose(y, np.interp(u % 1.0, X, Y), atol=1e-13)
    u, y = table("smoothness = Tab.Types.Smoothness.ConstantSegments")
    u = u + 1e-9  # samples at the points themselves belong to either side by rounding
    np.testing.assert_array_equal(y[INSIDE], Y[np.searchsorted(X, u[INSIDE], side="right") - 1])


def test_a_table_that_falls_back_is_refused(table) -> None:
    with pytest.raises(ModelicaError, match=r"Tables\.mo:\d+: this is no table: the first column falls"):
        table("table = [0, 1; 2, 2; 1, 3]")


def test_an_external_function_is_refused_where_it_is_called(run: Run) -> None:
    text = """
model A
  function f input Real x; output Real y; external "C" y = f(x); end f;
  Real y = f(time);
end A;"""
    with pytest.raises(ModelicaError, match=r"A\.mo:4: external function 'f' is not supported"):
        run(text, "y")


# -- friction that sticks

DRY = """
model A "A mass on a rough table, its friction as a machine of modes"
  parameter Real m = 1, f0 = 3, peak = 1.2, small = 1e-3;
  Real x(start = 0, fixed = true), v(start = 1, fixed = true), a, sa, f, F = 5*sin(2*time);
  Boolean forward(start = false, fixed = true), backward(start = false, fixed = true), locked(start = false);
  Integer mode(start = 3, fixed = true);
equation
  der(x) = v; der(v) = a; m*a = F - f;
  forward = pre(mode) == 0 and (sa > peak*f0 or pre(forward) and sa > f0) or pre(mode) == -1 and v > small
    or initial() and v > 0;
  backward = pre(mode) == 0 and (sa < -peak*f0 or pre(backward) and sa < -f0) or pre(mode) == 1 and v < -small
    or initial() and v < 0;
  locked = not (pre(mode) == 1 or forward or pre(mode) == -1 or backward);
  a = if locked then 0 else if forward or not backward and pre(mode) == 1 then sa - peak*f0 else sa + peak*f0;
  f = if locked then sa else if forward or not backward and pre(mode) == 1 then f0 else -f0;
  mode = if (pre(mode) == 1 or forward) and v > 0 then 1
    else if (pre(mode) == -1 or backward) and v < 0 then -1 else 0;
end A;"""


def dry_speed(t: np.ndarray, m: float) -> np.ndarray:
    """Speed of that mass, piece by piece in closed form; it starts at 1 m/s."""
    made, begin, v0, mode = np.zeros(len(t)), 0.0, 1.0, 1
    while begin < t[-1]:
        if mode:

            def speed(s, b=begin, v=v0, k=mode):
                return v + (-2.5 * (np.cos(2 * s) - np.cos(2 * b)) - 3 * k * (s - b)) / m

            looks = np.linspace(begin + 1e-6, t[-1], 200_001)
            turned = np.nonzero(speed(looks) * mode < 0)[0]
            end = brentq(speed, looks[turned[0] - 1], looks[turned[0]], xtol=1e-14) if len(turned) else t[-1]
            inside = (t >= begin) & (t <= end)
            made[inside] = speed(t[inside])
            drive = 5 * np.sin(2 * end)
            mode = int(np.sign(drive)) if abs(drive) > 3.6 else 0
        else:
            looks = np.linspace(begin, t[-1], 200_001)
            loose = np.nonzero(np.abs(5 * np.sin(2 * looks)) > 3.6)[0]
            if not len(loose):
                return made
            end = brentq(lambda s: abs(5 * np.sin(2 * s)) - 3.6, looks[loose[0] - 1], looks[loose[0]], xtol=1e-14)
            mode = int(np.sign(np.sin(2 * end)))
        begin, v0 = end, 0.0
    return made


@pytest.mark.parametrize("m", [1.0, 0.1, 0.02])
def test_a_mass_sticks_until_the_force_exceeds_the_peak(run: Run, caplog: pytest.LogCaptureFixture, m: float) -> None:
    """A light one would start forward, and once it does backward, where the modes are looked at all at once."""
    got = run(DRY, "v mode locked f", stop=6.0, m=m)
    t = np.arange(6001) * 1e-3
    # Runge-Kutta on a smooth force is exact to 1e-12; an event's place is 1e-11 of a step, times a jump of 8/m m/s2
    np.testing.assert_allclose(got["v"], dry_speed(t, m), atol=1e-9)
    assert got["locked"].sum() > 300
    assert not caplog.records  # no word of chattering


def test_functions_may_return_and_break_early(run: Run) -> None:
    text = """
function sgn
  input Real x;
  output Real y;
algorithm
  if x < 0 then
    y := -1;
    return;
  end if;
  if x > 0 then y := 1; return; end if;
  y := 0;
end sgn;
function upTo "Sum of the first elements below a limit"
  input Real x[:];
  input Real most;
  output Real s = 0;
algorithm
  for i in 1:size(x, 1) loop
    if s + x[i] > most then break; end if;
    s := s + x[i];
  end for;
end upTo;
model A
  Real a = sgn(time - 0.5), b = upTo({time, 1, 2}, 2.5);
end A;"""
    got = run(text, "a b", dt=0.125)
    t = np.arange(9) / 8
    np.testing.assert_array_equal(got["a"], np.sign(t - 0.5))
    np.testing.assert_array_equal(got["b"], t + 1)


def test_counters_of_a_loop_over_variables_stay_numbers(run: Run) -> None:
    """Insertion sort: which elements a round moves is known, whether it runs is not. Written out with counters that are
    expressions of all rounds before, this took minutes."""
    text = """
function sorted
  input Real v[:];
  output Real s[size(v, 1)] = v;
protected
  Integer j;
  Real held;
algorithm
  for i in 2:size(v, 1) loop
    held := s[i];
    j := i - 1;
    while j > 0 and s[max(j, 1)] > held loop
      s[j + 1] := s[j];
      j := j - 1;
    end while;
    s[j + 1] := held;
  end for;
end sorted;
model A
  Real v[5] = {sin((k + 2)*time + k) for k in 1:5};
  Real s[5] = sorted(v);
end A;"""
    names = [f"{name}[{k}]" for name in "vs" for k in range(1, 6)]
    got = run(text, " ".join(names), stop=6.0, dt=0.1)
    v, s = np.split(np.array([got[name] for name in names]), 2)
    np.testing.assert_array_equal(s, np.sort(v, axis=0))


def test_a_vector_may_be_read_at_a_place_that_changes(run: Run) -> None:
    text = """
model A
  Real x[3] = {time, 2*time, 3*time};
  Integer k = if time < 0.3 then 1 elseif time < 0.6 then 3 else 0;
  Real y = if k == 0 then -1 else x[k];
end A;"""
    got = run(text, "y", dt=0.25)["y"]
    np.testing.assert_array_equal(got, [0, 0.25, 1.5, -1, -1])


def test_pre_in_an_initial_equation_starts_a_discrete_variable(run: Run) -> None:
    text = """
model A
  parameter Boolean first = true;
  Boolean on;
  Real T(start = 1, fixed = true);
initial equation
  pre(on) = first;
equation
  on = pre(on) and T < 1.5 or T < 0.5;
  der(T) = if on then 1 else -1;
end A;"""
    got = run(text, "T", stop=0.25, dt=0.25)["T"]
    np.testing.assert_allclose(got, [1, 1.25], atol=1e-15)


def test_vector_parameters_that_depend_on_their_own_size_are_known(run: Run) -> None:
    text = """
model A
  parameter Real t[:] = {1, 2};
  parameter Integer n = size(t, 1);
  parameter Real w[:] = if n > 0 then {2.0*i for i in 1:n} else {0.0};
  Real y = w[2]*time;
end A;"""
    assert run(text, "y", dt=1.0)["y"][-1] == 4
