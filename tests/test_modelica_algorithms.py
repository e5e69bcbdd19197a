"""Algorithm sections of models, and what functions may loop over, each against an answer written down by hand."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import brentq

from hystid.compiled import CompiledModel
from hystid.errors import ModelicaError
from hystid.modelica import compile_model

Signals = Mapping[str, np.ndarray]
STEP = 0.01
MODELS: dict[str, tuple[str, float, Callable[[np.ndarray], Signals]]] = {}


def model(name: str, text: str, stop: float = 1.0) -> Callable[[Callable[[np.ndarray], Signals]], None]:
    """Registers a text and the function that gives its answer at the samples."""

    def add(answer: Callable[[np.ndarray], Signals]) -> None:
        MODELS[name] = (text, stop, answer)

    return add


def off(got: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    """Samples that are farther than 1e-6 from the answer, which may switch one sample earlier or later."""
    y = np.asarray(wanted, float)
    around = np.array([np.r_[y[:1], y[:-1]], y, np.r_[y[1:], y[-1:]]])
    room = 1e-6 * max(1.0, float(np.abs(y).max()))
    return np.flatnonzero((got > around.max(0) + room) | (got < around.min(0) - room))


@model(
    "loops, branches, arrays and when-clauses",
    """
model A
  parameter Integer n = 4;
  Real x(start = 1, fixed = true), y[n], total, m[2, 2];
  Integer c(start = 0, fixed = true);
  discrete Real h[2](start = {1, 2}, each fixed = true);
algorithm
  total := 0;
  for i in 1:n loop
    y[i] := i*x;
    if mod(i, 2) == 0 then
      total := total + y[i];
    elseif i == 3 then
      total := total + 10;
    else
      total := total - 1;
    end if;
  end for;
  for i in 2:-1:1, j in 1:i loop
    total := 2*total + i - j;
  end for;
  m := [x, 1; 2, total];
  when {time > 0.3, time > 0.6} then
    c := pre(c) + 1;
    h := {c, pre(h[1])};
  elsewhen time > 0.8 then
    h[2] := 7;
  end when;
equation
  der(x) = -x;
end A;""",
)
def _(t):
    x = np.exp(-t)
    total = 6 * x + 9
    for i, j in ((2, 1), (2, 2), (1, 1)):
        total = 2 * total + i - j
    return {
        "y[3]": 3 * x,
        "total": total,
        "m[2,2]": total,
        "c": (t > 0.3) * 1 + (t > 0.6),
        "h[1]": np.where(t > 0.6, 2, 1),
        "h[2]": np.select([t > 0.8, t > 0.6, t > 0.3], [7, 1, 1], 2),
    }


@model(
    "inherited variables, one section in each of two components",
    """
model A
  block Base
    parameter Real up = 1, lo = -1;
    input Real u;
    output Integer s(start = 0, fixed = true);
    output Boolean hi;
  end Base;
  block Machine
    extends Base;
  algorithm
    hi := u > 0;
    when u > up then
      s := 1;
    elsewhen u < lo then
      s := -1;
    end when;
  end Machine;
  Machine m[2](up = {0.5, 0.8}, each lo = -0.5);
equation
  m[1].u = cos(time);
  m[2].u = sin(time);
end A;""",
    5.9,
)
def _(t):
    down, again = np.arccos(-0.5), 2 * np.pi - np.arccos(0.5)
    return {
        "m[1].s": np.select([t > again, t > down], [1, -1], 0),
        "m[1].hi": np.cos(t) > 0,
        "m[2].s": np.select([t > np.pi + np.arcsin(0.5), t > np.arcsin(0.8)], [-1, 1], 0),
    }


@model(
    "several outputs, and variables read before they are assigned",
    """
model A
  function two
    input Real x;
    output Real a, b[2];
    output Integer k;
  algorithm
    a := x^2;
    b := {x, 2*x};
    k := 3;
  end two;
  Real p, q[2], z, w(start = 2);
  Integer k;
algorithm
  (p, q, k) := two(time);
  (, , k) := two(time);
  z := w*p;
  w := 3;
end A;""",
)
def _(t):
    return {"p": t**2, "q[2]": 2 * t, "k": 3 + 0 * t, "z": 2 * t**2, "w": 3 + 0 * t}


@model(
    "reinit and a mode in one when-clause",
    """
