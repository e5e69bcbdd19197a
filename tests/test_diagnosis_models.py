"""Baselines of any kind, start values from the recordings, and inputs that are missing."""

import json
import zipfile
from pathlib import Path

import numpy as np
import pytest
from fmpy.ssp.simulation import simulate_ssp
from fmpy.ssp.ssd import read_ssv

from hystid.cli import main
from hystid.compiled import CompiledModel
from hystid.diagnosis import Diagnosis, diagnose
from hystid.diagnosis.fit.extended import Skeleton, extended_model
from hystid.diagnosis.model.baseline import baseline_of
from hystid.errors import UsageError
from hystid.fmu import build
from hystid.fmu.build import Version
from hystid.fmu.platforms import host
from hystid.modelica import compile_model
from hystid.recording import Recording
from hystid.rig.terms import mass_of, real_parameters
from hystid.toolchain import shared_library

DT = 5e-4
T = DT * np.arange(6000)
FORCE = 60 * np.sin(2 * np.pi * (3 * T + 2 * T * T)) + 20 * np.sin(2 * np.pi * 7 * T)
OWN = """
model {name} "without the interfaces of the library"
  parameter Real mass(unit="kg") = 2;
  parameter Real k(unit="N/m") = 9000;
  parameter Real c(unit="N.s/m") = 6;
  input Real F(unit="N");
  output Real x(unit="m", start=0, fixed=true);
  output Real v(unit="m/s", start=0, fixed=true);
equation
  der(x) = v;
  mass*der(v) = F - k*x - c*v{more};
end {name};
"""


def own_model(folder: Path, name: str, more: str = "") -> str:
    path = folder / f"{name}.mo"
    path.write_text(OWN.format(name=name, more=more))
    return f"{path}:{name}"


def record(model: str, acceleration: str, snr: float = 0.01, **parameters: float) -> Recording:
    found = CompiledModel(compile_model(model)).simulate(
        {"F": FORCE}, DT, parameters=parameters, outputs=("x", "v", acceleration), interpolation="cubic", substeps=4
    )
    channels = dict(zip("xvaF", (*found.values(), FORCE), strict=True))
    rng = np.random.default_rng(3)
    return Recording(
        "rig", T, **{k: u + snr * float(np.std(u)) * rng.standard_normal(len(u)) for k, u in channels.items()}
    )


@pytest.fixture(scope="module")
def hardening(tmp_path_factory: pytest.TempPathFactory) -> Recording:
    return record(own_model(tmp_path_factory.mktemp("rig"), "Truth", " - 3e9*x^3"), "der(v)")


@pytest.fixture(scope="module")
def thinned(hardening: Recording) -> Recording:
    """For FMUs that are called sample by sample."""
    return hardening.part(slice(None, None, 2))


def is_cubic(found: Diagnosis) -> bool:
    """Found, with the true stiffness within 1 %: thrice what 34 dB of noise leaves, twice in half of the samples."""
    k3 = found.findings[0].parameters["k3"].value if found.findings else 0.0
    return [f.effect for f in found.findings] == ["cubic_stiffness"] and abs(k3 / 3e9 - 1) < 0.01


def test_a_model_without_our_interfaces_is_diagnosed_and_extended(tmp_path: Path, hardening: Recording) -> None:
    found = diagnose([hardening], model=own_model(tmp_path, "Mine"), parameters={"mass": 2.0}, out=tmp_path / "out")
    assert is_cubic(found)
    before, after = found.errors[0].free_run
    assert before is not None and after is not None and after < 0.1 * before
    text = (tmp_path / "out" / "extended.mo").read_text()
    assert "rig.F = F - (cubicStiffness.f)" in text and "model Mine" in text
    assert (tmp_path / "out" / "extended.fmu").exists()


