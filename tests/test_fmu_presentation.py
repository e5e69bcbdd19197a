"""What importers show of an FMU: icon, terminals, documentation, author and terms, units for people."""

from __future__ import annotations

import io
import re
import zipfile
from html import unescape
from pathlib import Path

import fmpy
import fmu_checker
import numpy as np
import pytest
from fmpy.validation import validate_fmu
from fmu_models import jenkins, linear
from lxml import etree

from hystid.cli.run import run
from hystid.errors import UsageError
from hystid.fmu import About, build, build_model
from hystid.modelica import compile_model
from hystid.modelica.check import equation_text
from hystid.modelica.expr import Num, Op, Ref

SCHEMA = Path(fmpy.__file__).parent / "schema" / "fmi3" / "fmi3TerminalsAndIcons.xsd"
BOTH = pytest.mark.parametrize("version", [2, 3])


def entry(path, name):
    with zipfile.ZipFile(path) as archive:
        return archive.read(name)


def picture(content):
    """The pixels of a PNG file, by a reader that is not ours."""
    matplotlib_image = pytest.importorskip("matplotlib.image")
    return matplotlib_image.imread(io.BytesIO(content), format="png")[..., :3]


@BOTH
def test_each_model_has_a_picture_of_its_own(tmp_path, version):
    name = "model.png" if version == 2 else "terminalsAndIcons/icon.png"
    shown = {}
    for model in ("Jenkins", "Dahl"):
        path = build_model(f"HystId.Oscillators.{model}", tmp_path / f"{model}.fmu", fmi=version).path
        assert validate_fmu(str(path)) == [] and fmu_checker.problems(path) == []
        shown[model] = picture(entry(path, name))
    inner = shown["Jenkins"][10:-10, 10:-10]
    drawn = np.any(inner < 0.9, axis=2)
    assert inner.shape == (180, 180, 3) and 0.005 < drawn.mean() < 0.5
    rows, columns = np.nonzero(drawn)
    assert np.ptp(rows) > 130 and np.ptp(columns) > 130  # the loop fills the picture
    assert not np.array_equal(shown["Jenkins"], shown["Dahl"])


def test_terminals_name_the_flange(tmp_path):
    schema = etree.XMLSchema(file=str(SCHEMA))
    for model, force in (("Oscillators.Jenkins", "F"), ("Forces.Jenkins", "f")):
        path = build_model(f"HystId.{model}", tmp_path / "m.fmu", fmi=3).path
        root = etree.fromstring(entry(path, "terminalsAndIcons/terminalsAndIcons.xml"))
        assert schema.validate(root), schema.error_log
        members = {
            m.get("memberName"): (m.get("variableName"), m.get("variableKind"))
            for m in root.iter("TerminalMemberVariable")
        }
        assert members == {"s": ("x", "signal"), "v": ("v", "signal"), "f": (force, "inflow")}
        names = {v.name for v in fmpy.read_model_description(str(path)).modelVariables}
        assert {variable for variable, _ in members.values()} <= names


def test_the_documentation_holds_parameters_equations_and_origin(tmp_path):
    path = build_model("HystId.Oscillators.Jenkins", tmp_path / "m.fmu", about=About(author="A <b>")).path
    page = entry(path, "documentation/index.html").decode()
    text = unescape(re.sub(r"<[^>]*>", " ", page))
    assert "A <b>" in text and "<b>" not in page
    assert "Force at which the contact slips" in text and "37.5" in text
    assert "R = B * v + Kl * x + f_h + f_effects" in text and "m * a + R = F" in text
    assert fmpy.read_model_description(str(path)).guid in text


