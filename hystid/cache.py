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
from pathlib import Path

import platformdirs

from hystid.errors import ToolchainError
from hystid.files import mark, on_disk_of, write_text

_log = logging.getLogger("hystid")
_LAYOUT = "2"  # of the folder: one that an older version filled is left alone
_CONTENT = re.compile(r"[0-9a-f]{64}(\.\w{1,8})?")
_OLDER = re.compile(r"(effect_)?[0-9a-f]{32}\.(so|dylib|dll|o|fmu|json|pickle)")  # layout 1
_OTHERS = stat.S_IWGRP | stat.S_IWOTH


@dataclass(frozen=True)
class Contents:
    """What a cache holds. damaged: names of entries whose content does not fit its hash."""

    folder: Path
    entries: int
    size: int
    damaged: tuple[str, ...]


def folder() -> Path:
    """The folder of the cache: ``HYSTID_CACHE``, or the platform's place, or a private one where that is not safe."""
    chosen = os.environ.get("HYSTID_CACHE")
    place = Path(chosen) if chosen else Path(platformdirs.user_cache_dir("hystid")) / _LAYOUT
    fault = _fault(place)
    return _private(place, fault) if fault else place


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
        return (error.strerror or str(error)).lower()
    return "" if os.access(place, os.W_OK | os.X_OK) else "it cannot be written"


@cache
def _private(place: Path, fault: str) -> Path:
    try:
        made = Path(tempfile.mkdtemp(prefix="hystid-cache-"))  # 0700
    except OSError as error:
        raise ToolchainError(
            f"there is no place for compiled models: the cache {place} cannot be used ({fault}), and neither can a "
            f"temporary folder ({(error.strerror or str(error)).lower()}); set HYSTID_CACHE to a folder of your own"
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
            made.replace(content)
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


def contents() -> Contents:
    """Count, measure and check all entries."""
    place = folder()
    names = sorted(path.stem for path in place.glob("*.key"))
    files = [path for path in place.iterdir() if _is_own(path) and path.is_file()]
    damaged = tuple(name for name in names if (found := _content(place, name)) is None or not _is_whole(found))
    return Contents(place, len(names), sum(path.stat().st_size for path in files), damaged)


def clear() -> int:
    """Remove all entries, those of older versions too; return how many bytes that frees. Other files stay."""
    place, freed = folder(), 0
    older = [path for path in place.parent.iterdir() if _OLDER.fullmatch(path.name)] if place.name == _LAYOUT else []
    for path in [*(path for path in place.iterdir() if _is_own(path)), *older]:
        if path.is_file():
            freed += path.stat().st_size
            path.unlink(missing_ok=True)
        else:
            shutil.rmtree(path, ignore_errors=True)
    return freed


@contextmanager
def workplace() -> Iterator[Path]:
    """A folder beside the entries, to make one in; gone afterwards."""
    with tempfile.TemporaryDirectory(dir=folder(), prefix=mark()) as made:
        yield Path(made)


def _is_own(path: Path) -> bool:
    name = path.name
    return bool(_CONTENT.fullmatch(name) or _OLDER.fullmatch(name)) or path.suffix == ".key" or name.startswith(".")


def _key(place: Path, name: str) -> Path:
    return place / f"{name}.key"


def _content(place: Path, name: str) -> Path | None:
    try:
        with _key(place, name).open("rb") as file:
            text = file.read(100).decode("ascii", errors="replace")
    except OSError:
        return None
    return place / text if _CONTENT.fullmatch(text) else None


def _is_whole(content: Path) -> bool:
    try:
        return _digest(content) == content.stem
    except OSError:
        return False


def _digest(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
