"""From candidates to names: forward, backward and exchange steps, simpler laws first, and when to say nothing.

Everything is judged by the share of the excess that a hypothesis explains: the excess is the mean square of the
residual
above the floor that noise alone leaves. With tens of thousands of samples every p-value is zero, so none is used.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from hystid.diagnosis.blocks import Effect
from hystid.diagnosis.fitting import ADDED_MASS, DELAY_LIMIT, WEIGHING_LIMIT, Fit, Problem, Term
from hystid.diagnosis.hysteresis import family, helps_everywhere
from hystid.diagnosis.independence import is_noise
from hystid.diagnosis.search import ABSORBED, Candidate, scan, scattered, try_fit, try_term
from hystid.diagnosis.sensors import HUM, force_drift, mains_hum
from hystid.diagnosis.windows import fitted_outside, is_off_outside, settled, unwindowed, window_of, windowed

SOUND = 0.075  # excess that smoothing and integration leave in healthy recordings
WORTH = 0.05  # fall of the mean square below which no effect is named
EXPLAINED = 0.93  # share of the excess that a right law explains
_PAIR_WORTH = 0.08  # fall of the mean square that each of several effects must be worth
PAIR_SHARE = 0.045  # share of the excess that each of several effects must cost when it is taken away
_PAIR_LEFT = 0.05  # share of the excess that several right effects may leave
_FAMILY, _AHEAD = 0.9, 0.2  # share of the excess that a form of the right id explains, and its lead over other ids
_HELD = 0.35  # samples of delay: a force that is held is half a sample late, and no shift undoes the steps
_FAR, _MOST, _MUCH = 30.0, 0.72, 0.4  # excess in floors, share of the first effect, share of the rest of the second
_FORM = 0.045  # share of the excess that another form of the right law leaves; more may be a second effect
_HOPEFUL = 0.6  # share of the excess that the best trial may leave to be searched again
_NEAR, _SEARCHED = 2.0, 2  # excess over that of the best trial, and number of ids, that are searched again
_RIVAL, _EXCHANGED = 0.5, 4  # share of the best gain that a look-alike may lack, and how many are fitted again
_REPAIRED = 2.0  # excess that is sound after a repair, over that of a sound recording
_FORMS = 3  # forms of the leading id that are searched again
_CLOSE, _CREEPING = 3, (0.02, 0.06)  # leading ids, and mean square (and share of the excess) behind the best, fitted on
_LAST = 60  # iterations for what is named
MAINS = (50.0, 60.0)  # Hz
_CLEAR_LINE = 100.0  # power of a line over that of its neighbours
_LINES, _STARTING = 2, 5  # lines of effects that are followed, from this many ids where lines end in nonsense
_REACHED = 0.001  # share of the samples of some recording that lie beyond a threshold
_LIMIT_GAIN = 0.03  # fall of the mean square that makes a correction at its limit a finding
_SAME = (0.007, 0.003)  # mean square, and share of the excess, that a simpler law may lack to be preferred
_JUMPY = 0.06  # the same where the law jumps: dry friction of any kind mends a little there
_TIE = (0.006, 0.012)  # mean squares closer than this (and share of the excess) are not told apart
_IDLE = 0.1  # share of the excess below which no candidate has anything to say about it
DELAY = "channel_delay"
PRELOAD, DRIFT = "preload", "force_drift"
_WINDOW_LEFT, _WINDOW_WORTH = 0.05, 0.25  # shares of the excess that a law in a window may leave, and must be worth
_SLOW = frozenset({"cyclic_degradation", "stiffness_drift", PRELOAD})  # laws that are windows of their own


@dataclass(frozen=True)
class Trial:
    """One hypothesis that was fitted: what was added last, how it went, and the ids that it was not told from."""

    name: str
    form: str
    size: int
    fit: Fit = field(repr=False)
    absorbed: float = 0.0
    others: tuple[Term, ...] = field(repr=False, default=())
    tied: tuple[str, ...] = ()

    @property
    def chi2(self) -> float:
        """Mean square of the residual, noise units."""
        return self.fit.chi2

    @property
    def form_of(self) -> Effect | None:
        """The form that was added; None where the trial is a correction of the chain."""
        terms = self.fit.hypothesis.terms
        return terms[-1].effect if terms and terms[-1].effect.id == self.name else None


@dataclass(frozen=True)
class Choice:
    """Outcome of the selection.

    before: the refitted baseline; after: with the named effects (the same where none is named). named: ids in the
    order of
    strength; classes: ids that cannot be told from each name. explained: share of the excess. unknown: something is
    left
    that no candidate explains. trials: all that was tried first, best first. untestable: ids that the refit absorbs.
    """

    before: Fit
    after: Fit
    floor_before: float
    floor_after: float
    named: tuple[str, ...] = ()
    classes: tuple[tuple[str, ...], ...] = ()
    margins: tuple[float, ...] = ()
    unknown: bool = False
    trials: tuple[Trial, ...] = field(repr=False, default=())
    untestable: tuple[str, ...] = ()

    @property
    def explained(self) -> float:
        """Share of the excess over the floor that the named effects explain."""
        excess = self.before.chi2 - self.floor_before
        return float(min(1.0, (self.before.chi2 - self.after.chi2) / excess)) if excess > 0 else 1.0


@dataclass(frozen=True)
class Step:
    """One accepted term: where it stands, and what it could not be told from."""

    trial: Trial
    tied: tuple[str, ...]
    margin: float


def choose(
    problem: Problem,
    baseline: Fit,
    effects: Sequence[Effect],
    progress: Callable[[], None] = lambda: None,
    *,
    repaired: bool = False,
    valleys: Sequence[Fit] = (),
) -> Choice:
    """Name what the refitted baseline leaves, or say that nothing, or nothing known, is there.

    valleys: other local optima of the refit. repaired: a channel was shifted or cut before; what the repair missed is
    no further finding.
    """
    baseline = without_hum(problem, baseline)
    floor = problem.floor(baseline.hypothesis)
    excess = baseline.chi2 - floor
    library = [*effects, force_drift(len(problem.parts), bow=False)]
    candidates = scan(problem, baseline, library, progress)
    untestable = _untestable(candidates)
    chain = chain_trials(problem, baseline, effects)
    idle = not candidates or candidates[0].gain < _IDLE * excess * len(baseline.residual)
    healthy = sound(problem, baseline.hypothesis.delay) * max(1.0, floor) * (_REPAIRED if repaired else 1.0)
    if excess < healthy or (idle and is_noise(problem, baseline)):
        return _quiet(problem, baseline, floor, chain, untestable)
    first = trials(problem, baseline, candidates, excess, chain)
    if not first:
        return Choice(baseline, baseline, floor, floor, unknown=True, untestable=untestable)
    freed = try_fit(problem, replace(first[0].fit.hypothesis, terms=baseline.hypothesis.terms, late=False), 25)
    if freed is not None and baseline.chi2 - freed.chi2 > 0.1 * excess:  # the refit was stuck, and the effect a way out
        return choose(problem, freed, effects, progress, repaired=repaired, valleys=(baseline, *valleys))
    first = _exchanged(problem, _searched_again(problem, first, floor, excess, valleys), baseline)
    first = _finished(problem, first, excess)
    chosen = _single(problem, first, baseline, excess)
    end_floor = problem.floor(chosen.trial.fit.hypothesis)
    alone = _explains(problem, chosen.trial.fit, end_floor, baseline, excess)
    left = chosen.trial.chi2 - end_floor
    constant = chosen.trial.name in (PRELOAD, DRIFT) and baseline.chi2 - chosen.trial.chi2 > 0.5 * excess
    if constant and left > sound(problem, baseline.hypothesis.delay) * max(1.0, end_floor):
        return _beside_preload(problem, baseline, chosen, first, effects, repaired=repaired)
    if alone and left < max(sound(problem, baseline.hypothesis.delay), _FORM * excess):
        return _named(problem, baseline, floor, [chosen], first, untestable)
    partly = _part_time(problem, baseline, floor, effects)
    if partly:
        return _named(problem, baseline, floor, partly, first, untestable)
    several = _several(problem, baseline, first, library, excess)
    worn = _worn(problem, baseline, floor, library, several) if several or not alone else []
    if worn or several is not None:
        return _named(problem, baseline, floor, worn or several or [], first, untestable)
    if alone or (baseline.chi2 - chosen.trial.chi2 > 0.5 * excess and is_noise(problem, chosen.trial.fit)):
        return _named(problem, baseline, floor, [chosen], first, untestable)
    if _stands_out(first, chosen, baseline, excess):
        return _named(problem, baseline, floor, [chosen], first, untestable)
    rough = _rough(problem, baseline, floor, first, library, chosen)
    if rough:
        return _named(problem, baseline, floor, rough, first, untestable)
    return Choice(baseline, baseline, floor, floor, unknown=True, trials=tuple(first), untestable=untestable)


def _beside_preload(
    problem: Problem, before: Fit, chosen: Step, first: Sequence[Trial], effects: Sequence[Effect], *, repaired: bool
) -> Choice:
    """A constant force has one form and no misfit of its own: what it leaves is judged anew, by its own size."""
    others = [effect for effect in effects if effect.id != PRELOAD]
    rest = choose(problem, chosen.trial.fit, others, repaired=repaired)
    if DRIFT in rest.named:  # what it leaves is part of the same
        rest = Choice(chosen.trial.fit, chosen.trial.fit, 0.0, problem.floor(chosen.trial.fit.hypothesis))
    alike = tuple(dict.fromkeys((chosen.trial.name, *chosen.tied)))
    return replace(
        rest, before=before, floor_before=problem.floor(before.hypothesis), named=(chosen.trial.name, *rest.named),
        classes=(alike, *rest.classes), margins=(chosen.margin, *rest.margins), unknown=False, trials=tuple(first),
    )  # fmt: skip


def without_hum(problem: Problem, baseline: Fit) -> Fit:
    """The refit with the lines of the mains taken out of the force, where they stand clear of their neighbours."""
    for frequency in MAINS:
        if problem.line(baseline.hypothesis, frequency) > _CLEAR_LINE:
            effect = mains_hum(len(problem.parts), frequency)
            made = try_term(problem, baseline, Term(effect, dict.fromkeys(effect.amplitudes, 0.0)))
            if made is not None and baseline.chi2 - made.chi2 > 0.5 * (baseline.chi2 - 1.0):
                return made
    return baseline


def _quiet(
    problem: Problem,
    baseline: Fit,
    floor: float,
    chain: Sequence[Trial],
    untestable: tuple[str, ...],
) -> Choice:
    """Nothing to explain, but for a correction of the chain that ran into its limit."""
    for trial in chain:
        if baseline.chi2 - trial.chi2 > _LIMIT_GAIN:
            return _named(problem, baseline, floor, [Step(trial, (), 1.0)], chain, untestable)
    return Choice(baseline, baseline, floor, floor, untestable=untestable)


def trials(
    problem: Problem,
    fitted: Fit,
    candidates: Sequence[Candidate],
    excess: float,
    extra: Sequence[Trial] = (),
    most: int = 12,
) -> list[Trial]:
    """Joint fits of the promising forms, best first. Absorbed ones count for nothing unless they change much."""
    found = [*extra]
    top = max((c.gain for c in candidates), default=0.0)
    promising = [c for c in candidates if c.gain > 0.3 * top][:most]
    promising += [c for c in candidates[:most] if c not in promising][: max(0, 5 - len(promising))]
    for candidate in promising:
        bar = min((t.chi2 for t in found), default=0.0)
        made = try_term(problem, fitted, candidate.term, bar=bar)
        if made is not None:
            found.append(_trial(candidate, made))
    found = _ranked(problem, found)
    if found and found[0].chi2 - 1.0 > 2 * SOUND:
        found = _ranked(problem, [*_restarts(problem, fitted, found[0]), *found])
    return [t for t in found if not (t.absorbed > ABSORBED and fitted.chi2 - t.chi2 < 0.5 * excess)]


def _ranked(problem: Problem, found: Sequence[Trial]) -> list[Trial]:
    """Best first, without those that need a threshold which the motion never passes."""
    return sorted((t for t in found if _are_reached(problem, t.fit)), key=lambda t: t.chi2)


def _are_reached(problem: Problem, fit: Fit) -> bool:
    """Whether the motion goes beyond every threshold: the tail of a contact that is never reached feigns a preload."""
    for term in fit.hypothesis.terms:
        if "gap" in term.values:
            side = term.values.get("side", 0.0)
            beyond = [np.mean((side * p.x if side else np.abs(p.x)) > term.values["gap"]) for p in problem.parts]
            if float(max(beyond)) < _REACHED:
                return False
    return True


def _restarts(problem: Problem, fitted: Fit, best: Trial) -> list[Trial]:
    """The best form from its next best grid points: most misses are searches that got stuck."""
    made = [try_term(problem, fitted, term, bar=best.chi2) for term in best.others[:2]]
    return [replace(best, fit=f, others=()) for f in made if f is not None and f.chi2 < best.chi2]


def _searched_again(
    problem: Problem, found: Sequence[Trial], floor: float, excess: float, valleys: Sequence[Fit]
) -> list[Trial]:
    """The leading ids from other starts, where the best explains much but not enough.

    A law with corners has side valleys: the refit without the missing effect may stand in one, and no fit that starts
    there comes out. Other starts are other valleys that the refit has seen, and scattered shapes.
    """
    left = found[0].chi2 - floor
    if left < max(SOUND * floor, _FORM * excess) or left > _HOPEFUL * excess:
        return list(found)
    again = list(found)
    leading = [trial for trial in _distinct(found)[:_SEARCHED] if trial.chi2 - floor < _NEAR * left]
    forms = {t.form_of.class_name: t for t in reversed(found) if t.form_of and t.name in {one.name for one in leading}}
    for valley in valleys:
        for candidate in scan(problem, valley, [t.form_of for t in forms.values() if t.form_of])[:_FORMS]:
            made = try_term(problem, valley, candidate.term, bar=again[0].chi2)
            known = forms[candidate.effect.class_name]
            again += [replace(known, fit=made, others=())] if made is not None and made.chi2 < known.chi2 else []
    if min(t.chi2 for t in again) - floor < max(SOUND * floor, _FORM * excess):
        return _ranked(problem, again)
    for trial in leading:
        starts = scattered(problem, trial.fit)
        fits = [made for start in starts if (made := try_fit(problem, start, bar=again[0].chi2)) is not None]
        again += [replace(trial, fit=made, others=()) for made in fits if made.chi2 < trial.chi2]
    return _ranked(problem, again)


def _exchanged(problem: Problem, found: Sequence[Trial], before: Fit) -> list[Trial]:
    """Look-alikes of the best trial, fitted again from where its baseline stands.

    The refit without any effect leans to one side, and a fit that starts there may never come to where the best one is:
    it would lose for that and not for its law.
    """
    best = found[0]
    here = best.fit.hypothesis
    if len(here.terms) == len(before.hypothesis.terms):
        return list(found)
    near = best.chi2 + _RIVAL * (before.chi2 - best.chi2)
    forms = {t.form_of.class_name: t for t in reversed(found) if t.chi2 < near and t.form_of}
    forms.pop(here.terms[-1].effect.class_name, None)
    bare = replace(here, terms=here.terms[:-1])
    rows = problem.rows(bare)
    start = Fit(bare, rows, float(np.mean(rows**2)), problem.unknowns(bare))
    effects = [t.form_of for t in forms.values() if t.form_of]
    again = list(found)
    for candidate in scan(problem, start, effects)[:_EXCHANGED]:
        made = try_term(problem, start, candidate.term, bar=best.chi2)
        if made is not None and made.chi2 < forms[candidate.effect.class_name].chi2 - _TIE[0]:
            again.append(replace(forms[candidate.effect.class_name], fit=made, others=()))
    return _ranked(problem, again)


def _finished(problem: Problem, found: Sequence[Trial], excess: float) -> list[Trial]:
    """The best of the leading ids, fitted on: a law with corners creeps, and comparisons end early."""
    near = [t for t in _distinct(found)[:_CLOSE] if t.chi2 - found[0].chi2 < _CREEPING[0] + _CREEPING[1] * excess]
    again = []
    for trial in near if len(near) > 1 else ():
        made = try_fit(problem, trial.fit.hypothesis, _LAST)
        again += [replace(trial, fit=made, others=())] if made is not None and made.chi2 < trial.chi2 else []
    return _ranked(problem, [*again, *found])


def _trial(candidate: Candidate, made: Fit) -> Trial:
    effect = candidate.effect
    return Trial(effect.id, effect.form, effect.size, made, candidate.absorbed, candidate.others)


def chain_trials(problem: Problem, fitted: Fit, effects: Sequence[Effect]) -> list[Trial]:
    """A late force channel, and a mass beyond what weighing explains: tried where the refit runs into their limits."""
    found = []
    here = fitted.hypothesis
    if abs(here.delay) > 0.8 * DELAY_LIMIT and not here.late:
        made = try_fit(problem, replace(here, late=True))
        if made is not None and abs(made.hypothesis.delay) > DELAY_LIMIT:
            found.append(Trial(DELAY, "", 1, made))
    if abs(here.weighing) > 0.95 * WEIGHING_LIMIT:
        heavier = _added_mass(problem, fitted, effects)
        found += [heavier] if heavier is not None else []
    return found


def _added_mass(problem: Problem, fitted: Fit, effects: Sequence[Effect]) -> Trial | None:
    """The weighing error as an effect without a limit."""
    here = fitted.hypothesis
    mass = next((effect for effect in effects if effect.id == ADDED_MASS), None)
    if mass is None or here.weighing == 0.0:
        return None
    term = Term(mass, {mass.amplitudes[0]: here.weighing * here.values["m"]})
    made = try_fit(problem, replace(here, weighing=0.0, terms=(*here.terms, term)))
    return Trial(mass.id, mass.form, 1, made) if made is not None else None


def _single(problem: Problem, found: Sequence[Trial], before: Fit, excess: float) -> Step:
    """The simplest of the trials that are as good as the best; the best is restarted first if something is left."""
    best = found[0]
    tie = _tie(best, excess)
    same = _SAME[0] + _SAME[1] * min(excess, 10.0)
    jumpy = _JUMPY if problem.reduce.jumps else 0.0
    simple = best
    for trial in sorted(found, key=lambda t: (t.size, t.chi2)):
        if trial.chi2 - best.chi2 < (same + jumpy) * max(1, best.size - trial.size):
            simple = trial
            break
    tied = tuple(dict.fromkeys(t.name for t in found if t.chi2 - simple.chi2 < tie and t.name != simple.name))
    other = next((t.chi2 for t in found if t.name != simple.name and t.name not in tied), before.chi2)
    margin = (other - simple.chi2) / max(excess, 1e-9)
    return Step(simple, tied, float(margin))


def _tie(best: Trial, excess: float) -> float:
    """Difference of mean squares that does not part two hypotheses: of the form, and of what is left anyway."""
    return _TIE[0] + _TIE[1] * min(excess, 10.0) + 0.05 * max(0.0, best.chi2 - 1.2)


def sound(problem: Problem, delay: float) -> float:
    """Excess that healthy recordings may show; more where a law jumps or the force was held between samples."""
    return SOUND * (2.5 if problem.reduce.jumps else 1.0) * (2.0 if abs(delay) > _HELD else 1.0)


def _explains(problem: Problem, fit: Fit, floor: float, before: Fit, excess: float) -> bool:
    """Whether what is left is within the share that close forms leave, and the change worth a name."""
    left = fit.chi2 - floor
    healthy = sound(problem, before.hypothesis.delay)
    worth = WORTH * healthy / SOUND
    return before.chi2 - fit.chi2 > worth and left < max(healthy * floor, (1 - EXPLAINED) * excess)


def _several(
    problem: Problem, before: Fit, first: Sequence[Trial], library: Sequence[Effect], excess: float
) -> list[Step] | None:
    """Two or three effects: forward from the best few, each removal costly, the floor reached; None where that
    fails."""
    reached: list[list[Trial]] = []
    open_ends: list[list[Trial]] = []
    for start in _distinct(first)[:_STARTING]:
        if len(reached) + len(open_ends) == _LINES or before.chi2 - start.chi2 <= 0.08 * excess:
            continue
        line = _grow(problem, [start], library, excess)
        if len(line) > 1 and _are_reached(problem, line[-1].fit):
            (reached if _complete(problem, line, before, excess) else open_ends).append(line)
    if not reached:
        longest = min(open_ends, key=lambda line: line[-1].chi2, default=None)
        third = _grow(problem, longest, library, excess) if longest and _promising(longest, before) else []
        if len(third) > 2 and _complete(problem, third, before, excess):
            reached.append(third)
    if not reached:
        return None
    best = min(line[-1].chi2 for line in reached)
    tied = [line for line in reached if line[-1].chi2 - best < _tie(line[-1], excess)]
    simplest = min(tied, key=lambda line: sum(trial.size for trial in line))
    return [Step(trial, trial.tied, 0.0) for trial in simplest]


def _part_time(problem: Problem, before: Fit, floor: float, effects: Sequence[Effect]) -> list[Step]:
    """An effect that acts for a part of the time; empty where there is no such window or no law for it.

    Stricter than a single effect: outside of the window the baseline alone must reach the noise, and the same law
    would have to be seen there if it acted there.
    """
    window = window_of(problem, before, floor)
    if window is None:
        return []
    start = fitted_outside(problem, before, window)
    laws = [windowed(effect, window) for effect in effects if effect.id not in _SLOW]
    excess = start.chi2 - floor
    found = trials(problem, start, scan(problem, start, laws), excess)
    if not found:
        return []
    chosen = _single(problem, found, start, excess)
    end = chosen.trial.fit.hypothesis
    term = end.terms[-1]
    left = chosen.trial.chi2 - problem.floor(end)
    healthy = sound(problem, before.hypothesis.delay) * max(1.0, floor)
    if left > max(healthy, _WINDOW_LEFT * (before.chi2 - floor)) or not is_off_outside(term, problem.signals(end)):
        return []
    bare = try_term(problem, before, unwindowed(term))  # the same law, all the time
    if bare is not None and bare.chi2 - chosen.trial.chi2 < _WINDOW_WORTH * (before.chi2 - floor):
        return []
    return [replace(chosen, trial=replace(chosen.trial, fit=settled(problem, chosen.trial.fit)))]


def _worn(
    problem: Problem, before: Fit, floor: float, library: Sequence[Effect], several: Sequence[Step] | None
) -> list[Step]:
    """Hysteretic friction that wears or is pinched, far above the noise; empty where it is not that, or no better than
    the effects that were found."""
    reached = several[-1].trial.chi2 if several else before.chi2
    if before.chi2 - floor < _FAR * floor or reached < 2 * floor:
        return []
    links = family(problem, before, library, floor)
    if not links or links[-1].fit.chi2 > 0.8 * reached:
        return []
    trials = [(Trial(link.effect.id, link.effect.form, link.effect.size, link.fit), link.tied) for link in links]
    return [Step(trial, tied, 0.0) for trial, tied in trials]


def _stands_out(first: Sequence[Trial], chosen: Step, before: Fit, excess: float) -> bool:
    """Whether one id, in whatever form, explains most while every other id is far behind."""
    name = chosen.trial.name
    others = [t.chi2 for t in first if t.name != name and t.name not in chosen.tied]
    share = (before.chi2 - chosen.trial.chi2) / excess
    second = (before.chi2 - min(others, default=before.chi2)) / excess
    return share > _FAMILY and share - second > _AHEAD and not chosen.tied


def _rough(
    problem: Problem, before: Fit, floor: float, first: Sequence[Trial], library: Sequence[Effect], chosen: Step
) -> list[Step]:
    """Names for real structures, whose laws no catalogue meets to the noise: where the mismatch is far above the noise
    and one effect takes most of it, it is named; a second one where it takes much of the rest, everywhere in the
    recordings, and nothing else does as well. Empty otherwise."""
    excess = before.chi2 - floor
    least = min(floor, problem.floor(chosen.trial.fit.hypothesis))  # a damper that stands for friction is a noisy one
    if excess < _FAR * least or before.chi2 - chosen.trial.chi2 < _MOST * excess:
        return []
    line = _grow(problem, [chosen.trial], library, chosen.trial.chi2 - floor)
    if len(line) < 2 or line[-1].chi2 > (1 - _MUCH) * chosen.trial.chi2:
        return [chosen]
    if line[-1].tied or not helps_everywhere(chosen.trial.fit, line[-1].fit):
        return [chosen]
    return [chosen, Step(line[-1], (), 0.0)]


def _promising(line: Sequence[Trial], before: Fit) -> bool:
    """A third effect is looked for only where two explain most of the mean square."""
    return before.chi2 < _FAR and line[-1].chi2 - 1.0 < 0.15 * (before.chi2 - 1.0)


def _grow(problem: Problem, line: Sequence[Trial], library: Sequence[Effect], excess: float) -> list[Trial]:
    """The line with the best further effect; unchanged where there is none."""
    end = line[-1]
    used = {trial.name for trial in line}
    candidates = [c for c in scan(problem, end.fit, library) if c.effect.id not in used]
    found = trials(problem, end.fit, candidates, excess, chain_trials(problem, end.fit, library), most=6)
    if not found:
        return list(line)
    step = _single(problem, found, end.fit, excess)
    return [*line, replace(step.trial, tied=tuple(name for name in step.tied if name not in used))]


def _complete(problem: Problem, line: Sequence[Trial], before: Fit, excess: float) -> bool:
    """Whether several effects reach the floor and each of them counts; three must reach it without a rest."""
    end = line[-1].fit
    floor = problem.floor(end.hypothesis)
    allowed = max(SOUND * floor, _PAIR_LEFT * excess if len(line) < 3 else 0.0)
    close = len(line) > 1 and end.chi2 - floor < allowed
    return close and _are_reached(problem, end) and _each_counts(problem, end, excess)


def _distinct(found: Sequence[Trial]) -> list[Trial]:
    """The best trial of each id."""
    seen: dict[str, Trial] = {}
    for trial in found:
        seen.setdefault(trial.name, trial)
    return list(seen.values())


def _each_counts(problem: Problem, fit: Fit, excess: float) -> bool:
    """Whether taking any effect away and fitting again costs a visible share."""
    hypothesis = fit.hypothesis
    visible = max(_PAIR_WORTH, PAIR_SHARE * excess, sound(problem, 0.0) if problem.reduce.jumps else 0.0)
    for i in range(len(hypothesis.terms)):
        if hypothesis.terms[i].effect.id == HUM:
            continue
        rest = replace(hypothesis, terms=tuple(t for k, t in enumerate(hypothesis.terms) if k != i))
        made = try_fit(problem, rest, iterations=6)
        if made is None or made.chi2 - fit.chi2 < visible:
            return False
    return True


def _named(
    problem: Problem,
    before: Fit,
    floor: float,
    steps: Sequence[Step],
    first: Sequence[Trial],
    untestable: tuple[str, ...],
) -> Choice:
    after = steps[-1].trial.fit
    after = _to_the_end(problem, after)
    names = tuple(dict.fromkeys(step.trial.name for step in steps))
    classes = tuple(tuple(dict.fromkeys((step.trial.name, *step.tied))) for step in steps)
    return Choice(
        before, after, floor, problem.floor(after.hypothesis), names, classes, tuple(step.margin for step in steps),
        False, tuple(first), untestable,
    )  # fmt: skip


def _to_the_end(problem: Problem, reached: Fit) -> Fit:
    """What is named, fitted to the end: where much is explained, comparisons accept a side valley."""
    if reached.chi2 - problem.floor(reached.hypothesis) < SOUND:
        return reached
    fits = [try_fit(problem, start, _LAST, bar=reached.chi2) for start in scattered(problem, reached)]
    return min([reached, *(made for made in fits if made is not None)], key=lambda made: made.chi2)


def _untestable(candidates: Sequence[Candidate]) -> tuple[str, ...]:
    """Ids of which every form is absorbed by the refit."""
    least: dict[str, float] = {}
    for candidate in candidates:
        ident = candidate.effect.id
        least[ident] = min(least.get(ident, 1.0), candidate.absorbed)
    return tuple(sorted(ident for ident, share in least.items() if share > ABSORBED))
