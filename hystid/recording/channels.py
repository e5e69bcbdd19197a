"""From the columns of a table to the channels t, F, x, v, a, R in SI units."""

from __future__ import annotations

import difflib
import re
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from hystid.errors import UsageError
from hystid.recording.problems import Problem, Severity
from hystid.recording.table import Column, Table
from hystid.recording.types import CHANNELS, PSEUDO_TIME, Array
from hystid.units import parse, to_si

SI = {"t": "s", **CHANNELS}

_ALIASES = {
    "t": ("t", "time", "zeit", "t_pseudo", "time_pseudo"),
    "F": ("f", "force", "load", "excitation", "input_force", "f_ext"),
    "x": ("x", "disp", "displ", "displacement", "position", "pos"),
    "v": ("v", "vel", "velocity", "speed", "xd", "xdot"),
    "a": ("a", "acc", "accel", "acceleration", "xdd", "xddot"),
    "R": ("r", "restoring_force", "restoring"),
}
_NUMBER = re.compile(r"^\s*([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)(.*)$")
_CANONICAL = {alias: name for name, aliases in _ALIASES.items() for alias in aliases}


def known_name(name: str) -> str | None:
    """The channel (t, F, x, v, a, R) that a column of this name holds, None when hystid has no meaning for it."""
    return _CANONICAL.get(name.strip().lower().replace(" ", "_"))


@dataclass(frozen=True)
class Channels:
    """Channels in SI units. values holds t and what else was found; extra the columns that hystid has no name for."""

    values: Mapping[str, Array]
    extra: Mapping[str, Array]
    origin: Mapping[str, str]
    notes: tuple[str, ...]
    problems: tuple[Problem, ...]


def interpret(
    table: Table,
    *,
    sensitivity: Mapping[str, str] | None = None,
    names: Mapping[str, str] | None = None,
) -> Channels:
    """Give every column its meaning and its SI values; problems are collected, not raised.

    sensitivity: channel -> sensor sensitivity with its unit, "22.4 mV/N" or "44.6 N/V", for channels stored as voltage.
    names: channel -> column of the file, where the file uses names of its own.
    Raises UsageError when an argument itself is wrong.
    """
    reading = _Reading(table, dict(sensitivity or {}), _wanted(table, names or {}))
    for column in table.columns:
        reading.take(column)
    reading.time_from_rate()
    return Channels(reading.values, reading.extra, reading.origin, tuple(reading.notes), tuple(reading.problems))


def _wanted(table: Table, names: Mapping[str, str]) -> dict[str, str]:
    present = [column.name for column in table.columns]
    for channel, column in names.items():
        if channel not in SI:
            raise UsageError(f"--channel {channel}={column}: the channels are {', '.join(SI)}")
        if column not in present:
            near = difflib.get_close_matches(column, present, n=3)
            hint = f"did you mean {', '.join(near)}?" if near else f"it has {', '.join(present)}"
            raise UsageError(f"{table.file} has no column '{column}' (--channel {channel}={column}): {hint}")
    return {column: channel for channel, column in names.items()}


