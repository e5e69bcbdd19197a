"""Any ``ModelCode`` compiled into this process: tables of inputs in, tables of outputs out, states clamped if wished.

The C text of the model is compiled together with the step and event code of the FMU shell, so that a model behaves here
as it does as an FMU. One call runs a whole recording; Python is left only at its beginning and end.
"""

from __future__ import annotations

import ctypes
import logging
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache, cached_property
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hystid.errors import NumericalError, UsageError
from hystid.modelcode import ModelCode, Variable
from hystid.toolchain import object_files, shared_library

Array = NDArray[np.float64]
Interpolation = Literal["hold", "linear", "cubic"]

SHELL = Path(__file__).parent / "fmu" / "shell"
FLAGS = ("-O2", "-ffp-contract=off")  # no fused multiply-add: the same bits on every processor
_ENGINE = ("hy_engine.c", "hy_step.c", "hy_ways.c", "hy_stops.c", "hy_strip.c", "hy_duhem.c", "hy_lanes.c")
_TABLE = ("hy_table.h", "hy_table.c")  # hy_lanes.c includes the last
_HEADERS = ("hy_model.h", "hy_engine.h", "hy_ways.h", "hy_stops.h", "hy_strip.h", *_TABLE)
_VERSION, _HOLD, _LINEAR, _HERMITE = 1, 0, 1, 2  # as in hy_table.h
_OUTCOMES = {1: "found no answer", 2: "failed"}

_log = logging.getLogger("hystid")
_int_p, _double_p = ctypes.POINTER(ctypes.c_int), ctypes.POINTER(ctypes.c_double)


class _Table(ctypes.Structure):
    """``hy_table`` of hy_table.h, field by field."""

    _fields_ = (
        ("version", ctypes.c_int),
        ("rows", ctypes.c_int),
        ("start_time", ctypes.c_double),
        ("dt", ctypes.c_double),
        ("substeps", ctypes.c_int),
        ("n_settings", ctypes.c_int),
        ("setting_slots", ctypes.c_void_p),
        ("settings", ctypes.c_void_p),
        ("n_columns", ctypes.c_int),
        ("column_slots", ctypes.c_void_p),
        ("column_modes", ctypes.c_void_p),
        ("samples", ctypes.c_void_p),
        ("slopes", ctypes.c_void_p),
        ("n_outputs", ctypes.c_int),
        ("output_slots", ctypes.c_void_p),
        ("outputs", ctypes.c_void_p),
        ("n_seeds", ctypes.c_int),
        ("seed_slots", ctypes.c_void_p),
        ("gradients", ctypes.c_void_p),
        ("failed_row", ctypes.c_int),
        ("failure", ctypes.c_char * 400),
        ("warning", ctypes.c_char * 400),
    )


@dataclass(frozen=True)
class Column:
    """One given signal: samples (n,) and how it runs between them; slopes (n,) [unit/s] make it a cubic Hermite."""

    slot: int
    samples: Array
    held: bool = False
    slopes: Array | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "samples", np.ascontiguousarray(self.samples, np.float64))
        if self.slopes is not None:
            object.__setattr__(self, "slopes", np.ascontiguousarray(self.slopes, np.float64))

    @cached_property
    def pointers(self) -> tuple[int, int]:
        """Addresses of samples and slopes, as long as the column lives."""
        first = _place(self.samples)
        return first, first if self.slopes is None else _place(self.slopes)


class Columns(tuple[Column, ...]):
    """Given signals as the C side reads them; many runs share them."""

    @cached_property
    def _arrays(self) -> tuple[NDArray[Any], ...]:
        slots, modes = np.array([c.slot for c in self], np.intc), np.array([_mode(c) for c in self], np.intc)
        samples, slopes = np.array([c.pointers for c in self], np.uintp).reshape(-1, 2).T.copy()
        return slots, modes, samples, slopes

    @cached_property
    def addresses(self) -> tuple[int, ...]:
        """Addresses of slots, modes, samples and slopes, as long as these columns live."""
        return tuple(map(_place, self._arrays))


@dataclass(frozen=True)
class Job:
    """One run: given signals, sample grid, values set before the start (name -> value), and what is wanted."""

    columns: Columns
    rows: int
    dt: float
    start_time: float
    settings: Mapping[str, float]
    outputs: tuple[str, ...]
    substeps: int


