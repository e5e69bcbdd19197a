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
which it takes for none. ``return`` and ``break`` become flags, and what follows them runs where these are not set.
A call whose results nobody takes is left out, as there is nothing but assertions and printing in such a function;
``Modelica.Utilities.Streams.error(...)`` becomes ``y := hystid_stop;``, which ends the compilation where it is reached.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import count

from hystid.modelica.clauses import clauses
from hystid.modelica.reach import Class, classes
from hystid.modelica.sources import Source
from hystid.modelica.workarounds.edits import Edit, edited

# names that ``expand.Call`` knows
ELSE, WHILE, NOTHING, STOP = "hystid_else_", "hystid_while_", "hystid_no_", "hystid_stop"
_TEST = "hystid_test_"
_WORD = re.compile(r"[A-Za-z_]\w*")
_INITIAL = re.compile(r"\binitial\s+algorithm\b")
_CALL = re.compile(r"\.?[A-Za-z_][\w.]*(?=\s*\()")
_SECTIONS = ("equation", "algorithm", "initial", "public", "protected")
_ENDS = frozenset((*_SECTIONS, "end", "else", "elseif", "elsewhen", "annotation", "external"))
_KEPT = frozenset(("assert", "terminate", "reinit"))
_UNIT = re.compile(r"\b(?:if|elseif|then|loop)\b|[;()\[\]{}]")


@dataclass(frozen=True)
class BranchText:
    """What stands between two keywords: offset of the first, those of the condition (None for else), the statements."""

    start: int
    condition: tuple[int, int] | None
    body: tuple[StatementText, ...]
    end: int


@dataclass(frozen=True)
class StatementText:
    """Offsets of its start and behind its semicolon; an equation is one as well.

    kind "simple", "call" (whose results nobody takes), "return", "break", "if", "for", "while" or "when".
    """

    kind: str
    start: int
    end: int
    branches: tuple[BranchText, ...] = ()

    @property
    def loops(self) -> bool:
        """Whether there is a loop in it."""
        return self.kind in ("for", "while") or any(s.loops for b in self.branches for s in b.body)

    @property
    def refused(self) -> bool:
        """Whether the front end refuses it."""
        if self.kind in ("while", "return", "break", "call") or (self.kind == "if" and self.loops):
            return True
        return any(s.refused for b in self.branches for s in b.body)

    @property
    def leaves(self) -> frozenset[str]:
        """Which of "return" and "break" may end what stands around it."""
        inner = frozenset(jump for b in self.branches for s in b.body for jump in s.leaves)
        return inner - {"break"} if self.kind in ("for", "while") else inner | ({self.kind} & {"return", "break"})


class Unreadable(Exception):
    """The statements are not understood here; the front end has its say about them."""


def with_readable_functions(source: Source) -> Source:
    """The text with such functions rewritten; lines stay where they are."""
    numbers = count(1)
    found = classes(source) or ()
    edits: list[Edit] = []
    for owner in sorted(found, key=lambda c: -c.start):
        if owner.kind == "function" and not owner.short and not any(c.parent is owner for c in found):
            edits += _rewritten(owner, numbers)
            edits += _with_plain_values(owner)
        elif owner.is_model and not owner.short:
            edits += _without_calls(owner)
    return edited(source, edits)


def _with_plain_values(owner: Class) -> Iterator[Edit]:
    """``Real x := 0;`` as a declaration, which the front end takes for a syntax error, with an equals sign."""
    for clause in clauses(owner):
        behind = clause.mods.closing + 1 if clause.mods else clause.behind
        sign = re.compile(r"\s*:(?==)").match(owner.source.plain, behind)
        if sign and clause.kind == "component":
            yield sign.end() - 1, sign.end(), " "


def _without_calls(owner: Class) -> Iterator[Edit]:
    """Takes away calls as statements in the initial algorithms of a model, which the front end refuses."""
    plain = owner.source.plain
    for section in _INITIAL.finditer(plain, owner.body, owner.end):
        try:
            statements, _ = statements_of(plain, section.end())
        except Unreadable:
            continue
        if statements and all(s.kind == "call" for s in statements):  # it takes no empty one either
            start, end = section.start(), statements[-1].end
            yield start, end, "\n" * plain.count("\n", start, end)
            continue
        for s in _called(statements):
            yield s.start, s.end, "\n" * plain.count("\n", s.start, s.end)


