"""A force into an FMU, a recording out."""

from __future__ import annotations

import difflib
import os
from collections.abc import Mapping, Sequence
from numbers import Real
from pathlib import Path

import numpy as np

from hystid.compiled import CompiledModel, slopes_of
from hystid.errors import FmuError, UsageError
from hystid.excitation import is_specification, parse
from hystid.files import file_named
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
    if not (isinstance(dt, Real) and np.isfinite(dt) and dt > 0):
        raise UsageError(f"--dt {dt}: a time step in s of more than 0 is needed")
    force = parse(text).force(dt, seed)
    seeded = f" (seed {seed})" if text.startswith("multisine") else ""
    t = dt * np.arange(force.size, dtype=np.float64)
    return Recording(text, t, F=force, origin={"F": text}, notes=(f"force {text}{seeded}",))


def simulate(
    fmu: str | os.PathLike[str] | Driver,
    force: str | Path | Recording,
    *,
    parameters: Mapping[str, float] | None = None,
    dt: float = 1e-4,
    noise_snr: float | None = None,
    seed: int = 0,
) -> Recording:
    """The answer of an FMU with input F to a force: t, F, x, v, a, R on the force's time grid.

    force: a recording that holds F, a file of one, or a specification such as "harmonic:20Hz@80N,2s" at step dt [s].
    parameters: name -> value in SI units; the FMU gets it in the unit that it states. noise_snr [dB]: white noise on F,
    x, v and a (``processing.add_noise``); R has to be computed from them then. Channels that the FMU does not put out
    stay None.
    Raises FmuError (no input F, unknown parameter), NumericalError (no finite answer).

    >>> import hystid
    >>> fmu = hystid.build("HystId.Oscillators.Linear", "linear.fmu", parameters={"m": 1.0, "B": 10.0, "Kl": 1e4})
    >>> answer = hystid.simulate(fmu, "harmonic:5Hz@100N,2s", dt=1e-3)
    >>> round(float(abs(answer.x[1000:]).max()), 4)  # 100 N / |1e4 - 31.4^2 + 314j| N/m
    0.0111
    """
    force = force if isinstance(force, Recording) else force_of(force, dt, seed)
    driver = fmu if isinstance(fmu, Driver) else Driver(file_named(fmu, "an FMU"))
    settings = driver.from_si(parameters or {})
    check_parameters(driver, settings)
    variables = {variable.name: variable.causality for variable in driver.model.variables}
    if variables.get("F") != "input":
        inputs = ", ".join(name for name, causality in variables.items() if causality == "input") or "none"
        raise FmuError(f"{driver.path.name} has no input F [N] to drive it by; its inputs are {inputs}")
    outputs = [name for name in _OUTPUTS if variables.get(name) in ("output", "local")]
    driver.check_si(("F", *outputs))
    found = driver.simulate(force.t, {"F": force.channel("F")}, parameters=settings, outputs=outputs)
    answer = _recording(driver, force, settings, found)
    return answer if noise_snr is None else add_noise(answer, noise_snr, seed)


SUBSTEPS = 4  # per sample: with a cubic force 6e-4 of the displacement at five samples per period


def driven(
    block: CompiledModel | Driver,
    inputs: Mapping[str, Array],
    t: Array,
    *,
    parameters: Mapping[str, float] | None = None,
    outputs: Sequence[str],
    substeps: int = SUBSTEPS,
) -> dict[str, Array]:
    """A model under recorded inputs: name -> samples (n,) at the uniform times t [s]. Returns output -> (n,).

    The inputs are cubics between their samples, with ``substeps`` steps in each, for a compiled model and for an FMU
    alike: an FMU, which takes its inputs as straight lines, gets them on the finer grid. Errors: of the block.
    """
    dt = float((t[-1] - t[0]) / (len(t) - 1))
    settings = dict(parameters or {})
    if isinstance(block, CompiledModel):
        return block.simulate(
            inputs, dt, parameters=settings, outputs=outputs, interpolation="cubic", substeps=substeps,
            start_time=float(t[0]),
        )  # fmt: skip
    from scipy.interpolate import CubicHermiteSpline

    fine = t[0] + dt / substeps * np.arange((len(t) - 1) * substeps + 1)
    finer = {name: CubicHermiteSpline(t, values, slopes_of(values, dt))(fine) for name, values in inputs.items()}
    found = block.simulate(fine, finer, parameters=settings, outputs=outputs)
    return {name: values[::substeps] for name, values in found.items()}


def check_parameters(driver: Driver, parameters: Mapping[str, float]) -> None:
    """Raise UsageError for a name that is no parameter of the FMU (with near matches) or a value out of its range."""
    known = {v.name: v for v in driver.model.variables if v.causality == "parameter"}
    for name, value in parameters.items():
        if name not in known:
            near = difflib.get_close_matches(name, known, n=3, cutoff=0.5)
            near += [other for other in known if other.lower() == name.lower() and other not in near]
            hint = f"did you mean {' or '.join(near)}?" if near else f"it has {', '.join(known) or 'none'}"
            raise UsageError(f"{driver.path.name} has no parameter '{name}': {hint}")
        low, high = known[name].limits
        if value < low or value > high:
            raise UsageError(
                f"{driver.path.name}: parameter {driver.shown({name: value})} is outside its range [{low:g}, {high:g}]"
            )


def _recording(
    driver: Driver, force: Recording, parameters: Mapping[str, float], found: Mapping[str, Array]
) -> Recording:
    note = f"simulated with {driver.path.name}" + (f" ({driver.shown(parameters)})" if parameters else "")
    further = [v.name for v in driver.model.variables if v.causality == "input" and v.name != "F"]
    unset = (f"inputs at their start values: {', '.join(further)}",) if further else ()
    origin = {"F": force.origin.get("F", "measured"), **dict.fromkeys(found, "simulated")}
    return Recording(
        force.name,
        force.t,
        F=force.channel("F"),
        origin=origin,
        notes=(*force.notes, note, *unset),
        warnings=force.warnings,
        rotational=force.rotational or driver.model.variable("F").unit == "N.m",
    ).with_channels(found)
