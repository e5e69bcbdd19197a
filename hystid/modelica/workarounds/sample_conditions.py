"""Several ``sample(...)``, written as ``(sample(...) or false)``.

What one clause with ``sample`` assigns may be read in another that ticks at other times; rumoca 0.10 refuses it as a
mixture of clocks unless the conditions are no bare samples.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence

from hystid.modelica.clauses import closing
from hystid.modelica.sources import Source
from hystid.modelica.workarounds.edits import Edit, edited

_SAMPLE = re.compile(r"(?<![\w.])sample\s*\(")
_WORD = re.compile(r"(\w+|\])\s*\Z")
_BEFORE_CALLS = frozenset(("when", "elsewhen", "and", "or", "not", "if", "elseif", "then", "else"))


def with_plain_samples(sources: Sequence[Source]) -> list[Source]:
    """The texts with such conditions rewritten; lines stay where they are."""
    several = sum(len(list(_calls(s.plain))) for s in sources) > 1
    return [edited(s, _samples(s.plain)) if several else s for s in sources]


def _samples(plain: str) -> Iterator[Edit]:
    for found in _calls(plain):
        end = closing(plain, found.end() - 1) + 1
        yield found.start(), found.start(), "("
        yield end, end, " or false)"


def _calls(plain: str) -> Iterator[re.Match[str]]:
    """Where the operator stands, and no component of that name: ``SampleTrigger sample(period = 1)``."""
    for found in _SAMPLE.finditer(plain):
        before = _WORD.search(plain[max(found.start() - 80, 0) : found.start()])
        if before is None or before.group(1) in _BEFORE_CALLS:
            yield found
