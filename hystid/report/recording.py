"""A recording as it is: every channel over time, its loop, and its figures."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from hystid.recording import Recording
from hystid.report.curves import Curve, loops, raw, window_of
from hystid.report.page import Fact, Page, Table, columns, number
from hystid.report.plots import Axis, Plot

NAMES = {"F": "Force F", "x": "Displacement x", "v": "Velocity v", "a": "Acceleration a", "R": "Restoring force R"}


def page(result: Recording, command: str) -> Page:
    """The report; a pure function of the recording."""
    made = Page(f"Recording {result.name}", command=command, facts=_facts(result), rotational=result.rotational)
    made.section("Channels")
    made.table(Table("Ranges", ["channel", "lowest", "highest", "rms", "origin"], _rows(result)))
    made.plots(*overview(result))
    if result.x is not None and (result.R is not None or result.F is not None):
        made.plots(_loop(result))
    made.bullets((*result.warnings, *result.notes))
    return made


def summary(result: Recording) -> str:
    """Length, rate and the range of every channel."""
    head = f"{result.name}: {len(result)} samples at {result.sample_rate:.6g} Hz, {result.t[-1] - result.t[0]:.4g} s"
    rows = [("channel", "lowest", "highest", "rms", "origin"), *_rows(result)]
    return "\n".join([head, columns(rows), *result.warnings])


def overview(result: Recording) -> list[Plot]:
    """Every channel over the whole time, one flat figure each."""
    return [
        raw(NAMES[name], result.t, Axis(name, result.unit(name)), values) for name, values in result.channels().items()
    ]


def _loop(result: Recording) -> Plot:
    """R over x where R is known, else F over x, where the motion is largest."""
    name = "R" if result.R is not None else "F"
    x, force = result.channel("x"), result.channel(name)
    near = window_of(result.F if result.F is not None else x, x, result.dt)
    span = f"t = {result.t[near][0]:.4g} to {result.t[near][-1]:.4g} s."
    plot = loops(f"{NAMES[name]} over displacement", [Curve("measured", x[near], force[near], "measured")], span)
    return replace(plot, y=Axis(NAMES[name], "N"))


def _facts(result: Recording) -> list[Fact]:
    return [
        Fact("Samples", f"{len(result)}"),
        Fact("Sample rate", number(result.sample_rate, "Hz", 5)),
        Fact("Duration", number(float(result.t[-1] - result.t[0]), "s", 4)),
    ]


def _rows(result: Recording) -> list[tuple[str, ...]]:
    rows = []
    for name, values in result.channels().items():
        figures = [number(float(f), result.unit(name), 4) for f in (np.min(values), np.max(values), np.std(values))]
        rows.append((name, *figures, result.origin.get(name, "measured")))
    return rows
