"""Annotations that the front end does not report: the default experiment of a class."""

from __future__ import annotations

import re
from collections.abc import Sequence

from hystid.modelcode import Experiment
from hystid.modelica.sources import Source, blanked

_NUMBER = r"\s*=\s*([-+]?[0-9.]+(?:[eE][-+]?\d+)?)"


def experiment_of(name: str, sources: Sequence[Source]) -> Experiment:
    """The experiment annotation of class ``name`` (its last part is looked for), defaults where it states none."""
    short = name.rsplit(".", 1)[-1]
    for source in sources:
        body = class_text(source.text, short)
        if body is None:
            continue
        found = list(re.finditer(r"\bexperiment\s*\(([^()]*)\)", body))
        if found:
            return _parse(found[-1].group(1))
        return Experiment()
    return Experiment()


def class_text(text: str, short: str) -> str | None:
    """Text of a class from its name to its ``end``, comments and strings blanked; None where it is not declared."""
    plain = blanked(text)
    start = re.search(rf"\b(?:model|block|class|package|function|connector|record|type)\s+{short}\b", plain)
    if not start:
        return None
    end = re.search(rf"\bend\s+{short}\s*;", plain[start.end() :])
    return plain[start.start() : start.end() + end.end()] if end else None


def _parse(text: str) -> Experiment:
    values = {key: float(value) for key, value in re.findall(rf"(\w+){_NUMBER}", text)}
    default = Experiment()
    return Experiment(
        start=values.get("StartTime", default.start),
        stop=values.get("StopTime", default.stop),
        step=values.get("Interval", default.step),
        tolerance=values.get("Tolerance"),
    )
