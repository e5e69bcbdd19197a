"""The cache: nothing in it is run that the user did not make, and damage is noticed before use."""

from __future__ import annotations

import ctypes
import os
import stat
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from hystid import cache
from hystid.cli.run import run
from hystid.compiled import CompiledModel
from hystid.diagnosis.model import library
from hystid.errors import ToolchainError
from hystid.fmu import Driver, build_model
from hystid.modelica import compile_model
from hystid.toolchain import shared_library

_ONE = {"one.c": '__attribute__((visibility("default"))) int one(void) { return 1; }\n'}


@pytest.fixture(autouse=True)
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("HYSTID_CACHE", str(tmp_path / "cache"))
    library._effect.cache_clear()
    cache._private.cache_clear()
    yield tmp_path / "cache"
    library._effect.cache_clear()
    cache._private.cache_clear()


def _one() -> int:
    return ctypes.CDLL(str(shared_library(_ONE, main=["one.c"]))).one()


def _damages(content: bytes) -> list[bytes]:
    """A full disk's, a broken disk's and a foreign file's content in place of the right one."""
    flipped = bytearray(content)
    flipped[len(content) // 2] ^= 0xFF
    return [b"", content[: len(content) // 2], content[:-1], bytes(len(content)), bytes(flipped), b"junk" * 100]


def _replace(path: Path, content: bytes) -> None:
    """Another file in its place: one that this process has mapped must not change below it."""
    path.unlink()
    path.write_bytes(content)


def test_the_folder_belongs_to_the_user_alone(place: Path) -> None:
    assert _one() == 1
    assert stat.S_IMODE(place.stat().st_mode) == 0o700


@pytest.mark.parametrize("kind", range(6))
def test_damaged_libraries_are_made_anew(place: Path, kind: int) -> None:
    made = shared_library(_ONE, main=["one.c"])
    whole = made.read_bytes()
    for path in (made, *place.glob("*.key")):
        _replace(path, _damages(path.read_bytes())[kind])
    again = shared_library(_ONE, main=["one.c"])
    assert again.read_bytes() == whole
    assert ctypes.CDLL(str(again)).one() == 1


@pytest.mark.parametrize("kind", range(6))
def test_no_broken_fmu_is_shipped(place: Path, tmp_path: Path, kind: int) -> None:
    """Every entry is damaged: the FMU, its note, the libraries and the object files of the shell."""
    first = build_model("HystId.Oscillators.Linear", tmp_path / "one.fmu")
    for path in place.iterdir():
        _replace(path, _damages(path.read_bytes())[kind])
    second = build_model("HystId.Oscillators.Linear", tmp_path / "two.fmu")
    assert first.identifier == second.identifier
    t = np.linspace(0.0, 0.1, 50)
    answers = [Driver(made.path).simulate(t, {"F": np.sin(t)})["x"] for made in (first, second)]
    np.testing.assert_array_equal(*answers)


@pytest.mark.parametrize("kind", range(6))
def test_damaged_effects_are_compiled_anew(place: Path, kind: int) -> None:
    name = "HystId.Effects.CoulombFriction"
    first = library._effect(name, library._digest(name))
    library._effect.cache_clear()
    for path in place.iterdir():
        _replace(path, _damages(path.read_bytes())[kind])
    assert library._effect(name, library._digest(name)).model.code == first.model.code


def test_effects_from_the_cache_equal_those_just_compiled() -> None:
    for name in ("CoulombFriction", "HystereticFriction", "ContactLoss__Hertz", "HiddenMode"):
        block = f"HystId.Effects.{name}"
        made = library._effect(block, library._digest(block))
        library._effect.cache_clear()
        again = library._effect(block, library._digest(block))
        assert again is not made and again.model.code == made.model.code
        assert {**vars(again), "model": None} == {**vars(made), "model": None}


def test_no_entry_is_a_pickle(place: Path) -> None:
    """A pickle runs code when it is read. No module of hystid reads one."""
    package = Path(cache.__file__).parent
    readers = ("pickle", "marshal", "shelve", "dill", "joblib")
    for path in package.rglob("*.py"):
        text = path.read_text(encoding="utf-8")
        assert not any(f"import {name}" in text for name in readers), path
        assert "allow_pickle=True" not in text, path


@pytest.mark.skipif(not hasattr(os, "getuid"), reason="folders of other users are told by POSIX owners")
@pytest.mark.parametrize("mode", [0o777, 0o770, 0o1777, 0o722])
def test_a_folder_that_others_can_write_is_not_used(place: Path, mode: int, caplog: pytest.LogCaptureFixture) -> None:
    made = shared_library(_ONE, main=["one.c"])
    made.chmod(0o755)
    place.chmod(mode)
    assert shared_library(_ONE, main=["one.c"]).parent != place
    assert str(place) in caplog.text and "other users can write into it" in caplog.text
    assert stat.S_IMODE(cache.folder().stat().st_mode) == 0o700


@pytest.mark.skipif(not hasattr(os, "getuid") or os.getuid() != 0, reason="only root can give a folder away")
def test_a_folder_of_another_user_is_not_used(place: Path, caplog: pytest.LogCaptureFixture) -> None:
    shared_library(_ONE, main=["one.c"])
    os.chown(place, 12345, 12345)
    assert shared_library(_ONE, main=["one.c"]).parent != place
    assert "it belongs to another user" in caplog.text


@pytest.mark.parametrize("kind", ["a file", "below a file", "a broken link"])
def test_a_place_that_is_no_folder_is_not_used(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, kind: str) -> None:
    place = tmp_path / "taken"
    if kind == "a broken link":
        place.symlink_to(tmp_path / "nowhere" / "at all")
    else:
        place.write_text("mine")
    monkeypatch.setenv("HYSTID_CACHE", str(place / "deeper" if kind == "below a file" else place))
    assert _one() == 1
    assert kind == "a broken link" or place.read_text() == "mine"


def test_without_any_place_there_is_one_sentence(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("HYSTID_CACHE", str(tmp_path / "file"))
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path / "nowhere"))
    with pytest.raises(ToolchainError, match="set HYSTID_CACHE to a folder of your own"):
        cache.folder()


def test_private_folders_go_with_the_process(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    work = tmp_path / "work"
    work.mkdir()
    environment = {**os.environ, "HYSTID_CACHE": str(tmp_path / "file"), "TMPDIR": str(work)}
    command = [sys.executable, "-m", "hystid", "build", "HystId.Oscillators.Linear", "-o", str(tmp_path / "a.fmu")]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0 and "not used" in done.stderr, done.stderr
    assert list(work.iterdir()) == []


def test_a_failed_entry_leaves_nothing(place: Path) -> None:
    with pytest.raises(ToolchainError, match=r"failed on generated code .*cache"):
        shared_library({"bad.c": "int one(void) { return x; }\n"}, main=["bad.c"])
    assert list(place.iterdir()) == []


def test_a_compiler_that_is_not_there_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(ToolchainError, match=r"no-such-compiler.*set CC"):
        shared_library(_ONE, main=["one.c"], command=["no-such-compiler"])


def test_the_command_shows_verifies_and_clears(place: Path, capsys: pytest.CaptureFixture[str]) -> None:
    made = shared_library(_ONE, main=["one.c"])
    (place / "notes of mine.txt").write_text("stay")
    assert run(["cache"]) == 0 and "1 entries" in capsys.readouterr().out
    assert run(["cache", "verify"]) == 0 and "every entry is whole" in capsys.readouterr().out
    _replace(made, b"half")
    assert run(["cache", "verify"]) == 1 and "damaged" in capsys.readouterr().out
    assert run(["cache", "clear"]) == 0
    assert [path.name for path in place.iterdir()] == ["notes of mine.txt"]
    assert run(["cache", "empty"]) == 2


@pytest.mark.parametrize("kind", ["a link", "a folder", "a pipe", "a huge file", "another place"])
def test_what_is_no_entry_is_told_and_replaced(
    place: Path, tmp_path: Path, kind: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """In place of the content: it was followed, read for ever, or raised. The entry is made anew all the same."""
    made = shared_library(_ONE, main=["one.c"])
    whole, key = made.read_bytes(), next(place.glob("*.key"))
    away = tmp_path / "away.so"
    made.rename(away)
    if kind == "a link":
        made.symlink_to(away)  # to the right content: whoever owns that file could change it after the check
    elif kind == "a folder":
        made.mkdir()
        (made / "file").write_text("")
        key.rename(tmp_path / "away.key")
        key.mkdir()
    elif kind == "a pipe":
        os.mkfifo(made)
    elif kind == "a huge file":
        made.touch()
        os.truncate(made, 1 << 40)  # takes no room on the disk
    else:
        away.rename(made)
        key.write_text(f"../{away.name}")
    assert run(["cache"]) == 0 and run(["cache", "verify"]) == 1
    assert f"{key.stem}: damaged" in capsys.readouterr().out
    again = shared_library(_ONE, main=["one.c"])
    assert not again.is_symlink() and again.read_bytes() == whole
    assert run(["cache", "verify"]) == 0
    assert run(["cache", "clear"]) == 0 and list(place.iterdir()) == []
    assert kind != "a link" or away.read_bytes() == whole


def test_emptying_leaves_what_is_not_of_the_cache(place: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """``HYSTID_CACHE=~`` is a folder that serves for more: hidden files and keys of servers were removed there."""
    shared_library(_ONE, main=["one.c"])
    (place / ".git").mkdir()
    for name in (".bashrc", "server.key", "d41d8cd98f00b204e9800998ecf8427e.txt", "\x1b[2J.key"):
        (place / name).write_text("mine")
    before = sorted(path.name for path in place.parent.iterdir())
    assert run(["cache", "verify"]) == 0 and run(["cache", "clear"]) == 0
    assert len(list(place.iterdir())) == 5
    assert sorted(path.name for path in place.parent.iterdir()) == before
    assert "\x1b" not in capsys.readouterr().out


@pytest.mark.parametrize("action", ["show", "verify", "clear"])
def test_a_cache_that_is_not_used_is_refused(place: Path, action: str, capsys: pytest.CaptureFixture[str]) -> None:
    """It was said of the private folder, just made instead, that every entry is whole."""
    made = shared_library(_ONE, main=["one.c"])
    place.chmod(0o777)
    assert run(["cache", action]) == 2
    assert f"the cache {place} is not used: other users can write into it" in capsys.readouterr().err
    assert made.exists()


def test_an_early_end_of_a_file_is_no_interruption(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def broken() -> None:
        raise EOFError("Ran out of input")

    monkeypatch.setattr(cache, "contents", lambda verify: broken())
    assert run(["cache"]) == 1
    said = capsys.readouterr().err
    assert "EOFError" in said and "interrupted" not in said


def test_models_run_from_a_rebuilt_cache(place: Path) -> None:
    code = compile_model("HystId.Oscillators.Linear")
    first = CompiledModel(code).simulate({"F": np.ones(20)}, 1e-3, outputs=["x"])["x"]
    for path in place.iterdir():
        _replace(path, b"")
    np.testing.assert_array_equal(CompiledModel(code).simulate({"F": np.ones(20)}, 1e-3, outputs=["x"])["x"], first)
