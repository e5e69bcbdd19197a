"""hystid's training beside its peers on the shared task, interleaved in one run: time to a validation error, memory.

    python benchmarks/lm/compare.py BENCH [REPETITIONS]

BENCH: folder of the shared training benchmark (its make_task.py, common.py, peer_*.py). Every repetition runs each peer
once, in turn, in a fresh process of one thread, from the same weights; the clock is the processor's. A peer whose
packages are not installed (pip install torch-levenberg-marquardt) is left out and named.
"""

from __future__ import annotations

import json
import os
import statistics
import subprocess
import sys
import tempfile
from pathlib import Path

HERE = Path(__file__).resolve().parent
LEVELS = (3e-4, 2e-4, 1.4e-4)
PEERS = {  # label: script of hystid or of the benchmark, its arguments, iterations
    "hystid fast": (HERE / "peer_hystid.py", ["fast"], 100),
    "hystid fast, float32": (HERE / "peer_hystid.py", ["fast", "float32"], 100),
    "hystid trainlm": (HERE / "peer_hystid.py", ["trainlm"], 100),
    "torch-levenberg-marquardt, fletcher": ("peer_torch_lm.py", ["cholesky-fletcher"], 40),
    "torch-levenberg-marquardt, default damping": ("peer_torch_lm.py", ["cholesky"], 70),
    "scipy least_squares lm, analytic Jacobian": ("peer_scipy.py", ["lm"], 40),
}


def main() -> None:
    """Run and print the table."""
    bench, repetitions = Path(sys.argv[1]).resolve(), int((sys.argv[2:] or ["3"])[0])
    with tempfile.TemporaryDirectory() as folder:
        task = Path(folder) / "task.npz"
        code = f"import sys; sys.path.insert(0, {str(bench)!r}); import make_task; make_task.main({str(task)!r})"
        subprocess.run([sys.executable, "-c", code], check=True, stdout=subprocess.DEVNULL)
        threads = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")
        where = {"LM_BENCH": str(bench), "LM_TASK": str(task), "PYTHONDONTWRITEBYTECODE": "1"}
        runs: dict[str, list[dict]] = {label: [] for label in PEERS}
        for seed in range(1, repetitions + 1):
            for label, (script, arguments, iterations) in PEERS.items():
                command = [sys.executable, str(bench / script), *arguments, str(seed), str(iterations), "120"]
                ended = subprocess.run(command, env={**os.environ, **threads, **where}, capture_output=True, text=True)
                if ended.returncode:
                    print(f"{label}: left out ({ended.stderr.strip().splitlines()[-1]})", file=sys.stderr)
                else:
                    runs[label].append(json.loads(ended.stdout.strip().splitlines()[-1]))
    table({label: found for label, found in runs.items() if found})


def table(runs: dict[str, list[dict]]) -> None:
    """Medians over the repetitions; ratio: of the processor time to the last level, over that of the first peer."""
    print("| trainer | ms per iteration | " + " | ".join(f"s (iterations) to {level:g}" for level in LEVELS)
          + " | x | extra memory MB |\n|" + "---|" * (len(LEVELS) + 4))  # fmt: skip
    first = None
    for label, found in runs.items():
        cells, last = [], None
        for level in LEVELS:
            hits = [hit for hit in (reached(run, level) for run in found) if hit]
            last = statistics.median(seconds for seconds, _ in hits) if len(hits) == len(found) else None
            iterations = statistics.median(count for _, count in hits) if hits else 0
            cells.append(f"{last:.3f} ({iterations:.0f})" if last is not None else f"{len(hits)} of {len(found)} runs")
        first = first or last
        ratio = f"{last / first:.1f}" if last and first else "-"
        each = 1e3 * statistics.median(run["cpu_per_iter"] for run in found)
        memory = statistics.median(run["rss_mb"] - run["base_mb"] for run in found)
        print(f"| {label} | {each:.1f} | " + " | ".join(cells) + f" | {ratio} | {memory:.0f} |")


def reached(run: dict, level: float) -> tuple[float, int] | None:
    """Processor seconds and iterations until the validation error was at most the level."""
    return next(((row[5], row[1]) for row in run["trace"] if row[2] <= level), None)


if __name__ == "__main__":
    main()
