"""Contacts whose force jumps where the motion turns, and a refit that something missing has led astray."""

from collections.abc import Callable

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from hystid.diagnosis import diagnose
from hystid.numeric import Array
from hystid.recording import Recording
from hystid.smoothing.noise import NOISE_ERROR
from tests.test_colour import noise
from tests.test_real_recordings import names

CONTACT = "HystId.Oscillators.PecorariSolodov"


def pecorari(x: Array, v: Array, stiffness: float, x0: float, x1: float) -> Array:
    """Pecorari and Solodov (2006), turning at once [N]."""
    way = np.sign(v)
    return np.asarray(stiffness * way * (0.5 * (x0 - x1) - np.maximum(-way * x - x1, 0.0)))


def multisine(
    seed: int, rate: float, band: tuple[float, float], size: float, force: Callable[[Array, Array, Array], Array],
    channels: str, pink: float = 0.0,
) -> Recording:  # fmt: skip
    """A motion that is given, the force that it takes, with white noise of 34 dB and 1/f noise on every channel."""
    rng, t = np.random.default_rng(seed), np.arange(8000) / rate
    w, phase = 2 * np.pi * rng.uniform(*band, 9), rng.uniform(0, 2 * np.pi, 9)
    share = rng.uniform(0.3, 1.0, 9) / w
    x, v, a = (np.sum(share * w**k * np.sin(np.outer(t, w) + phase + k * np.pi / 2), axis=1) for k in range(3))
    x, v, a = (size / np.max(np.abs(x)) * y for y in (x, v, a))
    columns = {"F": force(x, v, a), "x": x, "v": v, "a": a}
    seen = {
        name: y + 10 ** (-34 / 20) * np.std(y) * noise(rng, pink, len(t))
        for name, y in columns.items()
        if name in "F" + channels
    }
    return Recording(f"test {seed}", t, **seen)


@pytest.mark.parametrize("pink", [0.03, 0.06])
def test_the_right_laws_leave_noise_beside_a_contact_that_turns(pink: float) -> None:
    """The refit without them jumps at other places, and takes 1/f noise for a force: it was 66 and 72 % sure."""

    def force(x: Array, v: Array, a: Array) -> Array:
        missing = 1.35e4 * np.abs(v) * v + 2e12 * x**3
        return 3.16 * a + 50 * v + 1.77e5 * x + pecorari(x, v, 9.5e4, 5.6e-4, 2.7e-4) + missing

    tests = [multisine(seed, 3500.0, (12, 75), 4e-4, force, "xa", pink) for seed in (1, 2)]
    believed = {"m": 3.16, "B": 70.0, "Kl": 1.2e5, "Ks": 7e4, "x0": 7e-4, "x1": 2e-4}
    found = diagnose(tests, model=CONTACT, parameters=believed)
    assert set(names(found)) == {"quadratic_damping", "cubic_stiffness"}
    assert min(finding.confidence for finding in found.findings) > 0.9  # right laws leave no more than noise
    assert found.findings[0].evidence["chi2_after"] < found.findings[0].evidence["floor"] + NOISE_ERROR
    assert found.problem is not None
    assert np.mean(found.problem.reduce.told()) > 0.5  # far from a turn it is known where a contact stands


def test_a_refit_leaves_a_contact_a_contact() -> None:
    """One that turns over more than the motion's own speed is a damper, which took what was missing."""

    def force(x: Array, v: Array, a: Array) -> Array:
        contact = pecorari(x, v, 9.617e4, 5.31e-3, 2.99e-3)
        return 42.6 * a + 362 * v + 5.27268e5 * x + contact + 4518 * np.abs(v) * v

    tests = [multisine(seed, 1700.0, (6, 34), 4.3e-3, force, "xv") for seed in (1, 3)]
    believed = {"m": 42.574, "B": 386.8, "Kl": 4.941e5, "Ks": 1.068e5, "x0": 6.254e-3, "x1": 3.2462e-3}
    found = diagnose(tests, model=CONTACT, parameters=believed)
    assert names(found) == ["quadratic_damping"]
    fastest = max(float(np.max(np.abs(test.v))) for test in tests if test.v is not None)
    assert found.problem is not None and found.final is not None
    most = found.problem.baseline.highest["v_turn"]
    assert most == pytest.approx(0.05 * fastest, rel=0.1)  # noise of 2 % is in the largest sample
    assert found.final.hypothesis.values["v_turn"] <= most


def test_a_spring_with_a_knee_is_no_hysteresis() -> None:
    """Bouc-Wen without gamma loads and unloads along one line: it loses nothing, and was friction at 100 %."""
    rate, place = 700.0, np.arange(3000) / 700.0
    phase, fade = 2 * np.pi * (8 * place + 2.3 * place**2), np.minimum(1.0, 5 * np.sin(np.pi * place / place[-1]))
    x = np.concatenate([size * fade * np.sin(phase) for size in (3e-4, 6e-4, 1e-3)])
    t = np.arange(len(x)) / rate
    v, a = (CubicSpline(t, x)(t, order) for order in (1, 2))
    step, way = 5e-7, np.zeros(2001)
    for i in range(2000):  # midpoint rule over the displacement, in steps of a thousandth of 0.5 mm
        half = way[i] + 0.5 * step / 5e-4 * (1 - way[i] ** 4)
        way[i + 1] = way[i] + step / 5e-4 * (1 - half**4)
    F = 14 * a + 80 * v + 1.2e5 * x + 60 * np.sign(x) * np.interp(np.abs(x), step * np.arange(2001), way)
    rng = np.random.default_rng(1)
    seen = {n: y + 1e-3 * np.std(y) * rng.standard_normal(len(y)) for n, y in (("F", F), ("x", x), ("v", v))}
    found = diagnose(
        Recording("knee", t, **seen),
        model="HystId.Oscillators.Linear",
        parameters={"m": 14.0, "B": 78.0, "Kl": 1.75e5},
    )
    assert names(found) == ["cubic_stiffness"]
