"""``homotopy(simplified = s, actual = a)`` is written by place, ``homotopy(a, s)``.

rumoca 0.10 forgets the names of the arguments, so that the two could be mistaken for each other.
"""

from __future__ import annotations

import re
from collections.abc import Iterator

from hystid.modelica.clauses import closing, parted
from hystid.modelica.sources import Source
from hystid.modelica.workarounds.edits import Edit, edited

_HOMOTOPY = re.compile(r"(?<![\w.])homotopy\s*\(")


def with_arguments_in_place(source: Source) -> Source:
    """The text with such calls rewritten; what stands behind them stays on its line."""
    return edited(source, _in_place(source.plain))


def _in_place(plain: str) -> Iterator[Edit]:
    """Calls with names, outermost first; one inside another is rewritten along with it."""
    done = 0
    for found in _HOMOTOPY.finditer(plain):
        end = closing(plain, found.end() - 1)
        parts = (plain[start:stop].partition("=") for start, stop in parted(plain, found.end(), end))
        named = {name.strip(): value for name, _, value in parts}
        if found.start() < done or set(named) != {"actual", "simplified"}:
            continue
        done = end
        actual, simplified = (_rewritten(named[name]) for name in ("actual", "simplified"))
        lost = plain.count("\n", found.end(), end) - f"{actual}{simplified}".count("\n")
        yield found.end(), end, f"{actual}, {simplified}" + "\n" * lost


def _rewritten(text: str) -> str:
    for start, end, new in sorted(_in_place(text), reverse=True):
        text = text[:start] + new + text[end:]
    return text
