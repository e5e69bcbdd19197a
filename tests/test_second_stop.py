"""Of two stops at different distances the motion may touch the farther one by little."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from hystid.diagnosis import diagnose
from hystid.recording import Recording

MODEL = "HystId.Oscillators.Linear"
TRUE = {"m": 2.0, "B": 12.0, "Kl": 3e4}
STIFF, NEAR, FAR = 4e5, 1e-3, 1.5e-3  # N/m, m, m
RATE, SECONDS = 2000.0, 3.0


def harmonic(name: str, level: float, seed: int) -> Recording:
    """A rig that is driven near its resonance, as its own equation of motion has it; noise at 60 dB."""
    t = np.arange(0, SECONDS, 1 / RATE)
    omega = 0.93 * np.sqrt(TRUE["Kl"] / TRUE["m"])

    def acceleration(time: float, x: float, v: float) -> float:
        stops = STIFF * (max(x - FAR, 0.0) + min(x + NEAR, 0.0))
        force = level * np.sin(omega * time)
        return float((force - TRUE["B"] * v - TRUE["Kl"] * x - stops) / TRUE["m"])

    made = solve_ivp(
        lambda u, y: (y[1], acceleration(u, *y)), (0, SECONDS), (0, 0), t_eval=t, max_step=0.5 / RATE, rtol=1e-9,
        atol=1e-12,
    )  # fmt: skip
    x, v = made.y
    a = np.array([acceleration(*row) for row in zip(t, x, v, strict=True)])
    rng = np.random.default_rng(seed)
    told = {"F": level * np.sin(omega * t), "x": x, "v": v, "a": a}
    return Recording(name, t, **{q: u + 1e-3 * np.std(u) * rng.standard_normal(len(t)) for q, u in told.items()})


def test_a_second_stop_that_is_hardly_touched_is_found_from_the_first() -> None:
    tests = [harmonic("test_1", 8.0, 0), harmonic("test_2", 12.0, 1)]
    assert sum(np.count_nonzero(test.channel("x") > 1.005 * FAR) for test in tests) < 15
    found = diagnose(tests, model=MODEL, parameters=TRUE)
    assert [finding.effect for finding in found.findings] == ["two_sided_stop"]
    values = found.findings[0].parameters
    near = values["gap"].value
    assert near == pytest.approx(NEAR, rel=0.005)  # five times the noise of x
    assert near / (1 - values["lean"].value) == pytest.approx(FAR, rel=0.02)  # a dozen samples say where it is
