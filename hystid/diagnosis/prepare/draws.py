"""Draws of the error that noise of the channels leaves in the smoothed motion, made when they are asked for."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

Draw = tuple[NDArray[np.float32], ...]
ENOUGH = 3  # draws that tell how large an error is


def _nothing() -> Draw:
    return (np.zeros(1, np.float32),) * 4


class Draws:
    """Errors of x, v and a after smoothing, and of the inertia, (n,) each, by the number of the draw; in single
    precision, as they are many. What was drawn is kept: all that is compared is compared at the same draws.

    bias: of the smoother, besides.
    """

    def __init__(
        self, make: Callable[[int], Draw] = lambda number: _nothing(), bias: Callable[[], Draw] = _nothing
    ) -> None:
        self._make, self._bias = make, bias
        self._made: dict[int, Draw] = {}

    @cached_property
    def bias(self) -> Draw:
        """Bias of the smoother in x, v and a, (n,) each, and none of the inertia."""
        return self._bias()

    def __getitem__(self, number: int) -> Draw:
        if number not in self._made:
            self._made[number] = self._make(number)
        return self._made[number]

    def first(self, count: int = ENOUGH) -> list[Draw]:
        """So many draws."""
        return [self[number] for number in range(count)]

    def changed(self, by: Callable[[Draw], Draw]) -> Draws:
        """The same after what was done to the motion, which is linear."""
        return Draws(lambda number: by(self[number]), lambda: by(self.bias))
