"""A channel that stops at a level, against what the other channels say of it."""

from pathlib import Path

import numpy as np
import pytest

from hystid.diagnosis.prepare.clipping import level_of, saturated_motion
from hystid.recording import Recording, read
from tests.test_colour import noise as coloured

DATA = Path(__file__).parents[2] / "shared" / "data"
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


@pytest.mark.parametrize(("pink", "top", "stops"), [(0.1, 1.0, False), (0.3, 1.0, False), (0.03, 0.7, True)])
def test_noise_of_another_colour_is_no_level(pink: float, top: float, stops: bool) -> None:
    """1/f noise of 20 dB in x and v: what x says of v where v is near its top is known less well than by white noise,
    and where v stops at 0.7 of its top it lacks more than that."""
    for seed in (1, 8, 11):
        rng, t = np.random.default_rng(seed), np.arange(6000) * 5e-4
        tones = [(2 * np.pi * rng.uniform(*band), rng.uniform(0, 6)) for band in ((8, 20), (20, 40))]
        x, v = (sum(np.sin(w * t + p + k * np.pi / 2) * w ** (k - 1) for w, p in tones) for k in (0, 1))
        v = np.clip(v, -top * np.max(np.abs(v)), top * np.max(np.abs(v)))
        x, v = (u + 0.1 * np.std(u) * coloured(rng, pink) for u in (x, v))
        found = saturated_motion([Recording("test", t, F=v, x=x, v=v)])
        assert (found is not None and found.channel == "v") == stops


@pytest.mark.skipif(not DATA.is_dir(), reason="the recordings of other laboratories are not beside this checkout")
def test_a_channel_goes_no_further_than_where_it_stops() -> None:
    """The speed that a servo estimates lags behind its motion, and is up to 28 % beyond what looked like a level."""
    servo = read(DATA / "servo_pendulum_bam" / "xl330_up_and_down_kp200.csv")
    assert saturated_motion([servo]) is None
