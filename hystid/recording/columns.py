"""Further columns of recordings by value: a bolt tension or a pressure that was set once per test and not recorded."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from fnmatch import fnmatchcase

import numpy as np

from hystid.errors import UsageError
from hystid.recording.types import Recording
from hystid.units import parse, si_name

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
            found = _assign(found, name, given, text)
    return tuple(names), found


def _assign(recordings: Sequence[Recording], name: str, given: str, text: str) -> list[Recording]:
    pattern, colon, value = given.rpartition(":")
    if colon:
        chosen = [fnmatchcase(r.name, pattern) or r.name == pattern for r in recordings]
        if not any(chosen):
            known = ", ".join(r.name for r in recordings)
            raise UsageError(f"--input {text}: no recording is called '{pattern}'; there are {known}")
        values: list[str | None] = [value if hit else None for hit in chosen]
    elif "," in given:
        values = list(given.split(","))
        if len(values) != len(recordings):
            raise UsageError(
                f"--input {text}: {len(values)} values for {len(recordings)} recordings; give one per recording, in "
                "their order, those of --holdout last"
            )
    else:
        values = [None if name in r.extra else given for r in recordings]
    return [
        recording if value is None else with_column(recording, name, *_quantity(value, text))
        for recording, value in zip(recordings, values, strict=True)
    ]


def _quantity(value: str, text: str) -> tuple[float, str]:
    match = _VALUE.match(value)
    if not match:
        raise UsageError(f"--input {text}: '{value.strip()}' is no number with a unit, as 35 lbf or 2.25 V")
    unit = (match[2] or "1").strip()
    parse(unit)  # an unknown unit is refused here, with its name
    return float(match[1]), unit
