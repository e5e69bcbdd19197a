"""``hystid diagnose``: from recordings and a baseline to a verdict, a model, and the files that show both."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from threadpoolctl import threadpool_limits

from hystid.diagnosis.decide import forms
from hystid.diagnosis.decide.assumptions import decided
from hystid.diagnosis.decide.criterion import variance_of_states
from hystid.diagnosis.decide.possible import possible
from hystid.diagnosis.decide.selection import Choice
from hystid.diagnosis.fit.case import Case, pose
from hystid.diagnosis.fit.extended import extensible
from hystid.diagnosis.fit.problem import Problem
from hystid.diagnosis.fit.uncertainty import with_robust_errors
from hystid.diagnosis.model.adapters import FmuModel
from hystid.diagnosis.model.catalogue import Catalogue, catalogue_of
from hystid.diagnosis.model.effects import Effect
from hystid.diagnosis.model.library import load_effects
from hystid.diagnosis.prepare.given import given_parameters
from hystid.diagnosis.prepare.recordings import Taken, take
from hystid.diagnosis.prepare.refused import SHORTEST, NotDiagnosable
from hystid.diagnosis.prove.unchanged import unchanged
from hystid.diagnosis.tell.conclude import conclude, free_run_only
from hystid.diagnosis.tell.result import Diagnosis
from hystid.diagnosis.tell.turned import turned
from hystid.diagnosis.tell.written import written
from hystid.errors import UsageError
from hystid.progress import quiet_models, track
from hystid.recording import Sources
from hystid.rig.terms import is_fmu


def diagnose(
    recordings: Sources,
    *,
    model: str | Path,
    parameters: str | Path | Mapping[str, Any] | None = None,
    holdout: Sources | None = (),
    effects: str | Path | Sequence[str | Path] | None = None,
    exclude: Sequence[str] = (),
    out: str | Path | None = None,
) -> Diagnosis:
    """Find the physics that a model leaves out.

    recordings: at least one with force and motion (t, F and any of x, v, a; SI units). model: a class of the library
    ("HystId.Oscillators.Jenkins") or of a file ("rig.mo:Rig") with input F, states x and v, and output R.
    parameters: name -> value, or name -> {"value": ..., "fixed": true}; a mapping or a JSON file. A mass that is given
    counts as weighed (known to 3.5 %) unless it says "fixed": false (free) or true (exact); other values are starts.
    What is not given is scaled from the recordings, for classes of the library. holdout: recordings that no fit sees;
    they judge the fits by their own noise. effects: .mo file or files with further blocks.
    exclude: ids of the library that are not tried.
    out: folder for diagnosis.json, extended.mo, extended.fmu and mismatch_<recording>.csv.
    Raises UsageError, RecordingError, ModelicaError, ToolchainError; a structure that cannot be diagnosed is a verdict.

    >>> import hystid
    >>> rig = hystid.build("HystId.Oscillators.Jenkins", "rig.fmu")  # it sticks and slips; the model does not
    >>> sweep = hystid.simulate(rig, "chirp:1-40Hz@40N,2s", dt=1e-3, noise_snr=40)
    >>> answer = hystid.diagnose(sweep, model="HystId.Oscillators.Linear", parameters={"m": 1.0})
    >>> answer.verdict, answer.findings[0].title
    ('missing_physics', 'hysteretic friction')
    """
    if recordings is None or (isinstance(recordings, Sequence) and not recordings):
        raise UsageError("no recording was given: name at least one file")
    given, model = given_parameters(parameters), extensible(str(model))
    try:
        # matrices are small here: threads of a BLAS mostly wait for each other, and take three times the time
        with threadpool_limits(1, "blas"), track("diagnosis", 100) as step, quiet_models():
            taken = take(recordings, () if holdout is None else holdout, given)
            fmu = FmuModel(model, given.values) if is_fmu(model) else None
            as_given = unchanged(Path(model), taken.read, given.values) if fmu else ()
            if fmu and not fmu.holds:
                answer, extended = free_run_only(fmu, taken, model), None
            else:
                everything = load_effects(_paths(effects))
                posed = _posing(taken, model, catalogue_of(everything))
                case = posed()
                step(15, "baseline fitted")
                library, untestable = possible(everything, case, exclude)
                every = _every(step, max(1, len(library) // 70))
                case, choice = decided(case, library, every, posed, taken.integrated, taken.low_passed)
                choice = replace(choice, untestable=tuple(sorted({*choice.untestable, *untestable})))
                answer, extended = conclude(case, _with_errors(case.problem, choice, library))
    except NotDiagnosable as refusal:
        return not_applicable(str(refusal), model, given.values, out)
    answer = replace(answer, misread=taken.misread, doubts=taken.doubts, as_given=as_given, extended=extended)
    return written(turned(answer) if taken.tests[0].rotational else answer, out)


def _posing(taken: Taken, model: str, catalogue: Catalogue) -> Callable[..., Case]:
    """Makes the case, without some channels of the motion or with another belief about the time before."""

    def posed(without: str = "", *, rested: bool = True, holding: bool = False) -> Case:
        return pose(taken.without(without), model, catalogue, rested=rested, holding=holding)

    return posed


def not_applicable(
    why: str, model: str, values: Mapping[str, float] | None = None, out: str | Path | None = None
) -> Diagnosis:
    """The answer for a structure or recordings that cannot be diagnosed; written where a folder is given."""
    advice = f"Record F and at least one of x, v and a in one file, with at least {SHORTEST} samples, better thousands."
    found = Diagnosis("not_applicable", why, model, dict(values or {}), {}, next_experiment=advice)
    return written(found, out)


def _with_errors(problem: Problem, choice: Choice, library: Sequence[Effect]) -> Choice:
    """The selection with standard errors that hold, and what the forms of the named laws leave open."""
    named = choice.after is not choice.before
    left_open = forms.left_open(problem, choice.after, library) if named else {}
    problem.forget_columns()  # what follows takes room of its own
    before = with_robust_errors(problem, choice.before, variance_of_states(problem, choice.before))
    after = with_robust_errors(problem, choice.after, variance_of_states(problem, choice.after)) if named else before
    return replace(choice, before=before, after=after, left_open=left_open)


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
