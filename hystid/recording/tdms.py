"""TDMS files of LabVIEW and DIAdem (extra ``tdms``): one test per group."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from hystid.errors import RecordingError
from hystid.numeric import Array
from hystid.recording.names import known_name, meant, split_header
from hystid.recording.table import Column, RawTable, clock_seconds, clocks_apart
from hystid.recording.tree import refuse_scale

_UNITS = ("unit_string", "NI_UnitDescription", "unit")  # of LabVIEW, of its DAQ, of DIAdem


def read_tdms(path: Path) -> list[RawTable]:
    """One table for every group with numeric channels.

    The unit is a property of the channel (``_UNITS``), or stands in the name, ``x [mm]``;
    without a time channel the waveform property ``wf_increment`` gives the time axis.
    Raises RecordingError where there is none, or no TDMS file.
    """
    from nptdms import TdmsFile

    try:
        with path.open("rb") as file:  # by its path, an index that lies beside it would count for more
            groups = [
                (group.name, [_column(channel, path) for channel in group.channels()], _rate(group, path))
                for group in TdmsFile.read(file).groups()
            ]
    except RecordingError:
        raise
    except Exception as error:  # npTDMS raises ValueError, KeyError, struct.error ... on broken files
        raise RecordingError(f"{path.name}: this is not a readable TDMS file ({error})") from None
    several = len(groups) > 1
    found, unnamed = [], []
    for name, columns, rate in groups:
        kept = tuple(column for column in columns if column is not None and column.values.size)
        table = RawTable(path.name, kept, name if several else path.stem, sample_rate=rate)
        if any(meant(column.name, column.unit) for column in kept):
            found.append(table)
        elif len(kept) > 1:  # names of their own, which a user may assign
            unnamed.append(table)
    found = found or unnamed
    if not found:
        raise RecordingError(f"{path.name}: no group holds channels named t, F and x; name them so in the recording")
    return found


def _column(channel: Any, path: Path) -> Column | None:
    values = np.asarray(channel[:])
    name, unit = split_header(channel.name)
    if (stamps := clock_seconds(values)) is not None:
        return Column(name, "s", stamps)
    if values.dtype.kind not in "fiu":
        return None
    stated = next((channel.properties[key] for key in _UNITS if channel.properties.get(key)), unit)
    for key, value in channel.properties.items():
        refuse_scale(path.name, name, key, value)
    return Column(name, str(stated) if stated else None, values.astype(np.float64), values.dtype.kind in "iu")


def _rate(group: Any, path: Path) -> float | None:
    _refuse_clocks_apart(group, path)
    steps = [channel.properties.get("wf_increment", 0.0) for channel in group.channels()]
    known = [float(step) for step in steps if step and step > 0]
    return 1 / known[0] if known else None


def _refuse_clocks_apart(group: Any, path: Path) -> None:
    """Raise RecordingError where the waveforms of two channels, as their properties say, are not of one time."""
    channels = {known_name(split_header(channel.name)[0]): channel for channel in group.channels()}
    if "t" in channels:
        return
    waves = [c for name, c in channels.items() if name and c.properties.get("wf_increment", 0.0) > 0 and len(c) > 1]
    for channel in waves[1:]:
        if apart := clocks_apart(_times(waves[0], waves[0]), _times(channel, waves[0])):
            told = f"{channel.name} {apart} {waves[0].name}, as their waveforms say"
            raise RecordingError(f"{path.name}: {told}; export them at one rate and from one start")


def _times(channel: Any, first: Any) -> Array:
    """Time axis of a waveform [s], from the start of another one."""
    begins = [c.properties.get("wf_start_time") for c in (channel, first)]
    later = (begins[0] - begins[1]) / np.timedelta64(1, "s") if all(isinstance(b, np.datetime64) for b in begins) else 0
    start = float(channel.properties.get("wf_start_offset", 0.0)) + float(later)
    return np.asarray(start + float(channel.properties["wf_increment"]) * np.arange(len(channel)))
