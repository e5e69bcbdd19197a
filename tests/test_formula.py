"""Channels that a user computed from others: by which formula, and in which recordings."""

import numpy as np
import pytest
from scipy.signal import savgol_filter

from hystid.consistency import examine
from hystid.consistency.kinematics import formula
from hystid.diagnosis.prepare.independence import measured_alike
from hystid.recording import Recording

DT, N = 1e-3, 4000


def rig(seed: int = 1, level: float = 1e-3) -> Recording:
    """A mass on a spring in two octaves; x, a and F measured."""
    rng = np.random.default_rng(seed)
    t = np.arange(N) * DT
    omega = 2 * np.pi * np.linspace(20, 90, 50)
    wave = omega[:, None] * t + rng.uniform(0, 2 * np.pi, (50, 1))
    x, v, a = (np.sum(1e-4 * omega[:, None] ** k * np.cos(wave + k * np.pi / 2), axis=0) for k in range(3))
    seen = {
        n: u + level * np.std(u) * rng.standard_normal(N) for n, u in {"x": x, "a": a, "F": a + 3 * v + 4e4 * x}.items()
    }
    return Recording(f"rig_{seed}", t, **seen)


def smoothed(test: Recording, factor: float = 1.0) -> Recording:
    """The same with v and a by Savitzky and Golay's formula from x, which halves the quickest of the motion."""
    assert test.x is not None
    v, a = (factor * savgol_filter(test.x, 15, 3, deriv=k, delta=DT) for k in (1, 2))
    return Recording(test.name, test.t, F=test.F, x=test.x, v=v, a=a)


@pytest.mark.parametrize("factor", [1.0, -1.0, 1 / 9.80665])
def test_a_formula_is_known_with_its_gain_for_slow_motion(factor: float) -> None:
    test = smoothed(rig(), factor)
    assert test.x is not None and test.a is not None
    found = formula(np.asarray(test.x), np.asarray(test.a), 2, DT)
    # 1e-3: the moments of the weights, which the noise of x determines to its own share
    assert found is not None and found.sign * found.gain == pytest.approx(factor, rel=1e-3)


def test_a_measured_channel_follows_no_formula() -> None:
    test = rig()
    assert formula(np.asarray(test.x), np.asarray(test.a), 2, DT) is None


def test_smoothing_is_no_wrong_unit_and_a_wrong_unit_still_is() -> None:
    assert not [item for item in examine([smoothed(rig())], 1.0).refusals]
    wrong = examine([smoothed(rig(), 1 / 9.80665)], 1.0).refusals
    assert wrong and all(item.slip == "wrong_unit" for item in wrong)


def test_what_was_computed_in_one_recording_was_computed_in_all() -> None:
    short = smoothed(rig(2))
    part = Recording("short", short.t[:90], **{n: getattr(short, n)[:90] for n in "Fxva"})
    alone, together = measured_alike([part])[0], measured_alike([smoothed(rig(1)), smoothed(rig(3)), part])
    assert set(alone.measured) == {"x", "v", "a"}  # too short to show it
    assert all(channels.measured == ("x",) for channels in together)
    assert "in the other recordings" in together[2].computed["a"]


def test_what_is_held_out_does_not_say_what_was_measured() -> None:
    derived, measured = [smoothed(rig(seed)) for seed in (1, 2)], [rig(seed) for seed in (3, 4, 5)]
    found = measured_alike([*derived, *measured], len(derived))
    assert all(channels.measured == ("x",) for channels in found)
    assert "in the other recordings" in found[-1].computed["a"]


@pytest.mark.parametrize(("level", "reason"), [(0.0, "to its last digit"), (1e-3, "it repeats the noise of x")])
def test_without_noise_a_channel_follows_from_another_and_repeats_none(level: float, reason: str) -> None:
    (found,) = measured_alike([smoothed(rig(level=level))])
    assert found.measured == ("x",) and found.computed["a"].endswith(reason)
