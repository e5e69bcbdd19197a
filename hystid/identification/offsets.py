"""Constant and even forces: how much of them there is, for they are easily a fault of a channel."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from hystid.recording import Array, Recording

_BLOCKS = 10  # left out in turn: how far the answers move then is their standard error (jackknife)
_SURE = 3.0  # standard errors
_WORTH = 0.01  # of the force's standard deviation: less does not show in an NRMSE of a few percent
_NOTHING = 1e-3  # of the standard deviation: a mean below it has been taken out, not measured


def constant_and_even(recordings: Sequence[Recording]) -> tuple[str, ...]:
    """Sentences on a constant force, on one that is even in x, and on channels without a mean.

    R is fitted by x, v, sign(v), x^2 and a constant. A constant force and friction levels that differ with the
    direction are the same columns, so that the sentence names both.
    """
    x, v, R = (np.concatenate([r.channel(name) for r in recordings]) for name in ("x", "v", "R"))
    size = float(np.std(R))
    centre, span = float(np.mean(x)), float(np.std(x))
    square = ((x - centre) / span) ** 2
    table = np.stack([x / span, v / np.std(v), np.sign(v), square - square.mean(), np.ones_like(x)], axis=1)
    found, error = _jackknife(table, R)
    friction, even, offset = (float(value) for value in found[2:])
    notes = []
    if abs(offset) > max(_SURE * error[4], _WORTH * size):
        notes.append(
            f"the model holds a constant force of {offset:.3g} N (standard error {error[4]:.2g} N), which is the same "
            f"as friction levels of {friction + offset:.3g} N forward and {friction - offset:.3g} N backward; check "
            "the zero of the force channel"
        )
    if abs(even) * float(np.std(square)) > max(_SURE * error[3] * float(np.std(square)), _WORTH * size):
        notes.append(
            f"the force has a part that is even in the displacement, {even:.3g} N at one standard deviation of x: the "
            "two directions differ, as with a contact, a preload or a sensor that saturates"
        )
    return (*notes, *_coupled(recordings))


def _coupled(recordings: Sequence[Recording]) -> list[str]:
    """Sentences on forces whose mean is gone while the displacement has one."""
    found = []
    for recording in recordings:
        F = recording.F if recording.F is not None else recording.channel("R")
        x = recording.channel("x")
        if abs(np.mean(F)) < _NOTHING * np.std(F) and abs(np.mean(x)) > 0.1 * np.std(x):
            found.append(
                f"{recording.name}: the force has no mean, the displacement has: where the force channel is "
                "AC-coupled, constant forces (weight, preload, gas) are missing from the model"
            )
    return found


def _jackknife(table: Array, target: Array) -> tuple[Array, Array]:
    """Least squares and standard errors, from fits without each of the blocks."""
    whole = np.linalg.lstsq(table, target, rcond=None)[0]
    block = np.arange(len(target)) * _BLOCKS // len(target)
    parts = [np.linalg.lstsq(table[block != k], target[block != k], rcond=None)[0] for k in range(_BLOCKS)]
    error = np.sqrt((_BLOCKS - 1) * np.mean((np.array(parts) - np.mean(parts, axis=0)) ** 2, axis=0))
    return np.asarray(whole, np.float64), np.asarray(error, np.float64)