def test_equations_read_as_they_compute():
    a, b, c = Ref("a"), Ref("b"), Ref("c")
    for residual, text in (
        (Op("-", (a, Op("-", (b, Op("-", (c, a)))))), "a = b - (c - a)"),
        (Op("-", (a, Op("/", (b, Op("*", (c, a)))))), "a = b / (c * a)"),
        (Op("-", (a, Op("neg", (Op("+", (b, c)),)))), "a = -(b + c)"),
        (Op("-", (a, Op("*", (b, Op("neg", (c,)))))), "a = b * (-c)"),
        (Op("-", (a, Op("^", (Op("neg", (b,)), Num(2.0))))), "a = (-b) ^ 2"),
        (Op("-", (a, Op("+", (Op("if", (b, c, a)), c)))), "a = (if b then c else a) + c"),
    ):
        assert equation_text(residual) == text
    for line in compile_model("HystId.Oscillators.BoucWen").equations:
        assert line.count("(") == line.count(")") and " = " in line


@BOTH
def test_author_version_and_terms_by_command(tmp_path, version, monkeypatch):
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "1700000000")
    path = tmp_path / "m.fmu"
    said = ["--author", "A. Person", "--model-version", "1.2.0", "--license", "MIT", "--copyright", "(c) A. Person"]
    command = ["build", "HystId.Oscillators.Linear", "--fmi", str(version), "-o", str(path)]
    assert run([*command, *said]) == 0
    root = etree.fromstring(entry(path, "modelDescription.xml"))
    found = [root.get(name) for name in ("author", "version", "license", "copyright", "generationDateAndTime")]
    assert found == ["A. Person", "1.2.0", "MIT", "(c) A. Person", "2023-11-14T22:13:20Z"]
    assert validate_fmu(str(path)) == [] and fmu_checker.problems(path) == []
    first = path.read_bytes()
    path.unlink()
    assert run([*command, *said]) == 0 and path.read_bytes() == first  # same input, same bytes
    path.unlink()
    assert run(command) == 0 and path.read_bytes() != first


def test_texts_of_several_lines_are_refused():
    with pytest.raises(UsageError, match="the author of an FMU must be one line"):
        About(author="A\nB")


@BOTH
def test_people_read_millimetres(tmp_path, version):
    path = build(linear(), tmp_path / "m.fmu", fmi=version).path
    description = fmpy.read_model_description(str(path))
    assert next(v for v in description.modelVariables if v.name == "x").displayUnit == "mm"
    (metre,) = [unit for unit in description.unitDefinitions if unit.name == "m"]
    assert [(d.name, d.factor) for d in metre.displayUnits] == [("mm", 1000.0)]


@BOTH
def test_units_that_the_author_reads(tmp_path, version):
    """rev/min was deg/s, and others were left out; what does not fit the unit, or is not known, is as if unsaid."""
    (tmp_path / "m.mo").write_text("""
model M
  Real w(unit = "rad/s", displayUnit = "rev/min") = 1;
  Real o(unit = "rad/s", displayUnit = "rad/s") = 2;
  Real f(unit = "N", displayUnit = "kN") = 3;
  Real T(unit = "degC", displayUnit = "K") = 20;
  Real x(unit = "m", displayUnit = "kg") = 4;
  Real v(unit = "m/s", displayUnit = "warp") = 5;
end M;
""")
    path = build_model(f"{tmp_path}/m.mo:M", tmp_path / "m.fmu", fmi=version).path
    assert validate_fmu(str(path)) == [] and fmu_checker.problems(path) == []
    description = fmpy.read_model_description(str(path))
    shown = {v.name: v.displayUnit for v in description.modelVariables}
    assert [shown[name] for name in "wofTxv"] == ["rev/min", None, "kN", "K", "mm", None]
    factors = {(u.name, d.name): (d.factor, d.offset) for u in description.unitDefinitions for d in u.displayUnits}
    assert factors.pop(("rad/s", "rev/min")) == pytest.approx((60 / (2 * np.pi), 0), rel=1e-15)
    assert factors == {("N", "kN"): (1e-3, 0), ("degC", "K"): (1, 273.15), ("m", "mm"): (1e3, 0)}


def test_a_model_without_result_has_a_picture_too(tmp_path):
    path = build(jenkins(), tmp_path / "m.fmu", fmi=3, reference=False).path
    assert picture(entry(path, "terminalsAndIcons/icon.png")).shape == (200, 200, 3)
    assert fmu_checker.problems(path) == []
