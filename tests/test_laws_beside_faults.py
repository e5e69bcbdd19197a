"""A law and a fault of the force channel, or slow noise, in the same recordings: both are told.

The motion is made of tones and the force follows from it by the balance, so that nothing is integrated.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from scipy.signal import butter, lfilter

from hystid.diagnosis import Diagnosis, diagnose
from hystid.diagnosis.prepare.given import given_parameters
from hystid.diagnosis.prepare.recordings import take
from hystid.recording import Recording

Array = np.ndarray
FS, N, MASS, DAMPING, STIFFNESS = 1000.0, 6000, 2.0, 20.0, 5e4
T = np.arange(N) / FS
LINEAR = "HystId.Oscillators.Linear"


def tones(seed: int, lowest: float = 6.0, size: float = 1e-3) -> tuple[Array, Array, Array]:
    """x, v and a of forty tones up to 45 Hz; the resonance is at 25 Hz."""
    rng = np.random.default_rng(seed)
    omega = 2 * np.pi * np.linspace(lowest, 45.0, 40)
    response = 1.0 / (STIFFNESS - MASS * omega**2 + 1j * DAMPING * omega) * np.exp(2j * np.pi * rng.random(40))
    waves = np.exp(1j * np.outer(T, omega))
    x, v, a = ((waves @ (response * (1j * omega) ** k)).real for k in range(3))
    scale = size / float(np.max(np.abs(x)))
    return x * scale, v * scale, a * scale


def balance(motion: tuple[Array, Array, Array], law: Callable[[Array, Array], Array]) -> Array:
    x, v, a = motion
    return MASS * a + DAMPING * v + STIFFNESS * x + law(x, v)


def recorded(name: str, motion: tuple[Array, Array, Array], force: Array, noise: float, seed: int) -> Recording:
    """Columns with white noise, as a share of their spread."""
    rng = np.random.default_rng(seed)
    x, v, a, F = (u + noise * np.std(u) * rng.standard_normal(N) for u in (*motion, force))
    return Recording(name, T, F=F, x=x, v=v, a=a)


def asked(*tests: Recording) -> Diagnosis:
    return diagnose(tests, model=LINEAR, parameters={"m": MASS, "B": 15.0, "Kl": 4.6e4})


def test_a_late_force_is_told_beside_a_law() -> None:
    """2.2 samples, beyond what is none; of the refit without the law nobody could tell."""

    def law(x: Array, v: Array) -> Array:
        return 4e10 * x**3

    tests = []
    for seed in (1, 2):
        motion = tones(seed)
        force = np.interp(T - 2.2 / FS, T, balance(motion, law))
        tests.append(recorded(f"late_{seed}", motion, force, 1e-4, seed))
    found = asked(*tests)
    assert {finding.effect for finding in found.findings} == {"cubic_stiffness", "channel_delay"}
    late = next(finding for finding in found.findings if finding.effect == "channel_delay")
    # Interpolation between samples leaves a thousandth of the force, and a hundredth of a sample.
    assert abs(late.parameters["samples"].value - 2.2) < 0.05


def test_a_law_is_found_beside_a_force_that_is_cut_off_before_its_noise() -> None:
    motions = [tones(seed) for seed in (1, 2)]
    forces = [balance(motion, lambda x, v: 0 * x + 8.0) for motion in motions]
    level, tests = 0.5 * float(np.max(forces)), []
    for seed, (motion, force) in enumerate(zip(motions, forces, strict=True)):
        rng = np.random.default_rng(seed)
        cut = np.clip(force, -level, level) + 1e-3 * np.std(force) * rng.standard_normal(N)
        whole = recorded(f"cut_{seed}", motion, force, 1e-3, seed)
        tests.append(Recording(whole.name, T, F=cut, x=whole.x, v=whole.v, a=whole.a))
    found = asked(*tests)
    names = {name for finding in found.findings for name in finding.alike}
    assert "sensor_saturation" in names and names & {"preload", "force_drift"}
    constant = next(f for f in found.findings if "preload" in f.alike)
    if constant.effect == "preload":  # else one per recording
        assert abs(constant.parameters["f0"].value - 8.0) < 0.05  # a thousandth of the force


def test_a_constant_force_beside_play_is_no_slow_noise() -> None:
    """Without the play, the refit leaves slow forces, of which a constant one is lost in."""
    gap = 3e-4

    def law(x: Array, v: Array) -> Array:
        return -3e4 * np.clip(x, -gap, gap) - 6.0

    tests = [recorded(f"loose_{seed}", motion := tones(seed, 9.0), balance(motion, law), 0.02, seed) for seed in (3, 4)]
    found = asked(*tests)
    names = {name for finding in found.findings for name in finding.alike}
    assert names & {"backlash", "two_sided_stop"} and names & {"preload", "force_drift"}


def test_a_force_that_a_free_decay_does_not_have_holds_no_noise() -> None:
    """It is zero but for what a solver leaves, which is louder than 16 bit of itself, and not of any force."""
    motion = tones(5)
    driven = recorded("driven", motion, balance(motion, lambda x, v: 0 * x), 0.0, 1)
    rate = np.sqrt(STIFFNESS / MASS - (0.5 * DAMPING / MASS) ** 2)
    wave = 1e-3 * np.exp((-0.5 * DAMPING / MASS + 1j * rate) * T[:3000])
    x, v, a = ((wave * (-0.5 * DAMPING / MASS + 1j * rate) ** k).real for k in range(3))
    rest = 1e-6 * np.random.default_rng(2).standard_normal(3000)
    free = Recording("free", T[:3000], F=rest, x=x, v=v, a=a)
    taken = take([driven, free], (), given_parameters({"m": MASS}))
    assert all(any("holds no noise" in note for note in test.notes) for test in taken.tests)


def low_passed(test: Recording, hertz: float) -> Recording:
    """The same with the velocity behind a filter of first order, whose delay falls with frequency."""
    assert test.v is not None
    return test.with_channels({"v": lfilter(*butter(1, hertz, fs=FS), test.v)})


@pytest.mark.parametrize("cubic", [0.0, 4e10])
def test_a_filter_that_looks_like_a_delay_makes_no_physics(cubic: float) -> None:
    """Moved back, the velocity still lacks what x and a show; without it nothing is missing but the law."""
    tests = []
    for seed in (1, 2):
        motion = tones(seed)
        force = balance(motion, lambda x, v: cubic * x**3)
        tests.append(low_passed(recorded(f"slow_{seed}", motion, force, 0.01, seed), 110.0))
    found = asked(*tests)
    laws = {"cubic_stiffness"} if cubic else set()
    assert {finding.effect for finding in found.findings} == {"channel_delay", *laws}
    assert found.verdict == ("missing_physics" if cubic else "sensor_fault")
    assert any("channel v is left out" in note for note in found.notes) == bool(cubic)  # else it leaves noise
    if cubic:  # a damping that the filter feigns bends the law by per cents
        (law,) = (finding for finding in found.findings if finding.effect == "cubic_stiffness")
        assert abs(law.parameters["k3"].value / cubic - 1) < 0.003
