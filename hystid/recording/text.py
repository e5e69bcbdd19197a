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
from functools import cache
from pathlib import Path

import numpy as np

from hystid.errors import RecordingError
from hystid.files import content_of
from hystid.numeric import Array
from hystid.recording.names import announced, is_unit, known_name, labels_units, scales, split_header
from hystid.recording.problems import Problem
from hystid.recording.stamps import is_stamp, seconds
from hystid.recording.table import Column, Table

_EXAMPLE = "name the columns like 't [s],F [N],x [m]'"
_MISSING = frozenset(
    {"", "nan", "na", "n/a", "#n/a", "-", "--", "---", "null", "none", "n.a.", "#nv", "1.#qnan", "-nan"}
)
_HEADERS = 4  # rows above the numbers that may hold names, units, or what a logger has to say of each channel
_LOST = 0.01  # share of rows that may have lost a cell, as ``reading`` bridges them
_LOOKED_AT = 200  # lines by which the separator is chosen
_MARKS = ("\t", ";", ",", "|", None)  # that part columns; None: blanks
_COMMAS = (
    "commas separate both columns and decimals", "separate the columns with semicolons, or write decimal points"
)  # fmt: skip
_ONE_MARK = "write numbers with one decimal mark and no marks between thousands"
_PLAIN = r" *[+-]?\d+(?:\.\d*)?(?:[eE][+-]?\d+)? *"  # a number as nearly all are written
_FORTRAN = re.compile(r"(?<=[\d.])[dD](?=[+-]?\d)")  # 1.5D-03
_THOUSANDS = re.compile(r"[+-]?\d{1,3}(?:([,.'\s])\d{3})(?:\1\d{3})*(?:[.,]\d+)?")

_MINUS = "\N{MINUS SIGN}"  # what word processors make of a hyphen
_WITH_UNIT = re.compile(r"[+-]?\d+(?:[.,]\d+)?\s*[^\W\d]\S*$")

_LONGEST_LINE = 1_000_000  # characters: some 50,000 columns
_LONGEST_NOTE, _MOST_NOTES = 1_000, 2_000  # characters and lines above the table that are read for a sample rate

Line = tuple[int, str]
Header = tuple[str, str | None]


def read_text(path: Path) -> list[Table]:
    """The one table of a text file. Raises RecordingError naming the line and column of the first bad cell."""
    lines, comments = _content(path)
    if not lines:
        raise _refused(path, "format", "the file is empty", _EXAMPLE + " and put one sample in each line")
    if _is_json([line for _, line in lines]):
        raise _refused(path, "format", "this is JSON, and no table of columns", _EXAMPLE)
    separator = _separator([line for _, line in lines])
    first = _first_row(lines, separator)
    headers = _headers(path, lines[:first], comments, lines[first:], separator)
    body = _body(lines[first:], separator)
    if not body:
        raise _without_samples(path, lines[-1], separator)
    _refuse_scales(path, lines[:first], separator)
    headers = _with_unit_row(headers, lines[:first], separator)
    headers = _with_units_below(headers, lines[first + len(body) :], separator)
    headers, body = _with_seconds(headers, body, separator)
    headers, body = _without_words(headers, body, separator)
    values = _numbers(path, headers, body, separator)
    _refuse_thousands(path, headers, body, values, separator)
    columns = tuple(Column(name, unit, np.ascontiguousarray(values[:, k])) for k, (name, unit) in enumerate(headers))
    before = [line.strip()[:_LONGEST_NOTE] for _, line in [*comments, *lines[:first]][-_MOST_NOTES:]]
    rates = [rate for line in before if (rate := announced(line)) is not None]
    return [Table(path.name, columns, path.stem, _line_numbers(body), rates[-1] if rates else None)]


def _is_json(lines: Sequence[str]) -> bool:
    if lines[0].lstrip()[0] not in "{[":
        return False
    try:
        json.loads("\n".join(lines))
    except (ValueError, RecursionError):
        return False
    return True


def _without_samples(path: Path, last: Line, separator: str | None) -> RecordingError:
    cells = [cell for cell in _cells(last[1], separator) if _WITH_UNIT.match(cell)]
    if cells:
        found = f"'{cells[0][:40]}' holds more than a number"
        return _refused(path, "cell", found, "write units into the header, and numbers alone below it", line=last[0])
    return _refused(path, "too_short", "there is a header but no sample", "record at least 16 samples")


