"""Report of a diagnosis: verdict first, then loops, the residual map, harmonics, amplitude, time, and the evidence."""

from __future__ import annotations

import math

import numpy as np

from hystid.diagnosis import Diagnosis, Finding, Traces
from hystid.diagnosis.decide.criterion import Posterior
from hystid.numeric import Array
from hystid.report import evidence
from hystid.report.curves import FORCE, T_AXIS, V_AXIS, X_AXIS, raw
from hystid.report.linked import Linked, Series, windows
from hystid.report.page import Fact, Page, Table, Tone, Verdict, columns, number, percent, with_error
from hystid.report.plots import Axis, Bars, Heat, Line, Plot, Points, Role

_OF_FAULTS = {
    "samples": "how late the channel is, in samples",
    "delay": "how late the channel is",
    "level": "largest value that the channel shows, either way",
}
_TONES: dict[str, Tone] = {
    "consistent": "good",
    "recalibrated": "good",
    "missing_physics": "warn",
    "sensor_fault": "warn",
    "unknown_physics": "bad",
    "not_applicable": "neutral",
}
_CELLS = 36
_HARMONICS = 10
_CANDIDATES = 10
_LINKED = 2  # recordings that are shown in linked views, and free runs: more make the page long and say little more
_OVERVIEWS = 6
_TONAL = 0.3  # share of the power in one line above which multiples of it mean something


def page(diagnosis: Diagnosis, command: str) -> Page:
    """The report; a pure function of the result. command: what the reader can run to get it again."""
    made = Page(
        f"Diagnosis of {diagnosis.model}",
        command=command,
        verdict=Verdict(
            "bad" if diagnosis.misread else _TONES[diagnosis.verdict], _spoken(diagnosis), _advice(diagnosis)
        ),
        facts=_facts(diagnosis),
        rotational=diagnosis.rotational,
    )
    if diagnosis.posterior is not None:
        _odds(made, diagnosis.posterior)
    if diagnosis.traces:
        made.toggles(("measured", "measured"), ("before", "baseline"), *_after(diagnosis))
        _what(made, diagnosis)
        _where(made, diagnosis)
        _how_good(made, diagnosis)
        _evidence(made, diagnosis)
        _went_in(made, diagnosis)
    made.reproduce(command, {"Model": diagnosis.model, "Recordings": ", ".join(t.name for t in diagnosis.traces)})
    return made


def _after(d: Diagnosis) -> tuple[tuple[Role, str], ...]:
    return (("after", "with findings"),) if d.findings else ()


def _odds(page: Page, found: Posterior) -> None:
    """The probabilities of the headline, which add up to 1."""
    shares: tuple[tuple[str, float, Tone], ...] = (
        ("an effect of the library is missing", max(0.0, 1.0 - found.nothing - found.unknown), "warn"),
        ("nothing is missing", found.nothing, "good"),
        ("something is missing that no effect of the library explains", found.unknown, "neutral"),
    )
    page.odds(shares)


def summary(result: Diagnosis) -> str:
    """The verdict, each finding with its parameters, and the fit before and after."""
    lines = [f"{result.verdict.replace('_', ' ')}: {result.headline}"]
    lines += [f"to be mended: {text}" for text in result.misread]
    lines += [f"doubtful: {text}" for text in result.doubts]
    for finding in result.findings:
        values = ", ".join(f"{name} = {value_text(finding, name)}" for name in finding.parameters)
        ids = ", ".join(finding.alike)
        lines.append(f"  {title(finding)} ({ids}), probability {percent(finding.confidence)}: {values}")
        lines.append(f"    where: {finding.where.text}")
    given = {one.name: percent(one.free_run) for one in result.as_given}
    rows: list[tuple[str, ...]] = [("free run, x NRMSE", *(["as given"] if given else []), "before", "after")]
    for error in (*result.errors, *result.holdout):
        if error.free_run[0] is not None:
            first = [given.get(error.name, "-")] if given else []
            rows.append((error.name, *first, percent(error.free_run[0]), percent(error.free_run[1])))
    if len(rows) > 1:
        lines.append(columns(rows))
    if result.next_experiment:
        lines.append(f"next: {result.next_experiment}")
    return "\n".join(lines)


