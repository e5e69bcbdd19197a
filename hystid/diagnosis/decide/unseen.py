"""What held-out recordings say about a fit, by their own noise, level and kind."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from hystid.diagnosis.decide.criterion import Criterion, effective_states
from hystid.diagnosis.fit.problem import Fit, Hypothesis, Problem, standing
from hystid.diagnosis.fit.windows import for_recording, has_windows
from hystid.diagnosis.model.channel_effects import ChannelEffect
from hystid.diagnosis.prepare.segments import Part
from hystid.errors import NumericalError

ANOTHER_STATE = 0.1  # probability that a held-out recording is of another state of the structure: it then says nothing


def unseen_likelihood(problem: Problem, unseen: Sequence[Part]) -> Callable[[Fit, Fit], float]:
    """A function of the baseline and of a fit: logarithm of the likelihood that unseen recordings add to a fit, over
    what they add to the baseline. A recording alone can make a fit ten times less probable, never impossible."""
    alone = [problem.of([part]) for part in unseen]
    known: dict[int, list[_Judge]] = {}

    def told(before: Fit, after: Fit) -> float:
        if id(before) not in known:
            trained = Criterion(problem, before, 1)
            known[id(before)] = [_Judge(trained, one, before) for one in alone]
        total = 0.0
        for judge in known[id(before)]:
            gain = judge.added(after) - judge.added(before)
            total += float(np.logaddexp(np.log(1 - ANOTHER_STATE) + gain, np.log(ANOTHER_STATE) + max(gain, 0.0)))
        return total

    return told


class _Judge:
    """One unseen recording beside those that were used.

    A law that is a little wrong is so wherever the motion comes back to the same state. States that the recordings in
    use have shown already say nothing anew about its form: the likelihood is that of all rows over all states, less
    that of the rows in use.
    """

    def __init__(self, trained: Criterion, alone: Problem, before: Fit) -> None:
        self.trained, self.alone = trained, alone
        self.seen = Criterion(alone, standing(alone, _without_channel(before.hypothesis)), 1)
        self.rows = trained.rows + self.seen.rows
        self.states = effective_states([trained.problem, alone])

    def added(self, fit: Fit) -> float:
        """What the recording adds to the logarithm of the likelihood of a fit."""
        used = self.trained.misfit(fit, float("nan"))
        try:
            told = [self._joined(used, _without_channel(variant)) for variant in _variants(fit.hypothesis)]
        except NumericalError:
            return -np.inf
        return float(np.logaddexp.reduce(told) - np.log(len(told))) - self.trained.likelihood(used)

    def _joined(self, used: float, hypothesis: Hypothesis) -> float:
        fit = standing(self.alone, hypothesis)
        if not np.isfinite(fit.chi2):
            return -np.inf
        excesses = (used, self.trained), (self.seen.misfit(fit, self.seen.floor), self.seen)
        square = sum(c.rows * (max(misfit, 0.0) + c.accuracy) for misfit, c in excesses)
        return -0.5 * self.states * float(np.log1p(square / self.states))


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
