"""A wrong label never ends in exit code 0, in a crash, or in a name but with the label read rightly: every command.

A few of the slips of ``benchmarks/slips.py``; ``python -m benchmarks.slips --commands`` runs all twenty.
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest

from benchmarks.slips import RIGS, simulated, slips
from benchmarks.slips_in_commands import COMMANDS, outcome, prepared
from hystid import build, diagnose, identify, simulate
from hystid.identification.entry import Method
from hystid.recording import Recording, write_csv
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


@pytest.mark.parametrize("command", COMMANDS)
def test_a_late_force_is_refused(command: str, folder: Path, tmp_path: Path) -> None:
    """On a recording that shows it: 12 ms, more than half a radian of the main motion."""
    write_csv(SLIPS["F late"].make(simulated("Linear", "multisine:2-80Hz@40Nrms,1s", 40.0)), tmp_path / "late.csv")
    shutil.copy(folder / "surrogate.onnx", tmp_path)
    found = outcome(command, tmp_path / "late.csv", RIGS["Linear"]["m"], tmp_path)
    assert found.code == (1 if command == "check" else 2), found.said
    assert "[lag]" in found.said and "--align F" in found.said and not found.named and not found.crashed


@pytest.mark.parametrize("method", ["published", "refined"])
def test_three_commands_see_one_error(method: Method, folder: Path, tmp_path: Path) -> None:
    """The same FMU and recording, nothing fitted; to rounding, as ``identify`` runs the networks without an FMU."""
    file, fmu = folder / "sound.csv", tmp_path / "oscillator.fmu"
    identify(file, mass=MASS, layers=[2], ensemble=1, method=method, lags=(), workers=1, out=tmp_path)
    (metrics,) = json.loads((tmp_path / "identification.json").read_text(encoding="utf-8"))["metrics"]["recordings"]
    here = metrics["as_recorded"]["force_nrmse"], metrics["as_recorded"]["free_run"]["x_nrmse"]
    assert (metrics["force_nrmse"] == here[0]) == (method == "published")  # the refined one smooths
    (validated,) = validate(fmu, file).cases
    assert validated.free_run is not None
    assert (validated.force_nrmse, validated.free_run.x_nrmse) == pytest.approx(here, rel=1e-9)
    answer = diagnose(file, model=fmu, parameters={"m": MASS}, out=tmp_path / "d")
    (found,) = json.loads((tmp_path / "d" / "diagnosis.json").read_text(encoding="utf-8"))["baseline"]["as_given"]
    assert (found["force_nrmse"], found["free_run_x_nrmse"]) == pytest.approx(here, rel=1e-9)
    assert "as given" in answer.summary() and percent(found["free_run_x_nrmse"]) in answer.summary()


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