def _spoken(d: Diagnosis) -> str:
    """The verdict as it is said, with capital and colon."""
    return f"{d.verdict.replace('_', ' ').capitalize()}: {d.headline}"


def _advice(d: Diagnosis) -> str:
    told = [f"To be mended in the recordings: {text}." for text in d.misread]
    told += [f"Doubtful, and it may look like physics: {text}." for text in d.doubts]
    return " ".join([*told, f"Next: {d.next_experiment}" if d.next_experiment else ""]).strip()


def _facts(d: Diagnosis) -> list[Fact]:
    if not d.traces:
        return []
    before, after = (percent(error) for error in d.force_nrmse)
    shown = (
        (f"{before} → {after}", "baseline refitted → with findings") if d.findings else (before, "baseline refitted")
    )
    facts = [
        Fact("Force error", *shown),
        Fact("Noise floor", percent(d.noise_floor), "what a perfect model would leave"),
    ]
    listed = d.holdout or d.errors
    runs = [e.free_run for e in listed if e.free_run[0] is not None and e.free_run[1] is not None]
    if runs:
        first, last = (percent(float(np.mean([run[i] for run in runs]))) for i in (0, 1))
        label = "Free run, held out" if d.holdout else "Free run"
        text = f"{first} → {last}" if d.findings else first
        without = ", without the periodic force that nobody measured" if d.lines else ""
        facts.append(Fact(label, text, f"error of the displacement, NRMSE{without}"))
    if d.findings:
        least = min(finding.confidence for finding in d.findings)
        facts.append(Fact("Probability", percent(least), " and ".join(title(finding) for finding in d.findings)))
        if d.choice is not None and d.choice.named:
            facts.append(Fact("Explained", percent(d.choice.explained), "share of the misfit above the noise"))
    return facts


def title(finding: Finding) -> str:
    """The name under which a finding is shown: that of its class where it has one."""
    return finding.title or finding.effect.replace("_", " ")


_SIDES = {1.0: "+1 (x > 0)", -1.0: "-1 (x < 0)", 0.0: "0 (both)"}


def value_text(finding: Finding, name: str) -> str:
    """A parameter with its error; the side of a one-sided law in words."""
    value = finding.parameters[name]
    if name == finding.roles.get("switch") and value.value in _SIDES:
        return _SIDES[value.value]
    return with_error(value.value, value.stderr, value.unit)


def _meanings(d: Diagnosis, finding: Finding) -> dict[str, str]:
    """What an effect says of its parameters."""
    terms = d.final.hypothesis.terms if d.final is not None else ()
    own = [term.effect.meanings for term in terms if term.effect.id in finding.alike]
    known = _OF_FAULTS | {name: text for meanings in own for name, text in meanings.items()}
    return {name: known.get(name, "") for name in finding.parameters}


def _what(page: Page, d: Diagnosis) -> None:
    page.section("What was found")
    if not d.findings:
        page.text(d.headline + ".")
    for finding in d.findings:
        rows = [[name, value_text(finding, name), text] for name, text in _meanings(d, finding).items()]
        share = finding.explained
        where = finding.where.text[:1].upper() + finding.where.text[1:]
        note = f"{where}. " + (
            f"It explains {percent(share)} of the misfit above the noise." if share and math.isfinite(share) else ""
        )
        heading = title(finding)
        page.table(
            Table(
                heading[:1].upper() + heading[1:],
                ["parameter", "value ± standard error", "meaning"],
                rows,
                note.strip(),
            )
        )
    if d.findings:
        page.plots(*(plot for plot in (evidence.force_curve(d), evidence.both_ways(d)) if plot is not None))
    _candidates(page, d)
    _parameters(page, d)


def _chance(probability: float) -> str:
    """A probability in percent; what is below a hundredth of a percent is not told apart."""
    return "below 0.01 %" if probability < 1e-4 else percent(probability)


