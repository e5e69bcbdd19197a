"""The next experiment: only what tells something about this answer, and can be done where this was recorded."""

from __future__ import annotations

from collections.abc import Iterator

from hystid.diagnosis.prepare.steered import is_steered
from hystid.diagnosis.tell.result import Diagnosis

_LISTED_EFFECTS = 2  # effects that could not show, of which the experiment is told


def next_experiment(diagnosis: Diagnosis) -> str:
    """The test that would tell most about an answer; "" where none is left to make."""
    steered = diagnosis.problem is not None and is_steered(diagnosis.problem.parts)
    if pair := next(_pairs(diagnosis, steered), None):
        return pair
    if diagnosis.changed:
        return "Diagnose each recording by itself; to compare them, record again and change nothing between."
    if diagnosis.verdict == "unknown_physics":
        if diagnosis.problem is not None and any(part.lowest for part in diagnosis.problem.parts):
            return "Record the displacement as well: laws of the place, as gaps and stops, do not show without it."
        how = (
            "Record slow cycles, and harmonic tests at three amplitudes and three frequencies, so that the amplitude "
            "and rate laws"
            if steered
            else "Compare recordings of weaker and of stronger motion, so that the amplitude law"
        )
        return f"{how} of the unknown force can be read off; add a law that suggests itself with --effects."
    if diagnosis.verdict == "sensor_fault":
        return "Mend or calibrate the channel, and record one of the tests again."
    if not diagnosis.findings and (hidden := list(_hidden(diagnosis, steered))):
        return "These recordings cannot show everything. " + " ".join(hidden[:_LISTED_EFFECTS])
    if diagnosis.holdout:
        return ""
    which = "a test at another amplitude" if steered else "a recording of another level"
    return f"Confirm the model on {which} that was not used here."


def _pairs(diagnosis: Diagnosis, steered: bool) -> Iterator[str]:
    """What tells two laws of one class from each other."""
    catalogue = diagnosis.catalogue
    for finding in diagnosis.findings:
        for ident, one in catalogue.telling(finding.alike):
            if steered or not one.steered:
                pair = " from ".join(catalogue.title(law) for law in sorted((ident, one.law)))
                yield f"To tell {pair}: {one.experiment}."


def _hidden(diagnosis: Diagnosis, steered: bool) -> Iterator[str]:
    """What would show an effect that these recordings cannot show, which an answer without a finding leaves open."""
    for ident in diagnosis.untestable:
        said = diagnosis.catalogue.laws.get(ident)
        if said is not None and said.experiment and (steered or not said.steered):
            yield f"For {diagnosis.catalogue.title(ident)}: {said.experiment}."
