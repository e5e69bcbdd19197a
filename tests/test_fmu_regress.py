"""Reference results inside an FMU, their replay, and the pytest fixture that users get."""

from __future__ import annotations

import shutil
import subprocess
import sys
import warnings
import zipfile
from dataclasses import replace
from importlib.metadata import entry_points
from pathlib import Path
from xml.etree import ElementTree as ET

import fmpy
import fmu_checker
import numpy as np
import pytest
from fmu_models import EVERY, built, effect, jenkins, linear
from fmu_models import FOLDER as MODELS
from lxml import etree

import hystid
from hystid.building import build_afresh
from hystid.errors import FmuError, HystidError, UsageError
from hystid.fmu import Driver, build, regress
from hystid.fmu.platforms import host
from hystid.fmu.reference import FOLDER, NAMESPACE, read_cells, reference_entries, table_text

SSV_SCHEMA = Path(fmpy.__file__).parent / "ssp" / "schema" / "SystemStructureParameterValues.xsd"


def read_table(text):
    """Times and columns of a table of numbers."""
    t, cells = read_cells(text)
    return t, {name: np.array(column, float) for name, column in cells.items()}


@pytest.mark.parametrize("version", [2, 3])
@pytest.mark.parametrize("make", EVERY)
def test_every_fmu_answers_as_it_says(make, version):
    result = regress(built(make, version))
    assert result.passed, result.summary()
    assert {s.name for s in result.signals} == {v.name for v in make().variables if v.causality == "output"}


def test_the_manifest_is_of_the_layered_standard():
    with zipfile.ZipFile(built(jenkins, 3)) as archive:
        root = ET.fromstring(archive.read(f"{FOLDER}/fmi-ls-manifest.xml"))
        assert root.tag == "fmiReferences"
        assert root.get(f"{{{NAMESPACE}}}fmi-ls-name") == "org.fmi-standard.fmi-ls-ref"
        assert root.get(f"{{{NAMESPACE}}}fmi-ls-version") == "1.0.0-beta.1"
        related = {e.get("role"): e.get("source") for e in root.iter("Related")}
        for role, place in (("document", "documentation/index.html"), ("model", "sources/model.c")):
            assert related.pop(role) == f"../../{place}" and place in archive.namelist()
        values = etree.fromstring(archive.read(f"{FOLDER}/{related.pop('parameter')}"))
        etree.XMLSchema(file=str(SSV_SCHEMA)).assertValid(values)
        found = {p.get("name"): float(p[0].get("value")) for p in values.iter("{*}Parameter")}
        assert found == {v.name: v.start for v in jenkins().variables if v.causality == "parameter"}
        experiments = ET.fromstring(archive.read(f"{FOLDER}/{related.pop('experiment')}"))
        assert experiments.tag == "Experiments" and experiments.get("name") == jenkins().name
        simulation, *sources = experiments.find("Experiment")
        t, _ = read_table(archive.read(f"{FOLDER}/Jenkins_out.csv").decode())
        times = {name: float(value) for name, value in simulation.attrib.items()}
        assert times == {"startTime": t[0], "stopTime": t[-1], "stepSize": jenkins().experiment.step}
        files = {"Parameters": "Jenkins.ssv", "Stimuli": "Jenkins_in.csv", "References": "Jenkins_out.csv"}
        assert {e.tag: e.get("source") for e in sources} == files
        assert related == {"result": "Jenkins_out.csv", "testcase": "Jenkins_in.csv"}
        for source in related.values():
            t, columns = read_table(archive.read(f"{FOLDER}/{source}").decode())
            assert len(t) <= 251 and np.all(np.diff(t) > 0) and columns


def test_tables_keep_times_exactly_and_values_to_seven_digits():
    rng = np.random.default_rng(2)
    t, x = np.cumsum(rng.uniform(size=50)), rng.normal(size=50) * 1e-7
    again_t, columns = read_table(table_text(t, {"x, odd name": x}))
    np.testing.assert_array_equal(again_t, t)
    np.testing.assert_allclose(columns["x, odd name"], x, rtol=5.1e-7)
    np.testing.assert_array_equal(read_table(table_text(t, columns))[1]["x, odd name"], columns["x, odd name"])


def other_stiffness(tmp_path):
    """The linear oscillator with 2 % more stiffness and the reference of the right one."""
    code = linear()
    wrong = replace(code, sources={"model.c": code.sources["model.c"].replace("[K] = 800", "[K] = 816")})
    return build(wrong, tmp_path / "linear.fmu", extra=reference_entries(code), reference=False).path


