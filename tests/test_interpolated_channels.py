"""Channels that a user interpolated to the rate of the others."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.interpolate import CubicSpline, PchipInterpolator

from benchmarks.sound_rigs import sound_rig
from hystid.compiled import CompiledModel
from hystid.diagnosis import diagnose
from hystid.diagnosis.prepare.interpolated import where_measured
from hystid.modelica import compile_model
from hystid.recording import Recording

LINEAR = "HystId.Oscillators.Linear"
T = np.arange(4000) * 1e-3


def swing(rng: np.random.Generator) -> np.ndarray:
    return np.asarray(np.sin(2 * np.pi * 7 * T) + 0.02 * rng.standard_normal(len(T)))


def between(values: np.ndarray, known: np.ndarray, kind: str) -> np.ndarray:
    if kind == "linear":
        return np.asarray(np.interp(T, known, values))
    return np.asarray((CubicSpline if kind == "spline" else PchipInterpolator)(known, values)(T))


@pytest.mark.parametrize("step", [4, 5, 8])
@pytest.mark.parametrize("kind", ["linear", "spline", "pchip"])
@pytest.mark.parametrize("first", [0, 3])
def test_samples_that_were_measured_are_found(step: int, kind: str, first: int) -> None:
    rng = np.random.default_rng(step)
    x, F = swing(rng), rng.standard_normal(len(T))
    written = np.array([float(f"{value:.7g}") for value in between(x[first::step], T[first::step], kind)])
    used = where_measured(Recording("r", T, F=F, x=written), 200)
    assert len(used) == len(T[first::step])
    assert used.x == pytest.approx(x[first::step], rel=1e-6)
    assert pytest.approx(F[first::step], abs=0) == used.F
    assert f"one sample in {step} was measured" in used.notes[-1]


@pytest.mark.parametrize("rate", [300.0, 256.0, 100.0])
def test_a_rate_that_is_no_share_of_the_other_is_found(rate: float) -> None:
    rng, known = np.random.default_rng(1), np.arange(0, 4.1, 1 / rate) + 3e-4
    values = np.sin(2 * np.pi * 7 * known) + 0.02 * rng.standard_normal(len(known))
    used = where_measured(Recording("r", T, F=rng.standard_normal(len(T)), x=between(values, known, "linear")), 200)
    assert len(T) / len(used) == pytest.approx(np.ceil(1000 / rate), rel=0.01)


def test_what_was_measured_at_every_sample_stays() -> None:
    rng = np.random.default_rng(2)
    x = swing(rng)
    blows = np.sum([np.exp(-(((T - at) / 0.004) ** 2)) for at in (1, 2, 3)], axis=0)
    for values in (
        x,
        np.sin(2 * np.pi * 5 * T),
        2 * np.abs((5 * T) % 1 - 0.5),  # a triangle
        2 * np.abs((125 * T) % 1 - 0.5),
        np.sign(np.sin(2 * np.pi * 5 * T)),
        np.clip(3 * np.sin(20 * T), -1, 1),
        np.round(50 * x) / 50,  # an encoder
        np.round(800 * np.sin(2 * np.pi * 2 * T)) / 800,
        np.repeat(x[::4], 4),  # a slow display, which ``noise.steps`` sees
        np.exp(-3 * T) * np.sin(2 * np.pi * 20 * T),
        blows,
        np.interp(T, np.sort(rng.uniform(0, 4, 80)), rng.standard_normal(80)),
        np.zeros(len(T)),
    ):
        recording = Recording("r", T, F=rng.standard_normal(len(T)), x=values)
        assert where_measured(recording, 200) is recording


@given(st.integers(0, 2**32 - 1), st.floats(0, 1), st.integers(1, 400), st.sampled_from(["walk", "noise", "levels"]))
@settings(max_examples=60, deadline=None)
def test_any_channel_is_taken(seed: int, resting: float, count: int, kind: str) -> None:
    """Channels that rest, jump and go on: nothing is divided by nothing, and what remains was there."""
    rng = np.random.default_rng(seed)
    steps = rng.standard_normal(200 + count) * (rng.random(200 + count) > resting)
    values = {"walk": np.cumsum(steps), "noise": steps, "levels": np.round(np.cumsum(steps))}[kind]
    t = np.arange(len(values)) * 1e-3
    with np.errstate(all="raise"):
        used = where_measured(Recording("r", t, F=rng.standard_normal(len(t)), x=values), 200)
    assert used.x is not None
    assert set(used.x) <= set(values)


@pytest.mark.parametrize("kind", ["linear", "spline"])
def test_a_sound_rig_whose_displacement_was_interpolated_is_sound(kind: str) -> None:
    model, values, rng = CompiledModel(compile_model(LINEAR)), {"m": 1.0, "B": 5.0, "Kl": 2e4}, np.random.default_rng(3)
    tests = []
    for name in ("one", "other"):
        F = 5 * np.sin(2 * np.pi * (5 * T + 3.5 * T**2)) + rng.standard_normal() * np.sin(2 * np.pi * 17 * T)
        x = model.simulate({"F": F}, 1e-3, parameters=values, outputs=("x",), interpolation="cubic")["x"]
        noisy = [u + share * np.std(u) * rng.standard_normal(len(T)) for u, share in ((F, 0.003), (x, 0.02))]
        tests.append(Recording(name, T, F=noisy[0], x=between(noisy[1][::4], T[::4], kind)))
    found = diagnose(tests, model=LINEAR, parameters={**values, "B": 4.5})
    assert found.verdict in ("consistent", "recalibrated")
    assert sum("was measured, and the others are not used" in note for note in found.notes) == len(tests)


def test_a_law_that_has_no_answer_in_few_samples_stops_no_diagnosis() -> None:
    """At a quarter of the samples a hidden mode that is begun beside its end may be too quick for them."""
    recording, model, believed, _ = sound_rig(996930, "x", "interpolated")
    assert diagnose(recording, model=model, parameters=believed).verdict != "not_applicable"
