"""Tanh networks and the two-network hysteresis model built from them.

Signs and units as everywhere: m a + R = F, SI, R opposes motion as a spring does.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from hystid.errors import UsageError
from hystid.recording import Array
from hystid.turning_points import TurningPoints

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
        first, last = self.layers[0], self.layers[-1]
        layers = list(self.layers)
        layers[0] = (first[0] * self.input_gain, first[1] - first[0] @ (self.input_gain * self.input_offset))
        last = layers[-1]
        layers[-1] = (self.output_gain * last[0], self.output_offset + self.output_gain * last[1])
        return np.concatenate([part.ravel() for layer in layers for part in layer])


@dataclass(frozen=True, eq=False)
class Member:
    """One pair of networks: hysteresis (x, x0, Rh0) -> Rh and restoring (x, v, Rh) -> R."""

    hysteresis: Network
    restoring: Network

    def __post_init__(self) -> None:
        if self.hysteresis.sizes[0] != 3 or self.restoring.sizes[0] != 3:
            raise UsageError(
                "the hysteresis network takes (x, x0, Rh0) and the restoring network (x, v, Rh): 3 inputs each"
            )


@dataclass(frozen=True, eq=False)
class TwoNetworkModel:
    """Restoring force with memory, from an ensemble of network pairs.

    One step, at sample k, from the state of sample k-1 (turning-point rule: ``TurningPoints``):

        turn    = v_last == 0 or (|v[k]| >= velocity_band and v_last v[k] <= 0)
        x0      = x[k] if turn else x0
        Rh0[j]  = Rh[j] if turn else Rh0[j]                    for each member j, Rh[j] being that of sample k-1
        Rh[j]   = hysteresis[j](x[k], x0, Rh0[j])
        R       = mean over j of restoring[j](x[k], v[k], Rh[j])
        v_last  = v[k] if |v[k]| >= velocity_band else v_last

    Each member keeps its own force memory: averaging Rh over members instead would feed each network inputs that it
    never saw in training. x0 and v_last depend on the motion only and are shared.

    The state is one float64 vector of length 2 + 2 M for M members: [v_last, x0, Rh[0..M-1], Rh0[0..M-1]].

    mass [kg]; 0 where the force itself was recorded (no free run then). sample_rate [Hz]: that of the training data;
    the model holds at other rates as long as reversals are resolved. training_range: least and greatest value of x, v
    and R in the training data. velocity_band [m/s]: see ``TurningPoints``.
    metadata: what a reader wants to know (JSON-like).
    """

    members: tuple[Member, ...]
    mass: float
    sample_rate: float
    training_range: Mapping[str, tuple[float, float]]
    velocity_band: float = 0.0
    metadata: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        structures = {(member.hysteresis.sizes, member.restoring.sizes) for member in self.members}
        if len(structures) != 1:
            raise UsageError(f"a two-network model needs at least one member, all of one structure, found {structures}")
        if self.mass < 0 or not self.sample_rate > 0:
            raise UsageError(f"mass must be >= 0 and sample rate > 0, found {self.mass} kg and {self.sample_rate} Hz")

    @property
    def turning_points(self) -> TurningPoints:
        """The rule by which memory is renewed."""
        return TurningPoints(self.velocity_band)

    def initial_state(self, force: float = 0.0) -> Array:
        """State before the first sample; force [N] is the restoring force there (0: relaxed)."""
        members = len(self.members)
        return np.concatenate(([0.0, 0.0], np.full(members, float(force)), np.zeros(members)))

    def response(self, x: Array, v: Array, state: Array | None = None) -> tuple[Array, Array]:
        """Restoring force R [N] for a given motion x [m], v [m/s], all of shape (n,), and the state after it.

        state: from ``initial_state`` (None) or from the call before; chunk by chunk equals all at once to the bit.
        """
        from hystid.networks import evaluation

        return evaluation.response(self, x, v, self.initial_state() if state is None else state)

    def free_run(
        self, force: Array, dt: float, x_start: float = 0.0, v_start: float = 0.0, state: Array | None = None
    ) -> dict[str, Array]:
        """Motion under a given force: m a = F - R, closed loop. Returns x, v, a, R, each of shape (n,).

        force [N], shape (n,), on a grid of step dt [s]. The first row is the start: x_start [m], v_start [m/s].
        Integration: classical Runge-Kutta of order 4 with the fixed step dt, F interpolated linearly within the step.
        The memory (x0, Rh0) stays as it is during the four stages of a step and is renewed once, at the accepted
        sample, by the rule above; R and a of row k are those after the renewal, and so is the first stage of the next
        step. The oscillator FMU does the same.
        Raises NumericalError with the time at which the motion is no longer finite.
        """
        from hystid.networks import evaluation

        start = self.initial_state() if state is None else state
        return evaluation.free_run(self, force, dt, (x_start, v_start), start)
