"""A rig that turns: the same laws, in the words and units of angle, torque and inertia, from the file to the report."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest

import hystid
from hystid.fmu import Driver
from hystid.recording import read
from hystid.rotation import turned_text, turned_unit

INERTIA, DAMPING, STIFFNESS, SLIP = 0.013, 0.006, 1.2, 0.04  # kg.m2, N.m.s/rad, N.m/rad, N.m


@pytest.mark.parametrize(
    ("unit", "turned"),
    [("N", "N.m"), ("m", "rad"), ("mm", "mrad"), ("kg", "kg.m2"), ("N.s2/m2", "N.m.s2/rad2"), ("m/s2", "rad/s2"),
     ("m/(N.s)", "rad/(N.m.s)"), ("1/N", "1/(N.m)"), ("J", "J"), ("Hz", "Hz"), ("", "")],
)  # fmt: skip
def test_units_turn_once(unit: str, turned: str) -> None:
    assert turned_unit(unit) == turned_unit(turned) == turned


@pytest.mark.parametrize(
    ("text", "turned"),
    [
        ("Acts at x > 0.9 mm", "Acts at x > 0.9 mrad"),
        ("Fc = 6.501 ± 0.060 kN", "Fc = 6.501 ± 0.060 kN.m"),
        ("A displacement, a mass of 3 kg", "An angle, an inertia of 3 kg.m2"),
        ("force_2.csv --mass 3 force.csv", "force_2.csv --mass 3 force.csv"),  # names are no words
        ("force MSE [N²], case [filtered]", "torque MSE [(N.m)²], case [filtered]"),
        ("5 m/s, 12 min, 3 samples", "5 rad/s, 12 min, 3 samples"),
    ],
)
def test_words_turn_once(text: str, turned: str) -> None:
    assert turned_text(text) == turned_text(turned) == turned


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two files of a servo that sticks and slips, as a logger writes them: torque in N.m, angle in degrees."""
    made = tmp_path_factory.mktemp("servo")
    fmu = hystid.build(
        "HystId.Oscillators.Jenkins", made / "rig.fmu",
        parameters={"m": INERTIA, "B": DAMPING, "Kl": STIFFNESS, "Ks": 3.0, "fc": SLIP},
    )  # fmt: skip
    for name, size in (("low", 0.15), ("high", 0.4)):
        sweep = hystid.simulate(fmu, f"chirp:0.5-8Hz@{size}N,6s", dt=2e-3, noise_snr=50)
        rows = np.column_stack([sweep.t, sweep.channel("F"), np.degrees(sweep.channel("x"))])
        np.savetxt(made / f"{name}.csv", rows, delimiter=",", header="t [s],torque [N.m],angle [deg]", comments="")
    return made


def _is_of_angles(report: Path) -> None:
    shown = re.sub(r"<script.*?</script>|<pre>.*?</pre>", "", report.read_text(encoding="utf-8"), flags=re.S)
    titles = re.findall(r'"title": ?\{"text": ?"([^"]*)"', report.read_text(encoding="utf-8"))
    text = re.sub(r"<[^>]*>", " ", shown) + " ".join(titles)
    for word in (r"displacement", r"(?<![\w-])force(?!_)", r"\[m?N\]", r"\[mm\]", r"\d (mm|N|kg)(?![\w.])"):
        assert not re.search(word, text, re.I), re.findall(f".{{30}}{word}.{{20}}", text, re.I)
    assert "torque" in text.lower()


def test_the_check_speaks_of_inertia(folder: Path) -> None:
    found = hystid.check([folder / "low.csv", folder / "high.csv"], mass=INERTIA, out=folder / "check")
    assert not found.refusals
    assert "kg.m2" in found.summary() and "mass" not in found.summary()
    _is_of_angles(folder / "check" / "report.html")


def test_the_diagnosis_is_of_torques(folder: Path) -> None:
    """Law and values in N.m and rad; the FMU declares them, and drives into a recording that turns."""
    why = hystid.diagnose(
        [folder / "low.csv", folder / "high.csv"], model="HystId.Oscillators.Linear", parameters={"m": INERTIA},
        out=folder / "why",
    )  # fmt: skip
    assert why.verdict == "missing_physics" and "angle" in why.headline
    units = {name: value["unit"] for name, value in why.as_dict()["final"]["parameters"].items()}
    assert units["m"] == "kg.m2" and units["Kl"] == "N.m/rad"
    assert {"N.m", "N.m/rad"} & {v.unit for finding in why.findings for v in finding.parameters.values()}
    law = np.concatenate([trace.effect for trace in why.traces])
    assert law.min() < -0.5 * SLIP < 0.5 * SLIP < law.max()  # a force with its sign, not its size
    why.report(folder / "why" / "report.html")
    _is_of_angles(folder / "why" / "report.html")
    assert "kg.m2" in (folder / "why" / "extended.mo").read_text()
    assert json.loads((folder / "why" / "diagnosis.json").read_text())["final"]["parameters"]["m"]["unit"] == "kg.m2"
    driver = Driver(folder / "why" / "extended.fmu")
    assert {name: driver.model.variable(name).unit for name in ("F", "x", "m")} == {
        "F": "N.m", "x": "rad", "m": "kg.m2",
    }  # fmt: skip
    answer = hystid.simulate(driver, read(folder / "high.csv"))
    assert answer.rotational and answer.unit("R") == "N.m"


def test_the_surrogate_is_of_torques(folder: Path) -> None:
    found = hystid.identify(
        [folder / "low.csv", folder / "high.csv"], mass=INERTIA, ensemble=1, method="published", workers=1,
        layers=(3,), band=(0, 40), decimate=2, out=folder / "model",
    )  # fmt: skip
    found.report(folder / "model" / "report.html")
    _is_of_angles(folder / "model" / "report.html")
    driver = Driver(folder / "model" / "oscillator.fmu")
    assert {name: driver.model.variable(name).unit for name in ("F", "R", "x", "v", "m")} == {
        "F": "N.m", "R": "N.m", "x": "rad", "v": "rad/s", "m": "kg.m2",
    }  # fmt: skip
    checked = hystid.validate(folder / "model" / "oscillator.fmu", [folder / "high.csv"], band=(0, 40), decimate=2)
    checked.report(folder / "checked.html")
    _is_of_angles(folder / "checked.html")
