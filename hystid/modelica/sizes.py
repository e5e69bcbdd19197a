"""Arrays that are too large to be written out as scalars are refused before anything spends minutes on them."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence

from hystid.errors import ModelicaError
from hystid.modelica.clauses import Clause, clauses
from hystid.modelica.flat import FlatModel
from hystid.modelica.reach import reached
from hystid.modelica.sources import Source

MOST = 20_000  # scalars: each becomes lines of C, and passes over them take seconds to minutes beyond


def refuse_large_arrays(name: str, sources: Sequence[Source], structure: Mapping[str, float]) -> None:
    """Raise ModelicaError for a declaration whose sizes, as far as the text shows them, make too many elements."""
    for source, found in reached(name, sources).items():
        for owner in found or ():
            for clause in clauses(owner, found or ()):
                number = math.prod(_size(text, clause, structure) for text in clause.sizes)
                if number > MOST:
                    line = source.plain.count("\n", 0, clause.start) + 1
                    raise _too_many(f"{source.path}:{line}", clause.name, number)


def refuse_many_scalars(flat: FlatModel) -> None:
    """Raise ModelicaError for a flat model with too many elements in one array, or in all of them."""
    sizes = {v.name: math.prod(v.dims) for v in flat.variables}
    largest = max(flat.variables, key=lambda v: sizes[v.name], default=None)
    if largest is not None and sum(sizes.values()) > MOST:
        raise _too_many(str(largest.place), largest.name, sum(sizes.values()))


def _too_many(place: str, name: str, number: int) -> ModelicaError:
    return ModelicaError(
        f"{place}: with '{name}' the model has {number} elements; the limit is {MOST}, for each is written out in C: "
        "use a coarser discretisation"
    )


def _size(text: str, clause: Clause, structure: Mapping[str, float]) -> int:
    """A size written as a number, or as a name that the class gives a number; 1 where the text does not show it."""
    text = text.strip()
    if text.isdigit():
        return int(text)
    if text in structure:
        return int(structure[text])
    plain = clause.owner.source.plain[clause.owner.start : clause.owner.end]
    named = rf"\bInteger\b[^;]*\b{re.escape(text)}\s*(?:\([^()]*\))?\s*=\s*(\d+)\s*[;,]"
    given = re.search(named, plain) if text else None
    return int(given.group(1)) if given else 1
