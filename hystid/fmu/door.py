"""The door for FMUs: what is refused, and in which words. Whatever passes is unpacked into a folder of its own."""

from __future__ import annotations

import errno
import lzma
import re
import shutil
import stat
import struct
import weakref
import zipfile
import zlib
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any, Literal
from xml.parsers import expat

from hystid.errors import FmuError, first_line
from hystid.files import check_regular, on_disk_of, scratch_folder
from hystid.fmu.platforms import PLATFORMS, host
from hystid.fmu.si import unit_of
from hystid.fmu.signals import Signal, signals_of
from hystid.limits import FMU_DESCRIPTION, FMU_ELEMENTS, FMU_ENTRIES, FMU_UNPACKED, Limit
from hystid.modelcode import Enumeration, Experiment, ModelCode, Variable

DESCRIPTION = "modelDescription.xml"
_MB = 1 << 20
_ENCRYPTED = 1  # flag of an entry
_IDENTIFIER = re.compile(r"[A-Za-z_][A-Za-z0-9_]{0,199}")
# What zipfile and the decompressors raise on damaged archives, and the system on names that it does not take
_DAMAGE = (
    zipfile.BadZipFile, zlib.error, lzma.LZMAError, struct.error, EOFError, RuntimeError,
    ValueError, OSError, KeyError, IndexError, OverflowError,
)  # fmt: skip
_MACHINE = (errno.ENOSPC, errno.EDQUOT, errno.EACCES, errno.EROFS, errno.EMFILE, errno.ENOMEM)  # not the file's fault
_TYPES: dict[str, Literal["Real", "Integer", "Boolean"]] = {
    "Real": "Real", "Float64": "Real", "Float32": "Real", "Boolean": "Boolean",
    "Integer": "Integer", "Enumeration": "Integer", "Int8": "Integer", "UInt8": "Integer", "Int16": "Integer",
    "UInt16": "Integer", "Int32": "Integer", "UInt32": "Integer", "Int64": "Integer", "UInt64": "Integer",
}  # fmt: skip


@dataclass(frozen=True)
class Kind:
    """One interface of an FMU: the library that implements it."""

    identifier: str
    library: Path


@dataclass(frozen=True)
class OpenedFmu:
    """An unpacked FMU. model: its single numbers in our words, without sources; signals: name -> variable of any type
    but clocks; folder goes with the last reference."""

    path: Path
    folder: Path
    version: Literal[2, 3]
    model: ModelCode
    signals: Mapping[str, Signal]
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
    folder = unpack(path)
    try:
        opened = opened_from(path, folder)
    except BaseException:
        shutil.rmtree(folder, ignore_errors=True)
        raise
    weakref.finalize(opened, shutil.rmtree, folder, ignore_errors=True)
    return opened


def opened_from(path: Path, folder: Path) -> OpenedFmu:
    """The FMU that was unpacked from path into a folder; the folder stays. Raises FmuError as ``open_fmu``."""
    text = (folder / DESCRIPTION).read_bytes()
    try:
        description = _description(path, text)
        version: Literal[2, 3] = 2 if description.fmiVersion == "2.0" else 3
        model = _model(description, version)
        signals = signals_of(description.modelVariables, version)
        interpolates = version == 2 and bool(getattr(description.coSimulation, "canInterpolateInputs", False))
    except FmuError:
        raise
    except Exception as error:  # FMPy raises bare exceptions; numbers that are none raise ours
        raise FmuError(f"{path.name}: {DESCRIPTION} cannot be read: {_reason(error)}") from None
    _check_variables(path, model, signals, description.modelVariables)
    kinds = _kinds(path, folder, description, version)
    return OpenedFmu(
        path, folder, version, model, signals, kinds.get("CoSimulation"), kinds.get("ModelExchange"), interpolates,
        description,
    )  # fmt: skip


def unpack(path: Path) -> Path:
    """Unpack an FMU into a new folder, which the caller removes. Raises FmuError; then nothing is left behind."""
    check_regular(path, FmuError)
    folder = scratch_folder()
    try:
        with on_disk_of(folder.parent), zipfile.ZipFile(path) as archive:
            _extract(path, archive, _checked(path, archive), folder)
    except BaseException as error:
        shutil.rmtree(folder, ignore_errors=True)
        if isinstance(error, OSError) and error.errno in _MACHINE:
            raise
        if isinstance(error, _DAMAGE):
            raise FmuError(
                f"{path.name}: not an FMU, for it is not a zip file or it is damaged ({first_line(error)})"
            ) from None
        raise
    return folder


