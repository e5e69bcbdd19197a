"""Report of ``hystid check``: what is in the recordings, and whether their channels fit together."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

import numpy as np

from hystid.consistency import Channel, Examination, Examined
from hystid.errors import listed
from hystid.recording import Recording
from hystid.report.curves import raw, responses
from hystid.report.page import Cell, Fact, Page, Table, Verdict, columns, number, percent, with_error
from hystid.report.plots import Axis, Line, Plot
from hystid.rotation import turned_text

_SHOWN_RECORDINGS = 6  # recordings with pictures
_COLUMNS = 8  # further columns that are told by name
_LINES = 2048  # of a spectrum: resolution enough for a page


def page(result: Examination, command: str) -> Page:
    """The report; a pure function of the result. command: what the reader can run to get it again."""
    count = len(result.examined)
    made = Page(
        f"Check of {result.examined[0].recording if count == 1 else f'{count} recordings'}",
        command=command,
        verdict=verdict(result),
        facts=[
            Fact("Recordings", f"{count}"),
            Fact("To be mended", f"{len(result.refusals)}", "before anything is computed from them"),
            Fact("Notes", f"{len(result.notes)}", "worth knowing"),
        ],
        rotational=any(item.rotational for item in result.examined),
    )
    if result.findings:
        made.section("Findings")
        made.bullets(str(finding) for finding in (*result.refusals, *result.notes))
    for item in result.examined:
        made.section(item.recording, f"{item.samples} samples at {item.sample_rate:.6g} Hz")
        made.table(Table("Channels", _CHANNEL_HEAD, _channels(item)))
        if item.relations:
            made.table(Table("Do they show one motion?", _RELATION_HEAD, _relations(item), _RELATION_NOTE))
        if item.balance is not None:
            made.table(Table("Force and motion", ["what", "value"], _balance(item)))
        if item.undecided:
            made.text("What this recording does not show, and was not checked:")
            made.bullets(item.undecided.values())
        if item.unexamined:
            made.text(f"{item.unexamined}.")
        if further := _further(result, item):
            made.text(further)
        recording = next((r for r in result.recordings[:_SHOWN_RECORDINGS] if r.name == item.recording), None)
        if recording is not None:
            made.plots(*_pictures(recording))
    levels = responses(result.recordings)
    if levels is not None:
        made.section("Displacement over force, by level", "A linear structure answers alike at every level.")
        made.plots(levels, *_coherences(result.recordings))
    made.reproduce(command)
    return made


def verdict(result: Examination) -> Verdict:
    """The sentence on top."""
    if result.refusals:
        first = result.refusals[0]
        return Verdict("bad", f"{first.recording}: {first.sentence}", f"To mend it: {first.mend}.")
    if result.notes:
        first = result.notes[0]
        fit = "Not all was examined" if result.unexamined else "The channels fit together"
        return Verdict("warn", f"{fit}, with {_notes(len(result.notes))}", f"{first.sentence}.")
    if result.unexamined:
        return Verdict("warn", "Too short to be examined", f"{'. '.join(result.unexamined)}.")
    return Verdict("good", "Nothing speaks against using these recordings", "Units, signs and clocks fit together.")


def _notes(count: int) -> str:
    return "one note" if count == 1 else f"{count} notes"


def summary(result: Examination) -> str:
    """Channels, relations and findings in plain text."""
    parts: list[str] = []
    for item in result.examined:
        before = len(parts)
        parts.append(f"{item.recording}: {item.samples} samples at {item.sample_rate:.6g} Hz")
        parts.append(columns([tuple(_CHANNEL_HEAD), *(_plain(row) for row in _channels(item))]))
        if item.relations:
            parts.append(columns([tuple(_RELATION_HEAD), *(_plain(row) for row in _relations(item))]))
        if item.balance is not None:
            parts.append("; ".join(f"{what}: {value}" for what, value in _balance(item)))
        parts += item.undecided.values()
        parts += [further] if (further := _further(result, item)) else []
        parts[before:] = map(turned_text, parts[before:]) if item.rotational else parts[before:]
    parts += [f"{'mend' if f.severity == 'refuse' else 'note'}: {f}" for f in (*result.refusals, *result.notes)]
    parts += result.unexamined
    if not result.findings and not result.unexamined:
        parts.append("nothing speaks against using these recordings")
    return "\n".join(parts)


def _further(result: Examination, item: Examined) -> str:
    """Columns that are no channel: a misspelt one would be missed without a word."""
    names = next((list(r.extra) for r in result.recordings if r.name == item.recording), [])
    if not names:
        return ""
    return f"columns that are no channel: {listed(names, _COLUMNS)}; choose one with --channel, as --channel x=COLUMN"


def _plain(row: Iterable[str | Cell]) -> tuple[str, ...]:
    return tuple(cell.text if isinstance(cell, Cell) else cell for cell in row)


_CHANNEL_HEAD = ["channel", "lowest", "highest", "rms", "signal to noise", "usable band", "measured?"]
_RELATION_HEAD = ["relation", "gain", "sign", "lag", "coherence", "band"]
_RELATION_NOTE = (
    "Gain 1, sign + and no lag are right. The errors come from the coherence and from sections of the test."
)
_ANGULAR = {"F": "F (torque)", "x": "x (angle)"}
_SLOPES = {("x", "v"): "v over dx/dt", ("x", "a"): "a over d2x/dt2", ("v", "a"): "a over dv/dt"}


def _channels(item: Examined) -> list[list[str | Cell]]:
    return [
        [
            _ANGULAR.get(name, name) if item.rotational else name,
            number(channel.low, channel.unit, 4), number(channel.high, channel.unit, 4),
            number(channel.rms, channel.unit, 4), _decibels(channel), _band(channel.band),
            "yes" if channel.measured else channel.origin,
        ]
        for name, channel in item.channels.items()
    ]  # fmt: skip


def _decibels(channel: Channel) -> str:
    if not math.isfinite(channel.noise_db):
        return "no noise seen"
    return f"{'' if channel.white else 'more than '}{channel.noise_db:.0f} dB"


def _band(band: tuple[float, float]) -> str:
    return f"{band[0]:.3g} to {band[1]:.3g} Hz" if band[1] > 0 else "-"


def _relations(item: Examined) -> list[list[str | Cell]]:
    rows: list[list[str | Cell]] = []
    for relation in item.relations:
        gain = f"{relation.gain:.4g} ± {relation.gain * relation.gain_error:.2g}" if relation.gain > 0 else "-"
        lag = with_error(1e3 * relation.lag, 1e3 * relation.lag_error, "ms")
        sign = Cell("+", "good") if relation.sign > 0 else Cell("-", "bad")
        name = _SLOPES[relation.low, relation.high]
        rows.append([name, gain, sign, lag, percent(relation.coherence), _band(relation.band)])
    return rows


def _balance(item: Examined) -> list[tuple[str, str]]:
    balance, unit = item.balance, "kg.m2" if item.rotational else "kg"
    assert balance is not None  # asked for where there is one
    rows = [
        ("share of F that a passive structure explains", percent(balance.passive)),
        ("the same share with F reversed", percent(balance.reversed)),
    ]
    if math.isfinite(balance.mass_error):
        low, high = balance.mass_bounds
        word = "inertia" if item.rotational else "mass"
        rows.append((f"moving {word} by F over a", f"between {number(low, unit)} and {number(high, unit)}"))
    return rows


def _pictures(recording: Recording) -> list[Plot]:
    held = recording.channels("Fxva")
    found = [raw(name, recording.t, Axis(name, recording.unit(name)), values, 180) for name, values in held.items()]
    if recording.quasi_static:
        return found
    lines = [_spectrum(name, values, recording.dt) for name, values in held.items()]
    caption = "Each channel over its own largest density. A flat end is noise; the motion stands above it."
    axis = Axis("Power density", "1", log=True)
    return [*found, Plot("Spectra", Axis("Frequency", "Hz", log=True), axis, lines, caption)]


def _spectrum(name: str, values: np.ndarray, dt: float) -> Line:
    from scipy.signal import welch

    frequency, power = welch(values - np.mean(values), fs=1 / dt, nperseg=min(len(values), _LINES))
    inside = frequency > 0
    return Line(frequency[inside], power[inside] / max(float(power[inside].max()), 1e-300) + 1e-20, name)


def _coherences(recordings: Sequence[Recording]) -> list[Plot]:
    """Coherence of F and x of recordings with time, weak to strong."""
    from scipy.signal import coherence

    lines = []
    timed = [r for r in recordings if r.F is not None and r.x is not None and not r.quasi_static and len(r) >= 256]
    for r in sorted(timed, key=lambda r: float(np.std(np.asarray(r.F))))[:_SHOWN_RECORDINGS]:
        x = np.asarray(r.x)
        frequency, share = coherence(np.asarray(r.F), x, fs=1 / r.dt, nperseg=min(len(r) // 8, _LINES))
        level = number(float(np.std(np.asarray(r.F))), r.unit("F"), 3)
        lines.append(Line(frequency[1:], share[1:], f"{r.name}, {level} rms"))
    caption = "1: the displacement follows from the force alone. Noise and laws that are not linear take from it."
    axes = Axis("Frequency", "Hz", log=True), Axis("Coherence of F and x", "")
    return [Plot("Coherence by level", *axes, lines, caption)] if lines else []
