"""From an ONNX file to an FMU in one call."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from hystid.errors import NetworkError
from hystid.fmu.about import About
from hystid.fmu.arrays import with_arrays
from hystid.fmu.build import BuildResult, Version, build
from hystid.fmu.door import read_entry
from hystid.fmu.platforms import chosen
from hystid.limits import compiled
from hystid.surrogate import model_code
from hystid.surrogate.restoring_force import NETWORK


def build_network(
    network: Path,
    out: Path,
    *,
    fmi: Version = 2,
    platforms: str | Iterable[str] = "host",
    about: About | None = None,
    arrays: bool = False,
) -> BuildResult:
    """Compile an ONNX network to plain C and write its FMU.

    An identified restoring force becomes the block x, v -> R; any other network keeps its own inputs and outputs, one
    variable per element, and a pair ``name`` / ``name_next`` of the same shape becomes memory. arrays: inputs and
    outputs of several elements are one array variable each, in FMI 3.0.
    Raises NetworkError (no such file, damaged, an operator that cannot be compiled), ToolchainError; then nothing is
    written.
    """
    names = [platforms] if isinstance(platforms, str) else list(platforms)

    def make() -> BuildResult:
        code = model_code(Path(network))
        return build(with_arrays(code) if arrays else code, Path(out), fmi=fmi, platforms=names, about=about)

    return compiled(str(network), make, NetworkError, len(chosen(names)))


def network_of(fmu: Path, folder: Path) -> Path | None:
    """The network that an FMU was made from, written into a folder; None where it carries none. Raises FmuError."""
    content = read_entry(fmu, f"resources/{NETWORK}")
    if content is None:
        return None
    (folder / NETWORK).write_bytes(content)
    return folder / NETWORK
