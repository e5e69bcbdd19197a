"""Parameters as a user gives them: values, and which of them may move."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from numbers import Real
from pathlib import Path
from typing import Any, TypeGuard

from hystid.errors import UsageError
from hystid.files import json_of


@dataclass(frozen=True)
class Given:
    """Parameters as given: values, and names that must not move, or may.

    unforced: no recording has a force, so that one law of inertia is as good as another.
    """

    values: Mapping[str, float]
    fixed: frozenset[str]
    free: frozenset[str] = frozenset()
    unforced: bool = False

    @property
    def mass(self) -> float | None:
        """The mass as given [kg]."""
        return self.values.get("m", self.values.get("mass"))


def _is_number(value: object) -> TypeGuard[float]:
    """Whether it is a finite number; whole numbers of JSON may have any number of digits."""
    if isinstance(value, bool) or not isinstance(value, Real):
        return False
    try:
        return math.isfinite(value)
    except OverflowError:
        return False


def given_parameters(parameters: str | Path | Mapping[str, Any] | None) -> Given:
    """Parameters from a mapping or a JSON file, name -> number or {"value": number, "fixed": true}. Raises
    UsageError."""
    if parameters is None:
        return Given({}, frozenset())
    where = "parameters"
    if isinstance(parameters, str | Path):
        where = str(parameters)
        parameters = json_of(Path(parameters), UsageError)
    if not isinstance(parameters, Mapping):
        raise UsageError(f"{where}: parameters are an object of name: value, not a {type(parameters).__name__}")
    values: dict[str, float] = {}
    fixed: set[str] = set()
    free: set[str] = set()
    for name, entry in parameters.items():
        value = entry.get("value") if isinstance(entry, Mapping) else entry
        if not _is_number(value):
            raise UsageError(f'{where}: {name} must be a number or {{"value": number, "fixed": true}}, not {entry!r}')
        values[name] = float(value)
        if isinstance(entry, Mapping) and "fixed" in entry:
            if not isinstance(entry["fixed"], bool):
                raise UsageError(f"{where}: {name} has fixed {entry['fixed']!r}, where true or false is needed")
            (fixed if entry["fixed"] else free).add(name)
    return Given(values, frozenset(fixed), frozenset(free))
