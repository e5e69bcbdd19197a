"""Options that several commands share, and what their texts mean."""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from hystid.errors import UsageError

if TYPE_CHECKING:
    from hystid.recording import Recording

Recordings = Annotated[
    list[Path],
    typer.Argument(
        metavar="REC...",
        help="Recordings: .csv with 'name [unit]' headers, .mat, .h5, .uff or .tdms.",
        show_default=False,
    ),
]
Holdout = Annotated[
    list[Path] | None, typer.Option(metavar="REC", help="Recording kept for testing only; may be repeated.")
]
Folder = Annotated[Path, typer.Option("-o", "--out", metavar="DIR", help="Folder for the results.", show_default=False)]
Set = Annotated[
    list[str] | None, typer.Option("--set", metavar="P=V", help="Parameter value in SI units; may be repeated.")
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
Channel = Annotated[
    list[str] | None, typer.Option(metavar="CH=COL", help="Column that holds a channel, as F=Load; may be repeated.")
]
Resample = Annotated[bool, typer.Option("--resample", help="Interpolate unequal time steps and gaps linearly.")]
Accept = Annotated[
    list[str] | None,
    typer.Option(metavar="RULE", help="Door check whose errors count as warnings, as swapped_sign; may be repeated."),
]


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
    """``["Ks=2e5"]`` -> {"Ks": 2e5}. Raises UsageError for what is no finite number."""
    return {name: _number(f"{option} {name}={value}", value) for name, value in pairs(option, texts).items()}


def _number(place: str, text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise UsageError(f"{place}: the value must be a finite number in SI units")
    return value


def parameter_file(path: Path | None) -> dict[str, Any]:
    """Parameters from a JSON file: {"Ks": 2e5} or {"Ks": {"value": 2e5, "fixed": true}}. Raises UsageError."""
    if path is None:
        return {}
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except OSError:
        raise UsageError(f"--parameters {path}: the file cannot be read") from None
    except ValueError as error:
        raise UsageError(f"--parameters {path}: this is not JSON ({error})") from None
    if not isinstance(content, dict):
        raise UsageError(f'--parameters {path}: an object is needed, as {{"Ks": 2e5, "fc": 20}}')
    for name, entry in content.items():
        _number(f"--parameters {path}: {name}", str(entry.get("value") if isinstance(entry, dict) else entry))
    return content


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
    used = {path.resolve() for path in recordings}
    for path in holdout or ():
        if path.resolve() in used:
            raise UsageError(f"{path} is both used and held out: leave it out of one of the two lists")
    return holdout or ()


def load(
    paths: Sequence[Path],
    sensitivity: Iterable[str] | None = None,
    channel: Iterable[str] | None = None,
    resample: bool = False,
    accept: Iterable[str] = (),
) -> list[Recording]:
    """Read recordings as the command line asks, and print what is doubtful about them."""
    if not paths:
        return []
    from hystid.recording import read_all

    found = read_all(
        paths,
        sensitivity=pairs("--sensitivity", sensitivity),
        names=pairs("--channel", channel),
        resample=resample,
        accept=tuple(accept),
    )
    for recording in found:
        for warning in recording.warnings:
            print(f"hystid: warning: {warning}", file=sys.stderr)
    return found
