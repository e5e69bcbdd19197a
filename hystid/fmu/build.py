"""From ``ModelCode`` to an FMU: C tables, libraries, description, sources and reference results in one zip file."""

from __future__ import annotations

import ctypes
import html
import os
import re
import zipfile
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Literal
from xml.etree import ElementTree as ET

from hystid.batch import TableRunner
from hystid.compiled import FLAGS, shell_text
from hystid.errors import FmuError, UsageError
from hystid.files import atomic
from hystid.fmu.about import About
from hystid.fmu.interface import Interface, interface
from hystid.fmu.model_description import model_description
from hystid.fmu.model_description.common import add, text_of
from hystid.fmu.platforms import Platform, binaries, chosen, compile_for, host
from hystid.fmu.presentation import presentation
from hystid.fmu.reference import reference_entries
from hystid.fmu.tables import variables_source
from hystid.modelcode import ModelCode

Version = Literal[2, 3]

_SHELL_C = (
    "hy_engine.c",
    "hy_step.c",
    "hy_table.c",
    "hy_fmi.c",
    "hy_values.c",
    "hy_derivative.c",
    "hy_state.c",
    "hy_arrays.c",
)
_SHELL_H = (
    "hy_model.h", "hy_engine.h", "hy_paths.h", "hy_strip.h", "hy_table.h", "hy_fmi.h", "fmi_common.h",
)  # fmt: skip
_METHODS = {
    "hy_duhem_methods": "hy_duhem.c",
    "hy_path_methods": "hy_paths.c",
    "hy_stop_methods": "hy_stops.c",
    "hy_strip_methods": "hy_strip.c",
}  # come with models that name them
_FMI_H = {
    2: ("fmi2Functions.h", "fmi2FunctionTypes.h", "fmi2TypesPlatform.h"),
    3: ("fmi3Functions.h", "fmi3FunctionTypes.h", "fmi3PlatformTypes.h"),
}


@dataclass(frozen=True)
class BuildResult:
    """A finished FMU. size in bytes; identifier is the name of its binaries.

    changes: what is different from the FMU that it replaced, one line each; None where it replaced none.
    """

    path: Path
    fmi: Version
    identifier: str
    platforms: tuple[str, ...]
    size: int
    changes: tuple[str, ...] | None = None

    def __fspath__(self) -> str:
        """The path, so that the result serves wherever a file name does."""
        return str(self.path)

    def summary(self) -> str:
        """Path, size, FMI version and platforms in one line."""
        return f"{self.path} ({self.size / 1000:.0f} kB, FMI {self.fmi}.0, {', '.join(self.platforms)})"

    def _repr_html_(self) -> str:
        """What a notebook shows: the summary, and what changed."""
        return f"<pre>{html.escape(chr(10).join((self.summary(), *(self.changes or ()))))}</pre>"


def build(
    code: ModelCode,
    out: Path,
    *,
    fmi: Version = 2,
    platforms: str | Iterable[str] = "host",
    extra: Mapping[str, bytes] | None = None,
    reference: bool | None = None,
    about: About | None = None,
) -> BuildResult:
    """Write an FMU for Model Exchange and Co-Simulation.

    fmi: 2 or 3. platforms: "host", "all" or names such as "aarch64-linux". extra: path inside the FMU -> content.
    reference: whether to run the default experiment and put its results into the FMU; by default, where this machine
    is among the platforms. about: author, version and terms for the description.
    Raises UsageError, FmuError (a variable's attributes are contradictory), ToolchainError; then nothing is written.
    """
    if fmi not in (2, 3):
        raise UsageError(f"fmi must be 2 or 3, not {fmi}")
    if code.arrays and fmi != 3:
        raise UsageError("arrays: FMI 2.0 has single numbers only; build for FMI 3.0, or leave them out")
    if not code.token:
        raise FmuError(f"{code.name}: the model code carries no instantiation token")
    model, targets = interface(code), chosen(platforms)
    shell, own = shell_sources(fmi), _own_sources(model, fmi)
    sources = {**shell, **own}
    main = [name for name in sources if name.endswith(".c")]
    built = {target.tuple: compile_for(target, shell, own, FLAGS) for target in targets}
    if reference is None:
        reference = host() in built
    extra = {**(extra or {}), **(_reference(code, built) if reference else {})}
    about = about or About()
    description = model_description(model, fmi, generated=_now(), sources=main, about=about)
    content: dict[str, bytes] = {
        "modelDescription.xml": description.encode(),
        **binaries(built, model.identifier, fmi),
        **{f"sources/{name}": text.encode() for name, text in sources.items()},
        **{f"resources/{name}": data for name, data in code.resources.items()},
        **presentation(model, fmi, about, extra),
        **extra,
    }
    if fmi == 3:
        content["sources/buildDescription.xml"] = _build_description(model, main, targets).encode()
    write_zip(Path(out), content)
    return BuildResult(Path(out), fmi, model.identifier, tuple(built), Path(out).stat().st_size)


