"""Lines of a text file as cells, and what counts as a number in one."""

from __future__ import annotations

import csv
import re
from functools import cache
from pathlib import Path

from hystid.errors import RecordingError
from hystid.recording.problems import RecordingProblem
from hystid.recording.stamps import is_stamp

EXAMPLE = "name the columns like 't [s],F [N],x [m]'"
MISSING = frozenset(
    {"", "nan", "na", "n/a", "#n/a", "-", "--", "---", "null", "none", "n.a.", "#nv", "1.#qnan", "-nan"}
)
COMMAS = (
    "commas separate both columns and decimals", "separate the columns with semicolons, or write decimal points"
)  # fmt: skip
_PLAIN = r" *[+-]?\d+(?:\.\d*)?(?:[eE][+-]?\d+)? *"  # a number as nearly all are written
FORTRAN = re.compile(r"(?<=[\d.])[dD](?=[+-]?\d)")  # 1.5D-03
THOUSANDS = re.compile(r"[+-]?\d{1,3}(?:([,.'\s])\d{3})(?:\1\d{3})*(?:[.,]\d+)?")

Line = tuple[int, str]


def cells_of(line: str, separator: str | None) -> list[str]:
    """Cells of a line without blanks and quotes around them; separator None: blanks part them."""
    if separator and '"' in line:
        return [cell.strip() for cell in next(csv.reader([line.strip("\r\n")], delimiter=separator))]
    text = line.strip() if separator != "\t" else line.strip("\r\n ")
    return [cell.strip().strip('"') for cell in text.split(separator)]


def row_length(line: str, separator: str | None) -> int:
    """Number of cells where all of them are numbers or missing and at least one is a number, else 0."""
    if separator is not None and _plain_row(separator).fullmatch(line):
        return line.count(separator) + 1
    cells = cells_of(line, separator)
    while len(cells) > 1 and cells[-1] == "":
        cells.pop()
    numbers = [is_number(cell) for cell in cells]
    allowed = all(number or cell.lower() in MISSING for number, cell in zip(numbers, cells, strict=True))
    return len(cells) if allowed and any(numbers) else 0


@cache
def _plain_row(separator: str) -> re.Pattern[str]:
    """Rows that are nothing but plain numbers."""
    return re.compile(f"{_PLAIN}(?:{re.escape(separator)}{_PLAIN})*")


def is_number(cell: str) -> bool:
    """Whether a number is meant, in any way of writing: those that are not read are refused in their own words."""
    try:
        float(FORTRAN.sub("e", cell.replace(",", ".")))
    except ValueError:
        return is_stamp(cell) or THOUSANDS.fullmatch(cell) is not None
    return cell.strip().lower() not in MISSING


def refused(
    path: Path,
    rule: str,
    found: str,
    action: str,
    sample: int | None = None,
    line: int | None = None,
    channel: str = "",
) -> RecordingError:
    """The error of a rule that a text file breaks."""
    return RecordingError(str(RecordingProblem(path.name, rule, found, action, channel, sample, line)))
