"""The diagnosis on concealed cases of the benchmark's generator, which shares no code with it."""

import csv
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchmarks.concealed.cases import draw
from benchmarks.concealed.deck import CaseSpec
from benchmarks.concealed.generate import write_case
from hystid.compiled import CompiledModel
from hystid.diagnosis import TOLERATED, Diagnosis, diagnose
from hystid.diagnosis.model.effects import Scales
from hystid.diagnosis.model.library import load_effects
from hystid.diagnosis.model.transients import beginning
from hystid.errors import UsageError
from hystid.modelica import compile_model
from hystid.recording import Recording, read_all

LINEAR, JENKINS = "linear", "jenkins"


def case(folder: Path, spec: CaseSpec, seed: int) -> tuple[Path, dict[str, Any]]:
    """A case on disk, and its truth (which only the test opens)."""
    place = folder / "case_0000"
    write_case(draw(spec, np.random.default_rng(seed)), place, folder / "sealed")
    return place, json.loads((folder / "sealed" / "case_0000.json").read_text())


def run(place: Path, **options: object) -> Diagnosis:
    handed = json.loads((place / "case.json").read_text())
    recordings, holdout = (
        read_all([place / name for name in handed[kind]], accept=set(TOLERATED)) for kind in ("recordings", "holdout")
    )
    known = place / handed["parameters"]
    return diagnose(recordings, model=handed["model"], parameters=known, holdout=holdout, **options)  # type: ignore[arg-type]


def spec(group: str, ids: tuple[str, ...], family: str, variant: str = "standard") -> CaseSpec:
    return CaseSpec(group, ids, family, family, variant)


@pytest.mark.parametrize(
    ("ident", "family", "seed"),
    [
        ("cubic_stiffness", LINEAR, 11),
        ("quadratic_damping", LINEAR, 12),
        ("hidden_mode", LINEAR, 13),
        ("quadratic_stiffness", JENKINS, 14),
    ],
)
def test_single_effects_are_named_and_improve_the_held_out_run(
    tmp_path: Path, ident: str, family: str, seed: int
) -> None:
    place, _ = case(tmp_path, spec("single", (ident,), family), seed)
    found = run(place)
    assert found.verdict == "missing_physics"
    assert [finding.effect for finding in found.findings] == [ident]
    before, after = found.holdout[0].free_run
    assert before is not None and after is not None and after < before


@pytest.mark.parametrize(("family", "seed"), [(LINEAR, 21), (JENKINS, 22), ("boucwen", 23)])
def test_nothing_is_found_where_nothing_is_hidden(tmp_path: Path, family: str, seed: int) -> None:
    place, _ = case(tmp_path, spec("null", (), family), seed)
    found = run(place)
    assert found.verdict in ("consistent", "recalibrated")
    assert found.findings == ()


def test_contact_that_jumps_is_given_the_speed_over_which_it_turns(tmp_path: Path) -> None:
    place, truth = case(tmp_path, spec("single", ("quadratic_damping",), "pecorari"), 24)
    found = run(place)
    assert [finding.effect for finding in found.findings] == ["quadratic_damping"]
    turn = found.refit["v_turn"].value
    assert found.problem is not None
    fastest = max(float(np.max(np.abs(part.v))) for part in found.problem.parts)
    assert 0.001 < turn / fastest < 0.1  # of the rig: 0.01 of its nominal peak speed, by another smooth sign
    (held,) = found.holdout
    before, after = held.free_run
    assert before is not None and after is not None
    oracle = truth["oracle"]["holdout_truth"]
    # noise and the other shape of the turn: a tenth of the way from the oracle's error to that of the refit
    assert after < oracle + 0.1 * (before - oracle)


def test_physics_outside_the_library_is_unknown(tmp_path: Path) -> None:
    place, _ = case(tmp_path, spec("stranger", ("parametric_excitation",), LINEAR), 31)
    found = run(place)
    assert found.verdict == "unknown_physics"
    assert found.findings == () and found.unknown is not None and found.unknown.text


