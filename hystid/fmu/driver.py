"""Drive any FMU: our own through its batch entry, others through prepared buffers."""

from __future__ import annotations

import ctypes
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hystid.compiled import CompiledModel, TableRunner, check_finite
from hystid.errors import FmuError, NumericalError
from hystid.fmu.clamping import clamp_model_exchange
from hystid.fmu.door import open_fmu
from hystid.fmu.native import Access, Instance, Stepper, load
from hystid.modelcode import Variable

Array = NDArray[np.float64]


class Driver:
    """An opened FMU, FMI 2.0 or 3.0. Unpacked once; every call runs a fresh instance.

    Raises FmuError with one sentence where the file is not a usable FMU.
    """

    def __init__(self, path: Path | str) -> None:
        self._fmu = open_fmu(Path(path))
        self.model = self._fmu.model
        self.path = self._fmu.path
        self.fmi = self._fmu.version
        self._variables = {v.name: v for v in self.model.variables}
        self._own = self._batch_entry()

    @property
    def kinds(self) -> tuple[str, ...]:
        """Which of "CoSimulation" and "ModelExchange" can be run here."""
        found = {"CoSimulation": self._fmu.co_simulation, "ModelExchange": self._fmu.model_exchange}
        return tuple(name for name, kind in found.items() if kind is not None)

    @property
    def is_own(self) -> bool:
        """Whether the FMU offers our batch entry."""
        return self._own is not None

    def lists(self, name: str) -> bool:
        """Whether the description lists this name, of whatever type; ``model`` has those that are plain numbers."""
        return any(v.name == name for v in self._fmu.raw.modelVariables)

    def simulate(
        self,
        t: ArrayLike,
        inputs: Mapping[str, ArrayLike] | None = None,
        *,
        parameters: Mapping[str, float] | None = None,
        start: Mapping[str, float] | None = None,
        outputs: Iterable[str] | None = None,
        interpolation: Literal["linear", "hold"] = "linear",
    ) -> dict[str, Array]:
        """Outputs at the times t (n,) [s], increasing; inputs name -> (n,). Returns name -> (n,).

        outputs: names, all of causality output where none are given. interpolation: how inputs run between samples;
        an FMU that takes no input derivatives holds them whatever is asked. Our own FMUs run in one call when t is
        uniform. Raises FmuError (unknown name, the FMU refuses), NumericalError (not finite).
        """
        times, uniform = _times(self._fmu.name, t)
        names = (
            tuple(v.name for v in self.model.variables if v.causality == "output")
            if outputs is None
            else tuple(outputs)
        )
        table = {name: self._samples(name, values, len(times)) for name, values in (inputs or {}).items()}
        wanted = [self._find(name) for name in names]
        settings = {**(parameters or {}), **(start or {})}
        for name in settings:
            self._find(name)
        dt = (times[-1] - times[0]) / max(len(times) - 1, 1) or 1.0
        if self._own and uniform:
            return self._own.simulate(
                table, dt, parameters=settings, outputs=names, interpolation=interpolation, substeps=0, rows=len(times),
                start_time=float(times[0]),
            )  # fmt: skip
        if self._fmu.co_simulation is None:
            result = self._model_exchange(times, table, settings, names)
        else:
            result = self._co_simulation(times, table, settings, wanted, interpolation)
        check_finite(self._fmu.name, result, dt)
        return result

    def clamp(
        self,
        states: Mapping[str, ArrayLike],
        inputs: Mapping[str, ArrayLike],
        dt: float,
        *,
        parameters: Mapping[str, float] | None = None,
        outputs: Iterable[str],
        substeps: int = 1,
        sensitivities: Sequence[str] = (),
    ) -> dict[str, Array]:
        """``CompiledModel.clamp`` for an FMU: the named states follow the given motion, the others are integrated.

        Our own FMUs run in one call; others need Model Exchange, for co-simulation hides the states.
        Raises FmuError for an FMU with co-simulation only.
        """
        names = tuple(outputs)
        for name in (*states, *inputs, *names, *(parameters or {}), *sensitivities):
            self._find(name)
        if self._own:
            return self._own.clamp(
                states, inputs, dt, parameters=parameters, outputs=names, substeps=substeps, sensitivities=sensitivities
            )
        if self._fmu.model_exchange is None:
            raise FmuError(
                f"{self._fmu.name}: its states cannot be held to a measured motion, for it offers co-simulation only; "
                "an FMU with Model Exchange can, and this one can still be simulated freely"
            )
        return clamp_model_exchange(
            self._fmu, states, inputs, dt, dict(parameters or {}), names, substeps, sensitivities
        )

    def _batch_entry(self) -> CompiledModel | None:
        kind = self._fmu.co_simulation or self._fmu.model_exchange
        if kind is None:
            return None
        library = load(self._fmu, kind)
        return (
            CompiledModel(self.model, TableRunner(library, self._fmu.name))
            if hasattr(library, "hy_run_table")
            else None
        )

    def _find(self, name: str) -> Variable:
        if name not in self._variables:
            known = ", ".join(v.name for v in self.model.variables if v.causality in ("input", "output", "parameter"))
            raise FmuError(f"{self._fmu.name} has no variable '{name}'; it has {known or 'none that can be used'}")
        return self._variables[name]

    def _samples(self, name: str, values: ArrayLike, n: int) -> Array:
        if self._find(name).causality != "input":
            raise FmuError(f"{self._fmu.name}: '{name}' is not an input")
        samples = np.ascontiguousarray(values, np.float64)
        if samples.shape != (n,):
            raise FmuError(f"{self._fmu.name}: input '{name}' has shape {samples.shape} where the times have ({n},)")
        if not np.isfinite(np.sum(samples)) and not np.all(np.isfinite(samples)):
            raise FmuError(
                f"{self._fmu.name}: input '{name}' is not finite at sample {int(np.argmin(np.isfinite(samples)))}"
            )
        return samples

    def _co_simulation(
        self,
        times: Array,
        table: Mapping[str, Array],
        settings: Mapping[str, float],
        wanted: Sequence[Variable],
        interpolation: str,
    ) -> dict[str, Array]:
        with Instance(self._fmu, "CoSimulation") as instance:
            given = [(self._find(name), value) for name, value in settings.items()]
            first = [(self._find(name), float(samples[0])) for name, samples in table.items()]
            instance.initialise(float(times[0]), [*given, *first])
            inputs = _Rows(instance, [self._find(name) for name in table], len(times))
            inputs.fill(table)
            readings = _Rows(instance, wanted, len(times))
            slopes = None
            if interpolation == "linear" and self._fmu.interpolates_inputs:
                slopes = _InputSlopes(instance, [self._find(name) for name in table], table, times)
            stepper = Stepper(instance)
            readings.get(0)
            for k in range(len(times) - 1):
                inputs.set(k)
                if slopes:
                    slopes.set(k)
                ended = stepper.step(times[k], times[k + 1] - times[k])
                readings.get(k + 1)
                if ended and k + 2 < len(times):
                    raise FmuError(
                        f"{self._fmu.name}: it asked for the end of the simulation at t = {times[k + 1]:.9g} s, "
                        f"before the last time {times[-1]:.9g} s"
                    )
            return readings.columns()

    def _model_exchange(
        self, times: Array, table: Mapping[str, Array], settings: Mapping[str, float], names: Sequence[str]
    ) -> dict[str, Array]:
        """FMPy's adaptive solver, for FMUs that bring none."""
        from fmpy import simulate_fmu

        signals = np.zeros(len(times), dtype=[("time", "f8"), *((name, "f8") for name in table)])
        signals["time"] = times
        for name, samples in table.items():
            signals[name] = samples
        try:
            rows = simulate_fmu(
                str(self._fmu.folder), fmi_type="ModelExchange", model_description=self._fmu.raw, start_time=times[0],
                stop_time=times[-1], output_interval=(times[-1] - times[0]) / max(len(times) - 1, 1),
                start_values=dict(settings), input=signals if table else None, output=list(names), record_events=False,
                relative_tolerance=1e-8,
            )  # fmt: skip
        except Exception as error:  # FMPy raises bare exceptions
            raise NumericalError(f"{self._fmu.name}: model exchange failed: {str(error).splitlines()[0]}") from None
        return {name: np.interp(times, rows["time"], np.asarray(rows[name], np.float64)) for name in names}


