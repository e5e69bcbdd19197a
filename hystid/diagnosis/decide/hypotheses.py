"""What could be missing: hypotheses are made until none could earn its place any more.

What is tried, and in which order, is a matter of cost. Singles come first; a window of time, and two or three effects
together, only where the best single leaves what a further effect could still earn.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import cached_property

from hystid.diagnosis.decide.criterion import FORM, MENTION, SOUND, Criterion, FittedSet
from hystid.diagnosis.decide.lawfree import free_curves, wrong_forms
from hystid.diagnosis.decide.part_time import in_windows
from hystid.diagnosis.decide.trials import (
    Trial,
    also_from_nominal,
    are_reached,
    chain_trials,
    distinct,
    exchanged,
    finished,
    fitted_on,
    is_within,
    ranked,
    searched_again,
    trials,
)
from hystid.diagnosis.fit.clipped import clipped_force
from hystid.diagnosis.fit.hypothesis import Fit, Term, is_mass, is_source
from hystid.diagnosis.fit.independence import is_noise
from hystid.diagnosis.fit.pairscan import scan_pairs
from hystid.diagnosis.fit.problem import Problem, standing
from hystid.diagnosis.fit.search import ScannedForm, from_nominal, one_per_id, scan, try_fit, unexplained
from hystid.diagnosis.fit.windows import has_windows
from hystid.diagnosis.model.channel_effects import ChannelEffect, force_drifts, high_passes, ranges
from hystid.diagnosis.model.effects import Effect

_LEAP = 0.5  # share of the misfit that is left by a start from nominal values, from which the refit was stuck
ROUNDS = 3  # of looking for a better local minimum of what leads
_STARTS = 3  # singles from which sets of effects grow
_TRIED, _LAWS = 6, 4  # forms that are fitted as a further member of a set, and laws among them
_PAIRS = 16  # pairs of forms, found by a scan of both together, that are fitted from each start
_MEMBERS = 3  # effects of a set at most
_REPLACED = 4  # other effects that are tried in the place of each member of the leading set
_WORK = 15_000_000  # rows of residuals after which no further set is begun: some ten seconds, counted and not timed
_FINISHED = 4  # effects that are fitted to the end beside the leading one


class Search:
    """Makes the hypotheses about one problem."""

    def __init__(
        self,
        problem: Problem,
        baseline: Fit,
        effects: Sequence[Effect],
        progress: Callable[[], None],
        minima: Sequence[Fit],
    ) -> None:
        self.problem, self.baseline, self.effects, self.minima = problem, baseline, effects, minima
        parts = problem.parts
        faults = [*force_drifts(parts), *high_passes(parts), *ranges(parts), *clipped_force(problem, baseline)]
        self.library = [*effects, *([] if problem.unforced else faults)]
        self.candidates = scan(problem, baseline, self.library, progress)
        self.criterion = Criterion(problem, baseline, len({effect.id for effect in self.library}))
        self.first: list[Trial] = []
        self.followed = 0
        self.began = problem.work
        self.exact: dict[str, float] = {}

    @property
    def floor(self) -> float:
        """Mean square that noise leaves of the baseline."""
        return self.criterion.floor

    @property
    def excess(self) -> float:
        """Misfit of the baseline above the noise."""
        return self.baseline.chi2 - self.floor

    def hypotheses(self, known: Sequence[FittedSet] = ()) -> list[FittedSet]:
        """Sets of effects, each fitted. known: some that are fitted already; where they explain all, no sets are
        looked for."""
        if not self._may_gain(self.candidates, self.excess) and (
            self.is_noise or self.criterion.is_reached(self.excess)
        ):
            return [*self._singles(chain_trials(self.problem, self.baseline, self.effects)), *known]
        self.first = self._trials()
        found = [*self._singles(self.first), *map(self._anew, known)]
        self.exact = {h.names[0]: self.criterion.misfit(h.fit, h.floor) for h in found if h.exact}
        if self.is_noise and not self._leads(found):
            return found
        if not self._all_is_explained(found):
            found += self._in_windows()
        if self.first and not self._all_is_explained(found):
            found += self._sets()
        else:
            for start in self._starts():
                pairs = list(self._beside(start))
                found += pairs
                if not pairs:  # what fits less well leaves more, and would win by no further law
                    break
        found += self._with_chain(found)
        found += self._as_given(found)
        leading = min((h.fit for h in found), key=lambda fit: fit.chi2, default=None)
        if leading is None or not self._follow(leading, self.criterion.slack):
            return found
        return self.hypotheses(found)

    def again(self, known: Sequence[FittedSet]) -> Iterator[FittedSet]:
        """Hypotheses of another problem with the same recordings, fitted again."""
        for h in known:
            made = try_fit(self.problem, h.fit.hypothesis)
            if h.names and made is not None and are_reached(self.problem, made):
                yield self._anew(replace(h, fit=made))

    def _anew(self, h: FittedSet) -> FittedSet:
        """A hypothesis against the baseline in use."""
        return self._hypothesis(h.names, h.size, h.fit, windowed=h.windowed)

    def _with_chain(self, found: Sequence[FittedSet]) -> Iterator[FittedSet]:
        """What leads with a late force channel, or another mass, where its fit runs into the limits of what is none."""
        bare = [h for h in found if not h.fit.hypothesis.late and 0 < len(h.names) < _MEMBERS]
        worth = {id(h): self._worth(self.criterion.misfit(h.fit, h.floor), h.size, len(h.names)) for h in bare}
        for h in sorted(bare, key=lambda h: -worth[id(h)])[:_STARTS]:
            for trial in chain_trials(self.problem, h.fit, self.effects):
                if trial.name not in h.names and are_reached(self.problem, trial.fit):
                    yield self._hypothesis((*h.names, trial.name), h.size + trial.size, trial.fit, windowed=h.windowed)

    def _as_given(self, found: Sequence[FittedSet]) -> Iterator[FittedSet]:
        """What leads, fitted again from the values that were given, where its baseline stands far from them and more
        than noise is left: a refit without what is missing goes astray, and what is fitted from there may stay."""
        criterion, nominal = self.criterion, dict(self.problem.baseline.nominal)
        worth = {id(h): self._worth(criterion.misfit(h.fit, h.floor), h.size, len(h.names)) for h in found}
        for h in sorted(found, key=lambda h: -worth[id(h)])[:_STARTS]:
            left = criterion.misfit(h.fit, h.floor)
            if criterion.is_reached(left) or criterion.departure(h.fit) < -math.log(MENTION):
                continue
            made = try_fit(self.problem, replace(h.fit.hypothesis, values=nominal))
            if made is not None and made.chi2 < h.fit.chi2 and are_reached(self.problem, made):
                yield self._hypothesis(h.names, h.size, made, windowed=h.windowed)

    @cached_property
    def is_noise(self) -> bool:
        """Whether what the baseline leaves is noise, whatever its level."""
        return is_noise(self.problem, self.baseline)

    def _leads(self, found: Sequence[FittedSet]) -> bool:
        """Whether any effect explains more than it costs."""
        criterion, whole = self.criterion, self.excess
        return any(
            criterion.likelihood(m) - criterion.likelihood(whole) > criterion.penalty(h.size, 1, m)
            for h in found
            if (m := criterion.misfit(h.fit, h.floor)) < whole
        )

    def _may_gain(self, candidates: Sequence[ScannedForm], misfit: float) -> bool:
        """Whether any effect could be worth its price beside a fit, as a scan sees it; scans are linear, hence the
        factor.

        What one column takes does not hang on how well the level of the noise is known, as what is left in all does.
        Where all is within that level, a column counts from the size on that a sound rig does not leave.
        """
        criterion = self.criterion
        most = 2 * max((c.gain for c in candidates), default=0.0) / criterion.rows
        least = SOUND**2 * criterion.force if misfit < criterion.slack else 0.0
        gain = criterion.likelihood(0.0) - criterion.likelihood(most)
        return most > least and gain > criterion.price(1, 0.0)

    def formed(self, names: Sequence[str]) -> float:
        """Misfit that is left to those effects of a set that have a form, which may be a little wrong."""
        return min([self.excess, *(misfit for name, misfit in self.exact.items() if name in names)])

    def _all_is_explained(self, found: Sequence[FittedSet]) -> bool:
        best = min(found, key=lambda h: self.criterion.misfit(h.fit, h.floor), default=None)
        if best is None:
            return self.criterion.is_reached(self.excess)
        misfit = self.criterion.misfit(best.fit, best.floor)
        if self.criterion.is_settled(misfit, self.formed(best.names)):
            return True
        return best.windowed and is_noise(self.problem, best.fit)

    def _trials(self) -> list[Trial]:
        """Joint fits of the promising effects, each from the best starts that are known."""
        problem, before = self.problem, self.baseline
        chain = chain_trials(problem, before, self.effects)
        first = trials(problem, before, self.candidates, self.excess, chain)
        if not first:
            return []
        if not self.followed and self._follow(first[0].fit):
            return self._trials()
        if not self._is_reached(first[0]):
            stuck = first[0].chi2
            first = also_from_nominal(problem, first, self.baseline, self.library)
            if first[0].chi2 - self.floor < _LEAP * (stuck - self.floor):  # nothing was fitted from there yet
                first = exchanged(problem, first, self.baseline, self.library)
        if not self._is_reached(first[0]):
            first = searched_again(problem, first, self.baseline, self.floor, self.minima)
        for _ in range(ROUNDS):
            best = first[0].chi2
            first = finished(problem, exchanged(problem, first, self.baseline, self.library, every=False), self.excess)
            if best - first[0].chi2 < self.criterion.slack:
                break
        return ranked(problem, [*self._to_the_end(first), *first])

    def _follow(self, led: Fit, least: float = 0.0) -> bool:
        """Exchange the baseline for one from where an effect led it, if it fits better there without the effect; return
        whether it does. The refit was stuck then, and the effect a way out. least: mean square that it must gain."""
        problem, before = self.problem, self.baseline
        if self.followed >= 2:  # by what is tried first, and by what leads in the end
            return False
        freed = try_fit(problem, replace(led.hypothesis, terms=before.hypothesis.terms, late=False), 25)
        if freed is None or before.chi2 - freed.chi2 <= max(0.1 * self.excess, least):
            return False
        self.baseline = freed
        self.followed += 1
        self.minima = (before, *self.minima)
        self.criterion = Criterion(problem, freed, self.criterion.ids)
        self.__dict__.pop("is_noise", None)
        self.candidates = scan(problem, freed, self.library)
        return True

    def _to_the_end(self, first: Sequence[Trial]) -> Iterator[Trial]:
        """What fits about as well as a right law, fitted on: a law with corners creeps, and comparisons end early."""
        usual = self.criterion.usual * self.excess
        forms = {t.form: t for t in reversed(first) if t.name == first[0].name}
        leading = [*distinct(first), *forms.values()]
        unlike = {id(t): t for t in leading}.values()
        near = [t for t in unlike if t.chi2 - self.floor < usual and not self._is_reached(t)]
        for trial in near[:_FINISHED]:
            best = fitted_on(self.problem, trial.fit)
            if best.chi2 < trial.chi2:
                yield replace(trial, fit=best, others=())

    def _is_reached(self, trial: Trial) -> bool:
        return self.criterion.is_reached(self.criterion.misfit(trial.fit, float("nan")))

    def _is_settled(self, line: Sequence[Trial]) -> bool:
        misfit = self.criterion.misfit(line[-1].fit, float("nan"))
        return self.criterion.is_settled(misfit, self.formed([trial.name for trial in line]))

    def _singles(self, found: Sequence[Trial]) -> list[FittedSet]:
        """One hypothesis per id and size: the best form of each."""
        made: dict[tuple[str, int], Trial] = {}
        for trial in found:
            made.setdefault((trial.name, trial.size), trial)
        return [self._hypothesis((t.name,), t.size, t.fit) for t in made.values()]

    def _hypothesis(self, names: tuple[str, ...], size: int, fit: Fit, *, windowed: bool = False) -> FittedSet:
        near = fit.chi2 - self.floor < 2 * self.criterion.slack + 0.1 * self.excess
        floor = self.criterion.floor_of(fit) if near else self.floor
        terms = {term.effect.id: term.effect for term in fit.hypothesis.terms}
        formed = [terms[name] for name in names if name in terms and not _is_exact(terms[name])]
        laws = sum(not law.uses_h for law in formed)  # what weakens or pinches the hysteresis is no force of its own
        return FittedSet(names, size, fit, windowed, not formed, floor, laws=max(laws, 1))

    def _in_windows(self) -> Iterator[FittedSet]:
        """Effects that act for a part of the time, or of the levels. What these cost is not taken from the sets."""
        began = self.problem.work
        for fit in in_windows(self.problem, self.criterion, self.baseline, self.effects):
            effect = fit.hypothesis.terms[-1].effect
            yield self._hypothesis((effect.id,), effect.size, fit, windowed=has_windows(fit.hypothesis))
        self.began += self.problem.work - began

    def _sets(self) -> list[FittedSet]:
        """Two or three effects: pairs that fit together, then forward from the leading singles, then members exchanged
        for others."""
        began = self.problem.work
        found = self._pairs()
        self.began += self.problem.work - began  # what these cost is not taken from the sets that grow
        for start in () if self._all_is_explained(found) else self._starts():
            line = self._line(start, self.library, found)
            if len(line) > 1 and self._is_settled(line):
                break
        if not self.problem.baseline.has_h:  # what weakens or pinches hysteresis says nothing before there is some
            readers = [effect for effect in self.library if effect.uses_h]
            sources = [t for t in self.first if t.form_of is not None and is_source(t.form_of)]
            for start in list({t.form: t for t in reversed(sources)}.values())[-_STARTS:]:
                self._line(start, readers, found)
        if found and self.problem.work - self.began < _WORK:
            found += self.exchanged(min(found, key=lambda h: h.fit.chi2))
        return found

    def _pairs(self) -> list[FittedSet]:
        """Two effects of which each may hide the other, the best fit of each two ids: from where the refit stands, and
        from nominal values where both led it astray."""
        problem, starts = self.problem, [self.baseline]
        astray = self.criterion.departure(self.baseline) > -math.log(MENTION)
        if astray and (nominal := from_nominal(problem, self.baseline)) is not None:
            starts.append(nominal)
        best: dict[tuple[frozenset[str], int], FittedSet] = {}
        for start in starts:
            here, misfit = start.hypothesis, unexplained(problem, start) - self.floor

            def worth(gain: float, size: int, misfit: float = misfit) -> float:
                return self._worth(misfit - gain / self.criterion.rows, size, 2)

            for pair in scan_pairs(problem, start, self.library, worth, _PAIRS):
                made = try_fit(problem, here.beside(*pair.terms))
                known = best.get((pair.ids, pair.size))
                if made is None or (known and known.fit.chi2 <= made.chi2) or not are_reached(problem, made):
                    continue
                names = tuple(sorted(pair.ids, key=self._place))
                best[pair.ids, pair.size] = self._hypothesis(names, pair.size, made)
        return list(best.values())

    def _place(self, name: str) -> int:
        """Rank of an effect among those that were fitted alone."""
        names = [trial.name for trial in self.first]
        return names.index(name) if name in names else len(names)

    def _worth(self, left: float, size: int, effects: int = 1) -> float:
        """What effects explain beyond the price of their parameters. left: misfit that they leave."""
        return self.criterion.likelihood(left) - self.criterion.penalty(size, effects, left)

    def _starts(self) -> list[Trial]:
        """Singles from which sets grow, by what they explain beyond the price of their parameters."""

        def worth(trial: Trial) -> float:
            return self._worth(self.criterion.misfit(trial.fit, float("nan")), trial.size)

        return distinct(sorted(self.first, key=worth, reverse=True))[:_STARTS]

    def _beside(self, start: Trial) -> Iterator[FittedSet]:
        """A small effect beside one that explains nearly all: what the form of a law leaves, no other law takes down to
        the noise, or to next to nothing."""
        misfit = self.criterion.misfit(start.fit, float("nan"))
        scanned = scan(self.problem, start.fit, self.library) if self._is_settled([start]) else []
        if not self._may_gain(scanned, misfit):
            return
        nexts = self._further([start], scanned, most=len(self.library), fits=3 * _TRIED)  # simple ones too
        made = (self._of([start, further]) for further in nexts)
        for h in made:
            left = self.criterion.misfit(h.fit, h.floor)
            if self.criterion.is_reached(left) or self.criterion.is_worth_a_name(left, misfit, self.formed(h.names)):
                yield h

    def _line(self, start: Trial, library: Sequence[Effect], found: list[FittedSet]) -> list[Trial]:
        """A set that grows from one effect by the best further one; all that was tried is added to what was found."""
        line = [start]
        while len(line) < _MEMBERS and not self._is_settled(line) and self.problem.work - self.began < _WORK:
            nexts = self._further(line, scan(self.problem, line[-1].fit, library))
            if not nexts:
                break
            found += [self._of([*line, trial]) for trial in nexts]
            line.append(nexts[0])
        return line

    def _of(self, line: Sequence[Trial]) -> FittedSet:
        return self._hypothesis(tuple(t.name for t in line), sum(t.size for t in line), line[-1].fit)

    def _further(
        self, line: Sequence[Trial], scanned: Sequence[ScannedForm], most: int = _STARTS, fits: int = _TRIED
    ) -> list[Trial]:
        """The best further effects of a set, one per id. fits: how many forms are fitted."""
        end, used = line[-1], {trial.name for trial in line}
        left = end.chi2 - self.floor
        scanned = self._by_worth([c for c in scanned if c.effect.id not in used], left)
        best = one_per_id(scanned)[:_LAWS]  # forms of one law fit alike, and would take the places of simpler laws
        scanned = [*best, *(c for c in scanned if not any(c is one for one in best))]
        extra = chain_trials(self.problem, end.fit, self.effects)
        found = trials(self.problem, end.fit, scanned, left, extra, most=fits)
        return distinct(t for t in found if t.name not in used)[:most]

    def _by_worth(self, scanned: Sequence[ScannedForm], misfit: float) -> list[ScannedForm]:
        """Candidates by what they gain beyond the price of their parameters: a law always fits worse than the more
        general one that holds it, and would never be tried for its gain alone. misfit: what they may take."""

        def worth(c: ScannedForm) -> float:
            return self._worth(misfit - c.gain / self.criterion.rows, c.effect.size)

        return sorted(scanned, key=worth, reverse=True)

    def exchanged(self, best: FittedSet) -> list[FittedSet]:
        """The leading set with each member exchanged for others: the first was chosen when the rest was not there."""
        found = []
        here = best.fit.hypothesis
        for at, term in enumerate(here.terms):
            if term.effect.id not in best.names:
                continue
            others = {t.effect.id for i, t in enumerate(here.terms) if i != at}
            start = standing(self.problem, here.without(at))
            laws = [effect for effect in self.library if effect.id not in others]
            shapes = {name: value for name, value in term.values.items() if name not in term.effect.amplitudes}
            left = unexplained(self.problem, start) - self.floor
            scanned = self._by_worth(scan(self.problem, start, laws, near=shapes), left)
            simpler = [c for c in scanned if c.effect.id == term.effect.id and c.effect.size < term.effect.size]
            instead = [c.term for c in (*one_per_id(scanned)[:_REPLACED], *simpler[:1])]
            for other in (*instead, *_within(term, laws)):
                made = try_fit(self.problem, here.exchanged(at, other), incumbent=best.fit.chi2)
                if made is not None and are_reached(self.problem, made):
                    names = tuple(other.effect.id if n == term.effect.id else n for n in best.names)
                    size = best.size - term.effect.size + other.effect.size
                    found.append(self._hypothesis(names, size, made))
        return found

    def without_one(self, hypothesis: FittedSet, criterion: Criterion) -> Iterator[tuple[FittedSet, bool]]:
        """A set without each of its members, fitted again, and whether the member counts: whether that costs more than
        it does. criterion: at the level of the noise."""
        here, misfit = hypothesis.fit.hypothesis, criterion.misfit(hypothesis.fit, hypothesis.floor)
        formed = self.formed(hypothesis.names) - criterion.level
        for at, term in enumerate(here.terms):
            if term.effect.id in hypothesis.names:
                made = try_fit(self.problem, here.without(at))
                if made is None:
                    continue
                names = tuple(name for name in hypothesis.names if name != term.effect.id)
                without = criterion.misfit(made, hypothesis.floor)
                gain = criterion.likelihood(misfit) - criterion.likelihood(without)
                counts = gain > criterion.price(term.effect.size, misfit)
                counts = counts and (
                    criterion.is_worth_a_name(misfit, without, formed)
                    or (
                        not _is_exact(term.effect)
                        and self._is_no_form(criterion, made, term.effect.size, (misfit, without, formed))
                    )
                )
                yield self._hypothesis(names, hypothesis.size - term.effect.size, made), counts

    def _is_no_form(self, criterion: Criterion, rest: Fit, size: int, misfits: tuple[float, float, float]) -> bool:
        """Whether a member of a set takes, down to what right laws leave, what no form of the others would take.

        rest: the others, fitted without it. misfits: with it, without, and what is left to laws that have a form.
        """
        misfit, without, formed = misfits
        if not criterion.is_settled(misfit, formed):
            return False
        known = self.criterion.is_reached(
            misfit + criterion.level
        )  # as the noise was measured, not as the best law leaves it
        if without - misfit < FORM**2 * formed and not known:
            return False
        curves = [*free_curves(self.problem, rest), *wrong_forms(self.problem, rest)]
        return criterion.is_no_form(misfit, without, size, curves)


def _is_exact(effect: Effect) -> bool:
    """Whether an effect has no form to be wrong: a fault of a channel, a force that depends on nothing, or mass."""
    return isinstance(effect, ChannelEffect) or not effect.reads or is_mass(effect)


def _within(term: Term, laws: Sequence[Effect]) -> Iterator[Term]:
    """Simpler laws of another id with shapes of a fitted one alone, as it stands: a scan, which is linear, may not see
    them where their shapes are not those of its grid."""
    own = {shape.name for shape in term.effect.shapes}
    for effect in laws:
        if effect.id != term.effect.id and not effect.choices and is_within(effect, own, term.effect.size):
            names = (*(shape.name for shape in effect.shapes), *effect.amplitudes)
            yield Term(effect, {name: term.values.get(name, 0.0) for name in names})
