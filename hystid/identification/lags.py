"""Whether the force follows the velocity or a further input late, and by how much: lags chosen on left-out stretches.

A turning-point memory knows where a branch began but nothing of time. A coil whose current follows its voltage, an
anti-alias filter on the force, a column of fluid or a relaxing polymer make the force late; one first-order lag each
(``Lag``) is what such a chain needs at least. Candidates are judged by one network on (x, v, x0, R0, inputs, lags),
with the measured force at the turning points, on stretches of the recordings that it has not seen.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from hystid.identification.leftout import LeftOut
from hystid.networks import FurtherInput, Lag
from hystid.recording import Recording

# Candidates, in units of the time in which the motion turns by one radian. Slower than the motion itself, a lag of the
# velocity is the displacement over again, and tells a periodic test where in its cycle it is rather than any physics.
# One of the velocity acts within the turn of a branch and is missed where its time is off by more than a factor of 1.5.
_TIMES = {"v": (0.15, 0.25, 0.5, 1.0, 1.5), "inputs": (0.15, 0.5, 1.5, 5.0, 15.0)}
# A lag is one more input of both networks and one more state, about a fifth more time in training and use: the price of
# a fifth of what is left (a tenth of the NRMSE), and not worth it where less than a twentieth of the force is left.
_GAIN = 1 / 5
_SMALL_RESIDUAL = 0.05
_MOST_LAGS = 4
_NEW = 0.5  # of what a lag adds: below, most of it is a mixture of x and v


def choose_lags(leftout: LeftOut) -> tuple[Lag, ...]:
    """Lags of v and the further inputs that the recordings ask for, most useful first; mostly none."""
    total = float(np.var(leftout.R[leftout.scattered]))
    chosen: list[Lag] = []
    left = leftout.power(chosen, leftout.scattered) / total
    candidates = _candidates(leftout) if left > _SMALL_RESIDUAL**2 else []
    while len(chosen) < _MOST_LAGS and left > _SMALL_RESIDUAL**2 and candidates:
        scores = [leftout.power([*chosen, lag], leftout.scattered) / total for lag in candidates]
        best = int(np.argmin(scores))
        if scores[best] > (1 - _GAIN) * left:
            break
        chosen.append(candidates.pop(best))
        left = scores[best]
    return tuple(chosen)


def _candidates(leftout: LeftOut) -> list[Lag]:
    recordings = leftout.recordings
    speed = np.concatenate([recording.channel("v") for recording in recordings])
    slope = np.concatenate([np.diff(recording.channel("v")) / recording.dt for recording in recordings])
    radian = float(np.std(speed) / np.std(slope))
    shortest, longest = recordings[0].dt / 2, min(r.dt * len(r) for r in recordings) / 10
    found = [
        Lag(source, share * radian)
        for source in _sources(recordings, leftout.inputs)
        for share in _TIMES["v" if source == "v" else "inputs"]
        if shortest <= share * radian <= longest
    ]
    return [lag for lag in found if lag.source != "v" or _told_from_motion(leftout, lag)]


def _sources(recordings: Sequence[Recording], inputs: Sequence[FurtherInput]) -> list[str]:
    moving = [port for port in inputs if any(np.ptp(r.channel(port.column)) > 0 for r in recordings)]
    return ["v", *(port.name for port in moving)]


def _told_from_motion(leftout: LeftOut, lag: Lag) -> bool:
    """Whether some recording by itself tells the lag from a mixture of x and v: more than half of what it adds is new.

    In a motion of one tone all of it is a mixture: such a lag would be fitted to anything, and be wrong at another
    frequency. So it would with several recordings of one tone each, where it merely says which of them it is.
    """
    return any(_new_share(recording, lag) > _NEW for recording in leftout.recordings)


def _new_share(recording: Recording, lag: Lag) -> float:
    """Share of the power that a lag of the velocity adds to it which no mixture of x, v and a constant explains."""
    x, v = recording.channel("x"), recording.channel("v")
    added = v - lag.follow(v, recording.dt)
    motion = np.stack([x, v, np.ones_like(v)], axis=1)
    scaled = motion / np.abs(motion).max(axis=0)
    new = added - scaled @ np.linalg.lstsq(scaled, added, rcond=None)[0]
    return float(np.var(new) / np.var(added)) if np.ptp(added) else 0.0
