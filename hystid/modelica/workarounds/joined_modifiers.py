"""Modifiers of a component that an extends clause modifies again: joined, or refused where they cannot be.

In ``model B P p(m(min = 0) = 3); end B; model A extends B(p(m(max = 6))); end A;`` rumoca 0.10 forgets all that B says
about p.m, the value too. What a class says about its own elements it keeps, so B is read as
``model B model Mine = P(m(min = 0) = 3); Mine p; end B;``.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

from hystid.errors import ModelicaError
from hystid.modelica.clauses import Clause, Modifier, Modifiers
from hystid.modelica.reach import Class

Key = tuple[str, str, str]  # file, class path, component


@dataclass(frozen=True)
class Override:
    """An element of the modifiers of component ``component``, in an extends clause or a short class."""

    clause: Clause
    component: str
    element: Modifier


def forgotten(declared: Sequence[Clause]) -> dict[Key, dict[str, str]]:
    """Key of a component -> names of the elements of its modifiers that an extends clause would make forgotten, with
    the text that has to be moved into a class: what every such clause sets anew is left out.

    Raises ModelicaError, with file and line, where that cannot be done.
    """
    overrides = list(_overrides(declared))
    bases = _bases(declared)
    _refuse_chains(overrides, bases)
    found: dict[Key, dict[str, str]] = {}
    for clause in (c for c in declared if c.kind == "component" and c.mods):
        mine = [
            o for o in overrides
            if o.component == clause.name and _inherits(o.clause.owner, clause.owner.name, bases)
        ]  # fmt: skip
        for element in _elements(clause.mods):
            losing = [o for o in mine if _loses(element, o.element)]
            if losing:
                _refuse_unmovable(clause, element, losing[0])
                anew = set.intersection(*(_content(o.element) for o in mine if o.element.name == element.name))
                text = _kept(clause.owner.source.text, element, anew)
                found.setdefault(key(clause), {})[element.name] = text
    return found


def _kept(text: str, element: Modifier, anew: set[str]) -> str:
    """The element without what is set anew."""
    inner = []
    for m in _elements(element.inner):
        below = {path.removeprefix(f"{m.name}.") for path in anew if path.startswith(f"{m.name}.")}
        if _content(m) - below:
            inner.append(_kept(text, m, below))
    start, end = element.value if element.value and "=" not in anew else (0, 0)
    listed = f"({', '.join(inner)})" if inner else ""
    return f"{element.name}{listed}{' = ' if end else ''}{text[start:end].strip()}"


def key(clause: Clause) -> Key:
    """What stays the same while the text around a declaration changes."""
    return str(clause.owner.source.path), ".".join(c.name for c in clause.owner.around()), clause.name


def _elements(mods: Modifiers | None) -> tuple[Modifier, ...]:
    return mods.elements if mods else ()


def _overrides(declared: Iterable[Clause]) -> Iterator[Override]:
    for clause in declared:
        if clause.kind in ("extends", "short"):
            for component in _elements(clause.mods):
                if component.kind != "class":
                    for element in _elements(component.inner):
                        yield Override(clause, component.name, element)


def _bases(declared: Iterable[Clause]) -> dict[str, set[str]]:
    """Short name of a class -> short names of the classes that it extends."""
    found: dict[str, set[str]] = {}
    for clause in declared:
        if clause.kind in ("extends", "short"):
            found.setdefault(clause.owner.name, set()).add(clause.target.rsplit(".", 1)[-1].strip())
    return found


def _inherits(owner: Class, base: str, bases: Mapping[str, set[str]]) -> bool:
    """Whether a class extends the one with a short name, directly or through others."""
    seen: set[str] = set()
    waiting = set(bases.get(owner.name, ()))
    while waiting:
        seen |= waiting
        waiting = {b for name in waiting for b in bases.get(name, ())} - seen
    return base in seen


def _loses(before: Modifier, after: Modifier) -> bool:
    return before.name == after.name and not before.kind and bool(_content(before) - _content(after))


def _content(element: Modifier) -> set[str]:
    """Paths of what an element sets: "=" for its value, "min=" for an attribute."""
    found = {"="} if element.value else set()
    return found | {f"{inner.name}.{path}" for inner in _elements(element.inner) for path in _content(inner)}


def _refuse_chains(overrides: Sequence[Override], bases: Mapping[str, set[str]]) -> None:
    """Two extends clauses, one above the other, that set different things of one element."""
    for after in overrides:
        for before in overrides:
            if (
                after.component == before.component
                and after.clause is not before.clause
                and _loses(before.element, after.element)
                and _inherits(after.clause.owner, before.clause.owner.name, bases)
            ):
                raise _refused(after, f"{before.clause.owner.name} extends its base")


def _refuse_unmovable(clause: Clause, element: Modifier, override: Override) -> None:
    several = clause.names > 1
    rows = clause.sizes and _rows(element)
    if several or rows or {"replaceable", "redeclare"} & set(clause.prefixes):
        raise _refused(override, f"{clause.owner.name} declares it")


def _rows(element: Modifier) -> bool:
    """Whether the elements of an array of components get values of their own."""
    alike = "each" in element.prefixes
    return not alike and (element.value is not None or any(_rows(inner) for inner in _elements(element.inner)))


def _refused(override: Override, where: str) -> ModelicaError:
    place = override.clause.owner.source.place(override.element.named)
    name = f"{override.component}.{override.element.name}"
    return ModelicaError(
        f"{place}: modifiers of '{name}' here and where {where} cannot be joined: declare "
        f"'model Mine = ...({override.element.name}(...) = ...)' with all of them, and Mine for '{override.component}'"
    )
