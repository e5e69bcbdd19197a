"""What users take off their channels before they ask: straight lines, slow motion, and the ends under a window.

The rigs are sound and linear (``benchmarks.sound_rigs``): nothing is missing in any of them.
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import butter, detrend, sosfiltfilt
from scipy.signal.windows import tukey

from benchmarks.sound_rigs import sound_rig
from hystid import Diagnosis, diagnose
from hystid.diagnosis.prepare.levelled import unknown_degree, with_lines_told
from hystid.diagnosis.prepare.tapered import between_tapers
from hystid.numeric import Array
from hystid.recording import Recording

CALM = ("consistent", "recalibrated")


def asked(seed: int, channels: str, done: dict[str, Array]) -> Diagnosis:
    test, model, believed, _ = sound_rig(seed, channels)
    return diagnose(test.with_channels(done), model=model, parameters=believed)


def channel(seed: int, channels: str, name: str) -> Array:
    return sound_rig(seed, channels)[0].channel(name)


@pytest.mark.parametrize(("seed", "channels"), [(997100, "x"), (997106, "xva"), (997111, "x")])
@pytest.mark.parametrize("all_of_them", [False, True])
def test_a_straight_line_that_was_taken_off_is_no_drift(seed: int, channels: str, all_of_them: bool) -> None:
    names = ("F", *channels) if all_of_them else channels[:1]
    found = asked(seed, channels, {name: detrend(channel(seed, channels, name)) for name in names})
    assert found.verdict in CALM, found.headline
    assert any("a straight line was taken off" in note for note in found.notes)


def test_a_line_is_unknown_to_the_order_in_which_it_is_integrated() -> None:
    t, rng = np.arange(400) * 1e-2, np.random.default_rng(1)
    test = Recording("r", t, **{name: rng.standard_normal(400) + t for name in "Fxva"})
    assert unknown_degree(with_lines_told(test)) == 0
    for name, degree in (("F", 1), ("x", 1), ("v", 2), ("a", 3)):
        rounded = np.array([float(f"{value:.4e}") for value in detrend(test.channel(name))])  # as a text file has it
        assert unknown_degree(with_lines_told(test.with_channels({name: rounded}))) == degree


def test_steady_tones_have_their_line_still() -> None:
    t = np.arange(4000) * 1e-3
    for phase in np.linspace(0.0, np.pi, 7):  # whole periods have no mean, but a slope
        test = Recording("r", t, F=np.sin(2 * np.pi * 5 * t + phase), x=np.sin(2 * np.pi * 5 * t + phase + 0.1))
        assert unknown_degree(with_lines_told(test)) == 0


@pytest.mark.parametrize(("seed", "channels"), [(997105, "x"), (997104, "xva"), (997109, "x")])
@pytest.mark.parametrize("all_of_them", [False, True])
def test_slow_motion_that_was_taken_off_is_a_force_that_wanders(seed: int, channels: str, all_of_them: bool) -> None:
    """Forward and backward, so that no phase shows it: what is left out of one channel, and the ends of all."""
    slow = butter(2, 6.0 / len(channel(seed, channels, "F")), "highpass", output="sos")
    names = ("F", *channels) if all_of_them else channels[:1]
    found = asked(seed, channels, {name: sosfiltfilt(slow, channel(seed, channels, name)) for name in names})
    assert found.verdict == "sensor_fault" or found.verdict in CALM, found.headline
    assert {finding.effect for finding in found.findings} <= {"force_drift"}
    for finding in found.findings:
        assert not any(name.startswith("degree") for name in finding.parameters)
        swing = finding.parameters.get("swing_1")
        assert swing is None or (swing.unit == "N" and 0 < swing.stderr < swing.value)
        assert swing is None or any("a zero that wanders" in note for note in found.notes)


@pytest.mark.parametrize(("seed", "channels"), [(997102, "x"), (997107, "xva"), (997110, "x")])
@pytest.mark.parametrize("all_of_them", [False, True])
def test_the_ends_under_a_window_are_left_out(seed: int, channels: str, all_of_them: bool) -> None:
    window = tukey(len(channel(seed, channels, "F")), 0.25)
    names = ("F", *channels) if all_of_them else channels[:1]
    found = asked(seed, channels, {name: window * channel(seed, channels, name) for name in names})
    assert found.verdict in CALM, found.headline
    assert any("fades in and out" in note for note in found.notes)


@pytest.mark.parametrize(
    "taper", [tukey(4000, 0.2), np.minimum(1, np.minimum(np.arange(4000), np.arange(4000)[::-1]) / 400)]
)
def test_no_more_than_half_of_a_window_is_left_out_beside_it(taper: Array) -> None:
    t, rng = np.arange(4000) * 1e-3, np.random.default_rng(2)
    x = np.sin(2 * np.pi * 3.3 * t) + 0.01 * rng.standard_normal(4000)
    left = between_tapers(Recording("r", t, F=taper * x, x=x), 200)
    # noise hardly tells a half sine from a trapezoid that is a third shorter
    assert 0.4 <= left.t[0] < 0.6
    assert 0.4 <= t[-1] - left.t[-1] < 0.6


def test_what_begins_and_ends_at_rest_has_no_window() -> None:
    """A displacement that is told in steps while it rests, and is noisy while it moves; a motion that grows and dies
    away under noise that does not; noise that is louder in the middle."""
    t, rng = np.arange(4000) * 1e-3, np.random.default_rng(3)
    moves, grows = (t > 0.4) & (t < 3.6), tukey(4000, 0.2)
    white = rng.standard_normal(4000)
    for x in (
        np.where(moves, np.round(50 * np.sin(2 * np.pi * 3.3 * t) + white), 0.0),
        grows * np.sin(2 * np.pi * 3.3 * t) + 0.01 * white,
        np.sin(2 * np.pi * 3.3 * t) + 0.01 * (0.1 + grows) * white,
        grows * np.sin(2 * np.pi * 3.3 * t),
        np.where(np.abs(t - 2) < 0.7, 0.0, np.sin(2 * np.pi * 3.3 * t) + 0.01 * white),  # it rests in the middle
        np.zeros(4000),
    ):
        test = Recording("r", t, F=x + 0.01 * rng.standard_normal(4000), x=x)
        assert len(between_tapers(test, 200)) == 4000
