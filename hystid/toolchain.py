"""C compiler: find one, compile to a shared library, remember the result by content.

``cc`` (or ``$CC``) where there is one, else the ``ziglang`` package (extra ``cross``). A library is cached under the
user's cache folder by a hash of sources, headers and flags, so that compiling the same text again costs a look-up.
"""

from __future__ import annotations

import hashlib
import os
import shlex
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from importlib.util import find_spec
from pathlib import Path

import platformdirs

from hystid.errors import ToolchainError

_COMMON = ("-std=c11", "-fPIC", "-fvisibility=hidden")
_SUFFIX = {"win32": ".dll", "darwin": ".dylib"}.get(sys.platform, ".so")


def cache_folder() -> Path:
    """Folder of compiled libraries; ``HYSTID_CACHE`` overrides the platform's default."""
    chosen = os.environ.get("HYSTID_CACHE")
    folder = Path(chosen) if chosen else Path(platformdirs.user_cache_dir("hystid"))
    folder.mkdir(parents=True, exist_ok=True)
    return folder


@cache
def compiler() -> tuple[str, ...]:
    """Command of the C compiler on this machine.

    Raises ToolchainError where there is neither ``$CC``, ``cc``, ``gcc``, ``clang`` nor the ``ziglang`` package.
    """
    if os.environ.get("CC"):
        return tuple(shlex.split(os.environ["CC"]))
    for name in ("cc", "gcc", "clang"):
        if shutil.which(name):
            return (name,)
    if find_spec("ziglang"):
        return (sys.executable, "-m", "ziglang", "cc")
    raise ToolchainError(
        "no C compiler found: install gcc or clang, or 'pip install hystid[cross]' for one that comes by pip"
    )


def has_compiler() -> bool:
    """Whether generated code can be compiled on this machine."""
    try:
        compiler()
    except ToolchainError:
        return False
    return True


def shared_library(
    sources: Mapping[str, str],
    *,
    main: Sequence[str],
    flags: Sequence[str] = ("-O2",),
    libraries: Sequence[str] = ("-lm",),
    command: Sequence[str] | None = None,
    suffix: str = _SUFFIX,
    objects: Sequence[Path] = (),
) -> Path:
    """Compile C text to a shared library and return its path in the cache.

    sources: file name -> text, headers included. main: names of the ``.c`` files to compile.
    flags are added to ``-std=c11 -fPIC -shared -fvisibility=hidden``. command: another compiler than this machine's,
    whose libraries end in suffix. objects: further parts, from ``object_files`` with the same flags and command.
    Raises ToolchainError with the compiler's first error line.
    """
    command = [*(command or compiler()), *_COMMON, "-shared", *flags]
    parts = (*libraries, *main, *(path.name for path in objects), *_texts(sources))
    digest = _digest((*command, *parts))
    if "-march=native" in flags:  # a cache folder on a network drive may serve machines of several kinds
        digest.update(_processor().encode())
    library = cache_folder() / f"{digest.hexdigest()[:32]}{suffix}"
    if library.exists():
        return library
    with tempfile.TemporaryDirectory(dir=cache_folder()) as folder:
        _write(Path(folder), sources)
        made = Path(folder, "library" + suffix)
        _compile([*command, *main, *map(str, objects), "-o", made.name, *libraries], Path(folder))
        made.replace(library)  # atomic: another process sees the whole library or none
    return library


def object_files(
    sources: Mapping[str, str],
    *,
    main: Sequence[str],
    flags: Sequence[str] = ("-O2",),
    command: Sequence[str] | None = None,
) -> tuple[Path, ...]:
    """Compile C files that many libraries share, once; return their object files in the cache, in the order of main.

    Arguments as for ``shared_library``. Raises ToolchainError with the compiler's first error line.
    """
    full = [*(command or compiler()), *_COMMON, "-c", *flags]
    headers = {name: text for name, text in sources.items() if name not in main}
    common = (*full, *_texts(headers))
    objects = {name: cache_folder() / f"{_digest((*common, name, sources[name])).hexdigest()[:32]}.o" for name in main}
    missing = [name for name, path in objects.items() if not path.exists()]
    if missing:
        with tempfile.TemporaryDirectory(dir=cache_folder()) as folder:
            _write(Path(folder), sources)

            def compile_one(name: str) -> None:
                _compile([*full, name, "-o", f"{name}.o"], Path(folder))
                Path(folder, f"{name}.o").replace(objects[name])

            with ThreadPoolExecutor(os.cpu_count()) as pool:
                for _ in pool.map(compile_one, missing):
                    pass
    return tuple(objects.values())


def _texts(sources: Mapping[str, str]) -> Iterator[str]:
    for name, text in sorted(sources.items()):
        yield from (name, text)


def _digest(parts: Iterable[str]) -> hashlib._Hash:
    digest = hashlib.sha256()
    for part in parts:
        digest.update(part.encode())
        digest.update(b"\0")
    return digest


def _write(folder: Path, sources: Mapping[str, str]) -> None:
    for name, text in sources.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")


def _compile(command: Sequence[str], folder: Path) -> None:
    run = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    if run.returncode:
        first = next((line for line in run.stderr.splitlines() if "error" in line), run.stderr.strip()[:200])
        raise ToolchainError(f"the C compiler '{command[0]}' refused generated code: {first}")


@cache
def _processor() -> str:
    try:
        text = Path("/proc/cpuinfo").read_text()
    except OSError:
        return ""
    return next((line for line in text.splitlines() if line.startswith("flags")), "")
