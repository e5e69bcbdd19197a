"""ONNX operators in terms of the builder: one small function each, found by (domain, operator name).

Shapes, axes, indices and the like must be constant; what a rule cannot do it refuses through ``Node.refuse``.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from math import prod
from typing import Any

import numpy as np

from hystid.errors import NetworkError
from hystid.surrogate.program import Builder
from hystid.surrogate.tensors import Kind, View


@dataclass(frozen=True)
class Node:
    """One ONNX node with its operands resolved; an omitted optional operand is None.

    outputs: names of its results, "" for those that nobody wants.
    """

    name: str
    operator: str
    operands: tuple[View | None, ...]
    attributes: Mapping[str, Any]
    outputs: tuple[str, ...]
    opset: int

    def refuse(self, why: str) -> NetworkError:
        """The error to raise when this node cannot be compiled."""
        return NetworkError(f"node '{self.name}' ({self.operator}): {why}")

    def has(self, position: int) -> bool:
        """Whether the operand at this position is given."""
        return position < len(self.operands) and self.operands[position] is not None

    def operand(self, position: int) -> View:
        """A required operand."""
        view = self.operands[position] if position < len(self.operands) else None
        if view is None:
            raise self.refuse(f"input {position} is missing")
        return view

    def all(self) -> tuple[View, ...]:
        """All operands, each required."""
        return tuple(self.operand(position) for position in range(len(self.operands)))

    def constants(self, position: int, what: str) -> list[Any]:
        """Values of an operand that must be known while compiling, as a flat list."""
        view = self.operand(position)
        if not view.is_constant:
            raise self.refuse(f"{what} must be constant, found a computed tensor")
        return list(view.numpy().reshape(-1).tolist())

    def integers(self, what: str, position: int) -> list[int] | None:
        """Whole numbers given as an attribute (old operator sets) or a constant operand (new ones); None if neither."""
        if what in self.attributes:
            value = self.attributes[what]
            return [int(v) for v in value] if isinstance(value, Sequence) else [int(value)]
        return [int(v) for v in self.constants(position, what)] if self.has(position) else None

    def number(self, what: str, default: float) -> float:
        """A number given as an attribute. The standard keeps these, and their defaults, in single precision."""
        return float(np.float32(self.attributes.get(what, default)))

    def axis(self, axis: int, rank: int) -> int:
        """A possibly negative axis, checked and counted from the front."""
        if not -rank <= axis < max(rank, 1):
            raise self.refuse(f"axis {axis} does not exist in a tensor of rank {rank}")
        return axis % max(rank, 1)


Result = View | Sequence[View]
Rule = Callable[[Builder, Node], Result]
OPERATORS: dict[tuple[str, str], Rule] = {}


def operator(*names: str, domain: str = "") -> Callable[[Rule], Rule]:
    """Register a rule for one or more operator names."""

    def register(rule: Rule) -> Rule:
        for name in names:
            OPERATORS[domain, name] = rule
        return rule

    return register


_DIRECT = {
    "Abs": "abs", "Acos": "acos", "Add": "add", "And": "and", "Asin": "asin", "Asinh": "asinh", "Atan": "atan",
    "Ceil": "ceil", "Cos": "cos", "Cosh": "cosh", "Equal": "equal", "Erf": "erf", "Exp": "exp", "Floor": "floor",
    "Greater": "greater", "GreaterOrEqual": "greater_equal", "IsNaN": "isnan", "Less": "less",
    "LessOrEqual": "less_equal", "Log": "log", "Mul": "mul", "Neg": "neg", "Not": "not", "Or": "or", "Pow": "pow",
    "PRelu": "leaky", "Reciprocal": "reciprocal", "Relu": "relu", "Round": "round", "Sigmoid": "sigmoid",
    "Sign": "sign", "Sin": "sin", "Sinh": "sinh", "Softplus": "softplus", "Sqrt": "sqrt", "Sub": "sub", "Tan": "tan",
    "Tanh": "tanh", "Where": "select", "Xor": "xor",
}  # fmt: skip


@operator(*_DIRECT)
def _direct(b: Builder, node: Node) -> View:
    return b.apply(_DIRECT[node.operator], *node.all())


@operator("Min", "Max", "Sum", "Mean")
def _variadic(b: Builder, node: Node) -> View:
    function = {"Min": "min", "Max": "max"}.get(node.operator, "add")
    total, *rest = node.all()
    for view in rest:
        total = b.apply(function, total, view)
    return b.apply("div", total, b.constant(float(len(rest) + 1))) if node.operator == "Mean" else total


@operator("Div")
def _div(b: Builder, node: Node) -> View:
    whole = all(view.kind == "int" for view in node.all())
    return b.apply("div_int" if whole else "div", *node.all())


@operator("Mod")
def _mod(b: Builder, node: Node) -> View:
    return b.apply("fmod" if node.attributes.get("fmod", 0) else "mod", *node.all())


@operator("LeakyRelu")
def _leaky_relu(b: Builder, node: Node) -> View:
    return b.apply("leaky", node.operand(0), b.constant(node.number("alpha", 0.01)))


@operator("ThresholdedRelu")
def _thresholded_relu(b: Builder, node: Node) -> View:
    x = node.operand(0)
    return b.apply("select", b.apply("greater", x, b.constant(node.number("alpha", 1.0))), x, b.constant(0.0))


@operator("Elu", "Selu", "Celu")
def _elu(b: Builder, node: Node) -> View:
    """gain (x where x >= 0, else alpha (exp(x / scale) - 1))"""
    x = node.operand(0)
    alpha = node.number("alpha", 1.6732631921768188 if node.operator == "Selu" else 1.0)
    gain = node.number("gamma", 1.0507010221481323 if node.operator == "Selu" else 1.0)
    scale = alpha if node.operator == "Celu" else 1.0
    negative = b.apply("min", x, b.constant(0.0))  # keeps exp finite on the side that is not used
    curve = b.apply("mul", b.constant(alpha), b.apply("expm1", b.apply("div", negative, b.constant(scale))))
    y = b.apply("select", b.apply("less", x, b.constant(0.0)), curve, x)
    return y if gain == 1.0 else b.apply("mul", y, b.constant(gain))


@operator("Softsign")
def _softsign(b: Builder, node: Node) -> View:
    x = node.operand(0)
    return b.apply("div", x, b.apply("add", b.constant(1.0), b.apply("abs", x)))


@operator("HardSigmoid")
def _hard_sigmoid(b: Builder, node: Node) -> View:
    alpha, beta = node.number("alpha", 0.2), node.number("beta", 0.5)
    return b.apply("hard_sigmoid", node.operand(0), b.constant(alpha), b.constant(beta))


@operator("HardSwish")
def _hard_swish(b: Builder, node: Node) -> View:
    x = node.operand(0)
    return b.apply("mul", x, b.apply("hard_sigmoid", x, b.constant(node.number("alpha", 1.0 / 6.0)), b.constant(0.5)))


@operator("Gelu")
def _gelu(b: Builder, node: Node) -> View:
    """x Phi(x), exactly or by the tanh formula of Hendrycks and Gimpel (2016)."""
    x = node.operand(0)
    if node.attributes.get("approximate", "none") == "tanh":
        cubic = b.apply("mul", b.constant(0.044715), b.apply("mul", x, b.apply("square", x)))
        inner = b.apply("tanh", b.apply("mul", b.constant(float(np.sqrt(2 / np.pi))), b.apply("add", x, cubic)))
    else:
        inner = b.apply("erf", b.apply("mul", x, b.constant(float(np.sqrt(0.5)))))
    half = b.apply("mul", b.constant(0.5), x)
    return b.apply("mul", half, b.apply("add", b.constant(1.0), inner))


@operator("Mish")
def _mish(b: Builder, node: Node) -> View:
    x = node.operand(0)
    return b.apply("mul", x, b.apply("tanh", b.apply("softplus", x)))


@operator("Clip")
def _clip(b: Builder, node: Node) -> View:
    y = node.operand(0)
    for position, (bound, function) in enumerate((("min", "max"), ("max", "min")), start=1):
        if bound in node.attributes:
            y = b.apply(function, y, b.constant(node.attributes[bound]))
        elif node.has(position):
            y = b.apply(function, y, node.operand(position))
    return y


@operator("Identity", "Dropout")
def _identity(b: Builder, node: Node) -> View:
    if node.operator == "Dropout" and any(node.outputs[1:]):
        raise node.refuse("its mask output is not supported")
    return node.operand(0)


_KINDS: dict[int, Kind] = {1: "float", 10: "float", 11: "float", 16: "float", 9: "bool"}
_KINDS.update(dict.fromkeys((2, 3, 4, 5, 6, 7, 12, 13), "int"))


@operator("Cast", "CastLike")
def _cast(b: Builder, node: Node) -> View:
    """Between float widths nothing happens: all numbers are doubles."""
    view = node.operand(0)
    kind = node.operand(1).kind if node.operator == "CastLike" else _KINDS.get(node.attributes["to"])
    if kind is None:
        raise node.refuse(f"element type {node.attributes['to']} is not a number")
    if kind == "bool" and view.kind != "bool":
        return b.apply("truth", view)
    if kind == "int" and view.kind == "float":
        return b.apply("trunc", view).as_kind("int")
    return b.constant(view.numpy().astype(float)).as_kind(kind) if view.is_constant else view.as_kind(kind)


@operator("Constant")
def _constant(b: Builder, node: Node) -> View:
    for key in ("value", "value_float", "value_floats", "value_int", "value_ints"):
        if key in node.attributes:
            return b.constant(node.attributes[key])
    raise node.refuse("only numeric constants are supported")


@operator("ConstantOfShape")
def _constant_of_shape(b: Builder, node: Node) -> View:
    value = np.asarray(node.attributes.get("value", np.zeros(1))).reshape(-1)[0]
    shape = [int(n) for n in node.constants(0, "the shape")]
    b.room(shape)
    return b.constant(np.full(shape, value))


@operator("Range")
def _range(b: Builder, node: Node) -> View:
    start, stop, step = (node.constants(i, "each bound")[0] for i in range(3))
    b.room([max(math.ceil((stop - start) / step), 0)])
    return b.constant(np.arange(start, stop, step))


@operator("Gemm")
def _gemm(b: Builder, node: Node) -> View:
    """alpha A' B' + beta C"""
    a, w = node.operand(0), node.operand(1)
    if len(a.shape) != 2 or len(w.shape) != 2:
        raise node.refuse(f"operands must be matrices, not of shapes {list(a.shape)} and {list(w.shape)}")
    a = a.transpose((1, 0)) if node.attributes.get("transA", 0) else a
    w = w.transpose((1, 0)) if node.attributes.get("transB", 0) else w
    if a.shape[1] != w.shape[0]:
        raise node.refuse(f"shapes {list(a.shape)} and {list(w.shape)} do not match")
    alpha, beta = node.number("alpha", 1.0), node.number("beta", 1.0)
    if alpha != 1.0:
        w = b.apply("mul", w, b.constant(alpha))
    bias = node.operand(2) if node.has(2) else None
    if bias is not None and beta != 1.0:
        bias = b.apply("mul", bias, b.constant(beta))
    return b.matmul(a, w, bias)


@operator("MatMul")
def _matmul(b: Builder, node: Node) -> View:
    """NumPy's rule: one-dimensional operands are promoted, leading axes broadcast."""
    a, w = node.operand(0), node.operand(1)
    if not a.shape or not w.shape:
        raise node.refuse("operands must have at least one axis")
    left = b.reshape(a, (1, *a.shape)) if len(a.shape) == 1 else a
    right = b.reshape(w, (*w.shape, 1)) if len(w.shape) == 1 else w
    if left.shape[-1] != right.shape[-2]:
        raise node.refuse(f"shapes {list(a.shape)} and {list(w.shape)} do not match")
    product = _batched(b, left, right)
    shape = list(product.shape)
    if len(w.shape) == 1:
        del shape[-1]
    if len(a.shape) == 1:
        del shape[-1 if len(w.shape) == 1 else -2]
    return b.reshape(product, shape)


