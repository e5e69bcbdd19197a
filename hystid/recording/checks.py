"""Checks of single channels: finite, changing, not clipped. Whether they fit each other: ``hystid.consistency``."""

from __future__ import annotations

import math
import sys
from collections.abc import Mapping

import numpy as np

from hystid.numeric import Array, stretches
from hystid.recording.problems import RecordingProblem
from hystid.recording.table import RawTable

_NO_SIZE = 1e30  # in any unit: overflow is 9.9E37 in instruments, and 3.4e38 in single precision
_NO_SQUARE = 1e150  # beyond it no square is finite: a damaged value, and no marker of a logger


def channel_problems(table: RawTable, channels: Mapping[str, Array]) -> list[RecordingProblem]:
    """Problems of single channels: wrong length, NaN, constant, clipped."""
    problems: list[RecordingProblem] = []
    n = channels["t"].size if "t" in channels else 0
    for name, values in channels.items():
        if name == "t":
            continue
        if n and values.size != n:
            found = f"{values.size} samples where time has {n}"
            problems.append(table.problem("length", found, "write all channels with one length", name))
            continue
        problems += _not_finite(table, name, values) or _constant(table, name, values) or _clipped(table, name, values)
    return problems


def without_markers(values: Array) -> tuple[Array, float, int]:
    """Values with NaN for what a logger writes where nothing was measured; the marker, and how many samples hold it.

    Markers are 1e30 to 1e150, which nothing measures, and nothing but nines, as -9999, of at least three digits and
    twice as large as all that was measured.
    """
    with np.errstate(invalid="ignore"):
        size = np.abs(values)
        top = float(np.max(size, where=np.isfinite(size), initial=0.0))
        digits = np.round(np.log10(top + 1.0)) if top < _NO_SIZE else 0.0
        far = np.isfinite(size) & ((size >= _NO_SIZE) | ((size == 10.0**digits - 1.0) & (digits >= 3)))
        far &= size < _NO_SQUARE
        rest = float(np.max(size, where=np.isfinite(size) & ~far, initial=0.0))
    if not np.any(far) or np.all(far) or 2.0 * rest > float(np.min(size[far])):
        return values, 0.0, 0
    return np.where(far, np.nan, values), float(values[far][0]), int(np.count_nonzero(far))


def _not_finite(table: RawTable, name: str, values: Array) -> list[RecordingProblem]:
    bad = np.flatnonzero(~np.isfinite(values))
    found = f"{bad.size} of {values.size} samples are NaN or infinite"
    if not bad.size:  # energies and spectra are sums of squares: these must be finite too
        bad = np.flatnonzero(np.abs(values) > math.sqrt(sys.float_info.max / max(values.size, 1)))
        found = f"{bad.size} of {values.size} samples are beyond 1e150, where squares of numbers overflow"
    if not bad.size:
        return []
    action = "cut these samples, or fill them knowingly"
    return [table.problem("not_finite", found, action, name, int(bad[0]))]


def _constant(table: RawTable, name: str, values: Array) -> list[RecordingProblem]:
    if not is_constant(values):
        return []
    found = f"the channel is constant ({values[0]:.6g})"
    action = "check that the sensor was connected" + (", or remove the column" if name in ("v", "a", "R") else "")
    rule = "missing_force" if name == "F" and not np.any(values) else "constant"
    return [table.problem(rule, found, action, name)]


def is_constant(values: Array) -> bool:
    """Whether a channel changes by no more than rounding."""
    return float(np.ptp(values)) <= 1e-12 * float(np.max(np.abs(values), initial=0.0))


def _clipped(table: RawTable, name: str, values: Array) -> list[RecordingProblem]:
    idle = 2 * np.count_nonzero(values == 0) > values.size  # as a force between blows: nought is no limit there
    for side, found_at in (("top", flat_tops(values)), ("bottom", flat_tops(-values))):
        if len(found_at) >= 2 and not (idle and values[found_at[0][0]] == 0):
            held = sum(length for _, length in found_at)
            limit = values.max() if side == "top" else values.min()
            found = f"cut off at {limit:.6g}: it arrives there in full motion {len(found_at)} times for {held} samples"
            action = "measure again with a larger range, or use the tests below it"
            return [table.problem("clipped", found, action, name, found_at[0][0])]
    return []


def flat_tops(values: Array) -> list[tuple[int, int]]:
    """(first sample, length) of each stay of at least 3 samples at the exact maximum that is entered in full motion.

    A smooth signal slows down before its peak: its last step is of the size of one digit of the converter, even if
    it then rests. A clipped one arrives with a step of the size that it makes elsewhere in the same rise.
    """
    steps = np.diff(values)
    moving = np.abs(steps[steps != 0])
    if moving.size < 8:
        return []
    digit = float(moving.min())
    tops = []
    for start, end in stretches(values == values.max()):
        if end - start < 3 or start < 4:
            continue
        before = steps[start - 4 : start - 1]  # the last step is cut short by the limit itself
        if (
            before[-1] > 0
            and before.min() > 3 * digit
            and before.min() > 0.25 * np.median(moving)
            and _rises_on(before)
        ):
            tops.append((start, end - start))
    return tops


def _rises_on(before: Array) -> bool:
    """Whether a parabola through the last steps would still go on rising for two samples: a peak would not."""
    slowing = (before[0] - before[-1]) / (before.size - 1)
    return bool(before[-1] - 2.5 * slowing > 0.0)