def test_a_changed_model_is_found_shown_and_accepted(tmp_path):
    path = other_stiffness(tmp_path)
    result = regress(path)
    assert not result.passed
    assert {s.name: s.text(result.t).split()[-1] for s in result.signals} == {"x": "m", "v": "m/s", "R": "N"}
    assert "leaves the tube at t = " in result.summary() and result.summary().startswith("linear.fmu: differs")
    picture = ET.fromstring(result.picture())
    assert picture.tag.endswith("svg") and len(list(picture.iter("{http://www.w3.org/2000/svg}circle"))) > 10
    assert regress(path, update=True).updated
    assert regress(path).passed


def test_the_tube_has_the_stated_height(tmp_path):
    path = other_stiffness(tmp_path)
    worst = {s.name: s for s in regress(path).signals}["x"]
    shift = np.max(np.abs(worst.values - worst.reference)) / np.ptp(worst.reference)
    assert not regress(path, relative=shift / 4).passed
    assert regress(path, relative=20 * shift).passed


def test_a_reference_beside_the_file_is_used_and_updated(tmp_path):
    path = build(linear(), tmp_path / "plain.fmu", reference=False).path
    with pytest.raises(FmuError, match=r"carries no reference results, and plain_out\.csv is not beside it"):
        regress(path)
    t = np.linspace(0, 1, 101)
    (tmp_path / "plain_in.csv").write_text(table_text(t, {"F": np.sin(9 * t)}))
    (tmp_path / "plain_out.csv").write_text(table_text(t, {"x": np.zeros(101), "v": np.zeros(101)}))
    assert not regress(path).passed
    regress(path, update=True)
    assert regress(path).passed
    assert np.ptp(read_table((tmp_path / "plain_out.csv").read_text())[1]["x"]) > 0


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("time,x\n", "cannot be read"),
        ("t,x\n0,1\n", "not named time"),
        ("time,y\n0,1\n1,1\n", "names 'y', which is no variable"),
        ("time,x\n0,a\n", "cannot be read"),
    ],
)
def test_a_bad_reference_gets_one_sentence(tmp_path, text, sentence):
    path = build(linear(), tmp_path / "bad.fmu", reference=False).path
    (tmp_path / "bad_out.csv").write_text(text)
    with pytest.raises(FmuError, match=sentence):
        regress(path)


@pytest.mark.parametrize("row", ["0,inf", "0,nan", "0,1e308\n0.1,1e308\n0.2,-1e308\n0.3,-1e308", f"0,{'9' * 400}"])
def test_a_reference_without_finite_range_is_no_excuse(tmp_path, row):
    """One infinite value, or a range that overflows, made the tube infinitely high: everything passed."""
    path = build(linear(), tmp_path / "odd.fmu", reference=False).path
    (tmp_path / "odd_out.csv").write_text(f"time,x\n{row}\n1,2\n")
    result = regress(path)
    assert not result.passed
    with warnings.catch_warnings(action="error"):
        assert "nan" not in result.picture()


def test_times_of_an_input_that_are_not_in_order_get_one_sentence(tmp_path):
    path = build(linear(), tmp_path / "bad.fmu", reference=False).path
    (tmp_path / "bad_out.csv").write_text("time,x\n0,0\n1,0\n")
    for rows in ("1,0\n0,1\n", "nan,0\n"):
        (tmp_path / "bad_in.csv").write_text(f"time,F\n{rows}")
        with pytest.raises(FmuError, match="input of its reference cannot be read: its times are not in order"):
            regress(path)


def test_a_model_without_answer_gets_no_reference():
    code = effect()
    broken = replace(code, sources={"model.c": code.sources["model.c"].replace("[K3] = 1e6", "[K3] = -1")})
    assert reference_entries(broken) == {}


SUITE = """
def test_oscillator(fmu_regression):
    result = fmu_regression("linear.fmu")
    assert result.signals
"""


def run_pytest(folder, *options):
    plugin = [] if any(e.name == "hystid" for e in entry_points(group="pytest11")) else ["-p", "hystid.pytest_plugin"]
    command = [
        sys.executable,
        "-m",
        "pytest",
        "-q",
        *plugin,
        "-p",
        "no:cacheprovider",
        f"--basetemp={folder}/tmp",
        *options,
    ]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True)


