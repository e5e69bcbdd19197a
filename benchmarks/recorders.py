"""What laboratories do to channels between the sensor and the file: for ``benchmarks.textbook_rigs``.

Each changes no physics, and the right answer stays what it was.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.integrate import cumulative_trapezoid
from scipy.signal import butter, sosfilt, sosfiltfilt

from hystid.numeric import Array

Columns = dict[str, Array]
_CORNER = 0.1  # of the high-pass of integrators, over the resonance


@dataclass(frozen=True)
class Bench:
    """resonance, rate [Hz] of the samples; rng: draws what differs from case to case."""

    resonance: float
    rate: float
    rng: np.random.Generator

    def passed(self, order: int, corner: float, side: str, values: Array, *, both: bool = False) -> Array:
        """Values behind a Butterworth filter with a corner [Hz], run both ways or one."""
        filtered = sosfiltfilt if both else sosfilt
        return np.asarray(filtered(butter(order, corner, side, fs=self.rate, output="sos"), values))

    def integrated(self, columns: Columns, order: int, *, both: bool) -> Columns:
        """F and a, with v and x from a by integrators with a high-pass."""
        made = {name: columns[name] for name in "Fa"}
        for name, below in (("v", "a"), ("x", "v")):
            integral = cumulative_trapezoid(made[below], dx=1 / self.rate, initial=0)
            made[name] = self.passed(order, _CORNER * self.resonance, "high", integral, both=both)
        return made

    def any_of(self, columns: Columns) -> Array:
        """Values of one channel, to be changed."""
        return columns[str(self.rng.choice(list(columns)))]

    def places(self, columns: Columns, count: int) -> list[int]:
        """Samples apart from each other, away from the ends."""
        pieces = np.array_split(np.arange(50, len(columns["F"]) - 50), count)
        return [int(self.rng.choice(piece[:-10])) for piece in pieces]


def _bad_samples(bench: Bench, columns: Columns) -> Columns:
    values = bench.any_of(columns)
    height = 4 * float(np.std(values))
    for at in bench.places(columns, 8):
        values[at] += height * bench.rng.choice([-1, 1])
    return columns


def _lost_packets(bench: Bench, columns: Columns) -> Columns:
    for at in bench.places(columns, 5):
        for values in columns.values():
            values[at : at + 5] = values[at]
    return columns


def _hum(bench: Bench, columns: Columns) -> Columns:
    values = bench.any_of(columns)
    t = np.arange(len(values)) / bench.rate
    values += 0.03 * np.std(values) * np.sin(2 * np.pi * bench.rng.uniform(0.3, 4) * bench.resonance * t)
    return columns


def _few_bits(bench: Bench, columns: Columns) -> Columns:
    steps = {name: 2.2 * np.max(np.abs(values)) / 2**10 for name, values in columns.items()}
    return {name: steps[name] * np.round(values / steps[name]) for name, values in columns.items()}


def _slow_filter(bench: Bench, columns: Columns) -> Columns:
    corner = min(8 * bench.resonance, 0.4 * bench.rate)
    return {name: bench.passed(4, corner, "low", values, both=True) for name, values in columns.items()}


def _differences(bench: Bench, columns: Columns) -> Columns:
    v = np.gradient(columns["x"], 1 / bench.rate)
    return {"F": columns["F"], "x": columns["x"], "v": v, "a": np.gradient(v, 1 / bench.rate)}


# Name -> channels of the motion that are needed ("" for any), and what is done.
RECORDERS: dict[str, tuple[str, Callable[[Bench, Columns], Columns]]] = {
    "bad samples": ("", _bad_samples),
    "lost packets": ("", _lost_packets),
    "hum": ("", _hum),
    "few bits": ("", _few_bits),
    "slow filter": ("", _slow_filter),
    "differences": ("x", _differences),
    "integrators 1": ("a", lambda bench, columns: bench.integrated(columns, 1, both=False)),
    "integrators 2": ("a", lambda bench, columns: bench.integrated(columns, 2, both=False)),
    "integrated both ways": ("a", lambda bench, columns: bench.integrated(columns, 2, both=True)),
}
