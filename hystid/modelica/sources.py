"""Modelica files: where the library lies, where a class stands in a text, and from offsets to lines."""

from __future__ import annotations

import difflib
import re
from bisect import bisect_right
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from hystid.errors import ModelicaError

_WORDS = "model|block|class|package|function|connector|record|type|operator"
_CLASS = re.compile(
    rf"^\s*(?:(?:encapsulated|partial|final|replaceable|redeclare|pure|impure|expandable|inner|outer)\s+)*(?:{_WORDS})\s+"
    r"([A-Za-z_]\w*)",
    re.MULTILINE,
)


def library_folder() -> Path:
    """The folder that holds ``HystId``, in a checkout or in an installed wheel."""
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

    def line(self, offset: int) -> int:
        """Line number, from 1, of a byte offset."""
        return bisect_right(self._starts, offset)

    def piece(self, start: int, end: int) -> str:
        """Text between two byte offsets."""
        return self._data[start:end].decode(errors="replace")

    def find(self, word: str) -> int | None:
        """Line of the first appearance of an identifier or dotted name outside comments and strings, None without."""
        found = re.search(rf"(?<![\w.]){re.escape(word)}(?!\w)", blanked(self.text))
        return self.text.count("\n", 0, found.start()) + 1 if found else None

    def classes(self) -> list[str]:
        """Short names of the classes declared in the file, in order."""
        return _CLASS.findall(blanked(self.text))


def blanked(text: str) -> str:
    """The text with comments and strings turned into blanks, lines and columns kept."""

    def blank(match: re.Match[str]) -> str:
        return re.sub(r"[^\n]", " ", match.group())

    return re.sub(r'"(?:\\.|[^"\\])*"|//[^\n]*|/\*.*?\*/', blank, text, flags=re.DOTALL)


def read(path: Path) -> Source:
    """Read one file as UTF-8. Raises ModelicaError where that fails."""
    try:
        return Source(path, path.read_text(encoding="utf-8-sig"))
    except FileNotFoundError:
        raise ModelicaError(f"{path}: no such file") from None
    except (OSError, UnicodeDecodeError) as error:
        raise ModelicaError(f"{path}: cannot be read as UTF-8 text ({error})") from None


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


def qualified_classes(package: Path) -> list[str]:
    """Full names of the classes of a directory package that stand in files of their own or in package files."""
    names = []
    for source in read_tree(package):
        inside = source.path.relative_to(package.parent).with_suffix("").parts
        prefix = ".".join(inside[:-1] if inside[-1] == "package" else inside)
        names.append(prefix)
        short = prefix.rsplit(".", 1)[-1]
        names += [f"{prefix}.{c}" for c in source.classes() if c != short]
    return names


def describe(sources: Sequence[Source]) -> str:
    """File names for a message."""
    return ", ".join(str(s.path) for s in sources[:3])
