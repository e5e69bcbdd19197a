"""FMI 2.0: variables are referred to by their one-based index."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import datetime
from xml.etree import ElementTree as ET

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
    root_of,
)
from hystid.modelcode import Variable


def describe(model: Interface, generated: datetime, sources: Sequence[str]) -> ET.Element:
    """The root element."""
    root = root_of(model, "2.0", "guid", generated, numberOfEventIndicators=str(model.code.n_indicators))
    _add_kinds(root, model, sources)
    add_units(root, model)
    _add_types(root, model)
    add_log_categories(root)
    add_experiment(root, model)
    variables = add(root, "ModelVariables")
    for variable in model.variables:
        _add_variable(variables, model, variable)
    add_texts(variables, model, "String")
    _add_structure(root, model)
    return root


def _add_kinds(root: ET.Element, model: Interface, sources: Sequence[str]) -> None:
    shared: dict[str, str | None] = {
        "modelIdentifier": model.identifier,
        "canNotUseMemoryManagementFunctions": "true",
        "canGetAndSetFMUstate": "true",
        "canSerializeFMUstate": "true",
        "providesDirectionalDerivative": flag(model.code.has_forward),
    }
    interpolates = any(v.type == "Real" and v.variability == "continuous" for v in model.inputs)
    steps = flag(not model.code.steps_are_samples)
    own = {"canHandleVariableCommunicationStepSize": steps, "canInterpolateInputs": flag(interpolates)}
    exchange = {**shared, "completedIntegratorStepNotNeeded": flag(not model.needs_completed_steps)}
    kinds = {"ModelExchange": exchange} if model.offers_model_exchange else {}
    for tag, attributes in {**kinds, "CoSimulation": {**shared, **own}}.items():
        files = add(add(root, tag, attributes), "SourceFiles")
        for name in sources:
            add(files, "File", {"name": name})


def _add_types(root: ET.Element, model: Interface) -> None:
    if not model.code.enumerations:
        return
    definitions = add(root, "TypeDefinitions")
    for enumeration in model.code.enumerations:
        listed = add(add(definitions, "SimpleType", {"name": enumeration.name}), "Enumeration")
        add_items(listed, enumeration)


def _index(model: Interface, variable: Variable) -> int:
    return model.variables.index(variable) + 1


def _add_variable(parent: ET.Element, model: Interface, v: Variable) -> None:
    is_rate = v.derivative_of is not None and v.type == "Real"
    rate_of = str(_index(model, model.named(v.derivative_of))) if is_rate and v.derivative_of else None
    state = v.name if v.name in model.code.states else None
    kind = "Enumeration" if v.enumeration else v.type
    add(add(parent, "ScalarVariable", identity(v)), kind, of_its_values(model, v, state, rate_of))


def _add_structure(root: ET.Element, model: Interface) -> None:
    structure = add(root, "ModelStructure")
    _add_unknowns(structure, "Outputs", model, model.outputs, with_dependencies=True)
    _add_unknowns(structure, "Derivatives", model, model.derivatives, with_dependencies=True)
    _add_unknowns(structure, "InitialUnknowns", model, tuple(model.initial_unknowns()), with_dependencies=False)


def _add_unknowns(
    structure: ET.Element, tag: str, model: Interface, variables: Sequence[Variable], *, with_dependencies: bool
) -> None:
    if not variables:
        return  # empty lists are not valid
    index_of = {slot: _index(model, group[0]) for slot, group in model.groups.items()}
    index_of |= {
        slot: _index(model, model.named(name)) for slot, name in zip(model.state_slots, model.code.states, strict=True)
    }
    elements = add(structure, tag)
    for variable in variables:
        slots = model.known(variable, 2) if with_dependencies else None
        known = None if slots is None else sorted(index_of[slot] for slot in slots)
        add(elements, "Unknown", {"index": str(_index(model, variable)), "dependencies": joined(known)})
