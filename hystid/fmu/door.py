"""The door for FMUs: what is refused, and in which words. Whatever passes is unpacked into a folder of its own."""

from __future__ import annotations

import shutil
import tempfile
import weakref
import zipfile
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any, Literal
from xml.etree import ElementTree

from hystid.errors import FmuError
from hystid.fmu.platforms import PLATFORMS, host
from hystid.modelcode import Experiment, ModelCode, Variable

_LARGEST = 4 << 30  # bytes unpacked: more than any FMU holds, less than a disk
_TYPES: dict[str, Literal["Real", "Integer", "Boolean"]] = {
    "Real": "Real", "Float64": "Real", "Integer": "Integer", "Int32": "Integer", "Enumeration": "Integer",
    "Boolean": "Boolean",
}  # fmt: skip


@dataclass(frozen=True)
class Kind:
    """One interface of an FMU: the library that implements it."""

    identifier: str
    library: Path


@dataclass(frozen=True)
class OpenedFmu:
    """An unpacked FMU. model: its variables in our words, without sources; folder goes with the last reference."""

    path: Path
    folder: Path
    version: Literal[2, 3]
    model: ModelCode
    co_simulation: Kind | None
    model_exchange: Kind | None
    interpolates_inputs: bool
    raw: Any  # FMPy's ModelDescription

    @property
    def name(self) -> str:
        """File name, for messages."""
        return self.path.name


def open_fmu(path: Path) -> OpenedFmu:
    """Check and unpack an FMU (FMI 2.0 or 3.0). Raises FmuError with one sentence naming file and reason."""
    path = Path(path)
    if not path.is_file():
        raise FmuError(f"{path}: there is no such file")
    try:
        with zipfile.ZipFile(path) as archive:
            _check_entries(path, archive)
            description = _description(path, archive)
            folder = Path(tempfile.mkdtemp(prefix="hystid-fmu-"))
            archive.extractall(folder)
    except zipfile.BadZipFile as error:
        raise FmuError(f"{path.name}: not an FMU, for it is not a zip file or it is damaged ({error})") from None
    version: Literal[2, 3] = 2 if description.fmiVersion == "2.0" else 3
    kinds = _kinds(path, folder, description, version)
    opened = OpenedFmu(
        path=path,
        folder=folder,
        version=version,
        model=_model(description, version),
        co_simulation=kinds.get("CoSimulation"),
        model_exchange=kinds.get("ModelExchange"),
        interpolates_inputs=version == 2 and bool(getattr(description.coSimulation, "canInterpolateInputs", False)),
        raw=description,
    )
    weakref.finalize(opened, shutil.rmtree, folder, ignore_errors=True)
    return opened


def _check_entries(path: Path, archive: zipfile.ZipFile) -> None:
    names = archive.namelist()
    for name in names:
        parts = PurePosixPath(name.replace("\\", "/"))
        if parts.is_absolute() or ".." in parts.parts or ":" in name[:2]:
            raise FmuError(f"{path.name}: refused, for the entry '{name}' would be written outside its folder")
    if "modelDescription.xml" not in names:
        raise FmuError(f"{path.name}: not an FMU, for it holds no modelDescription.xml")
    if sum(entry.file_size for entry in archive.infolist()) > _LARGEST:
        raise FmuError(f"{path.name}: refused, for it would unpack to more than {_LARGEST >> 30} GiB")


def _description(path: Path, archive: zipfile.ZipFile) -> Any:
    from io import BytesIO

    from fmpy import read_model_description

    text = archive.read("modelDescription.xml")
    try:
        version = ElementTree.fromstring(text).get("fmiVersion") or "none"
    except ElementTree.ParseError as error:
        raise FmuError(f"{path.name}: modelDescription.xml is not well-formed: {error}") from None
    if version != "2.0" and not version.startswith("3."):
        raise FmuError(f"{path.name}: FMI version {version} is not supported; 2.0 and 3.0 are")
    try:
        return read_model_description(BytesIO(_only_description(text)), validate=False)
    except Exception as error:  # FMPy raises bare exceptions
        raise FmuError(f"{path.name}: modelDescription.xml cannot be read: {_first_line(error)}") from None


