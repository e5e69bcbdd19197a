"""A user integrates a noise-free acceleration and cuts what is slow: x has lost it, and no noise says so."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import cumulative_trapezoid
from scipy.signal import butter, sosfilt, sosfiltfilt

from hystid import build, diagnose, simulate
from hystid.compiled import CompiledModel
from hystid.modelica import compile_model
from hystid.recording import Recording

RIG = "HystId.Oscillators.Jenkins"  # 1 kg; 28 Hz while it sticks
LINEAR = "HystId.Oscillators.Linear"
GIVEN = {"m": 1.0, "B": 12.0, "Kl": 1.1e4, "Ks": 2.2e4, "fc": 9.0}


def integrated(recording: Recording, corner: float, *, both: bool = False) -> Recording:
    """With v and x from a, behind a high-pass of second order [Hz] each, run one way or both."""
    cut = butter(2, 2 * corner * recording.dt, "high", output="sos")
    passed = sosfiltfilt if both else sosfilt

    def integral(values: np.ndarray) -> np.ndarray:
        return np.asarray(passed(cut, cumulative_trapezoid(values, dx=recording.dt, initial=0.0)))

    v = integral(recording.channel("a"))
    return replace(recording, v=v, x=integral(v))


@pytest.fixture(scope="module")
def tests(tmp_path_factory: pytest.TempPathFactory) -> list[Recording]:
    rig = build(RIG, tmp_path_factory.mktemp("rig") / "rig.fmu")
    forces = ("multisine:2-80Hz@20Nrms,2s", "chirp:2-60Hz@25N,2s")
    return [simulate(rig, force, dt=4e-4, parameters={"Ks": 2e4, "fc": 8.0, "Kl": 1e4}) for force in forces]


@pytest.mark.parametrize(
    ("corner", "told"),
    [
        # next to no slow motion is lost: a filter of second order turns the phase as one of first order, by root 2 more
        (0.5, [f"channel {c} leads as an AC-coupled sensor does" for c in "xv"]),
        (3.0, ["channel x is left out, as x loses motion below", "channel v is left out, as v loses motion below"]),
    ],
)
def test_a_displacement_that_lost_its_slow_motion_is_no_physics(
    tests: list[Recording], corner: float, told: list[str]
) -> None:
    answer = diagnose([integrated(test, corner) for test in tests], model=RIG, parameters=GIVEN)
    assert answer.verdict in ("consistent", "recalibrated"), answer.headline
    for sentence in told:
        assert any(sentence in note and "left out" in note for note in answer.notes), answer.notes


def test_a_filter_run_both_ways_turns_no_phase_and_a_alone_leaves_nothing(tests: list[Recording]) -> None:
    answer = diagnose([integrated(test, 2.0, both=True) for test in tests], model=RIG, parameters=GIVEN)
    assert answer.verdict in ("consistent", "recalibrated"), answer.headline
    assert any("x and v are left out" in note for note in answer.notes), answer.notes


def without_x(force: str, names: str, noise: dict[str, float], seed: int) -> Recording:
    """A sound rig of 8 Hz and 0.6 % of damping, at rest before: two tones and their sidebands, or an earthquake.

    noise: standard deviations over those of the channels.
    """
    rng, dt = np.random.default_rng(seed), 2e-3
    t = np.arange(5000) * dt
    F = np.sin(2 * np.pi * 10.5 * t) * (1 + 0.7 * np.sin(2 * np.pi * 0.4 * t))
    if force == "earthquake":
        waves = zip(rng.uniform(0.8, 9, 60), rng.uniform(0, 6, 60), strict=True)
        F = np.sum([np.sin(2 * np.pi * f * t + phase) for f, phase in waves], axis=0) * t * np.exp(-t / 1.2)
    rig = CompiledModel(compile_model(LINEAR))
    given = {"m": 2.0, "B": 1.2, "Kl": 5000.0}
    exact = {"F": F, **rig.simulate({"F": F}, dt, parameters=given, outputs=("v", "a"), interpolation="cubic")}
    noisy = {n: exact[n] + noise[n] * np.std(exact[n]) * rng.standard_normal(len(t)) for n in ["F", *names]}
    return Recording(force, t, **noisy)


@pytest.mark.parametrize(
    ("force", "names", "noise", "seed"),
    [
        ("tones", "v", {"F": 3e-3, "v": 2e-3}, 2),
        ("tones", "v", {"F": 3e-4, "v": 5e-2}, 1),
        ("tones", "a", {"F": 3e-3, "a": 2e-2}, 1),
        ("tones", "va", {"F": 3e-3, "v": 2e-3, "a": 1e-2}, 2),
        ("earthquake", "va", {"F": 3e-3, "v": 2e-3, "a": 1e-2}, 1),
    ],
)
def test_a_sound_rig_without_x_is_sound(force: str, names: str, noise: dict[str, float], seed: int) -> None:
    """Free vibration after the start shares nothing with the force, and is motion; what the ends of a recording do to
    an integral, or to the noise of a derivative, is no physics."""
    given = {"m": 2.0, "B": 1.8, "Kl": 5900.0}
    found = diagnose(without_x(force, names, noise, seed), model=LINEAR, parameters=given)
    assert found.findings == () and found.verdict == "recalibrated"