RIGS = {
    "an array": """
model Rig
  parameter Real m(unit="kg") = 2;
  parameter Real k[2](each unit="N/m") = {8000, 1000};
  parameter Real c(unit="N.s/m") = 6;
  input Real F(unit="N");
  output Real x(unit="m", start=0, fixed=true);
  output Real v(unit="m/s", start=0, fixed=true);
equation
  der(x) = v;
  m*der(v) = F - sum(k)*x - c*v;
end Rig;
""",
    "a rig that turns": """
model Rig
  parameter Real J(unit="kg.m2") = 2;
  parameter Real k(unit="N.m/rad") = 9000;
  parameter Real c(unit="N.m.s/rad") = 6;
  input Real F(unit="N.m");
  output Real x(unit="rad", start=0, fixed=true);
  output Real v(unit="rad/s", start=0, fixed=true);
equation
  der(x) = v;
  J*der(v) = F - k*x - c*v;
end Rig;
""",
    "parameters of a component": """
model Rig
  extends HystId.Interfaces.PartialOscillator;
  HystId.Effects.LinearStiffness more(k = 500);
equation
  more.x = x;
  more.v = v;
  more.a = a;
  more.h = 0;
  f_h = more.f;
end Rig;
""",
    "an effect already": """
model Rig
  extends HystId.Oscillators.Linear(Kl = 4500, f_effects = leaf.f);
  HystId.Effects.LinearStiffness leaf(k = 4500);
equation
  leaf.x = x;
  leaf.v = v;
  leaf.a = a;
  leaf.h = f_h;
end Rig;
""",
}


@pytest.mark.parametrize("kind", RIGS)
def test_the_extended_model_holds_all_of_the_rig(tmp_path: Path, thinned: Recording, kind: str) -> None:
    (tmp_path / "rig.mo").write_text(RIGS[kind])
    found = diagnose([thinned], model=f"{tmp_path / 'rig.mo'}:Rig", parameters={"m": 2.0}, out=tmp_path / "out")
    assert_better(found)
    assert (tmp_path / "out" / "extended.fmu").exists()
    assert "model Rig" in (tmp_path / "out" / "extended.mo").read_text()


def test_a_file_of_several_blocks_is_written_once() -> None:
    text = "block One end One; block Two end Two;"
    written = extended_model(Skeleton("HystId.Oscillators.Linear"), {}, [], own={"One": text, "Two": text})
    assert written.count("block One") == written.count("block Two") == 1


@pytest.mark.parametrize(
    ("was", "now", "told"),
    [
        ("mass", "M", "its mass is M, and m is another parameter"),
        ('x(unit="m", start=0', 'x(unit="m", start=m', "the start of x is computed"),
        ("Mine", "Extended", "give that class another name"),
    ],
)
def test_a_rig_that_cannot_be_extended_is_refused_at_once(
    tmp_path: Path, hardening: Recording, was: str, now: str, told: str
) -> None:
    text = OWN.format(name="Mine", more="").replace("input", 'parameter Real m(unit="m") = 0;\n  input', 1)
    text = text if was == "mass" else text.replace("Real m(", "Real from(")
    (tmp_path / "rig.mo").write_text(text.replace(was, now.replace("=m", "=from")))
    with pytest.raises(UsageError, match=told):
        diagnose([hardening], model=str(tmp_path / "rig.mo"))


def test_a_mass_is_known_by_its_unit_before_its_name(tmp_path: Path) -> None:
    path = tmp_path / "rig.mo"
    path.write_text(
        OWN.format(name="Mine", more="").replace("parameter", 'parameter Real m(unit="1") = 3;\n  parameter', 1)
    )
    assert mass_of(compile_model(f"{path}:Mine").variables) == "mass"


def test_a_mass_of_several_parameters_is_their_sum(tmp_path: Path) -> None:
    text = OWN.format(name="Mine", more="").replace("mass*", "(mass + more)*")
    (tmp_path / "rig.mo").write_text(text.replace("parameter", 'parameter Real more(unit="kg") = 0.5; parameter', 1))
    model = f"{tmp_path / 'rig.mo'}:Mine"
    found = baseline_of(model, compile_model(model), {"more": 1.0, "k": 9000.0}, weighed=True)
    R, _ = found.force(np.full(5, 1e-3), np.zeros(5), 1e-3, found.nominal)
    assert found.mass == pytest.approx(3.0) and found.free == ("k", "c")  # the mass is known from weighing
    np.testing.assert_allclose(R, 9.0)


