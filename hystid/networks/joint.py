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
from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import NDArray

from hystid.leastsquares import Rule
from hystid.networks.normal_equations import (
    CompiledNormal,
    KernelSums,
    aligned,
    chunked,
    flattened,
    layers_of,
    parameter_count,
    pointer,
)
from hystid.networks.perceptron import Member, Network
from hystid.networks.training import Training, descend, draw, simplicity, split_indices
from hystid.recording import Array
from hystid.turning_points import TurningPoints

_LENGTH = 256  # samples per chunk
_BEGINNINGS, _FEWEST_BEGINNINGS = 0.03, 300  # of the samples
_RUNS = 16  # of segments: few enough to be long, many enough to be everywhere
_FEWEST_BRANCHES = 20  # fewer cannot be divided into three parts that resemble each other


@dataclass(frozen=True, eq=False)
class Trajectory:
    """One recording for training: x [m], v [m/s], R [N], shape (n,), and further inputs, shape (inputs, n)."""

    x: Array
    v: Array
    R: Array
    further: Array


@dataclass(frozen=True, eq=False)
class Sequences:
    """Recordings cut into segments between turning points, and the samples that are fitted.

    Segments, shape (s,): x0 displacement at its turning point [m], before: displacement one sample earlier [m] and,
    after it, the further inputs there, shape (s, 1 + inputs), fresh: where the memory begins anew, start: force [N] as
    measured one sample earlier, with which it begins there.
    Samples, shape (n,), sorted by segment: x, v, R; further, shape (inputs, n); segment, the number of each one's
    segment; weight of its error.
    """

    x0: Array
    before: Array
    fresh: NDArray[np.bool_]
    start: Array
    x: Array
    v: Array
    R: Array
    further: Array
    segment: NDArray[np.int32]
    weight: Array
    inputs: int = 0

    @staticmethod
    def of(
        motions: Sequence[Trajectory], rule: TurningPoints, weights: Sequence[Array] | None = None, inputs: int = 0
    ) -> Sequences:
        """All samples of recordings. weights: of the errors of each recording's samples [1/N], 1 where not given.

        inputs: how many rows of ``further`` are further inputs, whose effect is held small; the rest are lags.
        """
        parts: list[tuple[Array, ...]] = []
        numbers, count = [], 0
        for motion in motions:
            turn, _ = rule.find(motion.v)
            turn[0] = True
            at = np.flatnonzero(turn)
            fresh, last = at == 0, np.maximum(at - 1, 0)
            before = np.column_stack([motion.x[last], motion.further[:, last].T])
            parts.append((motion.x[at], before, fresh, motion.R[last]))
            numbers.append(count + np.cumsum(turn) - 1)
            count += len(at)
        x0, before, fresh, start = (np.concatenate(columns) for columns in zip(*parts, strict=True))
        x, v, R = (np.concatenate([getattr(motion, name) for motion in motions]) for name in ("x", "v", "R"))
        further = np.concatenate([motion.further for motion in motions], axis=1)
        segment = np.concatenate(numbers).astype(np.int32)
        weight = np.concatenate(weights or [np.ones(len(motion.x)) for motion in motions])
        return Sequences(x0, before, fresh.astype(bool), start, x, v, R, further, segment, weight, inputs)

    def pick(self, samples: NDArray[np.intp]) -> Sequences:
        """The same segments with some of the samples (sample numbers in any order)."""
        rows = np.sort(samples)
        motion = (self.x[rows], self.v[rows], self.R[rows], self.further[:, rows])
        memory = (self.x0, self.before, self.fresh, self.start)
        return Sequences(*memory, *motion, self.segment[rows], self.weight[rows], self.inputs)

    def thinned(self, count: int) -> tuple[Sequences, NDArray[np.bool_]]:
        """At most so many of the segments, in runs spread evenly over all, and which samples are in them.

        The memory passes through every segment, however few of the samples are fitted: that is what many cost.
        """
        length, runs = count // _RUNS, np.arange(_RUNS)
        if len(self.x0) <= count or not length:
            return self, np.ones(len(self.x), bool)
        begin = (runs * (len(self.x0) - length)) // (_RUNS - 1)
        kept = (begin[:, None] + np.arange(length)).ravel()
        number = np.full(len(self.x0), -1, np.int32)
        number[kept] = np.arange(len(kept))
        rows = number[self.segment] >= 0
        fresh = self.fresh.copy()
        fresh[begin] = True
        memory = (self.x0[kept], self.before[kept], fresh[kept], self.start[kept])
        motion = (self.x[rows], self.v[rows], self.R[rows], self.further[:, rows])
        return Sequences(*memory, *motion, number[self.segment[rows]], self.weight[rows], self.inputs), rows

    def joined(self, other: Sequences) -> Sequences:
        """These segments and samples and, after them, those of other recordings."""
        later = replace(other, segment=other.segment + np.int32(len(self.x0)))
        names = [field.name for field in fields(self) if field.name != "inputs"]
        columns = {name: (getattr(self, name), getattr(later, name)) for name in names}
        joined = {name: np.concatenate(both, axis=0 if name == "before" else -1) for name, both in columns.items()}
        return Sequences(**joined, inputs=self.inputs)

    def weighted(self, factor: float) -> Sequences:
        """The same with all weights times a factor."""
        return replace(self, weight=factor * self.weight)

    def unseen(self, seed: int) -> NDArray[np.bool_] | None:
        """Which samples ``split`` gives to no training; None where single samples, not branches, are left out."""
        if len(self.x0) < _FEWEST_BRANCHES:
            return None
        return np.asarray(~np.isin(self.segment, split_indices(len(self.x0), seed)["train"]))

    def split(self, seed: int) -> dict[str, NDArray[np.intp]]:
        """Sample numbers of the parts "train", "validation", "test": 70, 15, 15 % of the branches, drawn at random.

        Whole branches between turning points go to one part. Neighbours in time resemble each other, so that single
        samples left out would not show whether a model carries over to another cycle; branches left out do.
        """
        branches = len(self.x0)
        if branches < _FEWEST_BRANCHES:
            return split_indices(len(self.x), seed)
        parts = split_indices(branches, seed)
        return {name: np.flatnonzero(np.isin(self.segment, chosen)) for name, chosen in parts.items()}


