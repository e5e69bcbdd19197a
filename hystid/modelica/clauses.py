"""The declarations of a class with their modifiers, read from the text as far as rewriting them needs."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cache, lru_cache

from hystid.modelica.reach import Class, classes

_NAME = r"[A-Za-z_]\w*(?:\s*\.\s*[A-Za-z_]\w*)*"
_CLASS_KIND = r"(?:model|block|class|package|function|connector|record|type)"
_PREFIX = re.compile(
    r"\s*(redeclare|replaceable|each|final|inner|outer|flow|stream|discrete|parameter|constant|input|output|"
    r"public|protected)\b"
)
_SKIPPED = re.compile(r"\s*(?:import|annotation|end|external)\b")
_SECTION = re.compile(r"\s*(?:(?P<on>public|protected)|(?:initial\s+)?(?P<off>equation|algorithm))\b")


@dataclass(frozen=True)
class Modifiers:
    """A list in parentheses: offsets of the two parentheses, and its elements."""

    opening: int
    closing: int
    elements: tuple[Modifier, ...]


@dataclass(frozen=True)
class Modifier:
    """One element: ``name``, ``name(...)``, ``name = value``, or a redeclaration (kind "class" or "component").

    start, end: offsets. named: offset of the name. target: what a redeclaration takes, with the offset behind it.
    """

    start: int
    end: int
    prefixes: tuple[str, ...]
    kind: str
    name: str
    named: int
    target: str = ""
    behind: int = 0
    inner: Modifiers | None = None
    value: tuple[int, int] | None = None


@dataclass(frozen=True)
class Clause:
    """A declaration with a list of modifiers: an extends clause, a short class, or one component.

    start: offset of the statement. behind: where a list of modifiers would start. limit: name and modifiers of
    ``constrainedby``, None without one. sizes: what stands in the brackets of a component's type and name.
    target: the type of a component, the base of an extends clause or of a short class, and its offset ``typed``.
    names: how many components the statement declares.
    """

    owner: Class
    kind: str
    start: int
    prefixes: tuple[str, ...]
    name: str
    behind: int
    mods: Modifiers | None
    limit: tuple[str, Modifiers | None] | None = None
    sizes: tuple[str, ...] = ()
    target: str = ""
    typed: int = 0
    names: int = 1


@lru_cache(maxsize=8192)  # a dozen passes ask for those of the same class
def clauses(owner: Class) -> tuple[Clause, ...]:
    """The clauses of one class of a text. Nested classes have clauses of their own."""
    plain = owner.source.plain
    if owner.short:
        return tuple(_short(owner, plain))
    text = plain[: owner.end]
    for inner in classes(owner.source) or ():
        if inner.parent is owner:
            text = text[: inner.start] + re.sub(r"[^\n;]", " ", text[inner.start : inner.end]) + text[inner.end :]
    return tuple(c for at in _statements(text, owner.body, owner.end) for c in _statement(owner, text, *at))


def _short(owner: Class, plain: str) -> Iterator[Clause]:
    base = re.compile(rf"\s*(?:(?:input|output)\s+)?({_NAME})").match(plain, owner.body, owner.end)
    if not base or base.group(1) == "enumeration":
        return
    before = re.search(r"((?:\b(?:redeclare|replaceable|final|partial|encapsulated)\s+)*)\Z", plain[: owner.start])
    words = before.group(1) if before else ""
    behind = _behind_sizes(plain, base.end())
    mods = _listed(plain, behind)
    at = mods.closing + 1 if mods else behind
    start = owner.start - len(words)
    yield Clause(
        owner, "short", start, tuple(words.split()), owner.name, behind, mods, _limit(plain, at), (), base.group(1)
    )


def _statements(text: str, start: int, end: int) -> Iterator[tuple[int, int]]:
    """Offsets of the statements of the declaration sections."""
    at, on = start, True
    while at < end:
        stop = next_mark(text, at, end, ";")
        section = _SECTION.match(text, at, stop)
        if section:
            on = bool(section["on"])
            at = section.end()
        elif on and text[at:stop].strip():
            yield at + len(text[at:stop]) - len(text[at:stop].lstrip()), stop
            at = stop + 1
        else:
            at = stop + 1


def _statement(owner: Class, text: str, start: int, end: int) -> Iterator[Clause]:
    if _SKIPPED.match(text, start, end):
        return
    base = re.compile(rf"extends\s+({_NAME})").match(text, start, end)
    if base:
        mods = _listed(text, base.end())
        yield Clause(owner, "extends", start, (), base.group(1), base.end(), mods, target=base.group(1))
        return
    prefixes, at = _prefixes(text, start, end)
    kind = re.compile(rf"\s*{_NAME}").match(text, at, end)
    if not kind:
        return
    at = _behind_sizes(text, kind.end())
    common = _sizes(text[kind.end() : at])
    found: list[Clause] = []
    while at < end:
        name = re.compile(r"\s*([A-Za-z_]\w*)").match(text, at, end)
        if not name:
            break
        behind = _behind_sizes(text, name.end())
        mods = _listed(text, behind)
        stop = next_mark(text, behind, end, ",")
        limit = re.compile(r"\bconstrainedby\b").search(text, behind, stop)
        limited = _limit(text, limit.start()) if limit else None
        sizes = (*common, *_sizes(text[name.end() : behind]))
        target = kind.group().strip()
        typed = kind.end() - len(target)
        made = Clause(owner, "component", start, prefixes, name.group(1), behind, mods, limited, sizes, target, typed)
        found.append(made)
        at = stop + 1
    yield from (replace(clause, names=len(found)) for clause in found)


def _limit(text: str, at: int) -> tuple[str, Modifiers | None] | None:
    found = re.compile(rf"\s*constrainedby\s+({_NAME})").match(text, at)
    return (found.group(1), _listed(text, found.end())) if found else None


def _prefixes(text: str, at: int, end: int) -> tuple[tuple[str, ...], int]:
    found = []
    while word := _PREFIX.match(text, at, end):
        found.append(word.group(1))
        at = word.end()
    return tuple(found), at


def _behind_sizes(text: str, at: int) -> int:
    """Behind the brackets that follow, if there are any."""
    sizes = re.compile(r"\s*\[").match(text, at)
    return closing(text, sizes.end() - 1) + 1 if sizes else at


def _sizes(brackets: str) -> tuple[str, ...]:
    inside = brackets.strip()[1:-1]
    return tuple(inside.split(",")) if inside else ()


def _listed(text: str, at: int) -> Modifiers | None:
    found = re.compile(r"\s*\(").match(text, at)
    if not found:
        return None
    opening = found.end() - 1
    end = closing(text, opening)
    parts = [(text[start:stop], stop) for start, stop in parted(text, opening + 1, end)]
    return Modifiers(
        opening, end, tuple(_element(text, stop - len(part.lstrip()), stop) for part, stop in parts if part.strip())
    )


def _element(text: str, start: int, end: int) -> Modifier:
    prefixes, at = _prefixes(text, start, end)
    if "redeclare" in prefixes or "replaceable" in prefixes:
        short = re.compile(rf"\s*{_CLASS_KIND}\s+([A-Za-z_]\w*)\s*=\s*({_NAME})").match(text, at, end)
        if short:
            inner = _listed(text, short.end())
            name, base = short.group(1), short.group(2)
            return Modifier(start, end, prefixes, "class", name, short.start(1), base, short.end(), inner)
        kind = re.compile(rf"\s*({_NAME})").match(text, at, end)
        target, at = (kind.group(1), _behind_sizes(text, kind.end())) if kind else ("", at)
        return _plain_element(text, start, end, prefixes, at, "component", target)
    return _plain_element(text, start, end, prefixes, at, "", "")


def _plain_element(
    text: str, start: int, end: int, prefixes: tuple[str, ...], at: int, kind: str, target: str
) -> Modifier:
    name = re.compile(rf"\s*({_NAME})").match(text, at, end)
    if not name:
        return Modifier(start, end, prefixes, kind, "", at, target)
    behind = _behind_sizes(text, name.end())
    inner = _listed(text, behind)
    rest = inner.closing + 1 if inner else behind
    value = re.compile(r"\s*=(?!=)").match(text, rest, end)
    return Modifier(
        start, end, prefixes, kind, re.sub(r"\s", "", name.group(1)), name.start(1), target, rest, inner,
        (value.end(), end) if value else None,
    )  # fmt: skip


_BRACKETS = re.compile(r"[()\[\]{}]")


def next_mark(text: str, start: int, end: int, mark: str) -> int:
    """Offset of the next ``mark`` outside all brackets, ``end`` without one."""
    depth = 0
    for found in _marks(mark).finditer(text, start, end):
        letter = found.group()
        if letter == mark and depth <= 0:
            return found.start()
        depth += (letter in "([{") - (letter in ")]}")
    return end


def parted(text: str, start: int, end: int) -> Iterator[tuple[int, int]]:
    """Offsets of what commas outside all brackets part."""
    while start < end:
        stop = next_mark(text, start, end, ",")
        yield start, stop
        start = stop + 1


@cache
def _marks(mark: str) -> re.Pattern[str]:
    return re.compile(rf"[()\[\]{{}}{re.escape(mark)}]")


def closing(text: str, opening: int) -> int:
    """Position of the bracket that closes the one at ``opening`` (the text's end without one)."""
    if text[opening : opening + 1] not in tuple("([{"):
        return opening
    depth = 0
    for found in _BRACKETS.finditer(text, opening):
        depth += 1 if found.group() in "([{" else -1
        if depth == 0:
            return found.start()
    return len(text)
