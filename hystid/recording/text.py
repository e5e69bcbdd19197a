"""CSV and its relatives as loggers write them: any of comma, semicolon, tab or blanks; decimal point or comma;
UTF-8, UTF-16, Windows and Japanese code pages; lines before the table; names and units in one row or in two.

Lines that start with ``#`` or ``%`` are comments; the last one before the numbers may hold the names.
"""

from __future__ import annotations

import codecs
import json
import re
from collections import Counter
from collections.abc import Collection, Sequence
from pathlib import Path

import numpy as np

from hystid.errors import RecordingError
from hystid.files import content_of
from hystid.numeric import Array
from hystid.recording.headings import Header, headers_of, refuse_scales, with_unit_row, with_units_below
from hystid.recording.names import announced, known_name
from hystid.recording.stamps import is_stamp, seconds
from hystid.recording.table import Column, RawTable
from hystid.recording.text_cells import (
    COMMAS,
    EXAMPLE,
    FORTRAN,
    MISSING,
    THOUSANDS,
    Line,
    cells_of,
    is_number,
    refused,
    row_length,
)  # fmt: skip

_LOST = 0.01  # share of rows that may have lost a cell, as ``reading`` bridges them
_LOOKED_AT = 200  # lines by which the separator is chosen
_MARKS = ("\t", ";", ",", "|", None)  # that part columns; None: blanks
_ONE_MARK = "write numbers with one decimal mark and no marks between thousands"

_MINUS = "\N{MINUS SIGN}"  # what word processors make of a hyphen
_WITH_UNIT = re.compile(r"[+-]?\d+(?:[.,]\d+)?\s*[^\W\d]\S*$")

_LONGEST_LINE = 1_000_000  # characters: some 50,000 columns
_LONGEST_NOTE, _MOST_NOTES = 1_000, 2_000  # characters and lines above the table that are read for a sample rate


def read_text(path: Path) -> list[RawTable]:
    """The one table of a text file. Raises RecordingError naming the line and column of the first bad cell."""
    lines, comments = _content(path)
    if not lines:
        raise refused(path, "format", "the file is empty", EXAMPLE + " and put one sample in each line")
    if _is_json([line for _, line in lines]):
        raise refused(path, "format", "this is JSON, and no table of columns", EXAMPLE)
    separator = _separator([line for _, line in lines])
    first = _first_row(lines, separator)
    headers = headers_of(path, lines[:first], comments, lines[first:], separator)
    body = _body(lines[first:], separator)
    if not body:
        raise _without_samples(path, lines[-1], separator)
    refuse_scales(path, lines[:first], separator)
    headers = with_unit_row(headers, lines[:first], separator)
    headers = with_units_below(headers, lines[first + len(body) :], separator)
    headers, body = _with_seconds(headers, body, separator)
    headers, body = _without_words(headers, body, separator)
    values = _numbers(path, headers, body, separator)
    _refuse_thousands(path, headers, body, values, separator)
    columns = tuple(Column(name, unit, np.ascontiguousarray(values[:, k])) for k, (name, unit) in enumerate(headers))
    before = [line.strip()[:_LONGEST_NOTE] for _, line in [*comments, *lines[:first]][-_MOST_NOTES:]]
    rates = [rate for line in before if (rate := announced(line)) is not None]
    return [RawTable(path.name, columns, path.stem, _line_numbers(body), rates[-1] if rates else None)]


def _is_json(lines: Sequence[str]) -> bool:
    if lines[0].lstrip()[0] not in "{[":
        return False
    try:
        json.loads("\n".join(lines))
    except (ValueError, RecursionError):
        return False
    return True


def _without_samples(path: Path, last: Line, separator: str | None) -> RecordingError:
    cells = [cell for cell in cells_of(last[1], separator) if _WITH_UNIT.match(cell)]
    if cells:
        found = f"'{cells[0][:40]}' holds more than a number"
        return refused(path, "cell", found, "write units into the header, and numbers alone below it", line=last[0])
    return refused(path, "too_short", "there is a header but no sample", "record at least 16 samples")


