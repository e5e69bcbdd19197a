"""``build``: a Modelica model or an ONNX network becomes an FMU."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Literal

from hystid.errors import UsageError
from hystid.files import scratch
from hystid.fmu import About, BuildResult, build_model, build_network
from hystid.fmu.rebuilt import has_reference, with_reference_of
from hystid.outputs import check_file


def build(
    model: str | Path,
    out: str | Path,
    *,
    fmi: Literal[2, 3] = 2,
    parameters: Mapping[str, float] | None = None,
    platforms: str | Iterable[str] = "host",
    libraries: Sequence[str | Path] = (),
    about: About | None = None,
) -> BuildResult:
    """Compile a Modelica model, or an ONNX network, to an FMU for Model Exchange and Co-Simulation.

    model: a class of the library ("HystId.Oscillators.Jenkins"), a class of a file ("rig.mo:Rig"; "rig.mo" where it
    holds one model), or "net.onnx". out: the FMU to write; it replaces an older one only when it is complete. fmi: 2
    or 3. parameters: name -> start value in SI units, for Modelica models. platforms: "host", "all", or names such as
    "aarch64-linux". libraries: further .mo files, package folders, or folders that hold packages, as those that
    MODELICAPATH names.
    The FMU carries its C sources and the result of its default experiment, which ``regress`` replays. Where it replaces
    an FMU, that one's result stays the reference, and ``changes`` of the answer says what is different. about: author,
    version, licence and copyright of the model, for the FMU's description.
    Raises UsageError, ModelicaError, NetworkError, ToolchainError; then nothing is written.

    >>> import hystid
    >>> made = hystid.build("HystId.Oscillators.Jenkins", "jenkins.fmu", parameters={"Ks": 5e4, "fc": 40.0})
    >>> made.path.name, made.fmi
    ('jenkins.fmu', 2)
    """

    def made_at(path: Path) -> BuildResult:
        return build_afresh(
            model, path, fmi=fmi, parameters=parameters, platforms=platforms, libraries=libraries, about=about
        )

    check_file(Path(out), ".fmu")
    return _in_place_of(Path(out), made_at)


def build_arrays(
    network: Path, out: Path, *, platforms: str = "host", about: About | None = None, new_reference: bool = False
) -> BuildResult:
    """``build`` of a network for FMI 3.0 whose inputs and outputs of several elements are arrays."""

    def made_at(path: Path) -> BuildResult:
        return build_network(network, path, fmi=3, platforms=platforms, about=about, arrays=True)

    return made_at(out) if new_reference else _in_place_of(out, made_at)


def _in_place_of(out: Path, made_at: Callable[[Path], BuildResult]) -> BuildResult:
    """Build an FMU that keeps the reference of the one that it replaces."""
    if not has_reference(out):
        return made_at(out)
    with scratch() as folder:
        made = made_at(folder / out.name)
        changes = with_reference_of(out, made.path, out)
    return replace(made, path=out, size=out.stat().st_size, changes=changes)


def build_afresh(
    model: str | Path,
    out: Path,
    *,
    fmi: Literal[2, 3] = 2,
    parameters: Mapping[str, float] | None = None,
    platforms: str | Iterable[str] = "host",
    libraries: Sequence[str | Path] = (),
    about: About | None = None,
) -> BuildResult:
    """``build`` that takes today's result as reference, whatever was there before. Raises as that does."""
    if str(model).lower().endswith(".onnx"):
        if parameters:
            raise UsageError(f"{model}: a network has no parameters to set; leave them out")
        if libraries:
            raise UsageError(f"{model}: a network uses no Modelica packages; name no libraries")
        return build_network(Path(model), out, fmi=fmi, platforms=platforms, about=about)
    return build_model(
        str(model),
        out,
        fmi=fmi,
        parameters=parameters,
        platforms=platforms,
        libraries=[Path(library) for library in libraries],
        about=about,
    )
