"""``connect(a.y, s.u[1]); connect(a.y, q.v);`` of whole numbers or truth values, written with ``s.u[1] = a.y;``.

rumoca 0.10 refuses one such signal in an element of an array and somewhere else ("element assignments must cover a
discrete coordinate exactly once"). Only where each array of that name is an input: then such a connection says that
values are equal, and nothing else.
"""

from __future__ import annotations

import re
from collections import Counter, defaultdict
from collections.abc import Collection, Iterator, Sequence

from hystid.modelica.clauses import clauses
from hystid.modelica.reach import Class, classes
from hystid.modelica.sources import Source
from hystid.modelica.workarounds.edits import Edit, edited

_END = r"[A-Za-z_][\w.]*(?:\s*\[[^\]]*\])?"
_CONNECT = re.compile(rf"(?<![\w.])connect\s*\(\s*({_END})\s*,\s*({_END})\s*\)")
_ELEMENT = re.compile(r"[\w.]*\.(\w+)\s*\[")
_INPUT = re.compile(r"\s*input\s+(\w+)")


def with_separate_elements(sources: Sequence[Source]) -> list[Source]:
    """The texts with such connections as equations; lines stay where they are."""
    everything = [c for source in sources for c in classes(source) or ()]
    signals = {c.name: m.group(1) for c in everything if c.short and (m := _INPUT.match(c.source.plain, c.body))}
    kinds: dict[str, set[str]] = defaultdict(set)
    for owner in (c for c in everything if c.kind != "function"):
        for clause in (k for k in clauses(owner) if k.sizes and k.kind == "component"):
            type_name = clause.target.rsplit(".", 1)[-1].strip()
            kinds[clause.name].add(type_name if "input" in clause.prefixes else signals.get(type_name, ""))
    inputs = {name for name, found in kinds.items() if "" not in found and found & {"Integer", "Boolean"}}
    return [edited(s, (e for c in classes(s) or () if not c.short for e in _equations(c, inputs))) for s in sources]


def _equations(owner: Class, inputs: Collection[str]) -> Iterator[Edit]:
    connections = list(_CONNECT.finditer(owner.source.plain, owner.body, owner.tail))
    ends = Counter(end for connection in connections for end in connection.groups())
    for connection in connections:
        for element, other in (connection.groups(), connection.groups()[::-1]):
            array = _ELEMENT.match(element)
            if array and array.group(1) in inputs and ends[other] > 1:
                lines = "\n" * connection.group().count("\n")
                yield connection.start(), connection.end(), f"{element} = {other}{lines}"
                break
