"""Functions of one name that several models declare inside themselves, each renamed after its model.

rumoca 0.10 takes the first of them for all: ``position`` with two inputs in one model, with three in another, ends in
"axis 1 requires extent 2 but the call site proves 3", or in the wrong function.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Collection, Iterator, Sequence

from hystid.modelica.reach import Class, classes
from hystid.modelica.sources import Source
from hystid.modelica.workarounds.edits import Edit, edited

_FIXED = frozenset(("constructor", "destructor"))  # of external objects, by their names


def with_functions_apart(sources: Sequence[Source]) -> list[Source]:
    """The texts with such functions renamed; lines stay where they are."""
    outlines = [classes(source) or () for source in sources]
    functions = [
        c for found in outlines for c in found if c.kind == "function" and not c.short and c.name not in _FIXED
    ]
    counts = Counter(c.name for c in functions)
    alike = [c for c in functions if counts[c.name] > 1 and c.parent is not None and _is_local(c, c.parent)]
    if not alike:
        return list(sources)
    elsewhere = {name for source in sources for name in _called_outside(source, alike)}
    renamed = [c for c in alike if c.name not in elsewhere]
    return [edited(source, (e for c in renamed if c.source == source for e in _renamings(c))) for source in sources]


def _is_local(function: Class, owner: Class) -> bool:
    """Whether a model declares it for itself; packages and operators (``Complex.'*'.multiply``) do not."""
    named = function.source.text[function.body - len(function.name) : function.body] == function.name
    return owner.kind not in ("package", "operator") and named


def _called_outside(source: Source, functions: Collection[Class]) -> Iterator[str]:
    """Names called where the model around does not declare them, as one that inherits them does."""
    for name in {c.name for c in functions}:
        owners = [c.parent for c in functions if c.name == name and c.source == source and c.parent is not None]
        for call in re.finditer(rf"(?<!\w){name}\s*\(", source.plain):
            if not any(o.start <= call.start() < o.end for o in owners):
                yield name


def _renamings(function: Class) -> Iterator[Edit]:
    owner, plain = function.parent, function.source.plain
    assert owner is not None
    new = f"{function.name}_of_{owner.name}"
    said = rf"(?<![\w.]){function.name}(?=\s*\()|(?<![\w.])(?:function\s+|end\s+|=\s*){function.name}(?!\w)"
    for found in re.finditer(said, plain[owner.start : owner.end]):
        yield owner.start + found.end() - len(function.name), owner.start + found.end(), new
