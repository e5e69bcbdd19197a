"""The healthy rig: one of five oscillators of the library, with our own forms of their laws."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from benchmarks.proof.effects import Rng, Scale
from benchmarks.proof.motion import BASELINE, HYSTERETIC, Term

MODELS = ("Linear", "Jenkins", "BoucWen", "PecorariSolodov", "Iwan")


@dataclass(frozen=True)
class Rig:
    """Parameters under the library's names, and the natural frequency and peak displacement that the tests aim at."""

    model: str
    parameters: dict[str, float]
    f0: float
    X: float

    @property
    def mass(self) -> float:
        """Moving mass [kg]."""
        return self.parameters["m"]

    def terms(self, **changed: float) -> tuple[Term, ...]:
        """The force laws, with some parameters replaced."""
        p = {**self.parameters, **changed}
        linear = (Term("power", (p["Kl"], 1, 1, 0, 0), BASELINE), Term("drag", (p["B"], 1, 1, 0), BASELINE))
        if self.model == "Jenkins":
            return *linear, Term("sliders", (1,), HYSTERETIC, table=((p["Ks"], p["fc"] / p["Ks"]),))
        if self.model == "Iwan":
            # Iwan (1966): elements of equal stiffness whose slip forces grow linearly, fc in sum.
            n = 8
            table = tuple((p["Ks"] / n, 2 * p["fc"] * i / ((n + 1) * p["Ks"])) for i in range(1, n + 1))
            return *linear, Term("sliders", (1,), HYSTERETIC, table=table)
        if self.model == "BoucWen":
            law = (1, p["alpha"], p["beta"] * p["gamma"], p["beta"] * p["delta"], p["nu"])
            return *linear, Term("boucwen", law, HYSTERETIC)
        if self.model == "PecorariSolodov":
            return *linear, Term("pecorari", (p["Ks"], p["x0"], p["x1"]), HYSTERETIC)
        return linear

    def scale(self, T: float, top: float) -> Scale:
        """Sizes from which laws are drawn, for recordings of length ``T`` [s] that reach up to ``top`` [Hz]."""
        p = self.parameters
        peak = {
            "Linear": lambda: 0.0,
            "Jenkins": lambda: p["fc"],
            "Iwan": lambda: p["fc"],
            "BoucWen": lambda: (p["alpha"] / (p["beta"] * (p["gamma"] + p["delta"]))) ** (1 / p["nu"]),
            "PecorariSolodov": lambda: 0.5 * p["Ks"] * (p["x0"] - p["x1"]),
        }[self.model]()
        return Scale(self.X, self.f0, self.mass, p["Kl"], peak, T, top)


def draw_rig(model: str, rng: Rng) -> Rig:
    """A rig between a small sensor and a machine: 0.2 to 50 kg, 4 to 80 Hz, 0.05 to 5 mm."""
    m, f0, X = (float(np.exp(rng.uniform(np.log(lo), np.log(hi)))) for lo, hi in ((0.2, 50), (4, 80), (5e-5, 5e-3)))
    ratio = rng.uniform(0.3, 1.5) if model != "Linear" else 0.0
    Kl = m * (2 * np.pi * f0) ** 2 / (1 + 0.5 * ratio)
    Ks = ratio * Kl
    p = {"m": m, "B": 2 * rng.uniform(0.004, 0.04) * np.sqrt(Kl * m), "Kl": Kl}
    if model in ("Jenkins", "Iwan"):
        p |= {"Ks": Ks, "fc": Ks * X * rng.uniform(0.15, 0.45)}
    elif model == "BoucWen":
        nu, gamma, fc = float(rng.choice([1, 1, 2])), rng.uniform(0.4, 0.8), Ks * X * rng.uniform(0.15, 0.45)
        p |= {"alpha": Ks, "beta": Ks / fc**nu, "gamma": gamma, "delta": 1 - gamma, "nu": nu}
    elif model == "PecorariSolodov":
        x0 = X * rng.uniform(1.15, 1.5)
        p |= {"Ks": Ks * 0.6, "x0": x0, "x1": x0 * rng.uniform(0.3, 0.7)}
    return Rig(model, {k: float(v) for k, v in p.items()}, f0, X)


def nominal(rig: Rig, rng: Rng, far: bool) -> dict[str, float]:
    """What the user believes: the mass from weighing (0.1 %), the rest 10 % off, or up to 2.5 times where ``far``."""
    out = {}
    for name, value in rig.parameters.items():
        if name == "m":
            factor = 1 + 0.001 * rng.standard_normal()
        elif name in ("gamma", "delta", "nu"):
            factor = 1.0
        else:
            factor = float(np.exp(rng.uniform(-1, 1) * np.log(2.5))) if far else 1 + 0.1 * rng.standard_normal()
        out[name] = float(value * max(factor, 0.2))
    return out
