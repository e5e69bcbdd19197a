"""Validation: a surrogate against recordings or a reference FMU, on the given motion and in closed loop."""

from hystid.validation.cases import validate
from hystid.validation.cases_compared import Case, FreeRun, Levels, Validation
from hystid.validation.stability import Cycle, Stability

__all__ = ["Case", "Cycle", "FreeRun", "Levels", "Stability", "Validation", "validate"]
