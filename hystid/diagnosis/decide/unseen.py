"""What held-out recordings say about a fit, by their own noise, level and kind."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from hystid.diagnosis.decide.criterion import Criterion, visited
from hystid.diagnosis.fit.hypothesis import Fit, Hypothesis
from hystid.diagnosis.fit.problem import Problem, standing
from hystid.diagnosis.fit.windows import for_recording, has_windows
from hystid.diagnosis.fit.windowscan import in_every_interval
from hystid.diagnosis.prepare.segments import Part
from hystid.errors import NumericalError

ANOTHER_STATE = 0.1  # probability that a held-out recording is of another state of the structure: it then says nothing


def unseen_likelihood(problem: Problem, unseen: Sequence[Part]) -> Callable[[Fit, Fit], float]:
    """A function of the baseline and of a fit: logarithm of the likelihood that unseen recordings add to a fit, over
    what they add to the baseline. A recording alone can make a fit ten times less probable, never impossible."""
    alone = [one for part in unseen if (one := problem.elsewhere([part])).reduce.count]
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
        self.alone, self.before = alone, standing(alone, before.hypothesis.elsewhere())
        self.seen = Criterion(alone, self.before, 1)
        old, own = visited([trained, alone])
        self.new = float(np.count_nonzero(own & ~old)) / float(np.count_nonzero(own))

    def gain(self, fit: Fit) -> float:
        """Logarithm of the likelihood of a fit in this recording, over that of the baseline."""
        try:
            told = self._told(fit.hypothesis.elsewhere())
        except NumericalError:
            return -np.inf
        gain = _mean(told) - self._likelihood(self.before)
        return gain * (self.new if gain > 0 else 1.0)

    def _told(self, hypothesis: Hypothesis) -> list[float]:
        """Likelihoods of a hypothesis as it may stand in a recording of which nothing is known: what acts for a part of
        the time may act then as long as ever, never, always, or from any time to any other."""
        if not has_windows(hypothesis):
            return [self._likelihood(standing(self.alone, hypothesis))]
        off = tuple(term for term in hypothesis.terms if term.law.effect is term.effect)
        on = tuple(term.law for term in hypothesis.terms)
        never, always = (standing(self.alone, replace(hypothesis, terms=terms)) for terms in (off, on))
        any_ = [self._of_mean_square(chi2) for chi2 in in_every_interval(self.alone, never, always)]
        as_ever = standing(self.alone, for_recording(hypothesis))
        return [*map(self._likelihood, (as_ever, never, always)), _mean(any_)]

    def _likelihood(self, fit: Fit) -> float:
        if not np.isfinite(fit.chi2):
            return -np.inf
        return self.seen.likelihood(self.seen.misfit(fit, self.seen.floor))

    def _of_mean_square(self, chi2: float) -> float:
        """The same of residuals of which the mean square alone is known."""
        return self.seen.likelihood(chi2 - self.seen.floor) if np.isfinite(chi2) else -np.inf


def _mean(logarithms: Sequence[float]) -> float:
    """Logarithm of the mean of what has these logarithms."""
    return float(np.logaddexp.reduce(logarithms) - np.log(len(logarithms)))
