"""The user's cache: what was made once is found again under a name, and checked before it is used.

The content of an entry lies in a file that is named by its SHA-256; a small file, ``<name>.key``, holds that name. Both
are written by one rename each, so that an entry is whole or not there, whoever else is writing. A content that does not
fit its name (a full disk, a broken one) is never used: the entry counts as missing and is made anew.

The folder belongs to the user alone. Where somebody else could write into it, what lies there is not touched, and this
process gets a folder of its own, which goes with it.
"""

from __future__ import annotations

import atexit
import hashlib
import logging
import os
import re
import shutil
import stat
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from io import BufferedReader
from pathlib import Path

import platformdirs

from hystid.errors import ToolchainError, UsageError, printable, reason
from hystid.files import mark, on_disk_of, write_text

_log = logging.getLogger("hystid")
_LAYOUT = "2"  # of the folder: one that an older version filled is left alone
_CONTENT = re.compile(r"[0-9a-f]{64}(\.\w{1,8})?")
_OLDER = re.compile(r"(effect_)?[0-9a-f]{32}\.(so|dylib|dll|o|fmu|json|pickle)")  # layout 1
_KEY = re.compile(r"\w*[0-9a-f]{32}\.\w{1,8}\.key")
_BESIDE = re.compile(r"\.hystid-[0-9a-f]{8}-\d+-.*", re.DOTALL)  # see ``files.mark``
_OTHERS = stat.S_IWGRP | stat.S_IWOTH
_MOST_BYTES = 1 << 30  # bytes: FMUs and libraries are far smaller, and a larger file takes long to read


@dataclass(frozen=True)
class Contents:
    """What a cache holds. damaged: names of entries whose content does not fit its hash, where that was looked at."""

    folder: Path
    entries: int
    size: int
    damaged: tuple[str, ...]


def folder() -> Path:
    """The folder of the cache: ``HYSTID_CACHE``, or the platform's place, or a private one where that is not safe."""
    place = _chosen()
    fault = _fault(place)
    return _private(place, fault) if fault else place


def _chosen() -> Path:
    chosen = os.environ.get("HYSTID_CACHE")
    return Path(chosen) if chosen else Path(platformdirs.user_cache_dir("hystid")) / _LAYOUT


def _usable() -> Path:
    """The folder that was chosen. Raises UsageError where it is not used."""
    place = _chosen()
    if fault := _fault(place):
        raise UsageError(
            f"the cache {place} is not used: {fault}; set HYSTID_CACHE to a folder that is yours alone, and writable"
        )
    return place


def _fault(place: Path) -> str:
    """Why a folder cannot serve, "" where it can. It is made where there is none."""
    try:
        place.mkdir(mode=0o700, parents=True, exist_ok=True)
        found = place.stat()
        if hasattr(os, "getuid"):
            if found.st_uid != os.getuid():
                return "it belongs to another user"
            if found.st_mode & _OTHERS:
                return "other users can write into it"
            if stat.S_IMODE(found.st_mode) & 0o077 and not any(place.iterdir()):
                place.chmod(0o700)
    except OSError as error:
        return reason(error)
    if not os.access(place, os.W_OK | os.X_OK):
        return "it cannot be written"
    return "" if os.access(place, os.R_OK) else "it cannot be read"


@cache
def _private(place: Path, fault: str) -> Path:
    try:
        made = Path(tempfile.mkdtemp(prefix="hystid-cache-"))  # 0700
    except OSError as error:
        raise ToolchainError(
            f"there is no place for compiled models: the cache {place} cannot be used ({fault}), and neither can a "
            f"temporary folder ({reason(error)}); set HYSTID_CACHE to a folder of your own"
        ) from None
    owner = os.getpid()
    atexit.register(lambda: shutil.rmtree(made, ignore_errors=True) if os.getpid() == owner else None)
    _log.warning(
        "the cache %s is not used: %s; compiled models are kept until the end of this run only. "
        "Set HYSTID_CACHE to a folder that is yours alone",
        place,
        fault,
    )
    return made


def find(name: str) -> Path | None:
    """The content that was kept under a name, checked; None where there is none or where it is damaged."""
    place = folder()
    content = _content(place, name)
    if content is None:
        return None
    if _is_whole(content):
        return content
    _log.warning("%s in the cache %s is damaged and is made anew", name, place)
    return None


def kept(name: str) -> Path:
    """``find`` for what was just kept. Raises ToolchainError where it cannot be read back."""
    found = find(name)
    if found is None:
        raise ToolchainError(f"{name} was just written to the cache {folder()} and cannot be read back")
    return found


