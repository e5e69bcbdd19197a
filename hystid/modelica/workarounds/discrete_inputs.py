"""``edge(b)``, ``change(b)`` and ``pre(b)`` of an input b, by a variable of its own.

rumoca 0.10 takes them of no input of the model ("must name a discrete coordinate"). ``edge(b)`` becomes
``edge(hystid_of_b)`` with ``Boolean hystid_of_b = b`` declared in the same class.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence

from hystid.modelica.clauses import clauses
from hystid.modelica.reach import Class, classes
from hystid.modelica.sources import Source
from hystid.modelica.workarounds.edits import Edit, edited

_USE = re.compile(r"(?<![\w.])(?:pre|edge|change)\s*\(\s*([A-Za-z_]\w*)\s*\)")
_TYPE = re.compile(r"(?:.*\.)?\s*(?:(Boolean|Integer)|(Boolean|Integer)Input)")


def with_named_inputs(name: str, sources: Sequence[Source]) -> list[Source]:
    """The texts with such uses rewritten in class ``name`` and its bases; lines stay where they are."""
    family = _family(name.rsplit(".", 1)[-1], sources)
    inputs = {
        clause.name: found[1] or found[2]
        for owner in family
        for clause in clauses(owner)
        if clause.kind == "component" and not clause.sizes and (found := _TYPE.fullmatch(clause.target.strip()))
        if found[2] or "input" in clause.prefixes
    }
    if not inputs:
        return list(sources)
    names = {owner.name for owner in family}
    return [edited(s, (e for c in _models(s) if c.name in names for e in _edits(c, inputs))) for s in sources]


def _models(source: Source) -> list[Class]:
    return [c for c in classes(source) or () if c.is_model]


def _family(name: str, sources: Sequence[Source]) -> list[Class]:
    """The classes of a short name, and those that they extend."""
    every = [c for source in sources for c in _models(source)]
    found: dict[str, list[Class]] = {}
    waiting = [name]
    while waiting:
        short = waiting.pop()
        if short not in found:
            found[short] = [c for c in every if c.name == short]
            bases = [clause for c in found[short] for clause in clauses(c) if clause.kind in ("extends", "short")]
            waiting += [clause.target.rsplit(".", 1)[-1].strip() for clause in bases]
    return [c for group in found.values() for c in group]


def _edits(owner: Class, inputs: Mapping[str, str]) -> Iterator[Edit]:
    made = clauses(owner)
    if owner.short or not made:
        return
    inner = [c for c in classes(owner.source) or () if c.parent is owner]
    named: dict[str, str] = {}
    for use in _USE.finditer(owner.source.plain, owner.body, owner.tail):
        if use[1] in inputs and not any(c.start <= use.start() < c.end for c in inner):
            named[use[1]] = inputs[use[1]]
            yield use.start(1), use.end(1), f"hystid_of_{use[1]}"
    if named:
        declared = "".join(f"{kind} hystid_of_{name} = {name}; " for name, kind in named.items())
        yield made[0].start, made[0].start, declared
