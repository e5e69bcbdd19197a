"""Smoothing against the dense Gaussian answer, which shares no line with the recursion."""

from collections.abc import Mapping

import numpy as np
import pytest
from scipy.signal import lfilter

from hystid.errors import UsageError
from hystid.smoothing.noise import louder_for_a_while
from hystid.smoothing.smoother import Roughness, error_of_x, smooth


def _dense(
    channels: dict[str, np.ndarray], noise: Mapping[str, float | np.ndarray], dt: float, level: float
) -> np.ndarray:
    """Posterior mean of x at all samples for white jerk, by one linear solve over all states."""
    n = len(channels["x"])
    A = np.array([[1, 1, 0.5], [0, 1, 1], [0, 0, 1.0]])
    Q = level * np.array([[1 / 20, 1 / 8, 1 / 6], [1 / 8, 1 / 3, 1 / 2], [1 / 6, 1 / 2, 1.0]])
    H, b = np.zeros((3 * n, 3 * n)), np.zeros(3 * n)
    weight = np.linalg.inv(Q)
    for k in range(n - 1):
        here, ahead = slice(3 * k, 3 * k + 3), slice(3 * k + 3, 3 * k + 6)
        H[here, here] += A.T @ weight @ A
        H[ahead, ahead] += weight
        H[here, ahead] -= A.T @ weight
        H[ahead, here] -= weight @ A
    for row, name in enumerate("xva"):
        for k in np.flatnonzero(np.isfinite(channels[name])):
            precision = 1 / (float(np.broadcast_to(noise[name], n)[k]) * dt**row) ** 2
            H[3 * k + row, 3 * k + row] += precision
            b[3 * k + row] += precision * channels[name][k] * dt**row
    return np.linalg.solve(H, b).reshape(n, 3)


def _motion(n: int, dt: float) -> dict[str, np.ndarray]:
    t, w = np.arange(n) * dt, 2 * np.pi * 7.0
    return {"x": np.sin(w * t), "v": w * np.cos(w * t), "a": -w * w * np.sin(w * t)}


def test_recursion_is_the_dense_posterior() -> None:
    rng = np.random.default_rng(1)
    dt, true = 2e-3, _motion(60, 2e-3)
    noise = {name: 0.05 * float(np.std(values)) for name, values in true.items()}
    measured = {name: values + noise[name] * rng.standard_normal(60) for name, values in true.items()}
    found = smooth(measured, noise, dt, Roughness(3, 1e-6))
    dense = _dense(measured, noise, dt, 1e-6)
    # The recursion starts from a wide but finite belief, the dense answer from none: 1e-4 of the noise is its trace.
    assert np.allclose(found.x, dense[:, 0], atol=0.02 * noise["x"])
    assert np.allclose(found.a * dt**2, dense[:, 2], atol=0.02 * noise["a"] * dt**2)


def test_a_gap_in_a_steady_recursion_is_the_dense_posterior() -> None:
    """After some 50 samples the covariance is steady and is carried on no more, until a gap disturbs it."""
    rng = np.random.default_rng(3)
    dt, n = 2e-3, 400
    true = _motion(n, dt)
    noise = {name: 0.05 * float(np.std(values)) for name, values in true.items()}
    measured = {name: values + noise[name] * rng.standard_normal(n) for name, values in true.items()}
    measured["a"][250:260] = np.nan
    for values in measured.values():
        values[300:303] = np.nan
    found = smooth(measured, noise, dt, Roughness(3, 1e-4))
    dense = _dense(measured, noise, dt, 1e-4)
    # Far from the start, of which a trace is left (see above), the two agree to rounding.
    assert np.allclose(found.x[100:], dense[100:, 0], atol=1e-6 * noise["x"])
    assert np.allclose(found.a[100:] * dt**2, dense[100:, 2], atol=1e-6 * noise["a"] * dt**2)


