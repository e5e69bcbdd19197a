"""A Model Exchange FMU in continuous time: states, derivatives, and events at the ends of steps.

Events are handled at the end of the step in which an indicator changed sign, for to locate them costs calls, and the
signals are known at their samples only.
"""

from __future__ import annotations

from collections.abc import Callable
from ctypes import byref, c_bool, c_double, c_int, c_size_t, c_void_p

import numpy as np

from hystid.errors import FmuError
from hystid.fmu.door import OpenedFmu
from hystid.fmu.native import Instance
from hystid.numeric import Array


class Interpolated:
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


class Continuous:
    """An initialised instance. x, dx: its states and derivatives, as the last call has left them."""

    def __init__(self, instance: Instance, fmu: OpenedFmu) -> None:
        n, n_z = len(fmu.model.states), fmu.model.n_indicators
        self.instance = instance
        self.x, self.dx = np.zeros(n), np.zeros(n)
        self._z, self._signs = np.zeros(n_z), np.zeros(n_z)
        self._n, self._n_z = c_size_t(n), c_size_t(n_z)
        self._at = {name: c_void_p(getattr(self, name).ctypes.data) for name in ("x", "dx", "_z")}
        self._derivatives = "GetDerivatives" if instance.version == 2 else "GetContinuousStateDerivatives"
        self._next_time = np.inf

    def begin(self) -> None:
        """Initial event iteration, then continuous time."""
        _, self._next_time = self.instance.new_discrete_states()
        self.instance.call("EnterContinuousTimeMode")
        if len(self.x):
            self.instance.call("GetContinuousStates", self._at["x"], self._n)
        self.note_signs()

    def place(self, t: float) -> None:
        """Set the time [s], and the states to ``x``."""
        self.instance.call("SetTime", c_double(t))
        if len(self.x):
            self.instance.call("SetContinuousStates", self._at["x"], self._n)

    def slopes(self) -> Array:
        """Derivatives of the states."""
        if len(self.x):
            self.instance.call(self._derivatives, self._at["dx"], self._n)
        return self.dx

    def finish(self, now: float) -> None:
        """End of a step: events where an indicator changed its sign, or where the FMU asks for them.

        Raises FmuError where the FMU has asked for the end of the simulation in a step before.
        """
        if self.instance.ended:
            raise FmuError(f"{self.instance.name}: it asked for the end of the simulation before t = {now:.9g} s")
        two = self.instance.version == 2
        wants, terminate = (c_int(), c_int()) if two else (c_bool(), c_bool())
        yes = c_int(1) if two else c_bool(True)
        self.instance.call("CompletedIntegratorStep", yes, byref(wants), byref(terminate))
        self.instance.ended |= bool(terminate.value)
        if wants.value or now >= self._next_time or bool(np.any(self._indicators() != self._signs)):
            self.instance.call("EnterEventMode")
            self.begin()

    def note_signs(self) -> None:
        """Signs of the indicators from which changes count."""
        self._signs = self._indicators()

    def _indicators(self) -> Array:
        if len(self._z):
            self.instance.call("GetEventIndicators", self._at["_z"], self._n_z)
        return np.where(self._z > 0, 1.0, -1.0)


def runge_kutta(slopes: Callable[[float, Array], Array], s: float, h: float, x: Array) -> Array:
    """States (n,) after one step of the classical method, from x at the time s over h [s]."""
    k1 = slopes(s, x)
    k2 = slopes(s + h / 2, x + h / 2 * k1)
    k3 = slopes(s + h / 2, x + h / 2 * k2)
    k4 = slopes(s + h, x + h * k3)
    return np.asarray(x + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4))
