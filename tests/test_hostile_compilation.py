"""Networks, Modelica texts and values that would cost hours, memory without end, or an FMU full of infinities."""

from __future__ import annotations

import ctypes
import math
import os
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import onnx
import pytest
from fmu_models import jenkins, linear, unpacked
from onnx import TensorProto, helper, numpy_helper

from hystid import batch, compiled
from hystid.errors import ModelicaError, NetworkError, RecordingError
from hystid.fmu.from_modelica import _modelica_files
from hystid.fmu.native import Instance
from hystid.limits import OutOfTime, bounded, counted
from hystid.modelcode import ModelCode
from hystid.modelica import compile_model
from hystid.networks.onnx_reading import load
from hystid.recording import read
from hystid.surrogate import network_code

HUGE = 10**9


def node(kind, inputs, output="c", **attributes):
    return helper.make_node(kind, inputs, [output], **attributes)


def written(path: Path, nodes, **initialisers) -> Path:
    """A network with the input x and the output R = x + c, where the nodes make c."""
    x = helper.make_tensor_value_info("x", TensorProto.FLOAT, [1])
    out = helper.make_tensor_value_info("R", TensorProto.FLOAT, ["n"])
    tensors = [numpy_helper.from_array(np.asarray(values), name) for name, values in initialisers.items()]
    graph = helper.make_graph([*nodes, node("Add", ["x", "c"], "R")], "g", [x], [out], tensors)
    onnx.save(helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8), path)
    return path


_SIZE = np.array([HUGE], np.int64)
TOO_LARGE = {
    "constant of shape": ([node("ConstantOfShape", ["n"])], {"n": _SIZE}),
    "range": (
        [node("Range", ["a", "n", "d"])],
        {"a": np.array(0, np.int64), "n": np.array(HUGE, np.int64), "d": np.array(1, np.int64)},
    ),
    "tile": ([node("Tile", ["x", "n"])], {"n": _SIZE}),
    "expand": ([node("Expand", ["x", "n"])], {"n": _SIZE}),
    "pad": ([node("Pad", ["x", "n"])], {"n": np.array([0, HUGE], np.int64)}),
    "outer sum": (
        [node("Add", ["p", "q"])], {"p": np.zeros((100_000, 1), np.float32), "q": np.zeros((1, 100_000), np.float32)},
    ),
    "doubled again and again": (
        [node("Concat", ["x", "x"], "c0", axis=0)]
        + [node("Concat", [f"c{i}"] * 2, f"c{i + 1}", axis=0) for i in range(30)]
        + [node("Identity", ["c30"])],
        {},
    ),
    "many large ones": (
        [node("ConstantOfShape", ["n"], f"k{i}") for i in range(20)] + [node("Identity", ["k0"])],
        {"n": np.array([900_000], np.int64)},
    ),
    "deep": (
        [node("Tanh", ["x"], "t0")]
        + [node("Tanh", [f"t{i}"], f"t{i + 1}") for i in range(20_000)]
        + [node("Tanh", ["t20000"])],
        {},
    ),
}  # fmt: skip


@pytest.mark.parametrize("kind", TOO_LARGE)
def test_networks_that_grow_are_refused_before_they_do(tmp_path: Path, kind: str) -> None:
    nodes, initialisers = TOO_LARGE[kind]
    with pytest.raises(NetworkError, match="too large to compile"):
        network_code(written(tmp_path / "net.onnx", nodes, **initialisers))


def test_functions_of_functions_are_counted_before_they_are_written_out(tmp_path: Path) -> None:
    """Each calls the one before it twice: 40 of them are 2^40 nodes."""
    domains = [helper.make_opsetid("", 17), helper.make_opsetid("own", 1)]
    model = onnx.load(written(tmp_path / "net.onnx", [helper.make_node("f40", ["x"], ["c"], domain="own")]))
    model.opset_import.append(domains[1])
    for k in range(41):
        calls = [("a", "b"), ("b", "c")]
        body = [helper.make_node(f"f{k - 1}", [u], [y], domain="own") for u, y in calls] if k else [node("Tanh", ["a"])]
        model.functions.append(helper.make_function("own", f"f{k}", ["a"], ["c"], body, domains))
    onnx.save(model, tmp_path / "net.onnx")
    with pytest.raises(NetworkError, match=f"has {2**40 + 1} nodes with its functions written out, more than"):
        network_code(tmp_path / "net.onnx")


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere a process cannot limit another one")
def test_a_compiler_ends_by_itself_where_hystid_is_killed(monkeypatch: pytest.MonkeyPatch) -> None:
    """Nobody was left to stop it, and it computed on for as long as it liked."""
    import resource

    monkeypatch.setenv("HYSTID_COMPILE_SECONDS", "7")

    def limit() -> int:
        process = subprocess.Popen(["sleep", "60"], start_new_session=True)
        with counted(process):
            return resource.prlimit(process.pid, resource.RLIMIT_CPU)[0]

    assert bounded(limit) == 8


