"""A rig of parts, whose excitation and measured displacement are named from outside."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from hystid.cli.run import run
from hystid.compiled import CompiledModel
from hystid.diagnosis import diagnose, wired
from hystid.errors import UsageError
from hystid.modelica import compile_model
from hystid.recording import Recording

DT = 5e-4
T = DT * np.arange(6000)
FORCE = 60 * np.sin(2 * np.pi * (3 * T + 2 * T * T)) + 20 * np.sin(2 * np.pi * 7 * T)
PARTS = """
package Parts
  connector Flange
    Real s(unit = "m");
    flow Real f(unit = "N");
  end Flange;
  model Mass
    parameter Real m(unit = "kg") = 2;
    Flange flange;
    Real v(unit = "m/s");
  equation
    v = der(flange.s);
    m*der(v) = flange.f;
  end Mass;
  model Support "Spring and damper to the ground, with a cubic part"
    parameter Real k(unit = "N/m") = 9000, c(unit = "N.s/m") = 6;
    constant Real k3(unit = "N/m3") = {k3};
    Flange flange;
  equation
    flange.f = k*flange.s + c*der(flange.s) + k3*flange.s^3;
  end Support;
  model Shaker
    {kind} Real f(unit = "N");
    Flange flange;
  equation
    flange.f = -f;
  end Shaker;
  model Rig
    {ports}
    Mass mass;
    Support support;
    Shaker shaker;
  equation
    {equations}
    connect(mass.flange, support.flange);
    connect(mass.flange, shaker.flange);
  end Rig;
end Parts;
"""


def parts(folder: Path, k3: float = 0, ports: str = "", equations: str = "") -> str:
    """The file with a rig that has no port of its own, or with these ports."""
    path = folder / "parts.mo"
    text = PARTS.format(k3=k3, kind="input", ports=ports, equations=equations)
    path.write_text(text)
    return f"{path}:Parts.Rig"


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Recording:
    folder = tmp_path_factory.mktemp("truth")
    model = wired(parts(folder, 3e9), {"F": "shaker.f", "x": "mass.flange.s"}, folder)
    found = CompiledModel(compile_model(model)).simulate(
        {"F": FORCE}, DT, outputs=("x", "v", "a"), interpolation="cubic", substeps=4
    )
    rng = np.random.default_rng(3)
    channels = dict(zip("xvaF", (*found.values(), FORCE), strict=True))
    return Recording("rig", T, **{k: u + 0.01 * np.std(u) * rng.standard_normal(len(u)) for k, u in channels.items()})


def test_a_rig_without_ports_is_diagnosed_by_names_of_its_variables(tmp_path: Path, recording: Recording) -> None:
    model = wired(parts(tmp_path), {"F": "shaker.f", "x": "mass.flange.s"}, tmp_path)
    found = diagnose([recording], model=model, parameters={"mass.m": 2.0}, out=tmp_path / "out")
    assert [f.effect for f in found.findings] == ["cubic_stiffness"]
    # three times what 34 dB of noise leaves
    assert found.findings[0].parameters["k3"].value == pytest.approx(3e9, rel=0.01)
    text = (tmp_path / "out" / "extended.mo").read_text()
    assert "Measured rig(" in text and "package Parts" in text and "support(" in text


def test_an_input_of_the_rig_itself_may_have_another_name(tmp_path: Path, recording: Recording) -> None:
    rig = parts(tmp_path, ports='input Real push(unit = "N");', equations="shaker.f = push;")
    model = wired(rig, {"F": "push", "x": "mass.flange.s"}, tmp_path)
    found = diagnose([recording], model=model, parameters={"rig.mass.m": 2.0})
    assert [f.effect for f in found.findings] == ["cubic_stiffness"]


def test_the_command_names_them(tmp_path: Path, recording: Recording, capsys: pytest.CaptureFixture[str]) -> None:
    rows = np.column_stack([T, FORCE, recording.x, recording.v, recording.a])
    np.savetxt(tmp_path / "a.csv", rows, delimiter=",", header="t [s],F [N],x [m],v [m/s],a [m/s2]", comments="")
    out = tmp_path / "why"
    command = ["diagnose", str(tmp_path / "a.csv"), "--model", parts(tmp_path), "-o", str(out), "--set", "mass.m=2"]
    assert run([*command, "--signal", "F=shaker.f", "--signal", "x=mass.flange.s"]) == 1
    told = json.dumps(json.loads((out / "diagnosis.json").read_text()))
    assert json.dumps({"model": f"{out / 'measured.mo'}:Measured"})[1:-1] in told and (out / "measured.mo").is_file()
    assert run([*command, "--signal", "F=shaker.g"]) == 2
    assert "hystid: measured.mo:" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("model", "signals", "words"),
    [
        ("parts.mo:Parts.Rig", {"v": "mass.v"}, "name F, the excitation, or x"),
        ("parts.mo:Parts.Rig", {"F": "shaker.f + 1"}, "write a variable of the model"),
        ("rig.fmu", {"F": "u"}, "names variables of a model in Modelica, which rig.fmu is not"),
        ("folder/package.mo:Rig", {"F": "u"}, "is a part of a folder: put the folder above it into MODELICAPATH"),
        ("taken.mo:Measured", {"F": "u"}, "the name Measured is taken by --signal"),
    ],
)
def test_what_cannot_be_named_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, model: str, signals: dict[str, str], words: str
) -> None:
    monkeypatch.chdir(tmp_path)
    parts(tmp_path)
    (tmp_path / "taken.mo").write_text("model Measured end Measured;")
    with pytest.raises(UsageError, match=words.replace("+", r"\+")):
        wired(model, signals, tmp_path)
