"""Figures and tables of a diagnosis that show what kind of force is missing, and how sure its name is."""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.signal import welch

from hystid.diagnosis import Diagnosis, Traces
from hystid.diagnosis.decide.trials import Trial
from hystid.diagnosis.prepare.chain import turns
from hystid.numeric import Array
from hystid.report.curves import FORCE, V_AXIS, X_AXIS, response
from hystid.report.page import Cell, Table, number, percent
from hystid.report.plots import Axis, Bars, Line, Mark, Plot, Points, Role, Series

_BINS = 30
_LEAST_IN_LONG, _LEAST_IN_SHORT = 8, 3  # samples in a bin below which it is left out, in long and in short recordings
_CLOSED = 0.2  # gap of a loop over its range beyond which it has no energy of its own
_POINTS = 2500  # of a cloud: more hide each other
_CURVES = 6
_LOOPS = 500  # of the loops whose energy is shown
_LAGS = 200
_CANDIDATES = 10
_TRIALS = 15
_TRIED_HEAD = ["effect", "form", "mean square left", "collinear with the refit", "outcome"]

_STAGES: tuple[tuple[str, str, Role], ...] = (("residual", "baseline", "before"), ("left", "with findings", "after"))


def stages(named: bool) -> tuple[tuple[str, str, Role], ...]:
    """Attribute of the traces, name and role of what is shown: the second only where something was named."""
    return _STAGES if named else _STAGES[:1]


def both_ways(d: Diagnosis) -> Plot:
    """Mean residual over displacement, forward and backward apart."""
    x, v = (np.concatenate([getattr(t, name) for t in d.traces]) for name in ("x", "v"))
    edges = np.linspace(np.min(x), np.max(x), _BINS + 1)
    series: list[Series] = []
    for attribute, name, role in stages(bool(d.findings)):
        r = np.concatenate([getattr(t, attribute) for t in d.traces])
        for way, side in ((1.0, "forward"), (-1.0, "backward")):
            middle, mean = _binned(x, r, edges, way * v > 0)
            series.append(Line(middle, mean, f"{name}, {side}", role, "solid" if way > 0 else "dash"))
    caption = (
        "The mean of the two curves is the elastic part, half their distance the dissipative one. "
        "Both bend at a threshold of displacement."
    )
    return Plot("Residual over displacement", X_AXIS, FORCE, tuple(series), caption)


