"""ONNX files: writing an identified model as one stateful step, and reading files at the door.

The step has float64 inputs ``x`` (batch,), ``v`` (batch,), one (batch,) for each further input of the model, ``state``
(batch, n) and outputs ``R`` (batch,), ``state_next`` (batch, n). To evaluate a recording, call it sample by sample with
a batch of 1 and feed ``state_next`` back as ``state``; a larger batch steps independent recordings side by side. The
turning-point rule and the mean over the ensemble are inside.

Metadata are strings; those with structure are JSON. ``metadata_of`` lists them.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import onnx
from onnx import GraphProto, ModelProto, NodeProto, TensorProto, ValueInfoProto, helper, numpy_helper

from hystid.errors import NetworkError
from hystid.files import atomic, check_regular
from hystid.networks.level import Level
from hystid.networks.model import TwoNetworkModel
from hystid.networks.perceptron import Network
from hystid.networks.ports import Curve, FurtherInput, Lag
from hystid.networks.trust import Spread
from hystid.rotation import turned_unit

OPERATOR_SET = 17
IR_VERSION = 8  # read by every runtime since 2022
UNITS = {"x": "m", "v": "m/s", "R": "N", "mass": "kg", "sample_rate": "Hz", "velocity_band": "m/s"}
TURNING_POINTS = "turning_points"


@dataclass(frozen=True)
class StepDescription:
    """What a surrogate's ONNX file says about itself.

    mass [kg], 0 where the force itself was recorded. sample_rate [Hz] of the training data. training_range: least and
    greatest x [m], v [m/s] and, where given, R [N] and the further inputs. inputs, lags: in the order of the networks.
    level: what the remembered force is scaled by. spread: whether there is an output R_spread. state_layout: name of
    each element of the state. initial_state: its relaxed start, one number each. memory: "turning_points" where element
    0 is v_last and the memory is renewed where ``v_last v <= 0``; "" where the file does not say. metadata: all entries
    of the file, as the strings they are.
    """

    mass: float
    sample_rate: float
    training_range: Mapping[str, tuple[float, float]]
    state_layout: tuple[str, ...]
    initial_state: tuple[float, ...]
    memory: str
    metadata: Mapping[str, str]
    inputs: tuple[FurtherInput, ...] = ()
    lags: tuple[Lag, ...] = ()
    level: Level | None = None
    spread: bool = False

    @property
    def rotational(self) -> bool:
        """Whether it is of a rig that turns: x in rad, R in N.m, the mass in kg.m2."""
        units = json.loads(self.metadata.get("units", "{}"))
        return isinstance(units, dict) and units.get("R") == "N.m"

    @property
    def late(self) -> dict[int, str]:
        """Elements of the state that follow a signal late, and that signal: the last ones."""
        first = len(self.initial_state) - len(self.lags)
        return {first + number: lag.source for number, lag in enumerate(self.lags)}


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
    layout += [f"{lag.source}_late[{j + 1}]" for j, lag in enumerate(model.lags)]
    return {
        "hystid_version": _version(),
        "units": json.dumps(_units(model)),
        "inputs": json.dumps([_input(port) for port in model.inputs]),
        "lags": json.dumps([{"source": lag.source, "time": lag.time} for lag in model.lags]),
        "tail": json.dumps([model.tail.stiffness, model.tail.damping] if model.tail else []),
        "spread": json.dumps([model.spread.floor, model.spread.factor] if model.spread else []),
        "level": json.dumps(model.level.numbers() if model.level else []),
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


def _input(port: FurtherInput) -> dict[str, Any]:
    curve = {"curve": [list(port.curve.at), list(port.curve.to)]} if port.curve else {}
    return {"name": port.name, "unit": port.unit, "column": port.column, **curve}


def _units(model: TwoNetworkModel) -> dict[str, str]:
    units = UNITS | ({"R_spread": "N"} if model.spread else {})
    if model.metadata.get("rotational"):
        units = {name: turned_unit(unit) for name, unit in units.items()}
    return units | {port.name: port.unit for port in model.inputs}


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
    further = [g.node("Unsqueeze", [port.name, first], f"{port.name}_column") for port in model.inputs]
    x = g.node("Unsqueeze", ["x", first], "x_column")
    v = g.node("Unsqueeze", ["v", first], "v_column")
    parts = g.constant("state_parts", [1, 1, members, members, *([1] * len(model.lags))], np.int64)
    late = [f"late_{j + 1}" for j in range(len(model.lags))]
    g.node("Split", ["state", parts], ["v_last", "x0_last", "Rh_last", "Rh0_last", *late], axis=1)
    turn = _turning_points(g, v, model.velocity_band)
    beyond = ""
    if model.tail is not None:
        x, v, further, beyond = _ends(g, model, x, v, further)
    further = [_curved(g, port, column) for port, column in zip(model.inputs, further, strict=True)]
    sources = {"v": v} | {port.name: column for port, column in zip(model.inputs, further, strict=True)}
    coming = [
        _follow(g, lag, name, sources[lag.source], 1 / model.sample_rate)
        for lag, name in zip(model.lags, late, strict=True)
    ]
    further = [*further, *late]
    x0 = g.node("Where", [turn, x, "x0_last"], "x0")
    held = g.node("Where", [turn, "Rh_last", "Rh0_last"], "Rh0")
    each = [f"Rh0_{j + 1}" for j in range(members)]
    g.node("Split", [held, g.constant("one_each", [1] * members, np.int64)], each, axis=1)
    latest, forces = [], []
    for number, (member, memory) in enumerate(zip(model.members, each, strict=True), start=1):
        latest.append(_network(g, member.hysteresis, [x, x0, memory, *further], f"member{number}/hysteresis"))
        forces.append(_network(g, member.restoring, [x, v, latest[-1], *further], f"member{number}/restoring"))
    g.node("Concat", ["v_last_next", x0, *latest, held, *coming], "state_next", axis=1)
    g.node("Concat", forces, "R_members", axis=1)
    column = g.node("ReduceMean", ["R_members"], "R_mean", axes=[1], keepdims=1)
    deviation = _deviation(g, column) if model.spread is not None else ""
    if model.level is not None:
        column, width = _levelled(g, model.level, [x, *further], column)
        deviation = deviation and g.node("Mul", [width, deviation], "between_scaled")
    if beyond:
        column = g.node("Add", [column, beyond], "R_column")
    g.node("Squeeze", [column, first], "R")
    if model.spread is not None:
        g.node("Squeeze", [_spread(g, model.spread, deviation), first], "R_spread")
    size = 2 + 2 * members + len(late)
    inputs = [_port("x"), _port("v"), *(_port(port.name) for port in model.inputs), _port("state", size)]
    outputs = [_port("R"), *([_port("R_spread")] if model.spread else []), _port("state_next", size)]
    return helper.make_graph(g.nodes, "restoring_force_step", inputs, outputs, g.constants)


def _follow(g: _Graph, lag: Lag, late: str, source: str, dt: float) -> str:
    """late + share (source - late)."""
    gap = g.node("Sub", [source, late], f"{late}/gap")
    step = g.node("Mul", [gap, g.constant(f"{late}/share", lag.share(dt))], f"{late}/step")
    return g.node("Add", [late, step], f"{late}_next")


def _ends(g: _Graph, model: TwoNetworkModel, x: str, v: str, further: Sequence[str]) -> tuple[str, str, list[str], str]:
    """Columns of x, v and further inputs moved to the nearest of the training range; the force beyond (``Tail``)."""
    assert model.tail is not None

    def near(name: str, column: str) -> str:
        low, high = (
            g.constant(f"{name}/{end}", value)
            for end, value in zip(("least", "most"), model.training_range[name], strict=True)
        )
        return g.node("Clip", [column, low, high], f"{name}_near")

    def force(name: str, column: str, inside: str, factor: float) -> str:
        rest = g.node("Sub", [column, inside], f"{name}/beyond")
        return g.node("Mul", [rest, g.constant(f"{name}/tail", factor)], f"{name}/tail_force")

    x_near, v_near = near("x", x), near("v", v)
    forces = [force("x", x, x_near, model.tail.stiffness), force("v", v, v_near, model.tail.damping)]
    columns = [near(port.name, column) for port, column in zip(model.inputs, further, strict=True)]
    return x_near, v_near, columns, g.node("Add", forces, "R_beyond")


def _curved(g: _Graph, port: FurtherInput, column: str) -> str:
    """What the networks see of an input: to[0] + sum over the lines of slope * (value within the line - its begin)."""
    if port.curve is None:
        return column
    begin, end = (
        g.constant(f"{port.name}/{name}", [list(values)])
        for name, values in (("line_begins", port.curve.at[:-1]), ("line_ends", port.curve.at[1:]))
    )
    inside = g.node("Max", [g.node("Min", [column, end], f"{port.name}/below_end"), begin], f"{port.name}/in_line")
    way = g.node("Sub", [inside, begin], f"{port.name}/along_line")
    slopes = g.constant(f"{port.name}/slopes", [list(port.curve.slopes)])
    first = g.constant(f"{port.name}/curve_start", [port.curve.to[0]])
    return g.node("Gemm", [way, slopes, first], f"{port.name}_seen", transB=1)


def _deviation(g: _Graph, mean: str) -> str:
    """Standard deviation of the members' forces about their mean."""
    gap = g.node("Sub", ["R_members", mean], "between")
    power = g.node("ReduceMean", [g.node("Mul", [gap, gap], "between_squared")], "between_power", axes=[1], keepdims=1)
    return g.node("Sqrt", [power], "between_deviation")


