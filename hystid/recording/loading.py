"""Recordings as a caller has them: in memory, or in files."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from pathlib import Path

import numpy as np

from hystid.errors import RecordingError, UsageError, counted
from hystid.numeric import Array
from hystid.recording.reading import read_all
from hystid.recording.timing import ROUNDING, SHORTEST
from hystid.recording.types import CHANNELS, Recording

Source = str | Path | Recording
Sources = Source | Sequence[Source]


def loaded(sources: Sources, accept: Collection[str] = ()) -> list[Recording]:
    """The recordings of one source or several, in order; files are read by ``read_all``, which states the errors.

    accept: rules whose violation is a warning here and not an error.
    """
    listed = list[object](sources) if isinstance(sources, Iterable) and not isinstance(sources, str) else [sources]
    found: list[Recording] = []
    for source in listed:
        found += [validated(source)] if isinstance(source, Recording) else read_all([_file(source)], accept=accept)
    return found


def _file(source: object) -> str | Path:
    if isinstance(source, str | Path):
        return source
    told = f"a recording is a file or a hystid.Recording, and this is of type {type(source).__name__}"
    raise UsageError(f"{told}: hystid.Recording(name, t, F=..., x=...) makes one of arrays in SI units")


def validated(recording: Recording) -> Recording:
    """A recording that a program made, by the rules that hold for files: columns of real numbers, none missing, on one
    uniform time grid. Raises RecordingError."""
    columns = {"t": recording.t, **{n: getattr(recording, n) for n in CHANNELS}}
    found = {name: _column(recording.name, name, values) for name, values in columns.items() if values is not None}
    found |= {name: np.asarray(values) for name, values in recording.extra.items()}
    t = found.get("t", np.zeros(0))
    if len(t) < SHORTEST:
        raise RecordingError(f"{recording.name}: at least {SHORTEST} samples are needed, found {len(t)}")
    for name, values in found.items():
        if len(values) != len(t):
            told = f"channel {name} has {counted(len(values), 'sample')}, and t has {len(t)}"
            raise RecordingError(f"{recording.name}: {told}: each channel needs a value for each time")
    steps = np.diff(t)
    if np.any(steps <= 0):
        at = int(np.argmax(steps <= 0)) + 1
        raise RecordingError(f"{recording.name}: time does not increase at sample {at}: sort the samples by their time")
    jitter = float(np.max(np.abs(t - np.linspace(t[0], t[-1], len(t))))) / recording.dt
    if jitter > ROUNDING:
        told = f"time stamps are up to {jitter:.2g} steps off a uniform grid"
        raise RecordingError(f"{recording.name}: {told}: interpolate the channels onto one, or read them from a file")
    return recording


def _column(name: str, channel: str, values: object) -> Array:
    column = np.asarray(values)
    if column.dtype.kind not in "fiub":
        raise RecordingError(f"{name}, channel {channel}: real numbers are needed, found {column.dtype.name}")
    if column.ndim != 1:
        raise RecordingError(f"{name}, channel {channel}: one row of samples is needed, found shape {column.shape}")
    lost = ~np.isfinite(column)
    if np.any(lost):
        told = f"{np.count_nonzero(lost)} samples are no numbers, the first is sample {int(np.argmax(lost))}"
        raise RecordingError(f"{name}, channel {channel}: {told}: fill them, or cut the recording there")
    return column
