"""MDF 4 (and 3) files of data loggers and test benches, by ``asammdf``; one test per group of channels."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from hystid.errors import RecordingError
from hystid.files import scratch
from hystid.numeric import Array
from hystid.recording.names import known_name, split_header
from hystid.recording.table import Column, RawTable


def read_mdf(path: Path) -> list[RawTable]:
    """Tables of an MDF file: channels of all groups on the time axis of the quickest one that holds a known channel.

    Raises RecordingError where the file is none.
    """
    from asammdf import MDF

    try:
        # asammdf makes a file for what it unpacks, and keeps it where reading fails
        with scratch() as folder, MDF(path, temporary_folder=folder) as file:
            signals = [signal for signal in file.iter_channels(skip_master=True) if signal.samples.dtype.kind in "fiu"]
    except Exception as error:  # asammdf has exceptions of its own, and those of struct and zlib, for a broken file
        raise RecordingError(f"{path.name}: this is no MDF file that can be read ({error})") from None
    known = [
        s for s in signals if known_name(split_header(s.name)[0]) and s.samples.ndim == 1 and len(s.timestamps) > 1
    ]
    if not known:
        known = [signal for signal in signals if signal.samples.ndim == 1 and len(signal.timestamps) > 1]
    if not known:
        return []
    time = _common(path, max((signal.timestamps for signal in known), key=len), known)
    columns = [Column("t", "s", np.asarray(time, dtype=np.float64))]
    for signal in signals:
        if signal.samples.ndim != 1 or not len(signal.timestamps):
            continue
        name, unit = split_header(signal.name)
        values = np.asarray(signal.samples, dtype=np.float64)
        if len(signal.timestamps) != len(time) or not np.array_equal(signal.timestamps, time):
            values = np.interp(time, signal.timestamps, values)
        counts = signal.samples.dtype.kind in "iu"
        columns.append(Column(name, unit or signal.unit or None, values, counts))
    return [RawTable(path.name, tuple(columns), path.stem)]


def _common(path: Path, time: Array, known: Sequence[Any]) -> Array:
    """The times at which every channel was recorded: before and after, nobody knows its values."""
    first, last = max(known, key=lambda s: s.timestamps[0]), min(known, key=lambda s: s.timestamps[-1])
    kept = time[(time >= first.timestamps[0]) & (time <= last.timestamps[-1])]
    if not kept.size:
        found = f"{last.name} ends at {last.timestamps[-1]:g} s, and {first.name} begins at {first.timestamps[0]:g} s"
        raise RecordingError(f"{path.name}: {found}; export channels of one time")
    return np.asarray(kept)
