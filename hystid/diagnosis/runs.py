"""The proof: the refitted baseline and the extended model in free run, and the polish that the extended model gets."""

from __future__ import annotations

import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hystid.compiled import CompiledModel
from hystid.diagnosis.answer import Answer, refit_values
from hystid.diagnosis.extended import CLASS, Skeleton, extended_model, settings_of
from hystid.diagnosis.fitting import Hypothesis
from hystid.diagnosis.freerun import errors
from hystid.diagnosis.parts import Part
from hystid.diagnosis.polish import polish
from hystid.modelcode import ModelCode
from hystid.modelica import compile_model

Array = NDArray[np.float64]
_BALANCE = 1.3  # rise of the balance's mean square beyond which a polish contradicts the measured forces
Run = list[tuple[Array | None, float | None]]


@dataclass(frozen=True)
class Runs:
    """Free runs before and after, of the recordings used and of those held out; the answer with what the polish moved.

    text: the extended model. notes: what was done to the parameters.
    """

    answer: Answer
    text: str
    before: tuple[Run, Run]
    after: tuple[Run, Run]
    notes: tuple[str, ...] = ()


def free_runs(answer: Answer, skeleton: Skeleton, unseen: Sequence[Part]) -> Runs:
    """Run the baseline and, where something was named, the extended model, polished where that clearly helps."""
    choice, base = answer.choice, answer.baseline
    groups = (answer.problem.parts, unseen)
    first = choice.before.hypothesis
    values = base.settings({**first.values, "m": first.mass()} if "m" in first.values else first.values)
    before = errors(base.model, groups[0], values, first.delay), errors(base.model, groups[1], values, first.delay)
    text = written(answer, skeleton)
    if choice.after is choice.before:
        return Runs(answer, text, before, before)
    if skeleton.kind == "fmu":  # the effects act inside the motion, where a closed binary cannot take them up
        none: tuple[Run, Run] = ([(None, None)] * len(groups[0]), [(None, None)] * len(groups[1]))
        return Runs(answer, text, before, none)
    model = CompiledModel(compile_text(text))
    notes: tuple[str, ...] = ()
    if base.mass and answer.is_model():
        answer, notes = _polished(answer, skeleton, model)
        text = written(answer, skeleton) if notes else text
    last = answer.choice.after.hypothesis
    at = settings_of(skeleton, last) if notes else {}
    after = errors(model, groups[0], at, last.delay), errors(model, groups[1], at, last.delay)
    return Runs(answer, text, before, after, notes)


def _polished(answer: Answer, skeleton: Skeleton, model: CompiledModel) -> tuple[Answer, tuple[str, ...]]:
    """The answer with polished parameters, and a sentence; without one where the balance's parameters stay."""
    fit, problem = answer.choice.after, answer.problem

    def settings(at: Hypothesis) -> Mapping[str, float]:
        return settings_of(skeleton, at)

    found = polish(model, fit.hypothesis, fit.unknowns, problem.parts, settings)
    if found is None:
        return answer, ()
    rows = problem.rows(found.hypothesis)
    chi2 = float(rows @ rows) / max(1, len(rows) - len(fit.unknowns))
    if chi2 > _BALANCE * fit.chi2:
        return answer, ()
    after = replace(fit, hypothesis=found.hypothesis, residual=rows, chi2=chi2)
    told = (
        f"parameters polished on the displacement in free run: its error on the last quarter of the recordings, which "
        f"was kept back, falls from {100 * found.before:.3g} % to {100 * found.after:.3g} %"
    )
    return replace(answer, choice=replace(answer.choice, after=after)), (told,)


def written(answer: Answer, skeleton: Skeleton) -> str:
    """Text of the extended model."""
    refit = refit_values(answer, answer.choice.after)
    return extended_model(skeleton, refit, answer.terms(), answer.remarks(), answer.own_blocks())


def compile_text(text: str) -> ModelCode:
    """ModelCode of the class ``Extended`` in a text."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "extended.mo")
        path.write_text(text, encoding="utf-8")
        return compile_model(f"{path}:{CLASS}")
