"""A Model Exchange FMU in free run with a force that it lacks: both integrated as one system.

The missing force is an FMU of its own: inputs x, v, a, f_h, output f. It acts inside every stage of the classical
Runge-Kutta method, so that no step of delay comes between motion and force.
"""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import ExitStack
from ctypes import byref, c_bool, c_double, c_int, c_size_t, c_void_p

import numpy as np
from numpy.typing import NDArray

from hystid.child import beat
from hystid.compiled import check_finite, slopes_of
from hystid.errors import FmuError
from hystid.fmu.clamping import Motion
from hystid.fmu.door import OpenedFmu
from hystid.fmu.foreign import Foreign, runs_here
from hystid.fmu.native import Access, Instance

Array = NDArray[np.float64]


class _Side:
    """One of the two FMUs: time, states, inputs and outputs of its instance."""

    def __init__(self, instance: Instance, fmu: OpenedFmu, inputs: tuple[str, ...], outputs: tuple[str, ...]) -> None:
        n = len(fmu.model.states)
        variables = {v.name: v for v in fmu.model.variables}
        self._instance = instance
        self.x, self.dx = np.zeros(n), np.zeros(n)
        self._z, self._signs = np.zeros(fmu.model.n_indicators), np.zeros(fmu.model.n_indicators)
        self._n, self._n_z = c_size_t(n), c_size_t(fmu.model.n_indicators)
        self._at = {name: c_void_p(getattr(self, name).ctypes.data) for name in ("x", "dx", "_z")}
        self.u, self.y = np.zeros(len(inputs)), np.zeros(len(outputs))
        self._set = Access(instance, [variables[name] for name in inputs])
        self._get = Access(instance, [variables[name] for name in outputs]) if outputs else None
        self._derivatives = "GetDerivatives" if instance.version == 2 else "GetContinuousStateDerivatives"
        self._next_time = np.inf

    def begin(self) -> None:
        """Initial event iteration, then continuous time."""
        _, self._next_time = self._instance.new_discrete_states()
        self._continue()

    def place(self, t: float, states: Array) -> None:
        """Set time and states."""
        self._instance.call("SetTime", c_double(t))
        self.x[:] = states
        if len(self.x):
            self._instance.call("SetContinuousStates", self._at["x"], self._n)

    def outputs(self) -> Array:
        """Outputs under the inputs ``u``."""
        self._set.set(self.u.ctypes.data)
        if self._get is not None:
            self._get.get(self.y.ctypes.data)
        return self.y

    def slopes(self) -> Array:
        """Derivatives of the states under the inputs ``u``."""
        self._set.set(self.u.ctypes.data)
        if len(self.x):
            self._instance.call(self._derivatives, self._at["dx"], self._n)
        return self.dx

    def finish(self, now: float) -> None:
        """End of a step: events where an indicator changed its sign, or where the FMU asks for them."""
        two = self._instance.version == 2
        wants, terminate = (c_int(), c_int()) if two else (c_bool(), c_bool())
        self._instance.call(
            "CompletedIntegratorStep", c_int(1) if two else c_bool(True), byref(wants), byref(terminate)
        )
        if wants.value or now >= self._next_time or bool(np.any(self._indicators() != self._signs)):
            self._instance.call("EnterEventMode")
            _, self._next_time = self._instance.new_discrete_states()
            self._continue()

    def _continue(self) -> None:
        self._instance.call("EnterContinuousTimeMode")
        if len(self.x):
            self._instance.call("GetContinuousStates", self._at["x"], self._n)
        self._signs = self._indicators()

    def _indicators(self) -> Array:
        if len(self._z):
            self._instance.call("GetEventIndicators", self._at["_z"], self._n_z)
        return np.where(self._z > 0, 1.0, -1.0)


