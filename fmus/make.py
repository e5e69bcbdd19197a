"""Write fmus/<Model>/: readme with equations and provenance, reference input and result of the default experiment.

    python fmus/make.py            all oscillators of the library; --fmu also builds <Model>.fmu (not kept in git)

Everything comes from the Modelica text, so that a page cannot say another thing than the model.
"""

from __future__ import annotations

import argparse
import re
from pathlib import Path

from hystid.files import write_text
from hystid.fmu import build_model
from hystid.fmu.reference import FOLDER, reference_entries
from hystid.modelica import compile_model

HERE = Path(__file__).parent
LIBRARY = HERE.parent / "modelica" / "HystId"
_TAG = re.compile(r"<[^>]+>")


def models() -> list[str]:
    """Short names of the library's oscillators."""
    return sorted(path.stem for path in (LIBRARY / "Oscillators").glob("*.mo") if path.stem != "package")


def readme(model: str) -> str:
    """Text of a model's readme."""
    code = compile_model(f"HystId.Oscillators.{model}")
    rows = [
        f"| `{v.name}` | {v.start:g} | {v.unit or '1'} | {v.description} |"
        for v in code.variables
        if v.causality == "parameter" and v.start is not None
    ]
    parts = [f"# {model}", code.description + ". Signs: m a + R = F; R opposes motion as a spring does."]
    parts += ["## Equations", "```modelica", _equations(LIBRARY / "Interfaces" / "PartialOscillator.mo"), "```"]
    law = LIBRARY / "Forces" / f"{model}.mo"
    if law.exists():
        parts += ["with `f_h` the force `f` of", "```modelica", _equations(law), "```"]
    else:
        parts += ["with `f_h = 0`."]
    parts += ["## Parameters", "| name | start | unit | |\n|---|---|---|---|\n" + "\n".join(rows)]
    parts += ["## Provenance", _provenance(law), *_files(model, code.experiment.stop)]
    return "\n\n".join(parts).replace("```modelica\n\n", "```modelica\n").replace("\n\n```\n", "\n```\n") + "\n"


def _equations(path: Path) -> str:
    text = path.read_text(encoding="utf-8")
    body = re.split(r"^equation\n", text, flags=re.MULTILINE)[1]
    return re.split(r"^  annotation|^end ", body, flags=re.MULTILINE)[0].rstrip()


def _provenance(law: Path) -> str:
    text = law.read_text(encoding="utf-8") if law.exists() else ""
    found = re.search(r'info = "(.*?)"\)\)', text, re.DOTALL)
    source = " ".join(_TAG.sub(" ", found.group(1)).split()) if found else ""
    source = source.replace("&gt;", ">").replace("&lt;", "<").replace("\\", "")
    return (
        f"{source} Written in `modelica/HystId/Forces/{law.name}`." if source else "Textbook law, in `modelica/HystId`."
    )


def _files(model: str, stop: float) -> list[str]:
    return [
        "## Files",
        f"`{model}_in.csv` and `{model}_out.csv`: input and result of the default experiment ({stop:g} s), by the "
        "classical Runge-Kutta method with located events; the input runs linearly between rows. The same files are "
        "inside the FMU.",
        f"```\nhystid build HystId.Oscillators.{model} -o {model}.fmu\nhystid regress {model}.fmu\n```",
    ]


def tables(model: str) -> dict[str, str]:
    """File name -> text of the reference tables."""
    entries = reference_entries(compile_model(f"HystId.Oscillators.{model}"))
    found = {Path(name).name: data.decode() for name, data in entries.items() if name.startswith(FOLDER)}
    return {f"{model}_{name.rsplit('_', 1)[1]}": text for name, text in found.items() if name.endswith(".csv")}


def main() -> None:
    """Write the folders."""
    parser = argparse.ArgumentParser(description="Write fmus/<Model>/.")
    parser.add_argument("--fmu", action="store_true", help="build the FMUs too")
    arguments = parser.parse_args()
    for model in models():
        write_text(HERE / model / "README.md", readme(model))
        for name, text in tables(model).items():
            write_text(HERE / model / name, text)
        if arguments.fmu:
            build_model(f"HystId.Oscillators.{model}", HERE / model / f"{model}.fmu")


if __name__ == "__main__":
    main()