def read_entry(path: Path, name: str, most: int = 64 << 20) -> bytes | None:
    """One entry of an FMU, of at most so many bytes, None where it has none of this name. Raises FmuError."""
    check_regular(path, FmuError)
    try:
        with zipfile.ZipFile(path) as archive:
            if name not in archive.namelist():
                return None
            with archive.open(name) as entry:
                content = entry.read(most + 1)
    except _DAMAGE as error:
        raise FmuError(f"{path.name}: its entry '{name}' cannot be read ({first_line(error)})") from None
    if len(content) > most:
        raise FmuError(f"{path.name}: its entry '{name}' has more than {most >> 20} MB")
    return content


def _checked(path: Path, archive: zipfile.ZipFile) -> dict[PurePosixPath, zipfile.ZipInfo]:
    """The files of the archive by their path. Raises FmuError for entries that no FMU has."""
    entries = archive.infolist()
    if len(entries) > FMU_ENTRIES.value:
        raise FmuError(f"{path.name}: refused, for it has {len(entries)} entries, more than {FMU_ENTRIES}")
    files: dict[PurePosixPath, zipfile.ZipInfo] = {}
    taken = set()
    for entry in entries:
        place = PurePosixPath(entry.filename.replace("\\", "/"))
        if place.is_absolute() or ".." in place.parts or ":" in entry.filename[:2]:
            raise FmuError(
                f"{path.name}: refused, for the entry '{entry.filename}' would be written outside its folder"
            )
        if stat.S_IFMT(entry.external_attr >> 16) not in (0, stat.S_IFREG, stat.S_IFDIR):
            raise FmuError(f"{path.name}: refused, for the entry '{entry.filename}' is a link or a device, not a file")
        if entry.flag_bits & _ENCRYPTED:
            raise FmuError(f"{path.name}: it is encrypted, which FMUs are not; write it without a password")
        if entry.is_dir() or not place.parts:
            continue
        if str(place).casefold() in taken:
            raise FmuError(f"{path.name}: refused, for it has the entry '{entry.filename}' twice")
        taken.add(str(place).casefold())
        files[place] = entry
    if PurePosixPath(DESCRIPTION) not in files:
        raise FmuError(f"{path.name}: not an FMU, for it holds no {DESCRIPTION}")
    _check_budget(path, sum(entry.file_size for entry in files.values()), FMU_UNPACKED, "it unpacks")
    size = files[PurePosixPath(DESCRIPTION)].file_size
    _check_budget(path, size, FMU_DESCRIPTION, f"its {DESCRIPTION} unpacks")
    return files


def _check_budget(path: Path, size: int, limit: Limit, what: str) -> None:
    if size > limit.value * _MB:
        raise FmuError(f"{path.name}: refused, for {what} to {size / _MB:.0f} MB, more than {limit}")


def _extract(
    path: Path, archive: zipfile.ZipFile, files: Mapping[PurePosixPath, zipfile.ZipInfo], folder: Path
) -> None:
    """Write the files, and count what really comes out: the directory of a zip file may say anything."""
    left = {DESCRIPTION: FMU_DESCRIPTION.value * _MB}
    total = FMU_UNPACKED.value * _MB
    for place, entry in files.items():
        target = folder.joinpath(*place.parts)
        target.parent.mkdir(parents=True, exist_ok=True)
        room = left.get(str(place), total)
        with archive.open(entry) as source, target.open("xb") as file:
            while block := source.read(1 << 20):
                room, total = room - len(block), total - len(block)
                if min(room, total) < 0:
                    raise FmuError(f"{path.name}: refused, for the entry '{entry.filename}' unpacks without an end")
                file.write(block)


def _description(path: Path, text: bytes) -> Any:
    from io import BytesIO

    from fmpy import read_model_description

    version = _version(path, text)
    if version != "2.0" and not version.startswith("3."):
        raise FmuError(f"{path.name}: FMI version {version} is not supported; 2.0 and 3.0 are")
    return read_model_description(BytesIO(_only_description(text)), validate=False)


def _version(path: Path, text: bytes) -> str:
    """FMI version of a description. Raises FmuError where it is no plain XML."""
    return check_xml(f"{path.name}: {DESCRIPTION}", text).get("fmiVersion", "none")


