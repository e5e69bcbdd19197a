"""What is inside an FMU: description, sources that build again, symbols, platforms, and a build by name."""

from __future__ import annotations

import os
import re
import shutil
import struct
import subprocess
import zipfile
import zlib
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from xml.etree import ElementTree as ET

import fmpy.validation
import fmu_checker
import numpy as np
import pytest
from fmu_models import EVERY, built, contact, jenkins, linear, memory, tuned

from hystid.errors import FmuError, ModelicaError, UsageError
from hystid.fmu import Driver, build, build_model
from hystid.fmu.build import write_zip
from hystid.fmu.interface import interface
from hystid.fmu.model_description import model_description
from hystid.fmu.platforms import host, universal
from hystid.modelcode import Variable

BOTH = pytest.mark.parametrize("version", [2, 3])
NOW = datetime(2026, 1, 2, 3, 4, 5, 678, tzinfo=UTC)


@BOTH
@pytest.mark.parametrize("make", EVERY)
def test_strict_checkers_find_nothing(make, version):
    path = built(make, version)
    assert fmu_checker.problems(path) == []
    assert fmpy.validation.validate_fmu(str(path)) == []


@BOTH
def test_the_checker_can_find(tmp_path, version):
    """Each of these defects, put into a sound FMU, is found: the checker is not blind."""
    sound = built(linear, version)
    unknown = "index" if version == 2 else "valueReference"
    defects = [
        (
            r'generationDateAndTime="[^"]*"',
            'generationDateAndTime="2026-01-01T00:00:00+00:00"',
            "generationDateAndTime",
        ),
        (r'initial="exact" (.*?)start="2.0"', r'initial="exact" \1', "schema|start value"),
        (rf'<Unknown {unknown}="\d+" dependencies="[^"]*" />', "", "Outputs|Output"),
        (r'unit="N/m"', 'unit="slug"', "slug is used and not defined"),
        (r'causality="input"', 'causality="parameter"', "not legal"),
    ]
    if version == 3:
        defects[2] = (r'<Output valueReference="\d+" dependencies="[^"]*" />', "", "the outputs are")
        defects[1] = (r' start="2.0"', "", "start value is missing")
    else:
        defects[1] = (r' start="2.0"', "", "start value is missing")
    for pattern, text, finding in defects:
        path = tmp_path / "defect.fmu"
        with zipfile.ZipFile(sound) as old, zipfile.ZipFile(path, "w") as new:
            for name in old.namelist():
                data = old.read(name)
                if name == "modelDescription.xml":
                    changed = re.sub(pattern, text, data.decode(), count=1)
                    assert changed != data.decode(), pattern
                    data = changed.encode()
                new.writestr(name, data)
        assert any(re.search(finding, problem) for problem in fmu_checker.problems(path)), finding


@BOTH
def test_description_in_detail(version):
    root = ET.fromstring(model_description(interface(contact()), version, generated=NOW, sources=["model.c"]).encode())
    assert root.get("generationDateAndTime") == "2026-01-02T03:04:05Z"
    damping = root.find("UnitDefinitions/Unit[@name='N/m']/BaseUnit").attrib
    assert damping == {"kg": "1", "s": "-2"}
    experiment = root.find("DefaultExperiment").attrib
    assert 0 < float(experiment.pop("tolerance")) < 1e-3
    assert experiment == {"startTime": "0.0", "stopTime": "1.0", "stepSize": "0.001"}
    assert (root.get("numberOfEventIndicators") == "1") == (version == 2)
    kinds = {child.tag: child.attrib for child in root if child.tag in ("ModelExchange", "CoSimulation")}
    assert set(kinds) == {"ModelExchange", "CoSimulation"}
    assert not any("Directional" in name for name in kinds["ModelExchange"])  # contact has no derivatives: no flag
    if version == 3:
        assert len(root.findall("ModelStructure/EventIndicator")) == 1
        assert kinds["CoSimulation"]["hasEventMode"] == "true"
    else:
        assert kinds["CoSimulation"]["canInterpolateInputs"] == "true"


