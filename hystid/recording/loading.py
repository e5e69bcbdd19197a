"""Recordings as a caller has them: in memory, or in files."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from pathlib import Path

from hystid.recording.reading import read_all
from hystid.recording.types import Recording

Source = str | Path | Recording
Sources = Source | Sequence[Source]


def loaded(sources: Sources, accept: Collection[str] = ()) -> list[Recording]:
    """The recordings of one source or several, in order; files are read by ``read_all``, which states the errors.

    accept: rules whose violation is a warning here and not an error.
    """
    listed = [sources] if isinstance(sources, str | Path | Recording) else list(sources)
    found: list[Recording] = []
    for source in listed:
        found += [source] if isinstance(source, Recording) else read_all([source], accept=accept)
    return found
