"""Several masses show several resonances; one mass shows one, whatever its law."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.signal import butter, lfilter

from hystid.diagnosis.prepare.resonances import resonances, several_masses
from hystid.diagnosis.prepare.segments import Part, prepare_part
from hystid.recording import Recording

Array = np.ndarray
DT, N = 2e-3, 16000
T = np.arange(N) * DT


def random_force(rng: np.random.Generator) -> Array:
    return 30 * lfilter(*butter(2, 150, fs=1 / DT), rng.standard_normal(N))


def chain(masses: list[float], springs: list[float], F: Array, curve: float = 0.0, damping: float = 1e-3) -> Array:
    """Displacement and acceleration of the first mass of a chain to the ground, force held over each of four steps;
    a cubic spring at the first mass. Exact but for that spring, which is held over a step as well."""
    m, n = np.diag(masses), len(masses)
    k = np.diag([springs[i] + (springs[i + 1] if i + 1 < n else 0.0) for i in range(n)])
    k -= np.diag(springs[1:], 1) + np.diag(springs[1:], -1)
    state = np.block([[np.zeros((n, n)), np.eye(n)], [-np.linalg.solve(m, k), -np.linalg.solve(m, damping * k)]])
    push = np.zeros(2 * n)
    push[n] = 1 / masses[0]
    h = DT / 4
    whole = expm(np.block([[state, push[:, None]], [np.zeros((1, 2 * n + 1))]]) * h)
    y, found = np.zeros(2 * n), np.empty((N, 2))
    for i, force in enumerate(F):
        found[i] = y[0], state[n] @ y + (force - curve * y[0] ** 3) / masses[0]
        for _ in range(4):
            y = whole[:-1, :-1] @ y + whole[:-1, -1] * (force - curve * y[0] ** 3)
    return found


def part(found: Array, F: Array, rng: np.random.Generator) -> Part:
    x, a = (found + 0.02 * np.std(found, axis=0) * rng.standard_normal(found.shape)).T
    return prepare_part(Recording("test", T, F=F + 0.02 * np.std(F) * rng.standard_normal(N), x=x, a=a))


def test_three_masses_have_three_resonances() -> None:
    rng = np.random.default_rng(1)
    masses, springs = [1.0, 1.0, 1.0], [3e4, 3e4, 3e4]
    F = random_force(rng)
    found = resonances([part(chain(masses, springs, F, damping=1e-4), F, rng)])
    m, k = np.diag(masses), np.diag([6e4, 6e4, 3e4]) - np.diag([3e4, 3e4], 1) - np.diag([3e4, 3e4], -1)
    true = np.sqrt(np.sort(np.linalg.eigvals(np.linalg.solve(m, k)).real)) / (2 * np.pi)
    assert found == pytest.approx(list(true), abs=0.5)  # lines are 0.24 Hz apart, and a peak is a few lines wide
    assert several_masses(found)[0].startswith("not one mass: resonances at ")


@pytest.mark.parametrize("curve", [0.0, 1e8])
@pytest.mark.parametrize("kind", ["noise", "chirp", "sine"])
def test_one_mass_has_one_resonance(curve: float, kind: str) -> None:
    """Linear, and with a cubic spring that is half of the stiffness: harmonics are no resonances."""
    rng = np.random.default_rng(2)
    forces = {"noise": random_force(rng), "chirp": 40 * np.sin(2 * np.pi * (T + T**2)), "sine": 40 * np.sin(60 * T)}
    F = forces[kind]
    assert resonances([part(chain([2.0], [3e4], F, curve), F, rng)]) == []
