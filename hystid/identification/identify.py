"""``identify``: from recordings to a two-network model, its errors and its files."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

import numpy as np

from hystid import processing
from hystid.comparison import mse, nrmse
from hystid.errors import NumericalError, UsageError
from hystid.identification import data, export
from hystid.identification.result import Comparison, Identification, Prediction
from hystid.networks import TwoNetworkModel
from hystid.networks.ensemble import Samples, choose, train_ensemble
from hystid.networks.normal_equations import Precision
from hystid.networks.training import Mode, rule_of, split_indices
from hystid.recording import Recording
from hystid.turning_points import TurningPoints

Method = Literal["published", "refined"]


def identify(
    recordings: Sequence[Recording],
    *,
    mass: float,
    layers: Sequence[int] = (5, 5),
    ensemble: int = 30,
    band: processing.Band | None = None,
    decimate: int = 1,
    seed: int = 0,
    mode: Mode = "fast",
    method: Method = "published",
    precision: Precision = "float64",
    samples: int = 50_000,
    holdout: Sequence[Recording] = (),
    workers: int | None = None,
    out: Path | None = None,
) -> Identification:
    """Identify the restoring force with memory from recordings, by the two-network method.

    recordings: the training set; holdout: recordings that are only predicted. Both go through ``processing.prepare``
    with ``band`` (low, high) [Hz] and ``decimate``, so that x, v and R = F - mass a are there at one sample rate.
    mass [kg]: 0 means that F is the restoring force itself; then there is no free run.
    layers: neurons of each hidden layer of both networks. ensemble: number of starts; the best tenth is averaged.
    seed: of the split and of all starts; the result does not depend on ``workers`` (trainings at a time).
    mode: "trainlm" (MATLAB's damping) or "fast" (Marquardt's). samples: at most so many, drawn at random from all
    recordings after the turning points were found at full rate. out: folder to write the models and
    identification.json to.
    Raises UsageError, RecordingError, NumericalError. After Ctrl-C it goes on with the trainings that had finished.
    """
    _check(mass, layers, ensemble, samples)
    used = [processing.prepare(recording, band=band, decimate=decimate, mass=mass) for recording in recordings]
    unseen = [processing.prepare(recording, band=band, decimate=decimate, mass=mass) for recording in holdout]
    data.check(used, unseen)
    rule = TurningPoints()
    everything = data.samples(used, rule)
    drawn = everything.subset(samples, seed)
    starts = train_ensemble(
        drawn, layers, ensemble, seed=seed, rule=rule_of(mode), precision=precision, workers=workers
    )
    chosen = choose(starts)
    model = TwoNetworkModel(
        tuple(start.member for start in chosen),
        mass,
        used[0].sample_rate,
        {name: _range(getattr(everything, name)) for name in ("x", "v", "R")},
    )
    fit = data.linear_fit(drawn, mass)
    line = data.linear_model(fit, model.sample_rate)
    comparisons = [Comparison(r, "training", predict(model, r), predict(line, r)) for r in used]
    comparisons += [Comparison(r, "holdout", predict(model, r), predict(line, r)) for r in unseen]
    notes = () if len(starts) == ensemble else (f"interrupted: {len(starts)} of {ensemble} trainings had finished",)
    settings: dict[str, Any] = {"layers": list(layers), "ensemble": ensemble, "mode": mode, "method": method}
    settings |= {"seed": seed, "samples": len(drawn.x), "precision": precision, "decimate": decimate}
    settings["band"] = list(band) if band else None
    numbers = tuple(start.number for start in chosen)
    test = _test(model, drawn, seed)
    result = Identification(model, starts, numbers, comparisons, fit, test, settings, notes)
    return export.write(result, Path(out)) if out is not None else result


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
    return replace(open_loop, free_run=run, **errors)  # type: ignore[arg-type]


def _check(mass: float, layers: Sequence[int], ensemble: int, samples: int) -> None:
    if not (np.isfinite(mass) and mass >= 0):
        raise UsageError(f"mass must be a number of at least 0 kg, found {mass}")
    if not layers or any(neurons < 1 for neurons in layers):
        raise UsageError(f"layers must be neurons per hidden layer, each at least 1, as 5,5; found {tuple(layers)}")
    if ensemble < 1 or samples < 1:
        raise UsageError(f"ensemble and samples must be at least 1, found {ensemble} and {samples}")


def _range(values: np.ndarray[Any, Any]) -> tuple[float, float]:
    return float(values.min()), float(values.max())


def _test(model: TwoNetworkModel, drawn: Samples, seed: int) -> dict[str, float]:
    """Errors of the averaged model on the test part of the split, with the measured memory."""
    part = split_indices(len(drawn.x), seed)["test"]
    x, v, x0, R0, R = (getattr(drawn, name)[part] for name in ("x", "v", "x0", "R0", "R"))
    forces = [member.restoring(x, v, member.hysteresis(x, x0, R0)) for member in model.members]
    force = np.mean(forces, axis=0)
    return {"nrmse": nrmse(force, R), "mse": mse(force, R), "samples": len(R)}
