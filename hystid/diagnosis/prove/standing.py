"""Where a structure stands that was recorded by its rates alone, as the law that is named has it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from hystid.compiled import CompiledModel
from hystid.diagnosis.decide.answer import Answer
from hystid.diagnosis.decide.assumptions import chosen
from hystid.diagnosis.decide.selection import Choice
from hystid.diagnosis.fit.case import Case
from hystid.diagnosis.fit.search import try_fit
from hystid.diagnosis.fit.slow_motion import OCTAVES, Runs, told_of, with_slow_motion
from hystid.diagnosis.fit.windows import has_windows
from hystid.diagnosis.model.effects import Effect
from hystid.diagnosis.model.freerun import free_run
from hystid.diagnosis.prove.extended import CLASS, Skeleton, settings_of
from hystid.diagnosis.prove.runs import skeleton_of, written
from hystid.modelica_text import compile_text


def stands(case: Case, choice: Choice, library: Sequence[Effect]) -> tuple[Case, Choice]:
    """The case and its selection with slow motion that no channel shows as the named law does it under the measured
    force, as far above the lowest visible frequency as it fits better.

    What is named, and how surely, stays, but for sets: one of a set may have made up for that motion.
    """
    blind = any(part.lowest for part in case.problem.parts)
    if not choice.named or not case.baseline.mass or not blind or has_windows(choice.after.hypothesis):
        return case, choice
    skeleton = skeleton_of(case.baseline)
    if skeleton.kind == "fmu":  # a binary cannot be extended
        return case, choice
    answer = Answer(case.problem, case.baseline, choice, case.nominal_chi2, case.faults, case.catalogue)
    model = CompiledModel(compile_text(written(answer, skeleton), CLASS))
    here, made = case, choice
    for octaves in range(OCTAVES):
        moved = with_slow_motion(case.problem.parts, _runs(model, skeleton, made), octaves)
        problem = case.problem.of(moved)
        if case.problem.weighed_by:
            problem.distrust(*case.problem.weighed_by)
        before, after = (try_fit(problem, fit.hypothesis, 25) for fit in (made.before, made.after))
        if before is None or after is None or after.chi2 >= made.after.chi2:
            break
        made = replace(made, before=before, after=after)
        unseen = tuple(with_slow_motion(case.unseen, _runs(model, skeleton, made), octaves))
        here = replace(case, problem=problem, unseen=unseen, notes=(*case.notes, told_of(moved, octaves)))
    if here is not case and len(made.named) > 1:
        again = chosen(replace(here, refit=made.before, minima=()), library)
        made = again if again.named else made
    return here, made


def _runs(model: CompiledModel, skeleton: Skeleton, choice: Choice) -> Runs:
    last = choice.after.hypothesis
    values = settings_of(skeleton, last)
    return lambda part: free_run(model, part, values, last.delay)
