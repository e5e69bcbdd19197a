"""Laws at the limit of their parameters, where what bears one name acts as another law.

A contact without stiffness is a damper, a kink wider than the stroke a constant force, a mass on an overdamped spring
relaxation. Such a fit may be as good as any, and its name is wrong all the same. And laws that are the same, up to a
refit or in these recordings: where one of them was not tried, nothing tells it from the other.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.stats import spearmanr

from hystid.diagnosis.blocks import Signals, shape_bounds
from hystid.diagnosis.fitting import WEIGHING_LIMIT, Fit, Problem, Term
from hystid.diagnosis.search import complement

Array = NDArray[np.float64]
IMPACT, CONTACT_LOSS, TWO_SIDED_STOP = "impact", "contact_loss", "two_sided_stop"
_HIDDEN, _RELAXATION, _STIFFENING = "hidden_mode", "viscoelastic_relaxation", "stiffness_drift"
COULOMB, STRIBECK = "coulomb_friction", "stribeck_friction"
_BEYOND, _LASTS = 2.0, 0.2  # turns within which friction falls, and share of the fall that is left at high speed
_KINKED = frozenset({"bilinear_stiffness", CONTACT_LOSS})
_AT = 0.98  # of the highest frequency that is tried, and of the largest weighing error: fits that want more end there
_CRITICAL = 1.0  # damping ratio from which nothing resonates
_SURE = 4.0  # standard errors by which the mass lies beyond what weighing explains,
_WORTH = 0.01  # and fall of the mean square that it is worth: less is what the form of an effect leaves
_STRETCHES, _FOLLOWS = 10, 0.9  # stretches of a recording, and rank correlation of stiffness and frequency over them


def is_itself(problem: Problem, term: Term, signals: Sequence[Signals]) -> bool:
    """Whether a fitted law is what its name says, and not the limit in which it is another one.

    signals: what the effect sees.
    """
    effect, values = term.effect, term.values
    if effect.id == IMPACT:
        return _carries(term, signals)
    if effect.id in _KINKED and values.get("w", 0.0) >= float(problem.scales.x[-1]):
        return not _presses_at_rest(term)  # then it is next to a constant force; else it is half of a square
    if effect.id == _HIDDEN:
        return values.get("zeta", 0.0) < _CRITICAL and _is_in_band(problem, term)
    return True


def falls_with_speed(term: Term | None) -> bool:
    """Whether friction falls with speed as its name says: beyond its turn, of which it is another shape otherwise, and
    to a friction that lasts."""
    values = term.values if term is not None and term.effect.id == STRIBECK else {}
    slower, lasts = values.get("v_d", 0.0) > _BEYOND * values.get("v_s", 0.0), values.get("Fc", 0.0)
    return slower and lasts > _LASTS * values.get("Fd", 0.0) > 0.0


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


def is_beyond_weighing(problem: Problem, fitted: Fit) -> bool:
    """Whether the mass of a fit stands at the limit of a weighing error, and the residual still draws it further: then
    what is added, lost or scaled with the mass has no name yet, and the named effect may stand for a part of it."""
    hypothesis = fitted.hypothesis
    unknowns = problem.unknowns(hypothesis)
    at = next((i for i, unknown in enumerate(unknowns) if unknown.key == ("chain", "weighing")), None)
    if at is None or abs(hypothesis.weighing) < _AT * WEIGHING_LIMIT:
        return False
    outside = complement(problem, replace(fitted, unknowns=(*unknowns[:at], *unknowns[at + 1 :])))
    column = outside(problem.jacobian(hypothesis, [unknowns[at]])[:, 0])
    # in standard errors, since rows have unit noise
    pull = float(column @ problem.rows(hypothesis)) / float(np.linalg.norm(column)) * np.sign(hypothesis.weighing)
    return bool(pull > max(_SURE, np.sqrt(_WORTH * len(column))))


def untried(problem: Problem, fit: Fit, term: Term, known: Collection[str]) -> tuple[str, ...]:
    """Ids that are not told from a named effect and were not tried, since they are not among the known ones."""
    names: list[str] = []
    if _is_two_sided(fit, term):
        names.append(TWO_SIDED_STOP)
    if term.effect.id == _STIFFENING and _follows_frequency(problem, fit, term):
        names.append(_RELAXATION)
    return tuple(name for name in names if name not in known)


def _is_two_sided(fit: Fit, term: Term) -> bool:
    """Whether contact closes on both sides: by this effect, or by it and another one on the opposite side."""
    here = _closing_side(term)
    if here == 0.0:
        return True
    others = [_closing_side(other) for other in fit.hypothesis.terms if other is not term]
    return here is not None and any(other is not None and other != here for other in others)


def _closing_side(term: Term) -> float | None:
    """Side on which a contact closes (0: on both), None for what is no contact or one that opens."""
    if term.effect.id not in (IMPACT, CONTACT_LOSS) or term.values.get("k", 0.0) <= 0:
        return None
    return float(term.values["side"])


def _follows_frequency(problem: Problem, fit: Fit, term: Term) -> bool:
    """Whether a stiffness that changes with time rises with the frequency of the motion, in every recording: swept
    in one direction only, the recordings cannot say which of the two it is."""
    signals = problem.signals(fit.hypothesis)
    pairs = zip(signals, term.effect.forces(signals, term.values), strict=True)
    return all(_rises_alike(*(np.array_split(part, _STRETCHES) for part in (s.x, s.v, f))) for s, f in pairs)


def _rises_alike(x: Sequence[Array], v: Sequence[Array], force: Sequence[Array]) -> bool:
    """Whether stiffness (force over x) and frequency (v over x) have the same order over the stretches."""
    power = [float(part @ part) or np.inf for part in x]
    stiffness = [float(one @ other) / size for one, other, size in zip(x, force, power, strict=True)]
    frequency = [float(part @ part) / size for part, size in zip(v, power, strict=True)]
    return float(spearmanr(stiffness, frequency).statistic) > _FOLLOWS
