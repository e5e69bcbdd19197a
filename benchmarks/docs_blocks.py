"""Do the commands and Python blocks of the documentation run, as a reader would copy them into a fresh folder?

    python -m benchmarks.docs_blocks [PAGE ...]

Each page gets a folder of its own with the files that it takes for granted (recordings, FMUs, a surrogate), and its
blocks run there one after the other: ``hystid`` lines as on the command line, Python in one namespace, Modelica as
``rig.mo``. An exit code of 1 is a finding, as of a diagnosis. What is not run is listed with the reason. Two minutes of
processor time; exit code 1 where a block fails.
"""

from __future__ import annotations

import contextlib
import io
import os
import re
import shlex
import sys
import tempfile
import traceback
from collections.abc import Iterator
from pathlib import Path

import numpy as np

import hystid
from hystid.cli.run import run
from hystid.compiled import CompiledModel
from hystid.excitation import parse
from hystid.modelica import compile_model
from hystid.processing import add_noise
from hystid.recording import Recording, write_csv

DOCS = Path(__file__).parents[1] / "docs"
PAGES = ["../README", "first-csv", "fmu", "guide-fmi", "guide-modelica", "identification", "modelica", "surrogate"]
_BLOCK = re.compile(r"^```([^\n]*)\n(.*?)^```", re.MULTILINE | re.DOTALL)
_LEFT_OUT = {
    "--platforms all": "minutes of cross compilers",
    "identify a.csv b.csv": "needs columns of a damper's current",
    "identify *.csv": "needs names with a tension in them",
    "validate model/surrogate.fmu d.csv": "needs the line before",
    "def test_": "runs in pytest",
}
_DT = 1e-3
_RIG = """model Rig
  extends HystId.Interfaces.PartialOscillator;
  parameter Real k(unit = "N/m") = 1e4;
equation
  f_h = k*x;
end Rig;
"""


def _recordings(folder: Path) -> None:
    """A rig with a stop, under sweeps of several levels."""
    (folder / "stop.mo").write_text(
        "model Stop extends HystId.Oscillators.Linear(f_effects = gap.f);\n"
        "HystId.Effects.ContactLoss gap(x = x, v = v, a = a, h = f_h, k = 4e4, gap = 1e-3); end Stop;"
    )
    model = CompiledModel(compile_model(f"{folder / 'stop.mo'}:Stop"))
    spec = {"sweep15": 15, "sweep30": 30, "sweep60": 60, "sweep90": 90, "chirp15": 15, "chirp60": 60, "train": 40}
    spec |= {"sweep": 50, "unseen": 70, "sine20": 20, "other": 55}
    for k, (name, level) in enumerate(spec.items()):
        force = parse(f"chirp:2-30Hz@{level}N,3s").force(_DT / 10, k)
        found = model.simulate({"F": force}, _DT / 10, parameters={"m": 2.5, "Kl": 2e4}, outputs=("x", "v", "a"))
        t = _DT * np.arange(len(force[::10]))
        plain = Recording(name, t, force[::10], *(found[c][::10] for c in "xva"))
        write_csv(add_noise(plain, 45.0, k), folder / f"{name}.csv")


def _models(folder: Path) -> None:
    """What pages on FMUs and networks have at hand."""
    made = hystid.identify([folder / "sweep15.csv", folder / "sweep60.csv"], mass=2.5, ensemble=2, layers=(3,))
    made.save(folder / "made")
    for name in ("surrogate.onnx", "surrogate.fmu", "oscillator.fmu"):
        (folder / name).write_bytes((folder / "made" / name).read_bytes())
    (folder / "controller.onnx").write_bytes((folder / "surrogate.onnx").read_bytes())
    hystid.build("HystId.Oscillators.Jenkins", folder / "jenkins.fmu")
    (folder / "rig.mo").write_text(_RIG)


def _steps(text: str) -> Iterator[tuple[str, str]]:
    """(language, step): each command by itself, blocks of Python and Modelica as a whole."""
    for language, block in _BLOCK.findall(text):
        if language in ("python", "modelica"):
            yield language, block
        elif not language:
            lines = block.replace("\\\n", " ").splitlines()
            yield from (("", line.partition("   #")[0].strip()) for line in lines if line.startswith("hystid "))


def _tried(language: str, step: str, names: dict[str, object]) -> str:
    """Run one step; what went wrong, "" where nothing did."""
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed), contextlib.redirect_stderr(printed):
        if language == "modelica":
            with Path("rig.mo").open("a", encoding="utf-8") as file:
                file.write(step)
            return ""
        if language == "python":
            try:
                exec(compile(step, "block", "exec"), names)
            except Exception:  # whatever a block raises is what this page promises wrongly: it is reported
                return traceback.format_exc(limit=-1)
            return ""
        words = [w for word in shlex.split(step)[1:] for w in (sorted(map(str, Path().glob(word))) or [word])]
        code = run(words)
    return (
        ""
        if code < 2 and "internal error" not in printed.getvalue()
        else f"exit code {code}: {printed.getvalue()[-400:]}"
    )


def main(pages: list[str]) -> int:
    """Run the pages and print one line per step."""
    failed = 0
    with tempfile.TemporaryDirectory() as place:
        shared = Path(place, "shared")
        shared.mkdir()
        _recordings(shared)
        _models(shared)
        for page in pages or PAGES:
            folder = Path(place, Path(page).stem)
            folder.mkdir()
            for file in shared.glob("*.*"):
                if file.name != "rig.mo" or "modelica" not in page:
                    (folder / file.name).write_bytes(file.read_bytes())
            force = np.array([(0.0, 0.0), (2.0, 1.0)], dtype=[("time", float), ("F", float)])
            wave = np.sin(np.arange(500) * 0.05)
            names: dict[str, object] = {"t": np.arange(500) * _DT, "F": wave, "x": 1e-3 * wave, "dt": _DT}
            names |= {"v": 5e-2 * np.cos(np.arange(500) * 0.05), "force": force if "fmi" in page else wave}
            with contextlib.chdir(folder):
                for language, step in _steps((DOCS / f"{page}.md").read_text(encoding="utf-8")):
                    why = next((reason for mark, reason in _LEFT_OUT.items() if mark in step), "")
                    wrong = "" if why else _tried(language, step, names)
                    failed += bool(wrong)
                    outcome = f"not run ({why})" if why else f"FAILED {wrong}" if wrong else "ran"
                    print(f"{Path(page).name}: {step.strip().splitlines()[0][:90]}: {outcome}", flush=True)
    return 1 if failed else 0


if __name__ == "__main__":
    os.environ.setdefault("HYSTID_NO_PROGRESS", "1")
    sys.exit(main(sys.argv[1:]))
