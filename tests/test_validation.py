"""Validation: a surrogate that is the reference is found exact, a wrong one wrong, a diverging one diverged."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from onnx import helper
from surrogate_harness import make_model, smooth_slider

from hystid.errors import FmuError, NetworkError, RecordingError, UsageError
from hystid.fmu import build
from hystid.networks import Member, Network, TwoNetworkModel
from hystid.networks import onnx as exchange
from hystid.recording import Recording
from hystid.surrogate import network_code, oscillator_code, surrogate_code
from hystid.validation import Validation, validate

DT = 1e-4
SPECS = ("harmonic:20Hz@40N,0.4s", "chirp:5-60Hz@40N,0.4s")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """One structure in its three forms, and again as oscillator.fmu in the part of the reference."""
    folder = tmp_path_factory.mktemp("validation")
    exchange.write(smooth_slider(), folder / "surrogate.onnx")
    build(surrogate_code(folder / "surrogate.onnx"), folder / "surrogate.fmu")
    build(oscillator_code(folder / "surrogate.onnx"), folder / "oscillator.fmu")
    return folder


def recorded(
    frequency: float = 20.0, level: float = 40.0, n: int = 4000, model: TwoNetworkModel | None = None
) -> Recording:
    """A test of the slider, as a lab would have it: t, F, x, v, a."""
    t = DT * np.arange(n)
    F = level * np.sin(2 * np.pi * frequency * t)
    run = (model or smooth_slider()).free_run(F, DT)
    return Recording("a test", t, F=F, x=run["x"], v=run["v"], a=run["a"])


@pytest.mark.parametrize("name", ["surrogate.onnx", "surrogate.fmu", "oscillator.fmu"])
def test_the_reference_itself_is_found_exact(folder: Path, name: str) -> None:
    result = validate(folder / name, reference=folder / "oscillator.fmu", forces=SPECS)
    assert (
        result.mass == 1.0 and result.sample_rate == pytest.approx(1e4) and result.training_range["x"] == (-0.02, 0.02)
    )
    for case in result.cases:
        assert case.force_nrmse < 1e-12  # the same arithmetic, but for roundings
        assert case.free_run is not None and case.free_run.x_nrmse < 1e-9 and case.free_run.R_nrmse < 1e-9
        assert case.outside == 0.0 and case.diverged == "" and case.notes == ()
    assert [case.levels is not None for case in result.cases] == [True, False]


def test_a_force_is_sampled_as_the_surrogate_was(tmp_path: Path) -> None:
    """At ten times its rate a surrogate is refused; nobody should have to name the rate that it states."""
    slow = replace(smooth_slider(), sample_rate=1000.0)
    exchange.write(slow, tmp_path / "slow.onnx")
    build(oscillator_code(tmp_path / "slow.onnx"), tmp_path / "slow.fmu")
    result = validate(tmp_path / "slow.onnx", reference=tmp_path / "slow.fmu", forces=["harmonic:20Hz@40N,0.5s"])
    assert result.cases[0].reference.sample_rate == pytest.approx(1000.0)


def test_recordings_give_the_same_answer(folder: Path) -> None:
    result = validate(folder / "surrogate.fmu", [recorded()])
    assert result.figures("force_nrmse")[0] < 1e-10 and result.figures("x_nrmse")[0] < 1e-9
    levels = result.cases[0].levels
    assert levels is not None and levels.reference.fundamental == pytest.approx(20.0, abs=0.01)  # found by itself
    assert levels.worst_odd_db("force") == pytest.approx(0.0, abs=1e-6)
    assert len(levels.reference.order) == 10


def test_harmonics_of_a_slider_are_odd(folder: Path) -> None:
    """A symmetric loop has no even harmonics; its third one is well above the noise of the arithmetic."""
    levels = validate(folder / "surrogate.onnx", [recorded()]).cases[0].levels
    assert levels is not None
    third, even = levels.reference.level_db[2], levels.reference.level_db[1::2]
    assert third > -60 and even.max() < third - 20


def heavier(model: TwoNetworkModel, factor: float) -> TwoNetworkModel:
    """The same structure with a restoring force that is too large by a factor."""
    members = tuple(Member(m.hysteresis, stretched(m.restoring, factor)) for m in model.members)
    return replace(model, members=members)


def stretched(network: Network, factor: float) -> Network:
    return replace(network, output_gain=factor * network.output_gain)


def test_a_force_error_is_reported_as_what_it_is(tmp_path: Path) -> None:
    """R too large by 10 %: NRMSE = 0.1 rms(R) / std(R) exactly, and a free run that is off at resonance."""
    exchange.write(heavier(smooth_slider(), 1.1), tmp_path / "s.onnx")
    record = recorded()
    case = validate(tmp_path / "s.onnx", [record]).cases[0]
    R = record.channel("F") - record.channel("a")
    assert case.force_nrmse == pytest.approx(0.1 * np.sqrt(np.mean(R**2)) / np.std(R), rel=1e-6)
    assert case.force_mse == pytest.approx(0.01 * np.mean(R**2), rel=1e-6)
    assert case.free_run is not None and case.free_run.x_nrmse > 0.05


def test_divergence_is_a_result(tmp_path: Path) -> None:
    """A restoring force of the wrong sign drives the mass away; the force on the given motion is still measured."""
    exchange.write(heavier(smooth_slider(), -1.0), tmp_path / "s.onnx")
    result = validate(tmp_path / "s.onnx", [recorded(n=30_000)], out=tmp_path)
    case = result.cases[0]
    assert case.free_run is None and "diverged" in case.diverged and "at t = " in case.diverged
    assert case.force_nrmse == pytest.approx(2.0, rel=0.01)
    written = json.loads((tmp_path / "validation.json").read_text())
    assert "diverged" in written["cases"][0]["diverged"] and written["cases"][0]["free_run"] is None
    assert written["metrics"]["x_nrmse"]["worst"] is None  # infinite: JSON has no number for it
    assert np.isinf(result.figures("x_nrmse")[0])


@pytest.mark.parametrize("kind", ["white noise", "drift", "alternating"])
def test_what_is_no_tone_has_no_harmonics(folder: Path, kind: str) -> None:
    rng, n = np.random.default_rng(0), 3000
    forces = {
        "white noise": rng.normal(0, 20, n),
        "drift": np.linspace(0, 30, n),
        "alternating": 5.0 * (-1.0) ** np.arange(n),
    }
    run = smooth_slider().free_run(forces[kind], DT)
    record = Recording(kind, DT * np.arange(n), F=forces[kind], x=run["x"], v=run["v"], a=run["a"])
    assert validate(folder / "surrogate.onnx", [record]).cases[0].levels is None


def test_leaving_the_training_range_is_counted(folder: Path) -> None:
    record = recorded(level=150.0)
    case = validate(folder / "surrogate.onnx", [record]).cases[0]
    assert case.outside == np.mean((np.abs(record.channel("x")) > 0.02) | (np.abs(record.channel("v")) > 3.0))


def test_a_motion_under_way_starts_under_way(folder: Path) -> None:
    """A recording cut out of a longer one: x, v and R start where it does, so only the memory of before is missing."""
    whole = recorded()
    part = slice(1003, None)
    cut = Recording("cut", whole.t[part], **{name: getattr(whole, name)[part] for name in "Fxva"})
    case = validate(folder / "surrogate.onnx", [cut]).cases[0]
    relaxed = validate(folder / "surrogate.onnx", [whole]).cases[0]
    assert relaxed.force_nrmse < 1e-10
    # until the first reversal the branch starts a sample late; afterwards the loop closes
    assert case.force_nrmse < 0.1 and case.free_run is not None and case.free_run.x_nrmse < 0.2
    assert np.abs(case.force - cut.channel("F") + cut.channel("a"))[1500:].max() < 1.0


def test_mass_zero_has_no_free_run(folder: Path) -> None:
    record = recorded()
    R = record.channel("F") - record.channel("a")
    rig = Recording("rig", record.t, F=R, x=record.x, v=record.v)
    result = validate(folder / "surrogate.onnx", [rig], mass=0.0)
    assert result.cases[0].force_nrmse < 1e-10 and result.cases[0].free_run is None
    assert np.isnan(result.figures("x_nrmse")[0])
    assert result.as_dict()["metrics"]["x_nrmse"] == {"median": None, "worst": None}


def test_without_a_recorded_force_there_is_no_free_run(folder: Path) -> None:
    record = recorded()
    R = record.channel("F") - record.channel("a")
    case = validate(
        folder / "surrogate.onnx", [Recording("no F", record.t, x=record.x, v=record.v, a=record.a, R=R)]
    ).cases[0]
    assert case.free_run is None and "no channel F" in case.notes[0] and case.force_nrmse < 1e-10


def test_another_mass_is_noticed(folder: Path) -> None:
    result = validate(folder / "surrogate.onnx", reference=folder / "oscillator.fmu", forces=SPECS[:1], mass=1.5)
    assert "m a + R differs from F" in result.cases[0].notes[0]


def test_files_and_summary(folder: Path, tmp_path: Path) -> None:
    result: Validation = validate(folder / "surrogate.fmu", [recorded()], out=tmp_path / "new")
    assert result.files["json"] == tmp_path / "new" / "validation.json"
    written = json.loads(result.files["json"].read_text())
    assert written["surrogate"] == "surrogate.fmu" and written["kind"] == "surrogate" and written["mass"] == 1.0
    case = written["cases"][0]
    assert case["free_run"].keys() == {"x_nrmse", "R_nrmse", "x_mse", "R_mse"}
    assert case["harmonics"]["order"] == list(range(1, 11)) and len(case["harmonics"]["free_run_db"]) == 10
    assert (
        case["energy"]["reference"] == pytest.approx(case["energy"]["force"], rel=1e-6)
        and case["energy"]["reference"] > 0
    )
    assert set(result.cases[0].spectra) == {"reference", "force", "free_run"}


def test_bad_arguments_get_one_sentence(folder: Path, tmp_path: Path) -> None:
    record, surrogate = recorded(), folder / "surrogate.onnx"
    short = Recording("short", record.t[:20], **{name: getattr(record, name)[:20] for name in "Fxva"})
    slow = Recording("slow", record.t[::10], **{name: getattr(record, name)[::10] for name in "Fxva"})
    still = Recording("still", record.t, F=np.zeros(4000), x=record.x, v=record.v, a=record.a, R=np.zeros(4000))
    nothing = Recording("nothing", record.t, x=record.x, v=record.v, a=record.a)
    for error, sentence, arguments in (
        (UsageError, "against either recordings or a reference", {}),
        (UsageError, "needs a force to be driven by", {"reference": folder / "oscillator.fmu"}),
        (UsageError, "a mass in kg of 0 or more", {"recordings": [record], "mass": -1.0}),
        (UsageError, "sampled at 1000 Hz, the surrogate was trained at 10000 Hz", {"recordings": [slow]}),
        (RecordingError, "20 samples are too few", {"recordings": [short]}),
        (RecordingError, "the reference is constant", {"recordings": [still]}),
        (RecordingError, "channel F is needed", {"recordings": [nothing]}),
        (FmuError, "no input F", {"reference": folder / "surrogate.fmu", "forces": SPECS}),
    ):
        with pytest.raises(error, match=sentence) as caught:
            validate(surrogate, out=tmp_path, **arguments)  # type: ignore[arg-type]
        assert "\n" not in str(caught.value)
    assert list(tmp_path.iterdir()) == []


def test_what_is_no_surrogate(tmp_path: Path) -> None:
    proto = make_model([helper.make_node("Tanh", ["u"], ["y"])], {"u": (1,)}, ["y"])
    (tmp_path / "net.onnx").write_bytes(proto.SerializeToString())
    build(network_code(tmp_path / "net.onnx"), tmp_path / "net.fmu")
    with pytest.raises(UsageError, match="a surrogate has inputs x, v and output R"):
        validate(tmp_path / "net.fmu", [recorded()])
    with pytest.raises(NetworkError, match="a surrogate has the inputs x, v, state, found u"):
        validate(tmp_path / "net.onnx", [recorded()])
    (tmp_path / "text.fmu").write_text("not a zip")
    with pytest.raises(FmuError):
        validate(tmp_path / "text.fmu", [recorded()])
    with pytest.raises(FmuError):
        validate(tmp_path / "none.fmu", [recorded()])


def test_a_surrogate_of_another_make_is_compared_by_its_force(tmp_path: Path) -> None:
    """An FMU x, v -> R without our network inside: R = 1e4 x + 20 v, by Gemm."""
    nodes = [
        helper.make_node("Mul", ["x", "k"], ["spring"]),
        helper.make_node("Mul", ["v", "c"], ["damper"]),
        helper.make_node("Add", ["spring", "damper"], ["R"]),
    ]
    proto = make_model(nodes, {"x": (1,), "v": (1,)}, ["R"], {"k": np.array(1e4), "c": np.array(20.0)})
    (tmp_path / "linear.onnx").write_bytes(proto.SerializeToString())
    build(network_code(tmp_path / "linear.onnx"), tmp_path / "linear.fmu")
    record = recorded()
    result = validate(tmp_path / "linear.fmu", [record], mass=1.0)
    R, linear = record.channel("F") - record.channel("a"), 1e4 * record.channel("x") + 20 * record.channel("v")
    assert result.cases[0].force_nrmse == pytest.approx(np.sqrt(np.mean((linear - R) ** 2)) / np.std(R), rel=1e-9)
    assert result.cases[0].free_run is None and "carries no network" in result.notes[0]


@pytest.mark.parametrize("name", ["surrogate.onnx", "surrogate.fmu", "oscillator.fmu"])
def test_a_slider_dissipates_in_every_cycle_and_forgets_its_start(folder: Path, name: str) -> None:
    found = validate(folder / name, [recorded()]).stability
    assert found is not None and len(found.cycles) >= 8
    assert not found.feeding and found.least.loss >= 0
    # memory is renewed from the model's own force at every turning point: after four full cycles nothing else is left
    assert found.remembered < 1e-3


def test_a_force_that_feeds_energy_in_is_found(tmp_path: Path) -> None:
    """The slider with the wrong sign: every cycle that took energy out now puts as much in."""
    exchange.write(smooth_slider(), tmp_path / "right.onnx")
    exchange.write(heavier(smooth_slider(), -1.0), tmp_path / "wrong.onnx")
    right, wrong = (validate(tmp_path / f"{name}.onnx", [recorded()], out=tmp_path) for name in ("right", "wrong"))
    assert right.stability is not None and wrong.stability is not None
    largest = max(right.stability.cycles, key=lambda cycle: cycle.energy)
    assert min(cycle.energy for cycle in wrong.stability.cycles) == pytest.approx(-largest.energy, rel=1e-6)
    assert wrong.stability.feeding and wrong.stability.least.loss < 0
    written = json.loads((tmp_path / "validation.json").read_text())["stability"]
    assert written["feeding"] == len(wrong.stability.feeding) and min(written["loss"]) < 0
