"""Reading: file -> tables -> channels in SI -> checks -> Recording, the same for every format."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from os import PathLike
from pathlib import Path

import numpy as np

from hystid.errors import RecordingError, UsageError, counted
from hystid.files import check_regular, file_named
from hystid.numeric import Array
from hystid.recording.apart import BINARY, read_apart
from hystid.recording.channels import Channels, Wishes, interpret
from hystid.recording.checks import channel_problems
from hystid.recording.held import held_problems
from hystid.recording.problems import RULES, RecordingProblem, report
from hystid.recording.table import RawTable
from hystid.recording.text import read_text
from hystid.recording.timing import SHORTEST, order_problems, uniform
from hystid.recording.types import PSEUDO_TIME, Recording

_TEXT = (".csv", ".txt", ".tsv", ".dat", ".asc", ".lvm")
_SHEETS = (".xlsx", ".xlsm", ".xls", ".ods")

_STEPS = (1e-12, 1e12)  # s between samples
_LEAST_SIZE = 1e-100  # SI units: squares of the values and of their derivatives are then above 1e-300
_BRIDGED = 0.01  # share of lost rows that are bridged: with a straight line over one in a hundred, 40 dB are kept


@dataclass(frozen=True)
class _Door:
    """What a file must hold, and which rules it may break. motion: whether x, v or a must be there."""

    wishes: Wishes
    resample: bool
    accept: Collection[str]
    motion: bool = True

    @property
    def force(self) -> bool:
        """Whether F must be there and change: not in a free decay, which ``accept`` lets in."""
        return "missing_force" not in self.accept


def read(
    path: str | Path,
    *,
    sensitivity: Mapping[str, str] | None = None,
    names: Mapping[str, str] | None = None,
    resample: bool = False,
    accept: Collection[str] = (),
    motion: bool = True,
    units: Mapping[str, str] | None = None,
    reverse: Collection[str] = (),
) -> Recording:
    """Read the one test in a file: see ``read_all`` for arguments and errors; UsageError if it holds several.

    motion: whether x, v or a must be there; False for a file that only prescribes a force.

    >>> import hystid
    >>> from pathlib import Path
    >>> rows = [f"{k * 1e-3},{k % 40 - 20},{0.1 * (k % 40) - 2}" for k in range(200)]
    >>> _ = Path("saw.csv").write_text("\\n".join(["t [s],F [N],x [mm]", *rows]))
    >>> saw = hystid.read("saw.csv")
    >>> len(saw), round(saw.sample_rate), float(saw.x.min())  # in metres
    (200, 1000, -0.002)
    """
    wishes = Wishes(sensitivity or {}, names or {}, units or {}, reverse)
    found = _read_file(file_named(path, "a recording"), _Door(wishes, resample, accept, motion))
    if len(found) > 1:
        listed = ", ".join(recording.name for recording in found)
        raise UsageError(f"{path} holds {len(found)} tests ({listed}): give it where several recordings are taken")
    return found[0]


def read_all(
    paths: str | Path | Sequence[str | Path],
    *,
    sensitivity: Mapping[str, str] | None = None,
    names: Mapping[str, str] | None = None,
    resample: bool = False,
    accept: Collection[str] = (),
    units: Mapping[str, str] | None = None,
    reverse: Collection[str] = (),
) -> list[Recording]:
    """Read recordings, SI units, float64, each on a uniform time grid, in the order given; names are unique.

    paths: files (.csv .txt .tsv .dat .asc .lvm .mat .h5 .hdf5 .uff .unv .tdms); one file may hold several tests.
    sensitivity: channel -> "22.4mV/N" or "44.6N/V", for channels stored as voltage.
    names: channel -> column, for files with names of their own. resample: interpolate unequal steps and gaps.
    accept: rules (see ``problems.RULES``) whose violation is a warning here and not an error.
    units: channel -> unit, instead of the one in the header. reverse: channels whose sign is changed.
    Raises RecordingError with one line for every problem of every file; UsageError for a wrong argument.
    """
    if not paths:
        raise UsageError("no recording was given: name at least one file")
    door = _Door(Wishes(sensitivity or {}, names or {}, units or {}, reverse), resample, accept)
    recordings: list[Recording] = []
    refused: list[str] = []
    for path in [paths] if isinstance(paths, str | PathLike) else paths:
        try:
            recordings += _read_file(file_named(path, "a recording"), door)
        except RecordingError as error:
            refused += error.args
    if refused:
        raise RecordingError(*refused)
    return _unique_names(recordings)


def _read_file(path: Path, door: _Door) -> list[Recording]:
    unknown = sorted(set(door.accept) - set(RULES))
    if unknown:
        raise UsageError(f"--accept {unknown[0]}: the rules are {', '.join(RULES)}")
    found = tables(path)
    if len(found) > 1:
        found = [replace(table, file=f"{table.file}, test {table.name}") for table in found]
    return [_recording(table, interpret(table, door.wishes), door) for table in found]


def tables(path: Path) -> list[RawTable]:
    """The tables of a file as they stand there. Raises RecordingError when there is none to be had."""
    check_regular(path, RecordingError)
    suffix = path.suffix.lower()
    if suffix not in (*_TEXT, *BINARY):
        known = " ".join((*_TEXT, *BINARY))
        way = "save the sheet as CSV" if suffix in _SHEETS else "export it as one of these"
        raise RecordingError(f"{path.name}: recordings are read from {known}, not from '{path.suffix}'; {way}")
    try:
        found = read_text(path) if suffix in _TEXT else read_apart(path)
    except PermissionError:
        raise RecordingError(f"{path}: the file may not be read; check its permissions") from None
    if not found:
        raise RecordingError(f"{path.name}: no table with a time axis and channels was found in the file")
    return found


def _recording(table: RawTable, channels: Channels, door: _Door) -> Recording:
    problems = list(channels.problems)
    problems += _presence(table, channels, door)
    report(problems, door.accept)
    _refuse_unusable(channels.values, [*problems, *channel_problems(table, channels.values)])
    values, extra, lost = _without_lost_rows(table, channels)
    table = replace(table, lines=None) if lost else table  # lines are counted with the lost rows
    checked = {name: u for name, u in values.items() if door.force or name != "F" or np.any(u)}
    more = [*lost, *channel_problems(table, checked), *order_problems(table, values["t"])]
    report(more, door.accept)  # what follows needs an increasing time axis
    if not np.all(np.isfinite(values["t"])):
        report(more)
    more += held_problems(table, values)
    grid = uniform(table, values["t"], resample=door.resample)
    _refuse_extremes(table, values, grid.t)
    problems += [*more, *grid.problems]
    report(grid.problems, door.accept)
    recording = Recording(
        table.name or Path(table.file).stem,
        grid.t,
        extra={name: grid.place(array) for name, array in extra.items()},
        origin=channels.origin,
        notes=(*channels.notes, *grid.notes),
        rotational=channels.rotational,
        units=channels.units,
        accepted=frozenset(door.accept),
    ).with_channels({name: grid.place(array) for name, array in values.items() if name != "t"})
    return replace(recording, warnings=tuple(str(item) for item in report(problems, door.accept)))


def _refuse_unusable(values: Mapping[str, Array], problems: list[RecordingProblem]) -> None:
    """Whatever is accepted: nothing can be computed without a clock, or with channels that differ in length."""
    t = values.get("t")
    lengths = {array.size for array in values.values()}
    if t is None or t.size < 2 or len(lengths) > 1:
        report(problems)


def _refuse_extremes(table: RawTable, values: Mapping[str, Array], t: Array) -> None:
    """Whatever is accepted: powers of such numbers leave the range of double precision."""
    dt = float(t[-1] - t[0]) / max(t.size - 1, 1)
    if not _STEPS[0] <= dt <= _STEPS[1]:
        found = f"samples are {dt:g} s apart"
        report([table.problem("time_order", found, "check the unit of time; 1e-12 to 1e12 s are taken", "t")])
    for name, u in values.items():
        size = float(np.max(np.abs(u), where=np.isfinite(u), initial=0.0))
        if name != "t" and 0 < size < _LEAST_SIZE:
            found = f"all samples are within {size:.3g}, where squares of numbers vanish"
            report([table.problem("not_finite", found, "check the unit of the channel", name)])


def _without_lost_rows(
    table: RawTable, channels: Channels
) -> tuple[dict[str, Array], dict[str, Array], list[RecordingProblem]]:
    """Channels and extra columns without the rows in which a channel is missing, where these are few."""
    values, n = dict(channels.values), channels.values["t"].size
    extra = {name: array for name, array in channels.extra.items() if array.size == n}
    if any(array.size != n for array in values.values()):
        return values, extra, []
    missing = np.any([np.isnan(array) for array in values.values()], axis=0)
    at = np.flatnonzero(missing)
    if not 0 < at.size <= _BRIDGED * n or channels.origin["t"] == PSEUDO_TIME:
        return values, extra, []
    kept = ~missing
    found = f"{at.size} of {n} rows hold no number in some channel"
    action = "they count as lost and are bridged"
    first = int(at[0])
    lost = table.problem("gap", found, action, "", first, "warning")
    values, extra = ({name: u[kept] for name, u in group.items()} for group in (values, extra))
    return values, extra, [lost]


def _presence(table: RawTable, channels: Channels, door: _Door) -> list[RecordingProblem]:
    values = channels.values
    misread = {item.channel for item in channels.problems if item.severity == "error"}
    problems = []
    found = f"it has {table.named()}"
    force = "N.m" if channels.rotational else "N"
    for name, unit in (("t", "s"), ("F", force)):
        if name not in values and name not in misread:
            near = (
                " (a restoring force R alone is taken with mass 0 when the column is named F)" if "R" in values else ""
            )
            action = f"name a column '{name} [{unit}]' or choose one with --channel {name}=COLUMN{near}"
            if name == "t" and table.lines is not None:
                action += "; or write 'sample rate: ... Hz' above the header"
            if name == "F" and not near:
                action += "; a current, a command or a set point is no measured force"
            rule = "missing_force" if name == "F" else "missing_channel"
            problems.append(table.problem(rule, f"there is no channel {name}; {found}", action, name))
    if door.motion and not {"x", "v", "a"} & (set(values) | misread):
        action = "name a column 'x [m]', 'v [m/s]' or 'a [m/s2]', or choose one with --channel x=COLUMN"
        problems.append(table.problem("missing_channel", f"there is no motion x, v or a; {found}", action, "x"))
    size = max((array.size for array in values.values()), default=0)
    if size < SHORTEST:
        problems.append(
            table.problem("too_short", counted(size, "sample"), f"at least {SHORTEST} are needed, better thousands")
        )
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
