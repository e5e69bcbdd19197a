"""A table as it stands in a file: named columns with their unit text, before anything is interpreted."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from hystid.errors import listed
from hystid.numeric import Array
from hystid.recording.names import split_header
from hystid.recording.problems import RecordingProblem, Severity


@dataclass(frozen=True)
class Column:
    """One column. values: shape (n,). unit is None where the file states none. counts: stored as whole numbers."""

    name: str
    unit: str | None
    values: Array
    counts: bool = False


@dataclass(frozen=True)
class RawTable:
    """The columns of one test. Columns may differ in length until the door checks have run.

    file is what messages call it. lines holds the line number of each sample for text files, else None.
    sample_rate [Hz] is given by formats that store no time column.
    """

    file: str
    columns: tuple[Column, ...]
    name: str = ""
    lines: range | Array | None = None
    sample_rate: float | None = None

    def line(self, sample: int | None) -> int | None:
        """Line number of a sample, None where the format has no lines."""
        if sample is None or self.lines is None:
            return None
        return int(self.lines[sample])

    def named(self) -> str:
        """Its columns for a sentence that can be read: at most 40, and of a long name its begin."""
        return listed([c.name if len(c.name) <= 60 else f"{c.name[:60]}..." for c in self.columns], 40)

    def problem(
        self,
        rule: str,
        found: str,
        action: str,
        channel: str = "",
        sample: int | None = None,
        severity: Severity = "error",
    ) -> RecordingProblem:
        """A problem of this table; see ``RecordingProblem``."""
        return RecordingProblem(self.file, rule, found, action, channel, sample, self.line(sample), severity)


def column(header: str, values: object) -> Column:
    """A column from its header text and anything that converts to a vector of numbers."""
    name, unit = split_header(header)
    return Column(name, unit, np.ascontiguousarray(np.asarray(values, dtype=np.float64).ravel()))


def clock_seconds(values: np.ndarray[Any, Any]) -> Array | None:
    """Time stamps as seconds from the first one, durations as seconds, shape (n,); None where values are neither."""
    if values.dtype.kind == "M" and values.size:
        values = values - values[0]
    return np.asarray(values / np.timedelta64(1, "s")) if values.dtype.kind == "m" else None


def clocks_apart(time: Array, other: Array) -> str:
    """How another time axis [s] of as many samples differs, as "is sampled at other times than".

    "" where none stands half a step or more elsewhere, and where the lengths differ.
    """
    if time.size != other.size or time.size < 2:
        return ""
    far = np.abs(other - time) >= 0.5 * abs(time[1] - time[0])
    if not np.any(far):
        return ""
    spans = f"{other[0]:.6g} to {other[-1]:.6g} s beside {time[0]:.6g} to {time[-1]:.6g} s"
    return f"is sampled at other times ({spans}) than"
