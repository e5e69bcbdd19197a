"""A foreign Model Exchange FMU whose named states follow a measured motion.

The inner states are integrated by the classical Runge-Kutta method; events are handled at the end of the step in which
an indicator changed sign, for to locate them costs calls and the motion is known at its samples only.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from ctypes import byref, c_bool, c_double, c_int, c_size_t, c_void_p

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hystid.child import beat
from hystid.compiled import check_finite, slopes_of
from hystid.errors import FmuError
from hystid.fmu.door import OpenedFmu
from hystid.fmu.native import Access, Instance

Array = NDArray[np.float64]


class Motion:
    """A signal between its samples: cubic Hermite with slopes, or a straight line without."""

    def __init__(self, samples: Array, dt: float, slopes: Array | None) -> None:
        self._u, self._dt, self._d = samples, dt, slopes

    def at(self, row: int, s: float) -> float:
        """Value at the time s [s] after sample ``row``."""
        u, h = self._u, self._dt
        if s == 0 or row + 1 >= len(u):
            return float(u[row])
        mean = (u[row + 1] - u[row]) / h
        if self._d is None:
            return float(u[row] + s * mean)
        d0, d1 = self._d[row], self._d[row + 1]
        return float(u[row] + s * (d0 + s * ((3 * mean - 2 * d0 - d1) / h + s * (d0 + d1 - 2 * mean) / h**2)))


class _Clamped:
    def __init__(
        self, instance: Instance, fmu: OpenedFmu, states: Mapping[str, Array], inputs: Mapping[str, Array], dt: float
    ) -> None:
        order, n = fmu.model.states, len(fmu.model.states)
        self._instance = instance
        self._x, self._dx = np.zeros(n), np.zeros(n)
        self._z, self._signs = np.zeros(fmu.model.n_indicators), np.zeros(fmu.model.n_indicators)
        self._count, self._n_z = c_size_t(n), c_size_t(fmu.model.n_indicators)
        self._addresses = c_void_p(self._x.ctypes.data), c_void_p(self._dx.ctypes.data), c_void_p(self._z.ctypes.data)
        self._clamped = [(order.index(name), Motion(x, dt, _slope(name, states, dt))) for name, x in states.items()]
        self._free = [i for i, name in enumerate(order) if name not in states]
        variables = {v.name: v for v in fmu.model.variables}
        self._inputs = [(Access(instance, [variables[name]]), Motion(u, dt, None)) for name, u in inputs.items()]
        self._value = np.zeros(1)
        self._dt = dt
        self._derivatives = "GetDerivatives" if instance.version == 2 else "GetContinuousStateDerivatives"
        self._next_time = np.inf

    def begin(self) -> None:
        """Initial event iteration, then continuous time with the motion's first sample."""
        _, self._next_time = self._instance.new_discrete_states()
        self._instance.call("EnterContinuousTimeMode")
        self._instance.call("GetContinuousStates", self._addresses[0], self._count)
        self.place(0, 0.0, self._x[self._free].copy())
        self._note_signs()

    def place(self, row: int, s: float, free: Array) -> None:
        """Set time, inputs and states."""
        self._instance.call("SetTime", c_double(row * self._dt + s))
        for access, motion in self._inputs:
            self._value[0] = motion.at(row, s)
            access.set(self._value.ctypes.data)
        for i, motion in self._clamped:
            self._x[i] = motion.at(row, s)
        self._x[self._free] = free
        if len(self._x):
            self._instance.call("SetContinuousStates", self._addresses[0], self._count)

    def _slope(self, row: int, s: float, free: Array) -> Array:
        self.place(row, s, free)
        self._instance.call(self._derivatives, self._addresses[1], self._count)
        return self._dx[self._free].copy()

    def advance(self, row: int, substeps: int) -> None:
        """From sample ``row`` to the next."""
        h = self._dt / substeps
        for i in range(substeps):
            s, x = i * h, self._x[self._free].copy()
            if self._free:
                k1 = self._slope(row, s, x)
                k2 = self._slope(row, s + h / 2, x + h / 2 * k1)
                k3 = self._slope(row, s + h / 2, x + h / 2 * k2)
                k4 = self._slope(row, s + h, x + h * k3)
                x = x + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
            last = i + 1 == substeps
            self.place(row + 1 if last else row, 0.0 if last else s + h, x)
            self._finish_step(row * self._dt + s + h)

    def _finish_step(self, now: float) -> None:
        wants, terminate = (c_int(), c_int()) if self._instance.version == 2 else (c_bool(), c_bool())
        yes = c_int(1) if self._instance.version == 2 else c_bool(True)
        self._instance.call("CompletedIntegratorStep", yes, byref(wants), byref(terminate))
        if wants.value or self._crossed() or now >= self._next_time:
            self._instance.call("EnterEventMode")
            _, self._next_time = self._instance.new_discrete_states()
            self._instance.call("EnterContinuousTimeMode")
            self._instance.call("GetContinuousStates", self._addresses[0], self._count)
            self._note_signs()

    def _read_indicators(self) -> None:
        if len(self._z):
            self._instance.call("GetEventIndicators", self._addresses[2], self._n_z)

    def _note_signs(self) -> None:
        self._read_indicators()
        self._signs = np.where(self._z > 0, 1.0, -1.0)

    def _crossed(self) -> bool:
        self._read_indicators()
        return bool(np.any(np.where(self._z > 0, 1.0, -1.0) != self._signs))


