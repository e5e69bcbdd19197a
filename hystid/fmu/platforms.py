"""Where an FMU's binaries go and how they are compiled: for this machine by its compiler, for others by ziglang."""

from __future__ import annotations

import platform
import struct
import sys
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from importlib.util import find_spec
from pathlib import Path
from typing import Literal

from hystid.errors import ToolchainError, UsageError
from hystid.toolchain import object_files, shared_library


@dataclass(frozen=True)
class Platform:
    """One target. tuple: FMI 3's name; folder: FMI 2's; zig: target of ``zig cc``, for glibc 2.17 (2012) and newer.

    own: compiled by this machine's compiler, for its C library or newer ones, instead of zig's.
    """

    tuple: str
    folder: str
    zig: str
    suffix: str
    own: bool = False


PLATFORMS = {
    p.tuple: p
    for p in (
        Platform("x86_64-linux", "linux64", "x86_64-linux-gnu.2.17", ".so"),
        Platform("aarch64-linux", "aarch64-linux", "aarch64-linux-gnu.2.17", ".so"),
        Platform("x86_64-windows", "win64", "x86_64-windows-gnu", ".dll"),
        Platform("x86_64-darwin", "darwin64", "x86_64-macos", ".dylib"),
        Platform("aarch64-darwin", "darwin64", "aarch64-macos", ".dylib"),
    )
}
_MACHINES = {"amd64": "x86_64", "arm64": "aarch64"}


def host() -> str:
    """Name of this machine's platform, such as "x86_64-linux"."""
    machine = platform.machine().lower()
    system = {"win32": "windows", "darwin": "darwin"}.get(sys.platform, "linux")
    return f"{_MACHINES.get(machine, machine)}-{system}"


def chosen(platforms: str | Iterable[str]) -> tuple[Platform, ...]:
    """ "host", "all" or names of platforms. Raises UsageError for a name that is none.

    "host" is this machine, by its own compiler; a platform that is named is built by zig, for old C libraries, too.
    """
    names = [platforms] if isinstance(platforms, str) else list(platforms)
    names = [*PLATFORMS] if names == ["all"] else names
    found: dict[str, Platform] = {}
    for name in names:
        platform = PLATFORMS.get(host() if name == "host" else name)
        if platform is None:
            raise UsageError(
                f"'{name}' is not a platform that can be built for; choose host, all, {', '.join(PLATFORMS)}"
            )
        found.setdefault(platform.tuple, replace(platform, own=name == "host"))
    return tuple(found.values())


def compile_for(target: Platform, shell: Mapping[str, str], model: Mapping[str, str], flags: Sequence[str]) -> Path:
    """Library for one platform, from the cache where it was built before. Raises ToolchainError.

    shell: file name -> text of what all FMUs share, headers included; compiled once. model: the model's own files.
    """
    command: tuple[str, ...] | None = None
    strip = () if target.suffix == ".dylib" else ("-s",)
    libraries: tuple[str, ...] = ("-lm",)
    if not target.own:
        if not find_spec("ziglang"):
            raise ToolchainError(
                f"building for {target.tuple} by name needs a compiler for all platforms: pip install hystid[cross]"
            )
        command = (sys.executable, "-m", "ziglang", "cc", "-target", target.zig)
        libraries = ("-lm",) if target.suffix == ".so" else ()
    if target.suffix == ".dll":  # half of a Windows library is the compiler's run-time: for size, it shrinks by a third
        flags = tuple("-Os" if flag == "-O2" else flag for flag in flags)
    headers = {name: text for name, text in shell.items() if name.endswith(".h")}
    objects = object_files(shell, main=[name for name in shell if name.endswith(".c")], flags=flags, command=command)
    return shared_library(
        {**headers, **model},
        main=[name for name in model if name.endswith(".c")],
        flags=(*flags, *strip),
        libraries=libraries,
        command=command,
        suffix=target.suffix,
        objects=objects,
    )


def binaries(built: Mapping[str, Path], identifier: str, version: Literal[2, 3]) -> dict[str, bytes]:
    """Path inside the FMU -> content. FMI 2 has one folder for both Macs: their libraries become one universal file."""
    found: dict[str, list[Path]] = {}
    for name, library in built.items():
        target = PLATFORMS[name]
        folder = target.tuple if version == 3 else target.folder
        found.setdefault(f"binaries/{folder}/{identifier}{target.suffix}", []).append(library)
    return {path: _one_file([library.read_bytes() for library in parts]) for path, parts in found.items()}


def _one_file(libraries: Sequence[bytes]) -> bytes:
    return libraries[0] if len(libraries) == 1 else universal(libraries)


def universal(libraries: Sequence[bytes]) -> bytes:
    """Mach-O libraries of several processors in one file (Apple's ``mach-o/fat.h``: big-endian, pages of 16 kB)."""
    page = 1 << 14
    header = struct.pack(">II", 0xCAFEBABE, len(libraries))
    body, offset = b"", page
    for library in libraries:
        cpu_type, cpu_subtype = struct.unpack_from("<ii", library, 4)
        header += struct.pack(">iiIII", cpu_type, cpu_subtype, offset, len(library), 14)
        padded = library + bytes(-len(library) % page)
        body += padded
        offset += len(padded)
    return header + bytes(page - len(header)) + body
