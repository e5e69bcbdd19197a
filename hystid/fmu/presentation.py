"""What importers show of an FMU: its icon, its terminals, and the pages of its documentation."""

from __future__ import annotations

from collections.abc import Mapping
from html import escape
from xml.etree import ElementTree as ET

import numpy as np

from hystid.fmu.about import About
from hystid.fmu.icon import curve, png, svg
from hystid.fmu.interface import Interface
from hystid.fmu.model_description.common import add, generation_tool, number, text_of
from hystid.fmu.reference import FOLDER, read_cells
from hystid.modelcode import Variable

# Members of a flange (displacement, speed, force): name, candidates in a model, kind. The force that a body gets (F)
# and the one that a law takes (R, f) both flow in: joined, they add up to zero, as m a + R = F asks.
_FLANGE = (("s", ("x",), "signal"), ("v", ("v",), "signal"), ("f", ("F", "R", "f"), "inflow"))
_ACROSS, _UP = "x", ("R", "f")  # what the icon draws, where a model has it
_STYLE = (
    "body{font:16px/1.5 sans-serif;max-width:52em;margin:2em auto;padding:0 1em;color:#222}"
    "table{border-collapse:collapse}td,th{border:1px solid #bbb;padding:.2em .6em;text-align:left}"
    "pre{background:#f4f4f4;padding:1em;overflow-x:auto}"
)


def presentation(model: Interface, fmi: int, about: About, reference: Mapping[str, bytes]) -> dict[str, bytes]:
    """Path inside the FMU -> content. reference: the entries of its reference result, {} without one."""
    points = _points(reference)
    content = {"documentation/index.html": _page(model, about).encode()}
    if fmi == 2:
        return content | {"model.png": png(points)}
    return content | {
        "terminalsAndIcons/terminalsAndIcons.xml": _terminals(model).encode(),
        "terminalsAndIcons/icon.png": png(points),
        "terminalsAndIcons/icon.svg": svg(points, escape(model.code.name)),
    }


def _points(reference: Mapping[str, bytes]) -> np.ndarray:
    """The curve of the icon; none where there is no result."""
    columns: dict[str, np.ndarray] = {}
    for end in ("_in.csv", "_out.csv"):
        for name, content in reference.items():
            if name.startswith(FOLDER) and name.endswith(end):
                t, cells = read_cells(content.decode())
                single = {key: cell for key, cell in cells.items() if " " not in cell[0]}  # of no array
                columns |= {"time": t, **{key: np.array([float(x) for x in cell]) for key, cell in single.items()}}
    if len(columns) < 2:
        return np.empty((0, 2))
    up = next((columns[name] for name in _UP if name in columns), list(columns.values())[-1])
    return curve(columns.get(_ACROSS, columns["time"]), up)


def _terminals(model: Interface) -> str:
    root = ET.Element("fmiTerminalsAndIcons", {"fmiVersion": "3.0"})
    picture = add(root, "GraphicalRepresentation")
    square: dict[str, str | None] = {"x1": "-100", "y1": "-100", "x2": "100", "y2": "100"}
    add(picture, "CoordinateSystem", {**square, "suggestedScalingFactorTo_mm": "0.1"})
    add(picture, "Icon", square)
    outside = {v.name: v for v in (*model.inputs, *model.outputs)}
    members = [(name, outside[found], kind) for name, candidates, kind in _FLANGE
               if (found := next((c for c in candidates if c in outside), None))]  # fmt: skip
    if len(members) > 1:
        terminals = add(root, "Terminals")
        what = "where the structure is held or driven: displacement, speed, force"
        flange = add(terminals, "Terminal", {"name": "flange", "matchingRule": "plug", "description": what})
        for name, variable, kind in members:
            add(flange, "TerminalMemberVariable", {"variableName": variable.name, "memberName": name,
                                                   "variableKind": kind})  # fmt: skip
    return text_of(root)


def _page(model: Interface, about: About) -> str:
    code, experiment = model.code, model.code.experiment
    kinds = "Model Exchange and Co-Simulation" if model.offers_model_exchange else "Co-Simulation"
    said = {"made by": generation_tool(), **about.attributes(), "token": code.token, "kinds": kinds}
    said |= {"experiment": f"{experiment.start:g} s to {experiment.stop:g} s in steps of {experiment.step:g} s"}
    parameters = [v for v in model.variables if v.causality == "parameter"]
    states = [model.named(name) for name in code.states]
    body = [f"<h1>{escape(code.name)}</h1>", f"<p>{escape(code.description)}</p>"]
    for title, variables in (
        ("Inputs", model.inputs), ("Outputs", model.outputs), ("Parameters", parameters), ("States", states),
    ):  # fmt: skip
        body += _table(title, variables)
    if code.equations:
        body += ["<h2>Equations</h2>", f"<pre>{escape(chr(10).join(code.equations))}</pre>"]
    body += ["<h2>Where it comes from</h2>", "<table>"]
    body += [f"<tr><th>{escape(name)}</th><td>{escape(text)}</td></tr>" for name, text in said.items()]
    body += ["</table>", "<p>The C sources are in the folder <code>sources</code>; the input and the result of the "]
    body += [f"experiment, where it has one, in <code>{FOLDER}</code>. All values are in the units stated.</p>"]
    head = f'<meta charset="utf-8"><title>{escape(code.name)}</title><style>{_STYLE}</style>'
    return f'<!DOCTYPE html>\n<html lang="en"><head>{head}</head>\n<body>\n' + "\n".join(body) + "\n</body></html>\n"


def _table(title: str, variables: tuple[Variable, ...] | list[Variable]) -> list[str]:
    if not variables:
        return []
    rows = []
    for v in variables:
        limits = [f"{word} {bound:g}" for word, bound in (("at least", v.min), ("at most", v.max)) if bound is not None]
        start = "" if v.start is None else number(v.start) if v.type == "Real" else f"{v.start:g}"
        cells = (v.name, start, v.unit, ", ".join(limits), v.description)
        rows.append("<tr>" + "".join(f"<td>{escape(cell)}</td>" for cell in cells) + "</tr>")
    head = "<tr><th>name</th><th>start</th><th>unit</th><th>limits</th><th>meaning</th></tr>"
    return [f"<h2>{title}</h2>", "<table>", head, *rows, "</table>"]