@pytest.mark.parametrize(("value", "word"), [(math.inf, "infinite"), (-math.inf, "infinite"), (math.nan, "NaN")])
def test_weights_that_are_no_numbers_are_refused(tmp_path: Path, value: float, word: str) -> None:
    path = written(tmp_path / "net.onnx", [node("Identity", ["w"])], w=np.array([1, value], np.float32))
    with pytest.raises(NetworkError, match=f"'w' holds {word}"):
        load(path)


@pytest.mark.parametrize(("first", "says"), [("x", "must be matrices"), ("a", "do not match")])
def test_layers_of_other_shapes_are_refused(tmp_path: Path, first: str, says: str) -> None:
    """Found by changed bytes: an input with one axis was a traceback while its C was written."""
    weights = {"a": np.ones((1, 2), np.float32), "w": np.ones((3, 4), np.float32)}
    path = written(tmp_path / "net.onnx", [node("Gemm", [first, "w"])], **weights)
    with pytest.raises(NetworkError, match=rf"\(Gemm\): .*{says}"):
        network_code(path)


def test_complex_weights_are_refused(tmp_path: Path) -> None:
    """Their imaginary parts were left out, with a warning of NumPy."""
    path = written(tmp_path / "net.onnx", [node("Identity", ["w"])], w=np.array([1, 1j], np.complex64))
    with pytest.raises(NetworkError, match="'w' cannot be read as numbers: complex"):
        network_code(path)


@pytest.mark.parametrize(
    "stated", ["StopTime = 1e300, Interval = 1e-300", "Interval = 0", "StartTime = 2, StopTime = 1", "Tolerance = -1"]
)
def test_experiments_that_no_run_follows_from_are_refused(tmp_path: Path, stated: str) -> None:
    path = tmp_path / "decay.mo"
    model = f"Real x(start = 1, fixed = true); equation der(x) = -x; annotation(experiment({stated}));"
    path.write_text(f"model M {model} end M;")
    with pytest.raises(ModelicaError, match=rf"decay\.mo:1: no run follows .*\({stated}\)"):
        compile_model(f"{path}:M")


