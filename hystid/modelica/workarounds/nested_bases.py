"""A base class that stands inside the class that extends it, and that extends another one itself.

rumoca 0.10 takes what the nested class inherits for variables of the class around it and refuses them ("reference to
non-constant variable 's' from a lexically nested class"). The nested class is unwrapped: what it declares stands in
the class around it, in the same lines, and the extends clause goes. Only where nothing else names the nested class.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence

from hystid.modelica.clauses import Clause, clauses, closing
from hystid.modelica.reach import Class, classes
from hystid.modelica.sources import Source
from hystid.modelica.workarounds.edits import Edit, edited

_CLASS_ANNOTATION = re.compile(r"(?<![\w.])annotation\s*\(")


def with_unwrapped_bases(source: Source) -> Source:
    """The text with such classes unwrapped; lines stay where they are."""
    found = classes(source) or ()
    edits = [edit for owner in found if owner.is_model for edit in _edits(owner, found)]
    return edited(source, ((start, end, new or _gap(source.text[start:end])) for start, end, new in edits))


def _edits(owner: Class, found: Sequence[Class]) -> Iterator[Edit]:
    plain = owner.source.plain
    inside = [c for c in found if c.parent is owner and c.kind == owner.kind and not c.short]
    if not inside:
        return
    for clause in clauses(owner):
        nested = next((c for c in inside if c.name == clause.target.strip()), None)
        if clause.kind != "extends" or clause.mods or nested is None or not _alone(nested, found):
            continue
        yield _statement(clause, plain)
        yield nested.front, _behind_description(nested), ""
        yield nested.tail, nested.end, "public" + _gap(owner.source.text[nested.tail : nested.end])
        notes = list(_CLASS_ANNOTATION.finditer(plain, nested.body, nested.tail))
        last = notes[-1] if notes else None
        if last and not plain[closing(plain, last.end() - 1) + 1 : nested.tail].strip(" \n\t\r;"):
            yield last.start(), plain.index(";", closing(plain, last.end() - 1)) + 1, ""


def _alone(nested: Class, found: Sequence[Class]) -> bool:
    """Whether it extends something, and is named where it is declared and extended alone."""
    extends = any(c.kind == "extends" for c in clauses(nested))
    words = re.findall(rf"(?<!\w){nested.name}(?!\w)", nested.source.plain)
    return extends and len(words) == 3 and not any(c.parent is nested for c in found)


def _statement(clause: Clause, plain: str) -> Edit:
    return clause.start, plain.index(";", clause.behind) + 1, ""


def _behind_description(nested: Class) -> int:
    """Offset behind the text in quotes that may follow the name."""
    plain = nested.source.plain
    text = nested.source.text
    at = nested.body
    described = re.compile(r'\s*(?:"(?:\\.|[^"\\])*"\s*\+?\s*)*').match(text, at)
    return described.end() if described and plain[at : described.end()].strip() == "" else at


def _gap(text: str) -> str:
    return " " + "\n" * text.count("\n")
