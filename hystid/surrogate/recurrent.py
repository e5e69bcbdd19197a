"""LSTM, GRU and plain recurrent layers: the time steps of a fixed-length sequence, one after the other.

Equations and gate order as in the ONNX operator set. A surrogate steps a sequence of length 1 and carries the state.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from hystid.surrogate.operators import Node, operator
from hystid.surrogate.program import Builder
from hystid.surrogate.tensors import View

Step = Callable[["Layer", View, tuple[View, ...]], tuple[View, ...]]
_ACTIVATIONS = {"Tanh": "tanh", "Sigmoid": "sigmoid", "Relu": "relu"}


@dataclass(frozen=True)
class Layer:
    """One direction of a recurrent layer. W: (gates H, inputs), Rw: (gates H, H), bias: Wb and Rb, (gates H,) each."""

    b: Builder
    weights: View
    recurrent: View
    bias: tuple[View, View] | None
    hidden: int
    activations: tuple[str, ...]
    reset_first: bool

    def gates(self, x: View, h: View) -> View:
        """W x + Wb + R h + Rb, shape (batch, gates H)."""
        ours = self.b.matmul(x, self.weights.transpose((1, 0)), self._row(0))
        return self.b.apply("add", ours, self.b.matmul(h, self.recurrent.transpose((1, 0)), self._row(1)))

    def part(self, gates: View, number: int) -> View:
        """One gate's columns."""
        return gates.slice(1, number * self.hidden, (number + 1) * self.hidden)

    def rows(self, view: View, first: int, last: int) -> View:
        """Rows of a weight matrix or bias that belong to gates first .. last."""
        return view.slice(0, first * self.hidden, (last + 1) * self.hidden)

    def _row(self, number: int) -> View | None:
        return None if self.bias is None else self.bias[number]


def _lstm(layer: Layer, x: View, state: tuple[View, ...]) -> tuple[View, ...]:
    b, (f, g, h_act) = layer.b, layer.activations
    h, c = state
    gates = layer.gates(x, h)
    inputs, outputs, forget = (b.apply(f, layer.part(gates, n)) for n in (0, 1, 2))
    candidate = b.apply(g, layer.part(gates, 3))
    c = b.apply("add", b.apply("mul", forget, c), b.apply("mul", inputs, candidate))
    return b.apply("mul", outputs, b.apply(h_act, c)), c


def _gru(layer: Layer, x: View, state: tuple[View, ...]) -> tuple[View, ...]:
    b, (f, g) = layer.b, layer.activations
    (h,) = state
    wx = b.matmul(x, layer.weights.transpose((1, 0)), None if layer.bias is None else layer.bias[0])
    first_two = b.matmul(h, layer.rows(layer.recurrent, 0, 1).transpose((1, 0)), _bias(layer, 0, 1))
    update = b.apply(f, b.apply("add", layer.part(wx, 0), layer.part(first_two, 0)))
    reset = b.apply(f, b.apply("add", layer.part(wx, 1), layer.part(first_two, 1)))
    last = layer.rows(layer.recurrent, 2, 2).transpose((1, 0))
    if layer.reset_first:
        memory = b.matmul(b.apply("mul", reset, h), last, _bias(layer, 2, 2))
    else:
        memory = b.apply("mul", reset, b.matmul(h, last, _bias(layer, 2, 2)))
    candidate = b.apply(g, b.apply("add", layer.part(wx, 2), memory))
    kept = b.apply("mul", update, h)
    return (b.apply("add", b.apply("mul", b.apply("sub", b.constant(1.0), update), candidate), kept),)


def _bias(layer: Layer, first: int, last: int) -> View | None:
    return None if layer.bias is None else layer.rows(layer.bias[1], first, last)


def _rnn(layer: Layer, x: View, state: tuple[View, ...]) -> tuple[View, ...]:
    return (layer.b.apply(layer.activations[0], layer.gates(x, state[0])),)


_STEPS: dict[str, tuple[Step, int, tuple[str, ...], tuple[int, ...]]] = {
    "LSTM": (_lstm, 4, ("Sigmoid", "Tanh", "Tanh"), (5, 6)),
    "GRU": (_gru, 3, ("Sigmoid", "Tanh"), (5,)),
    "RNN": (_rnn, 1, ("Tanh",), (5,)),
}  # step, gates, default activations, positions of the initial states


@operator("LSTM", "GRU", "RNN")
def _recurrent(b: Builder, node: Node) -> list[View]:
    step, gates, default, initial = _STEPS[node.operator]
    _check(node)
    x = node.operand(0)
    x = x.transpose((1, 0, 2)) if node.attributes.get("layout", 0) else x
    length, batch = x.shape[:2]
    hidden = node.operand(2).shape[-1]
    order = node.attributes.get("direction", "forward")
    directions = 2 if order == "bidirectional" else 1
    outputs: list[list[View]] = [[] for _ in range(length)]
    finals: list[list[View]] = [[] for _ in initial]
    for direction in range(directions):
        layer = _layer(b, node, direction, gates, hidden, default)
        state = tuple(_start(b, node, place, direction, (batch, hidden)) for place in initial)
        backward = order == "reverse" or direction == 1
        for t in reversed(range(length)) if backward else range(length):
            state = step(layer, x.pick(0, t), state)
            outputs[t].append(state[0])
        for final, value in zip(finals, state, strict=True):
            final.append(value)
    results = [_stack(b, [_stack(b, row) for row in outputs]), *(_stack(b, final) for final in finals)]
    if node.attributes.get("layout", 0):
        results = [results[0].transpose((2, 0, 1, 3)), *(view.transpose((1, 0, 2)) for view in results[1:])]
    return results[: len(node.outputs)]


def _stack(b: Builder, views: list[View]) -> View:
    """Along a new first axis."""
    raised = [b.reshape(view, (1, *view.shape)) for view in views]
    return raised[0] if len(raised) == 1 else b.concat(raised, 0)


def _check(node: Node) -> None:
    if node.has(4):
        raise node.refuse("sequence_lens is not supported: all sequences have the length of the input")
    if node.has(7) or node.attributes.get("clip") or node.attributes.get("input_forget"):
        raise node.refuse("peepholes, clip and input_forget are not supported")


def _layer(b: Builder, node: Node, direction: int, gates: int, hidden: int, default: tuple[str, ...]) -> Layer:
    names = node.attributes.get("activations") or default * (direction + 1)
    chosen = names[direction * len(default) : (direction + 1) * len(default)]
    unknown = [name for name in chosen if name not in _ACTIVATIONS]
    if unknown:
        raise node.refuse(f"activation {unknown[0]} is not supported, only {', '.join(_ACTIVATIONS)}")
    bias = None
    if node.has(3):
        both = node.operand(3).pick(0, direction)
        bias = (both.slice(0, 0, gates * hidden), both.slice(0, gates * hidden, 2 * gates * hidden))
    return Layer(
        b,
        node.operand(1).pick(0, direction),
        node.operand(2).pick(0, direction),
        bias,
        hidden,
        tuple(_ACTIVATIONS[name] for name in chosen),
        not node.attributes.get("linear_before_reset", 0),
    )


def _start(b: Builder, node: Node, place: int, direction: int, shape: tuple[int, int]) -> View:
    if not node.has(place):
        return b.constant([[0.0] * shape[1]] * shape[0])
    given = node.operand(place)
    return given.pick(1 if node.attributes.get("layout", 0) else 0, direction)