class _Reading:
    """Fills the channels of one table, column by column."""

    def __init__(self, table: Table, sensitivity: dict[str, str], wanted: dict[str, str]) -> None:
        self.table = table
        self.sensitivity = {name: _sensitivity(name, text) for name, text in sensitivity.items()}
        self.wanted = wanted
        self.values: dict[str, Array] = {}
        self.extra: dict[str, Array] = {}
        self.origin: dict[str, str] = {}
        self.notes: list[str] = []
        self.problems: list[Problem] = []
        self.taken: dict[str, str] = {}

    def take(self, column: Column) -> None:
        channel = self.wanted.get(column.name) or self._canonical(column.name)
        if column.name in self.extra or (channel and channel in self.taken):
            other = self.taken.get(channel or "", column.name)
            found = f"columns '{other}' and '{column.name}' both mean {channel or column.name}"
            self._problem("columns", found, "rename one of them, or choose with --channel", channel or column.name)
        elif channel is None:
            self.extra[column.name] = self._extra_si(column)
        else:
            self.taken[channel] = column.name
            self._channel(channel, column)

    def time_from_rate(self) -> None:
        """A time axis from the sample rate, for formats that store no time column."""
        if "t" in self.values or not self.table.sample_rate or not self.table.columns:
            return
        n = max(column.values.size for column in self.table.columns)
        self.values["t"] = np.arange(n) / self.table.sample_rate
        self.origin["t"] = f"from the sample rate {self.table.sample_rate:g} Hz in the file"

    def _canonical(self, name: str) -> str | None:
        if name in self.wanted.values():
            return None
        channel = known_name(name)
        return None if channel in self.wanted.values() else channel

    def _channel(self, channel: str, column: Column) -> None:
        values = self._si(channel, column)
        if values is None:
            return
        self.values[channel] = values
        self.origin[channel] = "measured"
        if channel == "t" and "pseudo" in column.name.lower():
            self.origin["t"] = PSEUDO_TIME
            self.notes.append(f"{column.name} numbers the samples and is not a measured time: rates have no scale")

    def _si(self, channel: str, column: Column) -> Array | None:
        unit = column.unit
        if not unit:
            text = f"column {column.name} has no unit and is taken as {SI[channel]}"
            self._problem("columns", text, f"write '{column.name} [{SI[channel]}]'", channel, severity="warning")
            return column.values
        try:
            if _is_voltage(unit) and channel != "t":
                return self._from_voltage(channel, column, unit)
            factor, offset = to_si(unit, SI[channel])
        except UsageError as error:
            self._problem(
                "columns", str(error), f"write the unit of {channel} so that it converts to {SI[channel]}", channel
            )
            return None
        if factor == 1.0 and offset == 0.0:
            return column.values
        self.notes.append(f"{channel} converted from {unit} to {SI[channel]}")
        return factor * column.values + offset

    def _from_voltage(self, channel: str, column: Column, unit: str) -> Array | None:
        if channel not in self.sensitivity:
            action = f"state the sensor with --sensitivity {channel}=22.4mV/{SI[channel]}"
            self._problem("columns", f"{channel} is a voltage ({unit})", action, channel)
            return None
        per_volt = self.sensitivity[channel]
        self.notes.append(f"{channel} converted from {unit} with {per_volt:.10g} {SI[channel]}/V")
        return column.values * parse(unit).factor * per_volt

    def _extra_si(self, column: Column) -> Array:
        try:
            unit = parse(column.unit or "1")
        except UsageError:
            self.notes.append(f"{column.name} [{column.unit}] is kept as stored: its unit is not known")
            return column.values
        return unit.factor * column.values + unit.offset

    def _problem(self, rule: str, found: str, action: str, channel: str, severity: Severity = "error") -> None:
        self.problems.append(Problem(self.table.file, rule, found, action, channel, severity=severity))


def _is_voltage(unit: str) -> bool:
    return dict(parse(unit).exponents) == dict(parse("V").exponents)


def _sensitivity(channel: str, text: str) -> float:
    """SI units per volt. "22.4 mV/N" and "44.6 N/V" are both read; a bare number is SI units per volt."""
    match = _NUMBER.match(text)
    if not match:
        raise UsageError(f"--sensitivity {channel}={text}: write a number with its unit, as 22.4mV/N or 44.6N/V")
    value, unit = float(match[1]), match[2].strip()
    if channel not in CHANNELS:
        raise UsageError(f"--sensitivity {channel}={text}: the channels are {', '.join(CHANNELS)}")
    if not np.isfinite(value) or value == 0.0:
        raise UsageError(f"--sensitivity {channel}={text}: the sensitivity must be a finite number other than 0")
    return _per_volt(channel, value, unit)


def _per_volt(channel: str, value: float, unit: str) -> float:
    if not unit:
        return value
    above, _, below = unit.partition("/")
    head, _, volts = unit.rpartition("/")
    try:
        # "100 mV/g": the unit below the line is read in its channel's context, so that g means gravity for a
        if below and _is_voltage(above):
            return to_si(below, SI[channel])[0] / (value * parse(above).factor)
        if head and _is_voltage(volts):
            return value * to_si(head, SI[channel])[0] / parse(volts).factor
    except UsageError:
        pass
    text = f"--sensitivity {channel}={value:g}{unit}"
    raise UsageError(f"{text}: write it as {SI[channel]}/V or mV/{SI[channel]}, for example 22.4mV/{SI[channel]}")