def _called(statements: Iterable[StatementText]) -> Iterator[StatementText]:
    for s in statements:
        if s.kind == "call":
            yield s
        yield from (inner for b in s.branches for inner in _called(b.body))


def _rewritten(owner: Class, numbers: Iterator[int]) -> Iterator[Edit]:
    plain = owner.source.plain
    section = re.compile(r"\balgorithm\b").search(plain, owner.body, owner.end)
    if section is None:
        return
    try:
        statements, end = statements_of(plain, section.end())
    except Unreadable:
        return
    if not any(s.refused for s in statements):
        return
    writer = _Writer(owner.source.text, numbers, _real(owner))
    try:
        body = writer.function(statements, section.end(), end)
    except Unreadable:
        return
    names = f"Boolean {', '.join(writer.names)}; " if writer.names else ""
    start = f"protected {names}{_NOTHING} algorithm {' '.join(_unset(owner))}"
    yield section.start(), end, start + body


# The front end wants a value for every variable on every path; these stand for none.
_NOTHING = f"Real {NOTHING}Real = 0; Integer {NOTHING}Integer = 0; Boolean {NOTHING}Boolean = false; Real {STOP} = 0;"


def _real(owner: Class) -> str:
    """A scalar of type Real that the function assigns, an output first; "" without one."""
    made = [c for c in clauses(owner) if c.kind == "component" and c.target == "Real" and not c.sizes]
    made = [c for c in made if not {"input", "parameter", "constant"} & set(c.prefixes)]
    return next((c.name for c in sorted(made, key=lambda c: "output" not in c.prefixes)), "")


def _unset(owner: Class) -> Iterator[str]:
    plain = owner.source.plain
    for clause in clauses(owner):
        behind = clause.mods.closing + 1 if clause.mods else clause.behind
        given = re.compile(r"\s*:?=").match(plain, behind)
        if clause.kind != "component" or given or {"input", "parameter", "constant"} & set(clause.prefixes):
            continue
        nothing = NOTHING + (clause.target if clause.target in ("Integer", "Boolean") else "Real")
        if ":" not in "".join(clause.sizes):
            value = f"fill({nothing}, {', '.join(clause.sizes)})" if clause.sizes else nothing
            yield f"{clause.name} := {value};"


# -- reading


def word_at(plain: str, at: int) -> tuple[str, int]:
    """The word at an offset, white space skipped, and where it begins; "" for anything else."""
    start = at + len(plain[at:]) - len(plain[at:].lstrip())
    found = _WORD.match(plain, start)
    return (found.group() if found else "", start)


_HEADS = {"if": "then", "for": "loop", "while": "loop"}


def statements_of(plain: str, at: int, heads: Mapping[str, str] = _HEADS) -> tuple[tuple[StatementText, ...], int]:
    """Statements up to an ``end``, ``else`` or ``elseif``, and the offset of that.

    heads: what statements with branches begin with -> the word behind their conditions. Raises Unreadable.
    """
    found: list[StatementText] = []
    while True:
        word, start = word_at(plain, at)
        if word in _ENDS or start >= len(plain):
            return tuple(found), start
        if word in heads:
            found.append(_compound(plain, word, start, heads))
        elif word == "when":
            raise Unreadable
        else:
            found.append(_plain(plain, word, start))
        at = found[-1].end


def _plain(plain: str, word: str, start: int) -> StatementText:
    stop = until(plain, ";", start) + 1
    if word in ("return", "break"):
        return StatementText(word, start, stop)
    called = _CALL.match(plain, start)
    if called and called.group() not in _KEPT and ":=" not in plain[start:stop]:
        return StatementText("call", start, stop)
    return StatementText("simple", start, stop)


def _compound(plain: str, kind: str, start: int, heads: Mapping[str, str]) -> StatementText:
    branches: list[BranchText] = []
    word, at = word_at(plain, start)
    while word != "end":
        behind = at + len(word)
        condition = None
        if word != "else":
            close = until(plain, heads[kind], behind)
            condition, behind = (behind, close), close + 4
        body, end = statements_of(plain, behind, heads)
        branches.append(BranchText(at, condition, body, end))
        word, at = word_at(plain, end)
        if word not in ("end", "else", "elseif", "elsewhen"):
            raise Unreadable
    return StatementText(kind, start, plain.index(";", at) + 1, tuple(branches))


