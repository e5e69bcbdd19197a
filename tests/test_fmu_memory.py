"""The C of an FMU is clean: no warnings under strict flags, no finding of the sanitizers or of valgrind, no leak."""

from __future__ import annotations

import shutil
import subprocess

import pytest
from fmu_models import EVERY, FOLDER, bouncing, jenkins, linear

from hystid.compiled import shell_text
from hystid.fmu.build import fmu_sources
from hystid.fmu.interface import interface
from hystid.modelica import compile_model

STRICT = ("-std=c11", "-Wall", "-Wextra", "-Wpedantic", "-Wshadow", "-Werror", "-fvisibility=hidden")

pytestmark = pytest.mark.skipif(not shutil.which("gcc"), reason="needs gcc")


def program(folder, make, version, *flags):
    """Executable that exercises the FMI functions of a model, with right and wrong calls."""
    driver = "exercise.c" if version == 2 else "exercise3.c"
    sources = {**fmu_sources(interface(make()), version), driver: (FOLDER / driver).read_text()}
    for name, text in sources.items():
        (folder / name).write_text(text)
    main = [name for name in sources if name.endswith(".c")]
    subprocess.run(["gcc", *flags, *main, "-o", "exercise", "-lm"], cwd=folder, check=True)
    return folder / "exercise"


@pytest.mark.parametrize("make", EVERY)
@pytest.mark.parametrize("version", [2, 3])
def test_no_warnings(tmp_path, make, version):
    sources = fmu_sources(interface(make()), version)
    for name, text in sources.items():
        (tmp_path / name).write_text(text)
    changing = ["hy_variables.c", "model.c"] if make is not jenkins else [n for n in sources if n.endswith(".c")]
    run = subprocess.run(["gcc", *STRICT, "-fsyntax-only", *changing], cwd=tmp_path, capture_output=True, text=True)
    assert run.returncode == 0, run.stderr


@pytest.mark.parametrize(("make", "version"), [(jenkins, 2), (bouncing, 2), (bouncing, 3), (linear, 3)])
def test_sanitizers_find_nothing(tmp_path, make, version):
    flags = ("-g", "-O1", "-fsanitize=address,undefined", "-fno-sanitize-recover=all", "-fno-omit-frame-pointer")
    executable = program(tmp_path, make, version, *STRICT, *flags)
    token = make().token
    run = subprocess.run([executable, "500", token], capture_output=True, text=True)
    assert run.returncode == 0, run.stdout + run.stderr


@pytest.mark.skipif(not shutil.which("valgrind"), reason="needs valgrind")
@pytest.mark.parametrize("version", [2, 3])
def test_valgrind_finds_nothing_and_steps_allocate_nothing(tmp_path, version):
    executable = program(tmp_path, bouncing, version, "-g", "-O1")
    allocations = []
    for n in ("10", "1000"):
        command = ["valgrind", "--leak-check=full", "--error-exitcode=9", executable, n, bouncing().token]
        run = subprocess.run(command, capture_output=True, text=True)
        assert run.returncode == 0, run.stderr
        allocations.append(next(line for line in run.stderr.splitlines() if "total heap usage" in line).split()[4])
    assert allocations[0] == allocations[1]


@pytest.mark.parametrize("law", ["BoucWen", "MicroSlip", "Iwan"])
def test_sanitizers_find_nothing_where_a_motion_is_followed(tmp_path, law):
    code = compile_model(f"HystId.Oscillators.{law}")
    shell = {f"{name}.{end}" for name in ("hy_engine", "hy_paths", "hy_strip", "hy_table") for end in "ch"}
    sources = {name: shell_text(name) for name in {*shell, "hy_duhem.c", "hy_stops.c", "hy_step.c", "hy_model.h"}}
    sources |= {**code.sources, "follow.c": (FOLDER / "follow.c").read_text()}
    for name, text in sources.items():
        (tmp_path / name).write_text(text)
    main = [name for name in sources if name.endswith(".c")]
    flags = ("-g", "-O1", "-fsanitize=address,undefined", "-fno-sanitize-recover=all")
    subprocess.run(["gcc", *STRICT, *flags, *main, "-o", "follow", "-lm"], cwd=tmp_path, check=True)
    slots = {variable.name: str(variable.slot) for variable in code.variables}
    command = [tmp_path / "follow", *(slots[name] for name in ("x", "v", "R", "law.loss"))]
    run = subprocess.run(command, capture_output=True, text=True)
    assert run.returncode == 0, run.stdout + run.stderr
