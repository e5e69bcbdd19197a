"""Channels that stand at one value while another one shows that they move: a loose plug, a broken connection."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from scipy.signal import detrend

from hystid.numeric import Array
from hystid.recording.problems import RecordingProblem
from hystid.recording.table import RawTable

_LEAST_RUN = 16  # samples in a row at one value
_RARE_RUN = 10.0  # times as long as nearly all runs of the channel: a slow converter repeats its values everywhere
_USUAL_SHARE = 0.95  # share of the samples that stand in runs that are usual
_STEPS = 4.0  # smallest steps of a channel beyond which it would have changed
_CLEAR_MOTION = 10.0  # standard deviations of noise beyond which another channel moves
_MOTION = ("x", "v", "a")
_AFTER, _BEFORE = ("v", "a", ""), ("", "x", "v")  # derivative and integral of each


def held_problems(table: RawTable, channels: Mapping[str, Array]) -> list[RecordingProblem]:
    """A problem for each channel of motion that stands still against another one. channels: SI units, t among them."""
    dt = float(np.median(np.diff(channels["t"])))
    problems = []
    for name in _MOTION:
        if name in channels and (found := _longest(channels[name])) and _moves(name, *found, channels, dt):
            first, end = found
            text = f"it stands at {channels[name][first]:.6g} for {end - first} samples while others move"
            action = "check the plug and the cable, and leave out the channel or these samples"
            problems.append(table.problem("held", text, action, name, first))
    return problems


def _longest(values: Array) -> tuple[int, int] | None:
    """First sample and end of a run of equal values that is much longer than is usual; None where there is none, or it
    is the end of the channel's range, at which one is cut off."""
    edges = np.flatnonzero(np.diff(values, prepend=np.nan, append=np.nan) != 0)
    lengths = np.diff(edges)
    at = int(np.argmax(lengths))
    each = np.sort(np.delete(np.repeat(lengths, lengths), slice(edges[at], edges[at + 1])))
    if not len(each) or lengths[at] < max(_LEAST_RUN, _RARE_RUN * each[int(_USUAL_SHARE * (len(each) - 1))]):
        return None
    if values[edges[at]] in (np.max(values), np.min(values)):
        return None
    return int(edges[at]), int(edges[at + 1])


def _moves(name: str, first: int, end: int, channels: Mapping[str, Array], dt: float) -> bool:
    """Whether the next derivative, or else the integral, of a channel says that it changes by more than its steps."""
    steps = np.abs(np.diff(channels[name]))
    step = float(np.min(steps[steps > 0], initial=np.inf))
    place, count = _MOTION.index(name), end - first
    if (rate := channels.get(_AFTER[place])) is not None:
        path = np.cumsum(rate[first:end] - np.mean(rate[first:end])) * dt
        return bool(np.ptp(path) > max(_STEPS * step, _CLEAR_MOTION * _noise(rate) * dt * np.sqrt(count)))
    if (way := channels.get(_BEFORE[place])) is not None:
        bend = detrend(way[first:end])
        return bool(np.ptp(bend) > max(_STEPS * step * count * dt, _CLEAR_MOTION * _noise(way)))
    return False


def _noise(values: Array) -> float:
    """Standard deviation of white noise, from differences of differences, at which motion is small."""
    return float(np.median(np.abs(np.diff(values, 2))) / (0.6745 * np.sqrt(6)))
