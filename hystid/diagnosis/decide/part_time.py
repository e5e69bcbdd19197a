"""Effects that act for a part of the time: laws fitted in the windows in which they explain most."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

from hystid.diagnosis.decide.criterion import Criterion
from hystid.diagnosis.decide.trials import are_reached, fitted_on
from hystid.diagnosis.fit.hypothesis import Fit
from hystid.diagnosis.fit.problem import Problem, standing
from hystid.diagnosis.fit.search import try_fit, try_term
from hystid.diagnosis.fit.windows import has_edges, is_off_outside, settled, shared
from hystid.diagnosis.fit.windowscan import scan_windows
from hystid.diagnosis.model.effects import Effect

_LAWS, _FORMS = 3, 6  # laws that are fitted to the end, and forms that are tried
_LOOKS, _AGAIN = 3, 0.7  # looks for windows, and share of the misfit that is left by one which is worth another


def in_windows(
    problem: Problem, criterion: Criterion, before: Fit, effects: Sequence[Effect], reached: float
) -> Iterator[Fit]:
    """Fits of the baseline and one law that is switched on and off, each once with windows of its own per recording,
    and with one for all where they agree.

    reached: mean square that a law which acts all the time leaves; windows that promise no less are not fitted. Laws
    that open or close over most of their window, or that would not have been seen outside of it, are left out.
    """
    switched = [effect for effect in effects if not effect.is_over_time]
    leading = _leading(problem, criterion, before, switched, reached)
    for begun in leading[:_LAWS]:
        one = shared(problem, begun.hypothesis)
        made = try_fit(problem, one) if one is not None else None
        for fit in (begun, *([made] if made is not None else [])):
            ended = fit if _is_reached(criterion, fit) else fitted_on(problem, fit)
            term = ended.hypothesis.terms[-1]
            if (
                has_edges(ended)
                and are_reached(problem, ended)
                and is_off_outside(term, problem.signals(ended.hypothesis))
            ):
                yield settled(problem, ended)


def _leading(
    problem: Problem, criterion: Criterion, before: Fit, effects: Sequence[Effect], reached: float
) -> list[Fit]:
    """The best fit of each law, best first.

    A refit without the effect stands where a part of the time pulls it. Hence windows are looked for once more beside
    the baseline as it stands in the best fit, as long as that leads on.
    """
    found: dict[str, Fit] = {}
    start = best = before
    for _ in range(_LOOKS):
        scanned = scan_windows(problem, start, effects)
        promised = max((candidate.gain for candidate in scanned), default=0.0) / len(start.residual)
        if not found and start.chi2 - promised >= reached:
            break
        laws = {candidate.effect.id: candidate for candidate in reversed(scanned)}
        first = sorted(laws.values(), key=lambda candidate: -candidate.gain)[:_LAWS]
        for candidate in {id(c): c for c in (*first, *scanned[:_FORMS])}.values():
            made = try_term(problem, start, candidate.term, bar=best.chi2 if found else 0.0)
            if made is not None and made.chi2 < found.get(candidate.effect.id, before).chi2:
                found[candidate.effect.id] = made
        last, best = best, min([best, *found.values()], key=lambda fit: fit.chi2)
        if best is last or _is_reached(criterion, best) or _left(criterion, best) > _AGAIN * _left(criterion, last):
            break
        start = standing(problem, replace(best.hypothesis, terms=best.hypothesis.terms[:-1]))
    return sorted(found.values(), key=lambda fit: fit.chi2)


def _left(criterion: Criterion, fit: Fit) -> float:
    return criterion.misfit(fit, float("nan"))


def _is_reached(criterion: Criterion, fit: Fit) -> bool:
    return criterion.is_reached(_left(criterion, fit))
