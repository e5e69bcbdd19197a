"""Cost of one step of a network FMU against a hand-written C FMU, memory per step, and file sizes.

    python -m benchmarks.surrogate.step_cost [--rounds 9] [--steps 200000] [--shared ../shared]

The floor (the same 3-5-5-1 network written by hand in C) and the plain C driver are those of ``shared/bench/fmu``.
One step: set three inputs, doStep, get one output. Candidates take turns within one run; medians of the thread's CPU
time, so that other work on the machine touches all of them alike. Speed is stated as a ratio to the floor.
"""

from __future__ import annotations

import argparse
import re
import statistics
import subprocess
import sys
import tempfile
import zipfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from hystid.fmu import build
from hystid.fmu.driver import Driver
from hystid.networks import Member, Network, TwoNetworkModel
from hystid.networks import onnx as exchange
from hystid.surrogate import network_code, oscillator_code, surrogate_code
from hystid.toolchain import compiler

ROOT = Path(__file__).parents[2]
HEADERS = ROOT / "hystid" / "fmu" / "shell" / "fmi"


@dataclass(frozen=True)
class Candidate:
    """One FMU as the driver sees it; inputs and outputs are value references."""

    name: str
    version: int
    library: Path
    token: str
    inputs: tuple[int, ...]
    outputs: tuple[int, ...]
    size: int

    def arguments(self, steps: int) -> list[str]:
        """Command line behind the driver's name."""
        ports = [str(len(self.inputs)), *map(str, self.inputs), str(len(self.outputs)), *map(str, self.outputs)]
        return [str(self.version), str(self.library), self.token, str(self.library.parent), str(steps), "1e-4", *ports]


def unpacked(name: str, fmu: Path, folder: Path) -> Candidate:
    """An FMU of ours: its ports are read from its description."""
    place = folder / fmu.stem
    with zipfile.ZipFile(fmu) as archive:
        archive.extractall(place)
    text = (place / "modelDescription.xml").read_text()
    token = re.search(r'(?:guid|instantiationToken)="([^"]+)"', text)
    assert token
    model = Driver(fmu).model
    inputs = tuple(v.slot for v in model.variables if v.causality == "input")
    outputs = tuple(v.slot for v in model.variables if v.causality == "output")[:1]
    library = next((place / "binaries").rglob("*.so")).resolve()
    return Candidate(name, 2 if "guid=" in text else 3, library, token[1], inputs, outputs, fmu.stat().st_size)


def floor(shared: Path, folder: Path) -> Candidate:
    """The hand-written FMU."""
    fmu = folder / "floor.fmu"
    subprocess.run(["bash", str(shared / "build_floor.sh"), str(folder / "mlp"), str(fmu)], check=True)
    with zipfile.ZipFile(fmu) as archive:
        archive.extractall(folder / "floor")
    library = next((folder / "floor").rglob("*.so")).resolve()
    return Candidate("hand-written C (floor)", 2, library, "{floor}", (0, 1, 2), (3,), fmu.stat().st_size)


def ensemble(members: int, sizes: Sequence[int]) -> TwoNetworkModel:
    """A surrogate of the usual size; its weights are drawn, for only the arithmetic counts here."""
    rng = np.random.default_rng(1)

    def network(gains: Sequence[float]) -> Network:
        layers, width = [], 3
        for count in (*sizes, 1):
            layers.append((rng.normal(0, 0.6, (count, width)), rng.normal(0, 0.3, count)))
            width = count
        return Network(tuple(layers), np.zeros(3), np.asarray(gains), 0.0, 100.0)

    pairs = tuple(Member(network((100.0, 100.0, 0.01)), network((100.0, 0.5, 0.01))) for _ in range(members))
    return TwoNetworkModel(pairs, 1.0, 1e4, {"x": (-1.0, 1.0), "v": (-1.0, 1.0), "R": (-300.0, 300.0)})


def candidates(shared: Path, folder: Path) -> list[Candidate]:
    """The floor first, then the same network as FMUs of ours, then surrogates with memory."""
    subprocess.run([sys.executable, str(shared / "make_mlp.py"), str(folder / "mlp")], check=True)
    found = [floor(shared, folder)]
    for kind in ("f64", "f32"):
        code = network_code(folder / "mlp" / f"mlp_{kind}.onnx")
        for fmi in (2, 3):
            path = build(code, folder / f"ours_{kind}_{fmi}.fmu", fmi=fmi).path  # type: ignore[arg-type]
            found.append(unpacked(f"3-5-5-1 from ONNX ({kind}), FMI {fmi}", path, folder))
    for members, sizes in ((1, (5, 5)), (3, (5, 5)), (3, (13, 13, 13))):
        label = f"{members} x {'-'.join(map(str, sizes))}"
        source = folder / f"s{members}_{len(sizes)}.onnx"
        exchange.write(ensemble(members, sizes), source)
        for kind, make in (("surrogate", surrogate_code), ("oscillator", oscillator_code)):
            path = build(make(source), folder / f"{kind}_{members}_{len(sizes)}.fmu").path  # type: ignore[operator]
            found.append(unpacked(f"{kind}.fmu, {label}", path, folder))
    return found


def measure(driver: Path, candidate: Candidate, steps: int) -> tuple[float, float]:
    """Nanoseconds of CPU time per step, and growth of the resident set per step [B]."""
    run = subprocess.run([str(driver), *candidate.arguments(steps)], capture_output=True, text=True, check=True)
    cost, _, before, after = run.stdout.split()
    return float(cost), 1024 * (int(after) - int(before)) / steps


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=9)
    parser.add_argument("--steps", type=int, default=200_000)
    parser.add_argument("--shared", type=Path, default=ROOT.parent / "shared")
    options = parser.parse_args()
    shared = options.shared / "bench" / "fmu"
    if not (shared / "drive.c").exists():
        sys.exit(f"{shared}: the driver and the floor are not here; name their folder with --shared")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        driver = folder / "drive"
        flags = ["-O2", "-w", "-I", str(HEADERS), "-o", str(driver)]
        subprocess.run([*compiler(), *flags, str(shared / "drive.c"), "-ldl", "-lm"], check=True)
        found = candidates(shared, folder)
        costs: dict[str, list[float]] = {candidate.name: [] for candidate in found}
        growth = dict.fromkeys(costs, 0.0)
        for _ in range(options.rounds):
            for candidate in found:
                cost, bytes_per_step = measure(driver, candidate, options.steps)
                costs[candidate.name].append(cost)
                growth[candidate.name] = max(growth[candidate.name], bytes_per_step)
        base = statistics.median(costs[found[0].name])
        print("| FMU | step, ratio to the floor | memory growth, B per step | FMU size, kB |\n|---|---|---|---|")
        for candidate in found:
            ratio = statistics.median(costs[candidate.name]) / base
            print(f"| {candidate.name} | {ratio:.2f} | {growth[candidate.name]:.2f} | {candidate.size / 1000:.0f} |")
        print(f"\nFloor: {base:.0f} ns per step here; {options.rounds} rounds of {options.steps} steps, taking turns.")


if __name__ == "__main__":
    main()
