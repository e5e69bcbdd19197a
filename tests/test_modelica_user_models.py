"""Models as a user writes them, through the FMU and FMPy, each against an answer found without the compiler.

Every one of them was once refused without need, or computed wrongly without a word.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

import fmpy
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from hystid.errors import ModelicaError
from hystid.fmu import build_model
from hystid.modelica import compile_model

Signals = Mapping[str, np.ndarray]
MODELS: dict[str, tuple[str, str, Callable[[np.ndarray], Signals]]] = {}


def user_model(name: str, text: str) -> Callable[[Callable[[np.ndarray], Signals]], Callable[[np.ndarray], Signals]]:
    """Registers a text and the function that gives its answer at the times of communication."""

    def add(answer: Callable[[np.ndarray], Signals]) -> Callable[[np.ndarray], Signals]:
        MODELS[name] = (name, text, answer)
        return answer

    return add


def integrated(rates: Callable[[float, np.ndarray], object], start: list[float], t: np.ndarray) -> np.ndarray:
    return solve_ivp(rates, (0, t[-1]), start, method="DOP853", rtol=1e-12, atol=1e-13, t_eval=t).y


@user_model(
    "derivatives of a matrix in nested loops",
    """
model A
  parameter Integer nx = 4, ny = 3;
  Real T[nx, ny](each start = 0, each fixed = true);
equation
  for i in 1:nx, j in 1:ny loop
    der(T[i, j]) = 2*((if i > 1 then T[i - 1, j] else 1) - T[i, j] + (if i < nx then T[i + 1, j] - T[i, j] else 0)
      + (if j > 1 then T[i, j - 1] - T[i, j] else 0) + (if j < ny then T[i, j + 1] - T[i, j] else 0));
  end for;
end A;""",
)
def heat(t):
    def rates(_, s):
        T = s.reshape(4, 3)
        d = np.zeros((4, 3))
        d[1:] += T[:-1] - T[1:]
        d[0] += 1 - T[0]
        d[:-1] += T[1:] - T[:-1]
        d[:, 1:] += T[:, :-1] - T[:, 1:]
        d[:, :-1] += T[:, 1:] - T[:, :-1]
        return 2 * d.ravel()

    y = integrated(rates, [0.0] * 12, t)
    return {"T[1,1]": y[0], "T[2,3]": y[5], "T[4,3]": y[11]}


@user_model(
    "derivatives of components in a loop",
    """
model Body
  Real x(start = 1, fixed = true);
  Real v(start = 0, fixed = true);
  Real f;
  parameter Real m = 1;
end Body;
model A
  parameter Integer n = 3;
  Body b[n](m = {1, 2, 3});
  parameter Real k[n] = {10, 20, 30};
equation
  for i in 1:n loop
    der(b[i].x) = b[i].v;
    b[i].m*der(b[i].v) = b[i].f;
    b[i].f = -k[i]*b[i].x + (if i < n then k[i + 1]*(b[i + 1].x - b[i].x) else 0);
  end for;
end A;""",
)
def bodies(t):
    def rates(_, y):
        x = y[:3]
        a = [-10 * x[0] + 20 * (x[1] - x[0]), (-20 * x[1] + 30 * (x[2] - x[1])) / 2, -10 * x[2]]
        return [*y[3:], *a]

    y = integrated(rates, [1, 1, 1, 0, 0, 0], t)
    return {"b[1].x": y[0], "b[3].v": y[5]}


@user_model(
    "gear between inertias",
    """
package R
  connector Flange Real phi(unit = "rad"); flow Real tau(unit = "N.m"); end Flange;
  model Inertia
    Flange a, b;
    parameter Real J(unit = "kg.m2") = 1;
    Real phi(unit = "rad"), w(unit = "rad/s"), acc(unit = "rad/s2");
  equation
    phi = a.phi; phi = b.phi; w = der(phi); acc = der(w); J*acc = a.tau + b.tau;
  end Inertia;
  model Gear Flange a, b; parameter Real r = 2; equation a.phi = r*b.phi; 0 = r*a.tau + b.tau; end Gear;
  model Torque Flange f; input Real t(unit = "N.m"); equation f.tau = -t; end Torque;
