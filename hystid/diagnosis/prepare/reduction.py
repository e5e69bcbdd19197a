"""Columns over samples turned into rows with unit noise: whitened, trimmed, averaged in blocks and weighted.

Whatever is done to the balance (whitening, block averages, weights) is done to every column alike.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.polynomial.legendre import legvander
from numpy.typing import NDArray
from scipy.linalg import orth
from scipy.ndimage import maximum_filter1d

from hystid.diagnosis.prepare.differences import FIRST, SECOND
from hystid.diagnosis.prepare.filtering import filtered, quick_length
from hystid.diagnosis.prepare.segments import Part, band
from hystid.numeric import Array, Flags
from hystid.smoothing.noise import NOISE_ERROR, steps
from hystid.smoothing.smoother import BELOW

ROWS = 16_000  # of the least squares problems; more are averaged in blocks
_SLOW, _LEAST = 8, 2  # blocks per period of the quickest motion, and samples that are averaged all the same
_MOST, _STRETCHES = 40_000, 24  # rows beyond which stretches of each recording are taken, and how many
_DECAY = 10.0  # radians at the corner of a whitening filter after which nothing is left of an end (exp(-7))
_AT_ONCE = 8  # columns that are reduced together: more leave the processor's cache
_SHORT = 7  # samples per block that are added column by column
_SPECTRUM = 4096  # lines over which a spectrum is averaged
_ROUGHLY = 4.0  # in power: half an octave tells the bias of the smoother within a factor of two
_JUMP, _RARE = 4.0, 0.999  # mean square movement, noise units, beyond which a row is weighed down; quantile looked at


class Reduction:
    """Turns columns over the samples of all parts into weighted rows with unit noise.

    Each part: whitening where the acceleration had to be derived (its noise then grows with frequency), where noise of
    the displacement is loud in the force of a slow test, or where the displacement had to be integrated (its noise then
    grows towards low frequencies), trimming of the ends that this disturbs, block averages, division by the noise
    level.
    """

    def __init__(self, parts: Sequence[Part], mass: float) -> None:
        self.parts = tuple(parts)
        total = sum(len(part) for part in parts)
        alike = int(0.5 / min(part.noise_ends for part in parts))  # samples whose noise a filter makes one
        self.block = max(alike, min(total // ROWS, max(_LEAST, *(_slowly(part) for part in parts))))
        self._trust: Array | None = None
        self._open = np.zeros(1)  # variance that rows have as nobody knows where a law stands
        self._basis: list[tuple[slice, Array]] | None = None
        slopes = _slopes(parts, mass)
        self._filters = [_Filter.of(part, _whitening(part, mass, slopes), mass) for part in parts]
        pairs = list(zip(self.parts, self._filters, strict=True))
        self._followed = [_followed(p, f.response, mass, slopes) for p, f in pairs]
        self._trims = [_trim(p, f.response) for p, f in pairs]
        self._weights = [np.sqrt(self.block) / part.balance_noise(mass) for part in parts]
        self._kept = [self._stretches(i, total) for i in range(len(self.parts))]
        self._taken = [None if kept is None else _places(kept) for kept in self._kept]
        self._louder = [_louder_balance(part, mass) for part in parts]
        self._even = self._evened() if any(one is not None for one in self._louder) else None

    def __call__(self, columns: Sequence[Array]) -> Array:
        """Rows of all parts, (rows,), from one column (n,) per part; of k columns at once, (k, rows) from (k, n). Where
        a user took straight lines off channels, they hold no slow polynomial that this leaves unknown."""
        rows = self._weighted(columns)
        for own, basis in self._unknown():
            rows[..., own] -= (rows[..., own] @ basis) @ basis.T
        return rows

    def _weighted(self, columns: Sequence[Array]) -> Array:
        made = [column if f.response is None else f(column) for f, column in zip(self._filters, columns, strict=True)]
        rows = np.concatenate([self.plain(i, column) * self._weights[i] for i, column in enumerate(made)], axis=-1)
        if self._even is not None:
            rows *= self._even
        return rows if self._trust is None else rows * self._trust

    def _unknown(self) -> list[tuple[slice, Array]]:
        """Rows of recordings that hold a polynomial nobody knows, and an orthonormal basis of these, (rows, k)."""
        degrees = [part.unknown_degree for part in self.parts]
        if not any(degrees):
            return []
        if self._basis is None:
            ends = np.cumsum([0, *(len(self.plain(i, part.x)) for i, part in enumerate(self.parts))])
            own = [slice(first, end) for first, end in pairwise(ends)]
            places = [np.linspace(-1.0, 1.0, len(part)) for part in self.parts]
            rows = self._weighted([np.asarray(legvander(place, max(degrees)), np.float64).T for place in places])
            self._basis = [
                (at, orth(rows[: 1 + degree, at].T)) for at, degree in zip(own, degrees, strict=True) if degree
            ]
        return self._basis

    def several(self, columns: Sequence[Sequence[Array]]) -> list[Array]:
        """Rows of several columns, each one per part: some at once, in half the time of one by one."""
        groups = (columns[first : first + _AT_ONCE] for first in range(0, len(columns), _AT_ONCE))
        return [row for group in groups for row in self([np.stack(part) for part in zip(*group, strict=True)])]

    def spread(self, columns: Sequence[Array]) -> Array:
        """Rows of standard deviations, one column per part. Whether errors keep their sign from sample to sample is not
        known: after a filter the larger of the two counts."""
        rows = []
        for i, (column, filt) in enumerate(zip(columns, self._filters, strict=True)):
            power = column**2
            if filt.response is not None:
                alone = filtered(filt.over(power), np.asarray(np.fft.rfft(np.fft.irfft(filt.response) ** 2).real))
                power = np.maximum(alone, filt(column) ** 2)
            rows.append(np.sqrt(self.plain(i, power)) * self._weights[i])
        return np.concatenate(rows)

    def biased(self, bias: Sequence[Array], left: Array) -> Array:
        """Standard deviation of rows, (rows,), in which the smoother is biased; 0 where more is left there than that
        explains: a law is missing, and they tell it as others do.

        bias: what it does to the force [N], one column per part. left: rows of what a fit leaves.
        """
        pairs = zip(bias, self.parts, strict=True)
        rows = self.spread([maximum_filter1d(np.abs(force), int(1 / part.follows)) for force, part in pairs])
        there = rows > 1
        explained = np.any(there) and np.mean(left[there] ** 2) <= _ROUGHLY * np.mean(1 + rows[there] ** 2)
        return rows if explained else np.zeros(1)

    def whitened(self, columns: Sequence[Array]) -> list[Array]:
        """One column per part at all its samples, (n,), in units of the white noise."""
        noises = [np.sqrt(self.block) / weight for weight in self._weights]
        made = [f(column) / noise for f, column, noise in zip(self._filters, columns, noises, strict=True)]
        return [u if by is None else u / by for u, by in zip(made, self._louder, strict=True)]

    def _evened(self) -> Array:
        """Weights of rows whose noise is louder for a while."""
        ones = [np.ones(len(part)) if by is None else by for part, by in zip(self.parts, self._louder, strict=True)]
        return np.concatenate([1 / np.sqrt(self.plain(i, by**2)) for i, by in enumerate(ones)])

    def distrust(self, draws: Sequence[Array], filtered: Array, unsure: Array) -> None:
        """Weigh down the rows in which the noise of the regressors moves the force by more than its own noise.

        draws: rows of such movements, not weighed. filtered: rows of what filters of the recording chain leave open.
        unsure: standard deviations of rows in which nobody knows on which side of its jump a law stands; they are
        noise as well. A law that jumps where the velocity changes sign is the case in mind: where the jump falls is not
        known to the sample, and its neighbours say nothing about the law.
        """
        spread = maximum_filter1d(np.mean([rows**2 for rows in draws], axis=0), 3)
        wide = spread + filtered**2 + unsure**2
        if float(np.quantile(wide, _RARE)) > _JUMP:
            self._trust, self._basis = np.where(wide > _JUMP, 1.0 / np.sqrt(1.0 + wide), 1.0), None
        self._open = unsure**2

    def trust(self) -> None:
        """Weigh all rows alike again."""
        self._trust, self._open, self._basis = None, np.zeros(1), None

    def trusted(self, index: int) -> Array:
        """Weight of each sample of one part beside that of its noise, (n,): 1 where the law is sure, 0 where no row is
        made of it."""
        weights = np.zeros(len(self.parts[index]))
        trim, kept = self._trims[index], self._kept[index]
        rows = (len(weights) - 2 * trim) // self.block
        taken = np.ones(rows, dtype=bool) if kept is None else kept
        first = sum(len(self.plain(i, part.x)) for i, part in enumerate(self.parts[:index]))
        found = np.zeros(rows)
        count = int(np.count_nonzero(taken))
        found[taken] = 1.0 if self._trust is None else self._trust[first : first + count]
        weights[trim : trim + rows * self.block] = np.repeat(found, self.block)
        return weights

    def evenly(self, rows: Array) -> Array:
        """Rows as if all were trusted alike."""
        return rows if self._trust is None else rows / self._trust

    @cached_property
    def count(self) -> int:
        """Number of rows."""
        return sum(len(self.plain(i, part.x)) for i, part in enumerate(self.parts))

    def sure(self) -> Flags:
        """Rows, (rows,), that are not weighed down."""
        return np.ones(self.count, dtype=bool) if self._trust is None else self._trust == 1.0

    def told(self) -> Flags:
        """Rows, (rows,), that are not weighed down, and in which it is known where a law stands."""
        return np.asarray(self.sure() & (self._open < NOISE_ERROR))

    @property
    def is_local(self) -> bool:
        """Whether a row holds what its own samples do, and nothing of those before and after."""
        return all(filt.response is None for filt in self._filters)

    @property
    def weighs(self) -> bool:
        """Whether some rows are weighed down."""
        return self._trust is not None

    @property
    def level(self) -> float:
        """Mean square of rows that hold noise alone."""
        return self._overall(lambda i, cycles: self.parts[i].seen(2 * np.pi * cycles))

    @property
    def followed(self) -> float:
        """Share of it that noise of the motion makes through the restoring force, as far as the whitening knows."""
        return self._overall(self.followed_at)

    def followed_at(self, index: int, cycles: Array) -> Array:
        """The same of one part at frequencies [cycles per sample]."""
        return _over_band(self._followed[index], cycles)

    def _overall(self, share: Callable[[int, Array], Array]) -> float:
        """What averages of a block leave of a share of the noise that is known of each part at frequencies [cycles per
        sample]; white noise leaves 1."""
        cycles = np.linspace(0.0, 0.5, _SPECTRUM + 1)[1:]
        averaged = np.sin(np.pi * cycles * self.block) ** 2 / np.sin(np.pi * cycles) ** 2 / self.block
        shares = [
            float(np.mean(share(i, cycles) * averaged * _over_band(part.noise_passed, cycles)))
            for i, part in enumerate(self.parts)
        ]
        mean = float(np.average(shares, weights=[len(part) for part in self.parts]))
        return mean if self._trust is None else mean * float(np.mean(self._trust**2))

    def left_open(self, rows: Array) -> float:
        """Mean square of rows (rows,) that says nothing, as nobody knows where a law stands: as little as they show. A
        row that is weighed down leaves no more than 1 by that."""
        sure, weight = self.sure(), 1.0 if self._trust is None else self._trust**2
        shown, most = rows**2 - weight, np.where(sure, self._open, 1.0 - weight)
        return sum(float(np.clip(np.mean(shown * one), 0.0, np.mean(most * one))) for one in (sure, ~sure))

    def used(self, index: int) -> Flags:
        """Samples of one part of which rows are made, (n,), where all of them are taken."""
        part, trim = self.parts[index], self._trims[index]
        found = np.zeros(len(part), dtype=bool)
        found[trim : len(part) - trim] = True
        valid = self._filters[index].valid
        return found if valid is None else found & valid

    def plain(self, index: int, column: Array) -> Array:
        """A column of one part, (n,) or several (k, n), at its rows: trimmed and averaged alike, but neither whitened
        nor weighted."""
        trim, samples = self._trims[index], column.shape[-1]
        inner = column[..., trim : samples - trim]
        rows = inner.shape[-1] // self.block
        means = _means(inner[..., : rows * self.block].reshape(*inner.shape[:-1], rows, self.block))
        taken = self._taken[index]
        return np.asarray(means if taken is None else means[..., taken])

    def _stretches(self, index: int, total: int) -> Flags | None:
        """Rows of one part that are taken: those that are valid, in stretches all along where there are very many. None
        for all of them. What runs along with the time, or with the path, is seen from the beginning to the end."""
        part, trim = self.parts[index], self._trims[index]
        rows = (len(part) - 2 * trim) // self.block
        share = _MOST * self.block / total
        kept = np.ones(rows, dtype=bool)
        if share < 1:
            kept &= np.arange(rows) * _STRETCHES / rows % 1 < share
        valid = self._filters[index].valid
        if valid is not None:
            kept &= valid[trim : trim + rows * self.block].reshape(rows, self.block).all(axis=1)
        return None if kept.all() else kept


def _places(kept: Flags) -> slice | NDArray[np.int64]:
    """Where flags are set; a slice, which copies nothing, where they are so from one place to another."""
    places = np.flatnonzero(kept)
    whole = len(places) > 0 and int(places[-1] - places[0]) == len(places) - 1
    return slice(int(places[0]), int(places[-1]) + 1) if whole else places


@dataclass(frozen=True)
class _Filter:
    """A filter of one part that keeps what is not valid from the rows beside it.

    response: of the whole filter, None for none. valid: samples that it leaves valid, None for all of them.
    image: samples by which a column is continued before the first valid one, its mirror image, as at its end.
    Where slow noise is whitened as well, the filter has two steps, with straight lines over what is not valid in
    between: the first reaches a few samples far, None for none, the second as far as slow noise does.
    gap: these samples; before, after: those on either side of their gaps; share: how near they are to the latter.
    """

    response: Array | None
    valid: Flags | None
    image: NDArray[np.int64]
    first: Array | None
    second: Array | None
    gap: NDArray[np.int64]
    before: NDArray[np.int64]
    after: NDArray[np.int64]
    share: Array

    @classmethod
    def of(cls, part: Part, response: Array | None, mass: float) -> _Filter:
        """That of a part."""
        local, spreads = _local(part, response, mass)
        valid, begun = _clean(part.valid, local), 0 if part.valid is None else int(np.argmax(part.valid))
        image = np.pad(np.arange(begun, len(part)), (begun, 0), "symmetric")[:begun]
        none = np.zeros(0, np.int64)
        if not spreads or response is None or valid is None or np.all(valid) or not np.any(valid):
            return cls(response, valid, image, None, response, none, none, none, np.zeros(0))
        known, gap = np.flatnonzero(valid), np.flatnonzero(~valid)
        place = np.searchsorted(known, gap)
        before, after = known[np.maximum(place - 1, 0)], known[np.minimum(place, len(known) - 1)]
        share = (gap - before) / np.maximum(after - before, 1)
        second = response if local is None else response / local
        return cls(response, valid, image, local, second, gap, before, after, share)

    def __call__(self, column: Array) -> Array:
        """A column, (n,) or several (k, n), after all steps."""
        if len(self.image):
            column = np.concatenate([column[..., self.image], column[..., len(self.image) :]], axis=-1)
        if self.first is not None:
            column = filtered(column, self.first)
        column = self.over(column)
        return column if self.second is None else filtered(column, self.second)

    def over(self, column: Array) -> Array:
        """Columns with straight lines over the gaps; they begin and end as they do beside a gap there."""
        if not len(self.gap):
            return column
        made = np.array(column)
        made[..., self.gap] = (1 - self.share) * column[..., self.before] + self.share * column[..., self.after]
        return made


def _local(part: Part, response: Array | None, mass: float) -> tuple[Array | None, bool]:
    """The step of a filter that takes the noise of a derivative, None for none, and whether there is another one, which
    spreads what is not valid far. That noise cancels over time: it must stay whole until it is filtered."""
    spreads = response is not None and (bool(part.lowest) or any(part.colour) or "x" in part.noise)
    if response is None or not _is_derived(part, mass):
        return None, spreads
    omega = np.pi * np.arange(len(response)) / (len(response) - 1)
    noise = mass * _derived_noise(part, omega) / part.noise["F"]
    return np.asarray(1 / np.sqrt(1 + noise**2)), spreads


def _clean(valid: Flags | None, local: Array | None) -> Flags | None:
    """Samples that a local filter keeps from what is not valid, unless it leaves hardly any."""
    if valid is None or local is None:
        return valid
    corner = (
        max(int(np.argmax(local < 0.7)), 1) * np.pi / (len(local) - 1)
    )  # a derivative hides no noise at the very end
    reach = int(min(_DECAY / corner, len(valid)))
    clean = np.asarray(maximum_filter1d((~valid).astype(np.int8), 2 * reach + 1, mode="nearest") == 0)
    return clean if 2 * np.count_nonzero(clean) > np.count_nonzero(valid) else valid


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


def _is_derived(part: Part, mass: float) -> bool:
    """Whether the balance holds an acceleration that was not measured."""
    return part.inertia_order > 0 and mass != 0.0


def _whitening(part: Part, mass: float, slopes: tuple[float, float]) -> Array | None:
    """Frequency response that makes the noise of the balance white; None where it is white already.

    slopes: see ``_slopes``. At a resonance noise of the motion cancels between inertia and restoring force. This is
    left alone: it would take a filter that rings.
    """
    whitens_x, coloured = _whitens_x(part, mass, slopes), any(part.colour)
    if not whitens_x and not part.lowest and not coloured:
        return None
    n = 2 * quick_length(len(part))
    omega = 2 * np.pi * np.arange(n // 2 + 1) / n
    power = np.ones_like(omega)
    if _is_derived(part, mass):
        power += (mass * _derived_noise(part, omega) / part.noise["F"]) ** 2
    if whitens_x:
        power += _restoring(part, mass, slopes, omega)
    if part.lowest:
        turn = omega**2 + (BELOW["v" if "v" in part.noise else "a"] * part.first) ** 2
        drift = part.noise["v"] * part.dt / np.sqrt(turn) if "v" in part.noise else part.noise["a"] * part.dt**2 / turn
        power += (slopes[0] * drift / part.balance_noise(mass)) ** 2
    if coloured:
        power /= colouring(part) ** 2
    if not part.lowest:
        return np.asarray(1.0 / np.sqrt(power))
    high = (omega / part.first) ** 8
    return np.asarray(np.sqrt(high / (1.0 + high) / power))


def _restoring(part: Part, mass: float, slopes: tuple[float, float], omega: Array) -> Array:
    """Power that noise of the displacement makes through the restoring force over that of the balance, at angular
    frequencies [rad per sample]; 0 where the displacement was not measured.

    Without a mass the stiffness alone counts: a slope over the velocity may be that of dry friction, which noise does
    not move while it slides."""
    if "x" not in part.noise:
        return np.zeros_like(omega)
    error = np.interp(omega, np.linspace(0, np.pi, len(part.error_of_x)), part.error_of_x)
    damper = slopes[1] if _is_derived(part, mass) else 0.0
    return np.asarray((np.hypot(slopes[0], damper * omega / part.dt) * error / part.balance_noise(mass)) ** 2)


def _whitens_x(part: Part, mass: float, slopes: tuple[float, float]) -> bool:
    """Whether the noise of the displacement is whitened as well: where the acceleration was derived, and where nothing
    has a mass and it is louder through the stiffness than that of the force. Beside an acceleration that was measured
    it cancels in part, as the smoother makes one motion of both; and the error of a channel with coarse steps stays
    the same over a step, and is not white."""
    if mass:
        return _is_derived(part, mass)
    if "x" not in part.measured or steps(part.measured["x"]) is not None:
        return False
    omega = np.linspace(0, np.pi, len(part.error_of_x))
    return bool(np.max(_restoring(part, mass, slopes, omega)) > 1)


def _followed(part: Part, response: Array | None, mass: float, slopes: tuple[float, float]) -> Array:
    """The same after whitening, at equal steps of the frequency from 0 to half of the sample rate."""
    if response is None or not _whitens_x(part, mass, slopes):
        return np.zeros(2)
    white = response / colouring(part) if any(part.colour) else response
    return np.asarray(_restoring(part, mass, slopes, np.linspace(0, np.pi, len(response))) * white**2)


def colouring(part: Part) -> Array:
    """Frequency response that makes its noise white.

    1/f noise goes on below the lowest line, as long as the zero of the sensors is old: its density there, over the
    width of a line, stands in the mean.
    """
    n = 2 * quick_length(len(part))
    cycles = np.maximum(np.arange(n // 2 + 1), 1) / n
    power = 1 + part.colour[0] / cycles + part.colour[1] / cycles**2
    power[0] += part.colour[0] * n * max(np.log(max(part.since, part.dt) / (n * part.dt)) - 1, 0)
    return np.asarray(1 / np.sqrt(power))


def longest_trim(samples: int) -> int:
    """Samples of which no rows are made at either end of a recording, at most."""
    return samples // 8


def _trim(part: Part, response: Array | None) -> int:
    """Samples at either end that derivation and whitening disturb: what happens at an end decays with the corners.

    Where the acceleration alone was measured, so do place and speed at the end, which nobody knows.
    """
    samples, first = len(part), part.first * (1.0 if "v" in part.noise else BELOW["a"])
    least, most = max(len(FIRST) // 2 + 1, samples // 200), longest_trim(samples)
    if response is None:
        return least
    high = np.flatnonzero(response > 0.7 * np.max(response))[-1] * np.pi / (len(response) - 1)
    slow = min(high, first) if first else high
    return int(np.clip(_DECAY / slow, least, most)) if slow > 0 else most


def _slopes(parts: Sequence[Part], mass: float) -> tuple[float, float]:
    """Slopes of the restoring force over the displacement [N/m] and the velocity [N.s/m], for the size of what errors
    of these do. A constant force has none, and dry friction one at its turning points alone."""
    force = np.concatenate([part.F - mass * part.a for part in parts])
    motion = np.stack([np.concatenate([getattr(part, name) for part in parts]) for name in ("x", "v")])
    size = np.std(motion, axis=1)
    known = size > 0
    columns = [*(motion[known] / size[known, None]), np.sign(motion[1]), np.ones(len(force))]
    found = np.zeros(2)
    found[known] = np.linalg.lstsq(np.stack(columns, axis=1), force, rcond=None)[0][:-2] / size[known]
    return float(found[0]), float(found[1])


def _over_band(column: Array, cycles: Array) -> Array:
    """A column (m,) over equal steps of the frequency from 0 to half of the sample rate, at others [cycles per
    sample]."""
    return np.asarray(np.interp(2 * cycles, np.linspace(0.0, 1.0, len(column)), column))


def _response(weights: Array, omega: Array) -> Array:
    shift = np.arange(len(weights)) - len(weights) // 2
    return np.asarray(np.abs(np.exp(1j * np.outer(omega, shift)) @ weights))


def _means(blocks: Array) -> Array:
    """Means along the last axis; of few values they are added one after the other, ten times as fast."""
    count = blocks.shape[-1]
    if count == 1:
        return blocks[..., 0]
    if count > _SHORT:
        return np.asarray(blocks.mean(axis=-1))
    total = blocks[..., 0] + blocks[..., 1]
    for k in range(2, count):
        total += blocks[..., k]
    return np.asarray(total / count)
