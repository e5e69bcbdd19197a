"""Surrogates as FMUs in an independent importer: ONNX Runtime's answers, rollback, derivatives, hostile names."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import fmpy
import numpy as np
import onnxruntime
import pytest
from fmpy.fmi2 import FMU2Slave
from fmpy.fmi3 import FMU3Slave
from fmpy.validation import validate_fmu
from onnx import helper
from surrogate_harness import make_model, motion, random_model, smooth_slider

from hystid.fmu import build
from hystid.networks import onnx as exchange
from hystid.networks import onnx_reading
from hystid.surrogate import network_code, oscillator_code, surrogate_code

DT = 1e-4


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """surrogate.onnx and, made from that file alone, surrogate.fmu and oscillator.fmu; and the first one unpacked."""
    folder = tmp_path_factory.mktemp("fmus")
    exchange.write(random_model(11, 1), folder / "surrogate.onnx")
    build(surrogate_code(folder / "surrogate.onnx"), folder / "surrogate.fmu")
    build(oscillator_code(folder / "surrogate.onnx"), folder / "oscillator.fmu")
    for name in ("surrogate", "oscillator"):
        fmpy.extract(str(folder / f"{name}.fmu"), str(folder / name))
    return folder


@contextmanager
def running(unpacked: Path, **start: float) -> Iterator[tuple[FMU2Slave, dict[str, int]]]:
    """An instance behind its initialisation, and its value references by name."""
    described = fmpy.read_model_description(str(unpacked))
    fmu = FMU2Slave(
        guid=described.guid,
        unzipDirectory=str(unpacked),
        modelIdentifier=described.coSimulation.modelIdentifier,
        instanceName="i",
    )
    references = {variable.name: variable.valueReference for variable in described.modelVariables}
    fmu.instantiate()
    fmu.setupExperiment(startTime=0.0)
    for name, value in start.items():
        fmu.setReal([references[name]], [value])
    fmu.enterInitializationMode()
    fmu.exitInitializationMode()
    try:
        yield fmu, references
    finally:
        fmu.terminate()
        fmu.freeInstance()


def drive(fmu: FMU2Slave, vr: dict[str, int], x: np.ndarray, v: np.ndarray, first: int = 0) -> np.ndarray:
    """One doStep per sample, with the inputs of that sample; R after each."""
    force, inputs, outputs = np.empty(len(x)), [vr["x"], vr["v"]], [vr["R"]]
    for k in range(len(x)):
        fmu.setReal(inputs, [x[k], v[k]])
        fmu.doStep((first + k) * DT, DT)
        force[k] = fmu.getReal(outputs)[0]
    return force


def test_agrees_with_onnx_runtime_over_100_000_samples(folder: Path) -> None:
    x, v = motion(100_000, dt=2e-5)
    with running(folder / "surrogate") as (fmu, vr):
        ours = drive(fmu, vr, x, v)
    session = onnxruntime.InferenceSession(str(folder / "surrogate.onnx"))
    state, theirs = np.array([onnx_reading.read(folder / "surrogate.onnx")[1].initial_state]), np.empty(len(x))
    for k in range(len(x)):
        force, state = session.run(None, {"x": x[k : k + 1], "v": v[k : k + 1], "state": state})
        theirs[k] = force[0]
    np.testing.assert_allclose(ours, theirs, rtol=0, atol=1e-9 * np.abs(theirs).max())


def test_oscillator_is_the_models_free_run(folder: Path) -> None:
    t = DT * np.arange(3000)
    force = 60 * np.sin(2 * np.pi * (5 * t + 40 * t**2))
    expected = random_model(11, 1).free_run(force, DT)
    table = np.array(list(zip(t, force, strict=True)), dtype=[("time", float), ("F", float)])
    got = fmpy.simulate_fmu(
        str(folder / "oscillator"), stop_time=t[-1], step_size=DT, output_interval=DT, input=table, output=["x"],
    )  # fmt: skip
    assert len(got) == len(t)
    # the importer holds F over a step where the library interpolates it: they agree to first order in the step
    assert np.sqrt(np.mean((got["x"] - expected["x"]) ** 2)) < 2e-2 * np.std(expected["x"])
    with running(folder / "oscillator") as (fmu, vr):
        x = np.zeros(len(t))
        for k in range(1, len(t)):
            fmu.setReal([vr["F"]], [force[k - 1]])
            fmu.setRealInputDerivatives([vr["F"]], [1], [(force[k] - force[k - 1]) / DT])
            fmu.doStep((k - 1) * DT, DT)
            x[k] = fmu.getReal([vr["x"]])[0]
    np.testing.assert_allclose(x, expected["x"], rtol=0, atol=1e-9 * np.abs(x).max())  # with its slope given: the same


def test_asking_again_does_not_move_the_memory(folder: Path) -> None:
    x, v = motion(300)
    with running(folder / "surrogate") as (fmu, vr):
        plain = drive(fmu, vr, x, v)
    with running(folder / "surrogate") as (fmu, vr):
        for k in range(300):
            fmu.setReal([vr["x"], vr["v"]], [x[k], v[k]])
            asked = [fmu.getReal([vr["R"]])[0] for _ in range(3)]
            fmu.setReal([vr["x"], vr["v"]], [-x[k], -v[k]])
            fmu.getReal([vr["R"]])
            fmu.setReal([vr["x"], vr["v"]], [x[k], v[k]])
            fmu.doStep(k * DT, DT)
            again = [fmu.getReal([vr["R"]])[0] for _ in range(3)]
            assert asked == again == [plain[k]] * 3


def test_force_is_known_during_initialisation(folder: Path) -> None:
    expected = random_model(11, 1).response(np.array([2e-3]), np.array([-0.3]))[0][0]
    described = fmpy.read_model_description(str(folder / "surrogate"))
    vr = {variable.name: variable.valueReference for variable in described.modelVariables}
    fmu = FMU2Slave(
        guid=described.guid, unzipDirectory=str(folder / "surrogate"), modelIdentifier="surrogate", instanceName="i"
    )
    fmu.instantiate()
    fmu.setupExperiment(startTime=0.0)
    fmu.enterInitializationMode()
    fmu.setReal([vr["x"], vr["v"]], [2e-3, -0.3])
    assert fmu.getReal([vr["R"]])[0] == pytest.approx(expected, rel=1e-13)
    fmu.exitInitializationMode()
    fmu.doStep(0.0, DT)
    assert fmu.getReal([vr["R"]])[0] == pytest.approx(expected, rel=1e-13)
    fmu.terminate()
    fmu.freeInstance()


REPLAY = """
import sys
from pathlib import Path
import numpy as np
sys.path.insert(0, {tests!r})
from surrogate_harness import motion
from test_surrogate_fmu import drive, running
folder = Path({folder!r})
x, v = motion(400)
with running(folder / "surrogate") as (fmu, vr):
    state = fmu.deSerializeFMUstate((folder / "state.bin").read_bytes())
    fmu.setFMUState(state)
    print(drive(fmu, vr, x[200:], v[200:], 200).tobytes().hex())
    fmu.freeFMUState(state)