def _scaled(network: Network, column: int, values: Array) -> Array:
    return np.asarray((values - network.input_offset[column]) * network.input_gain[column])


def _link(g: Network, net: Network) -> tuple[float, float]:
    """Factor and constant that turn the scaled output of g into the scaled third input of a network."""
    gain = float(net.input_gain[2])
    return gain * g.output_gain, gain * (g.output_offset - float(net.input_offset[2]))


class JointNormal(KernelSums):
    """Normal equations of a pair of networks in simulation; parameters [those of g, those of f] on scaled signals.

    g and f must have the same scaling of x and of the further inputs. Needs the compiled kernel: raises ToolchainError
    where there is none.
    """

    def __init__(self, pair: Member, data: Sequences, continuous: bool = False) -> None:
        g, f = pair.hysteresis, pair.restoring
        self._counts = [parameter_count(net.sizes) for net in (g, f)]
        quiet = slice(3, 3 + data.inputs)
        priors = [simplicity(net.sizes, quiet, len(data.x)) for net in (g, f)]
        held = [prior for prior in priors if prior is not None]
        super().__init__(sum(self._counts), "float64", np.concatenate(held) if held else None)
        self.samples = len(data.x)
        self._sizes = tuple(np.array(net.sizes, dtype=np.int32) for net in (g, f))
        self._scale = np.array([part for net in (g, f) for part in _link(g, net)])
        columns = [3 + i for i in range(len(data.further))]
        self._x0, self._xb = (_scaled(g, column, v) for column, v in ((1, data.x0), (0, data.before[:, 0])))
        before = [_scaled(g, column, data.before[:, 1 + i]) for i, column in enumerate(columns)]
        self._before = np.ascontiguousarray(np.stack(before, axis=1)) if before else np.zeros((0, 0))
        self._fresh = data.fresh.astype(np.int32)
        self._h0 = _scaled(g, 2, data.start)
        self._slope: Array | None = None  # d h0 / d weights of g, shape (segments, weights): only where it is built
        further = [_scaled(f, column, values) for column, values in zip(columns, data.further, strict=True)]
        target = (data.R - f.output_offset) / f.output_gain
        rows = np.stack([_scaled(f, 0, data.x), _scaled(f, 1, data.v), *further, target, data.weight])
        self._data = chunked(rows, _LENGTH, "float64")
        self._segment = np.zeros(len(self._data) * _LENGTH, dtype=np.int32)
        self._segment[: self.samples] = data.segment
        widths = [int(sizes.max()) for sizes in self._sizes]
        activations = sum(int(sizes.sum()) for sizes in self._sizes) + 3 * max(widths)
        self._work = aligned(((self.stride + activations) * _LENGTH,), "float64")
        self._beginnings = _beginnings(g, data) if continuous else None

    def build(self, w: Array) -> float:
        found = super().build(w)
        if self._beginnings is None:
            return found
        own, count = self._beginnings, self._counts[0]
        error = own.build(w[:count])
        self.sums[:count, :count] += own.sums[:count, :count]
        self.sums[self.count, :count] += own.gradient()
        return found + error

    def squares(self, w: Array) -> float:
        own = self._beginnings.squares(w[: self._counts[0]]) if self._beginnings is not None else 0.0
        return super().squares(w) + own

    def _run(self, w: Array, sums: ctypes.c_void_p | None) -> float:
        if sums is not None and self._slope is None:
            self._slope = np.zeros((len(self._x0), self._counts[0]))
        slope = None if self._slope is None else pointer(self._slope)
        networks = [part for sizes in self._sizes for part in (len(sizes) - 1, pointer(sizes))]
        memory = [pointer(values) for values in (self._x0, self._xb, self._fresh, self._before, self._h0)]
        data = (ctypes.c_long(self.samples), _LENGTH, pointer(self._data), pointer(self._segment))
        return float(
            self.library.hystid_joint(
                *networks, pointer(w), pointer(self._scale), ctypes.c_long(len(self._x0)), *memory, slope, *data,
                sums, ctypes.c_long(self.stride), pointer(self._work),
            )
        )  # fmt: skip


