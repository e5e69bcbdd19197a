"""Whether a force channel stops at a level: the law is a witness where channels show the motion, and of both sides."""

import numpy as np
import pytest

from hystid.compiled import CompiledModel
from hystid.diagnosis import diagnose
from hystid.diagnosis.decide.assumptions import tells_half
from hystid.diagnosis.fit.case import Case, pose
from hystid.diagnosis.fit.clipped import error_of
from hystid.diagnosis.model.catalogue import catalogue_of
from hystid.diagnosis.model.library import load_effects
from hystid.diagnosis.prepare.given import given_parameters
from hystid.diagnosis.prepare.recordings import take
from hystid.modelica import compile_model
from hystid.recording import Recording
from hystid.recording.types import PSEUDO_TIME

MODEL = "HystId.Oscillators.Linear"
TRUE = {"m": 2.0, "B": 12.0, "Kl": 3e4}
RATE, COUNT = 1200.0, 6000
SLOW = 12.0  # N


def posed(*channels: str) -> Case:
    """A sweep over the resonance beside a force of 0.5 Hz, with some channels of the motion; noise at 28 dB."""
    rng, t = np.random.default_rng(4), np.arange(COUNT) / RATE
    F = 10 * np.sin(2 * np.pi * (10 * t + 10 * t**2 / t[-1])) + SLOW * np.sin(np.pi * t)
    y = CompiledModel(compile_model(MODEL)).simulate({"F": F}, 1 / RATE, parameters=TRUE, outputs=("x", "v", "a"))
    told = {"F": F, **{name: y[name] for name in channels}}
    noisy = {name: u + 0.04 * np.std(u) * rng.standard_normal(COUNT) for name, u in told.items()}
    return pose(
        take([Recording("test", t, **noisy)], [], given_parameters(TRUE)), MODEL, catalogue_of(load_effects([]))
    )


@pytest.mark.parametrize(("channels", "seen"), [("xva", True), ("v", False)])
def test_what_no_channel_shows_is_an_error_of_what_is_told(channels: str, seen: bool) -> None:
    case = posed(*channels)
    problem, here = case.problem, case.refit.hypothesis
    pairs = zip(problem.parts, problem.predicted(here), strict=True)
    told = [here.mass() * part.a + force for part, force in pairs]
    slow = SLOW / np.sqrt(2)  # rms of the slow force, of which v shows nothing at 28 dB
    assert (error_of(problem, here, told) < 0.5 * slow) == seen


def test_a_choice_of_channels_that_tells_next_to_nothing_is_none() -> None:
    """Where the noise of the motion moves the force by more than that of its channel, rows are weighed down."""
    case, other = posed("x", "v", "a"), posed("x", "v", "a")
    assert tells_half(other.problem, case.problem)
    rows = other.problem.reduce.count
    loud = np.where(np.arange(rows) < 0.8 * rows, 10.0, 0.0)
    other.problem.reduce.distrust([loud], np.zeros(rows), np.zeros(rows))
    assert not tells_half(other.problem, case.problem)
    assert tells_half(case.problem, other.problem)


@pytest.mark.parametrize("noise", [0.0, 0.02])
@pytest.mark.parametrize(("channels", "limited"), [("xva", "amplifier"), ("a", "amplifier"), ("xva", "channel")])
def test_a_force_that_an_amplifier_limits_is_no_channel_that_stops(noise: float, channels: str, limited: str) -> None:
    """The same flat tops in F: the motion says whether the force went on. Without noise, and at 34 dB."""
    rng, t = np.random.default_rng(4), np.arange(COUNT) / RATE
    whole = 10 * np.sin(2 * np.pi * (4 * t + 2 * t**2))
    flat = np.clip(whole, -8.0, 8.0)
    drive = {"F": flat if limited == "amplifier" else whole}
    y = CompiledModel(compile_model(MODEL)).simulate(drive, 1 / RATE, parameters=TRUE, outputs=("x", "v", "a"))
    motion = {name: y[name] + noise * np.std(y[name]) * rng.standard_normal(COUNT) for name in channels}
    found = diagnose([Recording("test", t, F=flat, **motion)], model=MODEL, parameters=TRUE)
    named = {finding.effect for finding in found.findings}
    assert named == ({"sensor_saturation"} if limited == "channel" else set())
    assert any("an actuator at its limit" in note for note in found.notes) == (limited == "amplifier")


