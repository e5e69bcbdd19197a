"""ONNX file to FMU by one command, run by an independent importer against an independent runtime."""

from __future__ import annotations

import ctypes
from dataclasses import replace
from pathlib import Path
from typing import Any

import fmpy
import numpy as np
import onnx
import onnxruntime
import pytest
from fmpy.validation import validate_fmu
from onnx import TensorProto, helper, numpy_helper
from surrogate_harness import make_model

from hystid.cli.run import run
from hystid.errors import FmuError, UsageError
from hystid.fmu import Driver, build_network
from hystid.fmu.door import open_fmu
from hystid.fmu.native import Instance


@pytest.fixture
def network(tmp_path: Path) -> Path:
    rng = np.random.default_rng(5)
    weights = {"W": rng.normal(size=(3, 4)), "b": rng.normal(size=4), "V": rng.normal(size=(4, 2))}
    graph = helper.make_graph(
        [
            helper.make_node("MatMul", ["u", "W"], ["s"]),
            helper.make_node("Add", ["s", "b"], ["t"]),
            helper.make_node("Tanh", ["t"], ["h"]),
            helper.make_node("MatMul", ["h", "V"], ["y"]),
        ],
        "net",
        [helper.make_tensor_value_info("u", TensorProto.DOUBLE, [1, 3])],
        [helper.make_tensor_value_info("y", TensorProto.DOUBLE, [1, 2])],
        [numpy_helper.from_array(value, name) for name, value in weights.items()],
    )
    path = tmp_path / "net.onnx"
    onnx.save(helper.make_model(graph, opset_imports=[helper.make_opsetid("", 18)], ir_version=10), path)
    return path


@pytest.mark.parametrize("fmi", ["2", "3"])
def test_a_network_becomes_an_fmu(network: Path, tmp_path: Path, fmi: str) -> None:
    out = tmp_path / "net.fmu"
    assert run(["build", str(network), "--fmi", fmi, "-o", str(out)]) == 0
    point = np.array([[0.3, -1.2, 2.0]])
    names = [v.name for v in fmpy.read_model_description(str(out)).modelVariables if v.causality == "input"]
    start = dict(zip(names, point[0], strict=True))
    result = fmpy.simulate_fmu(str(out), start_values=start, stop_time=1e-3, output_interval=1e-3)
    outputs = [name for name in result.dtype.names if name.startswith("y")]
    expected = onnxruntime.InferenceSession(network).run(None, {"u": point})[0][0]
    # both in double precision; only the order of summation may differ
    np.testing.assert_allclose([result[name][-1] for name in outputs], expected, rtol=1e-12)


@pytest.mark.parametrize("kind", ["CoSimulation", "ModelExchange"])
def test_arrays_of_fmi_3_run_in_an_independent_importer(network: Path, tmp_path: Path, kind: str) -> None:
    out = tmp_path / "net.fmu"
    assert run(["build", str(network), "--fmi", "3", "--arrays", "-o", str(out)]) == 0
    listed = {v.name: v.shape for v in fmpy.read_model_description(str(out)).modelVariables}
    assert listed["u"] == (3,) and listed["y"] == (2,) and "u[1]" not in listed
    assert validate_fmu(str(out)) == []
    point = np.array([[0.3, -1.2, 2.0]])
    signals = np.zeros(2, dtype=[("time", "f8"), ("u", "f8", (3,))])
    signals["time"], signals["u"] = [0.0, 1e-3], point
    result = fmpy.simulate_fmu(
        str(out), fmi_type=kind, input=signals, stop_time=1e-3, output_interval=1e-3, output=["y"]
    )
    expected = onnxruntime.InferenceSession(network).run(None, {"u": point})[0][0]
    # both in double precision; only the order of summation may differ
    np.testing.assert_allclose(result["y"][-1], expected, rtol=1e-12)