@dataclass(frozen=True)
class Settings:
    """What is set before the start: value references (k,) and the values there."""

    slots: NDArray[np.intc]
    values: Array

    @cached_property
    def addresses(self) -> tuple[int, int]:
        """Addresses of slots and values, as long as these settings live."""
        return _place(self.slots), _place(self.values)


@dataclass(frozen=True)
class Run:
    """One table for the runner: a job in value references."""

    columns: Columns
    rows: int
    dt: float
    settings: Settings
    start_time: float = 0.0
    substeps: int = 1


@dataclass(frozen=True)
class Motion:
    """States that follow a motion, and inputs, as a model takes them; ``CompiledModel.motion`` makes one.

    dt: sample time [s]. substeps: Runge-Kutta steps per sample.
    """

    columns: Columns = field(repr=False)
    rows: int
    dt: float
    substeps: int = 1


@dataclass(frozen=True)
class Outcome:
    """Outputs (n_outputs, rows) and, where seeds were asked for, gradients (n_outputs, n_seeds, rows).

    is_finite: whether every number of the call is; it says nothing where false.
    """

    outputs: Array
    gradients: Array
    is_finite: bool


class TableRunner:
    """The batch entry of a library that holds the shell, ours in this process or an FMU's."""

    def __init__(self, library: ctypes.CDLL, name: str) -> None:
        self._run = library.hy_run_table
        self._run.argtypes = [ctypes.POINTER(_Table)]
        self._run.restype = ctypes.c_int
        self._run_all = getattr(library, "hy_run_tables", None)  # an FMU has none
        if self._run_all is not None:
            self._run_all.argtypes = [ctypes.POINTER(_Table), ctypes.c_int, ctypes.POINTER(ctypes.c_int)]
            self._run_all.restype = None
        self._library = library
        self._name = name

    def run(
        self,
        columns: Sequence[Column],
        *,
        rows: int,
        dt: float,
        start_time: float = 0.0,
        settings: Mapping[int, float],
        outputs: Sequence[int],
        seeds: Sequence[int] = (),
        substeps: int = 1,
    ) -> Outcome:
        """Run one table. Slots are value references; settings: slot -> parameter or start value.

        Raises NumericalError with the model's own words where a step fails or an output is not finite.
        """
        given = Settings(np.array([*settings], np.intc), np.array([*settings.values()], np.float64))
        return self.run_all([Run(Columns(columns), rows, dt, given, start_time, substeps)], outputs, seeds)[0]

    def run_all(self, runs: Sequence[Run], outputs: Sequence[int], seeds: Sequence[int] = ()) -> list[Outcome]:
        """``run`` for several tables, side by side where the model integrates: that takes half the time of one by one.

        The outcomes are the same to the bit. Raises NumericalError of the first table that fails.
        """
        wanted = _Wanted(runs, outputs, seeds)
        tables = wanted.tables()
        if self._run_all is None or len(runs) == 1:
            outcomes = [self._run(ctypes.byref(table)) for table in tables]
        else:
            codes = (ctypes.c_int * len(runs))()
            self._run_all(tables, len(runs), codes)
            outcomes = list(codes)
        for table, run, code in zip(tables, runs, outcomes, strict=True):
            if table.warning:
                _log.warning("%s: %s", self._name, table.warning.decode(errors="replace"))
            if code:
                raise NumericalError(self._sentence(code, table, run.start_time + table.failed_row * run.dt))
        return wanted.outcomes()

    def _sentence(self, outcome: int, table: _Table, time: float) -> str:
        reason = table.failure.decode(errors="replace") or "its equations have no answer at these values"
        where = f"sample {table.failed_row} (t = {time:.9g} s)"
        return f"{self._name}: the model {_OUTCOMES.get(outcome, 'failed')} at {where}: {reason}"


def _mode(column: Column) -> int:
    return _HOLD if column.held else _LINEAR if column.slopes is None else _HERMITE


