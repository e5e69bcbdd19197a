"""Concealed physics: every id of the library by laws of our own, from the literature of each mechanism.

Each ``_draw`` returns a law of amplitude 1; ``cases`` scales it to the share of R that the case asks for.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from benchmarks.proof.motion import Array, Term

Gate = Callable[[Array, int], Array]


@dataclass(frozen=True)
class Scale:
    """What the sizes of a law are drawn from: peak motion, rig, and length of a recording."""

    X: float
    f0: float
    m: float
    Kl: float
    h_peak: float
    T: float
    top: float

    @property
    def V(self) -> float:
        """Speed at the natural frequency and the peak displacement [m/s]."""
        return 2 * np.pi * self.f0 * self.X


@dataclass(frozen=True)
class Concealed:
    """A law that the baseline lacks. ``equivalent``: ids that name the same thing; ``known``: amplitude -> parameters
    under the library's names, where its law is the very same; ``gate``: factor over (time, number of recording);
    ``most``: largest amplitude that the mechanism can have (a gap misses no more than the whole spring)."""

    effect: str
    form: str
    terms: tuple[Term, ...]
    equivalent: tuple[str, ...] = ()
    known: Callable[[float], dict[str, float]] = field(default=lambda _: {})
    gate: Gate | None = None
    sign: float = 1.0
    most: float = np.inf

    def at(self, amplitude: float, t: Array, number: int) -> tuple[Term, ...]:
        """The terms of this amplitude on the half-step grid ``t`` of recording ``number``."""
        gate = self.gate(t, number) if self.gate is not None else None
        return tuple(replace(term.times(self.sign * amplitude), gate=gate) for term in self.terms)


Rng = np.random.Generator


def cubic(s: Scale, rng: Rng) -> Concealed:
    form = str(rng.choice(["duffing", "string", "pendulum", "degree_35"], p=[0.5, 0.2, 0.15, 0.15]))
    if form == "duffing":
        sign = float(rng.choice([1, 1, -1]))
        return Concealed(
            "cubic_stiffness",
            form,
            (Term("power", (1, 3, s.X, 0, 0)),),
            sign=sign,
            known=lambda c: {"k3": sign * c / s.X**2},
            most=np.inf if sign > 0 else 0.25 * s.Kl,
        )
    if form == "string":  # exact geometry of a wire across the motion
        return Concealed("cubic_stiffness", form, (Term("string", (1, s.X * rng.uniform(0.8, 3))),))
    if form == "pendulum":
        return Concealed("cubic_stiffness", form, (Term("sine", (1, s.X * rng.uniform(0.6, 1.2))),), most=s.Kl)
    both = (Term("power", (1, 3, s.X, 0, 0)), Term("power", (rng.uniform(0.2, 0.6), 5, s.X, 0, 0)))
    return Concealed("cubic_stiffness", form, both)


def quadratic(s: Scale, rng: Rng) -> Concealed:
    sign = float(rng.choice([1, -1]))
    if rng.random() < 0.7:
        return Concealed(
            "quadratic_stiffness",
            "square",
            (Term("power", (1, 2, s.X, 0, 1)),),
            sign=sign,
            known=lambda c: {"k2": sign * c / s.X},
            most=0.4 * s.Kl,
        )
    L = s.X * rng.uniform(2.0, 4.0) * rng.choice([-1, 1])
    return Concealed("quadratic_stiffness", "exponential", (Term("exponential", (1, L)),))


def bilinear(s: Scale, rng: Rng) -> Concealed:
    w = 0.0 if rng.random() < 0.5 else s.X * rng.uniform(0.02, 0.15)
    term = Term("onesided", (1, 0, w, 1, float(rng.choice([-1, 1])), s.X))
    sign = float(rng.choice([1, -1]))
    return Concealed(
        "bilinear_stiffness",
        "sharp" if w == 0 else "gradual",
        (term,),
        ("contact_loss",),
        sign=sign,
        most=np.inf if sign > 0 else 0.85 * s.Kl,
    )


def yielding_spring(s: Scale, rng: Rng) -> Concealed:
    """A spring that gets softer beyond a displacement, the same on both sides, without loss."""
    gap = s.X * rng.uniform(0.3, 0.7)
    return Concealed(
        "bilinear_stiffness",
        "threshold",
        (Term("stops", (1, gap, gap, 1, s.X)),),
        ("two_sided_stop", "backlash"),
        sign=-1.0,
        most=0.9 * s.Kl,
    )


def contact_loss(s: Scale, rng: Rng) -> Concealed:
    side, gap = float(rng.choice([-1, 1])), s.X * rng.uniform(0.25, 0.75)
    form = str(rng.choice(["closes", "opens", "hertz", "rough", "friction_lost"], p=[0.35, 0.15, 0.2, 0.15, 0.15]))
    if form == "friction_lost" and s.h_peak > 0:
        return Concealed(
            "contact_loss", form, (Term("unloaded", (1, gap, side, s.X * rng.uniform(0.02, 0.08))),), most=1.0
        )
    n, w = (1.5, 0.0) if form == "hertz" else (1.0, s.X * rng.uniform(0.02, 0.08) if form == "rough" else 0.0)
    sign = -1.0 if form == "opens" else 1.0
    known = (lambda c: {"k": sign * c, "gap": gap}) if n == 1 and w == 0 else (lambda _: {})
    near = ("impact", "bilinear_stiffness") if gap < 0.05 * s.X else ("impact",)
    return Concealed(
        "contact_loss",
        form,
        (Term("onesided", (1, gap, w, n, side, s.X)),),
        near,
        known,
        sign=sign,
        most=np.inf if sign > 0 else 0.85 * s.Kl,
    )


def impact(s: Scale, rng: Rng) -> Concealed:
    """Contact with loss: Hunt and Crossley with any power, or Kelvin and Voigt without pull."""
    side, gap = float(rng.choice([-1, 1, 0])), s.X * rng.uniform(0.2, 0.6)
    if rng.random() < 0.65:
        n = float(rng.choice([1.0, 1.5, 2.0]))
        return Concealed(
            "impact", f"hunt_crossley_{n:g}", (Term("hunt", (1, gap, rng.uniform(0.4, 1.2) / s.V, n, side, s.X)),)
        )
    tau = rng.uniform(0.1, 0.3) * s.X / s.V
    return Concealed("impact", "kelvin_voigt", (Term("kelvin", (1, gap, tau, 0, side)),))


def stop(s: Scale, rng: Rng) -> Concealed:
    gap, n = s.X * rng.uniform(0.35, 0.8), float(rng.choice([1.0, 1.0, 1.5]))
    lean = rng.uniform(-0.2, 0.2) if rng.random() < 0.4 else 0.0
    known = (lambda c: {"k": c, "gap": gap}) if n == 1 and lean == 0 else (lambda _: {})
    return Concealed(
        "two_sided_stop",
        f"power_{n:g}" + ("_offcentre" if lean else ""),
        (Term("stops", (1, gap * (1 + lean), gap * (1 - lean), n, s.X)),),
        ("backlash",),
        known,
    )


def backlash(s: Scale, rng: Rng) -> Concealed:
    gap = s.X * rng.uniform(0.08, 0.45)
    return Concealed(
        "backlash",
        "free_play",
        (Term("play", (1, gap, 0)),),
        ("two_sided_stop",),
        lambda c: {"k": c, "gap": gap},
        most=0.95 * s.Kl,
    )


def _friction(
    ratio: float = 0,
    vd: float = 1,
    power: float = 0,
    vs: float = 0,
    lean: float = 0,
    slope: float = 0,
    wedge: float = 0,
    curve: float = 0,
) -> Term:
    return Term("friction", (1, ratio, vd, power, vs, lean, slope, wedge, curve))


def coulomb(s: Scale, rng: Rng) -> Concealed:
    vs = 0.0 if rng.random() < 0.5 else s.V * rng.uniform(0.003, 0.05)
    return Concealed(
        "coulomb_friction",
        "set_valued" if vs == 0 else "smooth",
        (_friction(vs=vs),),
        ("hysteretic_friction",),
        lambda c: {"Fc": c},
    )


def stribeck(s: Scale, rng: Rng) -> Concealed:
    power = float(rng.choice([0, 1, 2]))
    vs = 0.0 if rng.random() < 0.3 else s.V * rng.uniform(0.003, 0.01)
    ratio, vd = rng.uniform(0.7, 2.0), s.V * rng.uniform(0.05, 0.2)
    return Concealed(
        "stribeck_friction", {0: "hess_soom", 1: "tustin", 2: "gauss"}[int(power)], (_friction(ratio, vd, power, vs),)
    )


def asymmetric_friction(s: Scale, rng: Rng) -> Concealed:
    lean = rng.uniform(0.25, 0.7) * rng.choice([-1, 1])
    vs = 0.0 if rng.random() < 0.4 else s.V * rng.uniform(0.003, 0.03)
    return Concealed(
        "asymmetric_friction",
        "set_valued" if vs == 0 else "smooth",
        (_friction(vs=vs, lean=lean),),
        ("coulomb_friction+preload",),
        lambda c: {"F_forward": c * (1 + lean), "F_backward": c * (1 - lean)},
    )


def hysteretic_friction(s: Scale, rng: Rng) -> Concealed:
    """Pre-sliding by one slider, by many with a spread of limits (Iwan), or after Bouc and Wen."""
    form = str(rng.choice(["one_slider", "power_law", "exponential", "bouc_wen"]))
    xc = s.X * rng.uniform(0.06, 0.35)
    if form == "bouc_wen":
        n, gamma = float(rng.choice([1.0, 1.5, 2.0, 3.0])), rng.uniform(0.4, 0.7)
        term = Term("boucwen", (1, 1 / xc, gamma / xc, (1 - gamma) / xc, n))
    elif form == "one_slider":
        term = Term("sliders", (1,), table=((1 / xc, xc),))
    else:
        n = 30
        at = (np.arange(n) + 0.5) / n
        limits = 2 * xc * at if form == "power_law" else -xc * np.log(1 - at)
        weight = at ** rng.uniform(-0.5, 0.3) if form == "power_law" else np.ones(n)
        weight /= np.sum(weight * limits)
        term = Term("sliders", (1,), table=tuple(zip(weight, limits, strict=True)))
    near = ("coulomb_friction",) if xc < 0.02 * s.X else ()
    return Concealed("hysteretic_friction", form, (term,), near)


def position_friction(s: Scale, rng: Rng) -> Concealed:
    vs = 0.0 if rng.random() < 0.4 else s.V * rng.uniform(0.003, 0.03)
    form = str(rng.choice(["slope", "wedge", "curved"]))
    if form == "slope":
        term = _friction(vs=vs, slope=rng.uniform(0.5, 1.2) / s.X * rng.choice([-1, 1]))
    elif form == "wedge":
        term = _friction(vs=vs, wedge=rng.uniform(1.5, 6) / s.X)
    else:
        term = _friction(vs=vs, slope=rng.uniform(0.3, 0.7) / s.X, curve=rng.uniform(1, 3) / s.X**2)
    return Concealed("position_dependent_friction", form, (term,))


def quadratic_damping(s: Scale, rng: Rng) -> Concealed:
    n = float(rng.choice([2.0, 2.0, 2.0, 1.75, 2.4]))
    return Concealed(
        "quadratic_damping",
        f"power_{n:g}",
        (Term("drag", (1, n, s.V, 0)),),
        known=(lambda c: {"c": c / s.V}) if n == 2 else (lambda _: {}),
    )


def position_damping(s: Scale, rng: Rng) -> Concealed:
    form = str(rng.choice(["square", "distance", "sloped", "squeeze_film"], p=[0.4, 0.25, 0.2, 0.15]))
    L = s.X * rng.uniform(1.6, 2.5) if form == "squeeze_film" else s.X
    mode = ["square", "distance", "sloped", "squeeze_film"].index(form)
    term = Term("xdamping", (1, L, mode, rng.uniform(0.3, 1.5) * rng.choice([-1, 1])))
    return Concealed(
        "displacement_dependent_damping",
        form,
        (term,),
        known=(lambda c: {"c": c / s.X**2}) if mode == 0 else (lambda _: {}),
    )


def degradation(s: Scale, rng: Rng) -> Concealed:
    """The hysteretic force, or without one the spring, wears with the path, the energy or the peak."""
    cycles = s.T * s.f0
    path = 4 * 0.35 * s.X * cycles
    if s.h_peak == 0:
        term = Term("weakening", (1, path * rng.uniform(0.15, 0.6), 0, 0, 1))
        return Concealed("cyclic_degradation", "spring_path", (term,), ("stiffness_drift",), most=0.7 * s.Kl)
    form = str(rng.choice(["path", "energy", "baber_noori"]))
    size = path * (s.h_peak * 0.6 if form != "path" else 1) * rng.uniform(0.15, 0.6)
    return Concealed(
        "cyclic_degradation",
        form,
        (Term("weakening", (1, size, 0 if form == "path" else 1, 1 if form == "baber_noori" else 0, 0)),),
        most=1.0,
    )


def pinching(s: Scale, rng: Rng) -> Concealed:
    form = str(rng.choice(["gauss", "lorentz", "force"]))
    width = s.h_peak * rng.uniform(0.3, 0.6) if form == "force" else s.X * rng.uniform(0.1, 0.35)
    return Concealed(
        "pinching", form, (Term("pinch", (1, width, ["gauss", "lorentz", "force"].index(form), 0)),), most=1.0
    )


def relaxation(s: Scale, rng: Rng) -> Concealed:
    tau = rng.uniform(0.3, 3) / (2 * np.pi * s.f0)
    if rng.random() < 0.6:
        return Concealed(
            "viscoelastic_relaxation", "maxwell", (Term("maxwell", (1, tau)),), known=lambda c: {"k": c, "tau": tau}
        )
    many = tuple(Term("maxwell", (rng.uniform(0.5, 1.5), tau * q)) for q in (0.25, 1.0, 4.0))
    return Concealed("viscoelastic_relaxation", "prony", many)


def stiffness_drift(s: Scale, rng: Rng) -> Concealed:
    form = str(rng.choice(["steady", "warming"]))
    tau = s.T * rng.uniform(0.25, 0.7)

    def gate(t: Array, _: int) -> Array:
        return t / s.T if form == "steady" else 1 - np.exp(-t / tau)

    sign = float(rng.choice([1, -1, -1]))
    return Concealed(
        "stiffness_drift",
        form,
        (Term("power", (1, 1, 1, 0, 0)),),
        ("cyclic_degradation",) if s.h_peak == 0 else (),
        (lambda c: {"rate": sign * c / s.T}) if form == "steady" else (lambda _: {}),
        gate,
        sign,
        np.inf if sign > 0 else 0.7 * s.Kl,
    )


def preload(s: Scale, rng: Rng) -> Concealed:
    sign = float(rng.choice([1, -1]))
    return Concealed(
        "preload", "constant", (Term("constant", (1,)),), ("force_drift",), lambda c: {"f0": sign * c}, sign=sign
    )


def added_mass(s: Scale, rng: Rng) -> Concealed:
    return Concealed("added_mass", "rigid", (Term("mass", (s.m,)),), ("force_gain",), lambda c: {"dm": c * s.m})


def hidden_mode(s: Scale, rng: Rng) -> Concealed:
    f2, zeta = s.f0 * rng.uniform(0.6, 2.2), rng.uniform(0.01, 0.15)
    return Concealed(
        "hidden_mode",
        "absorber",
        (Term("hidden", (s.m, 2 * np.pi * f2, zeta, 0)),),
        known=lambda c: {"m2": c * s.m, "f2": f2, "zeta": zeta},
    )


PHYSICS: dict[str, Callable[[Scale, Rng], Concealed]] = {
    "cubic_stiffness": cubic,
    "quadratic_stiffness": quadratic,
    "bilinear_stiffness": bilinear,
    "contact_loss": contact_loss,
    "impact": impact,
    "two_sided_stop": stop,
    "backlash": backlash,
    "coulomb_friction": coulomb,
    "stribeck_friction": stribeck,
    "asymmetric_friction": asymmetric_friction,
    "hysteretic_friction": hysteretic_friction,
    "position_dependent_friction": position_friction,
    "quadratic_damping": quadratic_damping,
    "displacement_dependent_damping": position_damping,
    "cyclic_degradation": degradation,
    "pinching": pinching,
    "viscoelastic_relaxation": relaxation,
    "stiffness_drift": stiffness_drift,
    "preload": preload,
    "added_mass": added_mass,
    "hidden_mode": hidden_mode,
}
NEEDS_HYSTERESIS = {"pinching"}
TIME_LAWS = {"cyclic_degradation", "stiffness_drift"}


def draw(effect: str, scale: Scale, rng: Rng) -> Concealed:
    """A law of this id; one in four of ``bilinear_stiffness`` is the spring that yields on both sides."""
    if effect == "bilinear_stiffness" and rng.random() < 0.25:
        return yielding_spring(scale, rng)
    return PHYSICS[effect](scale, rng)


def windowed(law: Concealed, scale: Scale, rng: Rng, recordings: int) -> tuple[Concealed, dict[str, list[list[float]]]]:
    """The same law, acting in one stretch of one or of all recordings, and where (as shares of each recording)."""
    lo = rng.uniform(0.15, 0.55)
    hi = min(lo + rng.uniform(0.25, 0.45), 1.0)
    only = int(rng.integers(recordings)) if recordings > 1 and rng.random() < 0.4 else None

    def gate(t: Array, number: int) -> Array:
        place = (t - t[0]) / (t[-1] - t[0])
        edge = 0.01
        on = np.clip((place - lo) / edge, 0, 1) * np.clip((hi - place) / edge, 0, 1)
        return on if only is None or number == only else np.zeros_like(t)

    where = {str(i): [[lo, hi]] for i in range(recordings) if only is None or i == only}
    return replace(law, gate=gate), where