def fmu_sources(model: Interface, version: Version) -> dict[str, str]:
    """File name -> text of everything that the library is compiled from, headers included."""
    return {**shell_sources(version), **_own_sources(model, version)}


def shell_sources(version: Version) -> dict[str, str]:
    """File name -> text of what all FMUs of a version share."""
    headers = {name: shell_text(f"fmi/{name}") for name in _FMI_H[version]}
    own = {name: shell_text(name) for name in (*_SHELL_C, f"fmi{version}.c", *_SHELL_H)}
    return {**own, **headers, "hy_names.h": _prefixed_names(own[name] for name in _SHELL_H)}


def _prefixed_names(headers: Iterable[str]) -> str:
    """A header that puts the prefix of the FMI functions before the shell's own names, for static linking of several
    FMUs into one program; ``hy_model.h`` includes it where such a prefix is defined."""
    names = sorted({name for text in headers for name in re.findall(r"\bhy_\w+", text)})
    return "\n".join(
        (
            "/* The shell's names with the prefix of the FMI functions: FMUs linked into one program do not clash. */",
            "#ifdef FMI2_FUNCTION_PREFIX",
            "#define HY_PREFIX FMI2_FUNCTION_PREFIX",
            "#else",
            "#define HY_PREFIX FMI3_FUNCTION_PREFIX",
            "#endif",
            "#define HY_GLUED(prefix, name) prefix##name",
            "#define HY_NAME(prefix, name) HY_GLUED(prefix, name)",
            *(f"#define {name} HY_NAME(HY_PREFIX, {name})" for name in names),
            "",
        )
    )


def _own_sources(model: Interface, version: Version) -> dict[str, str]:
    clash = set(model.code.sources) & {*shell_sources(version), *_METHODS.values()}
    if clash:
        raise FmuError(f"{model.code.name}: the source file {min(clash)} has the name of a file of the shell")
    named = [name for name in _METHODS if any(name in text for text in model.code.sources.values())]
    more = {_METHODS[name]: shell_text(_METHODS[name]) for name in named}
    return {**model.code.sources, **more, "hy_variables.c": variables_source(model, version)}


def _reference(code: ModelCode, built: Mapping[str, Path]) -> dict[str, bytes]:
    if host() not in built:
        raise UsageError(f"reference results need a binary for this machine ({host()}) in the FMU")
    return reference_entries(code, TableRunner(ctypes.CDLL(str(built[host()])), code.name))


def write_zip(path: Path, content: Mapping[str, bytes]) -> None:
    """Write a zip file atomically; the same content gives the same bytes."""
    with atomic(path) as beside, zipfile.ZipFile(beside, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in content.items():
            entry = zipfile.ZipInfo(name, (1980, 1, 1, 0, 0, 0))
            entry.compress_type = zipfile.ZIP_DEFLATED
            entry.external_attr = (0o755 if name.startswith("binaries/") else 0o644) << 16
            archive.writestr(entry, data, compresslevel=9)


def read_zip(path: Path) -> dict[str, bytes]:
    """The files of a zip file, by their names there."""
    with zipfile.ZipFile(path) as archive:
        return {name: archive.read(name) for name in archive.namelist() if not name.endswith("/")}


def given_date() -> int | None:
    """Seconds since 1970 from SOURCE_DATE_EPOCH, where it is set: it makes builds reproducible byte for byte.

    Raises UsageError where it is no number.
    """
    text = os.environ.get("SOURCE_DATE_EPOCH", "")
    if text and not text.isdecimal():
        raise UsageError(f"SOURCE_DATE_EPOCH={text}: a number of seconds since 1970 is expected")
    return int(text) if text else None


def _now() -> datetime:
    given = given_date()
    return datetime.now(UTC) if given is None else datetime.fromtimestamp(given, UTC)


def _build_description(model: Interface, main: Iterable[str], targets: Iterable[Platform]) -> str:
    root = ET.Element("fmiBuildDescription", {"fmiVersion": "3.0"})
    attributes: dict[str, str | None] = {"modelIdentifier": model.identifier, "description": "any C11 compiler"}
    configuration = add(root, "BuildConfiguration", attributes)
    options = " ".join(("-std=c11", "-fvisibility=hidden", *FLAGS))
    files = add(configuration, "SourceFileSet", {"language": "C11", "compiler": "gcc", "compilerOptions": options})
    for name in main:
        add(files, "SourceFile", {"name": name})
    if any(target.suffix == ".so" for target in targets):
        add(configuration, "Library", {"name": "m", "external": "true", "description": "C mathematics library"})
    return text_of(root)
