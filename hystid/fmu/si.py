"""Units that an FMU states for its variables, and whether they are those of SI, which hystid works in."""

from __future__ import annotations

from typing import Any

from hystid.errors import UsageError
from hystid.units import parse


def unit_of(variable: Any) -> str:
    """The unit of one of FMPy's variables, its own or that of its declared type; "" without one."""
    return variable.unit or getattr(variable.declaredType, "unit", None) or ""


def beside_si(description: Any, name: str) -> str:
    """The unit of a variable where its numbers are not those of SI, as "mm"; else ""."""
    unit, factor, offset = _unit_in_si(description, name)
    return "" if factor == 1 and offset == 0 else unit


def from_si(description: Any, name: str, value: float) -> float:
    """A value in SI units as a number in the variable's unit."""
    _, factor, offset = _unit_in_si(description, name)
    return value if factor == 1 and offset == 0 else (value - offset) / factor


def _unit_in_si(description: Any, name: str) -> tuple[str, float, float]:
    """Unit, factor and offset of a variable: value_SI = factor * value + offset; 1 and 0 where nothing tells.

    description: FMPy's. What the FMU defines its unit to be counts before what the name of the unit says.
    """
    unit = next((unit_of(v) for v in description.modelVariables if v.name == name), "")
    defined = next((u.baseUnit for u in description.unitDefinitions if u.name == unit and u.baseUnit), None)
    try:
        read = parse(unit) if defined is None else defined
    except UsageError:
        return unit, 1.0, 0.0
    return unit, float(read.factor), float(read.offset)
