"""Random networks against ONNX Runtime, and random damage to a file: an answer that agrees, or one sentence."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from onnx import ModelProto, helper
from surrogate_harness import compile_all, make_model, outside, random_model

from hystid.errors import NetworkError
from hystid.networks import onnx as exchange
from hystid.surrogate import network_code, surrogate_code

UNARY = ["Tanh", "Sigmoid", "Relu", "Neg", "Abs", "Softplus", "Elu", "LeakyRelu", "Sin", "Identity", "Softmax"]
BINARY = ["Add", "Sub", "Mul", "Max", "Min"]
SIZES = [1, 2, 3]

Shape = tuple[int, ...]


class Draft:
    """A network in the making: nodes so far, and the shape of every tensor that may be used next."""

    def __init__(self, draw: Any) -> None:
        self.draw = draw
        self.rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
        self.shapes: dict[str, Shape] = {"a": (2, 3), "b": (1, 3), "c": (3, 2)}
        self.nodes: list[Any] = []
        self.constants: dict[str, np.ndarray] = {}

    def pick(self) -> tuple[str, Shape]:
        return self.draw(st.sampled_from(sorted(self.shapes.items())))

    def constant(self, value: np.ndarray) -> str:
        name = f"k{len(self.constants)}"
        self.constants[name] = value
        return name

    def add(self, operator: str, operands: list[str], shape: Shape, **attributes: Any) -> None:
        name = f"t{len(self.nodes)}"
        self.nodes.append(helper.make_node(operator, operands, [name], name=f"n{len(self.nodes)}", **attributes))
        self.shapes[name] = shape

    def unary(self) -> None:
        name, shape = self.pick()
        self.add(self.draw(st.sampled_from(UNARY)), [name], shape)

    def binary(self) -> None:
        (first, one), (second, two) = self.pick(), self.pick()
        try:
            shape = np.broadcast_shapes(one, two)
        except ValueError:
            return self.matrix()
        return self.add(self.draw(st.sampled_from(BINARY)), [first, second], shape)

    def matrix(self) -> None:
        name, shape = self.pick()
        width = self.draw(st.sampled_from(SIZES))
        weights, bias = self.rng.normal(0, 0.5, (shape[1], width)), self.rng.normal(0, 0.5, width)
        self.add("Gemm", [name, self.constant(weights), self.constant(bias)], (shape[0], width))

    def move(self) -> None:
        name, (rows, columns) = self.pick()
        kind = self.draw(st.sampled_from(["Transpose", "Slice", "Concat", "Gather", "Reshape"]))
        if kind == "Transpose":
            self.add(kind, [name], (columns, rows))
        elif kind == "Slice":
            ends = [self.constant(np.array([v])) for v in (0, columns, 1, 2)]
            self.add(kind, [name, *ends], (rows, -(-columns // 2)))
        elif kind == "Concat":
            self.add(kind, [name, name], (rows, 2 * columns), axis=1)
        elif kind == "Gather":
            index = self.rng.integers(-rows, rows, 2)
            self.add(kind, [name, self.constant(index)], (2, columns), axis=0)
        else:
            self.add(kind, [name, self.constant(np.array([-1, rows]))], (columns, rows))

    def choose(self) -> None:
        name, shape = self.pick()
        condition = self.constant(self.rng.random(shape) < 0.5)
        limit = self.constant(self.rng.normal(size=shape))
        self.add("Where", [condition, name, limit], shape)

    def reduce(self) -> None:
        name, (_, columns) = self.pick()
        self.add("ReduceMean", [name], (1, columns), axes=[0])

    def finish(self) -> ModelProto:
        last = [f"t{i}" for i in range(max(0, len(self.nodes) - 3), len(self.nodes))]
        inputs = {name: self.shapes[name] for name in "abc"}
        return make_model(self.nodes, inputs, last, self.constants)


@st.composite
def networks(draw: Any) -> ModelProto:
    draft = Draft(draw)
    steps = [draft.unary, draft.binary, draft.matrix, draft.move, draft.choose, draft.reduce]
    for _ in range(draw(st.integers(3, 14))):
        draw(st.sampled_from(steps))()
    return draft.finish()


@settings(max_examples=6, deadline=None, derandomize=True, suppress_health_check=list(HealthCheck))
@given(st.lists(networks(), min_size=6, max_size=6), st.integers(0, 1000))
def test_random_networks_agree_with_onnx_runtime(drawn: list[ModelProto], seed: int) -> None:
    models = {str(number): proto for number, proto in enumerate(drawn)}
    rng = np.random.default_rng(seed)
    for label, net in compile_all(models).items():
        inputs = {name: rng.uniform(-1.5, 1.5, shape) for name, shape in (("a", (2, 3)), ("b", (1, 3)), ("c", (3, 2)))}
        values = list(inputs.values())
        for got, want in zip(net.value(values), outside(models[label], inputs), strict=True):
            scale = 1 + np.abs(want).max()
            np.testing.assert_allclose(got, want, rtol=0, atol=1e-12 * scale)  # roundings of some dozen operations
        seeds = [rng.normal(size=value.shape) for value in values]
        slopes = net.forward(values, seeds)
        weights = [rng.normal(size=slope.shape) for slope in slopes]
        ahead = sum(float(w @ s) for w, s in zip(weights, slopes, strict=True))
        back = sum(float(b @ s.reshape(-1)) for b, s in zip(net.adjoint(values, weights), seeds, strict=True))
        assert back == pytest.approx(
            ahead, rel=1e-9, abs=1e-9 * sum(float(np.abs(w) @ np.abs(s)) for w, s in zip(weights, slopes, strict=True))
        )


@pytest.fixture(scope="module")
def sound(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("damage")
    exchange.write(random_model(), folder / "sound.onnx")
    return folder / "sound.onnx"


@settings(max_examples=150, deadline=None, derandomize=True, suppress_health_check=list(HealthCheck))
@given(data=st.data())
def test_damage_gets_one_sentence(sound: Path, data: st.DataObject) -> None:
    """Bytes overwritten, cut out or put in anywhere: compiled (a weight may just have changed) or refused."""
    content, path = bytearray(sound.read_bytes()), sound.with_name("damaged.onnx")
    for _ in range(data.draw(st.integers(1, 4))):
        at = data.draw(st.integers(0, len(content) - 1))
        how, some = (
            data.draw(st.sampled_from(["overwrite", "cut", "insert"])),
            data.draw(st.binary(min_size=1, max_size=8)),
        )
        content[at : at + (0 if how == "insert" else len(some))] = b"" if how == "cut" else some
    path.write_bytes(content)
    for compile_it in (surrogate_code, network_code):
        try:
            compile_it(path)
        except NetworkError as error:
            assert "\n" not in str(error) and str(path) in str(error)


def refused(proto: ModelProto, folder: Path) -> str:
    path = folder / "net.onnx"
    path.write_bytes(proto.SerializeToString())
    with pytest.raises(NetworkError) as caught:
        network_code(path)
    assert "\n" not in str(caught.value) and str(path) in str(caught.value)
    return str(caught.value)


def test_unknown_operators_are_named(tmp_path: Path) -> None:
    node = helper.make_node("NonZero", ["x"], ["y"], name="find")
    assert "node 'find' uses the operator NonZero" in refused(
        make_model([node], {"x": (3,)}, ["y"], output_kind=7), tmp_path
    )
    node = helper.make_node("Odd", ["x"], ["y"], name="mine", domain="com.example")
    ports = [helper.make_tensor_value_info(name, 11, [3]) for name in "xy"]
    opsets = [helper.make_opsetid("", 17), helper.make_opsetid("com.example", 1)]
    proto = helper.make_model(helper.make_graph([node], "g", ports[:1], ports[1:]), opset_imports=opsets, ir_version=8)
    assert "com.example.Odd" in refused(proto, tmp_path)


@pytest.mark.parametrize(
    ("key", "value", "sentence"),
    [
        ("training_range", '{"x": 5}', "'training_range' must give a list of finite numbers for 'x'"),
        ("training_range", '{"x": [0, 1, 2]}', "'training_range' must give 2 numbers for 'x'"),
        ("training_range", '{"x": [1, 0]}', "'training_range' must give the least number first for 'x'"),
        ("initial_state", '{"s": ["a"]}', "'initial_state' must give a list of finite numbers for 's'"),
        ("initial_state", "[1, 2]", "initial_state of 's' has 2 numbers, not 1"),
    ],
)
def test_wrong_metadata_are_named(tmp_path: Path, key: str, value: str, sentence: str) -> None:
    nodes = [helper.make_node("Add", ["x", "s"], ["s_next"]), helper.make_node("Neg", ["s_next"], ["y"])]
    proto = make_model(nodes, {"x": (1,), "s": (1,)}, ["y", "s_next"])
    helper.set_model_props(proto, {key: value})
    assert sentence in refused(proto, tmp_path)


def test_metadata_of_other_makes_do_not_disturb(tmp_path: Path) -> None:
    proto = make_model([helper.make_node("Neg", ["x"], ["y"])], {"x": (1,)}, ["y"])
    foreign = {
        "names": "Ada",
        "units": "[1]",
        "training_range": "unknown",
        "initial_state": "cold",
        "sample_rate": "fast",
    }
    helper.set_model_props(proto, foreign)
    (tmp_path / "net.onnx").write_bytes(proto.SerializeToString())
    assert [v.name for v in network_code(tmp_path / "net.onnx").variables] == ["x", "y"]


def test_control_flow_is_refused(tmp_path: Path) -> None:
    branch = helper.make_graph(
        [helper.make_node("Neg", ["x"], ["z"])], "b", [], [helper.make_tensor_value_info("z", 11, [1])]
    )
    node = helper.make_node("If", ["flag"], ["y"], name="fork", then_branch=branch, else_branch=branch)
    proto = make_model([node], {"x": (1,)}, ["y"], {"flag": np.array(True)})
    assert "node 'fork' uses the operator If" in refused(proto, tmp_path)


def test_what_must_be_constant_is_named(tmp_path: Path) -> None:
    nodes = [
        helper.make_node("Cast", ["x"], ["where"], to=7),
        helper.make_node("Gather", ["k", "where"], ["y"], name="look-up"),
    ]
    proto = make_model(nodes, {"x": (1,)}, ["y"], {"k": np.arange(4.0)})
    assert "node 'look-up' (Gather): indices must be constant" in refused(proto, tmp_path)


def test_shapes_that_do_not_fit_are_named(tmp_path: Path) -> None:
    node = helper.make_node("Reshape", ["x", "k"], ["y"], name="bend")
    graph = helper.make_graph(
        [node], "g", [helper.make_tensor_value_info("x", 11, [3])], [helper.make_tensor_value_info("y", 11, [2, 2])],
        [helper.make_tensor("k", 7, [2], [2, 2])],
    )  # fmt: skip
    proto = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
    assert "node 'bend' (Reshape): cannot give [3] the shape [2, 2]" in refused(proto, tmp_path)


def test_networks_too_large_for_c_are_refused(tmp_path: Path) -> None:
    nodes = [helper.make_node("MatMul", ["x", "W"], ["y"])]
    proto = make_model(nodes, {"x": (1, 1000)}, ["y"], {"W": np.zeros((1000, 600))})
    assert "600000 weights, more than the 500000" in refused(proto, tmp_path)
    wide = make_model([helper.make_node("Tanh", ["x"], ["y"])], {"x": (2_000_000,)}, ["y"])
    assert "2000000 elements" in refused(wide, tmp_path)
    nodes = [helper.make_node("MatMul", ["x", "x2"], ["y"], name="outer")]
    outer = make_model(nodes, {"x": (2000, 1), "x2": (1, 2000)}, ["y"])
    assert "node 'outer' (MatMul): cannot be compiled: its result has more than 1000000" in refused(outer, tmp_path)


def test_a_network_without_a_free_output_is_refused(tmp_path: Path) -> None:
    nodes = [helper.make_node("Tanh", ["s"], ["s_next"])]
    assert "no output besides its memory" in refused(make_model(nodes, {"s": (1,)}, ["s_next"]), tmp_path)