def _spread(g: _Graph, spread: Spread, deviation: str) -> str:
    """sqrt(floor^2 + (factor deviation)^2)."""
    scaled = g.node("Mul", [deviation, g.constant("spread/factor", spread.factor)], "spread/members")
    power = g.node("Mul", [scaled, scaled], "spread/power")
    total = g.node("Add", [power, g.constant("spread/floor_squared", spread.floor**2)], "spread/total")
    return g.node("Sqrt", [total], "R_spread_column")


def _levelled(g: _Graph, level: Level, signals: Sequence[str], force: str) -> tuple[str, str]:
    """centre + spread * force, and spread, see ``Level``; signals: x, further inputs and lags as columns."""
    row = g.node("Concat", signals, "level/signals", axis=1)

    def plane(name: str, constant: float, slopes: Sequence[float]) -> str:
        weights = g.constant(f"level/{name}_slopes", [list(slopes)])
        return g.node(
            "Gemm", [row, weights, g.constant(f"level/{name}_constant", [constant])], f"level/{name}", transB=1
        )

    centre = plane("centre", level.offset, level.slopes)
    spread = plane("spread", level.base, (0.0, *level.growth))
    bounded = g.node("Max", [spread, g.constant("level/least", [[level.least]])], "level/bounded")
    return g.node("Add", [centre, g.node("Mul", [bounded, force], "level/scaled")], "R_levelled"), bounded


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
    check_regular(path, NetworkError)
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
    further = _further(path, given)
    if "units" in given and not isinstance(_entry(path, given, "units"), dict):
        raise NetworkError(f"{path}: the metadata entry 'units' must be an object of names and units")
    ports = _ports(path, proto.graph, [port.name for port in further])
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
        inputs=further,
        lags=(lags := _lags(path, given, further, len(initial))),
        spread="R_spread" in ports,
        level=_level(path, given, len(further) + len(lags)),
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
        if np.isinf(values).any():
            raise NetworkError(
                f"{path}: initialiser '{tensor.name}' holds infinite numbers: the training that wrote it diverged"
            )