@BOTH
def test_dependencies_name_inputs_and_states_only(version):
    model = interface(linear())
    root = ET.fromstring(model_description(model, version, generated=NOW, sources=[]).encode())
    if version == 2:
        names = [v.name for v in model.variables]
        found = {
            names[int(u.get("index")) - 1]: {names[int(i) - 1] for i in u.get("dependencies").split()}
            for u in root.iterfind("ModelStructure/Derivatives/Unknown")
        }
    else:
        names = {str(v.slot): v.name for v in model.variables}
        found = {
            names[u.get("valueReference")]: {names[i] for i in u.get("dependencies").split()}
            for u in root.iterfind("ModelStructure/ContinuousStateDerivative")
        }
    assert found == {"der(x)": {"v"}, "der(v)": {"F", "x", "v"}}


@BOTH
def test_awkward_variables_become_legal(tmp_path, version):
    """Aliases, constants, whole numbers, truth values, names and texts that XML and C must quote."""
    code = linear()
    more = (
        Variable("R_again", 9, "local", "continuous", start=0.0, unit="N", description='a "quoted" <alias> & more'),
        Variable("k_copy", 3, "calculatedParameter", "fixed", unit="N/m"),
    )
    description = "two\nlines & <signs>"
    code = replace(code, variables=(*code.variables, *more), description=description)
    path = build(code, tmp_path / "awkward.fmu", fmi=version).path
    assert fmpy.validation.validate_fmu(str(path)) == []
    assert [p for p in fmu_checker.problems(path) if "k_copy" not in p] == []


@BOTH
def test_sources_inside_build_again(tmp_path, version):
    """The library made from the FMU's own sources and build description gives the same results as the shipped one."""
    with zipfile.ZipFile(built(jenkins, version)) as archive:
        archive.extractall(tmp_path)
    description = ET.parse(tmp_path / "modelDescription.xml").getroot()
    if version == 3:
        files = (
            ET.parse(tmp_path / "sources" / "buildDescription.xml").getroot().find("BuildConfiguration/SourceFileSet")
        )
        names, options = [f.get("name") for f in files.iterfind("SourceFile")], files.get("compilerOptions").split()
    else:
        names = [f.get("name") for f in description.iterfind("CoSimulation/SourceFiles/File")]
        options = ["-O2", "-ffp-contract=off"]
    library = next((tmp_path / "binaries").rglob("*.so"))
    library.unlink()
    compiler = shutil.which("cc") or shutil.which("gcc")
    subprocess.run(
        [compiler, *options, "-fPIC", "-shared", *names, "-o", library, "-lm"], cwd=tmp_path / "sources", check=True
    )
    again = tmp_path / "again.fmu"
    with zipfile.ZipFile(again, "w") as archive:
        for path in tmp_path.rglob("*"):
            if path.is_file() and path != again:
                archive.write(path, path.relative_to(tmp_path))
    t = np.arange(200) * 1e-4
    inputs = {"F": 60 * np.sin(100 * t)}
    one, two = (Driver(p).simulate(t, inputs) for p in (built(jenkins, version), again))
    for name in one:
        np.testing.assert_array_equal(one[name], two[name])


TWO_FMUS = """
#include <stdio.h>
extern const char *Jenkins_fmi{v}GetVersion(void), *Linear_fmi{v}GetVersion(void);
int main(void) {{ return puts(Jenkins_fmi{v}GetVersion()) + puts(Linear_fmi{v}GetVersion()) < 0; }}
"""


