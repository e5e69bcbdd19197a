"""``Integer(e)`` of an enumeration written ``numbers[e]``, with a list of its numbers declared beside it.

rumoca 0.10 refuses the call but for a parameter ("expected a numeric value, found Enumeration"). It takes an
enumeration as an index.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence

from hystid.modelica.clauses import clauses, closing
from hystid.modelica.reach import Class, classes
from hystid.modelica.sources import Source
from hystid.modelica.workarounds.edits import Edit, edited
from hystid.modelica.workarounds.model_algorithms import Types

_CALL = re.compile(r"(?<![\w.])Integer\s*\(")
_ALGORITHM = re.compile(r"(?<![\w.])algorithm\b")
_PART = r"[A-Za-z_]\w*(?:\s*\[[^\[\]]*\])?"
_VARIABLE = re.compile(rf"\s*(?:pre\s*\(\s*)?({_PART}(?:\s*\.\s*{_PART})*)[\s)]*\Z")


def with_numbers_of_enumerations(sources: Sequence[Source]) -> list[Source]:
    """The texts with such calls rewritten; lines stay where they are."""
    if not any(_CALL.search(s.plain) for s in sources):
        return list(sources)
    types = Types(c for source in sources for c in classes(source) or ())
    return [edited(s, (e for c in classes(s) or () if not c.short for e in _edits(c, types))) for s in sources]


def _edits(owner: Class, types: Types) -> Iterator[Edit]:
    plain, made = owner.source.plain, clauses(owner)
    if not made:
        return
    inner = [c for c in classes(owner.source) or () if c.parent is owner]
    declared: set[int] = set()
    for call in _CALL.finditer(plain, owner.body, owner.tail):
        end = closing(plain, call.end() - 1)
        named = _VARIABLE.match(plain, call.end(), end)
        if named is None or any(c.start <= call.start() < c.end for c in inner):
            continue
        count = types.items(re.sub(r"\[[^\[\]]*\]", "", named[1]), owner)
        if count:
            declared.add(count)
            yield call.start(), call.end(), f"{_list(count)}["
            yield end, end + 1, "]"
    section = _ALGORITHM.search(plain, made[-1].behind, owner.tail)
    # what is public in a function is an argument
    at, kind = (section.start(), "protected ") if section and owner.kind == "function" else (made[0].start, "")
    for count in declared:
        numbers = ", ".join(map(str, range(1, count + 1)))
        yield at, at, f"{kind}constant Integer {_list(count)}[{count}] = {{{numbers}}}; "


def _list(count: int) -> str:
    return f"hystid_numbers_{count}"
