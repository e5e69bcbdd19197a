"""Hostile inputs of every kind: ``python -m benchmarks.fuzz.run --minutes 25 -o build/fuzz`` (``make fuzz``).

Prints one row per kind: inputs tried, crashes, hangs, tracebacks, files written outside. Each kind has its share of the
minutes and ends earlier where its inputs are all tried. Seeds and inputs that found something stay in the folder.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path

from benchmarks.fuzz import orders
from benchmarks.fuzz.engine import COUNTS
from benchmarks.fuzz.targets import TARGETS

# Inputs of the long run. Calls cost microseconds, files milliseconds, Modelica a second: each kind has its share.
INPUTS = {
    "orders": 1_200_000, "unit": 20_000, "parameters": 10_000, "csv": 5_000, "mat": 1_500, "hdf5": 1_500, "uff": 1_500,
    "tdms": 1_500, "mdf": 1_500, "parquet": 1_500, "fmu": 4_000, "description": 4_000, "onnx": 2_000, "modelica": 100,
}  # fmt: skip
_SILENT = 300.0  # s of one input without an answer


@dataclass
class Row:
    """What came of the inputs of a kind."""

    kind: str
    inputs: int = 0
    crashes: int = 0
    hangs: int = 0
    tracebacks: int = 0
    outside: int = 0
    seconds: float = 0.0

    def __str__(self) -> str:
        return (
            f"| {self.kind} | {self.inputs:,} | {self.crashes} | {self.hangs} | {self.tracebacks} | {self.outside} | "
            f"{self.seconds:.0f} |"
        )


def of_files(kind: str, inputs: int, seconds: float, seed: int, out: Path) -> Row:
    """Inputs of one kind of file or text; a crash or a hang costs one process, and the next goes on."""
    row, begin = Row(kind), time.monotonic()
    while row.inputs < inputs and time.monotonic() - begin < seconds:
        counts = out / f"{kind}.counts"
        counts.unlink(missing_ok=True)
        command = [sys.executable, "-m", "benchmarks.fuzz.engine", kind, "--inputs", str(inputs - row.inputs)]
        command += ["--seed", str(seed + row.crashes + row.hangs), "-o", str(out)]
        end = _watched(command, counts, begin + seconds, out / f"{kind}.printed")
        tried, tracebacks, outside = _counts(counts)
        row.inputs, row.tracebacks, row.outside = row.inputs + tried, row.tracebacks + tracebacks, row.outside + outside
        row.crashes += end == "crash"
        row.hangs += end == "hang"
        if end not in ("crash", "hang") or not tried:
            break
    row.seconds = time.monotonic() - begin
    return row


def _watched(command: list[str], counts: Path, until: float, printed: Path) -> str:
    """How a process ended: "done", "time", "crash" or "hang"."""
    with printed.open("ab") as words:
        process = subprocess.Popen(command, stdout=words, stderr=words)
        last, since = -1, time.monotonic()
        while True:
            try:
                return "done" if process.wait(0.5) == 0 else "crash"
            except subprocess.TimeoutExpired:
                now, tried = time.monotonic(), _counts(counts)[0]
                last, since = (tried, now) if tried != last else (last, since)
                # it takes its time to start, on a busy machine more than its share: nothing tried is nothing found
                if (now < until or tried <= 0) and now - since < _SILENT:
                    continue
                process.kill()
                process.wait()
                return "hang" if now - since >= _SILENT else "time"


def _counts(path: Path) -> tuple[int, int, int]:
    data = path.read_bytes() if path.exists() else b""
    inputs, tracebacks, outside = COUNTS.unpack(data) if len(data) == COUNTS.size else (0, 0, 0)
    return inputs, tracebacks, outside


def of_orders(inputs: int, seconds: float, seed: int, out: Path) -> Iterator[Row]:
    """Orders of calls, on each model and version in turn."""
    rigs = [(model, version) for model in orders.MODELS for version in (2, 3)]
    for number, (model, version) in enumerate(rigs):
        row, begin = Row(f"calls, FMI {version}, {model}"), time.monotonic()
        folder = out / f"orders-{number}"
        made = orders.program(orders.code_of(orders.MODELS[model]), version, folder, orders.MEMORY)
        until = time.monotonic() + seconds / len(rigs)
        while row.inputs < inputs // len(rigs) and time.monotonic() < until:
            n = min(50_000, inputs // len(rigs) - row.inputs)
            found = orders.orders(made, seed * 1_000_000_000 + row.inputs, n)
            row.inputs, row.crashes, row.hangs = row.inputs + n, row.crashes + found.crashes, row.hangs + found.hangs
            if found.failures:
                with (out / "orders.log").open("a") as log:
                    log.write("\n".join([*found.failures, ""]))
        row.seconds = time.monotonic() - begin
        yield row


def rows(share: float, minutes: float, seed: int, out: Path, kinds: Mapping[str, int]) -> Iterator[Row]:
    """All kinds, each with at most its share of the minutes: half of them for calls."""
    files = [kind for kind in kinds if kind in TARGETS]
    for kind in files:
        seconds = 30 * minutes / max(len(files), 1) * (1 if "orders" in kinds else 2)
        yield of_files(kind, max(round(share * kinds[kind]), 1), seconds, seed, out)
    if "orders" in kinds:
        yield from of_orders(round(share * kinds["orders"]), (30 if files else 60) * minutes, seed, out)


def main(say: Callable[[str], None] = print) -> int:
    """Arguments are those of the module's text."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--minutes", type=float, default=25)
    parser.add_argument("--share", type=float, default=1.0, help="of the inputs of the long run")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--kinds", nargs="*", default=list(INPUTS))
    parser.add_argument("-o", "--out", type=Path, default=Path("build/fuzz"))
    given = parser.parse_args()
    given.out.mkdir(parents=True, exist_ok=True)
    os.environ["HYSTID_CACHE"] = str(given.out.resolve() / "cache")
    say("| kind | inputs | crashes | hangs | tracebacks | files outside | s |\n|---|---|---|---|---|---|---|")
    found = []
    for row in rows(given.share, given.minutes, given.seed, given.out, {kind: INPUTS[kind] for kind in given.kinds}):
        found.append(row)
        say(str(row))
        (given.out / "rows.json").write_text(json.dumps([asdict(row) for row in found], indent=1))
    bad = sum(row.crashes + row.hangs + row.tracebacks + row.outside for row in found)
    say(f"{sum(row.inputs for row in found):,} inputs, {bad} findings; seed {given.seed}")
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main())
