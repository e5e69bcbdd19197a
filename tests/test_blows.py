"""A hammer between two or three samples: what sampling leaves of a blow is no error of the data link, no noise, no law.

The rig is integrated here, in steps of a twentieth of a sample."""

from __future__ import annotations

import numpy as np
import pytest

from hystid import diagnose
from hystid.recording import Recording
from hystid.smoothing.noise import between_samples, noise_level

MASS, DAMPING, STIFFNESS = 2.0, 1.6, 3200.0  # 6.4 Hz
RATE, N, STEPS = 128.0, 3000, 20
GIVEN = {"m": MASS, "B": 2.0, "Kl": 3000.0}
LINEAR = "HystId.Oscillators.Linear"


def struck(friction: float, noise_db: float | None, channels: str, seed: int = 0) -> Recording:
    """Five blows of three samples each; friction turns over a speed of 3 mm/s."""
    rng = np.random.default_rng(seed)
    force = np.zeros(N)
    for at in range(60, N - 400, 600):
        force[at : at + 3] = rng.uniform(0.5, 1.5) * np.array([100.0, 270.0, 40.0])
    dt = 1 / RATE / STEPS
    x = v = 0.0
    motion = np.empty((3, N))

    def a(x: float, v: float, F: float) -> float:
        return (F - DAMPING * v - STIFFNESS * x - friction * float(np.tanh(v / 3e-3))) / MASS

    for i in range(N):
        motion[:, i] = x, v, a(x, v, force[i])
        step = (force[min(i + 1, N - 1)] - force[i]) / STEPS
        for k in range(STEPS):  # Heun, half a step of friction is 0.06 of its transition
            here, there = force[i] + k * step, force[i] + (k + 1) * step
            first = a(x, v, here)
            second = a(x + dt * v, v + dt * first, there)
            x, v = x + dt * (v + 0.5 * dt * first), v + 0.5 * dt * (first + second)
    columns = {"F": force, **{name: motion["xva".index(name)] for name in channels}}
    if noise_db is not None:
        columns = {k: u + np.std(u) * 10 ** (-noise_db / 20) * rng.standard_normal(N) for k, u in columns.items()}
    return Recording("hammer", np.arange(N) / RATE, **columns)


@pytest.mark.parametrize(("noise_db", "channels"), [(30.0, "xva"), (50.0, "xva"), (None, "x")])
def test_dry_friction_under_a_hammer_is_named(noise_db: float | None, channels: str) -> None:
    answer = diagnose(struck(4.0, noise_db, channels), model=LINEAR, parameters=GIVEN)
    assert not [note for note in answer.notes if "data link" in note]
    assert answer.verdict == "missing_physics", answer.headline
    (finding,) = answer.findings
    # without an acceleration, what its derivative is off at a blow makes the friction depend a little on the place
    assert {"coulomb_friction", "position_dependent_friction"} & {finding.effect, *finding.alike}
    # what is left of short blows moves it by a few per cent
    assert finding.parameters["Fc"].value == pytest.approx(4.0, rel=0.1)


@pytest.mark.parametrize(("noise_db", "channels"), [(30.0, "xva"), (60.0, "a"), (None, "x"), (None, "a")])
def test_a_sound_rig_under_a_hammer_is_calm(noise_db: float | None, channels: str) -> None:
    answer = diagnose(struck(0.0, noise_db, channels), model=LINEAR, parameters=GIVEN)
    assert answer.verdict in ("consistent", "recalibrated"), answer.headline


def test_only_shocks_are_unsure_between_samples() -> None:
    rng = np.random.default_rng(1)
    t = np.arange(4000) / 1000
    wave = np.sin(2 * np.pi * 9 * t) + 1e-3 * rng.standard_normal(4000)
    assert not np.any(between_samples(wave))
    wave[2000:2003] += [2.0, 5.0, 1.0]
    unsure = np.flatnonzero(between_samples(wave))
    assert unsure.min() >= 1990 and unsure.max() <= 2012  # six differences on either side
    assert noise_level(wave) == pytest.approx(1e-3, rel=0.1)