@pytest.mark.skipif(not (shutil.which("nm") and shutil.which("gcc")), reason="needs nm and gcc")
@BOTH
def test_two_source_fmus_in_one_program(tmp_path, version):
    """With a prefix every global name of an FMU carries it, so that two of them can be linked into one program."""
    (tmp_path / "main.c").write_text(TWO_FMUS.format(v=version))
    objects = []
    for name, make in (("Jenkins", jenkins), ("Linear", linear)):
        with zipfile.ZipFile(built(make, version)) as archive:
            archive.extractall(tmp_path / name)
        sources = tmp_path / name / "sources"
        files = sorted(path.name for path in sources.glob("*.c"))
        prefix = f"-DFMI{version}_FUNCTION_PREFIX={name}_"
        subprocess.run(["gcc", "-c", "-O0", prefix, *files], cwd=sources, check=True)
        objects += sources.glob("*.o")
        command = ["nm", "--defined-only", "--extern-only", *sources.glob("*.o")]
        lines = subprocess.run(command, capture_output=True, text=True, check=True).stdout.splitlines()
        names = [line.split()[-1] for line in lines if len(line.split()) == 3]
        assert sum(f"{name}_fmi{version}" in found for found in names) > 40
        assert [found for found in names if not found.startswith(f"{name}_")] == []
    program = tmp_path / "program"
    subprocess.run(["gcc", tmp_path / "main.c", *objects, "-lm", "-o", program], check=True)
    assert subprocess.run([program], capture_output=True, text=True, check=True).stdout.split() == [f"{version}.0"] * 2


@pytest.mark.skipif(not shutil.which("nm"), reason="needs nm")
@BOTH
def test_only_fmi_and_the_batch_entry_are_visible(tmp_path, version):
    with zipfile.ZipFile(built(jenkins, version)) as archive:
        archive.extractall(tmp_path)
    library = next((tmp_path / "binaries").rglob("*.so"))
    lines = subprocess.run(["nm", "-D", "--defined-only", library], capture_output=True, text=True, check=True).stdout
    symbols = {line.split()[-1] for line in lines.splitlines()}
    assert {s for s in symbols if not s.startswith(f"fmi{version}")} == {"hy_run_table"}
    table = subprocess.run(["nm", "--format=sysv", library], capture_output=True, text=True, check=True).stdout
    rows = [[cell.strip() for cell in line.split("|")] for line in table.splitlines() if line.count("|") == 6]
    writable = {name for name, *_, section in rows if section in (".data", ".bss")}
    start_up = {
        "completed.0",
        "__dso_handle",
        "__TMC_END__",
        "_edata",
        "__bss_start",
        "_end",
        "_DYNAMIC",
        "__data_start",
    }
    assert writable <= start_up  # of the compiler's run-time; nothing of ours can be written


def test_the_same_content_gives_the_same_bytes(tmp_path, monkeypatch):
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "1700000000")
    one, two = (build(linear(), tmp_path / name, fmi=3).path.read_bytes() for name in ("a.fmu", "b.fmu"))
    assert one == two


def test_an_fmu_is_small(tmp_path):
    with zipfile.ZipFile(built(jenkins, 2)) as archive:
        size = sum(entry.file_size for entry in archive.infolist() if entry.filename.startswith("binaries/"))
    assert size < 100_000


@pytest.mark.parametrize(
    ("change", "options", "error", "sentence"),
    [
        ({}, {"fmi": 1}, UsageError, "fmi must be 2 or 3"),
        ({}, {"platforms": "amiga"}, UsageError, "'amiga' is not a platform"),
        ({"token": ""}, {}, FmuError, "no instantiation token"),
        ({"states": ("x", "v", "y")}, {}, FmuError, "variable 'y'|derivative of state 'y'"),
        ({"sources": {"hy_engine.c": ""}}, {}, FmuError, "name of a file of the shell"),
    ],
)
def test_wrong_builds_write_nothing(tmp_path, change, options, error, sentence):
    with pytest.raises(error, match=sentence):
        build(replace(linear(), **change), tmp_path / "no.fmu", **options)
    assert list(tmp_path.iterdir()) == []


