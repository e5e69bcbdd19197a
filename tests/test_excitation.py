"""Force specifications."""

from __future__ import annotations

import numpy as np
import pytest

from hystid.errors import UsageError
from hystid.excitation import is_specification, parse

DT = 1e-4


def test_chirp_sweeps_linearly_at_constant_amplitude() -> None:
    force = parse("chirp:0-100Hz@60N,5s").force(DT)
    assert force.shape == (50_000,)
    assert np.max(np.abs(force)) == pytest.approx(60, rel=1e-4)
    # phase 2 pi (f1 / 2T) t^2: crossings after t seconds are 2 * 10 t^2
    upward = np.sum((force[:-1] < 0) & (force[1:] >= 0))
    assert upward == pytest.approx(100 / 2 * 5, abs=1)


def test_harmonic() -> None:
    t = np.arange(20_000) * DT
    np.testing.assert_allclose(
        parse("harmonic: 20 Hz @ 0.08 kN, 2000ms").force(DT), 80 * np.sin(40 * np.pi * t), atol=1e-9
    )


def test_multisine_has_its_rms_its_band_and_its_seed() -> None:
    asked = parse("multisine:5-80Hz@30Nrms,4s")
    force = asked.force(DT, seed=1)
    assert np.sqrt(np.mean(force**2)) == pytest.approx(30, rel=1e-12)
    lines = np.abs(np.fft.rfft(force))
    excited = np.flatnonzero(lines > 1e-6 * lines.max()) / 4.0
    assert (excited.min(), excited.max()) == (5.0, 80.0)
    np.testing.assert_array_equal(force, asked.force(DT, seed=1))
    assert np.max(np.abs(force - asked.force(DT, seed=2))) > 1


def test_odd_multisine_leaves_even_lines_empty() -> None:
    lines = np.abs(np.fft.rfft(parse("multisine-odd:5-80Hz@30N,4s").force(DT)))
    assert np.all(np.flatnonzero(lines > 1e-6 * lines.max()) % 2 == 1)


@pytest.mark.parametrize(
    "text",
    [
        "chirp:0-100Hz@60N",
        "chrip:0-100Hz@60N,5s",
        "harmonic:0Hz@1N,2s",
        "chirp:100-0Hz@1N,2s",
        "harmonic:20Hz@-80N,2s",
        "harmonic:20-30Hz@80N,2s",
        "harmonic:20Hz@80N,0s",
        "harmonic:20@80,2",
        "harmonic:20Hz@1e999N,1s",
    ],
)
def test_a_mistake_is_answered_in_one_sentence_with_an_example(text: str) -> None:
    with pytest.raises(UsageError, match="harmonic:20Hz@80N,2s") as caught:
        parse(text)
    assert "\n" not in str(caught.value)


def test_a_step_that_cannot_carry_the_frequency_is_refused() -> None:
    with pytest.raises(UsageError, match="use at most"):
        parse("harmonic:600Hz@1N,1s").force(1e-3)


def test_specifications_are_told_from_files() -> None:
    assert is_specification("chirp:0-1Hz@1N,1s")
    assert not is_specification("chirp.csv")
    assert not is_specification("C:/data/force.csv")