def _only_description(text: bytes) -> bytes:
    """A zip with the description alone: FMPy reads nothing else, and build descriptions would be read eagerly."""
    from io import BytesIO

    buffer = BytesIO()
    with zipfile.ZipFile(buffer, "w") as archive:
        archive.writestr("modelDescription.xml", text)
    return buffer.getvalue()


def _first_line(error: Exception) -> str:
    return (str(error).strip().splitlines() or [type(error).__name__])[0]


def _kinds(path: Path, folder: Path, description: Any, version: int) -> dict[str, Kind]:
    platform = PLATFORMS.get(host())
    if platform is None:
        raise FmuError(f"{path.name}: FMUs cannot be run on {host()}")
    directory = folder / "binaries" / (platform.tuple if version == 3 else platform.folder)
    declared = {"CoSimulation": description.coSimulation, "ModelExchange": description.modelExchange}
    kinds = {}
    for name, interface in declared.items():
        if interface is not None:
            library = directory / f"{interface.modelIdentifier}{platform.suffix}"
            if library.is_file():
                kinds[name] = Kind(interface.modelIdentifier, library)
    if not any(declared.values()):
        raise FmuError(f"{path.name}: it offers neither co-simulation nor model exchange")
    if not kinds:
        found = sorted(p.name for p in (folder / "binaries").glob("*") if p.is_dir())
        there = f"binaries for {', '.join(found)}" if found else "none at all"
        raise FmuError(f"{path.name}: no binary for this platform ({directory.name}); it has {there}")
    return kinds


def _model(description: Any, version: int) -> ModelCode:
    variables = tuple(v for v in map(_variable, description.modelVariables) if v is not None)
    derivatives = [unknown.variable for unknown in description.derivatives]
    states = tuple(v.derivative.name for v in derivatives if v.derivative is not None)
    kinds = [k for k in (description.modelExchange, description.coSimulation) if k is not None]
    attribute = "providesDirectionalDerivative" if version == 2 else "providesDirectionalDerivatives"
    experiment = description.defaultExperiment
    return ModelCode(
        name=description.modelName,
        description=description.description or "",
        variables=variables,
        sources={},
        states=states,
        n_indicators=int(description.numberOfEventIndicators or len(getattr(description, "eventIndicators", ()) or ())),
        has_forward=any(bool(getattr(kind, attribute, False)) for kind in kinds),
        experiment=Experiment(
            _number(experiment, "startTime", 0.0),
            _number(experiment, "stopTime", 1.0),
            _number(experiment, "stepSize", 1e-3),
        ),
        token=description.guid or getattr(description, "instantiationToken", "") or "",
    )


def _number(source: Any, name: str, default: float) -> float:
    value = getattr(source, name, None)
    return default if value is None else float(value)


def _variable(v: Any) -> Variable | None:
    if v.type not in _TYPES or getattr(v, "dimensions", None):
        return None  # strings, binaries, clocks and arrays: nothing that we set or read
    number = {"true": 1.0, "false": 0.0}.get(str(v.start).lower())
    try:
        start = number if number is not None else float(v.start) if v.start is not None else None
    except ValueError:
        start = None
    return Variable(
        name=v.name,
        slot=v.valueReference,
        causality=v.causality or "local",
        variability=v.variability or ("continuous" if v.type in ("Real", "Float64") else "discrete"),
        type=_TYPES[v.type],
        initial=v.initial,
        start=start,
        nominal=_optional(v.nominal),
        unit=v.unit or "",
        description=v.description or "",
        derivative_of=v.derivative.name if v.derivative is not None else None,
    )


def _optional(value: Any) -> float | None:
    return None if value is None else float(value)
