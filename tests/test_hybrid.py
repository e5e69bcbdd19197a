"""Physics plus network: the Modelica package is the Python model, the fit finds the law, each part shows its gain."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import fmpy
import numpy as np
import pytest

from hystid.compiled import CompiledModel
from hystid.errors import UsageError
from hystid.fmu import build
from hystid.identification import identify
from hystid.identification.hybrid.law import law_of
from hystid.identification.hybrid.package import OSCILLATOR, package_text
from hystid.modelica import compile_model
from hystid.modelica_text import compile_text
from hystid.networks import FurtherInput, Lag, Member, Network, TwoNetworkModel
from hystid.networks.ports import Polyline
from hystid.networks.trust import Spread, Tail
from hystid.processing import add_noise
from hystid.recording import Recording
from hystid.report.page import percent

RATE = 1000.0
COGGING = """model Stage "Spring, dry friction, and cogging of the magnets, which no law of the library has"
  extends HystId.Oscillators.Linear(m = 1, B = 12, Kl = 1.2e4, f_effects = dry.f + 8*sin(785*x));
  HystId.Effects.CoulombFriction dry(Fc = 6);
equation
  dry.x = x;
  dry.v = v;
  dry.a = a;
  dry.h = f_h;
end Stage;
"""
BELIEVED = COGGING.replace(" + 8*sin(785*x)", "").replace("Stage", "Extended").replace("Fc = 6", "Fc = 3")


def network(rng: np.random.Generator, width: int) -> Network:
    sizes = (width, 4, 3, 1)
    layers = tuple((rng.normal(0, 0.6, (o, i)), rng.normal(0, 0.6, o)) for i, o in pairwise(sizes))
    return Network(layers, rng.normal(0, 0.2, width), rng.uniform(0.5, 1.5, width), 0.2, 1.7)


@pytest.fixture(scope="module")
def signals() -> dict[str, np.ndarray]:
    t = np.arange(600) / RATE
    v = 0.8 * np.cos(40 * t) + 0.4 * np.sin(110 * t)  # up to 1.2: beyond the range of the networks
    return {"x": np.cumsum(v) / RATE, "v": v, "u": np.where(np.sin(25 * t) > 0, 2.0, 0.0), "t": t}


def test_the_package_is_the_law_and_the_networks(signals: dict[str, np.ndarray], tmp_path: Path) -> None:
    rng = np.random.default_rng(4)
    members = tuple(Member(network(rng, 6), network(rng, 6)) for _ in range(2))
    limits = {"x": (-1.0, 1.0), "v": (-1.0, 1.0), "u": (0.0, 2.0)}
    further = {"inputs": (FurtherInput("u", "V", "u"),), "lags": (Lag("u", 8e-3), Lag("v", 3e-3))}
    spread = Spread(0.3, 1.4, (Polyline((0.0, 1.0, 2.0), (1.0, 2.5, 1.0)),))
    residual = TwoNetworkModel(members, 0.0, RATE, limits, tail=Tail(0.0, 0.0), spread=spread, **further)
    law = law_of("HystId.Oscillators.Jenkins", 1.5)
    values = {**law.nominal, "fc": 20.0}
    file = tmp_path / "hybrid.mo"
    file.write_text(package_text(law, values, residual, 0.7))
    code = compile_model(f"{file}:{OSCILLATOR}")
    motion = {name: signals[name] for name in ("x", "v")}
    names = ("R", "R_physics", "R_network", "R_spread")
    found = CompiledModel(code).clamp(
        {f"law.{name}": values for name, values in motion.items()}, {"u": signals["u"]}, 1 / RATE, outputs=names
    )
    start = residual.initial_state(0.0, {name: float(signals[name][0]) for name in ("x", "v", "u")})
    force, each, _ = residual.members_response(motion["x"], motion["v"], start, {"u": signals["u"]})
    wanted = 0.7 * force
    (physics,) = law.forces([Recording("r", signals["t"], **motion)], values)
    # rounding of one sample, handed on by the memory
    np.testing.assert_allclose(found["R_network"], wanted, rtol=0, atol=1e-12 * np.abs(wanted).max() * 600)
    np.testing.assert_allclose(found["R_spread"], spread.of(each, [signals["u"]]), rtol=1e-9)
    np.testing.assert_allclose(found["R_physics"], physics, rtol=0, atol=1e-6 * np.abs(physics).max())
    np.testing.assert_allclose(found["R"], found["R_physics"] + found["R_network"], rtol=1e-12)

    fmu = build(code, tmp_path / "hybrid.fmu")
    table = np.zeros(600, dtype=[("time", "f8"), ("F", "f8"), ("u", "f8")])
    table["time"], table["F"], table["u"] = signals["t"], 30 * np.sin(50 * signals["t"]), 1.0
    run = fmpy.simulate_fmu(
        str(fmu.path), stop_time=0.599, output_interval=1 / RATE, input=table, output=["x", "a", *names]
    )
    np.testing.assert_allclose(run["R"], run["R_physics"] + run["R_network"], rtol=1e-9)
    held = table["F"][: len(run) - 1]  # FMPy hands inputs over at the beginning of a step
    np.testing.assert_allclose(1.5 * run["a"][1:] + run["R"][1:], held, atol=1e-6)
    assert np.ptp(run["R_network"]) > 0 and np.ptp(run["R_physics"]) > 0


def stage(rig: CompiledModel, name: str, level: float, seed: int) -> Recording:
    rng, t = np.random.default_rng(seed), np.arange(2000) / RATE
    lines = np.arange(5, 35, 0.5)
    force = (np.cos(2 * np.pi * np.outer(t, lines) + rng.uniform(0, 2 * np.pi, len(lines)))).sum(axis=1)
    F = level * force / force.std()
    found = rig.simulate({"F": F}, 1 / RATE, outputs=("x", "v", "a", "R"), interpolation="cubic", substeps=4)
    return add_noise(Recording(name, t, F=F, origin=dict.fromkeys("Fxva", "measured"), **found), 40.0, seed)


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("stage")
    (folder / "stage.mo").write_text(COGGING)
    (folder / "extended.mo").write_text(BELIEVED)
    return folder


def test_physics_plus_network_beats_each_alone(files: Path, tmp_path: Path) -> None:
    rig = CompiledModel(compile_model(f"{files / 'stage.mo'}:Stage"))
    used, unseen = stage(rig, "used", 30, 1), stage(rig, "unseen", 34, 2)
    settings = {"mass": 1.0, "ensemble": 4, "layers": (5,), "workers": 1}
    result = identify([used], holdout=[unseen], model=str(files / "extended.mo"), **settings, out=tmp_path)
    hybrid = result.hybrid
    assert hybrid is not None and hybrid.offered, hybrid.refusal
    (pair,) = hybrid.unseen
    assert pair.hybrid.force_nrmse < min(pair.physics.force_nrmse, pair.network.force_nrmse)
    law, networks = pair.shares
    assert law > 0.9 and 0 < networks < 0.1  # the cogging is a small part of the force
    assert 4 < hybrid.together["dry.Fc"] < 8  # 6 N
    assert hybrid.share > 0.3
    within = pair.as_dict()["hybrid"]["within_band"]
    assert 0.8 < within < 1.0  # nine in ten; one recording of 2 s, whose neighbours in time err alike
    assert hybrid.residual.spread is not None
    modern = build(compile_model(f"{tmp_path / 'hybrid.mo'}:{OSCILLATOR}"), tmp_path / "modern.fmu", fmi=3).path
    for path in (tmp_path / "hybrid.fmu", modern):
        driver = fmpy.simulate_fmu(str(path), stop_time=0.1, output=["R", "R_physics", "R_network", "R_spread"])
        assert np.isfinite(driver["R_network"]).all()
        assert (driver["R_spread"] >= 0.999 * hybrid.residual.spread.floor).all()
    assert "plus networks" in " ".join(result.notes)
    report = result.report(tmp_path / "report.html").read_text(encoding="utf-8")
    section = report.partition("Physics plus network")[2].partition("Parameters of the law")[0]
    assert percent(within).replace(" ", "\xa0") in section and "within the 90 % band" in section
    assert "held out" in section and f"{100 * law:.1f} %" in section  # shares that add up to a whole


def test_the_law_is_found_from_far_away(signals: dict[str, np.ndarray]) -> None:
    law = law_of("HystId.Oscillators.Jenkins", 1.0)
    true = {**law.nominal, "B": 4.0, "Kl": 300.0, "Ks": 2000.0, "fc": 12.0}
    recording = Recording("r", signals["t"], x=signals["x"], v=signals["v"])
    (force,) = law.forces([recording], true)
    near = replace(law, nominal={"B": 10.0, "Kl": 500.0, "Ks": 5000.0, "fc": 6.0})
    found = near.fit([recording], [force], [np.ones(len(force))], 0)
    assert found == pytest.approx(true, rel=1e-3)


def test_physics_without_unseen_recordings_or_a_mass_on_a_force_is_refused(files: Path) -> None:
    with pytest.raises(UsageError, match="hold out at least one"):
        identify([], mass=1.0, model="HystId.Oscillators.Jenkins")
    (files / "block.mo").write_text("model Block\n  input Real F;\n  output Real R;\nequation\n  R = F;\nend Block;\n")
    with pytest.raises(UsageError, match="one mass under a force"):
        law_of(f"{files / 'block.mo'}:Block", 1.0)
    with pytest.raises(UsageError, match="give its Modelica class"):
        law_of("rig.fmu", 1.0)


PORTS = """
  input Real F(unit="N");
  output Real x(unit="m", start=0, fixed=true);
  output Real v(unit="m/s", start=0, fixed=true);"""
PLAIN = """model Rig
  parameter Real mass(unit="kg") = 1;
  parameter Real k(unit="N/m") = 9000, c(unit="N.s/m") = 6;PORTS
