"""What is refused, and how: one sentence with file, line, the construct and the way around it."""

from __future__ import annotations

import subprocess
import sys

import pytest

from hystid.compiled import CompiledModel
from hystid.errors import ModelicaError, NumericalError
from hystid.modelica import compile_model, frontend
from hystid.modelica.flat import from_json


def model(body: str, declarations: str = "") -> str:
    return f"{declarations}model A\n{body}end A;\n"


LAWS = "model P parameter Real mu = 1; end P;\nmodel Q extends P; Real y = mu; end Q;\n"

# name: text, line, words that the message must hold
REFUSED = {
    "syntax": (model("  Real x;\nequation\n  x = = 3;\n"), 4, "unexpected '='"),
    "end name": ("model A\n  Real x;\nequation\n  x = 3;\nend B;\n", 5, "'B'"),
    "unknown name": (
        model("  Real speed;\nequation\n  speed = sped;\n"), 4, "'sped' is not declared; did you mean 'speed'?"
    ),
    "unknown type": (model("  Foo x;\nequation\n  x = 1;\n"), 2, "'Foo'"),
    "unknown base": (model("  extends Foo;\n"), 2, "'Foo'"),
    "unknown function": (model("  Real x;\nequation\n  x = foo(3);\n"), 4, "'foo'"),
    "unknown modifier": (model("  Real x(foo = 3);\nequation\n  x = 1;\n"), 2, "unknown modifier 'foo'"),
    "comparison as an equation": (model("  Real x;\nequation\n  x == 3;\n"), 4, r"without '=' \('==' compares\)$"),
    "number for a truth value": (model("  Real x = 1;\n  Boolean b = 1;\n"), 3, "another type, as a Boolean a number$"),
    "truth value for a number": (model("  Boolean b = true;\n  Real x = true;\n"), 3, "another type|expected 'Real'"),
    "branches of several lengths": (
        model("  Real x;\nequation\n  if time > 1 then\n    x = 3;\n  end if;\n"), 4, "equation counts; every"
    ),
    "equal reals": (
        model("  Real x, y;\nequation\n  x = time;\n  y = if x == 1 then 1 else 0;\n"), 1, "on Real .*; compare by <"
    ),
    "loop beyond an array": (
        model("  parameter Integer n = 3;\n  Real z[n];\nequation\n  for i in 1:n + 1 loop z[i] = time; end for;\n"),
        3,
        "'z' has 3 elements, and a loop names element 4",
    ),
    "number of an enumeration": (
        model(
            "  type G = enumeration(low, high);\n  parameter G g = G.low;\n  Integer k;\nequation\n"
            "  k = Integer(if time > 1 then G.high else g);\n"
        ),
        6,
        r"an enumeration stands where a number has to; write Integer\(e\), where e is the name of a variable",
    ),
    "unbalanced": (
        model("  Real x;\n  Real y;\nequation\n  x = 1;\n"), 3, r"no equations for 1 unknown \(y\), 1 too few",
    ),
    "too many equations": (
        model("  Real x;\n  Real y;\nequation\n  x = 1;\n  x + y = 3;\n  y = 2;\n"),
        7,
        r"3 equations for 2 unknowns \(y, x\), 1 too many: 'x = 1' \(rig.mo:5\), 'x \+ y = 3' \(rig.mo:6\), 'y = 2'",
    ),
    "too many equations for states": (
        model(
            "  Real x(start=0, fixed=true), v(start=0, fixed=true);\nequation\n  der(x) = v;\n  der(v) = -x;\n"
            "  x + v = 1;\n"
        ),
        6,
        r"3 equations for 2 unknowns \(v, x\), 1 too many: 'der\(x\) = v' \(rig.mo:4\), .*'x \+ v = 1' \(rig.mo:6\)",
    ),
    "a torque on a free end": (
        model(
            "  J a(phi(start=1, fixed=true)), b;\n  G g;\nequation\n  connect(a.b, g.a);\n  connect(g.b, b.a);\n"
            "  a.a.tau = sin(time);\n  b.b.tau = -b.w;\n",
            "connector F\n  Real phi;\n  flow Real tau;\nend F;\n"
            "model J\n  F a, b;\n  Real phi, w;\nequation\n  phi = a.phi;\n  phi = b.phi;\n  w = der(phi);\n"
            "  der(w) = a.tau + b.tau;\nend J;\n"
            "model G\n  F a, b;\nequation\n  a.phi = 3*b.phi;\n  3*a.tau + b.tau = 0;\nend G;\n",
        ),
        3,
        r"2 too many: .*'a\.a\.tau = sin\(time\)' \(rig.mo:26\), '0 = a\.a\.tau'",
    ),
    "a member that a bus does not declare": (
        model(
            "  Bus bus;\n  O o;\nequation\n  connect(o.y, bus.speed);\n",
            "expandable connector Bus end Bus;\nconnector Out = output Real;\nblock O\n  Out y = time;\nend O;\n",
        ),
        10,
        "adds a member that the connector does not declare; this is not supported: declare the member in the connector",
    ),
    "outputs of a distribution": (
        model(
            "  Real x(start=0, fixed=true), y, z;\nequation\n  der(x) = 1;\n"
            "  (y, z) = spatialDistribution(time, 0, x, true, {0, 1}, {0, 0});\n"
        ),
        5,
        r"spatialDistribution\(\) is not supported: discretise in space with an array of states",
    ),
    "a counter without pre": (
        model("  Integer n(start=0, fixed=true);\nequation\n  when time > 0.3 then\n    n = n + 1;\n  end when;\n"),
        2,
        r"'n' depends on itself at one instant; break the loop with pre\(\), as in n = pre\(n\) \+ 1",
    ),
    "two sources side by side": (
        model(
            "  V one, two;\n  G g;\nequation\n  connect(one.p, two.p);\n  connect(one.n, two.n);\n"
            "  connect(one.n, g.p);\n",
            "connector Pin\n  Real v;\n  flow Real i;\nend Pin;\n"
            "model V\n  Pin p, n;\nequation\n  p.v - n.v = 1;\n  p.i + n.i = 0;\nend V;\n"
            "model G\n  Pin p;\nequation\n  p.v = 0;\nend G;\n",
        ),
        14,
        r"3 equations for 2 unknowns .*, 1 too many: .*; 4 equations for 5 unknowns \(.*\.i, .*\), 1 too few: .*"
        r"'0 = one\.p\.i \+ two\.p\.i' \(rig\.mo:20\)",  # the clause, not the connector
    ),
    "sizes": (model("  Real x[2];\nequation\n  x = {1, 2, 3};\n"), 4, "[2]"),
    "type": (model("  Real x = true;\n"), 2, "Boolean"),
    "a parameter that follows an input": (
        model("  input Real u;\n  parameter Real k = 2*u;\n  Real x = k;\n"), 3, "'k' cannot depend on 'u', which",
    ),
    "a modifier that changes": (
        model("  Real u;\n  C c(k = u);\nequation\n  u = 1;\n", "model C\n  parameter Real k;\nend C;\n"), 2,
        r"'c\.k' cannot depend on 'u', which changes",
    ),
    "partial": ("partial " + model("  Real x;\nequation\n  x = 1;\n"), 1, "partial"),
    "algorithm": (
        model("  Real x;\nalgorithm\n  for i in 1:2 loop\n    x := i;\n    break;\n  end for;\n"), 3, "algorithm",
    ),
    "loop of an initial algorithm": (
        model(
            "  parameter Integer n(fixed = false);\n  Real x[3];\ninitial algorithm\n  n := 2;\n"
            "  for i in 1:n loop\n    x[i] := i;\n  end for;\nequation\n  der(x) = fill(1, 3);\n"
        ),
        4,
        "the range of a loop in an initial algorithm is open; give a number",
    ),
    "initial algorithm": (
        model("  Real x;\ninitial algorithm\n  x := 1;\nequation\n  der(x) = 1;\n"),
        3,
        r"an initial algorithm sets 'x', which is no parameter; let it set a parameter p\(fixed = false\), and say",
    ),
    "string": (model('  String s;\n  Real x = 1;\nequation\n  s = "a";\n'), 2, "String variable"),
    "string without a value": (model("  parameter String s;\n  Real x = 1;\n"), 2, "value of the String 's'"),
    "external": (
        model(
            "  Real x;\nequation\n  x = f(3);\n",
            'function f\n  input Real u;\n  output Real y;\nexternal "C";\nend f;\n',
        ),
        4,
        "external functions are not supported",
    ),
    "clock": (
        model("  Real x;\nequation\n  when Clock(0.1) then\n    x = previous(x) + 1;\n  end when;\n"),
        4,
        "clocks are not supported",
    ),
    "name taken": (
        model(
            "  extends P;\n  parameter Real a = 1;\nequation\n  a*x = time;\n",
            "partial model P\n  Real x;\n  Real a;\nend P;\n",
        ),
        3,
        "conflicting definitions.*the name is taken by what the class extends",
    ),
    "stream": (
        model("  C c;\n", "connector C\n  Real p;\n  flow Real m;\n  stream Real h;\nend C;\n"),
        4,
        "stream connectors are not supported",
    ),
    "der of expression in a loop": (
        model("  Real x[2](each start = 1);\nequation\n  for i in 1:2 loop\n    der(i*x[i]) = 1;\n  end for;\n"),
        5,
        "der.* takes one variable",
    ),
    "der of an input": (model("  input Real u;\n  Real x;\nequation\n  x = der(u);\n"), 5, "derivative of an input"),
    "an output that is left out": (
        "model A\n  function f\n    input Real u;\n    output Real a = u;\n    output Real b = 2*u;\n"
        "  algorithm\n  end f;\n  Real y;\nequation\n  (, y) = f(time);\nend A;\n",
        10, "an output that is left out",
    ),
    "an external object": (
        "model A\n  class H\n    extends ExternalObject;\n    function constructor\n      input Real u;\n"
        "      output H h;\n"
        '    external "C" h = make(u);\n    end constructor;\n    function destructor\n      input H h;\n'
        '    external "C" drop(h);\n    end destructor;\n  end H;\n  function g\n    input H h;\n    output Real y;\n'
        '  external "C" y = g(h);\n  end g;\n  H h = H(1);\n  Real y = g(h);\nend A;\n',
        3, "external objects are not supported",
    ),
    "an encapsulated model without an import": (
        "encapsulated model A\n  Real y = Modelica.Constants.g_n;\nend A;\n", 2, "sees what it imports alone",
    ),
    "breakdown of the front end": (model("  Real x;\nequation\n  x = der(time);\n"), 1, "front end broke down"),
    "change of expression": (
        model("  Real v(start = 1);\n  discrete Real n;\nequation\n  der(v) = -1;\n"
              "  when change(v >= 0) then\n    n = pre(n) + 1;\n  end when;\n"),
        6,
        "give the operand a name",
    ),
    "pre of continuous": (
        model("  Real v(start = 1);\n  Real y = 2*v;\n  discrete Real n;\nequation\n  der(v) = -1;\n"
              "  when v < 0 then\n    n = pre(y);\n  end when;\n"),
        8,
        r"pre\(y\) needs a discrete variable",
    ),
    "terminate": (
        model('  Real v(start = 1);\nequation\n  der(v) = -1;\n  when v < 0 then\n    terminate("x");\n  end when;\n'),
        5,
        "terminate",
    ),
    "nested when": (
        model("  discrete Real g;\nequation\n  when time > 1 then\n    when time > 2 then\n      g = 1;\n"
              "    end when;\n  end when;\n"),
        1,
        "cannot be nested",
    ),
    "two when-clauses": (
        model("  discrete Real k;\nequation\n  when time > 1 then\n    k = 1;\n  end when;\n"
              "  when time > 2 then\n    k = 2;\n  end when;\n"),
        1,
        "elsewhen",
    ),
    "if without else": (
        model("  Real g;\nequation\n  if time > 1 then\n    g = 1;\n  end if;\n"), 4, "every branch of an if-equation"
    ),
    "discrete loop": (model("  Boolean a, b;\nequation\n  a = not b;\n  b = not a;\n"), 2, r"use pre\(\)|with pre\(\)"),
    "singular": (model("  Real x, y;\nequation\n  x + y = 1;\n  2*x + 2*y = 2;\n"), 5, "singular"),
    "too many starts": (
        model("  Real x(start = 1, fixed = true);\ninitial equation\n  x = 2;\nequation\n  der(x) = -x;\n"),
        4,
        "too many initial conditions",
    ),
    "tied with an input": (
        model("  input Real u;\n  Real x, y;\nequation\n  x = u;\n  y = der(x);\n"), 5, "input 'u', whose derivative"
    ),
    "units": (
        model('  Real m(unit = "kg") = 1;\n  Real F(unit = "N") = 2;\n  Real x(unit = "N");\nequation\n  x = F + m;\n'),
        6,
        r"'F \+ m' adds N and kg",
    ),
    "units of an equation": (
        model('  Real v(unit = "m/s");\n  Real x(unit = "m", start = 0);\nequation\n  der(x) = v;\n  v = x;\n'),
        6,
        "'v = x' equates m/s and m",
    ),
    "units of a binding": (model('  parameter Real t(unit = "s") = 1;\n  Real x(unit = "m") = t;\n'), 3, "m and s"),
    "prefix of a unit": (model('  Real a(unit = "mm") = 1;\n  Real b(unit = "m") = a;\n'), 3, "m and mm"),
    "value and attribute deep in extends": (
        model("  extends D(b(m(min = 0.1) = 1.5));\n", "model B\n  parameter Real m = 1;\n  Real x = m;\nend B;\n"
              "model D B b; end D;\n"),
        7,
        "value and attributes of 'm'",
    ),
    "value and attribute in a redeclared component": (
        model("  extends D(redeclare Q b(mu(min = 0.1) = 1.5));\n", LAWS + "model D replaceable P b; end D;\n"),
        5,
        "value and attributes of 'mu'",
    ),
    "dotted modifier": (model("  D d(b.mu = 2);\n", LAWS + "model D Q b; end D;\n"), 5, r"write b\(mu"),
    "class redeclared deep in a modifier": (
        model("  D d(b(redeclare model F = Q));\n", LAWS + "model B replaceable model F = P; F f; end B;\n"
              "model D B b; end D;\n"),
        6,
        "'model Mine = ",
    ),
    "redeclare model extends": (
        model("  extends B;\n  redeclare model extends F\n    Real w = mu;\n  end F;\n",
              LAWS + "model B replaceable model F = P; F f; end B;\n"),
        6,
        "redeclare model extends F",
    ),
    "modifiers of a class that is limited and redeclared": (
        model("  extends B(redeclare model F = P);\n",
              LAWS + "model B\n  parameter Real q = 15;\n  replaceable model F = Q constrainedby P(mu = q);\n"
              "  F f;\nend B;\n"),
        5,
        "in the redeclaration",
    ),
    "modifiers beside constrainedby": (
        model("  extends B(redeclare Q f);\n",
              LAWS + "model B\n  replaceable Q f(mu = 2) constrainedby P(mu = 3);\nend B;\n"),
        4,
        r"write constrainedby P\(...\)",
    ),
    "parameter in a class redeclaration": (
        model("  parameter Real q = 3;\n  extends B(redeclare model F = Q(mu = 2*q));\n",
              LAWS + "model B replaceable model F = P; F f; end B;\n"),
        6,
        "'q' in the modifiers of a class",
    ),
    "parameter in a short class": (
        model("  parameter Real q = 3;\n  model F = Q(mu = q);\n  F f;\n", LAWS), 5, "no longer follows q"
    ),
    "range": (model("  parameter Real k(min = 0) = -1;\n  Real x = k*time;\n"), 2, "outside its range"),
    "constant without value": (model("  constant Real c;\n  Real x = c;\n"), 2, "constant 'c' has no value"),
    "large array": (
        model("  parameter Integer n = 200000;\n  Real x[n];\nequation\n  x = fill(time, n);\n"),
        3,
        "200000 elements",
    ),
    "many components": (model("  C c[150, 200];\n", "model C\n  Real y = time;\nend C;\n"), 5, "limit is 20000"),
    "components in components": (
        model("  D d[100];\n", "model C\n  Real y = time;\nend C;\nmodel B C c[100]; end B;\n"
              "model D B b[100]; end D;\n"),
        7,
        "1000000 elements",
    ),
    "long loop": (
        model("  Real x;\nequation\n  for k in 1:10000000 loop\n    x = 1;\n  end for;\n"),
        4,
        "a loop of 10000000 steps",
    ),
    "expansion without end": (
        model("  Real x = sum(fill(time, 999, 999)*fill(time, 999, 999));\n"),
        2,
        "HYSTID_COMPILE_ELEMENTS",
    ),
    "derivative of a function": (
        model("  Real x = g(time);\n", "function f\n  input Real u;\n  output Real y = u^2;\nalgorithm\nend f;\n"
              "function g = der(f, u);\n"),
        6,
        "write the derivative as a function of its own",
    ),
    "error statement": (
        model("  parameter Real p = -1;\n  Real x = f(p);\n", "function f\n  input Real u;\n  output Real y;\n"
              "algorithm\n  y := u;\n  if u < 0 then\n    Modelica.Utilities.Streams.error(\"negative\");\n  end if;\n"
              "end f;\n"),
        12,
        "function 'f' stops with its error",
    ),
    "function of a replaceable package in two forms": (
        model("  S a;\n  S b(redeclare package P = N);\n", "function g\n  input Real u;\n  output Real y;\nalgorithm\n"
              "  y := 3*u;\nend g;\npackage M\n  replaceable function f\n    input Real u;\n    output Real y;\n"
              "  algorithm\n    y := u;\n  end f;\nend M;\n"
              "package N\n  extends M;\n  redeclare function f = g;\nend N;\n"
              "model S\n  replaceable package P = M;\n  Real y = P.f(time);\nend S;\n"),
        20,
        "in two forms at once",
    ),
    "constant made from others, of a replaceable package": (
        model("  S a;\n  S b(redeclare package P = N);\n", "package M\n  constant Real g = 2;\n"
              "  constant Real h = 3*g;\nend M;\npackage N\n  extends M(g = 5);\nend N;\n"
              "model S\n  replaceable package P = M;\n  Real y = P.h;\nend S;\n"),
        10,
        "a constant made from others",
    ),
    "modifiers that cannot be joined": (
        model("  extends C(p(m(max = 6)));\n", "model P\n  parameter Real m = 1;\n  Real x = m;\nend P;\n"
              "model B P p(m = 3); end B;\nmodel C extends B(p(m(min = 0.2))); end C;\n"),
        8,
        "cannot be joined",
    ),
    "modifiers of the elements of an array that cannot be joined": (
        model("  extends C(p(i(x(each start = 2))));\n", "model I\n  parameter Real g = 1;\n  Real x(start = 1);\n"
              "equation\n  der(x) = -g*x;\nend I;\nmodel P I i; end P;\nmodel C P p[2](i(g = {1, 2})); end C;\n"),
        10,
        "cannot be joined",
    ),
    "classes that extend each other": (
        model("  P p;\n", "model P\n  extends Q;\nend P;\nmodel Q\n  extends P;\nend Q;\n"),
        4,
        "extends itself",
    ),
    "state assigned in a when-clause": (
        model("  Real x(start = 1);\nequation\n  der(x) = -x;\n  when x < 0.5 then\n    x = 1;\n  end when;\n"),
        2,
        "a state is set by reinit",
    ),
    "remainder of an index of a loop as a subscript": (
        model("  parameter Integer n = 3;\n  Real u[n](each start = 1), w[n];\nequation\n  der(u) = -w;\n"
              "  for i in 1:n loop\n    w[i] = u[mod(i, n) + 1];\n  end for;\n"),
        7,
        "with a parameter in them: write a constant",
    ),
    "loop over the elements of an array in a function": (
        model("  Real x = f({1, 2});\n", "function f\n  input Real v[:];\n  output Real s = 0;\nalgorithm\n"
              "  for e in v loop\n    s := s + e;\n  end for;\nend f;\n"),
        5,
        "for i in 1:size",
    ),
    "comprehension over the elements of an array": (
        model("  parameter Real v[2] = {1, 2};\n  Real x = sum(e^2 for e in v);\n"), 3, "for i in 1:size"
    ),
    "size that only a function tells": (
        model("  parameter Real c[2] = {1, 2};\n  parameter Real d[:] = f(c);\n  Real x = d[1];\n",
              "function f\n  input Real c[:];\n  output Real b[size(c, 1)];\nalgorithm\n  b := 2*c;\nend f;\n"),
        9,
        "write the size of 'd' in its declaration",
    ),
    "start value that is a derivative": (
        model("  Real x = time;\n  Real y(start=der(x));\nequation\n  der(y) = 1;\n"),
        3,
        r"the start value of 'y' holds der\(\), .* write an initial equation",
    ),
    "derivative of an array expression": (
        model("  Real x[2] = {time, 1};\n  Real y[2];\nequation\n  y = der(2*x);\n"),
        5, r"declare Real z\[n\] = ..., and"
    ),
    "derivative of an array expression in a declaration": (
        model("  Real x[2] = {time, 1};\n  Real y[2] = der(2*x);\n"), 3, r"declare Real z\[n\] = ..., and"
    ),
    "library that is not here": (
        model("  Modelica.Mechanics.Translational.Components.Mass m;\n"), 2, "of the Modelica Standard Library only"
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", REFUSED)
def test_refused_with_file_line_and_reason(name, tmp_path):
    text, line, words = REFUSED[name]
    file = tmp_path / "rig.mo"
    file.write_text(text)
    with pytest.raises(ModelicaError, match=words) as caught:
        compile_model(f"{file}:A")
    assert str(caught.value).startswith(f"{file}:{line}: "), str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_breakdown_of_the_front_end_prints_nothing_of_its_own(tmp_path, capfd):
    file = tmp_path / "rig.mo"
    file.write_text(REFUSED["breakdown of the front end"][0])
    with pytest.raises(ModelicaError, match="broke down"):
        compile_model(f"{file}:A")
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("name", REFUSED)
def test_what_is_refused_in_one_class_does_not_refuse_another_of_the_file(name, tmp_path):
    text = REFUSED[name][0]
    if name in ("syntax", "end name", "comparison as an equation"):  # such a text cannot be read at all
        return
    file = tmp_path / "rig.mo"
    file.write_text("model Sound\n  Real s(start = 1, fixed = true);\nequation\n  der(s) = -s;\nend Sound;\n" + text)
    assert compile_model(f"{file}:Sound").states == ("s",)


@pytest.mark.parametrize(
    ("model_name", "words"),
    [
        ("HystId.Oscillators.Jenkin", "did you mean 'HystId.Oscillators.Jenkins'"),
        ("Jenkins", "did you mean"),
        ("HystId.Oscillators", "is a package, not a model"),
        ("nowhere.mo:A", "no such file"),
        ("a b", "names no model"),
        ("HystId.Interfaces.PartialOscillator", "partial"),
    ],
)
def test_names_that_lead_nowhere(model_name, words):
    with pytest.raises(ModelicaError, match=words):
        compile_model(model_name)


def test_class_of_a_file_not_found(tmp_path):
    file = tmp_path / "rig.mo"
    file.write_text("model Rig\n  Real x = 1;\nend Rig;\n")
    with pytest.raises(ModelicaError, match=r"rig\.mo: there is no class 'Rigg'; did you mean 'Rig'\?"):
        compile_model(f"{file}:Rigg")


@pytest.mark.parametrize(
    ("parameters", "words"),
    [
        ({"Kss": 1.0}, "no parameter 'Kss'; did you mean 'Ks'"),
        ({"fc": -1.0}, "outside its range"),
        ({"law.Ks": 1.0}, None),
    ],
)
def test_parameters(parameters, words):
    if words is None:
        assert compile_model("HystId.Oscillators.Jenkins", parameters=parameters).variable("law.Ks").start == 1.0
        return
    with pytest.raises(ModelicaError, match=words):
        compile_model("HystId.Oscillators.Jenkins", parameters=parameters)


def test_integer_parameter_is_whole():
    with pytest.raises(ModelicaError, match=r"is an Integer and cannot be 2\.5"):
        compile_model("HystId.Oscillators.Iwan", parameters={"N": 2.5})


def test_final_parameter(tmp_path):
    file = tmp_path / "rig.mo"
    file.write_text(model("  final parameter Real k = 1;\n  Real x = k*time;\n"))
    with pytest.raises(ModelicaError, match=r"rig\.mo:2: parameter 'k' of A is final"):
        compile_model(f"{file}:A", parameters={"k": 2.0})


def test_models_without_units_and_with_literals_pass_the_unit_check(tmp_path):
    file = tmp_path / "rig.mo"
    file.write_text(
        model(
            '  Real x(unit = "m", start = 1);\n  Real F(unit = "N");\n  parameter Real k = 3;\n'
            "equation\n  der(x) = -k*x;\n  F = 1000*x + 9.81*k + sin(time);\n"
        )
    )
    assert compile_model(f"{file}:A").variable("F").unit == "N"


def test_nonlinear_equation_without_solution(tmp_path):
    file = tmp_path / "rig.mo"
    file.write_text(model("  Real x(start = 1);\nequation\n  x^2 + 1 = -time;\n"))
    with pytest.raises(NumericalError, match="no answer"):
        CompiledModel(compile_model(f"{file}:A")).simulate({}, 0.1, outputs=["x"], rows=3)


def test_flat_model_of_another_schema():
    with pytest.raises(ModelicaError, match="schema 0, this hystid reads schema 1"):
        from_json('{"schema": 0}', "old.json")


def test_front_end_missing_is_told(tmp_path):
    file = tmp_path / "rig.mo"
    file.write_text(model("  Real x = 1;\n"))
    script = (
        "import sys; sys.modules['rumoca'] = None\n"
        "from hystid.errors import ModelicaError\nfrom hystid.modelica import compile_model\n"
        f"try: compile_model({str(file) + ':A'!r})\nexcept ModelicaError as error: print(error)"
    )
    out = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert "needs the front end 'rumoca': pip install" in out.stdout


# What no front end finishes: body of a model, the limit that is lowered to keep the test short, words of the message.
ENDLESS = {
    "a hunger for memory": (
        "  Real x = " + "+".join(["time"] * 20000) + ";\n",
        ("_MEMORY", 400 << 20),
        "out of memory",
    ),
    "an abort": ("  Real x = " + "(" * 5000 + "1" + ")" * 5000 + ";\n", ("_STACK", 1 << 20), "nested too deeply"),
}


def test_a_hang_of_the_front_end_ends_with_the_time_of_the_compilation(tmp_path, monkeypatch, capfd):
    monkeypatch.setenv("HYSTID_COMPILE_SECONDS", "2")
    file = tmp_path / "rig.mo"
    file.write_text(model("  Real x[10];\nequation\n  for i in 1:2*5000000 loop\n    x[1] = 1;\n  end for;\n"))
    with pytest.raises(ModelicaError, match=r"compiling takes more than 2 s \(HYSTID_COMPILE_SECONDS raises this\)"):
        compile_model(f"{file}:A")
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("name", ENDLESS)
def test_the_front_end_gives_up_with_a_sentence(name, tmp_path, monkeypatch, capfd):
    body, limit, words = ENDLESS[name]
    monkeypatch.setattr(frontend, *limit)
    file = tmp_path / "rig.mo"
    file.write_text(model(body))
    with pytest.raises(ModelicaError, match=f"gave up on this model .*{words}") as caught:
        compile_model(f"{file}:A")
    assert str(caught.value).startswith(f"{file}:1: ") and "\n" not in str(caught.value)
    assert capfd.readouterr() == ("", "")
