"""What bad files and arguments are answered: one line, exit code 2 or 1, nothing written.

The cases run through the command line's own entry. ``python tests/test_bad_input.py`` writes the table of all of them
to docs/bad-input.md; a test keeps the two alike.
"""

from __future__ import annotations

import contextlib
import io
import re
import subprocess
import sys
import tempfile
import zipfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from hystid.cli.run import run

DOCUMENT = Path(__file__).parents[1] / "docs" / "bad-input.md"

N, DT = 400, 1e-3
T = np.arange(N) * DT
X = 1e-3 * np.sin(2 * np.pi * 9 * T)
V = 1e-3 * 18 * np.pi * np.cos(2 * np.pi * 9 * T)
F = 200 * V + 5e4 * X
GOOD = {"t [s]": T, "F [N]": F, "x [m]": X, "v [m/s]": V}


def at(values: np.ndarray, sample: int | slice, value: float) -> np.ndarray:
    changed = values.copy()
    changed[sample] = value
    return changed


def csv(columns: dict[str, np.ndarray]) -> str:
    rows = zip(*columns.values(), strict=True)
    return "\n".join([",".join(columns), *(",".join(f"{v:.9g}" for v in row) for row in rows)]) + "\n"


def modelica(text: str) -> Callable[[Path], None]:
    return lambda path: path.write_text(text) and None


def zipped(**entries: str) -> Callable[[Path], None]:
    def write(path: Path) -> None:
        with zipfile.ZipFile(path, "w") as archive:
            for name, text in entries.items():
                archive.writestr(name.replace("__", "/").replace("_xml", ".xml"), text)

    return write


def onnx_model(operator: str) -> Callable[[Path], None]:
    def write(path: Path) -> None:
        from onnx import TensorProto, helper, save

        names = [helper.make_tensor_value_info(name, TensorProto.DOUBLE, [1]) for name in ("x", "v", "state")]
        outputs = [helper.make_tensor_value_info(name, TensorProto.DOUBLE, [1]) for name in ("R", "state_next")]
        nodes = [helper.make_node(operator, ["x"], ["R"]), helper.make_node("Identity", ["state"], ["state_next"])]
        opset = [helper.make_opsetid("", 17)]
        save(helper.make_model(helper.make_graph(nodes, "bad", names, outputs), opset_imports=opset), path)

    return write


def truncated_onnx(path: Path) -> None:
    onnx_model("Tanh")(path)
    path.write_bytes(path.read_bytes()[:60])


def in_a_folder(path: Path) -> None:
    path.parent.mkdir()
    path.write_text("no model")
    Path("unseen.csv").write_text(csv({**GOOD, "F [N]": 1.1 * F}))


Content = str | bytes | Callable[[Path], None]


@dataclass(frozen=True)
class Case:
    """A bad thing, the file that holds it, the command that meets it, and words that the answer must contain."""

    what: str
    command: str
    says: str
    file: str = ""
    content: Content = ""
    code: int = 2

    def prepare(self) -> None:
        """Write the file into the working folder."""
        if not self.file:
            return
        path = Path(self.file)
        if callable(self.content):
            self.content(path)
        else:
            path.write_bytes(self.content if isinstance(self.content, bytes) else self.content.encode("utf-8"))


def recording(what: str, columns: dict[str, np.ndarray] | str, says: str, name: str = "bad.csv") -> Case:
    content = columns if isinstance(columns, str) else csv(columns)
    return Case(what, f"hystid identify {name} --mass 0 -o out", says, name, content)


def spoilt(**changes: np.ndarray) -> dict[str, np.ndarray]:
    named = {key.split(" ")[0]: key for key in GOOD}
    return {**GOOD, **{named[name]: values for name, values in changes.items()}}