equation
  der(x) = v;
  mass*der(v) = F - k*x - c*v;
end Rig;
"""
EXTENDED = """model Extended
  input Real F(unit="N");
  output Real x(unit="m"), v(unit="m/s"), a(unit="m/s2"), R(unit="N");
  Rig rig(mass = 3);
  HystId.Effects.CubicStiffness cubic(k3 = 2e9);
equation
  rig.F = F - cubic.f;
  x = rig.x;
  v = rig.v;
  a = der(rig.v);
  rig.mass*a + R = F;
  cubic.x = x;
  cubic.v = v;
  cubic.a = a;
  cubic.h = 0;
end Extended;
"""
PARTS = """package Bench
  connector Flange
    Real s(unit="m");
    flow Real f(unit="N");
  end Flange;
  model Slide
    parameter Real weight(unit="kg") = 1;
    Flange flange;
    Real v(unit="m/s");
  equation
    v = der(flange.s);
    weight*der(v) = flange.f;
  end Slide;
  model Leaf
    parameter Real k[2](each unit="N/m") = {8000, 1000};
    parameter Real c(unit="N.s/m") = 6;
    Flange flange;
  equation
    flange.f = sum(k)*flange.s + c*der(flange.s);
  end Leaf;
  model Push
    Flange flange;
    Real f(unit="N");
  equation
    flange.f = -f;
  end Push;
  model Rig
    input Real F(unit="N");
    output Real x(unit="m", start=0, fixed=true), v(unit="m/s", start=0, fixed=true), a(unit="m/s2");
    Slide slide;
    Leaf leaf[2];
    Push push;
  equation
    push.f = F;
    x = slide.flange.s;
    v = der(x);
    a = der(v);
    connect(slide.flange, push.flange);
    connect(slide.flange, leaf[1].flange);
    connect(slide.flange, leaf[2].flange);
  end Rig;
