"""The refit of the baseline alone, from several starts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from hystid.diagnosis.fit.hypothesis import Fit, Hypothesis, Term
from hystid.diagnosis.fit.problem import Problem
from hystid.diagnosis.fit.search import downhill, from_nominal, leading, other_minima, scan, try_fit, try_term
from hystid.diagnosis.model.channel_effects import history
from hystid.diagnosis.model.effects import Effect
from hystid.errors import NumericalError

_STARTS = (0.5, 2.0)  # factors on the nominal shapes of the law, for further starts of the refit
_MINIMA = 2  # rounds of looking for a better minimum of the refit
_JUMPS = 2  # rounds in which rows near jumps are found, and the refit begins again without them
_OPTIMA_APART = 0.01  # relative difference of mean squares that makes two optima of the refit
_LEFT = 0.03  # excess over the floor below which a refit needs no further start

Refit = tuple[Fit, tuple[Fit, ...], float]  # the best fit, other optima, and the mean square at the nominal values


def refit(problem: Problem, kept: Sequence[int] = (), sized: Sequence[Mapping[str, float]] = ()) -> Refit:
    """The baseline from several starts, other optima that were met, and the mean square at the nominal values.

    Further starts only while something is left: where a simplex comes to from the nominal shapes, these made smaller
    and larger, then where it comes to from the best, and shapes scattered around: a law with corners has local minima.
    sized: values that the recordings suggest: for a further start, as nominal ones may be such that a contact never
    slips, and others, of which the best few are tried.
    kept: numbers of recordings in which a contact keeps a force of the time before.
    """
    before = history(kept)
    terms = (Term(before, dict.fromkeys(before.amplitudes, 0.0)),) if kept else ()
    nominal = Hypothesis(dict(problem.baseline.nominal), terms)
    fits = [made for made in (try_fit(problem, nominal, 25),) if made is not None]
    if fits and not _sits(problem, fits[0]) and (relaxed := from_nominal(problem, fits[0])) is not None:
        fits += [made for h in downhill(problem, relaxed) if (made := try_fit(problem, h, 25)) is not None]
    if fits and problem.baseline.shapes and not _sits(problem, min(fits, key=lambda f: f.chi2)):
        own = [{n: values[n] for n in problem.baseline.free if n in values} for values in sized]  # others are held
        starts = [replace(nominal, values={**nominal.values, **values}) for values in own]
        promising = [*starts[:1], *leading(problem, starts[1:])]
        fits += [made for h in promising if (made := try_fit(problem, h, 25)) is not None]
    for factor in _STARTS if problem.baseline.shapes else ():
        fits.sort(key=lambda f: f.chi2)
        if fits and _sits(problem, fits[0]):
            break
        values = dict(problem.baseline.nominal)
        for name in problem.baseline.shapes:
            values[name] *= factor if name in problem.baseline.positive else 1.0
        fits += [made for made in (try_fit(problem, Hypothesis(values, terms), 25),) if made is not None]
    fits.sort(key=lambda f: f.chi2)
    if not fits:
        raise NumericalError("the baseline has no finite force on these recordings; check its nominal parameters")
    for _ in range(_MINIMA):
        if _sits(problem, best := fits[0]):
            break
        starts = other_minima(problem, best)
        fits += [made for h in starts if (made := try_fit(problem, h, 25, incumbent=best.chi2)) is not None]
        fits.sort(key=lambda f: f.chi2)
        if fits[0].chi2 > (1 - _OPTIMA_APART) * best.chi2:
            break
    return _without_jumps(problem, fits, nominal)


def refit_again(problem: Problem, before: Sequence[Fit]) -> Refit:
    """The same from fits of another problem with the same recordings, of which the noise is known better now."""
    made = [one for fit in before if (one := try_fit(problem, fit.hypothesis, 25)) is not None]
    nominal = _nominal(problem, before)
    return _without_jumps(problem, sorted(made or before[:1], key=lambda f: f.chi2), nominal)


def refit_at_rest(problem: Problem, before: Sequence[Fit], effects: Sequence[Effect]) -> Refit | None:
    """The same with the rows weighed down in which a structure may stand still by dry friction that was left out; None
    where there are none.

    before: the refit and other optima. A contact at rest holds any force up to its friction. No law of the motion says
    which, and what such rows hold would speak for laws that follow the motion into the rest.
    """
    scanned = scan(problem, before[0], [effect for effect in effects if effect.turns])
    friction = try_term(problem, before[0], scanned[0].term) if scanned else None
    if friction is None:
        return None
    return _where_it_moves(problem, before, friction.hypothesis, _nominal(problem, before))


def refit_held(problem: Problem, before: Sequence[Fit], start: Fit, effects: Sequence[Effect]) -> Refit | None:
    """The same for dry friction that acts for a part of the time: it is as large as the largest force that the
    baseline leaves. start: the baseline as it fits where nothing acts."""
    turning = [effect for effect in effects if effect.turns and effect.amplitudes]
    if not turning:
        return None
    effect = min(turning, key=lambda effect: effect.size)
    shapes = min(effect.grid(problem.scales), key=lambda point: point[effect.semantics.transition])
    left = zip(problem.balance_shown(start.hypothesis), problem.parts, strict=True)
    most = max(float(np.max(np.abs(f if part.valid is None else f * part.valid))) for f, part in left)
    friction = Term(effect, {**shapes, **dict.fromkeys(effect.amplitudes, most)})
    held = start.hypothesis.beside(friction)
    return _where_it_moves(problem, [start, *before], held, _nominal(problem, before))


def _where_it_moves(problem: Problem, before: Sequence[Fit], friction: Hypothesis, nominal: Hypothesis) -> Refit | None:
    """Fits again with the rows weighed down in which friction may hold the structure; None where there are none."""
    sure = problem.reduce.sure()
    problem.distrust(friction, nominal, refit=before[0].hypothesis)
    return _weighed(problem, before, nominal) if np.any(sure & ~problem.reduce.sure()) else None


def refit_beside(problem: Problem, before: Sequence[Fit], law: Fit) -> Refit:
    """The same from fits of another problem with the same recordings, with the rows weighed down in which a law jumps
    that explains what they leave: a refit that is led astray jumps elsewhere."""
    nominal = _nominal(problem, before)
    problem.distrust(law.hypothesis, nominal, refit=before[0].hypothesis)
    return _weighed(problem, before, nominal)


def _nominal(problem: Problem, before: Sequence[Fit]) -> Hypothesis:
    return Hypothesis(dict(problem.baseline.nominal), before[0].hypothesis.terms)


def _weighed(problem: Problem, before: Sequence[Fit], nominal: Hypothesis) -> Refit:
    """Fits again with the rows weighed as they are."""
    made = [one for fit in before if (one := try_fit(problem, fit.hypothesis, 25)) is not None]
    best, *others = sorted(made or before[:1], key=lambda f: f.chi2)
    return best, _minima(best, others), float(np.mean(problem.rows(nominal) ** 2))


def _without_jumps(problem: Problem, fits: Sequence[Fit], nominal: Hypothesis) -> Refit:
    """The best fit (they are sorted), other optima, and the mean square at the nominal values, with the rows weighed
    down in which a law jumps."""
    best, *others = fits
    rows = problem.rows(nominal)
    for _ in range(_JUMPS):
        weighed = problem.reduce.weighs
        if not problem.distrust(best.hypothesis, nominal) and not weighed:
            break
        again = [best.hypothesis, nominal]  # jumps may have led the fits astray: begin again without them
        fits = [made for h in again if (made := try_fit(problem, h, 25)) is not None]
        best, rows, others = min(fits, key=lambda f: f.chi2), problem.rows(nominal), []
    return best, _minima(best, others), float(np.mean(rows**2))


def _minima(best: Fit, others: Sequence[Fit]) -> tuple[Fit, ...]:
    return tuple(f for f in others if f.chi2 > (1 + _OPTIMA_APART) * best.chi2)[:2]


def _sits(problem: Problem, fitted: Fit) -> bool:
    """Whether a refit leaves hardly more than noise."""
    return fitted.chi2 < problem.floor(fitted) + _LEFT
