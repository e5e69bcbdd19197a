"""What the front end does not report about a class: its description and its default experiment."""

from __future__ import annotations

import math
import re

from hystid.errors import ModelicaError
from hystid.modelcode import Experiment
from hystid.modelica.sources import Declaration

_NUMBER = r"\s*=\s*([-+]?[0-9.]+(?:[eE][-+]?\d+)?)"


def experiment_of(declared: Declaration | None) -> Experiment:
    """The experiment annotation of a class, defaults where it states none.

    Raises ModelicaError where no run can be made of it.
    """
    found = list(re.finditer(r"\bexperiment\s*\(([^()]*)\)", declared.plain)) if declared else []
    default = Experiment()
    if not found:
        return default
    values = {key: float(value) for key, value in re.findall(rf"(\w+){_NUMBER}", found[-1].group(1))}
    start = values.get("StartTime", default.start)
    stop, step = values.get("StopTime", start + default.stop), values.get("Interval", default.step)
    if not (step > 0 and 0 <= (stop - start) / step < math.inf and values.get("Tolerance", 0.0) >= 0):
        raise ModelicaError(
            f"{declared}: no run follows from its annotation experiment({found[-1].group(1).strip()}): write a "
            "StopTime behind the StartTime, an Interval above 0, and no Tolerance below 0"
        )
    return Experiment(start, stop, step, values.get("Tolerance"))


def description_of(declared: Declaration | None) -> str:
    """The string behind a class's name, "" without one."""
    if declared is None:
        return ""
    found = re.match(r'(?:partial\s+)?\w+\s+\w+\s*"((?:\\.|[^"\\])*)"', declared.text)
    return re.sub(r"\\(.)", r"\1", found.group(1)) if found else ""
