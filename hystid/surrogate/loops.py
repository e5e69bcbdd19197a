"""Loops over views of buffers, and their elements, as C text."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from math import prod

import numpy as np

from hystid.surrogate.tensors import View

_INDEX = "ijklmnop"
Lines = list[str]


def number(value: float) -> str:
    """A C literal that reads back as exactly this double."""
    if np.isnan(value):
        return "NAN"
    if np.isinf(value):
        return "INFINITY" if value > 0 else "(-INFINITY)"
    return repr(float(value)) if value >= 0 and not np.signbit(value) else f"({float(value)!r})"


def pointer(view: View, prefix: str = "") -> str:
    """Where a view begins."""
    name = prefix + view.buffer.name
    return f"{name} + {view.offset}" if view.offset else name


def over(view: View, shape: Sequence[int], axes: Sequence[int]) -> View:
    """View re-read over a larger index space: its axis n runs with index ``axes[n]``, the others do not move it."""
    strides = [0] * len(shape)
    for stride, axis in zip(view.strides, axes, strict=True):
        strides[axis] = stride
    return View(view.buffer, tuple(shape), tuple(strides), view.offset, view.kind)


@dataclass(frozen=True)
class Nest:
    """Nested loops over a shape. strides: for views whose axes were merged, their strides in this nest."""

    shape: tuple[int, ...]
    strides: Mapping[int, tuple[int, ...]] = field(default_factory=dict)

    @staticmethod
    def merged(views: Sequence[View]) -> Nest:
        """As few loops as visit the same elements of all views in row-major order."""
        axes: list[tuple[int, list[int]]] = []
        for axis, size in enumerate(views[0].shape):
            steps = [view.strides[axis] for view in views]
            if size == 1:
                continue
            if axes and all(before == size * step for before, step in zip(axes[-1][1], steps, strict=True)):
                axes[-1] = (axes[-1][0] * size, steps)
            else:
                axes.append((size, steps))
        columns = {id(view): tuple(steps[n] for _, steps in axes) for n, view in enumerate(views)}
        return Nest(tuple(size for size, _ in axes), columns)

    def at(self, view: View, prefix: str = "") -> str:
        """The element of a view at the loop counters; constants of one element are written out."""
        strides = self.strides.get(id(view), view.strides)
        if view.is_constant and not prefix and all(n == 1 or s == 0 for n, s in zip(self.shape, strides, strict=True)):
            assert view.buffer.values is not None
            return number(float(view.buffer.values[view.offset]))
        terms = [str(view.offset)] if view.offset else []
        for index, size, stride in zip(_INDEX, self.shape, strides, strict=False):
            if size > 1 and stride:
                terms.append(index if stride == 1 else f"{stride} * {index}")
        return f"{prefix}{view.buffer.name}[{' + '.join(terms) or '0'}]"

    def counter(self) -> str:
        """Row-major position of the loop counters."""
        assert len(self.shape) <= 1
        return "i" if prod(self.shape) > 1 else "0"

    def wrap(self, body: Lines) -> Lines:
        """The body inside all loops, or in a block of its own where there is nothing to loop over."""
        return self.inner_wrap(body, 0, "    ")

    def inner_wrap(self, body: Lines, first: int, indent: str = "") -> Lines:
        """The body inside the loops from axis ``first`` on."""
        loops = [(index, size) for index, size in list(zip(_INDEX, self.shape, strict=False))[first:] if size > 1]
        lines: Lines = []
        for depth, (index, size) in enumerate(loops):
            lines.append(f"{indent}{'    ' * depth}for (int {index} = 0; {index} < {size}; ++{index}) {{")
        block = len(body) > 1 and not loops
        inner = indent + "    " * (len(loops) + block)
        lines += [indent + "{"] * block + [inner + line for line in body] + [indent + "}"] * block
        return lines + [f"{indent}{'    ' * depth}}}" for depth in reversed(range(len(loops)))]
