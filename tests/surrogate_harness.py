"""Helpers of the surrogate tests: small ONNX models, their compiled functions, and independent evaluations."""

from __future__ import annotations

import ctypes
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import onnx
import onnx.shape_inference
import onnxruntime
from onnx import ModelProto, TensorProto, helper, numpy_helper
from onnx.reference import ReferenceEvaluator

from hystid.networks import Member, Network, TwoNetworkModel
from hystid.surrogate import emit, reader
from hystid.surrogate.program import Program
from hystid.toolchain import shared_library

FLOAT, DOUBLE = TensorProto.FLOAT, TensorProto.DOUBLE
HEAD = "#include <math.h>\n#include <stdint.h>\n#include <string.h>\n"
STRICT = ("-O1", "-Wall", "-Wextra", "-Werror", "-pedantic")


def make_model(
    nodes: Sequence[onnx.NodeProto],
    inputs: Mapping[str, Sequence[int | str]],
    outputs: Sequence[str],
    constants: Mapping[str, Any] | None = None,
    *,
    opset: int = 17,
    kind: int = DOUBLE,
    output_kind: int | None = None,
) -> ModelProto:
    """A model with float inputs of given shapes, outputs of inferred shape and stored constants."""
    stored = [numpy_helper.from_array(np.asarray(value), name) for name, value in (constants or {}).items()]
    graph = helper.make_graph(
        list(nodes),
        "test",
        [helper.make_tensor_value_info(name, kind, list(shape)) for name, shape in inputs.items()],
        [helper.make_tensor_value_info(name, output_kind or kind, None) for name in outputs],
        stored,
    )
    opsets = [helper.make_opsetid("", opset), helper.make_opsetid("ai.onnx.ml", 3)]
    return onnx.shape_inference.infer_shapes(helper.make_model(graph, opset_imports=opsets, ir_version=8))


def outside(proto: ModelProto, feeds: Mapping[str, np.ndarray]) -> list[np.ndarray]:
    """Outputs by ONNX Runtime or, for operators that it lacks in double precision, by the standard's own evaluator."""
    options = onnxruntime.SessionOptions()
    options.log_severity_level = 4
    options.intra_op_num_threads = 1
    try:
        session = onnxruntime.InferenceSession(proto.SerializeToString(), options)
    except Exception:
        return [np.asarray(y) for y in ReferenceEvaluator(proto).run(None, dict(feeds))]
    return [np.asarray(y) for y in session.run(None, dict(feeds))]


@dataclass(frozen=True)
class Compiled:
    """A network compiled on its own: value, directional derivative and adjoint as Python functions of flat arrays."""

    program: Program
    library: ctypes.CDLL
    name: str
    work: int

    def _call(self, mode: str, *arrays: np.ndarray) -> None:
        work = np.zeros(self.work + 1)
        pointers = [ctypes.c_void_p(array.ctypes.data) for array in (*arrays, work)]
        getattr(self.library, f"x_{self.name}{mode}")(*pointers)

    def _blank(self) -> list[np.ndarray]:
        return [np.zeros(port.view.size) for port in self.program.outputs]

    def value(self, inputs: Sequence[np.ndarray]) -> list[np.ndarray]:
        """Outputs, each in its shape."""
        out = self._blank()
        self._call("", *map(_flat, inputs), *out)
        return [y.reshape(port.view.shape) for y, port in zip(out, self.program.outputs, strict=True)]

    def forward(self, inputs: Sequence[np.ndarray], seeds: Sequence[np.ndarray]) -> list[np.ndarray]:
        """d outputs along the seeds."""
        out, slopes = self._blank(), self._blank()
        self._call("_forward", *map(_flat, inputs), *map(_flat, seeds), *out, *slopes)
        return slopes

    def adjoint(self, inputs: Sequence[np.ndarray], seeds: Sequence[np.ndarray]) -> list[np.ndarray]:
        """Seeds on the outputs, carried back to the inputs."""
        back = [np.zeros(port.view.size) for port in self.program.inputs]
        self._call("_adjoint", *map(_flat, inputs), *back, *self._blank(), *map(_flat, seeds))
        return back


def _flat(array: np.ndarray) -> np.ndarray:
    return np.ascontiguousarray(array, dtype=np.float64).reshape(-1)


