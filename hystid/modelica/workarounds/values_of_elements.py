"""``Slider s[2](fc = linspace(1, 2, 2))`` written ``parameter Real v[2] = linspace(1, 2, 2); Slider s[2](fc = v)``.

rumoca 0.10 gives each element of an array of components the whole array, and refuses it for an "expression shape
mismatch", where the value is an expression and neither a name nor a list of elements.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from itertools import count

from hystid.modelica.clauses import Clause, clauses, closing
from hystid.modelica.reach import classes
from hystid.modelica.sources import Source
from hystid.modelica.workarounds.edits import Edit, edited
from hystid.modelica.workarounds.model_algorithms import Types

_SPREAD = re.compile(r"[A-Za-z_][\w.]*\s*(?=\[|\Z)|fill\s*(?=\([^\[]*\Z)|(?=\{)")
_MAKES_ARRAYS = re.compile(r"[{:]|(?<![\w.])(?:linspace|ones|zeros|fill|cat)\s*\(")
_NAME = re.compile(r"(?<![\w.])[A-Za-z_]\w*(?!\s*(?:[\w\[(]|\.\s*\w))")


def with_named_values(sources: Sequence[Source]) -> list[Source]:
    """The texts with such values declared beside the component; lines stay where they are."""
    everything = [c for source in sources for c in classes(source) or ()]
    types, numbers = Types(everything), count(1)
    components = [k for c in everything if c.is_model for k in clauses(c) if k.sizes]
    return [
        edited(s, (e for k in components if k.owner.source == s for e in _edits(k, types, numbers))) for s in sources
    ]


def _edits(clause: Clause, types: Types, numbers: Iterator[int]) -> Iterator[Edit]:
    plain = clause.owner.source.plain
    if clause.kind != "component" or len(clause.sizes) != 1 or ":" in clause.sizes[0]:
        return
    for element in clause.mods.elements if clause.mods else ():
        if not element.value or element.kind:
            continue
        start, end = element.value
        value, declared = plain[start:end].strip(), types.member(element.name, clause)
        if declared is None or declared.sizes or "each" in element.prefixes or _is_spread(value):
            continue
        named = (types.declared(name, clause.owner) for name in _NAME.findall(value))
        if not _MAKES_ARRAYS.search(value) and not any(k is not None and k.sizes for k in named):
            continue
        new = f"hystid_values_{next(numbers)}"
        kind = "parameter " if {"parameter", "constant"} & {*declared.prefixes, *clause.prefixes} else ""
        text = clause.owner.source.text[start:end]
        flat = " ".join(text.split())
        yield clause.start, clause.start, f"{kind}{types.built_in(declared)} {new}[{clause.sizes[0]}] = {flat}; "
        yield *element.value, f" {new}" + "\n" * text.count("\n")


def _is_spread(value: str) -> bool:
    """Whether the front end gives each component its element: of a name, a list of elements, or fill(), alone."""
    front = _SPREAD.match(value)
    return front is not None and closing(value, front.end()) >= len(value) - 1
