"""A diagnosis of a rig that turns, in its words and units. The fits and decisions before know nothing of it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from hystid.diagnosis.fit.value import Value
from hystid.diagnosis.tell.result import Diagnosis, Finding, Where
from hystid.rotation import turned_text, turned_unit

_HEAD = "// A rig that turns: x is an angle [rad], F and R are torques [N.m], m is an inertia [kg.m2]."


def turned(diagnosis: Diagnosis) -> Diagnosis:
    """The same diagnosis of angle, torque and inertia."""
    return replace(
        diagnosis,
        headline=turned_text(diagnosis.headline),
        refit=_units(diagnosis.refit),
        values=_units(diagnosis.values),
        findings=tuple(_finding(found) for found in diagnosis.findings),
        unknown=_where(diagnosis.unknown) if diagnosis.unknown else None,
        next_experiment=turned_text(diagnosis.next_experiment),
        notes=tuple(map(turned_text, diagnosis.notes)),
        doubts=tuple(map(turned_text, diagnosis.doubts)),
        misread=tuple(map(turned_text, diagnosis.misread)),
        rotational=True,
    )


def turned_model(text: str) -> str:
    """A Modelica model of such a rig: its comments change, its laws are those of every rig."""
    lines = [turned_text(line) if line.lstrip().startswith("//") else line for line in text.split("\n")]
    return "\n".join([_HEAD, *lines])


def _units(values: Mapping[str, Value]) -> dict[str, Value]:
    return {name: replace(value, unit=turned_unit(value.unit)) for name, value in values.items()}


def _finding(found: Finding) -> Finding:
    return replace(
        found,
        parameters=_units(found.parameters),
        where=_where(found.where),
        title=turned_text(found.title),
        sentence=turned_text(found.sentence),
    )


def _where(where: Where) -> Where:
    return replace(where, text=turned_text(where.text))
