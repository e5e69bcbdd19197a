"""A diagnosis as files: diagnosis.json, the residuals, the extended model and its FMU."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

from hystid.diagnosis.prove.runs import write_beside
from hystid.diagnosis.tell.result import Diagnosis, Traces
from hystid.diagnosis.tell.turned import turned_model
from hystid.files import inside, safe_name, write_json, write_text
from hystid.modelica_text import EXTENDED, compile_text
from hystid.rig.terms import is_fmu
from hystid.rotation import turned_code


def written(answer: Diagnosis, out: str | Path | None) -> Diagnosis:
    """A diagnosis, written to a folder where one is given."""
    if out is None:
        return answer
    folder = Path(out)
    folder.mkdir(parents=True, exist_ok=True)
    for trace in answer.traces:
        write_text(
            inside(folder, f"mismatch_{safe_name(trace.name)}.csv"), _table(trace, "N.m" if answer.rotational else "N")
        )
    if (extended := answer.extended) is not None:
        from hystid.fmu import build

        write_text(folder / "extended.mo", turned_model(extended) if answer.rotational else extended)
        code = compile_text(extended, EXTENDED)
        code = turned_code(code) if answer.rotational else code
        if is_fmu(answer.model):
            build(code, folder / "effects.fmu")
            write_beside(answer.model, _fmu_settings(answer), folder / "effects.fmu", folder / "extended.ssp")
        else:
            build(code, folder / "extended.fmu")
    write_json(folder / "diagnosis.json", answer.as_dict())
    return replace(answer, folder=folder)


def _fmu_settings(answer: Diagnosis) -> Mapping[str, float]:
    """Parameters of an FMU as they are in the end, by its own names."""
    if answer.problem is None or answer.final is None:
        return {}
    return answer.problem.baseline.settings(answer.final.hypothesis.parameters())


def _table(trace: Traces, unit: str) -> str:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(["t [s]", f"residual [{unit}]", "score [-]"])
    writer.writerows(
        [f"{t:.9g}", f"{r:.7g}", f"{s:.6g}"] for t, r, s in zip(trace.t, trace.residual, trace.score, strict=True)
    )
    return text.getvalue()
