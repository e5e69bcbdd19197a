"""From candidates to names: forward, backward and exchange steps, simpler laws first, and when to say nothing.

Everything is judged by the share of the excess that a hypothesis explains: the excess is the mean square of the
residual above the floor that noise alone leaves. With tens of thousands of samples every p-value is zero, so none is
used.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

from hystid.diagnosis.blocks import Effect
from hystid.diagnosis.constancy import are_constant
from hystid.diagnosis.fitting import ADDED_MASS, Fit, Key, Problem, Term
from hystid.diagnosis.hysteresis import family, helps_everywhere
from hystid.diagnosis.independence import is_noise
from hystid.diagnosis.limits import is_beyond_weighing, untried
from hystid.diagnosis.search import ABSORBED, Candidate, other_valleys, scan, try_fit, try_term
from hystid.diagnosis.sensors import DRIFT, force_drift, is_constant, mains_hum
from hystid.diagnosis.several import grow, several_effects
from hystid.diagnosis.trials import (
    FAR,
    FORM,
    LAST,
    SOUND,
    Step,
    Trial,
    added_mass_of,
    also_from_nominal,
    chain_trials,
    distinct,
    exchanged,
    finished,
    searched_again,
    single,
    sound,
    trials,
)  # fmt: skip
from hystid.diagnosis.windows import has_edges, is_off_outside, settled, windowed, windows_of

WORTH = 0.05  # fall of the mean square below which no effect is named
EXPLAINED = 0.93  # share of the excess that a right law explains
_FAMILY, _AHEAD = 0.9, 0.2  # share of the excess that a form of the right id explains, and its lead over other ids
_MOST, _MUCH = 0.72, 0.4  # share of the excess of the first effect, and share of the rest of the second
_REPAIRED = 2.0  # excess that is sound after a repair, over that of a sound recording
MAINS = (50.0, 60.0)  # Hz
_ROUNDS = 3  # of looking for a better valley of what is named
_CLEAR_LINE = 100.0  # power of a line over that of its neighbours
_LIMIT_GAIN = 0.03  # fall of the mean square that makes a correction at its limit a finding
_SILENT = 0.25  # share of the excess below which the best trial says nothing about a rest that is noise otherwise
_CONSTANT = 0.9  # share of the excess beyond which a constant force is named though what it leaves is unknown
_IDLE = 0.1  # share of the excess below which no candidate has anything to say about it
PRELOAD = "preload"
_TELLING = 0.3  # share of what is left inside a window that a law must take at once to be fitted; right ones take 0.4
_RIVAL = 0.7  # of the largest such share, below which another law is not fitted there
_SOMETHING = 0.01  # share of the excess that a law must take without a window to be tried with one
_WINDOW_LEFT = 0.05  # share of the excess that a law in a window may leave
_WINDOW_WORTH = (0.04, 0.25)  # share of the excess that a window must be worth, and that makes it the main thing
_ALMOST = 0.85  # share of the excess that the law explains without the window, where that is not the main thing
_SLOW = frozenset({"cyclic_degradation", "stiffness_drift", PRELOAD})  # laws that are windows of their own


@dataclass(frozen=True)
class Choice:
    """Outcome of the selection.

    before: the refitted baseline; after: with the named effects (the same where none is named). named: ids in the order
    of strength; classes: ids that cannot be told from each name. explained: share of the excess. unknown: something is
    left that no candidate explains. trials: all that was tried first, best first. untestable: ids that the refit
    absorbs. left_open: standard deviation that other forms of what is named leave in each parameter.
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
    left_open: Mapping[Key, float] = field(repr=False, default_factory=dict)

    @property
    def explained(self) -> float:
        """Share of the excess over the floor that the named effects explain."""
        excess = self.before.chi2 - self.floor_before
        return float(min(1.0, (self.before.chi2 - self.after.chi2) / excess)) if excess > 0 else 1.0


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
    found = _chosen(problem, baseline, effects, progress, repaired=repaired, valleys=valleys)
    known = {effect.id for effect in effects}
    terms = {term.effect.id: term for term in found.after.hypothesis.terms}
    extra = [untried(problem, found.after, terms[name], known) if name in terms else () for name in found.named]
    alike = [(*tied, *more) for tied, more in zip(found.classes, extra, strict=True)]
    return replace(found, classes=tuple(tuple(dict.fromkeys(names)) for names in alike))


