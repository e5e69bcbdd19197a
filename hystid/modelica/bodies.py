"""Statements of functions that the front end refuses, written so that it reads them and that they mean the same.

rumoca 0.10 takes no loop inside an if statement and no ``while``. Guards say which branch runs::

    if c then                       hystid_test_1 := c;
      for k in 1:3 loop               for k in 1:3 loop
        y := y + k;                     if hystid_test_1 then y := y + k; end if;
      end for;                        end for;
    else                            hystid_else_2 := not hystid_test_1;
      y := 0;                         if hystid_else_2 then y := 0; end if;
    end if;

    while c loop                    for hystid_while_3 in 1:2 loop hystid_test_3 := c;
      k := k + 1;                     k := k + 1;
    end while;                      end for;

``expand.Call`` runs the second form as what it stands for. Variables without a value get one, ``y := hystid_no_Real;``,
which it takes for none.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import count

from hystid.modelica.clauses import clauses
from hystid.modelica.reach import Class, classes
from hystid.modelica.sources import Source

ELSE, WHILE, NOTHING = "hystid_else_", "hystid_while_", "hystid_no_"  # names that ``expand.Call`` knows
_TEST = "hystid_test_"
_WORD = re.compile(r"[A-Za-z_]\w*")
_UNIT = re.compile(r"\b(?:if|then|loop)\b|[;()\[\]{}]")


@dataclass(frozen=True)
class _Branch:
    """What stands between two keywords: offset of the first, those of the condition (None for else), the statements."""

    start: int
    condition: tuple[int, int] | None
    body: tuple[_Statement, ...]
    end: int


@dataclass(frozen=True)
class _Statement:
    """kind "simple", "if", "for" or "while"; offsets of its start and behind its semicolon."""

    kind: str
    start: int
    end: int
    branches: tuple[_Branch, ...] = ()

    @property
    def loops(self) -> bool:
        """Whether there is a loop in it."""
        return self.kind in ("for", "while") or any(s.loops for b in self.branches for s in b.body)

    @property
    def refused(self) -> bool:
        """Whether the front end refuses it."""
        if self.kind == "while" or (self.kind == "if" and self.loops):
            return True
        return any(s.refused for b in self.branches for s in b.body)


class _Unreadable(Exception):
    """The statements are not understood here; the front end has its say about them."""


def with_readable_functions(source: Source) -> Source:
    """The text with such functions rewritten; lines stay where they are."""
    text = source.text
    numbers = count(1)
    found = classes(source) or ()
    for owner in sorted(found, key=lambda c: -c.start):
        if owner.kind == "function" and not owner.short and not any(c.parent is owner for c in found):
            text = _rewritten(owner, found, text, numbers)
    return source if text == source.text else Source(source.path, text)


def _rewritten(owner: Class, found: Sequence[Class], text: str, numbers: Iterator[int]) -> str:
    plain = owner.source.plain
    section = re.compile(r"\balgorithm\b").search(plain, owner.body, owner.end)
    if section is None:
        return text
    try:
        statements, end = _statements(plain, section.end())
    except _Unreadable:
        return text
    if not any(s.refused for s in statements):
        return text
    writer = _Writer(owner.source.text, numbers)
    body = writer.all(statements, section.end(), end, "")
    start = f"protected Boolean {', '.join(writer.names)}; {_NOTHING} algorithm {' '.join(_unset(owner, found))}"
    return f"{text[: section.start()]}{start}{body}{text[end:]}"


# The front end wants a value for every variable on every path; these stand for none.
_NOTHING = f"Real {NOTHING}Real = 0; Integer {NOTHING}Integer = 0; Boolean {NOTHING}Boolean = false;"


def _unset(owner: Class, found: Sequence[Class]) -> Iterator[str]:
    plain = owner.source.plain
    for clause in clauses(owner, found):
        behind = clause.mods.closing + 1 if clause.mods else clause.behind
        given = re.compile(r"\s*:?=").match(plain, behind)
        if clause.kind != "component" or given or {"input", "parameter", "constant"} & set(clause.prefixes):
            continue
        nothing = NOTHING + (clause.target if clause.target in ("Integer", "Boolean") else "Real")
        if ":" not in "".join(clause.sizes):
            value = f"fill({nothing}, {', '.join(clause.sizes)})" if clause.sizes else nothing
            yield f"{clause.name} := {value};"


# -- reading


def _word(plain: str, at: int) -> tuple[str, int]:
    """The word at an offset, white space skipped, and where it begins; "" for anything else."""
    start = at + len(plain[at:]) - len(plain[at:].lstrip())
    found = _WORD.match(plain, start)
    return (found.group() if found else "", start)


def _statements(plain: str, at: int) -> tuple[tuple[_Statement, ...], int]:
    """Statements up to an ``end``, ``else`` or ``elseif``, and the offset of that."""
    found: list[_Statement] = []
    while True:
        word, start = _word(plain, at)
        if word in ("end", "else", "elseif", "annotation") or start >= len(plain):
            return tuple(found), start
        if word in ("if", "for", "while"):
            statement = _compound(plain, word, start)
        elif word in ("when", "return", "break"):
            raise _Unreadable
        else:
            statement = _Statement("simple", start, _until(plain, ";", start) + 1)
        found.append(statement)
        at = statement.end


def _compound(plain: str, kind: str, start: int) -> _Statement:
    branches: list[_Branch] = []
    at = start
    while True:
        word, at = _word(plain, at)
        if word == "end":
            stop = plain.index(";", at) + 1
            return _Statement(kind, start, stop, tuple(branches))
        behind = at + len(word)
        condition = None
        if word != "else":
            close = _until(plain, "then" if kind == "if" else "loop", behind)
            condition, behind = (behind, close), close + 4
        body, end = _statements(plain, behind)
        branches.append(_Branch(at, condition, body, end))
        at = end


def _until(plain: str, mark: str, at: int) -> int:
    """Offset of the next keyword or semicolon that belongs to the statement itself, not to an if-expression in it."""
    depth = pending = 0
    for found in _UNIT.finditer(plain, at):
        unit = found.group()
        if unit == mark and depth == 0 and pending == 0:
            return found.start()
        depth += (unit in "([{") - (unit in ")]}")
        pending += (unit == "if") - (unit == "then")
        if unit == ";":
            pending = 0
    raise _Unreadable


# -- writing


class _Writer:
    def __init__(self, text: str, numbers: Iterator[int]) -> None:
        self.text = text
        self.numbers = numbers
        self.names: list[str] = []

    def all(self, statements: Sequence[_Statement], start: int, end: int, guard: str) -> str:
        """The statements between two offsets under a guard ("" for none)."""
        made = []
        for s in statements:
            made += [self.text[start : s.start], self._one(s, guard)]
            start = s.end
        return "".join((*made, self.text[start:end]))

    def _one(self, s: _Statement, guard: str) -> str:
        if s.kind == "if" and s.loops:
            return self._guarded(s, guard)
        if s.kind in ("for", "while"):
            return self._loop(s, guard)
        piece = self.text[s.start : s.end]
        return f"if {guard} then {piece} end if;" if guard else piece

    def _loop(self, s: _Statement, guard: str) -> str:
        (branch,) = s.branches
        assert branch.condition is not None
        condition = self.text[slice(*branch.condition)]
        if s.kind == "for":
            inside = self.all(branch.body, branch.condition[1] + 4, branch.end, guard)
            return f"for{condition}loop{inside}{self.text[branch.end : s.end]}"
        test = self._name(_TEST)
        inside = self.all(branch.body, branch.condition[1] + 4, branch.end, "")
        head = f"for {WHILE}{test.rsplit('_', 1)[-1]} in 1:2 loop {test} := {_and(guard)}({condition});"
        return f"{head}{inside}end for;{self._gap(branch.end, s.end)}"

    def _guarded(self, s: _Statement, guard: str) -> str:
        made = []
        before: list[str] = []
        for branch in s.branches:
            name = self._name(_TEST if branch.condition else ELSE)
            terms = [*([guard] if guard else []), *(f"not {b}" for b in before)]
            behind = branch.start + 4
            if branch.condition is not None:
                terms.append(f"({self.text[slice(*branch.condition)]})")
                behind = branch.condition[1] + 4
            made.append(f"{name} := {' and '.join(terms)};{self.all(branch.body, behind, branch.end, name)}")
            before.append(name)
        return "".join(made) + self._gap(s.branches[-1].end, s.end)

    def _name(self, front: str) -> str:
        self.names.append(f"{front}{next(self.numbers)}")
        return self.names[-1]

    def _gap(self, start: int, end: int) -> str:
        return "\n" * self.text.count("\n", start, end)


def _and(guard: str) -> str:
    return f"{guard} and " if guard else ""
