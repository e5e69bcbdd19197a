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
from hystid.diagnosis.model.adapters import FmuModel
from hystid.diagnosis.prepare.segments import prepare_part
from hystid.diagnosis.prove.freerun import errors
from hystid.recording import Recording, read, write_csv
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
    """The same FMU and recording. A diagnosis begins with the memory at rest, not with the first measured force."""
    metrics = json.loads((folder / "identification.json").read_text(encoding="utf-8"))["metrics"]["recordings"][0]
    recording = read(folder / "sound.csv")
    (validated,) = validate(folder / "oscillator.fmu", recording).cases
    assert validated.free_run is not None
    assert validated.force_nrmse == pytest.approx(metrics["force_nrmse"], rel=1e-9)
    assert validated.free_run.x_nrmse == pytest.approx(metrics["free_run"]["x_nrmse"], rel=1e-9)
    ((_, diagnosed),) = errors(FmuModel(str(folder / "oscillator.fmu")), [prepare_part(recording, 0)], {"m": MASS})
    assert diagnosed == pytest.approx(metrics["free_run"]["x_nrmse"], rel=0.05)
