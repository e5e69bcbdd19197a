"""Derivation, filtering, decimation and noise: phase, gain and balance against closed forms."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hystid.errors import RecordingError, UsageError
from hystid.processing import add_noise, band_pass, derive, differentiate, noise_cutoff, parse_band, prepare
from hystid.recording import Recording

DT = 1e-3
MASS, DAMPING, STIFFNESS = 2.0, 30.0, 5e4


def linear(n: int = 8000, frequencies: tuple[float, ...] = (7.0, 23.0), *, channels: str = "xva") -> Recording:
    """Steady motion of a linear oscillator with everything known in closed form."""
    t = np.arange(n) * DT
    x = sum(1e-3 * np.sin(2 * np.pi * f * t + f) for f in frequencies)
    v = sum(1e-3 * 2 * np.pi * f * np.cos(2 * np.pi * f * t + f) for f in frequencies)
    a = sum(-1e-3 * (2 * np.pi * f) ** 2 * np.sin(2 * np.pi * f * t + f) for f in frequencies)
    known = {"x": x, "v": v, "a": a}
    return Recording("linear", t, F=MASS * a + DAMPING * v + STIFFNESS * x, **{name: known[name] for name in channels})


def test_restoring_force_of_measured_channels_is_exact() -> None:
    recording = linear()
    made = prepare(recording, mass=MASS)
    np.testing.assert_allclose(made.R, DAMPING * recording.v + STIFFNESS * recording.x, atol=1e-10)
    assert "m = 2 kg" in made.origin["R"]


@pytest.mark.parametrize("f", [5.0, 20.0, 60.0])
def test_differentiation_has_sixth_order_gain(f: float) -> None:
    t = np.arange(2000) * DT
    found = differentiate(np.sin(2 * np.pi * f * t), DT)[10:-10]
    expected = (2 * np.pi * f * np.cos(2 * np.pi * f * t))[10:-10]
    # gain of the scheme: 1 - (w dt)^6 / 140
    allowed = (2 * np.pi * f * DT) ** 6 / 140 * 1.1 + 1e-9
    assert np.max(np.abs(found - expected)) < allowed * 2 * np.pi * f


def test_derived_channels_close_the_force_balance() -> None:
    truth = linear()
    made = prepare(linear(channels="x"), mass=MASS)
    inner = slice(20, -20)  # the end samples are one-sided differences of second order, as the note says
    error = (made.R - (DAMPING * truth.v + STIFFNESS * truth.x))[inner]
    assert np.std(error) / np.std(made.R) < 1e-4
    assert any("sixth order" in note for note in made.notes)


def test_derivation_limits_noise_to_where_there_is_signal() -> None:
    truth = linear()
    noisy = add_noise(linear(channels="x"), 50, seed=3)
    made = derive(noisy)
    assert noise_cutoff(noisy.x, DT) == pytest.approx(37, abs=4)  # highest line 23 Hz, Hann bins of 0.5 Hz, margin 1.5
    inner = slice(200, -200)
    # differentiating white noise of 50 dB up to 500 Hz would give an error of 10 % in v and 600 % in a
    assert np.std((made.v - truth.v)[inner]) / np.std(truth.v) < 0.004
    assert np.std((made.a - truth.a)[inner]) / np.std(truth.a) < 0.03


def test_motion_integrated_from_acceleration() -> None:
    truth = linear(20_000)
    made = prepare(linear(20_000, channels="a"), band=(2, 100), mass=MASS)
    shift = round((made.t[0] - truth.t[0]) / DT)
    part = slice(shift, shift + len(made))
    # trapezoidal rule: gain error (w dt)^2 / 12 = 0.17 % a stage at 23 Hz; the band-pass passes 7 Hz to 1e-4
    assert np.std(made.x - truth.x[part]) / np.std(truth.x) < 6e-3
    with pytest.raises(RecordingError, match="drifts"):
        derive(linear(channels="a"))


def test_band_pass_is_zero_phase_and_keeps_the_balance() -> None:
    recording = linear(frequencies=(20.0,))
    made = band_pass(recording, (5, 100))
    k = round((made.t[0] - recording.t[0]) / DT)
    error = np.abs(made.x - recording.x[k : k + len(made)]) / 1e-3
    assert error.max() < 0.02  # 1 % of the impulse response is left where the ends are cut
    assert error[k:-k].max() < 1e-3  # after the same time again; the gain of the band at 20 Hz is 1 - 6e-11
    balance = made.F - MASS * made.a - DAMPING * made.v - STIFFNESS * made.x
    assert np.std(balance) < 1e-10 * np.std(made.F)
    assert any(f"{k} samples cut at each end" in note for note in made.notes)


def test_band_pass_removes_an_offset_without_ringing_at_the_ends() -> None:
    t = np.arange(8000) * DT
    recording = Recording("offset", t, F=10 + np.sin(2 * np.pi * 20 * t), x=0.1 + np.sin(2 * np.pi * 20 * t))
    made = band_pass(recording, (5, 100))
    k = round(made.t[0] / DT)
    # 1 % of the impulse response is left where the ends are cut
    assert np.max(np.abs(made.F - np.sin(2 * np.pi * 20 * t[k : k + len(made)]))) < 0.02


def test_decimation_does_not_alias() -> None:
    t = np.arange(8000) * DT
    recording = Recording(
        "high", t, F=np.sin(2 * np.pi * 240 * t) + np.sin(2 * np.pi * 10 * t), x=np.sin(2 * np.pi * 10 * t)
    )
    made = prepare(recording, decimate=4)  # 250 Hz: 240 Hz would appear at 10 Hz
    assert made.sample_rate == pytest.approx(250)
    np.testing.assert_allclose(made.F, made.x, atol=1e-3)


def test_reference_processing_reduces_every_channel_by_four() -> None:
    made = prepare(linear(), band=(1, 100), decimate=4, mass=MASS)
    assert made.sample_rate == pytest.approx(250)
    for name in "FxvaR":
        assert len(made.channel(name)) == len(made)
    inner = slice(50, -50)
    error = (made.R - DAMPING * made.v - STIFFNESS * made.x)[inner]
    assert np.std(error) < 1e-9 * np.std(made.R)


@settings(max_examples=20, deadline=None)
@given(st.floats(10, 60), st.integers(0, 2**31))
def test_noise_has_the_ratio_asked_for(snr: float, seed: int) -> None:
    recording = linear(4000)
    noisy = add_noise(recording, snr, seed)
    for name in "Fxva":
        clean = recording.channel(name)
        ratio = np.std(clean) / np.std(noisy.channel(name) - clean)
        assert 20 * np.log10(ratio) == pytest.approx(
            snr, abs=0.6
        )  # standard deviation from 4000 samples: 1.1 %, 5 sigma
    assert noisy.R is None


def test_noise_is_seeded_per_channel() -> None:
    both, alone = add_noise(linear(), 34, 5), add_noise(linear(channels="x"), 34, 5)
    np.testing.assert_array_equal(both.x, alone.x)
    assert np.any(add_noise(linear(), 34, 6).x != both.x)


def test_quasi_static_recordings_have_no_inertia_and_no_band() -> None:
    from hystid.recording.types import PSEUDO_TIME

    t = np.arange(200) * 0.02
    recording = Recording("static", t, F=np.sin(t), x=np.sin(t), origin={"t": PSEUDO_TIME})
    with pytest.raises(RecordingError, match="mass 0"):
        prepare(recording, mass=1.0)
    with pytest.raises(RecordingError, match="no meaning"):
        prepare(recording, band=(0, 10))
    np.testing.assert_array_equal(prepare(recording).R, recording.F)


def test_a_staircase_reverses_only_where_its_motion_does() -> None:
    t = np.arange(1200) * 0.01
    motion = np.sin(2 * np.pi * t / 12)
    made = derive(Recording("stairs", t, F=motion, x=np.round(motion / 0.01) * 0.01))  # two of three samples repeat
    assert "holds its value" in made.origin["v"]
    at = t[1:][made.v[1:] * made.v[:-1] < 0]
    at = at[(at > 0.2) & (at < 11.8)]
    # the stair at a turning point lasts 2 * 12 s / (2 pi) * sqrt(2 * 0.005) = 0.38 s
    assert at.size
    assert np.all(np.min(np.abs(at[:, None] - np.array([3.0, 9.0])), axis=1) < 0.38)


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        ({"band": (5.0, 600.0)}, "600 Hz"),
        ({"band": (0.01, 100.0)}, "too short"),
        ({"band": (100.0, 5.0)}, "lower one first"),
        ({"decimate": 0}, "--decimate 0"),
        ({"decimate": 1000}, "fewer than 64"),
        ({"mass": -1.0}, "--mass -1"),
        ({"mass": float("nan")}, "--mass nan"),
    ],
)
def test_impossible_settings_are_refused(arguments: dict[str, object], says: str) -> None:
    with pytest.raises(UsageError, match=says):
        prepare(linear(), **arguments)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("text", "band"), [("5-500Hz", (5, 500)), ("-500 Hz", (None, 500)), ("0-500", (None, 500)), ("1e1-Hz", (10, None))]
)
def test_band_texts(text: str, band: tuple[float | None, float | None]) -> None:
    assert parse_band(text) == band


@pytest.mark.parametrize("text", ["500-5Hz", "abc", "-", "5", "5-500-900", "5Hz"])
def test_wrong_band_texts(text: str) -> None:
    with pytest.raises(UsageError, match="as 5-500Hz"):
        parse_band(text)
