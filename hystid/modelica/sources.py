"""Modelica files: where the library lies, where a class stands in a text, and from offsets to lines."""

from __future__ import annotations

import difflib
import os
import re
from bisect import bisect_right
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from hystid.errors import ModelicaError
from hystid.files import text_of

_KEYWORD = r"(?:model|block|class|package|function|connector|record|type|operator)"
_CLASS = re.compile(rf"(?<![\w.]){_KEYWORD}\s+([A-Za-z_]\w*)")


def library_folder() -> Path:
    """The folder that holds ``HystId``, in a checkout or in an installed wheel. Raises ModelicaError without one."""
    package = Path(__file__).resolve().parents[1]
    for folder in (package / "_modelica", package.parent / "modelica"):
        if (folder / "HystId" / "package.mo").is_file():
            return folder
    raise ModelicaError("the Modelica library HystId is missing from this installation: install hystid again")


@dataclass(frozen=True)
class Source:
    """One Modelica file."""

    path: Path
    text: str

    @cached_property
    def _data(self) -> bytes:
        return self.text.encode()

    @cached_property
    def _starts(self) -> list[int]:
        return [0, *(i + 1 for i, byte in enumerate(self._data) if byte == 10)]

    @cached_property
    def plain(self) -> str:
        """The text with comments and strings blanked."""
        return blanked(self.text)

    @cached_property
    def within(self) -> str:
        """Full name of the package that the file says to lie in, "" without."""
        found = re.match(r"\s*within\s+([\w.]+)\s*;", self.plain)
        return found.group(1) if found else ""

    def line(self, offset: int) -> int:
        """Line number, from 1, of a byte offset."""
        return bisect_right(self._starts, offset)

    def place(self, offset: int) -> str:
        """File and line, from 1, of an offset in characters."""
        return f"{self.path}:{self.text.count(chr(10), 0, offset) + 1}"

    def piece(self, start: int, end: int) -> str:
        """Text between two byte offsets."""
        return self._data[start:end].decode(errors="replace")

    def find(self, word: str) -> int | None:
        """Line of the first appearance of an identifier or dotted name outside comments and strings, None without."""
        found = re.search(rf"(?<![\w.]){re.escape(word)}(?!\w)", self.plain)
        return self.text.count("\n", 0, found.start()) + 1 if found else None

    def classes(self) -> list[str]:
        """Short names of the classes declared in the file, in order."""
        return _CLASS.findall(self.plain)


@dataclass(frozen=True)
class Declaration:
    """A class in a file: offsets (in characters) from its keyword to behind its ``end Name;``."""

    source: Source
    start: int
    end: int

    @property
    def plain(self) -> str:
        """Text of the class, comments and strings blanked."""
        return self.source.plain[self.start : self.end]

    @property
    def text(self) -> str:
        """Text of the class."""
        return self.source.text[self.start : self.end]

    def place(self, at: int = 0) -> str:
        """File and line of an offset in the class."""
        return self.source.place(self.start + at)

    def __str__(self) -> str:
        return self.place()


def declaration(name: str, sources: Sequence[Source]) -> Declaration | None:
    """Where class ``name`` is declared, None where it is not; a file's ``within`` counts as the front of its names."""
    for source in sources:
        prefix = f"{source.within}." if source.within else ""
        if name.startswith(prefix):
            found = _nested(source, name.removeprefix(prefix).split("."))
            if found:
                return found
    return None


def _nested(source: Source, names: list[str]) -> Declaration | None:
    start, end = 0, len(source.plain)
    for name in names:
        found = re.compile(rf"(?<![\w.])(?:partial\s+)?{_KEYWORD}\s+{name}\b").search(source.plain, start, end)
        if not found:
            return None
        close = re.compile(rf"\bend\s+{name}\s*;").search(source.plain, found.end(), end)
        short = re.compile(r"\s*=[^;]*;").match(source.plain, found.end())
        start, end = found.start(), (short or close or found).end()
    return Declaration(source, start, end)


def blanked(text: str) -> str:
    """The text with comments and strings turned into blanks, lines and columns kept.

    A name in quotes is turned into a plain one of the same length, 'a b' into Qa_bQ.
    """

    def blank(match: re.Match[str]) -> str:
        if match.group().startswith("'"):
            return f"Q{re.sub(r'[^A-Za-z0-9]', '_', match.group()[1:-1])}Q"
        return re.sub(r"[^\n]", " ", match.group())

    pattern = r'"(?:\\.|[^"\\])*"|//[^\n]*|/\*.*?\*/|\'(?:\\.|[^\'\\\n])+\''
    return re.sub(pattern, blank, text, flags=re.DOTALL)


def read(path: Path) -> Source:
    """Read one file as UTF-8. Raises ModelicaError where that fails."""
    return Source(path, text_of(path, ModelicaError))


def read_tree(root: Path) -> list[Source]:
    """Every .mo file of a directory package (given its folder), or the one file."""
    if root.is_file():
        return [read(root)]
    return [read(path) for path in sorted(root.rglob("*.mo"))]


def near(name: str, candidates: Iterable[str]) -> str:
    """A phrase such as "did you mean 'Jenkins'?", empty where nothing is near."""
    last = name.rsplit(".", 1)[-1].lower()
    options = sorted(set(candidates))
    close = [c for c in options if c.rsplit(".", 1)[-1].lower() == last]
    close += [c for c in difflib.get_close_matches(name, options, 3, 0.6) if c not in close]
    return "; did you mean " + " or ".join(f"'{c}'" for c in close[:3]) + "?" if close else ""


def search_path() -> list[Path]:
    """Folders of packages that the environment names (Modelica specification 3.6, section 13.3)."""
    return [Path(entry) for entry in os.environ.get("MODELICAPATH", "").split(os.pathsep) if entry]
