"""Recordings made ready: smoothed motion as regressors, raw force balance as evidence.

The force balance F - m a is taken from the raw channels, so that its noise is white and of known level. Only the
regressors are smoothed.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.ndimage import uniform_filter1d

from hystid.diagnosis.prepare.decay import MODEL_ERROR
from hystid.diagnosis.prepare.differences import FIRST, SECOND, advanced, stencil
from hystid.diagnosis.prepare.draws import Draw, Draws
from hystid.diagnosis.prepare.filtering import filtered, quick_length
from hystid.diagnosis.prepare.levelled import unknown_degree
from hystid.diagnosis.prepare.refused import NotDiagnosable
from hystid.numeric import Array
from hystid.numeric import Flags as Flags
from hystid.recording import Recording
from hystid.smoothing.noise import (
    SECTIONS,
    NoiseBefore,
    between_samples,
    filtered_beyond,
    level_between,
    louder_for_a_while,
    steps,
    unfiltered_level,
)
from hystid.smoothing.smoother import Smoothed, bias, error_of_x, followed, smooth

_SLOWEST, _QUICKEST = 0.01, 0.99  # shares of the power of the velocity below the slowest and the quickest motion
_HIDDEN = 0.05  # share of the force below the visible frequencies, beyond which a recording says too little
_LINES = 512  # over which a response is kept
_STOPS = 4.0  # standard deviations of noise on a level at which a channel stops: one sample in 30,000 lies below


class HiddenMotion(NotDiagnosable):
    """The channels that were recorded do not show the motion; the message says from where on."""


@dataclass(frozen=True)
class Part:
    """One recording, ready for fitting. Arrays of shape (n,), SI units.

    x, v, a: smoothed motion. F: force as measured. inertia: unbiased acceleration, for the balance F - m a
    (the channel itself, or a plain derivative of the best one). noise: standard deviation per channel.
    lowest: angular frequency [rad/s] below which the motion is not seen and x is held at zero; 0 where x was measured.
    past: samples after the first one that are run backwards before it: a law with memory begins as in mid-motion.
    louder: noise of a channel over ``noise``, (n,), where it is louder for a while, or shocks are too short to be seen.
    timed: whether time was measured; else it only numbers the samples. extra: further columns of the file, (n,) each.
    forced: whether a force was recorded; else it is known to be zero.
    sees_x: whether the displacement is known at all frequencies that matter.
    colour: power of the noise of all channels over its white part, times the frequency [cycles per sample], and times
    its square: 1/f noise, and a wandering zero. since: age of the zeros of the sensors, at least [s].
    pace: samples in the time of one of the first recording.
    rest: samples that are not valid for nothing but that nothing moves there.
    error_of_x: what noise leaves in x, over frequencies from 0 to pi per sample [m], (m,); white noise of standard
    deviation 1 has 1 everywhere. noise_ends: frequency [cycles per sample] up to which the noise of all channels is
    white; noise_passed: power that filters leave of it over frequencies from 0 to pi per sample, (m,), of the
    channel of which they leave most.
    unknown_degree: of a polynomial of time in the balance that nobody knows, as a user took a straight line off a
    channel; 0 for none. follows: frequency [cycles per sample] up to which smoothing follows the motion.
    jitter: draws of the error that channel noise leaves in (x, v, a) after smoothing, and of that in inertia.
    """

    name: str
    t: Array
    dt: float
    F: Array
    x: Array
    v: Array
    a: Array
    inertia: Array
    inertia_order: int
    noise: dict[str, float]
    measured: dict[str, Array]
    valid: Flags | None = field(repr=False, default=None)
    lowest: float = 0.0
    past: int = 0
    timed: bool = True
    extra: Mapping[str, Array] = field(repr=False, default_factory=dict)
    jitter: Draws = field(repr=False, default_factory=Draws)
    forced: bool = True
    sees_x: bool = True
    colour: tuple[float, float] = (0.0, 0.0)
    since: float = 0.0
    pace: float = 1.0
    louder: Mapping[str, Array] = field(repr=False, default_factory=dict)
    rest: Flags | None = field(repr=False, default=None)
    error_of_x: Array = field(repr=False, default_factory=lambda: np.zeros(2))
    noise_ends: float = 0.5
    noise_passed: Array = field(repr=False, default_factory=lambda: np.ones(2))
    unknown_degree: int = 0
    follows: float = 0.5

    def __len__(self) -> int:
        return len(self.t)

    def led_in(self, x: Array, v: Array) -> tuple[Array, Array]:
        """Displacement and velocity (n,) with the past before them, (past + n,)."""
        back = slice(self.past, 0, -1)
        return (np.concatenate([x[back], x]), np.concatenate([-v[back], v])) if self.past else (x, v)

    def with_zero(self, zero: float) -> Part:
        """The same with a displacement whose zero was off by so much [m]."""
        measured = {name: y - zero if name == "x" else y for name, y in self.measured.items()}
        return replace(self, x=self.x - zero, measured=measured)

    @property
    def first(self) -> float:
        """Lowest visible frequency [rad per sample]."""
        return self.lowest * self.dt

    def seen(self, omega: Array) -> Array:
        """Share of the motion that can be seen at angular frequencies [rad per sample]."""
        if not self.lowest:
            return np.ones_like(omega)
        high = (omega / self.first) ** 8
        return np.asarray(high / (1.0 + high))

    def slow(self, column: Array, octaves: int = 0) -> Array:
        """What of a column (n,) lies below the lowest visible frequency, or so many octaves above it."""
        length = quick_length(len(column))
        omega = np.pi * np.arange(length + 1) / length
        return filtered(column, 1.0 - self.seen(omega / 2**octaves))

    def force_advanced(self, delay: float) -> Array:
        """The force, earlier by a number of samples of the first recording: a clock is late by a time."""
        return advanced(self.F, delay * self.pace) if delay else self.F

    @property
    def shown_acceleration(self) -> Array:
        """The acceleration as people want to see it: measured, or smoothed where it was derived."""
        return self.inertia if self.inertia_order == 0 else self.a

    @property
    def first_Hz(self) -> float:
        """The same in Hz."""
        return self.first / (2 * np.pi * self.dt)

    def hidden(self, mass: float = 0.0) -> float:
        """Share of the power of the force below the frequency at which the motion can be seen.

        mass [kg]: a blow is over before the structure has moved; what counts is then the restoring force that rings.
        """
        power, ringing = (
            np.abs(np.fft.rfft((force - np.mean(force)) * np.hanning(len(self)))) ** 2
            for force in (self.F, self.F - mass * self.inertia)
        )
        below = 2 * np.pi * np.arange(len(power)) / len(self) < 0.9 * self.first
        return float(np.sum(power[below]) / max(float(np.sum(power)), float(np.sum(ringing)), 1e-300))

    def velocity_error(self) -> Array:
        """Standard error of the velocity [m/s], (n,): rms of its draws over all samples, or over sections where noise
        is louder for a while. A few draws hold too few independent errors to tell more."""
        return self._error(1)

    def acceleration_error(self) -> Array:
        """Standard error of the acceleration [m/s2], (n,), likewise."""
        return self._error(2)

    def _error(self, order: int) -> Array:
        squares = np.mean([np.asarray(draw[order], dtype=float) ** 2 for draw in self.jitter.first()], axis=0)
        if self.louder:
            return np.asarray(np.sqrt(uniform_filter1d(squares, len(self) // SECTIONS)))
        return np.full(len(self), float(np.sqrt(np.mean(squares))))

    def balance_noise(self, mass: float) -> float:
        """Standard deviation of F - m a per sample [N], where the acceleration was measured; else of F alone."""
        if self.inertia_order == 0 and "a" in self.noise:
            return float(np.hypot(self.noise["F"], mass * self.noise["a"]))
        return self.noise["F"]


def prepare_parts(
    recordings: Sequence[Recording], seed: int = 0, stopped: Mapping[str, float] | None = None
) -> list[Part]:
    """The parts of recordings that one recorder made: it filters a channel in all of them alike."""
    corners: dict[str, set[float]] = {}
    for recording in recordings:
        for name, before in noise_before(_all_channels(recording), {}).items():
            corners.setdefault(name, set()).update({before.end} - {0.5})
    return [prepare_part(recording, seed + i, stopped, corners) for i, recording in enumerate(recordings)]


def prepare_part(
    recording: Recording,
    seed: int = 0,
    stopped: Mapping[str, float] | None = None,
    corners: Mapping[str, Collection[float]] | None = None,
) -> Part:
    """Noise levels, smoothing and the unbiased acceleration of one recording; needs F and one of x, v, a.

    stopped: channels that stop at a level; samples there count as missing. corners: frequencies [cycles per sample]
    beyond which the recorder has taken the noise of a channel away, as other recordings show.
    """
    F, dt = recording.channel("F"), recording.dt
    measured = measured_motion(recording)
    channels = _all_channels(recording)
    # what is integrated does not know slow motion better than integration allows, however quiet it is
    limited = frozenset("F" if "x" in measured else channels)
    before = noise_before(channels, corners or {})
    stops = {
        name: np.abs(channels[name]) >= (1 - 1e-9) * level
        for name, level in (stopped or {}).items()
        if name in channels
    }
    levels = {name: max(_level(y, stops.get(name)), before[name].level) for name, y in channels.items()}
    noise = {name: _at_least(name in limited, level, channels[name]) for name, level in levels.items()}
    white = {name for name, one in before.items() if one.end == 0.5 and name not in stops}
    louder = _louder(channels, noise, limited, white)
    gapped, valid = _without_stops(channels, noise, stopped or {})
    seen, force = {name: gapped[name] for name in measured}, np.nan_to_num(gapped["F"])
    motion = smooth(seen, noise, dt, None, _of_motion(louder), force)
    inertia, order = _inertia(measured, dt, motion)
    return Part(
        recording.name, recording.t - recording.t[0], dt, F, motion.x, motion.v, motion.a, inertia, order, noise,
        channels, valid, motion.roughness.lowest, 0, not recording.quasi_static,
        {name: column for name, column in recording.extra.items() if len(column) == len(F)},
        _drawn(measured, seen, noise, dt, motion, (seed, louder, before)), louder=louder,
        error_of_x=error_of_x({name: noise[name] for name in measured}, dt, motion.roughness),
        noise_ends=min(one.end for one in before.values()), noise_passed=_passed(list(before.values())),
        unknown_degree=unknown_degree(recording), follows=max(followed(noise, dt, motion.roughness)[0], 1 / len(F)),
    )  # fmt: skip


def _all_channels(recording: Recording) -> dict[str, Array]:
    return {**measured_motion(recording), "F": recording.channel("F")}


def _level(channel: Array, stops: Flags | None) -> float:
    return unfiltered_level(channel) if stops is None else level_between(channel, stops)


def noise_before(channels: Mapping[str, Array], corners: Mapping[str, Collection[float]]) -> dict[str, NoiseBefore]:
    """Noise of each channel before a filter that ends it."""
    return {
        name: filtered_beyond(y, _others(name, channels), drives=name == "F", corners=corners.get(name, ()))
        for name, y in channels.items()
    }


def _passed(before: Sequence[NoiseBefore]) -> Array:
    """Power that filters leave of noise, of the channel of which they leave most, over frequencies from 0 to pi."""
    if any(one.end == 0.5 for one in before):
        return np.ones(2)
    return np.asarray(np.max([one.passed(np.linspace(0, 0.5, _LINES)) for one in before], axis=0))


def _others(name: str, channels: Mapping[str, Array]) -> list[Array]:
    """The force beside a channel of the motion, and these beside the force: sensors that share motion and no noise."""
    return [values for other, values in channels.items() if (other == "F") != (name == "F")]


def _at_least(limited: bool, level: float, values: Array) -> float:
    return max(level, MODEL_ERROR * float(np.std(values))) if limited else level


def _louder(
    channels: Mapping[str, Array], noise: dict[str, float], limited: Collection[str], white: Collection[str]
) -> dict[str, Array]:
    """Noise of channels over its level, (n,) each, where it is louder for a while; ``noise`` is told the level of the
    rest then. white: channels whose noise no filter ends: behind one, what is white is motion."""
    found = {}
    for name, values in channels.items():
        if name in white and (uneven := louder_for_a_while(values)) is not None:
            level, factor = uneven
            quiet = _at_least(name in limited, min(noise[name], level), values)
            found[name] = np.maximum(factor * level / quiet, 1.0)
            noise[name] = quiet
        if np.any((shock := between_samples(values) / noise[name]) > 1.0):
            found[name] = np.hypot(found.get(name, 1.0), shock)
    return found


def _of_motion(louder: Mapping[str, Array]) -> dict[str, Array]:
    return {name: factor for name, factor in louder.items() if name != "F"}


def measured_motion(recording: Recording) -> dict[str, Array]:
    """The channels of the motion that were measured; see ``independence.measurements`` for those that were computed."""
    return {name: values for name, values in recording.channels("xva").items() if recording.direct(name)}


def _without_stops(
    channels: dict[str, Array], noise: Mapping[str, float], stopped: Mapping[str, float]
) -> tuple[dict[str, Array], Flags | None]:
    """Channels with gaps where they stop, and the samples whose force balance can be trusted."""
    if not stopped:
        return channels, None
    valid = np.ones(len(channels["F"]), dtype=bool)
    known = dict(channels)
    for name, level in stopped.items():
        if name in channels:
            gap = np.abs(channels[name]) > level - _STOPS * noise[name] - 1e-9 * level
            known[name] = np.where(gap, np.nan, channels[name])
            valid &= ~np.convolve(gap, np.ones(3), mode="same").astype(bool)
    return known, valid


def _inertia(measured: dict[str, Array], dt: float, motion: Smoothed) -> tuple[Array, int]:
    """Acceleration without smoothing, and how many derivatives it took.

    Noise of a derivative cancels over time, but for what a cut leaves at an end, which whitening would spread far. The
    columns that are whitened go on as their mirror image. So does the noise of x: its second derivative then does
    likewise. That of v goes on as its mirror image of the other sign, for the same reason.
    """
    if "a" in measured:
        return measured["a"], 0
    name, weights, order = ("v", FIRST, 1) if "v" in measured else ("x", SECOND, 2)
    found = stencil(measured[name], weights) / dt**order
    width = len(weights) // 2
    noise = np.pad(measured[name] - getattr(motion, name), width, mode="symmetric")
    if order == 1:
        noise[:width], noise[-width:] = -noise[:width], -noise[-width:]
    mirrored = motion.a + np.convolve(noise, weights[::-1], mode="valid") / dt**order
    found[:width], found[-width:] = mirrored[:width], mirrored[-width:]
    return found, order


def _drawn(
    measured: dict[str, Array],
    seen: dict[str, Array],
    noise: dict[str, float],
    dt: float,
    motion: Smoothed,
    of: tuple[int, Mapping[str, Array], Mapping[str, NoiseBefore]],
) -> Draws:
    """The smoother is linear: smoothed noise is the error that noise leaves, beside the bias.

    seen: what was measured, with gaps. of: seed, by how much the noise of channels is louder for a while, and what it
    was before filters.
    """
    seed, louder, before = of
    stairs = {name: steps(values) for name, values in measured.items()}

    def only_noise(number: int) -> dict[str, Array]:
        rng = np.random.default_rng((seed, number))
        drawn = {name: before[name].behind(rng.standard_normal(len(values))) for name, values in measured.items()}
        held = {name: values if (at := stairs[name]) is None else values[at] for name, values in drawn.items()}
        return {name: noise[name] * louder.get(name, 1.0) * values for name, values in held.items()}

    def draw(number: int) -> Draw:
        drawn = only_noise(number)
        error = smooth(drawn, noise, dt, motion.roughness, _of_motion(louder))
        errors = (error.x, error.v, error.a, _inertia(drawn, dt, error)[0])
        return tuple(values.astype(np.float32) for values in errors)

    def biased() -> Draw:
        nothing = np.zeros(len(motion.x), np.float32)
        octave = min(0.5, 2 * followed(noise, dt, motion.roughness)[0])
        if any(before[name].end < octave for name in measured):
            return (nothing,) * 4  # a filter took the octave away in which it would be seen
        found = bias(seen, noise, dt, motion, drawn=only_noise(0), louder=_of_motion(louder))
        return (*(values.astype(np.float32) for values in found), nothing)

    return Draws(draw, biased)


def visible(parts: Sequence[Part], mass: float = 0.0) -> tuple[list[Part], list[str]]:
    """Parts whose motion can be seen, and sentences about the others. Raises HiddenMotion where none can.

    Without x or v, slow motion drowns in the noise of the acceleration; a law with memory cannot be judged without it.
    mass [kg]: as given, 0 where it is not known.
    """
    hidden = [part for part in parts if part.lowest and part.hidden(mass) > _HIDDEN]
    told = [
        f"{part.name}: {100 * part.hidden(mass):.0f} % of the force is below {part.first_Hz:.3g} Hz, where the noise "
        f"of channel {'v' if 'v' in part.noise else 'a'} hides the motion"
        for part in hidden
    ]
    if len(hidden) == len(parts):
        raise HiddenMotion(f"{'; '.join(told)}; record x or v as well")
    return [part for part in parts if not any(part is one for one in hidden)], [f"left out: {text}" for text in told]


def without_x(parts: Sequence[Part]) -> tuple[list[Part], list[str]]:
    """Parts for a law that does not read the displacement: what hides slow displacements hides nothing of it.

    Sentences tell where the displacement is not known.
    """
    blind = [part for part in parts if part.lowest]
    told = [
        f"{part.name}: x is not known below {part.first_Hz:.3g} Hz, and the model does not need it" for part in blind
    ]
    return [replace(part, lowest=0.0, sees_x=not part.lowest) for part in parts], told


def band(part: Part) -> tuple[float, float]:
    """Frequencies that hold all but 1 % of the power of the velocity at either end [Hz]."""
    power = np.cumsum(np.abs(np.fft.rfft(part.v * np.hanning(len(part)))) ** 2)
    frequency = np.fft.rfftfreq(len(part), part.dt)
    low, high = np.searchsorted(power, [_SLOWEST * power[-1], _QUICKEST * power[-1]])
    return float(frequency[low]), float(frequency[high])
