"""Parts that both versions of the description share."""

from __future__ import annotations

import math
from collections.abc import Iterable
from datetime import UTC, datetime
from importlib.metadata import version
from xml.etree import ElementTree as ET

from hystid.errors import UsageError
from hystid.fmu.interface import Interface
from hystid.modelcode import Enumeration, Variable
from hystid.units import exponents, to_si

_TOLERANCE = 1e-6  # where a model states none: with it CVode is within 0.1 % (benchmarks/fmu/solver_settings.py)
# What people read in place of a unit where the model states nothing: name, factor, offset (shown = factor * value +
# offset). Angles, temperatures and pressures as in the Modelica Standard Library; displacements of structures in
# millimetres.
_DISPLAYED = {
    "m": ("mm", 1e3, 0.0),
    "rad": ("deg", 180 / math.pi, 0.0),
    "rad/s": ("deg/s", 180 / math.pi, 0.0),
    "K": ("degC", 1.0, -273.15),
    "Pa": ("bar", 1e-5, 0.0),
}
LOG_CATEGORIES = {
    "logEvents": "Events found and handled",
    "logStatusWarning": "Warnings: chattering relations held over a step",
    "logStatusError": "Refused calls and failed steps, with the reason",
}


def number(value: float) -> str:
    """Shortest text that reads back as the same double."""
    return repr(float(value))


def start_text(variable: Variable) -> str:
    """Start value in the spelling of the variable's type."""
    value = variable.start or 0.0
    if variable.type == "Boolean":
        return "true" if value else "false"
    return str(round(value)) if variable.type == "Integer" else number(value)


def one_line(text: str) -> str:
    """Text fit for an attribute: line ends and tabs become spaces."""
    return " ".join(text.split())


def timestamp(generated: datetime) -> str:
    """xs:dateTime in UTC with the letter Z, to the second: the only form that strict checkers take."""
    return generated.astimezone(UTC).strftime("%Y-%m-%dT%H:%M:%SZ")


def generation_tool() -> str:
    """Name and version of this tool."""
    return f"hystid {version('hystid')}"


def root_of(model: Interface, version: str, token: str, generated: datetime, **own: str) -> ET.Element:
    """The root element. token: name of the attribute that holds the model's; own: further attributes."""
    attributes = {
        "fmiVersion": version,
        "modelName": model.code.name,
        token: model.code.token,
        "description": one_line(model.code.description),
        "generationTool": generation_tool(),
        "generationDateAndTime": timestamp(generated),
        "variableNamingConvention": "structured",
        **own,
    }
    return ET.Element("fmiModelDescription", {name: value for name, value in attributes.items() if value})


def add(parent: ET.Element, tag: str, attributes: dict[str, str | None] | None = None) -> ET.Element:
    """Child element; attributes that are None are left out."""
    given = {name: value for name, value in (attributes or {}).items() if value is not None}
    return ET.SubElement(parent, tag, given)


def flag(value: bool) -> str | None:
    """Attribute of a capability: left out unless true, since false is the default of all of them."""
    return "true" if value else None


def identity(v: Variable) -> dict[str, str | None]:
    """Attributes that say which variable it is, and when it changes."""
    return {
        "name": v.name,
        "valueReference": str(v.slot),
        "description": one_line(v.description) or None,
        "causality": v.causality,
        "variability": v.variability,
        "initial": None if v.causality in ("input", "independent") else v.initial,
    }


def of_its_values(model: Interface, v: Variable, state: str | None, derivative: str | None) -> dict[str, str | None]:
    """Attributes of type, unit, limits and start. state: that the variable is, derivative: reference to that of which
    it is the rate; None for none."""
    real, number_text = v.type == "Real", number if v.type == "Real" else lambda value: str(round(value))
    limits = {"min": v.min, "max": v.max} if v.type != "Boolean" else {}
    return {
        "declaredType": v.enumeration.name if v.enumeration else None,
        "unit": v.unit or None if real else None,
        "displayUnit": shown[0] if (shown := display_unit(v)) else None,
        **{name: None if x is None else number_text(x) for name, x in limits.items()},
        "nominal": number(abs(v.nominal)) if real and v.nominal else None,
        "start": start_text(v) if v.start is not None and v.causality != "independent" else None,
        "derivative": derivative,
        "reinit": flag(model.reinitialised(state)) if state is not None else None,
    }


