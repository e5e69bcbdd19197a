"""Single bad samples of a data link are bridged; blows, impacts and clipped channels are not touched."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from hystid.diagnosis.prepare.spikes import spikes, without_spikes
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
    found = without_spikes(Recording("link", T, F=motion(2), a=broken))
    assert found.a is not None and found.notes and "4 samples of channel a" in found.notes[0]
    # the polynomial through six good samples follows 7 Hz exactly; what is left is their noise, raised by its weights
    np.testing.assert_allclose(found.a[at], a[at], atol=0.02)
    untouched = np.delete(np.arange(len(T)), at)
    np.testing.assert_array_equal(found.a[untouched], broken[untouched])


def test_what_lasts_is_no_bad_sample() -> None:
    blow = motion(3)
    blow[2000:2005] += 6 * np.array([0.3, 0.8, 1.0, 0.8, 0.3])  # a hammer: several samples
    clipped = np.clip(3 * motion(4), -1, 1)
    for values in (motion(5), blow, clipped, np.zeros(len(T)), np.ones(len(T))):
        assert len(spikes(values)) == 0


def test_many_outliers_are_noise_of_another_kind() -> None:
    wild = motion(6)
    wild[::50] *= 9
    assert len(spikes(wild)) == 0


@pytest.mark.parametrize("width", [1, 2, 3])
def test_a_blow_between_two_samples_is_in_force_and_acceleration_and_is_kept(width: int) -> None:
    F, a = motion(7), motion(8)
    pulse = np.array([0.3, 1.0, 0.2])[-width:] if width > 1 else np.ones(1)
    for at in range(200, 3900, 450):  # nine blows: more samples than accidents are
        F[at : at + width] += 40 * pulse
        a[at : at + width] += 15 * pulse
    a[[700, 2222]] = -30.0
    kept = without_spikes(Recording("hammer", T, F=F, a=a))
    assert kept.a is not None and kept.F is not None
    np.testing.assert_array_equal(kept.F, F)
    changed = np.flatnonzero(kept.a != a)
    # of the two errors of the data link none, or both: among so many blows they need not stand out
    assert set(changed) <= {700, 2222}
    assert "samples of channel F" not in " ".join(kept.notes)
