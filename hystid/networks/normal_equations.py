"""Normal equations of one network on one data set: by a compiled kernel.

Parameters w are flat, [W1 row by row, b1, W2, b2, ...]; inputs and target are scaled to [-1, 1].
"""

from __future__ import annotations

import ctypes
from abc import ABC, abstractmethod
from collections.abc import Iterable, Sequence
from functools import cache
from itertools import pairwise
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from hystid.recording import Array
from hystid.toolchain import shared_library

Precision = Literal["float64", "float32"]

_FLAGS = ("-O3", "-march=native", "-ffp-contract=fast", "-Wno-psabi")
_CACHE = 900_000  # bytes of one chunk of the Jacobian: leaves room in a 1 MiB level-2 cache


def parameter_count(sizes: Sequence[int]) -> int:
    """Number of weights and biases of a network with these layer sizes, inputs and output included."""
    return sum((ni + 1) * no for ni, no in pairwise(sizes))


def unflatten(w: Any, sizes: Sequence[int]) -> list[tuple[Any, Any]]:
    """(W, b) of each layer as views into the flat vector, shape (..., P); W has shape (..., outputs, inputs)."""
    layers, at = [], 0
    for ni, no in pairwise(sizes):
        end = at + ni * no
        layers.append((w[..., at:end].reshape(*w.shape[:-1], no, ni), w[..., end : end + no]))
        at = end + no
    return layers


def flattened(layers: Iterable[tuple[Array, Array]]) -> Array:
    """Weights and biases of layers in the order of ``unflatten``, shape (P,)."""
    return np.concatenate([part.ravel() for layer in layers for part in layer])


def layers_of(w: Array, sizes: Sequence[int]) -> tuple[tuple[Array, Array], ...]:
    """As ``unflatten``, but copies."""
    return tuple((weights.copy(), bias.copy()) for weights, bias in unflatten(w, sizes))


@cache
def library_of(precision: Precision) -> ctypes.CDLL:
    """Compiled kernel; raises ToolchainError where there is no compiler."""
    folder = Path(__file__).parent / "kernel"
    headers = ("vector.h", "perceptron.h")
    main = ("normal.c",) if precision == "float32" else ("normal.c", "joint.c")
    sources = {name: (folder / name).read_text() for name in (*headers, *main)}
    flags = (*_FLAGS, "-DSINGLE") if precision == "float32" else _FLAGS
    library = ctypes.CDLL(str(shared_library(sources, main=main, flags=flags)))
    library.hystid_normal.restype = ctypes.c_double
    if precision == "float64":
        library.hystid_joint.restype = ctypes.c_double
    return library


def aligned(shape: tuple[int, ...], kind: str) -> np.ndarray[tuple[int, ...], np.dtype[np.floating]]:
    """Zeros of the given type whose first byte lies on a multiple of 64, as the kernels' vectors need."""
    size = int(np.prod(shape)) * np.dtype(kind).itemsize
    room = np.zeros(size + 64, np.uint8)
    begin = -room.ctypes.data % 64
    return room[begin : begin + size].view(kind).reshape(shape)


def pointer(values: np.ndarray[Any, Any]) -> ctypes.c_void_p:
    """Address of an array for the kernel; keeps the array alive as long as itself."""
    return values.ctypes.data_as(ctypes.c_void_p)


