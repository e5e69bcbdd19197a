"""Options that several commands share, and what their texts mean."""

from __future__ import annotations

import inspect
import math
import os
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import MISSING, dataclass, fields, is_dataclass, replace
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypeVar, cast, get_type_hints

import typer

from hystid.errors import ModelicaError, UsageError, printable, sentence
from hystid.files import json_of, write_json
from hystid.outputs import check_folder, replaced
from hystid.progress import tell
from hystid.results import Result

if TYPE_CHECKING:
    from hystid.diagnosis import Diagnosis
    from hystid.recording import Recording

Command = TypeVar("Command", bound=Callable[..., Any])


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
    Path,
    typer.Option(
        "-o",
        "--out",
        parser=named,
        metavar="DIR",
        help="Folder for the results.",
        show_default=False,
    ),
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


@dataclass(frozen=True)
class ReadingOptions:
    """The options of every command that reads recordings."""

    sensitivity: Sensitivity = None
    channel: Channel = None
    resample: Resample = False
    accept: Accept = None
    unit: Unit = None
    reverse: Reverse = None
    align: Align = None

    def load(self, paths: Sequence[Path], tolerated: Iterable[str] = ()) -> list[Recording]:
        """Read recordings as the command line asks, and print what is doubtful about them.

        tolerated: door checks whose errors count as warnings, besides those of --accept.
        """
        if not paths:
            return []
        from hystid.consistency import aligned
        from hystid.recording import read_all

        found = read_all(
            paths,
            sensitivity=pairs("--sensitivity", self.sensitivity),
            names=pairs("--channel", self.channel),
            resample=self.resample,
            accept=tuple({*(self.accept or ()), *tolerated}),
            units=pairs("--unit", self.unit),
            reverse=tuple(self.reverse or ()),
        )
        found = aligned(found, tuple(self.align)) if self.align else found
        for recording in found:
            for warning in recording.warnings:
                print(sentence(f"hystid: warning: {warning}"), file=sys.stderr)
        return found


@dataclass(frozen=True)
class BaselineModel:
    """The model that recordings are held against."""

    model: Annotated[
        str, typer.Option(metavar="MODEL|FMU", help="HystId.Oscillators.Jenkins, file.mo:Class or an FMU.")
    ]
    signal: Annotated[
        list[str] | None,
        typer.Option(
            metavar="CH=VAR",
            help="Variable of the model that is F or x, as F=shaker.f or x=mass.flange_b.s; repeatable.",
        ),
    ] = None

    def taken(self, folder: Path) -> str:
        """The model as ``diagnose`` takes it; a class that names its signals is written into a folder."""
        from hystid.diagnosis import wired

        signals = pairs("--signal", self.signal)
        return wired(self.model, signals, folder) if signals else self.model

    @contextmanager
    def told(self, folder: Path) -> Iterator[None]:
        """Complaints about the written class without a folder that is gone when somebody reads them."""
        try:
            yield
        except (ModelicaError, UsageError) as error:
            raise type(error)(str(error).replace(f"{folder}{os.sep}", "")) from None

    def kept(self, result: Diagnosis, folder: Path, out: Path) -> Diagnosis:
        """The result, in ``folder`` too, with the written class where it will lie in the end."""
        if not self.signal:
            return result
        name = result.model.replace(str(folder), str(out))
        result = replace(result, model=name)
        write_json(folder / "diagnosis.json", result.as_dict())
        return result


@dataclass(frozen=True)
class Study:
    """What both studies are given, beside the options of reading."""

    recordings: Recordings
    mass: Mass
    out: Folder
    holdout: Holdout = None
    starts: Annotated[int, typer.Option(metavar="N", help="Trainings of each structure.")] = 30
    band: BandText = None
    decimate: Decimate = 1
    seed: Seed = 0
    workers: Annotated[
        int | None, typer.Option(metavar="N", help="Trainings at a time on this machine; all cores by default.")
    ] = None
    scheduler: Annotated[str | None, typer.Option(metavar="URL", help="Dask scheduler, as tcp://host:8786.")] = None


def grouped(command: Command) -> Command:
    """Let a command take its options in groups: a parameter whose type is a dataclass stands for the fields of it."""
    hints = get_type_hints(command, include_extras=True)
    groups = {name: kind for name, kind in hints.items() if is_dataclass(kind)}

    @wraps(command)
    def flat(**given: Any) -> Any:
        made = {
            name: cast(type[Any], kind)(**{field.name: given.pop(field.name) for field in fields(kind)})
            for name, kind in groups.items()
        }
        return command(**given, **made)

    shown: list[inspect.Parameter] = []
    for name, parameter in inspect.signature(command).parameters.items():
        if name in groups:
            types = get_type_hints(groups[name], include_extras=True)
            for field in fields(groups[name]):
                default = inspect.Parameter.empty if field.default is MISSING else field.default
                shown.append(parameter.replace(name=field.name, annotation=types[field.name], default=default))
        else:
            shown.append(parameter.replace(annotation=hints[name]))
    shown = [parameter.replace(kind=inspect.Parameter.KEYWORD_ONLY) for parameter in shown]
    flat.__signature__ = inspect.Signature(shown, return_annotation=hints["return"])  # type: ignore[attr-defined]  # any object may have it
    flat.__annotations__ = {parameter.name: parameter.annotation for parameter in shown} | {"return": hints["return"]}
    return cast(Command, flat)


def done(result: Result, out: Path) -> None:
    """Print what a command has found, and where it lies."""
    show(result.summary())
    show(f"results and report.html in {out}")


def command_line(name: str) -> str:
    """What was typed, or the bare name of the command where it was called from Python."""
    import shlex

    return shlex.join(["hystid", *sys.argv[1:]]) if sys.argv[1:] else f"hystid {name}"