def test_build_by_name_is_remembered(tmp_path, monkeypatch):
    monkeypatch.setenv("HYSTID_CACHE", str(tmp_path / "cache"))
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "1700000000")
    made = build_model("HystId.Oscillators.Linear", tmp_path / "one.fmu", parameters={"Kl": 1e4})
    again = build_model("HystId.Oscillators.Linear", tmp_path / "two.fmu", parameters={"Kl": 1e4})
    other = build_model("HystId.Oscillators.Linear", tmp_path / "three.fmu", parameters={"Kl": 2e4})
    assert made.path.read_bytes() == again.path.read_bytes() != other.path.read_bytes()
    assert len(list((tmp_path / "cache").glob("*.fmu"))) == 2
    assert Driver(other.path).model.variable("Kl").start == 2e4
    assert fmu_checker.problems(made.path) == []


def test_a_changed_file_is_built_anew(tmp_path, monkeypatch):
    monkeypatch.setenv("HYSTID_CACHE", str(tmp_path / "cache"))
    text = "model Pull\n  parameter Real k = {k};\n  input Real x;\n  output Real f;\nequation\n  f = k*x;\nend Pull;\n"
    (tmp_path / "own").mkdir()
    source = tmp_path / "own" / "pull.mo"
    for k in (2.0, 3.0):
        source.write_text(text.format(k=k))
        build_model(str(source), tmp_path / "pull.fmu")  # the only model of its file
        force = Driver(tmp_path / "pull.fmu").simulate([0.0, 1.0], {"x": [1.0, 1.0]}, outputs=["f"])["f"]
        np.testing.assert_array_equal(force, [k, k])


def test_a_file_with_several_models_asks_for_one(tmp_path):
    (tmp_path / "two.mo").write_text("model A\nend A;\npackage P\n  model C\n  end C;\nend P;\nmodel B\nend B;\n")
    with pytest.raises(ModelicaError, match=r"name the model, as .*two\.mo:A; its models are A, B"):
        build_model(str(tmp_path / "two.mo"), tmp_path / "no.fmu")


def test_a_size_within_a_component_is_set_by_its_own_name(tmp_path, monkeypatch):
    """Sliders of the law inside the oscillator; of a size that fits nothing the message names what the user wrote."""
    path = build_model("HystId.Oscillators.Iwan", tmp_path / "iwan.fmu", parameters={"law.N": 4}).path
    assert sum(v.name.startswith("law.element[") and v.name.endswith("].z") for v in Driver(path).model.variables) == 4
    monkeypatch.setenv("HYSTID_COMPILE_SECONDS", "5")  # of the two minutes that it would be tried for
    with pytest.raises(ModelicaError) as refused:
        build_model("HystId.Oscillators.Iwan", tmp_path / "no.fmu", parameters={"law.N": 10**6})
    assert "HystidStructure" not in str(refused.value) and "Iwan" in str(refused.value)


def test_a_date_that_is_given_reaches_fmus_of_the_cache(tmp_path, monkeypatch):
    monkeypatch.setenv("HYSTID_CACHE", str(tmp_path / "cache"))
    monkeypatch.delenv("SOURCE_DATE_EPOCH", raising=False)
    build_model("HystId.Oscillators.Linear", tmp_path / "now.fmu")
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "1700000000")
    path = build_model("HystId.Oscillators.Linear", tmp_path / "then.fmu").path
    assert fmpy.read_model_description(str(path)).generationDateAndTime == "2023-11-14T22:13:20Z"
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "yesterday")
    with pytest.raises(UsageError, match="SOURCE_DATE_EPOCH=yesterday"):
        build_model("HystId.Oscillators.Linear", tmp_path / "no.fmu")


def test_platform_names():
    assert re.fullmatch(r"(x86_64|aarch64)-(linux|darwin|windows)", host())


def test_universal_files_hold_both_processors():
    """Two libraries that differ in their processor field, in one file: offsets and sizes in the header find them."""
    libraries = [
        struct.pack("<Iii", 0xFEEDFACF, cpu, 3) + bytes([fill]) * size for cpu, fill, size in ((7, 1, 100), (12, 2, 50))
    ]
    data = universal(libraries)
    magic, count = struct.unpack_from(">II", data)
    assert (magic, count) == (0xCAFEBABE, 2)
    for i, library in enumerate(libraries):
        cpu, _, offset, size, align = struct.unpack_from(">iiIII", data, 8 + 20 * i)
        assert data[offset : offset + size] == library and offset % (1 << align) == 0
        assert cpu == struct.unpack_from("<i", library, 4)[0]


