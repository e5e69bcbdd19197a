"""Which effects a case can show at all."""

from __future__ import annotations

from collections.abc import Sequence

from hystid.diagnosis.fit.case import Case
from hystid.diagnosis.model.effects import Effect
from hystid.diagnosis.prepare import chain

_REVERSAL = 0.02  # share of the range of x: smaller ones are taken for noise


def possible(effects: Sequence[Effect], case: Case, exclude: Sequence[str]) -> tuple[list[Effect], set[str]]:
    """Effects that are tried, and ids that these recordings cannot show. exclude: ids that the user rules out."""
    problem = case.problem
    lacking = {
        "time": not problem.timed, "speeds": case.timeless, "mass": not case.baseline.mass,
        "reversals": not any(chain.turns(part.x, _REVERSAL) for part in problem.parts),
    }  # fmt: skip
    hidden = {effect.id for effect in effects if any(lacking[need] for need in effect.semantics.needs)}
    hidden |= set() if problem.timed else {effect.id for effect in effects if effect.needs_clock}
    if not problem.sees_x:  # laws of the displacement, and those that remember it
        hidden |= {effect.id for effect in effects if "x" in effect.reads or effect.remembers}
    if problem.unforced:  # the time goes on as the motion falls, and inertia has no scale
        hidden |= {effect.id for effect in effects if "a" in effect.reads or effect.is_over_time}
    tried = [effect for effect in effects if effect.id not in {*exclude, *hidden}]
    return tried, (hidden - set(exclude)) & {effect.id for effect in effects}
