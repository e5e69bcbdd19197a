"""Annotations of our own in a class: ``annotation(__HystId_effect(title = "...", threshold = gap))``.

Other tools skip what begins with the name of another vendor (Modelica 3.6, section 18.1). The values here are
strings, numbers, true and false, names, lists in braces, and records ``Name(key = value)``.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NoReturn, TypeAlias

from hystid.errors import ModelicaError
from hystid.modelica.sources import Declaration, declaration, library_folder, read

_TOKEN = re.compile(
    r"(?P<skip>\s+|//[^\n]*|/\*.*?\*/)"
    r'|(?P<string>"(?:\\.|[^"\\])*")'
    r"|(?P<number>(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)"
    r"|(?P<name>[A-Za-z_]\w*(?:\.[A-Za-z_]\w*)*)"
    r"|(?P<mark>[(){}=,+-])",
    re.DOTALL,
)


@dataclass(frozen=True)
class Name:
    """A name that stands without quotes, as that of a parameter."""

    text: str


Value: TypeAlias = "str | float | bool | Name | list[Any] | AnnotationRecord"


@dataclass(frozen=True)
class Entry:
    """One ``key = value``. place: file and line."""

    value: Value
    place: str


@dataclass(frozen=True)
class AnnotationRecord:
    """``Name(key = value, ...)``. place: file and line."""

    name: str
    entries: dict[str, Entry]
    place: str


def vendor_annotation(class_name: str, keyword: str) -> AnnotationRecord | None:
    """The annotation ``keyword(...)`` of a class of the library, or of a file ("own.mo:Block"); None without one.

    Raises ModelicaError with file and line where it cannot be read, and where there are two.
    """
    file, _, name = class_name.rpartition(":")
    path = Path(file) if file else library_folder() / f"{class_name.replace('.', '/')}.mo"
    declared = declaration(name, [read(path)])
    if declared is None:
        return None
    found = [m for m in re.finditer(rf"\b{keyword}\b", declared.plain)]
    if not found:
        return None
    reader = _Reader(declared)
    if len(found) > 1:
        reader.refuse(found[1].start(), f"{keyword} stands twice in one class: leave one")
    return reader.record(found[0].start())


class _Reader:
    """Reads values from the text of a class; positions are offsets in it."""

    def __init__(self, declared: Declaration) -> None:
        self.declared, self.text, self.at = declared, declared.text, 0

    def refuse(self, at: int, why: str) -> NoReturn:
        raise ModelicaError(f"{self.declared.place(at)}: {why}")

    def record(self, at: int) -> AnnotationRecord:
        """The record that begins at an offset."""
        self.at = at
        made = self._value()
        if not isinstance(made, AnnotationRecord):
            self.refuse(at, f"an annotation is written {self.text[at : self.at].strip()}(key = value, ...)")
        return made

    def _next(self) -> tuple[str, str, int]:
        """Kind, text and offset of the next token."""
        while (found := _TOKEN.match(self.text, self.at)) is not None:
            self.at = found.end()
            if found.lastgroup != "skip":
                return str(found.lastgroup), found.group(), found.start()
        self.refuse(self.at, f"{self.text[self.at : self.at + 1]!r} cannot stand in an annotation of this vendor")

    def _peek(self) -> str:
        """Text of the next token, which stays."""
        before = self.at
        _, text, _ = self._next()
        self.at = before
        return text

    def _value(self) -> Value:
        kind, text, at = self._next()
        if kind == "string":
            said = _plain(text)
            while self._peek() == "+":
                self._next()
                kind, text, at = self._next()
                if kind != "string":
                    self.refuse(at, "a string is joined to another string only")
                said += _plain(text)
            return said
        if kind == "number":
            return float(text)
        if text in "+-":
            number = self._value()
            if isinstance(number, bool) or not isinstance(number, float):
                self.refuse(at, f"a number must follow {text}")
            return -number if text == "-" else number
        if text == "{":
            return self._listed()
        if kind == "name":
            if self._peek() == "(":
                return self._record(text, at)
            return text == "true" if text in ("true", "false") else Name(text)
        self.refuse(at, f"a value was expected, not {text!r}")

    def _listed(self) -> list[Value]:
        found: list[Value] = []
        if self._peek() == "}":
            self._next()
            return found
        while True:
            found.append(self._value())
            if self._closed("}"):
                return found

    def _closed(self, mark: str) -> bool:
        """Whether the list ends here; a comma goes on."""
        _, text, at = self._next()
        if text not in (",", mark):
            self.refuse(at, f"',' or {mark!r} was expected, not {text!r}")
        return text == mark

    def _record(self, name: str, at: int) -> AnnotationRecord:
        self._next()
        entries: dict[str, Entry] = {}
        if self._peek() == ")":
            self._next()
            return AnnotationRecord(name, entries, self.declared.place(at))
        while True:
            kind, key, here = self._next()
            if kind != "name":
                self.refuse(here, f"'key = value' was expected in {name}, not {key!r}")
            if key in entries:
                self.refuse(here, f"'{key}' stands twice in {name}: leave one")
            _, sign, there = self._next()
            if sign != "=":
                self.refuse(there, f"'{key} = value' was expected in {name}")
            entries[key] = Entry(self._value(), self.declared.place(here))
            if self._closed(")"):
                return AnnotationRecord(name, entries, self.declared.place(at))


def _plain(text: str) -> str:
    """A string without its quotes; line ends and what follows them are one blank."""
    return re.sub(r"\s*\n\s*", " ", re.sub(r"\\(.)", r"\1", text[1:-1]))