def _content(path: Path) -> tuple[list[Line], list[Line]]:
    """(line number, text) of every line that is not blank: those of the table, and comments."""
    lines: list[Line] = []
    comments: list[Line] = []
    for number, line in enumerate(_decode(path).replace(_MINUS, "-").splitlines(), start=1):
        if line.strip():
            is_comment = line.lstrip().startswith(("#", "%"))
            if len(line) > _LONGEST_LINE and not is_comment:
                found = f"the line has {len(line)} characters"
                raise refused(path, "format", found, "put one sample in each line", line=number)
            (comments if is_comment else lines).append((number, line))
    return lines, comments


def _decode(path: Path) -> str:
    raw = content_of(path, RecordingError)
    for mark, name in (
        (codecs.BOM_UTF8, "utf-8-sig"),
        (codecs.BOM_UTF32_LE, "utf-32"),
        (codecs.BOM_UTF16_LE, "utf-16"),
        (codecs.BOM_UTF16_BE, "utf-16"),
    ):
        if raw.startswith(mark):
            return raw.decode(name, errors="replace")
    head = raw[:4096]
    if b"\0" in head:
        for name, zeros in (("utf-16-le", head[1::2]), ("utf-16-be", head[::2])):
            if zeros.count(0) > 0.6 * len(zeros):  # plain text in two bytes: every other byte is zero
                return raw.decode(name, errors="replace")
        advice = "give CSV, .mat, .h5, .uff, .tdms, .mf4 or .parquet by its suffix"
        raise refused(path, "format", "this is a binary file, not text", advice)
    for name in ("utf-8", "cp932", "gb18030", "cp949", "cp1252"):
        try:
            text = raw.decode(name)
        except UnicodeDecodeError:
            continue
        if name not in ("cp932", "gb18030", "cp949") or _is_asian(text):
            return text
    return raw.decode("latin-1")  # every byte is a character there: headers such as "µm" or "m/s²" survive


def _is_asian(text: str) -> bool:
    """Whether words that hystid knows stand there; by chance, other code pages make rare characters of two bytes."""
    words = re.findall(r"[ぁ-んァ-ヶー一-龠가-힣]+", text[:20_000])
    return any(known_name(word) is not None for word in words)


