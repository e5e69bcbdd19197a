"""The object of a table in two dimensions is read as if it were one in one dimension, with a column.

rumoca 0.10 takes external objects of tables where it knows their functions in C by name, which is so in one dimension
alone: ``ModelicaStandardTables_CombiTable1D_init3``. It looks for ``columns`` among the arguments of the constructor.
"""

from __future__ import annotations

import re
from collections.abc import Iterator

from hystid.modelica.clauses import closing, next_mark
from hystid.modelica.sources import Source
from hystid.modelica.workarounds.edits import Edit, edited

_IN_C = re.compile(r"(?<=\bModelicaStandardTables_CombiTable)2(?=D_(?!\w*Abscissa))")  # abscissas: it expects numbers
_OBJECT = re.compile(r"\bclass\s+ExternalCombiTable2D\b")
_NUMBERS = re.compile(r"\binput\s+Real\s+table\s*\[[^\]]*\][^;]*;")
_MADE = re.compile(r"\bExternalCombiTable2D\s*\(")
_BEFORE = 3  # arguments: names of the table and of its file, and its numbers


def with_known_surfaces(source: Source) -> Source:
    """The text with such functions renamed and a column given; lines stay where they are."""
    return edited(source, _as_lines(source.plain)) if "CombiTable2D" in source.plain else source


def _as_lines(plain: str) -> Iterator[Edit]:
    yield from ((found.start(), found.end(), "1") for found in _IN_C.finditer(plain))
    for found in _OBJECT.finditer(plain):
        numbers = _NUMBERS.search(plain, found.end())
        if numbers is not None:
            yield numbers.end(), numbers.end(), " input Integer columns[:];"
    for found in _MADE.finditer(plain):
        at, end = found.end(), closing(plain, found.end() - 1)
        for _ in range(_BEFORE):
            at = next_mark(plain, at, end, ",") + 1
        yield at - 1, at - 1, ", {1}"