def test_the_fixture_in_a_suite_of_ones_own(tmp_path):
    (tmp_path / "suite").mkdir()
    other_stiffness(tmp_path / "suite")  # the FMU lies beside the test, not where pytest was started
    (tmp_path / "suite" / "test_own.py").write_text(SUITE)
    failed = run_pytest(tmp_path)
    assert failed.returncode == 1 and "leaves the tube" in failed.stdout, failed.stdout + failed.stderr
    picture = next((tmp_path / "tmp").rglob("linear_difference.svg"))
    ET.parse(picture)
    assert run_pytest(tmp_path, "--fmu-update").returncode == 0
    assert run_pytest(tmp_path).returncode == 0


ENDING = """<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="2.0" modelName="Ending" guid="{ending}">
  <CoSimulation modelIdentifier="Ending" canHandleVariableCommunicationStepSize="true"/>
  <ModelVariables>
    <ScalarVariable name="x" valueReference="0" causality="output" variability="continuous" initial="calculated">
      <Real/></ScalarVariable>
    <ScalarVariable name="n" valueReference="1" causality="output" variability="discrete" initial="calculated">
      <Integer/></ScalarVariable>
    <ScalarVariable name="text" valueReference="2" causality="output" variability="discrete" initial="calculated">
      <String/></ScalarVariable>
  </ModelVariables>
  <ModelStructure><Outputs><Unknown index="1"/><Unknown index="2"/><Unknown index="3"/></Outputs></ModelStructure>
</fmiModelDescription>
"""


@pytest.fixture
def ending(tmp_path):
    """An FMU of another tool, which asks for the end of the simulation at 0.5 s."""
    if host() != "x86_64-linux" or not shutil.which("gcc"):
        pytest.skip("needs gcc on Linux, x86_64")
    command = ["gcc", "-shared", "-fPIC", MODELS / "ending.c", "-o", tmp_path / "Ending.so"]
    subprocess.run(command, check=True)
    with zipfile.ZipFile(tmp_path / "ending.fmu", "w") as archive:
        archive.writestr("modelDescription.xml", ENDING)
        archive.write(tmp_path / "Ending.so", "binaries/linux64/Ending.so")
    return tmp_path / "ending.fmu"


def test_an_fmu_may_end_the_simulation(ending):
    driver = Driver(ending)
    np.testing.assert_allclose(driver.simulate(np.arange(6) * 0.1, outputs=["x"])["x"], np.arange(6) * 0.2)
    with pytest.raises(FmuError, match=r"asked for the end .* at t = 0\.5 s, before the last time 0\.7 s"):
        driver.simulate(np.arange(8) * 0.1)


def test_texts_and_discrete_signals_are_compared(ending):
    rows = [f"{0.1 * k!r},{0.2 * k!r},{k},{'some text' if k < 3 else 'another'}" for k in range(6)]
    beside = ending.with_name("ending_out.csv")
    beside.write_text("\n".join(["time,x,n,text", *rows]))
    result = regress(ending)
    assert [signal.name for signal in result.signals] == ["x", "n", "text"] and result.passed, result.summary()
    beside.write_text(beside.read_text().replace("another", "a third"))
    result = regress(ending)
    assert not result.passed
    assert "text: is 'another' at t = 0.3 s, where the reference has 'a third'" in result.summary()
    regress(ending, update=True)
    assert regress(ending).passed
    beside.write_text("\n".join(["time,n", *(f"{0.1 * k!r},{k + 2}" for k in range(6))]))
    assert "n: is 0 at t = 0 s, where the reference has 2" in regress(ending).summary()
    for text, sentence in (("time,y\n0,1", "no variable"), ("time,x\n0,1\n1", "rows differ in length")):
        beside.write_text(text)
        with pytest.raises(FmuError, match=sentence):
            regress(ending)


def test_an_input_on_other_times_is_carried_over_and_rows_around_an_event_are_compared_both(tmp_path):
    path = build(linear(), tmp_path / "plain.fmu", reference=False).path
    t = np.linspace(0, 1, 101)
    (tmp_path / "plain_in.csv").write_text(table_text(np.array([0.0, 1.0]), {"F": np.array([0.0, 5.0])}))
    x = Driver(path).simulate(t, {"F": 5 * t}, outputs=["x"])["x"]
    twice = np.insert(t, 50, t[50]), np.insert(x, 50, x[50])
    (tmp_path / "plain_out.csv").write_text(table_text(twice[0], {"x": twice[1]}))
    result = regress(path)
    assert result.passed and len(result.t) == 102


