"""ONNX files: writing an identified model as one stateful step, and reading files at the door.

The step has float64 inputs ``x`` (batch,), ``v`` (batch,), ``state`` (batch, n) and outputs ``R`` (batch,),
``state_next`` (batch, n). To evaluate a recording, call it sample by sample with a batch of 1 and feed ``state_next``
back as ``state``; a larger batch steps independent recordings side by side. The turning-point rule and the mean over
the ensemble are inside.

Metadata are strings; those with structure are JSON. ``metadata_of`` lists them.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import onnx
from onnx import GraphProto, ModelProto, NodeProto, TensorProto, ValueInfoProto, helper, numpy_helper

from hystid.errors import NetworkError
from hystid.files import atomic

if TYPE_CHECKING:
    from hystid.networks.network import Network, TwoNetworkModel

OPERATOR_SET = 17
IR_VERSION = 8  # read by every runtime since 2022
UNITS = {"x": "m", "v": "m/s", "R": "N", "mass": "kg", "sample_rate": "Hz", "velocity_band": "m/s"}
TURNING_POINTS = "turning_points"


@dataclass(frozen=True)
class StepDescription:
    """What a surrogate's ONNX file says about itself.

    mass [kg], 0 where the force itself was recorded. sample_rate [Hz] of the training data. training_range: least and
    greatest x [m], v [m/s] and, where given, R [N]. state_layout: name of each element of the state. initial_state: its
    relaxed start, one number each. memory: "turning_points" where element 0 is v_last and the memory is renewed where
    ``v_last v <= 0``; "" where the file does not say. metadata: all entries of the file, as the strings they are.
    """

    mass: float
    sample_rate: float
    training_range: Mapping[str, tuple[float, float]]
    state_layout: tuple[str, ...]
    initial_state: tuple[float, ...]
    memory: str
    metadata: Mapping[str, str]


def write(model: TwoNetworkModel, path: Path) -> None:
    """Write an identified model as one stateful step, float64, with everything that is needed to run it.

    The graph computes exactly the rule stated at ``TwoNetworkModel``. Raises NetworkError when a weight is not finite.
    """
    proto = helper.make_model(
        _graph(model),
        opset_imports=[helper.make_opsetid("", OPERATOR_SET)],
        ir_version=IR_VERSION,
        producer_name="hystid",
        producer_version=_version(),
        doc_string="Restoring force R [N] from displacement x [m], velocity v [m/s] and memory; one call per sample.",
    )
    helper.set_model_props(proto, metadata_of(model))
    _check_finite(proto, Path(path))
    onnx.checker.check_model(proto, full_check=True)
    with atomic(Path(path)) as beside:
        beside.write_bytes(proto.SerializeToString())


def metadata_of(model: TwoNetworkModel) -> dict[str, str]:
    """Metadata of the ONNX file: numbers as Python writes them, the rest as JSON."""
    members = len(model.members)
    layout = ["v_last", "x0", *(f"Rh[{j + 1}]" for j in range(members)), *(f"Rh0[{j + 1}]" for j in range(members))]
    return {
        "hystid_version": _version(),
        "units": json.dumps(UNITS),
        "mass": repr(float(model.mass)),
        "sample_rate": repr(float(model.sample_rate)),
        "velocity_band": repr(float(model.velocity_band)),
        "training_range": json.dumps(
            {name: [float(low), float(high)] for name, (low, high) in model.training_range.items()}
        ),
        "scaling": json.dumps(
            [{"hysteresis": _scaling(m.hysteresis), "restoring": _scaling(m.restoring)} for m in model.members]
        ),
        "layers": json.dumps(
            {"hysteresis": model.members[0].hysteresis.sizes, "restoring": model.members[0].restoring.sizes}
        ),
        "ensemble": str(members),
        "memory": TURNING_POINTS,
        "state_layout": json.dumps(layout),
        "initial_state": json.dumps([float(value) for value in model.initial_state()]),
        "identification": json.dumps(dict(model.metadata), default=str),
    }


def _version() -> str:
    try:
        return version("hystid")
    except PackageNotFoundError:
        return "unknown"


def _scaling(network: Network) -> dict[str, Any]:
    return {
        "input_offset": network.input_offset.tolist(),
        "input_gain": network.input_gain.tolist(),
        "output_offset": float(network.output_offset),
        "output_gain": float(network.output_gain),
    }


# writing


class _Graph:
    """Collects nodes and constants under readable names."""

    def __init__(self) -> None:
        self.nodes: list[NodeProto] = []
        self.constants: list[TensorProto] = []

    def constant(self, name: str, value: Any, kind: type = np.float64) -> str:
        """A stored array; returns its name."""
        self.constants.append(numpy_helper.from_array(np.asarray(value, dtype=kind), name))
        return name

    def node(self, operator: str, inputs: Sequence[str], output: str | Sequence[str], **attributes: Any) -> str:
        """A node called after its (first) output; returns that name."""
        outputs = [output] if isinstance(output, str) else list(output)
        self.nodes.append(helper.make_node(operator, list(inputs), outputs, name=outputs[0], **attributes))
        return outputs[0]


def _graph(model: TwoNetworkModel) -> GraphProto:
    g, members = _Graph(), len(model.members)
    first = g.constant("axis1", [1], np.int64)
    x = g.node("Unsqueeze", ["x", first], "x_column")
    v = g.node("Unsqueeze", ["v", first], "v_column")
    parts = g.constant("state_parts", [1, 1, members, members], np.int64)
    g.node("Split", ["state", parts], ["v_last", "x0_last", "Rh_last", "Rh0_last"], axis=1)
    turn = _turning_points(g, v, model.velocity_band)
    x0 = g.node("Where", [turn, x, "x0_last"], "x0")
    held = g.node("Where", [turn, "Rh_last", "Rh0_last"], "Rh0")
    each = [f"Rh0_{j + 1}" for j in range(members)]
    g.node("Split", [held, g.constant("one_each", [1] * members, np.int64)], each, axis=1)
    latest, forces = [], []
    for number, (member, memory) in enumerate(zip(model.members, each, strict=True), start=1):
        latest.append(_network(g, member.hysteresis, [x, x0, memory], f"member{number}/hysteresis"))
        forces.append(_network(g, member.restoring, [x, v, latest[-1]], f"member{number}/restoring"))
    g.node("Concat", ["v_last_next", x0, *latest, held], "state_next", axis=1)
    g.node("Concat", forces, "R_members", axis=1)
    g.node("ReduceMean", ["R_members"], "R", axes=[1], keepdims=0)
    inputs = [_port("x"), _port("v"), _port("state", 2 + 2 * members)]
    outputs = [_port("R"), _port("state_next", 2 + 2 * members)]
    return helper.make_graph(g.nodes, "restoring_force_step", inputs, outputs, g.constants)


def _port(name: str, *more: int) -> ValueInfoProto:
    return helper.make_tensor_value_info(name, TensorProto.DOUBLE, ["batch", *more])


def _turning_points(g: _Graph, v: str, band: float) -> str:
    """turn = v_last == 0 or (|v| >= band and v_last v <= 0); v_last_next = v if |v| >= band else v_last."""
    zero = g.constant("zero", 0.0)
    fast = g.node("GreaterOrEqual", [g.node("Abs", [v], "speed"), g.constant("velocity_band", band)], "fast")
    back = g.node("LessOrEqual", [g.node("Mul", ["v_last", v], "v_product"), zero], "reversed")
    fresh = g.node("Equal", ["v_last", zero], "fresh")
    g.node("Where", [fast, v, "v_last"], "v_last_next")
    return g.node("Or", [fresh, g.node("And", [fast, back], "fast_and_reversed")], "turn")


def _network(g: _Graph, network: Network, inputs: Sequence[str], label: str) -> str:
    """Scale, layers with tanh, scale back; returns the output column."""
    signal = g.node("Concat", inputs, f"{label}/input", axis=1)
    offset = g.constant(f"{label}/input_offset", network.input_offset)
    gain = g.constant(f"{label}/input_gain", network.input_gain)
    signal = g.node("Mul", [g.node("Sub", [signal, offset], f"{label}/centred"), gain], f"{label}/scaled")
    for number, (weights, bias) in enumerate(network.layers, start=1):
        w = g.constant(f"{label}/weights{number}", weights)
        b = g.constant(f"{label}/bias{number}", bias)
        signal = g.node("Gemm", [signal, w, b], f"{label}/layer{number}", transB=1)
        if number < len(network.layers):
            signal = g.node("Tanh", [signal], f"{label}/neurons{number}")
    gain = g.constant(f"{label}/output_gain", network.output_gain)
    offset = g.constant(f"{label}/output_offset", network.output_offset)
    return g.node("Add", [g.node("Mul", [signal, gain], f"{label}/physical"), offset], f"{label}/output")


# reading


def load(path: Path) -> ModelProto:
    """Any ONNX file, checked against the standard.

    Raises NetworkError with one sentence when there is no such file, when it is empty, truncated or not ONNX, breaks a
    rule of the standard, or holds weights that are not finite.
    """
    path = Path(path)
    if not path.is_file():
        raise NetworkError(f"{path}: there is no such file")
    if path.stat().st_size == 0:
        raise NetworkError(f"{path}: the file is empty")
    try:
        proto = onnx.load(str(path))
    except Exception as error:  # protobuf and onnx raise various types for damaged files
        raise NetworkError(f"{path}: not an ONNX file, or a damaged or truncated one ({_first_line(error)})") from error
    if any(isinstance(text, bytes) for text in _texts(proto)):  # protobuf's way to say: this is no UTF-8
        raise NetworkError(f"{path}: a damaged ONNX file: a name in it is no text")
    if not proto.ir_version or not proto.opset_import or not (proto.graph.node or proto.graph.output):
        raise NetworkError(f"{path}: not an ONNX file, or a damaged or truncated one (it holds no network)")
    try:
        onnx.checker.check_model(proto)
    except Exception as error:  # the checker raises protobuf's types as well as its own
        raise NetworkError(f"{path}: breaks the ONNX standard: {_first_line(error)}") from error
    _check_finite(proto, path)
    return proto


def read(path: Path) -> tuple[ModelProto, StepDescription]:
    """A surrogate's ONNX file (one stateful step, see above) and what it says about itself.

    Raises NetworkError with one sentence naming the input, output, element type or metadata entry that is missing or
    wrong, besides what ``load`` finds.
    """
    proto = load(path)
    given = {entry.key: entry.value for entry in proto.metadata_props}
    ports = _ports(path, proto.graph)
    initial = _numbers(path, given, "initial_state")
    for name, (kind, info) in ports.items():
        _check_port(path, kind, name, info, len(initial) if name.startswith("state") else 1)
    names = [f"state[{i + 1}]" for i in range(len(initial))]
    layout = _entry(path, given, "state_layout") if "state_layout" in given else names
    if not isinstance(layout, list):
        raise NetworkError(f"{path}: the metadata entry 'state_layout' must be a list of names")
    if len(layout) != len(initial):
        raise NetworkError(f"{path}: state_layout names {len(layout)} elements, initial_state has {len(initial)}")
    description = StepDescription(
        mass=_number(path, given, "mass", least=0.0),
        sample_rate=_number(path, given, "sample_rate", least=5e-324),
        training_range=_ranges(path, given),
        state_layout=tuple(str(name) for name in layout),
        initial_state=initial,
        memory=given.get("memory", ""),
        metadata=given,
    )
    return proto, description


def _texts(proto: ModelProto) -> Iterator[object]:
    """Every name in the file that is used later."""
    graph = proto.graph
    for node in graph.node:
        yield from (node.name, node.op_type, node.domain, *node.input, *node.output)
        yield from (attribute.name for attribute in node.attribute)
    yield from (info.name for info in (*graph.input, *graph.output, *graph.initializer))
    yield from (axis.dim_param for info in graph.input for axis in info.type.tensor_type.shape.dim)
    yield from (part for entry in proto.metadata_props for part in (entry.key, entry.value))
    yield from (entry.domain for entry in proto.opset_import)


def _first_line(error: Exception) -> str:
    lines = [line.strip() for line in str(error).splitlines() if line.strip()]
    return lines[0][:160] if lines else type(error).__name__


def _check_finite(proto: ModelProto, path: Path) -> None:
    for tensor in proto.graph.initializer:
        if tensor.data_type not in (TensorProto.FLOAT, TensorProto.DOUBLE):
            continue
        try:
            values = numpy_helper.to_array(tensor)
        except Exception as error:  # the stored length does not fit the shape, an external file is missing, ...
            raise NetworkError(f"{path}: initialiser '{tensor.name}' cannot be read: {_first_line(error)}") from error
        if np.isnan(values).any():
            raise NetworkError(f"{path}: initialiser '{tensor.name}' holds NaN: the training that wrote it failed")


def _ports(path: Path, graph: GraphProto) -> dict[str, tuple[str, ValueInfoProto]]:
    """Name -> ("input" or "output", declaration); the names must be those of a surrogate."""
    stored = {tensor.name for tensor in graph.initializer}
    ports: dict[str, tuple[str, ValueInfoProto]] = {}
    for kind, declared, wanted in (
        ("input", [info for info in graph.input if info.name not in stored], ("x", "v", "state")),
        ("output", list(graph.output), ("R", "state_next")),
    ):
        found = {info.name: (kind, info) for info in declared}
        if set(found) != set(wanted):
            raise NetworkError(
                f"{path}: a surrogate has the {kind}s {', '.join(wanted)}, found {', '.join(found) or 'none'}"
            )
        ports |= found
    return ports


def _check_port(path: Path, kind: str, name: str, info: ValueInfoProto, size: int) -> None:
    tensor = info.type.tensor_type
    if tensor.elem_type != TensorProto.DOUBLE:
        found = TensorProto.DataType.Name(tensor.elem_type)
        raise NetworkError(f"{path}: {kind} {name} must be float64 (DOUBLE), found {found}")
    sizes = [axis.dim_value for axis in tensor.shape.dim if axis.dim_value > 0]
    if math.prod(sizes) != size:
        raise NetworkError(f"{path}: {kind} {name} must have {size} element(s) per sample, found shape {sizes}")


def _entry(path: Path, given: Mapping[str, str], key: str) -> Any:
    if key not in given:
        raise NetworkError(f"{path}: the metadata entry '{key}' is missing; 'hystid identify' writes it")
    try:
        return json.loads(given[key])
    except ValueError as error:
        raise NetworkError(f"{path}: the metadata entry '{key}' cannot be read: {given[key][:60]!r}") from error


def _number(path: Path, given: Mapping[str, str], key: str, least: float) -> float:
    value = _entry(path, given, key)
    if isinstance(value, bool) or not isinstance(value, int | float) or not least <= value < math.inf:
        raise NetworkError(
            f"{path}: the metadata entry '{key}' must be a number of at least {least:g}, found {value!r}"
        )
    return float(value)


def _numbers(path: Path, given: Mapping[str, str], key: str) -> tuple[float, ...]:
    values = _entry(path, given, key)
    if not isinstance(values, list) or not all(
        isinstance(value, int | float) and abs(value) < math.inf for value in values
    ):
        raise NetworkError(f"{path}: the metadata entry '{key}' must be a list of numbers, found {str(values)[:60]}")
    if not values:
        raise NetworkError(f"{path}: the metadata entry '{key}' must hold at least one number")
    return tuple(float(value) for value in values)


def _ranges(path: Path, given: Mapping[str, str]) -> dict[str, tuple[float, float]]:
    ranges = _entry(path, given, "training_range")
    try:
        pairs = {str(name): (float(low), float(high)) for name, (low, high) in ranges.items()}
    except (AttributeError, TypeError, ValueError) as error:
        raise NetworkError(
            f"{path}: the metadata entry 'training_range' must hold [least, greatest] per signal"
        ) from error
    wrong = [name for name, (low, high) in pairs.items() if not -math.inf < low <= high < math.inf]
    if wrong:
        raise NetworkError(
            f"{path}: the metadata entry 'training_range' of {wrong[0]} must be two numbers, least first"
        )
    missing = {"x", "v"} - set(pairs)
    if missing:
        raise NetworkError(f"{path}: the metadata entry 'training_range' lacks {min(missing)}")
    return pairs
