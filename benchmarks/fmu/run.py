"""What FMUs cost: ratios from one run, CPU time, medians of alternating rounds.

What else runs on the machine slows a program by half as soon as it shares a core, and now and then: of ways that take
milliseconds each round takes the least of several runs.

    python benchmarks/fmu/run.py

drive     50,000 Runge-Kutta steps of the Jenkins oscillator: hand-written C, our batch entry, one call per step with
          prepared buffers, FMPy's simulate_fmu
network   one co-simulation step of a 3-5-5-1 tanh network from plain C, beside a hand-written FMU that checks nothing
build     FMU of the Jenkins oscillator with an empty cache, with the shell compiled, and from the cache
"""

from __future__ import annotations

import ctypes
import os
import subprocess
import sys
import tempfile
import time
import zipfile
from collections.abc import Callable, Mapping
from pathlib import Path

import fmpy
import numpy as np

from hystid.fmu import Driver, build, build_model
from hystid.toolchain import compiler

HERE = Path(__file__).parent
SHELL = HERE.parents[1] / "hystid" / "fmu" / "shell"
ROUNDS, RUNS, LONG = 7, 9, 0.2
N, DT = 50_000, 1e-4


def clock() -> float:
    """CPU time [s] of this process, and of those in which it runs FMUs of others."""
    own = os.getpid()
    children = Path(f"/proc/{own}/task/{own}/children").read_text().split()
    spent = [int(Path(f"/proc/{child}/schedstat").read_text().split()[0]) for child in children]
    return time.process_time() + 1e-9 * sum(spent)


def least(way: Callable[[], object]) -> float:
    """CPU seconds of one run; the least of some, where that is soon done."""
    times: list[float] = []
    while len(times) < RUNS and sum(times) < LONG:
        begin = clock()
        way()
        times.append(clock() - begin)
    return min(times)


def rounds_of(ways: Mapping[str, Callable[[], object]]) -> dict[str, np.ndarray]:
    """CPU seconds of each way in each of the rounds, in which the ways alternate."""
    rows = [{name: least(way) for name, way in ways.items()} for _ in range(ROUNDS)]
    return {name: np.array([row[name] for row in rows]) for name in ways}


def without_batch_entry(path: Path, target: Path) -> Path:
    """The same FMU as a stranger's: its batch entry renamed."""
    with zipfile.ZipFile(path) as old, zipfile.ZipFile(target, "w") as new:
        for name in old.namelist():
            data = old.read(name)
            new.writestr(name, data.replace(b"hy_run_table", b"no_run_table") if name.startswith("binaries") else data)
    return target


def hand_written(folder: Path) -> Callable[[np.ndarray], np.ndarray]:
    """The loop that one would write for this model alone."""
    library = folder / "jenkins.so"
    subprocess.run([*compiler(), "-O2", "-shared", "-fPIC", HERE / "jenkins.c", "-o", library], check=True)
    function = ctypes.CDLL(str(library)).jenkins

    def run(force: np.ndarray) -> np.ndarray:
        x, v = np.empty(N), np.empty(N)
        constants = np.array([1.0, 10.0, 1e4, 5e4, 37.5])  # m, B, Kl, Ks, fc: the library's start values
        first, *others = [ctypes.c_void_p(array.ctypes.data) for array in (constants, force, x, v)]
        function(first, N, ctypes.c_double(DT), *others)
        return x

    return run


def drive(folder: Path) -> None:
    """Print the table of driving costs."""
    path = build_model("HystId.Oscillators.Jenkins", folder / "jenkins.fmu").path
    ours, stranger = Driver(path), Driver(without_batch_entry(path, folder / "stranger.fmu"))
    t = np.arange(N) * DT
    force = 60 * np.sin(2 * np.pi * (0.2 + 10 * t) * t)
    signal = np.zeros(N, dtype=[("time", "f8"), ("F", "f8")])
    signal["time"], signal["F"] = t, force
    floor = hand_written(folder)
    outputs = ["x", "v"]
    ways: dict[str, Callable[[], object]] = {
        "hand-written C loop": lambda: floor(force),
        "our driver, batch entry": lambda: ours.simulate(t, {"F": force}, outputs=outputs),
        "prepared buffers, input held": lambda: stranger.simulate(
            t, {"F": force}, outputs=outputs, interpolation="hold"
        ),
        "prepared buffers, input linear": lambda: stranger.simulate(t, {"F": force}, outputs=outputs),
        "FMPy simulate_fmu": lambda: fmpy.simulate_fmu(
            str(path), fmi_type="CoSimulation", stop_time=t[-1], output_interval=DT, input=signal, output=outputs
        ),
    }
    difference = np.max(np.abs(ours.simulate(t, {"F": force}, outputs=["x"])["x"] - floor(force)))
    print(
        f"\n50,000 steps of the Jenkins oscillator (largest difference to the hand-written loop {difference:.1e} m)\n"
    )
    times = rounds_of(ways)
    batch, loop, fmpy_ = times["our driver, batch entry"], times["hand-written C loop"], times["FMPy simulate_fmu"]
    for name, value in times.items():
        floors, gain = np.median(value / loop), np.median(fmpy_ / value)
        print(f"| {name} | {np.median(value) * 1e3:.2f} ms | {floors:.1f} x floor | {gain:.1f} x faster than FMPy |")
    print(
        f"\nbatch entry: {np.median(fmpy_ / batch):.0f} x faster than FMPy, {np.median(batch / loop):.2f} x the "
        f"hand-written loop ({np.min(batch / loop):.2f} to {np.max(batch / loop):.2f} in {ROUNDS} rounds)"
    )


