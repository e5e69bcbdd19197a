"""Noise that grows towards low frequencies: 1/f noise of amplifiers, zeros that wander.

The noise level of a channel is read where nothing moves, high above the motion. Noise of amplifiers is louder at low
frequencies than it is there, as 1/f, and a wandering zero as 1/f^2. Taken for white, it would be a mismatch in the band
of the motion. It is measured below that band, in what the refit leaves, after all that follows the state of the
motion is taken out, and then the force balance is whitened by it (generalised least squares).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import label
from scipy.optimize import lsq_linear

from hystid.diagnosis.fit.curves import cells, curves
from hystid.diagnosis.fit.hypothesis import Fit
from hystid.diagnosis.fit.problem import Problem
from hystid.diagnosis.prepare.draws import Draw
from hystid.diagnosis.prepare.filtering import filtered
from hystid.diagnosis.prepare.reduction import ROWS
from hystid.diagnosis.prepare.segments import Part, band
from hystid.diagnosis.prepare.whitening import colouring
from hystid.numeric import Array

_POLYNOMIAL = 3  # coefficients: offset, ramp and bow, which are effects of their own
_FIRST_LINE = 3  # line of the spectrum from which the polynomial and the window leave it alone
_BELOW = 0.5  # share of the lowest frequency of the motion below which the window leaks nothing of it
_ABOVE = 2.0  # times the highest frequency of the motion, from which the spectrum holds little but noise
_FEWEST_LINES, _MANY_LINES = 10, 200  # lines from which a colour can be told, and bounded
_ROUNDS = 20  # of reweighting


def with_colour(problem: Problem, fitted: Fit, *, led: bool = False) -> tuple[list[Part] | None, bool]:
    """The parts of a problem with the colour of their noise, None where it is white as far as can be seen; and whether
    it was looked for below the motion.

    One colour for all channels and recordings, relative to their white noise: they come from the same amplifiers. As
    far as 1/f noise shows above the motion it is believed below it; where it may be there and does not show, it is
    believed as it is below, or not at all: what is louder than that is no noise. A motion that leaves nothing below it
    leaves what is above: there the structure may be moved, too, and the caller has to see that what is left then
    follows no motion, and is no quieter than noise.

    led: whether slow motion that no channel shows is that of the fit. Before, recordings without x show no colour.
    """
    seen, since = _seen(problem, fitted), _lasted(problem.parts)
    frequency, power, dt = (np.concatenate(columns) for columns in zip(*map(_below, seen), strict=True))
    slope, error = _above_all([one for one in seen if led or not one.part.lowest])
    is_seen, most, is_below = slope > 2 * error, slope + 2 * error, len(power) >= _FEWEST_LINES
    if is_below:
        lowest = min(band(part)[0] * part.dt for part in problem.parts)
        pink, red = _fitted(frequency, power, dt, most if is_seen else np.inf, lowest)
    else:
        pink, red = slope if is_seen else 0.0, 0.0
    if pink > most or not (pink or red):
        return None, is_below
    return [_coloured(part, (pink, red * part.dt), since) for part in problem.parts], is_below


def fainter(parts: Sequence[Part], seen: Sequence[Part], share: float) -> list[Part]:
    """Parts with a share of the colour that was seen."""
    colours = [(share * q.colour[0], share * q.colour[1]) for q in seen]
    return [_coloured(p, c, q.since) for p, c, q in zip(parts, colours, seen, strict=True)]


def slow_power(parts: Sequence[Part]) -> float:
    """Power of the noise over that of its white part, in the slowest line that tells its colour; the loudest part."""
    found = []
    for part in parts:
        slowest, (pink, red) = _FIRST_LINE / len(part), part.colour
        found.append(1.0 + pink / slowest + red / slowest**2)
    return max(found)


@dataclass(frozen=True)
class _Residual:
    """What a fit leaves of the longest stretch of a recording that has no gaps, in units of the white noise.

    residual: (n,); x, v: motion there; moved: what draws of the noise of the motion do to the force; inertial: what
    they do to that of inertia.
    followed: see ``Reduction.followed_at``.
    """

    part: Part
    residual: Array
    x: Array
    v: Array
    moved: tuple[Array, ...]
    inertial: tuple[Array, ...]
    followed: Callable[[Array], Array]


def _seen(problem: Problem, fitted: Fit) -> list[_Residual]:
    """The residuals of all parts; where a law is not sure of a sample, as where it jumps, little of it counts."""
    residuals = problem.reduce.whitened(problem.balance(fitted.hypothesis))
    moved = [problem.reduce.whitened(draw) for draw in problem.moved(fitted.hypothesis)]
    mass = problem.baseline.mass
    shaken = [[mass * part.jitter[draw][3].astype(float) for part in problem.parts] for draw in range(len(moved))]
    inertial = [problem.reduce.whitened(draw) for draw in shaken]
    found = []
    for i, part in enumerate(problem.parts):
        sure = problem.reduce.trusted(i)
        runs, count = label(sure > 0)
        longest = int(np.argmax(np.bincount(runs.ravel(), minlength=2)[1:])) + 1 if count else 0
        at = slice(*(np.flatnonzero(runs == longest)[[0, -1]] + [0, 1])) if count else slice(0, 0)
        draws, inertias = (tuple((draw[i] * sure)[at] for draw in kind) for kind in (moved, inertial))
        followed = partial(problem.reduce.followed_at, i)
        found.append(_Residual(part, (residuals[i] * sure)[at], part.x[at], part.v[at], draws, inertias, followed))
    return found


def _coloured(part: Part, colour: tuple[float, float], since: float) -> Part:
    """A part with the colour of its noise, and so the draws of what noise does to its motion."""
    made = replace(part, colour=colour, since=since)
    response = colouring(part) / colouring(made)

    def coloured(draw: Draw) -> Draw:
        return tuple(filtered(u.astype(float), response).astype(np.float32) for u in draw)

    return replace(made, jitter=part.jitter.changed(coloured))


def _lasted(parts: Sequence[Part]) -> float:
    """Time that all recordings took together [s]: the zeros of their sensors are no younger."""
    return sum(len(part) * part.dt for part in parts)


def _below(seen: _Residual) -> tuple[Array, Array, Array]:
    """Lines of the spectrum below the motion: frequency [cycles per sample], power over that of white noise, dt [s]."""
    part, residual = seen.part, seen.residual
    block = max(1, len(residual) // ROWS)
    rows = len(residual) // block
    # lines that a filter has taken out say nothing
    last = 0 if part.lowest else int(_BELOW * band(part)[0] * rows * block * part.dt)
    if last <= _FIRST_LINE:
        return np.empty(0), np.empty(0), np.empty(0)
    columns = (seen.x, seen.v, residual, *seen.moved)
    x, v, left, *noises = (u[: rows * block].reshape(rows, block).mean(axis=1) for u in columns)
    follows = [table for u in (x, v) for table in curves([u])]
    cell = cells(x, v)
    inside = cell[:, None] == np.unique(cell)
    known = np.column_stack([inside, *follows, np.vander(np.linspace(-1, 1, rows), _POLYNOMIAL)])
    window = np.hanning(rows)

    def lines(u: Array) -> Array:
        u = u - known @ np.linalg.lstsq(known, u, rcond=None)[0]
        return np.asarray(block * np.abs(np.fft.rfft(u * window)[_FIRST_LINE:last]) ** 2 / float(window @ window))

    frequency = np.arange(_FIRST_LINE, last) / (rows * block)
    white = 1 + float(np.mean(np.mean([lines(noise) for noise in noises], axis=0) - seen.followed(frequency)))
    return frequency, lines(left) / white, np.full(last - _FIRST_LINE, part.dt)


def _above_all(seen: Sequence[_Residual]) -> tuple[float, float]:
    """Coefficient of 1/f in the noise above the motion, and its standard error; 0 where none is seen there.

    What moves the structure there adds to it. Noise levels differ from recording to recording.
    """
    found = [(frequency, power / np.mean(power), white) for frequency, power, white in map(_above, seen) if len(power)]
    if sum(len(power) for _, power, _ in found) < _MANY_LINES:
        return 0.0, 0.0
    frequency, power, white = (np.concatenate(columns) for columns in zip(*found, strict=True))
    shapes = np.column_stack([white, 1 / frequency])
    expected = np.ones_like(power)
    for _ in range(_ROUNDS):
        weighted = shapes / expected[:, None]
        level, slope = np.linalg.lstsq(weighted, power / expected, rcond=None)[0]
        expected = np.maximum(shapes @ [level, slope], 0.1 * float(np.mean(power)))
    error = float(np.sqrt(np.linalg.inv(weighted.T @ weighted)[1, 1]))
    return (float(slope / level), error / float(level)) if level > 0 else (0.0, 0.0)


def _above(seen: _Residual) -> tuple[Array, Array, Array]:
    """Lines of the spectrum above the motion: frequency [cycles per sample], power, and that of white noise: next to
    the motion noise of the displacement takes away from that of inertia, as a spring does beyond its resonance.
    """
    count = len(seen.residual)
    ends = 0.98 * seen.part.noise_ends
    first, last = (int(share * count) for share in (_ABOVE * band(seen.part)[1] * seen.part.dt, ends))
    first = max(first, _FIRST_LINE, int(_ABOVE * seen.part.first_Hz * seen.part.dt * count))
    if last <= first:
        return np.empty(0), np.empty(0), np.empty(0)
    window = np.hanning(count)

    def lines(u: Array) -> NDArray[np.complex128]:
        return np.asarray(np.fft.rfft(u * window)[first:last] / np.linalg.norm(window))

    frequency, drawn = np.arange(first, last) / count, zip(seen.moved, seen.inertial, strict=True)
    added = np.mean([(np.conj(a) * (a + 2 * b)).real for a, b in ((lines(u), lines(w)) for u, w in drawn)], axis=0)
    shape = frequency**-2
    white = 1 + shape * (added @ shape) / (shape @ shape)
    return frequency, np.abs(lines(seen.residual)) ** 2, np.maximum(white, 0.0)


def _fitted(frequency: Array, power: Array, dt: Array, most: float, lowest: float) -> tuple[float, float]:
    """Coefficients of 1/f, at most so large, and dt/f^2 beside a white noise of 1, by Whittle's likelihood; 0 where
    they are not worth their place (Schwarz 1978).

    lowest: frequency of the motion [cycles per sample], from which on 1/f^2 may add no more than 1/f: what is slow in a
    force that nobody has modelled must not pass for noise of the motion's own frequencies.
    """
    pink, reddest = 1 / frequency, lowest / float(np.max(dt))
    shapes = np.column_stack([pink, pink + reddest * dt / frequency**2])  # with none of 1/f^2, and with all that may be
    size = np.linalg.norm(shapes, axis=0)
    shares = np.zeros(2)
    for _ in range(_ROUNDS):
        expected = 1 + shapes @ shares
        scaled, over = shapes / size / expected[:, None], (power - 1) / expected
        shares = lsq_linear(scaled, over, (0, most * size), method="bvls").x / size
    if np.sum(shares) > most:
        shares *= most / np.sum(shares)
    expected = 1 + shapes @ shares
    gain = float(np.sum(power - power / expected - np.log(expected)))
    numbers = 2 if shares[1] else 1
    worth = gain > 0.5 * numbers * np.log(len(power))
    return (float(np.sum(shares)), float(reddest * shares[1])) if worth else (0.0, 0.0)


def coloured_alike(parts: Sequence[Part], like: Sequence[Part]) -> list[Part]:
    """Further recordings of the same sensors, with the colour of their noise."""
    pink, red = like[0].colour
    return [_coloured(part, (pink, red * part.dt / like[0].dt), like[0].since) for part in parts]
