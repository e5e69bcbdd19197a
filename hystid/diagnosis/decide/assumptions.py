"""Assumptions about what nobody measured: the selection is made under one, and again under others.

In: a case. Out: the case under the assumptions that hold, and its selection. Others are tried only where something is
missing: slow motion that no channel shows, what contacts keep of the time before, noise that is slow, rest in which
friction holds any force, and a displacement that is an integral. Where nothing is, rest is looked at, which no fit saw.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from hystid.diagnosis.decide.criterion import DOUBT, NAME, ZERO, Criterion, FittedSet, leaves_noise
from hystid.diagnosis.decide.selection import Choice, choose, choose_among, weigh
from hystid.diagnosis.decide.unseen import unseen_likelihood
from hystid.diagnosis.fit.case import (
    Case,
    at_rest,
    held_for_a_while,
    moved_slowly,
    never_let_go,
    noise_beside,
    off_zero,
    swings_of_the_past,
    unseen_along,
    with_the_past,
    with_what_struck,
    without_lines_beside,
)
from hystid.diagnosis.fit.clipped import below_level, clipped_force, force_stays
from hystid.diagnosis.fit.hypothesis import Fit
from hystid.diagnosis.fit.independence import TWO_SIDED
from hystid.diagnosis.fit.problem import Problem, standing
from hystid.diagnosis.fit.refit import refit_again
from hystid.diagnosis.fit.search import try_fit
from hystid.diagnosis.fit.slow_motion import Runs, lacks_slow_motion, runs_of, slow_motion_of
from hystid.diagnosis.fit.windowscan import outside
from hystid.diagnosis.fit.zeros import zeros_of_x
from hystid.diagnosis.model.effects import Effect
from hystid.diagnosis.prepare.faults import DELAY, SATURATION
from hystid.diagnosis.prepare.refused import NotDiagnosable
from hystid.diagnosis.prepare.rest import does_more_than_noise, held
from hystid.diagnosis.prepare.segments import Part
from hystid.numeric import Array, Flags, stretches

Decided = tuple[Case, Choice]
_PLAINER = 4  # hypotheses of fewer numbers that are looked at with a displacement off its zero
_LEADING, _ROUNDS = 4, 3  # hypotheses whose slow motion is looked at, and rounds of it
_PROMISED = 0.5  # share of what a fit leaves that zeros, or slow motion, must take to be worth a search
_RUBBING = 6  # laws with dry friction that are fitted again before a search
_SEEN = 3.0  # standard deviations of the noise of a channel, from which a motion at rest would be seen
_STUCK = "nothing moves for a while, though the force goes on: something holds the structure that the model has not"
_MORE_THAN_LATE = "channel {} is left out: moved back, it still leaves what the others do not"
_LOW_PASSED = "channel {} is left out: it loses fast motion, and the others leave noise without it"
_AT_LIMIT = (
    "F takes its largest value, {:.4g} N, in {:.2g} % of the samples: mass and law say that the force stays there as "
    "well, as that of dry friction, or of an actuator at its limit"
)
_INTEGRATED = (
    "x and v are left out: they have next to no noise, as integrals of a, and do not fit in slow motion, "
    "while a alone leaves nothing; if x was measured, record it again"
)


def decided(
    case: Case,
    library: Sequence[Effect],
    progress: Callable[[], None],
    posed: Callable[..., Case],
    integrated: bool = False,
    low_passed: Sequence[str] = (),
) -> Decided:
    """The case under the assumptions that hold, and its selection.

    posed: makes the case without some channels of the motion, or (rested=False) with what contacts remember left out,
    where they were taken for at rest before a recording that begins in mid-motion, or (holding=True) still. integrated:
    x and v are integrals of the acceleration. low_passed: channels of the motion that lose fast motion.
    """
    choice = chosen(case, library, progress)
    if (spared := _without_late(case, choice, library, posed, low_passed)) is not None:
        return spared
    if not choice.missing and (stuck := held_at_rest(case)) is not None:
        case, choice = stuck, chosen(stuck, library)
    if not choice.missing and (longer := _with_the_past(case, choice)) is not None:
        case, choice = longer, chosen(longer, library)
    case, choice = _struck(case, choice, library)
    case, choice = _cut_off(case, choice, library)
    case, choice = _off_zero(case, choice, library)
    if case.rested and choice.missing:
        case, choice = _moving(case, choice, library, posed(rested=False))
    if case.may_hold and choice.missing and _changes(choice):
        case, choice = _moving(case, choice, library, posed(rested=False, holding=True))
    case, choice = _without_lines(case, choice, library)
    case, choice = _with_noise_beside(case, choice, library)
    case, choice = _slowly(case, choice, library)
    case, choice = _held(*_sound(case, choice, library), library)
    case, choice = _held_for_a_while(case, choice, library)
    if integrated and choice.unknown:
        case, choice = _accelerated(case, choice, library, partial(posed, "xv"))
    case, choice = _stands(case, choice, library)
    return _not_cut_off(case, choice), choice


def _not_cut_off(case: Case, choice: Choice) -> Case:
    """Without a level of the force channel as a fault, where the force itself stays there."""
    for fault in case.faults:
        if (fault.id, fault.channel) == (SATURATION, "F") and force_stays(
            case.problem, choice.best.hypothesis, fault.size
        ):
            rest = tuple(other for other in case.faults if other is not fault)
            return replace(case, faults=rest, notes=(*case.notes, _AT_LIMIT.format(fault.size, 100 * fault.share)))
    return case


def _struck(case: Case, choice: Choice, library: Sequence[Effect]) -> Decided:
    """With the samples that were left out for knocks, where a law has a name that leaves noise there as well, and
    something unknown is less probable: what acts for a while may strike a few times. So may a further law beside one
    that is named, as a stop beside a damper does."""
    if not case.struck:
        return case, choice
    whole = with_what_struck(case)
    again = chosen(whole, library, known=choice.posterior.likely if choice.named else ())
    is_surer = not choice.named or again.posterior.unknown < choice.posterior.unknown
    is_more = set(again.named) > set(choice.named) and not _is_doubtful(again)
    explains = again.named and leaves_noise(whole.problem, again.after)
    return (whole, again) if explains and (is_surer or is_more) else (case, choice)


def _cut_off(case: Case, choice: Choice, library: Sequence[Effect]) -> Decided:
    """Without the samples at which the force channel stops, where a level is seen beside the law that fits best.

    What the channel lacks is known as well as the law, and bends a law that is fitted to it. The level is believed
    where the other samples then leave noise, or next to nothing of what the law left of them before.
    """
    if not choice.missing:
        return case, choice
    terms = tuple(t for t in choice.best.hypothesis.terms if t.effect.id != SATURATION)
    bare = standing(case.problem, replace(choice.best.hypothesis, terms=terms))
    found = clipped_force(case.problem, bare)
    if not found:
        return case, choice
    parts, fault = below_level(case.problem.parts, found[0].level)
    problem = case.problem.of(parts)
    refitted, minima, nominal = refit_again(problem, [case.refit, *case.minima])
    unseen = tuple(below_level(case.unseen, fault.size)[0]) if case.unseen else ()
    cut = replace(
        case, problem=problem, refit=refitted, minima=minima, nominal_chi2=nominal, unseen=unseen,
        faults=(*case.faults, fault),
    )  # fmt: skip
    known = [h for h in choice.posterior.likely if SATURATION not in h.names]
    again = chosen(cut, library, known=known)
    criterion = Criterion(problem, again.before, 1)
    left, before = (criterion.misfit(f, criterion.floor) for f in (again.best, standing(problem, bare.hypothesis)))
    is_better = criterion.is_reached(left) or left < criterion.usual * before
    return (cut, again) if is_better and again.posterior.unknown <= choice.posterior.unknown else (case, choice)


def held_at_rest(case: Case) -> Case | None:
    """The case with the stretches at rest, None where no force swings there: one that does, while nothing moves, is
    held by something that the model has not. A force that stays says where a contact stopped, and nothing else; one
    under which the model moves by less than the noise says nothing."""
    runs = runs_of(case.baseline, case.refit)
    still = [_shows(part, held(part), runs) for part in case.problem.parts]
    if not any(map(np.any, still)):
        return None
    pairs = zip(case.problem.parts, still, strict=True)
    parts = [p if p.valid is None else replace(p, valid=p.valid | rest) for p, rest in pairs]
    problem = case.problem.weighed(parts)  # a law that turns with the velocity may hold any force there
    criterion = Criterion(problem, standing(problem, case.refit.hypothesis), 1)
    count, swing, first = 0, 0.0, 0
    for i, flags in enumerate(still):
        number = np.cumsum(np.diff(flags, prepend=False) & flags) * flags
        inside = problem.reduce.plain(i, number.astype(float))
        rows, sure = (
            every[first : first + len(inside)] for every in (criterion.baseline.residual, problem.reduce.sure())
        )
        first += len(inside)
        for k in range(1, int(np.max(inside, initial=0)) + 1):
            stretch = rows[(inside == k) & sure]
            if not len(stretch):
                continue
            count += len(stretch)
            swing += len(stretch) * float(np.var(stretch))
    if not count or not criterion.is_more_than_sound(swing / count - criterion.noise_of(count)):
        return None
    refitted, minima, nominal = refit_again(problem, [case.refit, *case.minima])
    names = " and ".join(part.name for part, rest in zip(parts, still, strict=True) if np.any(rest))
    notes = (*case.notes, f"{names}: {_STUCK}")
    return replace(case, problem=problem, refit=refitted, minima=minima, nominal_chi2=nominal, notes=notes)


def _shows(part: Part, rest: Flags, runs: Runs) -> Flags:
    """Stretches at rest, (n,), in which the force swings, and a free run of the model moves by more than the noise of
    some channel: noise of a force moves a model too."""
    run = runs(part) if np.any(rest) else None
    if run is None:
        return np.zeros(len(part), dtype=bool)
    moved, shown = {"x": run}, np.zeros(len(part), dtype=bool)
    moved["v"] = np.gradient(moved["x"], part.dt)
    moved["a"] = np.gradient(moved["v"], part.dt)
    for first, last in stretches(rest):
        inside = slice(first, last)
        shown[inside] = does_more_than_noise(part.F[inside], part.noise["F"]) and any(
            np.std(moved[name][inside]) > _SEEN * part.noise[name] for name in part.measured if name in moved
        )
    return shown


def chosen(
    case: Case,
    library: Sequence[Effect],
    progress: Callable[[], None] = lambda: None,
    *,
    known: Sequence[FittedSet] = (),
) -> Choice:
    """The selection of a case, with what its held-out recordings say. known: what was likely under another assumption,
    which the search may pass by here."""
    unseen = unseen_likelihood(case.problem, case.unseen)
    return choose(case.problem, case.refit, library, progress, minima=case.minima, unseen=unseen, known=known)


def _off_zero(case: Case, choice: Choice, library: Sequence[Effect]) -> Decided:
    """With the displacement off its zero, where fewer laws then leave as little: a law that is not linear, measured off
    its zero, looks like that law and another one."""
    if not choice.missing or not case.problem.sees_x:
        return case, choice
    problem, criterion = case.problem, Criterion(case.problem, choice.before, 1)
    numbers = _numbers(choice)
    listed = [c.hypothesis for c in choice.posterior.candidates if not c.hypothesis.windowed]
    plainer = sorted((h for h in listed if h.numbers < numbers), key=lambda h: h.fit.chi2)
    for fit in (choice.before, *(h.fit for h in plainer[:_PLAINER])):
        if criterion.is_reached(left := criterion.misfit(fit, criterion.floor)):
            continue  # nothing is left that zeros could take: whether the plainer law is the likelier one is decided
        zeros, less = zeros_of_x(problem, fit, ZERO)
        if not _are_usual(problem, zeros) or less / criterion.rows < _PROMISED * left:
            continue
        there = problem.with_zeros(zeros)
        moved = try_fit(there, fit.hypothesis)
        if moved is None or not _explains(criterion, choice, criterion.misfit(moved, criterion.floor)):
            continue
        zeros = zeros + zeros_of_x(there, moved, ZERO)[0]
        other = off_zero(case, zeros, moved)
        again = chosen(other, library, known=choice.posterior.likely)
        left = criterion.misfit(again.best, criterion.floor)
        if _are_usual(problem, zeros) and _explains(criterion, choice, left) and _numbers(again) < numbers:
            return other, again
    return case, choice


def _are_usual(problem: Problem, zeros: Array) -> bool:
    """Whether a displacement sensor is off these zeros [m] in one case of twenty, or more often."""
    return all(abs(zero) < TWO_SIDED * ZERO * np.std(part.x) for zero, part in zip(zeros, problem.parts, strict=True))


def _explains(criterion: Criterion, choice: Choice, misfit: float) -> bool:
    """Whether no more is left than a choice leaves, or than a right law does."""
    left = criterion.misfit(choice.after, choice.floor_after) + criterion.slack if choice.named else -np.inf
    return misfit < left or criterion.is_settled(misfit, choice.before.chi2 - choice.floor_before)


def _numbers(choice: Choice) -> float:
    """Real parameters of what is named: none where nothing is missing, and without end where no law explains it."""
    if not choice.missing:
        return 0
    named = frozenset(choice.named)
    return next((c.hypothesis.numbers for c in choice.posterior.candidates if frozenset(c.names) == named), np.inf)


def _without_lines(case: Case, choice: Choice, library: Sequence[Effect]) -> Decided:
    """Without periodic forces that nobody measured and that show beside the law that fits best, where something unknown
    is no more probable then: beside all that was missing they did not stand out."""
    found = without_lines_beside(case, choice.best) if choice.missing else None
    if found is None:
        return case, choice
    again = chosen(found, library, known=choice.posterior.likely)
    return (case, choice) if again.posterior.unknown > choice.posterior.unknown else (found, again)


def _with_noise_beside(case: Case, choice: Choice, library: Sequence[Effect]) -> Decided:
    """With the noise as it is beside the law that fits best. Not where a law that left noise leaves more than noise
    then: the colour that was measured beside it is not that of the noise either. Nor where one that left more makes all
    of it go away without a name: it may have been in the rows in which that law jumps."""
    beside = noise_beside(case, choice.best) if choice.missing else None
    if beside is None:
        return case, choice
    again = chosen(beside, library, known=choice.posterior.likely)
    left_noise = leaves_noise(case.problem, choice.best)
    is_worse = not leaves_noise(beside.problem, again.best) if left_noise else not again.missing
    return (case, choice) if is_worse else (beside, again)


def _is_doubtful(choice: Choice) -> bool:
    """Whether something is missing that may have no name."""
    return choice.missing and choice.posterior.unknown >= DOUBT


def _changes(choice: Choice) -> bool:
    """Whether what is missing has no name, or is said to change with time: what contacts held does when they let go."""
    return not choice.named or any(term.effect.needs_clock for term in choice.after.hypothesis.terms)


def _moving(case: Case, choice: Choice, library: Sequence[Effect], other: Case) -> Decided:
    """With what contacts remember left out, where nothing is missing then, or that makes something unknown less
    probable: a refit without the law that is missing cannot tell where contacts stood before, and a law may make up for
    contacts that were not at rest. Not where the samples that are left out hold a mismatch that no past explains."""
    again = chosen(other, library, known=choice.posterior.likely)
    better = not again.missing or (_is_doubtful(choice) and again.posterior.unknown < choice.posterior.unknown)
    return (other, again) if better and not _is_a_law(case.problem, other.problem, again.best) else (case, choice)


def _with_the_past(case: Case, choice: Choice) -> Case | None:
    """The case with the samples whose force depends on the time before, None where they hold nothing else."""
    if not case.complete:
        return None
    whole = case.problem.of(case.complete)
    return with_the_past(case, whole) if _is_a_law(whole, case.problem, choice.best) else None


def _is_a_law(whole: Problem, kept: Problem, fitted: Fit) -> bool:
    """Whether a fit leaves more in the samples that are not kept than a sound structure and its past do."""
    swings = swings_of_the_past(whole, kept, fitted)
    return Criterion(whole, standing(whole, fitted.hypothesis), 1).is_more_than_sound(swings)


def _accelerated(case: Case, choice: Choice, library: Sequence[Effect], made: Callable[[], Case]) -> Decided:
    """From the acceleration alone, where nothing is missing then, in half of the samples at least that told something
    before: an integral has lost the slow motion."""
    try:
        other = made()
    except NotDiagnosable:
        return case, choice
    other, again = _sound(other, chosen(other, library), library)
    if again.missing or not tells_half(other.problem, case.problem):
        return case, choice
    return replace(other, notes=(*other.notes, _INTEGRATED)), again


def tells_half(other: Problem, problem: Problem) -> bool:
    """Whether the force of the law is known in half as many samples as before, at least: else little says anything."""
    told, before = (np.count_nonzero(one.reduce.sure()) * one.reduce.block for one in (other, problem))
    return bool(2 * told >= before)


def _without_late(
    case: Case, choice: Choice, library: Sequence[Effect], posed: Callable[..., Case], low_passed: Sequence[str]
) -> Decided | None:
    """Without the late channel of the motion, where the others leave noise and it does not: what delays a channel often
    does more to it. Without one that is low-passed, too, where the others leave noise, and nothing is missing
    if it left noise as well. None where that is not so, where no channel is either, or no other shows the motion."""
    late = next((fault.channel for fault in case.faults if fault.id == DELAY and fault.channel != "F"), "")
    channel = late or next(iter(low_passed), "")
    left_noise = leaves_noise(case.problem, choice.best)
    if not channel or not choice.missing or (late and left_noise):
        return None
    try:
        other = posed(channel)
    except NotDiagnosable:
        return None
    if any(channel in part.measured for part in other.problem.parts):
        return None
    if late and not leaves_noise(other.problem, other.refit):
        law = try_fit(other.problem, choice.best.hypothesis)
        if law is None or not leaves_noise(other.problem, law):
            return None
    again = chosen(other, library, known=choice.posterior.likely)
    told = (*other.notes, (_MORE_THAN_LATE if late else _LOW_PASSED).format(channel))
    whole = replace(other, faults=case.faults, consistency=case.consistency, notes=told)
    is_better = leaves_noise(other.problem, again.best) and not (left_noise and again.missing)
    return (whole, again) if is_better else None


def _slowly(case: Case, choice: Choice, library: Sequence[Effect]) -> Decided:
    """With slow motion that no channel shows as the baseline has it, where nothing is missing then; or as a law has it
    that left more than noise, and leaves much less then."""
    if not choice.missing:
        return case, choice
    if (sound := _sound_with(moved_slowly(case, [choice.before]), library)) is not None:
        return sound
    for _ in range(_ROUNDS):
        if not choice.missing or leaves_noise(case.problem, choice.best):
            break
        leading = [c.hypothesis for c in choice.posterior.candidates[:_LEADING]]
        left, floor = choice.best.chi2, case.problem.floor(choice.best)
        laws = [choice.before, *(h.fit for h in leading)]
        moved = moved_slowly(case, laws, left - _PROMISED * (left - floor))
        if moved is None:
            break
        case, choice = moved, chosen(moved, library, known=leading)
    return case, choice


def _stands(case: Case, choice: Choice, library: Sequence[Effect]) -> Decided:
    """With slow motion that no channel shows as the named law does it.

    What is named, and how surely, stays, but for sets: one of a set may have made up for that motion.
    """
    found = slow_motion_of(case.problem, [choice.after]) if choice.named and lacks_slow_motion(case.problem) else None
    before = try_fit(found.problem, choice.before.hypothesis, 25) if found is not None else None
    if found is None or before is None:
        return case, choice
    here = replace(case, problem=found.problem, notes=found.told(case.notes), unseen=unseen_along(case, found))
    made = replace(choice, before=before, after=found.fit)
    if len(made.named) > 1:
        again = chosen(replace(here, refit=before, minima=()), library, known=choice.posterior.likely)
        made = again if again.named else made
    return here, made


def _sound(case: Case, choice: Choice, library: Sequence[Effect]) -> Decided:
    """With what contacts keep of the time before as the law has it, where nothing is missing then."""
    kept = never_let_go(case, choice.best) if choice.missing else None
    return _sound_with(kept, library) or (case, choice)


def _sound_with(case: Case | None, library: Sequence[Effect]) -> Decided | None:
    """A case and its selection where nothing is missing in it; else None."""
    if case is None or not leaves_noise(case.problem, case.refit):
        return None
    choice = chosen(case, library)
    return None if choice.missing else (case, choice)


def _rubs(fit: Fit) -> bool:
    """Whether a law of a fit turns with the direction of the motion."""
    return any(term.effect.turns for term in fit.hypothesis.terms)


def _held(case: Case, choice: Choice, library: Sequence[Effect]) -> Decided:
    """With what may be at rest weighed down, where that makes dry friction the answer and something unknown less
    probable."""
    if not _is_doubtful(choice) or (again := at_rest(case, library)) is None:
        return case, choice
    if _has_friction(choice):  # the name is known; rest can only move its numbers
        unseen = unseen_likelihood(again.problem, again.unseen)
        other = choose_among(choice.posterior.likely, again.problem, again.refit, library, unseen)
        other = replace(other, trials=choice.trials)
    else:
        rubbing = [c.hypothesis for c in choice.posterior.candidates if _rubs(c.hypothesis.fit)][:_RUBBING]
        if weigh(again.problem, again.refit, library, rubbing).unknown >= min(NAME, choice.posterior.unknown):
            return case, choice  # no law that rubs would have the name, and a search takes its time
        other = chosen(again, library, known=choice.posterior.likely)
    return (again, other) if _is_better(other, choice) else (case, choice)


def _held_for_a_while(case: Case, choice: Choice, library: Sequence[Effect]) -> Decided:
    """The same for dry friction that acts for a part of the time, with the samples that were left out for knocks: what
    takes hold, and slips now and then, looks like some."""
    if not _is_doubtful(choice) or not case.problem.timed:
        return case, choice
    whole, before = (with_what_struck(case), case.refit) if case.struck else (case, choice.before)
    criterion = Criterion(whole.problem, standing(whole.problem, before.hypothesis), 1)
    start, left = outside(whole.problem, criterion.baseline)
    if left - criterion.floor > criterion.usual * criterion.misfit(criterion.baseline, criterion.floor):
        return case, choice
    again = held_for_a_while(whole, start, library)
    if again is None:
        return case, choice
    other = chosen(again, library)  # windows that were found before ended where rest was taken for what no law gives
    return (again, other) if _is_better(other, choice) else (case, choice)


def _is_better(other: Choice, choice: Choice) -> bool:
    """Whether dry friction is the answer of another choice, and something unknown is less probable there."""
    return _has_friction(other) and other.posterior.unknown < choice.posterior.unknown


def _has_friction(choice: Choice) -> bool:
    """Whether a law that is named turns with the direction of the motion."""
    return bool(choice.named) and _rubs(choice.after)
