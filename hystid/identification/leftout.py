"""What one quick network leaves of the force on samples that it has not seen: the judge of lags and of spreads.

The network sees (x, v, x0, R0, further inputs, lags), with the measured force R0 at the turning points: no simulation,
a fraction of a second, and close enough to the two-network model to compare one choice with another. Where whole
recordings are left out, its forces are scaled by their level: else those at another value of an input are a guess.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from hystid.identification import data
from hystid.identification.levels import levels_of
from hystid.identification.prediction import respond
from hystid.networks import FurtherInput, Lag, Polyline, TwoNetworkModel
from hystid.networks.level import Level
from hystid.networks.training import RULES, Data, Scaling, initial_weights, train
from hystid.networks.trust import Spread
from hystid.recording import Array, Recording
from hystid.turning_points import TurningPoints

_HIDDEN = (8, 8)
_SAMPLES = 4_000  # enough for some 200 weights
_STARTS = 2
_BLOCKS = 40  # of each recording, of which a quarter is left out
_SHARE = 0.9  # that of the band which R_spread states
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

    def power(self, lags: Sequence[Lag], out: NDArray[np.bool_]) -> float:
        """Mean square error [N2] on the samples ``out`` without those."""
        return float(np.mean(self._errors(lags, out, out, by_level=False) ** 2))

    def _errors(self, lags: Sequence[Lag], out: NDArray[np.bool_], judged: NDArray[np.bool_], by_level: bool) -> Array:
        """Errors [N] on some of the samples ``judged`` without those of ``out``.

        by_level: forces scaled by their level at the samples seen (``Level``).
        """
        rng = np.random.default_rng(self.seed)
        known = rng.permutation(np.flatnonzero(~out))[:_SAMPLES]
        test = rng.permutation(np.flatnonzero(judged))[:_SAMPLES]
        rows, R, spread = np.stack([*self._table, *(self.column(lag) for lag in lags)]), self.R, np.ones(len(test))
        if by_level and self.inputs:
            x, R0, further = rows[0], rows[3], rows[4:]
            level = Level.of(x[known], further[:, known], R[known])
            R, rows[3] = ((force - level.centre(x, further)) / level.spread(further) for force in (R, R0))
            spread = level.spread(further[:, test])
        scaling, goal = Scaling.of(rows), Scaling.of(R[None])
        inputs, target = scaling.apply(rows), goal.apply(R[None])[0]
        cut = len(known) * 17 // 20
        parts = {"train": known[:cut], "validation": known[cut:], "test": test}
        split = Data({name: (inputs[:, at], target[at]) for name, at in parts.items()}, scaling, goal)
        sizes = (len(rows), *_HIDDEN, 1)
        starts = [initial_weights(sizes, np.random.default_rng([self.seed, k])) for k in range(_STARTS)]
        found = min((train(split, _HIDDEN, w, rule=RULES["fast"]) for w in starts), key=lambda each: each.test)
        return np.asarray(spread * (split.network(found.w, _HIDDEN)(*rows[:, test]) - R[test]))

    def spread(self, model: TwoNetworkModel, unseen: NDArray[np.bool_] | None, share: float = 1.0) -> Spread:
        """Spread of share times the model's force, from its errors on samples that were not trained on.

        unseen: those samples, shape (n,); None for all. The spread is that of the members' whole forces.
        """
        answers = [respond(model, recording) for recording in self.recordings]
        error = share * np.concatenate([R for R, _ in answers]) - self.R
        deviation = np.concatenate([np.std(each, axis=1) for _, each in answers])
        at = slice(None) if unseen is None else unseen
        inflation, between = self.inflation(model.lags)
        return replace(Spread.fit(error[at], deviation[at], inflation), between=between)

    def inflation(self, lags: Sequence[Lag]) -> tuple[float, tuple[Polyline | None, ...]]:
        """How much greater errors are than on scattered parts of known recordings, at least 1: on a recording of its
        own at inputs that were trained on; and, for each further input, times what between its levels.

        Each recording is left out in turn, or each quarter of all where there are fewer than three or levels of an
        input; only samples within the range of the rest are judged. Then each level that has others on both sides.
        Between two levels it is the greater the farther from both, most in the middle.
        """
        known = self._reach(lags, self.scattered)
        tables = [self._levels(port) for port in self.inputs]
        whole = len(self.recordings) >= 3 and not any(tables)
        part = self._parts(1) if whole else self._parts(_STRETCHES) % _STRETCHES
        found = [self._reach(lags, part == number) / known for number in range(int(part.max()) + 1)]
        alike = float(max(1.0, np.nanmedian(found))) if np.isfinite(found).any() else 1.0
        return alike, tuple(table and self._between(lags, *table, alike * known) for table in tables)

    def two_levels(self) -> tuple[str, ...]:
        """Sentences on inputs that stand at two levels, between which no recording says what errors are."""
        found = ((port, self._levels(port)) for port in self.inputs)
        return tuple(
            f"{port.column} stands at two levels, {levels[0][0]:.4g} and {levels[0][1]:.4g} {port.unit}: no recording "
            "says how far R is off between them, so that R_spread is that at the levels there, and too small where "
            "zeros or friction of the recordings differ; record a third level between"
            for port, levels in found
            if levels and len(levels[0]) == 2
        )

    def _levels(self, port: FurtherInput) -> tuple[Array, NDArray[np.intp]] | None:
        """Levels of an input that stands at one of them in each recording, as a tension set per test."""
        found = levels_of(np.concatenate([recording.channel(port.column) for recording in self.recordings]))
        if found is None or any(np.ptp(found[1][self._parts(1) == k]) for k in range(len(self.recordings))):
            return None
        return found

    def _between(self, lags: Sequence[Lag], at: Array, number: NDArray[np.intp], known: float) -> Polyline | None:
        """Greater errors between the levels of an input; None where no level lies between others."""
        heights = []
        for k in range(1, len(at) - 1):
            near = min(at[k] - at[k - 1], at[k + 1] - at[k]) / (at[k + 1] - at[k - 1])
            heights.append((self._reach(lags, number == k) / known - 1.0) / (2.0 * near))
        if not np.isfinite(heights).any():
            return None
        height = 1.0 + max(0.0, float(np.nanmean(heights)))
        middles = (at[1:] + at[:-1]) / 2
        to = np.insert(np.ones(len(at)), np.arange(1, len(at)), height)
        return Polyline(tuple(np.insert(at, np.arange(1, len(at)), middles).tolist()), tuple(to.tolist()))

    def _reach(self, lags: Sequence[Lag], out: NDArray[np.bool_]) -> float:
        """Magnitude that nine in ten errors [N] stay below on the samples ``out``, as far as they lie within the range
        of the rest; NaN where hardly any do."""
        low, high = (bound(self._seen[:, ~out], axis=1)[:, None] for bound in (np.min, np.max))
        judged = out & ((self._seen >= low) & (self._seen <= high)).all(axis=0)
        if judged.sum() < len(self.recordings[0]) // _BLOCKS:
            return float("nan")
        return float(np.quantile(np.abs(self._errors(lags, out, judged, by_level=True)), _SHARE))
