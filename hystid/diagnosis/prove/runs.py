"""The proof: the refitted baseline and the extended model in free run, and the output-error fit of the latter."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from hystid.compiled import CompiledModel
from hystid.diagnosis.decide.answer import Answer, refit_values
from hystid.diagnosis.decide.criterion import Criterion
from hystid.diagnosis.decide.selection import Choice
from hystid.diagnosis.fit.extended import Skeleton, extended_model, settings_of
from hystid.diagnosis.fit.hypothesis import Fit, Hypothesis
from hystid.diagnosis.fit.problem import Problem
from hystid.diagnosis.fit.windows import for_recording, has_own_windows, has_windows
from hystid.diagnosis.model.channel_effects import ChannelEffect
from hystid.diagnosis.model.freerun import diverges, error, errors
from hystid.diagnosis.prepare.segments import Part
from hystid.diagnosis.prove.output_error import output_error_fit
from hystid.errors import FmuError, NumericalError
from hystid.files import scratch
from hystid.fmu import build
from hystid.fmu.coupling import simulate_with_effects
from hystid.fmu.door import OpenedFmu, open_fmu
from hystid.fmu.ssp import Connection, write_ssp
from hystid.modelica_text import EXTENDED, compile_text
from hystid.numeric import Array

_MOST_STEPPED = 60_000  # samples of all recordings that two FMUs are run through step by step: some ten seconds
_BALANCE = 1.3  # rise of the balance's mean square up to which an output-error fit agrees with the measured forces
_AWAY = 2.0  # error of the free run with what is named over that without: four times the power is left unexplained
Run = list[tuple[Array | None, float | None]]


@dataclass(frozen=True)
class Runs:
    """Free runs before and after, of the recordings used and held out; the answer with what the output-error fit moved.

    text: the extended model. notes: what was done to the parameters.
    """

    answer: Answer
    text: str
    before: tuple[Run, Run]
    after: tuple[Run, Run]
    notes: tuple[str, ...] = ()


def free_runs(answer: Answer, skeleton: Skeleton, unseen: Sequence[Part]) -> Runs:
    """Run the baseline and, where something was named, the extended model, fitted on its run where that helps."""
    choice, base = answer.choice, answer.baseline
    groups = (answer.problem.parts, unseen)
    first = choice.before.hypothesis
    values = base.settings(first.parameters())
    model = base.model if base.mass else None  # without a mass nothing moves by itself
    before = errors(model, groups[0], values, first.delay), errors(model, groups[1], values, first.delay)
    text = written(answer, skeleton)
    if choice.after is choice.before or model is None:
        return Runs(answer, text, before, before)
    if skeleton.kind == "fmu":
        last = choice.after.hypothesis
        end = base.settings(last.parameters())
        return Runs(answer, text, before, _beside_fmu(skeleton.name, text, groups, end, last.delay))
    extended = CompiledModel(compile_text(text, EXTENDED))
    notes: tuple[str, ...] = ()
    if answer.is_model():
        answer, notes = _output_error(answer, skeleton, extended)
        text = written(answer, skeleton) if notes else text
    last = answer.choice.after.hypothesis
    at = settings_of(skeleton, for_recording(last)) if notes else {}
    mended = _at_the_structure(answer.problem, last)
    seen = errors(extended, mended, at, last.delay)
    if has_own_windows(last):
        own = [settings_of(skeleton, for_recording(last, i)) for i in range(len(mended))]
        seen = [errors(extended, [p], {**at, **s}, last.delay)[0] for p, s in zip(mended, own, strict=True)]
    return Runs(answer, text, before, (seen, errors(extended, groups[1], at, last.delay)), notes)


def led_away(choice: Choice, runs: Runs) -> str:
    """A sentence where what is named explains a part of the force, and leads the structure where it never was: it
    leaves more than a right law does in the median, and with it the model runs far off the recordings that it follows
    without. Else "". Of what acts for a while nobody knows when it does in recordings that were held out."""
    criterion = Criterion(runs.answer.problem, choice.before, 1)
    left, whole = choice.after.chi2 - choice.floor_after, choice.before.chi2 - choice.floor_before
    groups = [zip(*each, strict=True) for each in zip(runs.before, runs.after, strict=True)]
    known = groups[:1] if has_windows(choice.after.hypothesis) else groups
    pairs = [(before, after) for group in known for (_, before), (_, after) in group if before is not None]
    if criterion.is_settled(left, whole) or all(after is None for _, after in pairs):  # None: too long for a run
        return ""
    errors = np.array([(before, np.inf if after is None else after) for before, after in pairs])
    before, after = 100 * np.sqrt(np.mean(errors**2, axis=0))
    if before > 100 / _AWAY or after < _AWAY * before:  # beyond, so much more is what no motion at all would be off by
        return ""
    off = f"is off by {after:.3g} % of the displacement" if np.isfinite(after) else "runs away"
    names = " and ".join(map(runs.answer.catalogue.title, runs.answer.names()))
    return (
        f"{names} would explain {100 * choice.explained:.0f} % of what is missing; not named, as the free run with it "
        f"{off}, and without it is off by {before:.3g} %"
    )


def _at_the_structure(problem: Problem, hypothesis: Hypothesis) -> list[Part]:
    """The recordings with the force that acts on the structure: what the channel shows, less its faults."""
    signals = problem.signals(hypothesis)
    faults = [term for term in hypothesis.terms if isinstance(term.effect, ChannelEffect)]
    wrong = [sum((term.effect.force(s, term.values) for term in faults), np.zeros(len(s.x))) for s in signals]
    return [replace(part, F=part.F - f) for part, f in zip(problem.parts, wrong, strict=True)]


def _beside_fmu(
    path: str, text: str, groups: tuple[Sequence[Part], Sequence[Part]], values: Mapping[str, float], delay: float
) -> tuple[Run, Run]:
    """An FMU in free run with the effects beside it, both as Model Exchange; nothing where the run is too long."""
    none: tuple[Run, Run] = [(None, None)] * len(groups[0]), [(None, None)] * len(groups[1])
    samples = sum(len(part) for part in (*groups[0], *groups[1]))
    rig = open_fmu(Path(path))
    if rig.model_exchange is None or samples > _MOST_STEPPED:
        return none
    with scratch() as folder:
        build(compile_text(text, EXTENDED), Path(folder, "effects.fmu"))
        effects = open_fmu(Path(folder, "effects.fmu"))
        found = []
        for parts in groups:
            runs = [_coupled_run(rig, effects, part, values, delay) for part in parts]
            found.append([(run, error(run, part)) for run, part in zip(runs, parts, strict=True)])
    return found[0], found[1]


def _coupled_run(
    rig: OpenedFmu, effects: OpenedFmu, part: Part, values: Mapping[str, float], delay: float
) -> Array | None:
    force = part.force_advanced(delay)
    start = float(part.x[0]), float(part.v[0])
    try:
        x = simulate_with_effects(rig, effects, force, part.dt, parameters=values, start=start)
    except (NumericalError, FmuError):  # of a run that runs away, the FMU refuses what overflows first
        return None
    return None if diverges(x, part) else x


def _output_error(answer: Answer, skeleton: Skeleton, model: CompiledModel) -> tuple[Answer, tuple[str, ...]]:
    """The answer with parameters fitted so, and a sentence; without one where the balance's parameters stay."""
    fit, problem = answer.choice.after, answer.problem

    def settings(at: Hypothesis) -> Mapping[str, float]:
        return settings_of(skeleton, at)

    found = output_error_fit(model, fit.hypothesis, fit.unknowns, problem.parts, settings)
    if found is None:
        return answer, ()
    rows = problem.rows(found.hypothesis)
    chi2 = float(rows @ rows) / max(1, len(rows) - len(fit.unknowns))
    whole = answer.choice.before.chi2 - answer.choice.floor_before
    criterion = Criterion(problem, answer.choice.before, 1)
    # noise of the motion draws the balance's parameters away, to where less is left than at the right ones
    if chi2 > _BALANCE * fit.chi2 and not criterion.is_settled(chi2 - answer.choice.floor_after, whole):
        return answer, ()  # measured forces contradict it: it leaves more of them than a right law does by its form
    covariance = _of_the_run(found.covariance, fit) / max(chi2, 1.0)  # by which standard errors are scaled
    after = replace(fit, hypothesis=found.hypothesis, residual=rows, chi2=chi2, covariance=covariance)
    told = (
        f"parameters fitted once more, to the displacement in free run: its error on the last quarter of each "
        f"recording, which was kept back, falls from {100 * found.before:.3g} % to {100 * found.after:.3g} %"
    )
    return replace(answer, choice=replace(answer.choice, after=after)), (told,)