def test_a_reference_of_another_fmu_a_folder_or_a_table(tmp_path):
    """What a rebuilt FMU carries is its own answer: the old one, or a table, still finds the change."""
    old = build(linear(), tmp_path / "old.fmu").path
    (tmp_path / "new").mkdir()
    code = linear()
    wrong = replace(code, sources={"model.c": code.sources["model.c"].replace("[K] = 800", "[K] = 816")})
    new = build(wrong, tmp_path / "new" / "old.fmu").path
    assert regress(new).passed
    assert not regress(new, reference=old).passed and not regress(new, reference=tmp_path).passed
    with zipfile.ZipFile(old) as archive:
        for end in ("in", "out"):
            name = next(n for n in archive.namelist() if n.endswith(f"_{end}.csv"))
            (tmp_path / f"kept_{end}.csv").write_bytes(archive.read(name))
    table = tmp_path / "kept_out.csv"
    assert not regress(new, reference=table).passed and regress(old, reference=table).passed
    tables = tmp_path / "tables"
    tables.mkdir()
    for end in ("in", "out"):
        (tables / f"old_{end}.csv").write_bytes((tmp_path / f"kept_{end}.csv").read_bytes())
    assert regress(old, reference=tables).passed and not regress(new, reference=tables).passed
    regress(new, reference=table, update=True)
    assert regress(new, reference=table).passed and not regress(old, reference=table).passed
    before = old.read_bytes()
    with pytest.raises(UsageError, match="which is another FMU"):
        regress(new, reference=old, update=True)
    assert old.read_bytes() == before
    for reference, sentence in ((tmp_path / "none.fmu", "there is no such file"),
                                (tmp_path / "new" / "old.fmu", None), (Path(__file__), "must be an FMU, a folder"),
                                (MODELS, "it holds neither old_out.csv nor old.fmu")):  # fmt: skip
        if sentence:
            with pytest.raises(HystidError, match=sentence):
                regress(new, reference=reference)


def test_a_table_without_inputs_is_told_and_one_with_them_drives(tmp_path):
    path = build(linear(), tmp_path / "plain.fmu", reference=False).path
    t = np.linspace(0.0, 0.1, 101)
    force = np.sin(40 * t)
    x = Driver(path).simulate(t, {"F": force}, outputs=("x",))["x"]
    rows = [f"{a:.9g},{b:.9g},{c:.9g}" for a, b, c in zip(t, force, x, strict=True)]
    (tmp_path / "both.csv").write_text("time,F,x\n" + "\n".join(rows))
    (tmp_path / "alone.csv").write_text(
        "time,x\n" + "\n".join(row.split(",")[0] + "," + row.split(",")[2] for row in rows)
    )
    assert regress(path, reference=tmp_path / "both.csv").passed
    alone = regress(path, reference=tmp_path / "alone.csv")
    assert not alone.passed and "at their start values, for the reference gives no input: F" in alone.summary()
    (tmp_path / "force.csv").write_text("time,F\n" + "\n".join(row.rpartition(",")[0] for row in rows))
    none = regress(path, reference=tmp_path / "force.csv")  # what drives the FMU agreed with itself
    assert not none.passed and "nothing could be compared" in none.summary()


def test_a_rebuild_keeps_the_reference_and_says_what_changed(tmp_path):
    path = tmp_path / "rig.fmu"
    assert hystid.build("HystId.Oscillators.Linear", path).changes is None
    assert hystid.build("HystId.Oscillators.Linear", path).changes == () and regress(path).passed
    changes = hystid.build("HystId.Oscillators.Linear", path, fmi=3, parameters={"Kl": 2e4}).changes
    assert any("Kl" in line and "-> 20000" in line for line in changes)
    assert any("leaves the tube" in line for line in changes)
    assert fmu_checker.problems(path) == [] and not regress(path).passed
    assert regress(path, update=True).updated and regress(path).passed
    changes = hystid.build("HystId.Forces.Jenkins", path).changes  # of other variables: the old result still stands
    assert any(line.startswith("gone: ") for line in changes) and any(
        "no variable of the FMU" in line for line in changes
    )
    with pytest.raises(FmuError, match="no variable of the FMU"):
        regress(path)
    assert build_afresh("HystId.Forces.Jenkins", path).changes is None
    assert regress(path).passed


def test_a_model_without_an_answer_to_the_old_reference_is_built_and_told(tmp_path):
    """So stiff that the old steps end in no finite number."""
    path = tmp_path / "linear.fmu"
    hystid.build("HystId.Oscillators.Linear", path)
    changes = hystid.build("HystId.Oscillators.Linear", path, parameters={"B": 1e8}).changes
    assert any("found no answer" in line for line in changes)
    assert {v.name: v.start for v in Driver(path).model.variables}["B"] == 1e8
