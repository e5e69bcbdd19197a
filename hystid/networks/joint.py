"""Training both networks together in simulation: the force memory is the model's own, as it is in use.

The published method trains each network by itself with measured forces at the turning points, and closes the loop
only afterwards; noise in those forces biases the hysteresis network, and its own errors, which it will be fed with in
use, are never seen. Here the squared error of the simulated R is lowered, with the exact Jacobian: at a turning point
the derivative of the remembered force follows the same recursion as the force itself.
"""

from __future__ import annotations

import ctypes
import threading
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from hystid.networks.network import Member, Network
from hystid.networks.normal_equations import aligned, library_of, parameter_count, unflatten
from hystid.networks.training import Rule, Training, minimise, split_indices
from hystid.recording import Array
from hystid.turning_points import TurningPoints

_LENGTH = 256  # samples per chunk
_FEWEST_BRANCHES = 20  # fewer cannot be divided into three parts that resemble each other


@dataclass(frozen=True, eq=False)
class Sequences:
    """Recordings cut into segments between turning points, and the samples that are fitted.

    Segments, shape (s,): x0 displacement at its turning point [m], before: displacement one sample earlier [m], fresh:
    where a recording begins, start: force [N] that the memory begins with there.
    Samples, shape (n,), sorted by segment: x, v, R, and segment, the number of each one's segment.
    """

    x0: Array
    before: Array
    fresh: NDArray[np.bool_]
    start: Array
    x: Array
    v: Array
    R: Array
    segment: NDArray[np.int32]

    @staticmethod
    def of(motions: Sequence[tuple[Array, Array, Array]], rule: TurningPoints) -> Sequences:
        """All samples of recordings (x, v, R)."""
        parts: list[tuple[Array, ...]] = []
        numbers, count = [], 0
        for x, v, R in motions:
            turn, _ = rule.find(v)
            turn[0] = True
            at = np.flatnonzero(turn)
            fresh = at == 0
            parts.append((x[at], x[np.maximum(at - 1, 0)], fresh, np.where(fresh, R[0], 0.0)))
            numbers.append(count + np.cumsum(turn) - 1)
            count += len(at)
        x0, before, fresh, start = (np.concatenate(columns) for columns in zip(*parts, strict=True))
        x, v, R = (np.concatenate(columns) for columns in zip(*motions, strict=True))
        return Sequences(x0, before, fresh.astype(bool), start, x, v, R, np.concatenate(numbers).astype(np.int32))

    def pick(self, samples: NDArray[np.intp]) -> Sequences:
        """The same segments with some of the samples (sample numbers in any order)."""
        rows = np.sort(samples)
        return Sequences(
            self.x0, self.before, self.fresh, self.start, self.x[rows], self.v[rows], self.R[rows], self.segment[rows]
        )

    def split(self, seed: int) -> dict[str, NDArray[np.intp]]:
        """Sample numbers of the parts "train", "validation", "test": 70, 15, 15 % of the branches, drawn at random.

        Whole branches between turning points go to one part. Neighbours in time resemble each other, so that single
        samples left out would not show whether a model carries over to another cycle; branches left out do.
        """
        present = np.unique(self.segment)
        if len(present) < _FEWEST_BRANCHES:
            return split_indices(len(self.x), seed)
        parts = split_indices(len(present), seed)
        return {name: np.flatnonzero(np.isin(self.segment, present[chosen])) for name, chosen in parts.items()}


def _scaled(network: Network, column: int, values: Array) -> Array:
    return np.asarray((values - network.input_offset[column]) * network.input_gain[column])


def _link(g: Network, net: Network) -> tuple[float, float]:
    """Factor and constant that turn the scaled output of g into the scaled third input of a network."""
    gain = float(net.input_gain[2])
    return gain * g.output_gain, gain * (g.output_offset - float(net.input_offset[2]))