def test_bounded_work_ends(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HYSTID_COMPILE_SECONDS", "0.2")

    def endless() -> None:
        while True:
            time.perf_counter()

    with pytest.raises(OutOfTime):
        bounded(endless)


def test_a_pipe_beside_the_model_holds_nothing_up(tmp_path: Path) -> None:
    """What lies beside a model decides whether its FMU is the one that is kept; a pipe there was read for ever."""
    path = tmp_path / "decay.mo"
    path.write_text("model M Real x(start = 1, fixed = true); equation der(x) = -x; end M;")
    os.mkfifo(tmp_path / "pipe.mo")
    (tmp_path / "endless.mo").symlink_to("/dev/zero")
    assert path in _modelica_files(f"{path}:M", [])
    assert all(found.is_file() for found in _modelica_files(f"{path}:M", []))


def test_work_within_bounded_work_is_a_plain_call() -> None:
    assert bounded(lambda: bounded(lambda: 3)) == 3


@pytest.mark.parametrize("model", ["HystId.Oscillators.BoucWen", "a sum without end"])
def test_a_compilation_has_one_deadline(tmp_path: Path, model: str) -> None:
    """A millisecond stands for the usual limit. In a process of its own: work that is ended anywhere may leave objects
    to Python's collector, whose warnings are errors here."""
    path = tmp_path / "long.mo"
    total = " + ".join(f"{k} * x" for k in range(2_000))
    path.write_text(f"model M Real x(start = 1, fixed = true); equation der(x) = {total}; end M;")
    code = (
        "import sys\nfrom hystid.errors import ModelicaError\nfrom hystid.modelica import compile_model\n"
        "try: compile_model(sys.argv[1])\nexcept ModelicaError as error: print(error)\n"
    )
    name = model if model.startswith("HystId") else f"{path}:M"
    done = subprocess.run(
        [sys.executable, "-c", code, name],
        env={**os.environ, "HYSTID_COMPILE_SECONDS": "0.001"}, capture_output=True, text=True, timeout=300, check=True,
    )  # fmt: skip
    assert "takes more than 0.001 s (HYSTID_COMPILE_SECONDS raises this)" in done.stdout


@pytest.mark.parametrize("model", ["modelica", "network"])
def test_the_c_compiler_has_what_is_left_of_the_deadline(tmp_path: Path, model: str) -> None:
    """One that never ends, and starts another that does not, as drivers of compilers do; neither is left behind."""
    path = written(tmp_path / "net.onnx", [node("Tanh", ["x"])])
    if model == "modelica":
        path = tmp_path / "decay.mo"
        path.write_text("model M Real x(start = 1, fixed = true); equation der(x) = -x; end M;")
    endless = tmp_path / "endless.py"
    endless.write_text("while True: pass")
    compiler = tmp_path / "cc"
    compiler.write_text(f"#!/bin/sh\n{sys.executable} {endless}\n")
    compiler.chmod(0o755)
    limits = {"HYSTID_COMPILE_SECONDS": "2", "CC": str(compiler), "HYSTID_CACHE": str(tmp_path / "cache")}
    done = subprocess.run(
        [sys.executable, "-m", "hystid", "build", str(path), "-o", str(tmp_path / "out.fmu")],
        env={**os.environ, **limits}, capture_output=True, text=True, timeout=300,
    )  # fmt: skip
    assert done.returncode == 2
    assert "compiling takes more than 2 s (HYSTID_COMPILE_SECONDS raises this)" in done.stderr
    assert len(done.stderr.splitlines()) == 1 and not (tmp_path / "out.fmu").exists()
    running = [place.read_bytes() for place in Path("/proc").glob("[0-9]*/cmdline") if place.exists()]
    assert not any(os.fsencode(endless) in line for line in running)


def test_one_budget_of_elements_for_all_calls(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Two functions, each within the budget, and beyond it together."""
    path = tmp_path / "two.mo"
    body = "input Real x; output Real y = 0; algorithm for i in 1:1000 loop y := y + i * x; end for;"
    functions = "".join(f"function f{k} {body} end f{k}; " for k in range(2))
    for calls, refused in (("f0(x)", False), ("f0(x) + f1(x)", True)):
        path.write_text(f"model M {functions} Real x(start = 1, fixed = true); equation der(x) = {calls}; end M;")
        monkeypatch.delenv("HYSTID_COMPILE_ELEMENTS", raising=False)
        compile_model(f"{path}:M")
        monkeypatch.setenv("HYSTID_COMPILE_ELEMENTS", "20000")
        if refused:
            with pytest.raises(ModelicaError, match=r"are more than 20000 elements \(HYSTID_COMPILE_ELEMENTS raises"):
                compile_model(f"{path}:M")
        else:
            compile_model(f"{path}:M")


def limited() -> ModelCode:
    """A mass that is at least 0.5 kg and at most 8 kg."""
    code = jenkins()
    return replace(code, variables=tuple(replace(v, min=0.5, max=8.0) if v.name == "m" else v for v in code.variables))


@pytest.mark.parametrize("version", [2, 3])
def test_the_fmu_holds_parameters_to_their_limits(version: int) -> None:
    instance = Instance(unpacked(limited, version), "CoSimulation")
    slot = next(v.slot for v in limited().variables if v.name == "m")
    last = (ctypes.c_size_t(1),) if version == 3 else ()
    setter = instance.function("SetReal" if version == 2 else "SetFloat64")

    def status(value: float) -> int:
        reference, number = ctypes.c_uint32(slot), ctypes.c_double(value)
        return setter(instance.component, ctypes.byref(reference), ctypes.c_size_t(1), ctypes.byref(number), *last)

    assert [status(value) for value in (0.5, 2.0, 8.0)] == [0, 0, 0]
    assert [status(value) for value in (math.nan, math.inf)] == [3, 3]
    assert status(-1.0) == 3
    assert instance.last_message.endswith("m = -1 is below its minimum 0.5")
    assert status(8.0001) == 3
    assert instance.last_message.endswith("m = 8.0001 is above its maximum 8")


@pytest.mark.parametrize("version", [2, 3])
def test_infinite_derivatives_are_no_answer(version: int) -> None:
    """States of 1e308 are finite, what the spring makes of them is not."""
    instance = Instance(unpacked(jenkins, version), "ModelExchange")
    instance.initialise(0.0, [])
    instance.call("EnterContinuousTimeMode")
    n = len(jenkins().states)
    states, slopes = (ctypes.c_double * n)(*[1e308] * n), (ctypes.c_double * n)()
    assert instance.function("SetContinuousStates")(instance.component, states, ctypes.c_size_t(n)) == 0
    name = "GetDerivatives" if version == 2 else "GetContinuousStateDerivatives"
    assert instance.function(name)(instance.component, slopes, ctypes.c_size_t(n)) in (2, 3)
    by_name = {v.name: v.slot for v in jenkins().variables}
    last = (ctypes.c_size_t(1),) if version == 3 else ()
    reads = instance.function("GetReal" if version == 2 else "GetFloat64")

    def status(name: str) -> int:
        reference, number = ctypes.c_uint32(by_name[name]), ctypes.c_double()
        return reads(instance.component, ctypes.byref(reference), ctypes.c_size_t(1), ctypes.byref(number), *last)

    assert status("x") == 0
    for computed in ("der(v)", "a", "R"):
        assert status(computed) in (2, 3)
        assert f"{computed} is not finite" in instance.last_message


@pytest.mark.parametrize("version", [2, 3])
@pytest.mark.parametrize("way", ["Directional", "Adjoint"])
def test_infinite_directional_derivatives_are_no_answer(version: int, way: str) -> None:
    """dR = k dx: k and a seed of 1e200 each are finite, their product is not."""
    if version == 2 and way == "Adjoint":
        pytest.skip("FMI 2 has none")
    instance = Instance(unpacked(linear, version), "CoSimulation")
    model = {v.name: v for v in linear().variables}
    instance.initialise(0.0, [(model["k"], 1e200)])
    unknown, known = ctypes.c_uint32(model["R"].slot), ctypes.c_uint32(model["x"].slot)
    one, result = ctypes.c_size_t(1), ctypes.c_double()

    def status(size: float) -> int:
        seed = ctypes.c_double(size)
        sizes = ((one,), (one,)) if version == 3 else ((), ())
        return instance.function(f"Get{way}Derivative")(
            instance.component, ctypes.byref(unknown), one, ctypes.byref(known), one,
            ctypes.byref(seed), *sizes[0], ctypes.byref(result), *sizes[1],
        )  # fmt: skip

    assert status(1.0) == 0 and result.value == 1e200
    assert status(1e200) in (2, 3)
    assert "derivative is not finite" in instance.last_message


@pytest.mark.parametrize("what", ["setting", "column", "output", "seed"])
@pytest.mark.parametrize("slot", [-1, 1_000_000])
def test_tables_with_slots_outside_the_block_are_refused(what: str, slot: int) -> None:
    """The batch entry is exported: whoever calls it reads and writes no memory beside the block."""
    slots, values = (ctypes.c_int * 1)(slot), (ctypes.c_double * 2)()
    arrays, modes = (ctypes.c_void_p * 1)(ctypes.addressof(values)), (ctypes.c_int * 1)()
    table = batch._Table(version=1, rows=2, dt=0.01, substeps=1)
    setattr(table, f"n_{what}s", 1)
    setattr(table, f"{what}_slots", ctypes.addressof(slots))
    table.settings = ctypes.addressof(values)
    table.samples = table.outputs = table.gradients = table.slopes = ctypes.addressof(arrays)
    table.column_modes = ctypes.addressof(modes)
    library = ctypes.CDLL(str(compiled.compile_model_code(linear())))
    assert library.hy_run_table(ctypes.byref(table))
    assert b"no slot of the model" in table.failure and list(values) == [0, 0]


def test_one_sample_of_1e308_is_refused(tmp_path: Path) -> None:
    rows = [f"{k / 100},{math.sin(k / 5)},{math.sin(k / 5 - 0.1)}" for k in range(200)]
    rows[77] = "0.77,0.5,1e308"
    path = tmp_path / "one.csv"
    path.write_text("\n".join(["t [s],F [N],x [m]", *rows]))
    with pytest.raises(RecordingError, match="squares of numbers overflow"):
        read(path)