def _batched(b: Builder, left: View, right: View) -> View:
    batch = np.broadcast_shapes(left.shape[:-2], right.shape[:-2])
    if prod(batch) == 1 or len(right.shape) == 2:  # one product: leading axes of the left operand are just more rows
        rows = b.reshape(left, (prod(left.shape[:-1]), left.shape[-1]))
        product = b.matmul(rows, b.reshape(right, right.shape[-2:]))
        return b.reshape(product, (*batch, left.shape[-2], right.shape[-1]))
    left, right = left.expand((*batch, *left.shape[-2:])), right.expand((*batch, *right.shape[-2:]))
    out = b.local((*batch, left.shape[-2], right.shape[-1]))
    for index in np.ndindex(*batch):
        parts = [left, right, out]
        for place in index:
            parts = [part.pick(0, place) for part in parts]
        b.product_into(parts[2], parts[0], parts[1])
    return out


@operator("ReduceSum", "ReduceMean", "ReduceMax", "ReduceMin", "ReduceSumSquare", "ReduceL1", "ReduceL2")
def _reduce(b: Builder, node: Node) -> View:
    x, rank = node.operand(0), len(node.operand(0).shape)
    given = node.integers("axes", 1)
    if not given and node.attributes.get("noop_with_empty_axes", 0):
        return x
    axes = sorted({node.axis(axis, rank) for axis in given} if given else range(rank))
    keep = bool(node.attributes.get("keepdims", 1))
    kind = node.operator.removeprefix("Reduce")
    if kind in ("SumSquare", "L2"):
        x = b.apply("square", x)
    elif kind == "L1":
        x = b.apply("abs", x)
    total = reduce_axes(b, "max" if kind == "Max" else "min" if kind == "Min" else "sum", x, axes, keep)
    if kind == "Mean":
        return b.apply("div", total, b.constant(float(prod(x.shape[axis] for axis in axes))))
    return b.apply("sqrt", total) if kind == "L2" else total