def test_only_the_starts_of_states_are_no_parameters_of_a_fit(tmp_path: Path) -> None:
    text = OWN.format(name="Mine", more=" - k_start*x").replace("start=0", "start=x_start", 1)
    more = 'parameter Real k_start(unit="N/m") = 1; parameter Real x_start(unit="m") = 0;\n  parameter'
    (tmp_path / "rig.mo").write_text(text.replace("parameter", more, 1))
    found = real_parameters(compile_model(f"{tmp_path / 'rig.mo'}:Mine"))
    assert {v.name for v in found} == {"mass", "k", "c", "k_start"}


@pytest.fixture(scope="module")
def own_fmu(tmp_path_factory: pytest.TempPathFactory, hardening: Recording) -> tuple[Path, Diagnosis]:
    """An FMU of ours, diagnosed: the folder of the answer, and the answer."""
    folder = tmp_path_factory.mktemp("own")
    path = build_of(folder)
    return folder / "out", diagnose([hardening], model=str(path), parameters={"mass": 2.0}, out=folder / "out")


def test_an_fmu_is_diagnosed_and_runs_with_the_findings(own_fmu: tuple[Path, Diagnosis]) -> None:
    out, found = own_fmu
    assert "closed binary" in (out / "extended.mo").read_text()
    assert not (out / "extended.fmu").exists() and (out / "effects.fmu").exists()
    assert_better(found)


@pytest.mark.parametrize("fmi", [2, 3])
def test_a_foreign_fmu_is_diagnosed_and_runs_with_the_findings(
    tmp_path: Path, thinned: Recording, fmi: Version
) -> None:
    path = without_batch_entry(build_of(tmp_path, fmi))
    assert_better(diagnose([thinned], model=str(path), parameters={"mass": 2.0}))


def assert_better(found: Diagnosis) -> None:
    assert is_cubic(found)
    before, after = found.errors[0].free_run
    assert before is not None and after is not None and after < 0.1 * before


def test_an_fmu_with_its_effects_runs_as_a_system(own_fmu: tuple[Path, Diagnosis], hardening: Recording) -> None:
    """FMPy takes the .ssp. Its master is a step late with the force, which takes damping k dt away: short steps."""
    system = str(own_fmu[0] / "extended.ssp")
    errors = []
    assert hardening.x is not None
    for finer in (10, 20):
        rows = simulate_ssp(
            system, stop_time=0.6, step_size=DT / finer, parameter_set=read_ssv(system, "resources/parameters.ssv"),
            input={"F": lambda t: float(np.interp(t, T, FORCE))},
        )  # fmt: skip
        x = np.interp(T[T < 0.6], rows["time"], rows["x"])
        errors.append(float(np.sqrt(np.mean((x - hardening.x[: len(x)]) ** 2)) / np.std(hardening.x)))
    assert errors[0] < 0.15 and errors[1] < 0.6 * errors[0]  # first order in the step


def test_an_fmu_of_another_hand_is_diagnosed(tmp_path: Path, thinned: Recording) -> None:
    """FMI 3.0, Model Exchange only, without an output R, a parameter named m, or functions that nobody calls."""
    path = handmade(tmp_path)
    found = diagnose([thinned], model=str(path), parameters={"mass": 2.0}, out=tmp_path / "out")
    assert_better(found)
    assert (tmp_path / "out" / "effects.fmu").exists() and (tmp_path / "out" / "extended.ssp").exists()


def handmade(folder: Path) -> Path:
    """``tests/foreign_fmu`` compiled and zipped."""
    here = Path(__file__).parent / "foreign_fmu"
    library = shared_library({"oscillator.c": (here / "oscillator.c").read_text()}, main=["oscillator.c"])
    with zipfile.ZipFile(folder / "oscillator.fmu", "w") as made:
        made.write(here / "modelDescription.xml", "modelDescription.xml")
        made.write(library, f"binaries/{host()}/oscillator{library.suffix}")
    return folder / "oscillator.fmu"


