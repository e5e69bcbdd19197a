"""Oscillators of the deck: drawn parameters, their elements, and nominal values that are deliberately wrong."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from benchmarks.concealed.rig import Element, Rig

MODELS = {
    "linear": "HystId.Oscillators.Linear",
    "jenkins": "HystId.Oscillators.Jenkins",
    "boucwen": "HystId.Oscillators.BoucWen",
    "iwan": "HystId.Oscillators.Iwan",
    "pecorari": "HystId.Oscillators.PecorariSolodov",
}
IWAN_SLIDERS = 8
# Share of the small-motion stiffness that can slip. The memoryless law jumps at every turn short of x0: kept small.
SLIP = {
    "linear": (0.0, 0.0),
    "jenkins": (0.2, 0.45),
    "boucwen": (0.2, 0.45),
    "iwan": (0.2, 0.45),
    "pecorari": (0.06, 0.15),
}


@dataclass(frozen=True)
class Scale:
    """Sizes that effects are drawn for.

    X, V: peak displacement [m] and speed [m/s]; K: stiffness at small motion [N/m]; friction: limit of the law [N]
    (0 where there is none); f0 [Hz]; duration of a recording [s].
    """

    X: float
    V: float
    K: float
    m: float
    friction: float
    f0: float
    duration: float

    @property
    def force(self) -> float:
        """Peak spring force [N]."""
        return self.K * self.X


@dataclass(frozen=True)
class Baseline:
    """A drawn oscillator: family, its true parameters by the names of the Modelica model, and sizes."""

    family: str
    parameters: dict[str, float]
    scale: Scale

    @property
    def model(self) -> str:
        """Name for ``--model``."""
        return MODELS[self.family]

    def rig(self) -> Rig:
        """The oscillator without any effect."""
        return rig_of(self.family, self.parameters, self.scale.V)


def rig_of(family: str, p: dict[str, float], speed: float) -> Rig:
    """Rig of a family with parameters named as in the Modelica model. speed: peak speed, for the smooth sign [m/s]."""
    return Rig(p["m"], p["B"], p["Kl"], _elements(family, p, speed))


def _elements(family: str, p: dict[str, float], speed: float) -> tuple[Element, ...]:
    if family == "linear":
        return ()
    if family == "jenkins":
        return (Element("jenkins", (p["Ks"], p["fc"])),)
    if family == "boucwen":
        return (Element("boucwen", (p["alpha"], p["beta"], p["gamma"], p["delta"], p["nu"])),)
    if family == "pecorari":
        return (Element("pecorari", (p["Ks"], p["x0"], p["x1"], 0.01 * speed)),)
    count = np.arange(1, IWAN_SLIDERS + 1)
    limits = 2 * p["fc"] * count / (IWAN_SLIDERS * (IWAN_SLIDERS + 1))
    return (Element("sliders", (IWAN_SLIDERS, *np.full(IWAN_SLIDERS, p["Ks"] / IWAN_SLIDERS), *limits)),)


def draw(family: str, rng: np.random.Generator, duration: float) -> Baseline:
    """A random oscillator of the family: 0.5-5 kg, 15-40 Hz, 0.5-3 mm, 1-3 % viscous damping."""
    m, f0, X = rng.uniform(0.5, 5.0), rng.uniform(15, 40), 10 ** rng.uniform(-3.3, -2.5)
    K = m * (2 * np.pi * f0) ** 2
    slip = rng.uniform(*SLIP[family])
    Kl, Ks = (1 - slip) * K, slip * K
    p = {"m": m, "B": 2 * rng.uniform(0.01, 0.03) * np.sqrt(K * m), "Kl": Kl}
    fc = Ks * X * rng.uniform(0.2, 0.45)
    p |= _law(family, rng, Ks, fc, X)
    scale = Scale(X, 2 * np.pi * f0 * X, K, m, fc, f0, duration)
    return Baseline(family, {name: float(value) for name, value in p.items()}, scale)


def _law(family: str, rng: np.random.Generator, Ks: float, fc: float, X: float) -> dict[str, float]:
    if family == "linear":
        return {}
    if family in ("jenkins", "iwan"):
        return {"Ks": Ks, "fc": fc}
    if family == "pecorari":
        x0 = X * rng.uniform(1.02, 1.2)
        return {"Ks": Ks, "x0": x0, "x1": x0 * rng.uniform(0.2, 0.6)}
    gamma = rng.uniform(0.5, 0.8)
    nu = rng.choice([1.0, rng.uniform(1.0, 2.0)])
    return {"alpha": Ks, "beta": Ks / fc**nu, "gamma": gamma, "delta": 1 - gamma, "nu": nu}


def nominal(baseline: Baseline, rng: np.random.Generator, mass_error: float = 0.0) -> dict[str, float]:
    """Parameters as handed to the diagnosis: mass as weighed, the rest wrong by up to 20 % (damping by up to 40 %)."""
    wrong = {}
    for name, value in baseline.parameters.items():
        spread = {"m": 0.0, "B": 0.4, "gamma": 0.1, "delta": 0.1, "nu": 0.1}.get(name, 0.2)
        wrong[name] = value * (1 + spread * rng.uniform(-1, 1))
    wrong["m"] *= 1 + mass_error
    if (
        baseline.family == "boucwen"
    ):  # where the law is stated per power of the force, a wrong nu changes the unit of beta
        wrong["beta"] *= (baseline.scale.friction) ** (baseline.parameters["nu"] - wrong["nu"])
    return wrong
