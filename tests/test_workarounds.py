"""Each defect of the front end that is worked around, in the smallest text that shows it.

Where a test here says that a defect is gone, take its file out of ``hystid/modelica/workarounds`` and its text out of
``docs/upstream``.
"""

from __future__ import annotations

from importlib import metadata
from pathlib import Path

import numpy as np
import pytest

from hystid.compiled import CompiledModel
from hystid.errors import ModelicaError
from hystid.modelica import compile_model
from hystid.modelica.expr import Num
from hystid.modelica.frontend import flatten
from hystid.modelica.sources import Source

ROOT = Path(__file__).parents[1]
FOLDER = ROOT / "hystid" / "modelica" / "workarounds"

# file -> text with class A, output, its value at t = 1, and what the front end says about the text as it stands
REFUSED = {
    "nested_bases": (
        """
package P
  partial model Base
    Real s(start = 0, fixed = true);
  end Base;
  model Stop
    extends Limited;
    partial model Limited "Unwrapped"
      extends Base;
      parameter Real most = 2;
      Real y = min(s, most);
      annotation (defaultComponentName = "stop");
    end Limited;
    parameter Real v = 3;
  equation
    der(s) = v;
  end Stop;
end P;
model A
  extends P.Stop;
end A;""",
        "y", 2.0, "lexically nested class",
    ),
    "literal_arrays": (
        """
model A
  Real w[1, 2], y;
equation
  if time < 0.5 then
    w = [1, 1];
  else
    for i in 1:2 loop
      w[1, i] = i*time;
    end for;
  end if;
  y = w[1, 1] + w[1, 2];
end A;""",
        "y", 3.0, "mismatched equation counts",
    ),
    "derivatives_of_expressions": (
        """
model A
  Real x(start = 1, fixed = true), y;
equation
  der(x) = 2;
  y = der(x*x + time);
end A;""",
        "y", 13.0, "derivative expression",
    ),
    "function_bodies": (
        """
function firstAbove
  input Real x[:];
  input Real limit;
  output Integer k;
algorithm
  for i in 1:size(x, 1) loop
    if x[i] > limit then
      k := i;
      return;
    end if;
  end for;
  k := 0;
end firstAbove;
model A
  Real y = firstAbove({time, 2*time, 3*time}, 1.5);
end A;""",
        "y", 2.0, "function",
    ),
    "model_algorithms": (
        """
model A
  Real x(start = 1, fixed = true), y, z;
algorithm
  z := 0;
  for k in 1:3 loop
    z := z + k;
  end for;
  y := z/2;
equation
  der(x) = -x;
end A;""",
        "y", 3.0, "algorithm",
    ),
    "nested_conditions": (
        """
connector In = input Real;
connector Out = output Real;
block B
  parameter Boolean a = true, b = true;
  In u if b;
  Out y;
equation
  if a then
    if b then
      connect(u, y);
    else
      y = 7;
    end if;
  else
    y = 1;
  end if;
end B;
model A
  B b1, b2(b = false), b3(a = false, b = false);
  Out s = 3*time;
  Real y = b1.y + 10*b2.y + 100*b3.y;
equation
  connect(s, b1.u);
end A;""",
        "y", 173.0, "nested if-equation",
    ),
    "derivatives_in_loops": (
        """
record C
  Real x(start = 0);
end C;
model A
  C c[2];
  Real y = c[2].x;
equation
  for k in 1:2 loop
    der(c[k].x) = k;
  end for;
end A;""",
        "y", 2.0, "",
    ),
    "function_bindings": (
        """
function total
  input Real u[:];
  output Real s = sum(u);
algorithm
end total;
model A
  input Real u[3];
  output Real y = total(u);
  Real x(start = 0, fixed = true);
equation
  der(x) = y + 1;
end A;""",
        "x", 1.0, "unbalanced",
    ),
    "calls_in_when": (
        """
model A
  discrete Real y(start = 0, fixed = true), z(start = 0, fixed = true);
  function f
    input Real u;
    output Real a = u + 1;
    output Real b = 2*u;
  end f;
equation
  when sample(0, 0.4) then
    (y, z) = f(pre(y));
  end when;
end A;""",
        "z", 4.0, "multi-output event calls",
    ),
    "matrix_bodies": (
        """
package Modelica
  package Math
    package Matrices
      function cholesky
        input Real A[:, size(A, 1)];
        input Boolean upper = true;
        output Real H[size(A, 1), size(A, 2)];
      algorithm
        if size(A, 1) > 0 then
          H := A;
        else
          H := fill(0, 0, 0);
        end if;
      end cholesky;
    end Matrices;
  end Math;
end Modelica;
model A
  Real H[2, 2] = Modelica.Math.Matrices.cholesky([4 + time, 0; 0, 9]);
  Real y = H[2, 2];
end A;""",
        "y", 3.0, "assigns a value of shape",
    ),
    "random_functions": (
        """
package Random
  package Generators
    package Xorshift64star
      function initialState
        input Integer localSeed, globalSeed;
        output Integer state[2];
        external "C" something(localSeed, globalSeed, state);
      end initialState;
    end Xorshift64star;
  end Generators;
end Random;
model A
  Integer s[2](each start = 0);
  Real y = s[1];
initial equation
  pre(s) = Random.Generators.Xorshift64star.initialState(3, 5);
equation
  when sample(2, 1) then
    s = pre(s);
  end when;
end A;""",
        "y", 1_673_190_961.0, "expected Real",
    ),
    "discrete_inputs": (
        """
model A
  input Integer k(start = 3);
  Real y;
equation
  y = pre(k) + 1;
end A;""",
        "y", 4.0, "names an external input",
    ),
    "delay_times": (
        """
model A
  Real x(start = 0, fixed = true), y;
equation
  der(x) = 2;
  y = delay(x, 1) + 2;
end A;""",
        "y", 2.0, "must have type 'Real'",
    ),
    "sample_conditions": (
        """
model A
  discrete Real y(start = 0, fixed = true), z(start = 0, fixed = true);
equation
  when sample(0.25, 0.5) then
    z = pre(z) + 1;
  end when;
  when sample(0, 0.1) then
    y = z;
  end when;
end A;""",
        "y", 2.0, "",
    ),
    "namesakes": (
        """
model Two
  input Real u[2];
  output Real y;
protected
  function chosen
    input Real q[2];
    input Real t;
    output Real z;
  algorithm
    z := q[1] + t;
  end chosen;
equation
  y = chosen(u, time);
end Two;
model Three
  input Real u[3];
  output Real y;
protected
  function chosen
    input Real q[3];
    input Real t;
    output Real z;
  algorithm
    z := q[3] - t;
  end chosen;
equation
  y = chosen(u, time);
end Three;
model A
  Two two(u = {1, 2});
  Three three(u = {3, 4, 5});
end A;""",
        "three.y", 4.0, "requires extent",
    ),
    "shared_sources": (
        """
connector In = input Integer;
connector Out = output Integer;
block Source
  Out y;
equation
  y = if time > 0.5 then 2 else 1;
end Source;
block Sum
  In u[2];
  Out y;
equation
  y = u[1] + u[2];
end Sum;
model A
  Source s;
  Sum twice;
equation
  connect(s.y, twice.u[1]);
  connect(s.y, twice.u[2]);
end A;""",
        "twice.y", 4.0, "discrete coordinate exactly once",
    ),
    "enumeration_numbers": (
        """
model A
  type Gear = enumeration(low, mid "in the middle, of three", high);
  type Choice = Gear;
  function ratio
    input Gear g;
    output Real i;
  algorithm
    i := 2*Integer(g);
  end ratio;
  partial model Box
    Gear g = if time < 0.5 then Gear.mid else Gear.high;
  end Box;
  model Shifted
    extends Box;
    Choice before(start = Gear.low, fixed = true);
  equation
    when time > 0.7 then
      before = g;
    end when;
  end Shifted;
  Shifted s[2];
  Real y = 100*ratio(s[1].g) + 10*Integer(pre(s[2].before)) + Integer(Gear.mid);
end A;""",
        "y", 632.0, "an enumeration stands where a number has to",
    ),
    "values_of_elements": (
        """
model Spring
  parameter Real k;
  Real f = k*time;
end Spring;
model A
  parameter Real v[3] = {1, 2, 4};
  Spring s[3](k = 2*v), t[3](k = linspace(
    1, 2, 3)), u[3](k = fill(v[1], 3));
  Real y = s[3].f + 10*t[2].f + 100*u[3].f;
end A;""",
        "y", 123.0, "expression shape mismatch",
    ),
    "record_fields": (
        """
model A
  record Spring
    parameter Real k = 1;
    parameter Integer n = 1;
    parameter Boolean on = true;
  end Spring;
  parameter Spring s[3](k = {2, 3, 5}, on = {true, false, true}) "a; b", t[2] = {Spring(n = 2), Spring(k = 7)};
  Real f[3], y;
equation
  for i in 1:size(s, 1) loop
    f[i] = if s[i].on then s[i].k*time else 0;
  end for;
  y = f[1] + 10*f[3] + 100*sum(t[i].k^t[i].n for i in 1:2);
end A;""",
        "y", 852.0, "no entry found for key",
    ),
    "table_files": (
        """
package Types
  type Smoothness = enumeration(LinearSegments, ContinuousDerivative, ConstantSegments);
  type Extrapolation = enumeration(HoldLastPoint, LastTwoPoints, Periodic, NoExtrapolation);
  class ExternalCombiTable1D
    extends ExternalObject;
    function constructor
      input String tableName; input String fileName; input Real table[:, :]; input Integer columns[:];
      input Smoothness smoothness; input Extrapolation extrapolation = Extrapolation.LastTwoPoints;
      output ExternalCombiTable1D made;
    external "C" made = ModelicaStandardTables_CombiTable1D_init(tableName, fileName, table, columns);
    end constructor;
    function destructor
      input ExternalCombiTable1D made;
    external "C" ModelicaStandardTables_CombiTable1D_close(made);
    end destructor;
  end ExternalCombiTable1D;
end Types;
package Tables
  package Internal
    function getTable1DValue
      input Types.ExternalCombiTable1D tableID; input Integer icol; input Real u; output Real y;
    external "C" y = ModelicaStandardTables_CombiTable1D_getValue(tableID, icol, u);
    end getTable1DValue;
  end Internal;
end Tables;
model Table
  parameter Boolean tableOnFile = false;
  parameter String tableName = "NoName", fileName = "NoName";
  parameter Real table[:, :] = fill(0.0, 0, 2);
  final parameter Types.ExternalCombiTable1D tableID = Types.ExternalCombiTable1D(
    if tableOnFile then tableName else "NoName", if tableOnFile then fileName else "NoName", table, {2},
    Types.Smoothness.LinearSegments);
  Real y = Tables.Internal.getTable1DValue(tableID, 1, time);
end Table;
model A
  Table t(tableOnFile = true, tableName = "tab", fileName = "points.txt");
  Real y = t.y;
end A;""",
        "y", 3.0, "table",
    ),
    "surface_tables": (
        """
package Types
  type Smoothness = enumeration(LinearSegments, ContinuousDerivative, ConstantSegments);
  type Extrapolation = enumeration(HoldLastPoint, LastTwoPoints, Periodic, NoExtrapolation);
  class ExternalCombiTable2D
    extends ExternalObject;
    function constructor
      input String tableName; input String fileName; input Real table[:, :]; input Smoothness smoothness;
      input Extrapolation extrapolation = Extrapolation.LastTwoPoints;
      output ExternalCombiTable2D made;
    external "C" made = ModelicaStandardTables_CombiTable2D_init(tableName, fileName, table, smoothness);
    end constructor;
    function destructor
      input ExternalCombiTable2D made;
    external "C" ModelicaStandardTables_CombiTable2D_close(made);
    end destructor;
  end ExternalCombiTable2D;
end Types;
package Tables
  package Internal
    function getTable2DValue
      input Types.ExternalCombiTable2D tableID; input Real u1; input Real u2; output Real y;
    external "C" y = ModelicaStandardTables_CombiTable2D_getValue(tableID, u1, u2);
    end getTable2DValue;
    function getTable2DAbscissaUmin
      input Types.ExternalCombiTable2D tableID; output Real uMin[2];
    external "C" ModelicaStandardTables_CombiTable2D_minimumAbscissa(tableID, uMin);
    end getTable2DAbscissaUmin;
    partial model Base
      parameter Real table[:, :];
      final parameter Real u_min[2] = getTable2DAbscissaUmin(tableID);
      parameter Types.ExternalCombiTable2D tableID = Types.ExternalCombiTable2D(
        "NoName", "NoName", table, Types.Smoothness.LinearSegments);
    end Base;
  end Internal;
end Tables;
model A
  extends Tables.Internal.Base(table = [0, 3, 4; 1, 10, 20; 2, 30, 70]);
  Real y = Tables.Internal.getTable2DValue(tableID, u_min[1] + time, u_min[2] + time/2);
end A;""",
        "y", 50.0, "function value type",
    ),
    "external_functions": (
        """
function solve
  input Real A[:, size(A, 1)];
  input Real B[size(A, 1), :];
  output Real X[size(A, 1), size(B, 2)] = B;
  output Integer info;
protected
  Integer n = size(A, 1), nrhs = size(B, 2), pivots[size(A, 1)];
  Real work[size(A, 1), size(A, 1)] = A;
external "FORTRAN 77" dgesv(n, nrhs, work, n, pivots, X, n, info);
end solve;
model A
  Real x[2, 1] = solve({{0, 2}, {4, 1}}, {{2}, {5}}), y = x[1, 1] + 10*x[2, 1];
end A;""",
        "y", 11.0, "external function",
    ),
}  # fmt: skip


