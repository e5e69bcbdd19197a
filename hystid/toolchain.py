"""C compiler: find one, compile to a shared library, remember the result by content.

``cc`` (or ``$CC``) where there is one, else the ``ziglang`` package (extra ``cross``). A library lies in the user's
cache under a hash of sources, headers and flags, so that compiling the same text again costs a look-up.
"""

from __future__ import annotations

import contextvars
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

from hystid import cache as store
from hystid.errors import ToolchainError, reason
from hystid.limits import compiled, counted, wait_until_over

_COMMON = ("-std=c11", "-fPIC", "-fvisibility=hidden")
_LINE = 300  # characters of the compiler's words in a message
_PRINTED = 1 << 20  # bytes of them that are looked at
_SUFFIX = {"win32": ".dll", "darwin": ".dylib"}.get(sys.platform, ".so")


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
    parts = (*libraries, *main, *(path.name for path in objects), *texts_of(sources))
    digest = digest_of((*command, *parts))
    if "-march=native" in flags:  # a cache folder on a network drive may serve machines of several kinds
        digest.update(_processor().encode())
    name = f"{digest.hexdigest()[:32]}{suffix}"
    library = store.find(name)
    if library is not None:
        return library
    with store.workplace() as folder, store.keep(name) as beside:
        _write(folder, sources)
        made = folder / f"library{suffix}"
        _compile([*command, *main, *map(str, objects), "-o", made.name, *libraries], folder)
        made.replace(beside)
    return store.kept(name)


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
    common = (*full, *texts_of(headers))
    objects = {name: f"{digest_of((*common, name, sources[name])).hexdigest()[:32]}.o" for name in main}
    missing = [name for name, entry in objects.items() if store.find(entry) is None]
    if missing:
        with store.workplace() as folder:
            _write(folder, sources)

            def compile_one(name: str) -> None:
                with store.keep(objects[name]) as beside:
                    _compile([*full, name, "-o", f"{name}.o"], folder)
                    (folder / f"{name}.o").replace(beside)

            with ThreadPoolExecutor(os.cpu_count()) as pool:  # each thread in the compilation that this is part of
                for work in [pool.submit(contextvars.copy_context().run, compile_one, name) for name in missing]:
                    work.result()
    return tuple(map(store.kept, objects.values()))


def texts_of(sources: Mapping[str, str]) -> Iterator[str]:
    """Names and texts of files, by name."""
    for name, text in sorted(sources.items()):
        yield from (name, text)


def digest_of(parts: Iterable[str]) -> hashlib._Hash:
    """Hash of texts and of where each of them ends."""
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
    code, printed = compiled(f"the C compiler '{command[0]}'", lambda: _run(command, folder), ToolchainError)
    if code:
        lines = printed.decode(errors="replace").splitlines() or [f"it ended with code {code}"]
        if any("No space left on device" in line for line in lines):
            temporary = os.environ.get("TMPDIR") or tempfile.gettempdir()
            raise ToolchainError(f"the disk of the cache {store.folder()} or of {temporary} (temporary files) is full")
        first = next((line for line in lines if "error" in line), lines[0])[:_LINE]
        raise ToolchainError(
            f"the C compiler '{command[0]}' failed on generated code (cache {store.folder()}): {first}"
        )


def _run(command: Sequence[str], folder: Path) -> tuple[int, bytes]:
    """Exit code of a command, and the first of what it printed."""
    try:
        process = subprocess.Popen(
            command, cwd=folder, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE,
            start_new_session=True,
        )  # fmt: skip
    except OSError as error:
        raise ToolchainError(
            f"the C compiler '{command[0]}' cannot be run ({reason(error)}): set CC to "
            "one that can, or install gcc or clang"
        ) from None
    assert process.stderr is not None
    with process.stderr as words, counted(process):
        printed = words.read(_PRINTED)
        while words.read(_PRINTED):  # a compiler that cannot write waits
            pass
        wait_until_over(process)
    return process.returncode, printed


@cache
def _processor() -> str:
    try:
        text = Path("/proc/cpuinfo").read_text()
    except OSError:
        return ""
    return next((line for line in text.splitlines() if line.startswith("flags")), "")
