"""The time axis: order, gaps, unequal steps; and the uniform grid that everything later relies on."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from hystid.errors import counted
from hystid.numeric import Array
from hystid.recording.problems import RecordingProblem
from hystid.recording.table import RawTable

SHORTEST = 16  # samples: below, no filter, no derivative and no fit means anything
ROUNDING = 0.02  # of a step: time stamps this close to a uniform grid were rounded when written
_JITTER = 0.08  # of a step, rms: a clock that wanders this little is put on a grid by interpolation
_DROPPED = 8.5  # steps: up to so long an interval, a few samples were dropped and are interpolated
_FEW_DIGITS = 0.1  # share of repeated stamps beyond which the clock is too coarse, and no sample was written twice
_MOST_DROPPED = 0.03  # share of intervals that may be such


@dataclass(frozen=True)
class Grid:
    """The uniform grid ``t`` of shape (n,) and how to bring a channel onto it.

    part selects the samples that are kept. stamps are their time stamps where interpolation is needed, else None.
    """

    t: Array
    part: slice
    stamps: Array | None
    notes: tuple[str, ...] = ()
    problems: tuple[RecordingProblem, ...] = ()

    def place(self, values: Array) -> Array:
        """A channel of the file, shape (samples in the file,), on this grid, shape (n,)."""
        kept = values[self.part]
        return kept if self.stamps is None else np.interp(self.t, self.stamps, kept)


def order_problems(table: RawTable, t: Array) -> list[RecordingProblem]:
    """Samples at which time is not finite, repeats or runs backwards."""
    problems = []
    bad = np.flatnonzero(~np.isfinite(t))
    if bad.size:
        sample = int(bad[0])
        found = f"time is not a number at {counted(bad.size, 'sample')}"
        problems.append(table.problem("not_finite", found, "cut or complete these samples", "t", sample))
        return problems
    step = np.diff(t)
    if step.size and np.all(step < 0):
        return [
            table.problem("time_order", "time runs backwards throughout", "reverse the order of the samples", "t", 1)
        ]
    for found, where in (("repeats", step == 0), ("runs backwards", step < 0)):
        at = np.flatnonzero(where) + 1
        if at.size:
            text = f"time {found} (t = {t[at[0]]:.9g} s after {t[at[0] - 1]:.9g} s), {counted(at.size, 'time')} in all"
            action = (
                "remove the repeated samples" if found == "repeats" else "sort the file or split it into one per test"
            )
            if found == "repeats" and at.size > _FEW_DIGITS * t.size:
                text = f"time was written with too few digits: {at.size} of {t.size} samples repeat the one before"
                action = "write more digits, or cut the column of t and write 'sample rate: ... Hz' above the header"
            problems.append(table.problem("time_order", text, action, "t", int(at[0])))
    return problems


def uniform(table: RawTable, t: Array, *, resample: bool) -> Grid:
    """The grid for increasing time stamps t, shape (n,), n >= 16.

    Rounded stamps are put on their grid; a little jitter and single dropped samples are interpolated; of a recording
    with longer gaps the longest part without gap is kept if it holds at least half of the samples. With ``resample``
    everything is interpolated linearly, across gaps too.
    """
    step = np.diff(t)
    dt = float(np.median(step))
    if resample:
        return _interpolated(t, slice(0, t.size), dt, "resampled linearly onto a uniform grid as asked")
    gaps = np.flatnonzero(step > _DROPPED * dt)
    if gaps.size:
        return _longest_part(table, t, dt, gaps)
    return _without_gaps(table, t, slice(0, t.size))


def _longest_part(table: RawTable, t: Array, dt: float, gaps: NDArray[np.intp]) -> Grid:
    edges = np.concatenate([[0], gaps + 1, [t.size]])
    longest = int(np.argmax(np.diff(edges)))
    part = slice(int(edges[longest]), int(edges[longest + 1]))
    kept = part.stop - part.start
    first = int(gaps[0]) + 1
    found = (
        f"{counted(gaps.size, 'gap')} in time, the first of {t[first] - t[first - 1]:.4g} s"
        f" before t = {t[first]:.6g} s where the usual step is {dt:.4g} s"
    )
    if kept < max(t.size // 2, SHORTEST):
        action = "split the file at the gaps, or accept interpolation across them with --resample"
        problem = table.problem("gap", found, action, "t", first)
        return Grid(t, slice(0, t.size), None, (), (problem,))
    action = f"the longest part without gap is used: samples {part.start} to {part.stop - 1}, {kept} of {t.size}"
    problem = table.problem("gap", found, action, "t", first, "warning")
    rest = _without_gaps(table, t, part)
    return Grid(rest.t, part, rest.stamps, (action, *rest.notes), (problem, *rest.problems))


def _without_gaps(table: RawTable, t: Array, part: slice) -> Grid:
    stamps = t[part]
    n = stamps.size
    step = np.diff(stamps)
    dt = (stamps[-1] - stamps[0]) / (n - 1)
    grid = stamps[0] + dt * np.arange(n)
    if np.max(np.abs(stamps - grid)) <= ROUNDING * dt + np.spacing(np.abs(stamps[-1])):
        return Grid(grid, part, None)
    median = float(np.median(step))
    dropped = step > 1.5 * median
    jitter = float(np.std(step[~dropped]) / median)
    if jitter > _JITTER or dropped.mean() > _MOST_DROPPED:
        sample = part.start + int(np.argmax(np.abs(step - median))) + 1
        found = f"steps between {step.min():.4g} and {step.max():.4g} s (jitter {100 * jitter:.0f} % of the usual step)"
        action = "resample it with the tool that recorded it, or accept linear interpolation with --resample"
        return Grid(t, slice(0, t.size), None, (), (table.problem("unequal_steps", found, action, "t", sample),))
    text = f"time stamps jitter by {100 * jitter:.1f} % of a step: interpolated linearly onto a uniform grid"
    grid = _interpolated(t, part, float(np.mean(step[~dropped])), text)
    if not dropped.any():
        return grid
    lost = int(np.sum(np.rint(step[dropped] / median) - 1))
    found = f"{counted(lost, 'sample')} missing at {counted(int(dropped.sum()), 'place')}"
    first = part.start + int(np.argmax(dropped)) + 1
    problem = table.problem("gap", found, "they were interpolated linearly", "t", first, "warning")
    return replace(grid, problems=(problem,))


def _interpolated(t: Array, part: slice, dt: float, note: str) -> Grid:
    stamps = t[part]
    n = max(round((stamps[-1] - stamps[0]) / dt), 1) + 1
    return Grid(np.linspace(stamps[0], stamps[-1], n), part, stamps, (note,))
