"""Recordings made ready: smoothed motion as regressors, raw force balance as evidence, one reduction for both.

The force balance F - m a is taken from the raw channels, so that its noise is white and of known level. Only the
regressors are smoothed. Whatever is done to the balance (whitening, block averages, weights) is done to every column
alike.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from scipy.fft import dct, idct, next_fast_len
from scipy.ndimage import maximum_filter1d
from scipy.special import factorial

from hystid.diagnosis.prepare.refused import NotDiagnosable
from hystid.recording import Recording
from hystid.smoothing.noise import louder_for_a_while, noise_level, steps
from hystid.smoothing.smoother import BELOW, Smoothed, smooth

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
Single = NDArray[np.float32]
_ROWS = 16_000  # rows of the least squares problems; more are averaged in blocks
_SLOW, _LEAST = 8, 2  # blocks per period of the quickest motion, and samples that are averaged all the same
_MOST, _STRETCHES = 40_000, 24  # rows beyond which stretches of each recording are taken, and how many
_SLOWEST, _QUICKEST = 0.01, 0.99  # shares of the power of the velocity below the slowest and the quickest motion
_MODEL_ERROR = 5e-4  # share of a channel below which differences are not worth a name (integration, interpolation)
DRAWS = 3
_DECAY = 10.0  # radians at the corner of a whitening filter after which nothing is left of an end (exp(-7))
_HIDDEN = 0.05  # share of the force below the visible frequencies, beyond which a recording says too little
_TERMS, _LONG = 16, 50_000  # of the series for delays, and samples beyond which there is none
_SIZES, _SMALL = np.pi ** np.arange(_TERMS) / factorial(np.arange(_TERMS)), 1e-10  # terms of it at most, and of no use
_SHORT = 7  # samples per block that are added column by column
_STOPS = 4.0  # standard deviations of noise on a level at which a channel stops: one sample in 30,000 lies below
_JUMP, _RARE = 4.0, 0.999  # mean square movement, noise units, beyond which a row is weighed down; quantile looked at
# Central differences of eighth order: exact to 0.1 % up to a fifth of the sample rate.
FIRST = np.array([1 / 280, -4 / 105, 1 / 5, -4 / 5, 0.0, 4 / 5, -1 / 5, 4 / 105, -1 / 280])
SECOND = np.array([-1 / 560, 8 / 315, -1 / 5, 8 / 5, -205 / 72, 8 / 5, -1 / 5, 8 / 315, -1 / 560])


class HiddenMotion(NotDiagnosable):
    """The channels that were recorded do not show the motion; the message says from where on."""


@dataclass(frozen=True)
class Part:
    """One recording, ready for fitting. Arrays of shape (n,), SI units.

    x, v, a: smoothed motion. F: force as measured. inertia: unbiased acceleration, for the balance F - m a
    (the channel itself, or a plain derivative of the best one). noise: standard deviation per channel.
    lowest: angular frequency [rad/s] below which the motion is not seen and x is held at zero; 0 where x was measured.
    past: samples after the first one that are run backwards before it: a law with memory begins as in mid-motion.
    louder: noise of a channel over ``noise``, (n,), where it is louder for a while.
    timed: whether time was measured; else it only numbers the samples. extra: further columns of the file, (n,) each.
    sees_x: whether the displacement is known at all frequencies that matter.
    colour: power of the noise of all channels over its white part, times the frequency [cycles per sample], and times
    its square: 1/f noise, and a wandering zero. pace: samples in the time of one of the first recording.
    jitter: draws of the error that channel noise leaves in (x, v, a) after smoothing, and of that in inertia; in single
    precision, as they are many.
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
    jitter: tuple[tuple[Single, ...], ...] = field(repr=False, default=())
    sees_x: bool = True
    colour: tuple[float, float] = (0.0, 0.0)
    pace: float = 1.0
    louder: Mapping[str, Array] = field(repr=False, default_factory=dict)

    def __len__(self) -> int:
        return len(self.t)

    def led_in(self, x: Array, v: Array) -> tuple[Array, Array]:
        """Displacement and velocity (n,) with the past before them, (past + n,)."""
        back = slice(self.past, 0, -1)
        return (np.concatenate([x[back], x]), np.concatenate([-v[back], v])) if self.past else (x, v)

    @property
    def first(self) -> float:
        """Lowest visible frequency [rad per sample]."""
        return self.lowest * self.dt

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

    def balance_noise(self, mass: float) -> float:
        """Standard deviation of F - m a per sample [N], where the acceleration was measured; else of F alone."""
        if self.inertia_order == 0 and "a" in self.noise:
            return float(np.hypot(self.noise["F"], mass * self.noise["a"]))
        return self.noise["F"]


