"""Physics that is in nobody's catalogue, and physics that is but in another form than any block has.

``STRANGERS`` belong to no class of effects: the right answer is unknown_physics. ``RELATIVES`` have a fair name: that
of the family they belong to, or unknown_physics.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from benchmarks.concealed.baselines import Baseline
from benchmarks.concealed.effects import Effect, Rng
from benchmarks.concealed.rig import Element


def _cogging(rng: Rng, b: Baseline) -> Effect:
    """Magnetic detents, several within the stroke."""
    s = b.scale
    return Effect(
        "cogging", "sine_of_x", Element("cogging", (s.X / rng.uniform(1.5, 4), rng.uniform(0, 6.28)), 0.05 * s.force)
    )


def _parametric(rng: Rng, b: Baseline) -> Effect:
    """Stiffness pumped by something that turns."""
    s = b.scale
    shape = (s.X, 2 * np.pi * s.f0 * rng.uniform(0.15, 1.5), rng.uniform(0, 6.28))
    return Effect("parametric_excitation", "cosine_of_t", Element("parametric", shape, 0.1 * s.force))


def _delayed(rng: Rng, b: Baseline) -> Effect:
    """A controller that acts late, and not linearly."""
    s = b.scale
    return Effect("delayed_feedback", "cubic", Element("delayed", (s.X, rng.uniform(0.3, 1.3) / s.f0), 0.1 * s.force))


def _tone(rng: Rng, b: Baseline) -> Effect:
    """A machine beside the rig."""
    s = b.scale
    shape = (2 * np.pi * s.f0 * rng.uniform(0.4, 2.2), rng.uniform(0, 6.28))
    return Effect("outside_force", "tone", Element("tone", shape, 0.05 * s.force))


def _inertial(rng: Rng, b: Baseline) -> Effect:
    """Carried mass that grows with the square of the displacement (a beam that shortens)."""
    return Effect("inertial_nonlinearity", "x2a_plus_xv2", Element("inertial", (b.scale.X,), 0.1 * b.scale.m))


def _knocks(rng: Rng, b: Baseline) -> Effect:
    """Somebody hits the table."""
    s, count = b.scale, 9
    pairs = np.column_stack([np.sort(rng.uniform(0.05, 0.95, count)) * s.duration, rng.choice([-1, 1], count)])
    shape = (rng.uniform(0.2, 0.5) / s.f0, count, *pairs.ravel())
    return Effect("knocks", "half_sines", Element("knocks", shape, 0.3 * s.force))


def _centrifugal(rng: Rng, b: Baseline) -> Effect:
    """Stiffness that grows with the square of the speed."""
    s = b.scale
    return Effect(
        "centrifugal_stiffness", "x_v2", Element("centrifugal", (s.X, s.V), float(rng.choice([-1, 1])) * 0.1 * s.force)
    )


def _quintic(rng: Rng, b: Baseline) -> Effect:
    return Effect("quintic_stiffness", "x5", Element("odd_power", (b.scale.X, 5.0), 0.1 * b.scale.force))


def _magnet(rng: Rng, b: Baseline) -> Effect:
    s = b.scale
    return Effect(
        "magnet",
        "inverse_square",
        Element("magnet", (float(rng.choice([-1, 1])) * s.X * rng.uniform(2, 3.5),), 0.1 * s.force),
    )


def _fractional(rng: Rng, b: Baseline) -> Effect:
    """A fractional derivative of order 0.5, by six branches over three decades."""
    s, n = b.scale, 6
    times = np.logspace(-1.5, 1.5, n) / (2 * np.pi * s.f0)
    pairs = np.column_stack([(times / times[0]) ** -0.5, times])
    return Effect("fractional_damping", "order_0.5", Element("maxwell", (s.X, n, *pairs.ravel()), 0.3 * s.force))


def _cubic_drag(rng: Rng, b: Baseline) -> Effect:
    return Effect("cubic_damping", "v3", Element("drag", (b.scale.V, 3.0), 0.1 * b.scale.force))


def _iwan4(rng: Rng, b: Baseline) -> Effect:
    """Sliders with a power-law density of limits and a group that lets go at once (four-parameter Iwan)."""
    s, n = b.scale, 12
    phi = np.linspace(0.5, n - 0.5, n) / n * s.X * rng.uniform(0.2, 0.6)
    weight = (phi / phi[-1]) ** (rng.uniform(-0.6, 0.2)) / n
    weight[-1] += rng.uniform(0.3, 0.8) * np.sum(weight)
    total = np.sum(weight * phi)
    e = Element("slider_group", (n, *(weight / total), *(weight * phi / total)), 0.08 * s.force)
    return Effect("iwan_joint", "four_parameters", e)


STRANGERS: dict[str, Callable[[Rng, Baseline], Effect]] = {
    "cogging": _cogging,
    "parametric_excitation": _parametric,
    "delayed_feedback": _delayed,
    "outside_force": _tone,
    "inertial_nonlinearity": _inertial,
    "knocks": _knocks,
    "centrifugal_stiffness": _centrifugal,
}
RELATIVES: dict[str, tuple[str, Callable[[Rng, Baseline], Effect]]] = {
    "quintic_stiffness": ("cubic_stiffness", _quintic),
    "magnet": ("quadratic_stiffness", _magnet),
    "fractional_damping": ("viscoelastic_relaxation", _fractional),
    "cubic_damping": ("quadratic_damping", _cubic_drag),
    "iwan_joint": ("hysteretic_friction", _iwan4),
}