@pytest.mark.parametrize(("ident", "seed"), [("channel_delay", 41), ("sensor_saturation", 42)])
def test_sensor_faults_are_told_from_physics(tmp_path: Path, ident: str, seed: int) -> None:
    place, _ = case(tmp_path, spec("single", (ident,), LINEAR), seed)
    found = run(place)
    assert found.verdict == "sensor_fault"
    assert [finding.effect for finding in found.findings] == [ident]


def test_without_the_true_law_no_wrong_name(tmp_path: Path) -> None:
    place, _ = case(tmp_path, spec("single", ("hidden_mode",), LINEAR), 51)
    found = run(place, exclude=("hidden_mode",))
    assert all(finding.effect == "viscoelastic_relaxation" for finding in found.findings)  # its family


def test_files_of_the_contract(tmp_path: Path) -> None:
    place, _ = case(tmp_path, spec("single", ("contact_loss",), LINEAR), 61)
    out = tmp_path / "out"
    found = run(place, out=out)
    told = json.loads((out / "diagnosis.json").read_text())
    assert told["verdict"] == found.verdict
    assert set(told) >= {"verdict", "baseline", "findings", "fit", "untestable", "next_experiment"}
    assert set(told["baseline"]) >= {"model", "parameters", "refit", "force_nrmse", "noise_floor"}
    for finding in told["findings"]:
        assert set(finding) >= {"effect", "class", "confidence", "parameters", "where", "evidence"}
        assert finding["effect"] in finding["class"] and 0 <= finding["confidence"] <= 1
        assert set(finding["where"]) >= {"text", "x", "v", "t", "amplitude", "harmonics"}
    with (out / "mismatch_rec_1.csv").open(newline="") as text:
        assert next(csv.reader(text)) == ["t [s]", "residual [N]", "score [-]"]
    assert (out / "extended.fmu").stat().st_size > 0
    _extended_is_the_fitted_model(out / "extended.mo", found)


def _extended_is_the_fitted_model(path: Path, found: Diagnosis) -> None:
    """The written model, on the measured motion, gives the force that the diagnosis fitted."""
    assert found.problem is not None and found.final is not None
    part = found.problem.parts[0]
    model = CompiledModel(compile_model(f"{path}:Extended"))
    force = model.clamp({"x": part.x, "v": part.v}, {}, part.dt, outputs=("R",))["R"]
    fitted = found.problem.predicted(found.final.hypothesis)[0]
    assert np.allclose(force, fitted, atol=1e-6 * np.std(fitted))  # nine digits are written


def _shaken(n: int = 4000) -> Recording:
    rng = np.random.default_rng(5)
    t = np.arange(n) * 1e-3
    x = 1e-3 * np.sin(2 * np.pi * 5 * t) + 5e-4 * np.sin(2 * np.pi * 11 * t + 1)
    v = np.gradient(x, t)
    force = 1e4 * x + 20 * v + 2.0
    noisy = {"F": force + 0.01 * np.std(force) * rng.standard_normal(n), "x": x + 1e-6 * rng.standard_normal(n)}
    return Recording("rig", t, **noisy)


def test_a_users_own_block_is_a_candidate(tmp_path: Path) -> None:
    block = tmp_path / "mine.mo"
    block.write_text(
        'block MagnetPull "Constant pull"\n  extends HystId.Interfaces.PartialEffect;\n'
        '  parameter Real degree_of_pull(unit = "N") = 0 "Pull";\nequation\n  f = degree_of_pull;\nend MagnetPull;\n'
    )
    found = diagnose(
        [_shaken()], model="HystId.Oscillators.Linear", parameters={"m": 0.0, "B": 20.0, "Kl": 1e4}, effects=block,
        exclude=("preload", "asymmetric_friction", "force_drift"), out=tmp_path / "out",
    )  # fmt: skip
    assert [finding.effect for finding in found.findings] == ["magnet_pull"]
    assert abs(found.findings[0].parameters["degree_of_pull"].value - 2.0) < 0.02
    assert "MagnetPull" in (tmp_path / "out" / "extended.mo").read_text()


