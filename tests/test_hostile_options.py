"""Options that no sensible user gives: each is one sentence and exit code 2, and nothing is written."""

from __future__ import annotations

import json
import math
import os
from pathlib import Path

import pytest

from hystid.cli.run import run
from hystid.errors import UsageError
from hystid.fmu import build_model
from hystid.outputs import replaced

SIMULATE = "simulate {fmu} --force harmonic:20Hz@8N,0.1s -o out.csv"
IDENTIFY = "identify {rec} --mass 1 -o out"
GRID = "study grid {rec} --mass 1 --holdout {other} -o out"
DIAGNOSE = "diagnose {rec} --model HystId.Oscillators.Linear -o out"
REFUSED = [
    f"{SIMULATE} --dt 1e-320",
    f"{SIMULATE} --noise-snr 1e300",
    f"{SIMULATE} --noise-snr 20 --seed=-1",
    "simulate {fmu} --force multisine:5-80Hz@3Nrms,1e5s -o out.csv",
    "simulate {fmu} --force harmonic:20Hz@8N,1e9s -o out.csv",
    "simulate {fmu} --force multisine:5-80Hz@3Nrms,1s --seed=-1 -o out.csv",
    "simulate {fmu} --force harmonic:20Hz@8N,0.1s -o pipe.csv",
    "build HystId.Oscillators.Linear -o pipe.fmu",
    f"build HystId.Oscillators.Linear -o {'a' * 300}.fmu",
    f"build {'A.' * 5000}B -o out.fmu",
    f"build {'a' * 300}.mo -o out.fmu",
    f"build {'.' * 1000} -o out.fmu",
    *(f"check {{rec}} --mass={mass}" for mass in ("nan", "inf", "-1", "1e999")),
    *(f"{IDENTIFY} --band={band}" for band in ("5-5Hz", "0-0Hz", "0-Hz", "-0Hz", "")),
    *(f"{IDENTIFY} --ensemble={count}" for count in ("0", "1000000000", "9" * 20)),
    f"{IDENTIFY} --seed=-1",
    *(f"{IDENTIFY} --workers={count}" for count in ("0", "-1")),
    *(f"{GRID} --starts={count}" for count in ("0", "1000000000")),
    *(f"{GRID} --{option}" for option in ("workers=0", "seed=-1", "band=")),
    *(f"study grid {{rec}} --mass={mass} --holdout {{other}} -o out" for mass in ("nan", "-1", "inf")),
    *(f"study mass {{rec}} --mass={mass} --holdout {{other}} -o out" for mass in ("nan", "inf", "0")),
    f"{DIAGNOSE} --set m=-1",
    f"{DIAGNOSE} --parameters fixed.json",
]


@pytest.fixture(scope="module")
def given(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """A model and two recordings of it that every command takes."""
    folder = tmp_path_factory.mktemp("given")
    fmu = build_model("HystId.Oscillators.Linear", folder / "a.fmu").path
    for name, hertz in (("rec", 20), ("other", 15)):
        force = f"chirp:1-{hertz}Hz@8N,2s"
        assert run(["simulate", str(fmu), "--force", force, "--dt", "1e-3", "-o", str(folder / f"{name}.csv")]) == 0
    return {"fmu": fmu, "rec": folder / "rec.csv", "other": folder / "other.csv"}


@pytest.mark.parametrize("command", REFUSED, ids=lambda command: command[:70])
def test_options_are_refused_in_one_sentence(
    given: dict[str, Path],
    tmp_path: Path,
    command: str,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    os.mkfifo("pipe.csv")
    os.mkfifo("pipe.fmu")
    Path("fixed.json").write_text(json.dumps({"m": {"value": 1.0, "fixed": "yes"}}))
    before = sorted(path.name for path in tmp_path.iterdir())
    assert run(command.format(**given).split()) == 2
    said = [line for line in capsys.readouterr().err.splitlines() if "warning" not in line]
    assert len(said) == 1 and said[0].startswith("hystid: ") and len(said[0]) < 700 and "internal" not in said[0]
    assert sorted(path.name for path in tmp_path.rglob("*")) == before


def test_the_list_of_an_earlier_result_removes_nothing_outside(tmp_path: Path) -> None:
    """A folder that somebody else made: its list of files and its links lead to a file of the user."""
    elsewhere, out = tmp_path / "elsewhere", tmp_path / "out"
    elsewhere.mkdir()
    out.mkdir()
    (elsewhere / "thesis.tex").write_text("mine")
    (out / "link").symlink_to(elsewhere)
    (out / ".hystid").write_text("link/thesis.tex\n../elsewhere/thesis.tex\n")
    with replaced(out) as new:
        (new / "report.html").write_text("new")
    assert (elsewhere / "thesis.tex").read_text() == "mine"
    assert (out / "report.html").read_text() == "new"


def test_a_result_does_not_follow_a_link_out_of_its_folder(tmp_path: Path) -> None:
    elsewhere, out = tmp_path / "elsewhere", tmp_path / "out"
    elsewhere.mkdir()
    out.mkdir()
    (out / "trainings").symlink_to(elsewhere)
    with pytest.raises(UsageError, match="leads out"), replaced(out) as new:
        (new / "trainings").mkdir()
        (new / "trainings/1.json").write_text("{}")
    assert list(elsewhere.iterdir()) == []


def test_all_that_is_allowed_is_still_taken(given: dict[str, Path], tmp_path: Path) -> None:
    """The least and the greatest values, and a name that is as long as names of files may be."""
    out = tmp_path / f"{'a' * 240}.csv"
    assert run([*SIMULATE.format(**given).split()[:-1], str(out), "--noise-snr", "1000", "--seed", "0"]) == 0
    assert math.isfinite(float(out.read_text().splitlines()[-1].split(",")[1]))
