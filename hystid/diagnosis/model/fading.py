"""Steps of time that the inner states of a baseline need: they may fade faster than a motion is sampled, as the
bristles of a friction that slides far do."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from hystid.errors import NumericalError
from hystid.numeric import Array
from hystid.rig.terms import Model, Reading

_FADES = 2.0  # logarithm by which a state fades in one step: Runge and Kutta's method follows, and diverges from 2.8 on
_STEPS = 64  # most steps per sample: what fades faster has no memory from sample to sample
_LOOKS = 64  # samples of a motion that are looked at


def fast_samples(v: Array) -> NDArray[np.intp]:
    """Numbers of some samples of a motion, spread over its faster half."""
    half = np.argsort(-np.abs(v))[: len(v) // 2 + 1]
    return half[:: len(half) // _LOOKS + 1]


def fading_states(model: Model, reading: Reading, values: Mapping[str, float]) -> dict[str, str]:
    """Inner states whose derivative depends on themselves, with the names of these derivatives. Rate-independent ones
    are left out where nothing happens at instants: they are followed over the way, in no steps of time."""
    known = {v.derivative_of: v.name for v in model.code.variables if v.derivative_of}
    depends = model.code.dependencies
    fading = {s: d for s, d in known.items() if s not in reading.states and s in depends.get(d, ())}
    if not fading or model.code.n_indicators:
        return fading
    x = v = np.array([1e-3, -1e-3])
    away = dict.fromkeys(fading, 1e-3)  # at the start every spring follows the motion alone
    once, twice = (_slopes(model, reading, fading, (x, speed, 1.0), values, away) for speed in (v, 2 * v))
    return {s: d for (s, d), a, b in zip(fading.items(), once, twice, strict=True) if not np.array_equal(2 * a, b)}


def steps_for(
    model: Model, reading: Reading, fading: Mapping[str, str], motion: tuple[Array, Array, float],
    values: Mapping[str, float],
) -> int:  # fmt: skip
    """Runge-Kutta steps per sample in which no such state fades too far, from its start on. motion: x, v and dt."""
    dt = motion[2]
    still = _slopes(model, reading, fading, motion, values)
    sizes = dt * np.max(np.abs(still), axis=1)
    moved = _slopes(model, reading, fading, motion, values, dict(zip(fading, sizes, strict=True)))
    change = np.max(np.abs(moved - still), axis=1)
    fades = float(np.max(change[sizes > 0] / sizes[sizes > 0], initial=0.0)) * dt / _FADES
    return int(np.clip(np.ceil(fades), 1, _STEPS)) if np.isfinite(fades) else 1


def _slopes(
    model: Model, reading: Reading, fading: Mapping[str, str], motion: tuple[Array, Array, float],
    values: Mapping[str, float], moved: Mapping[str, float] | None = None,
) -> Array:  # fmt: skip
    """Derivatives of the states at their start values, or at some distance from them, along a motion; NaN where the
    law has no answer there."""
    x, v, dt = motion
    start = {s: float(model.code.variable(s).start or 0.0) + (moved or {}).get(s, 0.0) for s in fading}
    states = {**reading.motion(x, v), **{s: np.full(len(x), value) for s, value in start.items()}}
    names = [*fading.values()]
    try:
        found = model.clamp(states, reading.asked(len(x))[1], dt, parameters=values, outputs=names)
    except NumericalError:
        return np.full((len(names), len(x)), np.nan)
    return np.array([found[name] for name in names])
