"""Free decays: which samples of a recording without a force are used, and what is known of the force in them."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.textbook_rigs import released_rig, textbook_rig
from hystid.diagnosis import diagnose
from hystid.diagnosis.prepare.decay import NoDecay, released
from hystid.numeric import Array
from hystid.recording import Recording
from hystid.smoothing.kernels import kernel_of_smoothing

RATE, LONG = 1000.0, 6000
W = 2 * np.pi * 25.0


def ringing(start: float, damping: float = 0.02) -> Array:
    """Displacement [m], (n,), of a rig of 25 Hz that is struck at a time."""
    t = np.arange(LONG) / RATE - start
    return np.asarray(np.where(t > 0, 1e-3 * np.exp(-damping * W * np.maximum(t, 0)) * np.sin(W * t), 0.0))


def measured(x: Array) -> Recording:
    return Recording("decay", np.arange(LONG) / RATE, x=x + 1e-6 * np.random.default_rng(1).standard_normal(LONG))


def places(x: Array) -> list[tuple[float, float]]:
    return [(float(test.t[0]), float(test.t[-1])) for test in released([measured(x)], None).tests]


def test_the_rest_after_a_decay_hides_nothing_of_it() -> None:
    """It ends where the noise, 1e-6 m, is a fifth of its root mean square; to two periods of 0.04 s."""
    ((begin, end),) = places(ringing(0.0))
    assert begin == 0.0
    assert end == pytest.approx(np.log(200 / np.sqrt(2)) / (0.02 * W), abs=0.08)


def test_a_decay_ends_where_dry_friction_stops_it() -> None:
    """Half cycles about either side of the zero, each smaller by 2 d, until one ends where friction holds it."""
    t, d, start = np.arange(LONG) / RATE, 4e-5, 1.1e-3
    half = np.minimum((t * W / np.pi).astype(int), int(np.ceil((start / d - 1) / 2)))
    stop = half[-1] * np.pi / W
    swing = np.where(t < stop, np.cos(W * (t - half * np.pi / W)), 0.0)
    centre = np.where(t < stop, np.where(half % 2, -d, d), start - 2 * d * half)
    ((_, end),) = places(centre + swing * np.where(half % 2, -1, 1) * (start - (2 * half + 1) * d))
    assert stop - 0.01 < end < stop  # a quarter of a period; in the last of it, it moves by less than noise


def test_only_recordings_that_are_used_set_the_mass() -> None:
    """Held out, a decay or nothing at all leaves the mass to the recordings with a force."""
    held = [released(tests, None, held=True) for tests in ([], [measured(ringing(0.0))])]
    assert not any(one.unscaled or one.notes for one in held)


def test_a_blow_is_no_part_of_the_decay_after_it() -> None:
    ((begin, _),) = places(ringing(1.0))
    assert 1.0 < begin < 1.0 + 4 * 0.04  # within the window of two periods in which the motion is largest, and the next
    ((early, _),) = places(ringing(0.02))  # it lies within the first window
    assert 0.02 < early < 0.02 + 0.04


def test_each_blow_of_a_recording_gives_a_decay() -> None:
    found = places(ringing(0.5) + 0.7 * ringing(2.5) + 0.8 * ringing(4.5))
    assert len(found) == 3
    for (begin, end), blow in zip(sorted(found), (0.5, 2.5, 4.5), strict=True):
        assert blow < begin < blow + 0.2
        assert end < blow + 2.0  # before the next one


def test_a_steady_drive_is_no_part_of_the_decay_after_it() -> None:
    """The motion overshoots as it is driven up, and is steady until the drive ends at 3 s."""
    t = np.arange(LONG) / RATE
    up = (1 - np.exp(-0.02 * W * t)) + 0.3 * np.exp(-(((t - 0.8) / 0.3) ** 2))
    x = 1e-3 * np.where(t < 3.0, up, np.exp(-0.02 * W * np.maximum(t - 3.0, 0))) * np.sin(W * t)
    ((begin, _),) = places(x)
    assert 3.0 - 0.08 <= begin < 3.0 + 4 * 0.04


def test_one_recording_that_does_not_die_away_is_left_out() -> None:
    steady = Recording("driven", np.arange(LONG) / RATE, x=1e-3 * np.sin(W * np.arange(LONG) / RATE))
    found = released([measured(ringing(0.0)), steady], 1.0)
    assert len(found.tests) == 1
    assert any("left out: driven has no force" in note for note in found.notes)
    with pytest.raises(NoDecay, match="driven has no force, and its motion does not die away"):
        released([steady], 1.0)


def test_the_mass_of_a_free_decay_is_as_given_and_no_channel_of_the_force_is_at_fault() -> None:
    """All forces scale with the mass: a fit that could move it would shrink them all towards a force of zero."""
    tests, believed, _ = released_rig(4, "two_stops", "struck")
    found = diagnose(tests, model="HystId.Oscillators.Linear", parameters=believed)
    assert found.final_values()["m"].value == believed["m"]
    assert [finding.effect for finding in found.findings] == ["two_sided_stop"]


def test_a_spectrum_that_only_falls_shows_no_smoothing() -> None:
    """Dry friction leaves corners in a velocity, whose lines fall like those behind a moving mean, but never rise."""
    rng = np.random.default_rng(4)
    frequency = np.arange(20, 400)
    lines = (1e4 / frequency**4 + 1e-3) * rng.exponential(size=len(frequency))
    assert kernel_of_smoothing(lines, 0, len(lines)) is None
    smoothed = np.convolve(rng.standard_normal(2000), np.ones(9) / 9, mode="same")
    power = np.abs(np.fft.rfft(smoothed)) ** 2
    kernel = kernel_of_smoothing(power, 0, len(power))
    assert kernel is not None
    assert len(kernel) == 9


def test_a_decay_of_few_samples_is_refused_and_says_what_to_do() -> None:
    with pytest.raises(NoDecay, match=r"dies away within \d+ samples: at least 200 are needed; record it at a higher"):
        released([measured(ringing(0.0, 0.3))], None)


def test_driven_motion_that_falls_for_a_while_is_no_decay() -> None:
    """It falls to a third and swells again, over several periods each: no blow is so slow."""
    t = np.arange(LONG) / RATE
    sway = np.interp(t, np.linspace(0, 6, 25), 1 + 0.6 * np.sin(2.4 * np.arange(25.0)))
    with pytest.raises(NoDecay, match="it was driven by a force that nobody recorded"):
        released([Recording("shaken", t, x=1e-3 * sway * np.sin(W * t))], None)


def test_what_is_unknown_in_a_free_decay_may_be_a_force_that_was_not_recorded() -> None:
    tests, believed, _ = released_rig(1, "parametric", "struck")
    found = diagnose(tests, model="HystId.Oscillators.Linear", parameters=believed)
    assert found.verdict == "unknown_physics"
    assert any("no force was recorded" in note for note in found.notes)


def test_no_law_of_time_is_named_in_a_free_decay() -> None:
    """A sweep whose force was not recorded: above the resonance the motion falls, and is ever quicker."""
    driven, believed, _ = textbook_rig(23, "none")
    found = diagnose(replace(driven, F=None), model="HystId.Oscillators.Linear", parameters=believed)
    assert found.verdict in ("unknown_physics", "not_applicable")
