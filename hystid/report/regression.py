"""Report of ``hystid.regress``: each signal of the replay beside its reference."""

from __future__ import annotations

import numpy as np

from hystid.fmu import RegressionResult
from hystid.fmu.compared import SignalResult
from hystid.recording import Array
from hystid.report.curves import T_AXIS
from hystid.report.page import Cell, Page, Table, Verdict
from hystid.report.plots import Axis, Band, Line, Plot, Points, Series

_SHOWN_SIGNALS = 12  # signals with a figure


def page(result: RegressionResult, command: str) -> Page:
    """The report; a pure function of the result. command: what the reader can run to get it again."""
    differ = sum(not signal.tube.holds for signal in result.signals)
    headline = f"{differ} of {len(result.signals)} signals differ from the reference"
    if not result.signals:
        headline = "Nothing could be compared"
    elif result.updated:
        headline = "The reference was written anew"
    elif not differ:
        headline = "All signals are as in the reference"
    made = Page(
        f"Regression of {result.path.name}",
        command=command,
        verdict=Verdict("good" if result.passed else "bad", headline),
    )
    ordered = sorted(result.signals, key=lambda s: (s.tube.holds, -s.tube.worst))
    made.section("Signals", "Real numbers must stay in a tube around the reference, all others must be the same.")
    rows: list[list[str | Cell]] = [
        [s.name, Cell(s.text(result.t), "good" if s.tube.holds else "bad")] for s in ordered
    ]
    left, unset = ", ".join((*result.skipped, *result.new)), ", ".join(result.unset)
    note = f"Not compared: {left}. " if left else ""
    note += f"At their start values, for the reference gives no input: {unset}." if unset else ""
    made.table(Table("Outcome", ["signal", "outcome"], rows, note))
    made.plots(*(_figure(signal, result.t) for signal in ordered[:_SHOWN_SIGNALS]))
    made.reproduce(command)
    return made


def _figure(signal: SignalResult, t: Array) -> Plot:
    series: list[Series] = [
        Band(t, signal.tube.lower, signal.tube.upper, "tube", "muted"),
        Line(t, signal.reference, "reference", "reference"),
        Line(t, signal.values, "now", "model"),
    ]
    at = np.flatnonzero(signal.tube.outside)
    if at.size:
        series.append(Points(t[at], signal.values[at], "outside", "bad"))
    return Plot(signal.name, T_AXIS, Axis(signal.name, signal.unit), series)
