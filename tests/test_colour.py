"""Noise that grows towards low frequencies is measured below the motion, and whitened away."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from hystid.diagnosis import diagnose
from hystid.diagnosis.fit.case import Case, noise_beside, pose
from hystid.diagnosis.fit.colour import _above_all, _fitted, _seen, coloured_alike, fainter
from hystid.diagnosis.fit.refit import refit_again
from hystid.diagnosis.prepare.given import given_parameters
from hystid.diagnosis.prepare.recordings import take
from hystid.diagnosis.prepare.whitening import colouring
from hystid.recording import Recording

Array = NDArray[np.float64]
LINEAR = "HystId.Oscillators.Linear"
GIVEN = {"m": 1.0, "B": 2.0, "Kl": 3e4}
N, DT = 6000, 1e-3


def noise(rng: np.random.Generator, pink: float, n: int = N) -> Array:
    """White noise of standard deviation 1 with pink / f [cycles per sample] over its power density."""
    frequency = np.maximum(np.fft.rfftfreq(n), 1 / n)
    spectrum = np.fft.rfft(rng.standard_normal(n)) * np.sqrt(1 + pink / frequency)
    return np.asarray(np.fft.irfft(spectrum, n))


def rig(seed: int, pink: float, *, cubic: float = 0.0, square: float = 0.0, level: float = 0.02) -> Recording:
    """Two octaves about 30 Hz on a spring, every channel with the same noise."""
    rng = np.random.default_rng(seed)
    t = np.arange(N) * DT
    omega, phase = 2 * np.pi * np.linspace(15, 60, 40), rng.uniform(0, 2 * np.pi, 40)
    x, v, a = (
        1e-4 * np.sum(omega[:, None] ** k * np.cos(omega[:, None] * t + phase[:, None] + k * np.pi / 2), axis=0)
        for k in range(3)
    )
    F = 1.0 * a + 2.0 * v + 3e4 * x + cubic * x**3 + square * x**2
    seen = {name: u + level * np.std(u) * noise(rng, pink) for name, u in {"F": F, "x": x, "v": v, "a": a}.items()}
    return Recording(f"rig_{seed}", t, **seen)


def posed(*recordings: Recording) -> Case:
    return pose(take(list(recordings), [], given_parameters(GIVEN)), LINEAR)


def test_white_noise_has_no_colour() -> None:
    for seed in (1, 2, 3):
        assert posed(rig(seed, 0.0)).problem.parts[0].colour == (0.0, 0.0)


def test_the_colour_of_noise_is_measured_and_the_refit_leaves_its_floor() -> None:
    case = posed(rig(1, 0.05), rig(2, 0.05))
    pink, red = case.problem.parts[0].colour
    # about 80 lines below 7.5 Hz in two recordings: their mean scatters by a tenth; 1/f^2 may stand for a part of 1/f
    at = 5 * DT
    assert pink / at + red / at**2 == pytest.approx(0.05 / at, rel=0.5)
    # 0.12: the floor rests on a noise level that holds a part of the 1/f noise, here a tenth
    assert case.refit.chi2 == pytest.approx(case.problem.floor(case.refit), abs=0.12)


@pytest.mark.parametrize("first", [0, 10, 20])
def test_faint_colour_is_measured_where_the_noise_above_the_motion_does_not_show_it(first: int) -> None:
    pink, red = posed(*[rig(first + k, 0.01) for k in range(3)]).problem.parts[0].colour
    # As above; at the upper end of the motion it adds a tenth to the noise, no more than that is known there.
    at = 5 * DT
    assert pink / at + red / at**2 == pytest.approx(0.01 / at, rel=0.5)


@pytest.mark.parametrize("most", [np.inf, 0.5])
@pytest.mark.parametrize("steep", [1.0, 2.0, 3.0])
def test_a_zero_that_wanders_adds_no_more_than_1_f_noise_where_the_motion_is(steep: float, most: float) -> None:
    """However steep the spectrum below the motion is: slow forces that no law explains yet are steep."""
    frequency, lowest = np.arange(3, 60) / 6000, 0.015
    power = 1 + 40 * (frequency[0] / frequency) ** steep * np.random.default_rng(3).exponential(size=len(frequency))
    pink, red = _fitted(frequency, power, np.full_like(frequency, DT), most, lowest)
    assert 0 < pink <= most
    assert 0 <= red * DT / lowest**2 <= pink / lowest * (1 + 1e-9)


def test_colour_is_read_above_the_motion_without_a_bias() -> None:
    """There the spring takes from the noise of inertia, the more the nearer to the motion: as a slope the other way."""
    found = []
    for first in range(0, 60, 10):
        case = posed(*[rig(first + k, 0.03) for k in range(3)])
        white = case.problem.of(fainter(case.problem.parts, case.problem.parts, 0.0))
        found.append(_above_all(_seen(white, refit_again(white, [case.refit])[0]))[0])
    # The mean of six scatters by 0.0035; it was 0.010 too small.
    assert np.mean(found) == pytest.approx(0.03, abs=0.0065)


def test_noise_levels_of_recordings_are_no_colour() -> None:
    """A recording whose motion ends later shows quicker noise alone; that it is quieter there is no slope."""
    case = posed(rig(1, 0.02), rig(2, 0.02))
    one, other = _seen(case.problem, case.refit)
    later = replace(other, part=replace(other.part, v=np.gradient(np.sin(0.6 * np.arange(N)))))
    quieter = replace(later, residual=0.3 * later.residual)
    assert _above_all([one, quieter]) == pytest.approx(_above_all([one, later]))


def test_the_mean_of_1_f_noise_is_as_little_known_as_its_zero_is_old() -> None:
    """Ten seconds of noise that has gone on for an hour."""
    rng, n, dt, pink = np.random.default_rng(5), 500, 0.02, 0.02
    part = posed(rig(1, 0.0)).problem.parts[0]
    part = replace(part, t=np.arange(n) * dt, dt=dt, colour=(pink, 0.0), since=3600.0)
    hours = [noise(rng, pink, int(3600 / dt)) for _ in range(60)]
    means = np.array([(one - np.mean(one)).reshape(-1, n).mean(axis=1) for one in hours])
    # The slowest of its lines scatter most: of 60 hours the variance of a mean is known to a twentieth.
    assert colouring(part)[0] ** -2 == pytest.approx(n * np.mean(means**2), rel=0.15)


@pytest.mark.parametrize("pink", [0.0, 0.05])
def test_coloured_noise_neither_alarms_nor_hides_a_law(pink: float) -> None:
    quiet = diagnose([rig(4, pink), rig(5, pink)], model=LINEAR, parameters=GIVEN)
    assert quiet.verdict in ("consistent", "recalibrated")
    found = diagnose([rig(6, pink, cubic=1e10), rig(7, pink, cubic=1e10)], model=LINEAR, parameters=GIVEN)
    assert [finding.effect for finding in found.findings] == ["cubic_stiffness"]


def test_a_force_that_rectifies_is_no_noise() -> None:
    """A spring that differs by side makes slow forces of its own; they follow the state and are taken out first."""
    case = posed(rig(8, 0.0, square=2e7), rig(9, 0.0, square=2e7))
    pink, red = case.problem.parts[0].colour
    assert pink / 0.005 + red / 0.005**2 < 1.0


def test_noise_that_is_louder_than_what_a_law_leaves_is_measured_anew() -> None:
    """Slow physics may be taken for noise; beside the law that explains it the noise is what it was."""
    case = posed(rig(1, 0.0), rig(2, 0.0))
    assert noise_beside(case, case.refit) is None
    loud = case.problem.of(coloured_alike(case.problem.parts, [replace(case.problem.parts[0], colour=(1.0, 0.0))]))
    (law, *_), floor = refit_again(loud, [case.refit]), case.problem.floor(case.refit)
    again = noise_beside(replace(case, problem=loud), law)
    assert again is not None and again.problem.parts[0].colour == (0.0, 0.0)
    # the draws of the noise are filtered there and back, but for what their ends lose: rounding of single precision
    assert again.problem.floor(again.refit) == pytest.approx(floor, rel=1e-3)


def test_what_is_left_out_reaches_no_other_row() -> None:
    case = posed(rig(1, 0.05))
    part = replace(case.problem.parts[0], colour=(0.05, 0.0))
    valid = np.ones(N, dtype=bool)
    valid[:15], valid[3000:3100] = False, False
    reduce = case.problem.of([replace(part, valid=valid)]).reduce
    wrong = np.where(valid, part.F, part.F + 1e3)
    # a filter against slow noise remembers thousands of samples; nothing of what is left out may come through
    np.testing.assert_array_equal(reduce([wrong]), reduce([part.F]))
