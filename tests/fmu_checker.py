"""A strict static checker of FMUs, written from the standards' text: rules that FMPy's validation leaves out.

Rules come from FMI 2.0.4 (2.2, 2.3) and FMI 3.0.2 (2.4, 2.5): schema, dates, names, legal combinations of attributes,
aliases, complete and ordered ModelStructure, units, layout of the zip file, sources, token of the binaries. Every
problem is returned as a sentence.
"""

from __future__ import annotations

import re
import zipfile
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import fmpy
from lxml import etree

_DATE = re.compile(r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\dZ")
_LEGAL = {
    "parameter": {"fixed", "tunable"},
    "calculatedParameter": {"fixed", "tunable"},
    "input": {"discrete", "continuous"},
    "output": {"constant", "discrete", "continuous"},
    "local": {"constant", "fixed", "tunable", "discrete", "continuous"},
    "independent": {"continuous"},
}
_INITIAL = {
    ("parameter", "fixed"): {"exact"},
    ("parameter", "tunable"): {"exact"},
    ("calculatedParameter", "fixed"): {"calculated", "approx"},
    ("calculatedParameter", "tunable"): {"calculated", "approx"},
    ("local", "fixed"): {"calculated", "approx"},
    ("local", "tunable"): {"calculated", "approx"},
    ("output", "constant"): {"exact"},
    ("local", "constant"): {"exact"},
}
_B_NAME = r"(?:[A-Za-z_][A-Za-z0-9_]*|'(?:[^'\\\x00-\x1f]|\\['\"?\\abfnrtv])+')"
_IDENTIFIER = rf"{_B_NAME}(?:\[\d+(?:,\d+)*\])?(?:\.{_B_NAME}(?:\[\d+(?:,\d+)*\])?)*"
_STRUCTURED = re.compile(rf"{_IDENTIFIER}|der\({_IDENTIFIER}(?:,\d+)?\)")
_PLATFORMS = {
    2: re.compile(r"(linux|win|darwin)(32|64)|aarch64-linux"),  # the last is no name of FMI 2.0, and harmless
    3: re.compile(r"(x86|x86_64|aarch32|aarch64|riscv32|riscv64|ppc32|ppc64)-(linux|windows|darwin)"),
}
_SUFFIX = {"linux": ".so", "windows": ".dll", "win": ".dll", "darwin": ".dylib"}
_TOP = {"modelDescription.xml", "icon.png", "model.png", "terminalsAndIcons", "documentation", "licenses", "sources",
        "binaries", "resources", "extra"}  # fmt: skip
_TEXTS = {"name", "description", "modelName", "generationTool", "author"}
_SCHEMAS = Path(fmpy.__file__).parent / "schema"


def problems(path: Path) -> list[str]:
    """All findings, none for an FMU without fault."""
    with zipfile.ZipFile(path) as archive:
        names = archive.namelist()
        packing = [*_packing(archive)]
        root = etree.fromstring(archive.read("modelDescription.xml"))
        version = 2 if root.get("fmiVersion") == "2.0" else 3
        packing += _binaries(archive, root, version)
        found = [*_schema(root, f"fmi{version}/fmi{version}ModelDescription.xsd"), *_header(root, version)]
        if version == 3 and "sources/buildDescription.xml" in names:
            found += _schema(
                etree.fromstring(archive.read("sources/buildDescription.xml")), "fmi3/fmi3BuildDescription.xsd"
            )
    variables = _variables(root, version)
    found += [*_attributes(variables), *_aliases(variables, version), *_empty(root), *_units(root, variables)]
    found += [
        *(_structure2(root, variables) if version == 2 else _structure3(root, variables)),
        *_files(root, names, version),
    ]
    duplicates = [name for name, count in Counter(names).items() if count > 1]
    found += [*packing, *_names(root, variables)]
    return found + [f"the zip file holds {name} twice" for name in duplicates]


def _packing(archive: zipfile.ZipFile) -> Iterator[str]:
    """What unzip programs of importers stumble over, and names that the standards do not know."""
    for entry in archive.infolist():
        name, top = entry.filename, entry.filename.split("/")[0]
        if "\\" in name or name.startswith("/") or ":" in name or ".." in name.split("/") or not name.isascii():
            yield f"the path {name} is not plain and relative"
        if entry.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
            yield f"{name} is neither stored nor deflated"
        if entry.flag_bits & 0b1001 or entry.extra:
            yield f"{name} is encrypted, or has a data descriptor or extra fields"
        if top not in _TOP:
            yield f"{top} is no name of the standard at the top of the FMU"
        if name.startswith("extra/") and not re.fullmatch(r"[a-z0-9-]+(\.[a-z0-9-]+)+", name.split("/")[1]):
            yield f"{name.split('/')[1]} is no reversed domain name"
        if entry.filename.endswith((".xml", ".c", ".h")) and archive.read(entry).startswith(b"\xef\xbb\xbf"):
            yield f"{name} starts with a byte order mark"
    documented = any(n.startswith("documentation/") for n in archive.namelist())
    if documented and "documentation/index.html" not in archive.namelist():
        yield "documentation has no index.html"
    if archive.comment:
        yield "the zip file has a comment"


def _binaries(archive: zipfile.ZipFile, root: Any, version: int) -> Iterator[str]:
    token = root.get("guid" if version == 2 else "instantiationToken", "").encode()
    for name in (n for n in archive.namelist() if n.startswith("binaries/")):
        platform = name.split("/")[1]
        if not _PLATFORMS[version].fullmatch(platform):
            yield f"{platform} is no platform of FMI {version}"
        system = next((s for s in _SUFFIX if s in platform), "")
        if not name.endswith(_SUFFIX.get(system, "")):
            yield f"{name} has not the suffix of its platform"
        if token not in archive.read(name):
            yield f"{name} does not hold the token of the description"


def _names(root: Any, variables: list[dict[str, Any]]) -> Iterator[str]:
    names = [name for v in variables for name in (v["name"], *v["aliases"])]
    if root.get("variableNamingConvention") == "structured":
        yield from (f"the name {name} is not structured" for name in names if not _STRUCTURED.fullmatch(name))
    for element in root.iter():
        for key, text in element.attrib.items():
            if key in _TEXTS and (text != " ".join(text.split()) or not text.isprintable()):
                yield f"{element.tag}: the text of {key} has line ends, tabs or spaces at its ends"
    categories = [c.get("name") for c in root.iterfind("LogCategories/Category")]
    if len(set(categories)) != len(categories):
        yield "a log category is listed twice"


def _schema(root: Any, name: str) -> Iterator[str]:
    schema = etree.XMLSchema(file=str(_SCHEMAS / name))
    if not schema.validate(root):
        yield from (f"schema, line {error.line}: {error.message}" for error in schema.error_log)


def _header(root: Any, version: int) -> Iterator[str]:
    date = root.get("generationDateAndTime", "")
    if not _DATE.fullmatch(date):
        yield f"generationDateAndTime '{date}' is not of the form YYYY-MM-DDThh:mm:ssZ"
    for attribute in ("modelName", "generationTool", "guid" if version == 2 else "instantiationToken"):
        if not root.get(attribute):
            yield f"{attribute} is missing"
    for kind in root.findall("ModelExchange") + root.findall("CoSimulation"):
        if not re.fullmatch(r"[A-Za-z_]\w*", kind.get("modelIdentifier", "")):
            yield f"modelIdentifier '{kind.get('modelIdentifier')}' is not a C identifier"
        if any(value == "false" for value in kind.attrib.values()):
            yield "a capability is spelled out as false"
    if version == 2 and root.get("numberOfEventIndicators") is None:
        yield "numberOfEventIndicators is missing"
    experiment = root.find("DefaultExperiment")
    for key in ("stepSize", "tolerance"):
        if experiment is not None and float(experiment.get(key, 1)) <= 0:
            yield f"{key} of the default experiment is not positive"
    if experiment is not None and float(experiment.get("stopTime", 1)) <= float(experiment.get("startTime", 0)):
        yield "the default experiment ends before it starts"


def _variables(root: Any, version: int) -> list[dict[str, Any]]:
    found = []
    for index, element in enumerate(root.find("ModelVariables")):
        inner = element[0] if version == 2 else element
        variable = {**element.attrib, **inner.attrib, "type": inner.tag, "index": index + 1}
        if (text := element.find("Start")) is not None:
            variable["start"] = text.get("value")
        variable.setdefault("causality", "local")
        variable["aliases"] = [alias.get("name") for alias in element.findall("Alias")] if version == 3 else []
        found.append(variable)
    return found


def _attributes(variables: list[dict[str, Any]]) -> Iterator[str]:
    names = [name for v in variables for name in (v["name"], *v["aliases"])]
    yield from (f"two variables are named {name}" for name, count in Counter(names).items() if count > 1)
    if sum(v["causality"] == "independent" for v in variables) > 1:
        yield "there is more than one independent variable"
    for v in variables:
        yield from (f"{v['name']}: {problem}" for problem in _combination(v))


def _combination(v: dict[str, Any]) -> Iterator[str]:
    causality, variability, initial, start = v["causality"], v.get("variability"), v.get("initial"), v.get("start")
    if variability not in _LEGAL[causality]:
        yield f"variability {variability} is not legal for causality {causality}"
    if variability == "continuous" and v["type"] not in ("Real", "Float64", "Float32"):
        yield "only real variables may be continuous"
    if causality in ("input", "independent"):
        if initial:
            yield f"initial must not be given for causality {causality}"
    elif initial not in _INITIAL.get((causality, variability), {"exact", "approx", "calculated"}):
        yield f"initial {initial} is not legal here"
    needs = causality == "input" or initial in ("exact", "approx")
    if causality != "independent" and needs != (start is not None):
        yield "a start value is missing" if needs else "a start value is not allowed"
    if causality == "independent" and start is not None:
        yield "the independent variable must have no start value"
    if start is not None and v["type"] not in ("Boolean", "String"):  # noqa: SIM102  # one rule a line
        if not float(v.get("min", "-inf")) <= float(start) <= float(v.get("max", "inf")):
            yield "start lies outside min and max"
    if "nominal" in v and float(v["nominal"]) <= 0:
        yield "nominal must be positive"
    if float(v.get("min", "-inf")) > float(v.get("max", "inf")):
        yield "min lies above max"
    if v.get("intermediateUpdate") == "true" and (variability != "continuous" or causality == "independent"):
        yield "only variables in continuous time are accessible in intermediate update mode"
    if "derivative" in v and variability != "continuous":
        yield "a derivative must be continuous"
    if v["type"] in ("Integer", "Int32", "Enumeration"):
        for key in ("start", "min", "max"):
            if key in v and not (re.fullmatch(r"-?\d+", v[key]) and -(2**31) <= int(v[key]) < 2**31):
                yield f"{key} {v[key]} is no 32-bit whole number"
    if v["type"] == "Boolean" and v.get("start", "true") not in ("true", "false"):
        yield f"start {v['start']} is no Boolean"


def _aliases(variables: list[dict[str, Any]], version: int) -> Iterator[str]:
    groups: dict[tuple[str, str], list[dict[str, Any]]] = {}
    for v in variables:
        key = "" if version == 3 else v["type"]
        groups.setdefault((key, v["valueReference"]), []).append(v)
    for group in (g for g in groups.values() if len(g) > 1):
        names = ", ".join(v["name"] for v in group)
        if version == 3:
            yield f"{names} share a value reference"
        if sum("start" in v for v in group) > 1:
            yield f"of the aliases {names} more than one can be set"
        if len({v.get("unit") for v in group}) > 1:
            yield f"the aliases {names} differ in unit"
        if len({v.get("variability") in ("constant", "fixed") for v in group}) > 1:
            yield f"the aliases {names} differ in whether they vary"


def _empty(root: Any) -> Iterator[str]:
    required = {
        "ModelStructure",
        "ModelVariables",
        "ModelExchange",
        "CoSimulation",
        "BaseUnit",
        "Real",
        "Integer",
        "Boolean",
    }
    for element in root.iter():
        bare = isinstance(element.tag, str) and not len(element) and not element.attrib
        if bare and element.tag not in required:
            yield f"the element {element.tag} is empty"
    if any(value == "" and key != "dependencies" for e in root.iter() for key, value in e.attrib.items()):
        yield "an attribute is empty"


def _units(root: Any, variables: list[dict[str, Any]]) -> Iterator[str]:
    defined = [unit.get("name") for unit in root.iterfind("UnitDefinitions/Unit")]
    used = {v["unit"] for v in variables if "unit" in v}
    yield from (f"unit {name} is defined twice" for name, count in Counter(defined).items() if count > 1)
    yield from (f"unit {name} is used and not defined" for name in sorted(used - set(defined)))
    yield from (f"unit {name} is defined and not used" for name in sorted(set(defined) - used))
    for unit in root.iterfind("UnitDefinitions/Unit"):
        if unit.find("BaseUnit") is None:
            yield f"unit {unit.get('name')} has no SI exponents"


def _structure2(root: Any, variables: list[dict[str, Any]]) -> Iterator[str]:
    by_index = {v["index"]: v for v in variables}
    lists = {
        name: [int(u.get("index")) for u in root.iterfind(f"ModelStructure/{name}/Unknown")]
        for name in ("Outputs", "Derivatives", "InitialUnknowns")
    }
    outputs = [v["index"] for v in variables if v["causality"] == "output"]
    if lists["Outputs"] != outputs:
        yield f"Outputs lists {lists['Outputs']}, the outputs are {outputs}"
    states = {int(v["derivative"]): v["index"] for v in variables if "derivative" in v}
    if sorted(lists["Derivatives"]) != sorted(states.values()):
        yield f"Derivatives lists {lists['Derivatives']}, the derivatives are {sorted(states.values())}"
    for state in states:
        if by_index[state]["variability"] != "continuous" or by_index[state]["causality"] not in ("local", "output"):
            yield f"{by_index[state]['name']} has a derivative and is not a state"
    needed = {*outputs, *states, *states.values()} | {
        v["index"] for v in variables if v["causality"] == "calculatedParameter"
    }
    needed = {i for i in needed if by_index[i].get("initial") in ("approx", "calculated")}
    if set(lists["InitialUnknowns"]) != needed:
        yield f"InitialUnknowns lists {lists['InitialUnknowns']}, needed are {sorted(needed)}"
    if lists["InitialUnknowns"] != sorted(lists["InitialUnknowns"]):
        yield "InitialUnknowns is not in order"
    known = {v["index"] for v in variables if v["causality"] in ("input", "independent")} | set(states)
    for unknown in root.iterfind("ModelStructure/*/Unknown"):
        given = [int(i) for i in unknown.get("dependencies", "").split()]
        if given != sorted(set(given)) or not set(given) <= known:
            yield f"the dependencies of {by_index[int(unknown.get('index'))]['name']} are not knowns in order: {given}"


def _structure3(root: Any, variables: list[dict[str, Any]]) -> Iterator[str]:
    by_reference = {v["valueReference"]: v for v in variables}
    structure = root.find("ModelStructure")
    order = ["Output", "ContinuousStateDerivative", "ClockedState", "InitialUnknown", "EventIndicator"]
    tags = [order.index(child.tag) for child in structure]
    if tags != sorted(tags):
        yield "the entries of ModelStructure are not in the order of the schema"
    lists = {tag: [u.get("valueReference") for u in structure.iterfind(tag)] for tag in order}
    for tag, entries in lists.items():
        yield from (f"{tag} lists {vr} twice" for vr, n in Counter(entries).items() if n > 1)
        yield from (f"{tag} lists {vr}, which is no variable" for vr in entries if vr not in by_reference)
    outputs = {v["valueReference"] for v in variables if v["causality"] == "output"}
    if set(lists["Output"]) != outputs:
        yield f"Output lists {lists['Output']}, the outputs are {sorted(outputs)}"
    states = {v["derivative"]: v["valueReference"] for v in variables if "derivative" in v}
    if set(lists["ContinuousStateDerivative"]) != set(states.values()):
        yield "ContinuousStateDerivative does not list the derivatives"
    needed = {*outputs, *states, *states.values()}
    needed |= {v["valueReference"] for v in variables if v["causality"] == "calculatedParameter"}
    needed = {vr for vr in needed if by_reference[vr].get("initial") in ("approx", "calculated")}
    if set(lists["InitialUnknown"]) != needed:
        yield f"InitialUnknown lists {lists['InitialUnknown']}, needed are {sorted(needed)}"
    causalities = ("input", "independent", "parameter")
    known = {v["valueReference"] for v in variables if v["causality"] in causalities} | set(states)
    known |= {v["valueReference"] for v in variables if v.get("variability") == "discrete"}
    for unknown in structure:
        given = set(unknown.get("dependencies", "").split())
        kinds = unknown.get("dependenciesKind", "").split()
        if kinds and len(kinds) != len(unknown.get("dependencies", "").split()):
            yield f"{unknown.get('valueReference')} has kinds for another number of dependencies"
        if not given <= known:
            yield f"the dependencies of {unknown.get('valueReference')} are not knowns: {sorted(given - known)}"
    if sum(v["causality"] == "independent" for v in variables) != 1:
        yield "FMI 3 needs one independent variable"


def _files(root: Any, names: list[str], version: int) -> Iterator[str]:
    if version == 2:
        for kind in ("ModelExchange", "CoSimulation"):
            for file in root.iterfind(f"{kind}/SourceFiles/File"):
                if f"sources/{file.get('name')}" not in names:
                    yield f"the source file {file.get('name')} is listed and not there"
    identifiers = {
        kind.get("modelIdentifier") for kind in (*root.findall("ModelExchange"), *root.findall("CoSimulation"))
    }
    for name in names:
        if name.startswith("binaries/") and Path(name).stem not in identifiers:
            yield f"the binary {name} is not named as the model identifier"
    if names[0] != "modelDescription.xml":
        yield "modelDescription.xml is not the first entry"
