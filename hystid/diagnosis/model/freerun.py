"""Free run: the model is driven by the measured force alone; what counts is the displacement that it finds."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from hystid.compiled import CompiledModel, Motion
from hystid.diagnosis.prepare.segments import Part
from hystid.errors import NumericalError
from hystid.numeric import Array
from hystid.rig.terms import Model, starts_of

SUBSTEPS = 4  # Runge-Kutta steps per sample: with a cubic force 6e-4 of the displacement at five samples per period
_WRAP = 3.0  # steps of a channel, from its last sample to its first, within which a recording closes on itself
_FAR = 1e3  # times the largest displacement, beyond which a run has diverged
_UNREST = 0.05  # share of the rms that the first sample must show for a recording to begin in motion


def free_run(model: Model, part: Part, values: Mapping[str, float], delay: float = 0.0) -> Array | None:
    """Displacement [m], shape (n,), of the model under the measured force; None where it has no finite answer.

    values: parameters of the model. delay [samples]: fault of the force channel that is taken out.
    The force is a cubic between its samples. The run begins with the measured state; inner states begin at their start
    values. A recording that closes on itself may be one period of a steady motion, whose inner states at the start
    nobody knows: the model then also runs through it twice, and the second pass counts where it is the closer one.
    """
    first = run_from(model, part, values, delay)
    if first is None or not may_be_steady(model, part):
        return first
    second = run_from(model, part, values, delay, periods=2)
    if second is None:
        return first
    return min((first, second), key=lambda run: float(np.mean((run - _reference(part)) ** 2)))


def run_from(
    model: Model, part: Part, values: Mapping[str, float], delay: float = 0.0, periods: int = 1
) -> Array | None:
    """The last of a number of passes through a recording; None where it diverges."""
    force = part.force_advanced(delay)
    settings = {**start_of(model, part), **values}
    inputs = {"F": np.tile(force, periods)}
    try:
        found = model.simulate(
            inputs, part.dt, parameters=settings, outputs=("x",), interpolation="cubic", substeps=SUBSTEPS
        )
    except NumericalError:
        return None
    x = found["x"][-len(force) :]
    return None if diverges(x, part) else x


def runs_from(
    model: CompiledModel, motions: Sequence[Motion], settings: Sequence[Mapping[str, float]]
) -> list[Array] | None:
    """Displacements [m] under ``driven`` forces, all in one call; None where one of them has no finite answer."""
    try:
        return [found["x"] for found in model.follow(motions, settings, ("x",))]
    except NumericalError:
        return None


def driven(
    model: CompiledModel,
    part: Part,
    delay: float = 0.0,
    *,
    periods: int = 1,
    rows: int | None = None,
    substeps: int = SUBSTEPS,
) -> Motion:
    """The force of ``run_from``, made ready for many runs: of the first ``rows`` samples, for so many passes."""
    force = np.tile(part.force_advanced(delay)[:rows], periods)
    return model.motion({}, {"F": force}, part.dt, interpolation="cubic", substeps=substeps)


def diverges(x: Array, part: Part) -> bool:
    """Whether a simulated displacement leaves the measured one by orders of magnitude."""
    return not float(np.max(np.abs(x))) < _FAR * float(np.max(np.abs(part.x)))


def may_be_steady(model: Model, part: Part) -> bool:
    """Whether a recording may be one period of a steady motion, of a model with inner states."""
    return len(model.code.states) > 2 and _closes(part)


def _closes(part: Part) -> bool:
    """Whether the last sample runs on into the first one, and the recording begins in motion."""
    steady = []
    for channel in (part.F, part.x, part.v):
        step = float(np.sqrt(np.mean(np.diff(channel) ** 2)))
        steady.append(abs(float(channel[0] - channel[-1])) < _WRAP * step)
    moving = [abs(float(c[0])) > _UNREST * float(np.std(c)) for c in (part.F, part.x, part.v)]
    return all(steady) and sum(moving) > 1


def start_of(model: Model, part: Part) -> dict[str, float]:
    """Settings that make a model begin with the measured state: parameters for it, or else the states themselves."""
    return dict(zip(starts_of(model.code), (float(part.x[0]), float(part.v[0])), strict=True))


def error(simulated: Array | None, part: Part) -> float | None:
    """NRMSE of the displacement against the measured one; where x was not measured, against the smoothed one, without
    the slow motion that no channel shows."""
    if simulated is None:
        return None
    reference = _reference(part)
    off = simulated - reference
    if part.lowest:
        reference, off = (u - part.slow(u) for u in (reference, off))
    spread = float(np.std(reference))
    return float(np.sqrt(np.mean(off**2))) / spread if spread > 0 else None


def _reference(part: Part) -> Array:
    return part.measured.get("x", part.x)


def errors(
    model: Model | None, parts: Sequence[Part], values: Mapping[str, float], delay: float = 0.0
) -> list[tuple[Array | None, float | None]]:
    """Free run and its error for several recordings."""
    if model is None or not values.get("m", 1.0):
        return [(None, None) for _ in parts]
    runs = [free_run(model, part, values, delay) for part in parts]
    return [(run, error(run, part)) for run, part in zip(runs, parts, strict=True)]
