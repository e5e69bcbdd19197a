"""Further inputs of a model, how they are scaled, and signals that follow others late."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hystid.recording import Array


@dataclass(frozen=True)
class Polyline:
    """Straight lines over the values of an input: what the networks see in their place, or a factor (``Spread``).

    at: the values, ascending; to: what stands in their place. Outside, the nearest of them. What networks see follows
    the level of the force between the values trained on: ascending, from the same least to the same greatest value.
    """

    at: tuple[float, ...]
    to: tuple[float, ...]

    def __call__(self, values: Array) -> Array:
        """What stands in the place of the values, of their shape."""
        return np.asarray(np.interp(values, self.at, self.to))

    @property
    def slopes(self) -> tuple[float, ...]:
        """Slope of each line."""
        return tuple(float(slope) for slope in np.diff(self.to) / np.diff(self.at))


@dataclass(frozen=True)
class FurtherInput:
    """An input besides the motion, as a current or a pressure. name: of its port, a plain identifier. column: what it
    is called in recordings. unit: SI, "1" where it has none. curve: applied to it first, where there is one."""

    name: str
    unit: str
    column: str
    curve: Polyline | None = None

    def seen(self, values: Array) -> Array:
        """What the networks see of values in the input's unit, of their shape."""
        return values if self.curve is None else self.curve(values)


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
        from scipy.signal import lfilter  # a second to load, which a build of an FMU need not wait for

        return np.asarray(lfilter([0.0, share], [1.0, share - 1.0], source, zi=source[:1])[0])
