"""Further columns of recordings by value: a bolt tension, a pressure or a mass that was set once per test."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from fnmatch import fnmatchcase

import numpy as np

from hystid.errors import UsageError
from hystid.recording.types import Recording
from hystid.units import parse, si_name

MASS = "mass"
_VALUE = re.compile(r"^\s*([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)\s*(\D.*)?$")


def with_column(recording: Recording, name: str, value: float, unit: str = "1") -> Recording:
    """The recording with a further column of one value, given in ``unit`` and stored in SI.

    Raises UsageError when the recording has that column already, or the value is not finite.
    """
    if name in recording.extra:
        raise UsageError(f"{recording.name}: column {name} is in the file already; give its value for other files only")
    if not np.isfinite(value):
        raise UsageError(f"{recording.name}: the value of {name} must be a finite number, found {value}")
    known = parse(unit)
    column = np.full(len(recording), known.factor * value + known.offset)
    return replace(
        recording,
        extra={**recording.extra, name: column},
        units={**recording.units, name: si_name(unit)},
        notes=(
            *recording.notes,
            f"{name} = {value:g}{'' if unit == '1' else ' ' + unit} given for the whole recording",
        ),
    )


def own_mass(recording: Recording, mass: float) -> float:
    """Moving mass of a recording [kg, or kg.m2 where rotational]: its own column ``mass``, else ``mass``.

    0 (F is the restoring force itself) stays 0. A column that is no one number above 0 is something else.
    """
    if not mass or recording.units.get(MASS) != _mass_unit(recording):
        return mass
    values = recording.extra[MASS]
    return float(values[0]) if values[0] > 0 and np.all(values == values[0]) else mass


def _mass_unit(recording: Recording) -> str:
    return si_name("kg.m2" if recording.rotational else "kg")


def with_masses(recordings: Sequence[Recording], texts: Sequence[str]) -> tuple[float, list[Recording]]:
    """The mass of the first recording, and the recordings with their own masses where several were given.

    Each text is one of: ``4.2`` (for every recording), ``4.2,6.1`` (one per recording, in their order) or
    ``*heavy*:6.1`` (for recordings whose name matches; may be repeated). Kilograms where no unit is given, kg.m2 where
    the rig turns. Raises UsageError naming the text.
    """
    plain = [text for text in texts if not {",", ":"} & set(text)]
    if len(plain) > 1:
        raise UsageError(f"--mass {plain[1]}: one mass for all recordings was given already ({plain[0]})")
    found = list(recordings)
    usual = _mass_unit(found[0]) if found else "kg"
    for text in texts:
        if text not in plain:
            found = _assign(found, MASS, text, f"--mass {text}", usual)
    own = [own_mass(recording, np.nan) for recording in found]
    given = np.nan
    if plain:
        value, unit = _quantity(plain[0], f"--mass {plain[0]}", usual)
        given = parse(unit).factor * value
    for recording, mass in zip(found, own, strict=True):
        if np.isnan(mass) and MASS in recording.units and np.ptp(recording.extra[MASS]) == 0:
            held = f"{recording.extra[MASS][0]:g} {usual}"
            raise UsageError(f"--mass: {recording.name} has a mass of {held}; it must be above 0 {usual}")
        if np.isnan(mass) and not plain:
            raise UsageError(f"--mass: no mass was given for {recording.name}; add one for all others, as --mass 4.2")
    return (given if not own or np.isnan(own[0]) or given == 0 else own[0]), found


def mass_texts(texts: Sequence[str]) -> list[str]:
    """The texts of ``with_masses``, each value of which is a number. Raises UsageError: no recording is read for it."""
    for text in texts:
        for value in text.rpartition(":")[2].split(","):
            _quantity(value, f"--mass {text}", "kg")
    return list(texts)


def with_columns(recordings: Sequence[Recording], texts: Sequence[str]) -> tuple[tuple[str, ...], list[Recording]]:
    """Names of further inputs and the recordings with the values that were given for them.

    Each text is one of: ``NAME`` (a column of every file); ``NAME=35 lbf`` (one value for every recording without that
    column); ``NAME=20,35,80`` (one value per recording, in their order); ``NAME=*20lb*:20 lbf`` (for recordings whose
    name matches; may be repeated). A number without a unit is a plain number. Raises UsageError naming the text.
    """
    names: dict[str, None] = {}
    found = list(recordings)
    for text in texts:
        name, equals, given = (part.strip() for part in text.partition("="))
        if not name or (equals and not given):
            raise UsageError(f"--input {text}: write NAME, NAME=VALUE or NAME=PATTERN:VALUE")
        names[name] = None
        if given:
            found = _assign(found, name, given, f"--input {text}")
    return tuple(names), found


def _assign(recordings: Sequence[Recording], name: str, given: str, option: str, unit: str = "1") -> list[Recording]:
    pattern, colon, value = given.rpartition(":")
    if colon:
        chosen = [fnmatchcase(r.name, pattern) or r.name == pattern for r in recordings]
        if not any(chosen):
            known = ", ".join(r.name for r in recordings)
            raise UsageError(f"{option}: no recording is called '{pattern}'; there are {known}")
        values: list[str | None] = [value if hit else None for hit in chosen]
    elif "," in given:
        values = list(given.split(","))
        if len(values) != len(recordings):
            raise UsageError(
                f"{option}: {len(values)} values for {len(recordings)} recordings; give one per recording, in "
                "their order, those of --holdout last"
            )
    else:
        values = [None if name in r.extra else given for r in recordings]
    return [
        recording if value is None else with_column(recording, name, *_quantity(value, option, unit))
        for recording, value in zip(recordings, values, strict=True)
    ]


def _quantity(value: str, option: str, usual: str) -> tuple[float, str]:
    match = _VALUE.match(value)
    example = "35 lbf or 2.25 V" if usual == "1" else f"4.2 {usual}"
    if not match:
        raise UsageError(f"{option}: '{value.strip()}' is no number with a unit, as {example}")
    unit = (match[2] or usual).strip()
    parse(unit)  # an unknown unit is refused here, with its name
    return float(match[1]), unit