def _candidates(page: Page, d: Diagnosis) -> None:
    """What it could be, ranked: also where nothing is named."""
    ranked = d.candidates()[:_CANDIDATES]
    if ranked:
        rows = [[one["title"], _chance(one["probability"]), percent(one["explained"])] for one in ranked]
        columns = ["effect", "probability", "share of the misfit explained"]
        page.table(
            Table("What it could be", columns, rows, "Ranked. Each effect is fitted together with the baseline.")
        )


def _parameters(page: Page, d: Diagnosis) -> None:
    """Every parameter in the end, and what the refit of the baseline alone had to move."""
    if d.findings:
        sides = {f"{f.effect}.{name}": value_text(f, name) for f in d.findings for name in f.parameters}
        rows = [[k, sides.get(k, with_error(v.value, v.stderr, v.unit))] for k, v in d.final_values().items()]
        note = (
            "Baseline and findings, fitted together. These are the values in extended.mo. The errors are those of the "
            "fit; what the calibration of the channels leaves open comes on top."
        )
        page.table(Table("Final parameters", ["parameter", "value ± standard error"], rows, note))
    moved = []
    for name, value in d.refit.items():
        nominal = d.nominal.get(name)
        change = percent(value.value / nominal - 1) if nominal else "not available"
        moved.append([name, number(nominal, value.unit, 4), with_error(value.value, value.stderr, value.unit), change])
    scaled = any(note.startswith("start values") for note in d.notes)
    note = "Before anything is called missing, the baseline is fitted to the recordings as it is."
    note += " Values that were not given start from the size of the recordings." if scaled else ""
    columns = ["parameter", "start" if scaled else "given", "refitted", "change"]
    page.table(Table("Baseline alone", columns, moved, note))


def _where(page: Page, d: Diagnosis) -> None:
    page.section(
        "Where it acts",
        "Measured restoring force, and the model before and after. Point at a sample to see it in every view;"
        " the slider moves through the recording.",
    )
    ranked = sorted(d.traces, key=lambda t: -float(np.std(t.residual) / t.noise))
    named = bool(d.findings)
    for trace in ranked[:_LINKED]:
        used = "held out" if trace.held_out else "used for the fit"
        page.linked(f"{trace.name}, {used}", _linked(trace, named))
    page.plots(*(_map(d, which) for which in (("residual", "left") if named else ("residual",))))
    bent = None if named else evidence.both_ways(d)
    page.plots(*(plot for plot in (bent, evidence.since_turn(d), evidence.stiffness(d)) if plot is not None))
    tonal = max(d.traces, key=_tonality)
    bars = [_spectrum_bars(tonal, named)] if _tonality(tonal) > _TONAL else []
    energy = evidence.loop_energy(d)
    beside = [*bars, *([_levels(d, named)] if len(d.traces) > 1 else []), *([energy] if energy else [])]
    if beside:
        page.plots(*beside)
    page.plots(_in_time(ranked[0], named), columns=1)


def _linked(trace: Traces, named: bool) -> Linked:
    forces = [
        Series("measured", trace.R, "measured", dots=True),
        Series("baseline", trace.R - trace.residual, "before"),
    ]
    residual = [Series("baseline", trace.residual, "before")]
    if named:
        forces.append(Series("with findings", trace.R - trace.left, "after"))
        residual.append(Series("with findings", trace.left, "after"))
    return Linked.of((trace.t, trace.x, trace.v), forces, residual, trace.residual**2)


def _map(d: Diagnosis, which: str) -> Plot:
    """Mean residual in cells of (x, v), fewer for short recordings; cells with next to no samples stay empty."""
    x, v, r = (np.concatenate([getattr(t, name) for t in d.traces]) for name in ("x", "v", which))
    cells = int(np.clip(np.sqrt(len(x) / 20), 8, _CELLS))
    least = int(np.clip(len(x) / cells**2 / 4, 2, 20))
    edges = [np.linspace(np.quantile(u, 0.01), np.quantile(u, 0.99), cells + 1) for u in (x, v)]
    count, _, _ = np.histogram2d(x, v, bins=edges)
    total, _, _ = np.histogram2d(x, v, bins=edges, weights=r)
    mean = np.where(count >= least, total / np.maximum(count, 1), np.nan)
    middle = [(edge[1:] + edge[:-1]) / 2 for edge in edges]
    heading = "Residual of the baseline" if which == "residual" else "Residual with findings"
    heat = Heat(middle[0], middle[1], mean.T, "mean residual", "N")
    caption = f"Mean over all recordings. Empty: fewer than {least} samples."
    return Plot(heading, X_AXIS, V_AXIS, (heat,), caption)