model A
  Real h(start = 1, fixed = true), v(start = 0, fixed = true);
  Integer n(start = 0, fixed = true);
  Boolean flies(start = true, fixed = true);
algorithm
  when h <= 0 then
    n := pre(n) + 1;
    reinit(v, -0.8*v);
    if n > 3 then
      flies := false;
    end if;
    assert(n < 100, "too many");
  end when;
equation
  der(h) = v;
  der(v) = if flies then -9.81 else 0;
end A;""",
    3.0,
)
def _(t):
    g, at, h, v, n, until = 9.81, 0.0, 1.0, 0.0, 0, np.sqrt(2 / 9.81)
    rows = []
    for s in t:
        while s >= until:
            h, v, at, n = 0.0, -0.8 * (v - g * (until - at)), until, n + 1
            g, until = (0.0, np.inf) if n > 3 else (g, at + 2 * v / g)
        rows.append((h + v * (s - at) - g * (s - at) ** 2 / 2, n))
    height, count = np.array(rows).T
    return {"h": height, "n": count}


@model(
    "one variable in two when-clauses",
    """
model A
  Integer a(start = 0, fixed = true);
  Real r;
  Boolean trigger;
algorithm
  trigger := time > 0.5;
  when trigger then
    a := 5;
  end when;
  when time > 0.75 then
    a := a + 1;
  end when;
  r := a;
  r := r*2;
end A;""",
)
def _(t):
    return {"r": np.select([t > 0.75, t > 0.5], [12, 10], 0)}


@model(
    "Booleans, enumerations, and radio buttons that reset each other",
    """
model A
  type E = enumeration(x, y);
  block Button
    parameter Real at = 0;
    input Boolean reset[:] = {false};
    output Boolean on(start = false, fixed = true);
  protected
    parameter Integer n = size(reset, 1);
    Boolean before[n];
  initial equation
    pre(before) = fill(false, n);
    pre(reset) = fill(false, n);
  algorithm
    before := pre(reset);
    when before then
      on := false;
    end when;
    when time >= at then
      on := true;
    end when;
  end Button;
  Button a(at = 0.2, reset = {b.on});
  Button b(at = 0.5, reset = {a.on});
  Boolean f[3];
  Integer s;
  E e;
algorithm
  f[1] := time > 0.2;
  f[2] := not f[1];
  f[3] := f[1] or f[2];
  s := 0;
  for i in 1:3 loop
    if f[i] then
      s := s + i;
    end if;
  end for;
  e := if f[1] then E.y else E.x;
end A;""",
)
def _(t):
    return {
        "a.on": (t >= 0.2) & (t < 0.5),
        "b.on": t >= 0.5,
        "s": np.where(t > 0.2, 4, 5),
        "e": np.where(t > 0.2, 2, 1),
    }


@model(
    "change() of what an equation states late in the instant",
    """
model A
  Real level(start = 0, fixed = true);
  Boolean high = level > 0.5, was(start = false, fixed = true), seen(start = false, fixed = true);
  Integer n(start = 0, fixed = true), k(start = 0, fixed = true);
equation
  when time >= 0.3 then
    level = 1;
  end when;
  was = pre(high) or pre(was);
  when change(high) then
    n = pre(n) + 1;
    seen = high;
  end when;
  when {edge(high), time > 0.7} then
    k = pre(k) + 1;
  end when;
end A;""",
)
def _(t):
    return {"n": t >= 0.3, "seen": t >= 0.3, "was": t >= 0.3, "k": (t >= 0.3) * 1 + (t > 0.7)}


@model(
    "Booleans passed on in any order of equations",
    """
model A
  connector In = input Boolean;
  connector Out = output Boolean;
  block Not
    In u;
    Out y;
  equation
    y = not u;
  end Not;
  Not n1, n2;
  Boolean first, last, middle;
  Real r;
  Integer k;
equation
  r = k;
  n1.u = first;
  connect(n2.u, n1.y);
  last = n2.y;
  n1.y = middle;
  first = time > 0.5;
  k = integer(4*time + 0.1);
end A;""",
)
def _(t):
    return {"last": t > 0.5, "middle": t <= 0.5, "r": np.floor(4 * t + 0.1)}


@model(
    "while over variables, subscripts that change",
    """
