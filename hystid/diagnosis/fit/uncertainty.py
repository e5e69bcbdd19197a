"""Standard errors that hold: of residuals that are no white noise, and of a motion that is itself measured.

The covariance of least squares counts on independent errors of the rows, on exact regressors and on a true law. Here
the scores are summed over stretches of the recordings first (cluster-robust covariance: Liang and Zeger 1986). Long
stretches are left out in turn (delete-a-group jackknife): recordings differ in amplitude and speed, so that what the
law does not hold moves the parameters from one to the other. So are whole recordings: what one has of its own, as where
its sliders stood when it began, its stretches share. The bias that noise of the motion brings is found by
adding the same noise once more (simulation extrapolation: Cook and Stefanski 1994).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from hystid.diagnosis.fit.hypothesis import Fit
from hystid.diagnosis.fit.problem import Problem
from hystid.errors import NumericalError
from hystid.numeric import Array

_STRETCHES = 60  # of all rows together: long against the memory of the residual, many against the unknowns
_LEFT_OUT = 12  # stretches that are left out in turn: each is a test of its own
_ALONE = (0.5, 100.0)  # variance without a stretch over that with it, outside which only that stretch shows a parameter
_FIRST_BIAS = 1.5  # bias of the noise that is there over that of the same noise once more, which meets flattened slopes
SAME = 1e-9  # relative singular value below which directions are one


def with_robust_errors(problem: Problem, fitted: Fit, variance: float = 1.0) -> Fit:
    """The fit with standard errors that are not below those of the rows as they scatter, and not below its bias.

    variance: of an average over one state of the motion, in units of the noise: an error of the law comes again
    wherever the motion does, and more rows do not average it.
    """
    jacobian = problem.jacobian(fitted.hypothesis, fitted.unknowns)
    scale = np.linalg.norm(jacobian, axis=0)
    scale[scale == 0] = 1.0
    jacobian = jacobian / scale
    inverse = np.linalg.pinv(jacobian.T @ jacobian, rcond=1e-12)
    rows = np.array_split(np.arange(len(fitted.residual)), _STRETCHES)
    scores = np.stack([jacobian[r].T @ fitted.residual[r] for r in rows])
    robust = np.diag(inverse @ (scores.T @ scores) @ inverse)
    white = np.diag(inverse) * max(fitted.chi2, 1.0)  # what is stated where nothing else is known (Fit.stderr)
    repeated = np.diag(inverse) * variance
    left_out = [_stretches(problem, each) for each in (_LEFT_OUT, len(problem.parts))]
    told_apart = np.max([_jackknife(jacobian, fitted.residual, parts, inverse) for parts in left_out], axis=0)
    bias = _FIRST_BIAS * _bias(problem, fitted, scale, inverse, jacobian)
    reached = np.max([white, repeated, robust, told_apart], axis=0) + bias**2
    spread = np.sqrt(reached / np.where(white > 0, white, 1.0))
    return replace(fitted, covariance=inverse / np.outer(scale, scale) * np.outer(spread, spread))


def _stretches(problem: Problem, number: int) -> list[NDArray[np.int_]]:
    """Rows of at least so many stretches, none across two recordings."""
    recordings = problem.by_part(np.arange(sum(problem.row_counts())))
    each = -(-number // len(recordings))
    return [stretch for rows in recordings for stretch in np.array_split(rows, each)]


def _jackknife(jacobian: Array, residual: Array, stretches: Sequence[NDArray[np.int_]], inverse: Array) -> Array:
    """Variance of the scaled unknowns from fits without each stretch, of which one Gauss-Newton step is taken.

    A stretch that alone shows a parameter cannot be spared for it, and says nothing there.
    """
    normal, right = jacobian.T @ jacobian, jacobian.T @ residual
    with_all, steps = np.diag(inverse), []
    for rows in stretches:
        left = np.linalg.pinv(normal - jacobian[rows].T @ jacobian[rows], rcond=1e-12)
        step = left @ (right - jacobian[rows].T @ residual[rows])
        spared = (_ALONE[0] * with_all < np.diag(left)) & (np.diag(left) < _ALONE[1] * with_all)
        steps.append(np.where(spared, step, np.nan))
    moved = np.ma.masked_invalid(steps)
    count = np.maximum(moved.count(axis=0), 1)
    apart = (moved - moved.mean(axis=0)).filled(0.0)
    return np.asarray((count - 1) / count * np.sum(apart**2, axis=0))


def _bias(problem: Problem, fitted: Fit, scale: Array, inverse: Array, jacobian: Array) -> Array:
    """Change of the scaled unknowns when the noise of the motion is added once more, with either sign."""
    moved = []
    for sign in (1.0, -1.0):
        again = problem.with_noise_again(0, sign)
        try:
            columns = again.jacobian(fitted.hypothesis, fitted.unknowns) / scale
            rows = again.rows(fitted.hypothesis)
        except NumericalError:
            return np.zeros(len(scale))
        moved.append(np.linalg.lstsq(columns, rows, rcond=SAME)[0])
    start = inverse @ (jacobian.T @ fitted.residual)
    found = np.mean(moved, axis=0) - start
    return found if np.all(np.isfinite(found)) else np.zeros(len(scale))
