"""Derivatives of a law with respect to its parameters, known at one point and used at others near by."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

from hystid.numeric import Array

_REUSE = 0.04  # relative distance over which derivatives of the law are used again


@dataclass(frozen=True)
class Slope:
    """Derivative of the law by one of its shapes: of R as rows, of h per part."""

    rows: Array = field(repr=False)
    h: list[Array] = field(repr=False)

    @property
    def nbytes(self) -> int:
        """Memory."""
        return self.rows.nbytes + sum(column.nbytes for column in self.h)


def are_near(known: Sequence[float], shapes: Sequence[float]) -> bool:
    """Whether derivatives of the law at a known point serve at another one."""
    return all(abs(there - here) <= _REUSE * abs(here) for there, here in zip(known, shapes, strict=True))
