"""Recordings of different masses together: each R = F - m a and each free run with its own, in every command."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import hystid
from hystid.cli.run import run
from hystid.errors import UsageError
from hystid.recording import Recording, own_mass, with_column, with_masses

MASSES = {"light": 1.0, "heavy": 2.5}


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """One slider with a spring, tested twice: with 1 kg and with 2.5 kg on it."""
    folder = tmp_path_factory.mktemp("masses")
    found = {}
    for name, mass in MASSES.items():
        fmu = hystid.build("HystId.Oscillators.Jenkins", folder / f"{name}.fmu", parameters={"m": mass})
        motion = hystid.simulate(fmu, "chirp:1-40Hz@60N,2s", dt=1e-3)
        found[name] = replace(motion, R=None).save(folder / f"{name}.csv")  # what a lab has: F, x, v, a
    return found


def rig(name: str, rotational: bool = False) -> Recording:
    t = np.arange(50) / 100
    return Recording(name, t, F=np.sin(t), x=np.sin(t), rotational=rotational)


def test_masses_by_order_by_name_and_for_all() -> None:
    pair = [rig("light"), rig("heavy")]
    assert with_masses(pair, ["4.2"]) == (4.2, pair)
    for texts in (["1, 2500 g"], ["*ea*:2.5", "1"], ["light:1", "heavy: 2.5 kg"]):
        mass, found = with_masses(pair, texts)
        assert mass == 1.0
        # 2500 g in kg is a product of floats, good to one unit in the last place
        assert [own_mass(r, mass) for r in found] == pytest.approx([1.0, 2.5], rel=1e-15)
    assert with_masses(pair, ["0"])[0] == 0.0
    assert own_mass(with_column(rig("a"), "mass", 3.0, "kg"), 0.0) == 0.0  # F is the restoring force itself


def test_an_inertia_is_a_mass_that_turns() -> None:
    _, found = with_masses([rig("a", True), rig("b", True)], ["0.2,0.5"])
    assert [own_mass(r, 9.0) for r in found] == [0.2, 0.5]
    with pytest.raises(UsageError, match="kg"):
        with_masses([rig("a", True), rig("b", True)], ["0.2 Nm,0.5"])


@pytest.mark.parametrize(
    ("texts", "told"),
    [
        (["1", "2"], "--mass 2: one mass for all recordings was given already"),
        (["1,2,3"], "3 values for 2 recordings"),
        (["light:1", "2,3"], "column mass is in the file already"),
        (["light:2"], "no mass was given for heavy"),
        (["x:2"], "no recording is called 'x'"),
        (["1,-2"], "must be above 0 kg"),
        (["1,lots"], "'lots' is no number with a unit, as 4.2 kg"),
    ],
)
def test_slips_have_a_sentence(texts: list[str], told: str) -> None:
    with pytest.raises(UsageError, match=told):
        with_masses([rig("light"), rig("heavy")], texts)


def test_one_law_is_identified_from_both(files: dict[str, Path], tmp_path: Path) -> None:
    """Both share the law of the force and nothing else: with one mass, R would differ by 1.5 kg times a."""
    recordings = [str(files[name]) for name in MASSES]
    common = ["--ensemble", "4", "--workers", "1", "--method", "published"]
    assert run(["identify", *recordings, "--mass", "1,2.5", *common, "-o", str(tmp_path / "own")]) == 0
    told = json.loads((tmp_path / "own" / "identification.json").read_text())
    assert told["mass"] == 1.0
    # without noise two small networks leave about 1 % of the force, and the closed loop as much of the displacement
    for entry in told["metrics"]["recordings"]:
        assert entry["force_nrmse"] < 0.05
        assert entry["free_run"]["x_nrmse"] < 0.1
    surrogate = tmp_path / "own" / "surrogate.fmu"
    read = hystid.read(files["heavy"])
    right = hystid.validate(surrogate, with_column(read, "mass", 2.5, "kg")).cases[0]
    wrong = hystid.validate(surrogate, read).cases[0]
    assert right.free_run is not None
    assert right.force_nrmse < 0.05 < 0.5 < wrong.force_nrmse
