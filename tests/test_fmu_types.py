"""FMUs of others with every type of FMI 3.0: what goes in comes out, and a regression sees each of them."""

from __future__ import annotations

import shutil
import subprocess
import zipfile
from pathlib import Path

import numpy as np
import pytest

from hystid.errors import FmuError
from hystid.fmu import Driver, regress
from hystid.fmu.platforms import host

FOLDER = Path(__file__).parent / "foreign_fmu"
TYPES = ("Float32", "Float64", "Int8", "UInt8", "Int16", "UInt16", "Int32", "UInt32", "Int64", "UInt64", "Boolean",
         "Enumeration", "String", "Binary", "Array")  # fmt: skip
# type -> (cells of the input, another cell of the output that the wrong model gives)
INPUT = {
    "Float32": ("0.25", "0.5"), "Float64": ("0.1", "0.7"), "Int8": ("-128", "127"), "UInt8": ("255", "0"),
    "Int16": ("-32768", "32767"), "UInt16": ("65535", "1"), "Int32": ("-2147483648", "2147483647"),
    "UInt32": ("4294967295", "7"), "Int64": ("-9223372036854775808", "9223372036854775807"),
    "UInt64": ("18446744073709551615", "3"), "Boolean": ("false", "true"), "Enumeration": ("1", "2"),
    "String": ("stick", "slip, after a comma"), "Binary": ("00ff", "a5c3"), "Array": ("1.5 -2.5", "3.5 4.5"),
}  # fmt: skip


def description() -> str:
    rows = []
    for i, name in enumerate(TYPES):
        tag, inside = ("Float64", '<Dimension start="2"/>') if name == "Array" else (name, "")
        start = {"String": "", "Binary": "", "Array": ' start="0 0"'}.get(name, ' start="0"')
        start = ' start="1"' if name == "Enumeration" else ' start="false"' if name == "Boolean" else start
        inside += {"String": '<Start value="start"/>', "Binary": '<Start value="0000"/>'}.get(name, "")
        kind = ' declaredType="State"' if name == "Enumeration" else ""
        rows.append(f'<{tag} name="{name}_in" valueReference="{i}" causality="input"{kind}{start}>{inside}</{tag}>')
        inside = '<Dimension start="2"/>' if name == "Array" else ""
        rows.append(f'<{tag} name="{name}" valueReference="{100 + i}" causality="output"{kind}>{inside}</{tag}>')
    outputs = "".join(f'<Output valueReference="{100 + i}"/>' for i in range(len(TYPES)))
    return f"""<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="3.0" modelName="Types" instantiationToken="types">
<CoSimulation modelIdentifier="types" canHandleVariableCommunicationStepSize="true"/>
<TypeDefinitions><EnumerationType name="State"><Item name="stick" value="1"/><Item name="slip" value="2"/>
</EnumerationType></TypeDefinitions>
<ModelVariables>{"".join(rows)}
<Clock name="tick" valueReference="200" causality="output" intervalVariability="triggered"/>
<Int32 name="steps" valueReference="15" causality="local"/></ModelVariables>
<ModelStructure>{outputs}</ModelStructure></fmiModelDescription>
"""


@pytest.fixture(scope="module")
def build(tmp_path_factory):
    """broken type (or None) -> FMU whose output of that type goes wrong after 0.5 s."""
    if host() != "x86_64-linux" or not shutil.which("gcc"):
        pytest.skip("needs gcc on Linux, x86_64")
    folder = tmp_path_factory.mktemp("types")

    def make(broken: str | None) -> Path:
        which = -1 if broken is None else TYPES.index(broken)
        library = folder / f"{which}.so"
        command = ["gcc", "-shared", "-fPIC", f"-DBROKEN={which}", FOLDER / "types.c", "-o", library]
        subprocess.run(command, check=True)
        path = folder / f"types{which}.fmu"
        with zipfile.ZipFile(path, "w") as archive:
            archive.writestr("modelDescription.xml", description())
            archive.write(library, "binaries/x86_64-linux/types.so")
        for name in TYPES:
            cells = [INPUT[name][0]] * 4 + [INPUT[name][1]] * 7
            quoted = [f'"{cell}"' if "," in cell else cell for cell in cells]
            rows["in", name], rows["out", name] = quoted, [quoted[0], *quoted[:-1]]
        for end in ("in", "out"):
            lines = [",".join([f"{k / 10!r}", *(rows[end, name][k] for name in TYPES)]) for k in range(11)]
            head = ["time", *(f"{name}_in" if end == "in" else name for name in TYPES)]
            (folder / f"{path.stem}_{end}.csv").write_text("\n".join([",".join(head), *lines]) + "\n")
        return path

    rows: dict[tuple[str, str], list[str]] = {}
    return make