class _Wanted:
    """What is asked of the runs of one call. The C side reads and writes its arrays, which live as long as it does."""

    def __init__(self, runs: Sequence[Run], outputs: Sequence[int], seeds: Sequence[int]) -> None:
        self._runs = runs
        self._counts = len(outputs), len(seeds)
        self._slots = np.array(outputs, np.intc), np.array(seeds, np.intc)
        self._each = len(outputs) * (1 + len(seeds))
        self._block = np.empty(self._each * sum(run.rows for run in runs))  # one run after another
        first, addresses = _place(self._block), []
        for run in runs:
            addresses += [first + 8 * i * run.rows for i in range(self._each)]  # of outputs, then of gradients
            first += 8 * self._each * run.rows
        self._rows = np.array(addresses, np.uintp)

    def outcomes(self) -> list[Outcome]:
        """What the C side has written."""
        (n, seeds), first, found = self._counts, 0, []
        finite = bool(np.isfinite(np.add.reduce(self._block)))
        for run in self._runs:
            part = self._block[first : first + self._each * run.rows]
            gradients = part[n * run.rows :].reshape(n, seeds, run.rows)
            found.append(Outcome(part[: n * run.rows].reshape(n, run.rows), gradients, finite))
            first += len(part)
        return found

    def tables(self) -> ctypes.Array[_Table]:
        """The runs as the C side takes them."""
        (n, seeds), made = self._counts, (_Table * len(self._runs))()
        first = _place(self._rows)
        wanted, carried = (_place(slots) for slots in self._slots)
        for i, (table, run) in enumerate(zip(made, self._runs, strict=True)):
            outputs = first + 8 * i * self._each
            table.version, table.rows, table.substeps = _VERSION, run.rows, run.substeps
            table.start_time, table.dt = run.start_time, run.dt
            table.n_settings = len(run.settings.slots)
            table.setting_slots, table.settings = run.settings.addresses
            table.n_columns = len(run.columns)
            table.column_slots, table.column_modes, table.samples, table.slopes = run.columns.addresses
            table.n_outputs, table.output_slots, table.outputs = n, wanted, outputs
            table.n_seeds, table.seed_slots, table.gradients = seeds, carried, outputs + 8 * n
        return made


def _place(array: NDArray[Any]) -> int:
    """Address of an array, in a third of the time that ``array.ctypes`` takes."""
    place: int = array.__array_interface__["data"][0]
    return place


@cache
def shell_text(name: str) -> str:
    """Text of one file of the shell."""
    return (SHELL / name).read_text(encoding="utf-8")


def compile_model_code(code: ModelCode) -> Path:
    """Library of the model and the table runner, without FMI; cached by content. Raises ToolchainError."""
    headers = {name: shell_text(name) for name in _HEADERS}
    engine = object_files({**headers, **{name: shell_text(name) for name in _ENGINE}}, main=_ENGINE, flags=FLAGS)
    main = [name for name in code.sources if name.endswith(".c")]
    return shared_library({**headers, **code.sources}, main=main, flags=FLAGS, objects=engine)