def simulate_with_effects(
    rig: OpenedFmu,
    effects: OpenedFmu | None,
    force: Array,
    dt: float,
    *,
    parameters: Mapping[str, float],
    start: tuple[float, float],
    substeps: int = 2,
) -> Array:
    """Displacement [m], shape (n,), of the rig under a force [N], shape (n,), less that of the effects.

    rig: input F, states x and v. effects: None for the rig alone. parameters: of the rig. start: x [m] and v [m/s].
    The force is a cubic between its samples. Raises FmuError where one of them offers no Model Exchange,
    NumericalError where the run is not finite.
    """
    if not (runs_here(rig) and (effects is None or runs_here(effects))):
        found = Foreign.of(rig).table(
            "coupled", len(force), ("x",), effects=None if effects is None else str(effects.folder), force=force, dt=dt,
            parameters=dict(parameters), start=start, substeps=substeps,
        )  # fmt: skip
        return found["x"]
    named = {v.name for v in rig.model.variables}
    given = {v.name: v for v in rig.model.variables}
    hysteresis = ("f_h",) if "f_h" in named else ()
    if not {"x", "v"} <= set(rig.model.states):
        raise FmuError(f"{rig.name}: a free run with effects needs the states x and v")
    motion = Motion(force, dt, slopes_of(force, dt))
    with ExitStack() as opened:
        one = opened.enter_context(Instance(rig, "ModelExchange"))
        one.initialise(0.0, [(given[name], value) for name, value in parameters.items()])
        beside = None
        if effects is not None:
            other = opened.enter_context(Instance(effects, "ModelExchange"))
            other.initialise(0.0, [])
            beside = _Side(other, effects, _INPUTS, ("f",))
        x = _Coupled(_Side(one, rig, ("F",), hysteresis), beside, rig).run(motion, len(force), dt, start, substeps)
    check_finite(rig.name, {"x": x}, dt)
    return x


_INPUTS = ("x", "v", "a", "f_h")


class _Coupled:
    """The rig and the effects as one system of states."""

    def __init__(self, rig: _Side, effects: _Side | None, fmu: OpenedFmu) -> None:
        self._rig, self._effects = rig, effects
        self._sides = [side for side in (rig, effects) if side is not None]
        self._at = fmu.model.states.index("x"), fmu.model.states.index("v")
        self._reads_a = False

    def run(self, force: Motion, n: int, dt: float, start: tuple[float, float], substeps: int) -> Array:
        """Fixed steps; events at their ends."""
        for side in self._sides:
            side.begin()
        self._rig.x[list(self._at)] = start
        here = np.concatenate([side.x for side in self._sides])
        self._reads_a = self._effect_of(start, 1.0) != self._effect_of(start, 0.0)
        found = np.empty(n)
        h = dt / substeps
        for row in range(n):
            beat()
            found[row] = here[self._at[0]]
            for i in range(substeps if row + 1 < n else 0):
                t, s = row * dt, i * h
                k1 = self._slopes(t, s, force.at(row, s), here)
                middle = force.at(row, s + h / 2)
                k2 = self._slopes(t, s + h / 2, middle, here + h / 2 * k1)
                k3 = self._slopes(t, s + h / 2, middle, here + h / 2 * k2)
                end = force.at(row + 1, 0.0) if i + 1 == substeps else force.at(row, s + h)
                k4 = self._slopes(t, s + h, end, here + h * k3)
                here = here + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
                self._slopes(t, s + h, end, here)
                for side in self._sides:
                    side.finish(t + s + h)
                here = np.concatenate([side.x for side in self._sides])
        return found

    def _effect_of(self, state: tuple[float, float], a: float) -> float:
        if self._effects is None:
            return 0.0
        self._effects.u[:] = (*state, a, 0.0)
        return float(self._effects.outputs()[0])

    def _slopes(self, t: float, s: float, force: float, states: Array) -> Array:
        """Derivatives of all states; an effect that reads the acceleration is solved for it (it is linear in it)."""
        rig, effects = self._rig, self._effects
        n = len(rig.x)
        rig.place(t + s, states[:n])
        if effects is None:
            rig.u[0] = force
            return rig.slopes().copy()
        effects.place(t + s, states[n:])
        x, v = (float(states[i]) for i in self._at)
        effects.u[:] = (x, v, 0.0, float(rig.outputs()[0]) if len(rig.y) else 0.0)
        first = self._acceleration(force, 0.0)
        if self._reads_a:
            second = self._acceleration(force, 1.0)
            first = self._acceleration(force, first / (1.0 - (second - first)))
        effects.u[2] = first
        return np.concatenate([rig.dx, effects.slopes()])

    def _acceleration(self, force: float, a: float) -> float:
        assert self._effects is not None
        self._effects.u[2] = a
        self._rig.u[0] = force - float(self._effects.outputs()[0])
        return float(self._rig.slopes()[self._at[1]])
