"""What an identification answers: the model, how its training went, and how it does on each recording."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from hystid.leastsquares import REASONS
from hystid.networks import TwoNetworkModel
from hystid.networks.ensemble import Start
from hystid.networks.trust import BAND
from hystid.recording import Array, Recording
from hystid.results import Result

if TYPE_CHECKING:
    from hystid.identification.hybrid.result import Hybrid

Role = Literal["training", "holdout"]


@dataclass(frozen=True, eq=False)
class Prediction:
    """One model on one recording. R: restoring force on the measured motion [N], shape (n,).

    free_run: x, v, a, R of the closed loop from the recording's own start and force, None where there is no mass or
    where it diverged (then ``diverged`` says so). Errors are NRMSE (fractions); R_mse [N2].
    spread: standard deviation of the error of R [N], shape (n,).
    """

    R: Array
    force_nrmse: float
    free_run: Mapping[str, Array] | None = None
    x_nrmse: float | None = None
    R_nrmse: float | None = None
    R_mse: float | None = None
    diverged: str = ""
    spread: Array | None = None

    def within(self, R: Array) -> float | None:
        """Share of measured R [N], shape (n,), within the 90 % band of the model; None without a spread."""
        return None if self.spread is None else float(np.mean(np.abs(R - self.R) <= BAND * self.spread))


@dataclass(frozen=True, eq=False)
class Comparison:
    """One recording as it was used, with the answers of the model, of the linear fit, and of the published method.

    published is None where the model itself is the published one. All are fed with the same motion and force.
    recorded: the model on the channels as they were recorded, as ``validate`` judges it; None where none was smoothed.
    """

    recording: Recording
    role: Role
    network: Prediction
    linear: Prediction
    published: Prediction | None = None
    recorded: Prediction | None = None

    def as_dict(self) -> dict[str, Any]:
        """Entry of ``metrics.recordings`` in identification.json."""
        return {
            "name": self.recording.name,
            "role": self.role,
            **_errors(self.network),
            "within_band": self.network.within(self.recording.channel("R")),
            "as_recorded": _errors(self.recorded or self.network),
            "linear": _errors(self.linear),
            **({"published": _errors(self.published)} if self.published else {}),
            "notes": list(self.recording.notes),
        }


def _errors(prediction: Prediction) -> dict[str, Any]:
    free = {key: getattr(prediction, key) for key in ("x_nrmse", "R_nrmse", "R_mse")}
    entry: dict[str, Any] = {"force_nrmse": prediction.force_nrmse}
    entry["free_run"] = free if prediction.free_run is not None else None
    if prediction.diverged:
        entry["diverged"] = prediction.diverged
    return entry


@dataclass(frozen=True)
class LinearFit:
    """Least-squares fit of R = B v + Kl x + offset to the training samples, for comparison. B [N.s/m], Kl [N/m].

    slopes: factor of each further input [N per its unit].
    """

    mass: float
    B: float
    Kl: float
    offset: float
    slopes: tuple[float, ...] = ()


@dataclass(frozen=True, eq=False)
class Identification(Result, report="identification", json="identification.json"):
    """Result of ``identify``.

    starts: every finished training, in order; chosen: numbers of those that the model averages.
    test: {"nrmse", "mse" [N2], "samples"} of the model's simulated R on the test part of the split.
    settings: the arguments that matter to repeat it. notes: sentences a reader of the result should see.
    files: paths written, empty without ``out``. hybrid: physics plus network, where a law was given.
    """

    model: TwoNetworkModel
    starts: Sequence[Start]
    chosen: tuple[int, ...]
    comparisons: Sequence[Comparison]
    linear: LinearFit
    test: Mapping[str, float]
    settings: Mapping[str, Any]
    notes: tuple[str, ...] = ()
    files: Mapping[str, Path] = field(default_factory=dict)
    hybrid: Hybrid | None = None

    @property
    def rotational(self) -> bool:
        """Whether the rig turns: x in rad, forces in N.m, the mass in kg.m2."""
        return self.comparisons[0].recording.rotational

    @property
    def judged(self) -> list[Comparison]:
        """The comparisons that count: held-out recordings where there are any."""
        unseen = [comparison for comparison in self.comparisons if comparison.role == "holdout"]
        return unseen or list(self.comparisons)

    @property
    def failure(self) -> str:
        """Why the model is of no use, "" where it is: worse than a linear fit, or than no model at all in closed loop.

        An NRMSE of 100 % is what a displacement of zero has. Medians over ``judged``; a tie with the linear fit, within
        one in a hundred, is none: on a linear structure the two are the same.
        """
        force, linear = (
            float(np.median([prediction.force_nrmse for prediction in group]))
            for group in ([c.network for c in self.judged], [c.linear for c in self.judged])
        )
        if force > 1.01 * linear:
            return f"the force is worse ({100 * force:.3g} % unexplained) than a linear fit's ({100 * linear:.3g} %)"
        runs = [np.inf if c.network.diverged else c.network.x_nrmse for c in self.judged]
        free = float(np.median([error for error in runs if error is not None] or [0.0]))
        if not free > 1.0:
            return ""
        how = f"is off by {100 * free:.3g} %" if np.isfinite(free) else "diverges"
        return f"in closed loop the displacement {how}, where no model at all has 100 %"

    def as_dict(self) -> dict[str, Any]:
        """Content of identification.json."""
        return {
            "mass": self.model.mass,
            "sample_rate": self.model.sample_rate,
            **self.settings,
            "inputs": [{"name": p.name, "unit": p.unit, "column": p.column} for p in self.model.inputs],
            "lags": [{"source": lag.source, "time": lag.time} for lag in self.model.lags],
            "metrics": {
                "test": dict(self.test),
                "recordings": [comparison.as_dict() for comparison in self.comparisons],
            },
            "linear": {"m": self.linear.mass, "B": self.linear.B, "Kl": self.linear.Kl, "offset": self.linear.offset},
            "training_range": {name: list(limits) for name, limits in self.model.training_range.items()},
            "velocity_band": self.model.velocity_band,
            "trainings": [self._training(start) for start in self.starts],
            "failure": self.failure,
            "notes": list(self.notes),
            **({"hybrid": self.hybrid.as_dict()} if self.hybrid else {}),
            "files": {name: path.name for name, path in self.files.items()},
        }

    def _write(self, folder: Path) -> None:
        from hystid.identification import export

        export.write(self, folder)

    def _training(self, start: Start) -> dict[str, Any]:
        parts = {"hysteresis": start.hysteresis, "restoring": start.restoring}
        if start.joint:
            parts["joint"] = start.joint
        return {
            "start": start.number,
            "chosen": start.number in self.chosen,
            **{
                name: {
                    "validation_mse": part.best,
                    "test_mse": part.test,
                    "iterations": len(part.train) - 1,
                    "stopped": REASONS[part.reason],
                }
                for name, part in parts.items()
            },
        }
