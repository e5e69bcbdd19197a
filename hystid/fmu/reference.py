"""Reference results inside an FMU, in the form of the layered standard FMI-LS-REF (1.0.0-beta.1).

``extra/org.fmi-standard.fmi-ls-ref/`` holds a manifest, ``<Model>_out.csv``, for inputs ``<Model>_in.csv``, the
parameters with their start values as a parameter set (SSV), and the experiment that these make up. The result comes
from the table runner: fixed step, inputs linear between rows.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Collection, Mapping, Sequence
from dataclasses import asdict, dataclass
from xml.etree import ElementTree as ET

import numpy as np

from hystid.batch import TableRunner
from hystid.compiled import CompiledModel
from hystid.errors import NumericalError
from hystid.fmu.interface import Interface, interface
from hystid.fmu.model_description.common import start_text, text_of
from hystid.modelcode import ModelCode, Variable
from hystid.numeric import Array
from hystid.progress import quiet_models

FOLDER = "extra/org.fmi-standard.fmi-ls-ref"
NAMESPACE = "http://fmi-standard.org/fmi-ls-manifest"
_PURPOSE = "Layered Standard providing information on related files included in an FMU."  # wording fixed by its schema
SSV = "http://ssp-standard.org/SSP1/SystemStructureParameterValues"
RESULT_ROLE, INPUT_ROLE = "result", "testcase"
_EXPERIMENT = {".ssv": "Parameters", "_in.csv": "Stimuli", "_out.csv": "References"}  # end of the file -> element
_MOST_ROWS = 251
_DIGITS = 7  # of each number: far finer than any tube, and a third of the size
_CYCLES = 5.0  # of the reference input within the experiment


def reference_entries(code: ModelCode, runner: TableRunner | None = None) -> dict[str, bytes]:
    """Path inside the FMU -> content; {} where the model has no outputs or no finite answer to the reference input.

    runner: the batch entry of a library that holds the model; else it is compiled.
    """
    model = interface(code)
    t = reference_times(code)
    inputs = {v.name: _as_written(reference_input(v, t)) for v in model.inputs}
    names = [v.name for v in model.outputs]
    if not names:
        return {}
    try:
        with quiet_models():
            results = CompiledModel(code, runner).simulate(
                inputs, _spacing(t), outputs=names, substeps=0, rows=len(t), start_time=float(t[0])
            )
    except NumericalError:
        return {}
    return _entries(model, t, inputs, results)


def _entries(model: Interface, t: Array, inputs: Mapping[str, Array], results: Mapping[str, Array]) -> dict[str, bytes]:
    """The files of the layered standard; those named by ``..`` lie elsewhere in the FMU."""
    stem = model.identifier
    parameters = [v for v in model.variables if v.causality == "parameter"]
    networks = [name for name in model.code.resources if name.endswith(".onnx")]
    files = {f"{stem}_out.csv": _listed_text(model, t, results)}
    related = [_Related(f"{stem}_out.csv", "text/csv", RESULT_ROLE, "Output of the default experiment")]
    if inputs:
        files[f"{stem}_in.csv"] = _listed_text(model, t, inputs)
        what = "Input of the default experiment, linear between rows"
        related.insert(0, _Related(f"{stem}_in.csv", "text/csv", INPUT_ROLE, what))
    if parameters:
        files[f"{stem}.ssv"] = parameter_set({v.name: v for v in parameters})
        what = "The parameters with the values that the results were computed with"
        related.append(_Related(f"{stem}.ssv", "application/x-ssp-parameter-set", "parameter", what))
    files[f"{stem}.exp"] = _experiments(model.code, t, {k: f"{stem}{end}" for end, k in _EXPERIMENT.items()}, files)
    what = "The default experiment: parameters, input and result"
    related.append(_Related(f"{stem}.exp", "application/x-ma-hs-experiments", "experiment", what))
    for name in networks:
        what = "The network that the FMU was made from (ONNX)"
        related.append(_Related(f"../../resources/{name}", "application/octet-stream", "model", what))
    related.append(_Related("../../sources/model.c", "text/x-c", "model", "The model's own C source"))
    what = "The model, its parameters and where it comes from"
    related.append(_Related("../../documentation/index.html", "text/html", "document", what))
    files["fmi-ls-manifest.xml"] = _manifest(related)
    return {f"{FOLDER}/{name}": text.encode() for name, text in files.items()}


def _experiments(code: ModelCode, t: Array, sources: Mapping[str, str], files: Collection[str]) -> str:
    """What the result belongs to, in the experiments format of the Modelica Association (MA-HS-Experiments).

    sources: element -> file; those of them that are there are named.
    """
    root = ET.Element("Experiments", {"name": code.name})
    tolerance = {} if code.experiment.tolerance is None else {"tolerance": f"{code.experiment.tolerance:.17g}"}
    one = ET.SubElement(root, "Experiment", {"name": "default experiment", **tolerance})
    times = {"startTime": float(t[0]), "stopTime": float(t[-1]), "stepSize": code.experiment.step}
    ET.SubElement(one, "TransientSimulation", {name: f"{value:.17g}" for name, value in times.items()})
    for kind, source in sources.items():
        if source in files:
            ET.SubElement(one, kind, {"source": source})
    return text_of(root)


def parameter_set(parameters: Mapping[str, Variable], *, by_value: bool = False) -> str:
    """Start values, by name, as a parameter set of SSP 1.0 (SSV).

    by_value: items of enumerations by their numbers, as FMPy's runner takes them, and not by their names.
    """
    ET.register_namespace("ssv", SSV)
    root = ET.Element(f"{{{SSV}}}ParameterSet", {"version": "1.0", "name": "parameters"})
    listed = ET.SubElement(root, f"{{{SSV}}}Parameters")
    for name, v in parameters.items():
        cell = ET.SubElement(listed, f"{{{SSV}}}Parameter", {"name": name})
        if v.enumeration and not by_value:
            value = {"value": v.enumeration.items[round(v.start or 1) - 1], "name": v.enumeration.name}
            ET.SubElement(cell, f"{{{SSV}}}Enumeration", value)
        else:
            ET.SubElement(cell, f"{{{SSV}}}{v.type}", {"value": start_text(v)})
    return text_of(root)


def reference_times(code: ModelCode) -> Array:
    """The default experiment in at most 251 rows, a whole number of the model's steps apart."""
    experiment = code.experiment
    steps = max(round((experiment.stop - experiment.start) / experiment.step), 1)
    stride = -(-steps // (_MOST_ROWS - 1))
    rows = steps // stride + 1
    return np.asarray(experiment.start + np.arange(rows) * (stride * experiment.step), np.float64)


def _as_written(values: Array) -> Array:
    return np.array([float(_text(x)) for x in values])


def _text(value: float) -> str:
    return f"{value:.{_DIGITS}g}"


def reference_input(variable: Variable, t: Array) -> Array:
    """A smooth input without a jump at the start: a sine that grows to the input's nominal value (1 without one).

    Force inputs need amplitude to move a structure: without a nominal value newtons get 50.
    """
    if variable.type != "Real" or variable.variability != "continuous":
        return np.full_like(t, variable.start or 0.0)
    size = abs(variable.nominal or 0.0) or {"N": 50.0, "m": 1e-3, "m/s": 0.1}.get(variable.unit, 1.0)
    size = min(size, *(0.8 * abs(bound) for bound in (variable.min, variable.max) if bound), size)
    phase = (t - t[0]) / max(t[-1] - t[0], 1e-300)
    shift = 0.5 * np.pi if variable.unit == "m/s" else 0.0
    return np.asarray((variable.start or 0.0) + size * phase * np.sin(2 * np.pi * _CYCLES * phase + shift), np.float64)


def _spacing(t: Array) -> float:
    return float((t[-1] - t[0]) / max(len(t) - 1, 1)) or 1.0


def table_text(t: Array, columns: Mapping[str, Array]) -> str:
    """CSV with a column ``time`` first, whose numbers read back as the same doubles; the others have seven digits."""
    return cells_text(t, {name: [_text(value) for value in values] for name, values in columns.items()})


def _listed_text(model: Interface, t: Array, columns: Mapping[str, Array]) -> str:
    """``table_text`` with a column per variable of the description: elements of an array stand in one cell."""
    cells = {name: [_text(value) for value in values] for name, values in columns.items()}
    for array in model.arrays.values():
        parts = [cells.pop(v.name) for v in array.elements if v.name in cells]
        if parts:
            cells[array.name] = [" ".join(row) for row in zip(*parts, strict=True)]
    return cells_text(t, cells)


def cells_text(t: Array, columns: Mapping[str, Sequence[str]]) -> str:
    """``table_text`` of columns that are texts already."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(["time", *columns])
    writer.writerows([repr(float(row[0])), *row[1:]] for row in zip(t, *columns.values(), strict=True))
    return out.getvalue()


def read_cells(text: str) -> tuple[Array, dict[str, Sequence[str]]]:
    """Times and columns of such a table, the latter as texts. Raises ValueError where it is none."""
    rows = list(csv.reader(io.StringIO(text)))
    if len(rows) < 2 or rows[0][:1] != ["time"]:
        raise ValueError("the first column is not named time, or there are no rows")
    if len({len(row) for row in rows}) > 1:
        raise ValueError("its rows differ in length")
    if len(set(rows[0])) < len(rows[0]):
        raise ValueError("a column is there twice")
    cells, *columns = zip(*rows[1:], strict=True)
    times = np.array([float(x) for x in cells])
    if np.any(np.diff(times) < 0) or not np.all(np.isfinite(times)):
        raise ValueError("its times are not in order")
    return times, dict(zip(rows[0][1:], columns, strict=True))


@dataclass(frozen=True)
class _Related:
    source: str
    type: str
    role: str
    description: str


def _manifest(related: Sequence[_Related]) -> str:
    ET.register_namespace("fmi-ls", NAMESPACE)
    root = ET.Element(
        "fmiReferences",
        {
            f"{{{NAMESPACE}}}fmi-ls-name": "org.fmi-standard.fmi-ls-ref",
            f"{{{NAMESPACE}}}fmi-ls-version": "1.0.0-beta.1",
            f"{{{NAMESPACE}}}fmi-ls-description": _PURPOSE,
        },
    )
    for file in related:
        ET.SubElement(root, "Related", asdict(file))
    return text_of(root)
