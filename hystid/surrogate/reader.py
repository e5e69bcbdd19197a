"""ONNX model -> ``Program``: sizes fixed, nodes in order, operators translated one by one."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cache
from math import prod
from typing import Any

import numpy as np
from onnx import (
    AttributeProto,
    GraphProto,
    ModelProto,
    NodeProto,
    TensorProto,
    ValueInfoProto,
    helper,
    inliner,
    numpy_helper,
)

from hystid.errors import NetworkError
from hystid.limits import compiled, room_for
from hystid.surrogate import layout, recurrent  # noqa: F401  (they register their operators)
from hystid.surrogate.identifiers import readable
from hystid.surrogate.operators import OPERATORS, Node
from hystid.surrogate.program import MOST_ELEMENTS, Builder, Port, Program
from hystid.surrogate.tensors import Buffer, Kind, View, whole

MOST_CONSTANTS = 500_000
MOST_STATEMENTS = 20_000
_MOST_NODES = 10 * MOST_STATEMENTS  # with functions written out, which takes a second: few nodes make no statement

_KINDS: dict[int, Kind] = {
    TensorProto.FLOAT: "float",
    TensorProto.DOUBLE: "float",
    TensorProto.FLOAT16: "float",
    TensorProto.BFLOAT16: "float",
    TensorProto.INT32: "int",
    TensorProto.INT64: "int",
    TensorProto.BOOL: "bool",
}


def program(model: ModelProto, name: str, sizes: Mapping[str, int] | None = None) -> Program:
    """Translate a checked ONNX model; name: as messages call it.

    Every axis of unknown length gets 1 (a batch of one, a sequence of one step), or its entry in ``sizes`` where the
    axis has a name. All arithmetic is in double precision whatever the element types of the file.
    Raises NetworkError naming the node and operator that cannot be compiled, or the limit that the network exceeds.
    """
    return compiled(f"the network '{name}'", lambda: _program(model, sizes), NetworkError)


def _program(model: ModelProto, sizes: Mapping[str, int] | None) -> Program:
    if model.functions:
        _check_functions(model)
        model = inliner.inline_local_functions(model)
    graph = model.graph
    if graph.sparse_initializer:
        raise NetworkError("the network has sparse initialisers, which are not supported: store them dense")
    opsets = {entry.domain: entry.version for entry in model.opset_import}
    builder, tensors = Builder(), _constants(graph)
    known = {key: _declare(builder, key, values) for key, values in tensors.items()}
    inputs = [_input(builder, info, sizes or {}) for info in graph.input if info.name not in known]
    known.update({port.name: port.view for port in inputs})
    for number, node in enumerate(graph.node):
        _translate(builder, node, number, known, opsets)
    missing = [info.name for info in graph.output if info.name not in known]
    if missing:
        raise NetworkError(f"output '{missing[0]}' of the network is computed by no node")
    outputs = [(info.name, known[info.name]) for info in graph.output]
    return builder.finish(inputs, outputs)


def _check_functions(model: ModelProto) -> None:
    """Raise NetworkError where functions that call functions would be written out to too many nodes."""
    bodies = {(one.domain, one.name, getattr(one, "overload", "")): one.node for one in model.functions}

    @cache
    def inside(key: tuple[str, str, str]) -> int:
        return sum(map(size, bodies[key]))

    def size(node: NodeProto) -> int:
        graphs = [graph for attribute in node.attribute for graph in (attribute.g, *attribute.graphs)]
        key = (node.domain, node.op_type, getattr(node, "overload", ""))
        return sum(size(part) for graph in graphs for part in graph.node) + (inside(key) if key in bodies else 1)

    if (nodes := sum(map(size, model.graph.node))) > _MOST_NODES:
        raise NetworkError(
            f"the network has {nodes} nodes with its functions written out, more than {_MOST_NODES}: use a smaller one"
        )


def _constants(graph: GraphProto) -> dict[str, np.ndarray[Any, Any]]:
    total = sum(prod(tensor.dims) for tensor in graph.initializer)
    if total > MOST_CONSTANTS:
        raise NetworkError(
            f"the network has {total} weights, more than the {MOST_CONSTANTS} that are compiled into C: "
            "use a smaller network, or run this one in an ONNX runtime"
        )
    room_for(total)  # more would have been refused
    return {tensor.name: _numbers(tensor, f"initialiser '{readable(tensor.name)}'") for tensor in graph.initializer}


def _numbers(tensor: TensorProto, what: str) -> np.ndarray[Any, Any]:
    try:
        values = np.asarray(numpy_helper.to_array(tensor))
        if values.dtype.kind == "c":
            raise ValueError("complex numbers")
        return values if values.dtype.kind in "iub" else values.astype(np.float64)
    except Exception as error:  # onnx raises whatever its decoder ran into
        raise NetworkError(f"{what} cannot be read as numbers: {readable(str(error))}") from error


def _declare(builder: Builder, name: str, values: np.ndarray[Any, Any]) -> View:
    builder.hint = name
    return builder.constant(values)


def _input(builder: Builder, info: ValueInfoProto, sizes: Mapping[str, int]) -> Port:
    kind = _KINDS.get(info.type.tensor_type.elem_type)
    if kind is None or not info.type.HasField("tensor_type"):
        raise NetworkError(f"input '{readable(info.name)}' of the network is no tensor of float, int or bool")
    if not info.type.tensor_type.HasField("shape"):
        raise NetworkError(f"input '{readable(info.name)}' of the network has no shape")
    shape = [
        axis.dim_value if axis.HasField("dim_value") and axis.dim_value > 0 else sizes.get(axis.dim_param, 1)
        for axis in info.type.tensor_type.shape.dim
    ]
    if prod(shape) > MOST_ELEMENTS:
        raise NetworkError(f"input '{readable(info.name)}' has {prod(shape)} elements, more than {MOST_ELEMENTS}")
    buffer = Buffer(builder.names.unique("in_" + info.name), prod(shape), "input")
    return Port(info.name, whole(buffer, shape, kind))


def _translate(
    builder: Builder, proto: NodeProto, number: int, known: dict[str, View], opsets: Mapping[str, int]
) -> None:
    name, domain = readable(proto.name) or f"#{number}", "" if proto.domain == "ai.onnx" else proto.domain
    rule = OPERATORS.get((domain, proto.op_type))
    label = f"{domain}.{proto.op_type}" if domain else proto.op_type
    if rule is None:
        raise NetworkError(
            f"node '{name}' uses the operator {label}, which cannot be compiled to C; "
            "docs/surrogate.md lists those that can"
        )
    unknown = [key for key in proto.input if key and key not in known]
    if unknown:
        raise NetworkError(f"node '{name}' ({label}) reads '{readable(unknown[0])}', which nothing before it computes")
    node = Node(
        name,
        label,
        tuple(known[key] if key else None for key in proto.input),
        {attribute.name: _attribute(attribute, name) for attribute in proto.attribute},
        tuple(proto.output),
        opsets.get(proto.domain, opsets.get(domain, 1)),
    )
    builder.note, builder.hint = f"{name} ({label})", proto.output[0]
    try:
        result = rule(builder, node)
    except (ValueError, IndexError, KeyError, TypeError, ZeroDivisionError, AssertionError) as error:
        raise node.refuse(f"cannot be compiled: {_reason(error)}") from error
    views: Sequence[View] = [result] if isinstance(result, View) else result
    known.update({key: view for key, view in zip(proto.output, views, strict=False) if key})
    _limit(builder, node, views)


def _reason(error: Exception) -> str:
    text = readable(str(error))
    return f"attribute {text} is missing" if isinstance(error, KeyError) else text or type(error).__name__


def _attribute(attribute: AttributeProto, node: str) -> Any:
    if attribute.type == AttributeProto.TENSOR:
        return _numbers(attribute.t, f"the constant of node '{node}'")
    value = helper.get_attribute_value(attribute)
    if isinstance(value, bytes):
        return value.decode(errors="replace")
    return [v.decode(errors="replace") if isinstance(v, bytes) else v for v in value] if _is_list(value) else value


def _is_list(value: Any) -> bool:
    return isinstance(value, Sequence) and not isinstance(value, str)


def _limit(builder: Builder, node: Node, views: Sequence[View]) -> None:
    if any(view.size > MOST_ELEMENTS for view in views):
        raise node.refuse(f"its result has more than {MOST_ELEMENTS} elements, which is too large to compile")
    if len(builder.statements) > MOST_STATEMENTS:
        raise node.refuse(f"the network needs more than {MOST_STATEMENTS} statements, which is too large to compile")
