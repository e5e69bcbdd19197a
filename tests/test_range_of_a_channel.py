"""A channel that was set to another range in one recording: its gain is wrong there, and nowhere else."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from hystid.diagnosis import Diagnosis, diagnose
from hystid.diagnosis.model.channel_effects import ranges
from hystid.diagnosis.prepare.segments import prepare_parts
from hystid.recording import Recording
from tests.test_diagnosis_windows import MODEL, NOMINAL, recorded

CUBIC = 1e6  # N/m3


def sound(t: np.ndarray, x: np.ndarray, v: np.ndarray) -> np.ndarray:
    return 0 * t


def asked(gain: float, force: Callable[..., np.ndarray] = sound) -> Diagnosis:
    """Three recordings, of which the second shows so many times the force."""
    tests: list[Recording] = [recorded(seed, 1e3 * seed, force) for seed in (1, 2, 3)]
    tests[1] = replace(tests[1], F=gain * tests[1].F)
    return diagnose(tests, model=MODEL, parameters=NOMINAL)


@pytest.mark.parametrize("gain", [1.25, 0.9])
def test_is_named_with_its_size(gain: float) -> None:
    found = asked(gain)
    assert found.verdict == "sensor_fault"
    [finding] = found.findings
    assert finding.effect == "force_range"
    assert "in rig_2 only" in finding.where.text
    share = finding.parameters["share"]
    assert share.value == pytest.approx(1 / gain - 1, abs=4 * share.stderr)  # four standard errors


def test_the_free_run_is_driven_by_the_force_on_the_structure() -> None:
    before, after = asked(1.25).errors[1].free_run
    assert before is not None
    assert after is not None
    assert after < 0.5 * before


def test_is_found_beside_missing_physics() -> None:
    found = asked(1.25, lambda t, x, v: CUBIC * x**3)
    assert {finding.effect for finding in found.findings} == {"force_range", "cubic_stiffness"}


def test_is_none_where_all_ranges_agree() -> None:
    assert asked(1.0).verdict in ("consistent", "recalibrated")


def test_a_zero_that_is_off_in_one_recording_is_no_high_pass() -> None:
    """A corner at 0 Hz, and a force lost before the recording, was an AC-coupled channel at 100 %."""
    tests = [recorded(seed, 1e3 * seed, sound) for seed in (1, 2, 3)]
    tests[1] = replace(tests[1], F=tests[1].F + 0.3 * np.std(tests[1].F))
    found = diagnose(tests, model=MODEL, parameters=NOMINAL)
    assert "force_high_pass" not in {name for finding in found.findings for name in finding.alike}


@pytest.mark.parametrize("channel", ["x", "v", "a"])
def test_a_channel_of_motion_is_set_right_in_its_recording(channel: str) -> None:
    """Two channels agree, and the third does not: an acceleration of another range was added mass."""
    tests = [recorded(seed, 1e3 * seed, sound) for seed in (1, 2, 3)]
    tests[1] = replace(tests[1], **{channel: 1.2 * getattr(tests[1], channel)})
    found = diagnose(tests, model=MODEL, parameters=NOMINAL)
    assert found.verdict in ("consistent", "recalibrated")
    assert any(note.startswith(f"rig_2: channel {channel} reads 1.2") for note in found.notes)


def test_a_channel_that_shows_its_noise_alone_has_no_gain() -> None:
    """Of a free decay a force channel shows nothing: with 0.07 times its noise it left less, and was wrong at 98 %."""
    shaken, other = recorded(1, 1e3, sound), recorded(2, 2e3, sound)
    noise = 0.01 * np.std(shaken.F) * np.random.default_rng(3).standard_normal(len(other))
    forms = [
        [effect.form for effect in ranges(prepare_parts([shaken, test]))] for test in (other, replace(other, F=noise))
    ]
    assert forms == [["1", "2"], ["1"]]


def test_without_inertia_it_may_be_the_structure() -> None:
    """In slow tests a gain of the force, and a spring and a damper that grew alike, are the same."""
    tests = []
    for seed, gain in ((1, 1.0), (2, 1.25), (3, 1.0)):
        rng, t = np.random.default_rng(seed), np.arange(6000) / 200.0
        waves = [(0.3, 4e-3), (0.7, 2e-3), (1.1, 1e-3)]
        phases = rng.uniform(0, 2 * np.pi, 3)
        x = sum(size * np.sin(2 * np.pi * f * t + p) for (f, size), p in zip(waves, phases, strict=True))
        told = {"F": gain * (5e4 * x + 1e4 * np.gradient(x, t)), "x": x}
        noisy = {name: u + 0.01 * np.std(u) * rng.standard_normal(len(t)) for name, u in told.items()}
        tests.append(Recording(f"slow_{seed}", t, **noisy))
    found = diagnose(tests, model=MODEL, parameters={**NOMINAL, "B": 0.9e4})
    assert "force_range" not in {name for finding in found.findings for name in finding.alike}
