"""ONNX files: an identified model written as one stateful step.

The step has float64 inputs ``x`` (batch,), ``v`` (batch,), one (batch,) for each further input of the model, ``state``
(batch, n) and outputs ``R`` (batch,), ``state_next`` (batch, n). To evaluate a recording, call it sample by sample with
a batch of 1 and feed ``state_next`` back as ``state``; a larger batch steps independent recordings side by side. The
turning-point rule and the mean over the ensemble are inside.

Metadata are strings; those with structure are JSON. ``metadata_of`` lists them.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import numpy as np
import onnx
from onnx import GraphProto, NodeProto, TensorProto, ValueInfoProto, helper, numpy_helper

from hystid.errors import NetworkError
from hystid.files import atomic
from hystid.networks import runtime
from hystid.networks.level import Level
from hystid.networks.model import TwoNetworkModel
from hystid.networks.onnx_reading import TURNING_POINTS, check_finite
from hystid.networks.perceptron import Network
from hystid.networks.ports import FurtherInput, Lag, Polyline
from hystid.networks.trust import Spread
from hystid.numeric import Array
from hystid.rotation import turned_unit

OPERATOR_SET = 17
IR_VERSION = 8  # read by every runtime since 2022
UNITS = {"x": "m", "v": "m/s", "R": "N", "mass": "kg", "sample_rate": "Hz", "velocity_band": "m/s"}


def write(model: TwoNetworkModel, path: Path) -> None:
    """Write an identified model as one stateful step, float64, with everything that is needed to run it.

    The graph computes exactly the rule stated at ``TwoNetworkModel``. Raises NetworkError when a weight is not finite,
    and where ONNX Runtime computes other forces from the file than the model does.
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
    check_finite(proto, Path(path))
    onnx.checker.check_model(proto, full_check=True)
    content = proto.SerializeToString()
    _check_by_runtime(model, content, Path(path))
    with atomic(Path(path)) as beside:
        beside.write_bytes(content)


def _check_by_runtime(model: TwoNetworkModel, content: bytes, path: Path) -> None:
    def forces(signals: Mapping[str, Array]) -> Array:
        return model.response(signals["x"], signals["v"], inputs=signals)[0]

    why = runtime.check(content, path, model.training_range, model.initial_state().tolist(), forces)
    if why:
        raise NetworkError(f"{path}: ONNX Runtime cannot run the file: {why}")


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
    near = further
    further = [_curved(g, port.name, port.curve, column) for port, column in zip(model.inputs, further, strict=True)]
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
        width = _spread(g, model.spread, deviation)
        for port, curve, values in zip(model.inputs, model.spread.between, near, strict=bool(model.spread.between)):
            if curve is not None:
                factor = _curved(g, f"{port.name}/between", curve, values)
                width = g.node("Mul", [width, factor], f"R_spread_by_{port.name}")
        g.node("Squeeze", [width, first], "R_spread")
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


def _curved(g: _Graph, name: str, curve: Polyline | None, column: str) -> str:
    """Curve at an input, which stays as it is where there is none: to[0] + sum over the lines of slope * (value within
    the line - its begin)."""
    if curve is None:
        return column
    begin, end = (
        g.constant(f"{name}/{which}", [list(values)])
        for which, values in (("line_begins", curve.at[:-1]), ("line_ends", curve.at[1:]))
    )
    inside = g.node("Max", [g.node("Min", [column, end], f"{name}/below_end"), begin], f"{name}/in_line")
    way = g.node("Sub", [inside, begin], f"{name}/along_line")
    slopes = g.constant(f"{name}/slopes", [list(curve.slopes)])
    first = g.constant(f"{name}/curve_start", [curve.to[0]])
    return g.node("Gemm", [way, slopes, first], f"{name}_seen", transB=1)


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