class _Rows:
    """A table of values of an instance, one block per type, filled or read row by row in place."""

    def __init__(self, instance: Instance, variables: Sequence[Variable], n: int) -> None:
        self._order = [v.name for v in variables]
        self._parts: list[tuple[Access, NDArray[np.generic]]] = [
            (access, np.zeros((n, len(access.names)), access.dtype)) for access in instance.access(variables)
        ]
        self._places = [(a, block.ctypes.data, block.strides[0]) for a, block in self._parts]

    def fill(self, table: Mapping[str, Array]) -> None:
        """Take the values from name -> (n,)."""
        for access, block in self._parts:
            for i, name in enumerate(access.names):
                block[:, i] = table[name]

    def set(self, row: int) -> None:
        """Set the instance to this row."""
        for access, address, stride in self._places:
            access.set(address + row * stride)

    def get(self, row: int) -> None:
        """Read this row from the instance."""
        for access, address, stride in self._places:
            access.get(address + row * stride)

    def columns(self) -> dict[str, Array]:
        """name -> (n,) in the order asked for."""
        found = {
            name: np.ascontiguousarray(block[:, i], np.float64)
            for access, block in self._parts
            for i, name in enumerate(access.names)
        }
        return {name: found[name] for name in self._order}


class _InputSlopes:
    """First derivatives of the real continuous inputs, so that they run linearly within a step (FMI 2.0 only)."""

    def __init__(
        self, instance: Instance, inputs: Sequence[Variable], table: Mapping[str, Array], times: Array
    ) -> None:
        chosen = [v for v in inputs if v.type == "Real" and v.variability == "continuous"]
        self._values = np.column_stack([np.diff(table[v.name]) / np.diff(times) for v in chosen]) if chosen else None
        self._references = np.array([v.slot for v in chosen], np.uint32)
        self._orders = np.ones(len(chosen), np.intc)
        self._instance = instance
        self._set = instance.function("SetRealInputDerivatives") if chosen else None
        self._arguments = (
            instance.component,
            ctypes.c_void_p(self._references.ctypes.data),
            ctypes.c_size_t(len(chosen)),
            ctypes.c_void_p(self._orders.ctypes.data),
        )

    def set(self, row: int) -> None:
        """For the step that begins at this row."""
        if self._set is None or self._values is None:
            return
        address = self._values.ctypes.data + row * self._values.strides[0]
        if self._set(*self._arguments, ctypes.c_void_p(address)) > 1:
            self._instance.fail("setting input derivatives")


def _times(fmu: str, t: ArrayLike) -> tuple[Array, bool]:
    """The times, and whether they are a uniform grid but for what rounding and a file's digits leave."""
    times = np.ascontiguousarray(t, np.float64)
    if times.ndim == 1 and len(times) > 1:
        steps = times[1:] - times[:-1]
        least, most = float(steps.min()), float(steps.max())  # NaN in the times is NaN here
        if least > 0 and np.isfinite(most):
            return times, most - least <= 2e-6 * most
    elif times.ndim == 1 and len(times) == 1 and np.isfinite(times[0]):
        return times, True
    raise FmuError(f"{fmu}: times must be finite and increasing")
