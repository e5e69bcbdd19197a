"""From the columns of a table to the channels t, F, x, v, a, R in SI units."""

from __future__ import annotations

import difflib
import re
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from hystid.errors import UsageError
from hystid.numeric import Array
from hystid.recording.checks import without_markers
from hystid.recording.names import known_name, meant, numbered, turns, unit_symbol
from hystid.recording.problems import RecordingProblem
from hystid.recording.table import Column, RawTable
from hystid.recording.types import CHANNELS, PSEUDO_TIME, ROTATIONAL
from hystid.units import parse, si_name, to_si

SI = {"t": "s", **CHANNELS}

_CAPITALS = {unit.casefold(): unit for unit in ("s", "N", "kN", "m", "mm", "cm", "m/s", "mm/s", "m/s2", "mm/s2", "g")}
_NOT_STATED = ("as_stored", "as stored", "unit_not_stated")  # what data sets write where nobody knows the unit
_NUMBER = re.compile(r"^\s*([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)(.*)$")


@dataclass(frozen=True)
class Channels:
    """Channels in SI units. values holds t and what else was found; extra the columns that hystid has no name for, and
    units the SI unit of those whose unit is known."""

    values: Mapping[str, Array]
    extra: Mapping[str, Array]
    origin: Mapping[str, str]
    units: Mapping[str, str]
    rotational: bool
    notes: tuple[str, ...]
    problems: tuple[RecordingProblem, ...]


@dataclass(frozen=True)
class Wishes:
    """How a user wants the columns of a file to be read.

    sensitivity: channel -> sensor sensitivity with its unit, "22.4 mV/N" or "44.6 N/V", for channels stored as voltage.
    names: channel -> column of the file, where the file uses names of its own. units: channel -> unit, instead of the
    one in the header. reverse: channels whose sign is turned round.
    """

    sensitivity: Mapping[str, str] = field(default_factory=dict)
    names: Mapping[str, str] = field(default_factory=dict)
    units: Mapping[str, str] = field(default_factory=dict)
    reverse: Collection[str] = ()


def interpret(table: RawTable, wishes: Wishes | None = None) -> Channels:
    """Give every column its meaning and its SI values; problems are collected, not raised.

    A rig turns where a channel's unit or name says so (N.m, rad, torque); all its channels are then angular.
    Raises UsageError when a wish itself is wrong.
    """
    wishes = wishes or Wishes()
    for option, channels in (("--unit", wishes.units), ("--reverse", wishes.reverse)):
        for channel in channels:
            if channel not in SI or (channel == "t" and option == "--reverse"):
                raise UsageError(f"{option} {channel}: the channels are {', '.join(SI)}")
    for word, texts in (("units", wishes.units), ("sensitivity", wishes.sensitivity), ("names", wishes.names)):
        for channel, text in texts.items():
            if not isinstance(text, str):
                raise UsageError(f"{word}: that of {channel} must be a text, found {text!r}")
    wanted = _wanted(table, wishes.names)
    reading = _Reading(table, wishes, wanted)
    for column in table.columns:
        reading.take(column)
    reading.time_from_rate()
    reading.unmet()
    return Channels(
        reading.values, reading.extra, reading.origin, reading.units, reading.rotational,
        tuple(reading.notes), tuple(reading.problems),
    )  # fmt: skip


def _wanted(table: RawTable, names: Mapping[str, str]) -> dict[str, str]:
    """Column -> channel. A file that lacks the column, but names the channel in its own words, is left as it is."""
    present = [column.name for column in table.columns]
    found = {}
    for channel, column in names.items():
        if channel not in SI:
            raise UsageError(f"--channel {channel}={column}: the channels are {', '.join(SI)}")
        if column in present:
            found[column] = channel
        elif channel not in {known_name(numbered(present).get(name, name)) for name in present}:
            near = difflib.get_close_matches(column, present, n=3)
            hint = f"did you mean {', '.join(near)}?" if near else f"it has {table.named()}"
            raise UsageError(f"{table.file} has no column '{column}' (--channel {channel}={column}): {hint}")
    return found


def _angular(unit: str, channel: str) -> bool:
    """Whether a unit measures the angular kind of a channel, and could not measure the linear one."""
    try:
        known = parse(unit_symbol(unit))
        to_si(unit_symbol(unit), ROTATIONAL[channel])
    except UsageError:
        return False
    return channel in ("F", "R") or bool(known.exponents.get("rad"))