class KernelSums(ABC):
    """Least squares of one structure of ``count`` parameters on ``samples`` samples: J'J and J'e as the C kernel leaves
    them, and the solution of its normal equations.

    prior: factor of each parameter's square in the sum of squares (ridge), shape (P,); None for none.
    """

    samples: int

    def __init__(self, count: int, precision: Precision, prior: Array | None = None) -> None:
        self.library = library_of(precision)
        self.count, self.prior = count, prior
        block = self.library.hystid_block()
        self.stride = -(-(count + 1) // block) * block
        self.sums = aligned((self.stride, self.stride), "float64")
        self._factor = np.empty_like(self.sums)

    @abstractmethod
    def _run(self, w: Array, sums: ctypes.c_void_p | None) -> float:
        """Sum of squares at w; J'J and J'e into ``sums`` where that is given."""

    def squares(self, w: Array) -> float:
        """Sum of squared residuals e = output - target."""
        return self._run(np.ascontiguousarray(w, dtype=np.float64), None) + self.held(w)

    def build(self, w: Array) -> float:
        """As ``squares``; keeps J'J and J'e for ``diagonal``, ``gradient`` and ``solve``."""
        found = self._run(np.ascontiguousarray(w, dtype=np.float64), pointer(self.sums))
        if self.prior is not None:
            self.sums[np.arange(self.count), np.arange(self.count)] += self.prior
            self.sums[self.count, : self.count] += self.prior * w
        return found + self.held(w)

    def held(self, w: Array) -> float:
        """What the prior adds to the sum of squares."""
        return float(self.prior @ (w * w)) if self.prior is not None else 0.0

    def diagonal(self) -> Array:
        """Diagonal of J'J, shape (P,)."""
        return np.array(np.diagonal(self.sums)[: self.count])

    def gradient(self) -> Array:
        """J'e, shape (P,)."""
        return np.array(self.sums[self.count, : self.count])

    def solve(self, damping: Array) -> Array | None:
        """Solution d of (J'J + diag(damping)) d = J'e; None where the matrix is not positive definite."""
        damping, step = np.ascontiguousarray(damping, dtype=np.float64), np.empty(self.count)
        arrays = (pointer(damping), pointer(self._factor), pointer(step))
        size = ctypes.c_long(self.count)
        found = self.library.hystid_solve(size, pointer(self.sums), ctypes.c_long(self.stride), *arrays)
        return step if found else None


class One:
    """One problem as a batch of one (``hystid.leastsquares.LeastSquaresProblem``)."""

    def __init__(self, normal: KernelSums) -> None:
        self.normal, self.samples = normal, normal.samples

    def squares(self, w: Array) -> Array:
        return np.array([self.normal.squares(w[0])])

    def build(self, w: Array) -> Array:
        return np.array([self.normal.build(w[0])])

    def diagonal(self) -> Array:
        return self.normal.diagonal()[None]

    def gradient(self) -> Array:
        return self.normal.gradient()[None]

    def solve(self, damping: Array) -> tuple[Array, NDArray[np.bool_]]:
        step = self.normal.solve(damping[0])
        return (np.zeros_like(damping) if step is None else step[None]), np.array([step is not None])


def chunked(rows: Array, length: int, precision: Precision) -> np.ndarray[Any, Any]:
    """Rows of shape (r, n) as chunks of shape (n / length rounded up, r, length), padded with zeros."""
    count = -(-rows.shape[1] // length)
    padded = np.zeros((len(rows), count * length))
    padded[:, : rows.shape[1]] = rows
    data = aligned((count, len(rows), length), precision)
    data[:] = padded.reshape(len(rows), count, length).transpose(1, 0, 2)
    return data


class CompiledNormal(KernelSums):
    """C kernel; the Jacobian exists one cache-sized chunk at a time. Beyond the data: about 1 MB and 2 P^2 doubles."""

    def __init__(
        self,
        sizes: Sequence[int],
        inputs: Array,
        target: Array,
        precision: Precision = "float64",
        prior: Array | None = None,
    ) -> None:
        super().__init__(parameter_count(sizes), precision, prior)
        self.samples = len(target)
        fitting = _CACHE // (self.stride * np.dtype(precision).itemsize)
        self._length = int(np.clip(fitting // 64 * 64, 64, 512))
        self._data = chunked(np.concatenate([inputs, target[None]]), self._length, precision)
        rows = self.stride + sum(sizes) + 2 * max(sizes)
        self._work = aligned((rows * self._length + self.count,), precision)
        self._sizes = np.array(sizes, dtype=np.int32)

    def _run(self, w: Array, sums: ctypes.c_void_p | None) -> float:
        network = (len(self._sizes) - 1, pointer(self._sizes), pointer(w))
        data = (ctypes.c_long(self.samples), self._length, pointer(self._data))
        return float(self.library.hystid_normal(*network, *data, sums, ctypes.c_long(self.stride), pointer(self._work)))