end R;
model A
  R.Torque src(t = 10*sin(5*time));
  R.Inertia j1(J = 0.5);
  R.Gear g(r = 3);
  R.Inertia j2(J = 2, phi(start = 0, fixed = true), w(start = 0, fixed = true));
equation
  connect(src.f, j1.a); connect(j1.b, g.a); connect(g.b, j2.a);
end A;""",
)
def gear(t):
    w = 30 / 6.5 * (1 - np.cos(5 * t)) / 5
    return {"j2.w": w, "j1.w": 3 * w, "j2.phi": 30 / 6.5 * (t / 5 - np.sin(5 * t) / 25)}


@user_model(
    "two sampling rates that read each other",
    """
model A
  Real x(start = 0, fixed = true);
  discrete Real u(start = 0, fixed = true), y(start = 0, fixed = true);
  Real shown = u "a copy of a discrete variable";
equation
  der(x) = -x + u;
  when sample(0, 0.1) then
    y = x;
  end when;
  when sample(0, 0.2) then
    u = pre(u) + 0.5*(1 - y);
  end when;
end A;""",
)
def rates_of_sampling(t):
    x, u, last, ticks = 0.0, 0.0, 0.0, 0
    xs, us = [], []
    for now in t:
        while ticks * 0.1 <= now + 1e-9:
            x = u + (x - u) * math.exp(last - ticks * 0.1)
            last = ticks * 0.1
            u += 0.5 * (1 - x) if ticks % 2 == 0 else 0
            ticks += 1
        xs.append(u + (x - u) * math.exp(last - now))
        us.append(u)
    return {"x": np.array(xs), "shown": np.array(us)}


@user_model(
    "functions with loops in branches, while, and a sort",
    """
function table "linear between points"
  input Real x;
  input Real xs[:];
  input Real ys[size(xs, 1)];
  output Real y;
algorithm
  if x <= xs[1] then
    y := ys[1];
  elseif x >= xs[end] then
    y := ys[end];
  else // inside
    y := ys[1];
    for i in 1:size(xs, 1) - 1 loop
      if x >= xs[i] and x < xs[i + 1] then
        y := ys[i] + (ys[i + 1] - ys[i])*(x - xs[i])/(xs[i + 1] - xs[i]);
      end if;
    end for;
  end if;
end table;
function series
  input Real x;
  output Real y;
protected
  Integer k = 1;
  Real term = 1;
algorithm
  y := 1;
  while k <= 12 loop
    term := term*x/k;
    y := y + term;
    k := k + 1;
  end while;
end series;
function sorted
  input Real u[6];
  output Real y[6] = u;
protected
  Real kept;
algorithm
  for i in 1:5 loop
    for j in 1:6 - i loop
      if y[j] > y[j + 1] then
        kept := y[j];
        y[j] := y[j + 1];
        y[j + 1] := kept;
      end if;
    end for;
  end for;
end sorted;
function root "x^3 + x = u by Newton's method"
  input Real u;
  output Real x = 1;
algorithm
  for i in 1:30 loop
    x := x - (x^3 + x - u)/(3*x^2 + 1);
  end for;
end root;
function parts
  input Real u;
  output Real whole;
  output Real rest;
algorithm
  whole := floor(u);
  rest := u - whole;
end parts;
function both
  input Real u;
  output Real y;
protected
  Real a, b;
algorithm
  (a, b) := parts(u);
  y := a - b;
end both;
model A
  parameter Real tx[4] = {0, 0.3, 0.7, 0.9};
  parameter Real ty[4] = {0, 2, -1, 0.5};
  Real u = table(time, tx, ty);
  Real e = series(time);
  Real s[6] = sorted({sin(k*time) for k in 1:6});
  Real r = root(time), w = parts(3*time), d = both(3*time);
  Real q(start = 0, fixed = true);
equation
  der(q) = e;