def test_what_cannot_be_diagnosed_is_a_verdict() -> None:
    t = np.arange(1000) * 1e-3
    without_force = Recording("quiet", t, x=np.sin(90 * t))
    told = diagnose([without_force], model="HystId.Oscillators.Linear")
    assert told.verdict == "not_applicable" and "force" in told.headline
    short = Recording("short", t[:50], x=np.sin(t[:50]), F=np.cos(t[:50]))
    assert diagnose([short], model="HystId.Oscillators.Linear").verdict == "not_applicable"


@pytest.mark.parametrize(
    ("parameters", "rule"),
    [
        ({"m": "heavy"}, "must be a number"),
        ({"mass": 0.0}, "no parameter"),
        ({"m": {"fixed": True}}, "must be a number"),
    ],
)
def test_wrong_parameters_are_one_sentence(parameters: dict[str, object], rule: str) -> None:
    with pytest.raises(UsageError, match=rule):
        diagnose([_shaken()], model="HystId.Oscillators.Linear", parameters=parameters)


def test_a_file_that_is_no_effect_is_refused(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="there is no such file"):
        diagnose([_shaken()], model="HystId.Oscillators.Linear", effects=tmp_path / "none.mo")


def test_starts_of_a_hidden_mode_lie_closer_than_it_is_wide() -> None:
    effect = next(effect for effect in load_effects([]) if effect.id == "hidden_mode")
    x = np.linspace(0, 1e-3, 100)
    scales = Scales(x, 100 * x, x, 5.0, 1e-3, (2.0, 90.0), 1.0)
    starts = np.array(sorted({point["f2"] for point in effect.grid(scales)}))
    assert starts[0] <= 10.0 and starts[-1] >= 120.0  # all of the band but its slow end, and above
    assert np.all(np.diff(np.log(starts)) < 0.1)  # width of a resonance at the damping ratio of the starts, 0.05


@pytest.mark.parametrize("span", [5.0, 0.02])
def test_a_change_with_time_lasts_longer_than_a_period_of_the_slowest_motion(span: float) -> None:
    """What is over sooner is how a recording begins: no swing tells a stiffness from a force then."""
    effect = next(effect for effect in load_effects([]) if effect.form == "Saturating")
    x = np.linspace(0, 1e-3, 100)
    low, high = effect.bounds(effect.shapes[0], Scales(x, 100 * x, x, span, 1e-3, (2.0, 90.0), 1.0))
    assert low == min(0.5, high)
    assert all(
        low <= point["tau"] <= high for point in effect.grid(Scales(x, 100 * x, x, span, 1e-3, (2.0, 90.0), 1.0))
    )


@pytest.mark.parametrize(
    ("family", "ident", "seed"), [(JENKINS, "", 991), ("iwan", "", 997), ("iwan", "preload", 1004)]
)
def test_recordings_may_begin_in_mid_motion(tmp_path: Path, family: str, ident: str, seed: int) -> None:
    """Where a contact stuck before is not recorded: its force until it slips, or for good, is no mismatch."""
    group, ids = ("single", (ident,)) if ident else ("null", ())
    place, _ = case(tmp_path, spec(group, ids, family, "running"), seed)
    found = run(place)
    assert [finding.effect for finding in found.findings] == list(ids)
    assert found.verdict != "unknown_physics"
    assert any("begins in mid-motion" in note for note in found.notes)


def test_a_motion_that_stays_on_one_side_may_begin_in_mid_motion() -> None:
    """A preloaded joint: x never changes its sign, so that its two ends have nothing to do with zero."""
    t = np.arange(4000) * 1e-3
    rng = np.random.default_rng(3)
    x = 3e-3 + 1e-3 * np.sin(40 * t + 1.0) * (1 + 0.2 * np.sin(3 * t))
    compiled = CompiledModel(compile_model("HystId.Oscillators.Jenkins"))
    v = np.gradient(x, t)
    R = compiled.clamp({"x": x, "v": v}, {}, 1e-3, parameters={"Ks": 5e3, "fc": 1.5, "Kl": 1e4}, outputs=("R",))["R"]
    noisy = [u + 0.01 * np.std(u) * rng.standard_normal(len(t)) for u in (R, x)]
    test = Recording("one_sided", t, F=noisy[0], x=noisy[1])
    given = {"m": 0, "Ks": 4.5e3, "fc": 1.6, "Kl": 1.1e4}
    found = diagnose([test], model="HystId.Oscillators.Jenkins", parameters=given)
    assert any("begins in mid-motion" in note for note in found.notes)
    assert found.findings == ()


