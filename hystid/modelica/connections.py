"""Where connections are written: the front end gives their equations the line of a connected variable."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from hystid.modelica.flat import Place
from hystid.modelica.sources import Source

_CLAUSE = re.compile(r"(?<![\w.])connect\s*\(([^,;]*),([^;]*?)\)\s*(?:annotation\b|;)")
_FLOW = re.compile(r"[+-]|=")
_DEEPEST = 3  # parts of a name behind the connector's own: plug.pin[1].v of a plug


class Connections:
    """The connect-clauses of some texts, by what they connect."""

    def __init__(self, sources: Sequence[Source]) -> None:
        self._clauses: dict[frozenset[str], tuple[Source, int]] = {}
        for source in sources:
            for found in _CLAUSE.finditer(source.plain):
                ends = frozenset(_bare(found.group(k)) for k in (1, 2))
                self._clauses.setdefault(ends, (source, found.start()))

    def place(self, origin: Mapping[str, Any]) -> Place | None:
        """The clause that an equation comes from, a wrong one of equal words maybe; None where there is none."""
        for a, b in _pairs(origin):
            for ends in _ends(_bare(a).split("."), _bare(b).split(".")):
                if ends in self._clauses:
                    source, at = self._clauses[ends]
                    return Place(str(source.path), source.line(at))
        return None


def is_connection(origin: Any) -> bool:
    """Whether the front end says that an equation comes from connections."""
    return isinstance(origin, dict) and ("Connection" in origin or "FlowSum" in origin)


def _bare(name: str) -> str:
    """Without subscripts and spaces."""
    return re.sub(r"\[[^\]]*\]|\s", "", name)


def _pairs(origin: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    """Names that may be connected with each other directly."""
    if "Connection" in origin:
        yield origin["Connection"]["lhs"], origin["Connection"]["rhs"]
        return
    names = [n.strip() for n in _FLOW.split(re.sub(r"\[[^\]]*\]", "", origin["FlowSum"]["description"]))]
    named = [n for n in names if n and not n[0].isdigit()]
    yield from ((a, b) for k, a in enumerate(named) for b in named[k + 1 :])


def _ends(a: Sequence[str], b: Sequence[str]) -> Iterator[frozenset[str]]:
    """What a clause may call two variables: without the components around both, without the parts of a connector."""
    common = 0
    while common < min(len(a), len(b)) - 2 and a[common] == b[common]:
        common += 1
    for around in range(common, -1, -1):
        for cut in range(1, _DEEPEST + 1):
            left, right = a[around : len(a) - cut], b[around : len(b) - cut]
            if left and right:
                yield frozenset((".".join(left), ".".join(right)))