class JointNormal:
    """Normal equations of a pair of networks in simulation; parameters [those of g, those of f] on scaled signals.

    g and f must have the same scaling of x. Needs the compiled kernel: raises ToolchainError where there is none.
    """

    def __init__(self, pair: Member, data: Sequences) -> None:
        g, f = pair.hysteresis, pair.restoring
        self._library, self.samples = library_of("float64"), len(data.x)
        self._sizes = tuple(np.array(net.sizes, dtype=np.int32) for net in (g, f))
        self._counts = [parameter_count(net.sizes) for net in (g, f)]
        self._count = sum(self._counts)
        block = self._library.hystid_block()
        self._stride = -(-(self._count + 1) // block) * block
        self._scale = np.array([part for net in (g, f) for part in _link(g, net)])
        self._x0, self._before = (_scaled(g, column, v) for column, v in ((1, data.x0), (0, data.before)))
        self._fresh = data.fresh.astype(np.int32)
        self._h0 = _scaled(g, 2, data.start)
        self._slope = np.zeros((len(self._x0), self._counts[0]))
        rows = np.stack([_scaled(f, 0, data.x), _scaled(f, 1, data.v), (data.R - f.output_offset) / f.output_gain])
        self._data, self._segment = self._chunks(rows, data.segment)
        activations = sum(int(sizes.sum()) for sizes in self._sizes) + 3 * max(
            int(sizes.max()) for sizes in self._sizes
        )
        self._work = aligned(((self._stride + activations) * _LENGTH,), "float64")
        self._sums = aligned((self._stride, self._stride), "float64")
        self._factor = np.empty_like(self._sums)

    def _chunks(self, rows: Array, segment: NDArray[np.int32]) -> tuple[Array, NDArray[np.int32]]:
        chunks = -(-self.samples // _LENGTH)
        padded = np.zeros((3, chunks * _LENGTH))
        padded[:, : self.samples] = rows
        data = aligned((chunks, 3, _LENGTH), "float64")
        data[:] = padded.reshape(3, chunks, _LENGTH).transpose(1, 0, 2)
        numbers = np.zeros(chunks * _LENGTH, dtype=np.int32)
        numbers[: self.samples] = segment
        return data, numbers  # type: ignore[return-value]

    def _run(self, w: Array, sums: object) -> float:
        def at(values: object) -> object:
            return values.ctypes.data_as(ctypes.c_void_p)  # type: ignore[attr-defined]

        w = np.ascontiguousarray(w, dtype=np.float64)
        g, f = self._sizes
        return float(
            self._library.hystid_joint(
                len(g) - 1, at(g), len(f) - 1, at(f), at(w), at(self._scale),
                ctypes.c_long(len(self._x0)), at(self._x0), at(self._before), at(self._fresh), at(self._h0),
                at(self._slope),
                ctypes.c_long(self.samples), _LENGTH, at(self._data), at(self._segment),
                sums, ctypes.c_long(self._stride), at(self._work),
            )
        )  # fmt: skip

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
        arrays = [values.ctypes.data_as(ctypes.c_void_p) for values in (self._sums, damping, self._factor, step)]
        sums, weights, factor, answer = arrays
        found = self._library.hystid_solve(
            ctypes.c_long(self._count), sums, ctypes.c_long(self._stride), weights, factor, answer
        )
        return step if found else None


def parameters_of(pair: Member) -> Array:
    """Weights of both networks on scaled signals, one after the other."""
    networks = (pair.hysteresis, pair.restoring)
    return np.concatenate([part.ravel() for network in networks for layer in network.layers for part in layer])


def with_parameters(pair: Member, w: Array) -> Member:
    """The pair with other weights and the same scaling."""
    first = parameter_count(pair.hysteresis.sizes)
    layers = [
        tuple((weights.copy(), bias.copy()) for weights, bias in unflatten(part, network.sizes))
        for part, network in zip((w[:first], w[first:]), (pair.hysteresis, pair.restoring), strict=True)
    ]
    return Member(replace(pair.hysteresis, layers=layers[0]), replace(pair.restoring, layers=layers[1]))


def train_jointly(
    pair: Member, data: Sequences, rule: Rule, *, seed: int = 0, stop: threading.Event | None = None
) -> tuple[Member, Training]:
    """Lower the error of the simulated R from a trained pair; stops early on branches left out."""
    parts = data.split(seed)
    fit, check, test = (JointNormal(pair, data.pick(parts[name])) for name in ("train", "validation", "test"))
    result = minimise(fit, check, parameters_of(pair), rule, stop)
    return with_parameters(pair, result.w), replace(result, test=test.squares(result.w) / test.samples)
