"""Laws at the limit of their parameters, where what bears one name acts as another law.

A contact without stiffness is a damper, a kink wider than the stroke a constant force, a mass on an overdamped spring
relaxation. Such a fit may be as good as any, and its name is wrong all the same. And laws that are the same, up to a
refit or in these recordings: where one of them was not tried, nothing tells it from the other.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from hystid.diagnosis.fit.problem import ADDED_MASS, Problem, Term
from hystid.diagnosis.model.effects import Signals, shape_bounds

Array = NDArray[np.float64]
IMPACT, CONTACT_LOSS, TWO_SIDED_STOP = "impact", "contact_loss", "two_sided_stop"
_HIDDEN, _RELAXATION, _STIFFENING = "hidden_mode", "viscoelastic_relaxation", "stiffness_drift"
COULOMB, STRIBECK = "coulomb_friction", "stribeck_friction"
_BEYOND, _LASTS = 2.0, 0.2  # turns within which friction falls, and share of the fall that is left at high speed
_KINKED = frozenset({"bilinear_stiffness", CONTACT_LOSS})
_AT = 0.98  # of the highest frequency that is tried, and of the largest weighing error: fits that want more end there
_MASSIVE = 0.99  # of the mass that an effect may take away: what is left moves
_CRITICAL = 1.0  # damping ratio from which nothing resonates
_SURE = 4.0  # standard errors by which the mass lies beyond what weighing explains,
_WORTH = 0.01  # and fall of the mean square that it is worth: less is what the form of an effect leaves
_STRETCHES, _FOLLOWS = 10, 0.9  # stretches of a recording, and rank correlation of stiffness and frequency over them


def is_itself(problem: Problem, term: Term, signals: Sequence[Signals]) -> bool:
    """Whether a fitted law is what its name says, and not the limit in which it is another one.

    signals: what the effect sees.
    """
    effect, values = term.effect, term.values
    if effect.id == ADDED_MASS:  # what moves in the end has a mass
        return values[effect.amplitudes[0]] > -_MASSIVE * problem.baseline.mass
    if effect.id == IMPACT:
        return _carries(term, signals)
    if effect.id in _KINKED and values.get("w", 0.0) >= float(problem.scales.x[-1]):
        return not _presses_at_rest(term)  # then it is next to a constant force; else it is half of a square
    if effect.id == _HIDDEN:
        return values.get("zeta", 0.0) < _CRITICAL and _is_in_band(problem, term)
    return True


def _presses_at_rest(term: Term) -> bool:
    """Whether the force is not zero at rest."""
    still = np.zeros(3)
    return bool(np.any(term.effect.force(Signals(still, still, still, still, 1.0), term.values)))


def _carries(term: Term, signals: Sequence[Signals]) -> bool:
    """Whether the stiffness of a contact gives more force than its damping. A contact cannot pull: where damping
    outweighs stiffness it would, all the time that the bodies part, and is a damper that depends on the place."""
    if not {"k", "c"} <= set(term.values):
        return True
    elastic, lossy = (
        sum(float(f @ f) for f in term.effect.forces(signals, {**term.values, name: 0.0})) for name in ("c", "k")
    )
    return elastic > lossy


def _is_in_band(problem: Problem, term: Term) -> bool:
    """Whether a mode is not at an end of the range of frequencies: above it, it is mass, and below it a spring."""
    ranges = {s.name: shape_bounds(s, problem.scales) for s in term.effect.shapes if s.unit == "Hz"}
    return all(low / _AT < term.values[name] < _AT * high for name, (low, high) in ranges.items())
