"""Tensors of static shape as the network compiler sees them: a buffer, and views into it.

Slicing, transposing, expanding and reshaping are done on the view while compiling and cost nothing at run time.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import prod
from typing import Any, Literal

import numpy as np
from numpy.lib.stride_tricks import as_strided
from numpy.typing import NDArray

Kind = Literal["float", "int", "bool"]
Values = NDArray[Any]


@dataclass(frozen=True, eq=False)
class Buffer:
    """A contiguous run of doubles: an argument of the generated function, a constant table, or a local array.

    name: a valid C identifier, unique in its program. values: shape (size,), for constants only.
    """

    name: str
    size: int
    role: Literal["input", "output", "constant", "local"]
    values: NDArray[np.float64] | None = None


@dataclass(frozen=True, eq=False)
class View:
    """A tensor: element (i, j, ...) lies at ``offset + i strides[0] + j strides[1] + ...`` of its buffer.

    kind: what the ONNX element type was; every number is a double at run time, whole for "int", 0 or 1 for "bool".
    """

    buffer: Buffer
    shape: tuple[int, ...]
    strides: tuple[int, ...]
    offset: int = 0
    kind: Kind = "float"

    @property
    def size(self) -> int:
        """Number of elements."""
        return prod(self.shape)

    @property
    def is_constant(self) -> bool:
        """Whether the values are known while compiling."""
        return self.buffer.values is not None

    @property
    def is_contiguous(self) -> bool:
        """Whether the elements lie one after the other, in row-major order."""
        return all(
            size == 1 or stride == expected
            for size, stride, expected in zip(self.shape, self.strides, row_major(self.shape), strict=True)
        )

    def numpy(self) -> Values:
        """Values of a constant, shape ``self.shape``, in the type of ``kind``."""
        assert self.buffer.values is not None
        step = self.buffer.values.itemsize
        table = as_strided(self.buffer.values[self.offset :], self.shape, tuple(step * s for s in self.strides))
        if self.kind == "int":  # exporters write the greatest 64-bit number for "to the end", which no double holds
            return np.clip(table, -(2.0**62), 2.0**62).astype(np.int64)
        return table.astype(np.bool_ if self.kind == "bool" else np.float64)

    def as_kind(self, kind: Kind) -> View:
        """The same numbers under another element type."""
        return replace(self, kind=kind)

    def transpose(self, axes: Sequence[int]) -> View:
        """Axis i of the result is axis ``axes[i]`` of this view."""
        return replace(self, shape=tuple(self.shape[a] for a in axes), strides=tuple(self.strides[a] for a in axes))

    def expand(self, shape: Sequence[int]) -> View:
        """This view broadcast to ``shape`` (NumPy's rule); ValueError where it does not fit."""
        missing = len(shape) - len(self.shape)
        if missing < 0:
            raise ValueError(f"{list(self.shape)} does not broadcast to {list(shape)}")
        strides = [0] * missing
        for have, want, stride in zip(self.shape, shape[missing:], self.strides, strict=True):
            if have != want and have != 1:
                raise ValueError(f"{list(self.shape)} does not broadcast to {list(shape)}")
            strides.append(stride if have == want and have != 1 else 0)
        return replace(self, shape=tuple(shape), strides=tuple(strides))

    def slice(self, axis: int, start: int, stop: int, step: int = 1) -> View:
        """Elements start, start + step, ... before stop along one axis; indices already normalised."""
        count = len(range(start, stop, step))
        offset = self.offset + start * self.strides[axis] if count else self.offset
        return replace(
            self,
            shape=(*self.shape[:axis], count, *self.shape[axis + 1 :]),
            strides=(*self.strides[:axis], step * self.strides[axis], *self.strides[axis + 1 :]),
            offset=offset,
        )

    def pick(self, axis: int, index: int) -> View:
        """The sub-tensor at one index of an axis, which is dropped."""
        part = self.slice(axis, index, index + 1)
        return replace(
            part,
            shape=(*part.shape[:axis], *part.shape[axis + 1 :]),
            strides=(*part.strides[:axis], *part.strides[axis + 1 :]),
        )

    def reshape(self, shape: Sequence[int]) -> View | None:
        """The same elements in row-major order under another shape; None where that needs a copy."""
        assert prod(shape) == self.size
        if self.is_contiguous:
            return replace(self, shape=tuple(shape), strides=row_major(shape))
        kept = [(n, s) for n, s in zip(self.shape, self.strides, strict=True) if n != 1]
        if [n for n in shape if n != 1] != [n for n, _ in kept]:
            return None
        strides = iter([s for _, s in kept])
        return replace(self, shape=tuple(shape), strides=tuple(next(strides) if n != 1 else 0 for n in shape))


def row_major(shape: Sequence[int]) -> tuple[int, ...]:
    """Strides, in elements, of a contiguous tensor."""
    strides = [1] * len(shape)
    for axis in range(len(shape) - 2, -1, -1):
        strides[axis] = strides[axis + 1] * shape[axis + 1]
    return tuple(strides)


def whole(buffer: Buffer, shape: Sequence[int], kind: Kind = "float") -> View:
    """All of a buffer, in row-major order."""
    return View(buffer, tuple(shape), row_major(shape), 0, kind)


def broadcast_shape(shapes: Sequence[Sequence[int]]) -> tuple[int, ...]:
    """Common shape of tensors that are combined element by element; ValueError where there is none."""
    return tuple(np.broadcast_shapes(*(tuple(shape) for shape in shapes)))
