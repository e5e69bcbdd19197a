"""Validation: a surrogate against recordings or a reference FMU, on the given motion and in closed loop."""

from hystid.validation.cases import validate
from hystid.validation.cases_compared import FreeRun, Levels, Validation, ValidationCase
from hystid.validation.stability import Cycle, Stability

__all__ = ["Cycle", "FreeRun", "Levels", "Stability", "Validation", "ValidationCase", "validate"]
