"""A user integrates a noise-free acceleration and cuts what is slow: x has lost it, and no noise says so."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import cumulative_trapezoid
from scipy.signal import butter, sosfilt

from hystid import build, diagnose, simulate
from hystid.recording import Recording

RIG = "HystId.Oscillators.Jenkins"  # 1 kg; 28 Hz while it sticks
GIVEN = {"m": 1.0, "B": 12.0, "Kl": 1.1e4, "Ks": 2.2e4, "fc": 9.0}


def integrated(recording: Recording, corner: float) -> Recording:
    cut = butter(2, 2 * corner * recording.dt, "high", output="sos")

    def integral(values: np.ndarray) -> np.ndarray:
        return np.asarray(sosfilt(cut, cumulative_trapezoid(values, dx=recording.dt, initial=0.0)))

    v = integral(recording.channel("a"))
    return replace(recording, v=v, x=integral(v))


@pytest.fixture(scope="module")
def tests(tmp_path_factory: pytest.TempPathFactory) -> list[Recording]:
    rig = build(RIG, tmp_path_factory.mktemp("rig") / "rig.fmu")
    forces = ("multisine:2-80Hz@20Nrms,2s", "chirp:2-60Hz@25N,2s")
    return [simulate(rig, force, dt=4e-4, parameters={"Ks": 2e4, "fc": 8.0, "Kl": 1e4}) for force in forces]


@pytest.mark.parametrize(
    ("corner", "told"),
    [
        (0.5, ["x and v are left out"]),  # next to no slow motion is lost: only that a alone leaves nothing says so
        (3.0, ["channel x is left out, as x loses motion below", "channel v is left out, as v loses motion below"]),
    ],
)
def test_a_displacement_that_lost_its_slow_motion_is_no_physics(
    tests: list[Recording], corner: float, told: list[str]
) -> None:
    answer = diagnose([integrated(test, corner) for test in tests], model=RIG, parameters=GIVEN)
    assert answer.verdict in ("consistent", "recalibrated"), answer.headline
    for sentence in told:
        assert any(sentence in note for note in answer.notes), answer.notes
