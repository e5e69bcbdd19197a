"""Reading: file -> tables -> channels in SI -> checks -> Recording, the same for every format."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import replace
from importlib import import_module
from pathlib import Path
from typing import cast

from hystid.errors import HystidError, RecordingError, UsageError
from hystid.recording.channels import Channels, interpret
from hystid.recording.checks import channel_problems, motion_problems
from hystid.recording.problems import RULES, Problem, report
from hystid.recording.table import Table
from hystid.recording.timing import SHORTEST, order_problems, uniform
from hystid.recording.types import Array, Recording

# suffix -> (module, function); imported where used, because each pulls in a package of its own
_READERS = {
    ".csv": ("text", "read_text"),
    ".txt": ("text", "read_text"),
    ".tsv": ("text", "read_text"),
    ".dat": ("text", "read_text"),
    ".mat": ("mat", "read_mat"),
    ".h5": ("hdf5", "read_hdf5"),
    ".hdf5": ("hdf5", "read_hdf5"),
    ".uff": ("uff", "read_uff"),
    ".unv": ("uff", "read_uff"),
    ".tdms": ("tdms", "read_tdms"),
}


def read(
    path: str | Path,
    *,
    sensitivity: Mapping[str, str] | None = None,
    names: Mapping[str, str] | None = None,
    resample: bool = False,
    accept: Collection[str] = (),
    motion: bool = True,
) -> Recording:
    """Read the one test in a file: see ``read_all`` for arguments and errors; UsageError if it holds several.

    motion: whether x, v or a must be there; False for a file that only prescribes a force.
    """
    found = _read_file(Path(path), sensitivity, names, resample, accept, motion)
    if len(found) > 1:
        listed = ", ".join(recording.name for recording in found)
        raise UsageError(f"{path} holds {len(found)} tests ({listed}): give it where several recordings are taken")
    return found[0]


def read_all(
    paths: Sequence[str | Path],
    *,
    sensitivity: Mapping[str, str] | None = None,
    names: Mapping[str, str] | None = None,
    resample: bool = False,
    accept: Collection[str] = (),
) -> list[Recording]:
    """Read recordings, SI units, float64, each on a uniform time grid, in the order given; names are unique.

    paths: files (.csv .txt .tsv .dat .mat .h5 .hdf5 .uff .unv .tdms); one file may hold several tests.
    sensitivity: channel -> "22.4mV/N" or "44.6N/V", for channels stored as voltage.
    names: channel -> column, for files with names of their own. resample: interpolate unequal steps and gaps.
    accept: rules (see ``problems.RULES``) whose violation is a warning here and not an error.
    Raises RecordingError with one line for every problem of every file; UsageError for a wrong argument.
    """
    if not paths:
        raise UsageError("no recording was given: name at least one file")
    recordings: list[Recording] = []
    refused: list[str] = []
    for path in paths:
        try:
            recordings += _read_file(Path(path), sensitivity, names, resample, accept)
        except RecordingError as error:
            refused.append(str(error))
    if refused:
        raise RecordingError("\n".join(refused))
    return _unique_names(recordings)


def _read_file(
    path: Path,
    sensitivity: Mapping[str, str] | None,
    names: Mapping[str, str] | None,
    resample: bool,
    accept: Collection[str],
    motion: bool = True,
) -> list[Recording]:
    unknown = sorted(set(accept) - set(RULES))
    if unknown:
        raise UsageError(f"--accept {unknown[0]}: the rules are {', '.join(RULES)}")
    return [
        _recording(table, interpret(table, sensitivity=sensitivity, names=names), resample, accept, motion)
        for table in tables(path)
    ]


def tables(path: Path) -> list[Table]:
    """The tables of a file as they stand there. Raises RecordingError when there is none to be had."""
    if not path.exists():
        raise RecordingError(f"{path}: there is no such file")
    if path.is_dir():
        raise RecordingError(f"{path}: this is a folder; name the recording files in it")
    if path.suffix.lower() not in _READERS:
        raise RecordingError(f"{path.name}: recordings are read from {' '.join(_READERS)}, not from '{path.suffix}'")
    module, function = _READERS[path.suffix.lower()]
    reader = cast(Callable[[Path], list[Table]], getattr(import_module(f"hystid.recording.{module}"), function))
    try:
        found = reader(path)
    except HystidError:
        raise
    except PermissionError:
        raise RecordingError(f"{path}: the file may not be read; check its permissions") from None
    if not found:
        raise RecordingError(f"{path.name}: no table with a time axis and channels was found in the file")
    return found


def _recording(table: Table, channels: Channels, resample: bool, accept: Collection[str], motion: bool) -> Recording:
    problems = list(channels.problems)
    values = dict(channels.values)
    problems += _presence(table, values, channels, motion)
    problems += channel_problems(table, values)
    if "t" in values:
        problems += order_problems(table, values["t"])
    report(problems, accept)  # what follows needs an increasing time axis and channels of one length
    grid = uniform(table, values["t"], resample=resample)
    problems += grid.problems
    report(grid.problems, accept)
    placed = {name: grid.place(array) for name, array in values.items() if name != "t"}
    dt = float((grid.t[-1] - grid.t[0]) / (grid.t.size - 1))
    recording = Recording(
        table.name or Path(table.file).stem,
        grid.t,
        extra={name: grid.place(array) for name, array in channels.extra.items() if array.size == values["t"].size},
        origin=channels.origin,
        notes=(*channels.notes, *grid.notes),
        F=placed.get("F"),
        x=placed.get("x"),
        v=placed.get("v"),
        a=placed.get("a"),
        R=placed.get("R"),
    )
    problems += motion_problems(table, placed, dt, timed=not recording.quasi_static)
    return replace(recording, warnings=tuple(str(item) for item in report(problems, accept)))


def _presence(table: Table, values: Mapping[str, Array], channels: Channels, motion: bool) -> list[Problem]:
    misread = {item.channel for item in channels.problems if item.severity == "error"}
    problems = []
    found = f"it has {', '.join(column.name for column in table.columns)}"
    for name, unit in (("t", "s"), ("F", "N")):
        if name not in values and name not in misread:
            near = (
                " (a restoring force R alone is taken with mass 0 when the column is named F)" if "R" in values else ""
            )
            action = f"name a column '{name} [{unit}]' or choose one with --channel {name}=COLUMN{near}"
            problems.append(
                Problem(table.file, "missing_channel", f"there is no channel {name}; {found}", action, name)
            )
    if motion and not {"x", "v", "a"} & (set(values) | misread):
        action = "name a column 'x [m]', 'v [m/s]' or 'a [m/s2]', or choose one with --channel x=COLUMN"
        problems.append(Problem(table.file, "missing_channel", f"there is no motion x, v or a; {found}", action, "x"))
    size = max((array.size for array in values.values()), default=0)
    if size < SHORTEST:
        text = f"{size} samples"
        problems.append(Problem(table.file, "too_short", text, f"at least {SHORTEST} are needed, better thousands"))
    return problems


def _unique_names(recordings: list[Recording]) -> list[Recording]:
    counts = Counter(recording.name for recording in recordings)
    if all(count == 1 for count in counts.values()):
        return recordings
    seen: Counter[str] = Counter()
    renamed = []
    for recording in recordings:
        seen[recording.name] += 1
        again = counts[recording.name] > 1 and seen[recording.name] > 1
        renamed.append(replace(recording, name=f"{recording.name}-{seen[recording.name]}") if again else recording)
    return renamed
