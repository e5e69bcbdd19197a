"""``hystid diagnose``: from recordings and a baseline to a verdict, a model, and the files that show both."""

from __future__ import annotations

import csv
import io
import logging
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hystid.diagnosis.decide import forms
from hystid.diagnosis.decide.answer import Answer, Verdict, refit_values
from hystid.diagnosis.decide.selection import Choice, choose
from hystid.diagnosis.decide.unseen import unseen_likelihood
from hystid.diagnosis.fit.periodic import periodic_forces
from hystid.diagnosis.fit.problem import Fit, Hypothesis, Problem, Term
from hystid.diagnosis.fit.search import downhill, from_nominal, other_valleys, try_fit
from hystid.diagnosis.fit.uncertainty import honest
from hystid.diagnosis.fit.windows import for_recording
from hystid.diagnosis.fit.zeros import zeros_instead
from hystid.diagnosis.model.adapters import FmuModel, is_fmu, mass_of
from hystid.diagnosis.model.baseline import Baseline, baseline_of, real_parameters
from hystid.diagnosis.model.beginnings import beginning
from hystid.diagnosis.model.channel_effects import history
from hystid.diagnosis.model.effects import Effect, Scales
from hystid.diagnosis.model.library import load_effects
from hystid.diagnosis.model.redundancy import without_redundancy
from hystid.diagnosis.model.starts import scaled, sizes_of
from hystid.diagnosis.prepare import chain
from hystid.diagnosis.prepare.bandwidth import where_white
from hystid.diagnosis.prepare.decay import NoDecay, is_free, released
from hystid.diagnosis.prepare.given import Given, given_parameters
from hystid.diagnosis.prepare.independence import measurements
from hystid.diagnosis.prepare.readings import consistent
from hystid.diagnosis.prepare.resonances import resonances, several_masses
from hystid.diagnosis.prepare.rest import trimmed, without_rest
from hystid.diagnosis.prepare.segments import HiddenMotion, Part, band, prepare_part, visible, without_x
from hystid.diagnosis.prove.extended import Kind, Skeleton
from hystid.diagnosis.prove.freerun import errors
from hystid.diagnosis.prove.runs import Run, Runs, compile_text, free_runs, write_beside
from hystid.diagnosis.tell import locate
from hystid.diagnosis.tell.dependence import dependences
from hystid.diagnosis.tell.findings import findings, headline, next_experiment
from hystid.diagnosis.tell.result import Diagnosis, Errors, Traces
from hystid.errors import NumericalError, RecordingError, UsageError
from hystid.files import inside, safe_name, write_json, write_text
from hystid.modelcode import ModelCode
from hystid.modelica import compile_model
from hystid.processing import prepare
from hystid.progress import track
from hystid.recording import Recording, Sources, loaded
from hystid.smoothing.noise import noise_level

Array = NDArray[np.float64]
SHORTEST = 200  # samples: below this nothing can be told from noise
# faults that the diagnosis names instead of refusing them
TOLERATED = ("clipped", "lag", "missing_force", "not_one_motion")
_MOST = 1_200_000  # samples of all recordings together: memory stays below 1 GB
_CLOSE = 0.02  # error of a free run that integration and interpolation alone may leave
_NOISE_FREE = 2e-5  # noise over spread: below the 16 bit of any converter
_GOOD_RIG = 2e-3  # noise over spread, 54 dB
_LIBRARY = "HystId."
_STARTS = (0.5, 2.0)  # factors on the nominal shapes of the law, for further starts of the refit
_VALLEYS = 2  # rounds of looking for a better valley of the refit
_JUMPS = 2  # rounds in which rows near jumps are found, and the refit begins again without them
_APART = 0.01  # relative difference of mean squares that makes two optima of the refit
_REST = 1.3  # residual over the noise beyond which a named answer says that something is left
_LEFT = 0.03  # excess over the floor below which a refit needs no further start


