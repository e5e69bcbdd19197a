"""ONNX files read back, as files of unknown origin: what a step takes, and what a file says about itself."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import onnx
from onnx import GraphProto, ModelProto, TensorProto, ValueInfoProto, numpy_helper

from hystid.errors import NetworkError, first_line
from hystid.files import check_regular
from hystid.networks.level import Level
from hystid.networks.ports import FurtherInput, Lag, Polyline

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
    def turning(self) -> bool:
        """Whether state[0] is v_last and the memory is renewed where v_last v <= 0: it can be held still in between."""
        return self.memory == TURNING_POINTS

    @property
    def force_slots(self) -> tuple[int, ...]:
        """Elements of the state that hold the restoring force of the sample before, one per member of the ensemble."""
        return tuple(i for i, name in enumerate(self.state_layout) if name.startswith("Rh["))

    @property
    def late(self) -> dict[int, str]:
        """Elements of the state that follow a signal late, and that signal: the last ones."""
        first = len(self.initial_state) - len(self.lags)
        return {first + number: lag.source for number, lag in enumerate(self.lags)}


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
        raise NetworkError(
            f"{path}: not an ONNX file, or a damaged or truncated one ({first_line(error, 160)})"
        ) from error
    if any(isinstance(text, bytes) for text in _texts(proto)):  # protobuf's way to say: this is no UTF-8
        raise NetworkError(f"{path}: a damaged ONNX file: a name in it is no text")
    if not proto.ir_version or not proto.opset_import or not (proto.graph.node or proto.graph.output):
        raise NetworkError(f"{path}: not an ONNX file, or a damaged or truncated one (it holds no network)")
    asked = max((item.version for item in proto.opset_import if item.domain in ("", "ai.onnx")), default=0)
    if asked > onnx.defs.onnx_opset_version():
        known = f"the {onnx.defs.onnx_opset_version()} that the package onnx knows here"
        raise NetworkError(
            f"{path}: operator set {asked} of the ONNX standard is newer than {known}; export an older one"
        )
    try:
        onnx.checker.check_model(proto)
    except Exception as error:  # the checker raises protobuf's types as well as its own
        raise NetworkError(f"{path}: breaks the ONNX standard: {first_line(error, 160)}") from error
    check_finite(proto, path)
    return proto


def read(path: Path) -> tuple[ModelProto, StepDescription]:
    """A surrogate's ONNX file (one stateful step, see ``onnx``) and what it says about itself.

    Raises NetworkError with one sentence naming the input, output, element type or metadata entry that is missing or
    wrong, besides what ``load`` finds.
    """
    proto = load(path)
    given = {entry.key: entry.value for entry in proto.metadata_props}
    further = _further(path, given)
    if "units" in given and not isinstance(_entry(path, given, "units"), dict):
        raise _wrong(path, "units", "must be an object of names and units")
    ports = _ports(path, proto.graph, [port.name for port in further])
    initial = _numbers(path, given, "initial_state")
    for name, (kind, info) in ports.items():
        _check_port(path, kind, name, info, len(initial) if name.startswith("state") else 1)
    names = [f"state[{i + 1}]" for i in range(len(initial))]
    layout = _entry(path, given, "state_layout") if "state_layout" in given else names
    if not isinstance(layout, list):
        raise _wrong(path, "state_layout", "must be a list of names")
    if len(layout) != len(initial):
        raise NetworkError(f"{path}: state_layout names {len(layout)} elements, initial_state has {len(initial)}")
    description = StepDescription(
        mass=_number(path, given, "mass", least=0.0),
        sample_rate=_number(path, given, "sample_rate", above=0.0),
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


def check_finite(proto: ModelProto, path: Path) -> None:
    """Raise NetworkError where a stored number is not finite."""
    for tensor in proto.graph.initializer:
        if tensor.data_type not in (TensorProto.FLOAT, TensorProto.DOUBLE):
            continue
        try:
            values = numpy_helper.to_array(tensor)
        except Exception as error:  # the stored length does not fit the shape, an external file is missing, ...
            raise NetworkError(
                f"{path}: initialiser '{tensor.name}' cannot be read: {first_line(error, 160)}"
            ) from error
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
        must = (
            "must be a list of objects with name, unit and column, and a curve of two ascending rows where there is one"
        )
        raise _wrong(path, "inputs", must)
    return found


def _curve(rows: Any) -> Polyline | None:
    """The curve of an input; raises ValueError or TypeError where it is none."""
    if rows is None:
        return None
    at, to = (tuple(float(value) for value in row) for row in rows)
    rising = all(math.isfinite(low) and low < high < math.inf for row in (at, to) for low, high in pairwise(row))
    if not (rising and len(at) == len(to) >= 2):
        raise ValueError("a curve needs two ascending rows of one length")
    return Polyline(at, to)


def _lags(path: Path, given: Mapping[str, str], further: Sequence[FurtherInput], elements: int) -> tuple[Lag, ...]:
    entries = _entry(path, given, "lags") if "lags" in given else []
    try:
        found = tuple(Lag(str(entry["source"]), float(entry["time"])) for entry in entries)
    except (KeyError, TypeError, ValueError):
        raise _wrong(path, "lags", "must be a list of objects with source and time") from None
    known = {"v", *(port.name for port in further)}
    if any(lag.source not in known or not 0 < lag.time < math.inf for lag in found) or len(found) > elements:
        raise _wrong(path, "lags", "must name v or a further input, and times above 0 s")
    return found


def _level(path: Path, given: Mapping[str, str], signals: int) -> Level | None:
    if "level" not in given or given["level"] == "[]":
        return None
    values = list(_numbers(path, given, "level"))
    if len(values) != 4 + 2 * signals:
        raise _wrong(path, "level", f"must hold {4 + 2 * signals} numbers, found {len(values)}")
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
        known = {number: name for name, number in TensorProto.DataType.items()}
        found = known.get(tensor.elem_type, f"type {tensor.elem_type}")
        raise NetworkError(f"{path}: {kind} {name} must be float64 (DOUBLE), found {found}")
    sizes = [axis.dim_value for axis in tensor.shape.dim if axis.dim_value > 0]
    if math.prod(sizes) != size:
        raise NetworkError(f"{path}: {kind} {name} must have {size} element(s) per sample, found shape {sizes}")


def _wrong(path: Path, key: str, why: str) -> NetworkError:
    return NetworkError(f"{path}: the metadata entry '{key}' {why}")


def _entry(path: Path, given: Mapping[str, str], key: str) -> Any:
    if key not in given:
        raise _wrong(path, key, "is missing; 'hystid identify' writes it")
    try:
        return json.loads(given[key])
    except (ValueError, RecursionError) as error:
        raise _wrong(path, key, f"cannot be read: {given[key][:60]!r}") from error


def _number(
    path: Path, given: Mapping[str, str], key: str, least: float = -math.inf, above: float = -math.inf
) -> float:
    value = _entry(path, given, key)
    if (
        isinstance(value, bool)
        or not isinstance(value, int | float)
        or not (least <= value < math.inf and value > above)
    ):
        limit = f"above {above:g}" if above > least else f"of at least {least:g}"
        raise _wrong(path, key, f"must be a number {limit}, found {value!r}")
    return float(value)


def _numbers(path: Path, given: Mapping[str, str], key: str) -> tuple[float, ...]:
    values = _entry(path, given, key)
    if not isinstance(values, list) or not all(
        isinstance(value, int | float) and abs(value) < math.inf for value in values
    ):
        raise _wrong(path, key, f"must be a list of numbers, found {str(values)[:60]}")
    if not values:
        raise _wrong(path, key, "must hold at least one number")
    return tuple(float(value) for value in values)


def _ranges(path: Path, given: Mapping[str, str]) -> dict[str, tuple[float, float]]:
    ranges = _entry(path, given, "training_range")
    try:
        pairs = {str(name): (float(low), float(high)) for name, (low, high) in ranges.items()}
    except (AttributeError, TypeError, ValueError) as error:
        raise _wrong(path, "training_range", "must hold [least, greatest] per signal") from error
    wrong = [name for name, (low, high) in pairs.items() if not -math.inf < low <= high < math.inf]
    if wrong:
        raise _wrong(path, "training_range", f"of {wrong[0]} must be two numbers, least first")
    missing = {"x", "v"} - set(pairs)
    if missing:
        raise _wrong(path, "training_range", f"lacks {min(missing)}")
    return pairs
