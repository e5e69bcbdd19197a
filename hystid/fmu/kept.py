"""Where a reference result is kept: inside an FMU, beside it, in a folder, or in a table that is named."""

from __future__ import annotations

import zipfile
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from xml.etree import ElementTree as ET

from hystid.errors import FmuError, UsageError
from hystid.files import check_regular, text_of, write_text
from hystid.fmu.build import read_zip, write_zip
from hystid.fmu.door import check_xml, read_entry
from hystid.fmu.reference import FOLDER, INPUT_ROLE, RESULT_ROLE

_MANIFEST = 1 << 20  # bytes: of some thousand files


@dataclass(frozen=True)
class Kept:
    """A result and the input that it belongs to (empty without one), as texts of tables.

    place: the file that holds the result; entry: its name inside, where that file is an FMU.
    """

    place: Path
    entry: str
    result: str
    input: str

    @staticmethod
    def of(path: Path, reference: Path | None = None) -> Kept:
        """The reference for the FMU at path: its own, or from another FMU, a folder or a table.

        Raises FmuError, UsageError where there is none.
        """
        if reference is None:
            return _beside(path, path.parent) or _inside(path, f"{path.stem}_out.csv is not beside it")
        if reference.is_dir():
            return _in_folder(path, reference)
        check_regular(reference, UsageError)
        if reference.suffix.lower() == ".csv":
            return _table(reference)
        if not zipfile.is_zipfile(reference):
            raise UsageError(f"{reference}: the reference must be an FMU, a folder or a .csv table")
        return _beside(reference, reference.parent) or _inside(reference, "no table is beside it")

    def replaced(self, text: str) -> None:
        """Write a new result in place of the old."""
        if not self.entry:
            write_text(self.place, text)
            return
        write_zip(self.place, {**read_zip(self.place), self.entry: text.encode()})


def _beside(path: Path, folder: Path) -> Kept | None:
    table = folder / f"{path.stem}_out.csv"
    return _table(table) if table.is_file() else None


def _table(table: Path) -> Kept:
    stem = table.stem.removesuffix("_out")
    stimulus = table.with_name(f"{stem}_in.csv")
    return Kept(table, "", text_of(table, FmuError), text_of(stimulus, FmuError) if stimulus.is_file() else "")


def _in_folder(path: Path, folder: Path) -> Kept:
    found = _beside(path, folder)
    if found:
        return found
    if (folder / path.name).is_file():
        return _inside(folder / path.name, f"{folder} has no {path.stem}_out.csv")
    raise FmuError(f"{folder}: it holds neither {path.stem}_out.csv nor {path.name} to compare {path.name} with")


def _inside(path: Path, otherwise: str) -> Kept:
    manifest = read_entry(path, f"{FOLDER}/fmi-ls-manifest.xml", _MANIFEST)
    if manifest is None:
        raise FmuError(f"{path.name}: it carries no reference results, and {otherwise}")
    found, texts = {}, {}
    for role, name in _related(path, manifest):
        content = read_entry(path, name) if role in (RESULT_ROLE, INPUT_ROLE) and role not in texts else None
        if content is not None:
            found[role], texts[role] = name, content
    if RESULT_ROLE not in found:
        raise FmuError(f"{path.name}: the manifest of its reference results names no result that is there")
    try:
        result, stimulus = texts[RESULT_ROLE].decode(), texts.get(INPUT_ROLE, b"").decode()
    except UnicodeDecodeError as error:
        raise FmuError(f"{path.name}: its reference results cannot be read: {error}") from None
    return Kept(path, found[RESULT_ROLE], result, stimulus)


def _related(path: Path, manifest: bytes) -> list[tuple[str, str]]:
    what = "the manifest of its reference results"
    check_xml(f"{path.name}: {what}", manifest)
    root = ET.fromstring(manifest)
    found = [(e.get("role", ""), e.get("source", "")) for e in root.iter("Related") if e.get("type") == "text/csv"]
    return [(role, str(PurePosixPath(FOLDER, source))) for role, source in found]
