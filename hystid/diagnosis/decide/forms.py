"""What the form of a law leaves open: the part of a standard error that no number of samples takes away.

A structure follows its own law, which lies beside every form of a catalogue. How far beside can be measured: next to
the form that was fitted, the difference to another form of the same law is fitted as one more column. Its share is 0
where the fitted form is right, 1 where the other one is, negative where the truth lies beyond the fitted one
(comprehensive models: Atkinson 1970; Davidson and MacKinnon 1981). Parameters go along by that share.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from hystid.diagnosis.decide.criterion import SOUND
from hystid.diagnosis.decide.trials import are_reached
from hystid.diagnosis.fit.hypothesis import Fit, Key, get, is_mass, put
from hystid.diagnosis.fit.problem import Problem, standing
from hystid.diagnosis.fit.search import scan, try_fit
from hystid.diagnosis.fit.uncertainty import SAME
from hystid.diagnosis.fit.windows import in_window_of
from hystid.diagnosis.model.effects import Effect
from hystid.errors import NumericalError
from hystid.numeric import Array

_PHYSICAL = ("m", "m/s", "s", "Hz", "N")  # units of thresholds, times and forces: the same thing in every form
_FARTHEST = 2.0  # distances of two forms that the truth may lie off: what two draws say of a spread is little
_STARTS, _ITERATIONS = 2, 25  # grid points of another form that are fitted, and iterations
_WIDER = 5.0  # factor on the speed over which friction changes sign, for a slower approach to sliding


@dataclass(frozen=True)
class _Beside:
    """Another form: its prediction less that of the fit (rows), and how far those of its parameters that mean the
    same in both are from those of the fit."""

    difference: Array
    apart: Mapping[Key, float]


def left_open(problem: Problem, fitted: Fit, library: Sequence[Effect]) -> dict[Key, float]:
    """Standard deviation that other forms of the laws of a fit leave in their parameters, in their own units.

    Keys are those of the fit. Of the forms of one law the one that matters most counts. A mass that is added counts
    from the one that was stated, which is known as well as matched sensors show it.
    """
    tangent = _Tangent(problem, fitted)
    most: dict[Key, float] = {}
    for index in range(len(fitted.hypothesis.terms)):
        found = [tangent.spread(other) for other in _beside(problem, fitted, index, library)]
        for spreads in (*found, *_simpler(problem, fitted, index, library)):
            for key, spread in spreads.items():
                most[key] = max(most.get(key, 0.0), spread)
        if is_mass(effect := fitted.hypothesis.terms[index].effect):
            key = str(index), effect.semantics.mass
            most[key] = float(np.hypot(most.get(key, 0.0), SOUND * problem.baseline.mass))
    return most


class _Tangent:
    """The linearised fit: splits differences of predictions into what its parameters could follow and the remainder."""

    def __init__(self, problem: Problem, fitted: Fit) -> None:
        jacobian = problem.jacobian(fitted.hypothesis, fitted.unknowns)
        scale = np.linalg.norm(jacobian, axis=0)
        scale[scale == 0] = 1.0
        self.fitted, self.columns = fitted, jacobian / scale
        self.inverse = np.linalg.pinv(self.columns, rcond=SAME)
        here = fitted.hypothesis
        self.units = np.array([abs(get(here, u.key)) if u.log else 1.0 for u in fitted.unknowns]) / scale
        self.index = {u.key: i for i, u in enumerate(fitted.unknowns)}

    def spread(self, other: _Beside) -> dict[Key, float]:
        """How far the parameters may be off along the way to another form: by its share, with the error of that."""
        followed = self.inverse @ other.difference
        remainder = other.difference - self.columns @ followed
        power = float(remainder @ remainder)
        share = float(self.fitted.residual @ remainder) / power if power > 0 else np.inf
        error = np.sqrt(max(self.fitted.chi2, 1.0) / power) if power > 0 else np.inf
        reach = min(_FARTHEST, float(np.hypot(share, error)))
        moved = followed * self.units
        return {key: reach * abs(far - moved[self.index[key]]) for key, far in other.apart.items() if key in self.index}


def _beside(problem: Problem, fitted: Fit, index: int, library: Sequence[Effect]) -> Iterator[_Beside]:
    """Other forms of one law, everything else fitted anew."""
    term = fitted.hypothesis.terms[index]
    if term.effect.semantics.transition:
        yield from _turning_slower(problem, fitted, index)
    others = [e for e in library if e.id == term.effect.id and e.class_name != term.effect.class_name]
    forms = [in_window_of(effect, term) for effect in others if _shared(term.effect, effect)]
    for made in _refitted(problem, fitted, index, forms):
        other = made.hypothesis.terms[index]
        apart = {(str(index), n): other.values[n] - term.values[n] for n in _shared(term.effect, other.effect)}
        yield _Beside(fitted.residual - made.residual, apart)


def _simpler(problem: Problem, fitted: Fit, index: int, library: Sequence[Effect]) -> Iterator[dict[Key, float]]:
    """How far coefficients are from those of a form without some of the amplitudes.

    A further amplitude takes what other laws leave. Where it explains no more than stays unexplained with it, it may be
    nothing else; it counts for less the more it explains.
    """
    term = fitted.hypothesis.terms[index]
    effect, shapes = term.effect, {shape.name for shape in term.law.effect.shapes}
    others = [e for e in library if e.id == effect.id and set(e.amplitudes) < set(effect.amplitudes)]
    simpler = [in_window_of(e, term) for e in others if {shape.name for shape in e.shapes} == shapes]
    if not simpler:
        return
    left = max(0.0, fitted.chi2 - problem.floor(fitted))
    for made in _refitted(problem, fitted, index, simpler):
        worth = max(made.chi2 - fitted.chi2, 0.0)
        weight = left / worth if worth > left else 1.0
        other = made.hypothesis.terms[index]
        yield {(str(index), n): weight * abs(other.values[n] - term.values[n]) for n in other.effect.amplitudes}


def _turning_slower(problem: Problem, fitted: Fit, index: int) -> Iterator[_Beside]:
    """Friction that comes to its level more slowly than the form says, whichever form that is."""
    here = fitted.hypothesis
    speed = here.terms[index].effect.semantics.transition
    key = (str(index), speed)
    try:
        rows = problem.rows(put(here, {key: _WIDER * get(here, key)}))
    except NumericalError:
        return
    if np.all(np.isfinite(rows)):
        own = {(str(index), name): 0.0 for name in here.terms[index].values if name != speed}
        yield _Beside(fitted.residual - rows, own)


def _refitted(problem: Problem, fitted: Fit, index: int, forms: Sequence[Effect]) -> Iterator[Fit]:
    """Fits with each form in the place of a term; none for forms that find no place in the motion, or act on the
    other side."""
    here = fitted.hypothesis
    if not forms:
        return
    start = standing(problem, here.without(index))
    sides = {name: here.terms[index].values[name] for name in here.terms[index].effect.choices}
    for candidate in scan(problem, start, forms):
        points = [t for t in (candidate.term, *candidate.others) if sides.items() <= t.values.items() or not sides]
        fits = []
        for term in points[:_STARTS]:
            made = try_fit(problem, here.exchanged(index, term), _ITERATIONS)
            fits += [made] if made is not None and are_reached(problem, made) else []
        if fits:
            yield min(fits, key=lambda made: made.chi2)


def _shared(one: Effect, two: Effect) -> list[str]:
    """Thresholds, times and forces of both forms; a coefficient is another one in another form."""
    return [name for name, unit in one.units.items() if unit in _PHYSICAL and two.units.get(name) == unit]
