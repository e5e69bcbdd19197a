"""A Model Exchange FMU in free run with a force that it lacks: both integrated as one system.

The missing force is an FMU of its own: inputs x, v, a, f_h, output f. It acts inside every stage of the classical
Runge-Kutta method, so that no step of delay comes between motion and force.
"""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import ExitStack

import numpy as np

from hystid.child import beat
from hystid.compiled import check_finite, slopes_of
from hystid.errors import FmuError
from hystid.fmu.continuous import Continuous, Interpolated, runge_kutta
from hystid.fmu.door import OpenedFmu
from hystid.fmu.foreign import Foreign, runs_here
from hystid.fmu.native import Access, Instance
from hystid.numeric import Array


class _Side(Continuous):
    """One of the two FMUs, with inputs ``u`` and outputs ``y``."""

    def __init__(self, instance: Instance, fmu: OpenedFmu, inputs: tuple[str, ...], outputs: tuple[str, ...]) -> None:
        super().__init__(instance, fmu)
        variables = {v.name: v for v in fmu.model.variables}
        self.u, self.y = np.zeros(len(inputs)), np.zeros(len(outputs))
        self._set = Access(instance, [variables[name] for name in inputs])
        self._get = Access(instance, [variables[name] for name in outputs]) if outputs else None

    def outputs(self) -> Array:
        """Outputs under the inputs ``u``."""
        self._set.set(self.u.ctypes.data)
        if self._get is not None:
            self._get.get(self.y.ctypes.data)
        return self.y

    def slopes(self) -> Array:
        """Derivatives of the states under the inputs ``u``."""
        self._set.set(self.u.ctypes.data)
        return super().slopes()


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
    given = {v.name: v for v in rig.model.variables}
    hysteresis = ("f_h",) if "f_h" in given else ()
    if not (rig.model.state_of("x") and rig.model.state_of("v")):
        raise FmuError(f"{rig.name}: a free run with effects needs the states x and v")
    motion = Interpolated(force, dt, slopes_of(force, dt))
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
        x, v = (fmu.model.states.index(fmu.model.state_of(name)) for name in ("x", "v"))
        self._at = x, v
        self._reads_a = False

    def run(self, force: Interpolated, n: int, dt: float, start: tuple[float, float], substeps: int) -> Array:
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
                s = i * h

                def slopes(at: float, states: Array, row: int = row) -> Array:
                    now = force.at(row + 1, 0.0) if at == dt else force.at(row, at)
                    return self._slopes(row * dt + at, now, states)

                here = runge_kutta(slopes, s, h, here)
                slopes(s + h, here)
                for side in self._sides:
                    side.finish(row * dt + s + h)
                here = np.concatenate([side.x for side in self._sides])
        return found

    def _effect_of(self, state: tuple[float, float], a: float) -> float:
        if self._effects is None:
            return 0.0
        self._effects.u[:] = (*state, a, 0.0)
        return float(self._effects.outputs()[0])

    def _slopes(self, t: float, force: float, states: Array) -> Array:
        """Derivatives of all states; an effect that reads the acceleration is solved for it (it is linear in it)."""
        rig, effects = self._rig, self._effects
        n = len(rig.x)
        rig.x[:] = states[:n]
        rig.place(t)
        if effects is None:
            rig.u[0] = force
            return rig.slopes().copy()
        effects.x[:] = states[n:]
        effects.place(t)
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
