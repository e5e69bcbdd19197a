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


def with_plain_samples(sources: Sequence[Source]) -> list[Source]:
    """The texts with such conditions rewritten; lines stay where they are."""
    several = sum(len(_SAMPLE.findall(s.plain)) for s in sources) > 1
    return [edited(s, _samples(s.plain)) if several else s for s in sources]


def _samples(plain: str) -> Iterator[Edit]:
    for found in _SAMPLE.finditer(plain):
        end = closing(plain, found.end() - 1) + 1
        yield found.start(), found.start(), "("
        yield end, end, " or false)"
