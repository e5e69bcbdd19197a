"""``der(expression)`` in an equation of a model, by a variable of its own.

rumoca 0.10 takes one variable as the operand ("der(...) must have exactly one resolved variable-reference operand").
``der(a*x)`` becomes ``der(hystid_der_1)`` with ``Real hystid_der_1 = a*x`` declared in the same class. Not where the
operand holds the index of a loop or stands in an algorithm or in a function: these are left to its refusal.
"""

from __future__ import annotations

import re
from collections import deque
from collections.abc import Iterator, Sequence
from itertools import count

from hystid.modelica.clauses import closing
from hystid.modelica.reach import Class, classes
from hystid.modelica.sources import Source
from hystid.modelica.workarounds.edits import Edit, edited

_DERIVATIVE = re.compile(r"(?<![\w.])der\s*\(")
_VARIABLE = re.compile(r"\s*[A-Za-z_][\w.]*(?:\s*\[[^\[\]]*\](?:\s*\.\s*\w+)*)*\s*\Z")
_SECTION = re.compile(r"\b(?:initial\s+)?(?:equation|algorithm)\b")
_INDEX = re.compile(r"\bfor\s+(\w+)\s+in\b")


def with_named_derivatives(source: Source) -> Source:
    """The text with such operands named; lines stay where they are."""
    found = classes(source) or ()
    return edited(source, _edits(source, found))


def _edits(source: Source, found: Sequence[Class]) -> Iterator[Edit]:
    plain, numbers = source.plain, count(1)
    for der in _DERIVATIVE.finditer(plain):
        end = closing(plain, der.end() - 1)
        operand = plain[der.end() : end]
        owner = _innermost(found, der.start())
        if owner is None or owner.kind not in ("model", "block", "class") or owner.short or _VARIABLE.match(operand):
            continue
        section = deque(_SECTION.finditer(plain, owner.body, der.start()), maxlen=1)
        first = _SECTION.search(plain, owner.body, owner.tail)
        indices = set(_INDEX.findall(plain, owner.body, owner.tail))
        if not section or "algorithm" in section[0].group() or indices & set(re.findall(r"\w+", operand)) or not first:
            continue
        name = f"hystid_der_{next(numbers)}"
        at = _declarations_end(owner, found, first)
        yield at, at, f"protected Real {name} = {' '.join(source.text[der.end() : end].split())}; "
        yield der.end(), end, name + "\n" * plain.count("\n", der.end(), end)


def _innermost(found: Sequence[Class], offset: int) -> Class | None:
    """The innermost of a text's classes that holds an offset."""
    holding = [c for c in found if c.start <= offset < c.end]
    return holding[-1] if holding else None


def _declarations_end(owner: Class, found: Sequence[Class], first: re.Match[str]) -> int:
    """Where the first section of the class itself begins, classes in it left aside."""
    at = first
    while (inner := _innermost(found, at.start())) is not None and inner is not owner:
        following = _SECTION.search(owner.source.plain, inner.end, owner.tail)
        if following is None:
            return owner.tail
        at = following
    return at.start()