class _Reading:
    """Fills the channels of one table, column by column."""

    def __init__(self, table: RawTable, wishes: Wishes, wanted: dict[str, str]) -> None:
        self.table = table
        self.wishes = wishes
        self.wanted = wanted
        self.numbered = numbered([column.name for column in table.columns])
        self.rotational = any(self._is_angular(column) for column in table.columns)
        self.si = {"t": "s", **(ROTATIONAL if self.rotational else CHANNELS)}
        self.sensitivity = {name: _sensitivity(name, text, self.si) for name, text in wishes.sensitivity.items()}
        self.values: dict[str, Array] = {}
        self.extra: dict[str, Array] = {}
        self.origin: dict[str, str] = {}
        self.notes: list[str] = []
        self.problems: list[RecordingProblem] = []
        self.taken: dict[str, str] = {}
        self.units: dict[str, str] = {}

    def _is_angular(self, column: Column) -> bool:
        channel = self.wanted.get(column.name) or self._canonical(column)
        if channel is None or channel == "t":
            return False
        unit = self._unit(channel, column)
        stated = unit and not _is_voltage(unit)
        return _angular(unit, channel) if stated else turns(self.numbered.get(column.name, column.name))

    def _unit(self, channel: str, column: Column) -> str:
        """The unit that counts, as a symbol: the user's word before the header's; "" where there is none."""
        sensed = channel in self.wishes.sensitivity and not column.counts
        return self.wishes.units.get(channel) or unit_symbol(column.unit or "") or ("V" if sensed else "")

    def take(self, column: Column) -> None:
        channel = self.wanted.get(column.name) or self._canonical(column)
        if column.name in self.extra or (channel and channel in self.taken):
            other = self.taken.get(channel or "", column.name)
            found = f"columns '{other}' and '{column.name}' both mean {channel or column.name}"
            action = "rename one of them, or choose with --channel"
            if other == column.name:
                found, action = f"two columns are named '{other}'", "rename one of them, or leave it out"
            if found not in {item.found for item in self.problems}:
                self.problems.append(self.table.problem("columns", found, action, channel or column.name))
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

    def unmet(self) -> None:
        """Warn of each wish that this table has nothing for: a slip of the pen would pass in silence."""
        told = []
        for channel, name in self.wishes.names.items():
            if channel in self.taken and self.wanted.get(self.taken[channel]) != channel:
                found = f"there is no column '{name}' (--channel {channel}={name})"
                told.append((channel, found, f"column '{self.taken[channel]}' is taken"))
        groups = {"unit": self.wishes.units, "reverse": self.wishes.reverse, "sensitivity": self.wishes.sensitivity}
        for option, channels in groups.items():
            lacking = [channel for channel in channels if channel not in self.taken]
            told += [(c, f"--{option} {c} is given, and there is no such channel", "it is left out") for c in lacking]
        for channel in self.wishes.sensitivity:
            unit = self.units.get(channel, "V")
            if unit not in ("", *_NOT_STATED) and not _is_voltage(unit):
                found = f"it is in {unit} and no voltage, so that --sensitivity {channel} is not used"
                told.append((channel, found, f"leave it out, or give --unit {channel}=V"))
        for channel, found, action in told:
            self.problems.append(self.table.problem("columns", found, action, channel, severity="warning"))

    def _canonical(self, column: Column) -> str | None:
        if column.name in self.wanted.values():
            return None
        channel = meant(self.numbered.get(column.name, column.name), column.unit)
        return None if channel in self.wanted.values() else channel

    def _channel(self, channel: str, column: Column) -> None:
        values, marker, count = without_markers(column.values)
        if count:
            found = f"{count} of {values.size} samples hold {marker:g}, as loggers write where nothing was measured"
            self.problems.append(self.table.problem("gap", found, "they count as missing", channel, severity="warning"))
            column = replace(column, values=values)
        known = self._si(channel, column)
        if known is None:
            return
        values = known
        if channel in self.wishes.reverse:
            values = -values
            self.notes.append(f"sign of {channel} reversed as asked")
        self.values[channel] = values
        self.origin[channel] = "measured"
        self.units[channel] = self._unit(channel, column)
        if channel == "t" and "pseudo" in column.name.lower():
            self.origin["t"] = PSEUDO_TIME
            self.notes.append(f"{column.name} numbers the samples and is not a measured time: rates have no scale")

    def _si(self, channel: str, column: Column) -> Array | None:
        unit, si = self._unit(channel, column), self.si[channel]
        if not unit and channel == "t" and (clock := _clock(column.values)):
            text = f"{column.name} starts at {column.values[0]:.9g}, as {clock[1]} does"
            action = f"give --unit t={clock[0]}, or name the column '{column.name} [{clock[0]}]' or '{column.name} [s]'"
            self.problems.append(self.table.problem("columns", text, action, channel))
            return None
        lvm = self.table.file.lower().endswith(".lvm")
        if not unit and channel == "t" and lvm:
            return column.values  # LabVIEW writes seconds
        if not unit and channel != "t" and (column.counts or lvm):
            why, other = (
                "LabVIEW writes volts where none is set",
                f"--unit {channel}=V --sensitivity {channel}=22.4mV/{si}",
            )
            if column.counts:
                why, other = ("holds whole numbers, as a converter counts", "write its values in that unit")
            action = f"give --unit {channel}={si} if it is in {si}, else {other}"
            self.problems.append(
                self.table.problem("columns", f"column {column.name} has no unit, and {why}", action, channel)
            )
            return None
        if not unit or unit in _NOT_STATED:
            text = f"column {column.name} has no unit and is taken as {si}"
            self.problems.append(
                self.table.problem("columns", text, f"write '{column.name} [{si}]'", channel, severity="warning")
            )
            return column.values
        unit = _in_case(unit, si)
        try:
            if _is_voltage(unit) and channel != "t":
                return self._from_voltage(channel, column, unit)
            factor, offset = to_si(unit, si)
        except UsageError as error:
            action = f"write the unit of {channel} so that it converts to {si}"
            if self.rotational and not _angular(unit, channel):
                action += ", as other columns say that the rig turns, or leave the columns of the other motion out"
            self.problems.append(self.table.problem("columns", str(error), action, channel))
            return None
        if factor == 1.0 and offset == 0.0:
            return column.values
        self.notes.append(f"{channel} converted from {unit} to {si}")
        return factor * column.values + offset

    def _from_voltage(self, channel: str, column: Column, unit: str) -> Array | None:
        if channel not in self.sensitivity:
            action = f"state the sensor with --sensitivity {channel}=22.4mV/{self.si[channel]}"
            self.problems.append(self.table.problem("columns", f"{channel} is a voltage ({unit})", action, channel))
            return None
        per_volt = self.sensitivity[channel]
        if not column.unit and channel not in self.wishes.units:
            text = f"column {column.name} has no unit and is taken as V, as a sensitivity is given"
            action = f"write '{column.name} [V]'"
            self.problems.append(self.table.problem("columns", text, action, channel, severity="warning"))
        self.notes.append(f"{channel} converted from {unit} with {per_volt:.10g} {self.si[channel]}/V")
        return column.values * parse(unit).factor * per_volt

    def _extra_si(self, column: Column) -> Array:
        try:
            unit = parse(column.unit or "1")
            if column.unit:
                self.units[column.name] = si_name(column.unit)
        except UsageError:
            self.notes.append(f"{column.name} [{column.unit}] is kept as stored: its unit is not known")
            return column.values
        return unit.factor * column.values + unit.offset


