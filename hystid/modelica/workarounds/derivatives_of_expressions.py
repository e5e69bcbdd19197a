"""``der(expression)`` in an equation or a declaration of a model, by a variable of its own.

rumoca 0.10 takes one variable as the operand ("der(...) must have exactly one resolved variable-reference operand").
``der(a*x)`` becomes ``der(hystid_der_1)`` with ``Real hystid_der_1 = a*x`` declared in the same class. Not where the
operand holds the index of a loop or stands in an algorithm or in a function: these are left to its refusal. What a
parameter depends on does not move: in its declaration ``der(a*b)`` is ``0*(a*b)``.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from itertools import count

from hystid.modelica.clauses import closing
from hystid.modelica.reach import Class, classes
from hystid.modelica.sources import Source
from hystid.modelica.workarounds.edits import Edit, edited

NAME = "hystid_der_"
_DERIVATIVE = re.compile(r"(?<![\w.])der\s*\(")
_VARIABLE = re.compile(r"\s*[A-Za-z_][\w.]*(?:\s*\[[^\[\]]*\](?:\s*\.\s*\w+)*)*\s*\Z")
_SECTION = re.compile(r"\b(?:initial\s+)?(?:equation|algorithm)\b")
_ANNOTATION = re.compile(r";\s*(annotation\s*\()")
_STILL = re.compile(r"\b(?:parameter|constant)\b[^;]*\Z")
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
        if owner is None or not owner.is_model or owner.short:
            continue
        sections = [
            m for m in _SECTION.finditer(plain, owner.body, owner.tail) if _innermost(found, m.start()) is owner
        ]
        before = [m.group() for m in sections if m.start() < der.start()]
        if not before and _STILL.search(plain, owner.body, der.start()):
            if not re.search(r"\btime\b", operand):
                yield der.start(), der.end(), "(0*("
                yield end, end, ")"
            continue
        if _VARIABLE.match(operand):
            continue
        indices = set(_INDEX.findall(plain, owner.body, owner.tail))
        if (before and "algorithm" in before[-1]) or indices & set(re.findall(r"\w+", operand)):
            continue
        name = f"{NAME}{next(numbers)}"
        at = sections[0].start() if sections else _end(owner)
        yield at, at, f"protected Real {name} = {' '.join(source.text[der.end() : end].split())}; "
        yield der.end(), end, name + "\n" * plain.count("\n", der.end(), end)


def _innermost(found: Sequence[Class], offset: int) -> Class | None:
    """The innermost of a text's classes that holds an offset."""
    holding = [c for c in found if c.start <= offset < c.end]
    return holding[-1] if holding else None


def _end(owner: Class) -> int:
    """Where the declarations of a class without a section end: its own annotation comes last."""
    plain = owner.source.plain
    for said in _ANNOTATION.finditer(plain, owner.body, owner.tail):
        if plain[closing(plain, said.end() - 1) + 1 : owner.tail].strip() == ";":
            return said.start(1)
    return owner.tail
