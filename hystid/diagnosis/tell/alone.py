"""What recordings say one by one: a parameter of the model that differs between them.

A contact that was tightened between two tests is no law of the structure, and no law explains both tests at once.
"""

from __future__ import annotations

import numpy as np

from hystid.diagnosis.fit.hypothesis import Fit
from hystid.diagnosis.fit.problem import Problem
from hystid.diagnosis.fit.search import try_fit

REST = 1.3  # residual over the noise beyond which an answer says that something is left
CLEAR = 10.0  # standard errors from which a difference is told


def changes(problem: Problem, before: Fit) -> list[str]:
    """A sentence on parameters that differ, where each recording agrees with the model by itself; [] elsewhere.

    before: the model fitted to all recordings together.
    """
    fits: list[Fit] = []
    for part in problem.parts:
        one = problem.of([part])
        made = try_fit(one, before.hypothesis) if len(problem.parts) > 1 else None
        if made is None or made.chi2 > REST**2 * one.floor(made):
            return []
        fits.append(made)
    told = [_values(problem, fits, name) for name in before.hypothesis.values if _differs(fits, name)]
    why = "the structure, or a channel, was changed between them"
    return [f"each recording by itself agrees with the model, but {'; '.join(told)}: {why}"] if told else []


def _differs(fits: list[Fit], name: str) -> bool:
    found = np.array([fit.hypothesis.values[name] for fit in fits])
    errors = np.array([fit.stderr(("base", name)) for fit in fits])
    apart = np.abs(found[:, None] - found) > CLEAR * np.hypot(errors[:, None], errors)
    return bool(np.any(apart))  # a value that is not known, its error no number, differs from none


def _values(problem: Problem, fits: list[Fit], name: str) -> str:
    """The values of a parameter in words."""
    unit = problem.baseline.units.get(name, "")
    pairs = zip(problem.parts, fits, strict=True)
    return f"{name} is " + ", ".join(f"{f.hypothesis.values[name]:.3g} {unit} in {p.name}" for p, f in pairs)
