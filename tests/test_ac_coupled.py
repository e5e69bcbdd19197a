"""Sensors that lose slow motion or slow force: a phase that they turn is no damping, no relaxation and no resonance.

The rig is integrated here: one mass of 2 kg at 15.9 Hz, with or without a stop on one side.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest
from scipy.signal import butter, lfilter

from hystid import Diagnosis, check, diagnose
from hystid.diagnosis.prepare.ac_coupled import coupled
from hystid.recording import Recording

MASS, DAMPING, STIFFNESS = 2.0, 12.0, 2e4
RATE, N, STEPS = 1000.0, 6000, 6
NATURAL = (STIFFNESS / MASS) ** 0.5 / (2 * np.pi)
LINEAR = "HystId.Oscillators.Linear"


def noise(rng: np.random.Generator, values: np.ndarray, db: float) -> np.ndarray:
    return values + np.std(values) * 10 ** (-db / 20) * rng.standard_normal(len(values))


def record(kind: str, filtered: dict[str, float], channels: str, stop: float = 0.0, db: float = 45.0) -> Recording:
    """A chirp over the resonance, or noise. filtered: corner of a first-order high-pass over the resonance, by channel.
    stop: stiffness beyond 1 mm over that of the spring."""
    rng = np.random.default_rng(len(kind))
    t = np.arange(N) / RATE
    if kind == "chirp":
        force = 5.0 * np.sin(2 * np.pi * (0.3 * NATURAL * t + 0.95 * NATURAL * t**2 / t[-1]))
    else:
        lines = np.fft.rfft(rng.standard_normal(N))
        f = np.fft.rfftfreq(N, 1 / RATE)
        lines[(f < 0.1 * NATURAL) | (f > 4 * NATURAL)] = 0.0
        force = np.fft.irfft(lines, N)
        force *= 12.0 / np.std(force)
    motion = np.empty((3, N))
    state = np.zeros(2)
    dt = 1 / RATE / STEPS

    def slope(s: np.ndarray, F: float) -> np.ndarray:
        law = STIFFNESS * (s[0] + stop * max(s[0] - 1e-3, 0.0))
        return np.array([s[1], (F - DAMPING * s[1] - law) / MASS])

    for i in range(N):
        motion[:, i] = *state, slope(state, force[i])[1]
        change = (force[min(i + 1, N - 1)] - force[i]) / STEPS
        for k in range(STEPS):  # Heun; a step is a three hundredth of a period
            first = slope(state, force[i] + k * change)
            second = slope(state + dt * first, force[i] + (k + 1) * change)
            state = state + 0.5 * dt * (first + second)
    columns = {"F": force, **{name: motion["xva".index(name)] for name in channels}}
    columns = {name: noise(rng, values, db) for name, values in columns.items()}
    for name, corner in filtered.items():
        columns[name] = lfilter(*butter(1, corner * NATURAL, "high", fs=RATE), columns[name])
    return Recording(kind, t, **columns)


def asked(recordings: Sequence[Recording]) -> Diagnosis:
    return diagnose(recordings, model=LINEAR, parameters={"m": MASS})


@pytest.mark.parametrize(("channel", "channels"), [("a", "xva"), ("x", "xva"), ("x", "xa")])
def test_a_channel_that_loses_slow_motion_is_left_out(channel: str, channels: str) -> None:
    """The corner is far below the motion: only the phase is turned, by 2 degrees at the resonance."""
    answer = asked([record(kind, {channel: 0.03}, channels) for kind in ("chirp", "noise")])
    assert answer.verdict in ("consistent", "recalibrated"), answer.headline
    assert any(f"channel {channel} is left out" in note for note in answer.notes)


def test_a_sensor_that_is_seen_to_lose_slow_motion_is_left_out_everywhere() -> None:
    """The noise shows the filter, the chirp has no slow motion that would."""
    answer = asked([record(kind, {"a": 0.02}, "xa", db=50.0) for kind in ("noise", "chirp")])
    left = [note for note in answer.notes if "channel a is left out" in note]
    assert [note.split(":")[0] for note in left] == ["noise", "chirp"]
    assert answer.verdict in ("consistent", "recalibrated"), answer.headline


def test_an_ac_coupled_force_is_a_fault_of_the_sensor() -> None:
    answer = asked([record(kind, {"F": 0.05}, "xva") for kind in ("chirp", "noise")])
    assert answer.verdict == "sensor_fault", answer.headline
    (finding,) = answer.findings
    assert finding.effect == "force_high_pass"
    omega = finding.parameters["omega"]
    # five standard errors, as the noise of the force is summed up
    assert abs(omega.value - 2 * np.pi * 0.05 * NATURAL) < 5 * omega.stderr + 0.05 * omega.value


def test_an_ac_coupled_force_is_told_beside_a_stop() -> None:
    answer = asked([record(kind, {"F": 0.1}, "xva", stop=1.0, db=50.0) for kind in ("chirp", "noise")])
    named = [{finding.effect, *finding.alike} for finding in answer.findings]
    assert any("force_high_pass" in names for names in named)
    assert any({"contact_loss", "bilinear_stiffness"} & names for names in named)


def test_a_sound_rig_is_calm() -> None:
    answer = asked([record(kind, {}, "xva") for kind in ("chirp", "noise")])
    assert answer.verdict in ("consistent", "recalibrated")
    assert not any("left out" in note for note in answer.notes)


def test_a_displacement_that_was_interpolated_is_no_physics() -> None:
    """Another clock, read off between the samples: that takes the top of the noise, by which its level is told."""
    moved = []
    for kind in ("chirp", "noise"):
        made = record(kind, {}, "x", db=34.0)
        x = np.interp(made.t - 0.6 / RATE, made.t, made.channel("x"))
        moved.append(made.with_channels({"x": x}))
    assert asked(moved).verdict in ("consistent", "recalibrated", "sensor_fault")


def test_a_hardening_spring_that_outweighs_the_force_hides_no_mass() -> None:
    """Along a resonance that a cube bends, spring and inertia are ten times the force; x alone at 600 Hz."""
    rng = np.random.default_rng(1)
    rate, n, steps = 600.0, 6000, 8
    t = np.arange(n) / rate
    force = 120.0 * np.sin(2 * np.pi * (9.5 * t + 30.2 * t**2 / t[-1]))
    x = np.empty(n)
    s, dt = np.zeros(2), 1 / rate / steps

    def slope(s: np.ndarray, F: float) -> np.ndarray:
        return np.array([s[1], F - 20.0 * s[1] - 4e4 * s[0] - 4e9 * s[0] ** 3])

    for i in range(n):
        x[i] = s[0]
        change = (force[min(i + 1, n - 1)] - force[i]) / steps
        for k in range(steps):
            one = slope(s, force[i] + k * change)
            two = slope(s + dt * one, force[i] + (k + 1) * change)
            s = s + 0.5 * dt * (one + two)
    made = Recording("bent", t, F=noise(rng, force, 50.0), x=noise(rng, x, 50.0))
    found = check([made], mass=1.0)
    assert not found.findings, [str(one) for one in found.findings]
    balance = found.examined[0].balance
    assert balance is not None
    assert abs(balance.mass - 1.0) < 0.15  # as exact as a sound sensor is calibrated, three times over


def test_a_low_pass_of_the_force_is_no_resonance() -> None:
    """Four times above the resonance: late, weaker, and bent as by a second mass without a peak."""
    made = []
    for kind in ("chirp", "noise"):
        one = record(kind, {}, "xva", db=40.0)
        b, a = butter(2, 4 * NATURAL, fs=RATE)
        made.append(one.with_channels({"F": lfilter(b, a, one.channel("F"))}))
    answer = asked(made)
    assert not {finding.effect for finding in answer.findings} - {
        "channel_delay", "force_gain", "force_low_pass", "force_high_pass"
    }, answer.headline  # fmt: skip
    assert answer.verdict in ("sensor_fault", "unknown_physics")


def test_a_stretch_at_rest_says_nothing_of_a_corner() -> None:
    """Coarse channels stand still there, to the last digit: the corner was a ratio of two zeros, and a traceback."""
    test = record("chirp", {}, "xv")
    before = np.zeros(N // 2)
    channels = {name: np.concatenate([before, test.channel(name)]) for name in "Fxv"}
    step = {name: np.std(values) / 50 for name, values in channels.items()}
    coarse = {name: np.round(values / step[name]) * step[name] for name, values in channels.items()}
    coarse["x"] = coarse["x"] - 0.026078  # off its zero, by a number of which the mean is rounded
    whole = Recording("after a rest", np.arange(len(coarse["F"])) / RATE, **coarse)
    assert coupled([whole]) is None
