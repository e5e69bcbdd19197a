"""A network's step as plain C99: strict compilation, the bits of the FMU, state of the caller, single precision."""

from __future__ import annotations

import ctypes
import os
import re
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
from onnx import helper
from surrogate_harness import make_model, motion, random_model
from test_further_inputs import LAGS, PORTS, network

from hystid.compiled import CompiledModel
from hystid.errors import NetworkError, UsageError
from hystid.networks import Member, TwoNetworkModel
from hystid.networks import onnx as exchange
from hystid.surrogate import c_source, surrogate_code

STRICT = ["-std=c99", "-Wall", "-Wextra", "-Wpedantic", "-Werror"]
# Compiler, and what runs its programs; each that the machine has is used.
CHAINS = {
    "cc": [],
    "clang": [],
    "arm-linux-gnueabihf-gcc": ["qemu-arm", "-L", "/usr/arm-linux-gnueabihf"],
    "aarch64-linux-gnu-gcc": ["qemu-aarch64", "-L", "/usr/aarch64-linux-gnu"],
}


def written(model: TwoNetworkModel, folder: Path, real: str = "double") -> Path:
    exchange.write(model, folder / "model.onnx")
    for name, text in c_source(folder / "model.onnx", name="joint", real=real).items():
        (folder / name).write_text(text)
    return folder


def program(folder: Path, fields: list[str], real: str) -> Path:
    """A program that steps through lines of inputs and prints R and the flag in full precision."""
    scan = " ".join(["%lf"] * len(fields))
    places = ", ".join(f"&u[{i}]" for i in range(len(fields)))
    sets = " ".join(f"in.{field} = ({real})u[{i}];" for i, field in enumerate(fields))
    (folder / "main.c").write_text(
        f"""\
#include <stdio.h>
#include "joint.h"
int main(void)
{{
    double u[{len(fields)}];
    joint_state state;
    joint_inputs in;
    joint_outputs out;
    joint_start(&state);
    while (scanf("{scan}", {places}) == {len(fields)}) {{
        {sets}
        joint_step(&state, &in, &out);
        printf("%.17g %d\\n", (double)out.R, out.outside_training_range);
    }}
    return 0;
}}
"""
    )
    return folder / "main.c"


def run(chain: str, folder: Path, rows: np.ndarray, fields: list[str], real: str = "double") -> np.ndarray:
    if shutil.which(chain) is None or (CHAINS[chain] and shutil.which(CHAINS[chain][0]) is None):
        if chain.startswith("arm") and os.environ.get("HYSTID_NEEDS_ARM"):
            pytest.fail(f"{chain} and {CHAINS[chain][0]} are needed here")
        pytest.skip(f"{chain} is not installed")
    main, binary = program(folder, fields, real), folder / f"main_{chain}"
    subprocess.run([chain, *STRICT, "-O2", str(folder / "joint.c"), str(main), "-lm", "-o", str(binary)], check=True)
    text = "\n".join(" ".join(map(repr, map(float, row))) for row in rows)
    answer = subprocess.run([*CHAINS[chain], str(binary)], input=text, capture_output=True, text=True, check=True)
    return np.array([[float(item) for item in line.split()] for line in answer.stdout.splitlines()])


@pytest.mark.parametrize("chain", CHAINS)
def test_the_step_has_the_bits_of_the_block_in_the_fmu(tmp_path: Path, chain: str) -> None:
    """Both compile the same text in double precision; without contraction there is one answer on every processor."""
    x, v = motion(2000)
    written(random_model(5, 3), tmp_path)
    found = run(chain, tmp_path, np.stack([x, v], axis=1), ["x", "v"])
    block = CompiledModel(surrogate_code(tmp_path / "model.onnx"))
    expected = block.simulate({"x": x, "v": v}, 1e-4, outputs=("R", "outside_training_range"), substeps=0)
    assert np.array_equal(found[:, 0], expected["R"])
    assert np.array_equal(found[:, 1], expected["outside_training_range"])


