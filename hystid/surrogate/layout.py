"""ONNX operators that only move elements around. Most of them are views and leave no code."""

from __future__ import annotations

from collections.abc import Sequence
from math import prod

import numpy as np

from hystid.surrogate.operators import Node, operator
from hystid.surrogate.program import Builder
from hystid.surrogate.tensors import View


@operator("Reshape")
def _reshape(b: Builder, node: Node) -> View:
    x = node.operand(0)
    shape = node.integers("shape", 1) or []
    if not node.attributes.get("allowzero", 0):
        shape = [x.shape[i] if n == 0 and i < len(x.shape) else n for i, n in enumerate(shape)]
    if shape.count(-1) == 1:
        known = -prod(shape)
        shape[shape.index(-1)] = x.size // known if known else 0
    if prod(shape) != x.size:
        raise node.refuse(f"cannot give {list(x.shape)} the shape {shape}")
    return b.reshape(x, shape)


@operator("Flatten")
def _flatten(b: Builder, node: Node) -> View:
    x = node.operand(0)
    axis = node.attributes.get("axis", 1)
    axis = axis + len(x.shape) if axis < 0 else axis
    return b.reshape(x, (prod(x.shape[:axis]), prod(x.shape[axis:])))


@operator("Squeeze")
def _squeeze(b: Builder, node: Node) -> View:
    x, rank = node.operand(0), len(node.operand(0).shape)
    given = node.integers("axes", 1)
    drop = {i for i, n in enumerate(x.shape) if n == 1} if given is None else {node.axis(a, rank) for a in given}
    if any(x.shape[axis] != 1 for axis in drop):
        raise node.refuse(f"can only drop axes of length 1, the shape is {list(x.shape)}")
    return b.reshape(x, [n for axis, n in enumerate(x.shape) if axis not in drop])


@operator("Unsqueeze")
def _unsqueeze(b: Builder, node: Node) -> View:
    x, given = node.operand(0), node.integers("axes", 1) or []
    rank = len(x.shape) + len(given)
    new, old = {node.axis(axis, rank) for axis in given}, iter(x.shape)
    return b.reshape(x, [1 if axis in new else next(old) for axis in range(rank)])


@operator("Transpose")
def _transpose(b: Builder, node: Node) -> View:
    x = node.operand(0)
    return x.transpose(node.attributes.get("perm") or range(len(x.shape))[::-1])


@operator("Expand")
def _expand(b: Builder, node: Node) -> View:
    x = node.operand(0)
    shape = [int(n) for n in node.constants(1, "the shape")]
    return x.expand(np.broadcast_shapes(x.shape, tuple(shape)))


@operator("Tile")
def _tile(b: Builder, node: Node) -> View:
    x = node.operand(0)
    repeats = [int(n) for n in node.constants(1, "repeats")]
    b.room([x.size, *repeats])
    return b.table(x, np.tile(np.arange(x.size).reshape(x.shape), repeats))


@operator("Concat")
def _concat(b: Builder, node: Node) -> View:
    views = node.all()
    return b.concat(views, node.axis(node.attributes["axis"], len(views[0].shape)))


