"""Columns over samples turned into rows with unit noise: whitened, trimmed, averaged in blocks and weighted.

Whatever is done to the balance (whitening, block averages, weights) is done to every column alike.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.polynomial.legendre import legvander
from numpy.typing import NDArray
from scipy.linalg import orth
from scipy.ndimage import maximum_filter1d

from hystid.diagnosis.prepare.filtering import filtered
from hystid.diagnosis.prepare.segments import Part, band
from hystid.diagnosis.prepare.whitening import Filter, followed, louder_balance, slopes_of_force, trim, whitening
from hystid.numeric import Array, Flags
from hystid.smoothing.noise import NOISE_ERROR

ROWS = 16_000  # of the least squares problems; more are averaged in blocks
_SLOW, _LEAST_AVERAGED = 8, 2  # blocks per period of the quickest motion, and samples that are averaged all the same
_MOST_ROWS, _STRETCHES = 40_000, 24  # rows beyond which stretches of each recording are taken, and how many
_AT_ONCE = 8  # columns that are reduced together: more leave the processor's cache
_SHORT = 7  # samples per block that are added column by column
_SPECTRUM = 4096  # lines over which a spectrum is averaged
_ROUGHLY = 4.0  # in power: half an octave tells the bias of the smoother within a factor of two
_JUMP, _QUANTILE = 4.0, 0.999  # mean square movement, noise units, that weighs a row down; quantile looked at


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
        self.block = max(alike, min(total // ROWS, max(_LEAST_AVERAGED, *(_slowly(part) for part in parts))))
        self._trust: Array | None = None
        self._open = np.zeros(1)  # variance that rows have as nobody knows where a law stands
        self._basis: list[tuple[slice, Array]] | None = None
        slopes = slopes_of_force(parts, mass)
        self._filters = [Filter.of(part, whitening(part, mass, slopes), mass) for part in parts]
        pairs = list(zip(self.parts, self._filters, strict=True))
        self._followed = [followed(p, f.response, mass, slopes) for p, f in pairs]
        self._trims = [trim(p, f.response) for p, f in pairs]
        self._weights = [np.sqrt(self.block) / part.balance_noise(mass) for part in parts]
        self._kept = [self._stretches(i, total) for i in range(len(self.parts))]
        self._taken = [None if kept is None else _places(kept) for kept in self._kept]
        self._louder = [louder_balance(part, mass) for part in parts]
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
        if float(np.quantile(wide, _QUANTILE)) > _JUMP:
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
        share = _MOST_ROWS * self.block / total
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


def _slowly(part: Part) -> int:
    """Samples over which the quickest motion of a part changes little."""
    return int(1 / (_SLOW * part.dt * max(band(part)[1], 1 / (len(part) * part.dt))))


def _over_band(column: Array, cycles: Array) -> Array:
    """A column (m,) over equal steps of the frequency from 0 to half of the sample rate, at others [cycles per
    sample]."""
    return np.asarray(np.interp(2 * cycles, np.linspace(0.0, 1.0, len(column)), column))


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