def _chosen(
    problem: Problem,
    baseline: Fit,
    effects: Sequence[Effect],
    progress: Callable[[], None],
    *,
    repaired: bool,
    valleys: Sequence[Fit],
) -> Choice:
    """``choose``, but for look-alikes that were not tried."""
    baseline = without_hum(problem, baseline)
    floor = problem.floor(baseline.hypothesis)
    excess = baseline.chi2 - floor
    library = [*effects, *(force_drift(len(problem.parts), bow=bow) for bow in (False, True))]
    candidates = scan(problem, baseline, library, progress)
    untestable = _untestable(candidates)
    chain = chain_trials(problem, baseline, effects)
    idle = not candidates or candidates[0].gain < _IDLE * excess * len(baseline.residual)
    healthy = sound(problem, baseline.hypothesis.delay) * max(1.0, floor) * (_REPAIRED if repaired else 1.0)
    if excess < healthy or (idle and is_noise(problem, baseline)):
        return _quiet(problem, baseline, floor, chain, untestable)
    first = trials(problem, baseline, candidates, excess, chain)
    if not first and is_noise(problem, baseline):
        return _quiet(problem, baseline, floor, chain, untestable)
    if not first:
        return Choice(baseline, baseline, floor, floor, unknown=True, untestable=untestable)
    freed = try_fit(problem, replace(first[0].fit.hypothesis, terms=baseline.hypothesis.terms, late=False), 25)
    if freed is not None and baseline.chi2 - freed.chi2 > 0.1 * excess:  # the refit was stuck, and the effect a way out
        return _chosen(problem, freed, effects, progress, repaired=repaired, valleys=(baseline, *valleys))
    first = also_from_nominal(problem, first, baseline, floor, library)
    best_floor = problem.floor(first[0].fit.hypothesis)
    if first[0].chi2 - best_floor > max(healthy, FORM * excess) and (
        partly := _part_time(
            problem, baseline, floor, _worth_a_window(effects, candidates, excess * len(baseline.residual))
        )
    ):
        return _named(problem, baseline, floor, [partly], first, untestable)
    first = _compared(problem, searched_again(problem, first, baseline, floor, valleys), baseline, excess)
    chosen = single(problem, first, baseline, excess)
    end_floor = problem.floor(chosen.trial.fit.hypothesis)
    alone = _explains(problem, chosen.trial.fit, end_floor, baseline, excess)
    left = chosen.trial.chi2 - end_floor
    constant = _is_constant(problem, chosen.trial) and baseline.chi2 - chosen.trial.chi2 > 0.5 * excess
    if constant and left > sound(problem, baseline.hypothesis.delay) * max(1.0, end_floor):
        return _beside_preload(problem, baseline, chosen, first, effects, repaired=repaired)
    steady = _is_steady(problem, baseline, chosen.trial.fit)
    enough = alone and left < max(sound(problem, baseline.hypothesis.delay), FORM * excess)
    if enough and steady:
        return _named(problem, baseline, floor, [chosen], first, untestable)
    if enough and (heavier := _heavier(problem, baseline, chosen, effects)) is not None:
        return _named(problem, baseline, floor, [chosen, heavier], first, untestable)
    # What one law explains under a wrong name, two would explain as well.
    several = several_effects(problem, baseline, first, library, excess) if not enough else None
    if several is not None and not _is_steady(problem, baseline, several[-1].trial.fit):
        several = None
    worn = _worn(problem, baseline, floor, library, several) if several or not alone else []
    if worn or several is not None:
        return _named(problem, baseline, floor, worn or several or [], first, untestable)
    much = baseline.chi2 - chosen.trial.chi2 > 0.5 * excess
    if steady and (alone or (much and is_noise(problem, chosen.trial.fit))):
        return _named(problem, baseline, floor, [chosen], first, untestable)
    if _stands_out(first, chosen, baseline, excess) and not is_beyond_weighing(problem, chosen.trial.fit):
        return _named(problem, baseline, floor, [chosen], first, untestable)
    rough = _rough(problem, baseline, floor, first, library, chosen)
    if rough:
        return _named(problem, baseline, floor, rough, first, untestable)
    if baseline.chi2 - first[0].chi2 < _SILENT * excess and is_noise(problem, baseline):
        return _quiet(problem, baseline, floor, chain, untestable)
    return Choice(baseline, baseline, floor, floor, unknown=True, trials=tuple(first), untestable=untestable)