def _separator(lines: Sequence[str]) -> str | None:
    """What parts the columns: that which makes most lines rows of numbers, of the most usual length."""
    looked_at = [*lines[: _LOOKED_AT // 2], *lines[-_LOOKED_AT:]]
    best, most = None, 0.0
    for mark in _MARKS:
        counts = Counter(n for line in looked_at if (n := row_length(line, mark)) > 1)
        usual = counts.most_common(1)
        if usual and usual[0][1] > most:
            best, most = mark, usual[0][1]
    if most:
        return best
    return next((mark for mark in _MARKS if mark and mark in lines[0]), None)


def _first_row(lines: Sequence[Line], separator: str | None) -> int:
    """Index of the first row of numbers: of the usual length, and with others of its kind after it."""
    lengths = Counter(n for _, line in lines[: 50 * _LOOKED_AT] if (n := row_length(line, separator)) > 1)
    if not lengths:
        return next((k for k, (_, line) in enumerate(lines) if k and _is_data_like(line, separator)), len(lines))
    usual = lengths.most_common(1)[0][0]
    rows: list[bool] = []  # as far as it had to be looked: to the tenth row after the first, mostly
    alone = None
    for k in range(len(lines)):
        rows += [row_length(line, separator) == usual for _, line in lines[len(rows) : k + 10]]
        if rows[k] and 2 * sum(rows[k : k + 10]) >= len(rows[k : k + 10]):
            return _with_remarks(lines, k, separator)
        alone = k if rows[k] and alone is None else alone
    assert alone is not None  # lines of the usual length are there
    return alone


def _with_remarks(lines: Sequence[Line], first: int, separator: str | None) -> int:
    """The first row, where rows before it have a word in a column that is empty below, as a remark on a sample."""
    cells = cells_of(lines[first][1], separator)
    at = [k for k, cell in enumerate(cells) if is_number(cell)]
    while first > 0:
        above = cells_of(lines[first - 1][1], separator)
        if len(above) != len(cells) or not all(is_number(above[k]) for k in at):
            break
        first -= 1
    return first


def _is_data_like(line: str, separator: str | None) -> bool:
    cells = cells_of(line, separator)
    return sum(is_number(cell) for cell in cells) * 2 >= len(cells)


def _body(rows: Sequence[Line], separator: str | None) -> list[Line]:
    """Rows of the table without what a logger wrote after its end."""
    body = list(rows)
    while body and not row_length(body[-1][1], separator) and not any(map(is_number, cells_of(body[-1][1], separator))):
        body.pop()
    return body


def _with_seconds(headers: list[Header], body: list[Line], separator: str | None) -> tuple[list[Header], list[Line]]:
    """The table with times of day as seconds; where another column is the time, they are left out."""
    first = cells_of(body[0][1], separator)
    at = [k for k, cell in enumerate(first[: len(headers)]) if is_stamp(cell)]
    if not at:
        return headers, body
    rows = [cells_of(line, separator) for _, line in body]
    if any(known_name(name) == "t" for k, (name, _) in enumerate(headers) if k not in at):
        rows = [[cell for k, cell in enumerate(cells) if k not in at] for cells in rows]
        return [header for k, header in enumerate(headers) if k not in at], _joined(body, rows, separator)
    comma = separator != "," and any("," in cell for cells in rows[:50] for k, cell in enumerate(cells) if k not in at)
    for k in at:
        headers[k] = (headers[k][0], "s")
        stamps = seconds([cells[k] if k < len(cells) else "" for cells in rows])
        for cells, value in zip(rows, stamps, strict=True):
            if k < len(cells):
                cells[k] = repr(float(value)).replace(".", "," if comma else ".")
    return headers, _joined(body, rows, separator)


def _without_words(headers: list[Header], body: list[Line], separator: str | None) -> tuple[list[Header], list[Line]]:
    """The table without columns in which no row has a number: comments, dates, and what was not connected."""
    if separator is None:
        return headers, body

    def wordy(rows: Sequence[Sequence[str]], among: Collection[int]) -> set[int]:
        return {k for k in among if not any(is_number(cells[k]) for cells in rows if k < len(cells))}

    looked_at = [cells_of(line, separator) for _, line in body[:_LOOKED_AT]]
    empty = {k for k in range(len(headers)) if not any(cells[k] for cells in looked_at if k < len(cells))}
    dropped = wordy(looked_at, {k for k, (name, _) in enumerate(headers) if known_name(name) is None} | empty)
    if not dropped:
        return headers, body
    rows = [cells_of(line, separator) for _, line in body]
    dropped = wordy(rows, dropped)
    rows = [[cell for k, cell in enumerate(cells) if k not in dropped] for cells in rows]
    return [header for k, header in enumerate(headers) if k not in dropped], _joined(body, rows, separator)


def _joined(body: Sequence[Line], rows: Sequence[Sequence[str]], separator: str | None) -> list[Line]:
    mark = separator or " "
    quoted = [[f'"{cell}"' if mark in cell else cell for cell in cells] for cells in rows]
    return [(number, mark.join(cells)) for (number, _), cells in zip(body, quoted, strict=True)]


def _numbers(path: Path, headers: Sequence[Header], body: Sequence[Line], separator: str | None) -> Array:
    """Shape (n, columns); NaN where a cell or the end of a row is missing."""
    lines = [line for _, line in body]
    if separator != "," and any("," in line for line in lines[:50]):
        lines = _decimal_points(path, body)
    if any(FORTRAN.search(line) for line in lines[:50]):
        lines = [FORTRAN.sub("e", line) for line in lines]
    lines = [line.rstrip().rstrip(separator) if separator and separator != "\t" else line for line in lines]
    try:
        values = np.loadtxt(lines, delimiter=separator, ndmin=2, comments=None, quotechar='"')
    except ValueError:
        values = None
    if values is None or values.shape[1] != len(headers):
        numbered = [(n, line) for (n, _), line in zip(body, lines, strict=True)]
        values = _row_by_row(path, headers, numbered, separator)
    return np.asarray(values, dtype=np.float64)


def _refuse_thousands(
    path: Path, headers: Sequence[Header], body: Sequence[Line], values: Array, separator: str | None
) -> None:
    """Numbers below 1000 without a mark beside numbers with one and three digits behind it: it marks thousands."""
    for k, (name, _) in enumerate(headers):
        size = np.abs(values[:, k][np.isfinite(values[:, k])])
        whole = size == np.round(size)
        if np.all(whole) or np.max(size) >= 1000 or np.min(size[~whole]) < 1 or np.count_nonzero(size[whole] >= 10) < 5:
            continue
        cells = [(number, cells[k]) for number, line in body if k < len(cells := cells_of(line, separator))]
        marked = [(number, cell) for number, cell in cells if "." in cell or "," in cell]
        if all(THOUSANDS.fullmatch(cell) for _, cell in marked):
            found = f"'{marked[0][1]}' beside whole numbers looks like thousands"
            raise refused(path, "cell", found, _ONE_MARK, line=marked[0][0], channel=name)


def _row_by_row(path: Path, headers: Sequence[Header], body: Sequence[Line], separator: str | None) -> Array:
    """As ``_numbers``, for rows that are not all alike. Raises RecordingError for a cell that is no number."""
    values = np.full((len(body), len(headers)), np.nan)
    lost = 0
    for sample, (number, line) in enumerate(body):
        cells = cells_of(line, separator)
        if len(cells) == len(headers) + 1 and cells[-1] == "":
            cells.pop()
        if separator == "," and len(cells) == 2 * len(headers):
            raise refused(path, "cell", *COMMAS, line=number)
        if len(cells) > len(headers):
            found = f"{len(cells)} cells where the header names {len(headers)} columns"
            raise refused(path, "length", found, "complete or remove the line", sample, number)
        lost += len(cells) < len(headers) or "" in cells
        if lost > _LOST * len(body):
            if len(cells) < len(headers):
                found = f"{len(cells)} cells where the header names {len(headers)} columns"
                raise refused(path, "length", found, "complete or remove the line", sample, number)
            name = headers[cells.index("")][0]
            raise refused(path, "cell", "the cell is empty", "write a number, or cut the line", sample, number, name)
        for k, cell in enumerate(cells):
            if cell.lower() in MISSING:
                continue
            try:
                values[sample, k] = float(cell)
            except ValueError:
                found = f"'{cell[:40]}' is not a number"
                action = "write a number, or cut the line"
                action = _ONE_MARK if THOUSANDS.fullmatch(cell) else COMMAS[1] if is_number(cell) else action
                if not any(map(is_number, cells)) or line.startswith("Channels\t"):  # as in LabVIEW's segments
                    found = f"a second table begins with '{line.strip()[:40]}'"
                    action = "put one test in each file, or cut the line"
                raise refused(path, "cell", found, action, sample, number, headers[k][0]) from None
        if len(cells) < len(headers):
            values[sample] = np.nan  # the row broke off: its last number may have lost digits
    return values


def _decimal_points(path: Path, body: Sequence[Line]) -> list[str]:
    for number, line in body:
        if "." in line and "," in line:
            raise refused(path, "cell", "decimal point and decimal comma are mixed", _ONE_MARK, line=number)
    return [line.replace(",", ".") for _, line in body]


def _line_numbers(body: Sequence[Line]) -> range | Array:
    first, last = body[0][0], body[-1][0]
    if last - first == len(body) - 1:
        return range(first, last + 1)
    return np.array([number for number, _ in body], dtype=np.float64)
