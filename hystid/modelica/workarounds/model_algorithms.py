"""Algorithm sections of models, written as what the front end hands on.

rumoca 0.10 takes few of them and none as statements. Its assertions pass through unchanged, so each statement becomes
one, with a message that says what it stands for; ``when`` and ``for`` stay what they are::

    algorithm                         equation
      s := 0;                           assert(s == (0), "hystid-set 7 ..");
      if x > 1 then                     assert((x > 1), "hystid-if 7 ..");
        s := 2*x;                       assert(s == (2*x), "hystid-set 7 ..");
      end if;                           assert(true, "hystid-end 7 ..");
                                        s = s;

The last line keeps the count of equations; the adapter takes it away and puts the section in its place.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence
from itertools import count

from hystid.modelica.clauses import Clause, clauses, closing, next_mark, parted
from hystid.modelica.reach import Class, classes
from hystid.modelica.sources import Source
from hystid.modelica.workarounds.edits import Edit, edited
from hystid.modelica.workarounds.function_bodies import Unreadable, until, word_at

MARK = "hystid-"
_SECTION = re.compile(r"(?<![\w.])(initial\s+)?(algorithm|equation)\b")
_TARGET = re.compile(r"\s*([A-Za-z_]\w*(?:\s*\.\s*[A-Za-z_]\w*)*)\s*(\[)?")
_RANGE = re.compile(r"(\w+)\s+in\s+[^:{}]+(?::\s*(?:(-)[^:{}]*|\d+)\s*)?:[^:{}]+", re.DOTALL)
_PREFIXES = frozenset(("input", "output", "flow", "stream", "discrete"))
_BASE = re.compile(r"\s*=?\s*(?:(?:input|output)\s+)?([A-Za-z_][\w.]*)")  # of a short class
_BUILT_IN = ("Real", "Integer", "Boolean", "String")


def with_carried_algorithms(sources: Sequence[Source]) -> list[Source]:
    """The texts with algorithm sections in this form; lines stay where they are. What is not understood stays."""
    if not any(re.search(r"\balgorithm\b", s.plain) for s in sources):
        return list(sources)
    types = Types([c for s in sources for c in classes(s) or ()])
    numbers = count(1)
    return [edited(s, _edits(s, classes(s) or (), types, numbers)) for s in sources]


def _edits(source: Source, found: Sequence[Class], types: Types, numbers: Iterator[int]) -> Iterator[Edit]:
    for owner in found:
        if not owner.is_model or owner.short:
            continue
        plain = _own(owner, found)
        for start in _SECTION.finditer(plain, owner.body, owner.tail):
            if start[1] or start[2] == "equation":
                continue
            writer = _Writer(source.text, plain, owner, types, next(numbers))
            try:
                body, end = writer.section(start.end())
            except Unreadable:
                continue
            yield start.start(), end, f"equation{body}"


def _own(owner: Class, found: Sequence[Class]) -> str:
    """The text with nested classes blanked, offsets kept."""
    plain = owner.source.plain
    for inner in (c for c in found if c.parent is owner):
        plain = plain[: inner.front] + re.sub(r"[^\n]", " ", plain[inner.front : inner.end]) + plain[inner.end :]
    return plain


class Types:
    """What a name in a class is declared as, bases included."""

    def __init__(self, found: Iterable[Class]) -> None:
        self._by_name: dict[str, list[Class]] = {}
        for c in found:
            self._by_name.setdefault(c.name, []).append(c)

    def of(self, name: str, owner: Class) -> tuple[str, bool, bool]:
        """Predefined type, whether it is an array, whether it is declared discrete; Real where that is not found."""
        first, *rest = re.sub(r"\s", "", name).split(".")
        clause = self.declared(first, owner)
        if clause is None:
            return "Real", False, False
        if rest:
            inner = self._class(clause.target, clause.owner)
            return self.of(".".join(rest), inner) if inner is not None else ("Real", False, False)
        return self.built_in(clause), bool(clause.sizes), "discrete" in clause.prefixes

    def items(self, name: str, owner: Class, depth: int = 0) -> int:
        """How many literals the enumeration of a variable (also a component's) or of a literal has; 0 without one."""
        first, _, rest = re.sub(r"\s", "", name).partition(".")
        clause = self.declared(first, owner)
        inner = self._class(clause.target, clause.owner) if clause is not None and rest else None
        if inner is not None and depth < 20:
            return self.items(rest, inner, depth + 1)
        typed, scope = (name.rpartition(".")[0], owner) if clause is None else (clause.target, clause.owner)
        root, made = self._root(typed, scope)
        if root != "enumeration" or made is None:
            return 0
        plain, opening = made.source.plain, made.source.plain.index("(", made.body)
        return plain.count(",", opening, closing(plain, opening)) + 1

    def member(self, name: str, clause: Clause) -> Clause | None:
        """The declaration of a name in the type of a component."""
        inner = self._class(clause.target, clause.owner)
        return None if inner is None else self.declared(name, inner)

    def is_record(self, clause: Clause) -> bool:
        """Whether a component is a record."""
        inner = self._class(clause.target, clause.owner)
        return inner is not None and inner.kind == "record"

    def declared(self, name: str, owner: Class, depth: int = 0) -> Clause | None:
        """The declaration of a simple name in a class or its bases."""
        made = clauses(owner)
        for c in made:
            if c.kind == "component" and c.name == name:
                return c
        for c in made:
            base = self._class(c.target, owner) if c.kind in ("extends", "short") and depth < 20 else None
            if base is not None and (inherited := self.declared(name, base, depth + 1)) is not None:
                return inherited
        return None

    def _class(self, name: str, scope: Class) -> Class | None:
        """The class of a name, by its last parts; one that is declared nearer comes first."""
        parts = re.sub(r"\s", "", name).split(".")
        around = [*scope.around()]

        def fits(c: Class) -> int:
            path = [a.name for a in c.around()][::-1]
            return sum(a == b for a, b in zip(path[::-1], parts[::-1], strict=False)) + (c.parent in around)

        named = [c for c in self._by_name.get(parts[-1], ()) if c is not scope]
        return max(named, key=fits, default=None)

    def built_in(self, clause: Clause) -> str:
        """The predefined type of a component."""
        root, _ = self._root(clause.target, clause.owner)
        return "Integer" if root == "enumeration" else root or "Real"

    def _root(self, name: str, scope: Class) -> tuple[str, Class | None]:
        """What a type is in the end, a predefined one or "enumeration" ("" for neither), and the class that says so."""
        made: Class | None = None
        for _ in range(20):
            if name in (*_BUILT_IN, "enumeration"):
                return name, made
            made = self._class(name, made or scope)
            base = _BASE.match(made.source.plain, made.body, made.end) if made is not None and made.short else None
            if base is None:
                break
            name = base[1]
        return "", None


class _Writer:
    """One section."""

    def __init__(self, text: str, plain: str, owner: Class, types: Types, number: int) -> None:
        self.text, self.plain = text, plain
        self.owner, self.types, self.number = owner, types, number
        self.whens = 0
        self.inside = 0  # of how many if-statements
        self.numbers = count(1)
        self.loops: list[tuple[int, str, str]] = []  # number, direction and index of the loops around
        self.assigned: dict[str, bool] = {}  # whether in a when-clause

    def section(self, at: int) -> tuple[str, int]:
        """The equations, and the offset behind the section."""
        body, end = self.statements(at, False)
        word, _ = word_at(self.plain, end)
        if word not in ("end", "equation", "algorithm", "initial", "public", "protected", "annotation", "external"):
            raise Unreadable
        if not self.assigned and not body.strip():
            return body, end
        kept = " ".join(self._kept(name, clocked) for name, clocked in self.assigned.items())
        tail = re.search(r"\s*\Z", body)
        gap = tail.group() if tail else ""
        return f" {self.mark('begin')} {body.rstrip()} {self.mark('done')} {kept}{gap}", end

    def mark(self, what: str, condition: str = "true") -> str:
        """An assertion that stands for something.

        The front end writes a loop out statement by statement, not round by round; each statement says where it is.
        """
        number = next(self.numbers)
        path = "".join(f"{loop}{way}" for loop, way, _ in self.loops)
        made = f'assert({condition}, "{MARK}{what} {self.number} {path}{number}");'
        if not self.loops:
            return made
        indices = ", ".join(index for _, _, index in self.loops)
        return f'assert(sum({{{indices}}}) == 0, "{MARK}at {self.number} {path}{number}"); {made}'

    def _kept(self, name: str, clocked: bool) -> str:
        """As many equations as the section assigns."""
        kind, _, discrete = self.types.of(name, self.owner)
        if kind == "String":
            raise Unreadable
        if kind != "Real":
            return f"{name} = pre({name});"
        if clocked or discrete:
            return f"when initial() then {name} = pre({name}); {self.mark('kept')} end when;"
        return f"{name} = {name};"

    def statements(self, at: int, clocked: bool) -> tuple[str, int]:
        """Statements up to what ends them, and the offset of that."""
        made = []
        while True:
            word, start = word_at(self.plain, at)
            made.append(self._gap(at, start))
            if word in ("end", "else", "elseif", "elsewhen", "equation", "algorithm", "initial", "annotation"):
                return "".join(made), start
            if word in ("public", "protected", "external") or start >= len(self.plain):
                return "".join(made), start
            text, at = self._statement(word, start, clocked)
            made.append(text)

    def _gap(self, start: int, end: int) -> str:
        return "\n" * self.plain.count("\n", start, end) or " "

    def _statement(self, word: str, start: int, clocked: bool) -> tuple[str, int]:
        if word == "if":
            return self._choice(start, clocked)
        if word == "for":
            return self._loop(start, clocked)
        if word == "when":
            if clocked or self.loops or self.inside:
                raise Unreadable  # the language has none there
            return self._when(start)
        if word in ("while", "return", "break", "terminate"):
            raise Unreadable
        end = until(self.plain, ";", start) + 1
        if word in ("assert", "reinit"):
            if self.loops:
                raise Unreadable
            return (self.mark("check") if word == "assert" else "") + self.text[start:end], end
        return self._simple(start, end, clocked), end

    def _simple(self, start: int, end: int, clocked: bool) -> str:
        at = self.plain.find(":=", start, end)
        if at < 0:
            name = re.match(r"[\w.]+", self.plain[start:end])
            if name and re.search(r"(?:^|\.)(?:error|exit|readline\w*)$", name.group()):
                raise Unreadable
            return self._gap(start, end)  # prints, or asserts in a function: nothing follows from it
        value = self.text[at + 2 : end - 1].strip()
        if self.plain[start] == "(":
            return self._several(start, value, clocked)
        return self._set(self.text[start:at].strip(), value, "set", clocked)

    def _set(self, target: str, value: str, what: str, clocked: bool) -> str:
        found = _TARGET.match(target)
        if found is None:
            raise Unreadable
        name = re.sub(r"\s", "", found[1])
        rest = target[closing(target, found.end() - 1) + 1 :].strip() if found[2] else target[found.end() :].strip()
        if rest:
            raise Unreadable  # a component of an array of components
        self.assigned[name] = self.assigned.get(name, False) or clocked
        kind, array, _ = self.types.of(name, self.owner)
        whole = array and (not found[2] or ":" in target)
        if whole and kind == "Boolean":  # no relation takes it, and conditions of when-clauses do
            if clocked or self.loops or what != "set":
                raise Unreadable
            kept = (f"when {side} then {self.mark('vector')} end when;" for side in (target, value))
            return f"{self.mark('vector')} {' '.join(kept)}"
        relation = f"sum({target}) == sum({value})" if whole else f"{target} == ({value})"
        if what != "set" and kind == "Integer":  # the first output of the call may be a Real
            side = target if whole else f"{{{target}}}"
            relation = f"sum(1.0*{side}) == sum({{1.0*({value})}})"
        return self.mark(what, relation)

    def _several(self, start: int, value: str, clocked: bool) -> str:
        """(a, , c) := f(...): the call with the first output that is taken, then the other outputs."""
        parts = parted(self.plain, start + 1, closing(self.plain, start))
        names = [self.text[here:stop].strip() for here, stop in parts]
        return " ".join(self._set(name, value, f"out{k}", clocked) for k, name in enumerate(names) if name)

    def _choice(self, at: int, clocked: bool) -> tuple[str, int]:
        made = []
        self.inside += 1
        word = "if"
        while word != "end":
            behind = at + len(word)
            if word == "else":
                made.append(self.mark("else"))
            else:
                close = until(self.plain, "then", behind)
                made.append(self.mark(word, f"({self.text[behind:close].strip()})") + self._gap(behind, close))
                behind = close + 4
            body, end = self.statements(behind, clocked)
            made.append(body)
            word, at = word_at(self.plain, end)
            if word not in ("end", "else", "elseif"):
                raise Unreadable
        self.inside -= 1
        return " ".join([*made, self.mark("end")]), self.plain.index(";", at) + 1

    def _loop(self, at: int, clocked: bool) -> tuple[str, int]:
        """Each index makes a loop of its own."""
        close = until(self.plain, "loop", at)
        before = len(self.loops)
        heads = []
        here = at + 3
        while here <= close:
            stop = next_mark(self.plain, here, close, ",")
            found = _RANGE.fullmatch(self.plain[here:stop].strip())
            if found is None:
                raise Unreadable
            self.loops.append((next(self.numbers), "-" if found[2] else "+", found[1]))
            heads.append(f"for {self.text[here:stop].strip()} loop{self._gap(here, stop)}")
            here = stop + 1
        body, end = self.statements(close + 4, clocked)
        del self.loops[before:]
        return f"{' '.join(heads)}{body} {'end for; ' * len(heads)}", self.plain.index(";", end) + 1

    def _when(self, at: int) -> tuple[str, int]:
        self.whens += 1
        mine = f"when{self.whens}"
        made = [self.mark(mine)]
        word = "when"
        while word != "end":
            close = until(self.plain, "then", at + len(word))
            body, end = self.statements(close + 4, True)
            made.append(f"{self.text[at:close]}then {self.mark(mine)} {body}")
            word, at = word_at(self.plain, end)
            if word not in ("end", "elsewhen"):
                raise Unreadable
        return " ".join([*made, "end when;"]), self.plain.index(";", at) + 1
