"""Diagnose the recordings of other laboratories and write the table of ``docs/real-recordings.md``.

    python -m benchmarks.real_recordings ../shared/data [case ...]

Each case is what ``hystid diagnose REC... --model HystId.Oscillators.Linear --parameters P.json --holdout REC -o DIR``
answers. With case names, only those are run and printed, and the document stays.
"""

from __future__ import annotations

import json
import sys
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from hystid.diagnosis import Diagnosis, Finding, diagnose

DOCUMENT = Path(__file__).parents[1] / "docs" / "real-recordings.md"
START, END = "<!-- table: written by benchmarks/real_recordings.py -->\n", "<!-- end of table -->\n"
MODEL = "HystId.Oscillators.Linear"
RESTORING = {"m": 0}


@dataclass(frozen=True)
class Case:
    """Recordings used and held out, below the data folder, and what is known of the parameters."""

    folder: str
    used: tuple[str, ...]
    held: tuple[str, ...] = ()
    parameters: dict[str, Any] = field(default_factory=lambda: dict(RESTORING))


_NO_SPRING = {"Kl": {"value": 0, "fixed": True}}
_BAND = "brfd2023_0.5Hz30lbtension{}amplitude"
CASES = {
    "emps": Case("emps", ("emps_estimation",), ("emps_validation_pulses",), _NO_SPRING),
    "brfd": Case(
        "brfd_friction_backlash", (_BAND.format("1"), _BAND.format("0.5")), (_BAND.format("1.5"),)
    ),
    "brfd_80": Case("brfd_friction_backlash", ("brfd2022_0.5Hz80lbtension",), ("brfd2022_1Hz80lbtension",)),
    "cyberdiver_10N": Case(
        "cyberdiver_bilinear", ("static_10n_threshold_trial1", "static_10n_threshold_trial2"),
        ("static_10n_threshold_trial3",),
    ),
    "cyberdiver_linear": Case(
        "cyberdiver_bilinear", ("static_15npmm_trial1", "static_15npmm_trial2"), ("static_15npmm_trial3",)
    ),
    "pneumatic_1bar": Case("pneumatic_cylinder_friction", ("pneumatic_Circle_1bar",)),
    "pneumatic_3bar": Case("pneumatic_cylinder_friction", ("pneumatic_Circle_3bar",)),
    "pneumatic_5bar": Case("pneumatic_cylinder_friction", ("pneumatic_Circle_5bar",)),
    "pneumatic_7bar": Case("pneumatic_cylinder_friction", ("pneumatic_Circle_7bar",)),
    "mr_0V": Case("mr_damper_utfpr", ("mr_damper_0V",)),
    "mr_0.88V": Case("mr_damper_utfpr", ("mr_damper_0.88V",)),
    "mr_third": Case("mr_damper_utfpr", ("mr_damper_third_setting",)),
    "rc_column": Case("rc_cyclic", ("rc_column_gill",)),
    "ferrocement_wall": Case("rc_cyclic", ("ferrocement_wall_bedoya",)),
    "boucwen": Case(
        "boucwen_benchmark", ("boucwen_train_multisine_forgione",),
        ("boucwen_test_multisine", "boucwen_test_sinesweep"), {"m": 2.0},
    ),
}  # fmt: skip


def run(data: Path, case: Case) -> Diagnosis:
    """The answer to one case."""
    used, held = ([data / case.folder / f"{name}.csv" for name in names] for names in (case.used, case.held))
    return diagnose(used, model=MODEL, parameters=case.parameters, holdout=held)


def row(name: str, case: Case, found: Diagnosis, seconds: float) -> str:
    """One line of the table."""
    told = [_finding(finding) for finding in found.findings]
    given = ", ".join(
        f"{k} = {v['value']} exact" if isinstance(v, dict) else f"{k} = {v}" for k, v in case.parameters.items()
    )
    last = found.final.hypothesis.values if found.final else {}
    base = ", ".join(f"{k} = {v:.4g}" for k, v in last.items() if v)
    before, after = found.force_nrmse
    held = "; ".join(
        f"force {_pair(e.force)}" + (f", free-run x {_pair(e.free_run)}" if e.free_run[1] is not None else "")
        for e in found.holdout
    )
    cells = [
        f"`{name}`: {case.folder}, {given}", found.verdict, "<br>".join(told) or "nothing", base,
        _pair((before, after)), held or "none", f"{seconds:.0f} s",
    ]  # fmt: skip
    return "| " + " | ".join(cells) + " |"


def _finding(finding: Finding) -> str:
    """Id, form of the law, confidence, parameters and look-alikes."""
    values = ", ".join(
        f"{name} = {value.value:.4g} {value.unit}".removesuffix(" 1").strip()
        for name, value in finding.parameters.items()
    )
    others = ", ".join(other for other in finding.alike if other != finding.effect)
    form = f", {finding.evidence['form']}" if finding.evidence.get("form") else ""
    told = f"{finding.effect}{form} ({finding.confidence:.2f}): {values}"
    return told + (f"; or {others}" if others else "")


def _pair(errors: tuple[float | None, float | None]) -> str:
    before, after = (f"{100 * e:.3g} %" if e is not None else "-" for e in errors)
    return f"{before} → {after}"


def main(arguments: list[str]) -> None:
    """Run the cases; see the module's text."""
    data, chosen = Path(arguments[0]), arguments[1:]
    rows = []
    for name, case in CASES.items():
        if not chosen or name in chosen:
            began = time.process_time()
            found = run(data, case)
            rows.append(row(name, case, found, time.process_time() - began))
            print(rows[-1], flush=True)
            if found.holdout and case.folder == "boucwen_benchmark":
                print(json.dumps([e.free_run for e in found.holdout]))
    if chosen:
        return
    head = "| case, given | verdict | found, form of the law (confidence) | baseline in the end (SI) | force error "
    head += "| held out | CPU |\n"
    head += "|---|---|---|---|---|---|---|\n"
    text = DOCUMENT.read_text(encoding="utf-8")
    first, last = text.index(START) + len(START), text.index(END)
    DOCUMENT.write_text(text[:first] + head + "\n".join(rows) + "\n" + text[last:], encoding="utf-8")


if __name__ == "__main__":
    main(sys.argv[1:])