def cross(tmp_path, names, version):
    pytest.importorskip("ziglang", reason="needs the extra 'cross'")
    path = build(memory(), tmp_path / "cross.fmu", fmi=version, platforms=names).path
    with zipfile.ZipFile(path) as archive:
        return {n: archive.read(n) for n in archive.namelist() if n.startswith("binaries/")}


def test_linux_on_arm_by_cross_compiler(tmp_path):
    binaries = cross(tmp_path, ["host", "aarch64-linux"], 3)
    data = binaries["binaries/aarch64-linux/Memory.so"]
    assert data[:4] == b"\x7fELF" and struct.unpack_from("<H", data, 18)[0] == 183  # EM_AARCH64
    assert len(data) < 100_000 and f"binaries/{host()}/Memory.so" in binaries


def test_linux_by_name_needs_no_newer_c_library_than_promised(tmp_path):
    """Versions of the symbols that the library takes from glibc: 2.17 at most, whatever this machine has. A model with
    pow, exp, log and sin takes those of the mathematics library, whose newer versions gcc would choose."""
    if host() != "x86_64-linux" or not shutil.which("objdump"):
        pytest.skip("needs objdump on Linux, x86_64")
    pytest.importorskip("ziglang", reason="needs the extra 'cross'")
    (tmp_path / "Math.mo").write_text(
        "model Math input Real u(start=2); output Real y = u^2.5 + exp(u) + log(u + 3) + sin(u) + atan2(u, 2); "
        "Real x(start=1, fixed=true); equation der(x) = -x*abs(u)^1.5; end Math;"
    )
    path = build_model(f"{tmp_path / 'Math.mo'}:Math", tmp_path / "m.fmu", platforms=["x86_64-linux"]).path
    with zipfile.ZipFile(path) as archive:
        library = Path(archive.extract("binaries/linux64/Math.so", tmp_path))
    listed = subprocess.run(["objdump", "-T", library], capture_output=True, text=True, check=True).stdout
    versions = {tuple(map(int, v.split("."))) for v in re.findall(r"GLIBC_([0-9.]+)", listed)}
    assert versions and max(versions) <= (2, 17), sorted(versions)
    assert "pow" in listed and Driver(path).simulate([0, 1e-4], {"u": [2.0, 2.0]})["y"][0] > 0


@pytest.mark.skipif(not os.environ.get("HYSTID_CROSS"), reason="minutes at the first time: set HYSTID_CROSS=1")
@BOTH
def test_all_platforms_in_one_fmu(tmp_path, version):
    binaries = cross(tmp_path, "all", version)
    names = {Path(name).parent.name for name in binaries}
    if version == 3:
        assert names == {"x86_64-linux", "aarch64-linux", "x86_64-windows", "x86_64-darwin", "aarch64-darwin"}
    else:
        assert names == {"linux64", "aarch64-linux", "win64", "darwin64"}
    windows = next(data for name, data in binaries.items() if name.endswith(".dll"))
    assert windows[:2] == b"MZ"
    two = version == 2  # Macs, which share a file
    # docs/fmu.md: 20 to 60 kB zipped
    assert all(len(zlib.compress(d)) < 60_000 * (1 + (two and "darwin" in n)) for n, d in binaries.items())


EXPLICIT = """
model Explicit "what depends on time and parameters, and a second name that declares no unit"
  parameter Real k = 2;
  parameter Real unused = 3;
  parameter Real T(unit = "s") = 1;
  input Real u;
  Real w(unit = "rad/s", start = 1, fixed = true);
  output Real speed = w;
  output Real y = k*sin(time);
  output Boolean high(start = false, fixed = true);
  output Real held;
equation
  der(w) = (u - w)/T;
  when w > 2 then
    high = not pre(high);
  end when;
  held = if high then y else 0;
end Explicit;
"""