def _tonality(trace: Traces) -> float:
    """Share of the power of the motion in its strongest line: near 1 for harmonic tests, small for sweeps and noise."""
    power = np.abs(np.fft.rfft((trace.x - np.mean(trace.x)) * np.hanning(len(trace.x)))) ** 2
    line = 1 + int(np.argmax(power[1:]))
    return float(np.sum(power[max(line - 2, 1) : line + 3]) / max(float(np.sum(power[1:])), 1e-300))


def _spectrum_bars(trace: Traces, named: bool) -> Plot:
    """Power of the force at multiples of the strongest line, even and odd apart."""
    spectrum = {}
    n = len(trace.t)
    dt = float(trace.t[1] - trace.t[0])
    window = np.hanning(n)
    for name, values in (
        ("measured", trace.R),
        ("baseline", trace.R - trace.residual),
        ("after", trace.R - trace.left),
    ):
        spectrum[name] = np.abs(np.fft.rfft((values - np.mean(values)) * window)) * 4 / n
    line = 1 + int(np.argmax(spectrum["measured"][1:]))
    levels = {name: [_near(s, k * line) for k in range(1, _HARMONICS + 1)] for name, s in spectrum.items()}
    top = max(levels["measured"][0], 1e-300)
    labels = [str(k) for k in range(1, _HARMONICS + 1)]
    floor = 80.0
    roles: tuple[tuple[str, str, Role], ...] = (
        ("measured", "measured", "measured"),
        ("baseline", "baseline", "before"),
        ("after", "with findings", "after"),
    )
    series = tuple(
        Bars(labels, np.array([floor + 20 * np.log10(max(a / top, 1e-4)) for a in levels[name]]), title, role, base=0.0)
        for name, title, role in (roles if named else roles[:2])
    )
    caption = (
        f"Multiples of {line / (n * dt):.4g} Hz, dB above -80 dB of the first. Even ones (2, 4, ...) tell of a law "
        "that differs between the two directions."
    )
    return Plot(f"Harmonics of the force, {trace.name}", Axis("Harmonic order"), Axis("Level", "dB"), series, caption)


def _near(spectrum: Array, line: int) -> float:
    part = spectrum[max(line - 2, 0) : line + 3]
    return float(np.max(part)) if len(part) else 0.0


def _levels(d: Diagnosis, named: bool) -> Plot:
    """Residual in noise units over the amplitude of the recording."""
    amplitude = np.array([np.sqrt(2) * np.std(t.x) for t in d.traces])
    before, after = (
        np.array([float(np.std(getattr(t, name)) / t.noise) for t in d.traces]) for name in ("residual", "left")
    )
    names = [t.name for t in d.traces]
    series = (
        Points(amplitude, before, "baseline", "before", names),
        *([Points(amplitude, after, "with findings", "after", names)] if named else []),
    )
    axes = Axis("Amplitude", "m"), Axis("Residual over the noise")
    return Plot("Residual by recording", *axes, series, "1 is the noise. Amplitude: rms times 1.41.")


def _in_time(trace: Traces, named: bool) -> Plot:
    series = (
        Line(trace.t, trace.residual, "baseline", "before", width=1.0),
        *([Line(trace.t, trace.left, "with findings", "after", width=1.0, opacity=0.8)] if named else []),
    )
    return Plot(f"Residual in time, {trace.name}", T_AXIS, FORCE, series)


