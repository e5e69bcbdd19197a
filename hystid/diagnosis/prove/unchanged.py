"""An FMU as it was given, on the recordings as they were read: the errors that ``validate`` reports of it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from hystid.errors import HystidError
from hystid.processing import prepare
from hystid.recording import Recording
from hystid.validation.cases import compare
from hystid.validation.surrogate import open_surrogate


@dataclass(frozen=True)
class Unchanged:
    """NRMSE on one recording, fractions. force: on the measured motion. free_run: of x, None where there is none."""

    name: str
    force: float
    free_run: float | None


def unchanged(fmu: Path, recordings: Sequence[Recording], values: Mapping[str, float]) -> tuple[Unchanged, ...]:
    """Errors before anything is fitted. values: parameters as given, by the FMU's names.

    Nothing where ``validate`` could not judge the FMU either: no force R, no displacement, states that cannot be held.
    """
    try:
        model = replace(open_surrogate(fmu, values.get("m")), parameters=values)
        cases = [compare(model, prepare(recording, mass=model.mass)) for recording in recordings]
    except HystidError:
        return ()
    return tuple(Unchanged(c.name, c.force_nrmse, c.free_run.x_nrmse if c.free_run else None) for c in cases)
