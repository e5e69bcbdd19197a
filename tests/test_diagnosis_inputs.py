"""What the diagnosis is given: recordings without a clock, a free decay, further columns, channels with faults."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from hystid.diagnosis import diagnose
from hystid.diagnosis.fit.case import scales_of
from hystid.diagnosis.fit.descent import fit
from hystid.diagnosis.fit.hypothesis import Hypothesis
from hystid.diagnosis.fit.problem import Problem
from hystid.diagnosis.fit.zeros import zero_of_x
from hystid.diagnosis.model.baseline import baseline_of
from hystid.diagnosis.model.channel_effects import force_drift
from hystid.diagnosis.model.library import load_effects
from hystid.diagnosis.prepare.rest import resting, trimmed, without_rest
from hystid.diagnosis.prepare.segments import prepare_part
from hystid.diagnosis.tell.dependence import dependences
from hystid.errors import RecordingError
from hystid.modelica import compile_model
from hystid.modelica.sources import library_folder
from hystid.recording import Recording, read
from hystid.recording.types import PSEUDO_TIME
from tests import test_diagnosis_windows as rigs

Array = np.ndarray
DATA = Path(__file__).parents[2] / "shared" / "data"
LINEAR = "HystId.Oscillators.Linear"


def test_noise_of_a_derived_acceleration_cancels_up_to_the_ends() -> None:
    """A second difference of white noise is a sum that telescopes: whatever is left of it at an end is spread far."""
    n, turn = 4000, 2 * np.pi * 5e-3
    x = 1e-3 * np.sin(turn * np.arange(n) + 1)
    left = []
    for seed in range(6):
        noisy = x + 1e-5 * np.random.default_rng(seed).standard_normal(n)
        part = prepare_part(Recording("test", np.arange(n) * 1e-3, F=1e4 * x, x=noisy))
        error = part.inertia + (turn / 1e-3) ** 2 * x
        left += [np.sum(error[:40]) / np.std(error), np.sum(error[-40:]) / np.std(error)]
    assert np.sqrt(np.mean(np.square(left))) < 1.0  # less than one sample; four that repeat the fifth leave four


def test_a_force_that_drifts_is_no_finding_where_time_was_not_measured() -> None:
    """Cycles of a testing machine whose samples are numbered: the force sinks over the numbers."""
    n = 4000
    rng = np.random.default_rng(0)
    number = np.arange(n) / 100.0
    x = 1e-3 * np.interp(number, np.arange(41), np.where(np.arange(41) % 2, 1.0, -1.0) * np.linspace(0.3, 1.0, 41))
    F = 2e4 * x + 0.05 * number
    test = Recording("cycles", number, F=F + 0.02 * rng.standard_normal(n), x=x, origin={"t": PSEUDO_TIME})
    found = diagnose([test], model=LINEAR, parameters={"m": 0, "Kl": 2e4})
    assert not {"force_drift", "stiffness_drift"} & {finding.effect for finding in found.findings}
    assert "from" not in " ".join(finding.where.text for finding in found.findings if "only" in finding.where.text)
    assert "stiffness_drift" in found.untestable
    assert any("time only numbers the samples" in note for note in found.notes)


def test_laws_that_read_the_time_say_so_themselves() -> None:
    needs = {effect.id for effect in load_effects() if effect.needs_clock}
    assert "stiffness_drift" in needs and "cubic_stiffness" not in needs and "viscoelastic_relaxation" not in needs
    assert force_drift(1).needs_clock


@pytest.mark.parametrize("kind", ["Oscillators", "Effects"])
def test_forces_of_friction_and_masses_have_a_least_value_of_zero(kind: str) -> None:
    """A constant force may push either way, and a negative added mass is a gain of the force sensor."""
    either_way = {"f0"}
    for path in sorted((library_folder() / "HystId" / kind).glob("*.mo")):
        if path.stem == "package":
            continue
        for variable in compile_model(f"HystId.{kind}.{path.stem}").variables:
            if variable.causality != "parameter" or variable.name in either_way or variable.name == "dm":
                continue
            if variable.unit in ("N", "kg") or variable.name == "Ks":
                assert variable.min is not None and variable.min >= 0, f"{path.stem}.{variable.name}"


def noisy(u: Array, rng: np.random.Generator, share: float = 0.01) -> Array:
    return u + share * float(np.std(u)) * rng.standard_normal(len(u))


def damper(rng: np.random.Generator, level: Array, n: int = 8000, extra: dict[str, Array] | None = None) -> Recording:
    """Massless damper on a random motion, with friction of a given level [N] at each sample."""
    t = np.arange(n) / 500.0
    tones = rng.uniform(0.5, 4.0, 12), rng.uniform(0, 2 * np.pi, 12)
    phase = 2 * np.pi * np.outer(t, tones[0]) + tones[1]
    x, v = 1e-3 * np.sin(phase).sum(1), 1e-3 * (np.cos(phase) * 2 * np.pi * tones[0]).sum(1)
    F = 2e4 * x + 300.0 * v + level * np.tanh(v / 2e-3)
    return Recording("damper", t, F=noisy(F, rng), x=noisy(x, rng, 1e-3), v=noisy(v, rng, 1e-3), extra=extra or {})


def switched(rng: np.random.Generator, n: int = 8000) -> Array:
    """A voltage of 0 or 2 V that switches at random times."""
    return np.repeat(2.0 * rng.integers(0, 2, n // 100), 100)


def prepared(records: list[Recording]) -> Problem:
    """The refitted baseline and what it leaves, without any search."""
    parts = [prepare_part(record, i) for i, record in enumerate(records)]
    start = {"m": 0.0, "B": 300.0, "Kl": 2e4}
    baseline = baseline_of(LINEAR, compile_model(LINEAR), start, frozenset({"m"}), length=1e-3)
    return Problem(parts, baseline, scales_of(parts, baseline))


def fitted(problem: Problem) -> Hypothesis:
    return fit(problem, Hypothesis(dict(problem.baseline.nominal))).hypothesis


def test_friction_that_follows_a_voltage_is_said_to_follow_it() -> None:
    rng = np.random.default_rng(3)
    u, idle = switched(rng), switched(rng)
    record = damper(rng, 20.0 + 30.0 * u, extra={"u_coil": u, "idle": idle})
    problem = prepared([record])
    (found,) = dependences(problem, fitted(problem))
    assert found.column == "u_coil" and found.chance <= 0.01 and 0.3 < found.share <= 1.0
    (low, weak, _), (high, strong, _) = found.curve
    assert (low, high) == (0.0, 2.0) and strong > weak
    assert "the force depends on u_coil" in found.sentence()


def test_columns_that_follow_the_motion_or_say_nothing_are_not_named() -> None:
    """Missing friction beside a second displacement sensor, a set point and three idle columns, ten times over: by
    chance one in a hundred may be told, so that two of ten would be a defect."""
    named = 0
    for seed in range(10):
        rng = np.random.default_rng(seed)
        record = damper(rng, np.full(8000, 50.0))
        drift = np.cumsum(rng.standard_normal(8000))
        extra = {"x2": 1e3 * record.x, "x_set": np.roll(record.x, -3), "u": switched(rng), "T": drift, "p": drift**2}
        problem = prepared([replace(record, extra=extra)])
        named += len(dependences(problem, fitted(problem)))
    assert named <= 1


def test_a_value_per_recording_needs_three_recordings_on_a_line() -> None:
    rng = np.random.default_rng(5)
    loads = [1.0, 3.0, 5.0, 7.0]
    records = [damper(rng, np.full(3000, 10.0 * p), 3000, {"p": np.full(3000, p)}) for p in loads]
    problem = prepared(records)
    (found,) = dependences(problem, fitted(problem))
    assert found.column == "p" and [point[0] for point in found.curve] == loads
    two = prepared(records[:2])
    assert dependences(two, fitted(two)) == []


def decay(rng: np.random.Generator, m: float = 1.0, k3: float = 0.0, driven: float = 0.0) -> tuple[Array, Array]:
    """Time and displacement of a mass that is let go at 3 mm: 10 Hz, 0.8 %, by a fine leapfrog; noise of 1 um."""
    n, dt, fine = 8000, 1e-3, 20
    k, c = m * (2 * np.pi * 10.0) ** 2, m * 1.0
    x, v, h = 3e-3, 0.0, dt / fine
    found = np.empty(n)
    for i in range(n):
        found[i] = x
        for j in range(fine):
            push = driven * np.sin(2 * np.pi * 10.0 * (i + j / fine) * dt)
            v = (v * (1 - 0.5 * h * c / m) + h * (push - k * x - k3 * x**3) / m) / (1 + 0.5 * h * c / m)
            x += h * v
    return np.arange(n) * dt, found + 1e-6 * rng.standard_normal(n)


def test_a_free_decay_needs_no_force() -> None:
    """The leapfrog is off by (w h)^2/24, a part in a million: what is found is what was put in, per unit of mass."""
    t, x = decay(np.random.default_rng(1), m=2.5, k3=2.5 * 2e8)
    for force in (None, np.zeros_like(x)):
        found = diagnose([Recording("let_go", t, F=force, x=x)], model=LINEAR)
        assert "cubic_stiffness" in found.findings[0].alike
        assert any("per unit of mass" in note for note in found.notes)
        assert found.refit["m"].value == 1.0
    k3 = found.findings[0].parameters["k3"].value
    assert k3 == pytest.approx(2e8, rel=0.1)  # 1 um against 3 mm leaves 3 %


def test_a_driven_motion_without_a_force_is_refused(tmp_path: Path) -> None:
    t, x = decay(np.random.default_rng(2), driven=5.0)
    found = diagnose([Recording("driven", t, F=np.zeros_like(x), x=x)], model=LINEAR, out=tmp_path)
    assert found.verdict == "not_applicable" and "does not die away" in found.headline


def test_a_file_without_a_force_is_diagnosed_and_identified_not(tmp_path: Path) -> None:
    t, x = decay(np.random.default_rng(3))
    file = tmp_path / "let_go.csv"
    rows = "\n".join(f"{a:.4f},{b:.8f}" for a, b in zip(t, x, strict=True))
    file.write_text(f"t [s],x [m]\n{rows}\n")
    with pytest.raises(RecordingError, match="missing_force"):
        read(file)
    found = diagnose([file], model=LINEAR)
    assert found.verdict in ("consistent", "recalibrated")
    assert found.refit["Kl"].value == pytest.approx((2 * np.pi * 10.0) ** 2, rel=5e-3)


@pytest.mark.skipif(not DATA.is_dir(), reason="the recordings of other laboratories are not beside this checkout")
def test_the_ring_down_of_a_beam_with_magnets_hardens() -> None:
    """Its source: frequency rises from 36.9 to 39.1 Hz with amplitude, k3/k1 of 0.9e7 to 1e7 per unit of x squared."""
    record = read(
        DATA / "magneto_elastic_decay" / "magnet_beam_ringdown.csv", names={"x": "x_strain"}, accept=("missing_force",)
    )
    found = diagnose([record], model=LINEAR)
    assert found.verdict in ("missing_physics", "unknown_physics")
    assert np.sqrt(found.refit["Kl"].value) / (2 * np.pi) == pytest.approx(36.9, rel=0.1)
    assert not any("periodic force" in note for note in found.notes)  # that line is the motion's own


def test_a_velocity_alone_is_enough_where_nothing_depends_on_the_displacement() -> None:
    """A sliding mass with dry friction, pushed slowly: the integral of its velocity drifts, and nobody needs it."""
    rng = np.random.default_rng(11)
    t = np.arange(8000) * 2e-3
    tones, phase = rng.uniform(0.05, 3.0, 20), rng.uniform(0, 2 * np.pi, 20)
    turn = 2 * np.pi * np.outer(t, tones) + phase
    v, a = 0.05 * np.sin(turn).sum(1), 0.05 * (np.cos(turn) * 2 * np.pi * tones).sum(1)
    F = 2.0 * a + 30.0 * v + 15.0 * np.tanh(v / 1e-3)
    record = Recording("slider", t, F=noisy(F, rng), v=noisy(v, rng, 0.02))
    known = {"m": 2.0, "B": 30.0, "Kl": {"value": 0.0, "fixed": True}}
    found = diagnose([record], model=LINEAR, parameters=known)
    assert found.verdict == "missing_physics", found.headline
    assert {"coulomb_friction", "stribeck_friction"} & set(found.findings[0].alike)
    assert "cubic_stiffness" in found.untestable


def test_a_blow_does_not_hide_the_ringing_that_follows() -> None:
    """A blow of 2 ms has its power from zero on; the structure moves at 20 Hz."""
    t = np.arange(4000) * 1e-3
    blow = np.where(t < 2e-3, 1000.0, 0.0)
    decay = np.exp(-2 * t) * 2 * np.pi * 20
    v, a = decay * np.cos(2 * np.pi * 20 * t) * 1e-3, -decay * np.sin(2 * np.pi * 20 * t) * 0.126
    part = prepare_part(Recording("blow", t, F=blow, v=v + 1e-4 * np.random.default_rng(0).standard_normal(4000), a=a))
    part = replace(part, lowest=2 * np.pi * 3.0)
    assert part.hidden(2.0) < part.hidden()


def test_a_constant_force_may_be_the_zero_of_the_displacement() -> None:
    """A spring of 20 kN/m that is measured 0.1 mm off its zero looks like 2 N."""
    rng = np.random.default_rng(12)
    record = damper(rng, np.zeros(4000), 4000)
    problem = prepared([record])
    zero = zero_of_x(problem, fitted(problem), 2.0)
    assert zero is not None and zero.size == pytest.approx(1e-4, rel=0.01)  # the stiffness is fitted to 0.1 %
    assert zero.share == pytest.approx(1e-4 / np.std(record.x), rel=0.02)
    off = replace(record, x=np.asarray(record.x) + 1e-4)
    found = diagnose([off], model=LINEAR, parameters={"m": 0.0, "Kl": 2e4, "B": 300.0})
    if "preload" in {finding.effect for finding in found.findings}:
        assert any("may as well be the zero of the displacement sensor: 0.1 mm" in note for note in found.notes)


def test_resting_samples_do_not_lead_a_refit() -> None:
    """A spring beside dry friction, moved for a tenth of the time and left where friction holds it for the rest."""
    rng = np.random.default_rng(13)
    n = 8000
    t = np.arange(n) * 1e-3
    x = np.where(t < 0.8, 1e-3 * np.sin(2 * np.pi * 5 * t) * np.minimum(1, (0.8 - t) / 0.05), 0.0)
    x = x + 8e-4 / (1 + np.exp(-(t - 0.8) / 5e-3))  # it ends off its middle
    v = np.gradient(x, t)
    F = 2e4 * x + 12.0 * np.tanh(v / 1e-3)
    F = np.where(t > 0.85, 4.0, F)  # the actuator lets go; friction holds the spring
    record = Recording("held", t, F=F + 0.05 * rng.standard_normal(n), x=x + 1e-6 * rng.standard_normal(n))
    short = trimmed(record)
    assert len(short) < 1200 and "at rest from" in short.notes[0]
    start = {"m": 0.0, "B": 300.0, "Kl": 1e4}
    baseline = baseline_of(LINEAR, compile_model(LINEAR), start, frozenset({"m"}), length=1e-3)
    stiffness = {}
    for name, one in (("all", record), ("moving", short)):
        parts = [prepare_part(one)]
        problem = Problem(parts, baseline, scales_of(parts, baseline))
        stiffness[name] = fitted(problem).values["Kl"]
    assert stiffness["moving"] == pytest.approx(2e4, rel=0.15)  # friction is missing in this model
    assert abs(stiffness["all"] - 2e4) > 3 * abs(stiffness["moving"] - 2e4)


def test_a_rest_between_two_motions_is_left_out_of_the_balance() -> None:
    rng = np.random.default_rng(14)
    t = np.arange(6000) * 1e-3
    on = ((t < 1.0) | (t > 5.0)).astype(float)
    x = 1e-3 * np.sin(2 * np.pi * 10 * t) * on
    F = 2e4 * x + 3.0 * (1 - on)
    record = Recording("pause", t, F=F + 0.05 * rng.standard_normal(6000), x=x + 1e-6 * rng.standard_normal(6000))
    part = prepare_part(record)
    assert trimmed(record) is record and 0.55 < np.mean(resting(part)) < 0.67
    (moving,), (told,) = without_rest([part])
    assert "at rest in" in told and moving.valid is not None
    assert without_rest([moving])[0][0].valid is not None


def test_what_is_moved_and_creeps_back_is_no_free_decay() -> None:
    """An actuator that moves once has no force channel, and was driven all the same."""
    t = np.arange(900) * 0.01
    x = 0.1 * np.minimum(t / 0.5, np.exp(-(t - 0.5) / 2.0)) + 1e-4 * np.random.default_rng(1).standard_normal(len(t))
    found = diagnose([Recording("stroke", t, x=x)], model=LINEAR)
    assert found.verdict == "not_applicable"
    assert "does not swing" in found.headline


def test_dry_friction_in_a_free_decay_is_not_called_one_that_falls_with_speed() -> None:
    """The more general law holds it, and is found first: x alone, 45 dB, let go at 10 mm."""
    mass, damping, stiffness, friction, rate, n, steps = 2.0, 2.0, 8000.0, 1.2, 1000.0, 5000, 10
    x, v, dt, found = 0.01, 0.0, 1 / rate / steps, np.empty(n)

    def a(x: float, v: float) -> float:
        return -(damping * v + stiffness * x + friction * float(np.tanh(v / 2e-3))) / mass

    for i in range(n):
        found[i] = x
        for _ in range(steps):  # Heun: second order, 6 % of the transition per step
            first = a(x, v)
            second = a(x + dt * v, v + dt * first)
            x, v = x + dt * (v + 0.5 * dt * first), v + 0.5 * dt * (first + second)
    noise = 10 ** (-45 / 20) * np.std(found) * np.random.default_rng(77).standard_normal(n)
    decay = Recording("decay", np.arange(n) / rate, x=found + noise)
    answer = diagnose(decay, model="HystId.Oscillators.Linear", parameters={"m": mass})
    assert answer.verdict == "missing_physics"
    assert "coulomb_friction" in (answer.findings[0].effect, *answer.findings[0].alike), answer.headline


def test_a_held_out_recording_that_denies_the_mass_is_left_out() -> None:
    """Its force was measured behind the moving parts: the answer comes from the others, and says so."""
    test, other = (rigs.recorded(seed, 1e3 * seed, lambda t, x, v: 0 * t) for seed in (1, 2))
    assert other.F is not None
    assert other.a is not None
    behind = replace(other, F=other.F - rigs.MASS * other.a)
    found = diagnose([test], model=rigs.MODEL, parameters=rigs.NOMINAL, holdout=[behind])
    assert found.verdict in ("consistent", "recalibrated")
    assert any("held-out recording left out: rig_2" in doubt and "shows no mass" in doubt for doubt in found.doubts)


def test_a_recording_without_force_that_does_not_swing_is_left_out() -> None:
    """It creeps back to rest, and says little; the others carry the answer."""
    test = rigs.recorded(1, 1e3, lambda t, x, v: 0 * t)
    x = 0.01 * np.exp(-test.t / 1.5) + 1e-6 * np.random.default_rng(1).standard_normal(len(test))
    creeping = Recording("creeping", test.t, F=np.zeros(len(test)), x=x)
    found = diagnose([test, creeping], model=rigs.MODEL, parameters=rigs.NOMINAL)
    assert found.verdict in ("consistent", "recalibrated")
    assert any(note.startswith("left out: creeping has no force") for note in found.notes)