def _how_good(page: Page, d: Diagnosis) -> None:
    page.section("How much better", "Free run: the model is driven by the measured force alone.")
    rows = [
        [e.name, kind, percent(e.force[0]), percent(e.force[1]), percent(e.free_run[0]), percent(e.free_run[1])]
        for kind, listed in (("used", d.errors), ("held out", d.holdout))
        for e in listed
    ]
    columns = ["recording", "use", "force before", "force after", "free run before", "free run after"]
    page.table(Table("Errors (NRMSE)", columns, rows, "Before: the baseline after its own refit."))
    if d.as_given:
        told = [[one.name, percent(one.force), percent(one.free_run)] for one in d.as_given]
        same = "Nothing is fitted: hystid validate reports the same."
        page.table(Table("The FMU as given (NRMSE)", ["recording", "force", "free run"], told, same))
    runs = [t for t in d.traces if t.free_before is not None and t.free_after is not None]
    held = [t for t in runs if t.held_out]
    for trace in (held or runs)[:_LINKED]:
        page.plots(_free_run(trace, bool(d.findings)), _free_errors(trace), columns=1)
    worst = max(d.traces, key=lambda t: float(np.std(t.left) / t.noise))
    page.plots(evidence.spectrum(worst, bool(d.findings)), evidence.autocorrelation(worst, bool(d.findings)))


def _free_run(trace: Traces, named: bool) -> Plot:
    parts, first = windows(trace.x)
    window = slice(parts[first].start, parts[first].stop)
    series = [Points(trace.t[window], trace.x[window], "measured", "measured", size=3.5)]
    runs: list[tuple[Array | None, str, Role]] = [(trace.free_before, "baseline", "before")]
    runs += [(trace.free_after, "with findings", "after")] if named else []
    lines = [Line(trace.t[window], run[window], name, role, width=1.3) for run, name, role in runs if run is not None]
    heading = f"Free run, {trace.name}{' (held out)' if trace.held_out else ''}"
    return Plot(heading, T_AXIS, X_AXIS, (*series, *lines))


def _free_errors(trace: Traces) -> Plot:
    """Error of the free run over the whole recording, in the unit of the displacement."""
    runs: tuple[tuple[Array | None, str, Role], ...] = (
        (trace.free_before, "baseline", "before"),
        (trace.free_after, "with findings", "after"),
    )
    series = tuple(Line(trace.t, run - trace.x, name, role, width=1.0) for run, name, role in runs if run is not None)
    heading = f"Error of the free run, {trace.name}"
    return Plot(heading, T_AXIS, X_AXIS, series, "Simulated less measured.", height=260)


def _evidence(page: Page, d: Diagnosis) -> None:
    page.section("Evidence", "What each effect leaves when it is added: 1 is the noise. The simpler law wins a tie.")
    tried = evidence.tried(d)
    if tried is not None:
        page.table(tried)
    likeness = evidence.look_alikes(d)
    if likeness is not None:
        page.plots(likeness, columns=1)
    for finding in d.findings:
        if len(finding.alike) > 1:
            first, *others = (d.catalogue.title(name) for name in finding.alike)
            page.text(f"These recordings do not distinguish {first} from {' or '.join(others)}. {d.next_experiment}")
    if d.untestable:
        listed = ", ".join(d.catalogue.title(name) for name in d.untestable)
        page.text(f"Not identifiable from these recordings: {listed}.")
    if d.unknown:
        page.text(d.unknown.text + ".")
    if d.notes:
        page.text("Notes:")
        page.bullets(dict.fromkeys(d.notes))


def _went_in(page: Page, d: Diagnosis) -> None:
    page.section("What went in", "Every recording as it was used: displacement and restoring force over time.")
    for trace in d.traces[:_OVERVIEWS]:
        page.plots(
            raw(f"x, {trace.name}", trace.t, Axis("x", "m"), trace.x, 190),
            raw(f"R, {trace.name}", trace.t, Axis("R", "N"), trace.R, 190),
        )
    if len(d.traces) > _OVERVIEWS:
        page.text(f"The first {_OVERVIEWS} of {len(d.traces)} recordings are shown.")
