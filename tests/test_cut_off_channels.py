"""Channels that stop at a level: what that takes from their size, and that the door knows it for no slip of a unit."""

import numpy as np
import pytest
from numpy.typing import NDArray

from hystid import check
from hystid.consistency.cut_off import kept_size, level
from hystid.recording import Recording

Array = NDArray[np.float64]
N, DT = 8000, 1e-3


def test_a_sine_that_is_cut_off_keeps_what_its_first_harmonic_keeps() -> None:
    t = np.arange(N) * DT
    sine = np.sin(2 * np.pi * 5 * t)
    for top in (0.9, 0.6, 0.3):
        cut = np.clip(sine, -top, top)
        harmonic = 2 * float(np.mean(cut * sine))  # of a sine of amplitude 1
        # 0.01: shares are counted in whole samples, 200 to a period
        assert kept_size(cut) == pytest.approx(harmonic, abs=0.01)


def test_rest_before_and_after_the_motion_is_no_level() -> None:
    t = np.arange(N) * DT
    stroke = np.concatenate([np.full(300, -1.0), -np.cos(2 * np.pi * 0.5 * t[:4000]), np.full(300, -1.0)])
    assert level([stroke]) is None
    assert level([np.zeros(100)]) is None


@pytest.mark.parametrize("noise", [1e-4, 1e-3])
def test_what_is_cut_off_in_front_of_its_noise_keeps_as_much(noise: float) -> None:
    """An amplifier clips, and the recorder adds the noise: no value comes twice."""
    rng, t = np.random.default_rng(4), np.arange(N) * DT
    for period in (10, 37.3, 200):  # samples
        sine = np.sin(2 * np.pi * np.arange(N) / period)
        assert kept_size(sine + noise * rng.standard_normal(N)) == 1.0
    sine = np.sin(2 * np.pi * 5 * t)
    cut = np.clip(sine, -0.6, 0.6)
    # 0.03: of the samples beside the level, those within eight standard deviations of the noise count for it
    assert kept_size(cut + noise * rng.standard_normal(N)) == pytest.approx(2 * float(np.mean(cut * sine)), abs=0.03)


@pytest.mark.parametrize("noise", [0.01, 0.02])
@pytest.mark.parametrize("period", [10.3, 37.3, 200.0])  # samples
def test_a_level_is_seen_through_loud_noise(period: float, noise: float) -> None:
    """A wave that is cut off at half its size, with noise of 29 dB, keeps 0.61 of it (Gelb and Vander Velde); with the
    share of the samples beside the level that count for it, half as much is lost again, and no more."""
    rng = np.random.default_rng(4)
    wave = np.sin(2 * np.pi * np.arange(N) / period)
    drawn = noise * rng.standard_normal(N)
    assert kept_size(wave + drawn) == 1.0
    assert 0.4 < kept_size(np.clip(wave, -0.5, 0.5) + drawn) < 0.62


@pytest.mark.parametrize("behind", [False, True])
@pytest.mark.parametrize("top", [0.9, 0.56, 0.25])
def test_a_displacement_that_is_cut_off_is_no_wrong_unit(top: float, behind: bool) -> None:
    # Steady motion of a few lines; a, v and F are whole, and x ends at a share of its peak, behind its noise or before.
    rng = np.random.default_rng(3)
    t = np.arange(N) * DT
    omega, phase = 2 * np.pi * rng.uniform(5, 11, 8), rng.uniform(0, 2 * np.pi, 8)
    x, v, a = (
        1e-3 * np.sum(omega[:, None] ** k * np.cos(omega[:, None] * t + phase[:, None] + k * np.pi / 2), axis=0)
        for k in range(3)
    )
    F = 2.0 * a + 5.0 * v + 5e3 * x
    noisy = {name: u + 1e-3 * np.std(u) * rng.standard_normal(N) for name, u in zip("Fxva", (F, x, v, a), strict=True)}
    limit = top * float(np.max(np.abs(x)))
    stopped = np.clip(noisy["x"], -limit, limit) if behind else np.clip(x, -limit, limit) + noisy["x"] - x
    cut = Recording("cut", t, **{**noisy, "x": stopped})
    assert not [str(f) for f in check(cut, mass=2.0, accept=("clipped",)).findings]


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_displacement_that_is_cut_off_is_no_wrong_sign_of_a_force(seed: int) -> None:
    """Far below the resonance a force that the displacement no longer shows follows minus the acceleration."""
    rng, t = np.random.default_rng(seed), np.arange(N) * DT
    tones, phases = rng.uniform(2, 12, 12)[:, None], rng.uniform(0, 6, 12)[:, None]
    omega = 2 * np.pi * tones
    swings = rng.uniform(0.3, 1.0, 12)[:, None] * np.exp(1j * (omega * t + phases))
    x, v, a = (1e-3 * np.sum((1j * omega) ** order * swings, axis=0).imag for order in range(3))
    force = 10.0 * a + 200.0 * v + 1.4e6 * x
    noisy = {c: y + 1e-3 * np.std(y) * rng.standard_normal(N) for c, y in (("F", force), ("v", v), ("a", a))}
    test = Recording("stiff", t, x=np.clip(x, -0.5 * np.std(x), 0.5 * np.std(x)), **noisy)
    assert not [f for f in check(test).findings if f.slip == "swapped_sign"]