model A
  function root "of c*y + y^3 = x by Newton's method"
    input Real x, c;
    output Real y;
  protected
    Real step;
  algorithm
    y := 0;
    step := 1;
    while abs(step) > 1e-13 loop
      step := (c*y + y^3 - x)/(c + 3*y^2);
      y := y - step;
    end while;
  end root;
  function inside "interpolation in a table"
    input Real x, t[:, 2];
    output Real y;
  protected
    Integer k;
  algorithm
    k := 1;
    while k < size(t, 1) - 1 and x > t[k + 1, 1] loop
      k := k + 1;
    end while;
    y := t[k, 2] + (x - t[k, 1])*(t[k + 1, 2] - t[k, 2])/(t[k + 1, 1] - t[k, 1]);
  end inside;
  function marked
    input Integer k;
    output Real y[3];
  algorithm
    y := {1, 2, 3};
    y[k] := 10*k;
  end marked;
  parameter Real c = 2;
  Real y = root(sin(5*time), c);
  Real z = inside(time, {{0, 0}, {0.2, 1}, {0.5, -1}, {1, 2}});
  Real w[3] = marked(1 + integer(2.5*time));
end A;""",
)
def _(t):
    y = [brentq(lambda y, s=s: 2 * y + y**3 - np.sin(5 * s), -2, 2, xtol=1e-14) for s in t]
    k = 1 + np.floor(2.5 * t + 1e-9)
    return {
        "y": np.array(y),
        "z": np.interp(t, [0, 0.2, 0.5, 1], [0, 1, -1, 2]),
        "w[2]": np.where(k == 2, 20, 2),
        "w[3]": np.where(k == 3, 30, 3),
    }


@model(
    "if-expressions with elseif",
    """
model A
  function level
    input Real u;
    output Real y;
  algorithm
    y := 0;
    while y < 2 loop
      y := y + (if u > 0.6 then 2 elseif u > 0.3 then 3 else 4);
    end while;
  end level;
  Real x, y = level(time);
  Integer k(start = 1, fixed = true);
algorithm
  when {time > 0.25, time > 0.75} then
    if pre(k) <> 0 then
      k := if time > 2 then 1 elseif time > 0.2 then 0 else 5;
    else
      k := -1;
    end if;
  end when;
  x := if time > 0.6 then 2 elseif time > 0.3 then 3 else 4;
end A;""",
)
def _(t):
    x = np.where(t > 0.6, 2, np.where(t > 0.3, 3, 4))
    return {"x": x, "y": x, "k": np.where(t > 0.75, -1, np.where(t > 0.25, 0, 1))}


@pytest.mark.parametrize("name", MODELS)
def test_a_section_does_what_its_lines_say(name: str, tmp_path: Path) -> None:
    text, stop, answer = MODELS[name]
    file = tmp_path / "rig.mo"
    file.write_text(text)
    rows = round(stop / STEP) + 1
    wanted = answer(STEP * np.arange(rows))
    compiled = CompiledModel(compile_model(f"{file}:A"))
    got = compiled.simulate({}, STEP, rows=rows, outputs=list(wanted), substeps=4)
    assert not {n: off(got[n], wanted[n]).tolist() for n in wanted if off(got[n], wanted[n]).size}


def test_a_loop_without_end_ends_the_run(tmp_path: Path) -> None:
    file = tmp_path / "rig.mo"
    file.write_text(
        "model A\n  function f\n    input Real x;\n    output Real y;\n  algorithm\n    y := x;\n"
        "    while y > 0 loop\n      y := y + 1;\n    end while;\n  end f;\n  Real y = f(time - 0.5);\nend A;\n"
    )
    compiled = CompiledModel(compile_model(f"{file}:A"))
    with pytest.raises(Exception, match=r"sample 51"):
        compiled.simulate({}, STEP, rows=101, outputs=["y"])


@pytest.mark.parametrize(
    "lines",
    [
        "for i in 1:3 loop\n    y := i;\n    break;\n  end for;",
        "if x > 1 then\n    when x > 2 then\n      y := 1;\n    end when;\n  end if;",
    ],
)
def test_what_is_not_understood_is_refused_with_its_line(lines: str, tmp_path: Path) -> None:
    file = tmp_path / "rig.mo"
    file.write_text(f"model A\n  Real x = time, y;\nalgorithm\n  {lines}\nend A;\n")
    with pytest.raises(ModelicaError, match=r"rig\.mo:[1-5]: .*algorithm section"):
        compile_model(f"{file}:A")