RECORDINGS = [
    recording("empty file", "", "the file is empty"),
    recording("JSON under the name of a CSV", '{"t": [0, 1],\n "F": [0, 1]}\n', "this is JSON"),
    recording("header only", "t [s],F [N],x [m]\n", "no sample"),
    recording("no header", "0,1,2\n1,2,3\n", "numbers instead of names"),
    recording("one channel", "F [N]\n1\n2\n", "only one column"),
    recording("no force", {"t [s]": T, "x [m]": X}, "no channel F"),
    recording("no time", {"F [N]": F, "x [m]": X}, "no channel t"),
    recording("a header of pages", {"t [s]": T, "F [N] " + "of the test " * 5000: F, "x [m]": X}, "of the..., x; name"),
    recording("many columns", {"t [s]": T, "x [m]": X} | {f"bridge{k}": F for k in range(60)}, "and 22 more; name"),
    recording("no motion", {"t [s]": T, "F [N]": F}, "no motion x, v or a"),
    recording("3 samples", {key: values[:3] for key, values in GOOD.items()}, "3 samples"),
    recording("NaN", spoilt(x=at(X, slice(40, 60), np.nan)), "line 42, sample 40, channel x"),
    recording("a word in a cell", csv(GOOD).replace("\n0.002,", "\n0.002,abc", 1), "'abc"),
    recording("a missing cell", "t [s],F [N],x [m]\n0,1,2\n1,2\n", "2 cells where the header names 3 columns"),
    recording("reversed time", spoilt(t=T[::-1]), "time runs backwards throughout"),
    recording("duplicated time", spoilt(t=at(T, 100, T[99])), "line 102, sample 100"),
    recording("unequal steps", spoilt(t=np.cumsum(0.2 + np.abs(np.sin(np.arange(N)))) * DT), "--resample"),
    recording("gaps everywhere", spoilt(t=T + 0.5 * (np.arange(N) // 80)), "4 gaps"),
    recording("constant force", spoilt(F=np.full(N, 3.0)), "channel F: the channel is constant"),
    *(
        Case(
            f"constant force, {what}",
            f"hystid {command} -o out",
            "channel F: the channel is constant (3)",
            "bad.csv",
            csv(spoilt(F=np.full(N, 3.0))),
        )
        for what, command in (
            ("examined", "check bad.csv"),
            ("diagnosed", "diagnose bad.csv --model HystId.Oscillators.Linear"),
            ("accepted", "diagnose bad.csv --model HystId.Oscillators.Linear --accept constant"),
        )
    ),
    recording("clipped force", spoilt(F=np.clip(F, -0.6 * F.max(), 0.6 * F.max())), "cut off at"),
    recording("a loose plug", spoilt(x=at(X, slice(100, 180), X[100])), "while others move"),
    recording("x in mm, labelled m", spoilt(x=1e3 * X), "it looks like mm"),
    recording("v with the wrong sign", spoilt(v=-V), "wrong sign"),
    recording("F with the wrong sign", spoilt(F=-F), "F has the wrong sign"),
    recording("x and v exchanged", spoilt(x=V, v=X), "the columns are exchanged"),
    recording("a torque on a displacement", {"t [s]": T, "F [N.m]": F, "x [m]": X}, "say that the rig turns"),
    recording("unit of something else", {"t [s]": T, "F [mm]": F, "x [m]": X}, "cannot be converted to N"),
    recording("unknown unit", {"t [s]": T, "F [wurst]": F, "x [m]": X}, "'wurst' is not known"),
    recording("force as a voltage", {"t [s]": T, "F [V]": F, "x [m]": X}, "--sensitivity F="),
    recording("two columns of one name", {"t [s]": T, "F [N]": F, "x [m]": X, "disp [m]": X}, "both mean x"),
    recording("decimal commas between commas", "t [s],F [N],x [m]\n0,1,5,2,7,8\n", "semicolons"),
    recording("several problems at once", spoilt(F=at(F, 3, np.inf), v=np.zeros(N)), "channel v"),
    recording("a spreadsheet", "PK", "recordings are read from", "bad.xlsx"),
    recording("text named .mat", "no matrix", "not a readable MATLAB file", "bad.mat"),
    recording("text named .h5", "no tree", "not a readable HDF5 file", "bad.h5"),
    recording("text named .tdms", "no groups", "bad.tdms", "bad.tdms"),
    recording("text named .uff", "no sets", "bad.uff", "bad.uff"),
    Case("missing file", "hystid identify missing.csv --mass 0 -o out", "there is no such file"),
]

DRIVE = "hystid simulate bad.fmu --force harmonic:20Hz@80N,2s -o out.csv"
FMUS = [
    Case("not a zip file", DRIVE, "bad.fmu", "bad.fmu", "no zip"),
    Case("empty FMU", DRIVE, "bad.fmu", "bad.fmu", ""),
    Case("zip without modelDescription.xml", DRIVE, "modelDescription.xml", "bad.fmu", zipped(readme="x")),
    Case(
        "zip with ../ in a name", DRIVE, "../", "bad.fmu", zipped(**{"..__evil": "x", "modelDescription_xml": "<a/>"})
    ),
    Case("broken XML", DRIVE, "bad.fmu", "bad.fmu", zipped(modelDescription_xml="<fmiModelDescription")),
    Case("missing FMU", DRIVE, "bad.fmu"),
]

CHECK = "hystid validate bad.onnx good.csv -o out"
NETWORKS = [
    Case("truncated ONNX file", CHECK, "bad.onnx", "bad.onnx", truncated_onnx),
    Case("not an ONNX file", CHECK, "bad.onnx", "bad.onnx", "no network"),
    Case("unknown operator", CHECK, "Wurst", "bad.onnx", onnx_model("Wurst")),
]

MODELICA = [
    Case("class not found", "hystid build HystId.Oscillators.Jenkin -o out.fmu", "HystId.Oscillators.Jenkins"),
    Case("class not in the file", "hystid build bad.mo:Other -o out.fmu", "Other", "bad.mo", "model A\nend A;\n"),
    Case(
        "syntax error", "hystid build bad.mo:A -o out.fmu", "bad.mo:3", "bad.mo",
        "model A\n  Real x;\nequation x = = 1;\nend A;\n",
    ),
    Case(
        "unknown name", "hystid build bad.mo:A -o out.fmu", "bad.mo:4", "bad.mo",
        "model A\n  Real x;\nequation\n  x = y;\nend A;\n",
    ),
    Case(
        "more unknowns than equations", "hystid build bad.mo:A -o out.fmu", "bad.mo", "bad.mo",
        "model A\n  Real x;\n  Real y;\nequation\n  x = 1;\nend A;\n",
    ),
    Case(
        "metres added to newtons", "hystid build bad.mo:A -o out.fmu", "N", "bad.mo",
        'model A\n  parameter Real a(unit="m") = 1;\n  parameter Real b(unit="N") = 1;\n  output Real c;\n'
        "equation\n  c = a + b;\nend A;\n",
    ),
    Case("missing Modelica file", "hystid build missing.mo:A -o out.fmu", "missing.mo"),
]  # fmt: skip

ARGUMENTS = [
    Case("unknown command", "hystid analyse", "No such command"),
    Case("missing option", "hystid identify good.csv -o out", "--mass"),
    Case("misspelt option", "hystid identify good.csv --mas 0 -o out", "--mass"),
    Case("negative mass", "hystid identify good.csv --mass -1 -o out", "mass"),
    Case("impossible layers", "hystid identify good.csv --mass 0 --layers 5,x -o out", "as 5,5"),
    Case("band upside down", "hystid identify good.csv --mass 0 --band 500-5Hz -o out", "lower one first"),
    Case("band above half the sample rate", "hystid identify good.csv --mass 0 --band 0-900Hz -o out", "500 Hz"),
    Case("decimation to nothing", "hystid identify good.csv --mass 0 --decimate 100 -o out", "--decimate 100"),
    Case(
        "recording that is trained and held out", "hystid identify good.csv --mass 0 --holdout good.csv -o out", "good"
    ),
    Case("unknown door rule", "hystid identify good.csv --mass 0 --accept gaps -o out", "the rules are"),
    Case("unknown parameter", "hystid build HystId.Oscillators.Jenkins --set ks=1 -o out.fmu", "Ks"),
    Case("parameter without value", "hystid build HystId.Oscillators.Jenkins --set Ks -o out.fmu", "NAME=VALUE"),
    Case("parameter that is no number", "hystid build HystId.Oscillators.Jenkins --set Ks=stiff -o out.fmu", "finite"),
    Case(
        "force without duration", "hystid simulate a.fmu --force chirp:0-100Hz@60N -o out.csv", "chirp:0-100Hz@60N,5s"
    ),
    Case("misspelt force", "hystid simulate a.fmu --force chrip:0-9Hz@60N,5s -o out.csv", "kinds are"),
    Case("output of the wrong kind", "hystid build HystId.Oscillators.Jenkins -o out.zip", "must end in .fmu"),
    Case("FMI 4", "hystid build HystId.Oscillators.Jenkins --fmi 4 -o out.fmu", "2 and 3"),
    Case("nothing to compare with", "hystid validate a.onnx -o out", "recordings or a reference FMU"),
    Case(
        "parameter file that is no JSON",
        "hystid diagnose good.csv --model HystId.Oscillators.Jenkins --parameters p.json -o out",
        "not JSON",
        "p.json",
        "{",
    ),
    *(
        Case(
            f"folder without a model, {command.split()[0]}",
            f"hystid {command} --model rig -o out",
            "this folder holds no extended.mo",
            "rig/notes.txt",
            in_a_folder,
            2,
        )
        for command in ("diagnose good.csv", "identify good.csv --mass 0 --holdout unseen.csv")
    ),
    Case("baseline class not found", "hystid diagnose good.csv --model HystId.Oscillators.Jenkin -o out", "Jenkin"),
]

GROUPS = {
    "Recordings": RECORDINGS,
    "FMUs": FMUS,
    "ONNX files": NETWORKS,
    "Modelica": MODELICA,
    "Arguments": ARGUMENTS,
}
CASES = [case for group in GROUPS.values() for case in group]


def answer(case: Case) -> tuple[int, str]:
    """(exit code, message) of a case in a fresh folder, after checking that nothing was written."""
    with tempfile.TemporaryDirectory() as folder, contextlib.chdir(folder):
        Path("good.csv").write_text(csv(GOOD))
        case.prepare()
        before = sorted(Path().rglob("*"))
        err = io.StringIO()
        with contextlib.redirect_stderr(err), contextlib.redirect_stdout(io.StringIO()):
            code = run(case.command.split()[1:])
        assert sorted(Path().rglob("*")) == before, "something was written"
        return code, err.getvalue().replace(folder + "/", "").strip()


def document() -> str:
    """The table of docs/bad-input.md."""
    lines = [
        "# What bad input is answered",
        "",
        "One line per problem on standard error, exit code 2 (wrong usage or unusable input) or 1 (failure),",
        "nothing written.",
        "Written by `python tests/test_bad_input.py`, and kept in step by the same file's tests.",
    ]
    for title, cases in GROUPS.items():
        lines += ["", f"## {title}", "", "| bad input | command | code | answer |", "|---|---|---|---|"]
        for case in cases:
            code, message = answer(case)
            text = "<br>".join(_cell(line.removeprefix("hystid: ")) for line in message.splitlines())
            lines.append(f"| {case.what} | `{_cell(case.command)}` | {code} | {text} |")
    return "\n".join(lines) + "\n"


def _cell(text: str) -> str:
    return text.replace("|", "\\|").replace("<", "&lt;").replace("*", "\\*")


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.what)
def test_bad_input_is_answered_in_a_sentence_and_writes_nothing(case: Case) -> None:
    code, message = answer(case)
    assert case.says in message
    assert code == case.code, message
    assert "Traceback" not in message and "internal error" not in message
    for line in message.splitlines():
        assert line.startswith("hystid: ") and len(line) < 600, line


def test_there_are_enough_cases() -> None:
    assert len(CASES) >= 25
    assert len({case.what for case in CASES}) == len(CASES)


def test_the_document_says_what_the_command_line_says() -> None:
    text = DOCUMENT.read_text(encoding="utf-8")
    for case in CASES:
        assert f"| {case.what} | `{_cell(case.command)}` |" in text, "run python tests/test_bad_input.py"
    assert len(re.findall(r"^\| .* \| [12] \| ", text, flags=re.M)) == len(CASES)


@pytest.mark.parametrize("case", [RECORDINGS[0], FMUS[0], ARGUMENTS[0]], ids=lambda case: case.what)
def test_a_process_of_its_own_answers_alike(case: Case, tmp_path: Path) -> None:
    with contextlib.chdir(tmp_path):
        case.prepare()
        command = [sys.executable, "-m", *case.command.split()]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == case.code
    assert case.says in done.stderr
    assert done.stdout == ""


if __name__ == "__main__":
    DOCUMENT.write_text(document(), encoding="utf-8")
