"""Joint smoothing of x, v, a: exact where there is nothing to smooth, better than any channel alone where there is."""

import numpy as np

from hystid.identification.methods import smoothed
from hystid.recording import Recording
from hystid.recording.types import PSEUDO_TIME

DT = 1e-3
T = np.arange(4000) * DT


def motion():
    """Two sines: x, v, a in closed form."""
    x = v = a = 0.0
    for amplitude, w, phase in ((1e-3, 40.0, 0.3), (2e-4, 170.0, 1.1)):
        x = x + amplitude * np.sin(w * T + phase)
        v = v + amplitude * w * np.cos(w * T + phase)
        a = a - amplitude * w**2 * np.sin(w * T + phase)
    return {"x": x, "v": v, "a": a}


def noisy(level, seed=0):
    rng = np.random.default_rng(seed)
    return {name: values + level * values.std() * rng.standard_normal(len(T)) for name, values in motion().items()}


def relative(values, reference):
    return np.sqrt(np.mean((values - reference) ** 2)) / reference.std()


def test_every_channel_gets_better():
    clean, raw = motion(), noisy(0.02)
    found = smoothed(Recording("r", T, F=T, **raw))
    for name, reference in clean.items():
        # x and v by about 6, as a steadies them; a by the square root of the part of the band that the signal needs
        assert relative(getattr(found, name), reference) < 0.5 * relative(raw[name], reference)


def test_clean_channels_pass():
    found = smoothed(Recording("r", T, F=T, **motion()))
    for name, reference in motion().items():
        # what is left is the smoother's own error, largest in the second derivative
        assert relative(getattr(found, name), reference) < 1e-4


def test_result_is_one_motion():
    """v and a are the derivatives of x: central differences of a step of 1 ms are good to (w dt)^2 / 6 = 5e-3."""
    found = smoothed(Recording("r", T, F=T, **noisy(0.02)))
    inner = slice(5, -5)
    assert relative(np.gradient(found.x, DT)[inner], found.v[inner]) < 0.02
    assert relative(np.gradient(found.v, DT)[inner], found.a[inner]) < 0.02


def test_displacement_alone_gives_velocity_and_acceleration():
    raw = noisy(1e-3)
    found = smoothed(Recording("r", T, F=T, x=raw["x"]))
    assert relative(found.v, motion()["v"]) < 0.01
    assert relative(found.a, motion()["a"]) < 0.1
    assert found.origin["a"] == "joint smoothing of x"
    assert "smoothed jointly from x (noise" in found.notes[-1]


def test_derived_channels_take_no_part():
    raw = noisy(1e-3)
    wrong = {"v": "dx/dt, somehow", "a": "dv/dt, somehow"}
    rubbish = Recording("r", T, F=T, x=raw["x"], v=0 * T, a=0 * T, origin=wrong)
    assert np.array_equal(smoothed(rubbish).v, smoothed(Recording("r", T, F=T, x=raw["x"])).v)


def test_simulated_channels_count_as_measured():
    raw, simulated = noisy(0.02), dict.fromkeys(("x", "v", "a"), "simulated")
    plain, virtual = Recording("r", T, F=T, **raw), Recording("r", T, F=T, origin=simulated, **raw)
    assert np.array_equal(smoothed(virtual).a, smoothed(plain).a)


def test_restoring_force_that_was_derived_is_formed_anew():
    raw = noisy(0.02)
    derived = Recording("r", T, F=T, R=T, origin={"R": "F - m a with m = 1 kg"}, **raw)
    assert smoothed(derived).R is None
    assert smoothed(Recording("r", T, F=T, R=T, **raw)).R is not None


def test_recordings_that_cannot_be_smoothed_come_back():
    raw = noisy(0.02)
    quasi_static = Recording("q", T, F=T, x=raw["x"], origin={"t": PSEUDO_TIME})
    short = Recording("s", T[:50], F=T[:50], x=raw["x"][:50])
    upwards = Recording("u", T, F=T, a=raw["a"])
    for recording in (quasi_static, short, upwards):
        assert smoothed(recording) is recording