def _compared(problem: Problem, found: Sequence[Trial], before: Fit, excess: float) -> list[Trial]:
    """The leading ids, all fitted from where the best one stands, and to the end.

    Again where that brings the best to a better valley: the others must be seen there as well before they lose.
    """
    for _ in range(_ROUNDS):
        best = found[0].chi2
        found = finished(problem, exchanged(problem, found, before), excess)
        if best - found[0].chi2 < WORTH:
            break
    return list(found)


def _is_constant(problem: Problem, trial: Trial) -> bool:
    """Whether a trial adds a constant force, of the structure or of the force channel in each recording. A drift has
    many forms, and what a ramp leaves of it is no further finding."""
    if trial.name != DRIFT or trial.term is None:
        return trial.name == PRELOAD
    return is_constant(trial.term.values, problem.parts)


def _beside_preload(
    problem: Problem, before: Fit, chosen: Step, first: Sequence[Trial], effects: Sequence[Effect], *, repaired: bool
) -> Choice:
    """A constant force has one form and no misfit of its own: what it leaves is judged anew, by its own size."""
    others = [effect for effect in effects if effect.id != PRELOAD]
    rest = choose(problem, chosen.trial.fit, others, repaired=repaired)
    if DRIFT in rest.named:  # what it leaves is part of the same
        rest = Choice(chosen.trial.fit, chosen.trial.fit, 0.0, problem.floor(chosen.trial.fit.hypothesis))
    alike = tuple(dict.fromkeys((chosen.trial.name, *chosen.tied)))
    floor = problem.floor(before.hypothesis)
    if rest.unknown and before.chi2 - chosen.trial.chi2 < _CONSTANT * (before.chi2 - floor):
        return replace(rest, before=before, after=before, floor_before=floor, floor_after=floor, trials=tuple(first))
    return replace(
        rest, before=before, floor_before=floor, named=(chosen.trial.name, *rest.named),
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


def _explains(problem: Problem, fit: Fit, floor: float, before: Fit, excess: float) -> bool:
    """Whether what is left is within the share that close forms leave, and the change worth a name."""
    left = fit.chi2 - floor
    healthy = sound(problem, before.hypothesis.delay)
    worth = WORTH * healthy / SOUND
    return before.chi2 - fit.chi2 > worth and left < max(healthy * floor, (1 - EXPLAINED) * excess)


def _is_steady(problem: Problem, before: Fit, fitted: Fit) -> bool:
    """Whether a fit may be named: its parameters are parameters, and it leaves the mass where weighing found it."""
    return are_constant(problem, before, fitted) and not is_beyond_weighing(problem, fitted)


def _heavier(problem: Problem, before: Fit, chosen: Step, effects: Sequence[Effect]) -> Step | None:
    """A mass, or gain of the force channel, beyond weighing beside an effect that explains everything else; None where
    the mass is within it, or the two are no answer."""
    if not is_beyond_weighing(problem, chosen.trial.fit):
        return None
    made = added_mass_of(problem, chosen.trial.fit, effects)
    if made is None or not _is_steady(problem, before, made.fit):
        return None
    # An effect reads the smoothed acceleration, a weighing error the raw one: their floors differ.
    left, was = (fit.chi2 - problem.floor(fit.hypothesis) for fit in (made.fit, chosen.trial.fit))
    return Step(made, (), 0.0) if left < max(was, SOUND / 2) else None


def _part_time(problem: Problem, before: Fit, floor: float, effects: Sequence[Effect]) -> Step | None:
    """An effect that acts for a part of the time; None where there is no such window, or no law for it.

    Stricter than a single effect: outside of the window the baseline alone must reach the noise, the same law would
    have to be seen there if it acted there, and all the time it must explain far less.
    """
    steps = _in_windows(problem, before, floor, [effect for effect in effects if effect.id not in _SLOW])
    chosen = next((step for step in steps if _is_window(problem, before, floor, step.trial.fit)), None)
    return _with_settled_window(problem, chosen) if chosen is not None else None


def _in_windows(problem: Problem, before: Fit, floor: float, effects: Sequence[Effect]) -> Iterator[Step]:
    """The best of the effects in each window outside of which the baseline alone reaches the noise."""
    for window, start in windows_of(problem, before, floor):
        left = start.chi2 - floor
        candidates = scan(problem, start, [windowed(effect, window) for effect in effects])
        telling = bool(candidates) and candidates[0].gain > _TELLING * left * len(start.residual)
        found = trials(problem, start, candidates, left, least=_RIVAL) if telling else []
        if found:
            yield single(problem, found, start, left)


def _with_settled_window(problem: Problem, step: Step) -> Step:
    return replace(step, trial=replace(step.trial, fit=settled(problem, step.trial.fit)))


def _worth_a_window(effects: Sequence[Effect], candidates: Sequence[Candidate], excess: float) -> list[Effect]:
    """Effects that explain something of the excess (of the sum of squares) when they act all the time: what acts in a
    window does that as well."""
    classes = {c.effect.class_name for c in candidates if c.gain > _SOMETHING * excess}
    return [effect for effect in effects if effect.class_name in classes]


def _is_window(problem: Problem, before: Fit, floor: float, fitted: Fit) -> bool:
    """Whether a law in a window leaves next to nothing, and the window is worth it: because the law would be seen
    outside, or because it explains most even without."""
    end, excess = fitted.hypothesis, before.chi2 - floor
    if not has_edges(fitted):
        return False
    healthy = sound(problem, before.hypothesis.delay) * max(1.0, floor)
    if fitted.chi2 - problem.floor(end) > max(healthy, _WINDOW_LEFT * excess):
        return False
    always = try_fit(problem, replace(end, terms=(*end.terms[:-1], end.terms[-1].law)))
    worth = (always.chi2 - fitted.chi2) / excess if always is not None else 1.0
    if worth > _WINDOW_WORTH[1]:
        return is_off_outside(end.terms[-1], problem.signals(end))
    return _WINDOW_WORTH[0] < worth < 1 - _ALMOST  # the law has most to say without a window as well


def _worn(
    problem: Problem, before: Fit, floor: float, library: Sequence[Effect], several: Sequence[Step] | None
) -> list[Step]:
    """Hysteretic friction that wears or is pinched, far above the noise; empty where it is not that, or no better than
    the effects that were found."""
    reached = several[-1].trial.chi2 if several else before.chi2
    if before.chi2 - floor < FAR * floor or reached < 2 * floor:
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
    if excess < FAR * least or before.chi2 - chosen.trial.chi2 < _MOST * excess:
        return []
    line = grow(problem, [chosen.trial], library, chosen.trial.chi2 - floor)
    if len(line) < 2 or line[-1].chi2 > (1 - _MUCH) * chosen.trial.chi2:
        return [chosen]
    if line[-1].tied or not helps_everywhere(chosen.trial.fit, line[-1].fit):
        return [chosen]
    return [chosen, Step(line[-1], (), 0.0)]


def _named(
    problem: Problem,
    before: Fit,
    floor: float,
    steps: Sequence[Step],
    first: Sequence[Trial],
    untestable: tuple[str, ...],
) -> Choice:
    steps = _led_on(problem, before, floor, steps, first)
    after = _with_one_mass(problem, steps[-1].trial.fit)
    names = tuple(dict.fromkeys(step.trial.name for step in steps))
    classes = tuple(tuple(dict.fromkeys((step.trial.name, *step.tied))) for step in steps)
    return Choice(
        before, after, floor, problem.floor(after.hypothesis), names, classes, tuple(step.margin for step in steps),
        False, tuple(first), untestable,
    )  # fmt: skip


def _led_on(
    problem: Problem, before: Fit, floor: float, steps: Sequence[Step], first: Sequence[Trial]
) -> Sequence[Step]:
    """What is named, fitted to the end. One effect that comes to a better valley is compared with its look-alikes
    there: in the valley where all of them were stuck, the simplest had won."""
    last = steps[-1]
    best = replace(last.trial, fit=_to_the_end(problem, last.trial.fit))
    if len(steps) > 1 or last.trial.chi2 - best.chi2 < WORTH:
        return [*steps[:-1], replace(last, trial=best)]
    excess = before.chi2 - floor
    step = single(problem, _compared(problem, [best, *first], before, excess), before, excess)
    return [replace(step, trial=replace(step.trial, fit=_to_the_end(problem, step.trial.fit)))]


def _with_one_mass(problem: Problem, fitted: Fit) -> Fit:
    """Added mass that holds what the refit took for a weighing error as well: the two are one."""
    here = fitted.hypothesis
    at = next((i for i, term in enumerate(here.terms) if term.effect.id == ADDED_MASS), None)
    if at is None or here.weighing == 0.0:
        return fitted
    term = here.terms[at]
    name = term.effect.amplitudes[0]
    whole = replace(term, values={**term.values, name: term.values[name] + here.weighing * here.values["m"]})
    there = replace(here, weighing=0.0, terms=(*here.terms[:at], whole, *here.terms[at + 1 :]))
    rows = problem.rows(there)
    return replace(fitted, hypothesis=there, residual=rows, chi2=fitted.chi2 * float(rows @ rows) / fitted.rss)


def _to_the_end(problem: Problem, reached: Fit) -> Fit:
    """What is named, fitted to the end: where much is explained, comparisons accept a side valley, or end early."""
    for _ in range(_ROUNDS):
        if reached.chi2 - problem.floor(reached.hypothesis) < SOUND:
            return reached
        on = try_fit(problem, reached.hypothesis, LAST) or reached
        fits = [try_fit(problem, start, LAST, bar=on.chi2) for start in other_valleys(problem, on)]
        best = min([reached, on, *(made for made in fits if made is not None)], key=lambda made: made.chi2)
        if best.chi2 > reached.chi2 - SOUND:
            return best
        reached = best
    return reached


def others_instead(problem: Problem, choice: Choice, library: Sequence[Effect]) -> Iterator[Choice]:
    """What else there is where one effect was named for all that was found: each other effect that explains it, best
    first, and the same law in a window of time that makes it better."""
    if len(choice.named) != 1:
        return
    (name,) = choice.named
    excess = choice.before.chi2 - choice.floor_before
    for trial in distinct(choice.trials):
        if trial.name == name or not _explains(problem, trial.fit, choice.floor_after, choice.before, excess):
            continue
        after = _to_the_end(problem, trial.fit)
        if _explains(problem, after, problem.floor(after.hypothesis), choice.before, excess):
            yield _instead(problem, choice, trial.name, after)
    forms = [effect for effect in library if effect.id == name and name not in _SLOW]
    for step in _in_windows(problem, choice.before, choice.floor_before, forms):
        if has_edges(step.trial.fit) and choice.after.chi2 - step.trial.chi2 > WORTH:
            yield _instead(problem, choice, name, _with_settled_window(problem, step).trial.fit)


def _instead(problem: Problem, choice: Choice, name: str, after: Fit) -> Choice:
    alike = tuple(dict.fromkeys((name, *choice.classes[0])))
    floor = problem.floor(after.hypothesis)
    return replace(choice, after=after, floor_after=floor, named=(name,), classes=(alike,), left_open={})


def _untestable(candidates: Sequence[Candidate]) -> tuple[str, ...]:
    """Ids of which every form is absorbed by the refit."""
    least: dict[str, float] = {}
    for candidate in candidates:
        ident = candidate.effect.id
        least[ident] = min(least.get(ident, 1.0), candidate.absorbed)
    return tuple(sorted(ident for ident, share in least.items() if share > ABSORBED))
