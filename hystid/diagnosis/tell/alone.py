"""What recordings say one by one: a parameter of the model, or a delay of the force, that differs between them.

A contact that was tightened between two tests is no law of the structure, and no law explains both tests at once.
Neither does one delay where two recorders were started by hand in each test.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from hystid.diagnosis.fit.hypothesis import Fit, Hypothesis
from hystid.diagnosis.fit.problem import Problem
from hystid.diagnosis.fit.search import try_fit

REST = 1.3  # residual over the noise beyond which an answer says that something is left
_DELAY = ("chain", "delay")
CLEAR = 10.0  # standard errors from which a difference is told
SKEW = 0.1  # samples from which a delay of the force that is no fault is told


def changes(problem: Problem, before: Fit) -> str:
    """A sentence on parameters that differ, where each recording agrees with the model by itself; "" elsewhere.

    before: the model fitted to all recordings together.
    """
    ones = [problem.of([part]) for part in problem.parts] if len(problem.parts) > 1 else []
    first = [_agreeing(one, before.hypothesis) for one in ones]
    fits = [fit for fit in first if fit is not None]
    if not fits or len(fits) < len(first):
        return ""
    best = min(fits, key=lambda fit: fit.chi2).hypothesis  # a law with corners may stand in a minimum of its own
    again = [_agreeing(one, replace(best, delay=fit.hypothesis.delay)) for one, fit in zip(ones, fits, strict=True)]
    fits = [fit if a is None or a.chi2 > fit.chi2 else a for fit, a in zip(fits, again, strict=True)]
    told = [_values(problem, fits, name) for name in before.hypothesis.values if _differs(fits, ("base", name))]
    told += [_delays(problem, fits)] if _differs(fits, _DELAY) else []
    why = "the structure, or a channel, was changed between them"
    return f"each recording by itself agrees with the model, but {'; '.join(told)}: {why}" if told else ""


def _agreeing(one: Problem, start: Hypothesis) -> Fit | None:
    """The model fitted to one recording, where it agrees; with a delay beyond those of every rig only if it must."""
    tried = (try_fit(one, replace(start, late=late)) for late in (False, True))
    return next((made for made in tried if made is not None and made.chi2 < REST**2 * one.floor(made)), None)


def _differs(fits: list[Fit], key: tuple[str, str]) -> bool:
    found = np.array([_found(fit, key) for fit in fits])
    errors = np.array([fit.stderr(key) for fit in fits])
    apart = np.abs(found[:, None] - found) > CLEAR * np.hypot(errors[:, None], errors)
    return bool(np.any(apart))  # a value that is not known, its error no number, differs from none


def _found(fit: Fit, key: tuple[str, str]) -> float:
    return fit.hypothesis.delay if key == _DELAY else fit.hypothesis.values[key[1]]


def _delays(problem: Problem, fits: list[Fit]) -> str:
    """By how much F is late in each recording, in words."""
    dt, late, timely = problem.parts[0].dt, [], []
    for part, fit in zip(problem.parts, fits, strict=True):
        delay = fit.hypothesis.delay
        side = "late" if delay > 0 else "early"
        if abs(delay) < SKEW:
            timely.append(part.name)
        else:
            late.append(f"{side} by {1e3 * abs(delay) * dt:.3g} ms in {part.name}")
    return "F is " + ", ".join([*late, *([f"on time in {' and '.join(timely)}"] if timely else [])])


def _values(problem: Problem, fits: list[Fit], name: str) -> str:
    """The values of a parameter in words."""
    unit = problem.baseline.units.get(name, "")
    pairs = zip(problem.parts, fits, strict=True)
    return f"{name} is " + ", ".join(f"{f.hypothesis.values[name]:.3g} {unit} in {p.name}" for p, f in pairs)
