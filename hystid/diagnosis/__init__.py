"""Diagnosis: where a model and recordings disagree, which physics was left out, and the model with it."""

from hystid.diagnosis.diagnose import diagnose, not_applicable
from hystid.diagnosis.fit.value import Value
from hystid.diagnosis.model.library import load_effects
from hystid.diagnosis.model.wired import wired
from hystid.diagnosis.prepare.recordings import TOLERATED, inputs_missing
from hystid.diagnosis.tell.result import Diagnosis, Errors, Finding, Traces, Where

__all__ = [
    "TOLERATED", "Diagnosis", "Errors", "Finding", "Traces", "Value", "Where", "diagnose", "inputs_missing",
    "load_effects", "not_applicable", "wired",
]  # fmt: skip