def test_further_inputs_and_lags_are_fields(tmp_path: Path) -> None:
    rng = np.random.default_rng(4)
    limits = {"x": (-1.0, 1.0), "v": (-1.0, 1.0), "R": (-2.0, 2.0), "u": (0.0, 2.0), "p": (-1.0, 1.0)}
    model = TwoNetworkModel((Member(network(rng, 7), network(rng, 7)),), 0.0, 1e3, limits, inputs=PORTS, lags=LAGS)
    written(model, tmp_path)
    t = np.arange(400) * 1e-3
    signals = {"x": 0.3 * np.sin(20 * t), "v": 6 * np.cos(20 * t), "u": 1 + np.sign(np.sin(9 * t)), "p": np.sin(5 * t)}
    found = run("cc", tmp_path, np.stack(list(signals.values()), axis=1), ["x", "v", "u", "p"])
    expected, _ = model.response(signals["x"], signals["v"], None, {name: signals[name] for name in ("u", "p")})
    np.testing.assert_allclose(found[:, 0], expected, rtol=0, atol=1e-10)
    header = (tmp_path / "joint.h").read_text()
    assert re.search(r"double u; /\* \[V\], trained from 0 to 2 \*/", header)


def test_single_precision_is_single_throughout(tmp_path: Path) -> None:
    """No double is left in the text, and R is off by rounding: some hundred operations of 6e-8, fed back a little."""
    x, v = motion(2000)
    model = random_model(5, 2)
    written(model, tmp_path, "float")
    assert "double" not in re.sub(r"/\*.*?\*/", "", (tmp_path / "joint.c").read_text(), flags=re.S)
    subprocess.run(["cc", *STRICT, "-Wdouble-promotion", "-Wconversion", "-Wno-sign-conversion", "-c",
                    str(tmp_path / "joint.c"), "-o", str(tmp_path / "joint.o")], check=True)  # fmt: skip
    found = run("cc", tmp_path, np.stack([x, v], axis=1), ["x", "v"], "float")[:, 0]
    expected, _ = model.response(x, v)
    assert np.max(np.abs(found - expected)) < 1e-4 * np.max(np.abs(expected))


def test_nothing_is_allocated_and_little_is_called(tmp_path: Path) -> None:
    """The object asks its surroundings for what the header lists, memcpy and memset; it has no data of its own."""
    written(random_model(5, 3), tmp_path)
    subprocess.run(["cc", *STRICT, "-O2", "-c", "joint.c", "-o", "joint.o"], check=True, cwd=tmp_path)
    symbols = subprocess.run(["nm", "joint.o"], capture_output=True, text=True, check=True, cwd=tmp_path).stdout
    wanted = {line.split()[-1] for line in symbols.splitlines() if " U " in line}
    assert wanted <= {"memcpy", "memset", "fabs", "copysign", "__stack_chk_fail", "_GLOBAL_OFFSET_TABLE_"}
    assert not [line for line in symbols.splitlines() if line.split()[-2] in "BbDd"]
    assert "Functions of <math.h> that are called: copysign, fabs." in (tmp_path / "joint.h").read_text()


def test_any_network_of_the_compiler_can_be_written(tmp_path: Path) -> None:
    """A layer of two outputs with names that C has taken; two instances keep apart because there is nothing shared."""
    weights = np.array([[1.0, -2.0], [0.5, 3.0]])
    nodes = [helper.make_node("MatMul", ["int", "w"], ["sum"]), helper.make_node("Tanh", ["sum"], ["double"])]
    path = tmp_path / "net.onnx"
    path.write_bytes(make_model(nodes, {"int": [1, 2]}, ["double"], {"w": weights}).SerializeToString())
    for name, text in c_source(path, name="net").items():
        (tmp_path / name).write_text(text)
    flags = [*STRICT, "-shared", "-fPIC"]
    subprocess.run(["cc", *flags, "net.c", "-lm", "-o", "net.so"], check=True, cwd=tmp_path)
    library = ctypes.CDLL(str(tmp_path / "net.so"))
    inputs, outputs = (ctypes.c_double * 2)(0.2, -0.1), (ctypes.c_double * 3)()
    library.net_step(ctypes.create_string_buffer(8), inputs, outputs)
    np.testing.assert_allclose(outputs[:2], np.tanh(np.array([0.2, -0.1]) @ weights), rtol=1e-14)


def test_bad_arguments_get_a_sentence(tmp_path: Path) -> None:
    exchange.write(random_model(1, 1), tmp_path / "m.onnx")
    with pytest.raises(UsageError, match="becomes that of C functions"):
        c_source(tmp_path / "m.onnx", name="my step")
    with pytest.raises(UsageError, match="choose double or float"):
        c_source(tmp_path / "m.onnx", real="half")
    with pytest.raises(NetworkError, match="no such file"):
        c_source(tmp_path / "none.onnx")
