"""Options in groups: commands that share many of them take a dataclass for each group."""

from __future__ import annotations

import inspect
import os
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import MISSING, dataclass, fields, is_dataclass, replace
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypeVar, cast, get_type_hints

import typer

from hystid.cli import options as opt
from hystid.errors import ModelicaError, UsageError, sentence
from hystid.files import write_json

if TYPE_CHECKING:
    from hystid.diagnosis import Diagnosis
    from hystid.fmu import About
    from hystid.recording import Recording

Command = TypeVar("Command", bound=Callable[..., Any])


@dataclass(frozen=True)
class ReadingOptions:
    """The options of every command that reads recordings."""

    sensitivity: opt.Sensitivity = None
    channel: opt.Channel = None
    resample: opt.Resample = False
    accept: opt.Accept = None
    unit: opt.Unit = None
    reverse: opt.Reverse = None
    align: opt.Align = None

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
            sensitivity=opt.pairs("--sensitivity", self.sensitivity),
            names=opt.pairs("--channel", self.channel),
            resample=self.resample,
            accept=tuple({*(self.accept or ()), *tolerated}),
            units=opt.pairs("--unit", self.unit),
            reverse=tuple(self.reverse or ()),
        )
        found = aligned(found, tuple(self.align)) if self.align else found
        for recording in found:
            for warning in recording.warnings:
                print(sentence(f"hystid: warning: {warning}"), file=sys.stderr)
        return found


@dataclass(frozen=True)
class Preparation(ReadingOptions):
    """What is done to recordings that surrogates are made of or compared with, beside reading them."""

    band: opt.BandText = None
    decimate: opt.Decimate = 1
    further: opt.Input = None


@dataclass(frozen=True)
class TrainingOptions:
    """How networks are trained."""

    layers: Annotated[str, typer.Option(metavar="N,N", help="Neurons of each hidden layer, as 5,5.")] = "5,5"
    ensemble: Annotated[int, typer.Option(metavar="N", help="Trainings; the best tenth is averaged.")] = 30
    seed: opt.Seed = 0
    mode: Annotated[str, typer.Option(metavar="fast|trainlm", help="Damping rule of the training.")] = "fast"
    method: Annotated[
        str, typer.Option(metavar="published|refined", help="The published method, or refined in closed loop.")
    ] = "refined"
    workers: Annotated[int | None, typer.Option(metavar="N", help="Trainings at a time; all cores by default.")] = None

    def settings(self) -> dict[str, Any]:
        """The same as arguments of ``identify``. Raises UsageError."""
        return vars(self) | {
            "layers": opt.layer_sizes(self.layers),
            "mode": opt.choice("--mode", self.mode, ("fast", "trainlm")),
            "method": opt.choice("--method", self.method, ("published", "refined")),
        }


@dataclass(frozen=True)
class Reference:
    """The FMU that a surrogate is compared with, and what drives both."""

    against: Annotated[Path | None, typer.Option(metavar="REF.fmu", help="Reference FMU to compare with.")] = None
    force: Annotated[
        list[str] | None, typer.Option(metavar="SPEC", help="Force for --against, as harmonic:20Hz@80N,2s; repeatable.")
    ] = None
    dt: Annotated[
        float | None,
        typer.Option(metavar="S", help="Time step in s of a force given as SPEC, if not that of the surrogate."),
    ] = None


@dataclass(frozen=True)
class FmuOptions:
    """How an FMU is made, and what its description says."""

    fmi: Annotated[int, typer.Option(metavar="2|3", help="FMI version.")] = 2
    set_: opt.Set = None
    platforms: Annotated[str, typer.Option(metavar="host|all", help="Machines that the FMU runs on.")] = "host"
    library: Annotated[
        list[Path] | None,
        typer.Option(
            metavar="PATH",
            help="Folder with Modelica packages, such as the Modelica Standard Library; also a package or a file; "
            "repeatable. MODELICAPATH is searched too.",
        ),
    ] = None
    new_reference: Annotated[
        bool, typer.Option("--new-reference", help="Do not keep the reference result of the FMU that is replaced.")
    ] = False
    author: Annotated[str, typer.Option(metavar="TEXT", help="Author, for the FMU's description.")] = ""
    model_version: Annotated[str, typer.Option(metavar="TEXT", help="Version of the model, as 1.2.0.")] = ""
    license_: Annotated[str, typer.Option("--license", metavar="TEXT", help="Licence of the model.")] = ""
    copyright_: Annotated[str, typer.Option("--copyright", metavar="TEXT", help="Copyright of the model.")] = ""
    arrays: Annotated[
        bool, typer.Option("--arrays", help="List inputs and outputs of a network as arrays; needs --fmi 3.")
    ] = False

    def given(self) -> list[str]:
        """Options that are not as they are by default."""
        named = ((f"--{field.name.strip('_').replace('_', '-')}", field) for field in fields(self))
        return [option for option, field in named if (getattr(self, field.name) or field.default) != field.default]

    def about(self) -> About:
        """What the description says of the model's origin."""
        from hystid.fmu import About

        return About(self.author, self.model_version, self.license_, self.copyright_)


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
    parameters: Annotated[Path | None, typer.Option(metavar="P.json", help='Known parameters, as {"m": 4.2}.')] = None
    set_: opt.Set = None

    def known(self) -> dict[str, Any]:
        """Known parameters; those of --set go before those of the file. Raises UsageError."""
        return {**opt.parameter_file(self.parameters), **opt.numbers("--set", self.set_)}

    def taken(self, folder: Path) -> str:
        """The model as ``diagnose`` takes it; a class that names its signals is written into a folder."""
        from hystid.diagnosis import wired

        signals = opt.pairs("--signal", self.signal)
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

    recordings: opt.Recordings
    mass: opt.Mass
    out: opt.Folder
    holdout: opt.Holdout = None
    starts: Annotated[int, typer.Option(metavar="N", help="Trainings of each structure.")] = 30
    band: opt.BandText = None
    decimate: opt.Decimate = 1
    seed: opt.Seed = 0
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
    vars(flat)["__signature__"] = inspect.Signature(shown, return_annotation=hints["return"])
    flat.__annotations__ = {parameter.name: parameter.annotation for parameter in shown} | {"return": hints["return"]}
    return cast(Command, flat)
