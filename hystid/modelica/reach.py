"""Which classes of the texts a model may depend on, found by the words that its text holds.

A class cannot be used without its short name standing in a text that is used. So following every word that is the name
of a class reaches at least what the front end will read, and sometimes more.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path

from hystid.errors import ModelicaError
from hystid.modelica.sources import Source, read

KEYWORD = r"(?:model|block|class|package|function|connector|record|type|operator)"
_PREFIX = r"(?:redeclare|replaceable|final|inner|outer|partial|encapsulated|expandable|pure|impure)"
_STEP = re.compile(
    r"(?P<open>[(\[{])|(?P<close>[)\]}])|\b(?=[a-z])(?<!\.)(?:end\s+(?P<end>[A-Za-z_]\w*)\s*(?:;|(?=constrainedby\b))"
    rf"|(?P<front>(?:{_PREFIX}\s+)*)(?P<kind>operator\s+(?:record|function)\b|{KEYWORD})\s+"
    r"(?:extends\s+)?(?P<name>[A-Za-z_]\w*)(?:\s*(?P<short>=))?)"
)
_CONTROL = frozenset(("if", "for", "when", "while"))


@dataclass(frozen=True)
class Class:
    """A class in a text, as offsets in characters.

    front: where its prefixes begin. start: where its keyword stands. body: behind its name. tail: where its ``end``
    stands (that of a short class: its end). end: behind its semicolon.
    """

    source: Source
    kind: str
    name: str
    start: int
    body: int
    end: int
    parent: Class | None
    short: bool = False
    front: int = 0
    tail: int = 0

    @property
    def is_model(self) -> bool:
        """Whether it may have equations of its own: a model, a block, or what is called a class."""
        return self.kind in ("model", "block", "class")

    def around(self) -> Iterator[Class]:
        """The class and those that it is nested in, inside out."""
        here: Class | None = self
        while here is not None:
            yield here
            here = here.parent


@dataclass
class _Open:
    kind: str
    name: str
    start: int
    body: int
    inner: list[_Open] = field(default_factory=list)
    end: int = 0
    short: bool = False
    front: int = 0
    tail: int = 0


def only_class(path: Path) -> str:
    """Full name of the only model of a file: of those at its top, or where it holds packages alone, of those in them.

    Raises ModelicaError where there are none or several.
    """
    source = read(path)
    if classes(source) is None and source.classes():
        return source.classes()[0]  # what is wrong with the text is told when it is compiled
    whole = models_of(source)
    found = [_full_name(c) for c in [c for c in whole if c.parent is None] or whole]
    if len(found) != 1:
        there = f"its models are {', '.join(found)}" if found else "it declares none"
        raise ModelicaError(f"{path}: name the model, as {path}:{found[0] if found else 'Class'}; {there}")
    return found[0]


def names_of_models(path: Path) -> list[str]:
    """Full names of the models of a file, those in its packages too; of all classes of a text that cannot be read,
    of which the compiler tells what is wrong."""
    source = read(path)
    return list(source.classes()) if classes(source) is None else [_full_name(c) for c in models_of(source)]


def models_of(source: Source) -> list[Class]:
    """Models and blocks at the top of a text and in its packages; partial ones where there are no others."""
    models = [c for c in classes(source) or () if c.is_model and not c.short]
    seen = [c for c in models if all(outer.kind == "package" for outer in list(c.around())[1:])]
    return [c for c in seen if "partial" not in source.plain[c.front : c.start].split()] or seen


def _full_name(c: Class) -> str:
    front = f"{c.source.within}." if c.source.within else ""
    return front + ".".join(reversed([outer.name for outer in c.around()]))


@lru_cache(maxsize=1024)  # several passes ask for it; a text that none of them changed is the same
def classes(source: Source) -> Sequence[Class] | None:
    """Every class of a text, outer ones before inner ones; None where their ends do not match."""
    roots = _outline(source.plain)
    return None if roots is None else tuple(c for root in roots for c in _named(source, root, None))


def _named(source: Source, o: _Open, parent: Class | None) -> Iterator[Class]:
    made = Class(source, o.kind, o.name, o.start, o.body, o.end, parent, o.short, o.front, o.tail)
    yield made
    for inner in o.inner:
        yield from _named(source, inner, made)


def _outline(plain: str) -> list[_Open] | None:
    stack = [_Open("", "", 0, 0)]
    depth = 0
    for step in _STEP.finditer(plain):
        if step["open"] or step["close"]:
            depth += 1 if step["open"] else -1
        elif step["end"] and depth == 0 and step["end"] not in _CONTROL:
            if len(stack) == 1 or stack[-1].name != step["end"]:
                return None
            closed = stack.pop()
            closed.tail = step.start()
            closed.end = step.end() if plain[step.end() - 1] == ";" else plain.find(";", step.end()) + 1 or len(plain)
        elif step["name"] and depth == 0:
            kind = step["kind"].split()[-1]
            opened = _Open(kind, step["name"], step.start("kind"), step.end(), front=step.start())
            stack[-1].inner.append(opened)
            if step["short"]:
                close = plain.find(";", step.end())
                opened.end, opened.short = (close + 1 or len(plain)), True
                opened.tail = opened.end
            else:
                stack.append(opened)
    return stack[0].inner if len(stack) == 1 and depth == 0 else None


def reached(name: str, sources: Sequence[Source]) -> dict[Source, Sequence[Class] | None]:
    """Text -> its classes that class ``name`` may depend on; None for a text that must be taken as a whole."""
    outlines = {source: classes(source) for source in sources}
    by_name: dict[str, list[Class]] = {}
    for c in (c for found in outlines.values() for c in found or ()):
        by_name.setdefault(c.name, []).append(c)
    wanted = set(name.split("."))
    wanted.update(*(words(source.plain) for source, found in outlines.items() if found is None))
    used: set[Class] = set()
    while wanted:
        new = {a for word in wanted for c in by_name.get(word, ()) for a in c.around()} - used
        used |= new
        wanted = {word for c in new for word in words(own_text(c, outlines[c.source] or ()))}
    return {source: None if found is None else [c for c in found if c in used] for source, found in outlines.items()}


def own_text(c: Class, found: Sequence[Class]) -> str:
    """Text of a class without the classes nested in it; the ``within`` of its file counts as its own."""
    text, at = [], c.start
    for inner in (d for d in found if d.parent is c):
        text.append(c.source.plain[at : inner.start])
        at = inner.end
    within = re.match(r"\s*within\s+[\w.]*", c.source.plain)
    return " ".join((*text, c.source.plain[at : c.end], within.group() if within else ""))


def words(plain: str) -> set[str]:
    """Identifiers in a text."""
    return set(re.findall(r"[A-Za-z_]\w*", plain))
