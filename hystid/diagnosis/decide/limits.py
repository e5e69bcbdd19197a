"""Laws at the ends of their parameters, where what bears one name acts as another law.

A contact without stiffness is a damper, a kink wider than the stroke a constant force, a mass on an overdamped spring
relaxation. Such a fit may be as good as any, and its name is wrong all the same. Which ends these are, each block
declares (``becomes``); here they are evaluated on a fit.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from hystid.consistency.force import EXPLAINED
from hystid.diagnosis.fit.hypothesis import Fit, Term, is_mass
from hystid.diagnosis.fit.problem import Problem
from hystid.diagnosis.model.channel_effects import ChannelEffect
from hystid.diagnosis.model.effects import Signals
from hystid.diagnosis.model.semantics import End
from hystid.numeric import Flags

TOUCHED = 4  # samples of some recording beyond the threshold of a law that does not act short of it
_MASSIVE = 0.99  # of the mass that an effect may take away: what is left moves
AT_END = 0.98  # of the end of the range that is tried: fits that want more end there
_SAMPLES_IN_LENGTH = 4.0  # samples at full speed that a length must span to be resolved,
_SHARE_OF_STROKE = 0.02  # or else this share of the stroke


def is_itself(problem: Problem, term: Term, signals: Sequence[Signals]) -> bool:
    """Whether a fitted law is what its name says, and not the end at which it is another one.

    signals: what the effect sees.
    """
    said = term.effect.semantics
    if is_mass(term.effect) and term.values[said.mass] <= -_MASSIVE * problem.baseline.mass:
        return False
    refused = (end for end in said.becomes if end.fit == "refused")
    return not any(is_reached(problem, term, end, signals) for end in refused)


def is_tail(term: Term, signals: Sequence[Signals], beyond: Sequence[Flags]) -> bool:
    """Whether a law that acts short of its threshold as well has most of the power of its force there: it is a curve
    without a place then, beside which a constant force makes up for the tail."""
    forces = term.effect.forces(signals, term.values)
    there = sum(float(f[flags] @ f[flags]) for f, flags in zip(forces, beyond, strict=True))
    return there < EXPLAINED * sum(float(f @ f) for f in forces)


def is_reached(problem: Problem, term: Term, end: End, signals: Sequence[Signals]) -> bool:
    """Whether a fitted law has come to an end of a parameter. signals: what the effect sees."""
    if end.unless == "hysteresis" and problem.baseline.has_h:
        return False
    value = term.values[end.of]
    if end.one_sided:
        return not _acts_both_ways(term, signals)
    if end.over:
        return (end.below is None or value < end.below) and not _carries(term, end, signals)
    if end.at:
        shape = next(shape for shape in term.effect.shapes if shape.name == end.of)
        low, high = term.effect.bounds(shape, problem.scales)
        return value >= AT_END * high if end.at == "top" else value <= low / AT_END
    unit = term.values[end.per] if end.per in term.values else _unit(problem, end.per)
    return value >= end.above * unit if end.above is not None else value < (end.below or 0.0) * unit


def blames_in_vain(problem: Problem, fit: Fit) -> bool:
    """Whether nothing but the force channel or the mass is blamed, and half of the force belongs to no motion still.

    Where inertia is large beside the force, a mass of next to nothing, or a channel that is cut off, leaves the force
    as it is and explains nearly all of the balance.
    """
    terms = fit.hypothesis.terms
    if not terms or not all(isinstance(term.effect, ChannelEffect) or is_mass(term.effect) for term in terms):
        return False
    force = problem.reduce([part.F - np.mean(part.F) for part in problem.parts])
    return bool(0.0 < (1.0 - EXPLAINED) * float(force @ force) < fit.rss)


def _unit(problem: Problem, per: str) -> float:
    """What an end is measured in, SI unit."""
    if per == "resolution":
        path = max(float(np.max(np.abs(part.v))) * part.dt for part in problem.parts)
        stroke = max(float(np.max(np.abs(part.x))) for part in problem.parts)
        return min(_SAMPLES_IN_LENGTH * path, _SHARE_OF_STROKE * stroke)
    tops = {"stroke": problem.scales.x, "speed": problem.scales.v}
    return float(tops[per][-1]) if per else 1.0


def _acts_both_ways(term: Term, signals: Sequence[Signals]) -> bool:
    """Whether the force of a law has either sign. Of two stops the motion may reach one alone, while the fit has moved
    the other one out of its way."""
    forces = term.effect.forces(signals, term.values)
    return all(max(np.count_nonzero(way * f > 0) for f in forces) >= TOUCHED for way in (1, -1))


def _carries(term: Term, end: End, signals: Sequence[Signals]) -> bool:
    """Whether all else gives more force than one parameter alone. A contact cannot pull: where its damping outweighs
    its stiffness it would, all the time that the bodies part, and is a damper that depends on the place."""
    alone = {name: 0.0 for name in term.effect.amplitudes if name != end.of}
    main, other = (
        sum(float(f @ f) for f in term.effect.forces(signals, {**term.values, **changed}))
        for changed in ({end.of: 0.0}, alone)
    )
    return main > other