"""


def test_state_survives_into_another_process(folder: Path) -> None:
    """Saved, serialised, restored elsewhere and replayed bit for bit; rolled back here as well."""
    x, v = motion(400)
    with running(folder / "surrogate") as (fmu, vr):
        drive(fmu, vr, x[:200], v[:200])
        saved = fmu.getFMUState()
        (folder / "state.bin").write_bytes(fmu.serializeFMUState(saved))
        first = drive(fmu, vr, x[200:], v[200:], 200)
        fmu.setFMUState(saved)
        assert drive(fmu, vr, x[200:], v[200:], 200).tobytes() == first.tobytes()
        fmu.freeFMUState(saved)
    script = REPLAY.format(tests=str(Path(__file__).parent), folder=str(folder))
    there = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=False)
    assert there.stderr == ""
    assert bytes.fromhex(there.stdout.strip()) == first.tobytes()


def test_directional_derivatives_are_exact(folder: Path) -> None:
    """Central differences of what getReal answers for moved inputs, in the middle of a motion."""
    x, v = motion(150)
    with running(folder / "surrogate") as (fmu, vr):
        drive(fmu, vr, x, v)
        for name, at, step in (("x", x[-1], 1e-7), ("v", v[-1], 1e-5)):
            answers = []
            for side in (1, -1):
                fmu.setReal([vr["x"], vr["v"]], [x[-1], v[-1]])
                fmu.setReal([vr[name]], [at + side * step])
                answers.append(fmu.getReal([vr["R"]])[0])
            fmu.setReal([vr["x"], vr["v"]], [x[-1], v[-1]])
            slope = fmu.getDirectionalDerivative([vr["R"]], [vr[name]], [1.0])[0]
            assert slope == pytest.approx((answers[0] - answers[1]) / (2 * step), rel=1e-6)
    with running(folder / "oscillator", x_start=2e-3, v_start=0.1) as (fmu, vr):
        fmu.setReal([vr["F"]], [5.0])
        a, force = fmu.getReal([vr["a"], vr["R"]])
        assert a == pytest.approx(5.0 - force)
        assert fmu.getDirectionalDerivative([vr["a"]], [vr["F"]], [1.0])[0] == 1.0


@pytest.mark.parametrize("event_mode", [False, True])
def test_fmi_3_gives_the_same_and_its_adjoint(folder: Path, tmp_path: Path, event_mode: bool) -> None:
    unpacked = tmp_path / "surrogate"
    fmpy.extract(str(build(surrogate_code(folder / "surrogate.onnx"), tmp_path / "s.fmu", fmi=3).path), str(unpacked))
    described = fmpy.read_model_description(str(unpacked))
    vr = {variable.name: variable.valueReference for variable in described.modelVariables}
    x, v = motion(1500)
    fmu = FMU3Slave(guid=described.guid, unzipDirectory=str(unpacked), modelIdentifier="surrogate", instanceName="i")
    fmu.instantiate(eventModeUsed=event_mode)
    fmu.enterInitializationMode(startTime=0.0)
    fmu.exitInitializationMode()
    if event_mode:
        fmu.updateDiscreteStates()
        fmu.enterStepMode()
    force, motions = np.empty(len(x)), [vr["x"], vr["v"]]
    for k in range(len(x)):
        fmu.setFloat64(motions, [x[k], v[k]])
        fmu.doStep(k * DT, DT)
        force[k] = fmu.getFloat64([vr["R"]])[0]
    slopes = [fmu.getDirectionalDerivative([vr["R"]], [known], [1.0])[0] for known in motions]
    assert fmu.getAdjointDerivative([vr["R"]], motions, [1.0], nSensitivity=2) == pytest.approx(slopes, rel=1e-12)
    fmu.terminate()
    fmu.freeInstance()
    expected = random_model(11, 1).response(x, v)[0]
    np.testing.assert_allclose(force, expected, rtol=0, atol=1e-11 * np.abs(expected).max())


@pytest.mark.parametrize("fmi", [2, 3])
def test_model_exchange_moves_memory_at_completed_steps(folder: Path, tmp_path: Path, fmi: Any) -> None:
    """Driven by the importer's own integrator with one step per sample, the oscillator follows the free run."""
    path = tmp_path / "oscillator.fmu"
    exchange.write(smooth_slider(), tmp_path / "slider.onnx")
    build(oscillator_code(tmp_path / "slider.onnx"), path, fmi=fmi)
    t = DT * np.arange(1000)
    force = 40 * np.sin(2 * np.pi * 20 * t)
    table = np.array(list(zip(t, force, strict=True)), dtype=[("time", float), ("F", float)])
    got = fmpy.simulate_fmu(
        str(path),
        fmi_type="ModelExchange",
        solver="Euler",
        step_size=DT / 10,
        output_interval=DT / 10,
        stop_time=t[-1],
        input=table,
        output=["x"],
    )
    expected = smooth_slider().free_run(force, DT)
    x = np.interp(t, got["time"], got["x"])
    # explicit Euler of a 20 Hz motion with steps of 10 us: half a per cent after two periods; memory that never moved
    # would leave 90 %
    assert np.sqrt(np.mean((x - expected["x"]) ** 2)) < 0.01 * np.std(expected["x"])


