"""Which two effects could it be: every pair of forms on the grids of their shapes, beside what the baseline absorbs.

One effect after the other misses pairs of which each hides the other: the first is then fitted to what both leave, and
stands where the second no longer helps. Forces are linear in their amplitudes, so that what two forms take together
follows from the products of their columns with the residual and with each other (least squares in blocks).
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from itertools import combinations

import numpy as np

from hystid.diagnosis.fit.hypothesis import Fit, Term
from hystid.diagnosis.fit.problem import Problem
from hystid.diagnosis.fit.search import ABSORBED, complement
from hystid.diagnosis.model.effects import Effect
from hystid.numeric import Array

_FORMS = 4  # pairs of forms that are kept of two ids
_ROWS = 8_000  # rows of which products are made: more would tell a start no better
_RIDGE = 1e-6  # of a unit column, against columns that are alike
Rank = Callable[[float, int], float]  # worth of a pair: by what it takes of the sum of squares, and its parameters


@dataclass(frozen=True)
class TermPair:
    """The best grid points of two forms together, and what they take of the sum of squares."""

    terms: tuple[Term, Term]
    gain: float

    @property
    def size(self) -> int:
        """Number of parameters that a fit moves or chooses."""
        return sum(term.effect.size for term in self.terms)

    @property
    def ids(self) -> frozenset[str]:
        """Both ids."""
        return frozenset(term.effect.id for term in self.terms)


@dataclass(frozen=True)
class _Form:
    """A form at the points of its grid: columns beyond the basis, orthonormal at each point, (points, k, rows), their
    products with the residual, (points, k), amplitudes per coordinate, (points, k, k), and the least ones, (k,)."""

    effect: Effect
    shapes: list[dict[str, float]]
    columns: Array = field(repr=False)
    right: Array
    amplitudes: Array
    lowest: Array


@np.errstate(over="ignore", invalid="ignore")  # columns that are not finite are left out
def scan_pairs(problem: Problem, fitted: Fit, effects: Sequence[Effect], rank: Rank, most: int) -> list[TermPair]:
    """At most so many pairs of forms, some of each pair of ids, the worthiest first."""
    forms = list(_forms(problem, fitted, effects))
    if not forms:
        return []
    scale = len(fitted.residual) / forms[0].columns.shape[-1]
    made = (_best(one, other, scale) for one, other in combinations(forms, 2) if one.effect.id != other.effect.id)
    found, count = list[TermPair](), Counter[frozenset[str]]()
    for pair in sorted(filter(None, made), key=lambda pair: -rank(pair.gain, pair.size)):
        count[pair.ids] += 1
        found += [pair] if count[pair.ids] <= _FORMS else []
    return found[:most]


def _forms(problem: Problem, fitted: Fit, effects: Sequence[Effect]) -> Iterator[_Form]:
    """The forms that the recordings can test, with what the baseline cannot absorb of their columns."""
    every = max(1, len(fitted.residual) // _ROWS)
    basis, _ = np.linalg.qr(complement(problem, fitted).basis[::every])
    residual = fitted.residual[::every] - basis @ (basis.T @ fitted.residual[::every])
    signals = problem.signals(fitted.hypothesis)
    for effect in effects:
        if effect.needs_clock and not problem.timed:
            continue
        grid = effect.grid(problem.scales)
        made = problem.columns(effect, grid, signals)
        rows = made.scaled[..., ::every]
        whole = np.sum(rows**2, axis=-1)
        rows = rows - (rows @ basis) @ basis.T
        left = np.sum(rows**2, axis=-1)
        told = np.any(left > (1 - ABSORBED) * whole, axis=-1)  # not finite: false
        told &= np.all(made.lengths > 0, axis=-1)
        if not np.any(told):
            continue
        rows, lengths = rows[told], made.lengths[told]
        products = rows @ np.swapaxes(rows, -1, -2)
        ridge = _RIDGE * np.max(np.diagonal(products, axis1=-2, axis2=-1), axis=-1)
        triangle = np.linalg.cholesky(products + ridge[:, None, None] * np.eye(rows.shape[1]))
        inverse = np.linalg.inv(triangle)
        columns = inverse @ rows
        amplitudes = np.swapaxes(inverse, -1, -2) / lengths[..., None]
        lowest = np.array([effect.lowest.get(name, -np.inf) for name in effect.amplitudes])
        shapes = [grid[place] for place in made.places[told]]
        yield _Form(effect, shapes, columns, columns @ residual, amplitudes, lowest)


def _best(one: _Form, other: _Form, scale: float) -> TermPair | None:
    """The grid points of two forms that take most together; None where blocks allow no amplitudes anywhere."""
    (a, i, rows), (b, j, _) = one.columns.shape, other.columns.shape
    cross = (one.columns.reshape(a * i, rows) @ other.columns.reshape(b * j, rows).T).reshape(a, i, b, j)
    beyond = other.right - np.einsum("aibj,ai->abj", cross, one.right)
    normal = (1 + _RIDGE) * np.eye(j) - np.einsum("aibj,aibk->abjk", cross, cross)
    second = np.linalg.solve(normal, beyond[..., None])[..., 0]
    first = one.right[:, None] - np.einsum("aibj,abj->abi", cross, second)
    gains = np.sum(one.right**2, axis=-1)[:, None] + np.sum(beyond * second, axis=-1)
    forces = np.einsum("aki,abi->abk", one.amplitudes, first), np.einsum("bkj,abj->abk", other.amplitudes, second)
    allowed = np.all(forces[0] >= one.lowest, axis=-1) & np.all(forces[1] >= other.lowest, axis=-1)
    gains = np.where(allowed, gains, -np.inf)
    at = np.unravel_index(int(np.argmax(gains)), gains.shape)
    if not np.isfinite(gains[at]):
        return None
    places = zip((one, other), at, forces, strict=True)
    first_term, second_term = (_term(form, int(place), force[at]) for form, place, force in places)
    return TermPair((first_term, second_term), scale * float(gains[at]))


def _term(form: _Form, place: int, amplitudes: Array) -> Term:
    values = dict(zip(form.effect.amplitudes, map(float, amplitudes), strict=True))
    return Term(form.effect, {**form.shapes[place], **values})
