"""Studies: the table, resuming after a kill, the Dask cluster with a lost worker, the mass."""

import json
import os
import signal
import subprocess
import sys
import textwrap
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from hystid import study
from hystid.errors import UsageError
from hystid.recording import Recording, write_csv
from hystid.report.study import page as study_page
from hystid.study import work
from hystid.study.cells import Quartiles

DT, MASS = 1e-3, 1.0


def oscillator(name, amplitude, frequency, seconds=2.0):
    """Jenkins oscillator from rest under a chirp; semi-implicit Euler at a tenth of the sample time."""
    t = np.arange(round(seconds / DT)) * DT
    x = v = z = 0.0
    rows = []
    for F in amplitude * np.sin(2 * np.pi * frequency * t * (t / seconds + 0.2)):
        rows.append((F, x, v, F - 10 * v - 1e4 * x - z))
        for _ in range(10):
            v += DT / 10 * (F - 10 * v - 1e4 * x - z)
            x += DT / 10 * v
            z = min(37.5, max(-37.5, z + 5e4 * DT / 10 * v))
    return Recording(name, t, **dict(zip("Fxva", np.array(rows).T, strict=True)))


@pytest.fixture(scope="module")
def recordings():
    return [oscillator("train", 70, 20)], [oscillator("test", 60, 15, 1.0)]


SMALL = {"mass": MASS, "structures": [(2,), (4, 4)], "starts": 3, "iterations": 25, "samples": 1500, "seed": 3}


@pytest.fixture(scope="module")
def finished(recordings, tmp_path_factory):
    train, test = recordings
    return study.grid(train, holdout=test, out=tmp_path_factory.mktemp("grid"), **SMALL)


def test_grid_gives_figures_for_every_structure(finished):
    assert [cell.layers for cell in finished.cells] == [(2,), (4, 4)]
    assert [cell.parameters for cell in finished.cells] == [2 * 11, 2 * (16 + 20 + 5)]
    for cell in finished.cells:
        spread = cell.force
        assert len(spread.values) == 3
        assert spread.best <= spread.lower <= spread.median <= spread.upper <= spread.worst
        assert {spread.best, spread.median, spread.worst} == set(spread.values)
        assert all(sum(reasons.values()) == 3 for reasons in cell.stopped.values())
        assert all(outcome.seconds > 0 for outcome in cell.outcomes)
        # of three starts a tenth is one: ensemble and best single network are the same
        assert cell.ensemble["force_nrmse"] == pytest.approx(cell.single["force_nrmse"], rel=1e-12)
    assert finished.best.name in finished.reason and "within 10 %" in finished.reason


@pytest.mark.parametrize(("values", "expected"), [((1, 2, 4, 5), 3), ((1, 2, np.inf, np.inf), np.inf), ((1, 3), 2)])
def test_the_median_is_that_of_the_box_that_is_drawn(values, expected):
    """Half way between the middle two, and as plotly draws it (Hazen); nothing is half way to a run that diverged."""
    assert Quartiles.of(values).median == expected


def test_a_grid_that_is_of_no_use_says_so_everywhere(finished):
    poor = replace(finished.best, free_run=Quartiles.of([0.6, 0.8]))
    lost = replace(finished, cells=[poor], chosen=0)
    assert finished.failure == "" and "choose" in finished.summary()
    assert lost.as_dict()["failure"] == "no structure is of use: the free-run displacement is off by 70 % at best"
    assert lost.failure in lost.summary() and "choose" not in lost.summary()
    assert "No structure is of use" in study_page(lost, "").html()


def test_stored_outcomes_are_whole(finished):
    folder = finished.files["study"].parent / "trainings"
    for cell in finished.cells:
        for outcome in cell.outcomes:
            again = work.load(outcome.task, folder)
            assert np.array_equal(again.member.restoring.flat, outcome.member.restoring.flat)
            assert again.force == outcome.force
            assert again.curves["restoring_validation"].min() == pytest.approx(outcome.validation)


def test_an_unreadable_file_is_trained_anew(finished, recordings, tmp_path):
    train, test = recordings
    study.grid(train, holdout=test, out=tmp_path, **SMALL)
    broken = sorted((tmp_path / "trainings").glob("*.npz"))[1]
    whole = np.load(broken)["restoring_w"]
    broken.write_bytes(broken.read_bytes()[:100])
    study.grid(train, holdout=test, out=tmp_path, **SMALL)
    assert np.array_equal(np.load(broken)["restoring_w"], whole)


def test_killed_at_any_time_it_goes_on_and_ends_the_same(finished, recordings, tmp_path):
    """SIGKILL as soon as the first trainings are stored; the second run keeps their files untouched."""
    train, test = recordings
    write_csv(train[0], tmp_path / "train.csv")
    write_csv(test[0], tmp_path / "test.csv")
    script = f"""
        from hystid import study
        from hystid.recording import read
        from pathlib import Path
        folder = Path({str(tmp_path)!r})
        study.grid([read(folder / "train.csv")], holdout=[read(folder / "test.csv")], out=folder / "out", workers=1,
                   mass=1.0, structures=[(2,), (4, 4)], starts=40, iterations=25, samples=1500)
    """
    trainings = tmp_path / "out" / "trainings"
    run = subprocess.Popen([sys.executable, "-c", textwrap.dedent(script)])
    deadline = time.monotonic() + 60
    while len(list(trainings.glob("[!.]*.npz"))) < 3 and run.poll() is None and time.monotonic() < deadline:
        time.sleep(0.005)
    run.kill()
    run.wait()
    before = {path: path.stat().st_mtime_ns for path in trainings.glob("[!.]*.npz")}
    assert 3 <= len(before) < 80
    assert not (tmp_path / "out" / "study.json").exists()
    subprocess.run([sys.executable, "-c", textwrap.dedent(script)], check=True)
    assert len(list(trainings.glob("[!.]*.npz"))) == 80
    assert all(path.stat().st_mtime_ns == stamp for path, stamp in before.items())
    fresh = textwrap.dedent(script).replace('folder / "out"', 'folder / "fresh"')
    subprocess.run([sys.executable, "-c", fresh], check=True)
    assert (tmp_path / "out" / "study.json").read_bytes() == (tmp_path / "fresh" / "study.json").read_bytes()


