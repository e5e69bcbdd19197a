"""Equations and bindings that rumoca 0.10 refuses without a reason in the language, written so that it reads them.

``der(c[k].x)`` in a for-equation is taken inside an if-equation only: ``if true then der(c[k].x) = ...; else ...``.
What one clause with ``sample`` assigns may be read in another that ticks at other times after ``sample(...) or false``.
``Real u = f(a)`` with an array a counts as many equations as a has elements, ``Real u = 1*(f(a))`` counts one.
"""

from __future__ import annotations

import re
from collections import deque
from collections.abc import Collection, Iterator, Sequence

from hystid.modelica.clauses import clauses, closing, next_mark
from hystid.modelica.reach import Class, classes
from hystid.modelica.sources import Source

_DERIVATIVE = re.compile(r"\bder\s*\(\s*[A-Za-z_][\w.]*\s*\[([^\[\]]*[A-Za-z_][^\[\]]*)\]\s*\.")
_SECTION = re.compile(r"\b(?:equation|algorithm|public|protected|(?:model|block|class|function)\s+\w+)\b")
_HEAD = re.compile(r"\s*(?:(?P<until>for|if|elseif|when|elsewhen)\b|(?:initial\s+)?equation\b|else\b)")
_END = {"for": "loop", "if": "then", "elseif": "then", "when": "then", "elsewhen": "then"}
_SAMPLE = re.compile(r"(?<![\w.])sample\s*\(")
_HOMOTOPY = re.compile(r"(?<![\w.])homotopy\s*\(")
_VALUE = re.compile(r"\s*=(?!=)\s*")
_CALLED = re.compile(r"(?<![\w.])([A-Za-z_][\w.]*)\s*\(")

_Edit = tuple[int, int, str]


def with_readable_equations(sources: Sequence[Source]) -> list[Source]:
    """The texts with such equations rewritten; lines stay where they are."""
    outlines = [classes(source) or () for source in sources]
    functions = {c.name for found in outlines for c in found if c.kind == "function"}
    others = {c.name for found in outlines for c in found if c.kind not in ("function", "type") or _is_enumeration(c)}
    made = []
    for source in sources:
        text = source.text
        plain = source.plain
        edits = [*_actual(plain), *_derivatives(plain), *_samples(plain), *_bindings(source, functions, others)]
        for start, end, new in sorted(edits, reverse=True):
            text = text[:start] + new + text[end:]
        made.append(source if text == source.text else Source(source.path, text))
    return made


def _is_enumeration(c: Class) -> bool:
    found = re.match(r"\s*(?:enumeration|Integer|Boolean|String)\b", c.source.plain[c.body :])
    return c.kind == "type" and found is not None


def _derivatives(plain: str) -> Iterator[_Edit]:
    """Each equation as it is becomes the second branch, a copy on one line the first."""
    for start, end in dict.fromkeys(_equations(plain)):
        yield start, start, f"if true then {' '.join(plain[start:end].split())}; else "
        yield end, end, "; end if"


def _equations(plain: str) -> Iterator[tuple[int, int]]:
    """Offsets of the equations, up to their semicolons."""
    for found in _DERIVATIVE.finditer(plain):
        section = deque(_SECTION.finditer(plain, 0, found.start()), maxlen=1)
        if not section or section[0].group() != "equation":
            continue
        start = plain.rfind(";", 0, found.start()) + 1
        end = plain.find(";", found.end())
        while head := _HEAD.match(plain, start, found.start()):
            start = head.end()
            if head["until"]:
                stop = re.compile(rf"\b{_END[head['until']]}\b").search(plain, start, found.start())
                if stop is None:
                    break
                start = stop.end()
        start += len(plain[start:end]) - len(plain[start:end].lstrip())
        if end > 0:
            yield start, end


def _actual(plain: str) -> Iterator[_Edit]:
    """``homotopy(simplified = s, actual = a)`` means a in the solution; the front end forgets which name is which."""
    for found in _HOMOTOPY.finditer(plain):
        end = closing(plain, found.end() - 1)
        parts, start = [], found.end()
        while start < end:
            stop = next_mark(plain, start, end, ",")
            parts.append((start, stop))
            start = stop + 1
        named = [(a + len(m.group()), b) for a, b in parts if (m := re.match(r"\s*actual\s*=(?!=)", plain[a:b]))]
        first, last = (named or parts or [(found.end(), end)])[0]
        yield found.start(), first, "(" + "\n" * plain.count("\n", found.start(), first)
        yield last, end, " " + "\n" * plain.count("\n", last, end)


def _samples(plain: str) -> Iterator[_Edit]:
    if len(list(_SAMPLE.finditer(plain))) < 2:
        return
    for found in _SAMPLE.finditer(plain):
        end = closing(plain, found.end() - 1) + 1
        yield found.start(), found.start(), "("
        yield end, end, " or false)"


def _bindings(source: Source, functions: Collection[str], others: Collection[str]) -> Iterator[_Edit]:
    found = classes(source) or ()
    for owner in found:
        if owner.kind not in ("model", "block", "class"):
            continue
        for clause in clauses(owner, found):
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
