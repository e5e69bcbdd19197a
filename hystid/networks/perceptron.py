"""Tanh networks and pairs of them: what the two-network model is built from."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from hystid.errors import UsageError
from hystid.networks.normal_equations import flattened
from hystid.recording import Array

Layers = tuple[tuple[Array, Array], ...]


@dataclass(frozen=True, eq=False)
class Network:
    """Feed-forward network y = output_offset + output_gain * N((u - input_offset) * input_gain).

    layers: (W, b) with W of shape (outputs, inputs) and b of shape (outputs,); tanh after every layer but the last.
    input_offset, input_gain: shape (inputs,); offset is the middle and gain 2 / width of the training range, so that
    the training data span [-1, 1] (MATLAB's mapminmax). output_offset, output_gain: the target's middle and half width.
    """

    layers: Layers
    input_offset: Array
    input_gain: Array
    output_offset: float
    output_gain: float

    def __post_init__(self) -> None:
        width = len(self.input_offset)
        for number, (weights, bias) in enumerate(self.layers):
            if weights.shape != (len(bias), width):
                raise UsageError(
                    f"layer {number} of a network must have weights of shape ({len(bias)}, {width}), "
                    f"found {weights.shape}"
                )
            width = len(bias)
        if width != 1 or len(self.input_gain) != len(self.input_offset):
            raise UsageError("a network must have one output, and as many input gains as input offsets")

    @property
    def sizes(self) -> tuple[int, ...]:
        """Inputs, neurons of each hidden layer, 1: e.g. (3, 5, 5, 1)."""
        return (len(self.input_offset), *(len(bias) for _, bias in self.layers))

    def __call__(self, *inputs: Array | float) -> Array:
        """Output, shape (n,), for inputs that broadcast to shape (n,) each. Physical units in and out."""
        columns = np.stack(np.broadcast_arrays(*(np.atleast_1d(np.asarray(u, dtype=np.float64)) for u in inputs)))
        signal = (columns - self.input_offset[:, None]) * self.input_gain[:, None]
        for weights, bias in self.layers[:-1]:
            signal = np.tanh(weights @ signal + bias[:, None])
        weights, bias = self.layers[-1]
        return np.asarray(self.output_offset + self.output_gain * (weights @ signal + bias[:, None])[0])

    @cached_property
    def flat(self) -> Array:
        """Weights of the same network on unscaled inputs and output, [W1 row by row, b1, W2, b2, ...]: shape (P,)."""
        layers = list(self.layers)
        weights, bias = layers[0]
        layers[0] = (weights * self.input_gain, bias - weights @ (self.input_gain * self.input_offset))
        weights, bias = layers[-1]
        layers[-1] = (self.output_gain * weights, self.output_offset + self.output_gain * bias)
        return flattened(layers)


@dataclass(frozen=True, eq=False)
class Member:
    """One pair of networks: hysteresis (x, x0, Rh0, w...) -> Rh and restoring (x, v, Rh, w...) -> R.

    w: further inputs, as a current or a pressure; none in most models.
    """

    hysteresis: Network
    restoring: Network

    def __post_init__(self) -> None:
        if self.hysteresis.sizes[0] != self.restoring.sizes[0] or self.hysteresis.sizes[0] < 3:
            raise UsageError(
                "the hysteresis network takes (x, x0, Rh0) and the restoring network (x, v, Rh): 3 inputs each, "
                "and the same further inputs"
            )

    @property
    def further(self) -> int:
        """Number of further inputs."""
        return self.hysteresis.sizes[0] - 3
