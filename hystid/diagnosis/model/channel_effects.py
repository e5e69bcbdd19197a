"""Faults of the force channel that can be written as a force: they compete with the effects on equal terms."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from types import MappingProxyType

import numpy as np
from scipy.integrate import cumulative_trapezoid

from hystid.diagnosis.model.effects import Effect, Scales, Signals
from hystid.diagnosis.model.semantics import Semantics
from hystid.diagnosis.prepare.faults import SATURATION
from hystid.diagnosis.prepare.rest import does_more_than_noise
from hystid.diagnosis.prepare.segments import Part, band
from hystid.numeric import Array, stretches

HUM, DRIFT, HISTORY = "mains_hum", "force_drift", "history"
HIGH_PASS, RANGE = "force_high_pass", "force_range"
_STEADY_OFFSET = 0.05  # rms of ramps and bows over that of the offsets below which a force channel does not drift
# What is not a law of the structure has no block: a fault of a channel is called so here.
CHANNELS = {
    "channel_delay": Semantics(title="late channel"),
    "channel_gain": Semantics(title="wrong gain of a channel"),
    "channel_zero": Semantics(title="wrong zero of a channel"),
    "dead_channel": Semantics(title="dead channel"),
    SATURATION: Semantics(title="channel that stops at a level"),
    "force_gain": Semantics(title="wrong gain of the force channel"),
    DRIFT: Semantics(title="drift of the force channel"),
    HIGH_PASS: Semantics(title="AC-coupled force channel"),
    "force_low_pass": Semantics(title="low-pass of the force channel"),
    RANGE: Semantics(
        title="wrong gain of the force channel in one recording",
        sentence="The force channel lacks a share of what it shows; where one channel alone shows the motion, that one "
        "may as well read so much too high",
    ),
}
NUISANCES = frozenset({HUM, HISTORY})  # taken out, and no findings


class ChannelEffect(Effect):
    """A fault of the force channel; no law of the structure, hence no part of a model."""

    @property
    def reads(self) -> frozenset[str]:
        """Nothing that a law moves."""
        return frozenset()


class MainsHum(ChannelEffect):
    """A periodic force that nobody measured, of any phase in each recording: the mains on the force channel, a machine
    near by. Taken out, and no finding."""

    def force(self, signals: Signals, parameters: Mapping[str, float]) -> Array:
        """What the channel shows without any force [N], shape (n,)."""
        number = signals.index + 1
        sine, cosine = parameters.get(f"sine_{number}", 0.0), parameters.get(f"cosine_{number}", 0.0)
        sines, cosines = _waves(float(self.form) * signals.dt, len(signals.x))
        return np.asarray(sine * sines + cosine * cosines)


@lru_cache(maxsize=16)
def _waves(turns: float, samples: int) -> tuple[Array, Array]:
    """Sine and cosine of so many turns per sample, (n,) each."""
    angle = 2 * np.pi * turns * np.arange(samples)
    return np.sin(angle), np.cos(angle)


def mains_hum(recordings: int, frequency: float) -> MainsHum:
    """Periodic force of a frequency [Hz] over a number of recordings."""
    names = [f"{kind}_{i + 1}" for i in range(recordings) for kind in ("sine", "cosine")]
    return MainsHum(HUM, f"{frequency:.9g}", "", None, amplitudes=tuple(names), units=dict.fromkeys(names, "N"))


class History(ChannelEffect):
    """Force of a contact that stuck before a recording began, and never let go. Taken out, and no finding."""

    def force(self, signals: Signals, parameters: Mapping[str, float]) -> Array:
        """A constant in the recordings that begin in mid-motion [N], shape (n,)."""
        return np.full(len(signals.x), parameters.get(f"offset_{signals.index + 1}", 0.0))


def history(numbers: Sequence[int]) -> History:
    """What was before the recordings of these numbers, from 0."""
    names = tuple(f"offset_{number + 1}" for number in numbers)
    return History(HISTORY, "", "", None, amplitudes=names, units=dict.fromkeys(names, "N"))


@dataclass(frozen=True)
class _OfMeasuredForce(ChannelEffect):
    """A fault that depends on the measured force, which no signal shows.

    So it is known for the recordings in which it was looked for, by their displacement, and nothing elsewhere. motion:
    displacement [m]; missing: what the channel lacks, per unit of the first amplitude. Shape (n,) per recording.
    """

    motion: tuple[Array, ...] = field(default=(), repr=False)
    missing: tuple[Array, ...] = field(default=(), repr=False)

    def lacking(self, signals: Signals) -> tuple[float, Array]:
        """What the channel lacks, shape (n,), and how it counts: 1, reversed where the motion is mirrored, or 0 for
        another motion."""
        known = self.motion[signals.index] if signals.index < len(self.motion) else np.zeros(0)
        if len(known) != len(signals.x):
            return 0.0, np.zeros(len(signals.x))
        alike = float(known @ signals.x) / max(float(known @ known), 1e-300)
        return float(np.clip(np.rint(alike), -1, 1)), self.missing[signals.index]

    def force(self, signals: Signals, parameters: Mapping[str, float]) -> Array:
        """What the channel lacks [N], shape (n,)."""
        sign, missing = self.lacking(signals)
        return np.asarray(-parameters["share"] * sign * missing)


@dataclass(frozen=True)
class Saturation(_OfMeasuredForce):
    """What a force channel lacks beyond the level at which it stops [N], in each recording. level [N]."""

    level: float = 0.0

    @property
    def size(self) -> int:
        """The level counts as well."""
        return 2

    def grid(self, scales: Scales, near: Mapping[str, float] = MappingProxyType({})) -> list[dict[str, float]]:
        """The level as it was found."""
        return [{"level": self.level}]


def saturation(motion: Sequence[Array], missing: Sequence[Array], level: float) -> Saturation:
    """A force channel that stops at a level [N]. motion [m], missing [N]: (n,) per recording."""
    units = {"share": "1", "level": "N"}
    return Saturation(
        SATURATION, "", "", None, ("share",), units=units, lowest={"share": 0.0}, motion=tuple(motion),
        missing=tuple(missing), level=level,
    )  # fmt: skip


@dataclass(frozen=True)
class HighPass(_OfMeasuredForce):
    """What an AC-coupled force channel of first order lacks: dF/dt = dF_true/dt - omega F, so that F_true is F and
    omega times its integral, but for a constant of each recording that does not begin at rest.

    A piezoelectric sensor discharges so. Amplitudes omega [rad/s], the corner, and offset_1, ... [N]. swings: range of
    the channel in each recording [N].
    """

    swings: tuple[float, ...] = ()

    def force(self, signals: Signals, parameters: Mapping[str, float]) -> Array:
        """What the channel lacks [N], shape (n,)."""
        sign, missing = self.lacking(signals)
        offset = parameters.get(f"offset_{signals.index + 1}", 0.0)
        return np.asarray(-sign * (parameters["omega"] * missing + offset))

    @property
    def needs_clock(self) -> bool:
        """A charge is lost with the time."""
        return True

    @property
    def meanings(self) -> dict[str, str]:
        """What each parameter is."""
        offsets = {f"offset_{i + 1}": f"Force lost before recording {i + 1}" for i in range(len(self.swings))}
        return {"omega": "Angular frequency below which the channel loses force", **offsets}

    def is_possible(self, parameters: Mapping[str, float]) -> bool:
        """What was lost before a recording is no more than the channel swings: it holds no constant force."""
        offsets = [abs(parameters.get(f"offset_{i + 1}", 0.0)) for i in range(len(self.swings))]
        return all(offset < swing for offset, swing in zip(offsets, self.swings, strict=True))

    def of_noise(self, level: float, parameters: Mapping[str, float], like: Signals) -> Array:
        """Noise of the force is summed up as well: it walks at random."""
        return np.asarray(parameters["omega"] * like.dt * level * np.sqrt(np.arange(len(like.x))))


def high_passes(parts: Sequence[Part]) -> list[HighPass]:
    """An AC-coupled force channel, of recordings that begin at rest or, "Charged", of any."""
    motion, impulses = tuple(part.x for part in parts), tuple(_integral(part.F, part.dt) for part in parts)
    offsets = [f"offset_{i + 1}" for i in range(len(parts))]
    units = {"omega": "rad/s", **dict.fromkeys(offsets, "N")}
    return [
        HighPass(
            HIGH_PASS, form, "", None, ("omega", *names), units=units, lowest={"omega": 0.0}, motion=motion,
            missing=impulses, swings=tuple(float(np.ptp(part.F)) for part in parts),
        )
        for form, names in (("", []), ("Charged", offsets))
    ]  # fmt: skip


def _integral(values: Array, dt: float) -> Array:
    return np.asarray(cumulative_trapezoid(values, dx=dt, initial=0))


@dataclass(frozen=True)
class Range(_OfMeasuredForce):
    """What a force channel lacks that was set to another range in one recording: a share of what it shows there."""

    @property
    def meanings(self) -> dict[str, str]:
        """What each parameter is."""
        return {"share": f"Force that the channel lacks in recording {self.form}, as a share of what it shows"}


def ranges(parts: Sequence[Part]) -> list[Range]:
    """A force channel whose gain differs in one recording, for each that shows a force; [] where there is no other one.

    Of a free decay it shows its noise alone, and less of that leaves less.
    """
    motion, still = tuple(part.x for part in parts), [np.zeros(len(part)) for part in parts]
    found = []
    for own, part in enumerate(parts):
        if not does_more_than_noise(part.F, part.noise["F"]):
            continue
        shown = (*still[:own], part.F, *still[own + 1 :])
        made = Range(RANGE, str(own + 1), "", None, ("share",), units={"share": "1"}, lowest={"share": -1.0})
        found.append(replace(made, motion=motion, missing=shown))
    return found if len(parts) > 1 else []


class ForceDrift(ChannelEffect):
    """The force channel has an offset and a ramp of its own in each recording, with a bow, or further polynomials of
    Legendre beside them: its zero wanders, or a filter took slow motion from one of the channels.

    Amplitudes offset_1, ramp_1, bow_1, degree3_1, ... [N, N/s, N, N]. Not a law of the structure, hence in the units of
    the signal and not in Modelica. It appears in the balance as a force that is added to R.
    """

    @property
    def meanings(self) -> dict[str, str]:
        """What each parameter is."""
        kinds = {
            "offset": "Mean force without any",
            "ramp": "Its change with time",
            "bow": "Its bend over time",
            "swing": "Standard deviation of what wanders beside these",
        }
        numbers = sorted({name.partition("_")[2] for name in self.amplitudes})
        return {f"{kind}_{n}": f"{meaning}, in recording {n}" for n in numbers for kind, meaning in kinds.items()}

    @property
    def needs_clock(self) -> bool:
        """A ramp runs with the time."""
        return self.form != "Constant"

    def force(self, signals: Signals, parameters: Mapping[str, float]) -> Array:
        """What the channel shows without any force [N], shape (n,)."""
        t = np.arange(len(signals.x)) * signals.dt
        number = signals.index + 1
        value = parameters.get(f"offset_{number}", 0.0) + parameters.get(f"ramp_{number}", 0.0) * (t - t[-1] / 2)
        curve = (t / t[-1] - 0.5) ** 2 - 1 / 12
        value = value + parameters.get(f"bow_{number}", 0.0) * curve
        higher = [parameters.get(f"degree{degree}_{number}", 0.0) for degree in range(_BOWED, _DEGREES)]
        if any(higher):
            value = value + np.polynomial.legendre.legval(
                2 * t / t[-1] - 1, np.trim_zeros([0.0] * _BOWED + higher, "b")
            )
        return np.asarray(value)


_WANDERING = "Wandering"
_BOWED, _DEGREES = 3, 24  # polynomials of a bow; and most that are fitted to a recording, for the time that it takes
_KINDS = {"Constant": ("offset",), "": ("offset", "ramp"), "Bowed": ("offset", "ramp", "bow")} | {
    f"{_WANDERING}{most}": ("offset", "ramp", "bow", *(f"degree{degree}" for degree in range(_BOWED, most)))
    for most in (6, 12, _DEGREES)
}


def force_drifts(parts: Sequence[Part]) -> list[ForceDrift]:
    """Drifts of the force channel: a constant of each recording, of one recording a preload, with a ramp, with a bow,
    and with so many polynomials as all recordings tell. None that is slower than all motion that is seen: each half of
    a period is a bend."""
    recordings, most = len(parts), max(_BOWED, min(map(_bends, parts)))
    unseen = min(part.lowest * part.dt * len(part) / np.pi for part in parts)
    forms = [form for form, kinds in _KINDS.items() if unseen < len(kinds) <= most]
    return [force_drift(recordings, form) for form in forms if form != "Constant" or recordings > 1]


def _bends(part: Part) -> float:
    """How many bends of a drift a recording tells: fewer than the slowest motion has periods, and none of them within
    a rest, which no fit sees."""
    rests = stretches(part.rest) if part.rest is not None else []
    longest = max((last - first for first, last in rests), default=1)
    return min(band(part)[0] * part.dt, 1 / longest) * len(part)


def force_drift(recordings: int, form: str = "") -> ForceDrift:
    """One form of the drift of the force channel: "Constant", "" with a ramp, "Bowed", or "Wandering"."""
    names: Sequence[str] = [f"{kind}_{i + 1}" for i in range(recordings) for kind in _KINDS[form]]
    units = {name: "N/s" if name.startswith("ramp") else "N" for name in names}
    return ForceDrift(DRIFT, form, "", None, amplitudes=tuple(names), units=units)


def wanders(effect: Effect) -> bool:
    """Whether an effect is a drift of the force channel with more bends than a bow."""
    return effect.id == DRIFT and effect.form.startswith(_WANDERING)


def is_constant(values: Mapping[str, float], parts: Sequence[Part]) -> bool:
    """Whether a drift of the force channel is next to nothing but a constant per recording."""
    offset = sum(values[f"offset_{i + 1}"] ** 2 for i in range(len(parts)))
    ramp = sum((values.get(f"ramp_{i + 1}", 0.0) * part.t[-1]) ** 2 / 12 for i, part in enumerate(parts))
    bow = sum(values.get(f"bow_{i + 1}", 0.0) ** 2 / 180 for i in range(len(parts)))
    wave = any(name.startswith("degree") for name in values)
    return not wave and bool(ramp + bow < _STEADY_OFFSET**2 * offset)
