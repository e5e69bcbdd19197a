"""Connections in an if-equation inside another one: the branches are written side by side.

rumoca 0.10 counts the equations of the inner branches and takes no connection for one ("else branch has 1 equations,
but if branch has 0")::

    if a then                       if (a) and (b) then
      if b then                       connect(u, v);
        connect(u, v);              elseif (a) then
      else                            v = 1;
        v = 1;                      else
      end if;                         v = 2;
    else                            end if;
      v = 2;
    end if;
"""

from __future__ import annotations

import re
from collections.abc import Iterator

from hystid.modelica.reach import Class, classes
from hystid.modelica.sources import Source
from hystid.modelica.workarounds.edits import Edit, edited
from hystid.modelica.workarounds.function_bodies import StatementText, Unreadable, statements_of

_SECTION = re.compile(r"(?<![\w.])(?:(?:initial\s+)?(?P<other>algorithm)|(?P<initial>initial\s+)?equation)\b")
_HEADS = {"if": "then", "when": "then", "for": "loop"}


def with_branches_side_by_side(source: Source) -> Source:
    """The text with such if-equations unfolded; lines behind them stay where they are."""
    if not re.search(r"\bconnect\b", source.plain):
        return source
    found = classes(source) or ()
    edits = [
        e for c in found if c.is_model and not c.short and not any(d.parent is c for d in found) for e in _edits(c)
    ]
    return edited(source, edits)


def _edits(owner: Class) -> Iterator[Edit]:
    plain = owner.source.plain
    for section in _SECTION.finditer(plain, owner.body, owner.tail):
        if section["other"] or section["initial"]:
            continue
        try:
            equations, _ = statements_of(plain, section.end(), _HEADS)
        except (Unreadable, ValueError):
            continue
        for e in equations:
            piece = owner.source.text[e.start : e.end]
            if e.kind != "if" or '"' in piece or not _nested(e, plain):
                continue
            made = _unfolded(e, plain)
            if made is not None:
                yield e.start, e.end, made + "\n" * plain.count("\n", e.start, e.end)


def _nested(e: StatementText, plain: str) -> bool:
    inner = [i for branch in e.branches for i in branch.body if i.kind == "if"]
    return any(re.search(r"\bconnect\s*\(", plain[i.start : i.end]) for i in inner)


def _unfolded(e: StatementText, plain: str) -> str | None:
    leaves = list(_leaves(e, plain))
    if len(leaves) > 64:
        return None
    text = ""
    for k, (condition, body) in enumerate(leaves):
        text += f"{'if' if k == 0 else 'elseif'} {condition} then {body} " if condition else f"else {body} "
    return f"{text}end if;"


def _leaves(e: StatementText, plain: str) -> Iterator[tuple[str, str]]:
    """Conditions and equations in order, the last condition "" where everything else is meant."""
    for branch in e.branches:
        condition = plain[slice(*branch.condition)].strip() if branch.condition else ""
        pending = [("", "")]
        for i in branch.body:
            if i.kind != "if":
                piece = " ".join(plain[i.start : i.end].split())
                pending = [(c, f"{t} {piece}") for c, t in pending]
                continue
            inner = [*_leaves(i, plain)]
            inner += [("", "")] if inner[-1][0] else []
            pending = [(_both(c, d), f"{t} {u}") for c, t in pending for d, u in inner]
        yield from ((_both(f"({condition})" if condition else "", c), t) for c, t in pending)


def _both(a: str, b: str) -> str:
    return f"{a} and ({b})" if a and b else a or b
