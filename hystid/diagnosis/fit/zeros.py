"""The zero of the displacement sensor: a spring that is measured off its zero looks like a constant force, and one that
is not linear like another law beside it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hystid.diagnosis.fit.hypothesis import Fit, Hypothesis, Term
from hystid.diagnosis.fit.problem import Problem
from hystid.diagnosis.model.channel_effects import DRIFT, is_constant
from hystid.numeric import Array

_STEP = 1e-3  # share of the largest displacement by which the law is moved to see its slope
_STEADY_FORCE = 1e-6  # relative change of a force that counts as constant


@dataclass(frozen=True)
class Zero:
    """Zero of the displacement [m] that does what a constant force [N] does.

    share: of the zero, over the standard deviation of x.
    """

    size: float
    share: float
    force: float

    def sentence(self) -> str:
        """For people."""
        return (
            f"the constant force of {self.force:.3g} N may as well be the zero of the displacement sensor: "
            f"{1e3 * abs(self.size):.3g} mm off, {100 * self.share:.2g} % of its standard deviation"
        )


def zero_of_x(problem: Problem, hypothesis: Hypothesis, force: float) -> Zero | None:
    """Zero of the displacement sensor that explains a constant force [N]; None where the law has no stiffness.

    The mean slope of the law over the recorded motion counts: that of a linear spring is its stiffness.
    """
    base, values = problem.baseline, hypothesis.values
    step = _STEP * max(float(np.max(np.abs(part.x))) for part in problem.parts)
    sides = [
        base.forces([base.held(part.x + sign * step, part.v, part.dt) for part in problem.parts], values)
        for sign in (1.0, -1.0)
    ]
    slopes = [np.mean(high - low) / (2 * step) for (high, _), (low, _) in zip(*sides, strict=True)]
    slope = float(np.average(slopes, weights=[len(part) for part in problem.parts]))
    spread = float(np.std(np.concatenate([part.x for part in problem.parts]))) or 1.0
    size = force / slope if slope else np.inf
    return (
        Zero(size, abs(size) / spread, force)
        if abs(size) < max(np.max(np.abs(part.x)) for part in problem.parts)
        else None
    )


def zero_of_term(problem: Problem, hypothesis: Hypothesis, term: Term) -> Zero | None:
    """Zero of the displacement sensor that does what a term does; None where its force changes, or no zero does so. Of
    zeros that differ from recording to recording, the one that is farthest off."""
    if term.effect.id == DRIFT and is_constant(term.values, problem.parts):
        offsets = [value for name, value in term.values.items() if name.startswith("offset")]
        return zero_of_x(problem, hypothesis, max(offsets, key=abs))
    force = _constant(term, [term.effect.force(signal, term.values) for signal in problem.signals(hypothesis)])
    return zero_of_x(problem, hypothesis, force) if force else None


def drift_of_x(problem: Problem, hypothesis: Hypothesis, term: Term) -> Zero | None:
    """Drift of a displacement sensor, where it is furthest off, that does what a drift of the force channel does; None
    for other terms, without such a sensor, and where the law has no stiffness."""
    measured = all("x" in part.measured for part in problem.parts)
    if term.effect.id != DRIFT or not measured or is_constant(term.values, problem.parts):
        return None
    forces = np.concatenate([term.effect.force(signal, term.values) for signal in problem.signals(hypothesis)])
    return zero_of_x(problem, hypothesis, float(forces[np.argmax(np.abs(forces))]))


def zeros_instead(problem: Problem, hypothesis: Hypothesis) -> list[str]:
    """Sentences about constant forces, and drifts, of a hypothesis that the displacement sensor would explain."""
    zeros, drifts = ([of(problem, hypothesis, term) for term in hypothesis.terms] for of in (zero_of_term, drift_of_x))
    return [
        *(zero.sentence() for zero in zeros if zero is not None),
        *(
            f"the drift of the force channel, by up to {abs(zero.force):.3g} N, may as well be one of the displacement "
            f"sensor, by up to {1e3 * abs(zero.size):.3g} mm: look at both zeros before and after a test"
            for zero in drifts
            if zero is not None
        ),
    ]


def zeros_of_x(problem: Problem, fit: Fit, share: float, *, free: bool = True) -> tuple[Array, float]:
    """Zero of the displacement sensor in each recording [m] beside which a fit leaves least, (recordings,), and the sum
    of squares that it leaves less then; both to first order.

    share: of the standard deviation of x, by which zeros are usually off: less is more probable. free: whether the
    parameters of the fit give way.
    """
    steps = np.array([share * (float(np.std(part.x)) or 1.0) for part in problem.parts])
    moved = problem.with_zeros(steps).rows(fit.hypothesis) - fit.residual
    columns = np.zeros((len(moved), len(steps)))
    ends = np.cumsum([0, *problem.row_counts()])
    for i in range(len(steps)):
        columns[ends[i] : ends[i + 1], i] = moved[ends[i] : ends[i + 1]]
    rest = fit.residual
    if free:
        basis, _ = np.linalg.qr(problem.jacobian(fit.hypothesis, problem.unknowns(fit.hypothesis)))
        columns, rest = columns - basis @ (basis.T @ columns), rest - basis @ (basis.T @ rest)
    off = np.linalg.solve(columns.T @ columns + np.eye(len(steps)), -(columns.T @ rest))
    left = rest + columns @ off
    return off * steps, float(rest @ rest - left @ left)


def _constant(term: Term, forces: list[np.ndarray]) -> float:
    """The force of a term that is the same at all times and in all recordings [N]; 0 where it changes."""
    joined = np.concatenate(forces)
    mean = float(np.mean(joined))
    return mean if term.effect.model is not None and np.ptp(joined) <= _STEADY_FORCE * abs(mean) else 0.0