def _slope(name: str, states: Mapping[str, Array], dt: float) -> Array:
    """x follows the given v where both are states; other motions get slopes from their own samples."""
    return states["v"] if name == "x" and "v" in states else slopes_of(states[name], dt)


def clamp_model_exchange(
    fmu: OpenedFmu,
    states: Mapping[str, ArrayLike],
    inputs: Mapping[str, ArrayLike],
    dt: float,
    parameters: Mapping[str, float],
    outputs: Sequence[str],
    substeps: int,
    sensitivities: Sequence[str],
) -> dict[str, Array]:
    """As ``Driver.clamp``; sensitivities by central differences over whole runs."""
    motion = {name: _row(fmu, name, x) for name, x in states.items()}
    signals = {name: _row(fmu, name, u) for name, u in inputs.items()}
    for name in motion:
        if name not in fmu.model.states:
            raise FmuError(f"{fmu.name}: '{name}' is not a state; states: {', '.join(fmu.model.states) or 'none'}")
    lengths = {len(x) for x in (*motion.values(), *signals.values())}
    if len(lengths) != 1:
        raise FmuError(f"{fmu.name}: states and inputs must have one common number of samples; found {sorted(lengths)}")

    def run(values: Mapping[str, float]) -> dict[str, Array]:
        return _run(fmu, motion, signals, dt, values, outputs, substeps, lengths.copy().pop())

    result = run(parameters)
    starts = {v.name: v.start or 0.0 for v in fmu.model.variables}
    for name in sensitivities:
        value = parameters.get(name, starts[name])
        step = 1e-5 * (abs(value) or 1.0)
        high, low = run({**parameters, name: value + step}), run({**parameters, name: value - step})
        result.update({f"d {output}/d {name}": (high[output] - low[output]) / (2 * step) for output in outputs})
    return result


def _run(
    fmu: OpenedFmu,
    motion: Mapping[str, Array],
    signals: Mapping[str, Array],
    dt: float,
    parameters: Mapping[str, float],
    outputs: Sequence[str],
    substeps: int,
    rows: int,
) -> dict[str, Array]:
    variables = {v.name: v for v in fmu.model.variables}
    with Instance(fmu, "ModelExchange") as instance:
        first = [(variables[name], float(u[0])) for name, u in signals.items()]
        instance.initialise(0.0, [*((variables[name], value) for name, value in parameters.items()), *first])
        clamped = _Clamped(instance, fmu, motion, signals, dt)
        clamped.begin()
        accesses = instance.access([variables[name] for name in outputs])
        rows_of = [np.zeros((rows, len(a.names)), a.dtype) for a in accesses]
        for row in range(rows):
            beat()
            for access, block in zip(accesses, rows_of, strict=True):
                access.get(block.ctypes.data + row * block.strides[0])
            if row + 1 < rows:
                clamped.advance(row, substeps)
        result = {
            name: np.ascontiguousarray(block[:, i], np.float64)
            for access, block in zip(accesses, rows_of, strict=True)
            for i, name in enumerate(access.names)
        }
    check_finite(fmu.name, result, dt)
    return {name: result[name] for name in outputs}


def _row(fmu: OpenedFmu, name: str, values: ArrayLike) -> Array:
    samples = np.ascontiguousarray(values, np.float64)
    if samples.ndim != 1 or not np.all(np.isfinite(samples)):
        raise FmuError(f"{fmu.name}: '{name}' must be a row of finite samples")
    return samples
