"""A force into an FMU, a recording out."""

from __future__ import annotations

import difflib
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from hystid.errors import FmuError, UsageError
from hystid.excitation import is_specification, parse
from hystid.fmu import Driver
from hystid.processing import add_noise
from hystid.recording import Array, Recording, read

_OUTPUTS = ("x", "v", "a", "R")


def force_of(source: str | Path, dt: float = 1e-4, seed: int = 0) -> Recording:
    """A recording that holds t and F alone: from a specification at step dt [s], or from a file's force and time.

    seed: of a multisine's phases. Raises UsageError for a specification, RecordingError for a file that is wrong.
    """
    text = str(source)
    if not is_specification(text):
        if not Path(text).exists() and ":" in text:
            parse(text)  # meant as a specification: its sentence helps more than "no such file"
        file = read(text, motion=False)
        return Recording(file.name, file.t, F=file.channel("F"), notes=file.notes, warnings=file.warnings)
    if not (np.isfinite(dt) and dt > 0):
        raise UsageError(f"--dt {dt:g}: a time step in s of more than 0 is needed")
    force = parse(text).force(dt, seed)
    seeded = f" (seed {seed})" if text.startswith("multisine") else ""
    t = dt * np.arange(force.size, dtype=np.float64)
    return Recording(text, t, F=force, origin={"F": text}, notes=(f"force {text}{seeded}",))


def simulate(
    fmu: str | Path | Driver,
    force: Recording,
    *,
    parameters: Mapping[str, float] | None = None,
    noise_snr: float | None = None,
    seed: int = 0,
) -> Recording:
    """The answer of an FMU with input F to a force: t, F, x, v, a, R on the force's time grid.

    parameters: name -> value in SI units. noise_snr [dB]: white noise on F, x, v and a (``processing.add_noise``);
    R has to be computed from them then. Channels that the FMU does not put out stay None.
    Raises FmuError (no input F, unknown parameter), NumericalError (no finite answer).
    """
    driver = fmu if isinstance(fmu, Driver) else Driver(fmu)
    check_parameters(driver, parameters or {})
    variables = {variable.name: variable.causality for variable in driver.model.variables}
    if variables.get("F") != "input":
        inputs = ", ".join(name for name, causality in variables.items() if causality == "input") or "none"
        raise FmuError(f"{driver.path.name} has no input F [N] to drive it by; its inputs are {inputs}")
    outputs = [name for name in _OUTPUTS if variables.get(name) in ("output", "local")]
    found = driver.simulate(force.t, {"F": force.channel("F")}, parameters=parameters, outputs=outputs)
    answer = _recording(driver, force, parameters or {}, found)
    return answer if noise_snr is None else add_noise(answer, noise_snr, seed)


def check_parameters(driver: Driver, parameters: Mapping[str, float]) -> None:
    """Raise UsageError for a name that is no parameter of the FMU (with near matches) or a value out of its range."""
    known = {v.name: v for v in driver.model.variables if v.causality == "parameter"}
    for name, value in parameters.items():
        if name not in known:
            near = difflib.get_close_matches(name, known, n=3, cutoff=0.5)
            near += [other for other in known if other.lower() == name.lower() and other not in near]
            hint = f"did you mean {' or '.join(near)}?" if near else f"it has {', '.join(known) or 'none'}"
            raise UsageError(f"{driver.path.name} has no parameter '{name}': {hint}")
        low, high = known[name].min, known[name].max
        if (low is not None and value < low) or (high is not None and value > high):
            limits = f"[{'-inf' if low is None else f'{low:g}'}, {'inf' if high is None else f'{high:g}'}]"
            raise UsageError(f"{driver.path.name}: parameter {name} = {value:g} is outside its range {limits}")


def _recording(
    driver: Driver, force: Recording, parameters: Mapping[str, float], found: Mapping[str, Array]
) -> Recording:
    settings = ", ".join(f"{name} = {value:.10g}" for name, value in parameters.items())
    note = f"simulated with {driver.path.name}" + (f" ({settings})" if settings else "")
    origin = {"F": force.origin.get("F", "measured"), **dict.fromkeys(found, "simulated")}
    return Recording(
        force.name,
        force.t,
        F=force.channel("F"),
        x=found.get("x"),
        v=found.get("v"),
        a=found.get("a"),
        R=found.get("R"),
        origin=origin,
        notes=(*force.notes, note),
        warnings=force.warnings,
    )
