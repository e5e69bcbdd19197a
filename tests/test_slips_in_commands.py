"""A wrong label never ends in exit code 0, in a crash, or in a name but with the label read rightly: every command.

A few of the slips of ``benchmarks/slips.py``; ``python -m benchmarks.slips --commands`` runs all twenty.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import pytest

from benchmarks.slips import RIGS, simulated, slips
from benchmarks.slips_in_commands import COMMANDS, outcome, prepared
from hystid import build, diagnose, simulate
from hystid.recording import Recording, read, write_csv
from hystid.report.page import percent
from hystid.validation import validate

MASS = RIGS["Jenkins"]["m"]
SLIPS = {slip.name: slip for slip in slips()}
REFUSED = ("x and a swapped", "mass in g")


@pytest.fixture(scope="module")
def sound() -> Recording:
    return simulated("Jenkins", "chirp:2-40Hz@60N,1s", 45.0)


@pytest.fixture(scope="module")
def folder(sound: Recording) -> Iterator[Path]:
    with prepared(sound, MASS) as place:
        yield place


CASES = [
    *((name, command) for name in REFUSED for command in COMMANDS),
    *(("F reversed", command) for command in COMMANDS[:3]),  # a diagnosis reads it in the only other way
]


@pytest.mark.parametrize(("name", "command"), CASES)
def test_a_wrong_label_is_refused(name: str, command: str, sound: Recording, folder: Path) -> None:
    slip = SLIPS[name]
    write_csv(slip.make(sound), folder / "slip.csv")
    found = outcome(command, folder / "slip.csv", MASS * slip.mass, folder)
    assert found.code == (1 if command == "check" else 2), found.said
    assert f"[{slip.rule}]" in found.said and not found.named and not found.crashed


def test_three_commands_see_one_error(folder: Path) -> None:
    """The same FMU and recording, nothing fitted; to rounding, as ``identify`` runs the networks without an FMU."""
    metrics = json.loads((folder / "identification.json").read_text(encoding="utf-8"))["metrics"]["recordings"][0]
    recording = read(folder / "sound.csv")
    (validated,) = validate(folder / "oscillator.fmu", recording).cases
    answer = diagnose(folder / "sound.csv", model=folder / "oscillator.fmu", parameters={"m": MASS}, out=folder / "d")
    written = json.loads((folder / "d" / "diagnosis.json").read_text(encoding="utf-8"))
    (diagnosed,) = written["baseline"]["as_given"]
    assert validated.free_run is not None
    for found in (
        (validated.force_nrmse, validated.free_run.x_nrmse),
        (diagnosed["force_nrmse"], diagnosed["free_run_x_nrmse"]),
    ):
        assert found == pytest.approx((metrics["force_nrmse"], metrics["free_run"]["x_nrmse"]), rel=1e-9)
    assert "as given" in answer.summary() and percent(diagnosed["free_run_x_nrmse"]) in answer.summary()


@pytest.mark.parametrize("noise", [None, 45.0])
def test_parameters_that_are_given_count_in_both(tmp_path: Path, noise: float | None) -> None:
    """A wrong spring, and a recording with noise and without, to which a diagnosis adds some: as given it has none."""
    rig = build("HystId.Oscillators.Jenkins", tmp_path / "rig.fmu")
    recording = simulate(rig, "chirp:2-40Hz@60N,1s", dt=1e-3, noise_snr=noise, parameters={"Kl": 1.2e4})
    (validated,) = validate(rig.path, recording).cases
    soft = diagnose(recording, model=rig.path, parameters={"Kl": {"value": 1.2e4, "fixed": True}, "m": 1.0})
    (hard,) = diagnose(recording, model=rig.path).as_given
    assert validated.free_run is not None and hard.free_run is not None
    assert (hard.force, hard.free_run) == pytest.approx((validated.force_nrmse, validated.free_run.x_nrmse), rel=1e-12)
    assert soft.as_given[0].free_run is not None and soft.as_given[0].free_run < 0.2 * hard.free_run