end Bench;
"""
OWN = {
    "no restoring force": PLAIN,
    "of the mass's name": PLAIN.replace("Rig", "Oscillator"),
    "a written mass": PLAIN.replace("mass*der", "1.5*der").replace('parameter Real mass(unit="kg") = 1;', ""),
    "two masses": PLAIN.replace("mass*", "(mass + more)*").replace(
        'Real mass(unit="kg") = 1', 'Real mass(unit="kg") = 1, more(unit="kg") = 0.5'
    ),
    "an input of its own": PLAIN.replace("- k*x", "- k*(1 + u/volt)*x").replace(
        "PORTS", 'PORTS\n  input Real u(unit="V");\n  constant Real volt(unit="V") = 4;'
    ),
    "a weight": PLAIN.replace("- k*x", "- k*x - mass*g*sin(x/l)").replace(
        "PORTS", 'PORTS\n  parameter Real g(unit="m/s2") = 9.81, l(unit="m") = 0.02;'
    ),
    "as a diagnosis writes it": EXTENDED + PLAIN,
    "components": PARTS,
    "final parameters": PLAIN.replace("parameter Real k(", "final parameter Real k("),
    "a rig that turns": PLAIN.replace('"N/m"', '"N.m/rad"').replace("N.s/m", "N.m.s/rad").replace('"kg"', '"kg.m2"'),
}  # fmt: skip


@pytest.mark.parametrize("kind", OWN)
def test_the_package_holds_any_rig_that_a_diagnosis_takes(
    signals: dict[str, np.ndarray], tmp_path: Path, kind: str
) -> None:
    turned = PORTS.replace('"N"', '"N.m"').replace('"m', '"rad')
    (tmp_path / "extended.mo").write_text(OWN[kind].replace("PORTS", turned if "turns" in kind else PORTS))
    ports = (FurtherInput("u", "V", "u"),) if kind == "an input of its own" else ()
    law = law_of(f"{tmp_path / 'extended.mo'}:Bench.Rig" if kind == "components" else str(tmp_path), 1.5)
    t, u, F = signals["t"], signals["u"], 30 * np.sin(50 * signals["t"])
    driven = {"F": F, **{port.name: u for port in ports}}
    mass, rate = {name: 1.5 for name in [law.reading.mass] if name}, law.reading.acceleration
    run = law.model.simulate(driven, 1 / RATE, parameters=mass, outputs=("x", "v", rate), substeps=4)
    record = Recording("r", t, F=F, x=run["x"], v=run["v"], a=run[rate], extra={"u": u}, units={"u": "V"})
    law = law.beside([record], ports)
    (physics,) = law.forces([record], law.nominal)
    np.testing.assert_allclose(physics, F - 1.5 * run[rate], rtol=0, atol=1e-9 * np.abs(F).max())
    assert not {"mass", "more", law.reading.mass, "slide.weight"} & {*law.free}  # a fit of the force moves no mass

    rng = np.random.default_rng(4)
    member = Member(network(rng, 3 + len(ports)), network(rng, 3 + len(ports)))
    spread = Spread(0.5, 1.0, (None,) * len(ports))
    limits = {"x": (-1.0, 1.0), "v": (-1.0, 1.0), "u": (0.0, 2.0)}
    residual = TwoNetworkModel((member,), 0.0, RATE, limits, tail=Tail(0.0, 0.0), inputs=ports, spread=spread)
    code = compile_text(package_text(law, law.nominal, residual, 0.7), OSCILLATOR)
    table = np.zeros(600, dtype=[(name, "f8") for name in ("time", *driven)])
    for name, values in {"time": t, **driven}.items():
        table[name] = values
    names = ("x", "a", "R", "R_physics", "R_network")
    starts = {"x_start": 2e-3, "v_start": 0.1}
    path = str(build(code, tmp_path / "hybrid.fmu").path)
    out = fmpy.simulate_fmu(
        path, start_values=starts, stop_time=0.599, output_interval=1 / RATE, input=table, output=names
    )
    assert out["x"][0] == 2e-3
    np.testing.assert_allclose(1.5 * out["a"][1:] + out["R"][1:], F[: len(out) - 1], atol=1e-6)
    ours = CompiledModel(code).simulate(driven, 1 / RATE, parameters=starts, outputs=names, interpolation="hold")
    # FMPy's solver and ours at their steps
    np.testing.assert_allclose(out["x"], ours["x"], rtol=0, atol=1e-3 * np.abs(ours["x"]).max())
    assert np.ptp(out["R_network"]) > 0 and np.ptp(out["R_physics"]) > 0
    given = {"x_start": 0.0, "v_start": 0.0, "network.share": 0.0}
    alone = CompiledModel(code).simulate(driven, 1 / RATE, parameters=given, outputs=("x",), substeps=4)["x"]
    np.testing.assert_allclose(alone, run["x"], rtol=0, atol=1e-9 * np.abs(run["x"]).max())  # the rig without networks


def test_the_mass_of_each_recording_is_that_of_the_physics(tmp_path: Path) -> None:
    (tmp_path / "rig.mo").write_text(OWN["a written mass"].replace("PORTS", PORTS))
    t = np.arange(10) / RATE
    heavy = Recording("heavy", t, F=t, x=t, v=t, a=t, extra={"mass": np.full(10, 2.0)}, units={"mass": "kg"})
    with pytest.raises(UsageError, match=r"its mass is 1\.5 kg, .* that of heavy is 2 kg"):
        law_of(str(tmp_path / "rig.mo"), 1.5).beside([heavy], ())
    (tmp_path / "rig.mo").write_text(OWN["a weight"].replace("PORTS", PORTS))
    assert law_of(str(tmp_path / "rig.mo"), 1.5).settings(heavy) == {"mass": 2.0}


def test_an_input_of_the_rig_is_recorded_in_its_unit(tmp_path: Path) -> None:
    text = OWN["an input of its own"].replace("PORTS", PORTS)
    (tmp_path / "rig.mo").write_text(text)
    law = law_of(str(tmp_path / "rig.mo"), 1.0)
    assert "u stays at 0 V, as no --input names it" in " ".join(law.notes(law.nominal))
    assert law.beside([], (FurtherInput("u", "V", "u"),)).notes(law.nominal) == ()
    (tmp_path / "rig.mo").write_text(text.replace('"V"', '"mV"'))
    with pytest.raises(UsageError, match="its input u is in mV, and that of the recordings in V"):
        law_of(str(tmp_path / "rig.mo"), 1.0).beside([], (FurtherInput("u", "V", "u"),))


def test_a_law_of_the_library_begins_at_the_size_of_the_recordings(signals: dict[str, np.ndarray]) -> None:
    law = law_of("HystId.Oscillators.BoucWen", 1.0)
    sizes = {"N": 100.0, "N/m": 1e3, "N.s/m": 1e3, "m": 0.1, "1/m": 10.0}
    true = {name: value * sizes.get(law.units[name], 1.0) for name, value in law.nominal.items()}
    record = Recording("r", signals["t"], x=0.01 * signals["x"], v=0.01 * signals["v"])
    (force,) = law.forces([record], true)
    found = law.fit([record], [force], [np.full(len(force), 1 / np.std(force))], 0)
    np.testing.assert_allclose(law.forces([record], found)[0], force, rtol=0, atol=1e-6 * np.abs(force).max())
