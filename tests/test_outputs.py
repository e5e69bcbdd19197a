"""Results on disk: replaced whole or kept, and a place that cannot be written is said before any work."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from hystid.cli.run import run
from hystid.errors import UsageError
from hystid.outputs import replaced


def fill(folder: Path, names: list[str]) -> None:
    with replaced(folder) as new:
        for name in names:
            (new / name).parent.mkdir(parents=True, exist_ok=True)
            (new / name).write_text(f"new {name}")


def content(folder: Path) -> set[str]:
    return {p.relative_to(folder).as_posix() for p in folder.rglob("*") if p.is_file() and p.name != ".hystid"}


def test_a_new_result_leaves_nothing_of_the_old_one_and_nothing_of_the_user_changes(tmp_path: Path) -> None:
    fill(tmp_path, ["report.html", "mismatch_a.csv", "sub/b.csv"])
    (tmp_path / "my notes.txt").write_text("mine")
    fill(tmp_path, ["report.html", "mismatch_c.csv"])
    assert content(tmp_path) == {"report.html", "mismatch_c.csv", "my notes.txt"}
    assert not (tmp_path / "sub").exists()
    assert (tmp_path / "my notes.txt").read_text() == "mine"


@pytest.mark.parametrize("error", [ValueError, KeyboardInterrupt])
def test_after_a_failure_the_old_result_stands(tmp_path: Path, error: type[BaseException]) -> None:
    fill(tmp_path, ["report.html", "old.csv"])
    before = {p: p.read_text() for p in tmp_path.iterdir()}
    with pytest.raises(error), replaced(tmp_path) as new:
        (new / "report.html").write_text("half")
        raise error
    assert {p: p.read_text() for p in tmp_path.iterdir()} == before


def test_a_failure_while_files_are_exchanged_puts_all_back(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    fill(tmp_path, ["a", "b", "c"])
    before = {p: p.read_text() for p in tmp_path.iterdir()}
    real, calls = Path.replace, iter(range(100))

    def failing(self: Path, target: Path) -> Path:
        if next(calls) == 6:  # four files are aside, two of the new ones are in
            raise OSError("disk full")
        return real(self, target)

    monkeypatch.setattr(Path, "replace", failing)
    with pytest.raises(OSError, match="disk full"):
        fill(tmp_path, ["a", "b", "d"])
    monkeypatch.undo()
    assert {p: p.read_text() for p in tmp_path.iterdir()} == before


def test_a_failed_first_run_leaves_no_folder(tmp_path: Path) -> None:
    with pytest.raises(ValueError), replaced(tmp_path / "a" / "b"):
        raise ValueError
    assert list(tmp_path.iterdir()) == []


@settings(max_examples=30, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.text(max_size=40))
def test_a_damaged_list_of_files_never_reaches_outside(tmp_path: Path, text: str) -> None:
    folder, secret = tmp_path / "result", tmp_path / "secret"
    secret.write_text("keep")
    folder.mkdir(exist_ok=True)
    (folder / ".hystid").write_text(f"../secret\n{secret}\n{text}\n", encoding="utf-8", errors="surrogateescape")
    fill(folder, ["report.html"])
    assert secret.read_text() == "keep"


def refused(tmp_path: Path, out: Path, capsys: pytest.CaptureFixture[str]) -> str:
    """What ``identify`` says to an impossible -o; the recording does not exist, so that reading it would say so."""
    assert run(["identify", str(tmp_path / "none.csv"), "--mass", "1", "-o", str(out)]) == 2
    return capsys.readouterr().err


def test_the_output_is_checked_before_anything_is_read(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "file").write_text("x")
    assert "this is a file; name a folder" in refused(tmp_path, tmp_path / "file", capsys)
    assert "file is a file and can hold no folder" in refused(tmp_path, tmp_path / "file" / "a", capsys)
    assert "nothing can be written there" in refused(tmp_path, tmp_path / ("n" * 300), capsys)
    for command in (["simulate", "no.fmu", "--force", "harmonic:1Hz@1N,1s"], ["build", "HystId.Oscillators.Linear"]):
        suffix = ".csv" if command[0] == "simulate" else ".fmu"
        assert run([*command, "-o", str(tmp_path / "file" / f"a{suffix}")]) == 2
        assert "can hold no folder" in capsys.readouterr().err


@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() == 0, reason="the administrator may write anywhere")
def test_a_folder_without_permission_is_said_at_once(tmp_path: Path) -> None:
    tmp_path.chmod(0o500)
    with pytest.raises(UsageError, match="may not be written to"), replaced(tmp_path / "a"):
        pass
    tmp_path.chmod(0o700)


def test_ctrl_c_says_what_is_kept(tmp_path: Path) -> None:
    """A real signal to a real process in the middle of its work."""
    fill(tmp_path / "why", ["report.html"])
    code = (
        "import sys, time; from hystid.cli import groups, run\n"
        "import hystid.diagnosis\n"
        "def slow(*a, **k):\n"
        "    print('working', flush=True); time.sleep(60)\n"
        "hystid.diagnosis.diagnose = slow; groups.ReadingOptions.load = lambda *a: []\n"
        "sys.exit(run.run(['diagnose', 'a.csv', '--model', 'M', '-o', sys.argv[1]]))"
    )
    begun = subprocess.Popen(
        [sys.executable, "-c", code, str(tmp_path / "why")], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
    )  # fmt: skip
    assert begun.stdout is not None and begun.stdout.readline() == "working\n"
    time.sleep(0.1)
    begun.send_signal(signal.SIGINT)
    said = begun.communicate(timeout=60)[1]
    assert begun.returncode == 130
    assert "nothing was written; what was in" in said
    assert content(tmp_path / "why") == {"report.html"}


@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs processes that can be killed")
@pytest.mark.parametrize("step", range(9))
def test_an_exchange_that_was_killed_is_finished_by_the_next_run(tmp_path: Path, step: int) -> None:
    """Killed before each of its moves: 3 old files and their list go aside, 4 new ones and their list come in."""
    fill(tmp_path, ["a", "b", "sub/c"])
    (tmp_path / "mine").write_text("mine")
    child = os.fork()
    if child == 0:
        real, moves = Path.replace, iter(range(100))

        def killed(self: Path, target: Path) -> Path:
            if self.name != ".hystid" and self.name.startswith(".hystid"):  # the list itself is written beside first
                return real(self, target)
            if next(moves) == step:
                os.kill(os.getpid(), signal.SIGKILL)
            return real(self, target)

        Path.replace = killed  # type: ignore[method-assign]
        fill(tmp_path, ["a", "new", "sub/d", "e"])
        os._exit(0)
    assert os.WIFSIGNALED(os.waitpid(child, 0)[1])
    with pytest.raises(ValueError), replaced(tmp_path) as new:
        assert not list(new.iterdir())
        raise ValueError  # the next run fails: what was begun before is whole all the same
    assert content(tmp_path) == {"a", "new", "sub/d", "e", "mine"}
    assert not [path for path in tmp_path.iterdir() if path.name.startswith((".new", ".old"))]
    fill(tmp_path, ["last"])
    assert content(tmp_path) == {"last", "mine"}


@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs processes that can be killed")
def test_a_run_that_was_killed_leaves_the_old_result(tmp_path: Path) -> None:
    fill(tmp_path, ["a", "b"])
    child = os.fork()
    if child == 0:
        with replaced(tmp_path) as new:
            (new / "a").write_text("half")
            os.kill(os.getpid(), signal.SIGKILL)
    os.waitpid(child, 0)
    assert content(tmp_path) - {path for path in content(tmp_path) if path.startswith(".new")} == {"a", "b"}
    fill(tmp_path, ["c"])
    assert {path.name for path in tmp_path.iterdir()} == {"c", ".hystid"}