def test_arrays_of_fmi_3_are_whole(network: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Got, set and derived as a whole, by the same driver and the same regression as single numbers."""
    single = build_network(network, tmp_path / "single.fmu", fmi=3).path
    out = build_network(network, tmp_path / "net.fmu", fmi=3, arrays=True).path
    t, u = np.arange(5) * 1e-3, np.random.default_rng(1).normal(size=(5, 3))
    table = {f"u[{i + 1}]": u[:, i] for i in range(3)}
    # inputs are held over a step when they are set one by one, and so are those of the table
    apart = Driver(single).simulate(t, table, interpolation="hold")
    driver = Driver(out)
    assert driver.is_own  # one call, to the same bits; the steps of ``record`` one by one agree to rounding
    together = driver.simulate(t, {"u": u}, interpolation="hold")["y"]
    np.testing.assert_array_equal(together, np.column_stack([apart["y[1]"], apart["y[2]"]]))
    stepped = driver.record(t, {"u": u}, interpolation="hold")["y"]
    np.testing.assert_allclose(together[0], stepped[0], rtol=1e-14)
    assert run(["regress", str(out)]) == 0
    fmu = open_fmu(out)
    with Instance(fmu, "CoSimulation") as instance:
        instance.initialise(0.0, [(fmu.signals["u"], u[0])])
        vr = {name: ctypes.c_uint32(fmu.signals[name].reference) for name in ("u", "y")}
        jacobian = np.zeros((3, 2))
        for i, seed in enumerate(np.eye(3)):
            instance.call(
                "GetDirectionalDerivative", ctypes.byref(vr["y"]), ctypes.c_size_t(1), ctypes.byref(vr["u"]),
                ctypes.c_size_t(1), seed.ctypes.data_as(ctypes.c_void_p), ctypes.c_size_t(3),
                jacobian[i].ctypes.data_as(ctypes.c_void_p), ctypes.c_size_t(2),
            )  # fmt: skip
        step = 1e-6  # the error of a central difference is of order 1e-10 there
        session = onnxruntime.InferenceSession(network)
        beside = [session.run(None, {"u": u[:1] + s * step * row})[0] for row in np.eye(3) for s in (1, -1)]
        numeric = [(a - b)[0] / (2 * step) for a, b in zip(beside[::2], beside[1::2], strict=True)]
        np.testing.assert_allclose(jacobian, numeric, atol=1e-8)
        room = np.zeros(3)
        for reference, count in ((fmu.signals["u"].reference + 1, 1), (fmu.signals["u"].reference, 2)):
            with pytest.raises(FmuError, match=r"inside of an array|1 variables, 2 values"):
                instance.call(
                    "GetFloat64", ctypes.byref(ctypes.c_uint32(reference)), ctypes.c_size_t(1),
                    room.ctypes.data_as(ctypes.c_void_p), ctypes.c_size_t(count),
                )  # fmt: skip
    capsys.readouterr()
    assert run(["build", str(network), "--arrays", "-o", str(out)]) == 2
    assert "in FMI 3 only" in capsys.readouterr().err
    with pytest.raises(UsageError, match=r"FMI 2\.0 has single numbers only"):
        build_network(network, out, arrays=True)


def test_a_network_has_no_parameters(network: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["build", str(network), "--set", "m=1", "-o", str(tmp_path / "net.fmu")]) == 2
    assert "a network has no parameters" in capsys.readouterr().err
    assert not (tmp_path / "net.fmu").exists()


def low_pass(rate: float | None) -> onnx.ModelProto:
    """s_next = s + 0.2 (x - s), R = s_next, at this sample rate [Hz]."""
    nodes = [
        helper.make_node("Sub", ["x", "s"], ["gap"]),
        helper.make_node("Mul", ["gap", "part"], ["change"]),
        helper.make_node("Add", ["s", "change"], ["s_next"]),
        helper.make_node("Identity", ["s_next"], ["R"]),
    ]
    proto = make_model(nodes, {"x": (1,), "s": (1,)}, ["R", "s_next"], {"part": np.array([0.2])})
    if rate is not None:
        proto.metadata_props.add(key="sample_rate", value=repr(rate))
    return proto


def answer(path: Path, kind: str, step: float, stop: float) -> np.ndarray:
    """R at each ms under x = 1, by FMPy."""
    rows = fmpy.simulate_fmu(str(path), fmi_type=kind, stop_time=stop, step_size=step, output_interval=step,
                             start_values={"x": 1.0}, output=["R"], solver="Euler", record_events=False)  # fmt: skip
    times = np.arange(1, round(stop / 1e-3) + 1) * 1e-3
    return rows["R"][np.searchsorted(rows["time"], times + 1e-7) - 1]


@pytest.mark.parametrize("fmi", [2, 3])
def test_a_recurrent_network_keeps_its_sample_rate(tmp_path: Path, fmi: Any) -> None:
    """One sample per ms whatever the steps of the importer are: 1 - 0.8^k after k samples."""
    (tmp_path / "filter.onnx").write_bytes(low_pass(1e3).SerializeToString())
    path = build_network(tmp_path / "filter.onnx", tmp_path / "filter.fmu", fmi=fmi).path
    assert validate_fmu(str(path)) == []
    k = np.arange(1, 21)
    for step in (1e-3, 5e-4, 1e-4, 2e-3, 5e-3):
        found = answer(path, "CoSimulation", step, 0.02)
        at_ends = np.flatnonzero(np.abs(k * 1e-3 / step - np.round(k * 1e-3 / step)) < 1e-6)
        # steps of a sample or more: k samples at k ms; finer ones take sample 0 in the first step, so that it is k + 1
        n = k + 1 if step < 1e-3 else k
        np.testing.assert_allclose(found[at_ends], 1 - 0.8 ** n[at_ends], rtol=1e-12, err_msg=str(step))
    exchange = answer(path, "ModelExchange", 1e-3, 0.02)
    np.testing.assert_allclose(
        exchange[:-1], 1 - 0.8 ** (k[:-1] + 1), rtol=1e-12
    )  # the sample at the start is the first


@pytest.mark.parametrize("fmi", [2, 3])
def test_without_a_sample_rate_a_step_is_a_sample_and_nothing_else_is_offered(tmp_path: Path, fmi: Any) -> None:
    (tmp_path / "filter.onnx").write_bytes(low_pass(None).SerializeToString())
    path = build_network(tmp_path / "filter.onnx", tmp_path / "filter.fmu", fmi=fmi).path
    assert validate_fmu(str(path)) == []
    described = fmpy.read_model_description(str(path))
    assert described.modelExchange is None and not described.coSimulation.canHandleVariableCommunicationStepSize
    fmu = open_fmu(path)
    with pytest.raises(FmuError, match="model exchange is not offered: the memory moves on with each step"):
        Instance(replace(fmu, model_exchange=fmu.co_simulation), "ModelExchange")
    x = np.ones(21)
    np.testing.assert_allclose(Driver(path).simulate(np.arange(21) * 0.07, {"x": x})["R"], 1 - 0.8 ** np.arange(1, 22))
