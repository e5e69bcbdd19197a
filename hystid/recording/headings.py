"""Names and units of the columns of a text file, from the lines around the numbers."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

from hystid.recording.names import is_unit, known_name, labels_units, scales, split_header
from hystid.recording.stamps import is_stamp
from hystid.recording.text_cells import COMMAS, EXAMPLE, FORTRAN, Line, cells_of, is_number, refused, row_length

_HEADERS = 4  # rows above the numbers that may hold names, units, or what a logger has to say of each channel

Header = tuple[str, str | None]


def headers_of(
    path: Path, above: Sequence[Line], comments: Sequence[Line], rows: Sequence[Line], separator: str | None
) -> list[Header]:
    """(name, unit) of every column. Raises RecordingError where they do not name the columns of the rows."""
    width = max((row_length(line, separator) for _, line in rows[:50]), default=0)
    if above and separator is None and "[" in above[-1][1] and not width > 1:
        raise refused(path, "columns", "only one column is there", EXAMPLE, line=above[-1][0])
    names = [_heading(line, separator, 0) for _, line in above[-_HEADERS:]]
    if separator == "," and any(2 * len(cells) == width and any(map(_known, cells)) for cells in names):
        raise refused(path, "cell", *COMMAS, line=rows[0][0])
    candidates = [_heading(line, separator, width) for _, line in above[-_HEADERS:]]
    candidates = [cells for cells in candidates if len(cells) > 1 and (not width or abs(len(cells) - width) <= 1)]
    if not candidates and rows:
        before = [line.lstrip("#% ") for number, line in comments if number < rows[0][0]]
        named = [_heading(line, separator, width) for line in before]
        candidates = [cells for cells in named if len(cells) == width and any(_known(cell) for cell in cells)]
    if not candidates:
        if not above:
            found = "the first line holds numbers instead of names"
            raise refused(path, "columns", found, EXAMPLE, line=rows[0][0])
        if width <= 1:
            raise refused(path, "columns", "only one column is there", EXAMPLE, line=above[-1][0])
        found = f"the line before the numbers does not name {width} columns"
        raise refused(path, "columns", found, EXAMPLE, line=above[-1][0])
    return _named(candidates, width)


def _heading(line: str, separator: str | None, width: int) -> list[str]:
    """Cells of a line of names. Names may hold blanks where blanks part the numbers: two or more then part them."""
    cells = cells_of(line, separator)
    if separator is None and width and len(cells) != width:
        for mark in (r"\t", r"\s{2,}", ";", r"(?<=[\])])\s+", ","):
            parted = [cell.strip() for cell in re.split(mark, line.strip())]
            if len(parted) == width:
                return parted
    while len(cells) > max(width, 1) and cells[-1] == "":
        cells.pop()
    return cells


def _known(cell: str) -> bool:
    return known_name(split_header(cell)[0]) is not None


def _named(candidates: Sequence[list[str]], width: int) -> list[Header]:
    """The row with the most known names (the lowest of equals), and a row of nothing but units beside it."""
    units = [all(is_unit(cell) for cell in cells) and any(cells) for cells in candidates]
    scores = [sum(map(_known, cells)) - (0.5 if unit else 0.0) for cells, unit in zip(candidates, units, strict=True)]
    best = max(range(len(candidates)), key=lambda k: (scores[k], not units[k], k))
    headers = [split_header(cell) for cell in candidates[best]]
    while width and len(headers) > width and headers[-1] == ("", None):
        headers.pop()
    beside = [cells for k, (cells, unit) in enumerate(zip(candidates, units, strict=True)) if unit and k != best]
    if beside and all(unit is None for _, unit in headers):
        return _in_units(headers, beside[-1])
    return headers


def _in_units(headers: Sequence[Header], cells: Sequence[str]) -> list[Header]:
    """The headers with units from the cells of a row, as far as it goes."""
    row = [*cells, *[""] * len(headers)]
    return [(name, unit.strip().strip("[](){}") or None) for (name, _), unit in zip(headers, row, strict=False)]


def with_unit_row(headers: list[Header], above: Sequence[Line], separator: str | None) -> list[Header]:
    """Units from a row that says so in its first cell, as "Einheit;s;N;mm", where the names state none."""
    for _, line in reversed(above):
        label, *cells = _heading(line, separator, len(headers))
        if labels_units(label) and any(cells) and len(cells) < len(headers) and not any(map(_known, cells)):
            if any(unit is not None for _, unit in headers):
                return headers
            return [headers[0], *_in_units(headers[1:], cells)]
    return headers


def with_units_below(headers: list[Header], below: Sequence[Line], separator: str | None) -> list[Header]:
    """Units from a row of nothing but units below the samples, where the names state none."""
    rows = [cells_of(line, separator) for _, line in below]
    rows = [row for row in rows if len(row) == len(headers) and all(map(is_unit, row)) and any(row)]
    if not rows or any(unit is not None for _, unit in headers):
        return headers
    return _in_units(headers, rows[0])


def refuse_scales(path: Path, above: Sequence[Line], separator: str | None) -> None:
    """Raise RecordingError for factors above the samples: nobody knows whether the logger has applied them."""
    for number, line in above[-_HEADERS:]:
        cells = [cell for cell in cells_of(line, separator) if cell]
        if cells and scales(cells[0]) and any(_is_factor(cell) for cell in cells[1:]):
            found = f"'{' '.join(cells)[:60]}' scales the columns below, and is not applied"
            raise refused(path, "columns", found, "write the columns in their units and cut this line", line=number)


def _is_factor(cell: str) -> bool:
    """Whether a cell is a number other than 0 and 1; one with marks of thousands may be any, a date is none."""
    if is_stamp(cell) or not is_number(cell):
        return False
    try:
        return float(FORTRAN.sub("e", cell.replace(",", "."))) not in (0.0, 1.0)
    except ValueError:
        return True
