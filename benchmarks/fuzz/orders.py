"""FMI calls in any order against builds with sanitizers: models of several kinds, FMI 2 and 3, both interfaces."""

from __future__ import annotations

import os
import subprocess
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from benchmarks.fuzz.targets import CORPUS
from hystid.fmu.build import fmu_sources
from hystid.fmu.interface import interface
from hystid.modelcode import ModelCode
from hystid.modelica import compile_model
from hystid.surrogate import model_code

FOLDER = Path(__file__).parent
MEMORY = ("-g", "-O1", "-fsanitize=address,undefined", "-fno-sanitize-recover=all", "-fno-omit-frame-pointer")
THREADS = ("-g", "-O1", "-fsanitize=thread")
PLAIN = ("-g", "-O1")
MODELS = {
    "Duhem (BoucWen)": "HystId.Oscillators.BoucWen",
    "sliders (Iwan)": "HystId.Oscillators.Iwan",
    "events (BouncingBall)": str(CORPUS / "modelica" / "bounce.mo"),
    "network (identified force)": str(CORPUS / "onnx" / "surrogate.onnx"),
}
_CHUNK = 5_000  # orders of one process: a crash costs at most these


def code_of(model: str) -> ModelCode:
    """C of one of the models."""
    return model_code(Path(model)) if model.endswith(".onnx") else compile_model(model)


@dataclass(frozen=True)
class Program:
    """An executable that makes FMI calls of one model. See calls.h."""

    path: Path
    token: str
    values: int

    def command(self, what: str, first: int, count: int) -> list[str]:
        """Its command line."""
        return [str(self.path), what, self.token, str(self.values), str(first), str(count)]


def program(code: ModelCode, version: int, folder: Path, flags: Sequence[str]) -> Program:
    """The shell, the model and the driver in one executable."""
    folder.mkdir(parents=True, exist_ok=True)
    sources = fmu_sources(interface(code), 2 if version == 2 else 3)
    for name in ("calls.h", f"calls{version}.c"):
        sources[name] = (FOLDER / name).read_text()
    for name, text in sources.items():
        (folder / name).write_text(text)
    main = [name for name in sources if name.endswith(".c")]
    subprocess.run(["gcc", *flags, *main, "-o", "calls", "-lm", "-lpthread"], cwd=folder, check=True)
    return Program(folder / "calls", code.token, len(code.variables) + 2)


@dataclass
class Found:
    """What came of many orders. failures: first seed of the chunk, and what the sanitizer or the system said."""

    inputs: int
    calls: int
    crashes: int
    hangs: int
    failures: list[str]


def orders(made: Program, first: int, count: int) -> Found:
    """Run the orders with these seeds."""
    found = Found(0, 0, 0, 0, [])
    for begin in range(first, first + count, _CHUNK):
        n = min(_CHUNK, first + count - begin)
        run = subprocess.run(made.command("orders", begin, n), capture_output=True, text=True, env=os.environ)
        found.inputs += n
        if run.returncode == 0:
            found.calls += int(run.stdout)
            continue
        found.crashes += run.returncode != -14  # SIGALRM
        found.hangs += run.returncode == -14
        said = [line for line in run.stderr.splitlines() if any(word in line for word in ("ERROR", "error:", "    #"))]
        found.failures.append(f"{made.path.parent.name}, seeds {begin}..{begin + n - 1}: " + " | ".join(said[:4]))
    return found
