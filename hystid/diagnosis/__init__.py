"""Diagnosis: where a model and recordings disagree, which physics was left out, and the model with it."""

from hystid.diagnosis.diagnose import TOLERATED, diagnose, inputs_missing, not_applicable
from hystid.diagnosis.library import load_effects
from hystid.diagnosis.result import Diagnosis, Errors, Finding, Traces, Value, Where

__all__ = [
    "TOLERATED", "Diagnosis", "Errors", "Finding", "Traces", "Value", "Where", "diagnose", "inputs_missing",
    "load_effects", "not_applicable",
]  # fmt: skip
