"""Constant and even forces: how much of them there is, for they are easily a fault of a channel."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from hystid.networks import FurtherInput
from hystid.networks.training import draw
from hystid.recording import Array, Recording

_BLOCKS = 10  # left out in turn: how far the answers move then is their standard error (jackknife)
_SURE_ERRORS = 3.0  # standard errors
_OFFSET_WORTH = 0.01  # of the force's standard deviation: less does not show in an NRMSE of a few percent
_SAMPLES = 20_000  # hundreds per knot
_KNOTS = (4, 8, 16, 32)  # of a curve over x; twice as many say how much the answer hangs on them
_EDGE = 0.01  # of the samples, at either end of x, between which 0 must lie
_NO_MEAN = 1e-3  # of the standard deviation: a mean below it has been taken out, not measured


def constant_and_even(recordings: Sequence[Recording], inputs: Sequence[FurtherInput] = ()) -> tuple[str, ...]:
    """Sentences on a constant force, on one that is even in x, and on channels without a mean.

    The constant force is that of a curve over x at x = 0, beside v and sign(v): a mean alone is no constant force, for
    a contact on one side has one. A constant force and friction levels that differ with the direction are the same
    columns, so that the sentence names both. A force that a further input sets, as a pressure does, is none of these:
    ``inputs`` stand beside the curve with their level and with what they add to friction and damping, and the constant
    force is the one without them.
    """
    some = draw(sum(len(recording) for recording in recordings), _SAMPLES, 0)
    x, v, R = (np.concatenate([r.channel(name) for r in recordings])[some] for name in ("x", "v", "R"))
    size, span = float(np.std(R)), float(np.std(x))
    square = ((x - np.mean(x)) / span) ** 2
    sides = np.stack([v / np.std(v), np.sign(v)], axis=1)
    for port in inputs:
        level = np.concatenate([r.channel(port.column) for r in recordings])[some]
        level = level / np.abs(level).max()
        sides = np.column_stack([level, level[:, None] * sides[:, -2:], sides])
    without = f" at {' and '.join(port.column for port in inputs)} of 0" if inputs else ""
    notes = []
    offset, error, friction = _at_zero(x, sides, R)
    if abs(offset) > max(_SURE_ERRORS * error, _OFFSET_WORTH * size):
        same = ", more than friction that differs with the direction can make"
        if friction > abs(offset):
            levels = f"{friction + offset:.3g} N forward and {friction - offset:.3g} N backward"
            same = f", which is the same as friction levels of {levels}"
        notes.append(
            f"the model holds a constant force of {offset:.3g} N{without} (standard error {error:.2g} N){same}; "
            "check the zeros of force and displacement"
        )
        notes += _coupled(recordings)
    found, errors, _ = _jackknife(np.column_stack([x / span, sides, np.ones_like(x), square - square.mean()]), R)
    even = float(found[-1])
    if abs(even) * float(np.std(square)) > max(_SURE_ERRORS * errors[-1] * float(np.std(square)), _OFFSET_WORTH * size):
        notes.append(
            f"the force has a part that is even in the displacement, {even:.3g} N at one standard deviation of x: the "
            "two directions differ, as with a contact, a preload or a sensor that saturates"
        )
    return tuple(notes)


def _at_zero(x: Array, sides: Array, R: Array) -> tuple[float, float, float]:
    """Force at x = 0 beside v and sign(v) [N], its standard error, and the friction.

    Where x does not pass 0, the force in the middle: all that the curve over x changes may then be a spring's.
    """
    low, middle, high = np.quantile(x, (_EDGE, 0.5, 1.0 - _EDGE))
    inside = bool(low < 0.0 < high)
    fine = [_curve(x if inside else x - middle, sides, R, count) for count in (*_KNOTS, 2 * _KNOTS[-1])]
    best = int(np.argmin([left for *_, left in fine[:-1]]))
    offset, error, friction, range_, _ = fine[best]
    return offset, float(np.hypot(error, offset - fine[best + 1][0] if inside else range_)), friction


def _curve(x: Array, sides: Array, R: Array, count: int) -> tuple[float, float, float, float, float]:
    """Value at x = 0 of broken lines over x with a number of knots, its error by chance, the friction beside them, the
    range of the lines, and what they leave on the blocks that are left out."""
    knots = np.quantile(x, np.linspace(0.0, 1.0, count))
    apart = np.abs(knots) > 0.25 * float(np.std(x)) / count
    knots = np.unique(np.append(knots[apart], 0.0))
    hats = np.stack([np.interp(x, knots, row) for row in np.eye(len(knots))], axis=1)
    found, error, left = _jackknife(np.column_stack([hats, sides]), R)
    at = int(np.flatnonzero(knots == 0.0)[0])
    return float(found[at]), float(error[at]), float(found[-1]), float(np.ptp(found[: len(knots)])), left


def _coupled(recordings: Sequence[Recording]) -> list[str]:
    """A sentence on forces whose mean is gone while the displacement has one."""
    found = []
    for recording in recordings:
        F = recording.F if recording.F is not None else recording.channel("R")
        x = recording.channel("x")
        if abs(np.mean(F)) < _NO_MEAN * np.std(F) and abs(np.mean(x)) > 0.1 * np.std(x):
            found.append(recording.name)
    if not found:
        return []
    return [
        f"{', '.join(found)}: the force has no mean, the displacement has: where the force channel is AC-coupled, "
        "constant forces (weight, preload, gas) are missing from the model"
    ]


def _jackknife(table: Array, target: Array) -> tuple[Array, Array, float]:
    """Least squares, standard errors from fits without each of the blocks, and the squares that those leave there."""
    whole = np.linalg.lstsq(table, target, rcond=None)[0]
    block = np.arange(len(target)) * _BLOCKS // len(target)
    parts = np.array([np.linalg.lstsq(table[block != k], target[block != k], rcond=None)[0] for k in range(_BLOCKS)])
    error = np.sqrt((_BLOCKS - 1) * np.mean((parts - np.mean(parts, axis=0)) ** 2, axis=0))
    left = float(np.sum((target - np.sum(table * parts[block], axis=1)) ** 2))
    return np.asarray(whole, np.float64), np.asarray(error, np.float64), left
