"""ThreadSanitizer and valgrind over long runs of every kind of FMU: ``python -m benchmarks.fuzz.memory``.

8 threads run 8 instances each under ThreadSanitizer; one instance takes a million steps under valgrind. FMI 2 and 3,
co-simulation and model exchange.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import time
from pathlib import Path

from benchmarks.fuzz.orders import MODELS, PLAIN, THREADS, code_of, program
from benchmarks.fuzz.targets import CORPUS

# The ball's impacts accumulate at 4.06 s, which ends its run (Zeno): long runs have a model that goes on.
_LASTING = {name: model for name, model in MODELS.items() if "Bouncing" not in name}
_LASTING["events (Thermostat)"] = str(CORPUS / "modelica" / "thermostat.mo")
_VALGRIND = ("valgrind", "--quiet", "--leak-check=full", "--errors-for-leak-kinds=all", "--error-exitcode=9")


def said(command: list[str], ok: str) -> str:
    """ok, or the first words of what went wrong."""
    run = subprocess.run(command, capture_output=True, text=True)
    words = [line for line in run.stderr.splitlines() if line.strip("= ")]
    return ok if run.returncode == 0 and not words else f"code {run.returncode}: {' '.join(words[:2])[:200]}"


def main() -> int:
    """Arguments are those of the module's text."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--steps", type=int, default=1_000_000, help="of an instance under valgrind")
    parser.add_argument("--thread-steps", type=int, default=2_000, help="of each of 64 instances under ThreadSanitizer")
    parser.add_argument("--models", nargs="*", default=list(_LASTING))
    parser.add_argument("--kinds", nargs="*", default=["threads", "valgrind"])
    parser.add_argument("-o", "--out", type=Path, default=Path("build/memory"))
    given = parser.parse_args()
    bad = 0
    print("| model | FMI | interface | ThreadSanitizer | valgrind | s |\n|---|---|---|---|---|---|")
    for number, name in enumerate(given.models):
        code = code_of(_LASTING[name])
        for version in (2, 3):
            place = given.out / f"{number}-{version}"
            made = {kind: program(code, version, place / kind, flags) for kind, flags in
                    (("threads", THREADS), ("valgrind", PLAIN)) if kind in given.kinds}  # fmt: skip
            for interface, kind in (("co-simulation", 1), ("model exchange", 0)):
                begin, cells = time.monotonic(), ["not run", "not run"]
                if "threads" in made:
                    command = made["threads"].command("threads", kind, given.thread_steps)
                    cells[0] = said(command, f"nothing in 64 x {given.thread_steps:,} steps")
                if "valgrind" in made:
                    command = [*_VALGRIND, *made["valgrind"].command("steps", kind, given.steps)]
                    cells[1] = said(command, f"nothing in {given.steps:,} steps")
                bad += any(cell.startswith("code") for cell in cells)
                row = (name, f"{version}.0", interface, *cells, f"{time.monotonic() - begin:.0f}")
                print(f"| {' | '.join(row)} |", flush=True)
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main())
