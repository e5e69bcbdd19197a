"""Effects that act for a part of the time: laws fitted in the windows in which they explain most."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

from hystid.diagnosis.decide.criterion import Criterion
from hystid.diagnosis.decide.trials import are_reached, fitted_on
from hystid.diagnosis.fit.hypothesis import Fit
from hystid.diagnosis.fit.problem import Problem, standing
from hystid.diagnosis.fit.search import ScannedForm, one_per_id, scan, try_fit, try_term
from hystid.diagnosis.fit.windows import has_edges, in_window_of, is_off_outside, settled, shared
from hystid.diagnosis.fit.windowscan import outside, placed, scan_windows
from hystid.diagnosis.model.effects import Effect

_LAWS, _FORMS = 3, 6  # laws that are fitted to the end, and forms that are tried
_ROUNDS = 2  # of trying other laws in the windows of what leads


def in_windows(problem: Problem, criterion: Criterion, before: Fit, effects: Sequence[Effect]) -> Iterator[Fit]:
    """Fits of the baseline and one law that is switched on and off, each once with windows of its own per recording,
    and with one for all where they agree; [] where there is no time in which nothing acts.

    A refit without the effect stands where a part of the time pulls it. Hence law and window are looked for beside the
    baseline as it fits where nothing acts, and fitted alone before both are. There the baseline is a right law. A law
    that acts at some levels of the motion only needs no window for that: such laws come first. Laws that open or close
    over most of their window, or that would not have been seen outside of it, are left out.
    """
    start, left = outside(problem, before)
    if left - criterion.floor > criterion.usual * _left(criterion, before):
        return
    levels = _alone(problem, start, one_per_id(scan(problem, start, effects)[:_FORMS]))
    for fit in _joint(problem, criterion, before, levels):
        ended = _to_the_end(problem, criterion, before, fit)
        if are_reached(problem, ended):
            yield ended
            if _is_reached(criterion, ended):
                return
    switched = [effect for effect in effects if not effect.is_over_time]
    found = list(_switched(problem, criterion, before, _leading(problem, criterion, (start, before), switched)))
    best: Fit | None = None
    for _ in range(_ROUNDS):
        last, best = best, next(iter(_ranked(criterion, found)), None)
        if best is None or best is last:
            break
        found += _switched(problem, criterion, before, _exchanged(problem, criterion, best, switched))
    leading = _ranked(criterion, found)[:_LAWS]
    found += _switched(problem, criterion, before, [new for fit in leading if (new := placed(problem, fit)) is not fit])
    yield from found


def _switched(problem: Problem, criterion: Criterion, before: Fit, begun: Iterable[Fit]) -> Iterator[Fit]:
    """Fits of laws in windows, continued, each once with windows of its own and with one for all where they agree,
    without those that are not switched on and off."""
    for own in (placed(problem, fit) for fit in begun):
        one = shared(problem, own.hypothesis)
        made = try_fit(problem, one) if one is not None else None
        for fit in (own, *([made] if made is not None else [])):
            ended = _to_the_end(problem, criterion, before, fit)
            is_switched = has_edges(ended) and are_reached(problem, ended)
            if is_switched and is_off_outside(problem, ended, criterion.floor, criterion.slack):
                yield settled(problem, ended)


def _exchanged(problem: Problem, criterion: Criterion, best: Fit, effects: Sequence[Effect]) -> Iterator[Fit]:
    """Other laws in the windows of the best: a law that was fitted in windows of its own may stand beside them, and
    would lose for that and not for its law."""
    start, term = standing(problem, best.hypothesis.without(-1)), best.hypothesis.terms[-1]
    others = [in_window_of(effect, term) for effect in effects if effect.id != term.effect.id]

    def cost(candidate: ScannedForm) -> float:
        left = _left(criterion, start) - candidate.gain / criterion.rows
        return criterion.penalty(candidate.effect.size, 1, left) - criterion.likelihood(left)

    scanned = sorted(scan(problem, start, others, near=term.law.values), key=cost)
    for candidate in one_per_id(scanned)[:_LAWS]:
        made = try_term(problem, start, candidate.term, incumbent=best.chi2)
        if made is not None:
            yield made


def _leading(problem: Problem, criterion: Criterion, fits: tuple[Fit, Fit], effects: Sequence[Effect]) -> list[Fit]:
    """The best fits of laws in windows, best first. fits: of the baseline where nothing acts, and of all."""
    start, before = fits
    scanned = scan_windows(problem, start, effects)
    laws = one_per_id(scanned)
    alone = _alone(problem, start, laws)
    best = {_effect(fit).id for fit in _ranked(criterion, alone)[:_LAWS]}
    done = {id(candidate) for candidate in laws}
    more = _alone(problem, start, (c for c in scanned if c.effect.id in best and id(c) not in done))
    return _joint(problem, criterion, before, [*alone, *more])


def _joint(problem: Problem, criterion: Criterion, before: Fit, alone: Sequence[Fit]) -> list[Fit]:
    """Laws that were fitted beside a held baseline, fitted with it: the best form of each, best first."""
    found: dict[str, Fit] = {}
    for fit in _ranked(criterion, alone)[:_FORMS]:
        made, name = try_fit(problem, fit.hypothesis), _effect(fit).id
        if made is not None and made.chi2 < found.get(name, before).chi2:
            found[name] = made
    return _ranked(criterion, found.values())[:_LAWS]


def _ranked(criterion: Criterion, fits: Iterable[Fit]) -> list[Fit]:
    """Fits of one law by what decides between them, best first: a simpler law that explains as much comes before."""

    def cost(fit: Fit) -> float:
        misfit = _left(criterion, fit)
        return criterion.penalty(_effect(fit).size, 1, misfit) - criterion.likelihood(misfit)

    return sorted(fits, key=cost)


def _effect(fit: Fit) -> Effect:
    return fit.hypothesis.terms[-1].effect


def _to_the_end(problem: Problem, criterion: Criterion, before: Fit, fit: Fit) -> Fit:
    """A fit, continued where a right law may leave as much, and not yet the noise."""
    near = _left(criterion, fit) < criterion.usual * _left(criterion, before)
    return fitted_on(problem, fit) if near and not _is_reached(criterion, fit) else fit


def _alone(problem: Problem, start: Fit, candidates: Iterable[ScannedForm]) -> list[Fit]:
    """Fits of laws, and windows, beside a baseline that is held."""
    fits = [try_fit(problem, start.hypothesis.beside(candidate.term), last=True) for candidate in candidates]
    return [fit for fit in fits if fit is not None]


def _left(criterion: Criterion, fit: Fit) -> float:
    return criterion.misfit(fit, float("nan"))


def _is_reached(criterion: Criterion, fit: Fit) -> bool:
    return criterion.is_reached(_left(criterion, fit))
