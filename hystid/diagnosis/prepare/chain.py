"""Is the measurement chain sound: do x, v and a describe one motion, and does a channel stop at a level?

Sensor faults keep their signature in units of the signal: a level that is never passed, a shift in time, a zero, a
gain. They are looked for before any physics is, and taken out where they can be.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from scipy.stats import norm

from hystid.consistency.kinematics import ORDER
from hystid.diagnosis.prepare.ac_coupled import coupled, uncoupled
from hystid.diagnosis.prepare.clipping import saturated_motion, stopped
from hystid.diagnosis.prepare.differences import advanced
from hystid.diagnosis.prepare.faults import CALIBRATION, DEAD, DELAY, GAIN, SATURATION, ZERO, Fault
from hystid.diagnosis.prepare.pairs import CHANCE, ChannelPair, Estimate, agreed, consistency, pairs, sections
from hystid.diagnosis.prepare.segments import measured_motion
from hystid.numeric import Array
from hystid.recording import Recording
from hystid.smoothing.noise import noise_level

_TOUCH = 0.01  # share of the largest force (or stroke) that counts as nothing
_RISE = 0.3  # share of the largest force over which the first rise is taken as a line
_STEP, _SEAT = 0.002, 0.2  # shares of the stroke between which an approach lies
_SAME_SPEED = 1.4  # fastest over slowest stroke of one direction
_STRAIGHT = 0.02  # deviation of a stroke from a line over its length: a sine has 0.042, a triangle less than 0.01
NO_CLOCK = (
    "time only numbers the samples here: drifts, laws of time and windows of time are no candidates, and rates have no "
    "scale"
)
_NOISE = 0.5  # share of the power of a channel from which it is noise: a worse channel adds nothing to the others
_SURELY = float(norm.isf(CHANCE))  # standard errors by which a lag is more than that
_HALF = 0.55  # samples: by how much a held force is early against the motion that it makes, and a tenth for noise
_HELD = "a follows jumps of F, as where F is held between samples: neither was moved"
_SHIFTED = 1.0  # samples: channels of a multiplexed converter are so far apart; less is taken out without a finding


@dataclass(frozen=True)
class Chain:
    """Recordings with the faults of their channels taken out.

    faults: those that are findings. repaired: all that was taken out, some of it too small for a finding. notes: the
    same in sentences. consistency: lags and gains of the channels, for the report.
    """

    tests: list[Recording]
    unseen: list[Recording]
    faults: tuple[Fault, ...]
    repaired: tuple[Fault, ...]
    notes: tuple[str, ...]
    consistency: Mapping[str, Any]

    @property
    def stopped(self) -> dict[str, float]:
        """Channel -> level at which it stops."""
        return {fault.channel: fault.size for fault in self.faults if fault.id == SATURATION}


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
    note = f"{recording.name}: no force over the first {1e3 * gap:.3g} mm, left out as approach; x counts from contact"
    return recording.part(slice(first, last), note).with_channels({"x": x[first:last] - side * gap})


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


def examined(tests: Sequence[Recording], unseen: Sequence[Recording], clipped: Sequence[Fault] | None = None) -> Chain:
    """Look for faults of the channels and take out what can be taken out, in all recordings alike.

    Zeros, AC coupling, lags and gains, each only where the sections of the recordings agree. clipped: channels that
    were found to stop at a level (``stopped``); None where that is still to be looked for.
    """
    faults = list(stopped(tests) if clipped is None else clipped)
    tests, unseen, dead = _without_dead(tests, unseen, {fault.channel for fault in faults})
    tests, unseen, zeros = _without_zeros(tests, unseen)
    tests, unseen, filtered = _uncoupled(tests, unseen, {fault.channel for fault in faults})
    found = pairs(tests)
    late = _late_channel(_sound(found, faults))
    held = late is not None and _jumps_with_force(tests, late)
    if held:
        late = None
    if late is not None:
        tests, unseen = ([_shifted(test, late) for test in group] for group in (tests, unseen))
    alone = _scaled_alone(tests, faults)
    scaled = _scaled_channel(_sound(found, faults)) if not alone else None
    if scaled is not None:
        tests, unseen = ([_rescaled(test, scaled) for test in group] for group in (tests, unseen))
    tests = [_rescaled(test, alone[test.name]) if test.name in alone else test for test in tests]
    if not any(fault.channel in "xva" for fault in faults):
        faults += [f for f in (saturated_motion(tests),) if f is not None]
    repaired = [fault for fault in (*dead, *zeros, *filtered, late, scaled) if fault is not None]
    named = [fault for fault in repaired if fault.id == DELAY and _is_named(fault)]
    notes = (*(fault.sentence() for fault in repaired), *([_HELD] if held else []))
    notes += tuple(f"{name}: {fault.sentence()}" for name, fault in alone.items())
    return Chain(list(tests), list(unseen), (*faults, *named), tuple(repaired), notes, consistency(found))


def _jumps_with_force(tests: Sequence[Recording], late: Fault) -> bool:
    """Whether an acceleration that is early by half a sample at most follows jumps of the force, as where a controller
    or a simulation holds it over each step: moved back, it no longer balances the force."""
    if late.channel != "a" or not -_HALF <= late.size < 0:
        return False
    left = [0.0, 0.0]
    for test in tests:
        for k, moved in enumerate((test, _shifted(test, late))):
            motion = measured_motion(moved)
            if test.F is None or "a" not in motion:
                return False
            table = np.column_stack([*motion.values(), np.ones(len(test))])
            left[k] += float(np.sum((test.F - table @ np.linalg.lstsq(table, test.F, rcond=None)[0]) ** 2))
    return left[0] < left[1]


def _sound(found: Sequence[ChannelPair], faults: Sequence[Fault]) -> list[ChannelPair]:
    """Pairs of which neither channel stops at a level: clipping turns the phase at large motion."""
    stopped = {fault.channel for fault in faults}
    return [pair for pair in found if not {pair.low, pair.high} & stopped and np.isfinite(pair.lag.stderr)]


def _is_named(late: Fault) -> bool:
    """Whether a lag is a finding: beyond what converters and filters bring.

    Chains delay and never hurry: a channel that is early leads in phase, as one with AC coupling does.
    """
    return late.seconds > 0 and late.size - _SURELY * late.stderr >= _SHIFTED


def _without_dead(
    tests: Sequence[Recording], unseen: Sequence[Recording], stopped: set[str]
) -> tuple[Sequence[Recording], Sequence[Recording], list[Fault]]:
    """The recordings without a channel of the motion that shows another motion than two that agree, or noise alone."""
    found = pairs(tests)
    names = {name for pair in found for name in (pair.low, pair.high)}
    strange = [name for name in names - stopped if _is_strange(name, found) or _is_noise(tests, name)]
    if len(names) < 3 or len(strange) != 1:
        return tests, unseen, []
    (name,) = strange
    best = max(pair.correlation for pair in found if name in (pair.low, pair.high))
    bare = [[test.with_channels({name: None}) for test in group] for group in (tests, unseen)]
    return bare[0], bare[1], [Fault(DEAD, name, best, 0.0)]


def _is_noise(tests: Sequence[Recording], name: str) -> bool:
    """Whether a channel holds white noise alone, all through."""
    channels = [np.asarray(getattr(test, name)) for test in tests]
    return all(noise_level(values) ** 2 > _NOISE * float(np.var(values)) for values in channels)


def _is_strange(name: str, found: Sequence[ChannelPair]) -> bool:
    """Whether no other channel follows this one at any shift, while the others follow each other."""
    own = [pair for pair in found if name in (pair.low, pair.high)]
    others = [pair for pair in found if name not in (pair.low, pair.high)]
    return not any(pair.is_one_motion for pair in own) and all(pair.is_one_motion for pair in others)


def _without_zeros(
    tests: Sequence[Recording], unseen: Sequence[Recording]
) -> tuple[Sequence[Recording], Sequence[Recording], list[Fault]]:
    """Recordings whose velocity and acceleration have the mean that the displacement or the velocity says.

    The zero of each recording is its own. That of the displacement cannot be seen in the motion: a constant force does
    as much, and both stay in one class (``fit.zeros``).
    """
    groups, faults = [list(tests), list(unseen)], []
    for name, sources in (("v", "x"), ("a", "vx")):
        worst: Fault | None = None
        for group in groups:
            for i, test in enumerate(group):
                found = zero_of(test, name, sources)
                if found is None:
                    continue
                moved = {name: np.asarray(getattr(test, name)) - found.value}
                group[i] = test.with_channels(moved)
                share = abs(found.value) / (float(np.std(moved[name])) or 1.0)
                if worst is None or share > worst.share:
                    worst = Fault(ZERO, name, found.value, found.stderr, share)
        faults += [worst] if worst is not None else []
    return groups[0], groups[1], faults


def zero_of(test: Recording, name: str, sources: str) -> Estimate | None:
    """Constant on a channel that its lower derivative does not show [its unit]; None where sections do not agree.

    Under a window w that begins and ends flat, the integral of w v is that of -w' x, and that of w a the one of w'' x:
    no channel has to be derived, and the noise of all samples is averaged.
    """
    motion = measured_motion(test)
    source = next((other for other in sources if other in motion), "")
    if name not in motion or not source:
        return None
    order, found = ORDER[name] - ORDER[source], []
    for lower, upper in sections(motion[source], motion[name]):
        n = len(lower)
        turn = 2 * np.pi * (np.arange(n) + 0.5) / n
        rate = 2 * np.pi / (n * test.dt)
        window, steep = 1 - np.cos(turn), (-rate * np.sin(turn) if order == 1 else rate**2 * np.cos(turn))
        found.append(float(np.mean(window * upper) - np.mean(steep * (lower - np.mean(lower)))))
    zero = agreed(np.array(found), np.ones(len(found)))
    return zero if zero.agrees else None


def _uncoupled(
    tests: Sequence[Recording], unseen: Sequence[Recording], stopped: set[str]
) -> tuple[Sequence[Recording], Sequence[Recording], list[Fault]]:
    """Recordings without the AC coupling of their channels, of which one at least is sound."""
    found: list[Fault] = []
    while (fault := coupled(tests, stopped | {fault.channel for fault in found})) is not None:
        tests = [uncoupled(test, fault) for test in tests]
        unseen = [uncoupled(test, fault) for test in unseen]
        found.append(fault)
    return tests, unseen, found


def _late_channel(found: Sequence[ChannelPair]) -> Fault | None:
    """The one channel of the motion whose shift explains the lags; None where they are not believed.

    A clock that is late changes no amplitude: where sections or halves of the band do not agree on the gain, it is a
    filter. Of two channels the later one is at fault: chains delay and never hurry.
    """
    found = [pair for pair in found if pair.gain.stderr < CALIBRATION]
    if not any(pair.lag.agrees for pair in found):
        return None
    dt = found[0].dt
    if len(found) == 1:
        (pair,) = found
        name = pair.high if pair.lag.value > 0 else pair.low
        return Fault(DELAY, name, abs(pair.samples), pair.lag.stderr / dt, seconds=abs(pair.lag.value))
    name, size = _odd_one([(pair.low, pair.high, pair.lag) for pair in found])
    return Fault(DELAY, name, size.value / dt, size.stderr / dt, seconds=size.value)


def _scaled_channel(found: Sequence[ChannelPair]) -> Fault | None:
    """The channel whose gain disagrees with that of the others by more than what calibration leaves.

    Of two channels the displacement, or the velocity, is scaled: the acceleration carries the mass, which is weighed.
    """
    if not any(pair.gain.agrees for pair in found):
        return None
    name, size = _odd_one([(pair.low, pair.high, pair.gain) for pair in found])
    if abs(size.value) < CALIBRATION:
        return None
    return Fault(GAIN, name, float(np.exp(size.value)), float(np.exp(size.value)) * size.stderr)


def _scaled_alone(tests: Sequence[Recording], faults: Sequence[Fault]) -> dict[str, Fault]:
    """Name of a recording -> the channel that was set to another range there: two others agree, and it does not; {}
    where no recording is without."""
    alone, sound = {}, False
    for test in tests:
        found = _sound(pairs([test]), faults)
        fault = _scaled_channel(found)
        near = [pair for pair in found if abs(pair.gain.value) < CALIBRATION and np.isfinite(pair.gain.stderr)]
        sound |= len(near) == len(found) > 0
        if fault is not None and any(fault.channel not in (pair.low, pair.high) for pair in near):
            alone[test.name] = fault
    return alone if sound else {}


def _odd_one(found: Sequence[tuple[str, str, Estimate]]) -> tuple[str, Estimate]:
    """The channel that, changed alone, makes all differences (low, high, by how much high is ahead) vanish; its own."""
    best: tuple[float, str, Estimate] | None = None
    for name in sorted({name for low, high, _ in found for name in (low, high)}, key="xva".index):
        own = [(size, 1.0 if high == name else -1.0) for low, high, size in found if name in (low, high)]
        values = np.array([sign * size.value for size, sign in own])
        weight = np.array([1 / size.stderr**2 for size, _ in own])
        mean = float(weight @ values / np.sum(weight))
        misfit = float(weight @ (values - mean) ** 2)
        misfit += sum((size.value / size.stderr) ** 2 for low, high, size in found if name not in (low, high))
        if best is None or misfit < best[0]:
            spread = 1 / np.sum(weight) + float(weight @ (values - mean) ** 2 / np.sum(weight))
            best = misfit, name, Estimate(mean, float(np.sqrt(spread)))
    assert best is not None  # at least one pair was given
    return best[1], best[2]


def _rescaled(recording: Recording, fault: Fault) -> Recording:
    held = recording.channels((fault.channel,))
    return recording.with_channels({name: values / fault.size for name, values in held.items()})


def _shifted(recording: Recording, late: Fault) -> Recording:
    """Copy with one channel moved earlier by a time (band-limited interpolation, mirrored ends)."""
    held = recording.channels((late.channel,))
    return recording.with_channels({k: advanced(values, late.seconds / recording.dt) for k, values in held.items()})
