"""Slow motion that no channel shows, where a structure was recorded by its velocity or acceleration alone.

A law of the place depends on it: a spring with a corner bends where the structure stands, and a contact that was pushed
to another place holds another force. What moves the structure there is the measured force, and the law itself says how
far.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
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
_TURNS = 10  # of fits to the motion of the fit before
_SETTLED = (
    0.01  # share of the displacement by which it moves in a last turn, and of its mean square by which a fit rises
)
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


def led_by(problem: Problem, laws: Sequence[Fit]) -> Led | None:
    """The problem with the slow motion of that law, of some, which leaves least then, fitted to it again; None where
    each of them leaves less without.

    Law and motion are found in turns, until the motion stays. A right law leads to the motion that it fits better;
    another one to motion that no channel shows either, but that bends its force in another way.
    """
    first = [led for law in laws if (led := _turn(problem, problem, law)) is not None]
    led = min(first, key=lambda led: led.fit.chi2, default=None)
    if led is None or not led.fit.hypothesis.terms:
        return led
    before: tuple[Problem, Problem] | None = None
    for _ in range(_TURNS):
        to = along(problem, led.problem, led.fit, led.octaves)
        there = to if before is None else _mixed(led.problem, to, *before)
        made = try_fit(there, led.fit.hypothesis)
        if made is None or made.chi2 > (1 + _SETTLED) * led.fit.chi2:
            break
        before, far = (led.problem, to), _apart(there, led.problem)
        led = Led(there, made, led.octaves)
        if np.linalg.norm(far) < _SETTLED * np.linalg.norm(_places(there)):
            break
    return led


def _mixed(at: Problem, to: Problem, at_before: Problem, to_before: Problem) -> Problem:
    """Motion between two turns, from which the next one would move least if all moved alike (Anderson 1965)."""
    step, further = _apart(to, at), _apart(to, at) - _apart(to_before, at_before)
    share = float(further @ step) / (float(further @ further) or 1.0)
    parts = [
        replace(new, x=new.x - share * (new.x - old.x), v=new.v - share * (new.v - old.v))
        for new, old in zip(to.parts, to_before.parts, strict=True)
    ]
    return _of(to, parts)


def _places(problem: Problem) -> Array:
    """Displacement of all recordings [m], one after the other."""
    return np.concatenate([part.x for part in problem.parts])


def _apart(one: Problem, other: Problem) -> Array:
    return _places(one) - _places(other)


def _of(problem: Problem, parts: Sequence[Part]) -> Problem:
    """The same problem on other motion, with the rows weighed down that are weighed down there."""
    made = problem.of(parts)
    if problem.weighed_by:
        made.distrust(*problem.weighed_by)
    return made


def _turn(problem: Problem, known: Problem, law: Fit) -> Led | None:
    """The slow motion of a law and its fit there, as many octaves up as it leaves less; None where it does not."""
    best: Led | None = None
    for octaves in range(_OCTAVES):
        there = along(problem, known, law, octaves)
        made = try_fit(there, law.hypothesis)
        if made is None or made.chi2 >= (best.fit if best is not None else law).chi2:
            break
        best = Led(there, made, octaves)
    return best


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
        known = _of(problem, [replace(part, F=own.F) for part, own in zip(moved, problem.parts, strict=True)])
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
