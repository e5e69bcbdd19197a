"""Libraries built for other systems, run on this one: Windows under wine, Linux on ARM under qemu.

The same C program loads the library that was built for its system; what it prints must be what the library of this
machine gives. Needs HYSTID_CROSS=1 (zig's first Windows build takes minutes), the extra 'cross', and wine or
qemu-aarch64 with the C library of Debian's libc6-arm64-cross.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import numpy as np
import pytest
from fmu_models import FOLDER, jenkins, sampled

from hystid.fmu import build
from hystid.fmu.platforms import PLATFORMS, host

pytestmark = [
    pytest.mark.skipif(not os.environ.get("HYSTID_CROSS"), reason="minutes at the first time: set HYSTID_CROSS=1"),
    pytest.mark.skipif(host() != "x86_64-linux", reason="wine and qemu are called from Linux on x86_64"),
]
ARM_LIBRARIES = Path("/usr/aarch64-linux-gnu")
RUNNERS = {
    "x86_64-linux": [],
    "x86_64-windows": ["wine"],
    "aarch64-linux": ["qemu-aarch64", "-L", str(ARM_LIBRARIES)],
}
# model -> (step [s], input=value and outputs by name)
CASES = {jenkins: (1e-3, {"F": 30.0}, ["x", "v", "z", "R"]), sampled: (7e-3, {"u": 0.5}, ["y", "u_s"])}


@pytest.fixture(scope="module")
def programs(tmp_path_factory):
    """platform -> the loader built for it."""
    pytest.importorskip("ziglang", reason="needs the extra 'cross'")
    folder = tmp_path_factory.mktemp("load")
    found = {}
    for platform in RUNNERS:
        program = folder / f"load-{platform}{'.exe' if 'windows' in platform else ''}"
        libraries = [] if "windows" in platform else ["-ldl"]
        zig = [sys.executable, "-m", "ziglang", "cc", "-target", PLATFORMS[platform].zig]
        subprocess.run([*zig, "-O1", FOLDER / "load.c", "-o", program, *libraries], check=True, cwd=folder)
        found[platform] = program
    return found


@pytest.fixture(scope="module")
def environment(tmp_path_factory):
    """A wine prefix of our own, without a window."""
    settings = {"WINEPREFIX": str(tmp_path_factory.mktemp("wine")), "WINEDEBUG": "-all", "DISPLAY": ""}
    return {**os.environ, **settings, "WINEDLLOVERRIDES": "mscoree,mshtml="}


@pytest.mark.parametrize("version", [2, 3])
@pytest.mark.parametrize("make", CASES, ids=lambda make: make.__name__)
@pytest.mark.parametrize("platform", ["x86_64-windows", "aarch64-linux"])
def test_a_library_of_another_system_gives_the_same(tmp_path, programs, environment, platform, make, version):
    runner = RUNNERS[platform]
    if not shutil.which(runner[0]) or (platform == "aarch64-linux" and not ARM_LIBRARIES.is_dir()):
        pytest.skip(f"needs {runner[0]}")
    code = make()
    slot = {v.name: v.slot for v in code.variables}
    step, inputs, outputs = CASES[make]
    with zipfile.ZipFile(build(code, tmp_path / "m.fmu", fmi=version, platforms=["host", platform]).path) as archive:
        archive.extractall(tmp_path)
    rows = {}
    for name in (host(), platform):
        target = PLATFORMS[name]
        folder = tmp_path / "binaries" / (target.folder if version == 2 else target.tuple)
        given = [f"{slot[k]}={value}" for k, value in inputs.items()] + [str(slot[k]) for k in outputs]
        command = [*RUNNERS[name], programs[name], folder / f"{code.name}{target.suffix}", str(version), code.token]
        run = subprocess.run([*command, repr(step), "300", *given], capture_output=True, text=True, env=environment)
        assert run.returncode == 0, (name, run.returncode, run.stdout[-300:], run.stderr[-300:])
        rows[name] = np.array([[float(x) for x in line.split()] for line in run.stdout.splitlines()])
    assert rows[platform].shape == (300, len(outputs)) and np.ptp(rows[platform][:, 0]) > 0
    # the same arithmetic; only a compiler that fuses products and sums may differ, by rounding
    np.testing.assert_allclose(rows[platform], rows[host()], rtol=1e-11, atol=1e-14)
