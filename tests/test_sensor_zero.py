"""The zero of a sensor beside physics that is missing."""

import re
from dataclasses import replace

import numpy as np
import pytest

from hystid.diagnosis import diagnose
from hystid.diagnosis.model.channel_effects import force_drifts
from hystid.diagnosis.prepare.segments import prepare_part
from hystid.recording import Recording
from tests.test_diagnosis_windows import MODEL, NOMINAL, STIFFNESS, motion, recorded

LEVELS = (60.0, 45.0, 30.0)
GAP = 0.3 * float(np.max(motion(1, LEVELS[0])[1]))


def _beyond_a_gap(t: np.ndarray, x: np.ndarray, v: np.ndarray) -> np.ndarray:
    return 0.5 * STIFFNESS * np.sign(x) * np.maximum(np.abs(x) - GAP, 0.0)


def _friction(t: np.ndarray, x: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Friction that falls with speed (Tustin), some tenths of the elastic force."""
    least, slow = 0.15 * STIFFNESS * GAP, 0.2 * float(np.max(np.abs(v)))
    return (least + least * np.exp(-np.abs(v) / slow)) * np.tanh(v / (0.01 * slow))


def test_a_zero_of_x_in_each_recording_hides_no_friction() -> None:
    """Many samples show how a constant of each recording differs, and no law of the structure does so."""
    tests = [recorded(seed, level, _friction, noise=0.002) for seed, level in enumerate(LEVELS, 1)]
    tests = [replace(t, x=t.x + side * 0.03 * np.std(t.x)) for t, side in zip(tests, (1, -1, 1), strict=True)]
    found = diagnose(tests, model=MODEL, parameters=NOMINAL)
    assert "stribeck_friction" in {finding.effect for finding in found.findings}
    assert {finding.effect for finding in found.findings} <= {"stribeck_friction", "preload", "force_drift"}


def test_a_zero_of_x_in_each_recording_hides_no_law() -> None:
    """A displacement that is off its zero by 3 % of its spread, elsewhere in each recording, is what sensors do."""
    tests = [recorded(seed, level, _beyond_a_gap, noise=0.002) for seed, level in enumerate(LEVELS, 1)]
    tests = [replace(t, x=t.x + side * 0.03 * np.std(t.x)) for t, side in zip(tests, (1, -1, 1), strict=True)]
    found = diagnose(tests, model=MODEL, parameters=NOMINAL)
    assert found.verdict == "missing_physics"
    leading = next(finding for finding in found.findings if finding.effect in ("two_sided_stop", "backlash"))
    assert leading.confidence > 0.5
    assert {finding.effect for finding in found.findings} - {leading.effect} <= {"preload", "force_drift"}


def _cubic(t: np.ndarray, x: np.ndarray, v: np.ndarray) -> np.ndarray:
    """A spring that hardens: a tenth of the elastic force at the ends of the loudest motion."""
    return 0.1 * STIFFNESS * x**3 / (GAP / 0.3) ** 2


def test_a_zero_of_x_makes_no_second_law_of_a_spring_that_hardens() -> None:
    """Measured off its zero, a cubic spring has a square part as well, and is one law all the same."""
    tests = [recorded(seed, level, _cubic, noise=0.002) for seed, level in enumerate(LEVELS, 1)]
    tests = [replace(t, x=t.x + side * 0.03 * np.std(t.x)) for t, side in zip(tests, (1, -1, 1), strict=True)]
    found = diagnose(tests, model=MODEL, parameters=NOMINAL)
    (finding,) = found.findings
    assert finding.effect == "cubic_stiffness"
    (said,) = (note for note in found.notes if "off its zero" in note)
    shares = [float(share) for share in re.findall(r"\(([\d.]+) % of its standard deviation\)", said)]
    # The force of a spring at its zero is known to a few thousandths of its largest one.
    assert shares == pytest.approx([3.0, 3.0, 3.0], abs=0.3)


def _square(t: np.ndarray, x: np.ndarray, v: np.ndarray) -> np.ndarray:
    """A spring that differs by side: a seventh of the elastic force at the ends of the loudest motion."""
    return 0.15 * STIFFNESS * x**2 / (GAP / 0.3)


@pytest.mark.parametrize("seed", [20, 50])
def test_a_constant_of_each_recording_is_no_drift_and_no_charge_that_is_lost(seed: int) -> None:
    """A drift that does not run, and a corner far below one over the time of a recording, are constants as well."""
    tests = [recorded(seed + number, level, _square, noise=0.002) for number, level in enumerate(LEVELS[:2], 1)]
    size = float(np.std(tests[0].F))
    tests = [replace(t, F=t.F + share * size) for t, share in zip(tests, (0.03, 0.02), strict=True)]
    found = diagnose(tests, model=MODEL, parameters=NOMINAL)
    assert [finding.effect for finding in found.findings] == ["quadratic_stiffness"]


def test_a_constant_of_each_recording_needs_no_clock_and_is_no_other_of_one() -> None:
    """Of a single recording it is a constant force, which the library has already."""
    t = np.arange(400) * 1e-2
    slow, quick = (prepare_part(Recording("r", t, F=np.sin(w * t), x=np.sin(w * t))) for w in (3.0, 30.0))
    assert [drift.form for drift in force_drifts([slow])] == ["", "Bowed"]
    assert [drift.needs_clock for drift in force_drifts([slow] * 3)] == [False, True, True]
    wandering = [drift for drift in force_drifts([slow, quick][1:] * 2) if drift.form.startswith("Wandering")]
    assert [len(drift.amplitudes) for drift in wandering] == [2 * 6, 2 * 12]  # of 19 periods
    assert force_drifts([slow, quick])[-1].form == "Bowed"  # the slowest motion of all recordings counts
    still = replace(quick, rest=np.arange(len(t)) > 0.4 * len(t))  # what polynomials do there no fit sees
    assert [drift.form for drift in force_drifts([still])] == ["", "Bowed"]
    blind = replace(quick, lowest=7 * np.pi / t[-1])  # six bends in the time are slower than all that is seen
    assert [drift.form for drift in force_drifts([blind])] == ["Wandering12"]


def test_a_drift_of_x_is_not_blamed_on_the_force_alone() -> None:
    """What a spring holds does not tell which of the two sensors drifts."""
    tests = [recorded(seed, level, lambda t, x, v: 0 * t, noise=0.002) for seed, level in enumerate(LEVELS, 1)]
    warmer = [0.5 * float(np.std(t.x)) * (1 - np.exp(-3 * t.t / t.t[-1])) for t in tests]
    tests = [replace(t, x=t.x + slow) for t, slow in zip(tests, warmer, strict=True)]
    found = diagnose(tests, model=MODEL, parameters=NOMINAL)
    (finding,) = found.findings
    assert finding.effect == "force_drift" and "displacement" in finding.title
    (told,) = re.findall(r"one of the displacement sensor, by up to ([0-9.]+) mm", " ".join(found.notes))
    # A bow is no exponential: the two differ by a few per cent at the ends.
    assert float(told) == pytest.approx(1e3 * max(map(np.max, warmer)), rel=0.1)


def test_a_zero_of_x_takes_the_place_of_no_likelier_law() -> None:
    """A plainer friction leaves no more than noise as well, and is less likely: zeros of x have nothing to mend. The
    force has fallen at a hundredth of the peak speed, which few samples show; noise is as loud in all recordings."""
    loudest = recorded(1, 60.0, lambda t, x, v: np.zeros(len(t)), noise=0.0)
    loud = {name: float(np.std(values)) for name, values in loudest.channels("xvaF").items()}
    fastest = float(np.max(np.abs(loudest.channel("v"))))

    def force(t: np.ndarray, x: np.ndarray, v: np.ndarray) -> np.ndarray:
        return loud["F"] * (0.05 + 0.07 * np.exp(-np.abs(v) / (0.01 * fastest))) * np.sign(v)

    tests = []
    for seed, level in enumerate((60.0, 30.0, 18.0), 1):
        sound, rng = recorded(seed, level, force, noise=0.0), np.random.default_rng(seed + 1000)
        noisy = {n: sound.channel(n) + 0.01 * size * rng.standard_normal(len(sound)) for n, size in loud.items()}
        tests.append(replace(sound, **{**noisy, "v": None}))
    found = diagnose(tests, model=MODEL, parameters=NOMINAL)
    assert not any("off its zero" in note for note in found.notes)
    assert {finding.effect for finding in found.findings} <= {"stribeck_friction", "coulomb_friction"}