def until(plain: str, mark: str, at: int) -> int:
    """Offset of the next keyword or semicolon that belongs to the statement itself, not to an if-expression in it.
    Raises Unreadable without one."""
    depth = pending = 0
    for found in _UNIT.finditer(plain, at):
        unit = found.group()
        if unit == mark and depth == 0 and pending == 0:
            return found.start()
        depth += (unit in "([{") - (unit in ")]}")
        pending += (unit in ("if", "elseif")) - (unit == "then")
        if unit == ";":
            pending = 0
    raise Unreadable


# -- writing


class _Writer:
    def __init__(self, text: str, numbers: Iterator[int], result: str) -> None:
        self.text = text
        self.result = result
        self.numbers = numbers
        self.names: list[str] = []
        self._flags: dict[str, list[str]] = {}

    def function(self, statements: Sequence[StatementText], start: int, end: int) -> str:
        """The body of a function."""
        if not any("return" in s.leaves for s in statements):
            return self.all(statements, start, end, "")
        self._flags["return"] = [self._name(_TEST)]
        return f" {self._flags['return'][0]} := false;{self.all(statements, start, end, '')}"

    def all(self, statements: Sequence[StatementText], start: int, end: int, guard: str) -> str:
        """The statements between two offsets under a guard ("" for none)."""
        made = []
        for s in statements:
            made += [self.text[start : s.start], self._one(s, guard)]
            start = s.end
            if s.leaves and s is not statements[-1]:
                text, guard = self._still(s.leaves, guard)
                made.append(text)
        return "".join((*made, self.text[start:end]))

    def _still(self, jumps: Iterable[str], guard: str) -> tuple[str, str]:
        """A statement that says whether none of the jumps was taken, and its flag."""
        name = self._name(ELSE)
        terms = [*([guard] if guard else []), *(f"not {self._flags[jump][-1]}" for jump in sorted(jumps))]
        return f" {name} := {' and '.join(terms)};", name

    def _one(self, s: StatementText, guard: str) -> str:
        if s.kind == "if" and (s.loops or s.leaves):
            return self._guarded(s, guard)
        if s.kind in ("for", "while"):
            return self._loop(s, guard)
        if s.kind == "if":
            first, last = s.branches[0], s.branches[-1]
            piece = self.text[s.start : first.start]
            for branch in s.branches:
                at = branch.condition[1] + 4 if branch.condition else branch.start + 4
                piece += self.text[branch.start : at] + self.all(branch.body, at, branch.end, "")
            piece += self.text[last.end : s.end]
        else:
            piece = self._simple(s)
        return f"if {guard} then {piece} end if;" if guard and piece.strip() else piece

    def _simple(self, s: StatementText) -> str:
        text = self.text[s.start : s.end]
        if s.kind == "simple":
            return text
        gap = self._gap(s.start, s.end)
        if s.kind == "call":
            return (self._error() if re.match(r"(?:[\w.]*\.)?error\b", text) else "") + gap
        if not self._flags.get(s.kind):
            raise Unreadable
        return f"{self._flags[s.kind][-1]} := true;{gap}"

    def _error(self) -> str:
        """The front end drops a branch that sets nothing of use, so that a result takes the mark."""
        if not self.result:
            raise Unreadable
        return f"{self.result} := {STOP};"

    def _loop(self, s: StatementText, guard: str) -> str:
        (branch,) = s.branches
        assert branch.condition is not None
        condition = self.text[slice(*branch.condition)]
        jumps = {jump for inner in branch.body for jump in inner.leaves}
        before = ""
        if "break" in jumps:
            self._flags.setdefault("break", []).append(self._name(_TEST))
            before = f"{self._flags['break'][-1]} := false; "
        start = branch.condition[1] + 4
        if s.kind == "for":
            test, inner = self._still(jumps, guard) if jumps else ("", guard)
            inside = self.all(branch.body, start, branch.end, inner)
            made = f"{before}for{condition}loop{test}{inside}{self.text[branch.end : s.end]}"
        else:
            name = self._name(_TEST)
            terms = [*([guard] if guard else []), *(f"not {self._flags[j][-1]}" for j in sorted(jumps))]
            head = (
                f"for {WHILE}{name.rsplit('_', 1)[-1]} in 1:2 loop {name} := {' and '.join((*terms, ''))}({condition});"
            )
            inside = self.all(branch.body, start, branch.end, "")
            made = f"{before}{head}{inside}end for;{self._gap(branch.end, s.end)}"
        if "break" in jumps:
            self._flags["break"].pop()
        return made

    def _guarded(self, s: StatementText, guard: str) -> str:
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
