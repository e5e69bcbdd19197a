"""Turning-point block: the literal rule, its edge rules, the band, chunk = whole."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hystid.errors import UsageError
from hystid.turning_points import TurningPoints

velocities = st.lists(st.floats(-2, 2) | st.sampled_from([0.0, -0.0, 0.1, -0.1]), min_size=1, max_size=60)


def literal(v, band=0.0, last=0.0):
    turns = []
    for value in v:
        turns.append(last == 0 or (abs(value) >= band and last * value <= 0))
        if abs(value) >= band:
            last = value
    return turns


@given(velocities, st.sampled_from([0.0, 0.1, 0.5]))
def test_find_is_the_rule_read_word_by_word(v, band):
    assert TurningPoints(band).find(np.array(v))[0].tolist() == literal(v, band)


@given(velocities)
def test_without_band_it_is_the_published_product_rule(v):
    v = np.array(v)
    expected = np.concatenate(([True], v[:-1] * v[1:] <= 0))
    assert np.array_equal(TurningPoints().find(v)[0], expected)


@given(velocities, st.integers(0, 60), st.sampled_from([0.0, 0.1]))
def test_chunk_by_chunk_is_the_whole(v, cut, band):
    rule, v = TurningPoints(band), np.array(v)
    whole, end = rule.find(v)
    first, last = rule.find(v[:cut])
    second, last = rule.find(v[cut:], last)
    assert np.array_equal(np.concatenate((first, second)), whole) and last == end


def test_hold_keeps_the_latest_reversal():
    v = np.array([0.0, 1.0, 1.0, -1.0, -1.0, 0.0, 1.0, 1.0])
    x, force = np.arange(8.0), 10 * np.arange(8.0)
    x0, force0 = TurningPoints().hold(x, v, force)
    assert x0.tolist() == [0, 1, 1, 3, 3, 5, 6, 6]
    assert force0.tolist() == [0, 0, 0, 20, 20, 40, 50, 50]


def test_band_ignores_noise_around_zero_velocity():
    t = np.linspace(0, 2, 2001)
    v = np.cos(2 * np.pi * t) + 0.02 * np.random.default_rng(0).normal(size=len(t))
    assert TurningPoints().find(v)[0].sum() > 20
    assert TurningPoints(0.1).find(v)[0].sum() == 1 + 4  # the start and four reversals in two periods


@pytest.mark.parametrize("band", [-1.0, float("nan"), float("inf")])
def test_band_must_be_a_number(band):
    with pytest.raises(UsageError, match="velocity_band"):
        TurningPoints(band)
