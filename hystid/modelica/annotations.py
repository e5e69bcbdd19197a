"""What the front end does not report about a class: its description and its default experiment."""

from __future__ import annotations

import re

from hystid.modelcode import Experiment
from hystid.modelica.sources import Declaration

_NUMBER = r"\s*=\s*([-+]?[0-9.]+(?:[eE][-+]?\d+)?)"


def experiment_of(declared: Declaration | None) -> Experiment:
    """The experiment annotation of a class, defaults where it states none."""
    found = list(re.finditer(r"\bexperiment\s*\(([^()]*)\)", declared.plain)) if declared else []
    if not found:
        return Experiment()
    values = {key: float(value) for key, value in re.findall(rf"(\w+){_NUMBER}", found[-1].group(1))}
    default = Experiment()
    return Experiment(
        start=values.get("StartTime", default.start),
        stop=values.get("StopTime", default.stop),
        step=values.get("Interval", default.step),
        tolerance=values.get("Tolerance"),
    )


def description_of(declared: Declaration | None) -> str:
    """The string behind a class's name, "" without one."""
    if declared is None:
        return ""
    found = re.match(r'(?:partial\s+)?\w+\s+\w+\s*"((?:\\.|[^"\\])*)"', declared.text)
    return re.sub(r"\\(.)", r"\1", found.group(1)) if found else ""
