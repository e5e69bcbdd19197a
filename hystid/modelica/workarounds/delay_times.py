"""``delay(u, 1)`` is written ``delay(u, 1.0*(1))``: rumoca 0.10 takes no Integer for the time."""

from __future__ import annotations

import re
from collections.abc import Iterator
from itertools import islice

from hystid.modelica.clauses import closing, parted
from hystid.modelica.sources import Source
from hystid.modelica.workarounds.edits import Edit, edited

_DELAY = re.compile(r"(?<![\w.])delay\s*\(")


def with_real_delays(source: Source) -> Source:
    """The text with such calls rewritten; lines stay where they are."""
    return edited(source, _times(source.plain))


def _times(plain: str) -> Iterator[Edit]:
    for found in _DELAY.finditer(plain):
        end = closing(plain, found.end() - 1)
        for start, stop in islice(parted(plain, found.end(), end), 1, None):
            yield start, start, "1.0*("
            yield stop, stop, ")"