class CompiledModel:
    """A model in this process. It holds no run-time state: every call starts anew, and calls may run in threads."""

    def __init__(self, code: ModelCode, runner: TableRunner | None = None) -> None:
        """runner: the batch entry of a library that holds this model already (an FMU's); else it is compiled."""
        self.code = code
        self._variables = {variable.name: variable for variable in code.variables}
        self._runner = runner or TableRunner(ctypes.CDLL(str(compile_model_code(code))), code.name)
        self._partners: dict[frozenset[str], dict[str, str]] = {}
        self._forward_serves: dict[frozenset[str], bool] = {}
        self._settable: dict[tuple[str, ...], NDArray[np.intc]] = {}

    def simulate(
        self,
        inputs: Mapping[str, ArrayLike],
        dt: float,
        *,
        parameters: Mapping[str, float] | None = None,
        start: Mapping[str, float] | None = None,
        outputs: Iterable[str],
        interpolation: Interpolation = "linear",
        substeps: int = 1,
        rows: int | None = None,
        start_time: float = 0.0,
    ) -> dict[str, Array]:
        """Fixed-step Runge-Kutta with located events; one row per sample, the first at start_time.

        inputs: name -> samples (n,) on a uniform grid of step dt [s]; inputs not named keep their start value.
        interpolation: how inputs run between samples ("cubic" takes slopes of order four from the samples).
        substeps: Runge-Kutta steps per sample; 0 takes as many as the model's own step asks for.
        rows: number of samples, needed only where the model has no inputs. Returns output name -> (n,).
        Raises UsageError for unknown names and unequal lengths, NumericalError where the model has no finite answer.
        """
        columns = [self._input(name, values, dt, interpolation) for name, values in inputs.items()]
        settings = {**(parameters or {}), **(start or {})}
        return self._run(
            Job(Columns(columns), _rows(columns, rows), dt, start_time, settings, tuple(outputs), substeps)
        )

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
        start: Mapping[str, float] | None = None,
        start_time: float = 0.0,
    ) -> dict[str, Array]:
        """The named states follow the given motion, other states are integrated, outputs are evaluated at each sample.

        Between samples a state whose derivative is another given state (x and v) follows the cubic Hermite through
        both; other states follow a cubic with slopes of order four from their own samples; inputs run linearly.
        sensitivities: parameter names; adds ``"d <output>/d <parameter>"`` -> (n,), the derivative with the motion
        held: by the model's forward derivatives where they are exact, else by central differences over whole runs.
        """
        columns = [*self._motion(states, dt), *(self._input(name, u, dt, "linear") for name, u in inputs.items())]
        settings = {**(parameters or {}), **(start or {})}
        job = Job(Columns(columns), _rows(columns, None), dt, start_time, settings, tuple(outputs), substeps)
        if not sensitivities:
            return self._run(job)
        if self._forward_is_exact(frozenset(states), job, sensitivities):
            return self._run(job, sensitivities)
        return self._central_differences(job, sensitivities, relative_step=1e-4)

    def motion(
        self,
        states: Mapping[str, ArrayLike],
        inputs: Mapping[str, ArrayLike],
        dt: float,
        *,
        interpolation: Interpolation = "linear",
        substeps: int = 1,
    ) -> Motion:
        """States and inputs of ``clamp`` (or, without states, of ``simulate``), checked and made ready once for many
        runs."""
        _check_steps(self.code.name, dt, substeps)
        columns = [*self._motion(states, dt), *(self._input(name, u, dt, interpolation) for name, u in inputs.items())]
        return Motion(Columns(columns), _rows(columns, None), dt, substeps)

    def follow(
        self,
        motions: Sequence[Motion],
        parameters: Mapping[str, float] | Sequence[Mapping[str, float]],
        outputs: Sequence[str],
    ) -> list[dict[str, Array]]:
        """``clamp`` or ``simulate`` along several motions, at the same parameters or at those of each, in one call; the
        numbers are the same to the bit."""
        each = [parameters] * len(motions) if isinstance(parameters, Mapping) else parameters
        known = self._all_settings(each)
        runs = [Run(m.columns, m.rows, m.dt, known[id(p)], 0.0, m.substeps) for m, p in zip(motions, each, strict=True)]
        return self._results(runs, tuple(outputs))

    def _run(self, job: Job, seeds: Sequence[str] = ()) -> dict[str, Array]:
        return self._run_all([job], seeds)[0]

    def _run_all(self, jobs: Sequence[Job], seeds: Sequence[str] = ()) -> list[dict[str, Array]]:
        """Several jobs with the same outputs."""
        for job in jobs:
            _check_steps(self.code.name, job.dt, job.substeps)
        known = self._all_settings([job.settings for job in jobs])
        runs = [Run(j.columns, j.rows, j.dt, known[id(j.settings)], j.start_time, j.substeps) for j in jobs]
        return self._results(runs, jobs[0].outputs if jobs else (), seeds)

    def _results(self, runs: Sequence[Run], names: Sequence[str], seeds: Sequence[str] = ()) -> list[dict[str, Array]]:
        slots, carried = ([self._find(name).slot for name in wanted] for wanted in (names, seeds))
        found = self._runner.run_all(runs, slots, carried)
        results = [dict(zip(names, outcome.outputs, strict=True)) for outcome in found]
        for result, outcome, run in zip(results, found, runs, strict=True):
            for name, rows in zip(names, outcome.gradients, strict=True):
                result.update({f"d {name}/d {seed}": row for seed, row in zip(seeds, rows, strict=True)})
            if not outcome.is_finite:
                check_finite(self.code.name, result, run.dt)
        return results

    def _find(self, name: str) -> Variable:
        if name not in self._variables:
            known = ", ".join(v.name for v in self.code.variables if v.causality != "local")
            raise UsageError(f"{self.code.name} has no variable '{name}'; it has {known}")
        return self._variables[name]

    def _all_settings(self, each: Sequence[Mapping[str, float]]) -> dict[int, Settings]:
        """Settings by the identity of the values: many runs share theirs."""
        return {key: self._settings(values) for key, values in {id(values): values for values in each}.items()}

    def _settings(self, values: Mapping[str, float]) -> Settings:
        names = tuple(values)
        if names not in self._settable:
            self._settable[names] = np.array([self._slot_to_set(name) for name in names], np.intc)
        found = Settings(self._settable[names], np.array([*values.values()], np.float64))
        if not np.isfinite(found.values).all():
            name = next(name for name, value in values.items() if not np.isfinite(value))
            raise UsageError(f"{self.code.name}: '{name}' must be a finite number, not {values[name]}")
        return found

    def _slot_to_set(self, name: str) -> int:
        """Value reference of what may be set before the start."""
        variable = self._find(name)
        settable = variable.causality in ("parameter", "structuralParameter", "input")
        if name in self.code.states and variable.initial == "calculated":
            raise UsageError(f"{self.code.name}: the start of '{name}' is computed: {self._way_to_start(name)}")
        if not (settable or variable.initial in ("exact", "approx") or name in self.code.states):
            raise UsageError(f"{self.code.name}: '{name}' is computed by the model and cannot be set")
        return variable.slot

    def _way_to_start(self, state: str) -> str:
        known = self._variables.get(f"{state}_start")
        if known is not None and known.causality == "parameter":
            return f"set the parameter '{known.name}' instead"
        return "set the parameters that its start or its initial equation takes"

    def _input(self, name: str, values: ArrayLike, dt: float, interpolation: Interpolation) -> Column:
        variable = self._find(name)
        if variable.causality != "input":
            raise UsageError(f"{self.code.name}: '{name}' is not an input")
        samples = _samples(self.code.name, name, values)
        if interpolation not in ("hold", "linear", "cubic"):
            raise UsageError(f"interpolation must be hold, linear or cubic, not '{interpolation}'")
        held = interpolation == "hold" or variable.variability == "discrete" or variable.type != "Real"
        slopes = slopes_of(samples, dt) if interpolation == "cubic" and not held else None
        return Column(variable.slot, samples, held, slopes)

    def _motion(self, states: Mapping[str, ArrayLike], dt: float) -> list[Column]:
        samples = {name: _samples(self.code.name, name, values) for name, values in states.items()}
        for name in samples:
            if name not in self.code.states:
                known = ", ".join(self.code.states) or "none"
                raise UsageError(
                    f"{self.code.name}: '{name}' is not a continuous state and cannot be clamped; states: {known}"
                )
        partners = self._derivative_partners(frozenset(samples))
        return [
            Column(self._find(name).slot, x, slopes=samples[partners[name]] if name in partners else slopes_of(x, dt))
            for name, x in samples.items()
        ]

    def _derivative_partners(self, states: frozenset[str]) -> dict[str, str]:
        """State -> the other of these states that is its derivative, found by asking the model at some point."""
        if states not in self._partners:
            found = {}
            derivatives = {v.derivative_of: v.slot for v in self.code.variables if v.derivative_of in states}
            if len(states) > 1 and derivatives:
                given = {name: 1e-3 * (1 + 0.37 * i) for i, name in enumerate(sorted(states))}
                columns = [Column(self._find(name).slot, np.array([value])) for name, value in given.items()]
                slots = list(derivatives.values())
                values = self._runner.run(columns, rows=1, dt=1.0, settings={}, outputs=slots).outputs[:, 0]
                found = {
                    state: other
                    for state, slope in zip(derivatives, values, strict=True)
                    for other, value in given.items()
                    if state is not None and slope == value
                }
            self._partners[states] = found
        return self._partners[states]

    def _forward_is_exact(self, states: frozenset[str], job: Job, names: Sequence[str]) -> bool:
        """Whether forward derivatives serve here; where inner states switch, that is tried once and remembered.

        They lack the jumps that a switch gives to the sensitivities of inner and discrete states, be it an event or a
        discontinuity inside noEvent, which the code does not show.
        """
        discrete = any(v.variability == "discrete" and v.causality in ("local", "output") for v in self.code.variables)
        inner = len(states) < len(self.code.states)
        if not self.code.has_forward or (self.code.n_indicators and (inner or discrete)):
            return False
        if not inner:
            return True
        if states not in self._forward_serves:
            carried = self._run(job, names)
            tried = self._central_differences(job, names, relative_step=6e-6)
            self._forward_serves[states] = all(
                np.linalg.norm(carried[key] - tried[key]) <= 1e-3 * np.linalg.norm(tried[key])
                for key in carried
                if key.startswith("d ")
            )
        return self._forward_serves[states]

    def _central_differences(self, job: Job, names: Sequence[str], *, relative_step: float) -> dict[str, Array]:
        result = self._run(job)
        scale = max((float(np.max(np.abs(y))) for y in result.values()), default=0.0)
        for name in names:
            variable = self._find(name)
            value = float(job.settings.get(name, variable.start or 0.0))
            step = relative_step * (abs(value) or abs(variable.nominal or 1.0))
            for _ in range(4):  # a parameter at zero has no size of its own: grow the step until the outputs move
                change = self._change(job, name, value, step)
                moved = max((float(np.max(np.abs(d))) for d in change.values()), default=0.0)
                if value or moved > 1e-7 * scale:
                    break
                step *= 1e3
            result.update({f"d {output}/d {name}": change[output] / (2 * step) for output in job.outputs})
        return result

    def _change(self, job: Job, name: str, value: float, step: float) -> dict[str, Array]:
        high = self._run(replace(job, settings={**job.settings, name: value + step}))
        low = self._run(replace(job, settings={**job.settings, name: value - step}))
        return {output: high[output] - low[output] for output in job.outputs}