@operator("Split")
def _split(b: Builder, node: Node) -> list[View]:
    x = node.operand(0)
    axis = node.axis(node.attributes.get("axis", 0), len(x.shape))
    sizes, count = node.integers("split", 1), len(node.outputs)
    if sizes is None:
        each = -(-x.shape[axis] // count)
        sizes = [min(each, x.shape[axis] - i * each) for i in range(count)]
    ends = np.cumsum(sizes)
    if len(sizes) != count or ends[-1] != x.shape[axis]:
        raise node.refuse(f"parts {sizes} do not add up to an axis of length {x.shape[axis]}")
    return [x.slice(axis, int(end) - size, int(end)) for end, size in zip(ends, sizes, strict=True)]


@operator("Slice")
def _slice(b: Builder, node: Node) -> View:
    x = node.operand(0)
    starts, ends = node.integers("starts", 1) or [], node.integers("ends", 2) or []
    axes = node.integers("axes", 3) or list(range(len(starts)))
    steps = node.integers("steps", 4) or [1] * len(starts)
    for start, end, axis, step in zip(starts, ends, axes, steps, strict=True):
        place = node.axis(axis, len(x.shape))
        first, last, stride = slice(start, end, step).indices(x.shape[place])
        x = x.slice(place, first, last, stride)
    return x


@operator("Gather")
def _gather(b: Builder, node: Node) -> View:
    """Rows of a constant or computed tensor at constant indices."""
    x, where = node.operand(0), node.operand(1)
    axis = node.axis(node.attributes.get("axis", 0), len(x.shape))
    index = np.asarray(node.constants(1, "indices"), dtype=np.int64)
    _check_index(node, index, x.shape[axis])
    index = index % x.shape[axis]
    if where.shape == ():
        return x.pick(axis, int(index[0]))
    b.room([*x.shape[:axis], *where.shape, *x.shape[axis + 1 :]])
    places = np.take(np.arange(x.size).reshape(x.shape), index.reshape(where.shape), axis)
    return b.table(x, places)


@operator("GatherElements")
def _gather_elements(b: Builder, node: Node) -> View:
    x = node.operand(0)
    axis = node.axis(node.attributes.get("axis", 0), len(x.shape))
    index = np.asarray(node.constants(1, "indices"), dtype=np.int64).reshape(node.operand(1).shape)
    _check_index(node, index, x.shape[axis])
    return b.table(x, np.take_along_axis(np.arange(x.size).reshape(x.shape), index % x.shape[axis], axis))


def _check_index(node: Node, index: np.ndarray, length: int) -> None:
    if index.size and (index.min() < -length or index.max() >= length):
        raise node.refuse(f"index {int(index.max())} is outside an axis of length {length}")


@operator("Pad")
def _pad(b: Builder, node: Node) -> View:
    """Constant, edge or reflect padding."""
    x, rank = node.operand(0), len(node.operand(0).shape)
    pads = node.integers("pads", 1) or []
    axes = [node.axis(int(a), rank) for a in node.constants(3, "axes")] if node.has(3) else list(range(rank))
    if min(pads, default=0) < 0:
        raise node.refuse("negative pads are not supported")
    width = [(0, 0)] * rank
    for place, axis in enumerate(axes):
        width[axis] = (pads[place], pads[place + len(axes)])
    b.room([n + before + after for n, (before, after) in zip(x.shape, width, strict=True)])
    mode = node.attributes.get("mode", "constant")
    places = np.arange(x.size).reshape(x.shape)
    if mode in ("edge", "reflect"):
        return b.table(x, np.pad(places, width, mode=mode))
    value = node.constants(2, "the padding value")[0] if node.has(2) else node.attributes.get("value", 0.0)
    both = b.concat([b.reshape(x, (x.size,)), b.constant([float(value)])], 0)
    return b.table(both, np.pad(places, width, constant_values=x.size))


@operator("Shape")
def _shape(b: Builder, node: Node) -> View:
    shape = node.operand(0).shape
    return b.constant(np.asarray(shape[node.attributes.get("start", 0) : node.attributes.get("end")], dtype=np.int64))


@operator("Size")
def _size(b: Builder, node: Node) -> View:
    return b.constant(np.asarray(node.operand(0).size, dtype=np.int64))


@operator("Conv")
def _conv(b: Builder, node: Node) -> View:
    """Convolution over any number of axes, as a table of patches times the kernel."""
    x, kernel = node.operand(0), node.operand(1)
    shape, groups = kernel.shape[2:], node.attributes.get("group", 1)
    if x.shape[0] != 1:
        raise node.refuse("only a batch of one is supported")
    places, outside = _patches(b, node, x, shape)
    flat = b.concat([b.reshape(x, (x.size,)), b.constant([0.0])], 0) if outside else x
    out_shape = places.shape[: len(shape)]
    results = []
    for group in range(groups):
        channels, filters = x.shape[1] // groups, kernel.shape[0] // groups
        part = places[..., group * channels : (group + 1) * channels, :].reshape(prod(out_shape), -1)
        rows = b.reshape(kernel.slice(0, group * filters, (group + 1) * filters), (filters, part.shape[1]))
        bias = None
        if node.has(2):
            bias = b.reshape(node.operand(2).slice(0, group * filters, (group + 1) * filters), (filters, 1))
        results.append(b.matmul(rows, b.table(flat, part.T.copy()), bias))
    joined = b.concat(results, 0) if groups > 1 else results[0]
    return b.reshape(joined, (1, kernel.shape[0], *out_shape))


def _patches(b: Builder, node: Node, x: View, shape: Sequence[int]) -> tuple[np.ndarray, bool]:
    """Positions in x read for each output place: (*places, channels, prod(shape)); x.size stands for the padding."""
    rank = len(shape)
    given = node.attributes
    strides, dilations = given.get("strides", [1] * rank), given.get("dilations", [1] * rank)
    spans = [(n - 1) * d + 1 for n, d in zip(shape, dilations, strict=True)]
    pads = given.get("pads", [0] * (2 * rank))
    if given.get("auto_pad", "NOTSET").startswith("SAME"):
        pads = _same(x.shape[2:], strides, spans, given["auto_pad"] == "SAME_LOWER")
    if given.get("ceil_mode", 0):
        raise node.refuse("ceil_mode is not supported")
    width = [(0, 0), *zip(pads[:rank], pads[rank:], strict=True)]
    b.room([x.shape[1], *(n + sum(pair) for n, pair in zip(x.shape[2:], width[1:], strict=True)), prod(shape)])
    grid = np.pad(np.arange(x.size).reshape(x.shape[1:]), width, constant_values=x.size)
    windows = np.lib.stride_tricks.sliding_window_view(grid, spans, axis=tuple(range(1, rank + 1)))
    windows = windows[
        (slice(None), *(slice(None, None, s) for s in strides), *(slice(None, None, d) for d in dilations))
    ]
    windows = np.moveaxis(windows, 0, rank)
    return windows.reshape(*windows.shape[: rank + 1], -1), any(pads)


def _same(lengths: Sequence[int], strides: Sequence[int], spans: Sequence[int], lower: bool) -> list[int]:
    """Pads that give ceil(length / stride) places: first those before, then those behind; an odd one behind."""
    total = [max((-(-n // s) - 1) * s + span - n, 0) for n, s, span in zip(lengths, strides, spans, strict=True)]
    small, large = [n // 2 for n in total], [n - n // 2 for n in total]
    return [*large, *small] if lower else [*small, *large]


@operator("MaxPool", "AveragePool")
def _pool(b: Builder, node: Node) -> View:
    x, shape = node.operand(0), node.attributes["kernel_shape"]
    if x.shape[0] != 1 or any(node.outputs[1:]):
        raise node.refuse("only a batch of one, without the index output, is supported")
    places, outside = _patches(b, node, x, shape)
    if outside:
        raise node.refuse("padding is not supported here")
    rank = len(shape)
    patches = b.table(x, np.moveaxis(places, rank, 0))
    last = len(patches.shape) - 1
    if node.operator == "MaxPool":
        out = b.reduce("max", patches, [last], False)
    else:
        out = b.apply("div", b.reduce("sum", patches, [last], False), b.constant(float(prod(shape))))
    return b.reshape(out, (1, *out.shape))


@operator("GlobalAveragePool")
def _global_average_pool(b: Builder, node: Node) -> View:
    x = node.operand(0)
    axes = list(range(2, len(x.shape)))
    return b.apply("div", b.reduce("sum", x, axes, True), b.constant(float(prod(x.shape[2:]))))