def diagnose(
    recordings: Sources,
    *,
    model: str | Path,
    parameters: str | Path | Mapping[str, Any] | None = None,
    holdout: Sources = (),
    effects: str | Path | Sequence[str | Path] | None = None,
    exclude: Sequence[str] = (),
    out: str | Path | None = None,
) -> Diagnosis:
    """Find the physics that a model leaves out.

    recordings: at least one with force and motion (t, F and any of x, v, a; SI units). model: a class of the library
    ("HystId.Oscillators.Jenkins") or of a file ("rig.mo:Rig") with input F, states x and v, and output R.
    parameters: name -> value, or name -> {"value": ..., "fixed": true}; a mapping or a JSON file. A mass that is given
    counts as weighed (known to 3.5 %) unless it says "fixed": false (free) or true (exact); other values are starts.
    What is not given is scaled from the recordings, for classes of the library. holdout: recordings that are used
    for nothing but the free run in the end. effects: .mo file or files with further blocks.
    exclude: ids of the library that are not tried.
    out: folder for diagnosis.json, extended.mo, extended.fmu and mismatch_<recording>.csv.
    Raises UsageError, RecordingError, ModelicaError, ToolchainError; a structure that cannot be diagnosed is a verdict.

    >>> import hystid
    >>> rig = hystid.build("HystId.Oscillators.Jenkins", "rig.fmu")  # it sticks and slips; the model does not
    >>> sweep = hystid.simulate(rig, "chirp:1-40Hz@40N,2s", dt=1e-3, noise_snr=40)
    >>> answer = hystid.diagnose(sweep, model="HystId.Oscillators.Linear", parameters={"m": 1.0})
    >>> answer.verdict, answer.findings[0].effect
    ('missing_physics', 'hysteretic_friction')
    """
    if not recordings:
        raise UsageError("no recording was given: name at least one file")
    given = given_parameters(parameters)
    try:
        tests, unseen = loaded(recordings, TOLERATED), loaded(holdout, TOLERATED)
    except RecordingError as missing:
        if inputs_missing(missing):
            return not_applicable(str(missing), str(model), given.values, out)
        raise
    _check_apart(tests, unseen)
    refusal = _not_applicable([*tests, *unseen])
    if refusal:
        return not_applicable(refusal, str(model), given.values, out)
    read = consistent(tests, unseen, given.mass if "m" not in given.free else None)
    try:
        tests, unseen, given = _with_decays(read.tests, read.unseen, given)
    except NoDecay as refused:
        return not_applicable(str(refused), str(model), given.values, out)
    tests, unseen = (
        [_with_noise(test, i) for i, test in enumerate(where_white([_measured_only(t) for t in _bounded(group)]))]
        for group in (tests, unseen)
    )
    if is_fmu(model) and not (fmu := FmuModel(model)).holds:
        return _written(_free_run_only(fmu, [*tests, *unseen], str(model), given.values), None, out)
    with track("diagnosis", 100) as step, _quiet_models():
        try:
            case = _prepare(tests, unseen, str(model), given, read.faults)
        except HiddenMotion as hidden:
            return not_applicable(f"{hidden}; record x or v as well", str(model), given.values, out)
        step(15, "baseline fitted")
        timeless = any(test.quasi_static for test in tests) or chain.one_speed([p.x for p in case.problem.parts])
        left_out = {*exclude, *(chain.TIMED if timeless else ())}
        left_out |= set() if case.baseline.mass else {"hidden_mode"}  # nothing resonates where nothing is inert
        everything = load_effects(_paths(effects))
        left_out |= set() if case.problem.timed else {effect.id for effect in everything if effect.needs_clock}
        if not case.problem.sees_x:  # laws of the displacement, and those that remember it
            left_out |= {effect.id for effect in everything if "x" in effect.reads or effect.remembers}
        left_out |= {effect.id for effect in everything if given.unforced and "a" in effect.reads}
        library = [effect for effect in everything if effect.id not in left_out]
        share = max(1, len(library) // 70)
        choice = choose(
            case.problem, case.refit, library, _every(step, share), valleys=case.valleys,
            unseen=unseen_likelihood(case.problem, case.unseen),
        )  # fmt: skip
        untestable = {*choice.untestable, *((left_out - {*exclude}) & {effect.id for effect in everything})}
        choice = replace(choice, untestable=tuple(sorted(untestable)))
        answer, extended = _conclude(case, _with_errors(case.problem, choice, library), library)
    return _written(answer, extended, out)


def not_applicable(
    why: str, model: str, values: Mapping[str, float] | None = None, out: str | Path | None = None
) -> Diagnosis:
    """The answer for a structure or recordings that cannot be diagnosed; written where a folder is given."""
    advice = f"Record F and at least one of x, v and a in one file, with at least {SHORTEST} samples, better thousands."
    found = Diagnosis("not_applicable", why, model, dict(values or {}), {}, next_experiment=advice)
    return _written(found, None, out)


def _free_run_only(fmu: FmuModel, tests: Sequence[Recording], model: str, values: Mapping[str, float]) -> Diagnosis:
    """All that an FMU with co-simulation only can show: how far its free run is from the measured displacement."""
    parts = [prepare_part(test, i) for i, test in enumerate(tests)]
    found = errors(fmu, parts, values)
    worst = max((e if e is not None else np.inf for _, e in found), default=np.inf)
    noise = max(p.noise["x"] / float(np.std(p.measured["x"])) if "x" in p.noise else 0.0 for p in parts)
    agrees = worst < max(_CLOSE, 3 * noise)
    limits = (
        "this FMU offers co-simulation only, so that its states cannot be held to the motion: nothing is refitted, "
        "located or named; export it with Model Exchange for that"
    )
    told = f"error of the displacement in free run {100 * worst:.3g} %" if np.isfinite(worst) else "no finite free run"
    nothing = float("nan"), float("nan")
    listed = tuple(Errors(p.name, nothing, (e, e)) for p, (_, e) in zip(parts, found, strict=True))
    verdict: Verdict = "consistent" if agrees else "not_applicable"
    advice = "Export the FMU with Model Exchange, or give the model as Modelica."
    return Diagnosis(verdict, f"{told}; {limits}", model, dict(values), {}, errors=listed, next_experiment=advice)


def inputs_missing(refusal: RecordingError) -> bool:
    """Whether recordings were refused for nothing but missing channels or too few samples: that is a verdict."""
    rules = [line.rpartition("[")[2].rstrip("]") for line in str(refusal).splitlines()]
    return set(rules) <= {"missing_channel", "too_short"}


def _check_apart(tests: Sequence[Recording], unseen: Sequence[Recording]) -> None:
    """Raises UsageError where a held-out recording holds the samples of one that is used."""
    for held in unseen:
        for test in tests:
            pairs = [(getattr(held, name), getattr(test, name)) for name in "Fxva"]
            shared = [(one, other) for one, other in pairs if one is not None and other is not None]
            if shared and all(np.array_equal(one, other) for one, other in shared):
                raise UsageError(f"{held.name} is held out and used ({test.name} has the same samples): leave out one")


def _bounded(tests: list[Recording]) -> list[Recording]:
    """Recordings of bounded size: beyond 1.2 million samples all are decimated, without aliasing, and say so."""
    factor = -(-sum(len(test) for test in tests) // _MOST)
    return [prepare(test, decimate=factor) for test in tests] if factor > 1 else tests


def _measured_only(test: Recording) -> Recording:
    """A recording without the channels that were computed from others, and a note of what was taken as measured."""
    found = measurements(test)
    told = [f"{test.name}: {name} left out, {why}" for name, why in found.computed.items()]
    return replace(found.recording, notes=(*test.notes, *told))


def _with_noise(test: Recording, seed: int) -> Recording:
    """A simulated recording gets the noise of a good rig: else errors of integration would be named as physics."""
    channels = {name: getattr(test, name) for name in "Fxva" if getattr(test, name) is not None}
    if any(noise_level(values) > _NOISE_FREE * float(np.std(values)) for values in channels.values()):
        return test
    rng = np.random.default_rng(seed)
    noisy = {k: u + _GOOD_RIG * float(np.std(u)) * rng.standard_normal(len(u)) for k, u in channels.items()}
    note = f"{test.name} holds no noise: white noise of {100 * _GOOD_RIG:g} % of each channel is added"
    return replace(test, notes=(*test.notes, note), **noisy)


def _with_decays(
    tests: Sequence[Recording], unseen: Sequence[Recording], given: Given
) -> tuple[list[Recording], list[Recording], Given]:
    """Recordings whose force is known, free decays too; a mass of 1 where nothing gives a scale. Raises NoDecay."""
    given = replace(given, unforced=all(is_free(test) for test in tests))
    used = released(tests, given.mass)
    held = released(unseen, 1.0 if used.unscaled else given.mass)
    if used.unscaled:
        given = replace(given, values={**given.values, "m": 1.0}, fixed=given.fixed | {"m"})
        used.tests[0] = replace(used.tests[0], notes=(*used.notes, *used.tests[0].notes))
    return used.tests, held.tests, given


@contextmanager
def _quiet_models() -> Iterator[None]:
    """A model that is tried at thousands of parameters would warn thousands of times."""
    logger = logging.getLogger("hystid")
    level = logger.level
    logger.setLevel(logging.ERROR)
    try:
        yield
    finally:
        logger.setLevel(level)


@dataclass(frozen=True)
class Case:
    """Everything that the search works on."""

    problem: Problem
    baseline: Baseline
    refit: Fit
    valleys: tuple[Fit, ...]
    nominal_chi2: float
    faults: tuple[chain.Fault, ...]
    consistency: Mapping[str, Any]
    unseen: tuple[Part, ...]
    notes: tuple[str, ...]


def _every(step: Callable[..., None], share: int) -> Callable[[], None]:
    count = 0

    def progress() -> None:
        nonlocal count
        count += 1
        if count % share == 0:
            step(1, "effects compared")

    return progress


def _paths(effects: str | Path | Sequence[str | Path] | None) -> list[Path]:
    if effects is None:
        return []
    return [Path(effects)] if isinstance(effects, str | Path) else [Path(item) for item in effects]


def _not_applicable(tests: Sequence[Recording]) -> str:
    """Why these recordings cannot be diagnosed, "" where they can."""
    for test in tests:
        if test.x is None and test.v is None and test.a is None:
            return f"{test.name} has no channel of the motion: record x, v or a beside F"
        if len(test) < SHORTEST:
            return f"{test.name} has {len(test)} samples: at least {SHORTEST} are needed, better thousands"
    return ""


def _prepare(
    tests: Sequence[Recording],
    unseen: Sequence[Recording],
    model: str,
    given: Given,
    late: tuple[chain.Fault, ...] = (),
) -> Case:
    tests, unseen = ([trimmed(chain.seated(test)) for test in group] for group in (tests, unseen))
    still = any(test.quasi_static for test in tests)
    sensors = chain.examined(tests, unseen)
    tests, unseen = sensors.tests, sensors.unseen
    parts = [prepare_part(test, seed, sensors.stopped) for seed, test in enumerate(tests)]
    code, runs = _compiled(model, given.values)
    named, fixed, free = (_with_mass(names, code) for names in (given.values, given.fixed, given.free))
    whole = {v.name for v in code.variables if v.type != "Real"}
    values = {name: given.values[key] for name, key in named.items() if name not in whole}
    weighed = "m" in values and "m" not in free and "m" not in fixed
    rate_law = not baseline_of(model, code, values, frozenset(fixed), model=runs).reads_x()
    parts, hidden = without_x(parts) if rate_law else visible(parts, values.get("m", 0.0))
    parts, rests = without_rest(parts)
    length = max(float(np.max(np.abs(part.x))) for part in parts)

    def begun(values: Mapping[str, float]) -> tuple[Baseline, list[str]]:
        starts, told = _starts(parts, code, values, model, quasi_static=still)
        dampers = {v.name for v in real_parameters(code) if v.unit == "N.s/m"} - set(values) if still else set()
        start, rest = {**starts, **dict.fromkeys(dampers, 0.0), **values}, frozenset(fixed) | dampers
        return baseline_of(model, code, start, rest, weighed=weighed, length=length, model=runs), told

    baseline, told = begun(values)
    if (sentence := _no_force(baseline, parts)) and model.startswith(_LIBRARY):
        baseline, told = begun({name: value for name, value in values.items() if name in {"m", *fixed}})
        told = [f"the parameters that were given are no start: {sentence}", *told]
    if sentence := _no_force(baseline, parts):
        raise NumericalError(f"{sentence}; give parameters at which {model} has an answer on these recordings")
    parts, kept, running = beginning(parts, baseline)
    baseline, held_back = without_redundancy(baseline, parts)
    problem = Problem(parts, baseline, _scales(parts, baseline))
    refit, valleys, nominal = _refit(problem, kept)
    refit, lines = periodic_forces(problem, refit)
    held = tuple(prepare_part(test, 100 + i) for i, test in enumerate(unseen))
    told += [chain.NO_CLOCK] if still else []
    notes = (
        *sensors.notes,
        *(line.sentence() for line in lines),
        *told,
        *hidden,
        *rests,
        *running,
        *held_back,
        *(note for test in tests for note in test.notes),
    )
    return Case(problem, baseline, refit, valleys, nominal, (*late, *sensors.faults), sensors.consistency, held, notes)


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
    """Start values of a class of the library for what was not given, and a sentence about them.

    A user's own class keeps its defaults, which are what the user believes.
    """
    variables = real_parameters(code)
    if not model.startswith(_LIBRARY):
        return {}, []
    hysteretic = "f_h" in {v.name for v in code.variables} and not set(code.states) <= {"x", "v"}
    sizes = sizes_of(parts, values.get("m"), inertial=not quasi_static)
    starts = scaled(variables, values, sizes, hysteretic)
    notes = [f"start values from the recordings: {', '.join(f'{k} = {v:.4g}' for k, v in starts.items())}"]
    if "m" not in values and sizes.mass == 0.0:
        reason = "time only numbers the samples" if quasi_static else "inertia cannot be told from the other forces"
        notes.append(f"mass 0, as {reason}: the force is taken as the restoring force; give m where this is not so")
    return starts, notes if starts else []


def _refit(problem: Problem, kept: Sequence[int] = ()) -> tuple[Fit, tuple[Fit, ...], float]:
    """The baseline from several starts, other optima that were met, and the mean square at the nominal values.

    Further starts only while something is left: where a simplex comes to from the nominal shapes, these made smaller
    and larger, then where it comes to from the best, and shapes scattered around: a law with corners has side valleys.
    kept: numbers of recordings in which a contact keeps a force of the time before.
    """
    before = history(kept)
    terms = (Term(before, dict.fromkeys(before.amplitudes, 0.0)),) if kept else ()
    nominal = Hypothesis(dict(problem.baseline.nominal), terms)
    rows = problem.rows(nominal)
    fits = [made for made in (try_fit(problem, nominal, 25),) if made is not None]
    if fits and not _sits(problem, fits[0]) and (relaxed := from_nominal(problem, fits[0])) is not None:
        fits += [made for h in downhill(problem, relaxed) if (made := try_fit(problem, h, 25)) is not None]
    for factor in _STARTS if problem.baseline.shapes else ():
        fits.sort(key=lambda f: f.chi2)
        if fits and _sits(problem, fits[0]):
            break
        values = dict(problem.baseline.nominal)
        for name in problem.baseline.shapes:
            values[name] *= factor if name in problem.baseline.positive else 1.0
        fits += [made for made in (try_fit(problem, Hypothesis(values, terms), 25),) if made is not None]
    fits.sort(key=lambda f: f.chi2)
    if not fits:
        raise NumericalError("the baseline has no finite force on these recordings; check its nominal parameters")
    for _ in range(_VALLEYS):
        if _sits(problem, best := fits[0]):
            break
        starts = other_valleys(problem, best)
        fits += [made for h in starts if (made := try_fit(problem, h, 25, bar=best.chi2)) is not None]
        fits.sort(key=lambda f: f.chi2)
        if fits[0].chi2 > (1 - _APART) * best.chi2:
            break
    best, *others = fits
    for _ in range(_JUMPS):
        weighed = problem.reduce.weighs
        if not problem.distrust(best.hypothesis, nominal) and not weighed:
            break
        again = [best.hypothesis, nominal]  # jumps may have led the fits astray: begin again without them
        fits = [made for h in again if (made := try_fit(problem, h, 25)) is not None]
        best, rows, others = min(fits, key=lambda f: f.chi2), problem.rows(nominal), []
    valleys = [f for f in others if f.chi2 > (1 + _APART) * best.chi2]
    return best, tuple(valleys[:2]), float(np.mean(rows**2))


def _sits(problem: Problem, fitted: Fit) -> bool:
    """Whether a refit leaves hardly more than noise."""
    return fitted.chi2 < problem.floor(fitted.hypothesis) + _LEFT


def _scales(parts: Sequence[Part], baseline: Baseline) -> Scales:
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


def _with_errors(problem: Problem, choice: Choice, library: Sequence[Effect]) -> Choice:
    """The selection with standard errors that hold, and what the forms of the named laws leave open."""
    named = choice.after is not choice.before
    left_open = forms.left_open(problem, choice.after, library) if named else {}
    problem.forget_columns()  # what follows takes room of its own
    before = honest(problem, choice.before)
    after = honest(problem, choice.after) if named else before
    return replace(choice, before=before, after=after, left_open=left_open)


def _conclude(case: Case, choice: Choice, library: Sequence[Effect]) -> tuple[Diagnosis, str | None]:
    """Findings, extended model and free runs."""
    runs = _runs(case, choice)
    answer, choice, (before, after) = runs.answer, runs.answer.choice, (runs.before, runs.after)
    found = findings(answer)
    names = [part.name for part in case.problem.parts]
    force = _force_errors(case, choice)
    listed = tuple(Errors(n, f, (b[1], a[1])) for n, f, b, a in zip(names, force[0], before[0], after[0], strict=True))
    unseen = tuple(
        Errors(p.name, f, (b[1], a[1])) for p, f, b, a in zip(case.unseen, force[1], before[1], after[1], strict=True)
    )
    verdict = answer.verdict()
    told = _not_borne_out(unseen) if choice.named else []
    depends = tuple(dependences(case.problem, choice.after.hypothesis, choice.before.hypothesis))
    remains = _rest(choice)
    masses = several_masses(resonances(case.problem.parts)) if remains or choice.unknown else []
    masses += zeros_instead(case.problem, choice.after.hypothesis)
    notes = (*case.notes, *runs.notes, *told, *remains, *masses, *(one.sentence() for one in depends))
    unknown = None
    if verdict == "unknown_physics":
        rest = case.problem.balance(choice.after.hypothesis)
        unknown = locate.where_unknown(case.problem, rest, _noise(case))
    last = choice.after.hypothesis
    named = {name for finding in found for name in finding.alike}  # another form of the same id may be absorbed
    hidden = tuple(name for name in choice.untestable if name not in named)
    diagnosis = Diagnosis(
        verdict, "", case.baseline.name, dict(case.baseline.nominal), refit_values(answer, choice.before), found,
        listed, unseen, hidden, "", (_mean(force[0], 0), _mean(force[0], 1)), _floor(case), unknown,
        notes,
        {"lags": case.consistency, "delay": last.delay, "weighing": last.weighing},
        _traces(case, choice, answer, before, after), choice, case.problem, choice.after, choice.posterior,
        dependence=depends,
    )  # fmt: skip
    worded = replace(diagnosis, headline=headline(diagnosis), next_experiment=next_experiment(diagnosis))
    return worded, runs.text


def _not_borne_out(unseen: Sequence[Errors]) -> list[str]:
    """A sentence for each held-out recording whose force is no better explained with what is named than without."""
    return [
        f"{e.name} was held out and is not better explained with what is named (force error {100 * e.force[0]:.3g} % "
        f"without, {100 * e.force[1]:.3g} % with it): it may be of another state of the structure"
        for e in unseen
        if e.force[1] >= e.force[0]
    ]


def _rest(choice: Choice) -> list[str]:
    """A sentence where what is named leaves clearly more than noise."""
    left = float(np.sqrt(choice.after.chi2 / max(choice.floor_after, 1e-300)))
    if not choice.named or left < _REST:
        return []
    return [f"what is named leaves {left:.2g} times the noise: something smaller has no name yet"]


def _runs(case: Case, choice: Choice) -> Runs:
    """Free runs before and after what was named, and the answer that comes of them."""
    answer = Answer(case.problem, case.baseline, choice, case.nominal_chi2, case.faults)
    return free_runs(answer, _skeleton(case.baseline), case.unseen)


def _skeleton(baseline: Baseline) -> Skeleton:
    """What the written model is built around."""
    file, _, _ = baseline.name.rpartition(":")
    text = Path(file).read_text(encoding="utf-8") if file.endswith(".mo") else ""
    kind: Kind = "fmu" if is_fmu(baseline.name) else "extends" if baseline.takes_effects else "wraps"
    return Skeleton(baseline.name, kind, baseline.reading.mass, baseline.inner_mass, text, baseline.has_h)


def _noise(case: Case) -> float:
    return float(np.mean([part.balance_noise(case.baseline.mass) for part in case.problem.parts]))


def _floor(case: Case) -> float:
    """Share of the force that is noise: NRMSE that a perfect model would reach."""
    mass = case.baseline.mass
    shares = [p.balance_noise(mass) / float(np.std(p.F - mass * p.a)) for p in case.problem.parts]
    return float(np.mean(shares))


def _mean(force: Sequence[tuple[float, float]], which: int) -> float:
    return float(np.mean([pair[which] for pair in force]))


def _force_errors(case: Case, choice: Choice) -> tuple[list[tuple[float, float]], list[tuple[float, float]]]:
    """NRMSE of the force balance before and after, per training and held-out recording."""
    problem, found = case.problem, []
    unseen = for_recording(choice.after.hypothesis)
    groups = [(problem, choice.after.hypothesis), *([(problem.of(case.unseen), unseen)] if case.unseen else [])]
    for group, last in groups:
        rests = [group.balance(h) for h in (choice.before.hypothesis, last)]
        mass = choice.after.hypothesis.mass()
        spread = [float(np.std(p.F - mass * p.a)) or 1.0 for p in group.parts]
        found.append([(float(np.std(b)) / s, float(np.std(a)) / s) for b, a, s in zip(*rests, spread, strict=True)])
    return found[0], found[1] if case.unseen else []


def _traces(
    case: Case, choice: Choice, answer: Answer, before: tuple[Run, Run], after: tuple[Run, Run]
) -> tuple[Traces, ...]:
    problem = case.problem
    mass = choice.after.hypothesis.mass()
    residual, left = (problem.balance(f.hypothesis) for f in (choice.before, choice.after))
    acting = answer.acting()
    made = []
    for i, part in enumerate(problem.parts):
        noise = part.balance_noise(case.baseline.mass)
        named = acting is not None
        force = acting[i] if acting is not None else np.zeros(len(part))
        score = locate.score(force, noise) if named else locate.unknown_score(residual[i], noise)
        made.append(
            Traces(
                part.name, part.t, part.x, part.v, part.F - mass * part.inertia, residual[i], left[i], force, score,
                noise, before[0][i][0], after[0][i][0],
            )
        )  # fmt: skip
    return tuple(made)


def _written(answer: Diagnosis, extended: str | None, out: str | Path | None) -> Diagnosis:
    if out is None:
        return answer
    folder = Path(out)
    folder.mkdir(parents=True, exist_ok=True)
    for trace in answer.traces:
        write_text(inside(folder, f"mismatch_{safe_name(trace.name)}.csv"), _table(trace))
    if extended is not None:
        from hystid.fmu import build

        write_text(folder / "extended.mo", extended)
        if is_fmu(answer.model):
            build(compile_text(extended), folder / "effects.fmu")
            write_beside(answer.model, _fmu_settings(answer), folder / "effects.fmu", folder / "extended.ssp")
        else:
            build(compile_text(extended), folder / "extended.fmu")
    write_json(folder / "diagnosis.json", answer.as_dict())
    return replace(answer, folder=folder)


def _fmu_settings(answer: Diagnosis) -> Mapping[str, float]:
    """Parameters of an FMU as they are in the end, by its own names."""
    if answer.problem is None or answer.final is None:
        return {}
    return answer.problem.baseline.settings(answer.final.hypothesis.parameters())


def _table(trace: Traces) -> str:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(["t [s]", "residual [N]", "score [-]"])
    writer.writerows(
        [f"{t:.9g}", f"{r:.7g}", f"{s:.6g}"] for t, r, s in zip(trace.t, trace.residual, trace.score, strict=True)
    )
    return text.getvalue()
