"""The surrogate under validation, whichever file it came in: its force on a given motion, and its free run."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np

from hystid.compiled import CompiledModel
from hystid.errors import RecordingError, UsageError
from hystid.files import scratch
from hystid.fmu import Driver
from hystid.fmu.from_network import network_of
from hystid.networks import FurtherInput, onnx_reading, runtime
from hystid.networks.level import Level
from hystid.recording import Array, Recording
from hystid.simulation import driven
from hystid.surrogate import oscillator_code, surrogate_code
from hystid.validation.judged import start_of

Kind = Literal["onnx", "surrogate", "oscillator"]


@dataclass(frozen=True, eq=False)
class Surrogate:
    """force_block: inputs x, v; oscillator: input F. Either may be missing, not both. inputs: the further ones of both;
    for a block that does not tell, the column of a recording has the name of the input. late: states of the force block
    that follow v or a further input late; they begin settled. level: of the force, by which the states that remember
    it are scaled. parameters: of an oscillator, by its names, in place of its own values. rotational: whether it was
    trained on a rig that turns, None where the file does not tell."""

    kind: Kind
    mass: float
    sample_rate: float | None
    training_range: Mapping[str, tuple[float, float]]
    force_block: CompiledModel | Driver | None
    oscillator: CompiledModel | Driver | None
    force_states: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    inputs: tuple[FurtherInput, ...] = ()
    late: Mapping[str, str] = field(default_factory=dict)
    level: Level | None = None
    parameters: Mapping[str, float] = field(default_factory=dict)
    rotational: bool | None = None

    def further(self, record: Recording) -> dict[str, Array]:
        """Values of the further inputs, by their names. Raises RecordingError where the recording has no such column,
        or has it in another unit."""
        for port in self.inputs:
            if port.column not in record.extra:
                raise RecordingError(
                    f"{record.name}: the surrogate needs the input {port.column} [{port.unit}], which is no column of "
                    f"the recording; give its value as --input {port.column}=VALUE"
                )
            unit = record.units.get(port.column)
            if unit != port.unit and port.unit:
                raise RecordingError(
                    f"{record.name}: column {port.column} is in {unit or 'no known unit'}, but the surrogate was "
                    f"trained on it in {port.unit}"
                )
        return {port.name: record.channel(port.column) for port in self.inputs}

    def force(self, record: Recording) -> Array:
        """R on the recorded motion, from its own first force."""
        x, v, start = record.channel("x"), record.channel("v"), float(record.channel("R")[0])
        if self.force_block is not None:
            signals = {"x": x, "v": v} | self.further(record)
            first = {name: values[:1] for name, values in signals.items()}
            first |= {port.name: port.seen(first[port.name]) for port in self.inputs}
            if self.level is not None:
                further = np.stack([*(first[p.name] for p in self.inputs), *(first[s] for s in self.late.values())])
                start = float((start - self.level.centre(first["x"], further)[0]) / self.level.spread(further)[0])
            begin = dict.fromkeys(self.force_states, start)
            begin |= {state: float(first[source][0]) for state, source in self.late.items()}
            return _simulate(self.force_block, record, signals, begin, ("R",))["R"]
        assert self.oscillator is not None
        F = record.F if record.F is not None else np.zeros(len(record))
        begin = self._begin(record)
        inputs = {"F": F} | self.further(record)
        return self.oscillator.clamp({"x": x, "v": v}, inputs, record.dt, parameters=begin, outputs=("R",))["R"]

    def free_run(self, record: Recording) -> dict[str, Array]:
        """x, v, a, R of the closed loop under the recorded force. Raises NumericalError when it diverges."""
        assert self.oscillator is not None
        inputs = {"F": record.channel("F")} | self.further(record)
        if self.sample_rate is None:  # a model of differential equations; a network renews its memory at its own rate
            begin = self._begin(record)
            return driven(self.oscillator, inputs, record.t, parameters=begin, outputs=("x", "v", "a", "R"))
        return _simulate(self.oscillator, record, inputs, self._begin(record), ("x", "v", "a", "R"))

    def _begin(self, record: Recording) -> dict[str, float]:
        """Parameters that put the oscillator where the record starts, as far as it has them."""
        assert self.oscillator is not None
        known = {variable.name for variable in _variables(self.oscillator)}
        starts = {f"{name}_start": value for name, value in start_of(record).items()} | {"m": self.mass}
        return {name: value for name, value in {**starts, **self.parameters}.items() if name in known}


def _variables(block: CompiledModel | Driver) -> Sequence[Any]:
    return block.code.variables if isinstance(block, CompiledModel) else block.model.variables


def _simulate(
    block: CompiledModel | Driver,
    record: Recording,
    inputs: Mapping[str, Array],
    begin: Mapping[str, float],
    outputs: Sequence[str],
) -> dict[str, Array]:
    if isinstance(block, Driver):
        return block.simulate(record.t, inputs, parameters=begin, outputs=outputs)
    return block.simulate(
        inputs, record.dt, parameters=begin, outputs=outputs, substeps=0, start_time=float(record.t[0])
    )


def open_surrogate(path: Path, mass: float | None) -> Surrogate:
    """The surrogate in a .onnx file, a force FMU (x, v -> R) or an oscillator FMU (F -> x, R).

    mass [kg] overrides the one that the file carries; 0: no free run. Raises UsageError, NetworkError, FmuError.
    """
    if mass is not None and not 0 <= mass < np.inf:
        raise UsageError(f"--mass {mass:g}: a mass in kg of 0 or more is needed (0: F is the restoring force itself)")
    if path.suffix.lower() == ".onnx":
        return _from_network(path, mass)
    driver = Driver(path)
    driver.check_si(("F", "x", "v", "a", "R"))
    causality = {variable.name: variable.causality for variable in driver.model.variables}
    inputs = {name for name, kind in causality.items() if kind == "input"}
    if {"x", "v"} <= inputs and "F" not in inputs and causality.get("R") == "output":
        return _from_surrogate_fmu(path, driver, mass)
    if "F" in inputs and not {"x", "v"} & inputs and {"x", "R"} <= set(causality):
        return _from_oscillator_fmu(path, driver, mass)
    raise UsageError(
        f"{path}: a surrogate has inputs x, v and output R, or input F and outputs x, v, a, R, and perhaps further "
        f"inputs; this FMU has the inputs {', '.join(sorted(inputs)) or 'none'}"
    )


def _from_network(path: Path, mass: float | None) -> Surrogate:
    _, about = onnx_reading.read(path)
    kilograms = about.mass if mass is None else mass
    oscillator = CompiledModel(oscillator_code(path, mass=kilograms)) if kilograms else None
    states = tuple(f"state[{slot + 1}]" for slot in about.force_slots)
    block, dt = CompiledModel(surrogate_code(path)), 1 / about.sample_rate
    why = runtime.check(
        path.read_bytes(),
        path,
        about.training_range,
        about.initial_state,
        lambda signals: block.simulate(signals, dt, outputs=("R",), substeps=0)["R"],
    )
    return Surrogate(
        "onnx",
        kilograms,
        about.sample_rate,
        about.training_range,
        block,
        oscillator,
        states,
        notes=(f"ONNX Runtime cannot run the file, which is checked by our own code alone: {why}",) if why else (),
        inputs=about.inputs,
        late={f"state[{slot + 1}]": source for slot, source in about.late.items()},
        level=about.level,
        rotational=about.rotational,
    )


def _from_surrogate_fmu(path: Path, driver: Driver, mass: float | None) -> Surrogate:
    with scratch() as folder:
        network = network_of(path, folder)
        if network is not None:
            note = (
                "the closed loop runs the network that the FMU carries, integrated with the mass as oscillator.fmu does"
            )
            inner = _from_network(network, mass)
            return replace(
                inner, kind="surrogate", force_block=driver, notes=(*inner.notes, *((note,) if inner.mass else ()))
            )
    note = "no free run: this FMU carries no network of ours; give the oscillator's FMU for one"
    return Surrogate("surrogate", mass or 0.0, None, {}, driver, None, notes=(note,), inputs=_inputs_of(driver))


def _from_oscillator_fmu(path: Path, driver: Driver, mass: float | None) -> Surrogate:
    own = next((v.start for v in driver.model.variables if v.name == "m" and v.start is not None), None)
    kilograms = mass if mass is not None else own
    if not kilograms:
        raise UsageError(
            f"{path}: the mass is needed to compare forces, and the FMU has no parameter m: give it by --mass"
        )
    rate, limits, further, turns = None, {}, _inputs_of(driver), None
    with scratch() as folder:
        network = network_of(path, folder)
        if network is not None:
            _, about = onnx_reading.read(network)
            rate, limits, further = about.sample_rate, dict(about.training_range), about.inputs
            turns = about.rotational
    return Surrogate("oscillator", kilograms, rate, limits, None, driver, inputs=further, rotational=turns)


def _inputs_of(driver: Driver) -> tuple[FurtherInput, ...]:
    """Inputs of an FMU besides force and motion."""
    return tuple(
        FurtherInput(v.name, v.unit or "", v.name)
        for v in driver.model.variables
        if v.causality == "input" and v.name not in ("F", "x", "v")
    )
