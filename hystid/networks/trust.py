"""What a model says beyond its training data, and how far off it may be within."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hystid.networks.ports import Polyline
from hystid.recording import Array

BAND = 1.6448536269514722  # standard deviations that a 90 % band of a normal error reaches to each side


@dataclass(frozen=True)
class Tail:
    """Beyond the training range of x, v and the further inputs the networks see the nearest value inside, and a spring
    and a damper act on what is beyond: R = networks(nearest) + stiffness (x - nearest) + damping (v - nearest).

    A network by itself may say anything there. stiffness [N/m] and damping [N.s/m] are at least 0, so that the tail
    gives no energy out over a cycle.
    """

    stiffness: float
    damping: float


@dataclass(frozen=True)
class Spread:
    """Standard deviation of the model's error [N], from that between its members: sqrt(floor^2 + (factor s)^2).

    floor [N]: what all members miss alike, noise of the recordings included. between: what it is multiplied by between
    the levels of each further input, 1 at those trained on; None for inputs without such levels.
    """

    floor: float
    factor: float
    between: tuple[Polyline | None, ...] = ()

    def of(self, each: Array, further: Sequence[Array] = ()) -> Array:
        """Spread [N], shape (n,), for the members' forces, shape (n, members), and the further inputs, (n,) each."""
        spread = np.hypot(self.floor, self.factor * np.std(each, axis=1))
        for curve, values in zip(self.between, further, strict=bool(self.between)):
            spread = spread if curve is None else spread * curve(values)
        return np.asarray(spread)

    @staticmethod
    def fit(error: Array, between: Array, inflation: float = 1.0) -> Spread:
        """Fit to errors [N] on data that were not trained on, shape (n,), and the members' standard deviation there.

        floor and factor of the greatest normal likelihood, then both scaled so that nine in ten errors lie within the
        90 % band. inflation: how much greater errors are on a recording of its own than on these.
        """
        from scipy.optimize import minimize

        scale = float(np.sqrt(np.mean(error**2))) or 1.0
        e, s = error / scale, between / scale

        def cost(logs: Array) -> float:
            variance = np.exp(2 * logs[0]) + (np.exp(logs[1]) * s) ** 2
            return float(np.mean(np.log(variance) + e**2 / variance))

        # beyond these bounds one of the two terms no longer matters
        found = minimize(cost, np.log([0.7, 1.0]), method="L-BFGS-B", bounds=[(-7, 1), (-7, 3)])
        floor, factor = (float(value) for value in np.exp(found.x))
        reach = float(np.quantile(np.abs(e) / np.sqrt(floor**2 + (factor * s) ** 2), 0.9)) / BAND * inflation
        return Spread(floor * reach * scale, factor * reach)
