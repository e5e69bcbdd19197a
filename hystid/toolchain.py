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
from collections.abc import Mapping, Sequence
from functools import cache
from importlib.util import find_spec
from pathlib import Path

import platformdirs

from hystid.errors import ToolchainError

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
) -> Path:
    """Compile C text to a shared library and return its path in the cache.

    sources: file name -> text, headers included. main: names of the ``.c`` files to compile.
    flags are added to ``-std=c11 -fPIC -shared -fvisibility=hidden``. command: another compiler than this machine's,
    whose libraries end in suffix.
    Raises ToolchainError with the compiler's first error line.
    """
    command = [*(command or compiler()), "-std=c11", "-fPIC", "-shared", "-fvisibility=hidden", *flags]
    digest = hashlib.sha256()
    for part in (*command, *libraries, *main, *(text for item in sorted(sources.items()) for text in item)):
        digest.update(part.encode())
        digest.update(b"\0")
    if "-march=native" in flags:  # a cache folder on a network drive may serve machines of several kinds
        digest.update(_processor().encode())
    library = cache_folder() / f"{digest.hexdigest()[:32]}{suffix}"
    if library.exists():
        return library
    with tempfile.TemporaryDirectory(dir=cache_folder()) as folder:
        for name, text in sources.items():
            path = Path(folder, name)
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(text)
        made = Path(folder, "library" + suffix)
        run = subprocess.run(
            [*command, *main, "-o", made.name, *libraries],
            cwd=folder,
            capture_output=True,
            text=True,
            check=False,
        )
        if run.returncode:
            first = next((line for line in run.stderr.splitlines() if "error" in line), run.stderr.strip()[:200])
            raise ToolchainError(f"the C compiler '{command[0]}' refused generated code: {first}")
        made.replace(library)  # atomic: another process sees the whole library or none
    return library


@cache
def _processor() -> str:
    try:
        text = Path("/proc/cpuinfo").read_text()
    except OSError:
        return ""
    return next((line for line in text.splitlines() if line.startswith("flags")), "")
