"""Options that several commands share, and what their texts mean."""

from __future__ import annotations

import math
import os
import sys
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypeVar

import typer

from hystid.errors import UsageError, printable
from hystid.files import json_of
from hystid.outputs import check_folder, replaced
from hystid.progress import tell
from hystid.results import Result

if TYPE_CHECKING:
    from hystid.processing import Band
    from hystid.recording import Recording

Choice = TypeVar("Choice", bound=str)


def named(text: str | Path) -> Path:
    """Path of an output. Raises UsageError for '', as an unset variable of a shell leaves it: paths take that for the
    current folder."""
    if not str(text):
        raise UsageError("-o '': the name is empty; name a file or a folder, or . for this one")
    return Path(text)


Recordings = Annotated[
    list[Path],
    typer.Argument(
        metavar="REC...",
        help="Recordings: .csv with 'name [unit]' headers, .mat, .h5, .uff, .tdms, .mf4 or .parquet.",
        show_default=False,
    ),
]
Holdout = Annotated[
    list[Path] | None, typer.Option(metavar="REC", help="Recording kept for testing only; may be repeated.")
]
Folder = Annotated[
    Path, typer.Option("-o", "--out", parser=named, metavar="DIR", help="Folder for the results.", show_default=False)
]
Set = Annotated[
    list[str] | None, typer.Option("--set", metavar="P=V", help="Parameter value in SI units; may be repeated.")
]
Masses = Annotated[
    list[str],
    typer.Option(
        "--mass",
        callback=lambda texts: _mass_texts(texts),
        metavar="KG",
        help="Moving mass in kg; 0: F is the restoring force itself. One per recording as 4.2,6.1 (those of --holdout "
        "last) or *heavy*:6.1 (by name; may be repeated).",
    ),
]
Mass = Annotated[float, typer.Option(metavar="KG", help="Moving mass in kg; 0: F is the restoring force itself.")]
BandText = Annotated[
    str | None, typer.Option("--band", metavar="LO-HI", help="Zero-phase band-pass in Hz, as 5-500Hz.")
]
Decimate = Annotated[int, typer.Option(metavar="N", help="Keep every Nth sample, without aliasing.")]
Seed = Annotated[int, typer.Option(metavar="S", help="Seed of everything random; same seed, same result.")]
Sensitivity = Annotated[
    list[str] | None,
    typer.Option(metavar="CH=S", help="Sensor of a channel stored in volts, as F=22.4mV/N; may be repeated."),
]
Input = Annotated[
    list[str] | None,
    typer.Option(
        "--input",
        metavar="COL",
        help="Further input of the model: a column, or a value as tension=35lbf, tension=20,35,80 (one per recording) "
        "or tension=*20lb*:20lbf (by name); may be repeated.",
    ),
]
Channel = Annotated[
    list[str] | None, typer.Option(metavar="CH=COL", help="Column that holds a channel, as F=Load; may be repeated.")
]
Unit = Annotated[
    list[str] | None,
    typer.Option(metavar="CH=UNIT", help="Unit of a channel instead of the header's, as a=g; may be repeated."),
]
Reverse = Annotated[
    list[str] | None, typer.Option(metavar="CH", help="Channel whose sign is turned round; may be repeated.")
]
Align = Annotated[
    list[str] | None,
    typer.Option(metavar="CH", help="Channel of another clock, moved by the lag that it shows; may be repeated."),
]
Resample = Annotated[bool, typer.Option("--resample", help="Interpolate unequal time steps and gaps linearly.")]
Accept = Annotated[
    list[str] | None,
    typer.Option(metavar="RULE", help="Door check whose errors count as warnings, as swapped_sign; may be repeated."),
]


def choice(option: str, value: str, allowed: Sequence[Choice]) -> Choice:
    """The value, where it is among those allowed. Raises UsageError."""
    for item in allowed:
        if item == value:
            return item
    raise UsageError(f"{option} {value}: choose {' or '.join(allowed)}")


def show(text: str) -> None:
    """Print a result. Names and units from files stand in it, which a terminal must not obey."""
    for line in text.split("\n"):
        print(printable(line, max(len(line), 1)))


@contextmanager
def results(out: Path) -> Iterator[Path]:
    """A folder for the files of a command, which replace an earlier result in ``out`` when all has gone well.

    Raises UsageError before any work where ``out`` cannot be written; says after Ctrl-C that nothing was.
    """
    with replaced(out) as new:
        try:
            yield new
        except KeyboardInterrupt:
            tell(f"nothing was written; what was in {out} before is still there")
            raise


