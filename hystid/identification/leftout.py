"""What one quick network leaves of the force on samples that it has not seen: the judge of lags and of spreads.

The network sees (x, v, x0, R0, further inputs, lags), with the measured force R0 at the turning points: no simulation,
a fraction of a second, and close enough to the two-network model to compare one choice with another. Where whole
recordings are left out, its forces are scaled by their level: else those at another value of an input are a guess.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from hystid.identification import data
from hystid.networks import FurtherInput, Lag
from hystid.networks.level import Level
from hystid.networks.training import RULES, Data, Scaling, initial_weights, train
from hystid.recording import Array, Recording
from hystid.turning_points import TurningPoints

_HIDDEN = (8, 8)
_SAMPLES = 4_000  # enough for some 200 weights
_STARTS = 2
_BLOCKS = 40  # of each recording, of which a quarter is left out
_STRETCHES = 4  # of each recording, where there are too few recordings to leave one out


class LeftOut:
    """Samples of all recordings one after the other, from which some are left out."""

    def __init__(self, recordings: Sequence[Recording], inputs: Sequence[FurtherInput], seed: int) -> None:
        self.recordings, self.inputs, self.seed = recordings, tuple(inputs), seed
        found = data.samples(recordings, TurningPoints(), inputs)
        self._table = np.stack([found.x, found.v, found.x0, found.R0, *found.further])
        self._seen = np.stack([found.x, found.v, *found.further])
        self.R = found.R
        self._columns: dict[Lag, Array] = {}
        blocks = self._parts(_BLOCKS)
        drawn = np.random.default_rng(seed).permutation(_BLOCKS * len(recordings))
        self.scattered = np.isin(blocks, drawn[: len(drawn) // 4])

    def _parts(self, count: int) -> NDArray[np.intp]:
        """Number of the part that each sample lies in, with so many equal parts per recording."""
        return np.concatenate([count * np.arange(len(r)) // len(r) + count * k for k, r in enumerate(self.recordings)])

    def column(self, lag: Lag) -> Array:
        """The lag at all samples, shape (n,)."""
        if lag not in self._columns:
            follow = [data.motions([r], self.inputs, (lag,))[0].further[-1] for r in self.recordings]
            self._columns[lag] = np.concatenate(follow)
        return self._columns[lag]

    def power(
        self,
        lags: Sequence[Lag],
        out: NDArray[np.bool_],
        judged: NDArray[np.bool_] | None = None,
        by_level: bool = False,
    ) -> float:
        """Mean square error [N2] on the samples ``judged`` (``out`` where not given) without those of ``out``.

        by_level: forces scaled by their level at the samples seen (``Level``).
        """
        rng = np.random.default_rng(self.seed)
        known = rng.permutation(np.flatnonzero(~out))[:_SAMPLES]
        test = rng.permutation(np.flatnonzero(out if judged is None else judged))[:_SAMPLES]
        rows, R, spread = np.stack([*self._table, *(self.column(lag) for lag in lags)]), self.R, 1.0
        if by_level and self.inputs:
            x, R0, further = rows[0], rows[3], rows[4:]
            level = Level.of(x[known], further[:, known], R[known])
            R, rows[3] = ((force - level.centre(x, further)) / level.spread(further) for force in (R, R0))
            spread = float(np.sqrt(np.mean(level.spread(further[:, test]) ** 2)))
        scaling, goal = Scaling.of(rows), Scaling.of(R[None])
        inputs, target = scaling.apply(rows), goal.apply(R[None])[0]
        cut = len(known) * 17 // 20
        parts = {"train": known[:cut], "validation": known[cut:], "test": test}
        split = Data({name: (inputs[:, at], target[at]) for name, at in parts.items()}, scaling, goal)
        sizes = (len(rows), *_HIDDEN, 1)
        starts = [initial_weights(sizes, np.random.default_rng([self.seed, k])) for k in range(_STARTS)]
        errors = [train(split, _HIDDEN, w, rule=RULES["fast"]).test for w in starts]
        return float(min(errors) * (spread / goal.gain[0]) ** 2)

    def inflation(self, lags: Sequence[Lag]) -> float:
        """How much greater the error is on a recording of its own than on scattered parts of known ones, at least 1.

        Each recording is left out in turn, or each quarter of all where there are fewer than three; only samples within
        the range of the rest are judged.
        """
        whole = len(self.recordings) >= 3
        part = self._parts(1) if whole else self._parts(_STRETCHES) % _STRETCHES
        powers = []
        for number in range(int(part.max()) + 1):
            out = part == number
            low, high = (bound(self._seen[:, ~out], axis=1)[:, None] for bound in (np.min, np.max))
            judged = out & ((self._seen >= low) & (self._seen <= high)).all(axis=0)
            if judged.sum() >= len(self.recordings[0]) // _BLOCKS:
                powers.append(self.power(lags, out, judged, whole))
        if not powers:
            return 1.0
        return float(max(1.0, np.sqrt(np.median(powers) / self.power(lags, self.scattered, None, whole))))
