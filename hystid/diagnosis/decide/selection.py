"""From hypotheses to names: the criterion weighs them all, and the most probable one that can be told is named."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from hystid.diagnosis.decide.criterion import (
    MENTION,
    NAME,
    Candidate,
    Criterion,
    FittedSet,
    Posterior,
    zero_probability,
)
from hystid.diagnosis.decide.hypotheses import ROUNDS, Search
from hystid.diagnosis.decide.lawfree import free_curves
from hystid.diagnosis.decide.limits import blames_in_vain
from hystid.diagnosis.decide.trials import LAST, Trial, are_reached
from hystid.diagnosis.fit.hypothesis import Fit, Key, is_mass
from hystid.diagnosis.fit.independence import is_noise
from hystid.diagnosis.fit.problem import Problem
from hystid.diagnosis.fit.search import ABSORBED, ScannedForm, other_minima, try_fit
from hystid.diagnosis.fit.zeros import zero_of_term
from hystid.diagnosis.model.effects import Effect

_ALIKE_NAMES = 0.05  # of the probability of what leads: less is told apart, unless it fits better with more parameters


@dataclass(frozen=True)
class Choice:
    """Outcome of the selection.

    before: the refitted baseline; after: with the named effects (the same where none is named). named: ids, strongest
    first; classes: ids that the data cannot tell from each name; probabilities and shares: of each name's class, and of
    the misfit above the noise that its law explains. left_open: standard deviation that other forms leave.
    """

    before: Fit
    after: Fit
    floor_before: float
    floor_after: float
    posterior: Posterior
    named: tuple[str, ...] = ()
    classes: tuple[tuple[str, ...], ...] = ()
    probabilities: tuple[float, ...] = ()
    shares: tuple[float, ...] = ()
    trials: tuple[Trial, ...] = field(repr=False, default=())
    untestable: tuple[str, ...] = ()
    left_open: Mapping[Key, float] = field(repr=False, default_factory=dict)

    @property
    def missing(self) -> bool:
        """Whether something is missing, whatever its name."""
        return self.posterior.something > NAME

    @property
    def unknown(self) -> bool:
        """Whether something is missing that has no name."""
        return not self.named and self.missing

    def without_names(self) -> Choice:
        """The same where nothing is named: what was named contradicts the recordings, and is as unknown as anything."""
        listed = tuple(replace(c, probability=0.0) for c in self.posterior.candidates)
        held = replace(self.posterior, candidates=listed, unknown=1.0 - self.posterior.nothing)
        return Choice(
            self.before, self.before, self.floor_before, self.floor_before, held, trials=self.trials,
            untestable=self.untestable,
        )  # fmt: skip

    @property
    def best(self) -> Fit:
        """The fit that leaves least."""
        return min([self.before, *(c.hypothesis.fit for c in self.posterior.candidates)], key=lambda fit: fit.chi2)

    @property
    def explained(self) -> float:
        """Share of the misfit above the noise that the named effects explain."""
        excess = self.before.chi2 - self.floor_before
        return float(min(1.0, (self.before.chi2 - self.after.chi2) / excess)) if excess > 0 else 1.0


Unseen = Callable[[Fit, Fit], float]  # logarithm of the likelihood of held-out recordings, over that of the baseline


def choose(
    problem: Problem,
    baseline: Fit,
    effects: Sequence[Effect],
    progress: Callable[[], None] = lambda: None,
    *,
    minima: Sequence[Fit] = (),
    unseen: Unseen = lambda before, after: 0.0,
    known: Sequence[FittedSet] = (),
) -> Choice:
    """Name what the refitted baseline leaves, or say that nothing, or nothing known, is there.

    minima: other local minima of the refit. unseen: what held-out recordings say about a fit. known: hypotheses about
    the same recordings that are fitted again.
    """
    search = Search(problem, baseline, effects, progress, minima)
    return _decided(search, search.hypotheses(list(search.again(known))), unseen)


def choose_among(
    known: Sequence[FittedSet], problem: Problem, baseline: Fit, effects: Sequence[Effect], unseen: Unseen
) -> Choice:
    """The same among hypotheses about the same recordings, fitted again, and no others."""
    search = Search(problem, baseline, effects, lambda: None, ())
    return _decided(search, list(search.again(known)), unseen)


def weigh(problem: Problem, baseline: Fit, effects: Sequence[Effect], known: Sequence[FittedSet]) -> Posterior:
    """Probabilities of some hypotheses about the same recordings, fitted again, and of what the leading one is with its
    members exchanged: they were chosen under another assumption."""
    search = Search(problem, baseline, effects, lambda: None, ())
    found = list(search.again(known))
    leader = min(found, key=lambda h: h.fit.chi2, default=None)
    if leader is not None:
        found += search.exchanged(leader)
    criterion = search.criterion.with_level(found, _level(search, found))
    curves = free_curves(problem, baseline) if found else ()
    return criterion.posterior(found, is_noise=search.is_noise, curves=tuple(curves))


def _decided(search: Search, found: Sequence[FittedSet], unseen: Unseen) -> Choice:
    """The choice that the probabilities of the hypotheses lead to."""
    before, noise = search.baseline, search.is_noise
    criterion = search.criterion.with_level(found, _level(search, found))
    curves = tuple(free_curves(search.problem, before)) if len(found) > 0 else ()

    def weighed(hypotheses: Sequence[FittedSet]) -> Posterior:
        return criterion.posterior(hypotheses, is_noise=noise, curves=curves)

    found = _pruned(search, found, weighed, criterion)
    near = weighed(found).likely
    zeros = {id(h): _with_zero(search.problem, h) for h in near}
    found = [zeros.get(id(h), h) for h in found]
    # Held-out recordings cost a run each: what has no chance is not asked.
    said = {frozenset(h.names): unseen(before, h.fit) for h in zeros.values()}
    heard = [replace(h, unseen=said.get(h.counting or frozenset(h.names), h.unseen)) for h in found]
    posterior = weighed(heard)
    untestable = _untestable(search.candidates)
    chosen = _told(criterion, posterior)
    if chosen is not None and blames_in_vain(search.problem, chosen[0].hypothesis.fit):
        chosen = None
    if chosen is None:
        if posterior.zero is not None:  # what is left is the zero of a sensor
            before = posterior.zero.fit
        return Choice(
            before, before, search.floor, search.floor, posterior, trials=tuple(search.first), untestable=untestable
        )
    leader, names = chosen
    ended = _to_the_end(search.problem, search.criterion, leader.hypothesis.fit)
    if len(names) > 1 and ended is not leader.hypothesis.fit:
        rests = list(search.without_one(replace(leader.hypothesis, fit=ended), criterion))
        if not all(counts for _, counts in rests):  # a member made up for a side minimum of the others
            others = [h for h in found if frozenset(h.names) != frozenset(leader.names)]
            reached = [rest for rest, _ in rests if are_reached(search.problem, rest.fit)]
            return _decided(search, [*reached, *others], unseen)
    after = _with_one_mass(search.problem, ended)
    classes = [_class(criterion, posterior, leader, name) for name in names]
    return Choice(
        before, after, search.floor, search.problem.floor(after), posterior, names,
        tuple(alike for alike, _ in classes), tuple(p for _, p in classes), _shares(search, leader, names),
        tuple(search.first), untestable,
    )  # fmt: skip


def _pruned(
    search: Search,
    found: Sequence[FittedSet],
    weighed: Callable[[Sequence[FittedSet]], Posterior],
    criterion: Criterion,
) -> list[FittedSet]:
    """Hypotheses of which sets with a member that does not count speak for the others, and what sets are without one of
    theirs: what grew by the best further effect may hold one that the next makes idle; and where one may stand for what
    is left without counting, another one that does may not be sure. What leads then has its members exchanged."""
    pruned, seen, idle = list(found), set[frozenset[str]](), dict[frozenset[str], frozenset[str] | None]()
    for _ in range(ROUNDS):
        for h in weighed(pruned).likely:
            if len(h.names) < 2 or frozenset(h.names) in seen:
                continue
            seen.add(frozenset(h.names))
            rests = list(search.without_one(h, criterion))
            reached = [rest for rest, _ in rests if are_reached(search.problem, rest.fit)]
            pruned += reached
            if not all(counts for _, counts in rests):
                spoken = [rest for rest, counts in rests if not counts and any(rest is one for one in reached)]
                least = min(spoken, key=lambda rest: rest.fit.chi2, default=None)
                idle[frozenset(h.names)] = frozenset(least.names) if least is not None else None
        pruned = [made for h in pruned if (made := _counted(h, idle)) is not None]
    leader = next(iter(weighed(pruned).likely), None)  # the most probable one comes first
    if leader is not None and not any(leader is h for h in found):  # fitted in a set only, beside no simpler law
        pruned += search.exchanged(leader)
    return pruned


def _counted(hypothesis: FittedSet, idle: Mapping[frozenset[str], frozenset[str] | None]) -> FittedSet | None:
    """A hypothesis that speaks for what is left of it without members that do not count; None where nothing is."""
    names = frozenset(hypothesis.names)
    left: frozenset[str] | None = hypothesis.counting or names
    while left is not None and left in idle:
        left = idle[left]
    return None if left is None else hypothesis if left == names else replace(hypothesis, counting=left)


def _with_zero(problem: Problem, hypothesis: FittedSet) -> FittedSet:
    """A hypothesis that knows whether a constant force of it may be the zero of the displacement sensor."""
    here = hypothesis.fit.hypothesis
    for term in here.terms:
        if term.effect.id in hypothesis.names and (zero := zero_of_term(problem, here, term)) is not None:
            return replace(hypothesis, constant=term.effect.id, zero=zero_probability(zero.share))
    return hypothesis


def _level(search: Search, found: Sequence[FittedSet]) -> float:
    """Misfit of the best hypothesis where what it leaves is shown to be noise; infinite where it is not."""
    if search.is_noise or not found:
        return np.inf
    misfit, fit = min(((search.criterion.misfit(h.fit, h.floor), h.fit) for h in found), key=lambda pair: pair[0])
    return misfit if misfit > search.criterion.slack and is_noise(search.problem, fit) else np.inf


def _told(criterion: Criterion, posterior: Posterior) -> tuple[Candidate, tuple[str, ...]] | None:
    """The set of effects that is named, strongest first; None where no name is probable enough."""
    if not posterior.candidates or posterior.something < NAME:
        return None
    for leader in _plainest_first(criterion, posterior.candidates):
        if all(_class(criterion, posterior, leader, name)[1] >= NAME for name in leader.names):
            return leader, leader.names
    return None


def _plainest_first(criterion: Criterion, candidates: Sequence[Candidate]) -> list[Candidate]:
    """Candidates, most probable first; of those that fit like the first one and are about as probable, the one with the
    fewest numbers: a stop with a second side that is never reached is a stop on one side."""
    first = candidates[0]
    same = [
        c for c in candidates
        if c.probability > MENTION * first.probability and len(c.names) == len(first.names)
        and not criterion.predicts_else(c.hypothesis, first.hypothesis)
    ]  # fmt: skip
    plainest = min(same, key=lambda c: c.hypothesis.numbers, default=first)
    return [plainest, *(c for c in candidates if c is not plainest)]


def _class(criterion: Criterion, posterior: Posterior, leader: Candidate, name: str) -> tuple[tuple[str, ...], float]:
    """Ids that predict the same as one name of the leading set, or are about as probable, and the probability that one
    of them is missing."""
    alike = [name]
    rest = {n for n in leader.names if n != name}
    for other in posterior.candidates:
        swapped = set(other.names) - rest
        if len(other.names) == len(leader.names) and len(swapped) == 1 and other is not leader:
            (instead,) = swapped
            gain = criterion.gain(other.hypothesis, leader.hypothesis)
            near = other.probability > _ALIKE_NAMES * leader.probability or gain > 1.0
            same = near and not criterion.predicts_else(other.hypothesis, leader.hypothesis)
            if instead not in alike and (same or other.probability > MENTION * leader.probability):
                alike.append(instead)
    return tuple(alike), min(1.0, posterior.of(alike))


def _shares(search: Search, leader: Candidate, names: Sequence[str]) -> tuple[float, ...]:
    """Share of the misfit that each named law explains: what taking it away costs; of a single one, all it explains."""
    if len(names) == 1:
        return (leader.explained,)
    here, found = leader.hypothesis.fit, []
    for name in names:
        terms = tuple(t for t in here.hypothesis.terms if t.effect.id != name)
        made = try_fit(search.problem, replace(here.hypothesis, terms=terms), iterations=6)
        cost = (made.chi2 - here.chi2) / search.excess if made is not None else 1.0
        found.append(float(min(max(cost, 0.0), 1.0)))
    return tuple(found)


def _with_one_mass(problem: Problem, fitted: Fit) -> Fit:
    """Added mass that holds what the refit took for a mass error as well: the two are one."""
    here = fitted.hypothesis
    at = next((i for i, term in enumerate(here.terms) if is_mass(term.effect)), None)
    if at is None or here.mass_error == 0.0:
        return fitted
    term = here.terms[at]
    name = term.effect.semantics.mass
    whole = replace(term, values={**term.values, name: term.values[name] + here.mass_error * here.values["m"]})
    there = replace(here.exchanged(at, whole), mass_error=0.0)
    rows = problem.rows(there)
    return replace(fitted, hypothesis=there, residual=rows, chi2=fitted.chi2 * float(rows @ rows) / fitted.rss)


def _to_the_end(problem: Problem, criterion: Criterion, reached: Fit) -> Fit:
    """What is named, fitted to the end: comparisons accept a side minimum, or end early."""
    for _ in range(ROUNDS):
        if criterion.is_reached(reached.chi2 - problem.floor(reached)):
            return reached
        on = try_fit(problem, reached.hypothesis, LAST) or reached
        fits = [try_fit(problem, start, LAST, incumbent=on.chi2) for start in other_minima(problem, on)]
        best = min([reached, on, *(made for made in fits if made is not None)], key=lambda made: made.chi2)
        if best.chi2 > reached.chi2 - criterion.slack:
            return best
        reached = best
    return reached


def _untestable(candidates: Sequence[ScannedForm]) -> tuple[str, ...]:
    """Ids of which every form is collinear with the refit."""
    least: dict[str, float] = {}
    for candidate in candidates:
        ident = candidate.effect.id
        least[ident] = min(least.get(ident, 1.0), candidate.absorbed)
    return tuple(sorted(ident for ident, share in least.items() if share > ABSORBED))
