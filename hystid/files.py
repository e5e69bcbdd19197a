"""Writing results: beside first, then renamed, so that a reader sees the whole file or none.

A file whose name comes from data (of a recording, a group, a model) is placed by ``inside``, which keeps it in its
folder.
"""

from __future__ import annotations

import errno
import hashlib
import json
import math
import os
import platform
import re
import shutil
import stat
import tempfile
import unicodedata
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import Any

from hystid.errors import HystidError, UsageError

_LONGEST_NAME = 120  # bytes of a name from data: with what is put around it, below the 255 that file systems take
_NOT_PLAIN = re.compile(r"[^\w+=,.@ ()-]")
_RESERVED = re.compile(r"(con|prn|aux|nul|com\d|lpt\d)(\..*)?", re.IGNORECASE)  # devices on Windows


def safe_name(text: str) -> str:
    """A name from data as part of a file name: no separator, no control character, nothing hidden, not too long.

    Names that are harmless stay as they are. Others get a hash of the text behind them, so that two of them never
    become one.
    """
    plain = _NOT_PLAIN.sub("_", unicodedata.normalize("NFC", text)).strip(" .")
    if _RESERVED.fullmatch(plain):
        plain = f"_{plain}"
    plain = plain.encode()[:_LONGEST_NAME].decode(errors="ignore")
    if plain and plain == text:
        return plain
    return f"{plain or 'unnamed'}-{hashlib.sha256(text.encode(errors='surrogatepass')).hexdigest()[:8]}"


def inside(folder: Path, name: str) -> Path:
    """The path of a file in a folder. Raises UsageError where the name would lead out of it."""
    path = Path(folder) / name
    if name in ("", ".", "..") or path.name != name or path.parent != Path(folder):
        raise UsageError(f"{folder}: the file '{name}' would lie outside this folder and is not written")
    return path


@contextmanager
def on_disk_of(path: Path) -> Iterator[None]:
    """Errors of a full disk name what was written: the system names the other file of a copy, or none."""
    try:
        yield
    except OSError as error:
        if error.errno in (errno.ENOSPC, errno.EDQUOT):
            raise OSError(error.errno, "the disk is full", str(path)) from None
        raise


@contextmanager
def atomic(path: Path) -> Iterator[Path]:
    """Yield a temporary path in the same folder; it replaces ``path`` when the block ends without an error."""
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    _sweep(path.parent)
    handle, name = tempfile.mkstemp(dir=path.parent, prefix=mark(), suffix=path.suffix)
    os.close(handle)
    beside = Path(name)
    try:
        with on_disk_of(path):
            yield beside
            beside.chmod(0o644)
            beside.replace(path)
    finally:
        beside.unlink(missing_ok=True)


@contextmanager
def scratch() -> Iterator[Path]:
    """A folder for a while, in the system's place for such; see ``scratch_folder``."""
    folder = scratch_folder()
    try:
        yield folder
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def scratch_folder() -> Path:
    """A new folder in the system's place for temporary ones, to be removed by the caller.

    What processes leave there that are killed is removed by the next one that asks.
    """
    place = Path(tempfile.gettempdir())
    _sweep(place)
    return Path(tempfile.mkdtemp(prefix=mark(), dir=place))


def check_regular(path: Path, error: type[HystidError]) -> None:
    """Raise the error where a path is not that of a file with an end: missing, a folder, a pipe, a device."""
    try:
        kind = Path(path).stat().st_mode
    except FileNotFoundError:
        raise error(f"{path}: there is no such file") from None
    except (OSError, ValueError) as problem:
        raise error(f"{path}: it cannot be opened ({getattr(problem, 'strerror', None) or problem})") from None
    if stat.S_ISDIR(kind):
        raise error(f"{path}: this is a folder; name a file in it")
    if not stat.S_ISREG(kind):
        raise error(f"{path}: this is a pipe or a device, which may have no end; copy its content to a file")


