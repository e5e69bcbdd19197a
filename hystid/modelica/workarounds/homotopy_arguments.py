"""``homotopy(simplified = s, actual = a)``, which means a in the solution, is written as ``(a)``.

rumoca 0.10 forgets the names of the arguments, so that the two could be mistaken for each other.
"""

from __future__ import annotations

import re
from collections.abc import Iterator

from hystid.modelica.clauses import closing, next_mark
from hystid.modelica.sources import Source
from hystid.modelica.workarounds.edits import Edit, edited

_HOMOTOPY = re.compile(r"(?<![\w.])homotopy\s*\(")


def with_actual_arguments(source: Source) -> Source:
    """The text with such calls rewritten; lines stay where they are."""
    return edited(source, _actual(source.plain))


def _actual(plain: str) -> Iterator[Edit]:
    """``homotopy(simplified = s, actual = a)`` means a in the solution; the front end forgets which name is which."""
    for found in _HOMOTOPY.finditer(plain):
        end = closing(plain, found.end() - 1)
        parts, start = [], found.end()
        while start < end:
            stop = next_mark(plain, start, end, ",")
            parts.append((start, stop))
            start = stop + 1
        named = [(a + len(m.group()), b) for a, b in parts if (m := re.match(r"\s*actual\s*=(?!=)", plain[a:b]))]
        first, last = (named or parts or [(found.end(), end)])[0]
        yield found.start(), first, "(" + "\n" * plain.count("\n", found.start(), first)
        yield last, end, " " + "\n" * plain.count("\n", last, end)