def _content(path: Path) -> tuple[list[Line], list[Line]]:
    """(line number, text) of every line that is not blank: those of the table, and comments."""
    lines: list[Line] = []
    comments: list[Line] = []
    for number, line in enumerate(_decode(path).replace(_MINUS, "-").splitlines(), start=1):
        if line.strip():
            is_comment = line.lstrip().startswith(("#", "%"))
            if len(line) > _LONGEST_LINE and not is_comment:
                found = f"the line has {len(line)} characters"
                raise _refused(path, "format", found, "put one sample in each line", line=number)
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
        raise _refused(path, "format", "this is a binary file, not text", advice)
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
        counts = Counter(n for line in looked_at if (n := _is_row(line, mark)) > 1)
        usual = counts.most_common(1)
        if usual and usual[0][1] > most:
            best, most = mark, usual[0][1]
    if most:
        return best
    return next((mark for mark in _MARKS if mark and mark in lines[0]), None)


def _cells(line: str, separator: str | None) -> list[str]:
    if separator and '"' in line:
        import csv

        return [cell.strip() for cell in next(csv.reader([line.strip("\r\n")], delimiter=separator))]
    text = line.strip() if separator != "\t" else line.strip("\r\n ")
    return [cell.strip().strip('"') for cell in text.split(separator)]


def _is_row(line: str, separator: str | None) -> int:
    """Number of cells where all of them are numbers or missing and at least one is a number, else 0."""
    if separator is not None and _plain_row(separator).fullmatch(line):
        return line.count(separator) + 1
    cells = _cells(line, separator)
    while len(cells) > 1 and cells[-1] == "":
        cells.pop()
    numbers = [_is_number(cell) for cell in cells]
    allowed = all(number or cell.lower() in _MISSING for number, cell in zip(numbers, cells, strict=True))
    return len(cells) if allowed and any(numbers) else 0


@cache
def _plain_row(separator: str) -> re.Pattern[str]:
    """Rows that are nothing but plain numbers."""
    return re.compile(f"{_PLAIN}(?:{re.escape(separator)}{_PLAIN})*")


def _is_number(cell: str) -> bool:
    """Whether a number is meant, in any way of writing: those that are not read are refused in their own words."""
    try:
        float(_FORTRAN.sub("e", cell.replace(",", ".")))
    except ValueError:
        return is_stamp(cell) or _THOUSANDS.fullmatch(cell) is not None
    return cell.strip().lower() not in _MISSING


def _first_row(lines: Sequence[Line], separator: str | None) -> int:
    """Index of the first row of numbers: of the usual length, and with others of its kind after it."""
    lengths = Counter(n for _, line in lines[: 50 * _LOOKED_AT] if (n := _is_row(line, separator)) > 1)
    if not lengths:
        return next((k for k, (_, line) in enumerate(lines) if k and _is_data_like(line, separator)), len(lines))
    usual = lengths.most_common(1)[0][0]
    rows: list[bool] = []  # as far as it had to be looked: to the tenth row after the first, mostly
    alone = None
    for k in range(len(lines)):
        rows += [_is_row(line, separator) == usual for _, line in lines[len(rows) : k + 10]]
        if rows[k] and 2 * sum(rows[k : k + 10]) >= len(rows[k : k + 10]):
            return _with_remarks(lines, k, separator)
        alone = k if rows[k] and alone is None else alone
    assert alone is not None  # lines of the usual length are there
    return alone


def _with_remarks(lines: Sequence[Line], first: int, separator: str | None) -> int:
    """The first row, where rows before it have a word in a column that is empty below, as a remark on a sample."""
    cells = _cells(lines[first][1], separator)
    at = [k for k, cell in enumerate(cells) if _is_number(cell)]
    while first > 0:
        above = _cells(lines[first - 1][1], separator)
        if len(above) != len(cells) or not all(_is_number(above[k]) for k in at):
            break
        first -= 1
    return first


def _is_data_like(line: str, separator: str | None) -> bool:
    cells = _cells(line, separator)
    return sum(_is_number(cell) for cell in cells) * 2 >= len(cells)


