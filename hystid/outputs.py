"""Where a command writes: places checked before the work, and result folders replaced whole or kept as they were."""

from __future__ import annotations

import os
import shutil
import stat
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from hystid.errors import UsageError, reason
from hystid.files import left, mark, write_text

_NEW, _OLD = "new-", "old-"  # folders in the making and on their way out
_MANIFEST = ".hystid"  # names, one a line, of the files that belong to the result in a folder


@contextmanager
def replaced(folder: Path) -> Iterator[Path]:
    """Yield an empty folder; its files replace the earlier result in ``folder`` when the block ends without an error.

    Files of an earlier result (listed in ``.hystid``) go, whatever their names; files that are no result stay. After
    an error or Ctrl-C everything is as it was. Raises UsageError, before the block, where nothing can be written.
    """
    folder = Path(folder)
    check_folder(folder)
    made = [parent for parent in (folder, *folder.parents) if not parent.exists()]
    try:  # what permissions do not show, such as a name that is too long for this disk, shows here
        folder.mkdir(parents=True, exist_ok=True)
        _resume(folder)
        new = Path(tempfile.mkdtemp(dir=folder, prefix=mark(_NEW)))
    except OSError as error:
        raise _unwritable(folder, error) from None
    try:
        yield new
        _exchange(new, folder)
    finally:
        shutil.rmtree(new, ignore_errors=True)
        for parent in made:  # a failed run leaves no empty folder behind
            with suppress(OSError):
                parent.rmdir()


def _exchange(new: Path, folder: Path) -> None:
    """Old files aside, new files in; back again if anything fails on the way."""
    names = sorted(path.relative_to(new) for path in new.rglob("*") if path.is_file())
    for name in names:
        if not _is_inside(folder, name):
            raise UsageError(f"-o {folder}: {name.parent} is a link that leads out of this folder; remove it")
    aside = _aside(new)
    aside.mkdir()
    write_text(new / _MANIFEST, "".join(f"{name.as_posix()}\n" for name in names))
    names.append(Path(_MANIFEST))
    leaving = [name for name in dict.fromkeys((*_listed(folder), *names)) if (folder / name).is_file()]
    steps = [(folder / name, aside / name) for name in leaving] + [(new / name, folder / name) for name in names]
    done: list[tuple[Path, Path]] = []
    try:
        for source, target in steps:
            target.parent.mkdir(parents=True, exist_ok=True)
            source.replace(target)
            done.append((source, target))
    except BaseException:
        for source, target in reversed(done):
            target.replace(source)
        raise
    finally:
        shutil.rmtree(aside, ignore_errors=True)
    for emptied in {(folder / name).parent for name in leaving} - {folder}:
        with suppress(OSError):  # not empty: it holds new files, or files of the user
            emptied.rmdir()


def _aside(new: Path) -> Path:
    return new.with_name(new.name.replace(_NEW, _OLD, 1))


def _resume(folder: Path) -> None:
    """Finish what processes that were killed had begun to exchange, and remove what they had not finished making.

    The list of files is written when all of them are there, and moved when all others have been.
    """
    for new in left(folder, _NEW):
        if (new / _MANIFEST).is_file():
            names = [name for name in _listed(new) if _is_inside(folder, name)]
            for name in set(_listed(folder)) - set(names):
                (folder / name).unlink(missing_ok=True)
            for name in (*names, Path(_MANIFEST)):
                if (new / name).is_file():
                    (folder / name).parent.mkdir(parents=True, exist_ok=True)
                    (new / name).replace(folder / name)
        shutil.rmtree(_aside(new), ignore_errors=True)
        shutil.rmtree(new, ignore_errors=True)


def _listed(folder: Path) -> list[Path]:
    """Files of the earlier result; nothing outside of the folder, whatever the list says."""
    try:
        lines = (folder / _MANIFEST).read_text(encoding="utf-8").splitlines()
    except (OSError, UnicodeDecodeError):
        return []
    names = [Path(line) for line in lines if line]
    return [name for name in names if _is_inside(folder, name)]


def _is_inside(folder: Path, name: Path) -> bool:
    """Whether a file lies in the folder, links on the way there included."""
    if name.is_absolute() or ".." in name.parts:
        return False
    return (folder / name).parent.resolve().is_relative_to(folder.resolve())


def check_folder(folder: Path) -> None:
    """Raise UsageError where ``folder`` is a file, or cannot be made or written."""
    _check_writable(folder, folder)


def check_file(path: Path, suffix: str) -> None:
    """Raise UsageError where ``path`` has another suffix, is no plain file, or lies where nothing can be written."""
    if path.suffix.lower() != suffix:
        raise UsageError(f"-o {path}: the name must end in {suffix}")
    _check_writable(path, path.parent)
    try:
        kind = path.stat().st_mode
    except FileNotFoundError:
        return
    except OSError as error:
        raise _unwritable(path, error) from None
    if stat.S_ISDIR(kind):
        raise UsageError(f"-o {path}: this is a folder; name a file in it")
    if not stat.S_ISREG(kind):
        raise UsageError(f"-o {path}: this is a pipe or a device, which a file would replace; name a file")


def _check_writable(asked: Path, folder: Path) -> None:
    try:
        there = next(parent for parent in (folder, *folder.absolute().parents) if parent.exists())
    except OSError as error:  # such as a name that is too long
        raise _unwritable(asked, error) from None
    if not there.is_dir():
        what = "this is a file; name a folder" if there == asked else f"{there} is a file and can hold no folder"
        raise UsageError(f"-o {asked}: {what}")
    if not os.access(there, os.W_OK | os.X_OK):
        raise UsageError(f"-o {asked}: {there} may not be written to; choose another folder")


def _unwritable(folder: Path, error: OSError) -> UsageError:
    return UsageError(f"-o {folder}: nothing can be written there ({reason(error)})")