def check_xml(what: str, text: bytes) -> Mapping[str, str]:
    """Attributes of the outermost element. what: file and part, for messages. Raises FmuError where it is no plain XML.

    A document type can define entities, which can stand for gigabytes or for files of this machine. FMI knows none.
    """

    def refuse(*_: object) -> None:
        raise FmuError(f"{what} declares a document type, which FMI does not know; refused")

    def start(_: str, attributes: Mapping[str, str]) -> None:
        found.append(attributes)
        parser.StartElementHandler = None

    found: list[Mapping[str, str]] = []
    try:
        parser = expat.ParserCreate()
        parser.StartDoctypeDeclHandler, parser.StartElementHandler = refuse, start
        parser.Parse(text, True)
    except (expat.ExpatError, ValueError, LookupError) as error:
        raise FmuError(f"{what} is not well-formed: {error}") from None
    return found[0]


def _only_description(text: bytes) -> bytes:
    """A zip with the description alone: FMPy reads nothing else, and build descriptions would be read eagerly."""
    from io import BytesIO

    buffer = BytesIO()
    with zipfile.ZipFile(buffer, "w") as archive:
        archive.writestr(DESCRIPTION, text)
    return buffer.getvalue()


def _check_variables(path: Path, model: ModelCode, signals: Mapping[str, Signal], variables: Sequence[Any]) -> None:
    """Names stand once; what is set aside for values is decided by the description alone."""
    size = sum(signal.size for signal in signals.values()) + model.n_indicators
    if model.n_indicators < 0:
        raise FmuError(f"{path.name}: {DESCRIPTION} states {model.n_indicators} event indicators")
    if size > FMU_ELEMENTS.value:
        raise FmuError(f"{path.name}: refused, for it describes {size} numbers, more than {FMU_ELEMENTS}")
    names = Counter(v.name for v in variables)
    if names and max(names.values()) > 1:
        twice = next(name for name, count in names.items() if count > 1)
        raise FmuError(f"{path.name}: {DESCRIPTION} has two variables of the name '{twice}'")
    for signal in signals.values():
        if not 0 <= signal.reference < 1 << 32:
            raise FmuError(f"{path.name}: variable '{signal.name}' has the value reference {signal.reference}")


def _reason(error: Exception) -> str:
    """What FMPy found wrong; it takes references for granted, and its own checks are listed below a first line."""
    if isinstance(error, LookupError):
        return f"something that it refers to is not there ({error})"
    return "; ".join(line.strip() for line in str(error).splitlines()[:3]) or type(error).__name__


def _kinds(path: Path, folder: Path, description: Any, version: int) -> dict[str, Kind]:
    platform = PLATFORMS.get(host())
    if platform is None:
        raise FmuError(f"{path.name}: FMUs cannot be run on {host()}")
    directory = folder / "binaries" / (platform.tuple if version == 3 else platform.folder)
    declared = {"CoSimulation": description.coSimulation, "ModelExchange": description.modelExchange}
    kinds = {}
    for name, interface in declared.items():
        if interface is not None:
            if not _IDENTIFIER.fullmatch(interface.modelIdentifier or ""):
                raise FmuError(
                    f"{path.name}: refused, for its modelIdentifier '{interface.modelIdentifier}' is no C identifier; "
                    "it names the library inside the FMU"
                )
            library = directory / f"{interface.modelIdentifier}{platform.suffix}"
            if library.is_file():
                kinds[name] = Kind(interface.modelIdentifier, library)
    if not any(declared.values()):
        raise FmuError(f"{path.name}: it offers neither co-simulation nor model exchange")
    if not kinds:
        found = sorted(p.name for p in (folder / "binaries").glob("*") if p.is_dir())
        there = f"binaries for {', '.join(found)}" if found else "none at all"
        if directory.name in found:
            there = f"binaries/{directory.name}, but not the library of its modelIdentifier in it"
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
        return None  # texts, binary data, clocks and arrays
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
        min=_optional(v.min),
        max=_optional(v.max),
        nominal=_optional(v.nominal),
        unit=unit_of(v),
        description=v.description or "",
        derivative_of=v.derivative.name if v.derivative is not None else None,
        enumeration=_enumeration(v),
    )


def _enumeration(v: Any) -> Enumeration | None:
    """Names of its values, where these are counted from 1."""
    items = sorted((int(item.value), item.name) for item in getattr(v.declaredType, "items", None) or ())
    if v.type != "Enumeration" or not items or [value for value, _ in items] != list(range(1, len(items) + 1)):
        return None
    return Enumeration(v.declaredType.name, tuple(name for _, name in items))


def _optional(value: Any) -> float | None:
    return None if value is None else float(value)
