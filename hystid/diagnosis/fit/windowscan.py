"""Which effect could it be, and when: every law in every window of time, projected on what the baseline cannot absorb.

A matched filter in time. Products of a law's columns are summed over blocks of time, so that each window costs a few
additions and no further evaluation of the law. Recordings have windows of their own, or none, and one law in all.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from hystid.diagnosis.fit.hypothesis import Fit, Term
from hystid.diagnosis.fit.problem import Problem, standing
from hystid.diagnosis.fit.search import ABSORBED, ScannedForm, complement, try_fit
from hystid.diagnosis.fit.windows import LEAST_OUT, Window, Windowed, Windows, windowed
from hystid.diagnosis.model.effects import Effect
from hystid.diagnosis.prepare.segments import Part
from hystid.numeric import Array

Numbers = NDArray[np.int64]
_BLOCKS = 40  # blocks of each recording between which a window may begin and end
_FIRST, _LAST = np.triu_indices(_BLOCKS + 1, 1)  # blocks at which intervals begin, and before which they end
_LEAST_IN = 0.03  # share of all rows inside of windows
_TRIMMED, _TRIMS = 1 / 3, 4  # share of the rows that a trimmed fit keeps, and rounds
_NOISE_ERRORS = 3.0  # standard errors of the power of a block up to which it is noise
_POINTS = 2  # grid points of each form of which the windows of all recordings are looked for together
_SWEEPS = 4  # of choosing the window of each recording beside those of the others
_SETTLED = 1e-3  # relative gain of a sweep that ends them
_WINDOW_WORTH = 0.01  # share of the gain that the window of one recording must add: a right law leaves as much
_ELSEWHERE = 0.5  # share of the rest of a recording that another window must take: a wrong law takes some anywhere
_ORDER_APART = 0.05  # share of a law's columns by which window and whitening may differ in order
_RAMP = 0.8  # of a block, over which an effect comes and goes: a jump would be louder than any real one
_RIDGE = 1e-9  # of the squared length of columns, in a window and over all rows, against those that are zero or alike


@np.errstate(over="ignore", invalid="ignore")  # columns that are not finite are left out
def scan_windows(problem: Problem, fitted: Fit, effects: Sequence[Effect]) -> list[ScannedForm]:
    """The best grid point of every form with its windows, the largest gain first; [] where time was not measured, or
    the motion falls as it goes on.

    Forms that would act in nearly all rows, or in hardly any, are left out.
    """
    if not problem.timed or problem.unforced:
        return []
    seen = _Seen(problem, fitted)
    found = [made for effect in effects if (made := seen.best(effect)) is not None]
    return sorted(found, key=lambda candidate: -candidate.gain)


@dataclass(frozen=True)
class _Columns:
    """Rows (rows, k) of a law at one point of its shapes, scaled to unit length, and their lengths (k,)."""

    scaled: Array = field(repr=False)
    lengths: Array


@dataclass(frozen=True)
class _Sums:
    """Products of k columns of a law in every interval of every recording: with what is known (the basis, and
    the residual beyond it as the last one), (recordings, intervals, known, k), and with each other, (..., k, k)."""

    known: Array = field(repr=False)
    each: Array = field(repr=False)


@dataclass(frozen=True)
class _Choice:
    """Interval of each recording, None where it has none, with the gain and the amplitudes."""

    gain: float
    intervals: tuple[int | None, ...]
    amplitudes: Array


class _Seen:
    """Rows of a fit by blocks of time, and what laws explain of them in windows."""

    def __init__(self, problem: Problem, fitted: Fit) -> None:
        self.problem, self.fitted = problem, fitted
        self.signals = problem.signals(fitted.hypothesis)
        self.spans = [float(part.t[-1]) for part in problem.parts]
        own = _blocks(problem)
        place = np.concatenate(own)
        self.ends = np.cumsum([len(block) for block in own])
        self.counts = np.bincount(place, minlength=len(own) * _BLOCKS)
        before = np.cumsum(self.counts) - self.counts
        self.at = place * int(np.max(self.counts)) + np.arange(len(place)) - before[place]  # rows follow the time
        outside = complement(problem, fitted)
        self.known = np.column_stack([outside.basis, outside(fitted.residual)])
        self.table = np.ascontiguousarray(self._by_block(self.known).transpose(0, 2, 1))
        self.least = 2 * float(np.log(len(place)))  # what two times cost (Schwarz 1978)

    def best(self, effect: Effect) -> ScannedForm | None:
        """The best grid point of a form with its windows."""
        points = []
        grid = effect.grid(self.problem.scales)
        made = self.problem.columns(effect, grid, self.signals)
        for place, scaled, lengths in zip(made.places, made.scaled, made.lengths, strict=True):
            columns = _Columns(scaled.T, lengths)
            if np.any(lengths > 0):
                sums = self._sums(columns.scaled)
                alone, _ = _gains(sums.known, sums.each, _lowest(effect, columns))
                points.append((float(np.sum(np.max(alone, axis=1))), grid[place], columns, sums))
        found: ScannedForm | None = None
        for _, shapes, columns, sums in sorted(points, key=lambda point: -point[0])[:_POINTS]:
            if not self._commutes(effect, shapes, columns):
                sums = self._exact_sums(effect, shapes, columns)
            choice = self._chosen(sums, _lowest(effect, columns))
            if (found is None or choice.gain > found.gain) and self._is_window(choice):
                found = self._scanned(effect, shapes, columns, choice)
        return found

    def _scanned(self, effect: Effect, shapes: Mapping[str, float], columns: _Columns, choice: _Choice) -> ScannedForm:
        here = windowed(effect, self._windows(choice))
        amplitudes = choice.amplitudes / np.where(columns.lengths > 0, columns.lengths, np.inf)
        values = dict(zip(effect.amplitudes, map(float, amplitudes), strict=True))
        return ScannedForm(Term(here, {**shapes, **values, **here.near}), choice.gain, 0.0)

    def _windows(self, choice: _Choice) -> Windows:
        pairs = enumerate(zip(choice.intervals, self.spans, strict=True))
        return {
            i: Window(float(_FIRST[k] / _BLOCKS * span), float(_LAST[k] / _BLOCKS * span))
            for i, (k, span) in pairs
            if k is not None
        }

    def _is_window(self, choice: _Choice) -> bool:
        inside = sum(
            int(np.sum(self.counts[i * _BLOCKS + _FIRST[k] : i * _BLOCKS + _LAST[k]]))
            for i, k in enumerate(choice.intervals)
            if k is not None
        )
        return _LEAST_IN <= inside / len(self.known) <= 1 - LEAST_OUT

    def _by_block(self, rows: Array) -> Array:
        """Rows (rows, k) by block of time, (blocks, rows of a block, k), zeros where a block has fewer."""
        found = np.zeros((len(self.counts) * int(np.max(self.counts)), rows.shape[1]))
        found[self.at] = rows
        return found.reshape(len(self.counts), -1, rows.shape[1])

    def _sums(self, columns: Array) -> _Sums:
        table = self._by_block(columns)
        known, each = (
            _within(products.reshape(len(self.spans), _BLOCKS, *products.shape[1:]))
            for products in (self.table @ table, table.transpose(0, 2, 1) @ table)
        )
        return _Sums(known, each)

    def _commutes(self, effect: Effect, shapes: Mapping[str, float], columns: _Columns) -> bool:
        """Whether a window of whitened columns is the whitened column of a window. It is not where noise is slow, and
        the force in the window is a constant."""
        if self.problem.reduce.is_local:
            return True
        middle = [_gate(part.t, span, _BLOCKS // 3, 2 * _BLOCKS // 3) for part, span in self._parts()]
        gate = np.concatenate([self.problem.reduce.plain(i, on) for i, on in enumerate(middle)])
        inside = columns.scaled * gate[:, None]
        made = self._gated(effect, shapes, columns, middle)
        return float(np.sum((made - inside) ** 2)) < _ORDER_APART * float(np.sum(inside**2))

    def _parts(self) -> list[tuple[Part, float]]:
        return list(zip(self.problem.parts, self.spans, strict=True))

    def _gated(self, effect: Effect, shapes: Mapping[str, float], columns: _Columns, gates: Sequence[Array]) -> Array:
        """Rows (rows, k) of the law in its gates, in the scale of its columns."""
        made = []
        for at, length in zip(effect.units_at(shapes), columns.lengths, strict=True):
            forces = effect.forces(self.signals, at)
            made.append(self.problem.reduce([f * on for f, on in zip(forces, gates, strict=True)]) / (length or 1.0))
        return np.stack(made, axis=1)

    def _exact_sums(self, effect: Effect, shapes: Mapping[str, float], columns: _Columns) -> _Sums:
        """The same with every block of the force whitened by itself: what blocks leave in each other counts."""
        each = np.stack(
            [
                self._gated(effect, shapes, columns, [_gate(part.t, span, k, k + 1) for part, span in self._parts()])
                for k in range(_BLOCKS)
            ]
        )  # (blocks, rows, k)
        pieces = np.split(each, self.ends[:-1], axis=1)
        bases = np.split(self.known, self.ends[:-1])
        known = [basis.T @ rows for basis, rows in zip(bases, pieces, strict=True)]
        squares = [np.einsum("brk,crl->bckl", rows, rows, optimize=True) for rows in pieces]
        return _Sums(_within(np.stack(known)), _between(np.stack(squares)))

    def _chosen(self, sums: _Sums, lowest: Array) -> _Choice:
        """Intervals of all recordings, one after the other beside those of the others, the clearest first."""
        count = len(sums.known)
        known, each = np.zeros(sums.known.shape[2:]), np.zeros(sums.each.shape[2:])
        intervals: list[int | None] = [None] * count
        alone, _ = _gains(sums.known, sums.each, lowest)
        total, order = 0.0, np.argsort(-np.max(alone, axis=1))
        for _ in range(_SWEEPS):
            before = total
            for i in order:
                if (k := intervals[i]) is not None:
                    known, each = known - sums.known[i, k], each - sums.each[i, k]
                without = float(_gains(known[None], each[None], lowest)[0][0])
                gains, _ = _gains(known + sums.known[i], each + sums.each[i], lowest)
                best = int(np.argmax(gains))
                total = float(gains[best])
                intervals[i] = best if total - without > max(self.least, _WINDOW_WORTH * total) else None
                if intervals[i] is None:
                    total = without
                else:
                    known, each = known + sums.known[i, best], each + sums.each[i, best]
            if total <= before * (1 + _SETTLED):
                break
        gain, amplitudes = _gains(known[None], each[None], lowest)
        return _Choice(float(gain[0]), tuple(intervals), amplitudes[0])


def _blocks(problem: Problem) -> list[Numbers]:
    """Number of the block of time of each row, per recording; those of all recordings are counted on."""
    shares = [problem.reduce.plain(i, part.t) / part.t[-1] for i, part in enumerate(problem.parts)]
    return [np.minimum((t * _BLOCKS).astype(np.int64), _BLOCKS - 1) + i * _BLOCKS for i, t in enumerate(shares)]


def in_every_interval(problem: Problem, never: Fit, always: Fit) -> Array:
    """Mean squares that one recording leaves of a law that acts in each interval of time, (intervals,), from what it
    leaves where the law never acts and where it always does."""
    place = _blocks(problem)[0]
    off, on = (np.bincount(place, f.residual**2, minlength=_BLOCKS).astype(float) for f in (never, always))
    return np.asarray((np.sum(off) + _within((on - off)[None])[0]) / len(place))


def placed(problem: Problem, fitted: Fit) -> Fit:
    """A fit of a law in windows, with the window of each recording in which the law as it stands leaves least.

    A law that is loud in one recording hides what it does in others; and where it says nothing for a while, as friction
    that holds a structure, no fit moves the end of a window over that while.
    """
    here = fitted.hypothesis
    term = here.terms[-1]
    effect = term.effect
    if not isinstance(effect, Windowed) or effect.owners is None:
        return fitted
    without, always = problem.rows(here.without(-1)), problem.rows(here.exchanged(-1, term.law))
    rows = (problem.by_part(residual**2) for residual in (without, always, fitted.residual))
    windows = {i: Window(*effect.times(term.values, i)[:2]) for i in effect.owners}
    better: dict[int, Window] = {}
    for i, (off, on, left) in enumerate(zip(*rows, strict=True)):
        total = np.concatenate([[0.0], np.cumsum(off - on)])
        last = int(np.argmax(total - np.minimum.accumulate(total)))
        first = int(np.argmin(total[: last + 1]))
        gain = float(np.sum(left) - np.sum(off) + total[last] - total[first])
        other = 0.0 if i in windows else _ELSEWHERE * (float(np.sum(left)) - len(left))  # noise leaves one in each row
        if last > first and gain > max(2 * np.log(len(fitted.residual)), other):  # two times (Schwarz 1978)
            t = problem.reduce.plain(i, problem.parts[i].t)
            better[i] = Window(float(t[first]), float(t[last - 1]))
    if not better:
        return fitted
    made = windowed(effect.inner, {**windows, **better})
    ramp = effect.names(effect.owners[0])[2]
    there = Term(made, {**term.law.values, **made.near, ramp: term.values[ramp]})
    more = try_fit(problem, here.exchanged(-1, there))
    return fitted if more is None or more.chi2 > fitted.chi2 else more


@np.errstate(over="ignore")  # what is left of a force that is nought is without end
def outside(problem: Problem, before: Fit) -> tuple[Fit, float]:
    """The baseline as it fits where it leaves least, and the mean square that it leaves there.

    Least trimmed squares (Rousseeuw 1984) over blocks of time, from the refit and from nominal values: what acts for
    less than two thirds of the time does not move such a fit. Blocks are compared by what they leave of the restoring
    force beyond noise; of those that leave nothing, the loudest motion says most.
    """
    place = np.concatenate(_blocks(problem))
    rows = np.bincount(place)
    noise = rows + _NOISE_ERRORS * np.sqrt(2.0 * rows)
    mass = before.hypothesis.mass()
    restoring = problem.reduce([part.F - mass * part.inertia for part in problem.parts])
    power = np.bincount(place, restoring**2)
    nominal = replace(before.hypothesis, values=dict(problem.baseline.nominal), delay=0.0, mass_error=0.0)
    best = before, float(np.mean(before.residual**2))
    for fitted in (before, standing(problem, nominal)):
        kept = np.zeros(0, dtype=bool)
        for _ in range(_TRIMS):
            beyond = np.maximum(np.bincount(place, fitted.residual**2) - noise, 0.0)
            order = np.lexsort((-power, beyond / np.maximum(power, np.finfo(float).tiny)))
            half = order[np.cumsum(rows[order]) <= _TRIMMED * len(place)]
            last, kept = kept, np.isin(place, half)
            made = None if np.array_equal(kept, last) else try_fit(problem, fitted.hypothesis, 25, kept=kept)
            if made is None:
                break
            fitted = standing(problem, made.hypothesis)
            best = min(best, (fitted, made.chi2), key=lambda pair: pair[1])
    return best


def _gate(t: Array, span: float, first: int, last: int) -> Array:
    """1 in the blocks first .. last - 1, with ramps: gates of blocks side by side add up to that of all together."""
    place = t / span * _BLOCKS
    rise, fall = (np.clip((place - edge) / _RAMP + 0.5, 0.0, 1.0) for edge in (first, last))
    return np.asarray((rise if first else 1.0) - (fall if last < _BLOCKS else 0.0))


def _within(products: Array) -> Array:
    """Sums over all intervals of products per block, (recordings, blocks, ...) to (recordings, intervals, ...)."""
    sums = np.zeros((len(products), _BLOCKS + 1, *products.shape[2:]))
    np.cumsum(products, axis=1, out=sums[:, 1:])
    return np.asarray(sums[:, _LAST] - sums[:, _FIRST])


def _between(products: Array) -> Array:
    """The same of products of every block with every other, (recordings, blocks, blocks, ...)."""
    sums = np.zeros((len(products), _BLOCKS + 1, _BLOCKS + 1, *products.shape[3:]))
    sums[:, 1:, 1:] = np.cumsum(np.cumsum(products, axis=1), axis=2)
    return np.asarray(sums[:, _LAST, _LAST] - sums[:, _FIRST, _LAST] - sums[:, _LAST, _FIRST] + sums[:, _FIRST, _FIRST])


def _lowest(effect: Effect, columns: _Columns) -> Array:
    """Least amplitudes that the block allows, in the scale of its columns."""
    least = [effect.lowest.get(name, -np.inf) for name in effect.amplitudes]
    pairs = zip(least, columns.lengths, strict=True)
    return np.array([low * float(length) if length > 0 else -np.inf for low, length in pairs])


def _gains(known: Array, each: Array, lowest: Array) -> tuple[Array, Array]:
    """Falls of the sum of squares and amplitudes for any windows, from their products; 0 where the block does not allow
    the amplitudes, or the baseline absorbs the law."""
    basis, right = known[..., :-1, :], known[..., -1, :]
    own = np.diagonal(each, axis1=-2, axis2=-1)
    normal = each - np.swapaxes(basis, -1, -2) @ basis
    left = np.diagonal(normal, axis1=-2, axis2=-1)
    size = right.shape[-1]
    normal = normal + _RIDGE * (np.max(own, axis=-1) + _RIDGE)[..., None, None] * np.eye(size)
    amplitudes = right / normal[..., 0] if size == 1 else np.linalg.solve(normal, right[..., None])[..., 0]
    refused = np.any(amplitudes < lowest, axis=-1) | np.all(left <= (1 - ABSORBED) * own, axis=-1)
    gains = np.where(refused, 0.0, np.sum(amplitudes * right, axis=-1))
    return np.nan_to_num(gains, posinf=0.0, neginf=0.0), amplitudes
