"""A rig of parts connected at flanges, with an effect on one of them: simulated, and diagnosed from outside."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from hystid import Recording, diagnose
from hystid.compiled import CompiledModel
from hystid.modelica import compile_model

PARTS = """
package Bench
  connector Flange
    Real s(unit = "m");
    flow Real f(unit = "N");
  end Flange;
  model Mass
    Flange a, b;
    parameter Real m(unit = "kg", min = 0) = 1;
    Real s(unit = "m"), v(unit = "m/s");
  equation
    s = a.s;
    s = b.s;
    v = der(s);
    m*der(v) = a.f + b.f;
  end Mass;
  model Leaf
    Flange a, b;
    parameter Real c(unit = "N/m") = 1, d(unit = "N.s/m") = 1;
    Real stretch(unit = "m"), rate(unit = "m/s");
  equation
    stretch = b.s - a.s;
    rate = der(stretch);
    b.f = c*stretch + d*rate;
    a.f + b.f = 0;
  end Leaf;
  model Wall
    Flange flange;
  equation
    flange.s = 0;
  end Wall;
  model Push
    Flange flange;
    Real f(unit = "N");
  equation
    flange.f = -f;
  end Push;
  model OnFlange
    Flange flange;
    replaceable HystId.Effects.QuadraticDamping law constrainedby HystId.Interfaces.PartialEffect;
    Real v(unit = "m/s");
  equation
    v = der(flange.s);
    law.x = flange.s;
    law.v = v;
    law.a = der(v);
    law.h = 0;
    flange.f = law.f;
  end OnFlange;
  model Rig
    input Real F(unit = "N");
    output Real x(unit = "m", start = 0, fixed = true);
    output Real v(unit = "m/s", start = 0, fixed = true);
    output Real a(unit = "m/s2");
    Mass mass(m = 2);
    Leaf leaf(c = 8000, d = 12);
    Wall wall;
    Push shaker;
  equation
    shaker.f = F;
    connect(shaker.flange, mass.a);
    x = mass.s;
    v = der(x);
    a = der(v);
    connect(mass.b, leaf.b);
    connect(leaf.a, wall.flange);
  end Rig;
  model RigWithStop
    extends Rig;
    OnFlange stop(redeclare HystId.Effects.TwoSidedStop law(k = 3e4, gap = 2e-3));
  equation
    connect(stop.flange, mass.b);
  end RigWithStop;
end Bench;
"""


@pytest.fixture(scope="module")
def rig(tmp_path_factory: pytest.TempPathFactory) -> Path:
    file = tmp_path_factory.mktemp("rig") / "rig.mo"
    file.write_text(PARTS)
    return file


@pytest.fixture(scope="module")
def motion(rig: Path) -> tuple[np.ndarray, np.ndarray, dict[str, np.ndarray]]:
    t = 1e-3 * np.arange(6000)
    force = 40 * np.sin(2 * np.pi * (2 * t + 2 * t**2))
    model = CompiledModel(compile_model(f"{rig}:Bench.RigWithStop"))
    return t, force, model.simulate({"F": force}, 1e-3, outputs=["x", "v", "a"], interpolation="cubic", substeps=16)


def test_the_effect_acts_on_the_flange(motion: tuple[np.ndarray, np.ndarray, dict[str, np.ndarray]]) -> None:
    t, _, got = motion

    def rates(at: float, y: np.ndarray) -> list[float]:
        beyond = max(y[0] - 2e-3, 0) + min(y[0] + 2e-3, 0)
        force = 40 * np.sin(2 * np.pi * (2 * at + 2 * at**2))
        return [y[1], (force - 8000 * y[0] - 12 * y[1] - 3e4 * beyond) / 2]

    x = solve_ivp(rates, (0, t[-1]), [0, 0], method="DOP853", rtol=1e-9, atol=1e-12, max_step=1e-3, t_eval=t).y[0]
    assert np.abs(x).max() > 3e-3  # beyond the gap
    assert np.abs(got["x"] - x).max() < 1e-3 * np.abs(x).max()  # kinks lie inside steps of 62 us


def test_the_stop_is_named_and_written_as_an_extension_of_the_rig(
    rig: Path, motion: tuple[np.ndarray, np.ndarray, dict[str, np.ndarray]], tmp_path: Path
) -> None:
    t, force, got = motion
    noise = np.random.default_rng(3)
    noisy = {n: got[n] + 1e-3 * np.std(got[n]) * noise.standard_normal(len(t)) for n in ("x", "v", "a")}
    recording = Recording("sweep", t, F=force, **noisy)
    found = diagnose(recording, model=f"{rig}:Bench.Rig", parameters={"mass.m": 2.0}, out=tmp_path / "why")
    assert "two_sided_stop" in str(found.as_dict())
    text = (tmp_path / "why" / "extended.mo").read_text()
    assert "mass(m = " in text and "leaf(" in text and "mass.m =" not in text
    extended = compile_model(f"{tmp_path}/why/extended.mo:Extended")
    assert extended.variable("rig.mass.m").start == pytest.approx(2, rel=1e-2)
