"""The two-network hysteresis model.

Signs and units as everywhere: m a + R = F, SI, R opposes motion as a spring does.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from hystid.errors import UsageError
from hystid.networks import evaluation
from hystid.networks.level import Level
from hystid.networks.perceptron import Member
from hystid.networks.ports import FurtherInput, Lag
from hystid.networks.trust import Spread, Tail
from hystid.recording import Array


@dataclass(frozen=True, eq=False)
class TwoNetworkModel:
    """Restoring force with memory, from an ensemble of network pairs.

    One step, at sample k, from the state of sample k-1 (turning-point rule: ``TurningPoints``). w[k]: the further
    inputs and after them the lags (``Lag``) L[k], where there are any:

        turn    = v_last == 0 or (|v[k]| >= velocity_band and v_last v[k] <= 0)
        x0      = x[k] if turn else x0
        Rh0[j]  = Rh[j] if turn else Rh0[j]                    for each member j, Rh[j] being that of sample k-1
        Rh[j]   = hysteresis[j](x[k], x0, Rh0[j], w[k])
        R       = mean over j of restoring[j](x[k], v[k], Rh[j], w[k])
        v_last  = v[k] if |v[k]| >= velocity_band else v_last
        L       = L + share (source[k] - L)                    for each lag, for the next sample

    With a level (``Level``), Rh, Rh0 and the networks' force are scaled by it: R = centre + spread * mean(...).
    Beyond the training range a ``Tail`` carries on, where there is one; ``spread``: how far off R may be.

    Each member keeps its own force memory: averaging Rh over members instead would feed each network inputs that it
    never saw in training. x0 and v_last depend on the motion only and are shared.

    The state is one float64 vector of length 2 + 2 M + l for M members and l lags:
    [v_last, x0, Rh[0..M-1], Rh0[0..M-1], L[0..l-1]].

    mass [kg]; 0 where the force itself was recorded (no free run then). sample_rate [Hz]: that of the training data;
    the model holds at other rates as long as reversals are resolved. training_range: least and greatest value of x, v,
    R and each further input (by its name) in the training data. velocity_band [m/s]: see ``TurningPoints``.
    metadata: what a reader wants to know (JSON-like). inputs, lags: in the order of the networks. Where an input has a
    curve, w is what comes out of it, and lags follow that.
    With lags, ``response`` is to be called at the sample rate of the training data.
    """

    members: tuple[Member, ...]
    mass: float
    sample_rate: float
    training_range: Mapping[str, tuple[float, float]]
    velocity_band: float = 0.0
    metadata: Mapping[str, Any] = field(default_factory=dict)
    inputs: tuple[FurtherInput, ...] = ()
    lags: tuple[Lag, ...] = ()
    level: Level | None = None
    tail: Tail | None = None
    spread: Spread | None = None

    def __post_init__(self) -> None:
        structures = {(member.hysteresis.sizes, member.restoring.sizes) for member in self.members}
        if len(structures) != 1:
            raise UsageError(f"a two-network model needs at least one member, all of one structure, found {structures}")
        if self.mass < 0 or not self.sample_rate > 0:
            raise UsageError(f"mass must be >= 0 and sample rate > 0, found {self.mass} kg and {self.sample_rate} Hz")
        named = len(self.inputs) + len(self.lags)
        if self.members[0].further != named:
            raise UsageError(f"the networks take {self.members[0].further} further inputs, but {named} are named")

    def initial_state(self, force: float = 0.0, at: Mapping[str, float] | None = None) -> Array:
        """State before the first sample; force [N] is the restoring force there (0: relaxed).

        at: x, v and further inputs of the first sample, at which the lags have settled; by default rest at 0, and the
        middle of the training range.
        """
        middle = {port.name: 0.5 * sum(self.training_range.get(port.name, (0.0, 0.0))) for port in self.inputs}
        signals = {"x": 0.0, "v": 0.0} | middle | dict(at or {})
        signals |= {port.name: float(port.seen(np.array(signals[port.name]))) for port in self.inputs}
        late = [signals[lag.source] for lag in self.lags]
        if self.level is not None:
            further = np.array([*(signals[port.name] for port in self.inputs), *late])
            centre = self.level.centre(np.array(signals["x"]), further)
            force = float((force - centre) / self.level.spread(further))
        members = len(self.members)
        return np.concatenate(([0.0, 0.0], np.full(members, float(force)), np.zeros(members), late))

    def response(
        self, x: Array, v: Array, state: Array | None = None, inputs: Mapping[str, Array] | None = None
    ) -> tuple[Array, Array]:
        """Restoring force R [N] for a given motion x [m], v [m/s], all of shape (n,), and the state after it.

        state: from ``initial_state`` (None) or from the call before; chunk by chunk equals all at once to the bit.
        inputs: the further inputs by name, shape (n,) each, SI units. Raises UsageError where one is missing.
        """
        force, _, after = self.members_response(x, v, state, inputs)
        return force, after

    def members_response(
        self, x: Array, v: Array, state: Array | None = None, inputs: Mapping[str, Array] | None = None
    ) -> tuple[Array, Array, Array]:
        """As ``response``, with the restoring force of each member between [N], shape (n, members)."""
        start = self.initial_state() if state is None else state
        return evaluation.response(self._kernel(1 / self.sample_rate), x, v, self._table(inputs, len(x)), start)

    def free_run(
        self,
        force: Array,
        dt: float,
        x_start: float = 0.0,
        v_start: float = 0.0,
        state: Array | None = None,
        inputs: Mapping[str, Array] | None = None,
    ) -> dict[str, Array]:
        """Motion under a given force: m a = F - R, closed loop. Returns x, v, a, R, each of shape (n,).

        force [N], shape (n,), on a grid of step dt [s]. The first row is the start: x_start [m], v_start [m/s].
        inputs: the further inputs by name on the same grid.
        Integration: classical Runge-Kutta of order 4 with the fixed step dt, F and the further inputs interpolated
        linearly within the step.
        The memory (x0, Rh0) stays as it is during the four stages of a step and is renewed once, at the accepted
        sample, by the rule above; R and a of row k are those after the renewal, and so is the first stage of the next
        step. The oscillator FMU does the same.
        Raises NumericalError with the time at which the motion is no longer finite.
        """
        if not self.mass > 0:
            raise UsageError(
                "a free run needs a mass above 0 kg; this model was identified with F as the restoring force"
            )
        start = self.initial_state() if state is None else state
        further = self._table(inputs, len(force))
        begin = evaluation.Start(self.mass, dt, x_start, v_start, start)
        return evaluation.free_run(self._kernel(dt), force, further, begin)

    def _kernel(self, dt: float) -> evaluation.Ensemble:
        places = {"v": -1} | {port.name: number for number, port in enumerate(self.inputs)}
        sources = tuple(places[lag.source] for lag in self.lags)
        shares = tuple(lag.share(dt) for lag in self.lags)
        ends = None
        if self.tail is not None:
            signals = ["x", "v", *(port.name for port in self.inputs)]
            limits = np.array([self.training_range[name] for name in signals])
            ends = evaluation.Ends(limits, self.tail)
        curves = tuple(port.curve for port in self.inputs) if any(port.curve for port in self.inputs) else ()
        return evaluation.Ensemble(self.members, self.velocity_band, sources, shares, self.level, ends, curves)

    def _table(self, inputs: Mapping[str, Array] | None, samples: int) -> Array:
        """Further inputs as rows per sample, shape (n, inputs)."""
        given = inputs or {}
        missing = [port.name for port in self.inputs if port.name not in given]
        if missing:
            raise UsageError(f"the model has the further input {missing[0]}, for which no values were given")
        if not self.inputs:
            return np.zeros((samples, 0))
        columns = [np.asarray(given[port.name], dtype=np.float64) for port in self.inputs]
        for port, column in zip(self.inputs, columns, strict=True):
            if column.shape != (samples,):
                raise UsageError(f"input {port.name} must have shape ({samples},), found {column.shape}")
            bad = np.flatnonzero(~np.isfinite(column))
            if len(bad):
                raise UsageError(f"input {port.name} is not finite at sample {bad[0]}")
        return np.ascontiguousarray(np.stack(columns, axis=1))