@contextmanager
def keep(name: str) -> Iterator[Path]:
    """Yield a path to write the content to; it is kept under the name when the block ends without an error.

    ``find`` has it then. Nothing is kept after an error.
    """
    place, suffix = folder(), Path(name).suffix
    made = place / f"{mark()}{os.urandom(8).hex()}{suffix}"
    try:
        with on_disk_of(place):
            yield made
            content = place / f"{_digest(made)}{suffix}"
            _without_folder(content)
            made.replace(content)
        _without_folder(_key(place, name))
        write_text(_key(place, name), content.name)
    finally:
        made.unlink(missing_ok=True)


def keep_bytes(name: str, content: bytes) -> None:
    """``keep`` for what is at hand."""
    with keep(name) as beside:
        beside.write_bytes(content)


def holds(content: bytes, suffix: str) -> bool:
    """Whether exactly this content, a file of this suffix, was kept here by the user before."""
    return (folder() / f"{hashlib.sha256(content).hexdigest()}{suffix}").is_file()


def contents(*, verify: bool = True) -> Contents:
    """Count and measure all entries; verify: check them too, which reads them all. Raises UsageError, see ``clear``."""
    place = _usable()
    own = [path for path in place.iterdir() if _is_own(path)]
    names = sorted(path.stem for path in own if path.suffix == ".key")
    damaged = tuple(name for name in names if not _is_whole(_content(place, name))) if verify else ()
    return Contents(place, len(names), sum(map(_size, own)), damaged)


def clear() -> tuple[Path, int]:
    """Remove all entries, those of older versions too; return the folder, and how many bytes that frees.

    Other files stay, hidden ones too: the folder may serve for more. Raises UsageError where the folder is not used, or
    where entries cannot be removed.
    """
    place, freed, kept = _usable(), 0, []
    older = place.parent.iterdir() if place == Path(platformdirs.user_cache_dir("hystid")) / _LAYOUT else ()
    own = [*(path for path in place.iterdir() if _is_own(path)), *(p for p in older if _OLDER.fullmatch(p.name))]
    for path in own:
        size = _size(path)
        try:
            if path.is_dir() and not path.is_symlink():
                shutil.rmtree(path)
            else:
                path.unlink(missing_ok=True)
            freed += size
        except OSError as error:
            kept.append(f"{printable(path.name)} ({reason(error)})")
    if kept:
        raise UsageError(
            f"the cache {place}: {len(kept)} of {len(own)} entries cannot be removed, the first is {kept[0]}"
        )
    return place, freed


def _size(path: Path) -> int:
    """Bytes of an entry itself, 0 where it is gone meanwhile."""
    try:
        found = path.lstat()
    except OSError:
        return 0
    return found.st_size if stat.S_ISREG(found.st_mode) else 0


@contextmanager
def workplace() -> Iterator[Path]:
    """A folder beside the entries, to make one in; gone afterwards."""
    with tempfile.TemporaryDirectory(dir=folder(), prefix=mark()) as made:
        yield Path(made)


def _is_own(path: Path) -> bool:
    """Whether an entry is of this cache, by its name; of other files that end in ``.key`` what they hold decides."""
    name = path.name
    if any(known.fullmatch(name) for known in (_CONTENT, _OLDER, _KEY, _BESIDE)):
        return True
    return path.suffix == ".key" and _content(path.parent, path.stem) is not None


def _without_folder(path: Path) -> None:
    """A folder is no entry, and no file can be renamed to its place."""
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path, ignore_errors=True)


def _key(place: Path, name: str) -> Path:
    return place / f"{name}.key"


def _content(place: Path, name: str) -> Path | None:
    try:
        with _opened(_key(place, name)) as file:
            text = file.read(100).decode("ascii", errors="replace")
    except OSError:
        return None
    return place / text if _CONTENT.fullmatch(text) else None


def _is_whole(content: Path | None) -> bool:
    if content is None or _size(content) > _MOST_BYTES:
        return False
    try:
        return _digest(content) == content.stem
    except OSError:
        return False


def _opened(path: Path) -> BufferedReader:
    """A file itself: a link may lead to what others can change, and a pipe has no end. Raises OSError."""
    flags = [getattr(os, name, 0) for name in ("O_NOFOLLOW", "O_NONBLOCK", "O_BINARY")]
    file: BufferedReader = os.fdopen(os.open(path, os.O_RDONLY | sum(flags)), "rb")
    if not stat.S_ISREG(os.fstat(file.fileno()).st_mode):
        file.close()
        raise OSError(f"{path} is no file")
    return file


def _digest(path: Path) -> str:
    with _opened(path) as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
