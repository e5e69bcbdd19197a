"""Sizes and conditions of components, as far as the text shows them.

Arrays that are too large to be written out as scalars are refused before anything spends minutes on them.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence

from hystid.errors import ModelicaError
from hystid.modelica.clauses import Clause, clauses
from hystid.modelica.expr import Num
from hystid.modelica.flat import FlatModel
from hystid.modelica.reach import Class, own_text, reached, words
from hystid.modelica.sources import Source

_SURELY_TOO_MANY = 100_000  # by an estimate that counts components which conditions or redeclarations take away
_PREDEFINED = ("Real", "Integer", "Boolean", "String")
MOST = 20_000  # scalars: each becomes lines of C, and passes over them take seconds to minutes beyond


def refuse_large_arrays(name: str, sources: Sequence[Source], structure: Mapping[str, float]) -> None:
    """Raise ModelicaError for sizes and loops that make too many elements, as far as the text shows them."""
    found = reached(name, sources)
    declared = [c for classes in found.values() for owner in classes or () for c in clauses(owner)]
    for clause in declared:
        number = _number(clause, structure)
        if number > MOST:
            raise _too_many(clause.owner.source.place(clause.start), clause.name, number)
    counter = _Counter(declared, structure)
    for clause in declared:
        number = _number(clause, structure) * counter.elements(clause.target)
        if clause.kind == "component" and number > _SURELY_TOO_MANY:
            raise _too_many(clause.owner.source.place(clause.start), clause.name, number)
    for owner in (owner for classes in found.values() for owner in classes or ()):
        _refuse_long_loops(owner, structure)


_CONDITION = re.compile(r"\bif\b((?:(?!\bthen\b)[^;])*);")  # of a component: no "then" follows


def deciding_words(name: str, sources: Sequence[Source]) -> frozenset[str]:
    """Names in the sizes of component arrays and in the conditions of components that class ``name`` may have."""
    deciding = []
    for found in reached(name, sources).values():
        for owner in found or ():
            deciding += [part.partition("annotation")[0] for part in _CONDITION.findall(own_text(owner, found or ()))]
            parts = (c for c in clauses(owner) if c.kind == "component" and c.target not in _PREDEFINED)
            deciding += [re.sub(r"\bsize\s*\([^()]*\)", "", size) for c in parts for size in c.sizes]
    return frozenset(words(" ".join(deciding)))


class _Counter:
    """Elements of a class by its short name; of classes with one name the smallest, so that nothing is refused that
    the front end could read."""

    def __init__(self, declared: Sequence[Clause], structure: Mapping[str, float]) -> None:
        self._parts: dict[str, dict[Class, list[Clause]]] = {}
        for clause in declared:
            self._parts.setdefault(clause.owner.name, {}).setdefault(clause.owner, []).append(clause)
        self._structure = structure
        self._known: dict[str, int] = {}

    def elements(self, name: str) -> int:
        """1 for a type that is not declared in the texts, and inside a class that holds itself."""
        short = name.rsplit(".", 1)[-1].strip()
        if short not in self._known:
            self._known[short] = 1
            found = [sum(map(self._of, parts)) for parts in self._parts.get(short, {}).values()]
            self._known[short] = max(min(found, default=1), 1)
        return self._known[short]

    def _of(self, clause: Clause) -> int:
        return _number(clause, self._structure) * self.elements(clause.target) if clause.target else 0


_LOOP = re.compile(r"\bin\s+(\w+)\s*:\s*(\w+)\b(?!\s*[:*/+.(-])")


def _refuse_long_loops(owner: Class, structure: Mapping[str, float]) -> None:
    for found in _LOOP.finditer(owner.source.plain, owner.body, owner.end):
        first, last = (_value(text, owner, structure) for text in found.groups())
        if first is not None and last is not None and last - first >= MOST:
            raise ModelicaError(
                f"{owner.source.place(found.start())}: a loop of {last - first + 1} steps is too long (limit {MOST}), "
                "for each is written out in C"
            )


def refuse_many_scalars(flat: FlatModel) -> None:
    """Raise ModelicaError for a flat model with too many elements in one array, or in all of them."""
    sizes = {v.name: math.prod(v.dims) for v in flat.variables}
    largest = max(flat.variables, key=lambda v: sizes[v.name], default=None)
    if largest is not None and sum(sizes.values()) > MOST:
        raise _too_many(str(largest.place), largest.name, sum(sizes.values()))


def refuse_widened_arrays(flat: FlatModel, sources: Sequence[Source]) -> None:
    """Raise ModelicaError for an array that a loop leaves: the front end gives it the elements that the loop names."""
    declared = {
        (c.owner.source.place(c.start), c.name): c.sizes
        for found in reached(flat.name, sources).values()
        for owner in found or ()
        for c in clauses(owner)
        if c.sizes
    }
    values = {v.name: v.binding.value for v in flat.variables if isinstance(v.binding, Num)}
    for v in flat.variables:
        front, _, last = v.name.rpartition(".")
        for text, found in zip(declared.get((str(v.place), last), ()), v.dims, strict=False):
            name = f"{front}.{text.strip()}".lstrip(".")
            size = float(text) if text.strip().isdigit() else values.get(name, found)
            if size < found:
                raise ModelicaError(f"{v.place}: '{v.name}' has {size:g} elements, and a loop names element {found}")


def _too_many(place: str, name: str, number: int) -> ModelicaError:
    return ModelicaError(
        f"{place}: with '{name}' the model has {number} elements; the limit is {MOST}, for each is written out in C: "
        "use a coarser discretisation"
    )


def _number(clause: Clause, structure: Mapping[str, float]) -> int:
    """Product of the sizes of a declaration; 1 for those that the text does not show."""
    found = (_value(text.strip(), clause.owner, structure) for text in clause.sizes)
    return math.prod(1 if size is None else size for size in found)


def _value(text: str, owner: Class, structure: Mapping[str, float]) -> int | None:
    """A number, or a name that the class gives a number."""
    if text.isdigit():
        return int(text)
    if text in structure:
        return int(structure[text])
    plain = owner.source.plain[owner.start : owner.end]
    named = rf"\bInteger\b[^;]*\b{re.escape(text)}\s*(?:\([^()]*\))?\s*=\s*(\d+)\s*[;,]"
    given = re.search(named, plain) if text else None
    return int(given.group(1)) if given else None