def reduce_axes(b: Builder, function: Any, x: View, axes: Sequence[int], keep: bool = True) -> View:
    """A reduction, or the tensor itself where there is nothing to reduce over."""
    return b.reduce(function, x, axes, keep) if axes else x


@operator("Softmax", "LogSoftmax")
def _softmax(b: Builder, node: Node) -> View:
    x = node.operand(0)
    rank = len(x.shape)
    axis = node.axis(node.attributes.get("axis", -1 if node.opset >= 13 else 1), rank)
    axes = [axis] if node.opset >= 13 else list(range(axis, rank))  # older sets flatten behind the axis
    shifted = b.apply("sub", x, reduce_axes(b, "max", x, axes))
    powers = b.apply("exp", shifted)
    total = reduce_axes(b, "sum", powers, axes)
    if node.operator == "LogSoftmax":
        return b.apply("sub", shifted, b.apply("log", total))
    return b.apply("div", powers, total)


@operator("LayerNormalization")
def _layer_normalization(b: Builder, node: Node) -> View:
    x, rank = node.operand(0), len(node.operand(0).shape)
    if any(node.outputs[1:]):
        raise node.refuse("its mean and deviation outputs are not supported")
    axes = list(range(node.axis(node.attributes.get("axis", -1), rank), rank))
    scaled = b.apply("mul", _normalised(b, x, axes, node.number("epsilon", 1e-5)), node.operand(1))
    return b.apply("add", scaled, node.operand(2)) if node.has(2) else scaled


