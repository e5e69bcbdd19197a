"""CSV and its relatives: comma, semicolon, tab or blanks; decimal point or comma; comments; BOM.

The header line is ``name [unit]`` per column. A second line with nothing but units is taken as such.
Lines that start with ``#`` or ``%`` are comments.
"""

from __future__ import annotations

import codecs
from pathlib import Path

import numpy as np

from hystid.errors import RecordingError
from hystid.recording.problems import Problem
from hystid.recording.table import Column, Table, split_header
from hystid.recording.types import Array

_EXAMPLE = "name the columns like 't [s],F [N],x [m]'"


def read_text(path: Path) -> list[Table]:
    """The one table of a text file. Raises RecordingError naming the line and column of the first bad cell."""
    numbered = _content(path)
    if not numbered:
        raise _refused(path, "format", "the file is empty", _EXAMPLE + " and put one sample in each line")
    separator = _separator(numbered[0][1])
    headers, body = _split_headers(path, numbered, separator)
    values = _numbers(path, headers, body, separator)
    columns = tuple(Column(name, unit, np.ascontiguousarray(values[:, k])) for k, (name, unit) in enumerate(headers))
    return [Table(path.name, columns, path.stem, _line_numbers(body))]


def _content(path: Path) -> list[tuple[int, str]]:
    """(line number, text) of every line that is neither blank nor a comment."""
    text = _decode(path)
    return [
        (number, line)
        for number, line in enumerate(text.splitlines(), start=1)
        if line.strip() and not line.lstrip().startswith(("#", "%"))
    ]


def _decode(path: Path) -> str:
    raw = path.read_bytes()
    for mark, name in (
        (codecs.BOM_UTF8, "utf-8-sig"),
        (codecs.BOM_UTF16_LE, "utf-16"),
        (codecs.BOM_UTF16_BE, "utf-16"),
    ):
        if raw.startswith(mark):
            return raw.decode(name, errors="replace")
    if b"\0" in raw[:4096]:
        raise _refused(
            path, "format", "this is a binary file, not text", "give CSV, .mat, .h5, .uff or .tdms by its suffix"
        )
    try:
        return raw.decode("utf-8")
    except UnicodeDecodeError:
        return raw.decode("latin-1")  # every byte is a character there: headers such as "µm" or "m/s²" survive


def _separator(header: str) -> str | None:
    return next((mark for mark in ("\t", ";", ",") if mark in header), None)


def _cells(line: str, separator: str | None) -> list[str]:
    return [cell.strip().strip('"') for cell in line.strip().split(separator)]


def _split_headers(
    path: Path, numbered: list[tuple[int, str]], separator: str | None
) -> tuple[list[tuple[str, str | None]], list[tuple[int, str]]]:
    number, line = numbered[0]
    if separator is None and "[" in line:
        raise _refused(path, "columns", "only one column is there", _EXAMPLE, line=number)
    cells = _cells(line, separator)
    if all(_is_number(cell) for cell in cells):
        raise _refused(path, "columns", "the first line holds numbers instead of names", _EXAMPLE, line=number)
    headers = [split_header(cell) for cell in cells]
    while len(headers) > 1 and headers[-1] == ("", None):  # a separator at the end of the line
        headers.pop()
    body = numbered[1:]
    if body and all(unit is None for _, unit in headers):
        units = _cells(body[0][1], separator)
        if len(units) >= len(headers) and not any(_is_number(cell) for cell in units):
            headers = [(name, unit.strip("[]()")) for (name, _), unit in zip(headers, units, strict=False)]
            body = body[1:]
    return headers, body


def _is_number(cell: str) -> bool:
    try:
        float(cell.replace(",", "."))
    except ValueError:
        return False
    return True


def _numbers(
    path: Path, headers: list[tuple[str, str | None]], body: list[tuple[int, str]], separator: str | None
) -> Array:
    """Shape (n, columns)."""
    if not body:
        raise _refused(path, "too_short", "there is a header but no sample", "record at least 16 samples")
    lines = [line for _, line in body]
    if separator != "," and any("," in line for line in lines[:50]):
        lines = _decimal_points(path, body)
    lines = [line.rstrip().rstrip(separator) if separator and separator != "\t" else line for line in lines]
    try:
        values = np.loadtxt(lines, delimiter=separator, ndmin=2, comments=None, quotechar='"')
    except ValueError:
        values = None
    if values is None or values.shape[1] != len(headers):
        raise _first_bad_cell(path, headers, [(n, line) for (n, _), line in zip(body, lines, strict=True)], separator)
    return np.asarray(values, dtype=np.float64)


def _decimal_points(path: Path, body: list[tuple[int, str]]) -> list[str]:
    for number, line in body:
        if "." in line and "," in line:
            action = "write numbers with one decimal mark and no marks between thousands"
            raise _refused(path, "cell", "decimal point and decimal comma are mixed", action, line=number)
    return [line.replace(",", ".") for _, line in body]


def _first_bad_cell(
    path: Path, headers: list[tuple[str, str | None]], body: list[tuple[int, str]], separator: str | None
) -> RecordingError:
    for sample, (number, line) in enumerate(body):
        cells = _cells(line, separator)
        if separator == "," and len(cells) == 2 * len(headers):
            action = "separate the columns with semicolons, or write decimal points"
            return _refused(path, "cell", "commas separate both columns and decimals", action, line=number)
        if len(cells) != len(headers):
            found = f"{len(cells)} cells where the header names {len(headers)} columns"
            return _refused(path, "length", found, "complete or remove the line", sample, number)
        for (name, _), cell in zip(headers, cells, strict=True):
            try:
                float(cell)
            except ValueError:
                found = f"'{cell[:40]}' is not a number" if cell else "the cell is empty"
                return _refused(path, "cell", found, "write a number, or cut the line", sample, number, name)
    return _refused(path, "format", "the numbers cannot be read", _EXAMPLE)


def _line_numbers(body: list[tuple[int, str]]) -> range | Array:
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
