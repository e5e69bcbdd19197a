"""Summaries for the terminal, from the same result objects as the pages."""

from __future__ import annotations

from collections.abc import Sequence

from hystid.identification import Identification
from hystid.report.page import percent


def identification_summary(result: Identification) -> str:
    """One line per recording, then the files."""
    rows = [("recording", "used for", "force NRMSE", "linear fit", "free run x")]
    for comparison in result.comparisons:
        network = comparison.network
        free = "diverged" if network.diverged else percent(network.x_nrmse) if network.x_nrmse is not None else "-"
        errors = (percent(network.force_nrmse), percent(comparison.linear.force_nrmse), free)
        rows.append((comparison.recording.name, comparison.role, *errors))
    return "\n".join([columns(rows), *result.notes])


def columns(rows: Sequence[Sequence[str]]) -> str:
    """Rows of text in columns: the first to the left, the others to the right."""
    widths = [max(len(row[k]) for row in rows) for k in range(len(rows[0]))]
    lines = []
    for row in rows:
        cells = [cell.ljust(w) if k < 1 else cell.rjust(w) for k, (cell, w) in enumerate(zip(row, widths, strict=True))]
        lines.append("  ".join(cells).rstrip())
    return "\n".join(lines)
