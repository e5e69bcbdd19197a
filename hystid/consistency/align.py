"""Channels of another clock, moved back by the lag that the motion itself shows."""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence

import numpy as np

from hystid.consistency.force import examine_force
from hystid.consistency.kinematics import ORDER, motion, pairs
from hystid.errors import RecordingError, UsageError
from hystid.recording import Recording


def aligned(recordings: Sequence[Recording], channels: Collection[str]) -> list[Recording]:
    """Recordings with some channels moved in time so that they fit the others; ends without partner are cut.

    channels: "F", or one of x, v, a where another channel of the motion is there. Cubic interpolation between samples.
    Raises UsageError for another name, RecordingError where a recording does not show the lag.
    """
    for channel in channels:
        if channel not in ("F", *ORDER):
            raise UsageError(f"--align {channel}: the channels are F, x, v, a")
    return [_aligned(recording, sorted(channels)) for recording in recordings]


def _aligned(recording: Recording, channels: Sequence[str]) -> Recording:
    for channel in channels:
        if getattr(recording, channel) is None:
            raise RecordingError(f"{recording.name}: there is no channel {channel} to align")
        recording = _moved(recording, channel, _lag(recording, channel))
    return recording


def _lag(recording: Recording, channel: str) -> float:
    """How much later a channel is than the others [s]."""
    if channel == "F":
        force = examine_force(recording)
        if force is not None and math.isfinite(force.lag_error):
            return force.lag
    else:
        mine = [p for p in pairs(recording) if channel in (p.low, p.high) and math.isfinite(p.lag_error)]
        if mine:
            best = min(mine, key=lambda p: p.lag_error)
            return best.lag if best.high == channel else -best.lag
    others = ", ".join(name for name in ("F", *motion(recording)) if name != channel)
    raise RecordingError(
        f"{recording.name}: the lag of {channel} against {others} does not show; leave --align {channel} out"
    )


def _moved(recording: Recording, channel: str, lag: float) -> Recording:
    from scipy.interpolate import CubicSpline

    t = recording.t
    inside = (t + lag >= t[0]) & (t + lag <= t[-1])
    kept = slice(int(np.argmax(inside)), len(t) - int(np.argmax(inside[::-1])))
    moved = CubicSpline(t, recording.channel(channel))(t[kept] + lag)
    lost = len(t) - len(moved)
    note = f"{channel} moved by {-1e3 * lag:.4g} ms as asked, which fits the other channels; {lost} samples cut"
    return recording.part(kept, note).with_channels({channel: moved})
