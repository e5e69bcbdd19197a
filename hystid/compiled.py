"""Any ``ModelCode`` compiled into this process: tables of inputs in, tables of outputs out, states clamped if wished.

The C text of the model is compiled together with the step and event code of the FMU shell, so that a model behaves here
as it does as an FMU. One call runs a whole recording; Python is left only at its beginning and end.
"""

from __future__ import annotations

import ctypes
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hystid.batch import GivenSignal, GivenSignals, Run, Settings, TableRunner
from hystid.batch import Motion as Motion
from hystid.errors import NumericalError, UsageError
from hystid.modelcode import ModelCode, Variable
from hystid.numeric import Array
from hystid.toolchain import object_files, shared_library

Interpolation = Literal["hold", "linear", "cubic"]

SHELL = Path(__file__).parent / "fmu" / "shell"
FLAGS = ("-O2", "-ffp-contract=off")  # no fused multiply-add: the same bits on every processor
_ENGINE = ("hy_engine.c", "hy_step.c", "hy_paths.c", "hy_stops.c", "hy_strip.c", "hy_duhem.c", "hy_lanes.c")
_TABLE = ("hy_table.h", "hy_table.c")  # hy_lanes.c includes the last
_HEADERS = ("hy_model.h", "hy_engine.h", "hy_paths.h", "hy_strip.h", *_TABLE)


