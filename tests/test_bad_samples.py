"""Single bad samples of a data link are bridged; blows, impacts and clipped channels are not touched."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.signal import butter, sosfiltfilt

from hystid.consistency import admit, check
from hystid.consistency.bad_samples import standing_out, without_bad_samples
from hystid.recording import Recording

T = np.arange(4000) * 1e-3


def motion(seed: int) -> NDArray[np.float64]:
    rng = np.random.default_rng(seed)
    return np.sin(2 * np.pi * 7 * T) * np.linspace(0.2, 1, len(T)) + 1e-3 * rng.standard_normal(len(T))


@pytest.mark.parametrize("size", [3.0, -3.0, 50.0])
def test_bad_samples_are_bridged_and_told(size: float) -> None:
    a = motion(1)
    at = [40, 1500, 1507, 3990]
    broken = a.copy()
    broken[at] = size
    found = without_bad_samples(Recording("link", T, F=motion(2), a=broken))
    assert found.a is not None and found.notes and "4 samples of channel a" in found.notes[0]
    # the polynomial through six good samples follows 7 Hz exactly; what is left is their noise, raised by its weights
    np.testing.assert_allclose(found.a[at], a[at], atol=0.02)
    untouched = np.delete(np.arange(len(T)), at)
    np.testing.assert_array_equal(found.a[untouched], broken[untouched])


@pytest.mark.parametrize("lost", [0.0, -1.7])
def test_what_a_data_link_puts_for_lost_samples_is_bad_wherever_it_stands(lost: float) -> None:
    """Twelve samples in a fast motion; one that was small there stands out no further than the motion itself does."""
    rng = np.random.default_rng(8)
    v = sosfiltfilt(butter(4, 0.25, output="sos"), rng.standard_normal(len(T))) + 1e-3 * rng.standard_normal(len(T))
    at = np.sort(rng.choice(np.arange(20, len(T) - 20, 10), 12, replace=False))
    broken = v.copy()
    broken[at] = lost
    assert standing_out(broken).tolist() == at.tolist()
    assert len(standing_out(v)) == 0


def test_a_noisy_channel_that_is_cut_off_has_no_lost_samples() -> None:
    rng = np.random.default_rng(10)
    assert len(standing_out(np.clip(rng.standard_normal(len(T)), -1.8, 1.8))) == 0


def test_levels_of_a_converter_are_no_lost_samples() -> None:
    values = np.round(20 * motion(9)) / 20
    broken = values.copy()
    broken[[500, 1503, 2506, 3509]] = 3.0  # four spikes to one level
    assert standing_out(broken).tolist() == [500, 1503, 2506, 3509]
    broken[[500, 1503, 2506, 3509]] = 0.0  # which the motion has as well
    assert set(standing_out(broken)) <= {500, 1503, 2506, 3509}


def test_what_lasts_is_no_bad_sample() -> None:
    blow = motion(3)
    blow[2000:2005] += 6 * np.array([0.3, 0.8, 1.0, 0.8, 0.3])  # a hammer: several samples
    clipped = np.clip(3 * motion(4), -1, 1)
    for values in (motion(5), blow, clipped, np.zeros(len(T)), np.ones(len(T))):
        assert len(standing_out(values)) == 0


@pytest.mark.parametrize("height", [0.05, -0.3])
@pytest.mark.parametrize("noise", [0.0, 1e-3])
def test_a_bad_sample_within_the_range_stands_out_of_its_neighbours(height: float, noise: float) -> None:
    x = np.sin(2 * np.pi * 7 * T) + noise * np.random.default_rng(1).standard_normal(len(T))
    at = [812, 2001, 3333]
    broken = x.copy()
    broken[at] += height
    assert standing_out(broken).tolist() == at
    assert len(standing_out(x)) == 0


@pytest.mark.parametrize("noise", [0.0, 1e-6])
@pytest.mark.parametrize("place", [0.0, 0.3, 0.5])
def test_a_stop_bends_a_displacement_and_steps_a_velocity(noise: float, place: float) -> None:
    rng = np.random.default_rng(2)
    for order, size in ((1, 1e-2), (0, 0.5)):  # a bend of 10 mm/s at once, and a step; smooth motion is beside them
        values = np.sin(2 * np.pi * 7 * T) + noise * rng.standard_normal(len(T))
        for at in (900, 1700, 2500):
            late = T / T[1] - at - place
            values += size * np.where(late > 0, late**order, 0.0)
        assert len(standing_out(values)) == 0


def test_a_blow_of_a_sample_shows_in_the_motion_too() -> None:
    x = np.zeros(len(T))
    for at in (700, 1500, 2600):
        x += 1e-3 * np.maximum(T / T[1] - at, 0.0)
    a = np.pad(np.diff(x, 2), 1) / T[1] ** 2
    assert len(standing_out(a)) == 3
    kept = without_bad_samples(Recording("blows", T, x=x, a=a))
    assert kept.a is not None
    np.testing.assert_array_equal(kept.a, a)


def test_one_bad_sample_is_told_as_one_and_short_channels_have_no_others() -> None:
    x = motion(9)
    x[1234] += 0.4
    (note,) = (note for note in without_bad_samples(Recording("link", T, x=x)).notes if "data link" in note)
    assert "1 sample of channel x stands alone, far from its neighbours (at 1.234 s)" in note
    assert len(standing_out(x[1234 - 20 : 1234 + 20])) == 0


def test_many_outliers_are_noise_of_another_kind() -> None:
    wild = motion(6)
    wild[::50] *= 9
    assert len(standing_out(wild)) == 0


@pytest.mark.parametrize("width", [1, 2, 3])
def test_a_blow_between_two_samples_is_in_force_and_acceleration_and_is_kept(width: int) -> None:
    F, a = motion(7), motion(8)
    pulse = np.array([0.3, 1.0, 0.2])[-width:] if width > 1 else np.ones(1)
    for at in range(200, 3900, 450):  # nine blows: more samples than accidents are
        F[at : at + width] += 40 * pulse
        a[at : at + width] += 15 * pulse
    a[[700, 2222]] = -30.0
    kept = without_bad_samples(Recording("hammer", T, F=F, a=a))
    assert kept.a is not None and kept.F is not None
    np.testing.assert_array_equal(kept.F, F)
    changed = np.flatnonzero(kept.a != a)
    # of the two errors of the data link none, or both: among so many blows they need not stand out
    assert set(changed) <= {700, 2222}
    assert "samples of channel F" not in " ".join(kept.notes)


def test_check_tells_them_and_every_command_bridges_them() -> None:
    rng = np.random.default_rng(4)
    x = np.sin(2 * np.pi * 7 * T) * np.linspace(0.2, 1, len(T))
    v, a = (np.gradient(x, T[1]), np.gradient(np.gradient(x, T[1]), T[1]))
    exact = {"F": 2 * a + 8e3 * x, "x": x, "v": v, "a": a}
    noisy = {name: u + 1e-2 * float(np.std(u)) * rng.standard_normal(len(T)) for name, u in exact.items()}
    at = rng.choice(np.arange(60, len(T) - 60), 8, replace=False)
    for name in "Fxva":
        broken = {**noisy, name: noisy[name].copy()}
        broken[name][at] += 3 * np.std(noisy[name])
        recording = Recording("link", T, **broken)
        (note,) = (note for note in check(recording, mass=2.0).notes if note.slip == "bad_samples")
        assert (note.channel, note.seen["samples"]) == (name, 8)
        (whole,) = admit([recording], 2.0)
        assert any("[bad_samples]" in warning for warning in whole.warnings)
        # beside the bridged samples everything is as it was; they are off by their noise, raised by the polynomial
        np.testing.assert_allclose(whole.channel(name), noisy[name], atol=0.1 * float(np.std(noisy[name])))
