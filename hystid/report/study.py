"""Reports of studies: which structure, and what an error of the weighed mass costs."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from hystid.recording import Array
from hystid.report.page import Fact, Page, Table, Verdict, columns, percent
from hystid.report.plots import Axis, Boxes, Line, Mark, Plot, Points, Series
from hystid.study import GridResult, MassResult
from hystid.study.cells import GridCell

_OTHERS = "Other recordings help more than other structures: they must cover the motion of the held-out ones."


def page(result: GridResult | MassResult, command: str) -> Page:
    """The report; a pure function of the result. command: what the reader can run to get it again."""
    return _grid_page(result, command) if isinstance(result, GridResult) else _mass_page(result, command)


def summary(result: GridResult | MassResult) -> str:
    """Errors of every structure, and the choice or the cost with its reason."""
    rows = [("structure", "mass", "force NRMSE, median", "free run x, median")]
    for cell in result.cells:
        free = "-" if np.isnan(cell.free_run.median) else _share(cell.free_run.median)
        rows.append((cell.name, f"{cell.mass:.4g} kg", _share(cell.force.median), free))
    if isinstance(result, MassResult):
        last = _cost(result)
    else:
        last = f"{result.failure}. {_OTHERS}" if result.failure else f"choose {result.reason}"
    return f"{columns(rows)}\n{last}"


def _grid_page(result: GridResult, command: str) -> Page:
    best = result.best
    starts = len(best.outcomes)
    page = Page(
        "Which network structure",
        subtitle=f"{len(result.cells)} structures, {_starts(starts)} each, tested on held-out recordings",
        command=command,
        verdict=_chosen(result),
        facts=[
            Fact("Chosen structure", best.name, f"{best.parameters} weights in both networks"),
            Fact("Force NRMSE, median start", percent(best.force.median), "held-out recordings"),
            Fact("Free run, x NRMSE, median start", percent(best.free_run.median), "closed loop with the mass"),
            Fact("Ensemble of the best tenth", percent(best.ensemble["force_nrmse"]), "force NRMSE"),
            Fact("Best single network", percent(best.single["force_nrmse"]), "force NRMSE"),
        ],
    )
    page.section("Held-out errors of all starts", "Each box holds the starts of one structure.")
    page.plots(_boxes(result.cells, "force"), _boxes(result.cells, "free_run"), columns=1)
    page.table(_spreads("Force NRMSE on the measured motion", [(cell.name, cell) for cell in result.cells], "force"))
    if not np.isnan(best.free_run.median):
        page.table(_spreads("Free-run displacement NRMSE", [(cell.name, cell) for cell in result.cells], "free_run"))
    page.section(
        "Ensemble against the best single network",
        "The ensemble is the mean of the best tenth of the starts, chosen by validation error; the single network is"
        " the start of the least validation error. Neither choice knows the held-out recordings.",
    )
    page.plots(_ensembles(result.cells))
    page.section("Why the trainings ended", "Both networks of every start, counted.")
    page.table(_endings(result.cells))
    page.reproduce(command, {name: str(value) for name, value in result.settings.items()})
    return page


def _chosen(result: GridResult) -> Verdict:
    """The choice, or that none of the structures is of use."""
    if result.failure:
        return Verdict("bad", _sentence(result.failure).rstrip("."), _OTHERS)
    return Verdict("neutral", f"Choose {result.best.name} hidden neurons", _sentence(result.reason))


def _mass_page(result: MassResult, command: str) -> Page:
    structures = list(dict.fromkeys(cell.layers for cell in result.cells))
    rows = {layers: result.row(layers) for layers in structures}
    cost = _cost(result)
    page = Page(
        "What an error of the weighed mass costs",
        subtitle=f"{len(structures)} structures, {len(result.offsets)} masses around {result.nominal:g} kg",
        command=command,
        verdict=Verdict(
            "neutral", cost, "Medians over the starts of the best structure at each mass, on held-out recordings."
        ),
    )
    page.section("Error over assumed mass", "Training and free run use the assumed mass; the recordings stay the same.")
    page.plots(
        _over_mass(result, rows, "force", "Force NRMSE on the measured motion"),
        _over_mass(result, rows, "free_run", "Free-run displacement NRMSE"),
    )
    for kind, title in (("force", "Force NRMSE"), ("free_run", "Free-run displacement NRMSE")):
        names = [(f"{cell.name}, {100 * (cell.mass / result.nominal - 1):+.0f} %", cell) for cell in result.cells]
        page.table(_spreads(title, names, kind))
    page.reproduce(command, {name: str(value) for name, value in result.settings.items()})
    return page


def _boxes(cells: Sequence[GridCell], kind: str) -> Plot:
    shown = [np.array([v for v in getattr(cell, kind).values if np.isfinite(v)]) * 100 for cell in cells]
    title = "Force NRMSE on the measured motion" if kind == "force" else "Free-run displacement NRMSE"
    lost = sum(len(getattr(cell, kind).values) for cell in cells) - sum(values.size for values in shown)
    caption = f"{lost} starts without a finite answer (diverged, or no mass) are left out." if lost else ""
    caption += " The tables count them." if lost else ""
    axis = Axis("NRMSE", "%", log=True)
    return Plot(
        title, Axis("Hidden neurons"), axis, [Boxes([cell.name for cell in cells], shown, "", "model")], caption
    )


def _spreads(title: str, named: Sequence[tuple[str, GridCell]], kind: str) -> Table:
    columns = ["structure", "best", "lower quartile", "median", "upper quartile", "worst", "ensemble", "best single"]
    key = "force_nrmse" if kind == "force" else "x_nrmse"
    rows = []
    for name, cell in named:
        spread = getattr(cell, kind)
        levels = (spread.best, spread.lower, spread.median, spread.upper, spread.worst)
        rows.append([name, *(_share(v) for v in (*levels, cell.ensemble[key], cell.single[key]))])
    return Table(
        title, columns, rows, "Quartiles over the starts; each start's value is its median over the held-out tests."
    )


def _endings(cells: Sequence[GridCell]) -> Table:
    rows = [
        [cell.name, network, str(count), reason]
        for cell in cells
        for network, reasons in cell.stopped.items()
        for reason, count in reasons.items()
    ]
    return Table("Endings", ["structure", "network", "trainings", "because"], rows)


def _share(value: float) -> str:
    return "diverged" if np.isposinf(value) else percent(value)


def _ensembles(cells: Sequence[GridCell]) -> Plot:
    key = "force_nrmse" if np.isnan(cells[0].ensemble["x_nrmse"]) else "x_nrmse"
    single, mean = (_finite([getattr(cell, which)[key] for cell in cells]) for which in ("single", "ensemble"))
    largest = float(np.nanmax(np.concatenate([single, mean])))
    points: list[Series] = [
        Line(np.array([0.0, largest]), np.array([0.0, largest]), "equal", "muted", "dot"),
        Points(single, mean, "structures", "model", labels=[cell.name for cell in cells]),
    ]
    what = "Free-run displacement" if key == "x_nrmse" else "Force"
    axes = Axis("Best single network", "%"), Axis("Ensemble", "%")
    caption = "Below the dotted line the ensemble is better. One point per structure."
    return Plot(f"{what} error, NRMSE", *axes, points, caption)


def _over_mass(result: MassResult, rows: dict[tuple[int, ...], list[GridCell]], kind: str, title: str) -> Plot:
    offsets = 100 * np.array(result.offsets)
    curves = [
        Line(offsets, _finite([getattr(cell, kind).median for cell in cells]), cells[0].name) for cells in rows.values()
    ]
    marks = [Mark(0.0, text="as weighed")]
    return Plot(
        title, Axis("Error of the mass", "%"), Axis("NRMSE, median", "%"), curves, "One curve per structure.", marks
    )


def _finite(values: Sequence[float]) -> Array:
    array = 100 * np.array(values, dtype=float)
    return np.where(np.isfinite(array), array, np.nan)


def _cost(result: MassResult) -> str:
    """The best structure's median error as weighed, at the largest offsets, and where it is least."""
    offsets = np.array(result.offsets)
    free = not any(np.isnan(cell.free_run.median) for cell in result.cells)
    kind = "free_run" if free else "force"

    def least(offset: float) -> float:
        near = [c for c in result.cells if abs(c.mass / result.nominal - 1 - offset) < 1e-6]
        return float(min(getattr(cell, kind).median for cell in near))

    what = "Free-run displacement" if free else "Force"
    at = {float(offset): least(offset) for offset in offsets}
    middle, best = min(at, key=abs), min(at, key=at.__getitem__)
    ends = ", ".join(f"{_share(at[end])} at {100 * end:+.0f} %" for end in (min(at), max(at)))
    lowest = "" if best == middle else f"; least, {_share(at[best])}, at {100 * best:+.0f} %"
    return f"{what} error {_share(at[middle])} as weighed, {ends}{lowest}"


def _sentence(text: str) -> str:
    return f"{text[0].upper()}{text[1:].rstrip('.')}." if text else ""


def _starts(count: int) -> str:
    return "one start" if count == 1 else f"{count} starts"
