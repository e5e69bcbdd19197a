"""Error measures against closed forms."""

from __future__ import annotations

import numpy as np
import pytest

from hystid.comparison import harmonics, loop_energy, mse, nrmse, spectrum, tube
from hystid.errors import NumericalError, UsageError

DT = 1e-3
T = np.arange(4000) * DT


def test_nrmse_is_rms_error_over_standard_deviation() -> None:
    reference = 3.0 + np.sin(2 * np.pi * 5 * T)  # 20 whole periods: std = 1/sqrt(2), whatever the offset
    assert nrmse(reference + 0.1, reference) == pytest.approx(0.1 * np.sqrt(2), rel=1e-12)
    assert nrmse(reference, reference) == 0.0
    assert mse(reference + 0.1, reference) == pytest.approx(0.01, rel=1e-12)


def test_nrmse_refuses_what_has_no_answer() -> None:
    with pytest.raises(NumericalError, match="constant"):
        nrmse(np.ones(5), np.ones(5))
    with pytest.raises(UsageError, match="5 and 4 samples"):
        nrmse(np.ones(5), np.ones(4))
    with pytest.raises(NumericalError, match="sample 2"):
        nrmse(np.array([1.0, 2, np.nan]), np.array([1.0, 2, 3]))


def test_harmonics_of_a_known_series_without_whole_periods() -> None:
    f = 7.3  # not a multiple of the resolution of the record
    signal = 0.5 + 2 * np.cos(2 * np.pi * f * T + 0.3) + 0.02 * np.cos(2 * np.pi * 3 * f * T - 1.0)
    found = harmonics(signal, DT, f)
    assert found.offset == pytest.approx(0.5, abs=1e-10)
    assert found.amplitude[0] == pytest.approx(2.0, rel=1e-10)
    assert found.phase[0] == pytest.approx(0.3, abs=1e-10)
    assert found.level_db[2] == pytest.approx(-40.0, abs=1e-6)
    assert found.phase[2] == pytest.approx(-1.0, abs=1e-8)
    assert found.even_level_db < -180  # least squares on orthogonal-like columns: rounding only
    assert found.residual < 1e-10


def test_a_one_sided_stiffness_gives_even_harmonics_and_a_symmetric_one_does_not() -> None:
    x = np.sin(2 * np.pi * 5 * T)
    assert harmonics(np.where(x > 0, 2 * x, x), DT, 5).even_level_db > -30
    assert harmonics(x + x**3, DT, 5).even_level_db < -180


def test_harmonics_stop_at_half_the_sample_rate() -> None:
    found = harmonics(np.sin(2 * np.pi * 120 * T), DT, 120.0)
    assert found.order.max() * 120 < 500
    with pytest.raises(UsageError, match="two periods"):
        harmonics(np.sin(2 * np.pi * 0.3 * T), DT, 0.3)


def test_loop_energy_of_friction_and_of_a_spring() -> None:
    x = np.sin(2 * np.pi * T)  # four cycles of amplitude 1
    assert loop_energy(x, 100 * x) == pytest.approx(0.0, abs=1.0)
    # Coulomb friction takes 4 fc A per cycle; the trapezoidal rule cuts the jump at each of 8 reversals (1e-3 of it)
    assert loop_energy(x, 2.0 * np.sign(np.cos(2 * np.pi * T))) == pytest.approx(4 * 4 * 2.0, rel=5e-3)
    # viscous damping takes pi c w A^2 per cycle
    v = 2 * np.pi * np.cos(2 * np.pi * T)
    assert loop_energy(x, 3 * v) == pytest.approx(4 * np.pi * 3 * 2 * np.pi, rel=1e-3)


def test_spectrum_integrates_to_the_power() -> None:
    noise = np.random.default_rng(3).normal(0, 2.0, 200_000)
    found = spectrum(noise, DT)
    power = float(np.sum(found.density) * (found.frequency[1] - found.frequency[0]))
    assert power == pytest.approx(4.0, rel=0.03)  # 50 averages of Hann segments: about 1 % scatter


def test_tube_forgives_one_sample_of_event_time_but_no_more() -> None:
    k = np.arange(100)
    step = (k >= 50).astype(float)
    assert tube((k >= 51).astype(float), step, samples=1).holds
    late = tube((k >= 53).astype(float), step, samples=1)
    assert not late.holds
    assert np.flatnonzero(late.outside).tolist() == [51, 52]
    assert late.worst == pytest.approx(1 - 1e-3)


def test_a_value_that_is_not_finite_is_outside_the_tube() -> None:
    values = np.sin(T)
    broken = values.copy()
    broken[7] = np.nan
    assert np.flatnonzero(tube(broken, values).outside).tolist() == [7]
    assert tube(broken, values).worst == np.inf


@pytest.mark.parametrize("odd", [np.nan, np.inf, -np.inf])
def test_where_the_reference_is_not_finite_the_value_must_be_the_same(odd: float) -> None:
    reference = np.sin(T)
    reference[7] = odd
    assert tube(reference.copy(), reference).holds
    assert np.flatnonzero(tube(np.sin(T), reference).outside).tolist() == [7]
    assert np.flatnonzero(tube(np.sin(T) + 0.01, reference).outside).size == T.size
