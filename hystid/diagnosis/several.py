"""Several effects at once: lines of effects that are followed forward, and members that give way to better ones."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from hystid.diagnosis.blocks import Effect
from hystid.diagnosis.fitting import Fit, Problem, standing
from hystid.diagnosis.search import scan, try_fit
from hystid.diagnosis.sensors import NUISANCES
from hystid.diagnosis.trials import (
    FAR,
    SOUND,
    Step,
    Trial,
    are_reached,
    chain_trials,
    distinct,
    single,
    sound,
    tie,
    trials,
)

_PAIR_WORTH = 0.08  # fall of the mean square that each of several effects must be worth
PAIR_SHARE = 0.045  # share of the excess that each of several effects must cost when it is taken away
_BEGINS = 0.2  # share of the excess that an effect explains from which a line of effects begins
_PAIR_LEFT = 0.05  # share of the excess that several right effects may leave
_RIVALS = 4  # look-alikes of each member, besides its own forms, that are fitted in its place
_IN_SIGHT = 0.7  # share of the way to where another line has come that a scan must see: fits go on, but not far
_LINES, _STARTING = 2, 5  # lines of effects that are followed, from this many ids where lines end in nonsense


def several_effects(
    problem: Problem, before: Fit, first: Sequence[Trial], library: Sequence[Effect], excess: float
) -> list[Step] | None:
    """Two or three effects: forward from the best few, each removal costly, the floor reached; None where that
    fails."""
    reached: list[list[Trial]] = []
    open_ends: list[list[Trial]] = []
    for start in _starts(first, before, excess)[:_STARTING]:
        if len(reached) + len(open_ends) == _LINES:
            break
        line = grow(problem, [start], library, excess, min((line[-1].chi2 for line in reached), default=np.inf))
        if len(line) > 1 and are_reached(problem, line[-1].fit):
            (reached if _complete(problem, line, before, excess) else open_ends).append(line)
    if not reached:
        longest = min(open_ends, key=lambda line: line[-1].chi2, default=None)
        third = grow(problem, longest, library, excess) if longest and _promising(longest, before) else []
        if len(third) > 2 and _complete(problem, third, before, excess):
            reached.append(third)
    if not reached:
        return None
    best = min(line[-1].chi2 for line in reached)
    tied = [line for line in reached if line[-1].chi2 - best < tie(line[-1], excess)]
    simplest = min(tied, key=lambda line: sum(trial.size for trial in line))
    return _exchanged_members(problem, [Step(trial, trial.tied, 0.0) for trial in simplest], library, excess)


def _starts(first: Sequence[Trial], before: Fit, excess: float) -> list[Trial]:
    """Ids from which lines begin, the best first, of those that are not told apart the simplest; the others come
    last."""
    worth = [t for t in distinct(first) if before.chi2 - t.chi2 > _BEGINS * excess]
    leading: list[Trial] = []
    for trial in worth:
        if all(trial.chi2 - other.chi2 > tie(other, excess) for other in leading):
            leading.append(trial)
    alike = [[t for t in worth if 0 <= t.chi2 - one.chi2 <= tie(one, excess)] for one in leading]
    simplest = [min(group, key=lambda t: t.size) for group in alike]
    return list({t.name: t for t in (*simplest, *leading, *worth)}.values())


def _exchanged_members(problem: Problem, steps: Sequence[Step], library: Sequence[Effect], excess: float) -> list[Step]:
    """Every member beside its look-alikes, now that the others are there: the first was chosen when they were not."""
    fit, members = steps[-1].trial.fit, list(steps)
    for number, step in enumerate(members):
        terms = fit.hypothesis.terms
        at = next((i for i, term in enumerate(terms) if term.effect.id == step.trial.name), None)
        if at is None:
            continue
        others = {term.effect.id for i, term in enumerate(terms) if i != at}
        bare = replace(fit.hypothesis, terms=(*terms[:at], *terms[at + 1 :]))
        start = standing(problem, bare)
        rivals = [Trial(step.trial.name, step.trial.form, step.trial.size, fit)]
        laws = [effect for effect in library if effect.id not in others]
        candidates = scan(problem, start, laws)
        kin = [c for c in candidates if c.effect.id == step.trial.name]
        for candidate in (*kin, *[c for c in candidates if c not in kin][:_RIVALS]):
            there = replace(bare, terms=(*terms[:at], candidate.term, *terms[at + 1 :]))
            made = try_fit(problem, there, bar=fit.chi2)
            effect = candidate.effect
            if made is not None and are_reached(problem, made):
                rivals.append(Trial(effect.id, effect.form, effect.size, made))
        rivals.sort(key=lambda trial: trial.chi2)
        best = single(problem, rivals, fit, excess)
        fit = best.trial.fit
        members[number] = Step(replace(best.trial, tied=best.tied), best.tied, step.margin)
    return [replace(step, trial=replace(step.trial, fit=fit)) for step in members]


def _promising(line: Sequence[Trial], before: Fit) -> bool:
    """A third effect is looked for only where two explain most of the mean square."""
    return before.chi2 < FAR and line[-1].chi2 - 1.0 < 0.15 * (before.chi2 - 1.0)


def grow(
    problem: Problem, line: Sequence[Trial], library: Sequence[Effect], excess: float, bar: float = np.inf
) -> list[Trial]:
    """The line with the best further effect; unchanged where there is none.

    bar: what another line has reached; a line is not followed where the scan does not see it come near.
    """
    end = line[-1]
    used = {trial.name for trial in line}
    candidates = [c for c in scan(problem, end.fit, library) if c.effect.id not in used]
    most = max((c.gain for c in candidates), default=0.0) / len(end.fit.residual)
    if most < _IN_SIGHT * (end.chi2 - bar):
        return list(line)
    left = end.chi2 - problem.floor(end.fit.hypothesis)
    found = trials(problem, end.fit, candidates, left, chain_trials(problem, end.fit, library), most=6, bar=bar)
    if not found:
        return list(line)
    step = single(problem, found, end.fit, excess)
    return [*line, replace(step.trial, tied=tuple(name for name in step.tied if name not in used))]


def _complete(problem: Problem, line: Sequence[Trial], before: Fit, excess: float) -> bool:
    """Whether several effects reach the floor and each of them counts; three must reach it without a rest."""
    end = line[-1].fit
    floor = problem.floor(end.hypothesis)
    allowed = max(SOUND * floor, _PAIR_LEFT * excess if len(line) < 3 else 0.0)
    close = len(line) > 1 and end.chi2 - floor < allowed
    return close and are_reached(problem, end) and _each_counts(problem, end, excess)


def _each_counts(problem: Problem, fit: Fit, excess: float) -> bool:
    """Whether taking any effect away and fitting again costs a visible share."""
    hypothesis = fit.hypothesis
    visible = max(_PAIR_WORTH, PAIR_SHARE * excess, sound(problem, 0.0) if problem.reduce.jumps else 0.0)
    for i in range(len(hypothesis.terms)):
        if hypothesis.terms[i].effect.id in NUISANCES:
            continue
        rest = replace(hypothesis, terms=tuple(t for k, t in enumerate(hypothesis.terms) if k != i))
        made = try_fit(problem, rest, iterations=6)
        if made is None or made.chi2 - fit.chi2 < visible:
            return False
    return True