def growing(until: float, m: float = 0.0) -> Recording:
    """Sliders that a stronger motion has left on one side come back one by one, as the recorded motion grows: the last
    of them at a time [s]. Noise of 60 dB shows the force of each. m: mass [kg] that moves with them."""
    dt, rng = 1e-3, np.random.default_rng(8)
    t = dt * np.arange(-1000, 6000)
    grown = np.interp(t, [-1.0, 0.0, until, 7.0], [1.5, 0.1, 1.0, 1.0])
    x = 1e-3 * grown * (np.sin(60 * t) + 0.3 * np.sin(97 * t + 1.0))
    rig = CompiledModel(compile_model("HystId.Oscillators.Iwan"))
    R = rig.clamp({"x": x, "v": np.gradient(x, dt)}, {}, dt, parameters=SLIDERS, outputs=("R",))["R"]
    seen, F = t > -dt / 2, R + m * np.gradient(np.gradient(x, dt), dt)
    F, x = (u[seen] + 0.001 * np.std(u) * rng.standard_normal(np.count_nonzero(seen)) for u in (F, x))
    return Recording("grows", t[seen], F=F, x=x)


SLIDERS = {"m": 0, "Ks": 2e4, "fc": 12.0, "Kl": 1e4}


def test_what_is_remembered_for_most_of_a_recording_is_no_mismatch() -> None:
    found = diagnose([growing(4.5)], model="HystId.Oscillators.Iwan", parameters=SLIDERS)
    assert found.findings == ()
    assert found.verdict in ("consistent", "recalibrated")
    left_out = next(note for note in found.notes if "begins in mid-motion" in note)
    assert float(left_out.split("its first ")[1].split(" s")[0]) > 3.2  # more than half


def test_what_is_remembered_to_the_end_leaves_rows() -> None:
    """The last slider comes back when the recording is over, and no noise hides it. An acceleration that has to be
    derived costs rows at the end as well: what is left out ends before them."""
    whole = growing(6.0, m=1.0)
    short = Recording("short", whole.t[:4000], F=whole.F[:4000], x=whole.x[:4000])
    given = SLIDERS | {"m": {"value": 1.0, "fixed": True}}
    found = diagnose([short], model="HystId.Oscillators.Iwan", parameters=given)
    assert found.problem is not None and found.choice is not None
    quiet = [replace(part, noise=dict.fromkeys(part.noise, 1e-12)) for part in found.problem.parts]
    (begun,), _, (note,) = beginning(quiet, found.problem.baseline, found.choice.before.hypothesis.values)
    assert begun.valid is not None and np.count_nonzero(begun.valid) < 0.2 * len(begun)
    assert found.problem.of([begun]).reduce.count > 0
    assert "begins in mid-motion" in note


def left(level: float, seed: int) -> Recording:
    """A quasi-static test at a level [mm], after a motion of 1.5 mm that has left sliders on one side for good."""
    dt, rng = 1e-3, np.random.default_rng(seed)
    t = dt * np.arange(-1000, 5000)
    x = 1e-3 * np.interp(t, [-1.0, -0.1, 0], [1.5, 1.0, level])
    x *= np.sin(60 * t + seed) + 0.3 * np.sin(97 * t + 1.0 + seed)
    rig = CompiledModel(compile_model("HystId.Oscillators.Iwan"))
    R = rig.clamp({"x": x, "v": np.gradient(x, dt)}, {}, dt, parameters=SLIDERS, outputs=("R",))["R"]
    seen = t > -dt / 2
    F, x = (u[seen] + 3e-4 * np.std(u) * rng.standard_normal(np.count_nonzero(seen)) for u in (R, x))
    return Recording(f"left_{seed}", t[seen], F=F, x=x)


