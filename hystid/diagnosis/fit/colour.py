"""Noise that grows towards low frequencies: 1/f noise of amplifiers, zeros that wander.

The noise level of a channel is read where nothing moves, high above the motion. Noise of amplifiers is louder at low
frequencies than it is there, as 1/f, and a wandering zero as 1/f^2. Taken for white, it would be a mismatch in the band
of the motion. It is measured below that band, in what the refit leaves, after all that follows the state of the
motion is taken out, and then the force balance is whitened by it (generalised least squares).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import lsq_linear

from hystid.diagnosis.fit.curves import cells, curves
from hystid.diagnosis.fit.hypothesis import Fit
from hystid.diagnosis.fit.problem import Problem
from hystid.diagnosis.prepare.reduction import colouring, filtered
from hystid.diagnosis.prepare.segments import Part, band

Array = NDArray[np.float64]
_ROWS = 16_000  # of one recording; more are averaged in blocks
_POLYNOMIAL = 3  # coefficients: offset, ramp and bow, which are effects of their own
_FIRST = 3  # line of the spectrum from which the polynomial and the window leave it alone
_BELOW = 0.5  # share of the lowest frequency of the motion below which the window leaks nothing of it
_ABOVE = 2.0  # times the highest frequency of the motion, from which the spectrum holds little but noise
_FEWEST, _MANY = 10, 200  # lines from which a colour can be told, and bounded
_ROUNDS = 20  # of reweighting
_NOTHING = 1e-9  # share of the noise that is none: bounds of a search must lie apart


def with_colour(problem: Problem, fitted: Fit) -> list[Part] | None:
    """The parts of a problem with the colour of their noise; None where it is white as far as can be seen.

    One colour for all channels and recordings, relative to their white noise: they come from the same amplifiers.
    """
    rests = problem.reduce.whitened(problem.balance(fitted.hypothesis))
    moved = [problem.reduce.whitened(draw) for draw in problem.moved(fitted.hypothesis)]
    found = [_below(part, rests[i], [draw[i] for draw in moved]) for i, part in enumerate(problem.parts)]
    frequency, power, dt = (np.concatenate(columns) for columns in zip(*found, strict=True))
    if len(power) < _FEWEST:
        return None
    lowest = min(band(part)[0] * part.dt for part in problem.parts)
    pink, red = _fitted(frequency, power, dt, _most(problem.parts, rests), lowest)
    return [_coloured(part, (pink, red * part.dt)) for part in problem.parts] if pink or red else None


def _coloured(part: Part, colour: tuple[float, float]) -> Part:
    """A part with the colour of its noise, and so the draws of what noise does to its motion."""
    response = 1 / colouring(len(part), colour)
    jitter = tuple(tuple(filtered(u.astype(float), response).astype(np.float32) for u in draw) for draw in part.jitter)
    return replace(part, colour=colour, jitter=jitter)


def _below(part: Part, rest: Array, moved: Sequence[Array]) -> tuple[Array, Array, Array]:
    """Lines of the spectrum below the motion: frequency [cycles per sample], power over that of white noise, dt [s].

    moved: what white noise of the motion does to the force.
    """
    block = max(1, len(rest) // _ROWS)
    rows = len(rest) // block
    # lines that a filter has taken out, or a gap fills with anything, say nothing
    last = 0 if part.lowest or part.valid is not None else int(_BELOW * band(part)[0] * rows * block * part.dt)
    if last <= _FIRST:
        return np.empty(0), np.empty(0), np.empty(0)
    x, v, left, *noises = (u[: rows * block].reshape(rows, block).mean(axis=1) for u in (part.x, part.v, rest, *moved))
    follows = [table for u in (x, v) for table in curves([u])]
    cell = cells(x, v)
    inside = cell[:, None] == np.unique(cell)
    known = np.column_stack([inside, *follows, np.vander(np.linspace(-1, 1, rows), _POLYNOMIAL)])
    window = np.hanning(rows)

    def lines(u: Array) -> Array:
        u = u - known @ np.linalg.lstsq(known, u, rcond=None)[0]
        return np.asarray(block * np.abs(np.fft.rfft(u * window)[_FIRST:last]) ** 2 / float(window @ window))

    white = 1 + float(np.mean([lines(noise) for noise in noises]))
    return np.arange(_FIRST, last) / (rows * block), lines(left) / white, np.full(last - _FIRST, part.dt)


def _most(parts: Sequence[Part], rests: Sequence[Array]) -> float:
    """Largest coefficient of 1/f that the noise above the motion allows, two standard errors beyond the likeliest; 0
    where none is seen there.

    What moves the structure there adds to it: a bound from above, and no estimate.
    """
    found = [_above(part, rest) for part, rest in zip(parts, rests, strict=True)]
    frequency, power = (np.concatenate(columns) for columns in zip(*found, strict=True))
    if len(power) < _MANY:
        return 0.0
    shapes = np.column_stack([np.ones_like(frequency), 1 / frequency])
    expected = np.full_like(power, float(np.mean(power)))
    for _ in range(_ROUNDS):
        weighted = shapes / expected[:, None]
        level, slope = np.linalg.lstsq(weighted, power / expected, rcond=None)[0]
        expected = np.maximum(shapes @ [level, slope], 0.1 * float(np.mean(power)))
    error = float(np.sqrt(np.linalg.inv(weighted.T @ weighted)[1, 1]))
    return float((slope + 2 * error) / level) if level > 0 and slope > 2 * error else 0.0


def _above(part: Part, rest: Array) -> tuple[Array, Array]:
    """Lines of the spectrum above the motion: frequency [cycles per sample], and power over that of white noise."""
    first, last = (int(share * len(rest)) for share in (_ABOVE * band(part)[1] * part.dt, 0.49))
    if part.valid is not None or last <= first:
        return np.empty(0), np.empty(0)
    window = np.hanning(len(rest))
    power = np.abs(np.fft.rfft(rest * window)[first:last]) ** 2 / float(window @ window)
    return np.arange(first, last) / len(rest), np.asarray(power)


def _fitted(frequency: Array, power: Array, dt: Array, most: float, lowest: float) -> tuple[float, float]:
    """Coefficients of 1/f, at most so large, and dt/f^2 beside a white noise of 1, by Whittle's likelihood; 0 where
    they are not worth their place (Schwarz 1978).

    lowest: frequency of the motion [cycles per sample], from which on 1/f^2 may add no more than 1/f: what is slow in a
    force that nobody has modelled must not pass for noise of the motion's own frequencies.
    """
    shapes = np.column_stack([1 / frequency, dt / frequency**2])
    size = np.linalg.norm(shapes, axis=0)
    coefficients = np.zeros(2)
    for _ in range(_ROUNDS):
        expected = 1 + shapes @ coefficients
        scaled, over = shapes / size / expected[:, None], (power - 1) / expected
        highest = size * [most, coefficients[0] * lowest / float(np.max(dt))]
        coefficients = lsq_linear(scaled, over, (0, np.maximum(highest, _NOTHING))).x / size
    expected = 1 + shapes @ coefficients
    gain = float(np.sum(power - power / expected - np.log(expected)))
    counted = np.where(coefficients * size > _NOTHING, coefficients, 0.0)
    worth = gain > 0.5 * np.count_nonzero(counted) * np.log(len(power))
    return (float(counted[0]), float(counted[1])) if worth else (0.0, 0.0)


def coloured_alike(parts: Sequence[Part], like: Sequence[Part]) -> list[Part]:
    """Further recordings of the same sensors, with the colour of their noise."""
    pink, red = like[0].colour
    return [_coloured(part, (pink, red * part.dt / like[0].dt)) for part in parts]
