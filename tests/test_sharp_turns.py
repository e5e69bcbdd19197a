"""Triangles, as testing machines drive them: where a motion turns, the bias of the smoother is an error to know."""

import numpy as np
import pytest
from scipy.signal import butter, sosfilt

from hystid import diagnose
from hystid.diagnosis.prepare.segments import prepare_part
from hystid.recording import Recording
from hystid.smoothing.smoother import bias, smooth

_OVER, _PERIOD, _CYCLES = 16, 180, 12  # steps of the simulation per sample, samples per cycle
_ROUND = 0.02  # of a cycle, within which it turns


def _triangle() -> tuple[np.ndarray, np.ndarray]:
    """Displacement of peak 1, and velocity in units of it per sample, (n,) each."""
    turns = np.arange(_PERIOD * _CYCLES * _OVER) / (_PERIOD * _OVER)
    width = int(_PERIOD * _OVER * _ROUND)
    window = np.hanning(width + 2)[1:-1] / np.sum(np.hanning(width + 2))
    sharp = 1 - np.abs((turns + 0.75) % 1 * 4 - 2)
    x = np.convolve(np.pad(sharp, (width // 2, width - 1 - width // 2), "edge"), window, "valid")
    return x[::_OVER], np.gradient(x, 1 / _OVER)[::_OVER]


def _noisy(y: np.ndarray, snr: float, rng: np.random.Generator) -> np.ndarray:
    return np.asarray(y + 10 ** (-snr / 20) * np.std(y) * rng.standard_normal(len(y)))


@pytest.mark.parametrize("snr", [34, 46])
def test_the_bias_of_the_smoother_is_known_where_a_motion_turns(snr: float) -> None:
    rng = np.random.default_rng(1)
    x, v = _triangle()
    noise = {"x": 10 ** (-snr / 20) * float(np.std(x))}
    measured = {"x": _noisy(x, snr, rng)}
    found = smooth(measured, noise, 1.0)
    drawn = {"x": noise["x"] * rng.standard_normal(len(x))}
    errors = smooth(drawn, noise, 1.0, found.roughness).v
    away = bias(measured, noise, 1.0, found, drawn=drawn)[1]
    turns = np.abs(np.gradient(v)) > 0.02 * np.max(np.abs(v))
    error = float(np.std((found.v - v)[turns]))
    assert error > 3 * np.std(errors)  # noise tells a third of it at most
    # Half an octave stands for all that lies beyond: a factor of two either way.
    assert 0.5 < error / float(np.sqrt(np.mean(away[turns] ** 2 + np.var(errors)))) < 2


def test_a_sine_has_no_bias() -> None:
    rng, x = np.random.default_rng(2), np.sin(2 * np.pi * np.arange(3000) / 70)
    noise = {"x": 0.02 * float(np.std(x))}
    measured, drawn = ({"x": y + noise["x"] * rng.standard_normal(len(x))} for y in (x, 0 * x))
    found = smooth(measured, noise, 1.0)
    away = bias(measured, noise, 1.0, found, drawn=drawn)
    # Noise reaches the limit in one sample of a thousand, and takes its surroundings with it.
    assert np.mean(away[0] != 0) < 0.03


@pytest.mark.parametrize(("of_x", "of_force"), [(46, 34), (46, 60), (40, 34)])
def test_a_damper_under_a_triangle_is_sound(of_x: float, of_force: float) -> None:
    """Velocities jump at each turn, where a displacement with noise shows them a few samples wide."""
    rng = np.random.default_rng(3)
    x, v = _triangle()
    dt, k = 0.01, 1e5
    c = 0.1 * k / (2 * np.pi / _PERIOD) * dt
    force = k * x + c * v / dt
    test = Recording("triangle", np.arange(len(x)) * dt, x=_noisy(x, of_x, rng), F=_noisy(force, of_force, rng))
    believed = {"m": 0.0, "B": 0.9 * c, "Kl": 1.05 * k}
    answer = diagnose(test, model="HystId.Oscillators.Linear", parameters=believed)
    assert answer.verdict == "recalibrated", answer.headline


def test_no_bias_is_told_behind_a_filter() -> None:
    """What would show it is gone; and the bias of a part has the length of the part."""
    rng = np.random.default_rng(4)
    x, _ = _triangle()
    low_pass = butter(8, 0.7, output="sos")
    noisy = {name: sosfilt(low_pass, _noisy(values, 60, rng)) for name, values in (("x", x), ("F", 1e5 * x))}
    part = prepare_part(Recording("filtered", np.arange(len(x)) * 0.01, **noisy))
    assert part.noise_ends < min(0.5, 2 * part.follows)
    assert all(len(u) == len(x) and not np.any(u) for u in part.jitter.bias)
