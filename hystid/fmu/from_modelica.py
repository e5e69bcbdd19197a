"""From a Modelica model to an FMU in one call, remembered by content."""

from __future__ import annotations

import hashlib
import json
import os
import shutil
from collections.abc import Iterable, Mapping, Sequence
from importlib.metadata import version
from pathlib import Path

from hystid import cache
from hystid.errors import ModelicaError, UsageError
from hystid.files import atomic, check_regular
from hystid.fmu.about import About
from hystid.fmu.build import BuildResult, Version, build, given_date
from hystid.fmu.platforms import chosen
from hystid.limits import compiled

_PACKAGE = Path(__file__).resolve().parents[1]
_MODELICA = (_PACKAGE / "_modelica", _PACKAGE.parent / "modelica")  # in a wheel, in a checkout


def build_model(
    model: str,
    out: Path,
    *,
    fmi: Version = 2,
    parameters: Mapping[str, float] | None = None,
    platforms: str | Iterable[str] = "host",
    libraries: Sequence[Path] = (),
    about: About | None = None,
) -> BuildResult:
    """Compile a Modelica model and write its FMU, reference results included.

    model: "HystId.Oscillators.Jenkins", "file.mo:Class", or "file.mo" where it holds one model. parameters: name ->
    start value. libraries: further .mo files, package folders, or folders that hold packages. The FMU of the same
    text, parameters and tool is copied from the cache instead of built again.
    about: author, version and terms for the description.
    Raises ModelicaError, UsageError, ToolchainError; then nothing is written.
    """
    if fmi not in (2, 3):
        raise UsageError(f"fmi must be 2 or 3, not {fmi}")
    for library in map(Path, libraries):
        if not library.is_dir():
            check_regular(library, ModelicaError)
    targets = chosen(platforms)
    names = tuple(target.tuple for target in targets)
    wanted = ["host" if target.own else target.tuple for target in targets]
    about = about or About()
    key = _key(model, fmi, dict(parameters or {}), [*wanted, *map(str, about.attributes().items())], libraries)
    if cache.find(f"{key}.fmu") is None or cache.find(f"{key}.json") is None:
        from hystid.modelica import compile_model  # not needed, and slow to import, where the FMU is in the cache

        def make() -> BuildResult:
            code = compile_model(model, parameters=dict(parameters or {}), libraries=libraries)
            with cache.keep(f"{key}.fmu") as beside:
                return build(code, beside, fmi=fmi, platforms=wanted, about=about)

        made = compiled(model, make, ModelicaError, len(targets))
        cache.keep_bytes(f"{key}.json", json.dumps({"identifier": made.identifier}).encode())
    out, identifier = Path(out), json.loads(cache.kept(f"{key}.json").read_bytes())["identifier"]
    with atomic(out) as beside:
        shutil.copyfile(cache.kept(f"{key}.fmu"), beside)
    return BuildResult(out, fmi, identifier, names, out.stat().st_size)


def _key(
    model: str, fmi: int, parameters: Mapping[str, float], wanted: Sequence[str], libraries: Sequence[Path]
) -> str:
    """Hash of everything that decides the FMU: request, Modelica text, compiler and shell, and a date that is given."""
    request = [model, fmi, sorted(parameters.items()), list(wanted), version("hystid"), given_date()]
    digest = hashlib.sha256(json.dumps(request).encode())
    packages = [entry for entry in map(Path, libraries) if _holds_packages(entry)]
    texts = _modelica_files(model, [entry for entry in map(Path, libraries) if entry not in packages])
    for path in (*texts, *_own_files()):
        digest.update(str(path).encode())
        digest.update(path.read_bytes())
    searched = [] if model.startswith("HystId.") else os.environ.get("MODELICAPATH", "").split(os.pathsep)
    for folder in (*packages, *(Path(entry) for entry in searched if entry)):
        for path in sorted(folder.rglob("*.mo")):  # thousands of files: their dates stand for their texts
            digest.update(f"{path} {path.stat().st_size} {path.stat().st_mtime_ns}".encode())
    return digest.hexdigest()[:32]


def _holds_packages(entry: Path) -> bool:
    """Whether it is a folder of packages, as those that MODELICAPATH names, and not a package or a file."""
    return entry.is_dir() and not (entry / "package.mo").is_file()


def _modelica_files(model: str, libraries: Sequence[Path]) -> list[Path]:
    named = [Path(model.partition(".mo")[0] + ".mo")] if ".mo" in model else []
    found: list[Path] = []
    for entry in (*_MODELICA, *named, *map(Path, libraries)):
        root = entry.parent if entry.is_file() else entry  # a package's other files lie beside it
        found += sorted(root.rglob("*.mo")) if root.is_dir() else []
    return [path for path in found if path.is_file()]  # a pipe or a device may have no end


def _own_files() -> list[Path]:
    """What turns Modelica into an FMU; a change there makes another FMU."""
    folders = (_PACKAGE / "modelica", _PACKAGE / "fmu")
    return sorted(
        path for folder in folders for path in folder.rglob("*") if path.suffix in (".py", ".c", ".h", ".json")
    )
