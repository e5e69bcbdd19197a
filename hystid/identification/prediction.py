"""A two-network model on a recording: force on the measured motion, and the free run."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from hystid.errors import NumericalError
from hystid.identification.inputs import columns_of
from hystid.networks import TwoNetworkModel
from hystid.networks.trust import BAND
from hystid.recording import Array, Recording, own_mass
from hystid.validation.judged import force_error, run_errors, start_of

Role = Literal["training", "holdout"]


@dataclass(frozen=True, eq=False)
class Prediction:
    """One model on one recording. R: restoring force on the measured motion [N], shape (n,).

    free_run: x, v, a, R of the closed loop from the recording's own start and force, None where there is no mass or
    where it diverged (then ``diverged`` says so). Errors are NRMSE (fractions); R_mse [N2].
    spread: standard deviation of the error of R [N], shape (n,).
    """

    R: Array
    force_nrmse: float
    free_run: Mapping[str, Array] | None = None
    x_nrmse: float | None = None
    R_nrmse: float | None = None
    R_mse: float | None = None
    diverged: str = ""
    spread: Array | None = None

    def with_run(self, recording: Recording, run: Mapping[str, Array]) -> Prediction:
        """The same with a free run of the recording."""
        found = run_errors(recording, run)
        errors = {name: found[name] for name in ("x_nrmse", "R_nrmse", "R_mse")}
        return replace(self, free_run=run, **errors)  # type: ignore[arg-type]  # of these names

    def within(self, R: Array) -> float | None:
        """Share of measured R [N], shape (n,), within the 90 % band of the model; None without a spread."""
        return None if self.spread is None else float(np.mean(np.abs(R - self.R) <= BAND * self.spread))


def respond(model: TwoNetworkModel, recording: Recording) -> tuple[Array, Array]:
    """R on the measured motion [N], shape (n,), and each member's, shape (n, members)."""
    x, v, further, start = begin(model, recording)
    force, each, _ = at_rate(model, recording).members_response(x, v, start, further)
    return force, each


def spread_of(model: TwoNetworkModel, recording: Recording, each: Array) -> Array | None:
    """Spread of R along a recording [N], shape (n,), from each member's force (``respond``); None without one."""
    further = columns_of(recording, model.inputs)
    return None if model.spread is None else model.spread.of(each, list(further.values()))


def at_rate(model: TwoNetworkModel, recording: Recording) -> TwoNetworkModel:
    """The model with steps of the recording's sample time, which only its lags depend on."""
    return replace(model, sample_rate=recording.sample_rate)


def begin(model: TwoNetworkModel, recording: Recording) -> tuple[Array, Array, dict[str, Array], Array]:
    """x, v, further inputs of a recording, and the state of the model before its first sample."""
    x, v = recording.channel("x"), recording.channel("v")
    further = columns_of(recording, model.inputs)
    start = start_of(recording)
    first = {"x": start["x"], "v": start["v"]} | {name: float(values[0]) for name, values in further.items()}
    return x, v, further, model.initial_state(start["R"], first)


def predict(model: TwoNetworkModel, recording: Recording) -> Prediction:
    """The model on one recording: R on the measured motion, and the free run with its mass where there is one."""
    model = replace(model, mass=own_mass(recording, model.mass))
    x, v, further, start = begin(model, recording)
    force, each, _ = at_rate(model, recording).members_response(x, v, start, further)
    open_loop = Prediction(force, force_error(recording, force), spread=spread_of(model, recording, each))
    if not model.mass:
        return open_loop
    try:
        run = model.free_run(recording.channel("F"), recording.dt, float(x[0]), float(v[0]), start, further)
    except NumericalError as error:
        return replace(open_loop, diverged=str(error))
    return open_loop.with_run(recording, run)


def drift(prediction: Prediction) -> float:
    """NRMSE of the displacement in free run: 0 where there is none to judge, infinite where it diverged."""
    if prediction.diverged:
        return np.inf
    return prediction.x_nrmse or 0.0