def content_of(path: Path, error: type[HystidError]) -> bytes:
    """Bytes of a file that a user named. Raises the error where there is no such file, and see above.

    A file without a length is empty, whatever comes when it is read: those of /proc may have no end.
    """
    check_regular(path, error)
    size = Path(path).stat().st_size
    try:
        return Path(path).read_bytes() if size else b""
    except MemoryError:
        raise error(f"{path}: it has {size >> 20} MB, for which there is not enough memory") from None
    except OSError as problem:
        raise error(f"{path}: it cannot be read ({problem.strerror}); check its permissions and the disk") from None


def file_named(given: object, what: str) -> Path:
    """The path that a user gave for something. Raises UsageError for what is none."""
    if not isinstance(given, str | os.PathLike):
        raise UsageError(f"{what} is a file, and this is of type {type(given).__name__}: give its path")
    return Path(given)


def text_of(path: Path, error: type[HystidError]) -> str:
    """``content_of`` as text. Raises the error where it is not UTF-8, and see above."""
    try:
        return content_of(path, error).decode("utf-8-sig").replace("\r\n", "\n").replace("\r", "\n")
    except UnicodeDecodeError as problem:
        raise error(f"{path}: cannot be read as UTF-8 text ({problem})") from None


def json_of(path: Path, error: type[HystidError]) -> Any:
    """Content of a JSON file that a user named. Raises the error where it is none, or names something twice."""

    def named(pairs: Sequence[tuple[str, Any]]) -> dict[str, Any]:
        if len(found := dict(pairs)) < len(pairs):
            twice = Counter(name for name, _ in pairs).most_common(1)[0][0]
            raise ValueError(f"'{twice}' stands there twice")
        return found

    try:
        return json.loads(text_of(path, error), object_pairs_hook=named)
    except (ValueError, RecursionError) as problem:
        raise error(f"{path}: this is not JSON ({problem})") from None


def _mark(process: int) -> str:
    """Who writes: other machines may share the folder, and know nothing of our processes."""
    return f"hystid-{hashlib.sha256(platform.node().encode()).hexdigest()[:8]}-{process}-"


def mark(kind: str = "") -> str:
    """Front of a name for what goes with this process; what a killed one leaves is known by it, see ``left``."""
    return f".{kind}{_mark(os.getpid())}"


def left(folder: Path, kind: str = "") -> list[Path]:
    """Files and folders so marked that processes of this machine left which were killed."""
    own = f".{kind}{_mark(0).removesuffix('0-')}"
    named = ((path, path.name.removeprefix(own).partition("-")[0]) for path in folder.glob(f"{own}*"))
    return [path for path, process in named if process.isdigit() and not _runs(int(process))]


@cache
def _sweep(folder: Path) -> None:
    """Remove what processes of this machine that were killed left half written in a folder; once per process."""
    for path in left(folder):
        if path.is_dir() and not path.is_symlink():
            shutil.rmtree(path, ignore_errors=True)
        else:
            path.unlink(missing_ok=True)


def _runs(process: int) -> bool:
    if os.name == "nt":  # where signal 0 would end it
        return True
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except (OSError, OverflowError):
        pass
    return True


def write_text(path: Path, text: str) -> None:
    """Write text (UTF-8) atomically."""
    with atomic(path) as beside:
        beside.write_text(text, encoding="utf-8")


def write_json(path: Path, value: Any) -> None:
    """Write JSON atomically. Arrays become lists, NaN and infinities become null (JSON has neither)."""
    write_text(path, json.dumps(plain(value), indent=1, ensure_ascii=False, allow_nan=False) + "\n")


def plain(value: Any) -> Any:
    """Copy with NumPy types, tuples and non-finite numbers turned into what JSON can hold."""
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if hasattr(value, "tolist"):  # NumPy arrays and numbers, without importing NumPy for it
        return plain(value.tolist())
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, Path):
        return str(value)
    if isinstance(value, Sequence) and not isinstance(value, str | bytes):
        return [plain(item) for item in value]
    return value
