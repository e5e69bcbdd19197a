"""Drive any FMU: our own through its batch entry, others through prepared buffers."""

from __future__ import annotations

import ctypes
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal, NoReturn

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hystid.batch import TableRunner
from hystid.child import beat
from hystid.compiled import CompiledModel, check_finite
from hystid.errors import FmuError, NumericalError
from hystid.fmu.clamping import Clamping, clamp_model_exchange
from hystid.fmu.door import open_fmu, opened_from
from hystid.fmu.foreign import Foreign, runs_here
from hystid.fmu.native import Instance, Stepper, load
from hystid.fmu.rows import Rows
from hystid.fmu.si import beside_si, from_si
from hystid.fmu.signals import Signal
from hystid.numeric import Array


class Driver:
    """An opened FMU, FMI 2.0 or 3.0. Unpacked once; every call runs a fresh instance.

    Raises FmuError with one sentence where the file is not a usable FMU.
    """

    def __init__(self, path: Path | str, *, unpacked: Path | None = None) -> None:
        """path: the file. unpacked: a folder that it was unpacked into before, which is left alone."""
        self._fmu = open_fmu(Path(path)) if unpacked is None else opened_from(Path(path), unpacked)
        self.model = self._fmu.model
        self.path = self._fmu.path
        self.fmi = self._fmu.version
        self._ranges = {v.name: v.limits for v in self.model.variables if v.min is not None or v.max is not None}
        self._foreign = None if runs_here(self._fmu) else Foreign.of(self._fmu)
        self._elements: Mapping[str, tuple[str, ...]] = {}  # array -> names of its elements, for the batch entry
        self._own = self._batch_entry() if self._foreign is None else None
        self._has_batch_entry = self._own is not None if self._foreign is None else self._foreign.has_batch_entry()

    @property
    def kinds(self) -> tuple[str, ...]:
        """Which of "CoSimulation" and "ModelExchange" can be run here."""
        found = {"CoSimulation": self._fmu.co_simulation, "ModelExchange": self._fmu.model_exchange}
        return tuple(name for name, kind in found.items() if kind is not None)

    @property
    def is_own(self) -> bool:
        """Whether the FMU offers our batch entry."""
        return self._has_batch_entry

    @property
    def signals(self) -> Mapping[str, Signal]:
        """name -> every variable of the description but clocks, of whatever type; ``model`` has the single numbers."""
        return self._fmu.signals

    def lists(self, name: str) -> bool:
        """Whether the description lists this name, of whatever type."""
        return any(v.name == name for v in self._fmu.raw.modelVariables)

    def check_si(self, names: Iterable[str]) -> None:
        """Raise FmuError for the first of these variables, if they are there, whose unit is not that of SI."""
        for name in names:
            if unit := beside_si(self._fmu.raw, name):
                raise FmuError(
                    f"{self._fmu.name}: its variable {name} is in {unit}, and its numbers would be taken for SI units; "
                    "export the FMU with this variable in SI units"
                )

    def from_si(self, values: Mapping[str, float]) -> dict[str, float]:
        """Values in SI units as the FMU takes them, each in the unit of its variable."""
        return {name: from_si(self._fmu.raw, name, value) for name, value in values.items()}

    def shown(self, values: Mapping[str, float]) -> str:
        """Values as the FMU takes them, "k = 5 N/mm, n = 2": with the units that are not those of SI."""
        units = {name: beside_si(self._fmu.raw, name) for name in values}
        return ", ".join(f"{name} = {value:.10g} {units[name]}".rstrip() for name, value in values.items())

    def simulate(
        self,
        t: ArrayLike,
        inputs: Mapping[str, ArrayLike] | None = None,
        *,
        parameters: Mapping[str, Any] | None = None,
        start: Mapping[str, Any] | None = None,
        outputs: Iterable[str] | None = None,
        interpolation: Literal["linear", "hold"] = "linear",
    ) -> dict[str, Array]:
        """Outputs at the times t (n,) [s], increasing; inputs name -> (n,). Returns name -> (n,), arrays (n, size).

        outputs: names, all of causality output where none are given. interpolation: how inputs run between samples;
        an FMU that takes no input derivatives holds them whatever is asked. Our own FMUs run in one call when t is
        uniform. Numbers of all types come as double precision; ``record`` has them as they are, and texts.
        Raises FmuError (unknown name, the FMU refuses), NumericalError (not finite).
        """
        times, uniform = _times(self._fmu.name, t)
        names = self._outputs() if outputs is None else tuple(outputs)
        for name in names:
            if self._find(name).is_text:
                raise FmuError(f"{self._fmu.name}: '{name}' holds texts, not numbers")
        if self._foreign is not None:
            return self._foreign.table(
                "simulate", len(times), names, t=times, inputs=_arrays(inputs), parameters=dict(parameters or {}),
                start=dict(start or {}), outputs=names, interpolation=interpolation,
            )  # fmt: skip
        dt = (times[-1] - times[0]) / max(len(times) - 1, 1) or 1.0
        settings = {**(parameters or {}), **(start or {})}
        self._check_settings(settings)
        if self._own and uniform and not settings.keys() & self._elements.keys():
            table = {name: self._samples(name, values, len(times)) for name, values in (inputs or {}).items()}
            columns = {part: column for name in table for part, column in self._columns(name, table[name])}
            parts = [part for name in names for part in self._elements.get(name, (name,))]
            found = self._own.simulate(
                columns, dt, parameters=settings, outputs=parts, interpolation=interpolation, substeps=0,
                rows=len(times), start_time=float(times[0]),
            )  # fmt: skip
            return {name: self._joined(name, found) for name in names}
        found = self.record(times, inputs, settings=settings, outputs=names, interpolation=interpolation)
        result = {name: np.ascontiguousarray(values, np.float64) for name, values in found.items()}
        check_finite(self._fmu.name, result, dt)
        return result

    def record(
        self,
        t: ArrayLike,
        inputs: Mapping[str, ArrayLike] | None = None,
        *,
        settings: Mapping[str, Any] | None = None,
        outputs: Iterable[str] | None = None,
        interpolation: Literal["linear", "hold"] = "linear",
    ) -> dict[str, NDArray[Any]]:
        """``simulate`` step by step, with values of all types as they are: integers of their size, truth values, texts.

        inputs: name -> (n,), of an array (n, size). settings: parameters and start values. An array comes as (n, size),
        texts as objects, binary data as hexadecimal digits. What is not finite is returned as it is.
        Raises FmuError; texts cannot be read from an FMU with Model Exchange only.
        """
        times, _ = _times(self._fmu.name, t)
        names = self._outputs() if outputs is None else tuple(outputs)
        self._check_settings(settings or {})
        if self._foreign is not None:
            return self._foreign.table(
                "record", len(times), names, t=times, inputs=_arrays(inputs), settings=dict(settings or {}),
                outputs=names, interpolation=interpolation,
            )  # fmt: skip
        table = {name: self._samples(name, values, len(times)) for name, values in (inputs or {}).items()}
        wanted = [self._find(name) for name in names]
        given = [(self._find(name), value) for name, value in (settings or {}).items()]
        if self._fmu.co_simulation is None:
            return self._model_exchange(times, table, dict(settings or {}), wanted)
        return self._co_simulation(times, table, given, wanted, interpolation)

    @property
    def reads_texts(self) -> bool:
        """Whether texts and binary data can be recorded."""
        return self._fmu.co_simulation is not None

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
        for name in (*states, *inputs, *names, *sensitivities):
            self._find(name)
        self._check_settings(parameters or {})
        if self._foreign is not None:
            rows = max((len(np.atleast_1d(np.asarray(u))) for u in (*states.values(), *inputs.values())), default=0)
            return self._foreign.table(
                "clamp", rows, None, states=_arrays(states), inputs=_arrays(inputs), dt=dt,
                parameters=dict(parameters or {}), outputs=names, substeps=substeps, sensitivities=list(sensitivities),
            )  # fmt: skip
        if self._own:
            return self._own.clamp(
                states, inputs, dt, parameters=parameters, outputs=names, substeps=substeps, sensitivities=sensitivities
            )
        if self._fmu.model_exchange is None:
            raise FmuError(
                f"{self._fmu.name}: its states cannot be held to a measured motion, for it offers co-simulation only; "
                "an FMU with Model Exchange can, and this one can still be simulated freely"
            )
        motion, signals = ({n: np.asarray(u, np.float64) for n, u in table.items()} for table in (states, inputs))
        given = Clamping(motion, signals, dt, names, substeps)
        return clamp_model_exchange(self._fmu, given, parameters or {}, sensitivities)

    def _batch_entry(self) -> CompiledModel | None:
        kind = self._fmu.co_simulation or self._fmu.model_exchange
        arrays = [s for s in self.signals.values() if s.shape and s.causality in ("input", "output")]
        if kind is None or not all(s.is_real for s in arrays):
            return None
        library = load(self._fmu, kind)
        if not hasattr(library, "hy_run_table"):
            return None
        # The table is read by the places that the description states: it must be the one of this library.
        Instance(self._fmu, "CoSimulation" if self._fmu.co_simulation else "ModelExchange").close()
        self._elements = {s.name: tuple(v.name for v in s.elements()) for s in arrays}  # side by side in its block
        single = replace(self.model, variables=(*self.model.variables, *(v for s in arrays for v in s.elements())))
        return CompiledModel(single, TableRunner(library, self._fmu.name))

    def _columns(self, name: str, values: NDArray[Any]) -> Iterator[tuple[str, NDArray[Any]]]:
        """Single columns of a table, as the batch entry takes them: those of an array are its elements."""
        parts = self._elements.get(name, (name,))
        yield from zip(parts, np.ascontiguousarray(values.reshape(len(values), -1).T), strict=True)

    def _joined(self, name: str, found: Mapping[str, Array]) -> Array:
        return np.stack([found[part] for part in self._elements[name]], 1) if name in self._elements else found[name]

    def _outputs(self) -> tuple[str, ...]:
        return tuple(s.name for s in self.signals.values() if s.causality == "output" and not s.is_text)

    def _find(self, name: str) -> Signal:
        if name not in self.signals:
            known = ", ".join(s.name for s in self.signals.values() if s.causality in ("input", "output", "parameter"))
            raise FmuError(f"{self._fmu.name} has no variable '{name}'; it has {known or 'none that can be used'}")
        return self.signals[name]

    def _check_settings(self, settings: Mapping[str, Any]) -> None:
        """Values of parameters and starts lie in the ranges that the description states, and are finite."""
        for name, value in settings.items():
            if not self._find(name).is_real or np.ndim(value):
                continue
            low, high = self._ranges.get(name, (-np.inf, np.inf))
            if not (np.isfinite(value) and low <= value <= high):
                raise FmuError(
                    f"{self._fmu.name}: {name} = {value:g} is not in its range, which is [{low:g}, {high:g}]"
                )

    def _samples(self, name: str, values: ArrayLike, n: int) -> NDArray[Any]:
        signal = self._find(name)
        if signal.causality != "input":
            raise FmuError(f"{self._fmu.name}: '{name}' is not an input")
        try:
            samples = signal.samples(values)
        except (ValueError, TypeError) as error:
            raise FmuError(f"{self._fmu.name}: input '{name}' {error}") from None
        expected = (n, signal.size) if signal.shape else (n,)
        if samples.shape != expected:
            raise FmuError(f"{self._fmu.name}: input '{name}' has shape {samples.shape} where {expected} is needed")
        if signal.is_real and not np.all(np.isfinite(samples)):
            first = int(np.argmin(np.isfinite(samples.reshape(n, -1)).all(axis=1)))
            raise FmuError(f"{self._fmu.name}: input '{name}' is not finite at sample {first}")
        return samples

    def _co_simulation(
        self,
        times: Array,
        table: Mapping[str, NDArray[Any]],
        settings: Sequence[tuple[Signal, Any]],
        wanted: Sequence[Signal],
        interpolation: str,
    ) -> dict[str, NDArray[Any]]:
        with Instance(self._fmu, "CoSimulation") as instance:
            first = [(self._find(name), samples[0]) for name, samples in table.items()]
            instance.initialise(float(times[0]), settings, first)
            inputs = Rows(instance, list(table), len(times))
            inputs.fill(table)
            readings = Rows(instance, [s.name for s in wanted], len(times))
            slopes = None
            if interpolation == "linear" and self._fmu.interpolates_inputs:
                slopes = _InputSlopes(instance, [self._find(name) for name in table], table, times)
            stepper = Stepper(instance)
            readings.get(0)
            for k, (now, h) in enumerate(zip(times.tolist(), np.diff(times).tolist(), strict=False)):
                inputs.set(k)
                if slopes:
                    slopes.set(k)
                beat()
                ended = stepper.step(now, h)
                readings.get(k + 1)
                if ended and k + 2 < len(times):
                    self._ended_early(times[k + 1], times[-1])
            return readings.columns()

    def _model_exchange(
        self, times: Array, table: Mapping[str, NDArray[Any]], settings: Mapping[str, Any], wanted: Sequence[Signal]
    ) -> dict[str, NDArray[Any]]:
        """FMPy's adaptive solver, for FMUs that bring none."""
        from fmpy import simulate_fmu

        for signal in wanted:
            if signal.is_text:
                raise FmuError(f"{self._fmu.name}: the texts of '{signal.name}' cannot be read in model exchange")
        columns = [(name, samples.dtype, samples.shape[1:]) for name, samples in table.items()]
        signals = np.zeros(len(times), dtype=[("time", np.dtype(np.float64), ()), *columns])
        signals["time"] = times
        for name, samples in table.items():
            signals[name] = samples
        names = [s.name for s in wanted]
        try:
            rows = simulate_fmu(
                str(self._fmu.folder), fmi_type="ModelExchange", model_description=self._fmu.raw, start_time=times[0],
                stop_time=times[-1], output_interval=(times[-1] - times[0]) / max(len(times) - 1, 1),
                start_values=dict(settings), input=signals if table else None, output=names, record_events=False,
                relative_tolerance=1e-8, step_finished=_went_on,
            )  # fmt: skip
        except Exception as error:  # FMPy raises bare exceptions
            reason = (str(error).splitlines() or ["no reason given"])[0].replace(f"{self._fmu.folder}/", "")
            raise NumericalError(f"{self._fmu.name}: model exchange failed: {reason}") from None
        end = float(rows["time"][-1])
        if end < times[-1] - 1e-6 * (times[-1] - times[0]):
            self._ended_early(end, times[-1])
        slack = 1e-9 * (rows["time"][-1] - rows["time"][0])
        return {s.name: s.resampled(times, rows["time"], np.asarray(rows[s.name]), slack) for s in wanted}

    def _ended_early(self, end: float, last: float) -> NoReturn:
        raise FmuError(
            f"{self._fmu.name}: it asked for the end of the simulation at t = {end:.9g} s, "
            f"before the last time {last:.9g} s"
        )


def _went_on(_: float, __: Any) -> bool:
    beat()
    return True


def _arrays(table: Mapping[str, ArrayLike] | None) -> dict[str, NDArray[Any]]:
    return {name: np.asarray(values) for name, values in (table or {}).items()}


class _InputSlopes:
    """First derivatives of the real continuous inputs, so that they run linearly within a step (FMI 2.0 only)."""

    def __init__(
        self, instance: Instance, inputs: Sequence[Signal], table: Mapping[str, NDArray[Any]], times: Array
    ) -> None:
        chosen = [s for s in inputs if s.is_continuous]
        self._values = np.column_stack([np.diff(table[s.name]) / np.diff(times) for s in chosen]) if chosen else None
        self._references = np.array([s.reference for s in chosen], np.uint32)
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
