"""ONNX file to FMU by one command, run by an independent importer against an independent runtime."""

from __future__ import annotations

from pathlib import Path

import fmpy
import numpy as np
import onnx
import onnxruntime
import pytest
from onnx import TensorProto, helper, numpy_helper

from hystid.cli.run import run


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


def test_a_network_has_no_parameters(network: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["build", str(network), "--set", "m=1", "-o", str(tmp_path / "net.fmu")]) == 2
    assert "a network has no parameters" in capsys.readouterr().err
    assert not (tmp_path / "net.fmu").exists()
