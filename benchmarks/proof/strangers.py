"""Laws that the library does not have: the right answer is that no law of it fits."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from benchmarks.proof.effects import Concealed, Rng, Scale
from benchmarks.proof.motion import Array, Term


def _law(form: str, *terms: Term, most: float = np.inf) -> Concealed:
    return Concealed("unknown", form, terms, most=most)


def cogging(s: Scale, rng: Rng) -> Concealed:
    """Detent force of magnets, periodic along the way."""
    return _law("cogging", Term("ripple", (1, s.X * rng.uniform(0.25, 0.6) / (2 * np.pi), rng.uniform(0, 6))))


def pumped_spring(s: Scale, rng: Rng) -> Concealed:
    """A stiffness that varies periodically in time."""
    f, phase = s.f0 * rng.uniform(0.37, 1.7), rng.uniform(0, 6)

    def gate(t: Array, _: int) -> Array:
        return np.cos(2 * np.pi * f * t + phase)

    return Concealed("unknown", "pumped_spring", (Term("power", (1, 1, 1, 0, 0)),), gate=gate, most=0.5 * s.Kl)


def late_feedback(s: Scale, rng: Rng) -> Concealed:
    """A controller that pushes with the displacement of a while ago."""
    return _law("late_feedback", Term("delayed", (1, rng.uniform(0.6, 2.3) / s.f0)), most=0.5 * s.Kl)


def late_friction(s: Scale, rng: Rng) -> Concealed:
    """A brake whose direction follows the motion with a delay."""
    return _law("late_friction", Term("late_friction", (1, rng.uniform(0.25, 0.8) / s.f0, 0.05 * s.V)))


def lever(s: Scale, rng: Rng) -> Concealed:
    """Inertia that depends on the position, as of a linkage."""
    return Concealed("unknown", "lever", (Term("lever", (s.m / s.X,)),), sign=float(rng.choice([-1, 1])), most=0.7)


def suction(s: Scale, rng: Rng) -> Concealed:
    """A force of one direction that grows with the square of the speed."""
    return _law("suction", Term("drag", (1, 2, s.V, 1)))


def superelastic(s: Scale, rng: Rng) -> Concealed:
    """Flag-shaped loops of a shape-memory alloy: loss beyond a plateau, back to zero."""
    return _law("superelastic", Term("flag", (1, s.X * rng.uniform(0.3, 0.5), s.X * rng.uniform(0.1, 0.2))))


def energy_sink(s: Scale, rng: Rng) -> Concealed:
    """A second mass on a spring without a linear part."""
    return _law(
        "energy_sink", Term("hidden", (s.m, 2 * np.pi * s.f0 * rng.uniform(0.8, 1.5), 0.05, s.X * rng.uniform(0.5, 1)))
    )


def gel(s: Scale, rng: Rng) -> Concealed:
    """A cubic spring behind a dashpot that thins."""
    return _law("gel", Term("softgel", (1, rng.uniform(0.3, 1.5) / s.f0, s.X * rng.uniform(0.3, 0.6))))


def switched_spring(s: Scale, rng: Rng) -> Concealed:
    """A spring that somebody else switches on and off, slowly."""
    f, phase = s.f0 * rng.uniform(0.04, 0.15), rng.uniform(0, 6)

    def gate(t: Array, _: int) -> Array:
        return np.sign(np.cos(2 * np.pi * f * t + phase)) * 0.5 + 0.5

    return Concealed("unknown", "switched_spring", (Term("power", (1, 1, 1, 0, 0)),), gate=gate, most=0.5 * s.Kl)


STRANGERS: dict[str, Callable[[Scale, Rng], Concealed]] = {
    "cogging": cogging,
    "pumped_spring": pumped_spring,
    "late_feedback": late_feedback,
    "late_friction": late_friction,
    "lever": lever,
    "suction": suction,
    "superelastic": superelastic,
    "energy_sink": energy_sink,
    "gel": gel,
    "switched_spring": switched_spring,
}
