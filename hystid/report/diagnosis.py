"""Report of a diagnosis: verdict first, then loops, the residual map, harmonics, amplitude, time, and the evidence."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hystid.diagnosis import Diagnosis, Traces
from hystid.diagnosis.answer import in_words
from hystid.report import evidence
from hystid.report.page import Cell, Fact, Page, Table, Tone, Verdict, number, percent, with_error
from hystid.report.plots import Axis, Bars, Heat, Line, Plot, Points, Role

Array = NDArray[np.float64]
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
_LOOPS = 4  # recordings whose loops are shown
_SHORT = 3000  # samples up to which loops are shown as a whole
_TONAL = 0.3  # share of the power in one line above which multiples of it mean something


def write_diagnosis(diagnosis: Diagnosis, path: Path, command: str = "hystid diagnose") -> Path:
    """Write ``report.html``; a pure function of the diagnosis."""
    page = Page(
        f"Diagnosis of {diagnosis.model}",
        command=command,
        verdict=Verdict(_TONES[diagnosis.verdict], _spoken(diagnosis), _advice(diagnosis)),
        facts=_facts(diagnosis),
    )
    if diagnosis.traces:
        _what(page, diagnosis)
        _where(page, diagnosis)
        _how_good(page, diagnosis)
        _evidence(page, diagnosis)
    page.reproduce(command, {"Model": diagnosis.model, "Recordings": ", ".join(t.name for t in diagnosis.traces)})
    return page.write(path)


def _spoken(d: Diagnosis) -> str:
    """The verdict as it is said, with capital and colon."""
    return f"{d.verdict.replace('_', ' ').capitalize()}: {d.headline}"


def _advice(d: Diagnosis) -> str:
    return f"Next: {d.next_experiment}" if d.next_experiment else ""


def _facts(d: Diagnosis) -> list[Fact]:
    if not d.traces:
        return []
    before, after = (percent(error) for error in d.force_nrmse)
    told = (f"{before} → {after}", "refitted model → with findings") if d.findings else (before, "refitted model")
    facts = [
        Fact("Force error", *told),
        Fact("Noise floor", percent(d.noise_floor), "what a perfect model would leave"),
    ]
    listed = d.holdout or d.errors
    runs = [e.free_run for e in listed if e.free_run[0] is not None and e.free_run[1] is not None]
    if runs:
        first, last = (percent(float(np.mean([run[i] for run in runs]))) for i in (0, 1))
        label = "Free run, held out" if d.holdout else "Free run"
        shown = f"{first} → {last}" if d.findings else first
        facts.append(Fact(label, shown, "error of the displacement, NRMSE"))
    if d.findings:
        facts.append(Fact("How sure", f"{d.findings[0].confidence:.2f}", "1 is certain; look-alikes lower it"))
    return facts


def _what(page: Page, d: Diagnosis) -> None:
    page.section("What was found")
    if not d.findings:
        page.text(d.headline + ".")
    for finding in d.findings:
        rows = [[name, with_error(v.value, v.stderr, v.unit)] for name, v in finding.parameters.items()]
        page.table(Table(in_words(finding), ["parameter", "value ± standard error"], rows, finding.where.text))
    moved = []
    for name, value in d.refit.items():
        nominal = d.nominal.get(name)
        change = percent(value.value / nominal - 1) if nominal else "not available"
        moved.append([name, number(nominal, value.unit, 4), with_error(value.value, value.stderr, value.unit), change])
    scaled = any(note.startswith("start values") for note in d.notes)
    note = "What the refit had to move before anything was called missing."
    note += " What was not given started at values scaled from the recordings." if scaled else ""
    page.table(Table("Baseline", ["parameter", "start" if scaled else "given", "refitted", "change"], moved, note))


def _where(page: Page, d: Diagnosis) -> None:
    page.section(
        "Where it acts",
        "The loops show the measured restoring force, and the model without and with the findings. The"
        " map shows the mean residual of the refitted baseline over displacement and velocity.",
    )
    ranked = sorted(d.traces, key=lambda t: -float(np.std(t.residual) / t.noise))
    named = bool(d.findings)
    shown = sorted(ranked[:_LOOPS], key=lambda t: float(np.ptp(t.x)))
    page.plots(*(_loops(trace, named) for trace in shown))
    page.plots(*(_map(d, which) for which in (("residual", "left") if named else ("residual",))))
    page.plots(*(plot for plot in (evidence.both_ways(d), evidence.since_turn(d)) if plot is not None))
    tonal = max(d.traces, key=_tonality)
    bars = [_spectrum_bars(tonal, named)] if _tonality(tonal) > _TONAL else []
    energy = evidence.loop_energy(d)
    beside = [*bars, *([_levels(d, named)] if len(d.traces) > 1 else []), *([energy] if energy else [])]
    if beside:
        page.plots(*beside)
    page.plots(_in_time(ranked[0], named), columns=1)


def _loops(trace: Traces, named: bool) -> Plot:
    window = _worst_window(trace)
    x, R = trace.x[window], trace.R[window]
    lines: list[Points | Line] = [
        Points(x, R, "measured", "measured", size=2.5, opacity=0.5),
        Line(x, R - trace.residual[window], "baseline", "before"),
    ]
    if named:
        lines.append(Line(x, R - trace.left[window], "with findings", "after"))
    caption = "The whole recording." if len(trace.t) < _SHORT else "Window with the largest residual."
    return Plot(f"Loops, {trace.name}", Axis("displacement", "m"), Axis("restoring force", "N"), lines, caption)


def _worst_window(trace: Traces) -> slice:
    """A tenth of the recording around the largest local residual; a short one as a whole."""
    if len(trace.t) < _SHORT:
        return slice(None)
    width = max(50, len(trace.t) // 10)
    level = np.convolve(trace.residual**2, np.ones(width), mode="valid")
    first = int(np.argmax(level))
    return slice(first, first + width)


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
    title = "Residual of the baseline" if which == "residual" else "What is left in the end"
    heat = Heat(middle[0], middle[1], mean.T, "mean residual", "N")
    return Plot(
        title, Axis("displacement", "m"), Axis("velocity", "m/s"), (heat,), f"Empty: fewer than {least} samples."
    )


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
    return Plot(f"Harmonics of the force, {trace.name}", Axis("harmonic"), Axis("level", "dB"), series, caption)


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
    axes = Axis("amplitude", "m"), Axis("residual in units of the noise")
    return Plot("Which recordings it touches", *axes, series, "1 is the noise. Amplitude: rms times 1.41.")


def _in_time(trace: Traces, named: bool) -> Plot:
    series = (
        Line(trace.t, trace.residual, "residual of the baseline", "before", width=1.0),
        *([Line(trace.t, trace.left, "what is left", "after", width=1.0, opacity=0.8)] if named else []),
    )
    return Plot(f"Residual in time, {trace.name}", Axis("time", "s"), Axis("force", "N"), series)


def _how_good(page: Page, d: Diagnosis) -> None:
    page.section("How much better", "Free run: the model is driven by the measured force alone.")
    rows = [
        [e.name, kind, percent(e.force[0]), percent(e.force[1]), percent(e.free_run[0]), percent(e.free_run[1])]
        for kind, listed in (("used", d.errors), ("held out", d.holdout))
        for e in listed
    ]
    columns = ["recording", "", "force before", "force after", "free run before", "free run after"]
    page.table(Table("Errors (NRMSE)", columns, rows, "Before: the baseline after its own refit."))
    for trace in d.traces:
        if trace.free_after is not None and trace.free_before is not None:
            window = _worst_window(trace)
            series = (
                Line(trace.t[window], trace.x[window], "measured", "measured"),
                Line(trace.t[window], trace.free_before[window], "baseline", "before", "dash"),
                Line(trace.t[window], trace.free_after[window], "with findings", "after"),
            )
            page.plots(Plot(f"Free run, {trace.name}", Axis("time", "s"), Axis("displacement", "m"), series), columns=1)
            page.plots(_free_errors(trace), columns=1)
            break
    worst = max(d.traces, key=lambda t: float(np.std(t.left) / t.noise))
    page.plots(evidence.spectrum(worst, bool(d.findings)), evidence.autocorrelation(worst, bool(d.findings)))


def _free_errors(trace: Traces) -> Plot:
    """Error of the free run over the whole recording, in the unit of the displacement."""
    runs = ((trace.free_before, "baseline", "before"), (trace.free_after, "with findings", "after"))
    series = tuple(
        Line(trace.t, run - trace.x, name, role, width=1.0)  # type: ignore[arg-type]  # roles of the table above
        for run, name, role in runs
        if run is not None
    )
    title = f"Error of the free run, {trace.name}"
    return Plot(title, Axis("time", "s"), Axis("displacement", "m"), series, "Simulated less measured.", height=260)


def _evidence(page: Page, d: Diagnosis) -> None:
    page.section("Evidence", "What was tried first, and what the fit left: 1 is the noise. Simpler laws win ties.")
    choice = d.choice
    if choice is not None and choice.trials:
        rows: list[list[str | Cell]] = [
            [
                t.name,
                t.form or "plain",
                number(t.chi2, digits=4),
                percent(t.absorbed),
                Cell("named", "good") if t.name in choice.named else Cell("rejected"),
            ]
            for t in choice.trials[:15]
        ]
        columns = ["effect", "form", "mean square left", "absorbed by the refit", ""]
        note = (
            f"Baseline {choice.before.chi2:.4g}, floor {choice.floor_after:.4g}; explained {percent(choice.explained)}."
        )
        page.table(Table("Candidates", columns, rows, note))
    alike = evidence.look_alikes(d)
    if alike is not None:
        page.plots(alike, columns=1)
    for finding in d.findings:
        others = [name for name in finding.alike if name != finding.effect]
        if others:
            page.text(
                f"{finding.effect} cannot be told from {', '.join(others)} by these recordings. {d.next_experiment}"
            )
    if d.untestable:
        listed = ", ".join(name.replace("_", " ") for name in d.untestable)
        page.text(f"Not testable with these recordings, as the refit or their lack of rates hides them: {listed}.")
    if d.unknown:
        page.text(d.unknown.text + ".")
    if d.notes:
        page.bullets(d.notes)
