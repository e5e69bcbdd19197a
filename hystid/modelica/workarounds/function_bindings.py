"""``Real u = f(a)`` with an array a, written as ``Real u = 1*(f(a))``.

rumoca 0.10 counts such a declaration as many equations as a has elements ("unbalanced model").
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator, Sequence

from hystid.modelica.clauses import clauses, next_mark
from hystid.modelica.reach import Class, classes
from hystid.modelica.sources import Source
from hystid.modelica.workarounds.edits import Edit, edited

_VALUE = re.compile(r"\s*=(?!=)\s*")
_CALLED = re.compile(r"(?<![\w.])([A-Za-z_][\w.]*)\s*\(")


def with_counted_bindings(sources: Sequence[Source]) -> list[Source]:
    """The texts with such declarations rewritten; lines stay where they are."""
    outlines = [classes(source) or () for source in sources]
    functions = {c.name for found in outlines for c in found if c.kind == "function"}
    others = {c.name for found in outlines for c in found if c.kind not in ("function", "type") or _is_enumeration(c)}
    return [edited(source, _bindings(source, functions, others)) for source in sources]


def _is_enumeration(c: Class) -> bool:
    found = re.match(r"\s*(?:enumeration|Integer|Boolean|String)\b", c.source.plain[c.body :])
    return c.kind == "type" and found is not None


def _bindings(source: Source, functions: Collection[str], others: Collection[str]) -> Iterator[Edit]:
    for owner in classes(source) or ():
        if not owner.is_model:
            continue
        for clause in clauses(owner):
            real = clause.target.rsplit(".", 1)[-1].strip() not in {*others, "Integer", "Boolean", "String"}
            behind = clause.mods.closing + 1 if clause.mods else clause.behind
            value = _VALUE.match(source.plain, behind)
            if value is None or clause.kind != "component" or clause.sizes or not real:
                continue
            end = min(next_mark(source.plain, value.end(), owner.end, mark) for mark in ";,")
            text = re.split(r"\b(?:annotation|constrainedby)\b", source.plain[value.end() : end])[0].rstrip()
            if any(name.rsplit(".", 1)[-1] in functions for name in _CALLED.findall(text)):
                yield value.end(), value.end(), "1*("
                yield value.end() + len(text), value.end() + len(text), ")"
