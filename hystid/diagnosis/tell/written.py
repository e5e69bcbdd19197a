"""A diagnosis as files: diagnosis.json, the residuals, the extended model and its FMU."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

from hystid.diagnosis.model.adapters import is_fmu
from hystid.diagnosis.prove.runs import compile_text, write_beside
from hystid.diagnosis.tell.result import Diagnosis, Traces
from hystid.files import inside, safe_name, write_json, write_text


def written(answer: Diagnosis, extended: str | None, out: str | Path | None) -> Diagnosis:
    """A diagnosis, written to a folder where one is given. extended: text of the extended model."""
    if out is None:
        return answer
    folder = Path(out)
    folder.mkdir(parents=True, exist_ok=True)
    for trace in answer.traces:
        write_text(inside(folder, f"mismatch_{safe_name(trace.name)}.csv"), _table(trace))
    if extended is not None:
        from hystid.fmu import build

        write_text(folder / "extended.mo", extended)
        if is_fmu(answer.model):
            build(compile_text(extended), folder / "effects.fmu")
            write_beside(answer.model, _fmu_settings(answer), folder / "effects.fmu", folder / "extended.ssp")
        else:
            build(compile_text(extended), folder / "extended.fmu")
    write_json(folder / "diagnosis.json", answer.as_dict())
    return replace(answer, folder=folder)


def _fmu_settings(answer: Diagnosis) -> Mapping[str, float]:
    """Parameters of an FMU as they are in the end, by its own names."""
    if answer.problem is None or answer.final is None:
        return {}
    return answer.problem.baseline.settings(answer.final.hypothesis.parameters())


def _table(trace: Traces) -> str:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(["t [s]", "residual [N]", "score [-]"])
    writer.writerows(
        [f"{t:.9g}", f"{r:.7g}", f"{s:.6g}"] for t, r, s in zip(trace.t, trace.residual, trace.score, strict=True)
    )
    return text.getvalue()