@dataclass(frozen=True)
class _Job:
    """A run along a motion: values set before the start (name -> value), and what is wanted."""

    motion: Motion
    settings: Mapping[str, float]
    outputs: tuple[str, ...]


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
        outputs: Iterable[str],
        interpolation: Interpolation = "linear",
        substeps: int = 1,
        rows: int | None = None,
        start_time: float = 0.0,
    ) -> dict[str, Array]:
        """Fixed-step Runge-Kutta with located events; one row per sample, the first at start_time.

        inputs: name -> samples (n,) on a uniform grid of step dt [s]; inputs not named keep their start value.
        parameters: values set before the start, start values of states too.
        interpolation: how inputs run between samples ("cubic" takes slopes of order four from the samples).
        substeps: Runge-Kutta steps per sample; 0 takes as many as the model's own step asks for.
        rows: number of samples, needed only where the model has no inputs. Returns output name -> (n,).
        Raises UsageError for unknown names and unequal lengths, NumericalError where the model has no finite answer.
        """
        _check_steps(self.code.name, dt, substeps)
        columns = [self._input(name, values, dt, interpolation) for name, values in inputs.items()]
        motion = Motion(GivenSignals(columns), _rows(columns, rows), dt, substeps, start_time)
        return self._run(_Job(motion, parameters or {}, tuple(outputs)))

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
        """The named states follow the given motion, other states are integrated, outputs are evaluated at each sample.

        Between samples a state whose derivative is another given state (x and v) follows the cubic Hermite through
        both; other states follow a cubic with slopes of order four from their own samples; inputs run linearly.
        sensitivities: parameter names; adds ``"d <output>/d <parameter>"`` -> (n,), the derivative with the motion
        held: by the model's forward derivatives where they are exact, else by central differences over whole runs.
        """
        job = _Job(self.motion(states, inputs, dt, substeps=substeps), parameters or {}, tuple(outputs))
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
        return Motion(GivenSignals(columns), _rows(columns, None), dt, substeps)

    def follow(
        self,
        motions: Sequence[Motion],
        parameters: Mapping[str, float] | Sequence[Mapping[str, float]],
        outputs: Sequence[str],
    ) -> list[dict[str, Array]]:
        """``clamp`` or ``simulate`` along several motions, at the same parameters or at those of each, in one call; the
        numbers are the same to the bit."""
        each = [parameters] * len(motions) if isinstance(parameters, Mapping) else parameters
        known = {key: self._settings(p) for key, p in {id(p): p for p in each}.items()}  # many runs share theirs
        runs = [Run(motion, known[id(p)]) for motion, p in zip(motions, each, strict=True)]
        return self._results(runs, tuple(outputs))

    def _run(self, job: _Job, seeds: Sequence[str] = ()) -> dict[str, Array]:
        return self._results([Run(job.motion, self._settings(job.settings))], job.outputs, seeds)[0]

    def _results(self, runs: Sequence[Run], names: Sequence[str], seeds: Sequence[str] = ()) -> list[dict[str, Array]]:
        slots, carried = ([self._find(name).slot for name in wanted] for wanted in (names, seeds))
        found = self._runner.run_all(runs, slots, carried)
        results = [dict(zip(names, outcome.outputs, strict=True)) for outcome in found]
        for result, outcome, run in zip(results, found, runs, strict=True):
            for name, rows in zip(names, outcome.gradients, strict=True):
                result.update({f"d {name}/d {seed}": row for seed, row in zip(seeds, rows, strict=True)})
            if not outcome.is_finite:
                check_finite(self.code.name, result, run.motion.dt)
        return results

    def _find(self, name: str) -> Variable:
        if name not in self._variables:
            known = ", ".join(v.name for v in self.code.variables if v.causality != "local")
            raise UsageError(f"{self.code.name} has no variable '{name}'; it has {known}")
        return self._variables[name]

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

    def _input(self, name: str, values: ArrayLike, dt: float, interpolation: Interpolation) -> GivenSignal:
        variable = self._find(name)
        if variable.causality != "input":
            raise UsageError(f"{self.code.name}: '{name}' is not an input")
        samples = _samples(self.code.name, name, values)
        if interpolation not in ("hold", "linear", "cubic"):
            raise UsageError(f"interpolation must be hold, linear or cubic, not '{interpolation}'")
        held = interpolation == "hold" or variable.variability == "discrete" or variable.type != "Real"
        slopes = slopes_of(samples, dt) if interpolation == "cubic" and not held else None
        return GivenSignal(variable.slot, samples, held, slopes)

    def _motion(self, states: Mapping[str, ArrayLike], dt: float) -> list[GivenSignal]:
        samples = {name: _samples(self.code.name, name, values) for name, values in states.items()}
        for name in samples:
            if name not in self.code.states:
                known = ", ".join(self.code.states) or "none"
                raise UsageError(
                    f"{self.code.name}: '{name}' is not a continuous state and cannot be clamped; states: {known}"
                )
        partners = self._derivative_partners(frozenset(samples))
        return [
            GivenSignal(
                self._find(name).slot, x, slopes=samples[partners[name]] if name in partners else slopes_of(x, dt)
            )
            for name, x in samples.items()
        ]

    def _derivative_partners(self, states: frozenset[str]) -> dict[str, str]:
        """State -> the other of these states that is its derivative, found by asking the model at some point."""
        if states not in self._partners:
            found = {}
            derivatives = {v.derivative_of: v.slot for v in self.code.variables if v.derivative_of in states}
            if len(states) > 1 and derivatives:
                given = {name: 1e-3 * (1 + 0.37 * i) for i, name in enumerate(sorted(states))}
                columns = [GivenSignal(self._find(name).slot, np.array([value])) for name, value in given.items()]
                slots = list(derivatives.values())
                one = Run(Motion(GivenSignals(columns), 1, 1.0), self._settings({}))
                values = self._runner.run_all([one], slots)[0].outputs[:, 0]
                found = {
                    state: other
                    for state, slope in zip(derivatives, values, strict=True)
                    for other, value in given.items()
                    if state is not None and slope == value
                }
            self._partners[states] = found
        return self._partners[states]

    def _forward_is_exact(self, states: frozenset[str], job: _Job, names: Sequence[str]) -> bool:
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

    def _central_differences(self, job: _Job, names: Sequence[str], *, relative_step: float) -> dict[str, Array]:
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

    def _change(self, job: _Job, name: str, value: float, step: float) -> dict[str, Array]:
        high = self._run(replace(job, settings={**job.settings, name: value + step}))
        low = self._run(replace(job, settings={**job.settings, name: value - step}))
        return {output: high[output] - low[output] for output in job.outputs}


def slopes_of(samples: Array, dt: float) -> Array:
    """Time derivative (n,) of uniform samples by central differences of order four, lower at the two ends."""
    if len(samples) < 3:
        return np.full_like(samples, (samples[-1] - samples[0]) / dt if len(samples) == 2 else 0.0)
    if len(samples) < 5:
        return np.asarray(np.gradient(samples, dt, edge_order=2))
    slopes = np.empty(len(samples))
    slopes[2:-2] = (8 * (samples[3:-1] - samples[1:-3]) - (samples[4:] - samples[:-4])) / (12 * dt)
    slopes[:2] = np.gradient(samples[:4], dt, edge_order=2)[:2]
    slopes[-2:] = np.gradient(samples[-4:], dt, edge_order=2)[-2:]
    return slopes


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


def _rows(columns: Sequence[GivenSignal], rows: int | None) -> int:
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
