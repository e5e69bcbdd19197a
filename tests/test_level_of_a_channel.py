"""A channel that stops at a level, against what the other channels say of it."""

import numpy as np

from hystid.diagnosis.prepare.clipping import level_of

ERROR = 0.003  # of what the others say, of a motion of 1
T = np.arange(4000) / 1000.0
BLOW = np.exp(-T) * np.sin(2 * np.pi * 4.0 * T)  # dies away: each excursion is another one


def _read(noise: float, top: float) -> np.ndarray:
    return np.clip(BLOW, -top, top) + noise * np.random.default_rng(1).standard_normal(len(T))


def test_a_few_excursions_of_different_depths_tell_a_level() -> None:
    """Six of them: their depths differ too much for Student, but all lack, and none follows."""
    told = BLOW + ERROR * np.random.default_rng(2).standard_normal(len(T))
    found = level_of([_read(1e-4, 0.5)], [told], ERROR)
    assert found is not None
    assert abs(found[0] - 0.5) < 1e-3  # three standard deviations of the noise on the level


def test_three_excursions_that_stay_at_one_level_tell_it() -> None:
    """Too few for their signs, and for Student; what is lacking differs between them 100 times as much as where the
    channel stays."""
    told = BLOW + ERROR * np.random.default_rng(2).standard_normal(len(T))
    found = level_of([_read(1e-4, 0.7)], [told], ERROR)
    assert found is not None
    assert abs(found[0] - 0.7) < 1e-3  # three standard deviations of the noise on the level
    wavers = np.where(np.abs(BLOW) > 0.7, 0.05 * np.sin(2 * np.pi * 1.3 * T), 0.0)  # by half of what it lacks
    assert level_of([_read(1e-4, 0.7) - np.sign(BLOW) * wavers], [told], ERROR) is None


def test_a_channel_that_follows_has_no_level() -> None:
    """Beyond its own largest value there is only what is told wrong."""
    for seed in range(5):
        told = 1.02 * BLOW + ERROR * np.random.default_rng(seed).standard_normal(len(T))
        assert level_of([_read(1e-4, 1.0)], [told], ERROR) is None
