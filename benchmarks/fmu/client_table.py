"""The table FMU x client of docs/fmu.md: every oscillator of the library, in both versions, in importers of others.

python benchmarks/fmu/client_table.py          writes the table between its marks in docs/fmu.md
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
from fmpy.validation import validate_fmu

from hystid.files import write_text
from hystid.fmu import Driver, build_model, regress

ROOT = Path(__file__).parents[2]
PROGRAM = ROOT / "tests" / "fmu_clients.py"
CLIENTS = {"FMPy": "fmpy", "ecos": "ecos", "libcosim": "libcosim"}
START, END = "<!-- clients: begin -->", "<!-- clients: end -->"
N = 200


def answer(client: str, driver: Driver) -> str:
    """Largest relative difference to our driver at the last of 200 steps, or why there is none."""
    if client == "libcosim" and driver.fmi == 3:
        return "no FMI 3"
    step = driver.model.experiment.step
    request = [{"path": str(driver.path), "inputs": {"F": 20.0}, "outputs": ["x", "v", "R"], "step": step, "n": N}]
    run = subprocess.run(
        [sys.executable, PROGRAM, client], input=json.dumps(request), capture_output=True, text=True, check=False
    )
    line = next((text for text in run.stdout.splitlines() if text.startswith("ANSWER ")), None)
    if line is None:
        return f"fails (exit {run.returncode})"
    theirs = json.loads(line[7:])
    ours = driver.simulate(np.arange(N + 1) * step, {"F": np.full(N + 1, 20.0)}, interpolation="hold")
    worst = max(abs(theirs[name] - ours[name][-1]) / np.max(np.abs(ours[name])) for name in ("x", "v", "R"))
    return f"{worst:.0e}" if worst else "0"


def table() -> str:
    """Markdown."""
    lines = [
        "| model | FMI | kB | `fmpy validate` | reference | " + " | ".join(CLIENTS) + " |",
        "|---|---|---|---|---|" + "---|" * len(CLIENTS),
    ]
    with tempfile.TemporaryDirectory() as folder:
        for path in sorted((ROOT / "modelica" / "HystId" / "Oscillators").glob("*.mo")):
            if path.stem == "package":
                continue
            for version in (2, 3):
                model = f"HystId.Oscillators.{path.stem}"
                made = build_model(model, Path(folder) / f"{path.stem}{version}.fmu", fmi=version)
                driver = Driver(made.path)
                cells = [answer(client, driver) for client in CLIENTS.values()]
                findings = len(validate_fmu(str(made.path)))
                same = "as before" if regress(made.path).passed else "differs"
                lines.append(
                    f"| {path.stem} | {version}.0 | {made.size / 1000:.0f} | {findings} findings | {same} | "
                    + " | ".join(cells)
                    + " |"
                )
    return "\n".join(lines)


def main() -> None:
    """Write the table into the document."""
    document = ROOT / "docs" / "fmu.md"
    before, rest = document.read_text(encoding="utf-8").split(START)
    write_text(document, f"{before}{START}\n{table()}\n{END}{rest.split(END)[1]}")


if __name__ == "__main__":
    main()
