"""Level of a force that depends on further inputs: what the networks' force is scaled and shifted by.

A pressure shifts a force, a tension or a current multiplies its friction. Recordings are taken at a few of their
levels only, and a network that has seen friction of 20 N and 60 N may say anything at 40 N: neither the input nor the
remembered force has been there. Scaled by its level the force is nearly the same at all of them: there is no gap.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hystid.recording import Array

_TURNS = 3  # of centre and spread: each is fitted with the other as it was before
_EVEN = 0.05  # deviation of the spread, relative: less does not tell a common stiffness from one that grows with it
_LEAST_SPREAD = 0.05  # of the mean spread: so low an extrapolated level may get, and no lower


@dataclass(frozen=True)
class Level:
    """R = centre + spread * (networks' force), with x [m] and the further inputs and lags w:

    centre = offset + slopes . (x, w) [N], spread = max(base + growth . w, least) [N]. What depends on the velocity is
    scaled with the spread, as friction is: a spring beside it is not.
    """

    offset: float
    slopes: tuple[float, ...]
    base: float
    growth: tuple[float, ...]
    least: float

    @staticmethod
    def of(x: Array, further: Array, R: Array) -> Level:
        """Fit to samples, shape (n,); further: shape (inputs + lags, n).

        The centre is the least-squares plane of R, the spread that of the distance from it. A stiffness that grows with
        the spread, as that of a slip joint or a yielding fluid does, is the networks'; the centre has what is common to
        all spreads, 0 or more.
        """
        rows = np.stack([x, *further])
        plane = _plane(rows, R)
        for turn in range(_TURNS):
            distance = np.abs(R - plane[0] - plane[1:] @ rows)
            growth = _plane(further, distance)
            scaled = (growth[0] + growth[1:] @ further) / np.mean(distance)
            if turn == _TURNS - 1 or np.std(scaled) < _EVEN:
                break
            common = max(0.0, _plane(np.stack([*rows, scaled * (x - np.mean(x))]), R)[1])
            plane = np.insert(_plane(further, R - common * x), 1, common)
        return Level(
            float(plane[0]),
            tuple(float(value) for value in plane[1:]),
            float(growth[0]),
            tuple(float(value) for value in growth[1:]),
            float(_LEAST_SPREAD * np.mean(distance)) or 1.0,
        )

    def centre(self, x: Array, further: Array) -> Array:
        """Centre [N], shape (n,)."""
        return np.asarray(self.offset + self.slopes[0] * x + np.array(self.slopes[1:]) @ further)

    def spread(self, further: Array) -> Array:
        """Spread [N], shape (n,)."""
        return np.asarray(np.maximum(self.base + np.array(self.growth) @ further, self.least))

    def numbers(self) -> list[float]:
        """All of it in a row: offset, slopes, base, growth, least."""
        return [self.offset, *self.slopes, self.base, *self.growth, self.least]

    @staticmethod
    def from_numbers(values: list[float]) -> Level:
        """Inverse of ``numbers``."""
        count = (len(values) - 4) // 2
        slopes, growth = values[1 : 2 + count], values[3 + count : 3 + 2 * count]
        return Level(values[0], tuple(slopes), values[2 + count], tuple(growth), values[-1])


def _plane(rows: Array, target: Array) -> Array:
    """Constant and slopes of the least-squares plane; 0 for a row that does not vary."""
    middle, width = rows.mean(axis=1), np.std(rows, axis=1)
    scaled = (rows - middle[:, None]) / np.where(width > 0, width, 1.0)[:, None]
    solution = np.linalg.lstsq(np.stack([np.ones(rows.shape[1]), *scaled], axis=1), target, rcond=None)[0]
    slopes = np.where(width > 0, solution[1:] / np.where(width > 0, width, 1.0), 0.0)
    return np.concatenate([[solution[0] - slopes @ middle], slopes])