def _headers(
    path: Path, above: Sequence[Line], comments: Sequence[Line], rows: Sequence[Line], separator: str | None
) -> list[Header]:
    """(name, unit) of every column."""
    width = max((_is_row(line, separator) for _, line in rows[:50]), default=0)
    if above and separator is None and "[" in above[-1][1] and not width > 1:
        raise _refused(path, "columns", "only one column is there", _EXAMPLE, line=above[-1][0])
    names = [_heading(line, separator, 0) for _, line in above[-_HEADERS:]]
    if separator == "," and any(2 * len(cells) == width and any(map(_known, cells)) for cells in names):
        raise _refused(path, "cell", *_COMMAS, line=rows[0][0])
    candidates = [_heading(line, separator, width) for _, line in above[-_HEADERS:]]
    candidates = [cells for cells in candidates if len(cells) > 1 and (not width or abs(len(cells) - width) <= 1)]
    if not candidates and rows:
        before = [line.lstrip("#% ") for number, line in comments if number < rows[0][0]]
        named = [_heading(line, separator, width) for line in before]
        candidates = [cells for cells in named if len(cells) == width and any(_known(cell) for cell in cells)]
    if not candidates:
        if not above:
            found = "the first line holds numbers instead of names"
            raise _refused(path, "columns", found, _EXAMPLE, line=rows[0][0])
        if width <= 1:
            raise _refused(path, "columns", "only one column is there", _EXAMPLE, line=above[-1][0])
        found = f"the line before the numbers does not name {width} columns"
        raise _refused(path, "columns", found, _EXAMPLE, line=above[-1][0])
    return _named(candidates, width)


def _heading(line: str, separator: str | None, width: int) -> list[str]:
    """Cells of a line of names. Names may hold blanks where blanks part the numbers: two or more then part them."""
    cells = _cells(line, separator)
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


def _body(rows: Sequence[Line], separator: str | None) -> list[Line]:
    """Rows of the table without what a logger wrote after its end."""
    body = list(rows)
    while body and not _is_row(body[-1][1], separator) and not any(map(_is_number, _cells(body[-1][1], separator))):
        body.pop()
    return body


def _with_unit_row(headers: list[Header], above: Sequence[Line], separator: str | None) -> list[Header]:
    """Units from a row that says so in its first cell, as "Einheit;s;N;mm", where the names state none."""
    for _, line in reversed(above):
        label, *cells = _heading(line, separator, len(headers))
        if labels_units(label) and any(cells) and len(cells) < len(headers) and not any(map(_known, cells)):
            if any(unit is not None for _, unit in headers):
                return headers
            return [headers[0], *_in_units(headers[1:], cells)]
    return headers


def _with_units_below(headers: list[Header], below: Sequence[Line], separator: str | None) -> list[Header]:
    """Units from a row of nothing but units below the samples, where the names state none."""
    rows = [_cells(line, separator) for _, line in below]
    rows = [row for row in rows if len(row) == len(headers) and all(map(is_unit, row)) and any(row)]
    if not rows or any(unit is not None for _, unit in headers):
        return headers
    return _in_units(headers, rows[0])


def _refuse_scales(path: Path, above: Sequence[Line], separator: str | None) -> None:
    """Factors above the samples: nobody knows whether the logger has applied them."""
    for number, line in above[-_HEADERS:]:
        cells = [cell for cell in _cells(line, separator) if cell]
        if cells and scales(cells[0]) and any(_is_factor(cell) for cell in cells[1:]):
            found = f"'{' '.join(cells)[:60]}' scales the columns below, and is not applied"
            raise _refused(path, "columns", found, "write the columns in their units and cut this line", line=number)


def _is_factor(cell: str) -> bool:
    """Whether a cell is a number other than 0 and 1; one with marks of thousands may be any, a date is none."""
    if is_stamp(cell) or not _is_number(cell):
        return False
    try:
        return float(_FORTRAN.sub("e", cell.replace(",", "."))) not in (0.0, 1.0)
    except ValueError:
        return True


