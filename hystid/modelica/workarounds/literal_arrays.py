"""Equations such as ``w = [1, 1, 0]`` in a branch of an if-equation, written out element by element.

rumoca 0.10 counts such an equation once, and the elements of a loop in the other branch each, and refuses the
if-equation for "mismatched equation counts".
"""

from __future__ import annotations

import re
from collections.abc import Iterator

from hystid.modelica.sources import Source

_NUMBER = r"[-+]?\s*\d[\d.]*(?:[eE][-+]?\d+)?"
_ROW = rf"\s*{_NUMBER}\s*(?:,\s*{_NUMBER}\s*)*"
_EQUATION = re.compile(
    rf"(?:;|\b(?:then|else|loop|equation)\b)\s*(?P<name>[A-Za-z_][\w.]*)\s*=\s*"
    rf"(?:\[(?P<matrix>{_ROW}(?:;{_ROW})*)\]|\{{(?P<vector>{_ROW})\}})\s*(?=;)"
)


def with_elements_of_arrays(source: Source) -> Source:
    """The text with such equations rewritten; lines stay where they are."""
    text = source.text
    at = 0
    made = []
    while found := _EQUATION.search(source.plain, at):
        start, end = found.start("name"), found.end()
        made += [text[at:start], "; ".join(_elements(found)), "\n" * text.count("\n", start, end)]
        at = end
    return source if not made else Source(source.path, "".join((*made, text[at:])))


def _elements(found: re.Match[str]) -> Iterator[str]:
    name = found["name"]
    if found["vector"] is not None:
        for i, value in enumerate(found["vector"].split(","), 1):
            yield f"{name}[{i}] = {value.strip()}"
        return
    for i, row in enumerate(found["matrix"].split(";"), 1):
        for j, value in enumerate(row.split(","), 1):
            yield f"{name}[{i}, {j}] = {value.strip()}"
