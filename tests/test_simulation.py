"""A force into an FMU, a recording out."""

from __future__ import annotations

import zipfile
from pathlib import Path

import numpy as np
import pytest

from hystid.compiled import CompiledModel
from hystid.diagnosis import diagnose
from hystid.diagnosis.model.adapters import FmuModel
from hystid.errors import FmuError, RecordingError, UsageError
from hystid.fmu import Driver, build_model
from hystid.modelica import compile_model
from hystid.recording import Recording, read, write_csv
from hystid.simulation import SUBSTEPS, check_parameters, driven, force_of, simulate
from hystid.validation.surrogate import open_surrogate


@pytest.fixture(scope="module")
def linear(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("fmu") / "linear.fmu"
    build_model("HystId.Oscillators.Linear", path)
    return path


def test_the_answer_of_a_linear_oscillator_is_its_closed_form(linear: Path) -> None:
    m, B, Kl, f = 2.0, 30.0, 2e4, 12.0
    answer = simulate(linear, force_of(f"harmonic:{f}Hz@50N,3s"), parameters={"m": m, "B": B, "Kl": Kl})
    w = 2 * np.pi * f
    gain = 50 / (Kl - m * w**2 + 1j * B * w)
    steady = slice(20_000, None)  # the free motion has decayed by exp(-B / 2m * 2 s) = exp(-15)
    expected = np.imag(gain * np.exp(1j * w * answer.t))
    # RK4 at 1e-4 s and linear interpolation of F between samples: (w dt)^2 / 8 = 7e-6
    np.testing.assert_allclose(answer.channel("x")[steady], expected[steady], atol=2e-5 * abs(gain))
    balance = answer.F - m * answer.a - answer.R
    assert np.max(np.abs(balance)) < 1e-9 * 50


def test_noise_is_added_on_demand_and_seeded(linear: Path) -> None:
    force = force_of("multisine:5-80Hz@30Nrms,1s", seed=4)
    clean = simulate(linear, force)
    noisy = simulate(linear, force, noise_snr=34, seed=1)
    ratio = 20 * np.log10(np.std(clean.x) / np.std(noisy.x - clean.x))
    assert ratio == pytest.approx(34, abs=0.5)
    assert noisy.R is None
    np.testing.assert_array_equal(noisy.x, simulate(linear, force, noise_snr=34, seed=1).x)
    assert any("34 dB" in note for note in noisy.notes)


def test_a_recorded_force_drives_as_its_specification_does(linear: Path, tmp_path: Path) -> None:
    force = force_of("harmonic:20Hz@80N,0.5s")
    write_csv(force, tmp_path / "force.csv")  # t and F only: a force needs no motion
    again = simulate(linear, force_of(tmp_path / "force.csv"))
    # the time stamps are read back from decimal text: rounding only
    np.testing.assert_allclose(again.channel("x"), simulate(linear, force).channel("x"), rtol=1e-9, atol=1e-15)


def test_simulated_recordings_pass_the_door(linear: Path, tmp_path: Path) -> None:
    write_csv(simulate(linear, force_of("chirp:0-60Hz@20N,2s"), noise_snr=34), tmp_path / "made.csv")
    found = read(tmp_path / "made.csv")
    assert not found.warnings
    assert set("Fxva") == {name for name in "FxvaR" if getattr(found, name) is not None}


def test_wrong_parameters_are_answered_with_near_names_and_ranges(linear: Path) -> None:
    driver = Driver(linear)
    with pytest.raises(UsageError, match="did you mean Kl"):
        check_parameters(driver, {"kl": 1.0})
    with pytest.raises(UsageError, match="it has"):
        check_parameters(driver, {"completely_else": 1.0})


def test_an_fmu_without_force_input_is_refused(tmp_path: Path) -> None:
    (tmp_path / "own.mo").write_text("model Own\n  input Real u;\n  output Real y;\nequation\n  y = 2*u;\nend Own;\n")
    build_model(f"{tmp_path / 'own.mo'}:Own", tmp_path / "own.fmu")
    with pytest.raises(FmuError, match="no input F"):
        simulate(tmp_path / "own.fmu", force_of("harmonic:20Hz@80N,0.1s"))


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ('unit="N"', 'unit="kN"', "its variable F is in kN"),
        ('unit="m"', 'unit="mm"', "its variable x is in mm"),
        (
            '<BaseUnit kg="1" m="1" s="-2" />',
            '<BaseUnit kg="1" m="1" s="-2" factor="1000" />',
            "its variable F is in N",
        ),
    ],
)
def test_units_beside_si_are_refused(linear: Path, tmp_path: Path, old: str, new: str, says: str) -> None:
    """Their numbers were taken for N and m. What the FMU defines a unit to be counts before its name."""
    path = tmp_path / "other.fmu"
    with zipfile.ZipFile(linear) as source, zipfile.ZipFile(path, "w") as target:
        for name in source.namelist():
            content = source.read(name)
            target.writestr(name, content.replace(old.encode(), new.encode()) if name.endswith("tion.xml") else content)
    force = force_of("harmonic:20Hz@80N,0.1s")
    for use in (lambda: simulate(path, force), lambda: open_surrogate(path, 1.0), lambda: FmuModel(path)):
        with pytest.raises(FmuError, match=says):
            use()


