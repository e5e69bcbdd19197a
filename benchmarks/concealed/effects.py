"""Concealed effects: for each id one or more forms, drawn for the sizes of a baseline.

A form says which element acts, for how much force at first (the calibration scales it afterwards), and which of its
numbers are the physical quantities that a diagnosis may be held to. Friction is regularised in three ways, contact has
a smooth knee or a 3/2 power, loops are of Bouc-Wen, Duhem or slider kind, Stribeck falls by a rational law, and
degradation follows a power of energy: mostly not the forms that a library of effects would hold.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from benchmarks.concealed.baselines import Baseline
from benchmarks.concealed.rig import Element

Rng = np.random.Generator


@dataclass(frozen=True)
class Effect:
    """One concealed effect of a case. quantities: name -> (value, unit), by the documented meaning of the id."""

    id: str
    form: str
    element: Element
    quantities: Callable[[Element], dict[str, tuple[float, str]]] = lambda element: {}
    most: float = np.inf  # largest meaningful strength, for those that are shares


def _side(rng: Rng) -> float:
    return float(rng.choice([-1.0, 1.0]))


def _friction(rng: Rng, b: Baseline) -> tuple[float, float]:
    """Speed of the smooth sign [m/s] and its shape."""
    return b.scale.V * 10 ** rng.uniform(-2.3, -1.5), float(rng.integers(3))


def _cubic(rng: Rng, b: Baseline) -> Effect:
    s, sign = b.scale, float(rng.choice([1, 1, -1]))
    if rng.random() < 0.6:
        e = Element("odd_power", (s.X, 3.0), sign * 0.1 * s.force)
        return Effect("cubic_stiffness", "cubic", e, lambda e: {"k3": (e.strength / e.shape[0] ** 3, "N/m3")})
    return Effect(
        "cubic_stiffness", "spring_across", Element("transverse", (s.X * rng.uniform(0.9, 1.5),), sign * s.force)
    )


def _quadratic(rng: Rng, b: Baseline) -> Effect:
    s, sign = b.scale, _side(rng)
    if rng.random() < 0.6:
        e = Element("even_power", (s.X, 2.0), sign * 0.1 * s.force)
        return Effect("quadratic_stiffness", "square", e, lambda e: {"k2": (e.strength / e.shape[0] ** 2, "N/m2")})
    length = sign * s.X * rng.uniform(1.5, 3)
    return Effect("quadratic_stiffness", "exponential", Element("exponential", (length,), sign * 0.3 * s.force))


def _bilinear(rng: Rng, b: Baseline) -> Effect:
    s = b.scale
    width = s.X * rng.choice([0.0, rng.uniform(0.02, 0.1)])
    e = Element("knee", (0.0, _side(rng), width, s.X), float(rng.choice([1, -1])) * 0.1 * s.force)
    return Effect("bilinear_stiffness", "knee" if width else "corner", e)


def _contact_loss(rng: Rng, b: Baseline) -> Effect:
    s, side, gap = b.scale, _side(rng), b.scale.X * rng.uniform(0.4, 0.7)
    form = rng.choice(["knee", "hertz", "friction"] if b.scale.friction else ["knee", "hertz"])

    def place(e: Element) -> dict[str, tuple[float, str]]:
        return {"gap": (e.shape[0], "m")}

    if form == "hertz":
        return Effect("contact_loss", "hertz", Element("hertz_release", (gap, side), 0.1 * s.force), place)
    if form == "friction":
        e = Element("friction_release", (gap, side, 0.05 * s.X), 0.6)
        return Effect("contact_loss", "friction", e, place, most=1.0)
    return Effect("contact_loss", "knee", Element("knee", (gap, side, 0.03 * s.X, s.X), -0.3 * s.force), place)


def _impact(rng: Rng, b: Baseline) -> Effect:
    s = b.scale
    power = float(rng.choice([1.0, 1.5]))
    shape = (s.X * rng.uniform(0.5, 0.75), _side(rng), s.X, rng.uniform(0.2, 0.8) / s.V, power)
    return Effect(
        "impact", f"power_{power}", Element("stop", shape, 1.5 * s.force), lambda e: {"gap": (e.shape[0], "m")}
    )


def _two_sided_stop(rng: Rng, b: Baseline) -> Effect:
    s, power = b.scale, float(rng.choice([1.0, 1.5]))
    offset = float(rng.choice([0.0, rng.uniform(-0.1, 0.1)])) * s.X
    e = Element("two_stops", (s.X * rng.uniform(0.45, 0.7), s.X, power, offset), s.force)
    return Effect("two_sided_stop", f"power_{power}", e, lambda e: {"gap": (e.shape[0], "m")})


def _backlash(rng: Rng, b: Baseline) -> Effect:
    s = b.scale
    gap = s.X * rng.uniform(0.1, 0.35)
    e = Element("gap", (gap, rng.uniform(4, 20)), min(0.5, rng.uniform(0.2, 0.6)) * s.K * gap)
    return Effect("backlash", "free_play", e, lambda e: {"gap": (e.shape[0], "m")})


def _coulomb(rng: Rng, b: Baseline) -> Effect:
    e = Element("coulomb", _friction(rng, b), 0.05 * b.scale.force)
    return Effect("coulomb_friction", f"shape_{int(e.shape[1])}", e, lambda e: {"Fc": (e.strength, "N")})


def _stribeck(rng: Rng, b: Baseline) -> Effect:
    speed, shape = _friction(rng, b)
    e = Element(
        "stribeck", (speed, shape, b.scale.V * rng.uniform(0.1, 0.3), rng.uniform(0.8, 2.0)), 0.04 * b.scale.force
    )
    return Effect("stribeck_friction", "rational", e)


def _asymmetric(rng: Rng, b: Baseline) -> Effect:
    e = Element("asymmetric", (*_friction(rng, b), _side(rng) * rng.uniform(0.25, 0.7)), 0.05 * b.scale.force)

    def both(e: Element) -> dict[str, tuple[float, str]]:
        return {"F_forward": (e.strength * (1 + e.shape[2]), "N"), "F_backward": (e.strength * (1 - e.shape[2]), "N")}

    return Effect("asymmetric_friction", f"shape_{int(e.shape[1])}", e, both)


def _hysteretic(rng: Rng, b: Baseline) -> Effect:
    s = b.scale
    length = s.X * rng.uniform(0.05, 0.3)
    form = rng.choice(["loop", "duhem", "sliders"])
    if form == "loop":
        e = Element("loop", (length, rng.uniform(1.0, 3.0), rng.uniform(0.5, 0.9)), 0.08 * s.force)
    elif form == "duhem":
        e = Element("duhem", (length, rng.uniform(0.8, 1.6)), 0.08 * s.force)
    else:
        limits = np.sort(10 ** rng.uniform(-1, 0, 6))
        stiff = np.full(6, 1 / (6 * length))
        e = Element("slider_group", (6, *stiff, *(limits / np.sum(limits))), 0.08 * s.force)
    return Effect("hysteretic_friction", str(form), e)


def _place_friction(rng: Rng, b: Baseline) -> Effect:
    law = int(rng.choice([0, 1, 2, 3]))
    e = Element(
        "place_friction", (*_friction(rng, b), b.scale.X * (0.4 if law == 3 else 1.0), law), 0.08 * b.scale.force
    )
    return Effect("position_dependent_friction", ("linear", "wedge", "square", "hump")[law], e)


def _drag(rng: Rng, b: Baseline) -> Effect:
    power = float(rng.choice([2.0, rng.uniform(1.8, 2.3)]))
    e = Element("drag", (b.scale.V, power), 0.1 * b.scale.force)
    exact = power == 2.0
    return Effect(
        "quadratic_damping",
        "square" if exact else "power",
        e,
        lambda e: {"c": (e.strength / e.shape[0] ** 2, "N.s2/m2")} if exact else {},
    )


def _place_damping(rng: Rng, b: Baseline) -> Effect:
    law = int(rng.integers(3))
    e = Element("place_damping", (b.scale.X, b.scale.V, law), 0.1 * b.scale.force)
    exact = law == 0
    return Effect(
        "displacement_dependent_damping",
        ("square", "saturating", "wedge")[law],
        e,
        lambda e: {"c": (e.strength / e.shape[0] ** 2 / e.shape[1], "N.s/m3")} if exact else {},
    )


def _degradation(rng: Rng, b: Baseline) -> Effect:
    s = b.scale
    stiffness = 0.0 if s.friction else s.K
    flow = (s.friction or s.force) * s.V / 4
    e = Element("degrade", (flow * s.duration * rng.uniform(0.1, 0.4), rng.uniform(0.8, 1.6), stiffness), 0.3)
    return Effect("cyclic_degradation", "power_of_energy", e, most=0.95)


def _pinching(rng: Rng, b: Baseline) -> Effect:
    s, law = b.scale, int(rng.integers(2))
    e = Element("pinch", (s.friction * rng.uniform(0.2, 0.5), s.X * rng.uniform(0.15, 0.4), law), 0.5)
    return Effect("pinching", ("near_zero_force", "near_centre")[law], e, most=0.95)


def _relaxation(rng: Rng, b: Baseline) -> Effect:
    s, tau = b.scale, 10 ** rng.uniform(-0.5, 0.7) / (2 * np.pi * b.scale.f0)
    if rng.random() < 0.6:
        e = Element("maxwell", (s.X, 1, 1.0, tau), 0.1 * s.force)
        return Effect(
            "viscoelastic_relaxation",
            "one_branch",
            e,
            lambda e: {"k": (e.strength / e.shape[0], "N/m"), "tau": (e.shape[3], "s")},
        )
    return Effect(
        "viscoelastic_relaxation",
        "three_branches",
        Element("maxwell", (s.X, 3, 0.4, tau / 4, 0.4, tau, 0.3, tau * 5), 0.1 * s.force),
    )


def _stiffness_drift(rng: Rng, b: Baseline) -> Effect:
    law = int(rng.integers(3))
    s = b.scale
    e = Element("drift", (s.X, s.duration, law), float(rng.choice([-1, 1])) * 0.1 * s.force)
    exact = law == 0
    return Effect(
        "stiffness_drift",
        ("ramp", "settling", "square")[law],
        e,
        lambda e: {"rate": (e.strength / e.shape[0] / e.shape[1], "N/(m.s)")} if exact else {},
    )


def _preload(rng: Rng, b: Baseline) -> Effect:
    e = Element("constant", (), _side(rng) * 0.05 * b.scale.force)
    return Effect("preload", "constant", e, lambda e: {"f0": (e.strength, "N")})


def _added_mass(rng: Rng, b: Baseline) -> Effect:
    e = Element("mass", (), 0.08 * b.scale.m)
    return Effect("added_mass", "rigid", e, lambda e: {"dm": (e.strength, "kg")})


def _hidden_mode(rng: Rng, b: Baseline) -> Effect:
    s = b.scale
    f2, zeta = s.f0 * rng.choice([rng.uniform(0.5, 0.85), rng.uniform(1.25, 2.0)]), rng.uniform(0.005, 0.04)
    e = Element("hidden", (2 * np.pi * f2, zeta), 0.02 * s.m)
    return Effect(
        "hidden_mode",
        "attached_mass",
        e,
        lambda e: {"m2": (e.strength, "kg"), "f2": (e.shape[0] / (2 * np.pi), "Hz"), "zeta": (e.shape[1], "1")},
    )


PHYSICS: dict[str, Callable[[Rng, Baseline], Effect]] = {
    "cubic_stiffness": _cubic,
    "quadratic_stiffness": _quadratic,
    "bilinear_stiffness": _bilinear,
    "contact_loss": _contact_loss,
    "impact": _impact,
    "two_sided_stop": _two_sided_stop,
    "backlash": _backlash,
    "coulomb_friction": _coulomb,
    "stribeck_friction": _stribeck,
    "asymmetric_friction": _asymmetric,
    "hysteretic_friction": _hysteretic,
    "position_dependent_friction": _place_friction,
    "quadratic_damping": _drag,
    "displacement_dependent_damping": _place_damping,
    "cyclic_degradation": _degradation,
    "pinching": _pinching,
    "viscoelastic_relaxation": _relaxation,
    "stiffness_drift": _stiffness_drift,
    "preload": _preload,
    "added_mass": _added_mass,
    "hidden_mode": _hidden_mode,
}
NEEDS_LOOP = frozenset({"pinching"})
