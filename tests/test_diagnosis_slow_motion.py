"""Sound rigs in slow motion, and what a contact remembers from before: nothing is missing, and nothing is named."""

import numpy as np
import pytest
from numpy.typing import NDArray

from hystid.diagnosis import diagnose
from hystid.recording import Recording

Array = NDArray[np.float64]
PECORARI, JENKINS = "HystId.Oscillators.PecorariSolodov", "HystId.Oscillators.Jenkins"
RIG = {"m": 2.0, "B": 20.0, "Kl": 5e4}
CONTACT = {"Ks": 4e4, "x0": 1.2e-4, "x1": 6e-5}
CALM = ("consistent", "recalibrated")
N, DT = 5000, 1e-3


def by_hand(seed: int, *, top: float = 1.2, size: float = 5e-5) -> tuple[Array, Array, Array, Array]:
    """Time, and x, v, a of a slow motion that fills its recording: no frequency below it is left, (n,) each."""
    rng = np.random.default_rng(seed)
    t = np.arange(N) * DT
    omega, phase = 2 * np.pi * rng.uniform(0.2, top, 6), rng.uniform(0, 2 * np.pi, 6)
    x, v, a = (
        size / 2 * np.sum(omega[:, None] ** k * np.cos(omega[:, None] * t + phase[:, None] + k * np.pi / 2), axis=0)
        for k in range(3)
    )
    return t, x, v, a


def pink(rng: np.random.Generator, corner: float) -> Array:
    """Noise whose power is white above the corner frequency [Hz] and 1/f below, (n,), white part of variance 1."""
    frequency = np.maximum(np.fft.rfftfreq(N, DT), 1 / (N * DT))
    return np.asarray(np.fft.irfft(np.fft.rfft(rng.standard_normal(N)) * np.sqrt(1 + corner / frequency), N))


def jumping(x: Array, v: Array) -> Array:
    """Pecorari and Solodov (2006), the force that jumps with the sign of the velocity [N]."""
    s, half = np.sign(v), 0.5 * (CONTACT["x0"] - CONTACT["x1"])
    return np.asarray(CONTACT["Ks"] * s * (half - np.maximum(-s * x - CONTACT["x1"], 0.0)))


def seen(name: str, t: Array, F: Array, motion: dict[str, Array], level: float, corner: float, seed: int) -> Recording:
    rng = np.random.default_rng(seed)
    noisy = {key: u + level * np.std(u) * pink(rng, corner) for key, u in {"F": F, **motion}.items()}
    return Recording(name, t, **noisy)


@pytest.mark.parametrize("channels", ["x", "xva"])
def test_a_jump_whose_side_noise_decides_is_no_mismatch(channels: str) -> None:
    # 34 dB: near each turn of the slow motion the velocity is nothing but noise for tens of samples.
    recordings = []
    for seed in (1, 2):
        t, x, v, a = by_hand(seed)
        F = RIG["m"] * a + RIG["B"] * v + RIG["Kl"] * x + jumping(x, v)
        motion = {key: u for key, u in {"x": x, "v": v, "a": a}.items() if key in channels}
        recordings.append(seen(f"hand_{seed}", t, F, motion, 0.02, 0.0, seed))
    found = diagnose(recordings, model=PECORARI, parameters={**RIG, **CONTACT})
    assert found.verdict in CALM and not found.findings


def test_noise_of_a_motion_that_fills_its_recording_is_told_by_what_is_above_it() -> None:
    recordings = []
    for seed in (3, 4):
        t, x, v, a = by_hand(seed)
        F = RIG["m"] * a + RIG["B"] * v + RIG["Kl"] * x + jumping(x, v)
        recordings.append(seen(f"hand_{seed}", t, F, {"x": x, "v": v, "a": a}, 0.01, 100.0, seed))
    found = diagnose(recordings, model=PECORARI, parameters={**RIG, **CONTACT})
    assert found.verdict in CALM and not found.findings


def test_a_contact_that_slips_later_than_was_believed_remembers_longer() -> None:
    # Jenkins' element: its force follows x with Ks, within fc. It is 1.2 times the believed force, and half as stiff,
    # so it slips after 2.4 times the believed way; until then the force depends on what was before.
    Ks, fc = 2e4, 1.2
    recordings = []
    for seed in (5, 6):
        t, x, v, a = by_hand(seed, size=1e-4)
        x, v, a = x[N // 3 :], v[N // 3 :], a[N // 3 :]
        held, f = np.empty(len(x)), 0.9 * fc
        for i, step in enumerate(np.diff(x, prepend=x[0])):
            held[i] = f = min(max(f + Ks * step, -fc), fc)
        F = RIG["m"] * a + RIG["B"] * v + RIG["Kl"] * x + held
        rng = np.random.default_rng(seed)
        noisy = {
            key: u + 1e-3 * np.std(u) * rng.standard_normal(len(u)) for key, u in zip("Fxva", (F, x, v, a), strict=True)
        }
        recordings.append(Recording(f"begun_{seed}", t[: len(x)], **noisy))
    found = diagnose(recordings, model=JENKINS, parameters={**RIG, "Ks": 4e4, "fc": 1.0})
    assert found.verdict in CALM and not found.findings
