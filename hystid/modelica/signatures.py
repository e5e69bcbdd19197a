"""Units of the variables of functions, read from the text: the front end does not hand them on."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence

from hystid.modelica.clauses import Modifiers, clauses
from hystid.modelica.flat import Function
from hystid.modelica.reach import Class, classes
from hystid.modelica.sources import Source, declaration

_UNIT = re.compile(r'\s*"([^"]*)"')


def units_of_functions(functions: Sequence[Function], sources: Sequence[Source]) -> dict[str, dict[str, str]]:
    """Function -> variable -> unit, for those that state one, by themselves or by their type."""
    if not functions:
        return {}
    types = dict(_types(c for source in sources for c in classes(source) or ()))
    found = {}
    for function in functions:
        declared = declaration(function.name, sources)
        if declared is not None:
            inside = classes(declared.source) or ()
            owner = next((c for c in inside if declared.start <= c.start < declared.end), None)
            found[function.name] = dict(_units(owner, types)) if owner else {}
    return found


def _types(found: Iterable[Class]) -> Iterator[tuple[str, str]]:
    """Short names of types that state a unit."""
    for c in found:
        if c.kind == "type" and c.short:
            for clause in clauses(c):
                unit = _stated(c.source, clause.mods)
                if unit:
                    yield c.name, unit


def _units(owner: Class, types: Mapping[str, str]) -> Iterator[tuple[str, str]]:
    for clause in clauses(owner):
        unit = _stated(owner.source, clause.mods) or types.get(clause.target.rsplit(".", 1)[-1].strip(), "")
        if clause.kind == "component" and unit:
            yield clause.name, unit


def _stated(source: Source, mods: Modifiers | None) -> str:
    for element in mods.elements if mods else ():
        if element.name == "unit" and element.value:
            text = _UNIT.match(source.text, *element.value)
            return text.group(1) if text else ""
    return ""
