"""Importers that nobody here wrote run the library's FMUs and agree with our own driver."""

from __future__ import annotations

import ctypes
import json
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
from fmu_clients import CLIENTS

from hystid.fmu import Driver, build_model

MODULES = {"fmpy": "fmpy", "ecos": "ecospy", "libcosim": "libcosimpy"}
# FMI versions for co-simulation: libcosim 0.0.6 ends the process on FMI 3.0 files, whoever made them
VERSIONS = {"fmpy": (2, 3), "ecos": (2, 3), "libcosim": (2,)}
N = 200


def library_models():
    """Every oscillator of the library."""
    folder = Path(__file__).parents[1] / "modelica" / "HystId" / "Oscillators"
    return [f"HystId.Oscillators.{p.stem}" for p in sorted(folder.glob("*.mo")) if p.stem != "package"]


@pytest.fixture(scope="module")
def fmus(tmp_path_factory):
    """name -> driver, for every model in both versions."""
    folder = tmp_path_factory.mktemp("library")
    made = {}
    for model in library_models():
        for version in (2, 3):
            path = build_model(model, folder / f"{model.rpartition('.')[2]}{version}.fmu", fmi=version).path
            made[path.name] = Driver(path)
    return made


@pytest.mark.parametrize("client", CLIENTS)
def test_a_client_agrees_with_our_driver(fmus, client):
    if not find_spec(MODULES[client]):
        pytest.skip(f"{MODULES[client]} is not installed")
    if client == "ecos":
        try:
            ctypes.CDLL("libtbb.so.12")
        except OSError:
            pytest.skip("ecos needs the system library libtbb.so.12, which is not installed")
    chosen = [d for d in fmus.values() if d.fmi in VERSIONS[client]]
    requests = [
        {
            "path": str(d.path),
            "inputs": {"F": 20.0},
            "outputs": ["x", "v", "R"],
            "step": d.model.experiment.step,
            "n": N,
        }
        for d in chosen
    ]
    program = Path(__file__).with_name("fmu_clients.py")
    run = subprocess.run(
        [sys.executable, str(program), client], input=json.dumps(requests), capture_output=True, text=True, timeout=300
    )
    lines = [json.loads(line[7:]) for line in run.stdout.splitlines() if line.startswith("ANSWER ")]
    assert [line["name"] for line in lines] == [d.path.name for d in chosen], run.stdout[-2000:] + run.stderr[-2000:]
    for driver, answer in zip(chosen, lines, strict=True):
        t = np.arange(N + 1) * driver.model.experiment.step
        ours = driver.simulate(t, {"F": np.full(N + 1, 20.0)}, outputs=["x", "v", "R"], interpolation="hold")
        for name in ("x", "v", "R"):
            scale = np.max(np.abs(ours[name]))
            # clients sum their steps up: time is off by rounding, the solution by its slope times that
            assert abs(answer[name] - ours[name][-1]) <= 1e-9 * scale, (client, driver.path.name, name)