def add_units(root: ET.Element, model: Interface) -> None:
    """Every unit in use with its SI exponents, factor and offset; no element where no variable has a unit."""
    names = sorted({v.unit for v in model.variables if v.unit and v.type == "Real"})
    if not names:
        return
    shown: dict[str, dict[str, tuple[float, float]]] = {}
    for v in model.variables:
        if display := display_unit(v):
            shown.setdefault(v.unit, {})[display[0]] = display[1:]
    definitions = add(root, "UnitDefinitions")
    for name in names:
        unit = add(definitions, "Unit", {"name": name})
        try:
            ET.SubElement(unit, "BaseUnit", base_unit(name))
        except UsageError:
            continue  # a unit without base unit is legal: it only cannot be converted
        for read, (times, plus) in shown.get(name, {}).items():
            more = {"offset": number(plus)} if plus else {}
            add(unit, "DisplayUnit", {"name": read, "factor": number(times), **more})


def base_unit(name: str) -> dict[str, str]:
    """SI exponents, factor and offset of a unit as attributes. Raises UsageError where it is not known."""
    factor, offset, powers = exponents(name)
    attributes = {base: str(power) for base, power in powers.items() if power}
    attributes |= {"factor": number(factor)} if factor != 1 else {}
    return attributes | ({"offset": number(offset)} if offset != 0 else {})


def add_items(parent: ET.Element, enumeration: Enumeration) -> None:
    """The items of an enumeration with their values."""
    for value, item in enumerate(enumeration.items, 1):
        add(parent, "Item", {"name": item, "value": str(value)})


def add_texts(parent: ET.Element, model: Interface, inside: str) -> None:
    """Strings that are built in, as constants. inside: the element that holds the content, "Start" in FMI 3.0."""
    for reference, text in model.texts:
        common: dict[str, str | None] = {
            "name": text.name,
            "valueReference": str(reference),
            "description": one_line(text.description) or None,
            "causality": "local",
            "variability": "constant",
            "initial": "exact",
        }
        variable = add(parent, "String" if inside == "Start" else "ScalarVariable", common)
        add(variable, inside, {"value" if inside == "Start" else "start": text.content})


def display_unit(variable: Variable) -> tuple[str, float, float] | None:
    """The unit in which people read a variable, where it is another than the one it is stored in: that of its author,
    or a customary one. Name, factor, offset: shown = factor * value + offset."""
    if variable.type != "Real" or not variable.unit or variable.shown == variable.unit:
        return None
    if variable.shown:
        try:
            factor, offset = to_si(variable.shown, variable.unit)
        except UsageError:
            return _DISPLAYED.get(variable.unit)  # it says something else than the unit, or nobody knows it
        return variable.shown, 1 / factor, -offset / factor
    return _DISPLAYED.get(variable.unit)


def add_log_categories(root: ET.Element) -> None:
    """The categories under which the shell logs."""
    categories = add(root, "LogCategories")
    for name, description in LOG_CATEGORIES.items():
        add(categories, "Category", {"name": name, "description": description})


def add_experiment(root: ET.Element, model: Interface) -> None:
    """Default experiment [s]; its tolerance is what solvers of importers start from."""
    experiment = model.code.experiment
    add(
        root,
        "DefaultExperiment",
        {
            "startTime": number(experiment.start),
            "stopTime": number(experiment.stop),
            "tolerance": number(_TOLERANCE if experiment.tolerance is None else experiment.tolerance),
            "stepSize": number(experiment.step),
        },
    )


def joined(numbers: Iterable[int] | None) -> str | None:
    """List attribute; None stays None ("not known", which importers take as "depends on all")."""
    return None if numbers is None else " ".join(map(str, numbers))


def text_of(root: ET.Element) -> str:
    """The document with declaration, indented."""
    ET.indent(root)
    return '<?xml version="1.0" encoding="UTF-8"?>\n' + ET.tostring(root, encoding="unicode") + "\n"
