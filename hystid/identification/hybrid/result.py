"""What a hybrid answers: the law, its share of the force, and whether it beats law and networks alone."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from hystid.identification.prediction import Prediction, Role
from hystid.networks import TwoNetworkModel
from hystid.recording import Array, Recording

_TIE = 0.99  # of the better one's error: less of a gain is none, as with the linear fit


@dataclass(frozen=True, eq=False)
class HybridComparison:
    """One recording with the law alone, the networks alone, and both. R_physics: the law's force in the hybrid [N]."""

    recording: Recording
    role: Role
    physics: Prediction
    network: Prediction
    hybrid: Prediction
    R_physics: Array

    @property
    def shares(self) -> tuple[float, float]:
        """Shares of the force's power that the law explains, and that the networks explain of the rest."""
        R = self.recording.channel("R")
        power = float(np.var(R))
        law = 1 - float(np.var(R - self.R_physics)) / power
        return law, 1 - float(np.var(R - self.hybrid.R)) / power - law

    def as_dict(self) -> dict[str, Any]:
        """Entry of ``hybrid.recordings`` in identification.json."""
        law, networks = self.shares
        found: dict[str, Any] = {"name": self.recording.name, "role": self.role}
        for name in ("physics", "network", "hybrid"):
            prediction: Prediction = getattr(self, name)
            found[name] = {"force_nrmse": prediction.force_nrmse, "x_nrmse": prediction.x_nrmse}
            if prediction.diverged:
                found[name]["diverged"] = prediction.diverged
        found["hybrid"]["within_band"] = self.hybrid.within(self.recording.channel("R"))
        return found | {"share_of_physics": law, "share_of_network": networks}


@dataclass(frozen=True, eq=False)
class Hybrid:
    """Physics plus network. alone, together: parameters of the law by itself and beside the networks (SI).

    residual: networks of the force that the law leaves; share: the factor of their force, what unseen branches confirm
    of it. layers: their hidden layers. text: the Modelica package, class ``Hybrid.Oscillator``.
    pairs: training recordings, then held-out ones.
    """

    name: str
    alone: Mapping[str, float]
    together: Mapping[str, float]
    units: Mapping[str, str]
    residual: TwoNetworkModel
    share: float
    layers: tuple[int, ...]
    text: str
    pairs: Sequence[HybridComparison]
    notes: tuple[str, ...] = field(default=())

    @property
    def unseen(self) -> list[HybridComparison]:
        """The held-out recordings."""
        return [pair for pair in self.pairs if pair.role == "holdout"]

    @property
    def refusal(self) -> str:
        """Why it is not offered, "" where it is: it has to beat law and networks alone on unseen recordings.

        Medians of the force NRMSE and, where there is a mass, of the displacement in free run (no worse there).
        """
        both, law, networks = (self._median(name, "force_nrmse") for name in ("hybrid", "physics", "network"))
        best, what = min((law, "the law alone"), (networks, "the networks alone"))
        if not both < _TIE * best:
            return f"it leaves {both:.3g} of the force on unseen recordings (NRMSE), {what} {best:.3g}"
        both, law, networks = (self._median(name, "x_nrmse") for name in ("hybrid", "physics", "network"))
        best, what = min((law, "the law alone"), (networks, "the networks alone"))
        if both * _TIE > best:
            return (
                f"in free run on unseen recordings it is off by {both:.3g} (displacement NRMSE), {what} by {best:.3g}"
            )
        return ""

    @property
    def offered(self) -> bool:
        """Whether it beats law and networks alone."""
        return not self.refusal

    def sentence(self) -> str:
        """The outcome for the notes of the identification."""
        if self.refusal:
            return f"{self.name} plus networks is not offered: {self.refusal}"
        law, networks = (float(np.median([pair.shares[k] for pair in self.unseen])) for k in range(2))
        both, alone, net = (self._median(name, "force_nrmse") for name in ("hybrid", "physics", "network"))
        return (
            f"{self.name} plus networks (hybrid.mo, hybrid.fmu) leaves {both:.3g} of the force on unseen recordings "
            f"(NRMSE), the law alone {alone:.3g}, the networks alone {net:.3g}; of the force's power "
            f"{100 * law:.3g} % is physics and {100 * networks:.3g} % network"
        )

    def as_dict(self) -> dict[str, Any]:
        """Entry ``hybrid`` of identification.json."""
        return {
            "model": self.name,
            "offered": self.offered,
            "refusal": self.refusal,
            "parameters": {
                name: {"alone": self.alone[name], "together": self.together[name], "unit": self.units[name]}
                for name in self.together
            },
            "network": {"layers": list(self.layers), "members": len(self.residual.members), "share": self.share},
            "recordings": [pair.as_dict() for pair in self.pairs],
            "notes": list(self.notes),
        }

    def _median(self, model: str, error: str) -> float:
        """Median over unseen recordings; 0 where there is nothing to judge, infinite where a run diverged."""
        predictions: list[Prediction] = [getattr(pair, model) for pair in self.unseen]
        values = [np.inf if p.diverged and error == "x_nrmse" else getattr(p, error) for p in predictions]
        return float(np.median([value for value in values if value is not None] or [0.0]))
