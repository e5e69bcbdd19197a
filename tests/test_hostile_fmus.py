"""FMUs of others that crash, hang, leak, print or end the process: one sentence each, and hystid goes on."""

from __future__ import annotations

import functools
import logging
import os
import subprocess
import tempfile
import time
import zipfile
from pathlib import Path

import numpy as np
import pytest

from hystid import child
from hystid.cli.run import run
from hystid.errors import FmuError, HystidError
from hystid.fmu import Driver, build_model
from hystid.fmu.foreign import runs_here
from hystid.toolchain import compiler

SOURCE = Path(__file__).parent / "hostile_fmu" / "model.c"
DESCRIPTION = """<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="2.0" modelName="model" guid="0">
<CoSimulation modelIdentifier="model" canHandleVariableCommunicationStepSize="true"/>
<ModelVariables>
<ScalarVariable name="u" valueReference="1" causality="input"><Real start="0"/></ScalarVariable>
<ScalarVariable name="y" valueReference="2" causality="output"><Real/></ScalarVariable>
<ScalarVariable name="gain" valueReference="3" causality="parameter" variability="fixed">
<Real start="2" min="0" max="10"/></ScalarVariable>
</ModelVariables><ModelStructure><Outputs><Unknown index="2"/></Outputs></ModelStructure>
</fmiModelDescription>
"""
T = np.linspace(0.0, 1.0, 11)

pytestmark = pytest.mark.skipif(os.name == "nt", reason="the FMUs are written for POSIX")


@functools.cache
def _library(wrong: str, where: str) -> bytes:
    with tempfile.TemporaryDirectory() as folder:
        made = Path(folder) / "model.so"
        words = [f"-DWRONG={wrong}", f"-DWHERE={where}", "-fPIC", "-shared", "-w", "-O0"]
        subprocess.run([*compiler(), *words, str(SOURCE), "-o", str(made), "-lm"], check=True)
        return made.read_bytes()


def _fmu(folder: Path, wrong: str, where: str = "STEP", **extra: str) -> Path:
    path = folder / "model.fmu"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("modelDescription.xml", DESCRIPTION)
        archive.writestr("binaries/linux64/model.so", _library(wrong, where))
        for name, text in extra.items():
            archive.writestr(name, text)
    return path


def _fate(path: Path) -> str:
    with pytest.raises(HystidError) as caught:
        Driver(path).simulate(T, {"u": np.sin(T)})
    text = str(caught.value)
    assert text.startswith("model.fmu") and "\n" not in text and text.isprintable() and len(text) < 1000
    return text


