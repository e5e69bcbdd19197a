"""Algorithm sections as the front end hands them on: assertions with marks, see ``workarounds/model_algorithms.py``."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Protocol

from hystid.errors import ModelicaError
from hystid.modelica.expr import ONE, Expr, Num, Op, Ref
from hystid.modelica.flat import Equation, Place, Section, Statement
from hystid.modelica.inlining import assigned
from hystid.modelica.workarounds.model_algorithms import MARK

_MARK = re.compile(rf"{MARK}([a-z]+)(\d*) (\d+) ([\d+-]+)$")
Item = Mapping[str, Any]


class Reader(Protocol):
    """What is needed of the adapter."""

    def expr(self, node: Any) -> Expr:
        """An expression of the front end."""

    def at(self, item: Item) -> Place:
        """Where an equation stands; complaints about what is read next name it."""

    def level(self, node: Any) -> str:
        """Level of an assertion."""


class Carried:
    """assertions and chains: those of the author. sections: the algorithms, one for each instance of its class."""

    def __init__(self, reader: Reader, d: Item) -> None:
        self.reader = reader
        self._whens: dict[tuple[str, str], list[Item]] = {}
        self.chains = [c for c in d["when_chains"] if not self._took(c)]
        self.assertions: list[Item] = []
        self.sections = list(self._read(d["assert_equations"]))
        self._assigned = {name for s in self.sections for name in assigned(s.statements)}

    def others(self, equations: Sequence[Equation]) -> tuple[Equation, ...]:
        """The equations without those that only keep the count."""
        return tuple(e for e in equations if not self._counts(e))

    def _counts(self, e: Equation) -> bool:
        r = e.residual
        if not (isinstance(r, Op) and r.name == "-" and isinstance(r.args[0], Ref)):
            return False
        return r.args[0].name in self._assigned and r.args[1] in (r.args[0], Op("pre", (r.args[0],)))

    def _took(self, chain: Item) -> bool:
        """Whether a when-clause is one of a section, noted for it, or keeps the count."""
        marks = [_mark(item["Assert"]) for item in chain["first"]["equations"] if "Assert" in item]
        found = next((m for m in marks if m is not None), None)
        if found is not None and found[1] in ("when", "vector"):
            self._whens.setdefault((found[1] + found[2], found[3]), []).append(chain)
        return found is not None

    def _read(self, items: Sequence[Item]) -> Iterator[Section]:
        inside: list[Item] | None = None
        for item in items:
            mark = _mark(item)
            if mark is not None and mark[1] == "begin":
                inside = []
            elif mark is not None and mark[1] == "done":
                assert inside is not None
                statements, rest = self._statements(self._in_order(inside))
                assert not rest
                if statements:
                    yield Section(statements, statements[0].place)
                inside = None
            elif inside is not None:
                inside.append(item)
            else:
                self.assertions.append(item)

    def _in_order(self, items: Sequence[Item]) -> list[Item]:
        """The items as they follow each other, round by round of the loops around them."""
        rounds: dict[str, list[list[float]]] = {}
        keyed: list[tuple[list[float], Item]] = []
        here: list[float] = []
        for item in items:
            mark = _mark(item)
            if mark is None:
                keyed.append((here, item))
                continue
            path = re.split("[+-]", mark[4])
            if mark[1] == "at":
                rounds.setdefault(mark[4], []).append(self._indices(item))
                continue
            ways = [1.0 if way == "+" else -1.0 for way in re.findall("[+-]", mark[4])]
            at = rounds[mark[4]].pop(0) if ways else []
            here = []
            for loop, way, index in zip(path, ways, at, strict=False):
                here += [float(loop), way * index]
            here = [*here, float(path[-1])]
            if mark[1] != "check":
                keyed.append((here, item))
        return [item for _, item in sorted(keyed, key=lambda pair: pair[0])]

    def _indices(self, item: Item) -> list[float]:
        relation = self.reader.expr(item["condition"])
        assert isinstance(relation, Op) and isinstance(relation.args[0], Op)
        inside = relation.args[0].args[0]
        assert isinstance(inside, Op)
        return [float(n.value) for n in inside.args if isinstance(n, Num)]

    def _statements(self, items: list[Item]) -> tuple[tuple[Statement, ...], list[Item]]:
        """Statements up to the mark that ends them, and what follows."""
        made: list[Statement] = []
        while items:
            item, rest = items[0], items[1:]
            mark = _mark(item)
            if mark is not None and mark[1] in ("else", "elseif", "end"):
                return tuple(made), items
            if mark is None:
                made.append(self._assertion(item))
            elif mark[1] == "if":
                statement, rest = self._choice(items)
                made.append(statement)
            elif mark[1] == "when":
                made.append(self._when(self._whens["when" + mark[2], mark[3]].pop(0)))
            elif mark[1] == "vector":
                made.append(self._vector(item, self._whens["vector", mark[3]]))
            elif not (mark[1] == "out" and self._several(made, item, int(mark[2]))):
                made.append(self._assignment(item, mark[1]))
            items = rest
        return tuple(made), []

    def _assertion(self, item: Item) -> Statement:
        values = (self.reader.expr(item[k]) for k in ("condition", "message"))
        condition, message = values
        return Statement("assert", self.reader.at(item), (message,), condition, name=self.reader.level(item["level"]))

    def _relation(self, item: Item, of_several: bool = False) -> tuple[Expr, Expr]:
        """Target and value."""
        self.reader.at(item)
        relation = self.reader.expr(item["condition"])
        assert isinstance(relation, Op) and relation.name == "=="
        left, right = relation.args
        if isinstance(left, Op) and left.name == "sum" and isinstance(right, Op):
            left, right = left.args[0], right.args[0]
            left, right = (_bare(left), _bare(right)) if of_several else (left, right)
        return left, right

    def _vector(self, item: Item, chains: list[Item]) -> Statement:
        """An assignment to an array of Booleans: two conditions of when-clauses."""
        place = self.reader.at(item)
        target, value = (self.reader.expr(chains.pop(0)["first"]["condition"]) for _ in range(2))
        return Statement("assign", place, (target,), value)

    def _assignment(self, item: Item, kind: str) -> Statement:
        place = self.reader.at(item)
        target, value = self._relation(item, kind == "out")
        if kind == "out" and not (isinstance(value, Op) and value.name.startswith("call ")):
            raise ModelicaError(f"{place}: a list of outputs takes a function call")
        return Statement("assign", place, (target,), value)

    def _several(self, made: list[Statement], item: Item, which: int) -> bool:
        """Joins an output of a call to the statement that takes the first one, or begins such a statement."""
        place = self.reader.at(item)
        target, value = self._relation(item, of_several=True)
        last = made[-1] if made else None
        if last is not None and last.name == "outputs" and last.value == value and len(last.targets) <= which:
            targets = (*last.targets, *([None] * (which - len(last.targets))), target)
            made[-1] = Statement("assign", last.place, targets, value, name="outputs")
            return True
        if not (isinstance(value, Op) and value.name.startswith("call ")):
            return False
        targets = (*([None] * which), target)
        made.append(Statement("assign", place, targets, value, name="outputs"))
        return True

    def _choice(self, items: list[Item]) -> tuple[Statement, list[Item]]:
        branches: list[tuple[Expr, tuple[Statement, ...]]] = []
        place = self.reader.at(items[0])
        while True:
            mark = _mark(items[0])
            assert mark is not None
            if mark[1] == "end":
                return Statement("if", place, branches=tuple(branches)), items[1:]
            condition = ONE if mark[1] == "else" else self.reader.expr(items[0]["condition"])
            body, items = self._statements(items[1:])
            branches.append((condition, body))

    def _when(self, chain: Item) -> Statement:
        branches = []
        place = Place()
        for branch in [chain["first"], *chain["else_when"]]:
            place = self.reader.at(branch)
            condition = self.reader.expr(branch["condition"])
            branches.append((condition, tuple(self._in_when(branch["equations"]))))
        return Statement("when", place, branches=tuple(branches))

    def _in_when(self, items: Sequence[Item]) -> Iterator[Statement]:
        """A branch: assertions with marks, and what is set anew between them."""
        run: list[Item] = []
        for item in items:
            kind, body = next(iter(item.items()))
            if kind == "Assert":
                run.append({**body, "level": body.get("level")})
                continue
            yield from self._run(run)
            run = []
            if kind != "Reinit":
                raise ModelicaError(f"{self.reader.at(body)}: this statement in a when-clause is not supported")
            value = self.reader.expr(body["value"])
            yield Statement("reinit", self.reader.at(body), value=value, name=body["state"])
        yield from self._run(run)

    def _run(self, items: list[Item]) -> tuple[Statement, ...]:
        own = [i for i in items if (m := _mark(i)) is None or m[1] != "when"]
        statements, rest = self._statements(self._in_order(own))
        if rest:
            raise ModelicaError(f"{self.reader.at(rest[0])}: reinit() inside an if in an algorithm is not supported")
        return statements


def _bare(expr: Expr) -> Expr:
    """Without the brackets and the factor 1 that make a Real of an Integer."""
    while isinstance(expr, Op) and (expr.name in ("*", ".*") or (expr.name == "{}" and len(expr.args) == 1)):
        inner = expr.args[-1]
        if expr.name != "{}" and expr.args[0] != ONE:
            break
        expr = inner
    return expr


def _mark(item: Item) -> re.Match[str] | None:
    literal = item["message"].get("Literal") if isinstance(item["message"], dict) else None
    text = literal["value"].get("String") if literal else None
    return _MARK.match(text) if isinstance(text, str) else None
