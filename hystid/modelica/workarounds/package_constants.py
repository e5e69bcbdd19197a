"""Packages that another one extends with modifiers of constants, kept as they are.

With ``package Steel extends Material(E = 2e11)`` rumoca 0.10 gives ``Material.E`` the value of Steel, too, without a
word. So Material is read as ``package hystid_Material ... end hystid_Material; package Material extends
hystid_Material(E = 1e9); end Material;``, with the values that it states itself, and Steel extends hystid_Material,
which nobody else uses.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator, Mapping, Sequence

from hystid.errors import ModelicaError
from hystid.modelica.clauses import Clause, clauses, next_mark
from hystid.modelica.reach import Class, reached
from hystid.modelica.sources import Source
from hystid.modelica.workarounds.edits import edited


def with_separate_packages(name: str, sources: Sequence[Source]) -> list[Source]:
    """The texts with such packages apart; lines stay where they are.

    Raises ModelicaError, with file and line, where that cannot be done.
    """
    used = [c for found in reached(name, sources).values() for c in found or ()]
    extending = [
        clause
        for owner in used
        if owner.kind == "package"
        for clause in clauses(owner)
        if clause.kind in ("extends", "short")
        and any(not m.kind for m in (clause.mods.elements if clause.mods else ()))
    ]
    edits: dict[Source, set[tuple[int, int, str]]] = {}
    for clause in extending:
        base = _base(clause, used, sources)
        if base is None:
            continue
        others = [c for c in extending if c.target.rsplit(".", 1)[-1].strip() == base.name]
        names = {m.name for c in others for m in (c.mods.elements if c.mods else ()) if m.value}
        own = dict(_values(base))
        stated = ", ".join(f"{n} = {value}" for n, value in own.items() if n in names)
        _refuse_dependents(_with_dependents(names, own) - names, used, sources)
        new = f"hystid_{base.name}"
        edits.setdefault(clause.owner.source, set()).add((clause.behind - len(base.name), clause.behind, new))
        plain = base.source.plain
        partial = "partial " if re.search(r"\bpartial\s+\Z", plain[: base.start]) else ""
        wrapper = (
            f"{new}; {partial}package {base.name} extends {new}{f'({stated})' if stated else ''}; end {base.name};"
        )
        close = plain.rindex(base.name, base.start, base.end)
        edits.setdefault(base.source, set()).update(
            {(base.body - len(base.name), base.body, new), (close, base.end, wrapper)}
        )
    return [edited(s, edits.get(s, set())) for s in sources]


def _base(clause: Clause, used: Sequence[Class], sources: Sequence[Source]) -> Class | None:
    """The package that a clause extends; None where it is not in the texts."""
    short = clause.target.rsplit(".", 1)[-1].strip()
    found = [c for c in used if c.name == short and c.kind == "package"]
    if not found:
        return None
    holds = {c.kind for c in used if c.parent in found} & {"model", "block", "class", "connector", "package"}
    folder = any(re.match(rf"\s*within\s+[\w.]*\b{short}\b", s.plain) for s in sources)
    if len(found) > 1 or holds or folder or found[0].short:
        place = clause.owner.source.place(clause.start)
        raise ModelicaError(
            f"{place}: modifiers of the constants of package '{short}' are not supported "
            f"here: write 'package Common' with these constants and functions alone, and let '{short}' and "
            f"'{clause.owner.name}' extend it"
        )
    return found[0]


def _values(base: Class) -> Iterator[tuple[str, str]]:
    """Constants of a package with the text of their values."""
    plain = base.source.plain
    for clause in clauses(base):
        behind = clause.mods.closing + 1 if clause.mods else clause.behind
        sign = re.compile(r"\s*=").match(plain, behind)
        if clause.kind == "component" and sign:
            end = min(next_mark(plain, sign.end(), base.end, mark) for mark in ",;")
            value = plain[sign.end() : end].strip()
            if value:
                yield clause.name, " ".join(value.split())


def _with_dependents(names: Collection[str], values: Mapping[str, str]) -> set[str]:
    """The constants and those whose values are made from them."""
    found = set(names)
    while more := {n for n, v in values.items() if found & set(re.findall(r"[A-Za-z_]\w*", v))} - found:
        found |= more
    return found


def _refuse_dependents(names: Collection[str], used: Sequence[Class], sources: Sequence[Source]) -> None:
    """Of a replaceable package, constants made from modified ones are those of another package."""
    declared = (c for owner in used if owner.kind == "package" for c in clauses(owner))
    packages = {c.name for c in declared if c.kind == "short" and "replaceable" in c.prefixes}
    for package in packages:
        for name in names:
            for source in sources:
                found = re.search(rf"(?<![\w.]){package}\s*\.\s*{name}\b", source.plain)
                if found:
                    place = source.place(found.start())
                    raise ModelicaError(
                        f"{place}: '{package}.{name}', a constant made from others, of a replaceable "
                        "package is not supported where packages differ in these: write its formula here"
                    )