@pytest.mark.parametrize("levels", [(0.6, 0.4, 0.9), (0.5, 0.8, 0.9)])
def test_what_contacts_keep_for_good_is_no_constant_force(levels: tuple[float, ...]) -> None:
    """With the friction that was given all sliders let go at once; with that of the rig some never do."""
    tests = [left(level, seed) for seed, level in enumerate(levels, 1)]
    found = diagnose(tests, model="HystId.Oscillators.Iwan", parameters=SLIDERS | {"fc": 7.0})
    assert found.findings == ()
    assert found.verdict == "recalibrated"
    assert any("a constant force of contacts that never slip" in note for note in found.notes)
    assert found.final_values()["fc"].value == pytest.approx(12.0, rel=0.01)  # 70 dB, and some sliders never slip


def test_a_contact_that_slips_late_was_at_rest_where_the_recording_says_so() -> None:
    """Its memory would leave out all but a few samples, which any parameters fit: a spring that is missing was not
    seen."""
    t = np.arange(5000) * 1e-3
    growth = 0.4 + 0.6 * t / t[-1]
    x = 1e-3 * growth * (np.sin(9.0 * t + 0.7) + 0.4 * np.sin(23.0 * t))
    v = np.gradient(x, 1e-3, edge_order=2)
    a = np.gradient(v, 1e-3, edge_order=2)
    h = np.zeros_like(x)
    for i in range(1, len(x)):  # an elastic slider, at rest before the first sample
        h[i] = np.clip(h[i - 1] + 4000.0 * (x[i] - x[i - 1]), -3.0, 3.0)
    rng = np.random.default_rng(3)
    for cubic in (0.0, 2e9):
        channels = {"F": 2.0 * a + 5.0 * v + 3000.0 * x + h + cubic * x**3, "x": x, "v": v, "a": a}
        noisy = {key: u + 2e-3 * np.std(u) * rng.standard_normal(len(u)) for key, u in channels.items()}
        found = diagnose(
            Recording("by_hand", t, **noisy),
            model="HystId.Oscillators.Jenkins",
            parameters={"m": 2.0, "B": 6.0, "Kl": 2500.0, "Ks": 5000.0, "fc": 6.0},
        )
        assert any("bears out" in note for note in found.notes)
        assert (found.verdict == "missing_physics") == bool(cubic)
        # 54 dB and 5000 samples: a few thousandths; 3 % leaves room for the smoothed turns of the contact
        assert found.final_values()["fc"].value == pytest.approx(3.0, rel=0.03)


def test_a_mass_that_has_just_been_let_go_begins_at_rest() -> None:
    """A preload pulls from the first sample on: eight samples later the mass moves, and yet nothing was before.

    Noise of 34 dB; the preload moves the mass by a fifth of the rms of the displacement, so that it is seen by itself.
    """
    dt, given = 6e-4, {"m": 0.8, "B": 3.5, "Kl": 7e3, "alpha": 5e3, "beta": 2.5e3, "gamma": 0.7, "delta": 0.3}
    rig, rng = CompiledModel(compile_model("HystId.Oscillators.BoucWen")), np.random.default_rng(5)
    t, tests = dt * np.arange(6000), []
    for number, level in enumerate((0.8, 1.4)):
        F = level * np.sin(2 * np.pi * (2 * t + 5 * t**2))
        run = rig.simulate({"F": F + 0.35}, dt, parameters=given, outputs=("x", "v", "a"), interpolation="cubic")
        clean = {"F": F, **run}
        noisy = {k: u + 0.02 * np.std(u) * rng.standard_normal(len(t)) for k, u in clean.items()}
        tests.append(Recording(f"let_go_{number}", t, **noisy))
    found = diagnose(tests, model="HystId.Oscillators.BoucWen", parameters=given)
    assert [finding.effect for finding in found.findings] == ["preload"]
    assert abs(found.findings[0].parameters["f0"].value + 0.35) < 0.02
    assert not any("begins in mid-motion" in note for note in found.notes)
