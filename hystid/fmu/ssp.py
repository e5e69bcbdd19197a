"""Several FMUs and their connections in one file: System Structure and Parameterization (SSP 1.0)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from xml.etree import ElementTree as ET

from hystid.errors import FmuError, UsageError
from hystid.fmu.build import write_zip
from hystid.fmu.door import OpenedFmu, open_fmu
from hystid.fmu.model_description.common import base_unit, number, text_of
from hystid.fmu.reference import parameter_set
from hystid.modelcode import Enumeration, Experiment, Variable
from hystid.units import exponents

_SSD = "http://ssp-standard.org/SSP1/SystemStructureDescription"
_SSC = "http://ssp-standard.org/SSP1/SystemStructureCommon"
_OMS = "https://raw.githubusercontent.com/OpenModelica/OMSimulator/master/schema/oms.xsd"
_TOLERANCE = 1e-4  # of OMSimulator's masters, where an experiment states none
_FMU = "application/x-fmu-sharedlibrary"
_VALUES = "application/x-ssp-parameter-set"


@dataclass(frozen=True)
class Connection:
    """From an output to an input, each ``component.variable``, or a bare name for a connector of the system itself."""

    start: str
    end: str


def write_ssp(
    out: Path,
    components: Mapping[str, Path],
    connections: Sequence[Connection],
    *,
    inputs: Sequence[str] = (),
    outputs: Sequence[str] = (),
    experiment: Experiment | None = None,
    parameters: Mapping[str, float] | None = None,
) -> Path:
    """Write an ``.ssp`` file with the FMUs inside; its name is that of the system.

    components: name -> FMU. inputs, outputs: connectors of the system; connections lead from and to them by their bare
    names. A loop of FMUs without delay is solved by the importer's master as co-simulation does: with the last step's
    outputs. parameters: ``component.variable`` -> value, bound to the system from ``resources/parameters.ssv``.
    Raises UsageError for a connection or a parameter that does not fit, FmuError for an FMU that cannot be opened.
    """
    opened = {component: open_fmu(path) for component, path in components.items()}
    ends = [_ends(opened, connection, inputs, outputs) for connection in connections]
    taken = [connection.end for connection in connections]
    for end in taken:
        if taken.count(end) > 1:
            raise UsageError(f"'{end}' is connected to more than one output")
    own = dict(_system_connectors(connections, ends))
    for connector in (*inputs, *outputs):
        if connector not in own:
            raise UsageError(f"the connector '{connector}' of the system is not connected")
    root = _description(Path(out).stem, opened, connections, own, experiment or Experiment(), bool(parameters))
    content = {"SystemStructure.ssd": text_of(root).encode()}
    if parameters:
        content["resources/parameters.ssv"] = _values(opened, parameters).encode()
    content |= {f"resources/{component}.fmu": Path(path).read_bytes() for component, path in components.items()}
    write_zip(Path(out), content)
    return Path(out)


def _ends(
    opened: Mapping[str, OpenedFmu], connection: Connection, inputs: Sequence[str], outputs: Sequence[str]
) -> tuple[Variable | None, Variable | None]:
    """The variables at both ends, None for a connector of the system; checked for direction, type and unit."""
    start = _end(opened, connection.start, "output", inputs)
    end = _end(opened, connection.end, "input", outputs)
    if start and end and start.type != end.type:
        raise UsageError(
            f"{connection.start} is {start.type}, {connection.end} is {end.type}: they cannot be connected"
        )
    if start and end and start.enumeration != end.enumeration:
        named = [v.enumeration.name if v.enumeration else "a plain number" for v in (start, end)]
        raise UsageError(
            f"{connection.start} is {named[0]}, {connection.end} is {named[1]} or has other items: they cannot be "
            "connected"
        )
    if start and end and start.unit and end.unit and exponents(start.unit) != exponents(end.unit):
        raise UsageError(
            f"{connection.start} is in {start.unit}, {connection.end} in {end.unit}: they cannot be connected"
        )
    if not start and not end:
        raise UsageError(f"{connection.start} and {connection.end} are both connectors of the system")
    return start, end


def _end(opened: Mapping[str, OpenedFmu], path: str, causality: str, own: Sequence[str]) -> Variable | None:
    component, _, variable = path.partition(".")
    if not variable:
        if path not in own:
            raise UsageError(f"'{path}' is neither a connector of the system nor component.variable")
        return None
    if component not in opened:
        raise UsageError(f"'{path}': there is no component '{component}'; there are {', '.join(opened)}")
    found = next((v for v in opened[component].model.variables if v.name == variable), None)
    if found is None or found.causality != causality:
        raise FmuError(f"{opened[component].name} has no {causality} '{variable}'")
    return found


def _system_connectors(
    connections: Sequence[Connection], ends: Sequence[tuple[Variable | None, Variable | None]]
) -> list[tuple[str, tuple[str, Variable]]]:
    found = []
    for connection, (start, end) in zip(connections, ends, strict=True):
        if start is None and end is not None:
            found.append((connection.start, ("input", end)))
        if end is None and start is not None:
            found.append((connection.end, ("output", start)))
    return found


def _description(
    name: str,
    opened: Mapping[str, OpenedFmu],
    connections: Sequence[Connection],
    own: Mapping[str, tuple[str, Variable]],
    experiment: Experiment,
    bound: bool,
) -> ET.Element:
    ET.register_namespace("ssd", _SSD)
    ET.register_namespace("ssc", _SSC)
    root = ET.Element(f"{{{_SSD}}}SystemStructureDescription", {"version": "1.0", "name": name})
    system = _sub(root, "System", {"name": name})
    connectors = _sub(system, "Connectors") if own else None
    units: set[str] = set()
    for connector, (kind, variable) in own.items():
        assert connectors is not None
        units |= _add_connector(connectors, connector, kind, variable)
    if bound:
        bindings = _sub(system, "ParameterBindings")
        _sub(bindings, "ParameterBinding", {"type": _VALUES, "source": "resources/parameters.ssv"})
    elements = _sub(system, "Elements")
    for component, fmu in opened.items():
        element = _sub(elements, "Component", {"name": component, "type": _FMU, "source": f"resources/{component}.fmu"})
        inside = _sub(element, "Connectors")
        for variable in fmu.model.variables:
            if variable.causality in ("input", "output"):
                units |= _add_connector(inside, variable.name, variable.causality, variable)
    lines = _sub(system, "Connections")
    for connection in connections:
        _sub(lines, "Connection", {**_place("start", connection.start), **_place("end", connection.end)})
    _add_master(system, experiment)
    _add_enumerations(root, opened)
    _add_units(root, units)
    _sub(root, "DefaultExperiment", {"startTime": number(experiment.start), "stopTime": number(experiment.stop)})
    return root


def _add_master(system: ET.Element, experiment: Experiment) -> None:
    """What OMSimulator reads: its master with the step of the experiment; its own default is 0.1 s."""
    ET.register_namespace("oms", _OMS)
    notes = _sub(system, "Annotations")
    note = ET.SubElement(notes, f"{{{_SSC}}}Annotation", {"type": "org.openmodelica"})
    information = ET.SubElement(ET.SubElement(note, f"{{{_OMS}}}Annotations"), f"{{{_OMS}}}SimulationInformation")
    tolerance = number(experiment.tolerance or _TOLERANCE)
    step = {"description": "oms-ma", "stepSize": number(experiment.step)}
    tolerances = {"absoluteTolerance": tolerance, "relativeTolerance": tolerance}
    ET.SubElement(information, f"{{{_OMS}}}FixedStepMaster", {**step, **tolerances})


def _values(opened: Mapping[str, OpenedFmu], parameters: Mapping[str, float]) -> str:
    """A parameter set. Raises UsageError for a name that is no parameter of a component."""
    found = {}
    for path, value in parameters.items():
        component, _, name = path.partition(".")
        known = {v.name: v for v in opened[component].model.variables} if component in opened else {}
        if name not in known:
            raise UsageError(f"'{path}' is no variable of a component")
        found[path] = replace(known[name], start=value)
    return parameter_set(found, by_value=True)


def _sub(parent: ET.Element, tag: str, attributes: Mapping[str, str] | None = None) -> ET.Element:
    return ET.SubElement(parent, f"{{{_SSD}}}{tag}", dict(attributes or {}))


def _add_connector(parent: ET.Element, name: str, kind: str, variable: Variable) -> set[str]:
    """Add a connector; the units that it needs."""
    element = _sub(parent, "Connector", {"name": name, "kind": kind})
    if variable.enumeration:
        ET.SubElement(element, f"{{{_SSC}}}Enumeration", {"name": variable.enumeration.name})
        return set()
    unit = {variable.unit} if variable.type == "Real" and variable.unit else set()
    ET.SubElement(element, f"{{{_SSC}}}{variable.type}", {"unit": variable.unit} if unit else {})
    return unit


def _place(side: str, path: str) -> dict[str, str]:
    component, _, variable = path.partition(".")
    return {f"{side}Element": component, f"{side}Connector": variable} if variable else {f"{side}Connector": path}


def _add_enumerations(root: ET.Element, opened: Mapping[str, OpenedFmu]) -> None:
    """Those of the connectors. Raises UsageError where two FMUs mean different items by one name."""
    connectors = [v for fmu in opened.values() for v in fmu.model.variables if v.causality in ("input", "output")]
    found: dict[str, Enumeration] = {}
    for enumeration in filter(None, (v.enumeration for v in connectors)):
        if found.setdefault(enumeration.name, enumeration) != enumeration:
            raise UsageError(f"the enumeration {enumeration.name} has other items in one FMU than in another")
    definitions = _sub(root, "Enumerations") if found else None
    for name in sorted(found):
        assert definitions is not None
        listed = ET.SubElement(definitions, f"{{{_SSC}}}Enumeration", {"name": name})
        for value, item in enumerate(found[name].items, 1):
            ET.SubElement(listed, f"{{{_SSC}}}Item", {"name": item, "value": str(value)})


def _add_units(root: ET.Element, units: set[str]) -> None:
    if not units:
        return
    definitions = _sub(root, "Units")
    for name in sorted(units):
        unit = ET.SubElement(definitions, f"{{{_SSC}}}Unit", {"name": name})
        ET.SubElement(unit, f"{{{_SSC}}}BaseUnit", base_unit(name))
