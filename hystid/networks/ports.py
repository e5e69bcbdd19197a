"""Further inputs of a model, and signals that follow others late."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.signal import lfilter

from hystid.recording import Array


@dataclass(frozen=True)
class FurtherInput:
    """An input besides the motion, as a current or a pressure. name: of its port, a plain identifier. column: what it
    is called in recordings. unit: SI, "1" where it has none."""

    name: str
    unit: str
    column: str


@dataclass(frozen=True)
class Lag:
    """A signal L that follows another one late: time dL/dt = source - L. source: "v", or the name of a further input.

    A coil's current follows its voltage so, and a force that passes a filter or a column of fluid its motion. In
    samples: L[k + 1] = L[k] + share (source[k] - L[k]), so that L[k] is known before sample k is.
    """

    source: str
    time: float  # [s]

    def share(self, dt: float) -> float:
        """Share of the difference that a step of dt [s] makes up."""
        return float(-np.expm1(-dt / self.time))

    def follow(self, source: Array, dt: float) -> Array:
        """L at the samples of its source, both of shape (n,); it starts at the source's first value."""
        share = self.share(dt)
        return np.asarray(lfilter([0.0, share], [1.0, share - 1.0], source, zi=source[:1])[0])
