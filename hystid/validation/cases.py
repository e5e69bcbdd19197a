"""Running a surrogate through its cases and measuring it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from hystid.comparison import harmonics, mse
from hystid.consistency import admit
from hystid.errors import HystidError, NumericalError, RecordingError, UsageError
from hystid.excitation import is_specification, parse
from hystid.files import write_json
from hystid.fmu import Driver
from hystid.processing import Band, prepare
from hystid.recording import Array, Recording, Sources, loaded, own_mass
from hystid.simulation import force_of, simulate
from hystid.validation.cases_compared import FreeRun, Levels, Validation, ValidationCase
from hystid.validation.judged import force_error, run_errors
from hystid.validation.stability import stability
from hystid.validation.surrogate import Surrogate, open_surrogate

_SHORTEST = 50
"""Fewest samples of a recording that is worth comparing."""
HARMONICS = 10
RUNAWAY = 100.0
"""A free run further out than this many times the reference's greatest displacement has diverged."""
_STEP = 1e-4  # s of a force for a surrogate without a sample rate of its own


def validate(
    surrogate: str | Path,
    recordings: Sources = (),
    *,
    reference: str | Path | None = None,
    forces: Sequence[str] = (),
    mass: float | None = None,
    dt: float | None = None,
    band: Band | None = None,
    decimate: int = 1,
    out: Path | None = None,
) -> Validation:
    """Compare a surrogate with recordings, or with a reference FMU under given forces.

    surrogate: surrogate.onnx, surrogate.fmu (x, v -> R) or oscillator.fmu (F -> x, v, a, R). recordings: measured
    tests; band [Hz] and decimate: their processing (``processing.prepare``). reference: FMU with input F; forces: what
    drives it, specifications at step dt [s] (None: that of the surrogate's samples, else 0.1 ms) or files. mass [kg]:
    instead of the surrogate's own. out: folder for validation.json. Both sides start with the same x, v and restoring
    force.

    A free run that diverges is a result (``ValidationCase.diverged``). Raises UsageError (nothing to compare with,
    sample rates that do not fit), RecordingError (no x, too short), NetworkError and FmuError (a file beyond use).

    >>> import hystid
    >>> fmu = hystid.build("HystId.Oscillators.Jenkins", "jenkins.fmu")
    >>> sweep = hystid.simulate(fmu, "chirp:0-60Hz@60N,2s", dt=4e-4, noise_snr=40)
    >>> folder = hystid.identify(sweep, mass=1.0, ensemble=2, method="published", workers=1).save("model")
    >>> check = hystid.validate(folder / "surrogate.fmu", reference=fmu, forces=["harmonic:20Hz@50N,1s"])
    >>> float(check.figures("force_nrmse")[0]) < 0.2
    True
    """
    recordings, reference = loaded(recordings), Path(reference) if reference else None
    if bool(recordings) == bool(reference):
        raise UsageError("a surrogate is validated against either recordings or a reference FMU")
    if reference and not forces:
        raise UsageError(f"{reference}: a reference FMU needs a force to be driven by, as harmonic:20Hz@80N,2s")
    model = open_surrogate(Path(surrogate), mass)
    if reference and model.inputs:
        names = ", ".join(port.column for port in model.inputs)
        raise UsageError(
            f"{surrogate}: it has further inputs ({names}), which a force alone does not give; write the answer of "
            f"{reference} by hystid simulate, and compare with that: --input {model.inputs[0].column}=VALUE"
        )
    if reference:
        driver, step = Driver(reference), dt or (1 / model.sample_rate if model.sample_rate else _STEP)
        prepared = [prepare(simulate(driver, force_of(force, step)), mass=model.mass) for force in forces]
    else:
        admitted = admit(recordings, model.mass)
        prepared = [
            prepare(recording, band=band, decimate=decimate, mass=own_mass(recording, model.mass))
            for recording in admitted
        ]
    cases = tuple(compare(model, record) for record in prepared)
    result = Validation(
        Path(surrogate),
        model.kind,
        reference,
        model.mass,
        model.sample_rate,
        model.training_range,
        cases,
        model.notes,
        stability(model),
        model.inputs,
    )
    if out is None:
        return result
    result = replace(result, files={"json": Path(out) / "validation.json"})
    write_json(result.files["json"], result.as_dict())
    return result


def compare(model: Surrogate, record: Recording) -> ValidationCase:
    """One recording against the surrogate: force on the recorded motion and, where F and a mass are there, free run."""
    model = replace(model, mass=own_mass(record, model.mass))
    notes = _check(model, record)
    R = record.channel("R")
    force = model.force(record)
    case = ValidationCase(
        record.name,
        record,
        force,
        force_error(record, force),
        mse(force, R),
        outside=_outside(model, record),
        notes=notes,
    )
    if model.oscillator is None or not model.mass:
        return _with_levels(case)
    if record.F is None:
        return _with_levels(replace(case, notes=(*notes, "no free run: the recording has no channel F")))
    try:
        found = model.free_run(record)
        _watch(found["x"], record)
    except NumericalError as error:
        return _with_levels(replace(case, diverged=str(error)))
    errors = run_errors(record, found)
    ends = (errors["x_nrmse"], errors["R_nrmse"], errors["x_mse"], errors["R_mse"])
    return _with_levels(replace(case, free_run=FreeRun(found["x"], found["v"], found["a"], found["R"], *ends)))


