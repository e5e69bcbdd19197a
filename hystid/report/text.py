"""Summaries for the terminal, from the same result objects as the pages."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from hystid.diagnosis import Diagnosis
from hystid.identification import Identification
from hystid.report.page import percent, with_error
from hystid.validation import Validation


def identification_summary(result: Identification) -> str:
    """One line per recording, then the files."""
    rows = [("recording", "used for", "force NRMSE", "linear fit", "free run x")]
    for comparison in result.comparisons:
        network = comparison.network
        free = "diverged" if network.diverged else percent(network.x_nrmse) if network.x_nrmse is not None else "-"
        errors = (percent(network.force_nrmse), percent(comparison.linear.force_nrmse), free)
        rows.append((comparison.recording.name, comparison.role, *errors))
    return "\n".join([columns(rows), *result.notes])


def validation_summary(result: Validation) -> str:
    """One line per case, then the median and the worst."""
    rows: list[tuple[str, ...]] = [("case", "force NRMSE", "free run x", "free run R", "odd harmonics")]
    for case in result.cases:
        run = case.free_run
        free = (percent(run.x_nrmse), percent(run.R_nrmse)) if run else ("diverged" if case.diverged else "-", "-")
        odd = case.levels.worst_odd_db("force") if case.levels else None
        rows.append((case.name, percent(case.force_nrmse), *free, "-" if odd is None else f"{odd:.2g} dB"))
    figures = [result.figures(which) for which in ("force_nrmse", "x_nrmse", "R_nrmse")]
    for name, pick in (("median", np.median), ("worst", np.max)):
        cells = [percent(float(pick(values))) if not np.isnan(values).all() else "-" for values in figures]
        rows.append((name, *cells, ""))
    return "\n".join([columns(rows), *result.notes])


def diagnosis_summary(result: Diagnosis) -> str:
    """The verdict, each finding with its parameters, and the fit before and after."""
    lines = [f"{result.verdict.replace('_', ' ')}: {result.headline}"]
    for finding in result.findings:
        values = ", ".join(
            f"{name} = {with_error(p.value, p.stderr, p.unit)}" for name, p in finding.parameters.items()
        )
        others = [name for name in finding.alike if name != finding.effect]
        alike = f" (these data cannot tell it from {', '.join(others)})" if others else ""
        lines.append(f"  {finding.effect}, confidence {percent(finding.confidence)}{alike}: {values}")
        lines.append(f"    where: {finding.where.text}")
    rows: list[tuple[str, ...]] = [("free run, x NRMSE", "before", "after")]
    for error in (*result.errors, *result.holdout):
        if error.free_run[0] is not None:
            rows.append((error.name, percent(error.free_run[0]), percent(error.free_run[1])))
    if len(rows) > 1:
        lines.append(columns(rows))
    if result.next_experiment:
        lines.append(f"next: {result.next_experiment}")
    return "\n".join(lines)


def columns(rows: Sequence[Sequence[str]]) -> str:
    """Rows of text in columns: the first to the left, the others to the right."""
    widths = [max(len(row[k]) for row in rows) for k in range(len(rows[0]))]
    lines = []
    for row in rows:
        cells = [cell.ljust(w) if k < 1 else cell.rjust(w) for k, (cell, w) in enumerate(zip(row, widths, strict=True))]
        lines.append("  ".join(cells).rstrip())
    return "\n".join(lines)
