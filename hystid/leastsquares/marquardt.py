"""Levenberg-Marquardt (Levenberg, 1944; Marquardt, 1963) with early stopping.

A rule is data: how the damping is formed and how its factor mu moves. One loop serves all rules, and any number of
problems of one size side by side: each has its own mu, accepts its own steps and ends for its own reason. A single
problem is a batch of one.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from hystid.errors import NumericalError
from hystid.numeric import Array

Reason = Literal["validation", "iterations", "damping", "gradient", "stalled", "interrupted"]

REASONS: dict[Reason, str] = {
    "validation": "the validation error had not fallen for the allowed number of iterations",
    "iterations": "the iteration limit was reached",
    "damping": "no step lowers the training error any more (mu above its limit)",
    "gradient": "the gradient vanished",
    "stalled": "the training error fell by less than the stated fraction",
    "interrupted": "the training was interrupted",
}
_LEAST_MU = 1e-20


@dataclass(frozen=True)
class Rule:
    """Damping of J'J. scaling "mean": mu N I (mu damps J'J / N, as MATLAB's trainlm has it); "columns": mu diag(J'J).

    After a step that lowers the error mu is multiplied by ``down``, after one that does not by ``up``.
    The training ends as stalled when ``window`` iterations together lower the training error by less than ``progress``
    (a fraction; 0 never).
    draft: share of the training samples that the first three quarters of the iterations see, 0 for all of them from the
    start. Far from the minimum a few samples per weight give the direction as well; the answer is always one of all
    samples. At least ten samples per weight are taken; where that is above half of the samples, or there are fewer than
    10,000, which are soon trained on anyhow, there is no draft.
    """

    scaling: Literal["mean", "columns"]
    mu: float
    up: float = 10.0
    down: float = 0.1
    mu_max: float = 1e10
    max_iterations: int = 1000
    max_fails: int = 6
    min_gradient: float = 1e-7
    progress: float = 0.0
    window: int = 20
    draft: float = 0.0


class LeastSquaresProblem(Protocol):
    """E least-squares problems of P parameters each, side by side; ``samples`` residuals e in every one."""

    samples: int

    def squares(self, w: Array) -> Array:
        """Sums of squared residuals at w, shape (E, P): shape (E,)."""

    def build(self, w: Array) -> Array:
        """As ``squares``; keeps J'J and J'e for ``diagonal``, ``gradient`` and ``solve``."""

    def diagonal(self) -> Array:
        """Diagonals of J'J, shape (E, P)."""

    def gradient(self) -> Array:
        """J'e, shape (E, P)."""

    def solve(self, damping: Array) -> tuple[Array, NDArray[np.bool_]]:
        """Solutions d of (J'J + diag(damping)) d = J'e, shape (E, P), and where that is positive definite, (E,)."""


@dataclass(frozen=True, eq=False)
class Descent:
    """Outcome for one problem. w: parameters of the least validation error, shape (P,); iteration: where they were met.

    train, validation: mean square before the first and after each iteration, shape (iterations + 1,).
    """

    w: Array
    reason: Reason
    iteration: int
    train: Array
    validation: Array


class _Course:
    """How one problem has gone so far."""

    def __init__(self, w: Array, train: float, validation: float) -> None:
        self.best, self.best_at = w.copy(), 0
        self.train, self.validation = [train], [validation]
        self.reason: Reason | None = None

    def record(self, w: Array, train: float, validation: float, rule: Rule) -> None:
        """One accepted step, and whether it was the last."""
        self.train.append(train)
        self.validation.append(validation)
        iteration = len(self.train) - 1
        if validation < self.validation[self.best_at]:
            self.best, self.best_at = w.copy(), iteration
        if iteration - self.best_at >= rule.max_fails:
            self.reason = "validation"
        elif iteration >= rule.window and self.train[-1] > (1 - rule.progress) * self.train[-1 - rule.window]:
            self.reason = "stalled"

    def descent(self) -> Descent:
        return Descent(
            self.best, self.reason or "iterations", self.best_at, np.array(self.train), np.array(self.validation)
        )


def minimise(
    fit: LeastSquaresProblem,
    check: LeastSquaresProblem,
    w: Array,
    rule: Rule,
    stopped: Callable[[], bool] = lambda: False,
) -> list[Descent]:
    """Lower the errors of ``fit`` from w, shape (E, P); the answers are the iterates of least error of ``check``.

    stopped: asked after every iteration; True ends all that still run as interrupted.
    Raises NumericalError where an error at the start is not finite.
    """
    w = np.array(w, dtype=np.float64)
    train, validation = fit.squares(w) / fit.samples, check.squares(w) / check.samples
    if not np.isfinite(train).all():
        raise NumericalError("the error is not finite at its starting weights: is there a NaN in the data?")
    courses = [_Course(*start) for start in zip(w, train.tolist(), validation.tolist(), strict=True)]
    mu = np.full(len(w), rule.mu)
    for _ in range(rule.max_iterations):
        running = np.array([course.reason is None for course in courses])
        if not running.any():
            break
        before = fit.build(w)
        flat = 2 * np.linalg.norm(fit.gradient(), axis=1) / fit.samples < rule.min_gradient
        moved, errors = _accept(fit, w, mu, before, running & ~flat, rule)
        validation = check.squares(w) / check.samples
        for k in np.flatnonzero(running):
            if flat[k] or not moved[k]:
                courses[k].reason = "gradient" if flat[k] else "damping"
            else:
                courses[k].record(w[k], float(errors[k]) / fit.samples, float(validation[k]), rule)
        if stopped():
            for course in courses:
                course.reason = course.reason or "interrupted"
            break
    return [course.descent() for course in courses]


def _accept(
    fit: LeastSquaresProblem, w: Array, mu: Array, before: Array, waiting: NDArray[np.bool_], rule: Rule
) -> tuple[NDArray[np.bool_], Array]:
    """Raise each problem's mu until its step lowers its error or mu passes its limit. Changes w and mu in place.

    Returns which problems have moved, and their errors.
    """
    scale = np.full_like(w, float(fit.samples)) if rule.scaling == "mean" else fit.diagonal()
    if rule.scaling == "columns":  # a column of zeros (a saturated neuron) still needs a little damping
        scale = scale + 1e-12 * scale.max(axis=1, keepdims=True)
    moved, errors = np.zeros_like(waiting), before.copy()
    waiting = waiting & (mu <= rule.mu_max)
    while waiting.any():
        step, definite = fit.solve(mu[:, None] * scale)
        trial = np.where((waiting & definite)[:, None], w - step, w)
        error = fit.squares(trial) if (waiting & definite).any() else before
        better = waiting & definite & (error < before)
        w[better], errors[better] = trial[better], error[better]
        mu[better] = np.maximum(mu[better] * rule.down, _LEAST_MU)
        moved |= better
        waiting &= ~better
        mu[waiting] *= rule.up
        waiting &= mu <= rule.mu_max
    return moved, errors