def by_itself(text: str):
    """What the front end makes of a text that nothing was done to."""
    return flatten("A", [Source(Path("A.mo"), text)], [], {})


@pytest.mark.parametrize("name", REFUSED)
def test_the_front_end_still_refuses_what_the_way_around_lets_through(name: str, tmp_path: Path) -> None:
    text, output, value, words = REFUSED[name]
    path = tmp_path / "A.mo"
    path.write_text(text)
    (tmp_path / "points.txt").write_text("#1\ndouble tab(2, 2)\n0 1\n1 3\n")  # of the one that reads a file
    code = [compile_model(f"{path}:A") for _ in range(2)][-1]  # twice: the second one finds the text in memory
    got = CompiledModel(code).simulate({}, 0.05, rows=21, outputs=[output])
    # straight lines and their squares: Runge-Kutta is exact but for rounding
    np.testing.assert_allclose(got[output][-1], value, atol=1e-12)
    try:
        by_itself(text)
    except ModelicaError as error:
        assert words in str(error)
    else:
        pytest.fail(f"rumoca {metadata.version('rumoca')} takes this: {name}.py is no longer needed")


def test_derivatives_of_expressions_in_declarations(tmp_path: Path) -> None:
    """In values and modifiers, of a class with an annotation and of one with functions and classes in it."""
    path = tmp_path / "A.mo"
    path.write_text("""
model B
  Real a, x = 1 + 2*time;
  Real d = der(x*x) annotation(HideResult = false);
  annotation(experiment(StopTime = 2));
end B;
model A
  function f
    input Real u;
    output Real y;
  algorithm
    y := 2*u;
  end f;
  parameter Real k = 3, still = 5 + der(6*k), too = der(k);
  Real x = 1 + 2*time;
  B b(a = der(
    x^2));
  Real y = f(der(x*x + time)) + b.a + b.d + still + too;
end A;""")
    got = CompiledModel(compile_model(f"{path}:A")).simulate({}, 0.05, rows=21, outputs=["y"])
    x = 1 + 2 * np.linspace(0, 1, 21)
    np.testing.assert_allclose(got["y"], 2 * (4 * x + 1) + 8 * x + 5, atol=1e-12)