def _of_the_run(covariance: Array, fit: Fit) -> Array:
    """Covariance of the free run, or that of the balance for unknowns that the run says nothing about."""
    moved = np.isfinite(np.diag(covariance))
    known = fit.covariance if fit.covariance is not None else np.full_like(covariance, np.nan)
    kept = np.where(np.outer(~moved, ~moved), known * max(fit.chi2, 1.0), 0.0)
    return np.asarray(np.where(np.outer(moved, moved), covariance, kept))


def written(answer: Answer, skeleton: Skeleton) -> str:
    """Text of the extended model."""
    refit = refit_values(answer, answer.choice.after)
    return extended_model(skeleton, refit, answer.terms(), answer.remarks(), answer.own_blocks())


def write_beside(rig: str, refit: Mapping[str, float], effects: Path, out: Path) -> Path | None:
    """``extended.ssp``: an FMU with the effects beside it and its parameters as refitted (by the FMU's names).

    None where the FMU does not show x and v as outputs.

    An importer's master exchanges forces and motion once per step, which takes damping away: stiffness of the effects
    times the step. Steps must be short against that.
    """
    shown = {v.name for v in open_fmu(Path(rig)).model.variables if v.causality == "output"}
    if not {"x", "v"} <= shown:
        return None
    ways = [Connection("F", "effects.F"), Connection("effects.F_rig", "rig.F")]
    ways += [Connection(f"rig.{name}", f"effects.{name}") for name in ("x", "v", "a", "f_h") if name in shown]
    ways += [Connection(f"rig.{name}", name) for name in ("x", "v")]
    values = {f"rig.{name}": value for name, value in refit.items()}
    parts = {"rig": Path(rig), "effects": effects}
    return write_ssp(out, parts, ways, inputs=("F",), outputs=("x", "v"), parameters=values)