@pytest.mark.parametrize("model", ["Linear", "Jenkins"])
def test_a_slider_without_noise_is_no_channel_that_stops(model: str) -> None:
    """Dry friction holds the force at one value, to the last digit, for half of a slow cyclic test."""
    t = np.arange(4000) / 200.0
    x = 1e-3 * np.sin(0.4 * np.pi * t) * np.linspace(0.3, 1.0, len(t))
    F = np.zeros_like(x)
    for k in range(1, len(x)):
        F[k] = np.clip(F[k - 1] + 2e4 * (x[k] - x[k - 1]), -5.0, 5.0)
    cycles = Recording("cycles", t, F=F, x=x, origin={"t": PSEUDO_TIME})
    given = {"Linear": {"m": 0.0, "Kl": 2e4}, "Jenkins": {"m": 0.0, "Kl": 2e3, "Ks": 1.5e4, "fc": 4.0}}
    found = diagnose([cycles], model=f"HystId.Oscillators.{model}", parameters=given[model])
    assert [finding.effect for finding in found.findings] == (["hysteretic_friction"] if model == "Linear" else [])


@pytest.mark.parametrize("kind", ["square", "pulses", "steps", "binary"])
@pytest.mark.parametrize("channels", ["xva", "x"])
def test_a_force_that_is_switched_neither_stops_nor_is_coarse(kind: str, channels: str) -> None:
    """Without noise it stands at its largest value, and rests at few, for most of the time."""
    fine, rng = np.arange(40_000) / 1e4, np.random.default_rng(3)
    F = {
        "square": 6 * np.where(np.sin(6 * np.pi * fine) >= 0, 1.0, -1.0),
        "pulses": 6.0 * (2 * fine % 1 < 0.1),
        "steps": 3 * np.round(2 * np.sin(1.4 * np.pi * fine)),
        "binary": np.repeat(rng.choice([-6.0, 6.0], 200), 200),
    }[kind]
    y = CompiledModel(compile_model(MODEL)).simulate(
        {"F": F}, 1e-4, parameters=TRUE, outputs=("x", "v", "a"), interpolation="linear"
    )
    motion = {name: y[name][::10] for name in channels}
    found = diagnose([Recording(kind, fine[::10], F=F[::10], **motion)], model=MODEL, parameters=TRUE)
    assert found.findings == () and found.verdict in ("consistent", "recalibrated")


def held_cycles(clipped: float | None = None) -> Recording:
    """Trapezoids of a displacement against a spring and a slider, without noise; clipped: level of x [m]."""
    t = np.arange(4000) / 50.0
    phase = t / 8 % 1
    triangle = np.where(phase < 0.25, 4 * phase, np.where(phase < 0.75, 2 - 4 * phase, 4 * phase - 4))
    x = 5e-3 * (np.clip(1.5 * triangle, -1.0, 1.0) if clipped is None else triangle)
    slider = np.zeros_like(x)
    for k in range(1, len(x)):
        slider[k] = np.clip(slider[k - 1] + 4e5 * (x[k] - x[k - 1]), -600.0, 600.0)
    shown = x if clipped is None else np.clip(x, -clipped, clipped)
    return Recording("cycles", t, F=2e5 * x + slider, x=shown, origin={"t": PSEUDO_TIME})


@pytest.mark.parametrize("clipped", [None, 4e-3])
def test_a_displacement_that_is_held_is_no_channel_that_stops(clipped: float | None) -> None:
    """Where it is held the force stays as well; where its channel stops the force goes on."""
    given = {"m": 0.0, "B": 0.0, "Kl": 2e5, "Ks": 4e5, "fc": 500.0}
    found = diagnose([held_cycles(clipped)], model="HystId.Oscillators.Jenkins", parameters=given)
    assert [f.effect for f in found.findings] == ([] if clipped is None else ["sensor_saturation"])