def compile_all(models: Mapping[str, ModelProto], sizes: Mapping[str, int] | None = None) -> dict[str, Compiled]:
    """Compile many networks in one go, with warnings as errors."""
    sources, made = {}, {}
    for number, (label, proto) in enumerate(models.items()):
        name = f"net{number}"
        program = reader.program(proto, name, sizes)
        text = emit.functions(program, name)
        body = HEAD + text.tables + text.value + text.forward + text.adjoint
        sources[f"{name}.c"] = body + "".join(_exported(body, name + mode) for mode in ("", "_forward", "_adjoint"))
        made[label] = (program, name, text.work)
    library = ctypes.CDLL(str(shared_library(sources, main=list(sources), flags=STRICT)))
    return {label: Compiled(program, library, name, work) for label, (program, name, work) in made.items()}


def _exported(text: str, name: str) -> str:
    found = re.search(rf"static void {name}\((.*?)\)", text)
    assert found
    arguments = ", ".join(re.findall(r"(\w+)(?:,|$)", found[1]))
    visible = '__attribute__((visibility("default")))'
    return f"{visible} void x_{name}({found[1]});\n{visible} void x_{name}({found[1]}) {{ {name}({arguments}); }}\n"


def random_network(rng: np.random.Generator, gains: Sequence[float], height: float, sizes: Sequence[int]) -> Network:
    """A tanh network 3-sizes-1 with weights of moderate size; height is the half range of its output."""
    layers, width = [], 3
    for count in (*sizes, 1):
        layers.append((rng.normal(0, 1 / np.sqrt(width), (count, width)), rng.normal(0, 0.3, count)))
        width = count
    return Network(tuple(layers), rng.normal(0, 0.1, 3) / np.asarray(gains), np.asarray(gains), 0.1 * height, height)


def random_model(seed: int = 0, members: int = 2, band: float = 0.0, sizes: Sequence[int] = (5, 5)) -> TwoNetworkModel:
    """An ensemble of network pairs for motions of 10 mm and 2 m/s, with forces around 100 N."""
    rng = np.random.default_rng(seed)
    pairs = tuple(
        Member(
            random_network(rng, (100.0, 100.0, 0.01), 100.0, sizes),
            random_network(rng, (100.0, 0.5, 0.01), 150.0, sizes),
        )
        for _ in range(members)
    )
    ranges = {"x": (-0.01, 0.01), "v": (-2.0, 2.0), "R": (-300.0, 300.0)}
    return TwoNetworkModel(pairs, 1.0, 1e4, ranges, band, {"recordings": ["made up"]})


def smooth_slider(mass: float = 1.0, dt: float = 1e-4, damping: float = 20.0) -> TwoNetworkModel:
    """A well-behaved structure in closed form: Rh = fc tanh((k (x - x0) + Rh0) / fc), R = G tanh((K x + c v + Rh) / G).

    One neuron each; fc = 20 N, k = 2e4 N/m, K = 1e4 N/m, c = damping [N.s/m]; G = 1e4 N makes R almost linear.
    """
    slip, loop, spring, wide = 20.0, 2e4, 1e4, 1e4

    def neuron(weights: Sequence[float], height: float) -> Network:
        layers = ((np.array([weights]) / height, np.zeros(1)), (np.ones((1, 1)), np.zeros(1)))
        return Network(layers, np.zeros(3), np.ones(3), 0.0, height)

    member = Member(neuron((loop, -loop, 1.0), slip), neuron((spring, damping, 1.0), wide))
    return TwoNetworkModel((member,), mass, 1 / dt, {"x": (-0.02, 0.02), "v": (-3.0, 3.0), "R": (-250.0, 250.0)})


def motion(n: int, dt: float = 1e-4) -> tuple[np.ndarray, np.ndarray]:
    """A sweep with hundreds of reversals, some of them through an exact zero and one plateau: x [m], v [m/s]."""
    t = dt * np.arange(n)
    phase = 2 * np.pi * (10 * t + 8 * t**2)
    x, v = 0.009 * np.sin(phase), 0.009 * np.cos(phase) * 2 * np.pi * (10 + 16 * t)
    v[n // 3 : n // 3 + 5] = 0.0
    v[n // 2] = 0.0
    return x, v
