"""Free run: the model is driven by the measured force alone; what counts is the displacement that it finds."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from hystid.diagnosis.parts import Part, advanced
from hystid.diagnosis.rig import Model
from hystid.errors import NumericalError

Array = NDArray[np.float64]


def free_run(
    model: Model, part: Part, values: Mapping[str, float], delay: float = 0.0, offset: Array | None = None
) -> Array | None:
    """Displacement [m], shape (n,), of the model under the measured force; None where it has no finite answer.

    values: parameters of the model. delay [samples] and offset [N]: faults of the force channel that are taken out.
    The run begins with the measured state, and the force is a cubic between its samples.
    """
    force = advanced(part.F, delay) if delay else part.F
    force = force if offset is None else force - offset
    settings = {**values, **start_of(model, part)}
    try:
        found = model.simulate(
            {"F": force}, part.dt, parameters=settings, outputs=("x",), interpolation="cubic", substeps=2
        )
    except NumericalError:
        return None
    x = found["x"]
    return x if float(np.max(np.abs(x))) < 1e3 * float(np.max(np.abs(part.x))) else None


def start_of(model: Model, part: Part) -> dict[str, float]:
    """Settings that make a model begin with the measured state: parameters for it, or else the states themselves."""
    known = {variable.name for variable in model.code.variables}
    found = {}
    for name, value in (("x", float(part.x[0])), ("v", float(part.v[0]))):
        state = next((s for s in model.code.states if s in (name, f"rig.{name}")), name)
        found[f"{name}_start" if f"{name}_start" in known else state] = value
    return found


def error(simulated: Array | None, part: Part) -> float | None:
    """NRMSE of the displacement against the measured one (the smoothed one where x was not measured)."""
    if simulated is None:
        return None
    reference = part.measured.get("x", part.x)
    spread = float(np.std(reference))
    return float(np.sqrt(np.mean((simulated - reference) ** 2))) / spread if spread > 0 else None


def errors(
    model: Model | None, parts: Sequence[Part], values: Mapping[str, float], delay: float = 0.0
) -> list[tuple[Array | None, float | None]]:
    """Free run and its error for several recordings."""
    if model is None or not values.get("m", 1.0):
        return [(None, None) for _ in parts]
    runs = [free_run(model, part, values, delay) for part in parts]
    return [(run, error(run, part)) for run, part in zip(runs, parts, strict=True)]
