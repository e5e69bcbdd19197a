"""Further inputs that stand at a few levels, as a tension set per test: what the force does between them.

Two levels leave a straight line. From three on the level of the force itself says how it goes on: friction that has
nearly saturated at the second of three tensions is to stay nearly saturated up to the third. The input is then seen
through a ``Polyline``, on which the level of the force is a straight line.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from hystid.identification.data import beginning
from hystid.identification.prediction import respond
from hystid.networks import FurtherInput, Polyline, TwoNetworkModel
from hystid.networks.level import Level
from hystid.recording import Array, Recording

_GAP = 0.05  # of the range of an input without a value in it: the two sides are different levels
_MOST_LEVELS = 8  # levels: more are a continuous input, of which the networks see enough
_PROBE = 4_000  # samples of a recording: tens of cycles, enough to compare members with each other
_FLAT_SLOPE = 0.1  # of the mean slope: less, and the networks could not tell the two levels apart


def with_curves(recordings: Sequence[Recording], inputs: Sequence[FurtherInput]) -> tuple[FurtherInput, ...]:
    """The inputs, with a curve where three or more levels of one say how the force goes on between them."""
    table = [np.concatenate([recording.channel(port.column) for recording in recordings]) for port in inputs]
    x, R = (np.concatenate([recording.channel(name) for recording in recordings]) for name in ("x", "R"))
    return tuple(
        replace(port, curve=_curve(k, table, x, R)) if len(table[k]) else port for k, port in enumerate(inputs)
    )


def levels_of(values: Array) -> tuple[Array, NDArray[np.intp]] | None:
    """Mean of each level, ascending, and the number of the level that each value (n,) belongs to; None for a continuous
    input. Levels lie a twentieth of the range or more apart."""
    order = np.sort(values)
    limits = np.flatnonzero(np.diff(order) > _GAP * (order[-1] - order[0]))
    if not 1 <= len(limits) < _MOST_LEVELS:
        return None
    number = np.searchsorted((order[limits] + order[limits + 1]) / 2, values)
    return np.bincount(number, values) / np.bincount(number), number


def apart_between_levels(model: TwoNetworkModel, recordings: Sequence[Recording]) -> Array | None:
    """How far each member's force is from the median of all between the levels of the inputs: mean square [N2], shape
    (members,); None where no input has levels.

    Asked are the motions of the recordings on both sides of a gap, with the input in the middle of it. No recording
    covers that range, so only disagreement between the members shows an error there.
    """
    found: list[Array] = []
    for port in model.inputs:
        levels = levels_of(np.concatenate([recording.channel(port.column) for recording in recordings]))
        if levels is None:
            continue
        for low, high in pairwise(levels[0]):
            for recording in recordings:
                mean = float(np.mean(recording.channel(port.column)))
                if min(abs(mean - low), abs(mean - high)) < _GAP * (levels[0][-1] - levels[0][0]):
                    _, each = respond(model, _moved(recording, port.column, (low + high) / 2))
                    found.append(np.mean((each - np.median(each, axis=1)[:, None]) ** 2, axis=0))
    return np.mean(found, axis=0) if found else None


def _moved(recording: Recording, column: str, value: float) -> Recording:
    """The beginning of a recording with an input at another value throughout."""
    part = beginning(recording, _PROBE)
    return replace(part, extra={**part.extra, column: np.full(len(part), value)})


def _curve(which: int, table: Sequence[Array], x: Array, R: Array) -> Polyline | None:
    """The curve of one input: centre or width of the force at its levels, whichever changes more.

    Both are those of ``Level``, with each level of the input for itself.
    """
    found = levels_of(table[which])
    if found is None or len(found[0]) < 3:
        return None
    at, number = found
    hats = np.eye(len(at))[number]
    others = [column for k, column in enumerate(table) if k != which and np.ptp(column)]
    level = Level.of(x, np.stack([*hats.T, *others]), R)
    centre, width = (np.array(values[: len(at)]) for values in (level.slopes[1:], level.growth))
    to = centre if np.ptp(centre) > np.ptp(width) else width
    to = to if to[-1] > to[0] else -to
    if to[-1] == to[0]:
        return None
    to = at[0] + (to - to[0]) * (at[-1] - at[0]) / (to[-1] - to[0])
    if np.min(np.diff(to) / np.diff(at)) < _FLAT_SLOPE:
        return None
    ends = float(table[which].min()), float(table[which].max())
    return Polyline(
        (ends[0], *(float(value) for value in at[1:-1]), ends[1]),
        (ends[0], *(float(value) for value in to[1:-1]), ends[1]),
    )
