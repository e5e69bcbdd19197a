"""Which effect could it be: every form on a grid of its shapes, projected on what the baseline cannot absorb."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from types import MappingProxyType

import numpy as np
from scipy.optimize import minimize
from scipy.stats import qmc

from hystid.diagnosis.fit.descent import fit
from hystid.diagnosis.fit.hypothesis import Fit, Hypothesis, Key, Term, Unknown, get, is_allowed, put
from hystid.diagnosis.fit.problem import Problem, standing
from hystid.diagnosis.fit.scanned import Columns
from hystid.diagnosis.model.effects import Effect, Signals
from hystid.diagnosis.prepare.segments import Flags
from hystid.errors import NumericalError
from hystid.numeric import Array

_SPREAD = (1.4, 1.8)  # factor either way over which shapes of the law, and of effects, are spread for new starts
_POINTS, _KEPT_STARTS = 16, 2  # new starts that are tried, and that are kept
_SIMPLEX = 0.35  # size of a first simplex (logarithmic)
_EACH, _EVALUATIONS = 25, 80  # evaluations of a simplex per shape, and in all
_NEAR, _FLAT = 3e-3, 1e-3  # size of a simplex, and relative differences of the cost in it, that end the search
_OTHERS = 3  # next best grid points of a form that are kept
ABSORBED = 0.99  # share of a column that the refit takes over, above which the recordings cannot test the effect


@dataclass(frozen=True)
class ScannedForm:
    """Best grid point of one form: its term, the fall of the sum of squares, and the share that the baseline absorbs.

    others: the next best grid points, for restarts.
    """

    term: Term
    gain: float
    absorbed: float
    others: tuple[Term, ...] = ()

    @property
    def effect(self) -> Effect:
        """The form."""
        return self.term.effect


def one_per_id(candidates: Iterable[ScannedForm]) -> list[ScannedForm]:
    """The first candidate of each effect, in their order."""
    first: dict[str, ScannedForm] = {}
    for candidate in candidates:
        first.setdefault(candidate.effect.id, candidate)
    return list(first.values())


@dataclass(frozen=True)
class Complement:
    """Projection on the complement of the columns that are fitted already."""

    basis: Array = field(repr=False)

    def __call__(self, columns: Array) -> Array:
        """Part of the columns (rows, k) that the basis cannot give."""
        return np.asarray(columns - self.basis @ (self.basis.T @ columns))


def complement(problem: Problem, fitted: Fit) -> Complement:
    """Complement of the Jacobian at a fit, by QR of its scaled columns (directions without effect are left out)."""
    jacobian = problem.jacobian(fitted.hypothesis, fitted.unknowns)
    norms = np.linalg.norm(jacobian, axis=0)
    left, size, _ = np.linalg.svd(jacobian[:, norms > 0] / norms[norms > 0], full_matrices=False)
    return Complement(left[:, size > 1e-7 * size[0]])


@np.errstate(over="ignore", invalid="ignore")  # columns that are not finite are left out
def scan(
    problem: Problem,
    fitted: Fit,
    effects: Sequence[Effect],
    progress: Callable[[], None] = lambda: None,
    near: Mapping[str, float] = MappingProxyType({}),
) -> list[ScannedForm]:
    """The best grid point of every form, the largest gain first. Forms without any finite column are left out.

    near: values of shapes by name; forms that have shapes of these names are looked at there as well.
    """
    outside = complement(problem, fitted)
    beside = _Beside(outside.basis, outside(fitted.residual))
    signals = problem.signals(fitted.hypothesis)
    found = []
    for effect in effects:
        if effect.needs_clock and not problem.timed:
            continue
        best = _best(problem, effect, beside, signals, near)
        found += [best] if best is not None else []
        progress()
    return sorted(found, key=lambda c: -c.gain)


def unexplained(problem: Problem, fitted: Fit) -> float:
    """Mean square that no change of what is fitted already can explain: gains of a scan are shares of it."""
    left = complement(problem, fitted)(fitted.residual)
    return float(left @ left) / len(left)


class _Beside:
    """What a scan asks of columns: what the basis takes of them, and their products with the residual beyond it."""

    def __init__(self, basis: Array, residual: Array) -> None:
        self._rows = np.ascontiguousarray(np.vstack([basis.T, residual]))

    def __call__(self, columns: Columns) -> tuple[Array, Array]:
        """Products (points, k, k) of what the basis cannot give of the columns, and (points, k) of these with the
        residual."""
        points, size, rows = columns.scaled.shape
        shares = self._rows @ columns.scaled.reshape(points * size, rows).T
        shares = shares.reshape(len(self._rows), points, size)
        basis = np.moveaxis(shares[:-1], 0, -1)
        return columns.products - basis @ np.swapaxes(basis, -1, -2), shares[-1]


def _best(
    problem: Problem, effect: Effect, beside: _Beside, signals: Sequence[Signals], near: Mapping[str, float]
) -> ScannedForm | None:
    """The grid point of one form with the largest gain; None where there is none."""
    grids = [effect.grid(problem.scales)]
    if any(name in near for name in grids[0][0]):
        grids.append(effect.grid(problem.scales, near))
    lowest, found = np.array([effect.lowest.get(name, -np.inf) for name in effect.amplitudes]), []
    for grid in grids:
        columns = problem.columns(effect, grid, signals)
        gains, absorbed, amplitudes = _scores(columns, beside, lowest)
        shapes = [grid[place] for place in columns.places]
        found += [*zip(gains, absorbed, amplitudes, shapes, strict=True)]
    found = sorted((point for point in found if point[0] > -np.inf), key=lambda point: -point[0])[: 1 + _OTHERS]
    terms = [Term(effect, {**at, **dict(zip(effect.amplitudes, map(float, u), strict=True))}) for _, _, u, at in found]
    return ScannedForm(terms[0], float(found[0][0]), float(found[0][1]), tuple(terms[1:])) if found else None


def _scores(columns: Columns, beside: _Beside, lowest: Array) -> tuple[Array, Array, Array]:
    """Gain and absorbed share (points,), and amplitudes (points, k), of groups of columns; the gain is -inf where all
    of them vanish, or the block does not allow their amplitudes."""
    norms = columns.lengths
    normal, right = beside(columns)
    left = np.maximum(np.diagonal(normal, axis1=-2, axis2=-1), 0.0)
    normal = normal + 1e-9 * np.eye(len(lowest))
    alone = len(lowest) == 1
    amplitudes = right / normal[..., 0] if alone else np.linalg.solve(normal, right[..., None])[..., 0]
    allowed = np.any(norms > 0, axis=-1)
    refused = amplitudes < np.where(norms > 0, lowest, -np.inf)
    for i in np.flatnonzero(np.any(refused, axis=-1)):  # these stay at zero, the others are solved anew
        kept = np.flatnonzero(~refused[i])
        amplitudes[i] = 0.0
        amplitudes[i, kept] = np.linalg.solve(normal[i][np.ix_(kept, kept)], right[i, kept])
        allowed[i] &= len(kept) > 0 and not np.any(amplitudes[i] < lowest)
    gains = np.where(allowed, np.sum(right * amplitudes, axis=-1), -np.inf)
    return gains, 1.0 - np.max(left, axis=-1, initial=0.0), amplitudes / np.where(norms > 0, norms, np.inf)


def try_term(problem: Problem, fitted: Fit, term: Term, incumbent: float = 0.0) -> Fit | None:
    """Joint fit of what is there and one more effect; None where it has no finite answer."""
    return try_fit(problem, fitted.hypothesis.beside(term), incumbent=incumbent)


def try_fit(
    problem: Problem,
    start: Hypothesis,
    iterations: int = 12,
    incumbent: float = 0.0,
    *,
    kept: Flags | None = None,
    last: bool = False,
) -> Fit | None:
    """``fit``, or None where it has no finite answer.

    The way to a share of less than all may lead over more, as other forces are still too small: the largest amplitudes
    that blocks allow hold for where a fit ends.
    """
    try:
        made = fit(problem, start, iterations=iterations, incumbent=incumbent, kept=kept, last=last)
        if is_allowed(made.hypothesis):
            return made
        return fit(problem, made.hypothesis, iterations=iterations, incumbent=0.0, most=True, kept=kept, last=last)
    except (NumericalError, np.linalg.LinAlgError):
        return None


def scattered(problem: Problem, fitted: Fit) -> list[Hypothesis]:
    """New starts: shapes of the law and of the effects spread around a fit, everything linear solved at each point.

    A law with corners has local minima in its shapes, and a refit without the missing effect often ends in one. The
    points are those of a Sobol sequence, hence the same in every run; the best few are returned.
    """
    shapes = [u for u in problem.unknowns(fitted.hypothesis) if u.log]
    if not any(u.key[0] == "base" for u in shapes):
        return []
    spread = np.log([_SPREAD[u.key[0] != "base"] for u in shapes])
    draws = qmc.Sobol(len(shapes), seed=0).random(_POINTS)
    moved = (
        {
            u.key: u.within(float(get(fitted.hypothesis, u.key) * np.exp(step)))
            for u, step in zip(shapes, draw, strict=True)
        }
        for draw in (2 * draws - 1) * spread
    )
    return leading(problem, (put(fitted.hypothesis, values) for values in moved))


def leading(problem: Problem, starts: Iterable[Hypothesis]) -> list[Hypothesis]:
    """The best few of some starts, everything linear solved at each."""
    linear = [(start, [u for u in problem.unknowns(start) if u.linear]) for start in starts]
    found = [made for start, unknowns in linear if (made := _solved(problem, start, unknowns)) is not None]
    return [hypothesis for _, hypothesis in sorted(found, key=lambda item: item[0])[:_KEPT_STARTS]]


def other_minima(problem: Problem, fitted: Fit) -> list[Hypothesis]:
    """Starts for leaving a local minimum: where a simplex comes to from a fit, and scattered ones."""
    return [*downhill(problem, fitted), *scattered(problem, fitted)]


def downhill(problem: Problem, fitted: Fit) -> list[Hypothesis]:
    """Where a simplex of the law's shapes, large enough to lie across the ridges, comes to from a fit (Nelder and Mead
    1965), everything linear solved at each point; [] where the law has no shapes."""
    unknowns = problem.unknowns(fitted.hypothesis)
    shapes = [u for u in unknowns if u.log and u.key[0] == "base"]
    linear = [u for u in unknowns if u.linear]
    if not shapes:
        return []

    def there(steps: Array) -> Hypothesis:
        values = [get(fitted.hypothesis, u.key) * np.exp(step) for u, step in zip(shapes, steps, strict=True)]
        return put(fitted.hypothesis, {u.key: u.within(float(at)) for u, at in zip(shapes, values, strict=True)})

    def cost(steps: Array) -> float:
        found = _solved(problem, there(steps), linear)
        return found[0] / fitted.rss if found is not None else np.inf

    count = len(shapes)
    corners = _SIMPLEX * (np.vstack([np.zeros(count), np.eye(count)]) - 1 / (count + 1))
    end = minimize(
        cost, np.zeros(count), method="Nelder-Mead",
        options={
            "initial_simplex": corners, "maxfev": min(_EACH * count, _EVALUATIONS), "xatol": _NEAR, "fatol": _FLAT,
        },
    )  # fmt: skip
    found = _solved(problem, there(end.x), linear)
    return [found[1]] if found is not None else []


def from_nominal(problem: Problem, fitted: Fit) -> Fit | None:
    """The baseline at its nominal shapes, everything linear solved, beside the terms of a fit; None where it has no
    shapes, or nothing is finite."""
    here, base = fitted.hypothesis, problem.baseline
    if not base.shapes:
        return None
    start = replace(here, values={**here.values, **{name: base.nominal[name] for name in base.shapes}})
    found = _solved(problem, start, [u for u in problem.unknowns(start) if u.linear])
    return standing(problem, found[1]) if found is not None else None


@np.errstate(over="ignore", invalid="ignore")  # a start that is not finite loses
def _solved(problem: Problem, start: Hypothesis, linear: Sequence[Unknown]) -> tuple[float, Hypothesis] | None:
    """Sum of squares and hypothesis with the linear unknowns at their best; None where nothing is finite."""
    try:
        rows = problem.rows(start)
        columns = problem.jacobian(start, linear) if linear else np.zeros((len(rows), 0))
    except NumericalError:
        return None
    if not (np.all(np.isfinite(rows)) and np.all(np.isfinite(columns))):
        return None
    normal = columns.T @ columns
    scale = np.sqrt(np.diag(normal))
    scale[scale == 0] = 1.0
    normal = normal / np.outer(scale, scale) + 1e-9 * np.eye(len(scale))
    steps = np.linalg.solve(normal, columns.T @ rows / scale) / scale
    changes: dict[Key, float] = {
        u.key: u.within(get(start, u.key) + float(step)) for u, step in zip(linear, steps, strict=True)
    }
    taken = np.array([changes[u.key] - get(start, u.key) for u in linear])
    left = rows - columns @ taken
    return float(left @ left), put(start, changes)