def _beginnings(g: Network, data: Sequences) -> CompiledNormal:
    """Samples that say: a branch begins with the force that the one before ended with, g(x0, x0, Rh0) = Rh0.

    Recordings show it for the branches that they hold, mostly full ones. A network left to itself may jump at all the
    others, and a jump at a turning point feeds energy into cycles however small. A motion may turn wherever it comes:
    at the points (x, R) of the data, and at those between them and the straight line through all.
    """
    rng = np.random.default_rng(0)
    count = max(_FEWEST_BEGINNINGS, round(_BEGINNINGS * len(data.x)))
    at = rng.integers(len(data.x), size=count)
    x, further = data.x[at], data.further[:, at]
    slope = float(np.mean((data.x - data.x.mean()) * data.R) / (np.var(data.x) or 1.0))
    line = data.R.mean() + slope * (x - data.x.mean())
    h = line + rng.uniform(-1, 1, count) * (data.R[at] - line)
    columns = np.stack([_scaled(g, k, row) for k, row in enumerate([x, x, h, *further])])
    return CompiledNormal(g.sizes, columns, (h - g.output_offset) / g.output_gain)


def parameters_of(pair: Member) -> Array:
    """Weights of both networks on scaled signals, one after the other."""
    return flattened((*pair.hysteresis.layers, *pair.restoring.layers))


def with_parameters(pair: Member, w: Array) -> Member:
    """The pair with other weights and the same scaling."""
    first = parameter_count(pair.hysteresis.sizes)
    networks = (w[:first], pair.hysteresis), (w[first:], pair.restoring)
    return Member(*(replace(network, layers=layers_of(part, network.sizes)) for part, network in networks))


def train_jointly(
    pair: Member,
    data: Sequences,
    rule: Rule,
    *,
    seed: int = 0,
    share: float = 1.0,
    stop: threading.Event | None = None,
) -> tuple[Member, Training]:
    """Lower the error of the simulated R from a trained pair; stops early on branches left out.

    share: of the training samples that are used, drawn at random; the validation branches are always whole.
    """
    parts = data.split(seed)
    parts["train"] = parts["train"][draw(len(parts["train"]), round(share * len(parts["train"])), seed)]
    fit, check, test = (JointNormal(pair, data.pick(parts[name])) for name in ("train", "validation", "test"))
    result = descend(fit, check, parameters_of(pair), rule, stop)
    return with_parameters(pair, result.w), replace(result, test=test.squares(result.w) / test.samples)


def train_beside(pair: Member, parts: tuple[Sequences, Sequences], beside: Sequences, rule: Rule) -> Member:
    """The pair after more training on data and, beside them, on wanted answers that weigh as much as the data's error.

    Branches are to begin with the force that the one before ended with.

    parts: for training and for validation; the answers count in both.
    """
    w = parameters_of(pair)
    error, lacking = (JointNormal(pair, part).squares(w) for part in (parts[0], beside))
    if not lacking > 0:
        return pair
    share = len(parts[1].x) / len(parts[0].x)
    factor = np.sqrt(error / lacking)
    fit = JointNormal(pair, parts[0].joined(beside.weighted(factor)), continuous=True)
    check = JointNormal(pair, parts[1].joined(beside.weighted(factor * np.sqrt(share))))
    return with_parameters(pair, descend(fit, check, w, rule).w)
