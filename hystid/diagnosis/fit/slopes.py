"""Derivatives of a law with respect to its parameters, known at one point and used at others near by."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

from hystid.numeric import Array

_STEP = 2e-3  # relative step of difference quotients: laws with corners need a visible one
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


def step_at(value: float, high: float = math.inf) -> float:
    """Step of a difference quotient, downwards where it would lead above the highest value."""
    return _STEP * (abs(value) or 1.0) * (-1.0 if value * (1 + _STEP) > high else 1.0)
