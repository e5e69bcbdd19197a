"""Score the diagnosis: ``python -m benchmarks.concealed.score [--seed S] [--cases N] [--hard M] -o DIR [--doc]``.

The deck is generated case by case where it is not there yet, every case is diagnosed in a process of its own with one
thread and a limit of processor time, on a copy of what it may see, and the answer is graded against the sealed truth.
Interrupted runs go on where they stopped. ``--doc`` writes ``docs/concealed-first.md``.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

from benchmarks.concealed.deck import HARD, CaseSpec, deck
from benchmarks.concealed.document import complaint, table, write_document
from benchmarks.concealed.generate import generate
from benchmarks.concealed.grade import Grade, contract_problems, failed, grade
from benchmarks.concealed.rivals import compare
from benchmarks.concealed.summary import ONE, figures
from hystid.files import write_json
from hystid.progress import track

PATIENCE = 20  # wall time over processor time that a busy machine may take
ROOT = Path(__file__).resolve().parents[2]


def diagnose_case(case: Path, out: Path, limit: float, exclude: Sequence[str] = ()) -> str:
    """Run the worker on a copy of the case; leaves ``run.json`` with status and cost in ``out``. Returns the status."""
    if (out / "run.json").exists():
        return str(json.loads((out / "run.json").read_text(encoding="utf-8"))["status"])
    out.mkdir(parents=True, exist_ok=True)
    command = [sys.executable, "-m", "benchmarks.concealed.worker"]
    alone = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")
    with tempfile.TemporaryDirectory() as folder:
        seen = shutil.copytree(case, Path(folder, "case"))
        options = ["--limit", f"{limit:.0f}", *(["--exclude", ",".join(exclude)] if exclude else [])]
        try:
            done = subprocess.run(
                [*command, str(seen), str(out.resolve()), *options],
                cwd=ROOT, env={**os.environ, **alone}, capture_output=True, text=True, check=False,
                timeout=PATIENCE * limit,
            )  # fmt: skip
        except subprocess.TimeoutExpired:
            return _note(out, {"status": f"no end within {PATIENCE * limit:.0f} s"})
    if done.returncode == -signal.SIGXCPU:
        return _note(out, {"status": f"over {limit:.0f} s of processor time"})
    if done.returncode != 0:
        return _note(out, {"status": (done.stderr.strip().splitlines() or ["no message"])[-1][:300]})
    return _note(out, {"status": "answered", **json.loads(done.stdout.strip().splitlines()[-1])})


def _note(out: Path, run: dict[str, Any]) -> str:
    write_json(out / "run.json", run)
    return str(run["status"])


def grade_case(case: Path, out: Path, sealed: Path) -> Grade:
    """Grade what ``diagnose_case`` left."""
    truth = json.loads((sealed / f"{case.name}.json").read_text(encoding="utf-8"))
    run = json.loads((out / "run.json").read_text(encoding="utf-8"))
    if run["status"] != "answered":
        return failed(case.name, truth, run["status"])
    answer = json.loads((out / "diagnosis.json").read_text(encoding="utf-8"))
    problems = contract_problems(answer)
    if any(text.endswith("is missing") for text in problems):
        return failed(case.name, truth, "; ".join(problems))
    graded = grade(case.name, truth, answer, out, sealed)
    return replace(graded, cpu_s=run["cpu_s"], memory_MB=run["memory_MB"], notes=tuple(problems))


def score(
    folder: Path, seed: int, specs: Sequence[CaseSpec], *, limit: float, jobs: int = 1, without_truth: bool = False
) -> list[Grade]:
    """Generate, diagnose and grade. without_truth: single effects only, with their own ids taken out of the library."""
    answers = folder / ("answers_without_truth" if without_truth else "answers")

    def one(case: Path) -> Grade:
        """Diagnose and grade in one thread; the work itself is in the worker's process."""
        sealed = folder / "sealed"
        ids = json.loads((sealed / f"{case.name}.json").read_text(encoding="utf-8"))["ids"] if without_truth else ()
        diagnose_case(case, answers / case.name, limit, ids)
        return grade_case(case, answers / case.name, sealed)

    grades: list[Grade] = []
    groups = ONE if without_truth else {spec.group for spec in specs}
    with track("diagnosing concealed cases", len(specs)) as step, ThreadPoolExecutor(jobs) as pool:
        made = zip(generate(folder, seed, specs), specs, strict=True)
        for graded in _in_order(pool, one, (case for case, spec in made if spec.group in groups), jobs):
            grades.append(graded)
            step(text=f"{graded.case} {graded.verdict}")
    return grades