def _further(path: Path, given: Mapping[str, str]) -> tuple[FurtherInput, ...]:
    if "inputs" not in given:  # written before there were any
        return ()
    entries = _entry(path, given, "inputs")
    try:
        found = tuple(
            FurtherInput(entry["name"], entry["unit"], entry["column"], _curve(entry.get("curve"))) for entry in entries
        )
        whole = all(isinstance(part, str) and part for p in found for part in (p.name, p.unit, p.column))
    except (AttributeError, KeyError, TypeError, ValueError):
        whole = False
    if not whole:
        raise NetworkError(
            f"{path}: the metadata entry 'inputs' must be a list of objects with name, unit and column, and a curve of "
            "two ascending rows where there is one"
        )
    return found


def _curve(rows: Any) -> Curve | None:
    """The curve of an input; raises ValueError or TypeError where it is none."""
    if rows is None:
        return None
    at, to = (tuple(float(value) for value in row) for row in rows)
    rising = all(math.isfinite(low) and low < high < math.inf for row in (at, to) for low, high in pairwise(row))
    if not (rising and len(at) == len(to) >= 2):
        raise ValueError("a curve needs two ascending rows of one length")
    return Curve(at, to)


def _lags(path: Path, given: Mapping[str, str], further: Sequence[FurtherInput], elements: int) -> tuple[Lag, ...]:
    entries = _entry(path, given, "lags") if "lags" in given else []
    try:
        found = tuple(Lag(str(entry["source"]), float(entry["time"])) for entry in entries)
    except (KeyError, TypeError, ValueError):
        raise NetworkError(
            f"{path}: the metadata entry 'lags' must be a list of objects with source and time"
        ) from None
    known = {"v", *(port.name for port in further)}
    if any(lag.source not in known or not 0 < lag.time < math.inf for lag in found) or len(found) > elements:
        raise NetworkError(f"{path}: the metadata entry 'lags' must name v or a further input, and times above 0 s")
    return found


def _level(path: Path, given: Mapping[str, str], signals: int) -> Level | None:
    if "level" not in given or given["level"] == "[]":
        return None
    values = list(_numbers(path, given, "level"))
    if len(values) != 4 + 2 * signals:
        raise NetworkError(
            f"{path}: the metadata entry 'level' must hold {4 + 2 * signals} numbers, found {len(values)}"
        )
    return Level.from_numbers(values)


def _ports(path: Path, graph: GraphProto, further: Sequence[str]) -> dict[str, tuple[str, ValueInfoProto]]:
    """Name -> ("input" or "output", declaration); the names must be those of a surrogate."""
    stored = {tensor.name for tensor in graph.initializer}
    ports: dict[str, tuple[str, ValueInfoProto]] = {}
    for kind, declared, wanted in (
        ("input", [info for info in graph.input if info.name not in stored], ("x", "v", *further, "state")),
        ("output", list(graph.output), ("R", "state_next")),
    ):
        found = {info.name: (kind, info) for info in declared}
        if set(found) - {"R_spread"} != set(wanted):
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
