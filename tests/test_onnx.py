"""ONNX files of identified models: an independent runtime gives our own answer; bad files get one sentence."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import onnx
import onnxruntime
import pytest
from onnx import TensorProto, helper
from surrogate_harness import make_model, motion, random_model

from hystid.errors import NetworkError
from hystid.networks import TwoNetworkModel, onnx_reading, runtime
from hystid.networks import onnx as exchange
from hystid.validation.surrogate import open_surrogate


def step_through(path: Path, x: np.ndarray, v: np.ndarray, state: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """ONNX Runtime, sample by sample; x, v: (n, batch), state: (batch, n_state)."""
    session = onnxruntime.InferenceSession(str(path))
    force = np.empty_like(x)
    for k in range(len(x)):
        force[k], state = session.run(["R", "state_next"], {"x": x[k], "v": v[k], "state": state})
    return force, state


@pytest.fixture(scope="module")
def saved(tmp_path_factory: pytest.TempPathFactory) -> tuple[TwoNetworkModel, Path]:
    model, path = random_model(members=3), tmp_path_factory.mktemp("onnx") / "surrogate.onnx"
    exchange.write(model, path)
    return model, path


@pytest.mark.parametrize(("members", "band", "n"), [(1, 0.0, 20_000), (2, 0.05, 4_000), (3, 0.0, 4_000)])
def test_runtime_agrees_with_the_library(tmp_path: Path, members: int, band: float, n: int) -> None:
    model, path = random_model(members, members, band), tmp_path / "m.onnx"
    exchange.write(model, path)
    x, v = motion(n)
    force, state = model.response(x, v)
    ours, after = step_through(path, x[:, None], v[:, None], model.initial_state()[None])
    # the two sum in different orders; the memory feeds differences back, so a few hundred roundings may add up
    np.testing.assert_allclose(ours[:, 0], force, rtol=0, atol=1e-10 * np.abs(force).max())
    np.testing.assert_allclose(after[0], state, rtol=0, atol=1e-10 * np.abs(state).max())


def test_a_batch_steps_independent_recordings(saved: tuple[TwoNetworkModel, Path]) -> None:
    model, path = saved
    x, v = motion(400)
    columns = np.stack([x, -x, 0.5 * x], axis=1), np.stack([v, -v, 0.5 * v], axis=1)
    together, _ = step_through(path, *columns, np.tile(model.initial_state(), (3, 1)))
    for j in range(3):
        alone, _ = model.response(columns[0][:, j].copy(), columns[1][:, j].copy())
        np.testing.assert_allclose(together[:, j], alone, atol=1e-10 * np.abs(alone).max())


def test_the_file_tells_all_that_is_needed(saved: tuple[TwoNetworkModel, Path]) -> None:
    model, path = saved
    proto, about = onnx_reading.read(path)
    assert about.mass == model.mass and about.sample_rate == model.sample_rate
    assert about.training_range == model.training_range
    assert about.initial_state == tuple(model.initial_state())
    assert about.state_layout[:3] == ("v_last", "x0", "Rh[1]") and len(about.state_layout) == 8
    assert json.loads(about.metadata["units"])["R"] == "N"
    assert json.loads(about.metadata["scaling"])[0]["hysteresis"]["output_gain"] == 100.0
    assert json.loads(about.metadata["identification"]) == {"recordings": ["made up"]}
    assert {info.type.tensor_type.elem_type for info in (*proto.graph.input, *proto.graph.output)} == {
        TensorProto.DOUBLE
    }
    assert all(isinstance(value, str) for value in about.metadata.values())


def test_writing_is_deterministic(saved: tuple[TwoNetworkModel, Path], tmp_path: Path) -> None:
    model, path = saved
    exchange.write(model, tmp_path / "again.onnx")
    assert (tmp_path / "again.onnx").read_bytes() == path.read_bytes()


def test_a_failed_training_is_not_written(tmp_path: Path) -> None:
    model = random_model()
    model.members[0].hysteresis.layers[0][0][0, 0] = np.nan
    with pytest.raises(NetworkError, match="holds NaN"):
        exchange.write(model, tmp_path / "m.onnx")
    assert list(tmp_path.iterdir()) == []


def test_a_file_that_computes_something_else_is_neither_written_nor_validated(
    saved: tuple[TwoNetworkModel, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    model, path = saved

    def other(content: bytes, *rest: Any) -> str:
        proto = onnx.load_from_string(content)
        bias = next(tensor for tensor in proto.graph.initializer if tensor.name.endswith("restoring/bias1"))
        bias.CopyFrom(onnx.numpy_helper.from_array(onnx.numpy_helper.to_array(bias) + 1e-3, bias.name))
        return check(proto.SerializeToString(), *rest)

    check = runtime.check
    assert open_surrogate(path, None).notes == ()
    monkeypatch.setattr(runtime, "check", other)
    for act in (lambda: exchange.write(model, tmp_path / "m.onnx"), lambda: open_surrogate(path, None)):
        with pytest.raises(NetworkError, match=r"\.onnx: ONNX Runtime computes R = .* where this program computes"):
            act()
    assert list(tmp_path.iterdir()) == []


def test_what_the_runtime_cannot_run_is_told(saved: tuple[TwoNetworkModel, Path], tmp_path: Path) -> None:
    """As an operator set that the runtime does not know."""
    proto, path = onnx.load(saved[1]), tmp_path / "m.onnx"
    for node in proto.graph.node:
        if node.op_type == "Tanh":
            node.domain = "elsewhere"
    proto.opset_import.append(helper.make_opsetid("elsewhere", 1))
    why = runtime.check(
        proto.SerializeToString(), path, {}, saved[0].initial_state().tolist(), lambda signals: signals["x"]
    )
    assert "elsewhere" in why and "\n" not in why


def drop(key: str) -> Callable[[onnx.ModelProto], None]:
    def change(proto: onnx.ModelProto) -> None:
        kept = [entry for entry in proto.metadata_props if entry.key != key]
        del proto.metadata_props[:]
        proto.metadata_props.extend(kept)

    return change


def later(proto: onnx.ModelProto) -> None:
    next(item for item in proto.opset_import if item.domain == "").version = 999


def put(key: str, value: str) -> Callable[[onnx.ModelProto], None]:
    def change(proto: onnx.ModelProto) -> None:
        next(entry for entry in proto.metadata_props if entry.key == key).value = value

    return change


def single_precision_x(proto: onnx.ModelProto) -> None:
    proto.graph.input[0].type.tensor_type.elem_type = TensorProto.FLOAT


def no_v(proto: onnx.ModelProto) -> None:
    next(info for info in proto.graph.input if info.name == "v").name = "v_other"
    for node in proto.graph.node:
        for place, name in enumerate(node.input):
            if name == "v":
                node.input[place] = "v_other"


def weights_are_nan(proto: onnx.ModelProto) -> None:
    tensor = next(t for t in proto.graph.initializer if t.name.endswith("weights1"))
    tensor.CopyFrom(onnx.numpy_helper.from_array(np.full((5, 3), np.nan), tensor.name))


def short_weights(proto: onnx.ModelProto) -> None:
    tensor = next(t for t in proto.graph.initializer if t.name.endswith("weights1"))
    tensor.raw_data = tensor.raw_data[:-8]


def cycle(proto: onnx.ModelProto) -> None:
    proto.graph.node[0].input[0] = proto.graph.node[-1].output[0]


BAD = {
    "mass is missing": (drop("mass"), "'mass' is missing"),
    "sample rate is missing": (drop("sample_rate"), "'sample_rate' is missing"),
    "initial state is missing": (drop("initial_state"), "'initial_state' is missing"),
    "mass is text": (put("mass", "heavy"), "'mass' cannot be read: 'heavy'"),
    "mass is negative": (put("mass", "-1.0"), "'mass' must be a number of at least 0"),
    "sample rate is 0": (put("sample_rate", "0"), "'sample_rate' must be a number above 0, found 0"),
    "operators of a later standard": (later, "operator set 999 of the ONNX standard is newer than"),
    "range lacks v": (put("training_range", '{"x": [0, 1]}'), "lacks v"),
    "range is a number": (put("training_range", "3"), "must hold"),
    "state of another length": (put("initial_state", "[0, 0]"), "state must have 2 element"),
    "layout of another length": (put("state_layout", '["v_last"]'), "state_layout names 1 elements"),
    "layout is no JSON": (put("state_layout", "[v_last"), "'state_layout' cannot be read"),
    "layout is a number": (put("state_layout", "8"), "must be a list of names"),
    "state is not finite": (put("initial_state", "[NaN, 0, 0, 0, 0, 0, 0, 0]"), "must be a list of numbers"),
    "range upside down": (put("training_range", '{"x": [1, 0], "v": [0, 1]}'), "of x must be two numbers, least first"),
    "empty state": (put("initial_state", "[]"), "at least one number"),
    "single precision": (single_precision_x, "x must be float64|breaks the ONNX standard"),
    "other inputs": (no_v, "has the inputs x, v, state, found x, v_other, state"),
    "NaN weights": (weights_are_nan, "holds NaN"),
    "short weights": (short_weights, "cannot be read|breaks the ONNX standard"),
    "nodes out of order": (cycle, "breaks the ONNX standard"),
}


@pytest.mark.parametrize("what", BAD)
def test_a_bad_file_gets_one_sentence(saved: tuple[TwoNetworkModel, Path], tmp_path: Path, what: str) -> None:
    change, sentence = BAD[what]
    proto, path = onnx.load(saved[1]), tmp_path / "bad.onnx"
    change(proto)
    path.write_bytes(proto.SerializeToString())
    with pytest.raises(NetworkError, match=sentence) as caught:
        onnx_reading.read(path)
    assert str(path) in str(caught.value) and "\n" not in str(caught.value)


def test_a_foreign_network_is_no_surrogate(tmp_path: Path) -> None:
    proto = make_model([helper.make_node("Tanh", ["u"], ["y"])], {"u": (1,)}, ["y"])
    path = tmp_path / "foreign.onnx"
    path.write_bytes(proto.SerializeToString())
    with pytest.raises(NetworkError, match="has the inputs x, v, state, found u"):
        onnx_reading.read(path)


@pytest.mark.parametrize("content", [b"", b"not a network", b"PK\x03\x04" + bytes(40), bytes(1000), b"\x08"])
def test_what_is_not_onnx(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "n.onnx"
    path.write_bytes(content)
    with pytest.raises(NetworkError, match=r"the file is empty|not an ONNX file"):
        onnx_reading.load(path)


def test_no_such_file(tmp_path: Path) -> None:
    with pytest.raises(NetworkError, match="there is no such file"):
        onnx_reading.load(tmp_path / "none.onnx")


def test_truncation_anywhere_is_noticed(saved: tuple[TwoNetworkModel, Path], tmp_path: Path) -> None:
    """Every prefix is refused with one sentence or, where only trailing metadata are lost, at least told apart."""
    whole, path = saved[1].read_bytes(), tmp_path / "cut.onnx"
    for size in np.linspace(1, len(whole) - 1, 60).astype(int):
        path.write_bytes(whole[:size])
        with pytest.raises(NetworkError) as caught:
            onnx_reading.read(path)
        assert "\n" not in str(caught.value)


def test_an_element_type_without_a_name_is_one_sentence(tmp_path: Path, saved: tuple[TwoNetworkModel, Path]) -> None:
    """Found by changed bytes."""
    proto = onnx.load(str(saved[1]))
    next(port for port in proto.graph.input if port.name == "state").type.tensor_type.elem_type = 75
    onnx.save(proto, tmp_path / "odd.onnx")
    with pytest.raises(NetworkError, match=r"odd\.onnx: input state must be float64 \(DOUBLE\), found type 75"):
        onnx_reading.read(tmp_path / "odd.onnx")


@pytest.mark.parametrize("text", ['{"x": "m", "v" "m/s"}', "[1]", "", "[" * 100_000])
def test_units_that_are_no_object_are_one_sentence(
    tmp_path: Path, saved: tuple[TwoNetworkModel, Path], text: str
) -> None:
    """Found by changed bytes: the rig was asked whether it turns, and the answer was a traceback."""
    proto = onnx.load(str(saved[1]))
    next(entry for entry in proto.metadata_props if entry.key == "units").value = text
    onnx.save(proto, tmp_path / "odd.onnx")
    with pytest.raises(NetworkError, match=r"odd\.onnx: the metadata entry 'units'"):
        onnx_reading.read(tmp_path / "odd.onnx")
