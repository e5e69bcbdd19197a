"""A case: recordings and a baseline as one problem, with the baseline refitted.

In: recordings as taken and the model. Out: everything that the decision works on.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from hystid.diagnosis.fit.colour import coloured_alike, fainter, slow_power, with_colour
from hystid.diagnosis.fit.hypothesis import Fit, Hypothesis, Term
from hystid.diagnosis.fit.independence import is_noise
from hystid.diagnosis.fit.knocks import NO_LAW, without_knocks
from hystid.diagnosis.fit.periodic import without_periodic_forces
from hystid.diagnosis.fit.problem import Problem, standing
from hystid.diagnosis.fit.refit import Refit, refit, refit_again, refit_at_rest, refit_beside, refit_held
from hystid.diagnosis.fit.slow_motion import SlowMotion, lacks_slow_motion, settled_along, slow_motion_of
from hystid.diagnosis.fit.velocity_sign import longest_turn
from hystid.diagnosis.fit.windows import for_recording
from hystid.diagnosis.fit.zeros import zeros_of_x
from hystid.diagnosis.model.adapters import FmuModel
from hystid.diagnosis.model.baseline import Baseline, baseline_of
from hystid.diagnosis.model.catalogue import Catalogue
from hystid.diagnosis.model.channel_effects import history
from hystid.diagnosis.model.effects import Effect, Scales
from hystid.diagnosis.model.redundancy import without_redundancy
from hystid.diagnosis.model.transients import beginning, maybe_holding
from hystid.diagnosis.prepare import chain
from hystid.diagnosis.prepare.faults import Fault
from hystid.diagnosis.prepare.recordings import Taken
from hystid.diagnosis.prepare.refused import NotDiagnosable
from hystid.diagnosis.prepare.rest import trimmed, without_rest
from hystid.diagnosis.prepare.segments import Flags, Part, band, prepare_parts, visible, without_x
from hystid.errors import NumericalError
from hystid.modelcode import ModelCode
from hystid.modelica import compile_model
from hystid.numeric import Array
from hystid.rig.starts import Sizes, is_of_the_library, scaled, sizes_of, turning
from hystid.rig.terms import is_fmu, mass_of, real_parameters
from hystid.smoothing.noise import NOISE_ERROR

_SHARES = (1.0, 0.7, 0.5, 0.35, 0.25)  # of a colour, until the noise is no louder than all that is left
_SECTIONS = 10  # of a recording, the first of which tells most of what was before
_RESTED = ", and what its contacts remember of the time before bears out that they were at rest"
_NOTHING_LEFT = (
    "no sample is left that tells the force of the model: a channel stands at a level, or nothing moves, in all of "
    "them; record motion that goes on"
)
_OFF_ZERO = "the displacement is taken to be off its zero by {}, as fewer laws then explain as much"
_FRACTION = 1e-4  # m, from which zeros are told in mm
_NO_ZERO = 0.05  # of the largest zero, below which another one is not told
_LOUDER = 2.0  # times as much slow noise without a law as beside it: two lines of a spectrum differ by as much
_BEFORE = "what was before is not recorded"
_KEPT = (
    "samples that depend on what was before the recording are used, as if it had moved as after its start: what the "
    "model leaves in them swings with the motion, and no past does"
)
_BEGUN = 3  # times that the beginning, and knocks, are judged again by a refit


@dataclass(frozen=True)
class Case:
    """Everything that the decision works on.

    nominal_chi2: mean square at the nominal parameters. timeless: laws of time cannot show. catalogue: what the effects
    declare of themselves. rested: contacts are taken for at rest before a recording that begins in mid-motion.
    may_hold: they are where one begins still, and may hold a force. complete: the recordings with the samples whose
    force depends on what was before; none where there are no others. struck: the recordings with the samples that
    knocks are said to strike, likewise.
    """

    problem: Problem
    baseline: Baseline
    refit: Fit
    minima: tuple[Fit, ...]
    nominal_chi2: float
    faults: tuple[Fault, ...]
    consistency: Mapping[str, Any]
    unseen: tuple[Part, ...]
    notes: tuple[str, ...]
    timeless: bool = False
    catalogue: Catalogue = field(default_factory=Catalogue, repr=False)
    rested: bool = False
    may_hold: bool = False
    complete: tuple[Part, ...] = field(repr=False, default=())
    struck: tuple[Part, ...] = field(repr=False, default=())


def pose(
    taken: Taken, model: str, catalogue: Catalogue | None = None, *, rested: bool = True, holding: bool = False
) -> Case:
    """Recordings and a model as a problem with its refit. Raises NotDiagnosable, NumericalError, ModelicaError.

    catalogue: what the effects declare of themselves. rested: whether contacts may have been at rest before a recording
    that begins in mid-motion. holding: whether they may hold a force where one begins still.
    """
    tests, unseen, given = taken.tests, taken.unseen, taken.given
    timeless = any(test.quasi_static for test in tests)
    tests, unseen = ([trimmed(chain.seated(test)) for test in group] for group in (tests, unseen))
    still = any(test.quasi_static for test in tests)
    sensors = chain.examined(tests, unseen, taken.clipped)
    tests, unseen = sensors.tests, sensors.unseen
    parts = prepare_parts(tests, stopped=sensors.stopped)
    code, runs = _compiled(model, given.values)
    named, fixed, free = (_with_mass(names, code) for names in (given.values, given.fixed, given.free))
    whole = {v.name for v in code.variables if v.type != "Real"}
    values = {name: given.values[key] for name, key in named.items() if name not in whole}
    weighed = "m" in values and "m" not in free and "m" not in fixed
    rate_law = not baseline_of(model, code, values, frozenset(fixed), model=runs).reads_x()
    parts, hidden = without_x(parts) if rate_law else visible(parts, values.get("m", 0.0))
    parts, rests = without_rest(parts)
    parts = [replace(part, pace=parts[0].dt / part.dt, forced=not given.unforced) for part in parts]
    length = max(float(np.max(np.abs(part.x))) for part in parts)

    def begun(values: Mapping[str, float]) -> tuple[Baseline, list[str]]:
        starts, told = _starts(parts, code, values, model, quasi_static=still)
        dampers = {v.name for v in real_parameters(code) if v.unit == "N.s/m"} - set(values) if still else set()
        start, rest = {**starts, **dict.fromkeys(dampers, 0.0), **values}, frozenset(fixed) | dampers
        base = baseline_of(model, code, start, rest, weighed=weighed, length=length, model=runs)
        most = _longest_turns(parts, code, start) if is_of_the_library(model) else {}
        return replace(base, stated=frozenset(values), highest={**base.highest, **most}), told

    baseline, told = begun(values)
    if (sentence := _no_force(baseline, parts)) and is_of_the_library(model):
        baseline, told = begun({name: value for name, value in values.items() if name in {"m", *fixed}})
        told = [f"the parameters that were given are no start: {sentence}", *told]
    if sentence := _no_force(baseline, parts):
        raise NumericalError(f"{sentence}; give parameters at which {model} has an answer on these recordings")
    complete = parts
    parts, kept, running = beginning(parts, baseline, baseline.nominal, holding=holding)
    if given.unforced:  # friction holds what has died away off its zero, which nothing else shows
        kept = tuple(range(len(parts)))
    baseline, held_back = without_redundancy(baseline, parts)
    problem = Problem(parts, baseline, scales_of(parts, baseline))
    if not problem.reduce.count:
        raise NotDiagnosable(_NOTHING_LEFT)
    certain = {name: value for name, value in values.items() if name in {"m", *fixed}}
    sizes = _sizes(parts, certain, quasi_static=still)
    is_guessed = not {*values}.issuperset(baseline.shapes)  # nobody said how a contact slips
    starts = (sizes, *(sizes.seldom_slipping() if is_guessed else ()))
    sized = [scaled(code, certain, one) for one in starts] if is_of_the_library(model) else []
    refitted, minima, nominal = refit(problem, kept, sized)
    for _ in range(_BEGUN):  # a contact that slips later than was believed remembers longer
        longer, keeping, told_again = beginning(problem.parts, baseline, refitted.hypothesis.values, holding=holding)
        more = set(keeping) - set(kept)  # contacts that seem to let go at the nominal values, and do not
        if not more and _all_same(longer, problem.parts):
            break
        problem, running, kept = problem.of(longer), told_again, tuple(sorted({*kept, *more}))
        again = refit(problem, kept, sized) if more else refit_again(problem, [refitted, *minima])
        refitted, minima, nominal = again
    remembering = [~_valid(part) & _valid(whole) for part, whole in zip(problem.parts, complete, strict=True)]
    held = [replace(p, pace=parts[0].dt / p.dt) for p in prepare_parts(unseen, 100)]
    resting = _begun_at_rest(problem, complete, kept, sized) if rested else None
    if resting is not None:
        problem, (refitted, minima, nominal), begun_so = resting
        remembering = []
        running = [*(told for told in running if not told.startswith(begun_so)), *(f"{b}{_RESTED}" for b in begun_so)]
    held = beginning(held, baseline, refitted.hypothesis.values, holding=holding)[0]
    every, knocked = problem.parts, None
    for _ in range(0 if given.unforced else _BEGUN):  # knocks lead the refit astray, and what dies away repeats nothing
        found = without_knocks(problem.of(every), refitted)
        if found is None or (knocked is not None and _all_same(found.parts, knocked.parts)):
            break
        knocked, problem = found, problem.of(found.parts)
        refitted, minima, nominal = refit_again(problem, [refitted, *minima])
    running = [*running, *(knocked.told if knocked is not None else [])]
    if (coloured := _colour(problem, refitted)) is not None:
        problem, held = problem.of(coloured), coloured_alike(held, coloured)
        refitted, minima, nominal = refit_again(problem, [refitted, *minima])
    struck = [replace(p, valid=q.valid) for p, q in zip(problem.parts, every, strict=True)] if knocked else []
    if knocked is not None and not knocked.told:  # they belong to the law, and only the noise was to be seen without
        problem, struck = problem.of(struck), []
        refitted, minima, nominal = refit_again(problem, [refitted, *minima])
    if not given.unforced:  # a steady line would hold the motion up: what dies away has none
        refitted = without_periodic_forces(problem, refitted)
    told += [chain.NO_CLOCK] if still else []
    notes = (
        *sensors.notes,
        *told,
        *hidden,
        *rests,
        *running,
        *held_back,
        *(note for test in tests for note in test.notes),
    )
    return Case(
        problem, baseline, refitted, minima, nominal, (*taken.faults, *sensors.faults), sensors.consistency,
        tuple(held), notes, timeless or chain.one_speed([part.x for part in parts]),
        catalogue or Catalogue(), resting is not None, not holding and maybe_holding(complete, baseline),
        _with_beginnings(problem.parts, remembering), tuple(struck),
    )  # fmt: skip


def _begun_at_rest(
    problem: Problem, whole: Sequence[Part], kept: Sequence[int], sized: Sequence[Mapping[str, float]]
) -> tuple[Problem, Refit, tuple[str, ...]] | None:
    """The problem, refitted, with contacts at rest before the first sample of recordings of which their memory leaves
    out most, and how sentences about these begin; None where there are none, or they were not at rest.

    Few samples are left there, and any law fits them: what is missing would not be seen, and a contact that is believed
    to slip late remembers for long. A wrong past leaves most at the beginning, and another past less than rest does.
    """
    used, moves = ([_count(part) for part in group] for group in (problem.parts, whole))
    long = [i for i, part in enumerate(problem.parts) if part.past and 2 * used[i] < moves[i]]
    if not long:
        return None
    tried = problem.of([whole[i] if i in long else part for i, part in enumerate(problem.parts)])
    found = refit(tried, tuple(i for i in kept if i not in long), sized)
    here = found[0].hypothesis
    moving = [replace(whole[i], past=p.past) if i in long else p for i, p in enumerate(problem.parts)]
    rests, others = (_by_section(one, standing(one, here)) for one in (tried, problem.of(moving)))
    for i in long:
        first = rests[i][0]
        if first * (1 - NOISE_ERROR) > np.max(rests[i][1:]) or first > others[i][0]:
            return None
    return tried, found, tuple(f"{problem.parts[i].name} begins in mid-motion" for i in long)


def swings_of_the_past(whole: Problem, kept: Problem, fitted: Fit) -> float:
    """Mean square of what a fit leaves in the samples that one problem has and another has not, above what it leaves
    elsewhere, as far as no past explains it; 0 where there are none.

    What contacts keep of the time before stays as long as they stick, and fades, but never swings: in a section it lies
    between what there is of it in the one before and in the next one. A filter against slow noise would make it swing,
    and is left away; slow noise is then in every section of the same length.
    """
    whole = whole.of(fainter(whole.parts, whole.parts, 0.0))
    here = standing(whole, fitted.hypothesis)
    noise, rows = whole.floor(here), whole.by_part(here.residual)
    total, count = 0.0, 0
    for i, (part, other) in enumerate(zip(whole.parts, kept.parts, strict=True)):
        gone = np.rint(whole.reduce.plain(i, (_valid(part) & ~_valid(other)).astype(float))) > 0
        pieces = [piece for piece in np.array_split(rows[i][gone], _SECTIONS) if len(piece)]
        means = [*(float(np.mean(piece)) for piece in pieces), 0.0]
        usual = max(noise, _within(rows[i][~gone], max(map(len, pieces), default=1)))
        for k in range(1, len(pieces)):
            above = float(np.var(pieces[k])) - usual
            fades = (0.5 * (means[k - 1] - means[k + 1])) ** 2
            total += len(pieces[k]) * (above - min(fades, max(above, 0.0)))  # below the noise too: else noise adds up
            count += len(pieces[k])
    return total / max(count, 1)


def _within(rows: Array, length: int) -> float:
    """Mean variance of rows in sections of some length."""
    sections = np.array_split(rows, max(len(rows) // length, 1))
    return float(np.mean([np.var(section) for section in sections])) if len(rows) else 0.0


def with_the_past(case: Case, problem: Problem) -> Case:
    """The case with another problem: that with the samples whose force depends on what was before, with the motion run
    backwards before them."""
    notes = (*(note for note in case.notes if _BEFORE not in note), _KEPT)
    return _refitted(case, problem, refit_again(problem, [case.refit, *case.minima]), notes=notes)


def with_what_struck(case: Case) -> Case:
    """The case with the samples that were left out for knocks."""
    problem = case.problem.of(case.struck)
    notes = tuple(note for note in case.notes if NO_LAW not in note)
    return _refitted(case, problem, refit_again(problem, [case.refit, *case.minima]), notes=notes, struck=())


def _refitted(case: Case, problem: Problem, found: Refit, **changes: Any) -> Case:
    """The case with another problem and the fits that belong to it."""
    fitted, minima, nominal = found
    return replace(case, problem=problem, refit=fitted, minima=minima, nominal_chi2=nominal, **changes)


def _with_beginnings(parts: Sequence[Part], remembering: Sequence[Flags]) -> tuple[Part, ...]:
    """The parts with the samples valid that were left out for what was before; none where there are none."""
    if not any(map(np.any, remembering)):
        return ()
    pairs = zip(parts, remembering, strict=True)
    return tuple(replace(part, valid=_valid(part) | flags) for part, flags in pairs)


def _valid(part: Part) -> Flags:
    return np.ones(len(part), dtype=bool) if part.valid is None else part.valid


def _count(part: Part) -> int:
    """Samples that say something about the law."""
    return int(np.count_nonzero(_valid(part)))


def _by_section(problem: Problem, fitted: Fit) -> list[Array]:
    """Mean squares of the residual in sections of each recording, one after the other."""
    each = problem.by_part(fitted.residual)
    return [np.array([np.sum(u**2) / max(len(u), 1) for u in np.array_split(rows, _SECTIONS)]) for rows in each]


def _all_same(parts: Sequence[Part], others: Sequence[Part]) -> bool:
    """Whether the same samples say something in both."""
    return all(_same(one.valid, other.valid) for one, other in zip(parts, others, strict=True))


def _same(one: Flags | None, other: Flags | None) -> bool:
    return one is other or (one is not None and other is not None and bool(np.array_equal(one, other)))


def _colour(problem: Problem, refitted: Fit, *, led: bool = False) -> list[Part] | None:
    """The parts with the colour of their noise, None where it is white.

    Measured twice: a constant force that is missing leads the first refit astray, and the way it does is slow. A refit
    that gives little for slow forces does not follow it. No noise is louder than all that is left: what moves the
    structure may have added to it.
    """
    if not problem.timed:
        return None
    seen, is_below = with_colour(problem, refitted, led=led)
    if is_below and seen is not None:
        seen, _ = with_colour(problem, refit_again(problem.of(seen), [refitted])[0])
    for share in _SHARES if seen is not None else ():
        parts = fainter(problem.parts, seen or (), share)
        coloured = problem.of(parts)
        again = refit_again(coloured, [refitted])[0]
        if again.chi2 >= coloured.floor(again) - NOISE_ERROR:
            return parts if is_below or is_noise(coloured, again) else None
    return None


def noise_beside(case: Case, law: Fit) -> Case | None:
    """The case with its noise as it is beside a law that explains what the baseline leaves: with its colour there, and
    the rows weighed down in which this law jumps. None where that is about the same.

    What moves the structure slowly, or not at all, may have been taken for noise as long as no law explained it, and
    noise for a force; and a refit that is led astray jumps elsewhere.
    """
    problem, leaves_more = case.problem, law.chi2 > case.problem.floor(law) + NOISE_ERROR
    was_white = not any(any(part.colour) for part in problem.parts)
    if was_white and not leaves_more:
        return None
    white = problem.of(fainter(problem.parts, problem.parts, 0.0))
    beside = refit_again(white, [law])[0]
    coloured = _colour(white, beside)
    again = problem.of(coloured or white.parts)
    if coloured is not None:
        beside = refit_again(again, [beside])[0]
    is_noise_now = leaves_more and beside.chi2 < again.floor(beside) + NOISE_ERROR
    if coloured is not None:  # a force that nobody has modelled may be slow as well
        is_noise_now = is_noise_now and is_noise(again, beside)
    is_fainter = slow_power(problem.parts) >= _LOUDER * slow_power(again.parts)
    if not (is_noise_now or is_fainter or law.chi2 < problem.floor(law) - NOISE_ERROR):
        return None
    found = refit_beside(again, [case.refit, *case.minima], beside)
    return _refitted(case, again, found, unseen=tuple(coloured_alike(case.unseen, again.parts)))


def without_lines_beside(case: Case, law: Fit) -> Case | None:
    """The case without the periodic forces that show beside a law, and did not beside the baseline; None where none
    does."""
    if case.problem.unforced:
        return None
    made, here = without_periodic_forces(case.problem, law).hypothesis.terms, case.refit.hypothesis
    lines = made[len(law.hypothesis.terms) :]
    start = replace(case.refit, hypothesis=replace(here, terms=(*here.terms, *lines)))
    return _refitted(case, case.problem, refit_again(case.problem, [start])) if lines else None


def at_rest(case: Case, effects: Sequence[Effect]) -> Case | None:
    """The case with the rows weighed down in which dry friction that was left out may hold the structure; None where
    there are none."""
    problem = case.problem.weighed(case.problem.parts)
    found = refit_at_rest(problem, [case.refit, *case.minima], effects)
    return _refitted(case, problem, found) if found is not None else None


def held_for_a_while(case: Case, start: Fit, effects: Sequence[Effect]) -> Case | None:
    """The same for dry friction that acts for a part of the time. start: the baseline as it fits where nothing acts."""
    problem = case.problem.weighed(case.problem.parts)
    found = refit_held(problem, [case.refit, *case.minima], start, effects)
    return _refitted(case, problem, found) if found is not None else None


def never_let_go(case: Case, fit: Fit) -> Case | None:
    """The case with a constant force of the time before where the law, with the parameters of a fit of more laws, says
    that its contacts never let go; None where it does not.

    A refit without that force may make contacts slip that do not.
    """
    parts, kept, told = beginning(case.problem.parts, case.baseline, fit.hypothesis.values)
    if not kept:
        return None
    before, problem = history(kept), case.problem.of(parts)
    start = Hypothesis(fit.hypothesis.values, (Term(before, dict.fromkeys(before.amplitudes, 0.0)),))
    begun = tuple(f"{part.name} begins in mid-motion" for part in parts)
    notes = (*(note for note in case.notes if not note.startswith(begun)), *told)
    return _refitted(case, problem, refit_again(problem, [replace(fit, hypothesis=start)]), notes=notes)


def moved_slowly(case: Case, laws: Sequence[Fit], most: float = np.inf) -> Case | None:
    """The case with slow motion that no channel shows as that law does it, of some, which leaves least then; None where
    each of them leaves less without, or that one leaves more than some mean square. Noise that is slow shows then."""
    best = slow_motion_of(case.problem, laws) if lacks_slow_motion(case.problem) else None
    if best is None or best.fit.chi2 > most:
        return None
    if not any(any(part.colour) for part in best.problem.parts) and (seen := _colour(best.problem, best.fit, led=True)):
        best = replace(best, problem=best.problem.of(seen))
    start = replace(best.fit, hypothesis=replace(best.fit.hypothesis, terms=case.refit.hypothesis.terms))
    found = refit_again(best.problem, [start, case.refit, *case.minima])
    return _refitted(case, best.problem, found, notes=best.told(case.notes), unseen=unseen_along(case, best))


def unseen_along(case: Case, found: SlowMotion) -> tuple[Part, ...]:
    """Held-out recordings with the slow motion of a law."""
    if not case.unseen:
        return ()
    there = case.problem.elsewhere(case.unseen)
    elsewhere = replace(found.fit, hypothesis=for_recording(found.fit.hypothesis.elsewhere()))
    return tuple(settled_along(there, elsewhere, found.octaves, found.model).parts)


def off_zero(case: Case, zeros: Array, law: Fit) -> Case:
    """The case with the zeros of the displacement [m] taken out of each recording, and of held-out ones those beside
    which a law leaves least there. law: a fit of the case."""
    parts = [part.with_zero(zero) for part, zero in zip(case.problem.parts, zeros, strict=True)]
    shares = [abs(zero) / float(np.std(part.x)) for zero, part in zip(zeros, parts, strict=True)]
    problem = case.problem.of(parts)
    start = replace(law, hypothesis=replace(law.hypothesis, terms=case.refit.hypothesis.terms))
    fits = refit_again(problem, [start, case.refit, *case.minima])
    unseen = case.unseen
    if unseen:
        there = case.problem.elsewhere(unseen)
        found, _ = zeros_of_x(there, standing(there, law.hypothesis.elsewhere()), max(shares), free=False)
        unseen = tuple(part.with_zero(zero) for part, zero in zip(unseen, found, strict=True))
    scale, unit = (1e3, "mm") if np.max(np.abs(zeros)) >= _FRACTION else (1e6, "µm")
    told = _OFF_ZERO.format(
        ", ".join(
            f"{scale * zero:.3g} {unit} in {part.name} ({100 * share:.2g} % of its standard deviation)"
            for zero, part, share in zip(zeros, parts, shares, strict=True)
            if share > _NO_ZERO * max(shares)
        )
    )
    return _refitted(case, problem, fits, unseen=unseen, notes=(*case.notes, told))


def _no_force(baseline: Baseline, parts: Sequence[Part]) -> str:
    """Why the law has no finite force along a recording at its nominal values; "" where it has."""
    try:
        baseline.forces([baseline.held(part.x, part.v, part.dt) for part in parts], baseline.nominal)
    except NumericalError as error:
        return str(error)
    return ""


def _compiled(model: str, values: Mapping[str, float]) -> tuple[ModelCode, FmuModel | None]:
    """Code of a class with its array sizes set, or an FMU."""
    if is_fmu(model):
        fmu = FmuModel(model)
        return fmu.code, fmu
    code = compile_model(model)
    whole = {v.name for v in code.variables if v.type != "Real"}
    sizes = {name: value for name, value in values.items() if name in whole}
    return compile_model(model, parameters=sizes) if sizes else code, None


def _with_mass(names: Iterable[str], code: ModelCode) -> dict[str, str]:
    """Name in the diagnosis -> name as given; the mass is m whatever the model calls it."""
    mass = mass_of(code.variables)
    return {"m" if name == mass else name: name for name in names}


def _starts(
    parts: Sequence[Part], code: ModelCode, values: Mapping[str, float], model: str, *, quasi_static: bool
) -> tuple[dict[str, float], list[str]]:
    """Start values of a class of the library for what was not given, and a sentence about them."""
    if not is_of_the_library(model):
        return {}, []
    sizes = _sizes(parts, values, quasi_static=quasi_static)
    starts = scaled(code, values, sizes)
    notes = [f"start values from the recordings: {', '.join(f'{k} = {v:.4g}' for k, v in starts.items())}"]
    if "m" not in values and sizes.mass == 0.0:
        reason = "time only numbers the samples" if quasi_static else "inertia cannot be told from the other forces"
        notes.append(f"mass 0, as {reason}: the force is taken as the restoring force; give m where this is not so")
    return starts, notes if starts else []


def _sizes(parts: Sequence[Part], values: Mapping[str, float], *, quasi_static: bool) -> Sizes:
    *motion, force = (np.concatenate([getattr(p, name) for p in parts]) for name in ("x", "v", "a", "F"))
    return sizes_of(motion, force, values.get("m"), inertial=not quasi_static)


def _longest_turns(parts: Sequence[Part], code: ModelCode, start: Mapping[str, float]) -> dict[str, float]:
    """Largest speeds over which a law of the library may turn: beyond, it is no contact that turns, but a damper, and a
    refit takes it for what is missing."""
    return {name: max(longest_turn(parts), start.get(name, 0.0)) for name in turning(real_parameters(code))}


def scales_of(parts: Sequence[Part], baseline: Baseline) -> Scales:
    """Sizes of motion, force, time and frequency, from which effects take their starts and bounds."""
    x, v = (np.sort(np.concatenate([np.abs(getattr(p, name)) for p in parts])) for name in ("x", "v"))
    if baseline.has_h:
        h = [baseline.force(p.x, p.v, p.dt, baseline.nominal)[1] for p in parts]
    else:  # what an effect may bring is of the size of the restoring force
        h = [p.F - baseline.mass * p.a for p in parts]
    force = np.sort(np.abs(np.concatenate(h)))
    path = max(float(np.sum(np.abs(p.v)) * p.dt) for p in parts)
    return Scales(x, v, force, max(float(p.t[-1]) for p in parts), parts[0].dt, _band(parts), path)


def _band(parts: Sequence[Part]) -> tuple[float, float]:
    """Frequencies between which all recordings move [Hz]."""
    low, high = zip(*map(band, parts), strict=True)
    return max(min(low), 1.0 / float(parts[0].t[-1])), max(high)