@pytest.mark.parametrize("fmi", [2, 3])
def test_small_and_valid(folder: Path, tmp_path: Path, fmi: Any) -> None:
    for code in (surrogate_code(folder / "surrogate.onnx"), oscillator_code(folder / "surrogate.onnx")):
        result = build(code, tmp_path / f"{code.name}.fmu", fmi=fmi)
        assert result.size < 120_000  # the shell with its sources: 90 kB; the weights are few
        assert validate_fmu(str(result.path)) == []


HOSTILE = [
    "x",
    "X",
    "x.1",
    "1",
    "double",
    "Größe µ",
    'a"b',
    "a*/b",
    "a??/",
    "<&>",
    "\n",
    "time",
    "v[3]",
    "/layer/0/Gemm",
    "x_1",
    "N_U",
    "m",
    "",
]


def test_hostile_names_are_safe(tmp_path: Path) -> None:
    """Names that would break C, XML or importers: keywords, quotes, ends of comments, markup, case twins."""
    inputs = [name or "empty" for name in HOSTILE]
    outputs = [f"{name}!" for name in inputs]
    nodes = [helper.make_node("Tanh", [a], [b], name=a) for a, b in zip(inputs, outputs, strict=True)]
    proto = make_model(nodes, {name: (1,) for name in inputs}, outputs)
    path = tmp_path / 'hostile "name" & more.onnx'
    path.write_bytes(proto.SerializeToString())
    code = network_code(path)
    names = [variable.name for variable in code.variables]
    assert len({name.lower() for name in names}) == len(names) == 2 * len(HOSTILE)
    result = build(code, tmp_path / "hostile.fmu")
    assert validate_fmu(str(result.path)) == []
    start = {name: 0.1 * i for i, name in enumerate(names[: len(HOSTILE)])}
    got = fmpy.simulate_fmu(
        str(result.path), start_values=start, stop_time=1e-3, output_interval=1e-3, output=names[len(HOSTILE) :]
    )
    values = [got[name][-1] for name in names[len(HOSTILE) :]]
    np.testing.assert_allclose(values, np.tanh(0.1 * np.arange(len(HOSTILE))), rtol=1e-14)


def test_writing_fmus_needs_no_training_framework(folder: Path) -> None:
    script = (
        "import sys\nfrom pathlib import Path\n"
        "from hystid.fmu import build\nfrom hystid.surrogate import surrogate_code\n"
        f"build(surrogate_code(Path({str(folder / 'surrogate.onnx')!r})), Path({str(folder / 'again.fmu')!r}))\n"
        "assert 'torch' not in sys.modules and 'onnxruntime' not in sys.modules\n"
    )
    subprocess.run([sys.executable, "-c", script], check=True)