def test_noise_that_is_louder_for_a_while_weighs_less() -> None:
    rng = np.random.default_rng(4)
    dt, n = 2e-3, 400
    true = _motion(n, dt)
    noise = {name: 0.02 * float(np.std(values)) for name, values in true.items()}
    louder = {"x": np.ones(n), "a": np.ones(n)}
    louder["x"][200:240], louder["a"][220:300] = 20.0, np.geomspace(1, 30, 80)
    each = {name: noise[name] * louder.get(name, np.ones(n)) for name in true}
    measured = {name: values + each[name] * rng.standard_normal(n) for name, values in true.items()}
    found = smooth(measured, noise, dt, Roughness(3, 1e-4), louder)
    dense = _dense(measured, each, dt, 1e-4)
    assert np.allclose(found.x[100:], dense[100:, 0], atol=1e-6 * noise["x"])  # rounding, far from the start
    assert np.allclose(found.a[100:] * dt**2, dense[100:, 2], atol=1e-6 * noise["a"] * dt**2)


def test_pauses_of_a_simulated_force_are_no_quiet_noise() -> None:
    """Noise is not louder than nothing at all: the ratio has no value there, and the recording no finite weight."""
    burst = np.random.default_rng(3).standard_normal(24 * 200) * np.repeat(np.geomspace(1.0, 30.0, 24), 200)
    burst[: 5 * 200] = 0.0
    with np.errstate(all="raise"):
        assert louder_for_a_while(burst) is None


@pytest.mark.parametrize("names", ["xva", "xa", "x"])
def test_noise_falls_and_the_stated_error_is_honest(names: str) -> None:
    rng = np.random.default_rng(2)
    dt, true = 1e-3, _motion(3000, 1e-3)
    noise = {name: 0.02 * float(np.std(true[name])) for name in names}
    measured = {name: true[name] + noise[name] * rng.standard_normal(3000) for name in names}
    found = smooth(measured, noise, dt)
    error = float(np.std((found.x - true["x"])[50:-50]))
    assert error < 0.6 * noise["x"]
    assert 0.3 < error / found.stderr[0] < 3.0  # the signal is no white-jerk process: the order of size is what counts


def test_a_gap_is_bridged_by_the_other_channels() -> None:
    dt, true = 1e-3, _motion(1000, 1e-3)
    noise = {name: 1e-3 * float(np.std(values)) for name, values in true.items()}
    gap = {**true, "a": np.where(np.abs(true["a"]) > 0.9 * np.max(true["a"]), np.nan, true["a"])}
    found = smooth(gap, noise, dt)
    assert np.std(found.a - true["a"]) < 0.02 * np.std(true["a"])