def prepare_part(recording: Recording, seed: int = 0, stopped: Mapping[str, float] | None = None) -> Part:
    """Noise levels, smoothing and the unbiased acceleration of one recording; needs F and one of x, v, a.

    stopped: channels that stop at a level; samples there count as missing.
    """
    F, dt = recording.channel("F"), recording.dt
    measured = measured_motion(recording)
    noise = {name: noise_level(values) for name, values in measured.items()}
    noise["F"] = max(noise_level(F), _MODEL_ERROR * float(np.std(F)))
    louder = _louder({**measured, "F": F}, noise)
    known, valid = _without_stops({**measured, "F": F}, noise, stopped or {})
    seen, force = {name: known[name] for name in measured}, np.nan_to_num(known["F"])
    motion = smooth(seen, noise, dt, None, _of_motion(louder), force)
    inertia, order = _inertia(measured, dt)
    return Part(
        recording.name, recording.t - recording.t[0], dt, F, motion.x, motion.v, motion.a, inertia, order, noise,
        {**measured, "F": F}, valid, motion.roughness.lowest, 0, not recording.quasi_static,
        {name: column for name, column in recording.extra.items() if len(column) == len(F)},
        _jitter(measured, noise, dt, motion, (seed, louder)), louder=louder,
    )  # fmt: skip


def _louder(channels: Mapping[str, Array], noise: dict[str, float]) -> dict[str, Array]:
    """Noise of channels over its level, (n,) each, where it is louder for a while; ``noise`` is told the level of the
    rest then."""
    found = {}
    for name, values in channels.items():
        if (uneven := louder_for_a_while(values)) is not None:
            level, factor = uneven
            quiet = min(noise[name], level)
            if name == "F":
                quiet = max(quiet, _MODEL_ERROR * float(np.std(values)))
            found[name] = np.maximum(factor * level / quiet, 1.0)
            noise[name] = quiet
    return found


def _of_motion(louder: Mapping[str, Array]) -> dict[str, Array]:
    return {name: factor for name, factor in louder.items() if name != "F"}


def measured_motion(recording: Recording) -> dict[str, Array]:
    """The channels of the motion that were measured; see ``independence.measurements`` for those that were computed."""
    found = {name: getattr(recording, name) for name in "xva"}
    return {
        name: np.asarray(values, dtype=float)
        for name, values in found.items()
        if values is not None and recording.direct(name)
    }


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


def _inertia(measured: dict[str, Array], dt: float) -> tuple[Array, int]:
    """Acceleration without smoothing, and how many derivatives it took."""
    if "a" in measured:
        return measured["a"], 0
    if "v" in measured:
        return stencil(measured["v"], FIRST) / dt, 1
    return stencil(measured["x"], SECOND) / dt**2, 2


