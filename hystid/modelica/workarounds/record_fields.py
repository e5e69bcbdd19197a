"""``p[i].k`` of an array of records that are parameters, written ``k[i]`` of ``parameter Real k[2] = p.k``.

rumoca 0.10 breaks down, "no entry found for key", at such an element in a loop where the records are given values.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from itertools import count

from hystid.modelica.clauses import clauses, next_mark
from hystid.modelica.reach import Class, classes
from hystid.modelica.sources import Source
from hystid.modelica.workarounds.edits import Edit, edited
from hystid.modelica.workarounds.model_algorithms import Types

_ELEMENT = r"(?<![\w.])%s\s*(?=(\[[^\[\]]*[A-Za-z_][^\[\]]*\])\s*\.\s*([A-Za-z_]\w*)(?!\w|\s*[.\[(]))"


def with_named_fields(sources: Sequence[Source]) -> list[Source]:
    """The texts with such fields declared beside the records; lines stay where they are."""
    everything = [c for source in sources for c in classes(source) or ()]
    types, numbers = Types(everything), count(1)
    models = [c for c in everything if c.is_model and not c.short]
    return [edited(s, (e for c in models if c.source == s for e in _edits(c, types, numbers))) for s in sources]


def _edits(owner: Class, types: Types, numbers: Iterator[int]) -> Iterator[Edit]:
    for clause in clauses(owner):
        given = clause.kind == "component" and {"parameter", "constant"} & {*clause.prefixes}
        if not given or len(clause.sizes) != 1 or ":" in clause.sizes[0] or not types.is_record(clause):
            continue
        named: dict[str, str] = {}
        for used in re.compile(_ELEMENT % clause.name).finditer(owner.source.plain, owner.body, owner.tail):
            field = types.member(used[2], clause)
            if field is None or field.sizes or types.built_in(field) not in ("Real", "Integer", "Boolean"):
                continue
            if used[2] not in named:
                new = named[used[2]] = f"hystid_field_{next(numbers)}"
                behind = next_mark(owner.source.plain, clause.start, owner.tail, ";") + 1
                declared = f" parameter {types.built_in(field)} {new}[{clause.sizes[0]}] = {clause.name}.{used[2]};"
                yield behind, behind, declared
            yield used.start(), used.end(2), f"{named[used[2]]}{used[1]}"