def test_parameters_go_to_an_fmu_in_its_own_units(tmp_path: Path) -> None:
    """They are given in SI units; 2000 N/m became 2000 N/mm."""
    (tmp_path / "k.mo").write_text("""model Spring
  input Real F(unit = "N");
  output Real x(unit = "m", start = 0, fixed = true), v(unit = "m/s", start = 0, fixed = true);
  parameter Real k(unit = "N/mm", max = 100) = 1;
equation
  der(x) = v;
  1.0*der(v) = F - 1000*k*x - 5*v;
end Spring;
""")
    path = tmp_path / "k.fmu"
    build_model(f"{tmp_path / 'k.mo'}:Spring", path)
    force = force_of("harmonic:20Hz@80N,0.5s")
    answer = simulate(path, force, parameters={"k": 2000.0})
    assert "simulated with k.fmu (k = 2 N/mm)" in answer.notes
    np.testing.assert_array_equal(answer.x, Driver(path).simulate(force.t, {"F": force.F}, parameters={"k": 2.0})["x"])
    with pytest.raises(UsageError, match="k = 200 N/mm is outside its range"):
        simulate(path, force, parameters={"k": 2e5})
    with pytest.raises(FmuError, match="its variable k is in N/mm"):
        diagnose(answer, model=str(path), parameters={"m": 1.0, "k": 2000.0})


def test_forces_that_cannot_be_had(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="kinds are"):
        force_of("sweep:0-9Hz@1N,1s")
    with pytest.raises(RecordingError, match="no such file"):
        force_of("missing.csv")
    with pytest.raises(UsageError, match="--dt"):
        force_of("harmonic:20Hz@80N,0.1s", dt=0.0)
    write_csv(Recording("still", np.arange(50) * 1e-3, F=np.ones(50)), tmp_path / "still.csv")
    with pytest.raises(RecordingError, match="constant"):
        force_of(tmp_path / "still.csv")


def test_one_fmu_and_one_force_have_one_answer_in_every_command(linear: Path) -> None:
    """Cubic between samples, in the compiled model, in the FMU of a validation and in the FMU of a diagnosis.

    Twenty samples per period: straight lines between them would take 0.8 % off the force at that frequency.
    """
    dt = 1e-3
    force = {"F": 50 * np.sin(2 * np.pi * 50 * dt * np.arange(2000))}
    inside = CompiledModel(compile_model("HystId.Oscillators.Linear"))
    answers = [
        inside.simulate(force, dt, outputs=("x",), interpolation="cubic", substeps=SUBSTEPS)["x"],
        driven(Driver(linear), force, dt * np.arange(2000), outputs=("x",))["x"],
        FmuModel(linear).simulate(force, dt, outputs=("x",))["x"],
    ]
    size = float(np.std(answers[0]))
    assert np.max(np.abs(answers[2] - answers[1])) < 1e-12 * size
    # straight lines over a quarter of a sample: (2 pi / 80)^2 / 12 = 5e-4, and as much for the start from rest
    assert np.std(answers[1] - answers[0]) < 1e-3 * size