end A;""",
)
def functions(t):
    rows = np.sort(np.sin(np.outer(np.arange(1, 7), t)), axis=0)
    return {
        "u": np.interp(t, [0, 0.3, 0.7, 0.9], [0, 2, -1, 0.5]),
        "e": np.exp(t),
        "s[1]": rows[0],
        "s[4]": rows[3],
        "r": np.array([brentq(lambda x, u=u: x**3 + x - u, -2, 2, xtol=1e-15) for u in t]),
        "w": np.floor(3 * t),
        "d": np.floor(3 * t) - np.mod(3 * t, 1),
        "q": np.exp(t) - 1,
    }


@user_model(
    "records, texts, names in quotes",
    """
record Law
  parameter Real k(unit = "N/m", min = 0) = 1;
  parameter Real d = 0.1;
end Law;
package Data
  constant Law steel(k = 4, d = 0.2);
end Data;
function force
  input Law law;
  input Real x;
  input Real v;
  output Real f;
algorithm
  f := law.k*x + law.d*v;
end force;
model Mass
  parameter Law law;
  parameter String name = "mass";
  Real x(start = 1, fixed = true);
  Real 'v of it'(start = 0, fixed = true);
equation
  der(x) = 'v of it';
  der('v of it') = -force(law, x, 'v of it');
  assert(x < 5, name + " is at " + String(x));
end Mass;
model A
  parameter Law mine = Data.steel;
  Mass m(law = mine, name = "the one");
end A;""",
)
def records(t):
    return {"m.x": integrated(lambda _, y: [y[1], -4 * y[0] - 0.2 * y[1]], [1, 0], t)[0]}


@user_model(
    "start values and limits through two levels",
    """
model Mass
  parameter Real m(min = 0, max = 10) = 1;
  Real s(start = 0), v(start = 0, fixed = true);
equation
  der(s) = v;
  m*der(v) = -4*s;
end Mass;
model Rig
  Mass a(m(min = 0.1) = 2, s(start = 0.3, fixed = true));
end Rig;
model A
  extends Rig(a(m(max = 5), s(start = 0.2)));
end A;""",
)
def limits(t):
    return {"a.s": 0.2 * np.cos(np.sqrt(2) * t), "a.m": np.full_like(t, 2.0)}


@user_model(
    "initial equations for parameters and rates",
    """
model A
  parameter Real a(fixed = false, start = 1), b = 2*a, c(fixed = false, start = 1);
  Real x(start = 1), y(start = 1);
initial equation
  a^3 + a = 10;
  c + b = sin(c) + 5;
  x = b;
  der(y) = 0;
equation
  der(x) = -a*x;
  der(y) = x - y^3;
end A;""",
)
def at_rest(t):
    c = brentq(lambda c: c + 4 - math.sin(c) - 5, -5, 5, xtol=1e-15)
    y = integrated(lambda _, s: [-2 * s[0], s[0] - s[1] ** 3], [4, 4 ** (1 / 3)], t)
    return {"a": np.full_like(t, 2.0), "c": np.full_like(t, c), "x": y[0], "y": y[1]}


@user_model(
    "pendulum in x and y from rest, and a lever",
    """
model Pendulum
  Real x(start = 0.6), y(start = -0.8), vx, vy, lam;
initial equation
  x = 0.6;
  vx = 0;
equation
  der(x) = vx;
  der(y) = vy;
  der(vx) = -lam*x;
  der(vy) = -lam*y - 9.81;
  x^2 + y^2 = 1;
end Pendulum;
model Lever
  Real a(start = 0.1), va, b, vb, F;
initial equation
  va = 0;
equation
  der(a) = va;
  der(b) = vb;
  der(va) = -50*a - F;
  2*der(vb) = 2*F - 9.81;
  a = 2*b;
end Lever;
model A
  Pendulum p;
  Lever l;
end A;""",
)
def tied(t):
    phi = integrated(lambda _, s: [s[1], -9.81 * math.sin(s[0])], [math.atan2(0.6, 0.8), 0], t)[0]
    rest = -9.81 / 100
    return {"p.x": np.sin(phi), "l.a": rest + (0.1 - rest) * np.cos(np.sqrt(50 / 1.5) * t)}


@user_model(
    "packages with redeclared functions and constants",
    """
