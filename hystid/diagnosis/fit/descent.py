"""Levenberg-Marquardt on a hypothesis: steps from normal equations, within bounds, none tried twice.

A loop of its own beside ``leastsquares``: an evaluation costs a run of the law, so a step tells more than whether the
error fell. Unknowns at bounds are solved out, the damping follows the promised fall, and a fit that cannot reach the
incumbent is given up.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from hystid.diagnosis.fit.hypothesis import Fit, Hypothesis, Unknown, get, put
from hystid.diagnosis.fit.problem import Problem
from hystid.diagnosis.prepare.segments import Flags
from hystid.errors import NumericalError
from hystid.numeric import Array

_PACE = 0.04  # share of the way to the incumbent that every step must make
_DAMPINGS, _HARDER = 7, 8.0  # dampings per step, and the factor from one to the next
_ANOTHER = 0.1  # relative difference of steps that makes another one worth its cost
_NO_FALL = 1e-5  # share of the sum of squares below which a promised fall is not worth a step
_REFUSED, _MUCH = 2, 0.1  # refusals after which the law is held, and share of the promised fall that must be left then
_FIRST_DAMPING = 1e-4  # damping at the start
_SMALL_FALL = 1e-4  # relative fall of the sum of squares that is small
_EASIER, _LEAST_DAMPING = 0.1, 1e-9  # factor by which a damping falls at most, and how far


@np.errstate(over="ignore", invalid="ignore")  # refused steps may be as wild as they like
def fit(
    problem: Problem,
    start: Hypothesis,
    *,
    iterations: int = 25,
    incumbent: float | None = None,
    most: bool = False,
    kept: Flags | None = None,
    last: bool = False,
) -> Fit:
    """Levenberg-Marquardt from one start. A step that leaves the finite numbers is refused, never taken.

    incumbent: mean square that another hypothesis has reached; this one is given up when it cannot come
    near at its pace. 0: a step that gains less than ``_PACE`` ends it. None: it runs to its end.
    most: whether amplitudes keep to the largest values that their blocks allow. kept: rows that count, all without it;
    last: whether the last effect alone moves.
    Ends when an accepted step lowers the sum of squares by less than ``_SMALL_FALL`` of it twice in a row. The
    covariance is that of the last point at which derivatives were taken: a step that ends the fit is too small to
    matter, or the fit is given up.
    Raises NumericalError when the start itself has no finite residual.
    """
    unknowns = problem.unknowns(start, most=most)
    unknowns = tuple(u for u in unknowns if not last or u.key[0] == str(len(start.terms) - 1))
    here = put(start, {u.key: u.within(get(start, u.key)) for u in unknowns})
    view = _View(problem, unknowns, slice(None) if kept is None else kept)
    rows = view.rows(here)
    cost = float(rows @ rows)
    if not np.isfinite(cost):
        raise NumericalError("the start of a fit has no finite residual; check the nominal parameters")
    damping, small = _FIRST_DAMPING, 0
    normal = view.normal(here, rows)
    for done in range(iterations):
        taken = _step(view, here, normal, cost, damping)
        if taken is None and problem.renew(here):
            normal, damping = view.normal(here, rows), _FIRST_DAMPING
            continue
        if taken is None:
            break
        gain = 1.0 - taken.cost / cost
        here, rows, cost, damping = taken.there, taken.rows, taken.cost, taken.damping
        small = small + 1 if gain < _SMALL_FALL else 0
        if done > 2 and incumbent is not None and gain < _PACE * (1.0 - incumbent * len(rows) / cost):
            break
        if small == 2 or gain < 1e-8:
            break
        normal = view.normal(here, rows)
    freedom = max(1, len(rows) - len(unknowns))
    return Fit(here, rows, cost / freedom, unknowns, normal.covariance())


@dataclass(frozen=True)
class _View:
    """What a fit sees of a problem: its unknowns, and the rows that count."""

    problem: Problem
    unknowns: tuple[Unknown, ...]
    kept: Flags | slice

    def rows(self, here: Hypothesis) -> Array:
        return self.problem.rows(here)[self.kept]

    def normal(self, here: Hypothesis, rows: Array) -> _Normal:
        jacobian = self.problem.jacobian(here, self.unknowns)
        return _Normal(jacobian if isinstance(self.kept, slice) else jacobian[self.kept], rows)

    def rows_or_none(self, here: Hypothesis) -> Array | None:
        try:
            rows = self.rows(here)
        except NumericalError:
            return None
        return rows if np.all(np.isfinite(rows)) else None


@dataclass(frozen=True)
class _Step:
    """Where a step leads, its rows and their sum of squares, and the damping for the next one."""

    there: Hypothesis
    rows: Array
    cost: float
    damping: float


def _taken(there: Hypothesis, rows: Array | None, cost: float, promised: float, damping: float) -> _Step | None:
    """A step that lowers the sum of squares; None for another one. The damping falls where the fall was as promised,
    stays where it was half of that, and grows beyond (Nielsen 1999)."""
    found = float(rows @ rows) if rows is not None else np.inf
    if rows is None or not found < cost:
        return None
    kept = 2 * (cost - found) / promised - 1
    return _Step(there, rows, found, max(damping * max(_EASIER, 1 - kept**3), _LEAST_DAMPING))


def _step(view: _View, here: Hypothesis, normal: _Normal, cost: float, damping: float) -> _Step | None:
    """The first step that lowers the sum of squares; None where there is none worth its name.

    Corners of the law may refuse step after step, each of which costs an evaluation of it: then all else moves alone.
    """
    for refused, (tried, promised, there) in enumerate(normal.steps(here, view.unknowns, damping)):
        if promised < _NO_FALL * cost:
            return None
        if refused == _REFUSED:
            alone = _beside_law(view, here, normal, max(_NO_FALL * cost, _MUCH * promised))
            beside = _taken(alone, view.rows_or_none(alone), cost, promised, tried) if alone is not None else None
            if beside is not None:
                return beside
        taken = _taken(there, view.rows_or_none(there), cost, promised, tried)
        if taken is not None:
            return taken
    return None


def _beside_law(view: _View, here: Hypothesis, normal: _Normal, least: float) -> Hypothesis | None:
    """Where the step leads with the shapes of the law held; None where it promises less than the least, or there are
    none."""
    shapes = {("base", name) for name in view.problem.baseline.shapes}
    held = frozenset(i for i, unknown in enumerate(view.unknowns) if unknown.key in shapes)
    if not held:
        return None
    _, promised, there = next(normal.steps(here, view.unknowns, _FIRST_DAMPING, held))
    return there if promised > least else None


class _Normal:
    """Normal equations of one Jacobian, in columns of unit length: many steps are tried from one point. Unknowns whose
    derivative is not finite stay where they are."""

    def __init__(self, jacobian: Array, rows: Array) -> None:
        products, right = jacobian.T @ jacobian, jacobian.T @ rows
        wild = ~np.isfinite(np.diag(products)) | ~np.isfinite(right)
        if np.any(wild):
            products[wild], products[:, wild], right[wild] = 0.0, 0.0, 0.0
        self.scale = np.sqrt(np.diag(products))
        self.scale[self.scale == 0] = 1.0
        self.matrix, self.right = products / np.outer(self.scale, self.scale), right / self.scale

    def steps(
        self, here: Hypothesis, unknowns: Sequence[Unknown], first: float, held: frozenset[int] = frozenset()
    ) -> Iterator[tuple[float, float, Hypothesis]]:
        """Damping, fall of the sum of squares that the normal equations promise, and where the step leads.

        The first damping, and larger ones that lead to another step: among columns of unit length a small damping
        changes nothing, and what was refused would be refused again. held: unknowns that stay where they are.
        """
        last: Array | None = None
        for power in range(_DAMPINGS):
            damping = first * _HARDER**power
            moves = self._moves(here, unknowns, damping, held)
            scaled = moves * self.scale
            if last is None or np.linalg.norm(scaled - last) > _ANOTHER * np.linalg.norm(last):
                last = scaled
                promised = float(scaled @ (2 * self.right - self.matrix @ scaled))
                yield damping, promised, self._there(here, unknowns, moves)

    @staticmethod
    def _there(here: Hypothesis, unknowns: Sequence[Unknown], moves: Array) -> Hypothesis:
        targets = {u.key: _moved(here, u, move) for u, move in zip(unknowns, moves, strict=True)}
        return put(here, {u.key: u.within(targets[u.key]) for u in unknowns})

    def _moves(self, here: Hypothesis, unknowns: Sequence[Unknown], damping: float, held: frozenset[int]) -> Array:
        """Damped Gauss-Newton step; unknowns that it would push over their bounds are set there and the rest solved
        anew."""
        free = [i for i in range(len(unknowns)) if i not in held]
        moves = np.zeros(len(unknowns))
        right = self.right
        while free:
            moves[free] = self._solved(free, right, damping)
            over = []
            for i in free:
                target = _moved(here, unknowns[i], moves[i])
                bounded = unknowns[i].within(target)
                if bounded != target:
                    moves[i] = _move(here, unknowns[i], bounded)
                    over.append(i)
            if not over:
                break
            for i in over:
                right = right - self.matrix[:, i] * self.scale[i] * moves[i]
                free.remove(i)
        return moves

    def _solved(self, free: list[int], right: Array, damping: float) -> Array:
        damped = self.matrix[np.ix_(free, free)] if len(free) < len(self.matrix) else self.matrix.copy()
        damped.flat[:: len(free) + 1] += damping + 1e-12
        return np.asarray(np.linalg.solve(damped, right[free]) / self.scale[free])

    def covariance(self) -> Array:
        """Covariance of the unknowns for rows of unit noise."""
        return np.asarray(np.linalg.pinv(self.matrix, rcond=1e-12) / np.outer(self.scale, self.scale))


def _moved(here: Hypothesis, unknown: Unknown, move: float) -> float:
    value = get(here, unknown.key)
    return value * math.exp(min(max(move, -1.2), 1.2)) if unknown.log else value + float(move)


def _move(here: Hypothesis, unknown: Unknown, target: float) -> float:
    """Step of an unknown that leads to a value: the reverse of ``_moved``."""
    value = get(here, unknown.key)
    return float(np.log(target / value)) if unknown.log else target - value