@contextmanager
def resumable(out: Path) -> Iterator[None]:
    """For work that keeps each finished part in ``out``, and goes on from there when it is asked for again."""
    check_folder(out)
    try:
        yield
    except KeyboardInterrupt:
        tell(f"finished trainings are kept in {out}; the same command goes on from there")
        raise


def pairs(option: str, texts: Iterable[str] | None) -> dict[str, str]:
    """``["F=22.4mV/N"]`` -> {"F": "22.4mV/N"}. Raises UsageError for a missing "=" or a name given twice."""
    found: dict[str, str] = {}
    for text in texts or ():
        name, equals, value = (part.strip() for part in text.partition("="))
        if not (name and equals and value):
            raise UsageError(f"{option} {text}: write NAME=VALUE")
        if name in found:
            raise UsageError(f"{option} {name} is given twice: {found[name]} and {value}")
        found[name] = value
    return found


def numbers(option: str, texts: Iterable[str] | None) -> dict[str, float]:
    """``["Ks=2e5"]`` -> {"Ks": 2e5}; true is 1. Raises UsageError for what is no finite number."""
    return {name: _number(f"{option} {name}={value}", value) for name, value in pairs(option, texts).items()}


def _number(place: str, text: str) -> float:
    try:
        value = float({"true": "1", "false": "0"}.get(text, text))
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise UsageError(f"{place}: the value must be a finite number in SI units")
    return value


def parameter_file(path: Path | None) -> dict[str, Any]:
    """Parameters from a JSON file: {"Ks": 2e5} or {"Ks": {"value": 2e5, "fixed": true}}. Raises UsageError."""
    if path is None:
        return {}
    if "=" in str(path) and not path.exists():
        raise UsageError(f"--parameters {path}: this option takes a file; give a value with --set {path}")
    content = json_of(path, UsageError)
    if not isinstance(content, dict):
        raise UsageError(f'--parameters {path}: an object is needed, as {{"Ks": 2e5, "fc": 20}}')
    for name, entry in content.items():
        _number(f"--parameters {path}: {name}", str(entry.get("value") if isinstance(entry, dict) else entry))
    return content


def band_of(text: str | None) -> Band | None:
    """``"5-500Hz"`` -> (5.0, 500.0); None for None. Raises UsageError."""
    from hystid.processing import parse_band

    return None if text is None else parse_band(text)


def with_inputs(
    inputs: Sequence[str] | None, *groups: Sequence[Recording]
) -> tuple[tuple[str, ...], list[list[Recording]]]:
    """Names of the further inputs, and the groups of recordings with the values given for them. Raises UsageError."""
    from hystid.recording import with_columns

    names, found = with_columns([recording for group in groups for recording in group], inputs or ())
    return names, _grouped_as(groups, found)


def _mass_texts(texts: Sequence[str]) -> list[str]:
    from hystid.recording import mass_texts

    return mass_texts(texts)


def with_masses(texts: Sequence[str], *groups: Sequence[Recording]) -> tuple[float, list[list[Recording]]]:
    """Mass of the first recording, and the groups with the masses given for single recordings. Raises UsageError."""
    from hystid.recording import with_masses as given

    mass, found = given([recording for group in groups for recording in group], texts)
    return mass, _grouped_as(groups, found)


def _grouped_as(groups: Sequence[Sequence[Recording]], found: Sequence[Recording]) -> list[list[Recording]]:
    parts = []
    for group in groups:
        parts.append(list(found[: len(group)]))
        found = found[len(group) :]
    return parts


def layer_sizes(text: str) -> tuple[int, ...]:
    """``"5,5"`` -> (5, 5). Raises UsageError."""
    try:
        sizes = tuple(int(part) for part in text.replace("-", ",").split(","))
    except ValueError:
        sizes = ()
    if not sizes or min(sizes) < 1 or max(sizes) > 512 or len(sizes) > 8:
        raise UsageError(f"--layers {text}: write the neurons of each hidden layer, as 5,5")
    return sizes


def apart(recordings: Sequence[Path], holdout: Sequence[Path] | None) -> Sequence[Path]:
    """The held-out files, after checking that none of them is also used. Raises UsageError."""
    used = set(map(os.path.realpath, recordings))
    for path in holdout or ():
        if os.path.realpath(path) in used:
            raise UsageError(f"{path} is both used and held out: leave it out of one of the two lists")
    return holdout or ()


def done(result: Result, out: Path) -> None:
    """Print what a command has found, and where it lies."""
    show(result.summary())
    show(f"results and report.html in {out}")


def command_line(name: str) -> str:
    """What was typed, or the bare name of the command where it was called from Python."""
    import shlex

    return shlex.join(["hystid", *sys.argv[1:]]) if sys.argv[1:] else f"hystid {name}"