@operator("InstanceNormalization")
def _instance_normalization(b: Builder, node: Node) -> View:
    """Each channel by its own mean and variance."""
    x, channel = node.operand(0), (-1, *[1] * (len(node.operand(0).shape) - 2))
    axes = list(range(2, len(x.shape)))
    scaled = _normalised(b, x, axes, node.number("epsilon", 1e-5))
    scale, shift = (b.reshape(node.operand(i), (node.operand(i).size, *channel[1:])) for i in (1, 2))
    return b.apply("add", b.apply("mul", scaled, scale), shift)


def _normalised(b: Builder, x: View, axes: Sequence[int], epsilon: float) -> View:
    """(x - mean) / sqrt(variance + epsilon) over some axes."""
    count = b.constant(float(prod(x.shape[axis] for axis in axes)))
    centred = b.apply("sub", x, b.apply("div", b.reduce("sum", x, axes, True), count))
    variance = b.apply("div", b.reduce("sum", b.apply("square", centred), axes, True), count)
    return b.apply("div", centred, b.apply("sqrt", b.apply("add", variance, b.constant(epsilon))))


@operator("Einsum")
def _einsum(b: Builder, node: Node) -> View:
    """Products over all index letters, summed over those that the result does not name; no ellipsis."""
    left, arrow, result = node.attributes["equation"].replace(" ", "").partition("->")
    terms = left.split(",")
    if "." in left or any(len(set(term)) != len(term) for term in (*terms, result)):
        raise node.refuse("an equation with an ellipsis or a repeated index is not supported")
    letters = sorted(set(left) - {","})
    if not arrow:
        result = "".join(letter for letter in letters if left.count(letter) == 1)
    order = [*result, *(letter for letter in letters if letter not in result)]
    total = _spread(b, node.operand(0), terms[0], order)
    for place, term in enumerate(terms[1:], start=1):
        total = b.apply("mul", total, _spread(b, node.operand(place), term, order))
    return reduce_axes(b, "sum", total, list(range(len(result), len(order))), keep=False)