def _in_order(pool: ThreadPoolExecutor, work: Any, cases: Iterator[Path], ahead: int) -> Iterator[Grade]:
    """Results in order, with at most ``ahead`` cases under way, so that generation keeps pace with diagnosis."""
    waiting = []
    for case in cases:
        waiting.append(pool.submit(work, case))
        if len(waiting) > ahead:
            yield waiting.pop(0).result()
    for future in waiting:
        yield future.result()


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(description="Score hystid diagnose on concealed physics.")
    parser.add_argument("--seed", type=int, default=int(time.time()), help="default: from the clock")
    parser.add_argument("--cases", type=int, default=153, help="cases at 34 dB")
    parser.add_argument("--hard", type=int, default=0, help="cases over 28 dB, x and F only, two recordings, mass off")
    parser.add_argument("--only", default="", help="ids, groups or families, separated by commas")
    parser.add_argument("--variant", default="", help="in place of the standard one")
    parser.add_argument("--limit", type=float, default=120.0, help="processor seconds per case")
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--without-truth", action="store_true", help="single effects once more, their ids taken away")
    parser.add_argument("--rivals", action="store_true", help="other methods on the same deck (needs the extra bench)")
    parser.add_argument("--doc", action="store_true", help="write docs/concealed-first.md")
    parser.add_argument("--note", default="", help="a sentence for the head of the page")
    parser.add_argument("-o", dest="folder", type=Path, default=Path("concealed"))
    return parser


def main(arguments: Sequence[str] | None = None) -> None:
    """Command line."""
    chosen = _parser().parse_args(arguments)
    only, variants = ([part for part in text.split(",") if part] for text in (chosen.only, chosen.variant))
    seed, folder = chosen.seed, chosen.folder / str(chosen.seed)
    print(f"seed {seed}")
    specs = deck(seed, chosen.cases, only, variants)
    plan = deck(seed + 1, chosen.hard, only or ("single", "null"), HARD) if chosen.hard else []
    how = {"limit": chosen.limit, "jobs": chosen.jobs}
    standard = score(folder / "standard", seed, specs, **how)
    hard = score(folder / "hard", seed + 1, plan, **how)
    _store(folder / "results.json", seed, standard, hard)
    if chosen.without_truth:
        blind = score(folder / "standard", seed, specs, without_truth=True, **how)
        _store(folder / "results_without_truth.json", seed, blind, [])
    if chosen.rivals:
        compare(folder / "standard")
    print(table(figures(standard)))
    print("\n".join(_told(g) for g in (*standard, *hard) if complaint(g) or g.notes))
    if chosen.doc:
        write_document(ROOT / "docs" / "concealed-first.md", seed, standard, hard, folder, chosen.note)


def _store(file: Path, seed: int, standard: Sequence[Grade], hard: Sequence[Grade]) -> None:
    write_json(file, {"seed": seed, "standard": [asdict(g) for g in standard], "hard": [asdict(g) for g in hard]})


def _told(g: Grade) -> str:
    answer = " ".join((g.verdict, ",".join(g.answer), *g.notes))
    return f"{g.case} {g.group} {g.variant} {','.join(g.truth)} -> {answer}: {complaint(g)}"


if __name__ == "__main__":
    main()
