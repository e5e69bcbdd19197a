"""Report of a validation: does the surrogate follow its reference, on the given motion and in closed loop."""

from __future__ import annotations

import numpy as np

from hystid.errors import counted
from hystid.report.curves import X_AXIS, Curve, harmonic_bars, highest_frequency, over_time, spectra, window_of
from hystid.report.linked import Linked, Series
from hystid.report.page import Cell, Fact, Page, Table, Verdict, columns, graded, number, percent, training_range
from hystid.report.plots import Axis, Bars, Plot
from hystid.validation import Levels, Stability, Validation, ValidationCase

_GOOD, _FAIR = 0.06, 0.15  # force NRMSE at worst: the demo's target, and what is still of use
_SHOWN_CASES = 3  # worst cases with figures of their own


def page(result: Validation, command: str) -> Page:
    """The report; a pure function of the result. command: what the reader can run to get it again."""
    cases = counted(len(result.cases), "case")
    made = Page(
        f"Validation of {result.surrogate.name}",
        subtitle=f"against {result.against.name if result.against else 'recordings'}, {cases}",
        command=command,
        verdict=verdict(result),
        facts=_facts(result),
        rotational=result.rotational,
    )
    made.toggles(("reference", "reference"), ("model", "surrogate"), ("third", "free run"))
    add_errors(made, result)
    for case in sorted(result.cases, key=lambda case: -case.force_nrmse)[:_SHOWN_CASES]:
        _case(made, case)
    if result.stability:
        _stability(made, result.stability)
    _validity(made, result)
    made.reproduce(command)
    return made


def summary(result: Validation) -> str:
    """One line per case, then the median and the worst."""
    rows: list[tuple[str, ...]] = [("case", "force NRMSE", "free run x", "free run R", "odd harmonics")]
    for case in result.cases:
        run = case.free_run
        free = (percent(run.x_nrmse), percent(run.R_nrmse)) if run else ("diverged" if case.diverged else "-", "-")
        odd = case.levels.worst_odd_db("force") if case.levels else None
        rows.append((case.name, percent(case.force_nrmse), *free, "-" if odd is None else f"{odd:.2g} dB"))
    figures = [result.figures(which) for which in ("force_nrmse", "x_nrmse", "R_nrmse")]
    for name, pick in (("median", np.median), ("worst", np.max)):
        cells = [percent(float(pick(values))) if not np.isnan(values).all() else "-" for values in figures]
        rows.append((name, *cells, ""))
    return "\n".join([columns(rows), *result.notes])


def verdict(result: Validation) -> Verdict:
    """The sentence on top, judged by the worst case."""
    force, motion = result.figures("force_nrmse"), result.figures("x_nrmse")
    median, worst = float(np.median(force)), float(np.max(force))
    tone = graded(worst, _GOOD, _FAIR)
    closed = "There is no mass, so no closed loop. "
    if not np.all(np.isnan(motion)):
        closed = f"In closed loop the displacement is off by {percent(float(np.nanmedian(motion)))}"
        closed += " in the median. " if len(result.cases) > 1 else ". "
    diverged = [case.name for case in result.cases if case.diverged]
    if diverged:
        tone, closed = "bad", f"In closed loop it diverges in {counted(len(diverged), 'case')}: {', '.join(diverged)}. "
    if result.stability and result.stability.feeding:
        tone = "warn" if tone == "good" else tone
        closed += "Within its training range there are motions into which it feeds energy. "
    outside = max(case.outside for case in result.cases)
    if outside > 0.01:
        closed += f"Up to {percent(outside)} of a case lies outside the range that it was trained on."
    spread = f" in the median, {percent(worst)} at worst" if len(result.cases) > 1 else ""
    return Verdict(tone, f"The surrogate's force is off by {percent(median)}{spread}", closed)


def _facts(result: Validation) -> list[Fact]:
    force, motion = result.figures("force_nrmse"), result.figures("x_nrmse")
    facts = [
        Fact("Force NRMSE, median", percent(float(np.median(force))), "on the reference motion"),
        Fact("Force NRMSE, worst", percent(float(np.max(force))), result.cases[int(np.argmax(force))].name),
    ]
    if not np.all(np.isnan(motion)):
        facts.append(
            Fact("Free run, x NRMSE, median", percent(float(np.nanmedian(motion))), "closed loop with the mass")
        )
        worst = int(np.nanargmax(motion))
        facts.append(Fact("Free run, x NRMSE, worst", percent(float(motion[worst])), result.cases[worst].name))
    if result.worst_odd_db is not None:
        hint = "3rd to 9th harmonic of R, where above -60 dB"
        facts.append(Fact("Odd harmonics, largest difference", number(result.worst_odd_db, "dB", 2), hint))
    facts.append(Fact("Mass", number(result.mass, "kg", 4) if result.mass else "0"))
    return facts