def _in_case(unit: str, si: str) -> str:
    """A unit that was written in capitals or in small letters, as KN or MM, in its own; others as they are."""
    try:
        to_si(unit, si)
    except UsageError:
        return _CAPITALS.get(unit.casefold(), unit)
    return unit


def _clock(t: Array) -> tuple[str, str] | None:
    """Unit of a time without unit, and in words, where it shows a date of this century that seconds do not show: days
    since 1900, at more than 50 kHz if they were seconds, or fractions of a second since 1970."""
    if t.size > 1 and bool(np.all((t > 36526) & (t < 73050))) and float(np.median(np.diff(t))) < 2e-5:
        return "d", "a count of days in a spreadsheet"
    for unit, size in (("ms", 1e-3), ("us", 1e-6), ("ns", 1e-9)):
        if t.size and bool(np.all((t * size > 946_684_800) & (t * size < 4_102_444_800))):
            return unit, f"a count of {unit} since 1970"
    return None


def _is_voltage(unit: str) -> bool:
    try:
        return dict(parse(unit).exponents) == dict(parse("V").exponents)
    except UsageError:
        return False


def _sensitivity(channel: str, text: str, si: Mapping[str, str]) -> float:
    """SI units per volt. "22.4 mV/N" and "44.6 N/V" are both read; a bare number is SI units per volt."""
    match = _NUMBER.match(text)
    if not match:
        raise UsageError(f"--sensitivity {channel}={text}: write a number with its unit, as 22.4mV/N or 44.6N/V")
    value, unit = float(match[1]), match[2].strip()
    if channel not in CHANNELS:
        raise UsageError(f"--sensitivity {channel}={text}: the channels are {', '.join(CHANNELS)}")
    if not np.isfinite(value) or value == 0.0:
        raise UsageError(f"--sensitivity {channel}={text}: the sensitivity must be a finite number other than 0")
    return _per_volt(channel, value, unit, si[channel])


def _per_volt(channel: str, value: float, unit: str, si: str) -> float:
    if not unit:
        return value
    above, _, below = unit.partition("/")
    head, _, volts = unit.rpartition("/")
    try:
        # "100 mV/g": the unit below the line is read in its channel's context, so that g means gravity for a
        if below and _is_voltage(above):
            return to_si(below, si)[0] / (value * parse(above).factor)
        if head and _is_voltage(volts):
            return value * to_si(head, si)[0] / parse(volts).factor
    except UsageError:
        pass
    text = f"--sensitivity {channel}={value:g}{unit}"
    raise UsageError(f"{text}: write it as {si}/V or mV/{si}, for example 22.4mV/{si}")
