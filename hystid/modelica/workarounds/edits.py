"""Changes of a text: from one offset to another, by a new piece."""

from __future__ import annotations

from collections.abc import Iterable

from hystid.modelica.sources import Source

Edit = tuple[int, int, str]


def edited(source: Source, edits: Iterable[Edit]) -> Source:
    """The text after the edits, which do not overlap; the same object without any."""
    wanted = sorted(set(edits), reverse=True)
    text = source.text
    for start, end, new in wanted:
        text = text[:start] + new + text[end:]
    return Source(source.path, text) if wanted else source
