"""Joint smoothing of x, v and a: one smooth motion that fits all three, each weighted by its own noise.

The motion is a quintic spline with a knot at every sample; minimised is

    sum (x - X)^2 / sx^2 + (v - V)^2 / sv^2 + (a - A)^2 / sa^2 + penalty integral (x'''')^2 dt

over its coefficients (Whittaker 1923, Reinsch 1967), with those of X, V, A that were measured: x settles the slow part
of a, and a the fast part of x, which no filter on one channel alone can do. The penalty is chosen by generalised
cross-validation (Craven and Wahba, 1979).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import scipy.linalg
from scipy.optimize import minimize_scalar
from scipy.signal import welch

from hystid.recording import Array, Recording

_UNITS = {"x": "m", "v": "m/s", "a": "m/s2"}  # in the order of their derivative
_DEGREE = 5
_PENALISED = 4  # a kink in a, as sticking and slipping make it, is an impulse in x'''': white, as the penalty assumes
# Quintic B-spline and derivatives at the five knots where it is not zero, for unit knot distance.
_VALUES = {
    0: np.array([1, 26, 66, 26, 1]) / 120,
    1: np.array([-1, -10, 0, 10, 1]) / 24,
    2: np.array([1, 2, -6, 2, 1]) / 6,
    4: np.array([1.0, -4, 6, -4, 1]),
}


def noise_level(values: Array) -> float:
    """Standard deviation of the white part of a signal: the median of the highest fifth of its spectrum.

    Never below 1e-6 of the signal's rms, so that a noise-free channel still has a finite weight.
    """
    power = welch(values, fs=2.0, nperseg=min(len(values), 1024))[1]
    top = power[-max(len(power) // 5, 1) : -1] if len(power) > 10 else power
    return float(max(np.sqrt(np.median(top)), 1e-6 * np.sqrt(np.mean(values**2))))


def smooth(recording: Recording) -> Recording:
    """The recording with x, v and a from one smooth motion; F is untouched, R = F - m a has to be formed anew.

    Uses the channels that were measured, each weighted by its own noise (``noise_level``). A recording without any, or
    whose time only numbers the samples, or shorter than 64 samples is returned as it is, and so is one in which a and v
    were integrated upwards only (no x): a spline cannot know their drift.
    """
    measured = [name for name in _UNITS if _is_measured(recording, name)]
    if "x" not in measured or recording.quasi_static or len(recording) < 64:
        return recording
    levels = {name: noise_level(recording.channel(name)) for name in measured}
    problem = _Problem({name: recording.channel(name) for name in measured}, levels, recording.dt)
    penalty = problem.cross_validated()
    noise = ", ".join(f"{levels[name]:.3g} {_UNITS[name]} on {name}" for name in measured)
    sources, limit = ", ".join(measured), problem.cutoff(penalty)
    note = f"x, v, a smoothed jointly from {sources} (noise {noise}; resolution {limit:.4g} Hz)"
    channels = dict(zip(_UNITS, problem.motion(penalty), strict=True))
    origin = {**recording.origin, **dict.fromkeys(_UNITS, f"joint smoothing of {sources}")}
    force = {} if _is_measured(recording, "R") else {"R": None}
    return replace(recording, origin=origin, notes=(*recording.notes, note), **channels, **force)  # type: ignore[arg-type]  # names of channels


def _is_measured(recording: Recording, name: str) -> bool:
    """Whether the channel is a view of the motion of its own; one derived from another channel is not."""
    origin = recording.origin.get(name, "measured")
    return getattr(recording, name) is not None and origin.startswith(("measured", "simulated"))


class _Problem:
    """Banded least squares of the spline coefficients. Time is counted in samples, so that d/dt = rate d/dk."""

    def __init__(self, channels: Mapping[str, Array], noise: Mapping[str, float], dt: float) -> None:
        orders = [list(_UNITS).index(name) for name in channels]
        self.dt, self.count, self.orders = dt, len(next(iter(channels.values()))), orders
        self.weights = {order: 1 / (noise[name] * dt**order) for order, name in zip(orders, channels, strict=True)}
        self.data = {order: values * dt**order for order, values in zip(orders, channels.values(), strict=True)}
        unknowns = self.count + _DEGREE - 1
        self.matrix, self.right = np.zeros((_DEGREE, unknowns)), np.zeros(unknowns)
        self.rough = np.zeros((_DEGREE, unknowns))
        for order, weight in self.weights.items():
            row = _VALUES[order] * weight
            _add_products(self.matrix, row, self.count)
            for i in range(_DEGREE):
                self.right[i : i + self.count] += row[i] * weight * self.data[order]
        _add_products(self.rough, _VALUES[_PENALISED], self.count)

    def coefficients(self, penalty: float) -> Array:
        """Spline coefficients, shape (n + 4,)."""
        banded = self.matrix + penalty * self.rough
        banded[0] += 1e-9 * self.weights[0] ** 2  # settles the ends where little is known; far below what x says
        return np.asarray(scipy.linalg.solveh_banded(banded, self.right, lower=True, check_finite=False))

    def motion(self, penalty: float) -> Array:
        """x, v, a of the spline at the samples, shape (3, n), SI units."""
        c = self.coefficients(penalty)
        return np.stack([np.correlate(c, _VALUES[order], "valid") / self.dt**order for order in range(3)])

    def _gains(self, penalty: float) -> tuple[Array, Array]:
        """Transfer function of the smoother over frequency [rad/sample], from the spline's own response."""
        w = np.linspace(0, np.pi, 2049)[1:]
        steps = np.arange(-2, 3)
        response = {order: np.abs(row @ np.exp(1j * np.outer(steps, w))) ** 2 for order, row in _VALUES.items()}
        information = sum(response[order] * weight**2 for order, weight in self.weights.items())
        return w, np.asarray(information / (information + penalty * response[_PENALISED]))

    def cutoff(self, penalty: float) -> float:
        """Frequency [Hz] at which half of the signal's amplitude passes."""
        w, gain = self._gains(penalty)
        low = np.flatnonzero(gain < 0.5)
        return float((w[low[0]] if len(low) else np.pi) / (2 * np.pi * self.dt))

    def cross_validated(self) -> float:
        """Penalty of least generalised cross-validation score."""
        reference = float(self.matrix[0].max() / self.rough[0].max())

        def score(exponent: float) -> float:
            penalty = reference * 10**exponent
            try:
                c = self.coefficients(penalty)
            except np.linalg.LinAlgError:  # so stiff that x is lost in rounding: far beyond any resolution of use
                return float("inf")
            misses = [
                weight * (self.data[order] - np.correlate(c, _VALUES[order], "valid"))
                for order, weight in self.weights.items()
            ]
            freedom = self.count * float(np.mean(self._gains(penalty)[1]))
            squares = sum(float(np.sum(miss**2)) for miss in misses)
            return float(np.log(squares) - 2 * np.log(len(misses) * self.count - freedom))

        coarse = min(
            range(-6, 13, 2), key=score
        )  # the score is flat on the side of no smoothing: no place to search from
        best = minimize_scalar(score, bounds=(coarse - 2, coarse + 2), method="bounded", options={"xatol": 0.1})
        return reference * 10 ** float(best.x)


def _add_products(banded: Array, weights: Array, count: int) -> None:
    """banded += A' A in lower form, where row k of A holds the weights at columns k .. k + 4."""
    for i in range(_DEGREE):
        for j in range(i + 1):
            banded[i - j, j : j + count] += weights[i] * weights[j]
