"""FMUs of others that crash, hang, leak, print or end the process: one sentence each, and hystid goes on."""

from __future__ import annotations

import contextlib
import functools
import io
import logging
import os
import signal
import subprocess
import tempfile
import time
import zipfile
from pathlib import Path

import numpy as np
import pytest

from hystid.child import Child, frames
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
# The same with a state, for solvers of ours and of FMPy.
EXCHANGE = {
    2: """<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="2.0" modelName="model" guid="0" numberOfEventIndicators="0">
<ModelExchange modelIdentifier="model"/>
<ModelVariables>
<ScalarVariable name="u" valueReference="1" causality="input"><Real start="0"/></ScalarVariable>
<ScalarVariable name="y" valueReference="2" causality="output"><Real/></ScalarVariable>
<ScalarVariable name="x" valueReference="4" causality="output" initial="exact"><Real start="0"/></ScalarVariable>
<ScalarVariable name="der(x)" valueReference="5"><Real derivative="3"/></ScalarVariable>
</ModelVariables><ModelStructure><Outputs><Unknown index="2"/><Unknown index="3"/></Outputs>
<Derivatives><Unknown index="4"/></Derivatives></ModelStructure>
</fmiModelDescription>
""",
    3: """<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="3.0" modelName="model" instantiationToken="0">
<ModelExchange modelIdentifier="model" needsCompletedIntegratorStep="true"/>
<ModelVariables>
<Float64 name="time" valueReference="0" causality="independent" variability="continuous"/>
<Float64 name="u" valueReference="1" causality="input" start="0"/>
<Float64 name="y" valueReference="2" causality="output"/>
<Float64 name="x" valueReference="4" causality="output" initial="exact" start="0"/>
<Float64 name="der(x)" valueReference="5" derivative="4"/>
</ModelVariables><ModelStructure><Output valueReference="2"/><Output valueReference="4"/>
<ContinuousStateDerivative valueReference="5"/></ModelStructure>
</fmiModelDescription>
""",
}
T = np.linspace(0.0, 1.0, 11)

pytestmark = pytest.mark.skipif(os.name == "nt", reason="the FMUs are written for POSIX")


@functools.cache
def _library(wrong: str, where: str) -> bytes:
    with tempfile.TemporaryDirectory() as folder:
        made = Path(folder) / "model.so"
        words = [f"-DWRONG={wrong}", f"-DWHERE={where}", "-fPIC", "-shared", "-w", "-O0"]
        subprocess.run([*compiler(), *words, str(SOURCE), "-o", str(made), "-lm"], check=True)
        return made.read_bytes()


def _fmu(folder: Path, wrong: str, where: str = "STEP", exchange: int = 0) -> Path:
    """exchange: version of FMI for model exchange, 0 for co-simulation."""
    path = folder / "model.fmu"
    platform = "x86_64-linux" if exchange == 3 else "linux64"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("modelDescription.xml", EXCHANGE.get(exchange, DESCRIPTION))
        archive.writestr(f"binaries/{platform}/model.so", _library(wrong, where))
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