DROPPED = {
    "dropped_modifiers": (
        """
model Law
  parameter Real k = 1;
  Real f = k;
end Law;
model Rig
  replaceable model F = Law;
  F law;
end Rig;
model A
  extends Rig(redeclare model F = Law(k = 7));
end A;""",
        "law.k", 7.0,
    ),
    "joined_modifiers": (
        """
model P
  parameter Real m = 1;
end P;
model B
  P p(m(min = 0) = 3);
end B;
model A
  extends B(p(m(max = 6)));
end A;""",
        "p.m", 3.0,
    ),
    "package_constants": (
        """
package Material
  constant Real E = 1;
end Material;
package Steel
  extends Material(E = 2);
end Steel;
model A
  parameter Real a = Material.E;
  parameter Real b = Steel.E;
end A;""",
        "a", 1.0,
    ),
    "limits": (
        """
model P
  parameter Real mu = 1;
end P;
model B
  replaceable model F = P constrainedby P(mu = 15);
  F f;
end B;
model A
  extends B(redeclare model F = P);
end A;""",
        "f.mu", 15.0,
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", DROPPED)
def test_the_front_end_still_drops_what_the_way_around_keeps(name: str, tmp_path: Path) -> None:
    text, parameter, value = DROPPED[name]
    path = tmp_path / "A.mo"
    path.write_text(text + "\n")
    code = compile_model(f"{path}:A")
    assert float({v.name: v for v in code.variables}[parameter].start or "nan") == value
    binding = {v.name: v for v in by_itself(text).variables}[parameter].binding
    if binding == Num(value):
        pytest.fail(f"rumoca {metadata.version('rumoca')} keeps this: {name}.py is no longer needed")


def test_each_way_around_has_a_defect_and_a_text_for_its_authors() -> None:
    files = {p.stem for p in FOLDER.glob("*.py")} - {"__init__", "edits"}
    shown = {*REFUSED, *DROPPED, "homotopy_arguments"}  # that one: test_homotopy_means_its_actual_argument_...
    assert files == shown
    assert {p.stem for p in (ROOT / "docs" / "upstream").glob("*.txt")} == shown
