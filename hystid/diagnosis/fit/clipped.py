"""A force channel that stops at a level: it lacks what mass and law say beyond it.

No other channel shows the force. What the refit says where the force is near its top must come from the samples below,
as the level would bend a refit of all samples. A law that yields holds the force as well, but for the inertia: where
that changes and the force does not, it is the channel.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.stats import norm

from hystid.consistency.cut_off import BELOW
from hystid.diagnosis.fit.hypothesis import Fit, Hypothesis
from hystid.diagnosis.fit.problem import Problem, standing
from hystid.diagnosis.fit.search import complement, try_fit
from hystid.diagnosis.model.channel_effects import Saturation, saturation
from hystid.diagnosis.prepare.clipping import DEEP, STAYS, beyond, level_of, near_top
from hystid.diagnosis.prepare.faults import SATURATION, Fault
from hystid.diagnosis.prepare.pairs import CHANCE
from hystid.diagnosis.prepare.segments import Flags, Part
from hystid.numeric import Array, stretches

_LEAST_BELOW = 400  # samples below the top that can lead a refit


def clipped_force(problem: Problem, baseline: Fit) -> list[Saturation]:
    """The force that the channel lacks beyond its level, as an effect; [] where it does not stop.

    Samples that are not valid say nothing: where an exact level was found before, these are its own.
    """
    if not problem.baseline.mass:
        return []
    noise = max(part.noise["F"] for part in problem.parts)
    near = near_top([part.F for part in problem.parts], noise)
    if near is None or _level(problem, baseline.hypothesis) is None:
        return []
    kept = [_valid(part) & ~gap for part, gap in zip(problem.parts, near, strict=True)]
    if sum(map(np.count_nonzero, kept)) < _LEAST_BELOW:
        return []
    below = problem.of([replace(part, valid=valid) for part, valid in zip(problem.parts, kept, strict=True)])
    made = try_fit(below, baseline.hypothesis, 25)
    level = _level(problem, made.hypothesis) if made is not None else None
    if made is None or level is None:
        return []
    if level < max(float(np.max(np.abs(part.F))) for part in problem.parts) - BELOW * noise:
        return []  # a channel goes no further than where it stops, but for its noise
    told = _told(problem, made.hypothesis)
    missing = [np.sign(one) * np.maximum(np.abs(one) - level, 0.0) for one in told]
    return [saturation([part.x for part in problem.parts], missing, level)]


def below_level(parts: Sequence[Part], level: float) -> tuple[list[Part], Fault]:
    """Parts without the samples at which the force channel stands at a level [N], as far as noise tells, and that level
    as a fault of the channel."""
    at, noise = _at(parts, level)
    made = [replace(p, valid=_valid(p) & ~there) if np.any(there) else p for p, there in zip(parts, at, strict=True)]
    count = sum(map(np.count_nonzero, at))
    return made, Fault(SATURATION, "F", level, noise / np.sqrt(max(count, 1)), count / sum(map(len, parts)))


def _at(parts: Sequence[Part], level: float) -> tuple[list[Flags], float]:
    """Samples at which the force channel stands at a level [N], as far as noise tells, and that noise."""
    noise = max(part.noise["F"] for part in parts)
    return [np.abs(part.F) > level - BELOW * noise for part in parts], noise


def force_stays(problem: Problem, hypothesis: Hypothesis, level: float) -> bool:
    """Whether the force itself stays at a level [N] at which its channel does: that of dry friction, or of an amplifier
    that can give no more.

    The slopes on either side say how far a force would go on, as a parabola. The balance lacks all of that where the
    channel is cut off, and none of it where the force stays.
    """
    at, noise = _at(problem.parts, level)
    parts = [replace(part, valid=_valid(part) | there) for part, there in zip(problem.parts, at, strict=True)]
    whole = problem.of(parts)
    fitted = standing(whole, hypothesis)
    outside = complement(whole, fitted)
    gone = [_beyond(part.F, there) for part, there in zip(parts, at, strict=True)]
    column = outside(whole.reduce([np.sign(one) * np.maximum(np.abs(one) - BELOW * noise, 0.0) for one in gone]))
    power = float(column @ column)
    if not power:
        return False
    lacking, error = -float(column @ outside(fitted.residual)) / power, float(np.sqrt(max(fitted.chi2, 1.0) / power))
    return bool(lacking + float(norm.isf(CHANCE / 2)) * error < STAYS)


def _beyond(force: Array, at: Flags) -> Array:
    """How far a force (n,) [N] goes on from where it comes near a level, 0 elsewhere."""
    lacking = np.zeros_like(force)
    for first, last in stretches(at):
        if first > 0 and last < len(force):
            lacking[first:last] = beyond(force, first, last)
    return lacking


def _told(problem: Problem, hypothesis: Hypothesis) -> list[Array]:
    """The force that mass and law say, by the smoothed motion [N]."""
    mass = hypothesis.mass()
    return [mass * part.a + force for part, force in zip(problem.parts, problem.predicted(hypothesis), strict=True)]


def error_of(problem: Problem, hypothesis: Hypothesis, told: Sequence[Array]) -> float:
    """Standard error of the force that mass and law say, told, (n,) per part [N]: what noise of the motion does to it,
    and all that it leaves of the force where no channel shows the motion."""
    moved = next(problem.moved(hypothesis))
    errors = [hypothesis.mass() * p.jitter[0][2] + force for p, force in zip(problem.parts, moved, strict=True)]
    unseen = [p.slow(p.F - one) if p.lowest else np.zeros_like(one) for p, one in zip(problem.parts, told, strict=True)]
    return float(np.hypot(np.std(np.concatenate(errors)), np.std(np.concatenate(unseen))))


def _valid(part: Part) -> Flags:
    return np.ones(len(part), dtype=bool) if part.valid is None else part.valid


def _level(problem: Problem, hypothesis: Hypothesis) -> float | None:
    """Level at which the force channel stops [N]; None where it does not, or where a law may hold the force."""
    mass = hypothesis.mass()
    told = [np.where(_valid(p), one, 0.0) for p, one in zip(problem.parts, _told(problem, hypothesis), strict=True)]
    found = level_of([part.F for part in problem.parts], told, error_of(problem, hypothesis, told))
    if found is None:
        return None
    inertia = np.concatenate(
        [mass * part.a[np.abs(one) > found[0]] for part, one in zip(problem.parts, told, strict=True)]
    )
    noise = max(part.noise["F"] for part in problem.parts)
    return found[0] if float(np.std(inertia)) > DEEP * noise else None