def network_file(folder: Path) -> tuple[Path, str]:
    """A 3-5-5-1 tanh network as ONNX (float64) and as C arrays."""
    import onnx
    from onnx import TensorProto, helper

    rng = np.random.default_rng(7)
    weights = [rng.normal(size=shape) for shape in ((5, 3), (5, 5), (1, 5))]
    biases = [rng.normal(size=shape) for shape in (5, 5, 1)]
    nodes, tensors, last = [], [], "x"
    for i, (W, b) in enumerate(zip(weights, biases, strict=True)):
        tensors += [helper.make_tensor(f"W{i}", TensorProto.DOUBLE, W.shape, W.ravel())]
        tensors += [helper.make_tensor(f"B{i}", TensorProto.DOUBLE, b.shape, b)]
        out = "y" if i == 2 else f"s{i}"
        nodes.append(helper.make_node("Gemm", [last, f"W{i}", f"B{i}"], [out], transB=1))
        if i < 2:
            nodes.append(helper.make_node("Tanh", [out], [f"h{i}"]))
            last = f"h{i}"
    row = [helper.make_tensor_value_info(n, TensorProto.DOUBLE, [1, k]) for n, k in (("x", 3), ("y", 1))]
    graph = helper.make_graph(nodes, "mlp", row[:1], row[1:], tensors)
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
    path = folder / "mlp.onnx"
    onnx.save(model, str(path))
    arrays = {**{f"W{i}": W for i, W in enumerate(weights)}, **{f"B{i}": b for i, b in enumerate(biases)}}
    lines = [f"static const double {n}[] = {{{', '.join(map(repr, a.ravel().tolist()))}}};" for n, a in arrays.items()]
    return path, "\n".join(lines)


def network(folder: Path) -> None:
    """Print the cost of a step of a network FMU."""
    from hystid.surrogate import network_code

    onnx_path, weights = network_file(folder)
    (folder / "weights.h").write_text(weights)
    floor, driver = folder / "floor.so", folder / "drive"
    subprocess.run(
        [*compiler(), "-O2", "-shared", "-fPIC", f"-I{folder}", HERE / "floor.c", "-o", floor, "-lm"], check=True
    )
    subprocess.run(
        [*compiler(), "-O2", f"-I{SHELL / 'fmi'}", HERE / "drive.c", "-o", driver, "-ldl", "-lm"], check=True
    )
    made = build(network_code(onnx_path), folder / "mlp.fmu")
    with zipfile.ZipFile(made.path) as archive:
        archive.extractall(folder / "mlp")
    library = next((folder / "mlp" / "binaries").rglob("*.so"))
    model = Driver(made.path).model
    inputs = [str(v.slot) for v in model.variables if v.causality == "input"]
    output = next(str(v.slot) for v in model.variables if v.causality == "output")
    command = [
        driver,
        "41",
        "40000",
        floor,
        "token",
        "3",
        "3",
        "0",
        "1",
        "2",
        library,
        model.token,
        output,
        "3",
        *inputs,
    ]
    lines = subprocess.run(list(map(str, command)), capture_output=True, text=True, check=True).stdout.splitlines()
    (floor_ns, _, floor_y), (our_ns, ratio, our_y) = ([float(x) for x in line.split()] for line in lines)
    print("\nOne step of a 3-5-5-1 network from plain C: set 3 inputs, step, get 1 output\n")
    print(f"| hand-written FMU, nothing checked | {floor_ns:.0f} ns |")
    print(f"| FMU from the ONNX file | {our_ns:.0f} ns | {ratio:.2f} x floor |")
    print(f"\nlast outputs differ by {abs(our_y - floor_y):.1e}; library {library.stat().st_size / 1000:.0f} kB")


_BUILD = """
import sys, time
begin = time.perf_counter()
from hystid.fmu import build_model
loaded = time.perf_counter()
build_model(sys.argv[1], sys.argv[2])
print(loaded - begin, time.perf_counter() - loaded)
"""


def builds(folder: Path) -> None:
    """Print what a build costs, in a process of its own each time."""
    environment = {**os.environ, "HYSTID_CACHE": str(folder / "cache")}
    print("\nBuilding an FMU from Modelica (wall time; the cache is empty at first)\n")
    for name, model in (
        ("cold: nothing compiled", "HystId.Oscillators.Jenkins"),
        ("another model: the shell is compiled", "HystId.Oscillators.BoucWen"),
        ("warm: from the cache", "HystId.Oscillators.Jenkins"),
    ):
        command = [sys.executable, "-c", _BUILD, model, str(folder / "built.fmu")]
        run = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
        imports, seconds = map(float, run.stdout.split())
        print(f"| {name} | {seconds:.2f} s | imports {imports:.2f} s |")


def main() -> None:
    """Run all three."""
    with tempfile.TemporaryDirectory() as name:
        for part in (drive, network, builds):
            part(Path(name))


if __name__ == "__main__":
    main()
