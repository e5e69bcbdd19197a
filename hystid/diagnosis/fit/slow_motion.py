"""Slow motion that no channel shows, where a structure was recorded by its velocity or acceleration alone.

A law of the place depends on it: a spring with a corner bends where the structure stands, and a contact that was pushed
to another place holds another force. What moves the structure there is the measured force, and the law itself says how
far.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from hystid.diagnosis.fit.hypothesis import Fit
from hystid.diagnosis.fit.problem import Problem
from hystid.diagnosis.fit.search import try_fit
from hystid.diagnosis.model.baseline import Baseline
from hystid.diagnosis.model.freerun import free_run
from hystid.diagnosis.prepare.segments import Part
from hystid.numeric import Array

_OCTAVES = 4  # above the lowest visible frequency in which noise may hide the motion: it falls by 12 dB in each
_TIMES = 3  # that the forces of effects are taken along the motion that they lead to, between two fits
_ROUNDS = 6  # of fits to the motion of the fit before
_SETTLED = 0.01  # share of its mean square by which a fit must fall for another round
Runs = Callable[[Part], Array | None]  # displacement (n,) of a free run under the measured force, where it is finite


@dataclass(frozen=True)
class Led:
    """A problem whose slow motion is that of a law, and the law as fitted there. octaves: how far above the lowest
    visible frequency the motion is that of the law, as noise is loud there."""

    problem: Problem
    fit: Fit
    octaves: int

    def told(self) -> str:
        """What was done, as a sentence."""
        below = 2**self.octaves * max(part.first_Hz for part in self.problem.parts if part.lowest)
        return f"x was not measured: motion below {below:.2g} Hz is what the model does under the measured force"


def is_blind(problem: Problem) -> bool:
    """Whether a structure moves under the measured force in a way that no channel shows."""
    return bool(problem.baseline.mass) and any(part.lowest for part in problem.parts)


def led_by(problem: Problem, law: Fit) -> Led | None:
    """The problem with the slow motion of a law, which is fitted to it again; None where the law leaves less without.

    Law and motion are found in turns. A right law leads to the motion that it fits better; another one to motion that
    no channel shows either, but that bends its force in another way.
    """
    here, found = problem, None
    fit = law
    for _ in range(_ROUNDS):
        best: Led | None = None
        for octaves in range(_OCTAVES):
            there = along(problem, here, fit, octaves)
            made = try_fit(there, fit.hypothesis)
            if made is None or made.chi2 >= (best.fit if best is not None else fit).chi2:
                break
            best = Led(there, made, octaves)
        if best is None:
            break
        settled = best.fit.chi2 > (1 - _SETTLED) * fit.chi2
        found, here, fit = best, best.problem, best.fit
        if settled:
            break
    return found


def along(problem: Problem, known: Problem, law: Fit, octaves: int) -> Problem:
    """The problem with the slow motion of a law. known: the same with the motion that is known so far.

    The baseline runs free under the measured force less that of the effects, along the motion that is known so far, and
    again along that to which they lead (Picard).
    """
    for _ in range(_TIMES if law.hypothesis.terms else 1):
        forces = effect_forces(known, law)
        parts = [replace(part, F=part.F - f) for part, f in zip(problem.parts, forces, strict=True)]
        runs = runs_of(problem.baseline, law)
        moved = [_led(part, runs(_begun(part)), octaves) if part.lowest else part for part in parts]
        known = problem.of([replace(part, F=own.F) for part, own in zip(moved, problem.parts, strict=True)])
        if problem.weighed_by:
            known.distrust(*problem.weighed_by)
    return known


def effect_forces(problem: Problem, law: Fit) -> list[Array]:
    """Force of the effects of a fit per recording [N]."""
    with_effects = problem.predicted(law.hypothesis)
    without = problem.predicted(replace(law.hypothesis, terms=()))
    return [one - other for one, other in zip(with_effects, without, strict=True)]


def runs_of(baseline: Baseline, fit: Fit) -> Runs:
    """Free runs of a baseline with the parameters of a fit."""
    values, delay = baseline.settings(fit.hypothesis.parameters()), fit.hypothesis.delay
    return lambda part: free_run(baseline.model, part, values, delay)


def _begun(part: Part) -> Part:
    """A part that begins at rest where it was: what is seen of the motion at the first sample lacks the slow part."""
    return part if part.past else replace(part, x=part.x - part.x[0], v=part.v - part.v[0])


def _led(part: Part, run: Array | None, octaves: int) -> Part:
    if run is None:
        return part
    slow = part.slow(run - part.x, octaves)
    return replace(part, x=part.x + slow, v=part.v + np.gradient(slow, part.dt))
