"""Columns of effects at grid points of their shapes, as scans ask for them again and again."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hystid.diagnosis.fit.hypothesis import Term
from hystid.diagnosis.model.effects import Effect, Signals
from hystid.diagnosis.model.memory import Memory
from hystid.diagnosis.prepare.reduction import Reduction
from hystid.diagnosis.prepare.segments import Part
from hystid.numeric import Array

_ROWS, _FORCES = 120_000_000, 40_000_000  # bytes that are remembered: of columns, and of forces per unit of h
_AT_ONCE = 400_000  # samples of laws that run together: more leave the processor's cache


@dataclass(frozen=True)
class Columns:
    """Rows (points, k, rows) of an effect at points of its shapes, per unit of each of its k amplitudes, scaled to unit
    length; their lengths (points, k), 0 where a column vanishes, and their products with each other (points, k, k).

    places: (points,), of these points among those that were asked for: where the effect never acts, or is not finite,
    there are no columns.
    """

    places: NDArray[np.int64]
    scaled: Array = field(repr=False)
    lengths: Array
    products: Array


class Scanned:
    """Makes the columns. What depends on the motion alone is the same in every scan, and remembered."""

    def __init__(self, parts: Sequence[Part], reduce: Reduction) -> None:
        self._parts, self._reduce = parts, reduce
        self._rows, self._forces = Memory(_ROWS, cyclic=True), Memory(_FORCES)

    def columns(self, effect: Effect, grid: Sequence[Mapping[str, float]], signals: Sequence[Signals]) -> Columns:
        """What an effect adds to the rows at points of its shapes."""
        if effect.law is not effect and self._reduce.is_local:
            always = self.columns(effect.law, [effect.law_values(shapes) for shapes in grid], signals)
            ones = [np.ones_like(part.x) for part in self._parts]
            opened = [effect.switched(ones, signals, grid[place]) for place in always.places]
            gates = [np.concatenate([self._reduce.plain(i, g) for i, g in enumerate(one)]) for one in opened]
            rows = always.scaled * always.lengths[..., None]
            return Columns(always.places, *_scaled(rows * np.array(gates)[:, None] if gates else rows))

        def made() -> tuple[NDArray[Any], ...]:
            size, places, rows = len(effect.amplitudes), list[int](), list[Array]()
            some = max(1, _AT_ONCE // sum(map(len, self._parts)))
            for first in range(0, len(grid), some):
                here = grid[first : first + some]
                forces = self._unit_forces(effect, [at for shapes in here for at in effect.units_at(shapes)], signals)
                raw = [forces[i * size : (i + 1) * size] for i in range(len(here))]
                kept = [i for i, point in enumerate(raw) if _acts(point)]
                places += [first + i for i in kept]
                rows += self._reduce.several([column for i in kept for column in raw[i]])
            return np.array(places, np.int64), *_scaled(np.array(rows).reshape(len(places), size, self._reduce.count))

        key = Term(effect, {}).key, tuple(tuple(shapes.items()) for shapes in grid)
        return Columns(*(self._rows.get(key, made) if effect.lasts else made()))

    def _unit_forces(
        self, effect: Effect, units: Sequence[Mapping[str, float]], signals: Sequence[Signals]
    ) -> Sequence[Sequence[Array]]:
        """Forces per part, at each of several values of the parameters; NaN where they have no finite answer. Where
        they are proportional to h, those per unit of h are remembered."""
        if not effect.per_h:
            return effect.forces_at(signals, units)

        def per_unit() -> tuple[Array, ...]:
            plain = [replace(s, h=np.ones_like(s.h)) for s in signals]
            return tuple(force for forces in effect.forces_at(plain, units) for force in forces)

        flat = self._forces.get((Term(effect, {}).key, tuple(tuple(at.items()) for at in units)), per_unit)
        count = len(signals)
        parts = (flat[i : i + count] for i in range(0, len(flat), count))
        return [[s.h * unit for s, unit in zip(signals, one, strict=True)] for one in parts]


def _scaled(rows: Array) -> tuple[Array, ...]:
    lengths = np.linalg.norm(rows, axis=-1)
    scaled = rows / np.where(lengths > 0, lengths, 1.0)[..., None]
    return scaled, lengths, scaled @ np.swapaxes(scaled, -1, -2)


def _acts(columns: Sequence[Sequence[Array]]) -> bool:
    """Whether forces, of which there are some per part, are finite, and not all of them nothing."""
    forces = [force for column in columns for force in column]
    sizes = [float(np.max(np.abs(force))) for force in forces]
    return all(size < 1e100 for size in sizes) and any(size > 0 for size in sizes)