def test_every_type_goes_through_unchanged(build):
    result = regress(build(None))
    assert result.passed, result.summary()
    names = [signal.name for signal in result.signals]
    assert names == [*TYPES[:-1], "Array[1]", "Array[2]"] and not result.skipped and not result.new


@pytest.mark.parametrize("broken", TYPES)
def test_a_change_of_any_type_is_found(build, broken):
    path = build(broken)
    result = regress(path)
    assert not result.passed
    wrong = [signal.name for signal in result.signals if not signal.tube.holds]
    assert wrong == ["Array[2]" if broken == "Array" else broken]
    line = result.summary().splitlines()[1]
    assert line.startswith(f"  {wrong[0]}: ") and "t = 0.6 s" in line, line
    assert result.picture().count("<polyline") == 3 * 6
    regress(path, update=True)
    assert regress(path).passed


def test_values_come_as_they_are(build):
    driver = Driver(build(None))
    t = np.linspace(0, 1, 3)
    found = driver.record(
        t, {"UInt64_in": [2**64 - 1] * 3, "Array_in": np.arange(6).reshape(3, 2)}, settings={"String_in": "sliding"},
        outputs=["UInt64", "Array", "String", "steps"],
    )  # fmt: skip
    assert found["UInt64"].dtype == np.uint64 and found["UInt64"][2] == 2**64 - 1
    np.testing.assert_array_equal(found["Array"], [[0, 1], [0, 1], [2, 3]])  # the inputs of the step before
    assert list(found["String"]) == ["sliding"] * 3 and list(found["steps"]) == [0, 1, 2]
    numbers = driver.simulate(t, {"Int8_in": [1, 2, 3]}, outputs=["Int8"])
    assert numbers["Int8"].dtype == np.float64


@pytest.mark.parametrize(
    ("inputs", "sentence"),
    [
        ({"Int8_in": [0, 300, 0]}, r"'Int8_in' is 300 at sample 1, which Int8 cannot hold"),
        ({"UInt8_in": [0, 0, -1]}, r"is -1 at sample 2, which UInt8 cannot hold"),
        ({"Int32_in": [0, 0.5, 0]}, r"is 0\.5 at sample 1, which Int32 cannot hold"),
        ({"Array_in": [0, 0, 0]}, r"has shape \(3,\) where \(3, 2\) is needed"),
        ({"Float32_in": [0, np.nan, 0]}, "not finite at sample 1"),
    ],
)
def test_values_without_a_place_get_one_sentence(build, inputs, sentence):
    with pytest.raises(FmuError, match=sentence):
        Driver(build(None)).simulate([0, 0.1, 0.2], inputs)


def test_what_cannot_be_compared_is_said(build):
    path = build(None)
    table = path.with_name(f"{path.stem}_out.csv")
    table.write_text("time,tick,Int8\n0,1,0\n1,1,0\n")
    path.with_name(f"{path.stem}_in.csv").unlink()
    result = regress(path)
    assert result.passed and result.skipped == ("tick",) and "UInt8" in result.new
    assert (
        "not compared: tick" in result.summary() and "for the reference does not have them: Float32" in result.summary()
    )
    table.write_text("time,tick\n0,1\n1,1\n")
    result = regress(path)
    assert not result.passed and "nothing could be compared" in result.summary()
    for text, sentence in (("time,Int8\n0,1.5\n", "'1.5' is no value of 'Int8', which is of type Int8"),
                           ("time,Array\n0,1\n", "'Array' has 2 elements"),
                           ("time,Int8\n1,1\n0,1\n", "its times are not in order"),
                           ("time,Int8,Int8\n0,1,1\n", "a column is there twice")):  # fmt: skip
        table.write_text(text)
        with pytest.raises(FmuError, match=sentence):
            regress(path)