@pytest.fixture
def patience(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HYSTID_CHILD_SECONDS", "1.5")


@pytest.mark.parametrize(
    ("wrong", "where", "says"),
    [
        *(
            ("CRASH", where, "(segmentation fault)")
            for where in ("LOAD", "INSTANTIATE", "SETUP", "STEP", "GET", "FREE")
        ),
        *(("EXIT0", where, "exit code 0") for where in ("LOAD", "STEP", "FREE")),
        ("ABORT", "STEP", "aborted"),
        ("EXIT3", "STEP", "exit code 3"),
    ],
)
def test_ends_of_the_process_are_told(tmp_path: Path, wrong: str, where: str, says: str) -> None:
    assert says in _fate(_fmu(tmp_path, wrong, where))


@pytest.mark.parametrize(
    ("wrong", "says"),
    [
        ("DIVIDE", "arithmetic error"),
        ("ILLEGAL", "illegal instruction"),
        ("DEEP", "segmentation fault"),
        ("KILL", "ended by SIGKILL"),
        ("DOUBLE_FREE", "aborted"),
        ("FORK", "exit code 0"),
        ("NOISE", "ended by SIGKILL"),
        ("REFUSE", "failed"),
        ("FATAL", "failed"),
        ("NULL_MESSAGE", "failed"),
        ("READ_STDIN", "failed"),
        ("NAN_", "'y' is nan"),
        ("INFINITE", "'y' is inf"),
        ("BAD_ALLOC", "of memory"),
    ],
)
def test_other_fates(tmp_path: Path, wrong: str, says: str) -> None:
    assert says in _fate(_fmu(tmp_path, wrong, "STEP"))


@pytest.mark.parametrize(("wrong", "where"), [("LOOP", "STEP"), ("SLEEP", "LOAD"), ("LOOP", "FREE")])
def test_hangs_are_stopped(tmp_path: Path, wrong: str, where: str, patience: None) -> None:
    assert "gave no answer within" in _fate(_fmu(tmp_path, wrong, where))


def test_leaks_are_stopped(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HYSTID_CHILD_MEMORY_MB", "600")
    assert "needs more than 600 MB of memory (HYSTID_CHILD_MEMORY_MB raises this" in _fate(_fmu(tmp_path, "LEAK"))


def test_files_have_an_end(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A log without an end stops at the budget of the disk."""
    monkeypatch.setenv("HYSTID_FMU_UNPACKED_MB", "5")
    assert "wrote 5 MB" in _fate(_fmu(tmp_path, "FILL"))


def test_closed_pipes_are_noticed(tmp_path: Path, patience: None) -> None:
    assert "model.fmu: its library" in _fate(_fmu(tmp_path, "CLOSE"))


def test_prints_reach_no_terminal(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    text = _fate(_fmu(tmp_path, "PRINT"))
    assert "the last that it printed was" in text and "\\x1b" in text
    out, err = capfd.readouterr()
    assert "evil" not in out + err and "\x1b" not in out + err


def test_messages_are_formatted_and_short(tmp_path: Path) -> None:
    assert len(_fate(_fmu(tmp_path, "LONG_MESSAGE"))) < 600
    assert "\\x1b" in _fate(_fmu(tmp_path, "FORMAT"))


def test_files_that_it_writes_go_with_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    work = tmp_path / "work"
    work.mkdir()
    monkeypatch.chdir(work)
    Driver(_fmu(tmp_path, "WRITE_FILE")).simulate(T, {"u": np.sin(T)})
    assert list(work.iterdir()) == []


def test_after_a_crash_the_next_call_is_answered(tmp_path: Path) -> None:
    """A library that crashes for one input only: the driver is still of use."""
    driver = Driver(_fmu(tmp_path, "FINE"))
    first = driver.simulate(T, {"u": np.sin(T)})["y"]
    os.kill(driver._foreign._child._running._process.pid, 9)
    time.sleep(0.1)
    np.testing.assert_array_equal(driver.simulate(T, {"u": np.sin(T)})["y"], first)
    np.testing.assert_array_equal(first, 2 * np.sin(T[[0, *range(10)]]))


def test_no_process_and_no_folder_is_left(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    place = tmp_path / "temporary"
    place.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(place))
    driver = Driver(_fmu(tmp_path, "FINE"))
    driver.simulate(T, {"u": np.sin(T)})
    number = driver._foreign._child._running._process.pid
    assert Path(f"/proc/{number}").exists() or not Path("/proc").exists()
    del driver
    assert not Path(f"/proc/{number}").exists()
    assert list(place.iterdir()) == []


def test_parameters_stay_within_their_range(tmp_path: Path) -> None:
    driver = Driver(_fmu(tmp_path, "FINE"))
    driver.simulate(T, {"u": T}, parameters={"gain": 10.0})
    for value in (-1.0, 10.5, np.nan, np.inf):
        with pytest.raises(FmuError, match="gain"):
            driver.simulate(T, {"u": T}, parameters={"gain": value})


@pytest.mark.parametrize("wrong", ["EXIT0", "REFUSE"])
def test_regress_does_not_pass(tmp_path: Path, wrong: str, capsys: pytest.CaptureFixture[str]) -> None:
    """exit(0) inside a step ended hystid with code 0: a regression that had compared nothing passed."""
    path = _fmu(tmp_path, wrong)
    (tmp_path / "model_out.csv").write_text("time,y\n" + "".join(f"{t},{2 * t}\n" for t in T))
    (tmp_path / "model_in.csv").write_text("time,u\n" + "".join(f"{t},{t}\n" for t in T))
    assert run(["regress", str(path)]) == 2
    assert "model.fmu" in capsys.readouterr().err


def test_the_command_line_tells_the_fate(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = _fmu(tmp_path, "CRASH")
    assert run(["regress", str(path), "--reference", str(path)]) == 2
    path.with_name("model_out.csv").write_text("time,y\n0,0\n1,2\n")
    assert run(["regress", str(path)]) == 2
    assert "segmentation fault" in capsys.readouterr().err


def test_our_own_run_in_this_process(tmp_path: Path) -> None:
    """What was built here is trusted by the hash of its library; the same library under another name, too."""
    own = Driver(build_model("HystId.Oscillators.Linear", tmp_path / "own.fmu").path)
    assert runs_here(own._fmu) and own._foreign is None
    assert not runs_here(Driver(_fmu(tmp_path, "FINE"))._fmu)


def test_our_own_of_another_machine_keep_their_batch_entry(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = build_model("HystId.Oscillators.Linear", tmp_path / "own.fmu").path
    t = np.arange(2000) * 1e-3
    here = Driver(path).simulate(t, {"F": np.sin(40 * t)})
    monkeypatch.setenv("HYSTID_CACHE", str(tmp_path / "another"))
    driver = Driver(path)
    assert driver.is_own and driver._foreign is not None
    there = driver.simulate(t, {"F": np.sin(40 * t)})
    for name, values in here.items():
        np.testing.assert_array_equal(there[name], values)


def test_a_library_that_claims_to_be_ours_is_not_believed(tmp_path: Path) -> None:
    """The batch entry's name in a library proves nothing."""
    path = _fmu(tmp_path, "FINE")
    with zipfile.ZipFile(path, "a") as archive:
        archive.writestr("hystid.txt", "hy_run_table")
    assert Driver(path)._foreign is not None


def test_arrays_and_texts_come_through_the_pipe() -> None:
    value = {
        "a": np.arange(6.0).reshape(2, 3), "b": np.array([True, False]), "c": np.zeros((0, 3)), "d": np.int32(7),
        "e": [1, 2.5, None, "x", {"f": np.array(["a", "ü"], object)}], "": float("inf"), "g": np.array(2.0),
        "h": np.arange(10)[::2],
    }  # fmt: skip
    packed = child._Arrays()
    text = child._packed(value, packed)
    data = memoryview(b"".join(bytes(memoryview(array).cast("B")) for array in packed if array.nbytes))
    found = child._unpacked(text, data)
    assert list(found) == list(value)
    for name in ("a", "b", "c", "g", "h"):
        np.testing.assert_array_equal(found[name], value[name])
    assert found["d"] == 7 and found["e"][:4] == [1, 2.5, None, "x"] and list(found["e"][4]["f"]) == ["a", "ü"]


@pytest.mark.parametrize(
    "told",
    [["array", 0, "O", [1]], ["array", -8, "<f8", [1]], ["array", 0, "<f8", [-1]], ["array", 0, "<f8", [99]], ["?"]],
)
def test_nonsense_from_over_there_is_no_array(told: list[object]) -> None:
    with pytest.raises((ValueError, TypeError, IndexError)):
        child._unpacked(told, memoryview(bytes(16)))


def floods(count: int) -> int:
    """What a library does that logs at every call."""
    for i in range(count):
        logging.getLogger("hystid").warning("message %d", i)
    return count


def test_messages_without_end_are_cut(caplog: pytest.LogCaptureFixture) -> None:
    """The first ones say what is wrong; each call has its own number of them."""
    other = child.Child()
    try:
        for _ in range(2):
            caplog.clear()
            assert other.ask("test_hostile_fmus:floods", count=3000) == 3000
            assert len(caplog.records) == 1000
            assert caplog.messages[0] == "message 0"
            assert caplog.messages[-1] == "further messages of this call are left out"
    finally:
        other.close()
