"""Normal equations of one network on one data set: compiled C where there is a compiler, NumPy otherwise.

Parameters w are flat, [W1 row by row, b1, W2, b2, ...]; inputs and target are scaled to [-1, 1].
"""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from functools import cache
from itertools import pairwise
from pathlib import Path
from typing import Literal, Protocol

import numpy as np
import scipy.linalg

from hystid import toolchain
from hystid.errors import ToolchainError
from hystid.recording import Array

Precision = Literal["float64", "float32"]

_FLAGS = ("-O3", "-march=native", "-ffp-contract=fast", "-Wno-psabi")
_CACHE = 900_000  # bytes of one chunk of the Jacobian: leaves room in a 1 MiB level-2 cache


def parameter_count(sizes: Sequence[int]) -> int:
    """Number of weights and biases of a network with these layer sizes, inputs and output included."""
    return sum((ni + 1) * no for ni, no in pairwise(sizes))


def unflatten(w: Array, sizes: Sequence[int]) -> list[tuple[Array, Array]]:
    """(W, b) of each layer as views into the flat vector; W has shape (outputs, inputs)."""
    layers, at = [], 0
    for ni, no in pairwise(sizes):
        end = at + ni * no
        layers.append((w[at:end].reshape(no, ni), w[end : end + no]))
        at = end + no
    return layers


class NormalEquations(Protocol):
    """Least squares of one network structure on one data set of ``samples`` samples."""

    samples: int

    def squares(self, w: Array) -> float:
        """Sum of squared residuals e = output - target."""

    def build(self, w: Array) -> float:
        """As ``squares``; keeps J'J and J'e for ``diagonal``, ``gradient`` and ``solve``."""

    def diagonal(self) -> Array:
        """Diagonal of J'J, shape (P,)."""

    def gradient(self) -> Array:
        """J'e, shape (P,)."""

    def solve(self, damping: Array) -> Array | None:
        """Solution d of (J'J + diag(damping)) d = J'e; None where the matrix is not positive definite."""


def normal_equations(
    sizes: Sequence[int], inputs: Array, target: Array, precision: Precision = "float64"
) -> NormalEquations:
    """The fastest implementation on this machine. inputs: shape (features, samples); target: shape (samples,)."""
    try:
        return CompiledNormal(sizes, inputs, target, precision)
    except ToolchainError:
        return NumpyNormal(sizes, inputs, target, precision)


@cache
def library_of(precision: Precision) -> ctypes.CDLL:
    """Compiled kernel; raises ToolchainError where there is no compiler."""
    folder = Path(__file__).parent / "kernel"
    headers = ("vector.h", "perceptron.h")
    main = ("normal.c",) if precision == "float32" else ("normal.c", "joint.c")
    sources = {name: (folder / name).read_text() for name in (*headers, *main)}
    flags = (*_FLAGS, "-DSINGLE") if precision == "float32" else _FLAGS
    library = ctypes.CDLL(str(toolchain.shared_library(sources, main=main, flags=flags)))
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


