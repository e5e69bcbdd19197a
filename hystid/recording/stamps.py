"""Cells that hold a time of day, with or without a date: what loggers write instead of seconds."""

from __future__ import annotations

import datetime
import re
from collections.abc import Sequence

import numpy as np

from hystid.numeric import Array

_DAY = 86400.0  # s
_CLOCK = re.compile(
    r"""^(?:(?P<iso>\d{4}-\d\d-\d\d)[T\s]+
    |\d{1,4}[./-]\d{1,2}[./-]\d{2,4},?\s+|\d{1,2}[-\s]?[^\W\d_]{3,4}\.?[-\s]?\d{2,4}[:,]?\s+)?  # another date
    (?P<hours>\d{1,2}):(?P<minutes>\d\d):(?P<seconds>\d\d(?:[.,]\d+|:\d{3})?)\s*(?P<half>[AaPp][Mm])?
    \s*(?:Z|UTC|GMT|(?P<zone>[+-]\d\d:?\d\d))?$""",
    re.VERBOSE,
)
_COMPACT = re.compile(r"^(\d{4})(\d\d)(\d\d)T(\d\d)(\d\d)(\d\d(?:[.,]\d+)?)(Z|[+-]\d\d:?\d\d)?$")  # ISO 8601, basic
_MINUTES = re.compile(r"^(?P<minutes>\d{1,2}):(?P<seconds>\d\d[.,]\d+)$")  # as spreadsheets show fractions of seconds


def is_stamp(cell: str) -> bool:
    """Whether a cell is a time of day, as "13:59:59.8", "2024-03-05T13:59:59.8", "13:59:59:800" or "59:59.8"."""
    if "T" in cell and _COMPACT.match(cell):
        return True
    return ":" in cell and (_CLOCK.match(cell) is not None or _MINUTES.match(cell) is not None)


def seconds(cells: Sequence[str]) -> Array:
    """Seconds since midnight of the first day (UTC where a zone is stated), shape (n,); NaN for what is no time of day.

    Days of ISO dates count; of other dates nobody can tell day from month, so that there a clock that falls back by
    half a day or more went through midnight. "59:59.8" falls back after an hour instead.
    """
    found = np.full(len(cells), np.nan)
    first: int | None = None
    period, dated = _DAY, False
    for k, cell in enumerate(cells):
        cell = _COMPACT.sub(r"\1-\2-\3T\4:\5:\6\7", cell)
        if match := _CLOCK.match(cell):
            found[k] = 3600 * _hours(match) + 60 * int(match["minutes"]) + _number(match["seconds"])
            if match["zone"]:  # summer time may begin or end within a test
                found[k] -= _offset(match["zone"])
            if match["iso"] and (day := _day(match["iso"])) is not None:
                first = day if first is None else first
                found[k] += _DAY * (day - first)
                dated = True
        elif match := _MINUTES.match(cell):
            found[k] = 60 * int(match["minutes"]) + _number(match["seconds"])
            period = 3600.0
    return found if dated else _without_midnight(found, period)


def _without_midnight(t: Array, period: float) -> Array:
    there = np.flatnonzero(np.isfinite(t))
    turns = np.cumsum(np.diff(t[there], prepend=t[there[:1]]) < -0.5 * period)
    t[there] += period * turns
    return t


def _hours(match: re.Match[str]) -> int:
    hours = int(match["hours"])
    if not match["half"]:
        return hours
    return hours % 12 + (12 if match["half"].lower() == "pm" else 0)


def _offset(zone: str) -> float:
    return float(f"{zone[0]}1") * (3600 * int(zone[1:3]) + 60 * int(zone[-2:]))


def _number(text: str) -> float:
    return float(text.replace(",", ".").replace(":", "."))


def _day(text: str) -> int | None:
    try:
        return datetime.date.fromisoformat(text).toordinal()
    except ValueError:
        return None
