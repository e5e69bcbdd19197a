"""What held-out recordings say about a fit, by their own noise, level and kind."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from hystid.diagnosis.decide.criterion import Criterion
from hystid.diagnosis.fit.problem import Fit, Hypothesis, Problem, standing
from hystid.diagnosis.fit.windows import for_recording, has_windows
from hystid.diagnosis.model.channel_effects import ChannelEffect
from hystid.diagnosis.prepare.segments import Part
from hystid.errors import NumericalError

ANOTHER_STATE = 0.1  # probability that a held-out recording is of another state of the structure: it then says nothing


def unseen_likelihood(problem: Problem, unseen: Sequence[Part]) -> Callable[[Fit, Fit], float]:
    """A function of the baseline and of a fit: logarithm of the likelihood of the unseen recordings under the fit, over
    that under the baseline. A recording alone can make a fit ten times less probable, never impossible."""
    alone = [problem.of([part]) for part in unseen]
    known: dict[int, list[tuple[Criterion, float]]] = {}

    def told(before: Fit, after: Fit) -> float:
        if id(before) not in known:
            known[id(before)] = [_judged(one, before) for one in alone]
        total = 0.0
        for one, (criterion, without) in zip(alone, known[id(before)], strict=True):
            gain = _likelihood(one, criterion, after.hypothesis) - without
            total += float(np.logaddexp(np.log(1 - ANOTHER_STATE) + gain, np.log(ANOTHER_STATE) + max(gain, 0.0)))
        return total

    return told


def _judged(problem: Problem, before: Fit) -> tuple[Criterion, float]:
    criterion = Criterion(problem, standing(problem, _without_channel(before.hypothesis)), 1)
    return criterion, _likelihood(problem, criterion, before.hypothesis)


def _likelihood(problem: Problem, criterion: Criterion, hypothesis: Hypothesis) -> float:
    try:
        told = [_one(problem, criterion, _without_channel(variant)) for variant in _variants(hypothesis)]
    except NumericalError:
        return -np.inf
    return float(np.logaddexp.reduce(told) - np.log(len(told)))


def _one(problem: Problem, criterion: Criterion, hypothesis: Hypothesis) -> float:
    fit = standing(problem, hypothesis)
    return criterion.likelihood(criterion.misfit(fit, criterion.floor)) if np.isfinite(fit.chi2) else -np.inf


def _variants(hypothesis: Hypothesis) -> list[Hypothesis]:
    """A hypothesis as it may stand in a recording of which nothing is known: what acts for a part of the time may act
    then as long as ever, never, or always."""
    if not has_windows(hypothesis):
        return [hypothesis]
    never = tuple(term for term in hypothesis.terms if term.law.effect is term.effect)
    always = tuple(term.law for term in hypothesis.terms)
    return [for_recording(hypothesis), replace(hypothesis, terms=never), replace(hypothesis, terms=always)]


def _without_channel(hypothesis: Hypothesis) -> Hypothesis:
    """A hypothesis without the faults of the force channel, which differ from recording to recording."""
    return replace(hypothesis, terms=tuple(t for t in hypothesis.terms if not isinstance(t.effect, ChannelEffect)))
