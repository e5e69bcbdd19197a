"""Report of an identification: how well the surrogate does, where, and how its training went."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

import numpy as np

from hystid.comparison import Harmonics, harmonics
from hystid.errors import counted
from hystid.identification import Comparison, Identification, Prediction
from hystid.identification.hybrid.result import Hybrid, HybridComparison
from hystid.leastsquares import REASONS
from hystid.networks.training import Training
from hystid.recording import Array, Recording
from hystid.report.curves import (
    X_AXIS,
    Curve,
    fundamental_of,
    harmonic_bars,
    highest_frequency,
    over_time,
    raw,
    responses,
    spectra,
    steady,
    window_of,
)
from hystid.report.linked import Linked, Series
from hystid.report.page import Cell, Fact, Page, Table, Tone, Verdict, columns, graded, number, percent, training_range
from hystid.report.plots import Axis, Bars, Line, Plot, Points, Role

_CLEARLY = 0.8  # error over error, from which a model is worth asking for (a stated cost)
_GOOD, _FAIR = 0.05, 0.15  # force NRMSE: a few percent is what the published method reaches on measured data
_OVERVIEWS = 5
_SHOWN_RECORDINGS = 2  # recordings with figures of their own: more make the page long without saying more


def page(result: Identification, command: str) -> Page:
    """The report; a pure function of the result. command: what the reader can run to get it again."""
    made = Page(
        "Identification of the restoring force",
        subtitle=f"{counted(len(result.comparisons), 'recording')}, {_structure(result)}",
        command=command,
        verdict=verdict(result),
        facts=_facts(result),
        rotational=result.rotational,
    )
    made.toggles(("measured", "measured"), ("model", "surrogate"), ("muted", "linear fit"))
    _errors(made, result)
    if result.hybrid:
        _hybrid(made, result.hybrid)
    for comparison in _shown(result):
        _recording(made, comparison)
    _training(made, result)
    _data(made, result)
    settings = {name: str(value) for name, value in result.settings.items()}
    files = ", ".join(file.name for file in result.files.values())
    made.reproduce(command, {**settings, **({"Files": files} if files else {})})
    return made


def summary(result: Identification) -> str:
    """One line per recording, then the files."""
    rows = [("recording", "used for", "force NRMSE", "linear fit", "free run x")]
    for comparison in result.comparisons:
        network = comparison.network
        free = "diverged" if network.diverged else percent(network.x_nrmse) if network.x_nrmse is not None else "-"
        errors = (percent(network.force_nrmse), percent(comparison.linear.force_nrmse), free)
        rows.append((comparison.recording.name, comparison.role, *errors))
    return "\n".join([columns(rows), *result.notes])


def verdict(result: Identification) -> Verdict:
    """The sentence on top: judged on held-out recordings where there are any."""
    judged = result.judged
    force = [comparison.network.force_nrmse for comparison in judged]
    linear = float(np.median([comparison.linear.force_nrmse for comparison in judged]))
    median, worst = float(np.median(force)), max(force)
    unseen = judged[0].role == "holdout"
    where = "recordings it has not seen" if unseen else "the recordings it was trained on"
    tone = graded(median, _GOOD, _FAIR)
    detail = f"A linear fit (m, B, Kl) leaves {percent(linear)}. "
    diverged = [comparison.recording.name for comparison in judged if comparison.network.diverged]
    if told := _published_is_better(judged):
        tone, detail = "warn" if tone == "good" else tone, detail + told
    if diverged:
        tone, detail = "bad", f"{detail}In closed loop it diverged on {', '.join(diverged)}. "
    if not unseen:
        tone = "warn" if tone == "good" else tone
        detail += "No recording was held out (--holdout), so this says how well it fits, not how well it predicts."
    if result.failure:
        return Verdict("bad", f"This model is of no use: {result.failure}", f"Judged on {where}. {detail}")
    worst_text = f", {percent(worst)} at worst" if len(judged) > 1 else ""
    return Verdict(
        tone, f"The surrogate leaves {percent(median)} of the force unexplained{worst_text}, on {where}", detail
    )


def _published_is_better(judged: Sequence[Comparison]) -> str:
    """A sentence where the published method is better both on the measured motion and in free run."""
    both = [(c.network, c.published) for c in judged if c.published is not None]
    if not both:
        return ""
    mine, other = (float(np.median([pair[k].force_nrmse for pair in both])) for k in (0, 1))
    runs = [pair for pair in both if pair[0].x_nrmse is not None]
    worse = any(theirs.diverged or (theirs.x_nrmse or np.inf) > (own.x_nrmse or np.inf) for own, theirs in runs)
    if other > _CLEARLY * mine or worse:
        return ""
    return f"The published method leaves less, {percent(other)}: --method published gives that model. "


def _facts(result: Identification) -> list[Fact]:
    judged = result.judged
    role = "held-out" if judged[0].role == "holdout" else "training"
    free = [c.network.x_nrmse for c in judged if c.network.x_nrmse is not None]
    facts = [
        Fact(
            "Force NRMSE, median",
            percent(float(np.median([c.network.force_nrmse for c in judged]))),
            f"{role} recordings, on the measured motion",
        ),
        Fact(
            "Linear fit, same recordings",
            percent(float(np.median([c.linear.force_nrmse for c in judged]))),
            "what no memory and no friction gives",
        ),
    ]
    if free:
        facts.append(
            Fact(
                "Free run, x NRMSE, median",
                percent(float(np.median(free))),
                f"closed loop with the mass, worst {percent(max(free))}",
            )
        )
    facts.append(
        Fact(
            "Mass",
            number(result.model.mass, "kg", 4) if result.model.mass else "0",
            "" if result.model.mass else "F is the restoring force itself",
        )
    )
    facts.append(
        Fact(
            "Averaged networks", f"{len(result.chosen)} of {len(result.starts)}", "the best on the training recordings"
        )
    )
    return facts


def _errors(page: Page, result: Identification) -> None:
    page.section(
        "Errors of every recording",
        "Force NRMSE: the model is given the measured motion and its force is compared with the measured one."
        " Free run: the model, with the mass, is given only the measured excitation and has to find the motion itself.",
    )
    published = any(comparison.published for comparison in result.comparisons)
    columns = ["recording", "used for", "force NRMSE", *(["published method"] if published else []), "linear fit"]
    columns.insert(3, "within the 90 % band")
    columns += ["free run, x NRMSE", "free run, R NRMSE", "linear, x NRMSE"] if result.model.mass else []
    rows = [_row(comparison, published, bool(result.model.mass)) for comparison in result.comparisons]
    page.table(
        Table(
            "NRMSE per recording",
            columns,
            rows,
            "NRMSE: rms of the error over the standard deviation of the reference. Band: R ± 1.64 R_spread.",
        )
    )
    _as_recorded(page, result)
    names = [comparison.recording.name for comparison in result.comparisons]
    bars = [
        Bars(names, np.array([100 * c.network.force_nrmse for c in result.comparisons]), "surrogate", "model"),
        Bars(names, np.array([100 * c.linear.force_nrmse for c in result.comparisons]), "linear fit", "muted"),
    ]
    page.plots(
        Plot(
            "Force error on the measured motion",
            Axis("Recording"),
            Axis("Force NRMSE", "%"),
            bars,
            "Shorter is better.",
        )
    )


def _as_recorded(page: Page, result: Identification) -> None:
    heads = ["recording", "force", *(["free run, x"] if result.model.mass else [])]
    rows = [
        [c.recording.name, percent(c.recorded.force_nrmse), percent(c.recorded.x_nrmse)][: len(heads)]
        for c in result.comparisons
        if c.recorded
    ]
    if rows:
        told = "Above, x, v and a are smoothed; here they keep their noise. hystid validate reports the same."
        page.table(Table("NRMSE on the channels as recorded", heads, rows, told))


def _row(comparison: Comparison, published: bool, mass: bool) -> list[str | Cell]:
    network, linear = comparison.network, comparison.linear
    row: list[str | Cell] = [
        comparison.recording.name,
        "held out" if comparison.role == "holdout" else "training",
        Cell(percent(network.force_nrmse), graded(network.force_nrmse, _GOOD, _FAIR)),
        percent(network.within(comparison.recording.channel("R"))),
    ]
    if published:
        row.append(percent(comparison.published.force_nrmse if comparison.published else None))
    row.append(percent(linear.force_nrmse))
    if mass:
        x = Cell("diverged", "bad") if network.diverged else percent(network.x_nrmse)
        row += [x, percent(network.R_nrmse), "diverged" if linear.diverged else percent(linear.x_nrmse)]
    return row


def _hybrid(page: Page, hybrid: Hybrid) -> None:
    page.section(
        f"Physics plus network: {hybrid.name}",
        "The law was fitted first; networks answer for what it leaves, with the share of their force that unseen "
        "branches confirm. Both were then fitted in turns. " + hybrid.sentence() + ".",
    )
    columns = ["recording", "used for", "law alone", "networks alone", "both", "within the 90 % band"]
    columns += ["physics", "network", "left"]
    run = any(p.hybrid.x_nrmse is not None for p in hybrid.pairs)
    columns += ["law, x", "networks, x", "both, x"] if run else []
    page.table(
        Table(
            "Force NRMSE of each alone and of both, and shares of the force's power",
            columns,
            [_pair(pair, run) for pair in hybrid.pairs],
            "Shares: what the law of the hybrid explains of the variance of R, and what the networks explain of the"
            " rest. x: displacement NRMSE in free run. Band: R of both ± 1.64 R_spread of hybrid.fmu.",
        )
    )
    rows: list[list[str | Cell]] = [
        [name, number(hybrid.alone[name], hybrid.units[name], 4), number(value, hybrid.units[name], 4)]
        for name, value in hybrid.together.items()
    ]
    page.table(Table("Parameters of the law", ["parameter", "alone", "beside the networks"], rows))


def _pair(pair: HybridComparison, run: bool) -> list[str | Cell]:
    alone, both = (pair.physics, pair.network), pair.hybrid
    law, networks = pair.shares
    tone: Tone = "good" if both.force_nrmse < min(p.force_nrmse for p in alone) else "warn"
    row: list[str | Cell] = [pair.recording.name, "held out" if pair.role == "holdout" else pair.role]
    row += [*(percent(p.force_nrmse) for p in alone), Cell(percent(both.force_nrmse), tone)]
    row.append(percent(both.within(pair.recording.channel("R"))))
    row += [percent(law, 3), percent(networks), percent(1 - law - networks)]
    return row + ([("diverged" if p.diverged else percent(p.x_nrmse)) for p in (*alone, both)] if run else [])


def _recording(page: Page, comparison: Comparison) -> None:
    record, network = comparison.recording, comparison.network
    R = record.channel("R")
    page.section(f"{record.name} ({'held out' if comparison.role == 'holdout' else 'training'})")
    forces = [
        Series("measured", R, "measured", dots=True),
        Series("surrogate", network.R, "model"),
        Series("linear fit", comparison.linear.R, "muted"),
    ]
    difference = [Series("surrogate less measured", network.R - R, "bad")]
    error = f"On the measured motion; the force is off by {percent(network.force_nrmse)}"
    page.linked(error, Linked.of((record.t, record.channel("x"), record.channel("v")), forces, difference))
    page.plots(*_closed_loop(record, network), _content(record, R, network))


def _closed_loop(record: Recording, network: Prediction) -> list[Plot]:
    if network.free_run is None:
        return []
    near = window_of(record.channel("F"), record.channel("x"), record.dt)
    motions = [
        Curve("measured", record.t, record.channel("x"), "measured"),
        Curve("surrogate with mass", record.t, network.free_run["x"], "model"),
    ]
    caption = f"Driven by the measured force alone: NRMSE {percent(network.x_nrmse)}."
    return [over_time("Free run: displacement", X_AXIS, motions, caption, near)]


def _content(record: Recording, measured: Array, network: Prediction) -> Plot:
    """Harmonics for a harmonic test, else power spectra."""
    model = network.R if network.free_run is None else network.free_run["R"]
    t, f = record.t, fundamental_of(steady(record.channel("F")), record.dt)
    if f is None:
        curves = [Curve("measured", t, measured, "measured"), Curve("surrogate", t, model, "model")]
        highest = highest_frequency(measured, record.dt)
        return spectra("Power spectrum of R", "N", curves, highest, "Welch, Hann windows, half overlapped.")
    caption = "Even harmonics need a difference between push and pull; friction and hysteresis alone give odd ones."
    ours, theirs = (harmonics(steady(R), record.dt, f) for R in (model, measured))
    signals: list[tuple[str, Role, Harmonics]] = [("measured", "measured", theirs), ("surrogate", "model", ours)]
    return harmonic_bars(f"Harmonics of R at {f:.4g} Hz", signals, caption)


def _training(page: Page, result: Identification) -> None:
    page.section(
        "Training",
        f"{counted(len(result.starts), 'pair')} of networks were trained from random starts; each stops when the error"
        " on data kept aside (validation) no longer falls. The best are averaged. Errors are in units of the scaled"
        " target.",
    )
    page.plots(_learning(result), _starts(result))
    reasons = Counter(REASONS[part.reason] for start in result.starts for part in (start.hysteresis, start.restoring))
    rows = [[reason, str(count)] for reason, count in reasons.most_common()]
    page.table(Table("Why trainings stopped", ["reason", "trainings"], rows))


def _learning(result: Identification) -> Plot:
    curves: list[Line] = []
    for start in result.starts:
        if start.number in result.chosen:
            parts: list[tuple[str, Training, Role]] = [
                ("hysteresis network", start.hysteresis, "before"),
                ("restoring network", start.restoring, "model"),
            ]
            for name, part, role in parts:
                steps = np.arange(part.validation.size, dtype=float)
                curves.append(Line(steps, part.validation, name if len(curves) < 2 else "", role, opacity=0.75))
    error = Axis("Mean square error", log=True)
    caption = "Each curve ends where its training stopped."
    return Plot("Validation error of the averaged networks", Axis("Iteration"), error, curves, caption)


def _starts(result: Identification) -> Plot:
    finals = np.array([start.error for start in result.starts])
    numbers = np.array([start.number for start in result.starts], dtype=float)
    chosen = np.isin(numbers, result.chosen)
    points = [
        Points(numbers[chosen], finals[chosen], "averaged", "good"),
        Points(numbers[~chosen], finals[~chosen], "left out", "muted"),
    ]
    caption = "Many starts guard against the poor local solutions that some end in."
    return Plot("Validation error of all starts", Axis("Start"), Axis("Mean square error", log=True), points, caption)


def _data(page: Page, result: Identification) -> None:
    page.section(
        "Data and validity",
        "The surrogate knows what the training data showed it. Outside of these ranges its answers are extrapolation.",
    )
    page.table(training_range(result.model.training_range, {port.name: port.unit for port in result.model.inputs}))
    records = [comparison.recording for comparison in result.comparisons]
    shown = responses(records)
    forces = [raw(f"Force, {r.name}", r.t, Axis("F", "N"), r.channel("F")) for r in records[:_OVERVIEWS]]
    page.plots(*([shown] if shown else []), *forces)
    done = dict.fromkeys(note for comparison in result.comparisons for note in comparison.recording.notes)
    if done:
        page.text("What was done to the recordings before:")
        page.bullets(done)
    page.bullets(result.notes)


def _shown(result: Identification) -> list[Comparison]:
    """Held-out recordings first, the worst of them on top: what a reader must see is where it is poor."""
    order = sorted(result.comparisons, key=lambda c: (c.role != "holdout", -c.network.force_nrmse))
    return order[:_SHOWN_RECORDINGS]


def _structure(result: Identification) -> str:
    sizes = "-".join(str(n) for n in result.settings.get("layers", ()))
    return f"two networks with {sizes} hidden neurons, {result.model.sample_rate:.6g} Hz"
