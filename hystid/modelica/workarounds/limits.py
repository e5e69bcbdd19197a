"""Modifiers of a replaceable class or component that is redeclared elsewhere, where a constraining clause stands too.

``replaceable model F = Q constrainedby P(mu = 15)`` gives mu to every class that F is redeclared to (Modelica
specification 3.6, section 7.3.2); rumoca 0.10 forgets it. So each redeclaration is read with that modifier, unless it
states one itself. ``replaceable Q f(mu = 2) constrainedby P`` gives mu to the default alone; the default becomes a
class of its own, ``model hystid_f = Q(mu = 2)``, which a redeclaration leaves behind.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

from hystid.modelica.clauses import Clause, Modifiers, clauses
from hystid.modelica.reach import reached
from hystid.modelica.sources import Source
from hystid.modelica.workarounds.dropped_modifiers import all_elements, names_in, one_line
from hystid.modelica.workarounds.edits import Edit, edited


def with_limits_kept(name: str, sources: Sequence[Source]) -> list[Source]:
    """The texts with such modifiers of what class ``name`` may meet where they act; lines stay where they are.

    What names do not distinguish, or what names variables, is not changed; a later pass refuses it.
    """
    used = reached(name, sources)
    declared = [c for found in used.values() for owner in found or () for c in clauses(owner)]
    limited = [c for c in declared if "replaceable" in c.prefixes and c.limit]
    if not limited:
        return list(sources)
    again = list(_redeclarations(declared))
    edits: dict[Source, list[Edit]] = {s: [] for s in sources}
    offers = _Offers(declared)
    for clause in limited:
        mine = [r for r in again if r.name == clause.name]
        theirs = [offers.of(r.name, r.base) for r in mine]
        if not mine or any(len(found) != 1 for found in theirs):
            continue
        own = edits[clause.owner.source]
        if clause.kind == "component":
            own += _apart(clause)
        elif (limits := _limits(clause)) and not names_in(clause, limits):
            lines = "\n" * clause.owner.source.text.count("\n", limits.opening, limits.closing)
            own += [*_added(clause, clause.mods, clause.behind), (limits.opening, limits.closing + 1, lines)]
            for r in (r for r, found in zip(mine, theirs, strict=True) if found == [clause]):
                edits[r.source] += _added(clause, r.mods, r.behind)
    return [edited(s, edits[s]) for s in sources]


@dataclass(frozen=True)
class _Again:
    """A redeclaration of what class ``base`` offers as ``name``; base: "" where names do not tell."""

    source: Source
    name: str
    base: str
    mods: Modifiers | None
    behind: int


def _redeclarations(declared: Iterable[Clause]) -> Iterator[_Again]:
    for c in declared:
        if "redeclare" in c.prefixes:
            yield _Again(c.owner.source, c.name, _around(c), c.mods, c.behind)
        for element, _, depth in all_elements(c.mods):
            if element.kind:
                base = c.target.rsplit(".", 1)[-1].strip() if depth == 1 else ""
                yield _Again(c.owner.source, element.name, base, element.inner, element.behind)


def _around(clause: Clause) -> str:
    """The class that holds the statement; a short class is its own owner."""
    owner = clause.owner.parent if clause.kind == "short" else clause.owner
    return owner.name if owner is not None else ""


class _Offers:
    """Which replaceable class or component a name means in a class: its own, or that of a base class."""

    def __init__(self, declared: Iterable[Clause]) -> None:
        self._offers: dict[tuple[str, str], list[Clause]] = defaultdict(list)
        self._bases: dict[str, list[str]] = defaultdict(list)
        for c in declared:
            if "replaceable" in c.prefixes and "redeclare" not in c.prefixes:
                self._offers[_around(c), c.name].append(c)
            if c.kind in ("extends", "short"):
                self._bases[c.owner.name].append(c.target.rsplit(".", 1)[-1].strip())

    def of(self, name: str, owner: str) -> list[Clause]:
        """Every clause that may be meant."""
        waiting, seen = [owner], set()
        while waiting:
            here = waiting.pop()
            if (here, name) in self._offers:
                return self._offers[here, name]
            seen.add(here)
            waiting += [b for b in self._bases[here] if b not in seen]
        return []


def _limits(clause: Clause) -> Modifiers | None:
    return clause.limit[1] if clause.limit else None


def _added(limit: Clause, mods: Modifiers | None, behind: int) -> Iterator[Edit]:
    stated = {m.name for m in mods.elements} if mods else set()
    found, text = _limits(limit), limit.owner.source.text
    wanted = [one_line(text[m.start : m.end]) for m in (found.elements if found else ()) if m.name not in stated]
    if wanted and mods:
        yield mods.closing, mods.closing, (", " if mods.elements else "") + ", ".join(wanted)
    elif wanted:
        yield behind, behind, f"({', '.join(wanted)})"


def _apart(clause: Clause) -> Iterator[Edit]:
    """A component whose default has modifiers of its own, none of which the limit states too."""
    mods, found = clause.mods, _limits(clause)
    if mods is None or clause.names > 1 or {m.name for m in mods.elements} & _stated(found):
        return
    if any(m.kind for m in mods.elements):
        return
    text, name = clause.owner.source.text, f"hystid_{clause.name}"
    inside = one_line(text[mods.opening : mods.closing + 1])
    yield clause.start, clause.start, f"model {name} = {clause.target}{inside}; "
    yield clause.typed, clause.typed + len(clause.target), name
    yield mods.opening, mods.closing + 1, "\n" * text.count("\n", mods.opening, mods.closing)


def _stated(mods: Modifiers | None) -> set[str]:
    return {m.name for m in mods.elements} if mods else set()
