"""From recordings to the samples that the two networks are trained on."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from hystid.errors import NumericalError, RecordingError, UsageError
from hystid.identification.result import LinearFit
from hystid.networks import Member, Network, TwoNetworkModel
from hystid.networks.ensemble import Samples
from hystid.recording import Recording
from hystid.turning_points import TurningPoints

_LEAST = 200  # samples below which a network of dozens of weights has nothing to be trained on


def check(recordings: Sequence[Recording], holdout: Sequence[Recording]) -> None:
    """Raise RecordingError where recordings cannot be used together."""
    if not recordings:
        raise UsageError("identification needs at least one recording to train on")
    rates = [recording.sample_rate for recording in (*recordings, *holdout)]
    for recording, rate in zip((*recordings, *holdout), rates, strict=True):
        if abs(rate - rates[0]) > 0.01 * rates[0]:
            raise RecordingError(
                f"{recording.name}: sampled at {rate:.6g} Hz, but {recordings[0].name} at {rates[0]:.6g} Hz; "
                "recordings of one identification must share a sample rate: resample one of them"
            )
        for name in ("x", "v", "R"):
            values = recording.channel(name)
            bad = np.flatnonzero(~np.isfinite(values))
            if len(bad):
                raise RecordingError(f"{recording.name}: {name} is not finite at sample {bad[0]}")
            if np.ptp(values) == 0:
                raise RecordingError(f"{recording.name}: {name} is constant, so there is nothing to learn from it")
    total = sum(len(recording) for recording in recordings)
    if total < _LEAST:
        raise RecordingError(f"the training recordings hold {total} samples together; at least {_LEAST} are needed")


def samples(recordings: Sequence[Recording], rule: TurningPoints) -> Samples:
    """Samples of all recordings one after the other; the turning-point memory begins anew with each."""
    columns = []
    for recording in recordings:
        x, v, R = (recording.channel(name) for name in ("x", "v", "R"))
        columns.append((x, v, *rule.hold(x, v, R), R))
    return Samples(*(np.concatenate(parts) for parts in zip(*columns, strict=True)))


def linear_fit(data: Samples, mass: float) -> LinearFit:
    """Least squares of R on v, x and a constant."""
    table = np.stack([data.v, data.x, np.ones_like(data.x)], axis=1)
    scale = np.abs(table).max(axis=0)
    solution, _, rank, _ = np.linalg.lstsq(table / scale, data.R, rcond=None)
    if rank < 3 or not np.isfinite(solution).all():
        raise NumericalError("the linear fit has no unique answer: x, v and a constant are dependent in the recordings")
    B, Kl, offset = (float(value) for value in solution / scale)
    return LinearFit(mass, B, Kl, offset)


def linear_model(fit: LinearFit, sample_rate: float) -> TwoNetworkModel:
    """The linear fit in the form of a two-network model without hidden layers, so that both run through one code."""
    plain = {"input_offset": np.zeros(3), "input_gain": np.ones(3), "output_offset": 0.0, "output_gain": 1.0}
    nothing = Network(((np.zeros((1, 3)), np.zeros(1)),), **plain)  # type: ignore[arg-type]
    law = Network(((np.array([[fit.Kl, fit.B, 0.0]]), np.array([fit.offset])),), **plain)  # type: ignore[arg-type]
    return TwoNetworkModel((Member(nothing, law),), fit.mass, sample_rate, {})
