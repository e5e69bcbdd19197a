"""FMI 3.0: variables are referred to by value reference; further names of one value are aliases inside it."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from datetime import datetime
from xml.etree import ElementTree as ET

from hystid.fmu.arrays import ArrayOf
from hystid.fmu.interface import Interface
from hystid.fmu.model_description.common import (
    add,
    add_experiment,
    add_items,
    add_log_categories,
    add_texts,
    add_units,
    flag,
    identity,
    joined,
    of_its_values,
    one_line,
    root_of,
    start_text,
)
from hystid.modelcode import Variable

_OF_AN_ELEMENT = re.compile(r", element \d+ of \d+")
_TAG = {"Real": "Float64", "Integer": "Int32", "Boolean": "Boolean"}


def describe(model: Interface, generated: datetime) -> ET.Element:
    """The root element."""
    root = root_of(model, "3.0", "instantiationToken", generated)
    _add_kinds(root, model)
    add_units(root, model)
    _add_types(root, model)
    add_log_categories(root)
    add_experiment(root, model)
    variables = add(root, "ModelVariables")
    for slot, group in model.groups.items():
        if slot in model.arrays:
            _add_array(variables, model, model.arrays[slot])
        elif model.first_slots[slot] == slot:
            _add_variable(variables, model, group)
    stem = _free_stem(model, "eventIndicator")
    for i in range(model.code.n_indicators):
        _add_indicator(variables, model, stem, i)
    add_texts(variables, model, "Start")
    _add_structure(root, model)
    return root


def _add_kinds(root: ET.Element, model: Interface) -> None:
    shared: dict[str, str | None] = {
        "modelIdentifier": model.identifier,
        "canGetAndSetFMUState": "true",
        "canSerializeFMUState": "true",
        "providesDirectionalDerivatives": flag(model.code.has_forward),
        "providesAdjointDerivatives": flag(model.code.has_adjoint),
    }
    if model.offers_model_exchange:
        add(root, "ModelExchange", {**shared, "needsCompletedIntegratorStep": flag(model.needs_completed_steps)})
    own: dict[str, str | None] = {
        "canHandleVariableCommunicationStepSize": flag(not model.code.steps_are_samples),
        "providesIntermediateUpdate": "true",
        "mightReturnEarlyFromDoStep": "true",
        "canReturnEarlyAfterIntermediateUpdate": "true",
        "hasEventMode": "true",
    }
    add(root, "CoSimulation", {**shared, **own})


def _add_types(root: ET.Element, model: Interface) -> None:
    if model.code.enumerations:
        definitions = add(root, "TypeDefinitions")
        for enumeration in model.code.enumerations:
            add_items(add(definitions, "EnumerationType", {"name": enumeration.name}), enumeration)


def _add_array(parent: ET.Element, model: Interface, array: ArrayOf) -> None:
    first = array.elements[0]
    text = _OF_AN_ELEMENT.sub("", first.description)
    element = _add_variable(parent, model, (replace(first, name=array.name, description=text),))
    if "start" in element.attrib:
        element.set("start", " ".join(start_text(v) for v in array.elements))
    for n in array.shape:
        add(element, "Dimension", {"start": str(n)})


def _add_variable(parent: ET.Element, model: Interface, group: tuple[Variable, ...]) -> ET.Element:
    v = group[0]
    state = next((name for name, s in zip(model.code.states, model.state_slots, strict=True) if s == v.slot), None)
    derived = next((a.derivative_of for a in group if a.derivative_of is not None), None)
    rate_of = None if derived is None else str(model.named(derived).slot)
    updates = flag(v.variability == "continuous" and v.causality != "independent")
    attributes = {**identity(v), "intermediateUpdate": updates, **of_its_values(model, v, state, rate_of)}
    element = add(parent, "Enumeration" if v.enumeration else _TAG[v.type], attributes)
    for alias in _listed_aliases(group):
        add(element, "Alias", {"name": alias.name, "description": one_line(alias.description) or None})
    return element


def _listed_aliases(group: tuple[Variable, ...]) -> tuple[Variable, ...]:
    """Further names of a value. Those of a computed output stay out: importers in wide use (FMPy 0.3) take each of them
    for an output that InitialUnknowns forgot."""
    computed_output = group[0].causality in ("output", "calculatedParameter") and group[0].initial != "exact"
    return () if computed_output else group[1:]


def _free_stem(model: Interface, stem: str) -> str:
    """The stem, longer where variables of the model are called so."""
    while any(v.name.startswith(f"{stem}[") for v in model.variables):
        stem += "_"
    return stem


def _add_indicator(parent: ET.Element, model: Interface, stem: str, i: int) -> None:
    add(
        parent,
        "Float64",
        {
            "name": f"{stem}[{i + 1}]",
            "valueReference": str(model.code.n_values + i),
            "description": "its change of sign is a state event",
            "causality": "local",
            "variability": "continuous",
            "initial": "calculated",
        },
    )


def _add_structure(root: ET.Element, model: Interface) -> None:
    structure = add(root, "ModelStructure")
    outputs = [group[0] for group in model.groups.values() if group[0].causality == "output"]
    outputs = [v for v in outputs if model.first_slots[v.slot] == v.slot]
    _add_unknowns(structure, "Output", model, outputs)
    _add_unknowns(structure, "ContinuousStateDerivative", model, model.derivatives)
    done: set[int] = set()
    for variable in model.initial_unknowns():
        first = model.groups[variable.slot][0]
        if model.first_slots[variable.slot] not in done and first.initial in ("calculated", "approx"):
            add(structure, "InitialUnknown", {"valueReference": str(variable.slot)})
        done.add(model.first_slots[variable.slot])
    for i in range(model.code.n_indicators):
        add(structure, "EventIndicator", {"valueReference": str(model.code.n_values + i)})


def _add_unknowns(structure: ET.Element, tag: str, model: Interface, variables: Sequence[Variable]) -> None:
    for variable in variables:
        add(structure, tag, {"valueReference": str(variable.slot), "dependencies": joined(_known(model, variable))})


def _known(model: Interface, variable: Variable) -> tuple[int, ...] | None:
    """Value references of what a variable, or any element of an array, depends on; None where that is not known."""
    if variable.slot not in model.arrays:
        names = model.groups[variable.slot]
        slots = next((k for v in names if (k := model.known(v, 3)) is not None), None)
    else:
        each = [model.known(v, 3) for v in model.arrays[variable.slot].elements]
        slots = None if None in each else tuple(slot for k in each for slot in k or ())
    return None if slots is None else tuple(sorted({model.first_slots[slot] for slot in slots}))