def test_ctrl_c_keeps_what_was_finished(recordings, tmp_path):
    """SIGINT ends the running trainings at their next iteration: whole files, none half written, no study.json."""
    train, test = recordings
    write_csv(train[0], tmp_path / "train.csv")
    write_csv(test[0], tmp_path / "test.csv")
    arguments = ["study", "grid", "train.csv", "--holdout", "test.csv", "--mass", "1", "--workers", "1", "-o", "out"]
    command = [sys.executable, "-c", f"from hystid.cli import main; main({arguments!r})"]
    run = subprocess.Popen(
        command,
        cwd=tmp_path,
        stderr=subprocess.PIPE,
        text=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),  # a shell's background job begins without it
    )
    trainings, deadline = tmp_path / "out" / "trainings", time.monotonic() + 60
    while len(list(trainings.glob("[!.]*.npz"))) < 2 and run.poll() is None and time.monotonic() < deadline:
        time.sleep(0.01)
    run.send_signal(signal.SIGINT)
    message = run.communicate(timeout=60)[1]
    assert run.returncode == 130 and "finished trainings are kept in out" in message
    files = sorted(trainings.iterdir())
    assert 2 <= len(files) < 450 and all(path.suffix == ".npz" and path.name[0] != "." for path in files)
    assert all(np.load(path)["restoring_w"].size == 11 for path in files)  # the first structure: one layer of two
    assert not (tmp_path / "out" / "study.json").exists()


def dask(kind, *arguments):
    return subprocess.Popen(
        [sys.executable, "-m", f"distributed.cli.dask_{kind}", *arguments],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        env={**os.environ, "OMP_NUM_THREADS": "1"},
    )


def test_dask_cluster_survives_the_loss_of_a_worker(recordings, finished, tmp_path):
    """A real scheduler and two workers, one killed as the first results are there. Same figures as on this machine."""
    pytest.importorskip("distributed")
    described = tmp_path / "scheduler.json"
    processes = [dask("scheduler", "--port", "0", "--no-dashboard", "--scheduler-file", str(described))]
    try:
        processes += [
            dask("worker", "--scheduler-file", str(described), "--no-nanny", "--no-dashboard", "--nthreads", "1")
            for _ in range(2)
        ]
        deadline = time.monotonic() + 60
        while not described.exists() and time.monotonic() < deadline:
            time.sleep(0.05)
        address = json.loads(described.read_text())["address"]
        killer = subprocess.Popen([sys.executable, "-c", KILLER, str(tmp_path / "out"), str(processes[1].pid)])
        train, test = recordings
        result = study.grid(train, holdout=test, out=tmp_path / "out", scheduler=address, **SMALL)
        assert killer.wait(30) == 0
        assert processes[1].wait(30) == -signal.SIGKILL
        assert json.dumps(result.as_dict()["cells"]) == json.dumps(finished.as_dict()["cells"])
    finally:
        for process in reversed(processes):
            process.kill()
            process.wait()


KILLER = """
import os, signal, sys, time
from pathlib import Path
end = time.monotonic() + 60
while not list(Path(sys.argv[1]).glob("trainings/[!.]*.npz")) and time.monotonic() < end:
    time.sleep(0.01)
os.kill(int(sys.argv[2]), signal.SIGKILL)
"""


def test_mass_study_finds_the_weighed_mass_best(recordings, tmp_path):
    """R = F - m a holds for the true mass only: with a wrong one R is no function of motion and memory."""
    train, test = recordings
    result = study.mass(
        train,
        mass=MASS,
        holdout=test,
        offsets=(-0.2, 0.0, 0.2),
        sizes=(5,),
        starts=4,
        iterations=60,
        samples=2000,
        out=tmp_path,
    )
    cells = result.row((5, 5))
    assert [cell.mass for cell in cells] == pytest.approx([0.8, 1.0, 1.2])
    errors = [cell.free_run.best for cell in cells]
    assert errors[1] == min(errors)
    stored = json.loads((tmp_path / "study.json").read_text())
    assert stored["offsets"] == [-0.2, 0.0, 0.2] and len(stored["cells"]) == 3


def test_wrong_use_gets_a_sentence(recordings, finished, tmp_path):
    train, test = recordings
    folder = finished.files["study"].parent
    with pytest.raises(UsageError, match="holds a study of other recordings or settings"):
        study.grid(train, holdout=test, out=folder, **{**SMALL, "seed": 4})
    with pytest.raises(UsageError, match="--holdout"):
        study.grid(train, holdout=[], out=tmp_path, **SMALL)
    with pytest.raises(UsageError, match="needs a mass above 0 kg"):
        study.mass(train, mass=0.0, holdout=test, out=tmp_path)
    with pytest.raises(UsageError, match=r"no Dask scheduler answers at tcp://127\.0\.0\.1:9"):
        study.grid(train, holdout=test, out=tmp_path / "lost", scheduler="tcp://127.0.0.1:9", **SMALL)
    assert Path(folder, "study.json").exists()
