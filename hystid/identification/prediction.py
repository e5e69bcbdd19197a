"""A two-network model on a recording: force on the measured motion, and the free run."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from hystid.comparison import mse, nrmse
from hystid.errors import NumericalError
from hystid.identification.result import Prediction
from hystid.networks import TwoNetworkModel
from hystid.recording import Recording


def predict(model: TwoNetworkModel, recording: Recording) -> Prediction:
    """The model on one recording: R on the measured motion, and the free run where there is a mass."""
    x, v, R = (recording.channel(name) for name in ("x", "v", "R"))
    start = model.initial_state(float(R[0]))
    force, _ = model.response(x, v, start)
    open_loop = Prediction(force, nrmse(force, R))
    if not model.mass:
        return open_loop
    try:
        run = model.free_run(recording.channel("F"), recording.dt, float(x[0]), float(v[0]), start)
    except NumericalError as error:
        return replace(open_loop, diverged=str(error))
    errors = {"x_nrmse": nrmse(run["x"], x), "R_nrmse": nrmse(run["R"], R), "R_mse": mse(run["R"], R)}
    return replace(open_loop, free_run=run, **errors)  # type: ignore[arg-type]  # the keys are fields


def drift(prediction: Prediction) -> float:
    """NRMSE of the displacement in free run: 0 where there is none to judge, infinite where it diverged."""
    if prediction.diverged:
        return np.inf
    return prediction.x_nrmse or 0.0