package Base
  constant Real g = 2;
  replaceable function f
    input Real x;
    output Real y;
  algorithm
    y := x;
  end f;
end Base;
function cube
  input Real x;
  output Real y;
algorithm
  y := x^3;
end cube;
package Mine
  extends Base(redeclare function f = cube, g = 5);
end Mine;
model Sub
  replaceable package P = Base;
  Real z = P.f(time)*P.g;
end Sub;
model A
  Sub b(redeclare package P = Mine);
  Real y = Base.f(time)*Base.g;
end A;""",
)
def packages(t):
    return {"y": 2 * t, "b.z": 5 * t**3}


@pytest.mark.parametrize("name", MODELS)
def test_user_model_in_fmpy(name, tmp_path):
    _, text, answer = MODELS[name]
    file = tmp_path / "rig.mo"
    file.write_text(text)
    fmi = 2 + list(MODELS).index(name) % 2
    fmu = build_model(f"{file}:A", tmp_path / "a.fmu", fmi=fmi).path
    wanted = list(answer(np.array([0.0, 1.0])))
    rows = fmpy.simulate_fmu(
        str(fmu), fmi_type="CoSimulation", stop_time=0.95, output_interval=0.01, output=wanted, step_size=1e-3
    )
    expected = answer(rows["time"])
    # at a jump itself both sides are right; 0.01 from it nothing is left of that
    clear = np.min(np.abs(np.subtract.outer(rows["time"], [1 / 3, 2 / 3, *np.arange(10) / 10])), axis=1) > 1e-6
    for signal in wanted:
        # Runge-Kutta of order four in steps of 1 ms on rates below 15/s leaves (0.015)^4 = 5e-8 of signals near 1
        np.testing.assert_allclose(rows[signal][clear], expected[signal][clear], atol=1e-7, err_msg=signal)


LAWS = """
type Force = Real(final unit = "N", min = 0, max = 100);
model P
  parameter Real m(min = 0, max = 10) = 1;
  parameter Force F = 5;
  Real y = m*F*time;
end P;
model Q extends P(m(max = 5)); end Q;
model R extends Q(m(min = 0.5) = 2); end R;
"""

# name: declarations behind LAWS, the parameter, (min, max, value)
LIMITS = {
    "two levels of extends": ("model A extends R; end A;", "m", (0.5, 5, 2)),
    "value at the top": ("model S extends R(m(min = 0.2)); end S; model A extends S(m = 3); end A;", "m", (0.2, 5, 3)),
    "component": ("model A R p(m(max = 4)); end A;", "p.m", (0.5, 4, 2)),
    "component of a component": ("model B P p(m(max = 6) = 3); end B; model A B b(p(m(min = 1))); end A;", "b.p.m",
                                 (1, 6, 3)),
    "value in a base, limit in extends": ("model B P p(m = 3); end B; model A extends B(p(m(max = 6))); end A;", "p.m",
                                          (0, 6, 3)),
    "limit in a base, value in extends": ("model B P p(m(max = 6)); end B; model A extends B(p(m = 3)); end A;", "p.m",
                                          (0, 6, 3)),
    "limit in a base, value in a short class": ("model B P p(m(max = 6)); end B; model C = B(p(m = 3)); model A C c;"
                                                " end A;", "c.p.m", (0, 6, 3)),
    "each": ("model B P p[2](each m = 4); end B; model A extends B(p(each m(max = 8))); end A;", "p[2].m", (0, 8, 4)),
    "rows": ("model B P p[2](each m(max = 8)); end B; model A extends B(p(m = {4, 5})); end A;", "p[2].m", (0, 8, 5)),
    "redeclared": ("model B replaceable P p(m = 3); end B; model A extends B(redeclare Q p); end A;", "p.m", (0, 5, 3)),
    "alias of a type": ("type Pull = Force(min = 2); model A parameter Pull F = 3; Real y = F; end A;", "F",
                        (2, 100, 3)),
    "final": ("model B extends P(final m = 2); end B; model A extends B; end A;", "m", (0, 10, 2)),
}  # fmt: skip


@pytest.mark.parametrize("name", LIMITS)
def test_limits_and_values_meet_from_several_places(name, tmp_path):
    text, parameter, expected = LIMITS[name]
    file = tmp_path / "rig.mo"
    file.write_text(LAWS + text)
    found = compile_model(f"{file}:A").variable(parameter)
    assert (found.min, found.max, found.start) == expected


UNITS = """
function g
  input Real a(unit = "m");
  input Real b(unit = "N");
  output Real y(unit = "J");
