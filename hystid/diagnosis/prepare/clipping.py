"""Channels that stop at a level: cut off behind the noise, which repeats one value, or before it, which does not.

A recorder that clips repeats its last value. An amplifier that clips in front of the recorder leaves noise on the
level, and no value comes twice: then the channel is compared with what the others say of the motion. Beyond the level
they go on, and the channel stays where it is.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from scipy.stats import binom
from scipy.stats import f as fisher

from hystid.consistency import cut_off
from hystid.consistency.cut_off import BELOW
from hystid.diagnosis.prepare.faults import CALIBRATION, SATURATION, Fault
from hystid.diagnosis.prepare.pairs import CHANCE, agreed
from hystid.diagnosis.prepare.segments import measured_motion
from hystid.numeric import Array, Flags, stretches
from hystid.recording import Recording
from hystid.smoothing.noise import noise_level
from hystid.smoothing.smoother import Smoothed, smooth

_FEWEST_BEYOND = 10  # samples beyond a level from which it is one
_LOWEST = 0.5  # of the largest value: a louder channel shows no level
DEEP = 3.0  # standard errors of what is told: less is missing by chance, as excursions are chosen by it
_SWITCHED = 2.0  # times the change before: noise as large as the change itself doubles it
_DIGITS = 1e-3  # of the largest value: what filters behind the level leave
STAYS = 0.5  # slope of a channel over what the others say, beyond its level: half way between a stop and no stop


def stopped(tests: Sequence[Recording], *, slow: bool = False) -> tuple[Fault, ...]:
    """Channels that stop at a level, in recordings as they were read: what is moved, filtered or scaled does not.

    slow: nothing has inertia there. A displacement at which the force stays as well is held, as in a test with pauses.
    """
    faults = [fault for name in "xvaF" if (fault := _stopped(tests, name)) is not None]
    return tuple(f for f in faults if f.channel != "x" or not slow or _goes_on(tests, f.size))


def _goes_on(tests: Sequence[Recording], level: float) -> bool:
    """Whether the force goes on where a displacement stands at a level, by half of what its slopes there say."""
    shown = due = 0.0
    for test in tests:
        for first, last in stretches(np.abs(test.channel("x")) >= level):
            if test.F is not None and first > 0 and last < len(test):
                inside, side = test.F[first - 1 : last + 1], np.sign(test.channel("x")[first])
                shown += side * float(np.mean(inside) - 0.5 * (inside[0] + inside[-1]))
                due += side * float(np.mean(beyond(test.F, first, last)))
    return shown >= STAYS * due


def beyond(force: Array, first: int, last: int) -> Array:
    """How far a force (n,) goes on within a stretch, (last - first,), as a parabola with the slopes on either
    side, each over a quarter of the stretch; 0 where they do not rise to it."""
    count, side = last - first, np.sign(force[first])
    before, after = max(first - 1 - count // 4, 0), min(last + count // 4, len(force) - 1)
    rise, fall = (
        (force[first] - force[before]) / (first - before),
        (force[last - 1] - force[after]) / (after - last + 1),
    )
    inside = np.arange(1, count + 1)
    return np.asarray(side * max(side * (rise + fall), 0.0) / 2 * inside * (count + 1 - inside) / (count + 1))


def saturated_motion(recordings: Sequence[Recording]) -> Fault | None:
    """A channel of the motion that stops at a level where the other channels show that the motion goes on."""
    for name in "axv":
        if all(set(measured_motion(r)) > {name} for r in recordings):
            fault = _saturated(recordings, name)
            if fault is not None:
                return fault
    return None


def level_of(seen: Sequence[Array], told: Sequence[Array], error: float) -> tuple[float, int] | None:
    """Level at which a channel stops, and the number of its samples there; None where it does not.

    seen: the channel, (n,) per recording; told: what it should show. error: standard deviation of the latter.

    Each excursion beyond the level is a witness, and one more where what is told moves by more than its error: what the
    channel lacks there must not be zero by chance (Student; or its sign, and whether the channel stays; or its spread
    beside that of the levels at which the channel stays, Fisher's F), must be more than a gain or errors of what is
    told do, and the channel must not follow what is told.
    """
    top = max(float(np.max(np.abs(values))) for values in seen)
    far = np.concatenate([(np.sign(one) * values)[np.abs(one) > top] for values, one in zip(seen, told, strict=True)])
    if len(far) < _FEWEST_BEYOND:
        return None
    level = float(np.median(far))
    inside = [np.abs(one) > level for one in told]
    lacking, weights, stays, levels = [], [], [], []
    for values, one, beyond in zip(seen, told, inside, strict=True):
        for first, last in stretches(beyond):
            should_be, is_there = one[first:last], values[first:last]
            lacking.append(float(np.mean(np.sign(one[first]) * (should_be - is_there))))
            levels.append(float(np.mean(np.sign(one[first]) * is_there)))
            weights.append(float(last - first))
            if np.ptp(should_be) > 2 * DEEP * error:
                stays.append(np.polyfit(should_be, is_there, 1)[0] < STAYS)
    found = agreed(np.array(lacking), np.array(weights))
    clear = np.array(lacking)[np.abs(lacking) > DEEP * error]
    witnesses = [*(clear > 0), *stays]  # depths differ, but not their sign, nor that the channel stays
    by_sign = float(binom.sf(sum(witnesses) - 1, len(witnesses), 0.5))
    is_deep = found.value > max(CALIBRATION * level, DEEP * error)
    shown = np.concatenate([(np.sign(one) * values)[b] for values, one, b in zip(seen, told, inside, strict=True)])
    should = np.concatenate([np.abs(one[b]) for one, b in zip(told, inside, strict=True)])
    follows = np.polyfit(should - level, shown - level, 1)[0] > STAYS
    is_no_chance = found.agrees or min(by_sign, _by_level(levels, lacking)) < CHANCE
    return (level, len(shown)) if is_no_chance and is_deep and not follows else None


def _by_level(levels: Sequence[float], lacking: Sequence[float]) -> float:
    """Probability by chance that a channel stays at levels that differ so little beside what it lacks there."""
    more = len(levels) - 1
    spread = float(np.var(lacking))
    return float(fisher.cdf(np.var(levels) / spread, more, more)) if more and spread > 0 else 1.0


def near_top(channels: Sequence[Array], noise: float) -> list[Flags] | None:
    """Samples that may stand at a level, (n,) per recording; None where there are few, or noise hides any level."""
    top = max(float(np.max(np.abs(values))) for values in channels)
    near = [np.abs(values) > _lowest(channels, noise) for values in channels]
    is_hidden = BELOW * noise > (1 - _LOWEST) * top
    return None if is_hidden or sum(map(np.count_nonzero, near)) < _FEWEST_BEYOND else near


def _lowest(channels: Sequence[Array], noise: float) -> float:
    """Lowest sample of channels that stop: beyond their level there is noise, and what filters leave, and no more."""
    top = max(float(np.max(np.abs(values))) for values in channels)
    return top - BELOW * noise - _DIGITS * top


def _saturated(recordings: Sequence[Recording], name: str) -> Fault | None:
    motions = [measured_motion(recording) for recording in recordings]
    noises = [{key: noise_level(values) for key, values in motion.items()} for motion in motions]
    channels, noise = [motion[name] for motion in motions], max(one[name] for one in noises)
    near = near_top(channels, noise)
    if near is None:
        return None
    told, errors = [], []
    for recording, motion, own, gap in zip(recordings, motions, noises, near, strict=True):
        if not np.any(gap):
            told.append(motion[name])
            continue
        known = {**motion, name: np.where(gap, np.nan, motion[name])}
        bridged = smooth(known, own, recording.dt)
        told.append(getattr(bridged, name))
        errors.append(_bridging_error(known, own, recording.dt, bridged, name))
    found = level_of(channels, told, max(errors))
    if found is None or found[0] < _lowest(channels, noise):
        return None  # a channel goes no further than where it stops, but for its noise
    level, count = found
    return Fault(SATURATION, name, level, float(noise / np.sqrt(count)), count / sum(map(len, recordings)))


def _bridging_error(
    known: Mapping[str, Array], noise: Mapping[str, float], dt: float, bridged: Smoothed, name: str
) -> float:
    """Standard error of a channel in its gaps, as the others bridge them: of what noise does to it, and of what is
    found in gaps of the same lengths beside them, the larger one. Noise of another colour than white, and motion that
    is rougher than was believed, are seen there alone."""
    gap = np.isnan(known[name])
    rng = np.random.default_rng(0)
    drawn = {key: noise[key] * rng.standard_normal(len(values)) + 0 * values for key, values in known.items()}
    error = smooth(drawn, noise, dt, bridged.roughness)  # the smoother is linear: what noise does to it
    drawn_error = float(np.std(getattr(error, name)[gap]))
    longest = max(last - first for first, last in stretches(gap))
    beside = np.roll(gap, 2 * longest) & ~gap
    if np.count_nonzero(beside) < _FEWEST_BEYOND:
        return drawn_error
    again = smooth({**known, name: np.where(beside, np.nan, known[name])}, noise, dt, bridged.roughness)
    return max(drawn_error, float(np.std((getattr(again, name) - getattr(bridged, name))[beside])))


def _jumps(channels: Sequence[Array], level: float) -> bool:
    """Whether channels mostly jump to a level, as a force that is switched: towards its top a signal changes by less
    from sample to sample, and by less still where it is cut off."""
    steps, before = list[float](), list[float]()
    for values in channels:
        change = np.abs(np.diff(values))
        for first, last in stretches(np.abs(values) >= level):
            if first >= 2 and last + 2 <= len(values):
                steps += [float(change[first - 1]), float(change[last - 1])]
                before += [float(change[first - 2]), float(change[last])]
    return bool(steps) and float(np.median(steps)) > _SWITCHED * float(np.median(before))


def _stopped(recordings: Sequence[Recording], name: str) -> Fault | None:
    """A channel that takes its exact extreme far more often than other values: cut off behind the noise."""
    channels = [np.asarray(values) for r in recordings if (values := getattr(r, name)) is not None]
    found = cut_off.level(channels)
    if found is None or _jumps(channels, found.value):
        return None
    return Fault(SATURATION, name, found.value, 1e-3 * found.value, found.share)
