"""Modifiers that the front end reads and then drops without a word; a wrong number is worse than a refusal.

Seen in rumoca 0.10: a value together with attributes in an extends clause, modifiers in a constraining clause, and
modifiers of a class redeclaration. Each has another spelling that works, which the message gives.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence

from hystid.errors import ModelicaError
from hystid.modelica.sources import Source

_NAME = r"[A-Za-z_][\w.]*"
_EXTENDS = re.compile(rf"\bextends\s+{_NAME}\s*\(")
_CONSTRAINED = re.compile(rf"\bconstrainedby\s+({_NAME})\s*\(")
_REDECLARED = re.compile(
    rf"\bredeclare\s+(?:(?:final|replaceable|each)\s+)*(?:model|block|class|package|function|connector)\s+(\w+)\s*=\s*({_NAME})\s*\("
)
_VALUE_AFTER = re.compile(r"\s*=(?!=)")


def refuse_dropped_modifiers(sources: Sequence[Source]) -> None:
    """Raise ModelicaError for the first modifier in these files that would be dropped."""
    for source in sources:
        text = source.plain
        for offset, message in sorted(_problems(text)):
            line = text.count("\n", 0, offset) + 1
            raise ModelicaError(f"{source.path}:{line}: {message}")


def _problems(text: str) -> Iterator[tuple[int, str]]:
    for found in _EXTENDS.finditer(text):
        yield from _values_with_attributes(text, found.end() - 1)
    for found in _CONSTRAINED.finditer(text):
        yield (
            found.start(),
            f"modifiers of 'constrainedby {found.group(1)}' are not supported: give them where the component is "
            "declared or redeclared",
        )
    for found in _REDECLARED.finditer(text):
        yield (
            found.start(),
            f"modifiers in 'redeclare ... {found.group(1)} = {found.group(2)}(...)' are not supported: declare "
            f"'model Mine = {found.group(2)}(...)' and redeclare with Mine",
        )


def _values_with_attributes(text: str, opening: int) -> Iterator[tuple[int, str]]:
    """Elements ``name(...) = value`` between the parenthesis at ``opening`` and its partner."""
    end = closing(text, opening)
    for inner in re.finditer(r"(\w+)\s*\(", text[opening + 1 : end]):
        start = opening + 1 + inner.start()
        after = closing(text, opening + inner.end()) + 1
        if after <= end and _VALUE_AFTER.match(text, after) and _is_modifier(text, start):
            yield (
                start,
                f"value and attributes of '{inner.group(1)}' together in an extends clause are not supported: "
                f"write the value alone here, {inner.group(1)} = ..., and the attributes at its declaration",
            )


def _is_modifier(text: str, start: int) -> bool:
    """A name after "(", ",", "each" or "final" begins a modifier; other names are calls inside values."""
    before = text[:start].rstrip()
    return before.endswith(("(", ",")) or re.search(r"\b(?:each|final)$", before) is not None


def closing(text: str, opening: int) -> int:
    """Position of the parenthesis that closes the one at ``opening`` (the text's end without one)."""
    depth = 0
    for k in range(opening, len(text)):
        depth += (text[k] == "(") - (text[k] == ")")
        if depth == 0:
            return k
    return len(text)