def _with_seconds(headers: list[Header], body: list[Line], separator: str | None) -> tuple[list[Header], list[Line]]:
    """The table with times of day as seconds; where another column is the time, they are left out."""
    first = _cells(body[0][1], separator)
    at = [k for k, cell in enumerate(first[: len(headers)]) if is_stamp(cell)]
    if not at:
        return headers, body
    rows = [_cells(line, separator) for _, line in body]
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
        return {k for k in among if not any(_is_number(cells[k]) for cells in rows if k < len(cells))}

    looked_at = [_cells(line, separator) for _, line in body[:_LOOKED_AT]]
    empty = {k for k in range(len(headers)) if not any(cells[k] for cells in looked_at if k < len(cells))}
    dropped = wordy(looked_at, {k for k, (name, _) in enumerate(headers) if known_name(name) is None} | empty)
    if not dropped:
        return headers, body
    rows = [_cells(line, separator) for _, line in body]
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
    if any(_FORTRAN.search(line) for line in lines[:50]):
        lines = [_FORTRAN.sub("e", line) for line in lines]
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
        cells = [(number, cells[k]) for number, line in body if k < len(cells := _cells(line, separator))]
        marked = [(number, cell) for number, cell in cells if "." in cell or "," in cell]
        if all(_THOUSANDS.fullmatch(cell) for _, cell in marked):
            found = f"'{marked[0][1]}' beside whole numbers looks like thousands"
            raise _refused(path, "cell", found, _ONE_MARK, line=marked[0][0], channel=name)


def _row_by_row(path: Path, headers: Sequence[Header], body: Sequence[Line], separator: str | None) -> Array:
    """As ``_numbers``, for rows that are not all alike. Raises RecordingError for a cell that is no number."""
    values = np.full((len(body), len(headers)), np.nan)
    lost = 0
    for sample, (number, line) in enumerate(body):
        cells = _cells(line, separator)
        if len(cells) == len(headers) + 1 and cells[-1] == "":
            cells.pop()
        if separator == "," and len(cells) == 2 * len(headers):
            raise _refused(path, "cell", *_COMMAS, line=number)
        if len(cells) > len(headers):
            found = f"{len(cells)} cells where the header names {len(headers)} columns"
            raise _refused(path, "length", found, "complete or remove the line", sample, number)
        lost += len(cells) < len(headers) or "" in cells
        if lost > _LOST * len(body):
            if len(cells) < len(headers):
                found = f"{len(cells)} cells where the header names {len(headers)} columns"
                raise _refused(path, "length", found, "complete or remove the line", sample, number)
            name = headers[cells.index("")][0]
            raise _refused(path, "cell", "the cell is empty", "write a number, or cut the line", sample, number, name)
        for k, cell in enumerate(cells):
            if cell.lower() in _MISSING:
                continue
            try:
                values[sample, k] = float(cell)
            except ValueError:
                found = f"'{cell[:40]}' is not a number"
                action = "write a number, or cut the line"
                action = _ONE_MARK if _THOUSANDS.fullmatch(cell) else _COMMAS[1] if _is_number(cell) else action
                if not any(map(_is_number, cells)) or line.startswith("Channels\t"):  # as in LabVIEW's segments
                    found = f"a second table begins with '{line.strip()[:40]}'"
                    action = "put one test in each file, or cut the line"
                raise _refused(path, "cell", found, action, sample, number, headers[k][0]) from None
        if len(cells) < len(headers):
            values[sample] = np.nan  # the row broke off: its last number may have lost digits
    return values


def _decimal_points(path: Path, body: Sequence[Line]) -> list[str]:
    for number, line in body:
        if "." in line and "," in line:
            raise _refused(path, "cell", "decimal point and decimal comma are mixed", _ONE_MARK, line=number)
    return [line.replace(",", ".") for _, line in body]


def _line_numbers(body: Sequence[Line]) -> range | Array:
    first, last = body[0][0], body[-1][0]
    if last - first == len(body) - 1:
        return range(first, last + 1)
    return np.array([number for number, _ in body], dtype=np.float64)


def _refused(
    path: Path,
    rule: str,
    found: str,
    action: str,
    sample: int | None = None,
    line: int | None = None,
    channel: str = "",
) -> RecordingError:
    return RecordingError(str(Problem(path.name, rule, found, action, channel, sample, line)))