def _check(model: Surrogate, record: Recording) -> tuple[str, ...]:
    if len(record) < _SHORTEST:
        raise RecordingError(
            f"{record.name}: {len(record)} samples are too few to compare, at least {_SHORTEST} are needed"
        )
    if model.rotational is not None and model.rotational != record.rotational:
        kinds = {True: "a rig that turns (N.m, rad)", False: "one that does not (N, m)"}
        here, there = kinds[record.rotational], kinds[model.rotational]
        raise UsageError(
            f"{record.name} is of {here}, and the surrogate was trained on {there}: give recordings of its own rig"
        )
    notes = _balance(model, record)
    if model.sample_rate is None:
        return tuple(notes)
    ratio = record.sample_rate / model.sample_rate
    trained = f"the surrogate was trained at {model.sample_rate:.6g} Hz"
    rates = f"{record.name} is sampled at {record.sample_rate:.6g} Hz, {trained}"
    if not 0.2 < ratio < 5.5:
        raise UsageError(f"{rates}: bring them closer together (--decimate, --dt)")
    if abs(ratio - 1) >= 0.01:
        notes.append(f"{rates}; its memory finds turning points on a finer or coarser grid than it learnt them")
    return tuple(notes)


def _balance(model: Surrogate, record: Recording) -> list[str]:
    """m a + R = F, where all of them are known independently of each other."""
    if record.F is None or record.a is None or record.R is None or not model.mass:
        return []
    spread, error = float(np.std(record.R)), float(np.std(record.F - model.mass * record.a - record.R))
    if error <= 0.02 * spread:
        return []
    return [
        f"m a + R differs from F by {error:.3g} N rms (R: {spread:.3g} N) with m = {model.mass:g} kg: "
        "is this the reference's mass?"
    ]


def _outside(model: Surrogate, record: Recording) -> float:
    beyond = np.zeros(len(record), dtype=bool)
    signals = {"x": record.channel("x"), "v": record.channel("v")} | model.further(record)
    for name in signals:
        if name in model.training_range:
            low, high = model.training_range[name]
            values = signals[name]
            beyond |= (values < low) | (values > high)
    return float(np.mean(beyond))


def _watch(x: Array, record: Recording) -> None:
    limit = RUNAWAY * float(np.max(np.abs(record.channel("x"))))
    away = np.flatnonzero(np.abs(x) > limit)
    if away.size:
        k = int(away[0])
        raise NumericalError(
            f"the free run diverged: x = {x[k]:.3g} m at t = {record.t[k]:.6g} s is more than {RUNAWAY:g} times as far "
            "out as the reference ever was"
        )


def _with_levels(case: ValidationCase) -> ValidationCase:
    tone = _fundamental(case.reference)
    if tone is None:
        return case
    half, dt = slice(len(case.reference) // 2, None), case.reference.dt
    signals = (case.reference.channel("R"), case.force, case.free_run.R if case.free_run else None)
    try:
        found = [None if s is None else harmonics(s[half], dt, tone, count=HARMONICS) for s in signals]
    except HystidError:  # fewer than two periods in the second half: there is no steady state to speak of
        return case
    assert found[0] is not None and found[1] is not None
    return replace(case, levels=Levels(found[0], found[1], found[2]))


def _fundamental(record: Recording) -> float | None:
    """Frequency [Hz] of the one tone that the force, or the motion where F is missing, consists of; None if of more.

    From the excitation's specification where the record is called after one, else the tallest line of the spectrum,
    refined by least squares, if that line and its harmonics leave less than a fifth (rms) unexplained.
    """
    if is_specification(record.name):
        asked = parse(record.name)
        return asked.low if asked.kind == "harmonic" else None
    signal = record.F if record.F is not None else record.channel("x")
    half = signal[len(signal) // 2 :] - np.mean(signal[len(signal) // 2 :])
    lines = np.abs(np.fft.rfft(half * np.hanning(half.size)))
    line, width = int(np.argmax(lines)), 1 / (half.size * record.dt)
    if not 3 <= line <= half.size // 2 - 2:  # too slow for the record, or noise at the end of the band
        return None
    from scipy.optimize import minimize_scalar

    def unexplained(frequency: float) -> float:
        return harmonics(half, record.dt, frequency, count=5).residual

    best = minimize_scalar(unexplained, bounds=((line - 0.7) * width, (line + 0.7) * width), method="bounded")
    return float(best.x) if best.fun < 0.2 * float(np.std(half)) else None
