"""What held-out recordings say about a fit, by their own noise, level and kind."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from hystid.diagnosis.decide.criterion import Criterion, visited
from hystid.diagnosis.fit.hypothesis import Fit, Hypothesis
from hystid.diagnosis.fit.problem import Problem, standing
from hystid.diagnosis.fit.windows import for_recording, has_windows
from hystid.diagnosis.model.channel_effects import ChannelEffect
from hystid.diagnosis.prepare.segments import Part
from hystid.errors import NumericalError

ANOTHER_STATE = 0.1  # probability that a held-out recording is of another state of the structure: it then says nothing


def unseen_likelihood(problem: Problem, unseen: Sequence[Part]) -> Callable[[Fit, Fit], float]:
    """A function of the baseline and of a fit: logarithm of the likelihood that unseen recordings add to a fit, over
    what they add to the baseline. A recording alone can make a fit ten times less probable, never impossible."""
    alone = [problem.of([part]) for part in unseen]
    for one in alone:
        if problem.weighed_by:  # where a law jumps, nobody knows there either on which side it stands
            one.distrust(*map(_without_channel, problem.weighed_by))
    known: dict[int, list[_Judge]] = {}

    def told(before: Fit, after: Fit) -> float:
        if id(before) not in known:
            known[id(before)] = [_Judge(problem, one, before) for one in alone]
        total = 0.0
        for judge in known[id(before)]:
            gain = judge.gain(after)
            total += float(np.logaddexp(np.log(1 - ANOTHER_STATE) + gain, np.log(ANOTHER_STATE) + max(gain, 0.0)))
        return total

    return told


class _Judge:
    """One unseen recording: what it says about a fit against the baseline.

    An error of a law repeats wherever the motion comes back to the same state. Hence a fit that does better in states
    that the recordings in use have shown proves no form anew, and counts for the share of other states alone. One that
    does worse than the baseline contradicts the law in any state.
    """

    def __init__(self, trained: Problem, alone: Problem, before: Fit) -> None:
        self.alone, self.before = alone, standing(alone, _without_channel(before.hypothesis))
        self.seen = Criterion(alone, self.before, 1)
        old, own = visited([trained, alone])
        self.new = float(np.count_nonzero(own & ~old)) / float(np.count_nonzero(own))

    def gain(self, fit: Fit) -> float:
        """Logarithm of the likelihood of a fit in this recording, over that of the baseline."""
        try:
            told = [self._likelihood(standing(self.alone, _without_channel(h))) for h in _variants(fit.hypothesis)]
        except NumericalError:
            return -np.inf
        gain = float(np.logaddexp.reduce(told) - np.log(len(told))) - self._likelihood(self.before)
        return gain * (self.new if gain > 0 else 1.0)

    def _likelihood(self, fit: Fit) -> float:
        if not np.isfinite(fit.chi2):
            return -np.inf
        return self.seen.likelihood(self.seen.misfit(fit, self.seen.floor))


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