@BOTH
def test_dependencies_and_units_of_a_modelica_model(tmp_path, version):
    """Time is a known like any other (FMI 2.0.4, 2.2.8); in FMI 3.0 parameters and discrete states are, too (2.4.8)."""
    (tmp_path / "Explicit.mo").write_text(EXPLICIT)
    path = build_model(f"{tmp_path / 'Explicit.mo'}:Explicit", tmp_path / "explicit.fmu", fmi=version).path
    assert fmu_checker.problems(path) == []
    with zipfile.ZipFile(path) as archive:
        root = ET.fromstring(archive.read("modelDescription.xml"))
    elements = list(root.find("ModelVariables"))
    if version == 2:
        name = {str(i + 1): e.get("name") for i, e in enumerate(elements)}
        units = {e.get("name"): e[0].get("unit") for e in elements}
        rows = [(u.get("index"), u) for u in root.iterfind("ModelStructure/Outputs/Unknown")]
        assert units["speed"] == units["w"] == "rad/s"
    else:
        name = {e.get("valueReference"): e.get("name") for e in elements}
        rows = [(u.get("valueReference"), u) for u in root.iterfind("ModelStructure/Output")]
        assert {e.get("name"): e.get("unit") for e in elements}["speed"] == "rad/s"
    found = {name[key]: {name[i] for i in u.get("dependencies").split()} for key, u in rows}
    assert found["y"] == ({"time"} if version == 2 else {"time", "k"})
    assert found["held"] == ({"time"} if version == 2 else {"time", "k", "high"})


def test_what_intermediate_update_mode_can_reach():
    root = ET.fromstring(model_description(interface(tuned()), 3, generated=NOW, sources=[]).encode())
    marked = {e.get("name") for e in root.find("ModelVariables") if e.get("intermediateUpdate") == "true"}
    assert marked == {"y"}  # neither parameters, nor the discrete input, nor time


def test_event_indicators_get_names_of_their_own():
    code = contact()
    code = replace(code, variables=(*code.variables, Variable("eventIndicator[1]", 11, "local", "discrete")))
    root = ET.fromstring(model_description(interface(code), 3, generated=NOW, sources=[]).encode())
    names = [e.get("name") for e in root.find("ModelVariables")]
    assert "eventIndicator_[1]" in names and len(set(names)) == len(names)


@pytest.mark.parametrize(
    ("entry", "problem"),
    [
        ("documentation/page.html", "no index.html"),
        ("extra/ours/x.txt", "no reversed domain name"),
        ("/absolute.txt", "not plain and relative"),
        ("sources\\x.c", "not plain and relative"),
        ("readme.txt", "no name of the standard"),
        ("binaries/amiga/x.so", "no platform"),
        ("binaries/linux64/Linear.dll", "suffix"),
    ],
)
def test_the_checker_knows_the_layout(tmp_path, entry, problem):
    path = tmp_path / "changed.fmu"
    with zipfile.ZipFile(built(linear, 2)) as given:
        content = {name: given.read(name) for name in given.namelist() if not name.startswith("documentation/")}
    write_zip(path, content)
    assert fmu_checker.problems(path) == []
    with zipfile.ZipFile(path, "a") as archive:
        archive.writestr(zipfile.ZipInfo(entry), b"linear")
    assert any(problem in found for found in fmu_checker.problems(path))


@pytest.mark.parametrize(
    ("name", "good"),
    [
        ("a.b[1,2].c", True),
        ("der(a[1].b)", True),
        ("der(x,2)", True),
        ("'a b'.c", True),
        ("a[i]", False),
        ("a-b", False),
        ("state[Rh[1]]", False),
        ("1a", False),
        ("", False),
    ],
)
def test_the_checker_knows_structured_names(name, good):
    assert bool(fmu_checker._STRUCTURED.fullmatch(name)) is good