algorithm
  y := a*b;
end g;
model A
  parameter Real m(unit = "kg") = 1, k(unit = "N/m") = 2, L(unit = "m") = 1, T(unit = "s") = 1, n = 2;
  parameter Real ph(unit = "rad") = 1, w(unit = "rad/s") = 3, f(unit = "Hz") = 2;
  Real x(unit = "m", start = 1, fixed = true), v(unit = "m/s", start = 0, fixed = true);
  Real y(unit = "{unit}");
  Real z[2](each unit = "{unit}");
equation
  der(x) = v; m*der(v) = -k*x;
  y = {value};
  z = {{0, 0}};
end A;
"""
WRONG = {
    "x + k*x": ("m", "adds m and kg.m.s-2"),
    "der(x)": ("m", "equates m and m.s-1"),
    "g(v, k*x)": ("J", "a value in m/s to 'a' in m"),
    "g(x, k*x)": ("N", "equates N and kg.m2.s-2"),
    "sin(x)": ("1", "plain number as argument, 'x' has m"),
    "exp(-T)": ("1", "'-T' has s"),
    "2^x": ("1", "plain number as exponent, 'x' has m"),
    "x^2": ("m", "equates m and m2"),
    "if time > 1 then x else v": ("m", "compares m and m/s"),
    "mod(x, T)": ("m", "compares m and s"),
    "sum({x, v})": ("m", "compares m and m/s"),
    "sqrt(x*v)": ("m", "equates m and"),
}
RIGHT = {
    "1000*x*n + 3": "N", "ph": "1", "x/L": "rad", "w": "1/s", "f": "Hz", "2*f": "1/s", "k*x*x": "N.m", "k*x*v": "W",
    "sqrt(k/m)": "rad/s", "(k/m)^0.5": "1/s", "(x/L)^n": "1", "k*x^n": "N", "noEvent(if x > 0 then x else 0)": "m",
    "L*sin(w*time + ph) + L*cos(6.28*f*time)": "m", "exp(-time/T)*tanh(x/L)": "1", "g(1, 2)": "J", "1000*x": "mm",
    "k": "kg/s2", "atan2(x, L)": "rad", "min(x, 0.1)": "m", "ph*180/3.14159": "deg",
}  # fmt: skip


@pytest.mark.parametrize("value", WRONG)
def test_wrong_units_are_named_with_their_line(value, tmp_path):
    unit, words = WRONG[value]
    file = tmp_path / "rig.mo"
    file.write_text(UNITS.format(unit=unit, value=value))
    with pytest.raises(ModelicaError) as caught:
        compile_model(f"{file}:A")
    assert str(caught.value).startswith(f"{file}:17: units do not fit: ") and words in str(caught.value)


def test_right_units_pass(tmp_path):
    declared = "".join(f'  Real y{k}(unit = "{unit}");\n' for k, unit in enumerate(RIGHT.values()))
    equations = "".join(f"  y{k} = {value};\n" for k, value in enumerate(RIGHT))
    text = UNITS.format(unit="m", value="x").replace("equation\n", f"{declared}equation\n{equations}")
    file = tmp_path / "rig.mo"
    file.write_text(text)
    made = compile_model(f"{file}:A")
    assert [made.variable(f"y{k}").unit for k in range(len(RIGHT))] == list(RIGHT.values())