@pytest.mark.parametrize("names", ["x", "xv", "xva"])
def test_the_spectrum_of_what_noise_leaves_is_that_of_smoothed_noise(names: str) -> None:
    rng, n = np.random.default_rng(6), 8192
    dt, noise = 1e-3, {"x": 1.0, "v": 300.0, "a": 1e5}
    given, roughness = {name: noise[name] for name in names}, Roughness(3, 1e-4)
    expected = error_of_x(given, dt, roughness)
    power = np.zeros(n // 4 + 1)
    for _ in range(8):
        drawn = {name: level * rng.standard_normal(n) for name, level in given.items()}
        left = smooth(drawn, given, dt, roughness).x[n // 4 : -n // 4]
        power += np.abs(np.fft.rfft(left * np.hanning(n // 2))) ** 2 / np.sum(np.hanning(n // 2) ** 2) / 8
    for low, high in ((0.002, 0.02), (0.02, 0.1), (0.1, 0.2)):  # cycles per sample
        seen = power[int(low * n // 2) : int(high * n // 2)]
        told = np.interp(np.linspace(2 * low, 2 * high, len(seen)), np.linspace(0, 1, len(expected)), expected**2)
        # 8 spectra of 70 lines and more, of which two beside each other are about one: 6 % of scatter
        assert np.mean(seen) == pytest.approx(np.mean(told), rel=0.2)


def test_no_channel_is_refused() -> None:
    with pytest.raises(UsageError, match="x, v, a"):
        smooth({}, {}, 1e-3)


def test_noise_louder_at_low_frequencies_is_not_taken_for_motion():
    """x and the integral of v stay one motion, to a tenth of the noise of x: v has noise of correlation 0.85, whose
    level at high frequencies is a quarter of its size."""
    rng, dt = np.random.default_rng(3), 1e-3
    t = dt * np.arange(8000)
    x = 3e-4 * np.sin(2 * np.pi * (1 + 4 * t) * t)
    v = np.gradient(x, dt)
    channels, noise = {}, {}
    for name, clean in {"x": x, "v": v, "a": np.gradient(v, dt)}.items():
        size = 0.02 * float(np.std(clean))
        channels[name] = clean + size * np.sqrt(1 - 0.85**2) * lfilter([1.0], [1.0, -0.85], rng.standard_normal(len(t)))
        noise[name] = 0.28 * size
    made = smooth(channels, noise, dt)
    way = np.cumsum(dt / 2 * (made.v[1:] + made.v[:-1]) - dt**2 / 12 * np.diff(made.a))
    assert np.std(made.x[1:] - way) < 0.1 * noise["x"]
    assert np.std(made.v - v) < 0.015 * np.std(v)  # 0.02 was measured, and 0.018 is left without the remedy


@pytest.mark.parametrize("noise", [1e-6, 1e-5, 1e-3])
def test_a_quiet_acceleration_alone_gives_the_displacement(noise: float) -> None:
    """What holds x at zero, where no displacement was measured, is no measurement: it once flattened quiet motion."""
    dt, rng = 1e-3, np.random.default_rng(3)
    t = dt * np.arange(6000)
    omega = 2 * np.pi * np.array([6.0, 9.5, 14.0])
    tones = np.sin(np.outer(t, omega) + np.array([0.0, 1.0, 2.0]))
    x = np.sum(tones / omega**2, axis=1)
    a = -np.sum(tones, axis=1) + noise * rng.standard_normal(len(t))
    found = smooth({"a": a}, {"a": noise}, dt)
    inner = slice(1500, -1500)
    # the corner below the lowest frequency changes the motion by 1 % at most; 2 % with the ends of the record
    np.testing.assert_allclose(found.x[inner], x[inner], atol=0.02 * float(np.max(np.abs(x))))


def test_slow_noise_of_an_acceleration_is_no_displacement() -> None:
    """Noise that grows as 1/f, twice integrated, wanders farther than the structure moves; the force knows nothing of
    it."""
    rng = np.random.default_rng(5)
    dt, n, w0 = 1e-3, 8000, 2 * np.pi * 12.0
    t = np.arange(n) * dt
    force = np.sin(2 * np.pi * (6.0 * t + 0.5 * 14.0 / t[-1] * t**2))  # 6 to 20 Hz
    x = lfilter([dt**2], [1 + 0.1 * w0 * dt, (w0 * dt) ** 2 - 2 - 0.1 * w0 * dt, 1.0], force)
    a = np.gradient(np.gradient(x, dt), dt)
    cycles = np.fft.rfftfreq(n)
    cycles[0] = cycles[1]
    slow = np.fft.irfft(np.fft.rfft(rng.standard_normal(n)) * np.sqrt(1 + 0.05 / cycles), n)  # knee at 50 Hz
    noise = 0.02 * float(np.std(a))
    inner = slice(500, -500)

    def wrong(force: np.ndarray | None) -> float:
        found = smooth({"a": a + noise * slow}, {"a": noise}, dt, force=force)
        return float(np.std(found.x[inner] - x[inner]) / np.std(x[inner]))

    # noise in the band of the motion, to a line of the coherence (1 Hz), cannot be told from it: what that is in x,
    # and as much for what the filters leave
    frequency = np.fft.rfftfreq(n, dt)
    told = np.where(frequency > 5.0, np.fft.rfft(noise * slow) / np.maximum(2 * np.pi * frequency, 1.0) ** 2, 0.0)
    inside = float(np.std(np.fft.irfft(told, n)) / np.std(x[inner]))
    assert wrong(force) < 2.0 * inside
    assert wrong(None) > 2.0 * inside


def test_a_long_rest_does_not_say_how_smooth_a_motion_is() -> None:
    rng = np.random.default_rng(6)
    dt, w = 1e-3, 2 * np.pi * 30.0
    t = np.arange(12_000) * dt
    decay = np.exp(-12.0 * t)
    x = decay * np.cos(w * t)
    v = np.gradient(x, dt)
    noise = {"x": 0.02, "v": 0.02 * w}
    found = smooth(
        {"x": x + 0.02 * rng.standard_normal(len(t)), "v": v + noise["v"] * rng.standard_normal(len(t))}, noise, dt
    )
    moving = slice(20, 200)
    # the error of one measurement: what is smoothed away by far more would be the motion itself
    assert np.std(found.v[moving] - v[moving]) < noise["v"]
