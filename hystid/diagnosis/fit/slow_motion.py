"""Slow motion that no channel shows, where a structure was recorded by its velocity or acceleration alone.

A law of the place depends on it: a spring with a corner bends where the structure stands, and a contact that was pushed
to another place holds another force. What moves the structure there is the measured force, and the law itself says how
far.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from hystid.compiled import CompiledModel
from hystid.diagnosis.fit.extended import compiled_with, settings_of, skeleton_of
from hystid.diagnosis.fit.hypothesis import Fit
from hystid.diagnosis.fit.problem import Problem
from hystid.diagnosis.fit.search import try_fit
from hystid.diagnosis.fit.windows import for_recording
from hystid.diagnosis.model.baseline import Baseline
from hystid.diagnosis.model.freerun import free_run
from hystid.diagnosis.prepare.draws import Draw
from hystid.diagnosis.prepare.segments import Part
from hystid.numeric import Array

_OCTAVES = 4  # above the lowest visible frequency in which noise may hide the motion: it falls by 12 dB in each
_TURNS = 10  # of fits to the motion of the fit before
_SETTLED = 0.01  # share of the displacement by which the last turn moves it, and by which a fit may get worse
_TOLD = "x was not measured: motion"
Runs = Callable[[Part], Array | None]  # displacement (n,) of a free run under the measured force, where it is finite


@dataclass(frozen=True)
class SlowMotion:
    """A problem whose slow motion is that of a law, and the law as fitted there. octaves: how far above the lowest
    visible frequency the motion is that of the law, as noise is loud there. model: as in ``along``."""

    problem: Problem
    fit: Fit
    octaves: int
    model: CompiledModel | None = field(repr=False)

    def told(self, notes: Sequence[str]) -> tuple[str, ...]:
        """Notes with a sentence about the motion, and without one about other motion."""
        below = 2**self.octaves * max(part.first_Hz for part in self.problem.parts if part.lowest)
        others = (note for note in notes if not note.startswith(_TOLD))
        return *others, f"{_TOLD} below {below:.2g} Hz is what the model does under the measured force"


def lacks_slow_motion(problem: Problem) -> bool:
    """Whether a structure moves under the measured force in a way that no channel shows."""
    return bool(problem.baseline.mass) and any(part.lowest for part in problem.parts)


def slow_motion_of(problem: Problem, laws: Sequence[Fit]) -> SlowMotion | None:
    """The problem with the slow motion of that law, of some, which leaves least then, fitted to it again; None where
    each of them leaves less without.

    Law and motion are fitted in turns, until the motion stays.
    """
    first = [found for law in laws if (found := _first(problem, law, None)) is not None]
    if not first:
        law = min(laws, key=lambda law: law.chi2)
        model = compiled_with(skeleton_of(problem.baseline), law.hypothesis)
        first = [found] if model is not None and (found := _first(problem, law, model)) is not None else []
    found = min(first, key=lambda found: found.fit.chi2, default=None)
    if found is None or not found.fit.hypothesis.terms:
        return found
    before: tuple[Problem, Problem] | None = None
    for _ in range(_TURNS):
        to = along(problem, found.problem, found.fit, found.octaves, found.model)
        there = to if before is None else _mixed(found.problem, to, *before)
        made = try_fit(there, found.fit.hypothesis)
        if made is None or made.chi2 > (1 + _SETTLED) * found.fit.chi2:
            break
        before, far = (found.problem, to), _apart(there, found.problem)
        found = replace(found, problem=there, fit=made)
        if np.linalg.norm(far) < _SETTLED * np.linalg.norm(_places(there)):
            break
    return found


def settled_along(problem: Problem, law: Fit, octaves: int, model: CompiledModel | None) -> Problem:
    """The problem with the slow motion of a law that is known, until it stays."""
    known = problem
    for _ in range(_TURNS):
        to = along(problem, known, law, octaves, model)
        far, known = _apart(to, known), to
        if np.linalg.norm(far) < _SETTLED * np.linalg.norm(_places(to)):
            break
    return known


def _mixed(at: Problem, to: Problem, at_before: Problem, to_before: Problem) -> Problem:
    """Motion between two turns, from which the next one would move least if all moved alike (Anderson 1965)."""
    step, further = _apart(to, at), _apart(to, at) - _apart(to_before, at_before)
    share = float(further @ step) / (float(further @ further) or 1.0)
    parts = [
        replace(new, x=new.x - share * (new.x - old.x), v=new.v - share * (new.v - old.v))
        for new, old in zip(to.parts, to_before.parts, strict=True)
    ]
    return to.weighed(parts)


def _places(problem: Problem) -> Array:
    """Displacement of all recordings [m], one after the other."""
    return np.concatenate([part.x for part in problem.parts])


def _apart(one: Problem, other: Problem) -> Array:
    return _places(one) - _places(other)


def _first(problem: Problem, law: Fit, model: CompiledModel | None) -> SlowMotion | None:
    """The slow motion of a law and its fit there, as many octaves up as it leaves less; None where it does not."""
    known, best, fit = problem, None, law
    for octaves in range(_OCTAVES):
        there = along(problem, known, fit, octaves, model)
        made = try_fit(there, fit.hypothesis)
        if made is None or made.chi2 >= fit.chi2:
            break
        known, best, fit = there, SlowMotion(there, made, octaves, model), made
    return best


def along(problem: Problem, known: Problem, law: Fit, octaves: int, model: CompiledModel | None) -> Problem:
    """The problem with the slow motion of a law.

    model: the baseline with its effects runs under the measured force. Without one the baseline runs alone, under what
    the effects leave of that force along the motion that is known so far (Picard). That way does not need good
    parameters of the effects to begin with, but effects that are weak beside the baseline.
    """
    forces = _effect_forces(known, law) if model is None else [np.zeros(len(part)) for part in problem.parts]
    moved = [
        _with_slow(part, _run(problem.baseline, law, model, i)(_begun(replace(part, F=part.F - force))), octaves)
        if part.lowest
        else part
        for i, (part, force) in enumerate(zip(problem.parts, forces, strict=True))
    ]
    return problem.weighed([replace(part, F=own.F) for part, own in zip(moved, problem.parts, strict=True)])


def _effect_forces(problem: Problem, law: Fit) -> list[Array]:
    """Force of the effects of a fit per recording [N]."""
    with_effects = problem.predicted(law.hypothesis)
    without = problem.predicted(replace(law.hypothesis, terms=()))
    return [one - other for one, other in zip(with_effects, without, strict=True)]


def runs_of(baseline: Baseline, fit: Fit) -> Runs:
    """Free runs of a baseline with the parameters of a fit."""
    values, delay = baseline.settings(fit.hypothesis.parameters()), fit.hypothesis.delay
    return lambda part: free_run(baseline.model, part, values, delay)


def _run(baseline: Baseline, law: Fit, model: CompiledModel | None, index: int) -> Runs:
    if model is None:
        return runs_of(baseline, law)
    values = settings_of(skeleton_of(baseline), for_recording(law.hypothesis, index))
    return lambda part: free_run(model, part, values, law.hypothesis.delay)


def _begun(part: Part) -> Part:
    """A part that begins at rest where it was: what is seen of the motion at the first sample lacks the slow part."""
    return part if part.past else replace(part, x=part.x - part.x[0], v=part.v - part.v[0])


def _with_slow(part: Part, run: Array | None, octaves: int) -> Part:
    if run is None:
        return part
    x, v = _led(part, part.x, part.v, run, octaves)
    still = np.zeros_like(run)  # what noise hides of slow motion is gone: the law knows it

    def led(draw: Draw) -> Draw:
        motion = _led(part, draw[0].astype(float), draw[1].astype(float), still, octaves)
        return (*(u.astype(np.float32) for u in motion), *draw[2:])

    return replace(part, x=x, v=v, jitter=part.jitter.changed(led))


def _led(part: Part, x: Array, v: Array, run: Array, octaves: int) -> tuple[Array, Array]:
    """Displacement and velocity (n,) whose slow part is that of a free run."""
    slow = part.slow(run - x, octaves)
    return x + slow, v + np.gradient(slow, part.dt)
