"""Is the measurement chain sound: do x, v and a describe one motion, and does a channel stop at a level?

Sensor faults keep their signature in units of the signal: a shift in time, a level that is never passed. They are
looked for before any physics is, and taken out where they can be.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations, pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.signal import csd, welch

from hystid.diagnosis.noise import noise_level
from hystid.diagnosis.parts import FIRST, advanced, measured_motion, stencil
from hystid.diagnosis.smoothing import smooth
from hystid.recording import Recording

Array = NDArray[np.float64]
_ORDER = {"x": 0, "v": 1, "a": 2}
_TOUCH = 0.01  # share of the largest force (or stroke) that counts as nothing
_RISE = 0.3  # share of the largest force over which the first rise is taken as a line
_STEP, _SEAT = 0.002, 0.2  # shares of the stroke between which an approach lies
_SAME_SPEED = 1.4  # fastest over slowest stroke of one direction
_STRAIGHT = 0.02  # deviation of a stroke from a line over its length: a sine has 0.042, a triangle less than 0.01
# What needs a measured time and several speeds: without them these laws cannot be told from dry friction.
TIMED = frozenset({"added_mass", "displacement_dependent_damping", "hidden_mode", "impact", "quadratic_damping",
                   "stribeck_friction", "viscoelastic_relaxation"})  # fmt: skip
_HALF = 0.025  # samples about a half
_SHIFTED = 0.25  # samples: differences below this come from filters and rounding


@dataclass(frozen=True)
class Fault:
    """A fault of one channel. size: delay in samples, or the level at which the channel stops (its unit).

    share: share of the samples that it touches; z: size over its standard error.
    """

    id: str
    channel: str
    size: float
    stderr: float
    share: float = 1.0


@dataclass(frozen=True)
class Lag:
    """How much later channel ``late`` is than ``early`` [samples], with standard error."""

    late: str
    early: str
    lag: float
    stderr: float


def shifted(recording: Recording, channel: str, samples: float) -> Recording:
    """Copy with one channel moved earlier by a number of samples (band-limited interpolation, mirrored ends)."""
    moved = {channel: advanced(np.asarray(getattr(recording, channel)), samples)}
    return replace(recording, **moved)  # type: ignore[arg-type]  # the keys are channels


def seated(recording: Recording) -> Recording:
    """A quasi-static test on one side of zero, from the contact on: x counts from there.

    Testing machines begin a little before they touch. Where the force stays at nothing over the first (and last) few
    per cent of a stroke that starts at zero, these samples say nothing about the structure and are left out. Play that
    is run through in the middle of a test belongs to the structure and stays.
    """
    if not recording.quasi_static or recording.x is None or recording.F is None:
        return recording
    x, force = recording.x, recording.F
    top, load = float(np.max(np.abs(x))), float(np.max(np.abs(force)))
    side = 1.0 if np.max(x) > -np.min(x) else -1.0
    loaded = np.abs(force) > _TOUCH * load
    if np.min(side * x) < -_TOUCH * top or not np.any(loaded):
        return recording
    first, last = int(np.argmax(loaded)), len(loaded) - int(np.argmax(loaded[::-1]))
    gap = _contact(side * x[first:last], np.abs(force[first:last]), load)
    if not _STEP * top < gap < _SEAT * top or first < 2 or not np.all(loaded[first:last]):
        return recording
    kept = slice(first, last)
    cut = {name: getattr(recording, name)[kept] for name in "Fxva" if getattr(recording, name) is not None}
    cut["x"] = cut["x"] - side * gap
    note = f"{recording.name}: no force over the first {1e3 * gap:.3g} mm, left out as approach; x counts from contact"
    extra = {name: values[kept] for name, values in recording.extra.items()}
    R = None if recording.R is None else recording.R[kept]
    return replace(recording, t=recording.t[kept], R=R, extra=extra, notes=(*recording.notes, note), **cut)


def _contact(x: Array, force: Array, load: float) -> float:
    """Displacement at which a line through the first part of the rising force has no force."""
    rising = force < _RISE * load
    slope, level = np.polyfit(x[rising], force[rising], 1) if np.count_nonzero(rising) > 4 else (0.0, 0.0)
    return float(-level / slope) if slope > 0 else 0.0


def one_speed(motions: Sequence[Array]) -> bool:
    """Whether displacements (n,) run along straight lines, at one speed each way: nothing tells rate from direction."""
    bent, slopes = [], []
    for x in motions:
        thin = x[:: max(1, len(x) // 5000)]
        at = turns(thin)
        for first, last in pairwise(at):
            if last - first > 8:
                index = np.arange(first, last + 1)
                line = np.polyfit(index, thin[first : last + 1], 1)
                bent.append(float(np.std(thin[first : last + 1] - np.polyval(line, index))) / abs(np.ptp(thin[index])))
                slopes.append(float(line[0]) * len(thin) / len(x))
    each_way = [[abs(s) for s in slopes if s * way > 0] for way in (1.0, -1.0)]
    steady = all(speeds and max(speeds) < _SAME_SPEED * min(speeds) for speeds in each_way)
    return steady and float(np.median(bent)) < _STRAIGHT


def turns(x: Array, share: float = 0.25) -> list[int]:
    """Samples at which a displacement turns by more than a share of its range."""
    least = share * float(np.ptp(x))
    found, best, way = [], 0, 0
    for k in range(1, len(x)):
        if way == 0:
            way = int(np.sign(x[k] - x[0])) if abs(x[k] - x[0]) > least else 0
            best = k
        elif way * (x[k] - x[best]) > 0:
            best = k
        elif way * (x[best] - x[k]) > least:
            found.append(best)
            way, best = -way, k
    return found


def lags(recordings: Sequence[Recording]) -> list[Lag]:
    """Time differences between the measured channels of the motion, from the phase of their cross spectra."""
    names = [name for name in "xva" if all(name in measured_motion(r) for r in recordings)]
    return [_lag(recordings, early, late) for early, late in combinations(names, 2)]


def _lag(recordings: Sequence[Recording], low: str, high: str) -> Lag:
    """Lag of the higher derivative behind the lower one; the lower one is derived numerically first."""
    weights, slopes = 0.0, 0.0
    for recording in recordings:
        motion = measured_motion(recording)
        derived = motion[low]
        for _ in range(_ORDER[high] - _ORDER[low]):
            derived = stencil(derived, FIRST)
        n = min(1024, len(derived) // 4)
        omega, cross = csd(derived, motion[high], fs=2 * np.pi, nperseg=n)
        power = welch(derived, fs=2 * np.pi, nperseg=n)[1] * welch(motion[high], fs=2 * np.pi, nperseg=n)[1]
        coherence = np.abs(cross) ** 2 / np.maximum(power, 1e-300)
        blocks = max(1.0, 1.8 * len(derived) / n)
        good = (omega > 0) & (omega < 1.0) & (coherence > max(0.5, 4 / blocks))
        if not np.any(good):
            continue
        coherence = np.minimum(coherence[good], 1 - 1e-9)
        weight = 2 * blocks * coherence / (1 - coherence) * omega[good] ** 2
        weights += float(np.sum(weight))
        slopes += float(np.sum(weight * -np.angle(cross[good]) / omega[good]))
    if weights == 0.0:
        return Lag(high, low, 0.0, np.inf)
    return Lag(high, low, slopes / weights, float(1 / np.sqrt(weights)))


def delayed_channel(found: Sequence[Lag]) -> Fault | None:
    """The one channel of the motion whose shift explains the lags; None when they agree within a quarter of a
    sample."""
    if not found or max(abs(lag.lag) for lag in found if np.isfinite(lag.stderr)) < _SHIFTED:
        return None
    best: tuple[float, Fault] | None = None
    for name in "xva":
        touched = [(lag, 1.0 if lag.late == name else -1.0) for lag in found if name in (lag.late, lag.early)]
        rest = [lag for lag in found if name not in (lag.late, lag.early)]
        if not touched:
            continue
        weight = np.array([1 / (lag.stderr**2 + 0.02**2) for lag, _ in touched])
        size = float(np.sum(weight * [sign * lag.lag for lag, sign in touched]) / np.sum(weight))
        error = float(1 / np.sqrt(np.sum(weight)))
        misfit = sum((sign * lag.lag - size) ** 2 / (lag.stderr**2 + 0.05**2) for lag, sign in touched)
        misfit += sum(lag.lag**2 / (lag.stderr**2 + 0.05**2) for lag in rest)
        if best is None or misfit < best[0]:
            best = (misfit, Fault("channel_delay", name, size, error))
    if best is None or abs(best[1].size) <= max(_SHIFTED, 4 * best[1].stderr):
        return None
    fault = best[1]
    if len(found) == 1 and abs(abs(fault.size) - 0.5) < _HALF:  # of two channels, the one computed by differences
        return replace(fault, channel=found[0].late, size=found[0].lag)
    return fault


def one_sided(fault: Fault) -> bool:
    """Whether a shift is the half sample of a difference quotient: a channel that was computed is no late sensor."""
    return fault.channel in ("v", "a") and abs(abs(fault.size) - 0.5) < _HALF and fault.stderr < _HALF


def saturated_motion(recordings: Sequence[Recording]) -> Fault | None:
    """A channel of the motion that stops at a level where the other channels show that the motion goes on."""
    for name in "axv":
        if all(set(measured_motion(r)) > {name} for r in recordings):
            fault = _stopped(recordings, name) or _saturated(recordings, name)
            if fault is not None:
                return fault
    return None


def _saturated(recordings: Sequence[Recording], name: str) -> Fault | None:
    top = max(float(np.max(np.abs(getattr(r, name)))) for r in recordings)
    beyond, count, total = [], 0, 0
    for recording in recordings:
        motion = measured_motion(recording)
        noise = {key: noise_level(values) for key, values in motion.items()}
        total += len(recording)
        high = np.abs(motion[name]) > max(0.9 * top, top - 8 * noise[name])
        near = np.abs(motion[name]) > top - 6 * noise[name] - 1e-3 * top
        if np.count_nonzero(near) < 8:
            continue
        gap = {**motion, name: np.where(high, np.nan, motion[name])}
        bridged = getattr(smooth(gap, noise, recording.dt), name)
        excess = (bridged - motion[name]) * np.sign(motion[name])
        spread = noise[name] + 0.01 * top
        beyond.append(excess[near] / spread)
        count += int(np.count_nonzero(excess[near] > 3 * spread))
    if not beyond or count < max(10, 2e-4 * total):
        return None
    excess = np.concatenate(beyond)
    flat = float(np.mean(excess > 1.0))
    return Fault("sensor_saturation", name, top, 0.01 * top, count / total) if flat > 0.6 else None


def saturated_force(recordings: Sequence[Recording]) -> Fault | None:
    """A force channel whose range is too small."""
    return _stopped(recordings, "F")


def _stopped(recordings: Sequence[Recording], name: str) -> Fault | None:
    """A channel that takes its exact extreme far more often than any other value: cut off behind the noise."""
    channels = [recording.channel(name) for recording in recordings]
    top = max(float(np.max(np.abs(channel))) for channel in channels)
    touched, usual, total = 0, 1, 0
    for channel in channels:
        total += len(channel)
        touched += int(np.count_nonzero(np.abs(channel) >= top * (1 - 1e-9)))
        inside = channel[np.abs(channel) < top * (1 - 1e-9)]
        usual = max(usual, int(np.max(np.unique(inside, return_counts=True)[1], initial=1)))
    if touched < max(10, 3 * usual):  # a coarse converter repeats every value, a clipped channel only its last one
        return None
    return Fault("sensor_saturation", name, top, 1e-3 * top, touched / total)


def consistency(found: Sequence[Lag]) -> Mapping[str, float]:
    """Lags as plain numbers for the report: "v after x" -> samples."""
    return {f"{lag.late} after {lag.early}": lag.lag for lag in found}