class CompiledNormal:
    """C kernel; the Jacobian exists one cache-sized chunk at a time. Beyond the data: about 1 MB and 2 P^2 doubles."""

    def __init__(self, sizes: Sequence[int], inputs: Array, target: Array, precision: Precision = "float64") -> None:
        self._library = library_of(precision)
        self.samples, self._count = len(target), parameter_count(sizes)
        block = self._library.hystid_block()
        self._stride = -(-(self._count + 1) // block) * block
        fitting = _CACHE // (self._stride * np.dtype(precision).itemsize)
        self._length = int(np.clip(fitting // 64 * 64, 64, 512))
        self._data = self._chunks(inputs, target, precision)
        rows = self._stride + sum(sizes) + 2 * max(sizes)
        self._work = aligned((rows * self._length + self._count,), precision)
        self._sums = aligned((self._stride, self._stride), "float64")
        self._factor = np.empty_like(self._sums)
        self._sizes = np.array(sizes, dtype=np.int32)

    def _chunks(
        self, inputs: Array, target: Array, precision: Precision
    ) -> np.ndarray[tuple[int, ...], np.dtype[np.floating]]:
        chunks = -(-self.samples // self._length)
        rows = np.zeros((len(inputs) + 1, chunks * self._length))
        rows[:-1, : self.samples], rows[-1, : self.samples] = inputs, target
        data = aligned((chunks, len(rows), self._length), precision)
        data[:] = rows.reshape(len(rows), chunks, self._length).transpose(1, 0, 2)
        return data

    def _run(self, w: Array, sums: object) -> float:
        w = np.ascontiguousarray(w, dtype=np.float64)
        return float(
            self._library.hystid_normal(
                len(self._sizes) - 1,
                self._sizes.ctypes.data_as(ctypes.c_void_p),
                w.ctypes.data_as(ctypes.c_void_p),
                ctypes.c_long(self.samples),
                self._length,
                self._data.ctypes.data_as(ctypes.c_void_p),
                sums,
                ctypes.c_long(self._stride),
                self._work.ctypes.data_as(ctypes.c_void_p),
            )
        )

    def squares(self, w: Array) -> float:
        return self._run(w, None)

    def build(self, w: Array) -> float:
        return self._run(w, self._sums.ctypes.data_as(ctypes.c_void_p))

    def diagonal(self) -> Array:
        return np.array(np.diagonal(self._sums)[: self._count])

    def gradient(self) -> Array:
        return np.array(self._sums[self._count, : self._count])

    def solve(self, damping: Array) -> Array | None:
        damping = np.ascontiguousarray(damping, dtype=np.float64)
        step = np.empty(self._count)
        found = self._library.hystid_solve(
            ctypes.c_long(self._count),
            self._sums.ctypes.data_as(ctypes.c_void_p),
            ctypes.c_long(self._stride),
            damping.ctypes.data_as(ctypes.c_void_p),
            self._factor.ctypes.data_as(ctypes.c_void_p),
            step.ctypes.data_as(ctypes.c_void_p),
        )
        return step if found else None


class NumpyNormal:
    """NumPy with BLAS, chunk by chunk: the fallback without a compiler, and an independent check of the kernel."""

    def __init__(self, sizes: Sequence[int], inputs: Array, target: Array, precision: Precision = "float64") -> None:
        self.samples, self._sizes, self._kind = len(target), tuple(sizes), np.dtype(precision)
        self._inputs, self._target = inputs.astype(self._kind), target.astype(self._kind)
        self._length = 1024
        self._sums = np.zeros((0, 0))

    def _parts(self) -> list[slice]:
        return [slice(k, k + self._length) for k in range(0, self.samples, self._length)]

    def _forward(self, w: Array, part: slice) -> tuple[list[Array], Array]:
        layers = unflatten(w.astype(self._kind), self._sizes)
        acts = [self._inputs[:, part]]
        for weights, bias in layers[:-1]:
            acts.append(np.tanh(weights @ acts[-1] + bias[:, None]))
        weights, bias = layers[-1]
        return acts, (weights @ acts[-1] + bias[:, None])[0] - self._target[part]

    def squares(self, w: Array) -> float:
        return sum(float(np.sum(np.square(self._forward(w, part)[1]), dtype=np.float64)) for part in self._parts())

    def build(self, w: Array) -> float:
        count = parameter_count(self._sizes)
        self._sums = np.zeros((count + 1, count + 1))
        for part in self._parts():
            rows = self._rows(w, part)
            self._sums += rows @ rows.T
        return float(self._sums[-1, -1])

    def _rows(self, w: Array, part: slice) -> Array:
        """Rows d y/d w and, last, the residual, for one chunk."""
        layers = unflatten(w.astype(self._kind), self._sizes)
        acts, residual = self._forward(w, part)
        delta = np.ones((1, len(residual)), self._kind)
        rows = [residual[None]]
        for (weights, _), below in zip(reversed(layers), reversed(acts), strict=True):
            products = (delta[:, None] * below[None]).reshape(-1, len(residual))
            rows[:0] = [products, delta]
            delta = (weights.T @ delta) * (1 - below * below)
        return np.concatenate(rows)

    def diagonal(self) -> Array:
        return np.diagonal(self._sums)[:-1].copy()

    def gradient(self) -> Array:
        return self._sums[-1, :-1].copy()

    def solve(self, damping: Array) -> Array | None:
        matrix = self._sums[:-1, :-1] + np.diag(damping)
        try:
            return np.asarray(scipy.linalg.solve(matrix, self._sums[-1, :-1], assume_a="pos", check_finite=False))
        except (np.linalg.LinAlgError, scipy.linalg.LinAlgWarning):
            return None
