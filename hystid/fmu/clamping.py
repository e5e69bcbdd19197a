"""A foreign Model Exchange FMU whose named states follow a measured motion.

The inner states are integrated by the classical Runge-Kutta method.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from hystid.child import beat
from hystid.compiled import check_finite, slopes_of
from hystid.errors import FmuError
from hystid.fmu.continuous import Continuous, Interpolated, runge_kutta
from hystid.fmu.door import OpenedFmu
from hystid.fmu.native import Access, Instance
from hystid.fmu.rows import Rows
from hystid.numeric import Array


@dataclass(frozen=True)
class Clamping:
    """What the FMU is driven by. states, inputs: name -> (n,) samples, one every dt [s]; substeps between two."""

    states: Mapping[str, Array]
    inputs: Mapping[str, Array]
    dt: float
    outputs: Sequence[str]
    substeps: int


class _Clamped(Continuous):
    def __init__(self, instance: Instance, fmu: OpenedFmu, given: Clamping) -> None:
        super().__init__(instance, fmu)
        order, self._dt = fmu.model.states, given.dt
        self._clamped = [
            (order.index(name), Interpolated(x, given.dt, _slope(name, given.states, given.dt)))
            for name, x in given.states.items()
        ]
        self._free = [i for i, name in enumerate(order) if name not in given.states]
        variables = {v.name: v for v in fmu.model.variables}
        self._inputs = [
            (Access(instance, [variables[name]]), Interpolated(u, given.dt, None)) for name, u in given.inputs.items()
        ]
        self._value = np.zeros(1)
        self.begin()
        self._follow(0, 0.0, self.x[self._free].copy())
        self.note_signs()

    def _follow(self, row: int, s: float, free: Array) -> None:
        """Set time, inputs and states."""
        for i, motion in self._clamped:
            self.x[i] = motion.at(row, s)
        self.x[self._free] = free
        self.place(row * self._dt + s)
        for access, motion in self._inputs:
            self._value[0] = motion.at(row, s)
            access.set(self._value.ctypes.data)

    def advance(self, row: int, substeps: int) -> None:
        """From sample ``row`` to the next."""

        def slopes(s: float, free: Array) -> Array:
            self._follow(row, s, free)
            return self.slopes()[self._free].copy()

        h = self._dt / substeps
        for i in range(substeps):
            s, x = i * h, self.x[self._free].copy()
            if self._free:
                x = runge_kutta(slopes, s, h, x)
            last = i + 1 == substeps
            self._follow(row + 1 if last else row, 0.0 if last else s + h, x)
            self.finish(row * self._dt + s + h)


def _slope(name: str, states: Mapping[str, Array], dt: float) -> Array:
    """x follows the given v where both are states; other motions get slopes from their own samples."""
    return states["v"] if name == "x" and "v" in states else slopes_of(states[name], dt)


def clamp_model_exchange(
    fmu: OpenedFmu, given: Clamping, parameters: Mapping[str, float], sensitivities: Sequence[str]
) -> dict[str, Array]:
    """As ``Driver.clamp``; sensitivities by central differences over whole runs.

    Raises FmuError for what is no state, and for samples that are not finite or differ in number.
    """
    for name, samples in (*given.states.items(), *given.inputs.items()):
        if samples.ndim != 1 or not np.all(np.isfinite(samples)):
            raise FmuError(f"{fmu.name}: '{name}' must be a row of finite samples")
    for name in given.states:
        if name not in fmu.model.states:
            raise FmuError(f"{fmu.name}: '{name}' is not a state; states: {', '.join(fmu.model.states) or 'none'}")
    lengths = {len(x) for x in (*given.states.values(), *given.inputs.values())}
    if len(lengths) != 1:
        raise FmuError(f"{fmu.name}: states and inputs must have one common number of samples; found {sorted(lengths)}")

    rows = lengths.pop()
    result = _run(fmu, given, parameters, rows)
    starts = {v.name: v.start or 0.0 for v in fmu.model.variables}
    for name in sensitivities:
        value = parameters.get(name, starts[name])
        step = 1e-5 * (abs(value) or 1.0)
        high, low = (_run(fmu, given, {**parameters, name: value + by}, rows) for by in (step, -step))
        result.update({f"d {output}/d {name}": (high[output] - low[output]) / (2 * step) for output in given.outputs})
    return result


def _run(fmu: OpenedFmu, given: Clamping, parameters: Mapping[str, float], rows: int) -> dict[str, Array]:
    variables = {v.name: v for v in fmu.model.variables}
    with Instance(fmu, "ModelExchange") as instance:
        first = [(variables[name], float(u[0])) for name, u in given.inputs.items()]
        instance.initialise(0.0, [(variables[name], value) for name, value in parameters.items()], first)
        clamped = _Clamped(instance, fmu, given)
        readings = Rows(instance, given.outputs, rows)
        for row in range(rows):
            beat()
            readings.get(row)
            if row + 1 < rows:
                clamped.advance(row, given.substeps)
        result = {name: np.asarray(values, np.float64) for name, values in readings.columns().items()}
    check_finite(fmu.name, result, given.dt)
    return result
