"""Does the force depend on a further column of the recordings: voltage, current, temperature, pressure, tension?

An oscillator has one input, its force. A damper with a coil has two, and a model without the second one misses the
force in a way that no law of the motion can explain. No law is assumed here: what is left of the force is described by
a few functions of the motion, once with fixed coefficients and once with coefficients that follow the column. What the
second description explains beyond the first, the column explains.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.stats import t as student

from hystid.diagnosis.fit.hypothesis import Hypothesis
from hystid.diagnosis.fit.problem import Problem, standing
from hystid.numeric import Array

CHANCE = 0.01  # probability of a dependence by chance, over all columns, below which it is told: one report in 100
WORTH = 0.05  # share of the misfit below which a dependence is not told: leaving it out changes no other figure
_KNOTS = 4  # values of a column between which coefficients are interpolated; more knots find no simpler law
_SHIFTS = (
    399  # circular shifts, so that one in 100 can be told for up to four columns; a quarter where rows have memory
)
_ENOUGH = 5  # shifts that gain as much, after which a column is given up
_PREDICTED = 0.5  # share of a column that the motion predicts, beyond which it is an answer and no input
_WITHIN = 0.1  # share of the variance within recordings below which a column is one value per recording
_ROWS = 6000  # rows that are used: the coefficients are at most 24


@dataclass(frozen=True)
class Dependence:
    """How the force depends on one column.

    share: of the misfit above the noise that the dependence explains, 0..1. chance: probability of as much without a
    dependence, over all columns that were looked at. curve: (value of the column, force over that of the model,
    constant force [N]), at values that occur. additive: the constant force changes more than what follows the motion.
    beside: the misfit is that beside named physics.
    """

    column: str
    share: float
    chance: float
    curve: tuple[tuple[float, float, float], ...]
    additive: bool = False
    beside: bool = False

    def sentence(self) -> str:
        """What it says, for people."""
        (first, gain, level), (last, more, higher) = self.curve[0], self.curve[-1]
        size = (
            f"a constant force of {level:.3g} N at {first:.3g}, of {higher:.3g} N at {last:.3g}"
            if self.additive
            else f"{gain:.2g} of the model's force at {first:.3g}, {more:.2g} at {last:.3g}"
        )
        return (
            f"the force depends on {self.column}, which is no input of the model: it explains {100 * self.share:.0f} % "
            f"of what {'the named physics' if self.beside else 'the refitted model'} leaves above the noise ({size})"
        )

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        names = ("value", "force_over_model", "constant_N")
        return {
            "column": self.column, "share": self.share, "chance": self.chance,
            "curve": [dict(zip(names, point, strict=True)) for point in self.curve],
        }  # fmt: skip


def dependences(problem: Problem, hypothesis: Hypothesis, before: Hypothesis | None = None) -> list[Dependence]:
    """Columns of the recordings on which what a hypothesis leaves depends, the strongest first.

    before: the refitted baseline alone. A law that was named beside it may have taken over what a column does (a drift
    what a temperature does, an offset per recording what a pressure does), so that both are looked at.
    Only columns that all recordings have, that change, and that do not follow from the motion (a second displacement
    sensor, a set point): what depends on those may be physics of the motion. Empty where nothing is left.
    """
    found = _dependences(problem, hypothesis)
    if before is not None and before is not hypothesis:
        found = [replace(one, beside=True) for one in found]
        known = {one.column for one in found}
        found += [one for one in _dependences(problem, before) if one.column not in known]
    return found


def _dependences(problem: Problem, hypothesis: Hypothesis) -> list[Dependence]:
    here = standing(problem, hypothesis)
    rows, misfit = here.residual, here.chi2 - problem.floor(here)
    names = [name for name in problem.parts[0].extra if all(name in part.extra for part in problem.parts)]
    columns = {name: [part.extra[name] for part in problem.parts] for name in names}
    columns = {name: values for name, values in columns.items() if _changes(values)}
    if misfit <= 0 or not columns:
        return []
    motion = _Motion(problem, hypothesis, rows)
    found = []
    for name, values in columns.items():
        own = values if _is_constant(values) else _own(problem, values)
        if own is None:
            continue
        gain, chance = motion.constant(values) if _is_constant(values) else motion.varying(own)
        share, chance = gain / (misfit * len(rows)), min(1.0, chance * len(columns))
        if chance <= CHANCE and share >= WORTH:
            curve = motion.curve(values)
            found.append(Dependence(name, min(share, 1.0), chance, curve, motion.is_additive(curve)))
    return sorted(found, key=lambda one: -one.share)


def _changes(values: Sequence[Array]) -> bool:
    joined = np.concatenate(values)
    return bool(np.all(np.isfinite(joined)) and np.ptp(joined) > 1e-9 * float(np.max(np.abs(joined))))


def _is_constant(values: Sequence[Array]) -> bool:
    """Whether a column has one value per recording, but for noise and what a controller leaves."""
    inner = sum(float(np.sum((u - np.mean(u)) ** 2)) for u in values)
    joined = np.concatenate(values)
    return len(values) > 1 and inner < _WITHIN * float(np.sum((joined - np.mean(joined)) ** 2))


def _own(problem: Problem, values: Sequence[Array]) -> list[Array] | None:
    """What the motion does not predict of a column, per recording; None where that is less than half.

    Another sensor of the motion, or its set point, says nothing that the motion does not say.
    """
    seen = []
    for part in problem.parts:
        x, v, a = (s / (float(np.std(s)) or 1.0) for s in (part.x, part.v, part.a))
        late = max(1, int(0.1 / (part.dt * max(problem.scales.band[1], 1e-9))))  # a tenth of the shortest period
        lagged = [np.roll(x, k * late) for k in (-8, -4, -2, -1, 1, 2, 4, 8)]
        seen.append(np.stack([np.ones_like(x), x, v, a, part.F, x**2, v**2, np.abs(x), np.abs(v), x * v, *lagged], 1))
    u, columns = np.concatenate(values), np.concatenate(seen)
    columns = columns / np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
    step = max(1, len(u) // _ROWS)
    remainder = u - columns @ np.linalg.lstsq(columns[::step], u[::step], rcond=None)[0]
    if float(np.var(remainder)) < (1 - _PREDICTED) * float(np.var(u)):
        return None
    return list(np.split(remainder, np.cumsum([len(part) for part in problem.parts])[:-1]))


def _hats(values: Array, knots: Array) -> Array:
    """Piecewise linear functions of a column, one per knot but the first, (n, knots - 1): the first is the rest."""
    return np.stack([np.interp(values, knots, unit) for unit in np.eye(len(knots))[1:]], axis=1)


def _knots(values: Array) -> Array:
    """Values between which coefficients are interpolated: levels where there are few, else quantiles."""
    levels = np.unique(np.quantile(values, np.linspace(0.02, 0.98, _KNOTS), method="nearest"))
    least = 0.1 * float(np.ptp(levels))  # steps below a tenth of the range are one level
    kept = [levels[0]]
    kept += [level for level in levels[1:] if level - kept[-1] > least]
    return np.array(kept if len(kept) > 1 else [float(np.min(values)), float(np.max(values))])


class _Motion:
    """What is left of the force as rows, and the functions of the motion that describe it."""

    def __init__(self, problem: Problem, hypothesis: Hypothesis, rows: Array) -> None:
        self._problem = problem
        self._left = rows
        self._force = problem.predicted(hypothesis)
        self._balance = problem.balance(hypothesis)
        functions = [self._functions(i) for i in range(len(problem.parts))]
        self._columns = [[f[k] for f in functions] for k in range(len(functions[0]))]
        self._rows = np.stack([problem.reduce(column) for column in self._columns], axis=1)
        self._of = np.repeat(np.arange(len(problem.parts)), problem.row_counts())
        self._rng = np.random.default_rng(0)

    def _functions(self, index: int) -> list[Array]:
        """A constant, displacement, velocity, the direction of motion and the force of the model."""
        part = self._problem.parts[index]
        speed = float(np.std(part.v)) or 1.0
        direction = np.tanh(part.v / (0.1 * speed))  # rounded where noise would decide the sign
        return [np.ones_like(part.x), part.x, part.v, direction, self._force[index]]

    def varying(self, values: Sequence[Array]) -> tuple[float, float]:
        """Gain in the sum of squares over that of fixed coefficients, and its probability by chance: a column that is
        shifted against the motion, round the end, keeps its own spectrum and loses what it has to do with the force."""
        knots = _knots(np.concatenate(values))
        real = self._gain(self._products(values, knots))
        local = self._problem.reduce.is_local
        count = _SHIFTS if local else _SHIFTS // 4
        others: list[float] = []
        for products in self._shifted(values, knots, count, local=local):
            others.append(self._gain(products))
            above = sum(other >= real for other in others)
            if above >= _ENOUGH:  # as many again would come: the chance is known well enough (Besag and Clifford)
                return real - float(np.median(others)), above / len(others)
        return real - float(np.median(others)), (1 + above) / (1 + count)

    def _shifted(self, values: Sequence[Array], knots: Array, count: int, *, local: bool) -> Iterator[Array]:
        """Products with the column shifted in each recording by a part of its length."""
        counts = self._problem.row_counts()
        hats = [
            np.stack([self._problem.reduce.plain(i, h) for h in _hats(u, knots).T], 1) for i, u in enumerate(values)
        ]
        for _ in range(count):
            parts = self._rng.uniform(0.05, 0.95, len(values))
            if local:
                moved = [np.roll(h, int(s * n), axis=0) for h, s, n in zip(hats, parts, counts, strict=True)]
                yield self._times(np.concatenate(moved))
            else:
                yield self._products([np.roll(u, int(s * len(u))) for u, s in zip(values, parts, strict=True)], knots)

    def _products(self, values: Sequence[Array], knots: Array) -> Array:
        """Rows of the functions of the motion times those of the column."""
        hats = [_hats(u, knots) for u in values]
        if self._problem.reduce.is_local:
            rows = [np.stack([self._problem.reduce.plain(i, h) for h in u.T], 1) for i, u in enumerate(hats)]
            return self._times(np.concatenate(rows))
        reduce = self._problem.reduce
        made = [
            reduce([f * u[:, k] for f, u in zip(column, hats, strict=True)])
            for column in self._columns
            for k in range(len(knots) - 1)
        ]
        return np.stack(made, axis=1)

    def _times(self, hats: Array) -> Array:
        return (self._rows[:, :, None] * hats[:, None, :]).reshape(len(self._rows), -1)

    def _gain(self, products: Array) -> float:
        """Fall of the sum of squares beyond what the functions of the motion explain with fixed coefficients."""
        step = max(1, len(self._left) // _ROWS)
        fixed, rows = self._rows[::step], self._left[::step]
        both = np.hstack([fixed, products[::step]])
        return step * (_rest(fixed, rows) - _rest(both, rows))

    def constant(self, values: Sequence[Array]) -> tuple[float, float]:
        """The same for one value per recording. Chance: that of so straight a line through the recordings.

        Each recording counts once, however long it is: whatever differs between recordings would look the same in all
        of its samples. Three recordings are the least of which a line says anything.
        """
        at = np.array([float(np.mean(u)) for u in values])
        hats = ((at - np.mean(at)) / (float(np.std(at)) or 1.0))[self._of][:, None]
        gain = self._gain(self._times(hats))
        if len(values) < 3:
            return gain, 1.0
        found = np.array(
            [
                np.linalg.lstsq(self._rows[self._of == i], self._left[self._of == i], rcond=None)[0]
                for i in range(len(at))
            ]
        )
        size = np.array([float(np.linalg.norm(self._rows[:, k])) for k in range(found.shape[1])])
        scores = (found - np.mean(found, axis=0)) * size
        leading = scores @ np.linalg.svd(scores, full_matrices=False)[2][0]
        r = float(np.corrcoef(at, leading)[0, 1])
        free = len(at) - 2
        return gain, float(2 * student.sf(abs(r) * np.sqrt(free / max(1 - r**2, 1e-12)), free))

    def curve(self, values: Sequence[Array]) -> tuple[tuple[float, float, float], ...]:
        """Force over that of the model and constant force, for values of the column that occur."""
        u, force = np.concatenate(values), np.concatenate(self._force)
        measured = force + np.concatenate(self._balance)
        means = [float(np.mean(one)) for one in values]
        knots = np.array(sorted(set(means))) if _is_constant(values) else _knots(u)
        nearest = np.argmin(np.abs(u[:, None] - knots), axis=1)
        found = []
        for k in range(len(knots)):
            at = nearest == k
            columns = np.stack([force[at], np.ones(int(np.sum(at)))], 1)
            gain, level = np.linalg.lstsq(columns, measured[at], rcond=None)[0]
            found.append((float(np.mean(u[at])), float(gain), float(level)))
        return tuple(found)

    def is_additive(self, curve: Sequence[tuple[float, float, float]]) -> bool:
        """Whether the constant force changes more along a curve than what is proportional to the force of the model."""
        spread = float(np.std(np.concatenate(self._force)))
        return bool(np.ptp([level for _, _, level in curve]) > spread * np.ptp([gain for _, gain, _ in curve]))


def _rest(columns: Array, rows: Array) -> float:
    """Sum of squares that columns leave of rows; columns that others give are left out."""
    scaled = columns / np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
    normal = scaled.T @ scaled
    value, vector = np.linalg.eigh(normal)
    kept = value > 1e-9 * value[-1]
    share = vector[:, kept].T @ (scaled.T @ rows)
    return float(rows @ rows - np.sum(share**2 / value[kept]))


def told(found: Sequence[Dependence]) -> list[str]:
    """Sentences for the notes."""
    return [one.sentence() for one in found]