def test_signs_of_life_do_not_last_for_ever(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A million messages per step: each step ends, and all of them would take many times the limit."""
    monkeypatch.setenv("HYSTID_CHILD_RUN_SECONDS", "2")
    assert "was not done after 2 s (HYSTID_CHILD_RUN_SECONDS raises this)" in _fate(_fmu(tmp_path, "FLOOD"))


def test_events_that_creep_on_have_an_end(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Each event names the next one a nanosecond ahead: the solver shows life at every step, 10^9 times."""
    monkeypatch.setenv("HYSTID_CHILD_RUN_SECONDS", "3")
    assert "was not done after 3 s" in _fate(_fmu(tmp_path, "CREEP", "NOWHERE", 2))


def test_a_process_that_takes_no_more_questions_is_stopped(tmp_path: Path, patience: None) -> None:
    """Stopped in its last call, it does not read the next question, which is larger than a pipe."""
    driver = Driver(_fmu(tmp_path, "FINE"))
    driver.simulate(T, {"u": T})
    os.kill(driver._foreign._child._running._process.pid, signal.SIGSTOP)
    t = np.linspace(0.0, 1.0, 20_000)
    with pytest.raises(FmuError, match="gave no answer within"):
        driver.simulate(t, {"u": t})


@pytest.mark.parametrize("version", [2, 3])
@pytest.mark.parametrize("where", ["DERIVATIVES", "TIME", "DISCRETE"])
def test_crashes_under_held_states_are_told(tmp_path: Path, version: int, where: str) -> None:
    """Our own integration of what a measured motion leaves free."""
    driver = Driver(_fmu(tmp_path, "CRASH", where, version))
    with pytest.raises(FmuError, match=r"model\.fmu: its library crashed \(segmentation fault\)"):
        driver.clamp({}, {"u": np.ones(11)}, 0.1, outputs=["y"])


@pytest.mark.parametrize(
    ("version", "wrong", "where", "says"),
    [
        (3, "CRASH", "TIME", "(segmentation fault)"),
        (2, "ABORT", "DERIVATIVES", "aborted"),
        (3, "EXIT0", "DERIVATIVES", "exit code 0"),
        (2, "EXIT0", "TIME", "exit code 0"),
        (3, "PRINT", "DISCRETE", "the last that it printed was"),
        (2, "REFUSE", "DERIVATIVES", "failed"),
        (3, "REFUSE", "DISCRETE", "failed"),
        (2, "LOOP", "DISCRETE", "gave no answer within"),
        (3, "LOOP", "DERIVATIVES", "gave no answer within"),
        (2, "STORM", "NOWHERE", "gave no answer within"),
        (3, "LEAK", "TIME", "of memory"),
    ],
)
def test_fates_in_model_exchange(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, version: int, wrong: str, where: str, says: str
) -> None:
    """In calls of FMPy's solver."""
    monkeypatch.setenv("HYSTID_CHILD_SECONDS", "1.5")
    if wrong == "LEAK":  # a solver needs some hundreds of megabytes for itself, and more after others
        monkeypatch.setenv("HYSTID_CHILD_MEMORY_MB", "600")
    assert says in _fate(_fmu(tmp_path, wrong, where, version))


@pytest.mark.parametrize("version", [2, 3])
def test_without_a_fault_model_exchange_runs(tmp_path: Path, version: int) -> None:
    """der(x) = 1 - x from rest, by a solver whose relative tolerance is 1e-8."""
    found = Driver(_fmu(tmp_path, "FINE", "NOWHERE", version)).simulate(T, {"u": np.ones(11)}, outputs=["x"])["x"]
    np.testing.assert_allclose(found, 1 - np.exp(-T), atol=1e-6)


@pytest.mark.parametrize("version", [2, 3])
@pytest.mark.parametrize("held", [False, True])
def test_an_early_end_in_model_exchange_is_told(tmp_path: Path, version: int, held: bool) -> None:
    """The last values were repeated up to the last time."""
    driver = Driver(_fmu(tmp_path, "ENDS", "NOWHERE", version))
    with pytest.raises(FmuError, match=r"model.fmu: it asked for the end of the simulation (at t = 0.5|before)"):
        if held:
            driver.clamp({"x": T}, {"u": T}, 0.1, outputs=["y"])
        else:
            driver.simulate(T, {"u": T}, outputs=["x"])


@pytest.mark.parametrize("exchange", [0, 2])
def test_inputs_are_set_where_fmi_2_allows_it(tmp_path: Path, exchange: int) -> None:
    """From Initialization Mode on."""
    driver = Driver(_fmu(tmp_path, "INSIST", "NOWHERE", exchange))
    assert driver.simulate(T, {"u": T + 1}, outputs=["y"])["y"][0] == 2
    if exchange:
        assert driver.clamp({"x": T}, {"u": T + 1}, 0.1, outputs=["y"])["y"][0] == 2


def test_leaks_are_stopped(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HYSTID_CHILD_MEMORY_MB", "600")
    assert "needs more than 600 MB of memory (HYSTID_CHILD_MEMORY_MB raises this" in _fate(_fmu(tmp_path, "LEAK"))


@pytest.mark.parametrize(
    ("wrong", "says"),
    [("FINE", ""), ("BELOW", "failed"), ("EARLY", "early, which it was told not to"), ("BYTES", "bytes are more than")],
)
def test_answers_that_the_standard_does_not_know(tmp_path: Path, wrong: str, says: str) -> None:
    """A status below 0, a step that ends where it began, binary data of 2^64 - 1 bytes: all were taken for good."""
    path = tmp_path / "model.fmu"
    text = EXCHANGE[3].replace("ModelExchange model", "CoSimulation model")
    with zipfile.ZipFile(path, "w") as archive:
        more = '<Binary name="b" valueReference="6" causality="output"/></ModelVariables>'
        archive.writestr("modelDescription.xml", text.replace("</ModelVariables>", more))
        archive.writestr("binaries/x86_64-linux/model.so", _library(wrong, "STEP"))
    if not says:
        assert list(Driver(path).record(T, {"u": T}, outputs=["b"])["b"]) == ["6162"] * len(T)
        return
    with pytest.raises(FmuError, match=f"model.fmu: .*{says}"):
        Driver(path).record(T, {"u": T}, outputs=["b"])


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


@pytest.mark.skipif(not Path("/proc").exists(), reason="what it has started is found there")
@pytest.mark.parametrize("killed", [False, True])
def test_what_it_has_started_ends_with_it(tmp_path: Path, killed: bool) -> None:
    """A daemon in a session of its own, which no signal to its group reaches, also where its process is killed."""
    driver = Driver(_fmu(tmp_path, "DAEMON"))
    driver.simulate(T, {"u": T})
    process = driver._foreign._child._running
    sign = f"HYSTID_CHILD_SIGN={process._sign}".encode()

    def started() -> list[Path]:
        found = []
        for place in Path("/proc").glob("[0-9]*"):
            with contextlib.suppress(OSError):
                if sign in (place / "environ").read_bytes():
                    found.append(place)
        return found

    assert len(started()) == len(T)  # one per step, and the process itself
    if killed:
        os.kill(process._process.pid, signal.SIGKILL)
        driver.simulate(T[:1], {"u": T[:1]})  # by another process: it makes no step
    else:
        driver._foreign._child.close()
    assert started() == []


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
    found = frames.receive(io.BytesIO(b"".join(frames.encoded(value))), 10_000, 10_000)
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
        frames._unpacked(told, memoryview(bytes(16)))


def floods(count: int) -> int:
    """What a library does that logs at every call."""
    for i in range(count):
        logging.getLogger("hystid").warning("message %d", i)
    return count


def test_messages_without_end_are_cut(caplog: pytest.LogCaptureFixture) -> None:
    """The first ones say what is wrong; each call has its own number of them."""
    other = Child()
    try:
        for _ in range(2):
            caplog.clear()
            assert other.ask("test_hostile_fmus:floods", count=3000) == 3000
            assert len(caplog.records) == 1000
            assert caplog.messages[0] == "message 0"
            assert caplog.messages[-1] == "further messages of this call are left out"
    finally:
        other.close()
