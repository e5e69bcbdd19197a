"""The surrogate under validation, whichever file it came in: its force on a given motion, and its free run."""

from __future__ import annotations

import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from hystid.compiled import CompiledModel
from hystid.errors import UsageError
from hystid.fmu import Driver
from hystid.networks import onnx
from hystid.recording import Array, Recording
from hystid.surrogate import oscillator_code, surrogate_code
from hystid.surrogate.restoring_force import NETWORK, force_slots
from hystid.validation.result import Kind


@dataclass(frozen=True, eq=False)
class Surrogate:
    """force_block: inputs x, v; oscillator: input F. Either may be missing, not both."""

    kind: Kind
    mass: float
    sample_rate: float | None
    training_range: Mapping[str, tuple[float, float]]
    force_block: CompiledModel | Driver | None
    oscillator: CompiledModel | Driver | None
    force_states: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()

    def force(self, record: Recording) -> Array:
        """R on the recorded motion, from its own first force."""
        x, v, start = record.channel("x"), record.channel("v"), float(record.channel("R")[0])
        if self.force_block is not None:
            begin = dict.fromkeys(self.force_states, start)
            return _simulate(self.force_block, record, {"x": x, "v": v}, begin, ("R",))["R"]
        assert self.oscillator is not None
        F = record.F if record.F is not None else np.zeros(len(record))
        begin = self._begin(record)
        return self.oscillator.clamp({"x": x, "v": v}, {"F": F}, record.dt, parameters=begin, outputs=("R",))["R"]

    def free_run(self, record: Recording) -> dict[str, Array]:
        """x, v, a, R of the closed loop under the recorded force. Raises NumericalError when it diverges."""
        assert self.oscillator is not None
        inputs = {"F": record.channel("F")}
        return _simulate(self.oscillator, record, inputs, self._begin(record), ("x", "v", "a", "R"))

    def _begin(self, record: Recording) -> dict[str, float]:
        """Parameters that put the oscillator where the record starts, as far as it has them."""
        assert self.oscillator is not None
        known = {variable.name for variable in _variables(self.oscillator)}
        starts = {f"{name}_start": float(record.channel(name)[0]) for name in ("x", "v", "R")} | {"m": self.mass}
        return {name: value for name, value in starts.items() if name in known}


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
    causality = {variable.name: variable.causality for variable in driver.model.variables}
    inputs = {name for name, kind in causality.items() if kind == "input"}
    if inputs == {"x", "v"} and causality.get("R") == "output":
        return _from_surrogate_fmu(path, driver, mass)
    if inputs == {"F"} and {"x", "R"} <= set(causality):
        return _from_oscillator_fmu(path, driver, mass)
    raise UsageError(
        f"{path}: a surrogate has inputs x, v and output R, or input F and outputs x, v, a, R; "
        f"this FMU has the inputs {', '.join(sorted(inputs)) or 'none'}"
    )


def _from_network(path: Path, mass: float | None) -> Surrogate:
    _, about = onnx.read(path)
    kilograms = about.mass if mass is None else mass
    oscillator = CompiledModel(oscillator_code(path, mass=kilograms)) if kilograms else None
    states = tuple(f"state[{slot + 1}]" for slot in force_slots(about))
    return Surrogate(
        "onnx",
        kilograms,
        about.sample_rate,
        about.training_range,
        CompiledModel(surrogate_code(path)),
        oscillator,
        states,
    )


def _from_surrogate_fmu(path: Path, driver: Driver, mass: float | None) -> Surrogate:
    with TemporaryDirectory() as folder:
        network = _network_inside(path, Path(folder))
        if network is not None:
            note = (
                "the closed loop runs the network that the FMU carries, integrated with the mass as oscillator.fmu does"
            )
            inner = _from_network(network, mass)
            return replace(inner, kind="surrogate", force_block=driver, notes=(note,) if inner.mass else ())
    note = "no free run: this FMU carries no network of ours; give the oscillator's FMU for one"
    return Surrogate("surrogate", mass or 0.0, None, {}, driver, None, notes=(note,))


def _from_oscillator_fmu(path: Path, driver: Driver, mass: float | None) -> Surrogate:
    own = next((v.start for v in driver.model.variables if v.name == "m" and v.start is not None), None)
    kilograms = mass if mass is not None else own
    if not kilograms:
        raise UsageError(
            f"{path}: the mass is needed to compare forces, and the FMU has no parameter m: give it by --mass"
        )
    rate, limits = None, {}
    with TemporaryDirectory() as folder:
        network = _network_inside(path, Path(folder))
        if network is not None:
            _, about = onnx.read(network)
            rate, limits = about.sample_rate, dict(about.training_range)
    return Surrogate("oscillator", kilograms, rate, limits, None, driver)


def _network_inside(fmu: Path, folder: Path) -> Path | None:
    with zipfile.ZipFile(fmu) as archive:
        if f"resources/{NETWORK}" not in archive.namelist():
            return None
        (folder / NETWORK).write_bytes(archive.read(f"resources/{NETWORK}"))
    return folder / NETWORK
