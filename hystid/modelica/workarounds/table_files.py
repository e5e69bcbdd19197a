"""``tableOnFile = true, tableName = "tab", fileName = "table.txt"`` becomes ``table = [...]``, the numbers of the file.

rumoca 0.10 takes tables in memory alone. A file is looked for beside the model, then in the working folder; its name
is a text, or ``loadResource`` of one. Files are the three that the Modelica Standard Library reads: its own texts
(``double tab(3, 2)`` and numbers), MATLAB's, and CSV.
"""

from __future__ import annotations

import io
import re
import warnings
from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np

from hystid.errors import ModelicaError
from hystid.files import text_of
from hystid.modelica.clauses import Modifier, Modifiers, clauses
from hystid.modelica.reach import classes
from hystid.modelica.sources import Source
from hystid.modelica.workarounds.edits import Edit, edited
from hystid.numeric import Array

_NAMED = re.compile(r'(?:(?:\.?Modelica\.Utilities\.Files\.)?loadResource\s*\(\s*)?"((?:\\.|[^"\\])*)"\s*\)?')
_HEAD = re.compile(r"^\s*(?:double|float)\s+(\w+)\s*\(\s*(\d+)\s*,\s*(\d+)\s*\)", re.MULTILINE)
_NUMBERS = 20_000  # numbers, as many as a model may have elements


def with_tables_of_files(source: Source) -> Source:
    """The text with such tables written out; lines stay where they are. Raises ModelicaError where there are none."""
    if not re.search(r"\btableOnFile\s*=\s*true\b", source.plain):
        return source
    lists = [c.mods for owner in classes(source) or () for c in clauses(owner) if c.mods is not None]
    return edited(source, (edit for mods in lists for edit in _tables(mods, source)))


def _tables(mods: Modifiers, source: Source) -> Iterator[Edit]:
    said = {m.name: _value(m, source.text) for m in mods.elements}
    on_file = next((m for m in mods.elements if m.name == "tableOnFile" and said["tableOnFile"] == "true"), None)
    if on_file is not None:
        place = source.place(on_file.start)
        file = _NAMED.fullmatch(said.get("fileName", ""))
        name = re.fullmatch(r'"([^"]*)"', said.get("tableName", '"table"'))
        if file is None or name is None:
            raise ModelicaError(
                f'{place}: a table on a file is read when the model is built: write fileName = "..." and tableName = '
                '"..." as texts beside tableOnFile = true'
            )
        numbers = _read(_found(file[1], source.path.parent, place), name[1], said, place)
        rows = "; ".join(", ".join(map(repr, row)) for row in numbers.tolist())
        lines = "\n" * source.text.count("\n", on_file.start, on_file.end)
        yield on_file.start, on_file.end, f"table = [{rows}]{lines}"
        yield from ((*m.value, '"NoName"') for m in mods.elements if m.name == "fileName" and m.value)
    for m in mods.elements:
        if m.inner is not None:
            yield from _tables(m.inner, source)


def _value(m: Modifier, text: str) -> str:
    return text[slice(*m.value)].strip() if m.value else ""


def _found(name: str, folder: Path, place: str) -> Path:
    """The file of a name beside the model or in the working folder; of a modelica: address what stands behind the
    package."""
    behind = re.sub(r"^modelica://\w+/", "", re.sub(r"^file://", "", name))
    options = [up / behind for up in (folder, Path(), *(folder.parents if behind != name else ()))]
    found = next((path for path in options if path.is_file()), None)
    if found is None:
        raise ModelicaError(f"{place}: the file of a table, {name}, is neither beside the model nor in this folder")
    return found


def _read(path: Path, name: str, said: Mapping[str, str], place: str) -> Array:
    """The numbers of a table (rows, columns)."""
    kind = path.suffix.lower()
    try:
        made = _of_matlab(path, name) if kind == ".mat" else _of_text(path, name, said)
    except (OSError, ValueError) as error:
        raise ModelicaError(f"{place}: {path} cannot be read as a table: {error}") from None
    if made is None:
        raise ModelicaError(f"{place}: {path} holds no table named {name}")
    if made.size == 0 or made.size > _NUMBERS or not np.isfinite(made).all():
        raise ModelicaError(f"{place}: the table {name} of {path} must hold 1 to {_NUMBERS} numbers, and no others")
    return made


def _of_matlab(path: Path, name: str) -> Array | None:
    from scipy.io import loadmat  # it takes its time, and few need it

    try:
        found = loadmat(path, variable_names=[name]).get(name)
        return None if found is None else np.atleast_2d(np.asarray(found, float))
    except Exception as error:  # scipy raises ValueError, TypeError, struct.error ... on broken files
        raise ValueError(str(error)) from None


def _of_text(path: Path, name: str, said: Mapping[str, str]) -> Array | None:
    text = text_of(path, ModelicaError)
    if path.suffix.lower() == ".csv":
        head = int(said.get("nHeaderLines") or 0)
        mark = (said.get("delimiter") or '","').strip('"').replace("\\t", "\t")
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # an empty file: told by its size
            return np.loadtxt(io.StringIO(text), delimiter=mark, skiprows=head, ndmin=2)
    for head_line in _HEAD.finditer(text):
        if head_line[1] == name:
            rows, columns = int(head_line[2]), int(head_line[3])
            numbers = re.sub(r"#[^\n]*", "", text[head_line.end() :])
            words = re.split(r"[\s,;]+", numbers.strip())[: rows * columns]
            if len(words) < rows * columns:
                raise ValueError(f"{name} has {len(words)} numbers, not {rows} x {columns}")
            return np.array([float(word) for word in words]).reshape(rows, columns)
    return None
