"""Trials: joint fits of a baseline and one more effect, and how they are compared with each other."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from hystid.diagnosis.decide.limits import AT_END, TOUCHED, is_itself, is_tail
from hystid.diagnosis.fit.hypothesis import Fit, Hypothesis, Term, is_mass
from hystid.diagnosis.fit.problem import DELAY_LIMIT, LATE_LIMIT, Problem, standing
from hystid.diagnosis.fit.search import (
    ABSORBED,
    ScannedForm,
    downhill,
    from_nominal,
    other_minima,
    scan,
    try_fit,
    try_term,
)
from hystid.diagnosis.model.channel_effects import DRIFT, HIGH_PASS, RANGE
from hystid.diagnosis.model.effects import Effect
from hystid.diagnosis.prepare.faults import CALIBRATION, DELAY
from hystid.errors import NumericalError

_HEALTHY = 0.075  # excess that smoothing and integration leave in healthy recordings
_PROMISING = 0.3  # share of the largest gain of a scan that makes a form worth a fit
_HOPEFUL = 0.4  # share of the excess that the best trial may leave to be searched again
_NEAR_BEST, _SEARCHED = 2.0, 2  # excess over that of the best trial, and number of ids, that are searched again
_RIVAL, _EXCHANGED = 0.5, 4  # share of the best gain that a look-alike may lack, and how many are fitted again
_EQUAL, _SIMPLER = 0.99, 2  # share of the gain that a simpler look-alike has, and how many of these are fitted as well
_FORMS = 3  # forms of the leading id that are searched again
_CLOSE, _CREEPING = 3, (0.02, 0.06)  # leading ids, and mean square (and share of the excess) behind the best, fitted on
LAST = 60  # iterations for what is named
_MOVING = 6.0  # standard errors (of white noise) beyond which a recording drifts: real ones show 15 and more
_REACHED = 0.001  # share of the samples of some recording that lie beyond a threshold, where a law acts short of it
# of the largest speed, within which dry friction must have turned: a smooth sign (tanh) then grows there with a power
# of the speed below 0.1, a damper with 1
_SLIDES = 0.44


@dataclass(frozen=True)
class Trial:
    """One hypothesis that was fitted: what was added last, and how it went."""

    name: str
    form: str
    size: int
    fit: Fit = field(repr=False)
    absorbed: float = 0.0
    others: tuple[Term, ...] = field(repr=False, default=())

    @property
    def chi2(self) -> float:
        """Mean square of the residual, noise units."""
        return self.fit.chi2

    @property
    def term(self) -> Term | None:
        """The term of this name, None where the trial is a correction of the chain."""
        return next((term for term in self.fit.hypothesis.terms if term.effect.id == self.name), None)

    @property
    def form_of(self) -> Effect | None:
        """The form that was added; None where the trial is a correction of the chain."""
        terms = self.fit.hypothesis.terms
        return terms[-1].effect if terms and terms[-1].effect.id == self.name else None


def trials(
    problem: Problem,
    fitted: Fit,
    candidates: Sequence[ScannedForm],
    excess: float,
    extra: Sequence[Trial],
    most: int = 12,
) -> list[Trial]:
    """Joint fits of at most so many promising forms, best first, with the trials that were made elsewhere.

    Absorbed ones count for nothing unless they change much.
    """
    found = [*extra]
    top = max((c.gain for c in candidates), default=0.0)
    promising = [c for c in candidates if c.gain > _PROMISING * top][:most]
    promising += [c for c in candidates[:most] if c not in promising][: max(0, 5 - len(promising))]
    for candidate in promising:
        made = try_term(problem, fitted, candidate.term, incumbent=min((t.chi2 for t in found), default=0.0))
        if made is not None:
            found.append(_trial(candidate, made))
    found = ranked(problem, found)
    if found and found[0].chi2 - 1.0 > 2 * _HEALTHY:
        found = ranked(problem, [*_restarts(problem, fitted, found[0]), *found])
    return [t for t in found if not (t.absorbed > ABSORBED and fitted.chi2 - t.chi2 < 0.5 * excess)]


def ranked(problem: Problem, found: Sequence[Trial]) -> list[Trial]:
    """Best first, without those that need a threshold which the motion never passes."""
    return sorted((t for t in found if are_reached(problem, t.fit)), key=lambda t: t.chi2)


def are_reached(problem: Problem, fit: Fit) -> bool:
    """Whether the motion goes beyond every threshold, dry friction slides, and each law is what its name says: the tail
    of a contact that is never reached feigns a preload, and friction that turns over most of the speeds is a damper by
    another name. Beside a law, a delay ends short of the longest that is tried: else the two make up for each other."""
    if fit.hypothesis.terms and abs(fit.hypothesis.delay) >= AT_END * LATE_LIMIT:
        return False
    signals = problem.signals(fit.hypothesis)
    for number, term in enumerate(fit.hypothesis.terms):
        if not term.effect.is_possible(term.values) or (term.effect.id == DRIFT and not _drifts(problem, fit, number)):
            return False
        if term.effect.id == RANGE and not _shows_inertia(problem, fit, number):
            return False
        if term.effect.id == HIGH_PASS and not _is_clear(fit, number, "omega"):  # else a constant of each recording
            return False
        said = term.effect.semantics
        if said.threshold:
            side, gap = term.values.get(said.switch, 0.0), term.values[said.threshold]
            gates = term.effect.switched([np.ones_like(p.x) for p in problem.parts], signals, term.values)
            acting = zip(problem.parts, gates, strict=True)  # what lies beyond while the law is off touches nothing
            beyond = [((side * p.x if side else np.abs(p.x)) > gap) & (gate > 0.5) for p, gate in acting]
            touched = max(map(np.count_nonzero, beyond)) >= TOUCHED or max(map(np.mean, beyond)) >= _REACHED
            if not touched or (said.width and is_tail(term, signals, beyond)):
                return False
        if term.values.get(said.transition, 0.0) > _SLIDES * problem.scales.v[-1] or not is_itself(
            problem, term, signals
        ):
            return False
    return True


def _shows_inertia(problem: Problem, fit: Fit, number: int) -> bool:
    """Whether a gain of the force channel in one recording shows in the inertia there, beyond noise: else the structure
    may have changed as well, as a damper whose valve was opened."""
    term = fit.hypothesis.terms[number]
    mass, share = fit.hypothesis.mass(), term.values["share"]
    inertia = [mass * part.a * (str(i + 1) == term.effect.form) for i, part in enumerate(problem.parts)]
    rows = problem.reduce(inertia)
    return abs(share) * float(np.linalg.norm(rows)) > _MOVING * float(np.sqrt(fit.chi2))


def _is_clear(fit: Fit, number: int, name: str) -> bool:
    """Whether a parameter of a term is more than its error, where that is known."""
    return fit.covariance is None or abs(fit.hypothesis.terms[number].values[name]) > _MOVING * fit.stderr(
        (str(number), name)
    )


def _drifts(problem: Problem, fit: Fit, number: int) -> bool:
    """Whether a drift of the force channel is one in most of the recordings, or, where its form is that of constants, a
    constant in most of them.

    A constant that one recording needs and others do not, with ramps here and there, is what a wrong even law leaves,
    or friction that stuck elsewhere when a recording began.
    """
    values, count = fit.hypothesis.terms[number].values, len(problem.parts)

    runs = any(not name.startswith("offset") for name in values)
    kinds = {name.partition("_")[0] for name in values} - ({"offset"} if runs else set())
    clear = [any(_is_clear(fit, number, f"{kind}_{k + 1}") for kind in kinds) for k in range(count)]
    return 2 * sum(clear) > count


def _restarts(problem: Problem, fitted: Fit, best: Trial) -> list[Trial]:
    """The best form from its next best grid points: most misses are searches that got stuck."""
    made = [try_term(problem, fitted, term, incumbent=best.chi2) for term in best.others[:2]]
    return [replace(best, fit=f, others=()) for f in made if f is not None and f.chi2 < best.chi2]


def also_from_nominal(problem: Problem, found: Sequence[Trial], before: Fit, library: Sequence[Effect]) -> list[Trial]:
    """Also the most promising forms fitted from the nominal baseline: a refit that has taken the missing effect for one
    of its own may stand too far away."""
    start = from_nominal(problem, before)
    if start is None:
        return list(found)
    incumbent, candidates = found[0].chi2, scan(problem, start, library)[:_FORMS]
    pairs = [(candidate, try_term(problem, start, candidate.term, incumbent=incumbent)) for candidate in candidates]
    made_so = (_trial(candidate, made) for candidate, made in pairs if made is not None)
    return ranked(problem, [*found, *made_so, *chain_trials(problem, start, library)])


def searched_again(
    problem: Problem, found: Sequence[Trial], before: Fit, floor: float, minima: Sequence[Fit]
) -> list[Trial]:
    """The leading ids from other starts, where the best explains much, and not enough.

    A law with corners has local minima: the refit without the missing effect may stand in one, and no fit that starts
    there comes out. Other starts are other minima that the refit has seen, and scattered shapes.
    """
    left, excess = found[0].chi2 - floor, before.chi2 - floor
    if left > _HOPEFUL * excess:
        return list(found)
    again = list(found)
    leading = [trial for trial in distinct(found)[:_SEARCHED] if trial.chi2 - floor < _NEAR_BEST * left]
    forms = {t.form_of.class_name: t for t in reversed(found) if t.form_of and t.name in {one.name for one in leading}}
    for minimum in minima:
        for candidate in scan(problem, minimum, [t.form_of for t in forms.values() if t.form_of])[:_FORMS]:
            made = try_term(problem, minimum, candidate.term, incumbent=again[0].chi2)
            known = forms[candidate.effect.class_name]
            again += [replace(known, fit=made, others=())] if made is not None and made.chi2 < known.chi2 else []
    again = ranked(problem, again)
    for trial in leading:
        starts = other_minima(problem, trial.fit)
        fits = [made for start in starts if (made := try_fit(problem, start, incumbent=again[0].chi2)) is not None]
        again += [replace(trial, fit=made, others=()) for made in fits if made.chi2 < trial.chi2]
    return ranked(problem, again)


def exchanged(
    problem: Problem, found: Sequence[Trial], before: Fit, library: Sequence[Effect], *, every: bool = True
) -> list[Trial]:
    """Look-alikes of the best trial, fitted again from where its baseline stands.

    The refit without any effect leans to one side, and a fit that starts there may never come to where the best one is:
    it would lose for that and not for its law. library: what may look alike. every: all of it; else what has come near,
    and simpler laws of the same shapes that were never fitted: a scan from the refit alone may take what holds them.
    """
    best = found[0]
    here = best.fit.hypothesis
    if len(here.terms) == len(before.hypothesis.terms):
        return list(found)
    near = best.chi2 + _RIVAL * (before.chi2 - best.chi2)
    forms = {t.form_of.class_name: t for t in reversed(found) if t.chi2 < near and t.form_of}
    forms.pop(here.terms[-1].effect.class_name, None)
    start = standing(problem, here.without(-1))
    again, law = list(found), here.terms[-1]
    fitted, own = {t.name for t in found}, {shape.name for shape in law.effect.shapes}
    effects = [
        effect
        for effect in library
        if every or effect.class_name in forms or (effect.id not in fitted and is_within(effect, own, law.effect.size))
    ]
    shapes = {name: value for name, value in law.values.items() if name not in law.effect.amplitudes}
    for candidate in _rivals(scan(problem, start, effects, near=shapes), law.effect.size):
        made = try_term(problem, start, candidate.term, incumbent=best.chi2)
        known = forms.get(candidate.effect.class_name)
        if made is not None and (known is None or made.chi2 < known.chi2):
            again.append(replace(_trial(candidate, made), others=()))
    return ranked(problem, [*again, *_wider(problem, again, library)])


def _wider(problem: Problem, found: Sequence[Trial], library: Sequence[Effect]) -> Iterator[Trial]:
    """Laws that become a leading one at an end of theirs, and have fitted worse all the same, begun beside that end.

    A second stop that the motion touches by little shows in no step of a grid where the first one is not in its place;
    and until it is found, another law may lead.
    """
    best = found[0]
    leading = distinct(found)[: _SEARCHED if best.chi2 - 1.0 > 2 * _HEALTHY else 1]
    for narrow in (trial for trial in leading if trial.form_of):
        nearer = {t.form_of.class_name for t in found if t.form_of and t.chi2 <= narrow.chi2}
        wider = [
            e
            for e in library
            if e.class_name not in nearer and any(end.law == narrow.name for end in e.semantics.becomes)
        ]
        for effect in wider:
            start = _at_its_end(problem, narrow.fit.hypothesis, effect)
            made = try_fit(problem, start, incumbent=best.chi2) if start is not None else None
            if made is not None:
                yield Trial(effect.id, effect.form, effect.size, made)


def _at_its_end(problem: Problem, here: Hypothesis, effect: Effect) -> Hypothesis | None:
    """A hypothesis with another effect for its last one, as like it as the grid of the other gets; None where it would
    not be itself."""
    law, signals = here.terms[-1], problem.signals(here)
    same = {name: law.values.get(name, 0.0) for name in effect.amplitudes}
    near = (Term(effect, {**at, **same}) for at in effect.grid(problem.scales, law.values))
    starts = [here.exchanged(-1, term) for term in near if is_itself(problem, term, signals)]
    return min(starts, key=partial(_left, problem), default=None)


def _left(problem: Problem, start: Hypothesis) -> float:
    """Mean square that a hypothesis leaves as it stands; without end where it has no answer, as a mode that is too
    quick for the samples has not."""
    try:
        return standing(problem, start).chi2
    except NumericalError:
        return np.inf


def is_within(effect: Effect, shapes: Collection[str], size: int) -> bool:
    """Whether an effect has some of these shapes, and no others, and fewer parameters."""
    return effect.size < size and bool(effect.shapes) and all(shape.name in shapes for shape in effect.shapes)


def _rivals(candidates: Sequence[ScannedForm], size: int) -> list[ScannedForm]:
    """Candidates that are fitted again: those that take most, and simpler ones that take as much."""
    leading, others = candidates[:_EXCHANGED], candidates[_EXCHANGED:]
    simpler = [c for c in others if c.gain > _EQUAL * candidates[0].gain and c.effect.size < size]
    return [*leading, *sorted(simpler, key=lambda c: c.effect.size)[:_SIMPLER]]


def finished(problem: Problem, found: Sequence[Trial], excess: float) -> list[Trial]:
    """The best of the leading ids, fitted on: a law with corners creeps, and comparisons end early."""
    near = [t for t in distinct(found)[:_CLOSE] if t.chi2 - found[0].chi2 < _CREEPING[0] + _CREEPING[1] * excess]
    again = []
    for trial in near if len(near) > 1 else ():
        made = try_fit(problem, trial.fit.hypothesis, LAST)
        again += [replace(trial, fit=made, others=())] if made is not None and made.chi2 < trial.chi2 else []
    return ranked(problem, [*again, *found])


def fitted_on(problem: Problem, fit: Fit) -> Fit:
    """A fit continued, also over the ridges between local minima."""
    made = try_fit(problem, fit.hypothesis, LAST) or fit
    fits = [try_fit(problem, start, LAST) for start in downhill(problem, made)]
    return min([made, *(f for f in fits if f is not None)], key=lambda f: f.chi2)


def _trial(candidate: ScannedForm, made: Fit) -> Trial:
    effect = candidate.effect
    return Trial(effect.id, effect.form, effect.size, made, candidate.absorbed, candidate.others)


def distinct(found: Iterable[Trial]) -> list[Trial]:
    """The best trial of each id."""
    seen: dict[str, Trial] = {}
    for trial in found:
        seen.setdefault(trial.name, trial)
    return list(seen.values())


def chain_trials(problem: Problem, fitted: Fit, effects: Sequence[Effect]) -> list[Trial]:
    """A late force channel, and a mass beyond its tolerance: tried where the refit runs into their limits."""
    found = []
    here = fitted.hypothesis
    if abs(here.delay) > 0.8 * DELAY_LIMIT and not here.late and not problem.unforced:
        made = try_fit(problem, replace(here, late=True))
        if made is not None and abs(made.hypothesis.delay) > DELAY_LIMIT:
            found.append(Trial(DELAY, "", 1, made))
    if abs(here.mass_error) > 0.95 * CALIBRATION:
        heavier = added_mass_of(problem, fitted, effects)
        found += [heavier] if heavier is not None else []
    return found


def added_mass_of(problem: Problem, fitted: Fit, effects: Sequence[Effect]) -> Trial | None:
    """The mass error of a fit as an effect without a limit; None where there is none, or no such effect."""
    here = fitted.hypothesis
    mass = next((effect for effect in effects if is_mass(effect)), None)
    if mass is None or here.mass_error == 0.0:
        return None
    term = Term(mass, {mass.semantics.mass: here.mass_error * here.values["m"]})
    made = try_fit(problem, replace(here.beside(term), mass_error=0.0))
    return Trial(mass.id, mass.form, 1, made) if made is not None else None
