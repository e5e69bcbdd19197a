"""The functions of ``Modelica.Math`` that call LAPACK are written as functions in C.

rumoca 0.10 refuses the loops, and the sizes of locals, of most of them. What they give is known here, see
``matrix_functions.py``.
"""

from __future__ import annotations

import re
from collections.abc import Iterator

from hystid.modelica.clauses import clauses
from hystid.modelica.matrix_functions import is_matrix_function
from hystid.modelica.reach import Class, classes
from hystid.modelica.sources import Source
from hystid.modelica.workarounds.edits import Edit, edited

_BODY = re.compile(r"\b(?:protected|algorithm|external)\b")
_PUBLIC = re.compile(r"\bpublic\b")


def with_known_matrices(source: Source) -> Source:
    """The text with their bodies left out; lines stay where they are."""
    if not re.search(r"\bModelica\b", source.plain):
        return source
    within = re.match(r"\s*within\s+(Modelica)(?:\.Math)?\s*;", source.plain)
    functions = [c for c in classes(source) or () if c.kind == "function" and _is_known(c, within is not None)]
    return edited(source, (edit for owner in functions for edit in _outline(owner)))


def _is_known(owner: Class, standard: bool) -> bool:
    around = [c.name for c in owner.around()]
    return is_matrix_function(".".join(reversed(around))) and (standard or "Modelica" in around)


def _outline(owner: Class) -> Iterator[Edit]:
    """Locals and statements go; what is public stays. A function in C is impure unless it says otherwise."""
    plain, start = owner.source.plain, owner.body
    if not re.search(r"\bpure\s*$", plain[owner.front : owner.start]):
        yield owner.start, owner.start, "pure "
    given = {n.name: n.prefixes for n in clauses(owner) if n.kind == "component"}
    names = [name for name, prefixes in given.items() if {"input", "output"} & set(prefixes)]
    while (body := _BODY.search(plain, start, owner.tail)) is not None:
        public = _PUBLIC.search(plain, body.end(), owner.tail) if body.group() == "protected" else None
        end = public.start() if public else owner.tail
        call = "" if public else f'external "C" {owner.name}({", ".join(names)});'
        yield body.start(), end, call + "\n" * plain.count("\n", body.start(), end)
        if public is None:
            return
        start = end
