"""Rigs that are simulated apart from the library and from the proof (``benchmarks.textbook_rigs``)."""

import numpy as np
import pytest
from scipy.signal import StateSpace, lsim

from benchmarks.textbook_loops import KINDS as LOOPS
from benchmarks.textbook_loops import textbook_loop
from benchmarks.textbook_rigs import KINDS, Rig, judged, moved, released_rig, textbook_rig
from hystid.diagnosis import diagnose


def test_a_rig_without_an_effect_moves_as_scipy_says() -> None:
    rig, t = Rig(2.0, 5.0, 8e3, 63.2, 1e-3, 1.0), np.arange(2000) / 600.0
    force = np.sin(2 * np.pi * (3.0 * t + 2.0 * t**2))
    found = moved(rig, rig.m, (0, lambda y, t: (0.0, ())), t, force)
    system = StateSpace([[0, 1], [-rig.k / rig.m, -rig.c / rig.m]], [[0], [1 / rig.m]], np.eye(2), np.zeros((2, 1)))
    _, states, _ = lsim(system, force, t)  # exact for a force that is straight between samples
    for own, known in zip(found[:2], states.T, strict=True):
        # 140 steps per period: an error of (2 pi / 140)^4 / 120 in each, over fifty periods.
        assert np.max(np.abs(own - known)) < 1e-4 * np.max(np.abs(known))
    assert np.allclose(rig.m * found[2], force - rig.c * found[1] - rig.k * found[0])


@pytest.mark.parametrize("seed", [11, 12])
def test_a_mass_is_named_from_a_velocity_and_an_acceleration(seed: int) -> None:
    """It adds noise, where that is below what the channels show; a low-pass of the force was surer, at 90 and 98 %."""
    recording, believed, _ = textbook_rig(seed, "mass", "va")
    found = diagnose(recording, model="HystId.Oscillators.Linear", parameters=believed)
    assert judged(KINDS["mass"], found.verdict, {finding.effect for finding in found.findings}) == "right"


@pytest.mark.parametrize(
    ("kind", "how", "seed"),
    [
        ("none", "struck", 2), ("none", "again", 3), ("coulomb", "pulled", 1), ("coulomb", "recorded", 2),
        ("cubic", "struck", 3), ("square", "again", 1), ("two_stops", "pulled", 4), ("bouc_wen", "struck", 1),
        ("absorber", "pulled", 2), ("absorber", "struck", 3), ("drag", "struck", 4),
    ],
)  # fmt: skip
def test_a_free_decay_is_read_however_the_rig_was_let_go(kind: str, how: str, seed: int) -> None:
    """Most of each recording is rest. The motion was looked for at frequencies of the noise, and the mass, which
    scales all forces alike, was made smaller until noise explained what was missing."""
    tests, believed, _ = released_rig(seed, kind, how)
    found = diagnose(tests, model="HystId.Oscillators.Linear", parameters=believed)
    assert judged(KINDS[kind], found.verdict, {finding.effect for finding in found.findings}) == "right"


@pytest.mark.parametrize("kind", ["none", "coulomb", "cubic", "play", "fades"])
def test_a_slow_cyclic_test_is_read(kind: str) -> None:
    recording, believed, _ = textbook_loop(103, kind)
    found = diagnose(recording, model="HystId.Oscillators.Linear", parameters=believed)
    assert judged(LOOPS[kind], found.verdict, {finding.effect for finding in found.findings}) == "right"
