"""Effects that act for a part of the time: laws fitted in the windows in which they explain most."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace

from hystid.diagnosis.decide.criterion import Criterion
from hystid.diagnosis.decide.trials import are_reached, fitted_on
from hystid.diagnosis.fit.hypothesis import Fit
from hystid.diagnosis.fit.problem import Problem
from hystid.diagnosis.fit.search import Candidate, try_fit
from hystid.diagnosis.fit.windows import has_edges, is_off_outside, settled, shared
from hystid.diagnosis.fit.windowscan import outside, scan_windows
from hystid.diagnosis.model.effects import Effect

_LAWS, _FORMS = 3, 6  # laws that are fitted to the end, and forms that are tried


def in_windows(problem: Problem, criterion: Criterion, before: Fit, effects: Sequence[Effect]) -> Iterator[Fit]:
    """Fits of the baseline and one law that is switched on and off, each once with windows of its own per recording,
    and with one for all where they agree.

    Laws that open or close over most of their window, or that would not have been seen outside of it, are left out.
    """
    switched = [effect for effect in effects if not effect.is_over_time]
    leading = _leading(problem, criterion, before, switched)
    for begun in leading[:_LAWS]:
        one = shared(problem, begun.hypothesis)
        made = try_fit(problem, one) if one is not None else None
        for fit in (begun, *([made] if made is not None else [])):
            near = _left(criterion, fit) < criterion.usual * _left(criterion, before)  # a right law leaves no more
            ended = fitted_on(problem, fit) if near and not _is_reached(criterion, fit) else fit
            term = ended.hypothesis.terms[-1]
            if (
                has_edges(ended)
                and are_reached(problem, ended)
                and is_off_outside(term, problem.signals(ended.hypothesis))
            ):
                yield settled(problem, ended)


def _leading(problem: Problem, criterion: Criterion, before: Fit, effects: Sequence[Effect]) -> list[Fit]:
    """The best fit of each law, best first; [] where there is no time in which nothing acts.

    A refit without the effect stands where a part of the time pulls it. Hence law and window are looked for beside the
    baseline as it fits where nothing acts, and fitted alone before both are. There the baseline is a right law.
    """
    start, left = outside(problem, before)
    if left - criterion.floor > criterion.usual * _left(criterion, before):
        return []
    scanned = scan_windows(problem, start, effects)
    laws = {candidate.effect.id: candidate for candidate in reversed(scanned)}
    alone = _alone(problem, start, laws.values())
    best = {fit.hypothesis.terms[-1].effect.id for fit in alone[:_LAWS]}
    done = {id(candidate) for candidate in laws.values()}
    alone += _alone(problem, start, (c for c in scanned if c.effect.id in best and id(c) not in done))
    found: dict[str, Fit] = {}
    for fit in sorted(alone, key=lambda fit: fit.chi2)[:_FORMS]:
        made, name = try_fit(problem, fit.hypothesis), fit.hypothesis.terms[-1].effect.id
        if made is not None and made.chi2 < found.get(name, before).chi2:
            found[name] = made
    return sorted(found.values(), key=lambda fit: fit.chi2)


def _alone(problem: Problem, start: Fit, candidates: Iterable[Candidate]) -> list[Fit]:
    """Fits of laws and windows beside a baseline that is held, best first."""
    here = start.hypothesis
    terms = [(*here.terms, candidate.term) for candidate in candidates]
    fits = [try_fit(problem, replace(here, terms=t), last=True) for t in terms]
    return sorted((fit for fit in fits if fit is not None), key=lambda fit: fit.chi2)


def _left(criterion: Criterion, fit: Fit) -> float:
    return criterion.misfit(fit, float("nan"))


def _is_reached(criterion: Criterion, fit: Fit) -> bool:
    return criterion.is_reached(_left(criterion, fit))
