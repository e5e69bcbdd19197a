"""From recordings to the samples that the two networks are trained on."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from hystid.errors import NumericalError, RecordingError, UsageError
from hystid.identification.inputs import table_of
from hystid.identification.result import LinearFit
from hystid.limits import TRAININGS, check_whole
from hystid.networks import FurtherInput, Lag, Member, Network, TwoNetworkModel
from hystid.networks.ensemble import Samples
from hystid.networks.joint import Trajectory
from hystid.networks.level import Level
from hystid.networks.trust import Tail
from hystid.processing import cut
from hystid.recording import Recording
from hystid.turning_points import TurningPoints

_FEWEST = 200  # samples below which a network of dozens of weights has nothing to be trained on


def check(recordings: Sequence[Recording], holdout: Sequence[Recording]) -> None:
    """Raise RecordingError where recordings cannot be used together."""
    if not recordings:
        raise UsageError("identification needs at least one recording to train on")
    for recording in (*recordings, *holdout):
        for name in ("x", "v", "R"):
            values = recording.channel(name)
            bad = np.flatnonzero(~np.isfinite(values))
            if len(bad):
                raise RecordingError(f"{recording.name}: {name} is not finite at sample {bad[0]}")
            if np.ptp(values) == 0:
                raise RecordingError(f"{recording.name}: {name} is constant, so there is nothing to learn from it")
    total = sum(len(recording) for recording in recordings)
    if total < _FEWEST:
        raise RecordingError(f"the training recordings hold {total} samples together; at least {_FEWEST} are needed")


def samples(
    recordings: Sequence[Recording],
    rule: TurningPoints,
    inputs: Sequence[FurtherInput] = (),
    lags: Sequence[Lag] = (),
    level: Level | None = None,
) -> Samples:
    """Samples of all recordings one after the other; the turning-point memory begins anew with each."""
    columns = [
        (motion.x, motion.v, *rule.hold(motion.x, motion.v, motion.R), motion.R, motion.further)
        for motion in motions(recordings, inputs, lags, level)
    ]
    x, v, x0, R0, R, further = (np.concatenate(parts, axis=-1) for parts in zip(*columns, strict=True))
    return Samples(x, v, x0, R0, R, further, len(inputs))


def motions(
    recordings: Sequence[Recording],
    inputs: Sequence[FurtherInput],
    lags: Sequence[Lag] = (),
    level: Level | None = None,
) -> list[Trajectory]:
    """x, v, R, further inputs and lags of each recording, for training in simulation; R scaled by the level, if any."""
    found = []
    for recording in recordings:
        x, v, R = (recording.channel(name) for name in ("x", "v", "R"))
        further = table_of(recording, inputs, lags)
        if level is not None:
            R = (R - level.centre(x, further)) / level.spread(further)
        found.append(Trajectory(x, v, R, further))
    return found


def limits_of(recordings: Sequence[Recording], inputs: Sequence[FurtherInput]) -> dict[str, tuple[float, float]]:
    """Least and greatest x, v, R and further inputs, these in their units."""
    columns = {name: name for name in ("x", "v", "R")} | {port.name: port.column for port in inputs}
    return {
        name: (
            min(float(r.channel(column).min()) for r in recordings),
            max(float(r.channel(column).max()) for r in recordings),
        )
        for name, column in columns.items()
    }


def level_of(recordings: Sequence[Recording], inputs: Sequence[FurtherInput], lags: Sequence[Lag]) -> Level:
    """Level of the recordings' force."""
    parts = motions(recordings, inputs, lags)
    x, R = (np.concatenate([getattr(part, name) for part in parts]) for name in ("x", "R"))
    return Level.of(x, np.concatenate([part.further for part in parts], axis=1), R)


def check_counts(trainings: int, samples: int, seed: int, workers: int | None, name: str) -> None:
    """Raise UsageError for numbers that are none. name: of the number of trainings, as users know it."""
    check_whole(name, trainings, 1, TRAININGS)
    check_whole("samples", samples, 1)
    check_whole("seed", seed, 0)
    if workers is not None:
        check_whole("workers", workers, 1)


def beginnings(recordings: Sequence[Recording], samples: int) -> list[Recording]:
    """The beginning of each recording, all in proportion, with about so many samples together."""
    share = samples / sum(len(recording) for recording in recordings)
    return [beginning(recording, max(2, round(share * len(recording)))) for recording in recordings]


def beginning(recording: Recording, samples: int) -> Recording:
    """The first samples of a recording, the whole where it is no longer."""
    return recording if len(recording) <= samples else cut(recording, 0, samples)


def linear_fit(data: Samples, mass: float) -> LinearFit:
    """Least squares of R on v, x, a constant and the further inputs. Raises NumericalError where they are
    dependent."""
    table = np.stack([data.v, data.x, np.ones_like(data.x), *data.further], axis=1)
    scale = np.abs(table).max(axis=0)
    solution, _, rank, _ = np.linalg.lstsq(table / scale, data.R, rcond=None)
    if rank < table.shape[1] or not np.isfinite(solution).all():
        raise NumericalError("the linear fit has no unique answer: x, v, a constant and the inputs are dependent")
    B, Kl, offset, *slopes = (float(value) for value in solution / scale)
    return LinearFit(mass, B, Kl, offset, tuple(slopes))


_EDGE = 0.7  # of the greatest displacement or velocity: far enough out that a friction level has been reached


def tail_of(found: Samples) -> Tail:
    """Spring and damper that carry the force on beyond the range: its slopes at the edge of the range, none below 0.

    Not those of the linear fit: where friction makes the force, its damper is the level over the velocity, and twice
    the velocity would give twice the friction. A constant, the sign of x and the sign of v take the levels out.
    """
    slopes = []
    for along in (found.x, found.v):
        edge = np.abs(along) >= _EDGE * np.abs(along).max()
        columns = [found.x, found.v, np.sign(found.x), np.sign(found.v), np.ones_like(found.x)]
        table = np.stack(columns, axis=1)[edge]
        scale = np.abs(table).max(axis=0)
        scale[scale == 0] = 1.0
        solution = np.linalg.lstsq(table / scale, found.R[edge], rcond=None)[0] / scale
        slopes.append(float(solution[0 if along is found.x else 1]))
    return Tail(max(slopes[0], 0.0), max(slopes[1], 0.0))


def linear_model(fit: LinearFit, sample_rate: float, inputs: Sequence[FurtherInput] = ()) -> TwoNetworkModel:
    """The linear fit in the form of a two-network model without hidden layers, so that both run through one code."""
    width = 3 + len(inputs)
    plain = {"input_offset": np.zeros(width), "input_gain": np.ones(width), "output_offset": 0.0, "output_gain": 1.0}
    nothing = Network(((np.zeros((1, width)), np.zeros(1)),), **plain)  # type: ignore[arg-type]  # all normalisations
    slopes = np.array([[fit.Kl, fit.B, 0.0, *fit.slopes]])
    law = Network(((slopes, np.array([fit.offset])),), **plain)  # type: ignore[arg-type]  # the same
    return TwoNetworkModel((Member(nothing, law),), fit.mass, sample_rate, {}, inputs=tuple(inputs))
