"""A full disk, a home that cannot be written, no compiler, a cache of somebody else: one true sentence each."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path

import pytest

MODEL = "model Rig Real x(start = 1, fixed = true); output Real y = x; equation der(x) = -x; end Rig;"
ROOT_ONLY = pytest.mark.skipif(not hasattr(os, "getuid") or os.getuid() != 0, reason="only root can mount, give away")


def hystid(folder: Path, *arguments: str, **environment: str) -> subprocess.CompletedProcess[str]:
    """The command, in a folder of its own."""
    return subprocess.run(
        [sys.executable, "-m", "hystid", *arguments],
        cwd=folder, env={**os.environ, **environment}, capture_output=True, text=True, check=False,
    )  # fmt: skip


@pytest.fixture
def rig(tmp_path: Path) -> Path:
    """A folder with a model that no cache holds yet."""
    (tmp_path / "rig.mo").write_text(MODEL)
    return tmp_path


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    """A disk of 64 kB: less than one FMU takes."""
    place = tmp_path / "small"
    place.mkdir()
    if subprocess.run(
        ["mount", "-t", "tmpfs", "-o", "size=64k,mode=700", "none", place], capture_output=True
    ).returncode:
        pytest.skip("no disk can be mounted here")
    yield place
    subprocess.run(["umount", "-l", place], check=True)


@ROOT_ONLY
@pytest.mark.parametrize("what", ["result", "cache", "temporary"])
def test_a_full_disk_is_named_and_nothing_half_written(rig: Path, small_disk: Path, what: str) -> None:
    out = small_disk / "rig.fmu" if what == "result" else rig / "rig.fmu"
    places: Mapping[str, str] = {"HYSTID_CACHE": str(rig / "cache")}
    if what == "cache":
        places = {"HYSTID_CACHE": str(small_disk)}
    elif what == "temporary":
        (small_disk / "filler").write_bytes(bytes(60 << 10))
        places = {**places, "TMPDIR": str(small_disk)}
    done = hystid(rig, "build", "rig.mo", "-o", str(out), **places)
    if what == "temporary" and done.returncode == 0:  # this compiler needs no more than is left
        return
    assert done.returncode == 1, done.stderr
    said = done.stderr.lower()
    assert "full" in said and len(done.stderr.splitlines()) == 1, done.stderr
    assert str(small_disk) in done.stderr and "internal" not in said
    assert not out.exists()
    again = hystid(rig, "build", "rig.mo", "-o", str(rig / "rig.fmu"), HYSTID_CACHE=str(rig / "other"))
    assert again.returncode == 0, again.stderr  # what was written by half was not kept


@ROOT_ONLY
def test_a_full_disk_is_named_where_an_fmu_is_unpacked(rig: Path, small_disk: Path) -> None:
    """An FMU of some 90 kB does not fit into 64."""
    cache = {"HYSTID_CACHE": str(rig / "cache")}
    assert hystid(rig, "build", "rig.mo", "-o", "rig.fmu", **cache).returncode == 0
    done = hystid(rig, "regress", "rig.fmu", TMPDIR=str(small_disk), **cache)
    assert done.returncode == 1 and done.stderr == f"hystid: {small_disk}: the disk is full\n"
    assert list(small_disk.iterdir()) == []


@ROOT_ONLY
def test_a_home_that_cannot_be_written_costs_the_cache_only(rig: Path) -> None:
    """The model is built, and one sentence says that nothing is kept; a result there is refused before any work."""
    home = rig / "home"
    home.mkdir()
    if subprocess.run(["mount", "-t", "tmpfs", "-o", "ro,size=64k", "none", home], capture_output=True).returncode:
        pytest.skip("no disk can be mounted here")
    try:
        places = {"HOME": str(home), "HYSTID_CACHE": "", "XDG_CACHE_HOME": ""}
        done = hystid(rig, "build", "rig.mo", "-o", "rig.fmu", **places)
        assert done.returncode == 0 and (rig / "rig.fmu").exists(), done.stderr
        assert len(done.stderr.splitlines()) == 1 and "read-only" in done.stderr and str(home) in done.stderr
        refused = hystid(rig, "build", "rig.mo", "-o", str(home / "rig.fmu"), **places)
        assert refused.returncode == 2 and "may not be written to" in refused.stderr
    finally:
        subprocess.run(["umount", "-l", home], check=True)


@ROOT_ONLY
def test_a_cache_of_another_user_costs_the_cache_only(rig: Path) -> None:
    place = rig / "cache"
    place.mkdir()
    os.chown(place, 12345, 12345)
    done = hystid(rig, "build", "rig.mo", "-o", "rig.fmu", HYSTID_CACHE=str(place))
    assert done.returncode == 0 and (rig / "rig.fmu").exists()
    assert len(done.stderr.splitlines()) == 1 and "it belongs to another user" in done.stderr
    assert not list(place.iterdir())


def test_without_a_compiler_there_is_one_sentence(rig: Path) -> None:
    """No cc on the path and no compiler by pip."""
    code = (
        "import importlib.util, sys\nreal = importlib.util.find_spec\n"
        "import hystid.toolchain as t\nt.find_spec = lambda name: None if name == 'ziglang' else real(name)\n"
        "from hystid.cli.run import run\nsys.exit(run(['build', 'rig.mo', '-o', 'rig.fmu']))\n"
    )
    empty = {**os.environ, "PATH": str(rig / "nothing"), "HYSTID_CACHE": str(rig / "cache")}
    empty.pop("CC", None)
    done = subprocess.run([sys.executable, "-c", code], cwd=rig, env=empty, capture_output=True, text=True, check=False)
    assert done.returncode == 1 and len(done.stderr.splitlines()) == 1, done.stderr
    assert "no C compiler found: install gcc or clang" in done.stderr and not (rig / "rig.fmu").exists()
