"""Records as a whole: in equations, as outputs of functions, from constructors, in arrays."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from hystid.compiled import CompiledModel
from hystid.modelica import compile_model

TEXT = """
package Rig
  record Z
    Real re, im;
    Real p[2];
  end Z;
  record P
    parameter Real k = 2;
    parameter Real c[2] = {1, 2};
  end P;
  function made
    input Real a;
    output Z z;
  algorithm
    z.re := a;
    z.im := 2*a;
    z.p := {a, 1};
  end made;
  function size2
    input Z z;
    output Real n;
  algorithm
    n := z.re^2 + z.im^2 + sum(z.p);
  end size2;
  function bent
    input Real x;
    output Z r;
  protected
    Z q;
  algorithm
    q := made(x);
    r.re := q.re + 1;
    r.p := {1, 2};
    r.im := size2(q);
    if x > 0.505 then
      r.re := q.re;
      r.im := q.im;
      r.p := q.p;
    end if;
  end bent;
  model A
    parameter P p(k = 3, c = {4, 5});
    parameter P q = P(k = 7, c = {1, 6});
    Real x(start = 1, fixed = true);
    Z z, w, v[2], u = if time > 0.305 then bent(time) else made(time);
    Real n = size2(w), s = q.k + q.c[2] + p.c[1];
  equation
    der(x) = -p.k*x;
    z = made(x);
    w = Z(im = x, re = p.c[2], p = {1, 2});
    v[1] = z;
    v[2] = Z(1, 2, {3, 4});
  end A;
end Rig;
"""


def test_records_as_a_whole(tmp_path: Path) -> None:
    file = tmp_path / "rig.mo"
    file.write_text(TEXT)
    t = 0.01 * np.arange(101)
    x = np.exp(-3 * t)
    late, bent = t > 0.505, t > 0.305
    wanted = {
        "z.im": 2 * x,
        "w.re": 5 + 0 * t,
        "w.im": x,
        "n": 25 + x**2 + 3,
        "s": 17 + 0 * t,
        "v[1].p[1]": x,
        "v[2].p[2]": 4 + 0 * t,
        "u.re": np.where(bent & ~late, t + 1, t),
        "u.im": np.where(bent & ~late, 5 * t**2 + t + 1, 2 * t),
        "u.p[2]": np.where(bent & ~late, 2, 1),
    }
    got = CompiledModel(compile_model(f"{file}:Rig.A")).simulate({}, 0.01, rows=101, outputs=list(wanted), substeps=4)
    for name, values in wanted.items():
        assert np.abs(got[name] - values).max() < 1e-6, name  # Runge-Kutta with 2.5 ms: below 1e-9


def test_what_no_one_connects_in_an_expandable_connector_is_not_there(tmp_path: Path) -> None:
    file = tmp_path / "rig.mo"
    file.write_text("""
package Rig
  connector In = input Real;
  connector Out = output Real;
  expandable connector Bus
    Real used, unused;
    Boolean flag, idle;
  end Bus;
  block Twice
    In u;
    Out y = 2*u;
  end Twice;
  model A
    Bus bus;
    Twice g;
    Out s = sin(time);
    connector BOut = output Boolean;
    BOut b = time > 0.505;
    Boolean c = bus.flag;
  equation
    connect(s, bus.used);
    connect(bus.used, g.u);
    connect(b, bus.flag);
  end A;
end Rig;
""")
    code = compile_model(f"{file}:Rig.A")
    t = 0.01 * np.arange(101)
    got = CompiledModel(code).simulate({}, 0.01, rows=101, outputs=["g.y", "c"])
    assert np.abs(got["g.y"] - 2 * np.sin(t)).max() < 1e-15
    assert (got["c"] == (t > 0.505)).all()
    assert not {"bus.unused", "bus.idle"} & {v.name for v in code.variables}


def test_an_operator_record_with_several_operators_is_read(tmp_path: Path) -> None:
    text = """
operator record Pair
  Real a, b;
  encapsulated operator '*'
    function times
      import Pair; input Pair p; input Real k; output Pair q;
    algorithm
      q := Pair(k*p.a, k*p.b);
    end times;
  end '*';
  encapsulated operator function '+'
    import Pair; input Pair p; input Pair r; output Pair q;
  algorithm
    q := Pair(p.a + r.a, p.b + r.b);
  end '+';
  encapsulated operator function '-'
    import Pair; input Pair p; output Pair q;
  algorithm
    q := Pair(-p.a, -p.b);
  end '-';
  encapsulated operator function '=='
    import Pair; input Pair p; input Pair r; output Boolean same;
  algorithm
    same := p.a == r.a;
  end '==';
end Pair;
model A
  Pair p = Pair(time, 2), q = Pair.'*'.times(p, 3);
  Real y = q.a + 10*q.b;
end A;"""
    path = tmp_path / "A.mo"
    path.write_text(text)
    got = CompiledModel(compile_model(f"{path}:A")).simulate({}, 0.5, rows=3, outputs=["y"])
    np.testing.assert_allclose(got["y"], 60 + 1.5 * np.arange(3), rtol=1e-13)
