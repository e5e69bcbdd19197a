"""Surrogate and oscillator blocks in process: the model's own answer, memory that moves once per sample."""

from __future__ import annotations

import json
import subprocess
from pathlib import Path

import numpy as np
import pytest
from onnx import TensorProto, helper
from surrogate_harness import make_model, motion, outside, random_model

from hystid.compiled import SHELL, CompiledModel
from hystid.errors import NetworkError, UsageError
from hystid.networks import TwoNetworkModel
from hystid.networks import onnx as exchange
from hystid.surrogate import emit, model_code, network_code, oscillator_code, surrogate_code
from hystid.toolchain import compiler

DT = 1e-4


@pytest.fixture(scope="module", params=[0.0, 0.02], ids=["published rule", "velocity band"])
def identified(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> tuple[TwoNetworkModel, Path]:
    model, path = random_model(5, 2, request.param), tmp_path_factory.mktemp("blocks") / "surrogate.onnx"
    exchange.write(model, path)
    return model, path


def save(folder: Path, proto: object, name: str = "net.onnx") -> Path:
    path = folder / name
    path.write_bytes(proto.SerializeToString())  # type: ignore[attr-defined]
    return path


def test_surrogate_gives_the_models_force(identified: tuple[TwoNetworkModel, Path]) -> None:
    model, path = identified
    x, v = motion(20_000)
    force, _ = model.response(x, v)
    got = CompiledModel(surrogate_code(path)).simulate({"x": x, "v": v}, DT, outputs=["R", "outside_training_range"])
    # roundings of another order of summation, carried along by the memory
    np.testing.assert_allclose(got["R"], force, rtol=0, atol=1e-11 * np.abs(force).max())
    outside_range = (np.abs(x) > 0.01) | (np.abs(v) > 2.0)
    np.testing.assert_array_equal(got["outside_training_range"], outside_range.astype(float))
    assert 0 < outside_range.sum() < len(x)


def test_oscillator_gives_the_models_free_run(identified: tuple[TwoNetworkModel, Path]) -> None:
    """Same integrator, same rule: memory as it stands within a step, renewed at the accepted sample."""
    model, path = identified
    t = DT * np.arange(20_000)
    force = 60 * np.sin(2 * np.pi * (5 * t + 20 * t**2))
    expected = model.free_run(force, DT, x_start=1e-3, v_start=-0.05)
    got = CompiledModel(oscillator_code(path)).simulate(
        {"F": force}, DT, parameters={"x_start": 1e-3, "v_start": -0.05}, outputs=["x", "v", "a", "R"]
    )
    for name, values in got.items():
        np.testing.assert_allclose(
            values, expected[name], rtol=0, atol=1e-9 * np.abs(expected[name]).max(), err_msg=name
        )
    np.testing.assert_allclose(model.mass * got["a"], force - got["R"], atol=1e-12 * np.abs(force).max())


def test_mass_can_be_given(identified: tuple[TwoNetworkModel, Path]) -> None:
    _, path = identified
    code = oscillator_code(path, mass=2.5)
    assert code.variable("m").start == 2.5
    force = np.full(10, 7.0)
    got = CompiledModel(code).simulate({"F": force}, DT, outputs=["a", "R"])
    np.testing.assert_allclose(got["a"], (force - got["R"]) / 2.5, rtol=1e-14)
    with pytest.raises(UsageError, match="needs a mass above 0 kg, found 0"):
        oscillator_code(path, mass=0.0)


def test_units_and_interface(identified: tuple[TwoNetworkModel, Path]) -> None:
    _, path = identified
    surrogate, oscillator = surrogate_code(path), oscillator_code(path)
    assert {v.name: v.unit for v in surrogate.variables if v.causality in ("input", "output")} == {
        "x": "m", "v": "m/s", "R": "N", "outside_training_range": "",
    }  # fmt: skip
    assert {v.name for v in oscillator.variables if v.causality == "output"} == {
        "x",
        "v",
        "a",
        "R",
        "outside_training_range",
    }
    assert surrogate.variable("x").nominal == 0.005 and oscillator.variable("v").nominal == 1.0  # half the range
    assert oscillator.states == ("x", "v") and oscillator.experiment.step == DT
    assert model_code(path) == surrogate
    assert surrogate.token != oscillator.token and surrogate.token == surrogate_code(path).token


def gated(folder: Path) -> Path:
    """A memory that moves at every sample, so that one step too many shows: s' = tanh(0.5 s + u), y = s' + u."""
    nodes = [
        helper.make_node("Mul", ["s", "half"], ["scaled"]),
        helper.make_node("Add", ["scaled", "u"], ["sum"]),
        helper.make_node("Tanh", ["sum"], ["s_next"]),
        helper.make_node("Add", ["s_next", "u"], ["y"]),
    ]
    proto = make_model(nodes, {"u": (1, 2), "s": (1, 2)}, ["y", "s_next"], {"half": np.array(0.5)})
    helper.set_model_props(proto, {"initial_state": json.dumps([0.25, -0.25]), "units": json.dumps({"u": "V"})})
    return save(folder, proto, "gated.onnx")


def test_memory_of_any_network_is_recognised_by_name(tmp_path: Path) -> None:
    code = network_code(gated(tmp_path))
    assert model_code(gated(tmp_path)) == code
    assert [(v.name, v.causality, v.unit, v.start) for v in code.variables] == [
        ("u[1]", "input", "V", 0.0),
        ("u[2]", "input", "V", 0.0),
        ("y[1]", "output", "", None),
        ("y[2]", "output", "", None),
        ("s[1]", "local", "", 0.25),
        ("s[2]", "local", "", -0.25),
    ]
    u = np.random.default_rng(1).normal(size=(2, 50))
    u[:, 20:25] = u[:, 19:20]  # the same inputs again are new samples all the same
    got = CompiledModel(code).simulate({"u[1]": u[0], "u[2]": u[1]}, DT, outputs=["y[1]", "y[2]"], interpolation="hold")
    state = np.array([0.25, -0.25])
    for k in range(50):
        state = np.tanh(0.5 * state + u[:, k])
        np.testing.assert_allclose([got["y[1]"][k], got["y[2]"][k]], state + u[:, k], rtol=1e-13)


def test_memory_can_be_named_or_denied(tmp_path: Path) -> None:
    path = gated(tmp_path)
    plain = network_code(path, memory={})
    assert {v.name for v in plain.variables if v.causality == "input"} == {"u[1]", "u[2]", "s[1]", "s[2]"}
    with pytest.raises(NetworkError, match="memory 's' -> 'z': there is no such"):
        network_code(path, memory={"s": "z"})

    with pytest.raises(NetworkError, match="two inputs cannot take"):
        network_code(path, memory={"s": "y", "u": "y"})


def test_elements_can_have_names(tmp_path: Path) -> None:
    proto = make_model([helper.make_node("Neg", ["x"], ["y"])], {"x": (1, 3)}, ["y"])
    helper.set_model_props(proto, {"names": json.dumps({"x": ["speed", "Speed", "gap width"], "y": ["too few"]})})
    names = [variable.name for variable in network_code(save(tmp_path, proto)).variables]
    assert names == ["speed", "Speed_2", "gap_width", "y[1]", "y[2]", "y[3]"]


def test_open_axes_take_their_given_length(tmp_path: Path) -> None:
    proto = make_model([helper.make_node("ReduceSum", ["x"], ["y"])], {"x": ("batch", "time", 2)}, ["y"])
    path = save(tmp_path, proto)
    assert len([v for v in network_code(path).variables if v.causality == "input"]) == 2
    names = [v.name for v in network_code(path, sizes={"time": 3}).variables if v.causality == "input"]
    assert names == ["x[1,1]", "x[1,2]", "x[2,1]", "x[2,2]", "x[3,1]", "x[3,2]"]


def test_single_precision_networks_are_computed_in_double(tmp_path: Path) -> None:
    """The stored weights are taken as they are; only the arithmetic is finer than ONNX Runtime's."""
    rng = np.random.default_rng(3)
    weights, bias = rng.normal(size=(3, 4)).astype(np.float32), rng.normal(size=4).astype(np.float32)
    nodes = [helper.make_node("Gemm", ["x", "W", "b"], ["h"]), helper.make_node("Tanh", ["h"], ["y"])]
    proto = make_model(nodes, {"x": (1, 3)}, ["y"], {"W": weights, "b": bias}, kind=TensorProto.FLOAT)
    x = np.array([[0.3, -0.7, 1.1]], dtype=np.float32)
    model = CompiledModel(network_code(save(tmp_path, proto)))
    rows = {f"x[{i + 1}]": np.full(2, float(x[0, i])) for i in range(3)}
    got = model.simulate(rows, DT, outputs=[f"y[{i + 1}]" for i in range(4)])
    y = np.array([got[f"y[{i + 1}]"][0] for i in range(4)])
    np.testing.assert_allclose(y, np.tanh(x.astype(float) @ weights.astype(float) + bias)[0], rtol=1e-14)
    np.testing.assert_allclose(y, outside(proto, {"x": x})[0][0], atol=1e-6)


def test_whole_numbers_and_truth_values_keep_their_types(tmp_path: Path) -> None:
    graph = helper.make_graph(
        [helper.make_node("Less", ["x", "limit"], ["below"]), helper.make_node("Add", ["n", "n"], ["twice"])],
        "types",
        [
            helper.make_tensor_value_info("x", TensorProto.DOUBLE, [1]),
            helper.make_tensor_value_info("n", TensorProto.INT64, [1]),
        ],
        [
            helper.make_tensor_value_info("below", TensorProto.BOOL, [1]),
            helper.make_tensor_value_info("twice", TensorProto.INT64, [1]),
        ],
        [helper.make_tensor("limit", TensorProto.DOUBLE, [], [2.0])],
    )
    proto = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
    code = network_code(save(tmp_path, proto))
    assert {v.name: v.type for v in code.variables} == {
        "x": "Real",
        "n": "Integer",
        "below": "Boolean",
        "twice": "Integer",
    }
    got = CompiledModel(code).simulate(
        {"x": [1.0, 3.0], "n": [4.0, 5.0]}, DT, outputs=["below", "twice"], interpolation="hold"
    )
    assert list(got["below"]) == [1.0, 0.0] and list(got["twice"]) == [8.0, 10.0]


def test_large_networks_work_in_the_instances_memory(tmp_path: Path) -> None:
    """Above a few thousand intermediate numbers the stack would be at risk."""
    rng = np.random.default_rng(5)
    weights = rng.normal(0, 0.05, (2, 6000))
    nodes = [
        helper.make_node("MatMul", ["x", "W"], ["h"]),
        helper.make_node("Tanh", ["h"], ["t"]),
        helper.make_node("ReduceSum", ["t"], ["y"], keepdims=0),
    ]
    code = network_code(save(tmp_path, make_model(nodes, {"x": (1, 2)}, ["y"], {"W": weights})))
    assert code.n_values > 12_000 and "t_h[6000]" not in code.sources["model.c"]
    got = CompiledModel(code).simulate({"x[1]": [0.3, 0.4], "x[2]": [-0.2, 0.1]}, DT, outputs=["y"])["y"]
    np.testing.assert_allclose(
        got, [np.tanh(np.array(x) @ weights).sum() for x in ([0.3, -0.2], [0.4, 0.1])], rtol=1e-12
    )


EXERCISE = """
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "hy_model.h"
static void quiet(void *owner, int level, const char *text) { (void)owner; (void)level; (void)text; }
int main(void)
{
    const hy_model *m = &hy_the_model;
    const size_t n = (size_t)m->n_values, size = n * sizeof(double);
    double *v = malloc(size), *seed = calloc(n, sizeof *v), *sens = calloc(n, sizeof *v);
    hy_data d = {v, quiet, 0};
    int outcome = HY_OK;
    memcpy(v, m->start, size);
    if (m->initialise) outcome |= m->initialise(&d);
    for (int k = 0; k < 3000; k++) {
        for (int i = 0; i < m->n_u; i++) v[m->u + i] = 3 * sin(0.01 * k * (i + 1));
        for (int i = 0; i < m->n_x; i++) v[m->x + i] = sin(0.02 * k * (i + 1));
        for (size_t i = 0; i < n; i++) seed[i] = 0.1;
        outcome |= m->evaluate(&d) | m->forward(&d, seed, sens) | m->adjoint(&d, seed, sens);
        if (m->completed_step) outcome |= m->completed_step(&d);
    }
    free(v), free(seed), free(sens);
    return outcome;
}
"""


@pytest.mark.parametrize("kind", ["surrogate", "oscillator", "network"])
def test_generated_code_is_clean(tmp_path: Path, kind: str) -> None:
    """No warning even of the strict kinds, and nothing for the address and undefined-behaviour sanitisers to find."""
    exchange.write(random_model(3, 1, 0.01), tmp_path / "s.onnx")
    code = {
        "surrogate": surrogate_code,
        "oscillator": oscillator_code,
        "network": lambda _: network_code(gated(tmp_path)),
    }[kind](tmp_path / "s.onnx")
    (tmp_path / "model.c").write_text(code.sources["model.c"])
    (tmp_path / "main.c").write_text(EXERCISE)
    strict = ["-Wall", "-Wextra", "-Wconversion", "-Wshadow", "-pedantic", "-Werror"]
    sanitisers = ["-fsanitize=address,undefined", "-fno-sanitize-recover=all"]
    common = ["-std=c11", "-O1", *strict, "-I", str(SHELL), "main.c", "model.c", "-lm", "-o"]
    built = subprocess.run([*compiler(), *common, "plain"], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert built.returncode == 0, built.stderr
    checked = subprocess.run(
        [*compiler(), *sanitisers, *common, "checked"], cwd=tmp_path, capture_output=True, check=False
    )
    program = "./checked" if checked.returncode == 0 else "./plain"  # not every compiler brings the sanitisers
    run = subprocess.run([program], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert (run.returncode, run.stderr) == (0, "")


def test_large_ensembles_are_compiled_apart_to_the_same_bits(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Beyond some size matrix products are functions of their own: far less compiler time, the same answer."""
    path = tmp_path / "surrogate.onnx"
    exchange.write(random_model(3, 3), path)
    x, v = motion(400)
    answers, texts = [], []
    for many in (0, 10**9):
        monkeypatch.setattr(emit, "MANY", many)
        code = surrogate_code(path)
        texts.append(code.sources["model.c"])
        answers.append(CompiledModel(code).simulate({"x": x, "v": v}, DT, outputs=["R"])["R"])
    assert "noinline" in texts[0] and "noinline" not in texts[1]
    np.testing.assert_array_equal(*answers)