def _spread(b: Builder, x: View, term: str, order: Sequence[str]) -> View:
    """Axes in the order of the letters, with length 1 where the term has none."""
    turned = x.transpose([term.index(letter) for letter in order if letter in term])
    sizes = iter(turned.shape)
    return b.reshape(turned, [next(sizes) if letter in term else 1 for letter in order])


@operator("BatchNormalization")
def _batch_normalization(b: Builder, node: Node) -> View:
    """With the stored mean and variance, as at inference: (x - mean) scale / sqrt(variance + epsilon) + shift."""
    x = node.operand(0)
    if node.attributes.get("training_mode", 0):
        raise node.refuse("training mode cannot be exported")
    channel = (-1, *[1] * (len(x.shape) - 2))
    scale, shift, mean, variance = (np.asarray(node.constants(i, "each parameter")) for i in range(1, 5))
    gain = scale / np.sqrt(variance + node.number("epsilon", 1e-5))
    scaled = b.apply("mul", x, b.constant(gain.reshape(channel)))
    return b.apply("add", scaled, b.constant((shift - mean * gain).reshape(channel)))


@operator("Scaler", domain="ai.onnx.ml")
def _scaler(b: Builder, node: Node) -> View:
    centred = b.apply("sub", node.operand(0), b.constant(np.asarray(node.attributes["offset"], dtype=float)))
    return b.apply("mul", centred, b.constant(np.asarray(node.attributes["scale"], dtype=float)))


@operator("LinearRegressor", domain="ai.onnx.ml")
def _linear_regressor(b: Builder, node: Node) -> View:
    targets = node.attributes.get("targets", 1)
    if node.attributes.get("post_transform", "NONE") != "NONE":
        raise node.refuse("post_transform is not supported")
    weights = np.asarray(node.attributes["coefficients"], dtype=float).reshape(targets, -1)
    intercepts = np.asarray(node.attributes.get("intercepts", np.zeros(targets)), dtype=float)
    return b.matmul(node.operand(0), b.constant(weights.T), b.constant(intercepts))
