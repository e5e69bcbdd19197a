"""``(a, b) = f(x)`` in a when-clause among equations: the clause is written as one of an algorithm section.

rumoca 0.10 refuses calls with several outputs there; in a section they are carried past it (``model_algorithms.py``).
"""

from __future__ import annotations

import re
from collections.abc import Iterator

from hystid.modelica.clauses import next_mark
from hystid.modelica.sources import Source
from hystid.modelica.workarounds.edits import Edit, edited

_SECTION = re.compile(r"(?<!end )\b(initial\s+)?(equation|algorithm|public|protected)\b")
_CLAUSE = re.compile(r"(?<![\w.])(?<!end )when\b(.*?)\bend\s+when\s*;", re.DOTALL)
_TARGETS = re.compile(r"\s*\([\w\s,.\[\]]*\)\s*=(?!=)")
_NESTED = re.compile(r"\b(?:if|for|when)\b")


def with_calls_in_algorithms(source: Source) -> Source:
    """The text with such clauses rewritten; lines stay where they are."""
    return edited(source, _edits(source.plain))


def _edits(plain: str) -> Iterator[Edit]:
    for clause in _CLAUSE.finditer(plain):
        before = [m for m in _SECTION.finditer(plain, 0, clause.start())]
        statements = list(_statements(plain, clause.start(1), clause.end(1)))
        if not before or before[-1].group(2) != "equation":
            continue
        if not any(_TARGETS.match(plain, a, b) for a, b in statements):
            continue
        if any(_NESTED.match(plain[a:b].lstrip()) for a, b in statements):
            continue  # an if-equation among them; the front end says what it cannot do
        yield clause.start(), clause.start(), "algorithm "
        for start, end in statements:
            sign = next_mark(plain, start, end, "=")
            if sign < end:
                yield sign, sign, ":"
        yield clause.end(), clause.end(), " equation"


def _statements(plain: str, start: int, end: int) -> Iterator[tuple[int, int]]:
    """Statements of a clause: what stands between then, elsewhen and the semicolons."""
    while start < end:
        found = re.compile(r"\bthen\b").search(plain, start, end)
        branch = re.compile(r"\belsewhen\b").search(plain, found.end(), end) if found else None
        stop = branch.start() if branch else end
        at = found.end() if found else end
        while at < stop:
            semicolon = plain.find(";", at, stop)
            until = semicolon if semicolon >= 0 else stop
            if plain[at:until].strip():
                yield at, until
            at = until + 1
        start = branch.end() if branch else end
