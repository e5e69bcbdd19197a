"""Which effects a case can show at all."""

from __future__ import annotations

from collections.abc import Sequence

from hystid.diagnosis.fit.case import Case
from hystid.diagnosis.model.effects import Effect
from hystid.diagnosis.prepare import chain


def possible(effects: Sequence[Effect], case: Case, exclude: Sequence[str]) -> tuple[list[Effect], set[str]]:
    """Effects that are tried, and ids that these recordings cannot show. exclude: ids that the user rules out."""
    problem = case.problem
    hidden = set(chain.TIMED if case.timeless else ())
    hidden |= set() if case.baseline.mass else {"hidden_mode"}  # nothing resonates where nothing is inert
    hidden |= set() if problem.timed else {effect.id for effect in effects if effect.needs_clock}
    if not problem.sees_x:  # laws of the displacement, and those that remember it
        hidden |= {effect.id for effect in effects if "x" in effect.reads or effect.remembers}
    hidden |= {effect.id for effect in effects if case.unforced and "a" in effect.reads}
    tried = [effect for effect in effects if effect.id not in {*exclude, *hidden}]
    return tried, (hidden - set(exclude)) & {effect.id for effect in effects}
