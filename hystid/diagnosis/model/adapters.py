"""An FMU as a baseline: it answers which force belongs to a motion, and which motion to a force, as a class does."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from hystid.compiled import Interpolation
from hystid.fmu.coupling import simulate_with_effects
from hystid.fmu.door import open_fmu
from hystid.fmu.driver import Driver
from hystid.numeric import Array
from hystid.rig.terms import mass_of
from hystid.simulation import SUBSTEPS, driven

_LONG = 30_000  # samples from which a foreign FMU takes one step per sample: each costs a tenth of a millisecond


class FmuModel:
    """An FMU with the calls of a compiled model. given: names of parameters that somebody has given, in SI units."""

    def __init__(self, path: Path | str, given: Iterable[str] = ()) -> None:
        self.driver = Driver(path)
        self.code = self.driver.model
        self.driver.check_si(("F", "x", "v", "a", "R", mass_of(self.code.variables), *given))
        self.clamp = self.driver.clamp

    @property
    def holds(self) -> bool:
        """Whether its states can be held to a motion."""
        return self.driver.is_own or "ModelExchange" in self.driver.kinds

    def simulate(
        self,
        inputs: Mapping[str, ArrayLike],
        dt: float,
        *,
        parameters: Mapping[str, float] | None = None,
        outputs: Iterable[str],
        interpolation: Interpolation = "cubic",
        substeps: int = 1,
    ) -> dict[str, Array]:
        """The FMU under inputs that are cubics between their samples, as ``validate`` and compiled models have them.

        An FMU takes straight lines, so it gets the cubics on the grid of ``substeps``, of four where fewer are asked.
        A foreign FMU with Model Exchange alone is integrated here: fixed steps, cubic inputs, nothing but x.
        """
        n = len(np.asarray(next(iter(inputs.values()))))
        if self.driver.is_own or "CoSimulation" in self.driver.kinds or tuple(outputs) != ("x",):
            table = {name: np.asarray(values, np.float64) for name, values in inputs.items()}
            steps = max(substeps, SUBSTEPS) if interpolation == "cubic" else 1
            t, names = np.arange(n, dtype=np.float64) * dt, tuple(outputs)
            if steps == 1 or not table:
                return self.driver.simulate(t, table, parameters=parameters, outputs=names)
            return driven(self.driver, table, t, parameters=parameters, outputs=names, substeps=steps)
        values = dict(parameters or {})
        start = values.pop(self.code.state_of("x"), 0.0), values.pop(self.code.state_of("v"), 0.0)
        rig, force = open_fmu(self.driver.path), np.asarray(inputs["F"], np.float64)
        steps = 2 if n < _LONG else 1
        return {"x": simulate_with_effects(rig, None, force, dt, parameters=values, start=start, substeps=steps)}
