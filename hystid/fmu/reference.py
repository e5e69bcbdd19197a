"""Reference results inside an FMU, in the form of the layered standard FMI-LS-REF (1.0.0-alpha.1).

``extra/org.fmi-standard.fmi-ls-ref/`` holds a manifest, ``<Model>_out.csv`` and, for inputs, ``<Model>_in.csv``.
The result comes from the table runner: fixed step, inputs linear between rows.
"""

from __future__ import annotations

import csv
import io
import logging
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from xml.etree import ElementTree as ET

import numpy as np
from numpy.typing import NDArray

from hystid.compiled import CompiledModel, TableRunner
from hystid.errors import NumericalError
from hystid.fmu.interface import Interface, interface
from hystid.modelcode import ModelCode, Variable

Array = NDArray[np.float64]

FOLDER = "extra/org.fmi-standard.fmi-ls-ref"
NAMESPACE = "http://fmi-standard.org/fmi-ls-manifest"
_PURPOSE = "Layered Standard providing information on related files included in an FMU."  # wording fixed by its schema
RESULT_ROLE, INPUT_ROLE = "result", "testcase"
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
        with _unheard():
            results = CompiledModel(code, runner).simulate(
                inputs, _spacing(t), outputs=names, substeps=0, rows=len(t), start_time=float(t[0])
            )
    except NumericalError:
        return {}
    return entries(model, t, inputs, results)


@contextmanager
def _unheard() -> Iterator[None]:
    """Keep the model's warnings back: the reference input is ours, and no user asked for this run."""
    logger = logging.getLogger("hystid")
    level = logger.level
    logger.setLevel(logging.ERROR)
    try:
        yield
    finally:
        logger.setLevel(level)


def entries(model: Interface, t: Array, inputs: Mapping[str, Array], results: Mapping[str, Array]) -> dict[str, bytes]:
    """The three files of the layered standard."""
    stem = model.identifier
    files = {f"{FOLDER}/{stem}_out.csv": table_text(t, results)}
    if inputs:
        files[f"{FOLDER}/{stem}_in.csv"] = table_text(t, inputs)
    files[f"{FOLDER}/fmi-ls-manifest.xml"] = _manifest(stem, bool(inputs))
    return {name: text.encode() for name, text in files.items()}


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
    times, *columns = zip(*rows[1:], strict=True)
    return np.array([float(x) for x in times]), dict(zip(rows[0][1:], columns, strict=True))


def _manifest(stem: str, has_input: bool) -> str:
    ET.register_namespace("fmi-ls", NAMESPACE)
    root = ET.Element(
        "fmiReferences",
        {
            f"{{{NAMESPACE}}}fmi-ls-name": "org.fmi-standard.fmi-ls-ref",
            f"{{{NAMESPACE}}}fmi-ls-version": "1.0.0-alpha.1",
            f"{{{NAMESPACE}}}fmi-ls-description": _PURPOSE,
        },
    )
    for wanted, end, role, description in (
        (has_input, "in", INPUT_ROLE, "Input of the default experiment, linear between rows"),
        (True, "out", RESULT_ROLE, "Output of the default experiment"),
    ):
        if wanted:
            related = {"type": "text/csv", "source": f"{stem}_{end}.csv", "role": role, "description": description}
            ET.SubElement(root, "Related", related)
    page = {"type": "text/html", "source": "../../documentation/index.html", "role": "document"}
    ET.SubElement(root, "Related", {**page, "description": "The model, its parameters and where it comes from"})
    ET.indent(root)
    return '<?xml version="1.0" encoding="UTF-8"?>\n' + ET.tostring(root, encoding="unicode") + "\n"