def without_batch_entry(path: Path) -> Path:
    """The same FMU, as a tool without our batch entry would have written it."""
    made = path.with_name("foreign.fmu")
    with zipfile.ZipFile(path) as old, zipfile.ZipFile(made, "w") as new:
        for item in old.infolist():
            new.writestr(item, old.read(item).replace(b"hy_run_table", b"xx_run_table"))
    return made


def test_co_simulation_only_compares_the_free_run(tmp_path: Path, hardening: Recording) -> None:
    path = without_batch_entry(build_of(tmp_path))
    only = tmp_path / "only.fmu"
    with zipfile.ZipFile(path) as old, zipfile.ZipFile(only, "w") as new:
        for item in old.infolist():
            content = old.read(item)
            if item.filename == "modelDescription.xml":
                start, end = content.index(b"<ModelExchange"), content.index(b"<CoSimulation")
                content = content[:start] + content[end:]
            new.writestr(item, content)
    found = diagnose([hardening], model=str(only))
    assert found.verdict == "not_applicable" and "co-simulation only" in found.headline
    assert found.errors[0].free_run[0] is not None


def build_of(folder: Path, fmi: Version = 2) -> Path:
    path = folder / "mine.fmu"
    build(compile_model(own_model(folder, "Mine")), path, fmi=fmi)
    return path


def test_values_that_nobody_gave_follow_from_the_recordings() -> None:
    """A rig stiffer and smaller than the defaults is still found; 5 %: a few samples lie on the sticking branch."""
    true = {"m": 2.0, "B": 40.0, "Kl": 4e4, "Ks": 2e5, "fc": 20.0}
    found = diagnose([record("HystId.Oscillators.Jenkins", "a", **true)], model="HystId.Oscillators.Jenkins")
    assert found.findings == ()
    assert abs(found.refit["fc"].value / 20.0 - 1) < 0.05 and abs(found.refit["Ks"].value / 2e5 - 1) < 0.05
    assert any("start values" in note for note in found.notes)


def test_a_fixed_mass_is_exact(hardening: Recording) -> None:
    fixed = {"m": {"value": 2.05, "fixed": True}}
    assert diagnose([hardening], model="HystId.Oscillators.Linear", parameters=fixed).refit["m"].value == 2.05


def test_names_nearly_right_and_held_out_twins_are_refused(hardening: Recording) -> None:
    with pytest.raises(UsageError, match="did you mean 'Kl'"):
        diagnose([hardening], model="HystId.Oscillators.Linear", parameters={"KL": 1.0})
    with pytest.raises(UsageError, match="held out and used"):
        diagnose([hardening], model="HystId.Oscillators.Linear", holdout=[hardening])


@pytest.mark.parametrize(
    ("columns", "rows", "word"), [(("x [m]",), 500, "record F"), (("x [m]", "F [N]"), 3, "3 samples")]
)
def test_missing_inputs_are_a_verdict_on_the_command_line(
    tmp_path: Path, columns: tuple[str, ...], rows: int, word: str
) -> None:
    table = np.column_stack([T[:rows], *(1e-3 * np.sin(700 * T[:rows]) for _ in columns)])
    np.savetxt(tmp_path / "rec.csv", table, delimiter=",", header=",".join(("t [s]", *columns)), comments="")
    out = tmp_path / "out"
    with pytest.raises(SystemExit) as stopped:
        main(["diagnose", str(tmp_path / "rec.csv"), "--model", "HystId.Oscillators.Linear", "-o", str(out)])
    assert stopped.value.code == 1
    told = json.loads((out / "diagnosis.json").read_text())
    assert told["verdict"] == "not_applicable" and word in told["headline"]


def test_a_simulation_without_noise_is_consistent_with_its_own_law() -> None:
    clean = record("HystId.Oscillators.Linear", "a", snr=0.0)
    found = diagnose([clean], model="HystId.Oscillators.Linear")
    assert found.verdict in ("consistent", "recalibrated")
    assert any("holds no noise" in note for note in found.notes)
