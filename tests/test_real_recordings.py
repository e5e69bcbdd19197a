"""Diagnosis of measured structures: hysteresis that wears or has slack, and recordings of other laboratories."""

import json
from pathlib import Path

import numpy as np
import pytest

from hystid.diagnosis import Diagnosis, diagnose
from hystid.diagnosis.chain import seated
from hystid.recording import Recording
from hystid.recording.types import PSEUDO_TIME

DATA = Path(__file__).parents[2] / "shared" / "data"
LINEAR = "HystId.Oscillators.Linear"
measured = pytest.mark.skipif(
    not DATA.is_dir(), reason="the recordings of other laboratories are not beside this checkout"
)


def names(found: Diagnosis) -> list[str]:
    return [finding.effect for finding in found.findings]


def cycles(amplitudes: list[float], per_cycle: int = 400) -> tuple[np.ndarray, np.ndarray]:
    """Time and displacement of cycles of growing amplitude, one second each."""
    t = np.arange(per_cycle * len(amplitudes)) / per_cycle
    size = np.interp(t, np.arange(len(amplitudes)) + 0.5, amplitudes)
    return t, size * np.sin(2 * np.pi * t)


def friction(x: np.ndarray, stiffness: float, limit: float) -> np.ndarray:
    """Dahl's force along a displacement, exact from sample to sample."""
    force = np.zeros_like(x)
    for k, step in enumerate(np.diff(x)):
        end = np.sign(step) * limit
        force[k + 1] = end + (force[k] - end) * np.exp(-stiffness * abs(step) / limit)
    return force


def test_hysteresis_that_wears_is_two_effects(tmp_path: Path) -> None:
    """Friction that loses three quarters of its force with the path, beside a spring: neither is in the baseline."""
    t, x = cycles([1e-3, 2e-3, 3e-3, 4e-3, 5e-3, 5e-3, 5e-3])
    path = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(x)))])
    rng = np.random.default_rng(1)
    F = 2e4 * x + friction(x, 4e5, 100.0) * (1 - 0.75 * (1 - np.exp(-path / 0.03)))
    noisy = F + 0.01 * np.std(F) * rng.standard_normal(len(x))
    record = Recording("worn", t, F=noisy, x=x + 1e-3 * np.std(x) * rng.standard_normal(len(x)))
    found = diagnose([record], model=LINEAR, parameters={"m": 0}, out=tmp_path)
    assert set(names(found)) == {"hysteretic_friction", "cyclic_degradation"}
    before, after = found.force_nrmse
    assert after < 0.02 < 0.1 < before  # 1 % of noise
    text = (tmp_path / "extended.mo").read_text()
    assert "cyclicDegradation.h = hystereticFriction.f;" in text  # and it has compiled: there is an FMU
    assert (tmp_path / "extended.fmu").exists()


@measured
def test_reinforced_concrete_degrades() -> None:
    found = diagnose([DATA / "rc_cyclic" / "rc_column_gill.csv"], model=LINEAR, parameters={"m": 0})
    assert set(names(found)) == {"hysteretic_friction", "cyclic_degradation"}
    assert all(finding.confidence < 0.6 for finding in found.findings)  # a seventh of the force stays unexplained


@measured
def test_spring_of_limited_force_is_bilinear_with_its_break_point() -> None:
    trials = [DATA / "cyberdiver_bilinear" / f"static_10n_threshold_trial{i}.csv" for i in (1, 2, 3)]
    found = diagnose(trials[:2], model=LINEAR, parameters={"m": 0}, holdout=trials[2:])
    assert names(found) == ["bilinear_stiffness"]
    gap = found.findings[0].parameters["gap"].value  # from contact on; programmed: 10 N at 15 N/mm, 0.667 mm
    assert gap == pytest.approx(8.4 / 14.7e3, rel=0.05)  # measured plateau over measured slope
    before, after = found.holdout[0].force
    assert after < 0.15 * before
    assert json.loads(json.dumps(found.as_dict()))["findings"][0]["class"] == ["bilinear_stiffness", "contact_loss"]


@measured
def test_linear_spring_is_consistent_with_a_linear_model() -> None:
    trials = [DATA / "cyberdiver_bilinear" / f"static_15npmm_trial{i}.csv" for i in (1, 2, 3)]
    found = diagnose(trials[:2], model=LINEAR, parameters={"m": 0}, holdout=trials[2:])
    assert found.verdict in ("consistent", "recalibrated")
    assert found.refit["Kl"].value == pytest.approx(15e3, rel=0.03)
    assert any("contact" in note for note in found.notes)


def test_play_in_the_middle_of_a_test_is_no_approach() -> None:
    """Compression that lets go and comes back is a property of the structure; a start before contact is not."""
    t = np.arange(800) * 0.01
    x = -1e-3 * np.abs(np.sin(np.pi * t / 4))
    origin = {"t": PSEUDO_TIME, "x": "measured", "F": "measured"}
    twice = Recording("twice", t, F=1e4 * np.minimum(x + 1e-4, 0.0), x=x, origin=origin)
    assert seated(twice) is twice
    once = Recording("once", t[:400], F=twice.F[:400], x=x[:400], origin=origin)  # type: ignore[index]
    cut = seated(once)
    assert len(cut) < 400 and cut.x is not None and cut.F is not None
    assert np.max(np.abs(cut.F - 1e4 * cut.x)) < 1e-3 * np.max(np.abs(cut.F))
    assert seated(Recording("timed", t[:400], F=once.F, x=once.x)).x is once.x