def force_curve(d: Diagnosis) -> Plot | None:
    """The force that was missing and the law that was found for it, with its thresholds; None without a finding.

    Over displacement or velocity, whichever of the two tells more of the law's force.
    """
    if not d.findings:
        return None
    x, v, law, missing = (
        np.concatenate(columns)
        for columns in zip(*((t.x, t.v, t.effect, t.effect + t.left) for t in d.traces), strict=True)
    )
    over_x = _scatter(x, law) <= _scatter(v, law)
    at, axis = (x, X_AXIS) if over_x else (v, V_AXIS)
    step = max(1, len(at) // _POINTS)
    series = (
        Points(at[::step], missing[::step], "measured force less baseline", "measured", size=5.0, opacity=0.35),
        Points(at[::step], law[::step], "law that was found", "after", size=2.0),
    )
    span = float(np.max(np.abs(at)))
    begins = [place for finding in d.findings for place in finding.where.begins if over_x and abs(place) <= span]
    shown = tuple(Mark(place, text=f"threshold {number(place, axis.unit, 4)}", role="bad") for place in begins)
    caption = f"One sample in {step} of all recordings." if step > 1 else "All samples of all recordings."
    caption += " Dotted: the threshold of the law." if shown else ""
    return Plot("Force that was missing", axis, FORCE, series, caption, marks=shown)


def _scatter(at: Array, values: Array) -> float:
    """Mean square of the values about their mean in classes of ``at`` with equally many samples."""
    order = np.argsort(at, kind="stable")
    return float(np.mean([np.var(part) for part in np.array_split(values[order], _BINS)]))


def stiffness(d: Diagnosis) -> Plot | None:
    """Dynamic stiffness |R/x| over frequency, one curve per level of motion; None where no band is excited."""
    order = sorted(d.traces, key=lambda t: float(np.std(t.x)))
    curves = [
        Line(f, level, f"{number(float(np.std(t.x)), 'm')} rms, {t.name}", width=1.3)
        for t in order[:: max(1, len(order) // _CURVES)]
        for f, level in [response(t.x, t.R, float(t.t[1] - t.t[0]))]
        if len(f) > _LEAST_IN_SHORT
    ]
    if not curves:
        return None
    axes = Axis("Frequency", "Hz", log=True, prefix=False), Axis("|R/x|", "N/m", log=True)
    caption = "By level of motion. A linear structure gives one curve; friction softens and stops stiffen with level."
    return Plot("Frequency response by level", *axes, curves, caption)


def since_turn(d: Diagnosis) -> Plot | None:
    """Mean residual in the direction of motion over the distance from the last turning point; None without turns."""
    distance, way = [], []
    for trace in d.traces:
        at = np.array([0, *turns(trace.x, 0.05)])
        last = at[np.searchsorted(at, np.arange(len(trace.x)), side="right") - 1]
        known = last > 0
        distance.append(np.where(known, np.abs(trace.x - trace.x[last]), np.nan))
        way.append(np.sign(trace.x - trace.x[last]))
    far, sign = np.concatenate(distance), np.concatenate(way)
    known = np.isfinite(far)
    if np.count_nonzero(known) < 10 * _LEAST_IN_LONG:
        return None
    edges = np.linspace(0.0, float(np.nanmax(far)), _BINS + 1)
    series = []
    for attribute, name, role in stages(bool(d.findings)):
        r = np.concatenate([getattr(t, attribute) for t in d.traces]) * sign
        series.append(Line(*_binned(far, r, edges, known), name, role))
    caption = "Along the motion. A law with memory rises over the first part; one without memory jumps."
    axes = Axis("Distance since reversal", "m"), FORCE
    return Plot("Residual since the last reversal", *axes, tuple(series), caption)


def loop_energy(d: Diagnosis) -> Plot | None:
    """Energy per loop over its amplitude, measured and modelled; None with fewer than two loops."""
    found = [loop for trace in d.traces for loop in _loops(trace)]
    if len(found) < 2:
        return None
    amplitude, *energies = (np.array(column) for column in zip(*found, strict=True))
    names: tuple[tuple[str, Role], ...] = (("measured", "measured"), ("baseline", "before"), ("with findings", "after"))
    series = []
    for energy, (name, role) in zip(energies, names if d.findings else names[:2], strict=False):
        good = np.flatnonzero(energy > 0)
        good = good[:: max(1, len(good) // _LOOPS)]
        series.append(Points(amplitude[good], energy[good], name, role, size=6.0))
    caption = "Slopes: 1 dry friction, 2 a viscous damper at one frequency, 3 micro-slip or quadratic damping."
    axes = Axis("Amplitude", "m", log=True, prefix=False), Axis("Energy per loop", "J", log=True, prefix=False)
    return Plot("Energy lost per loop", *axes, tuple(series), caption)


def spectrum(trace: Traces, named: bool) -> Plot:
    """Spectral density of the residual and the level of the noise."""
    rate = 1.0 / float(trace.t[1] - trace.t[0])
    series: list[Series] = []
    for attribute, name, role in stages(named):
        frequency, power = welch(getattr(trace, attribute), rate, nperseg=min(1024, len(trace.t) // 2))
        series.append(Line(frequency[1:], np.sqrt(power[1:]), name, role))
    noise = trace.noise * np.sqrt(2.0 / rate)
    series.append(Line(frequency[[1, -1]], np.full(2, noise), "noise", "muted", "dot"))
    axes = Axis("Frequency", "Hz", log=True, prefix=False), Axis("Density", "N/√Hz", log=True)
    return Plot(f"Spectrum of the residual, {trace.name}", *axes, tuple(series), "White noise is the dotted line.")


def autocorrelation(trace: Traces, named: bool) -> Plot:
    """Autocorrelation of the residual: that of white noise is zero."""
    n = len(trace.t)
    lags = np.arange(min(_LAGS, n // 4))
    series = []
    for attribute, name, role in stages(named):
        r = getattr(trace, attribute) - np.mean(getattr(trace, attribute))
        power = np.abs(np.fft.rfft(r, 2 * n)) ** 2
        series.append(Line(lags * (trace.t[1] - trace.t[0]), _unit(np.fft.irfft(power)[: len(lags)]), name, role))
    bound = 2.0 / np.sqrt(n)
    marks = tuple(Mark(at, axis="y") for at in (-bound, bound))
    caption = "Outside the grey lines something other than white noise is left."
    heading, axes = f"Autocorrelation of the residual, {trace.name}", (Axis("Lag", "s"), Axis("Correlation"))
    return Plot(heading, *axes, tuple(series), caption, marks=marks)


def look_alikes(d: Diagnosis) -> Plot | None:
    """How much of the same mismatch each candidate explains, and how alike its explanation is to that of the name."""
    choice = d.choice
    if choice is None or not choice.trials or not d.findings:
        return None
    before = choice.before
    excess = before.chi2 - choice.floor_before
    best: dict[str, Trial] = {}
    for trial in choice.trials:
        best.setdefault(trial.name, trial)
    first = before.residual - choice.after.residual
    shown = list(best.values())[:_CANDIDATES]
    share = np.array([max(0.0, 1.0 - (t.chi2 - choice.floor_before) / excess) for t in shown])
    alike = np.array([_cosine(first, before.residual - t.fit.residual) for t in shown])
    labels = [d.catalogue.title(t.name) for t in shown]
    series = (
        Bars(labels, share, "explains alone", "after", horizontal=True),
        Bars(labels, alike, "likeness to what was named", "muted", horizontal=True),
    )
    caption = (
        "Where both are near 1, these recordings hardly distinguish the two. Likeness: cosine of what they explain."
    )
    return Plot("What else it could be", Axis("Share", bounds=(0.0, 1.0)), Axis(" "), series, caption)


def _binned(at: Array, values: Array, edges: Array, chosen: NDArray[np.bool_]) -> tuple[Array, Array]:
    """Means of the chosen values in bins, NaN where there are too few."""
    count, _ = np.histogram(at[chosen], edges)
    total, _ = np.histogram(at[chosen], edges, weights=values[chosen])
    least = _LEAST_IN_LONG if len(at) > 100 * len(edges) else _LEAST_IN_SHORT
    return (edges[1:] + edges[:-1]) / 2, np.where(count >= least, total / np.maximum(count, 1), np.nan)


def _loops(trace: Traces) -> list[tuple[float, float, float, float]]:
    """Amplitude, and energy measured, of the baseline and of the extended model, per closed loop."""
    at: Sequence[int] = turns(trace.x, 0.05)
    found = []
    for first, last in zip(at, at[2:], strict=False):
        span = slice(first, last + 1)
        x, R = trace.x[span], trace.R[span]
        if abs(x[-1] - x[0]) < _CLOSED * np.ptp(x):
            forces = R, R - trace.residual[span], R - trace.left[span]
            measured, before, after = (float(np.trapezoid(force, x)) for force in forces)
            found.append((float(np.ptp(x)) / 2, measured, before, after))
    return found


def _unit(values: Array) -> Array:
    return np.asarray(values / values[0]) if values[0] > 0 else values


def _cosine(one: Array, other: Array) -> float:
    size = float(np.linalg.norm(one) * np.linalg.norm(other))
    return abs(float(one @ other)) / size if size > 0 else 0.0


def tried(d: Diagnosis) -> Table | None:
    """The forms that were tried first, the best fit of each; None where none was."""
    if d.choice is None or not d.choice.trials:
        return None
    best: dict[tuple[str, str], Trial] = {}
    for trial in d.choice.trials:
        best.setdefault((trial.name, trial.form), trial)
    leading = {trial.name: trial.form for trial in reversed(best.values())}
    rows: list[list[str | Cell]] = [
        [
            d.catalogue.title(trial.name), _words(trial.form), number(trial.chi2, digits=4), percent(trial.absorbed),
            _judged(d, trial, leading=trial.form == leading[trial.name]),
        ]
        for trial in list(best.values())[:_TRIALS]
    ]  # fmt: skip
    note = (
        f"The baseline leaves {number(d.choice.before.chi2, digits=4)}, "
        f"a perfect model would leave {number(d.choice.floor_after, digits=4)}. "
        f"What is named explains {percent(d.choice.explained)} of the difference."
    )
    return Table("Effects that were tried first", _TRIED_HEAD, rows, note)


def _words(form: str) -> str:
    """A form in words: "KelvinVoigt" is "Kelvin Voigt"."""
    return re.sub(r"(?<=[a-z])(?=[A-Z])", " ", form) or "plain"


def _judged(d: Diagnosis, trial: Trial, *, leading: bool) -> Cell:
    if d.choice is not None and trial.name in d.choice.named:
        return Cell("named", "good") if leading else Cell("another form")
    alike = {name for finding in d.findings for name in finding.alike}
    return Cell("not distinguishable" if trial.name in alike else "rejected")
