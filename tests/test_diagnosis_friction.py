"""Dry friction in slow motion: when it is told from a damper, and when it is said to fall with speed."""

import numpy as np
import pytest

from hystid.diagnosis import diagnose
from hystid.numeric import Array
from hystid.recording import Recording

FASTEST = 0.018  # m/s, about


def moved_by_hand(seed: int, law: str) -> Recording:
    """A linear rig with a friction of 2 N or so, in noise of 34 dB."""
    rng, dt = np.random.default_rng(seed), 1 / 400
    t = dt * np.arange(4000)
    x = np.zeros(len(t))
    for frequency in rng.uniform(0.3, 1.6, 6):
        x += 1e-3 * rng.normal() * np.sin(2 * np.pi * frequency * t + rng.uniform(0, 2 * np.pi))
    v = np.gradient(x, dt)
    a = np.gradient(v, dt)
    friction: Array = 2.0 * np.tanh(v / (0.5 * FASTEST)) if law == "turns" else np.arcsinh(8 * v / FASTEST)
    clean = {"F": a + 8 * v + 4000 * x + friction, "x": x, "v": v, "a": a}
    return Recording("by_hand", t, **{k: u + 0.02 * np.std(u) * rng.standard_normal(len(u)) for k, u in clean.items()})


def names(law: str, seed: int) -> list[str]:
    given = {"m": 1.0, "B": 8.0, "Kl": 4100.0}
    pair = [moved_by_hand(seed, law), moved_by_hand(seed + 100, law)]
    return [finding.effect for finding in diagnose(pair, model="HystId.Oscillators.Linear", parameters=given).findings]


@pytest.mark.parametrize("seed", [0, 2])
def test_friction_that_turns_slowly_is_friction(seed: int) -> None:
    """Its sign turns within a third of the largest speed; at that speed it grows no more, as a damper would."""
    assert names("turns", seed) == ["coulomb_friction"]


@pytest.mark.parametrize("seed", [0, 1])
def test_friction_that_grows_with_speed_is_not_said_to_fall(seed: int) -> None:
    """It grows all along, with a slope that falls. An additional force at speeds at which the sign has not turned yet
    makes the curve of falling friction the same, but it does not fall there."""
    assert names("grows", seed) == ["coulomb_friction"]