def slopes_of(samples: Array, dt: float) -> Array:
    """Time derivative (n,) of uniform samples by central differences of order four, lower at the two ends."""
    if len(samples) < 3:
        return np.full_like(samples, (samples[-1] - samples[0]) / dt if len(samples) == 2 else 0.0)
    slopes = np.gradient(samples, dt, edge_order=2)
    if len(samples) > 4:
        slopes[2:-2] = (8 * (samples[3:-1] - samples[1:-3]) - (samples[4:] - samples[:-4])) / (12 * dt)
    return np.asarray(slopes)


def check_finite(model: str, values: Mapping[str, Array], dt: float) -> None:
    """Raise NumericalError naming the first output and sample that is NaN or infinite."""
    for name, row in values.items():
        if not np.isfinite(np.sum(row)) and not np.all(np.isfinite(row)):
            first = int(np.argmin(np.isfinite(row)))
            raise NumericalError(
                f"{model}: '{name}' is {row[first]} at sample {first} (t = {first * dt:.9g} s); "
                "parameters or inputs lie where the model has no answer"
            )


def _samples(model: str, name: str, values: ArrayLike) -> Array:
    samples = np.ascontiguousarray(values, np.float64)
    if samples.ndim != 1 or not len(samples):
        raise UsageError(f"{model}: '{name}' must be a row of samples, not an array of shape {samples.shape}")
    if not np.isfinite(np.sum(samples)) and not np.all(np.isfinite(samples)):
        first = int(np.argmin(np.isfinite(samples)))
        raise UsageError(f"{model}: '{name}' is {samples[first]} at sample {first}; fill or cut gaps first")
    return samples


def _rows(columns: Sequence[Column], rows: int | None) -> int:
    lengths = {len(column.samples) for column in columns} | ({rows} if rows is not None else set())
    if len(lengths) != 1:
        found = ", ".join(map(str, sorted(lengths))) or "none"
        raise UsageError(f"inputs and states must have one common number of samples; found {found}")
    return lengths.pop()


def _check_steps(model: str, dt: float, substeps: int) -> None:
    if not (np.isfinite(dt) and dt > 0):
        raise UsageError(f"{model}: the sample step must be positive, not {dt} s")
    if substeps < 0:
        raise UsageError(f"{model}: substeps must be at least 1, or 0 for the model's own step, not {substeps}")