def stencil(values: Array, weights: Array) -> Array:
    """Convolve with a central difference (per sample time); the ends repeat the outermost value."""
    inner = np.convolve(values, weights[::-1], mode="valid")
    return np.pad(inner, len(weights) // 2, mode="edge")


def _jitter(
    measured: dict[str, Array],
    noise: dict[str, float],
    dt: float,
    motion: Smoothed,
    of: tuple[int, Mapping[str, Array]],
) -> tuple[tuple[Single, ...], ...]:
    """The smoother is linear, so that smoothed noise is the error that noise leaves.

    of: seed, and by how much the noise of channels is louder for a while.
    """
    seed, louder = of
    rng = np.random.default_rng(seed)
    draws = []
    stairs = {name: steps(values) for name, values in measured.items()}
    for _ in range(DRAWS):
        drawn = {name: rng.standard_normal(len(values)) for name, values in measured.items()}
        held = {name: values if (at := stairs[name]) is None else values[at] for name, values in drawn.items()}
        only_noise = {name: noise[name] * louder.get(name, 1.0) * values for name, values in held.items()}
        error = smooth(only_noise, noise, dt, motion.roughness, _of_motion(louder))
        errors = (error.x, error.v, error.a, _inertia(only_noise, dt)[0])
        draws.append(tuple(values.astype(np.float32) for values in errors))
    return tuple(draws)


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


class Reduction:
    """Turns columns over the samples of all parts into weighted rows with unit noise.

    Each part: whitening where the acceleration had to be derived (its noise then grows with frequency) or the
    displacement to be integrated (its noise then grows towards low frequencies), trimming of the ends that this
    disturbs, block averages, division by the noise level.
    """

    def __init__(self, parts: Sequence[Part], mass: float) -> None:
        self.parts = tuple(parts)
        total = sum(len(part) for part in parts)
        self.block = max(1, min(total // _ROWS, max(_LEAST, *(_slowly(part) for part in parts))))
        self._trust: Array | None = None
        self.jumps = False  # whether a law jumps: noise of the regressors, or its shape, moves rows far
        stiffness = _stiffness(parts, mass)
        self._filters = [_whitening(part, mass, stiffness) for part in parts]
        filters = [filt for filt in self._filters if filt is not None]
        alike = len(filters) == len(parts) and len({len(part) for part in parts}) == 1
        self._together = np.stack(filters) if alike else None
        self._trims = [_trim(len(p), filt, p.first) for p, filt in zip(self.parts, self._filters, strict=True)]
        self._weights = [np.sqrt(self.block) / part.balance_noise(mass) for part in parts]
        self._kept = [self._stretches(i, total) for i in range(len(self.parts))]
        self._louder = [_louder_balance(part, mass) for part in parts]
        self._even = self._evened() if any(one is not None for one in self._louder) else None

    def __call__(self, columns: Sequence[Array]) -> Array:
        """Rows of all parts, shape (rows,), from one column per part."""
        made = self._whitened(columns)
        rows = np.concatenate([self.plain(i, column) * self._weights[i] for i, column in enumerate(made)])
        if self._even is not None:
            rows *= self._even
        return rows if self._trust is None else rows * self._trust

    def whitened(self, columns: Sequence[Array]) -> list[Array]:
        """One column per part at all its samples, (n,), in units of the white noise."""
        noises = [np.sqrt(self.block) / weight for weight in self._weights]
        made = [column / noise for column, noise in zip(self._whitened(columns), noises, strict=True)]
        return [u if by is None else u / by for u, by in zip(made, self._louder, strict=True)]

    def _evened(self) -> Array:
        """Weights of rows whose noise is louder for a while."""
        ones = [np.ones(len(part)) if by is None else by for part, by in zip(self.parts, self._louder, strict=True)]
        return np.concatenate([1 / np.sqrt(self.plain(i, by**2)) for i, by in enumerate(ones)])

    def _whitened(self, columns: Sequence[Array]) -> Sequence[Array]:
        """Columns of all parts after their filters, in one transform where the parts are of one length."""
        if self._together is not None:
            return list(filtered(np.stack(columns), self._together))
        return [c if filt is None else filtered(c, filt) for c, filt in zip(columns, self._filters, strict=True)]

    def distrust(self, draws: Sequence[Array], filtered: Array) -> None:
        """Weigh down the rows in which the noise of the regressors moves the force by more than its own noise.

        draws: rows of such movements, not weighed. filtered: rows of what filters of the recording chain leave open. A
        law that jumps where the velocity changes sign is the case in mind: where the jump falls is not known to the
        sample, and its neighbours say nothing about the law.
        """
        spread = maximum_filter1d(np.mean([rows**2 for rows in draws], axis=0), 3)
        wide = spread + filtered**2
        self.jumps = float(np.quantile(spread, _RARE)) > _JUMP
        if float(np.quantile(wide, _RARE)) > _JUMP:
            self._trust = np.where(wide > _JUMP, 1.0 / np.sqrt(1.0 + wide), 1.0)

    def trust(self) -> None:
        """Weigh all rows alike again."""
        self._trust, self.jumps = None, False

    def evenly(self, rows: Array) -> Array:
        """Rows as if all were trusted alike."""
        return rows if self._trust is None else rows / self._trust

    @property
    def is_local(self) -> bool:
        """Whether a row holds what its own samples do, and nothing of those before and after."""
        return all(filt is None for filt in self._filters)

    @property
    def weighs(self) -> bool:
        """Whether some rows are weighed down."""
        return self._trust is not None

    @property
    def level(self) -> float:
        """Mean square of rows that hold noise alone."""
        seen = float(np.average([self._seen(part) for part in self.parts], weights=[len(part) for part in self.parts]))
        return seen if self._trust is None else seen * float(np.mean(self._trust**2))

    def _seen(self, part: Part) -> float:
        """Share of the band of the rows in which the motion of a part can be seen."""
        if not part.lowest:
            return 1.0
        omega = np.linspace(0.0, np.pi / self.block, 2049)[1:]
        high = (omega / part.first) ** 8
        return float(np.mean(high / (1.0 + high)))

    def used(self, index: int) -> Flags:
        """Samples of one part of which rows are made, (n,), where all of them are taken."""
        part, trim = self.parts[index], self._trims[index]
        found = np.zeros(len(part), dtype=bool)
        found[trim : len(part) - trim] = True
        return found if part.valid is None else found & part.valid

    def plain(self, index: int, column: Array) -> Array:
        """A column of one part at its rows: trimmed and averaged alike, but neither whitened nor weighted."""
        trim = self._trims[index]
        inner = column[trim : len(column) - trim]
        rows = len(inner) // self.block
        means = _means(inner[: rows * self.block].reshape(rows, self.block))
        kept = self._kept[index]
        return np.asarray(means if kept is None else means[kept])

    def _stretches(self, index: int, total: int) -> Flags | None:
        """Rows of one part that are taken: those that are valid, in stretches all along where there are very many. None
        for all of them. What runs along with the time, or with the path, is seen from the beginning to the end."""
        part, trim = self.parts[index], self._trims[index]
        rows = (len(part) - 2 * trim) // self.block
        share = _MOST * self.block / total
        kept = np.ones(rows, dtype=bool)
        if share < 1:
            kept &= np.arange(rows) * _STRETCHES / rows % 1 < share
        if part.valid is not None:
            kept &= part.valid[trim : trim + rows * self.block].reshape(rows, self.block).all(axis=1)
        return None if kept.all() else kept


def band(part: Part) -> tuple[float, float]:
    """Frequencies that hold all but 1 % of the power of the velocity at either end [Hz]."""
    power = np.cumsum(np.abs(np.fft.rfft(part.v * np.hanning(len(part)))) ** 2)
    frequency = np.fft.rfftfreq(len(part), part.dt)
    low, high = np.searchsorted(power, [_SLOWEST * power[-1], _QUICKEST * power[-1]])
    return float(frequency[low]), float(frequency[high])


def _slowly(part: Part) -> int:
    """Samples over which the quickest motion of a part changes little."""
    return int(1 / (_SLOW * part.dt * max(band(part)[1], 1 / (len(part) * part.dt))))


def _derived_noise(part: Part, omega: Array) -> Array:
    """Noise of an acceleration that was derived, over angular frequencies [rad per sample], (n,) [m/s2]."""
    weights, name = (SECOND, "x") if part.inertia_order == 2 else (FIRST, "v")
    return _response(weights, omega) / part.dt**part.inertia_order * part.noise[name]


def _louder_balance(part: Part, mass: float) -> Array | None:
    """Noise of the whitened balance over its level, (n,), where it is louder for a while; None elsewhere."""
    if not part.louder:
        return None
    name = ("a", "v", "x")[part.inertia_order]
    if part.inertia_order:
        power = (mass * _derived_noise(part, np.linspace(0, np.pi, 257)) / part.noise["F"]) ** 2
        share = float(np.mean(1 / (1 + power)))  # of the force in what is white
    else:
        share = (part.noise["F"] / part.balance_noise(mass)) ** 2
    ones = np.ones(len(part))
    squares = share * part.louder.get("F", ones) ** 2 + (1 - share) * part.louder.get(name, ones) ** 2
    return np.asarray(np.sqrt(squares))


def _whitening(part: Part, mass: float, stiffness: float) -> Array | None:
    """Frequency response that makes the noise of the balance white; None where it is white already."""
    derived = part.inertia_order > 0 and mass != 0.0
    coloured = any(part.colour) and not part.lowest
    if not derived and not part.lowest and not coloured:
        return None
    n = 2 * _quick(len(part))
    omega = 2 * np.pi * np.arange(n // 2 + 1) / n
    power = np.ones_like(omega)
    if derived:
        power += (mass * _derived_noise(part, omega) / part.noise["F"]) ** 2
    if coloured:
        power /= colouring(len(part), part.colour) ** 2
    if part.lowest:
        turn = omega**2 + (BELOW["v" if "v" in part.noise else "a"] * part.first) ** 2
        high = (omega / part.first) ** 8
        drift = part.noise["v"] * part.dt / np.sqrt(turn) if "v" in part.noise else part.noise["a"] * part.dt**2 / turn
        power += (stiffness * drift / part.balance_noise(mass)) ** 2
        return np.asarray(np.sqrt(high / (1.0 + high) / power))
    return np.asarray(1.0 / np.sqrt(power))


def colouring(samples: int, colour: tuple[float, float]) -> Array:
    """Frequency response that makes noise of this colour white."""
    n = 2 * _quick(samples)
    cycles = np.maximum(np.arange(n // 2 + 1), 1) / n
    return np.asarray(1 / np.sqrt(1 + colour[0] / cycles + colour[1] / cycles**2))


def _trim(samples: int, response: Array | None, first: float) -> int:
    """Samples at either end that derivation and whitening disturb: what happens at an end decays with the corners."""
    least, most = max(5, samples // 200), samples // 8
    if response is None:
        return least
    high = np.flatnonzero(response > 0.7 * np.max(response))[-1] * np.pi / (len(response) - 1)
    slow = min(high, first) if first else high
    return int(np.clip(_DECAY / slow, least, most)) if slow > 0 else most


def _stiffness(parts: Sequence[Part], mass: float) -> float:
    """Slope of the restoring force over the displacement [N/m], for the size of what an error of the latter does."""
    force = np.concatenate([part.F - mass * part.inertia for part in parts])
    x = np.concatenate([part.x for part in parts])
    power = float(x @ x)
    return abs(float(x @ force)) / power if power > 0 else 0.0


def _response(weights: Array, omega: Array) -> Array:
    shift = np.arange(len(weights)) - len(weights) // 2
    return np.asarray(np.abs(np.exp(1j * np.outer(omega, shift)) @ weights))


def filtered(column: Array, response: Array) -> Array:
    """Zero-phase filter along the last axis; its mirror image continues the column, hence the cosine transform.

    response: shape (..., m + 1) for a length m that transforms quickly, at least that of the column.
    """
    samples, length = column.shape[-1], response.shape[-1] - 1
    if length > samples:
        column = np.pad(column, [(0, 0)] * (column.ndim - 1) + [(0, length - samples)], mode="symmetric")
    return np.asarray(idct(dct(column) * response[..., :-1])[..., :samples])


def _quick(samples: int) -> int:
    """Length of a transform: a prime number takes ten times as long as one of small factors."""
    return int(next_fast_len(samples, real=True))


def _means(blocks: Array) -> Array:
    """Mean of each row of (rows, block); short rows are added column by column, ten times as fast as one by one."""
    if blocks.shape[1] == 1:
        return np.array(blocks[:, 0])
    if blocks.shape[1] > _SHORT:
        return np.asarray(blocks.mean(axis=1))
    total = blocks[:, 0] + blocks[:, 1]
    for k in range(2, blocks.shape[1]):
        total += blocks[:, k]
    return np.asarray(total / blocks.shape[1])


class Advanced:
    """``advanced`` for many numbers of samples, one after another.

    Between whole samples it is a power series in the rest, of which half a sample needs 16 terms to 1e-10; that of
    the last whole number of samples is kept. Long signals, for which it would take too much memory, go without.
    """

    def __init__(self, values: Array) -> None:
        self._values = values
        self._whole: int | None = None
        self._series = np.empty((0, 0))

    def __call__(self, samples: float) -> Array:
        """The signal, moved; its edges are kept."""
        whole = round(samples)
        if len(self._values) > _LONG:
            return advanced(self._values, samples)
        if whole != self._whole:
            self._whole, self._series = whole, self._about(whole)
        powers = (samples - whole) ** np.arange(_TERMS)
        told = int(np.count_nonzero(np.abs(powers) * _SIZES > _SMALL))
        return _with_edges(powers[:told] @ self._series[:told], self._values, samples)

    def _about(self, whole: int) -> Array:
        """Coefficients of the powers of what is left beside a whole number of samples, shape (_TERMS, n)."""
        spectrum, turn = _mirrored(self._values)
        spectrum, rows = spectrum * np.exp(turn * whole), []
        for power in range(1, _TERMS + 1):
            rows.append(_unmirrored(spectrum, self._values))
            spectrum = spectrum * (turn / power)
        return np.stack(rows)


def advanced(values: Array, samples: float) -> Array:
    """A signal moved earlier by any number of samples: band-limited interpolation of its mirrored copy. Its edges are
    kept."""
    spectrum, turn = _mirrored(values)
    return _with_edges(_unmirrored(spectrum * np.exp(turn * samples), values), values, samples)


def _mirrored(values: Array) -> tuple[NDArray[np.complex128], NDArray[np.complex128]]:
    """Spectrum of a signal and its mirror image behind it, and by what a sample's advance turns it."""
    spectrum = np.fft.rfft(np.concatenate([values, values[::-1]]))
    return spectrum, np.asarray(2j * np.pi * np.fft.rfftfreq(2 * len(values)), np.complex128)


def _unmirrored(spectrum: NDArray[np.complex128], values: Array) -> Array:
    return np.asarray(np.fft.irfft(spectrum, 2 * len(values))[: len(values)])


def _with_edges(moved: Array, values: Array, samples: float) -> Array:
    edge = int(np.ceil(abs(samples))) + 1
    moved[:edge], moved[-edge:] = values[:edge], values[-edge:]
    return moved