def add_errors(page: Page, result: Validation) -> None:
    """Section with the errors of every case as a table and as bars."""
    page.section(
        "Errors of every case",
        "Force: the surrogate is shown the reference motion and gives R. Free run: with the mass it is driven by the"
        " reference force alone, so that its errors feed back.",
    )
    columns = [
        "case",
        "force NRMSE",
        "force MSE [N²]",
        "x NRMSE",
        "R NRMSE",
        "R MSE [N²]",
        "odd harmonics [dB]",
        "energy",
    ]
    note = "NRMSE: rms of the error over the standard deviation of the reference. MSE: mean square error. "
    note += (
        "Odd harmonics: largest difference of the 3rd to 9th. Energy: work done against R over that of the reference."
    )
    page.table(Table("Errors", columns, [_row(case) for case in result.cases], note))
    names = [case.name for case in result.cases]
    bars = [Bars(names, 100 * result.figures("force_nrmse"), "force on the reference motion", "model")]
    motion = result.figures("x_nrmse")
    if not np.all(np.isnan(motion)):
        bars.append(Bars(names, 100 * np.where(np.isfinite(motion), motion, np.nan), "displacement, free run", "third"))
    page.plots(Plot("Error of every case", Axis("Case"), Axis("NRMSE", "%"), bars, "Shorter is better."))


def _row(case: ValidationCase) -> list[str | Cell]:
    run, energy = case.free_run, case.energy
    tone = graded(case.force_nrmse, _GOOD, _FAIR)
    odd = case.levels.worst_odd_db("force") if case.levels else None
    share = energy["force"] / energy["reference"] if energy["reference"] else float("nan")
    free: list[str | Cell] = [Cell("diverged", "bad")] * 3 if case.diverged else ["-"] * 3
    if run:
        free = [percent(run.x_nrmse), percent(run.R_nrmse), number(run.R_mse)]
    ends = ["-" if odd is None else number(odd, "", 2), percent(share, 3)]
    return [case.name, Cell(percent(case.force_nrmse), tone), number(case.force_mse), *free, *ends]


def _case(page: Page, case: ValidationCase) -> None:
    record = case.reference
    x, R = record.channel("x"), record.channel("R")
    near = window_of(record.F if record.F is not None else x, x, record.dt)
    page.section(case.name)
    page.text(" ".join(case.notes))
    forces = [Series("reference", R, "reference", dots=True), Series("surrogate", case.force, "model")]
    difference = [Series("surrogate less reference", case.force - R, "bad")]
    error = f"On the reference motion; the force is off by {percent(case.force_nrmse)}"
    page.linked(error, Linked.of((record.t, x, record.channel("v")), forces, difference))
    page.plots(*_motion(case, near), content(case))


def _motion(case: ValidationCase, near: slice) -> list[Plot]:
    if case.diverged or case.free_run is None:
        return []
    record = case.reference
    curves = [
        Curve("reference", record.t, record.channel("x"), "reference"),
        Curve("surrogate", record.t, case.free_run.x, "model"),
        Curve("difference", record.t, case.free_run.x - record.channel("x"), "bad"),
    ]
    caption = f"Driven by the force alone. NRMSE {percent(case.free_run.x_nrmse)}."
    return [over_time("Free run: displacement", X_AXIS, curves, caption, near)]


def content(case: ValidationCase) -> Plot:
    """Harmonics of R where the force is one tone, else its power spectrum."""
    if case.levels:
        return _harmonics(case.levels)
    record, t = case.reference, case.reference.t
    curves = [Curve("reference", t, record.channel("R"), "reference"), Curve("surrogate", t, case.force, "model")]
    if case.free_run:
        curves.append(Curve("surrogate, free run", t, case.free_run.R, "third", True))
    highest = highest_frequency(record.channel("R"), record.dt)
    return spectra("Power spectrum of R", "N", curves, highest, "Welch, Hann windows, half overlapped.")


def _harmonics(levels: Levels) -> Plot:
    title = f"Harmonics of R at {levels.reference.fundamental:.4g} Hz, up to the tenth"
    caption = "By least squares over the second half. Friction and hysteresis give odd harmonics only."
    return harmonic_bars(
        title, [("reference", "reference", levels.reference), ("surrogate", "model", levels.force)], caption
    )


def _stability(page: Page, found: Stability) -> None:
    feeding = len(found.feeding)
    sentence = f"All {len(found.cycles)} cycles dissipate, or keep their energy."
    if feeding:
        sentence = (
            f"In {feeding} of {len(found.cycles)} cycles the surrogate feeds energy in: it may drive an oscillator."
        )
    memory = ""
    if np.isfinite(found.remembered):
        memory = f" After four cycles {percent(found.remembered)} is left of a difference of its starting force."
    page.section("Dissipation", f"The surrogate alone, on harmonic motions over its training range. {sentence}{memory}")
    rows: list[list[str | Cell]] = [
        [
            number(cycle.amplitude, "m", 3),
            number(cycle.frequency, "Hz", 3),
            number(cycle.energy, "J", 3),
            Cell(percent(cycle.loss, 3), "bad" if cycle in found.feeding else "neutral"),
        ]
        for cycle in found.cycles
    ]
    note = "Loss: energy re pi x amplitude x greatest force; 0 % for a spring, 100 % for a damper, negative: fed in."
    page.table(Table("Energy taken out per cycle", ["amplitude", "frequency", "energy", "loss"], rows, note))


def _validity(page: Page, result: Validation) -> None:
    if result.training_range or result.notes:
        page.section("Validity", "Outside of its training range a surrogate extrapolates.")
        if result.training_range:
            page.table(training_range(result.training_range, {port.name: port.unit for port in result.inputs}))
        page.bullets(result.notes)
