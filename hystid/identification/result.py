"""What an identification answers: the model, how its training went, and how it does on each recording."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from hystid.files import atomic, write_json
from hystid.identification.hybrid.package import OSCILLATOR
from hystid.identification.hybrid.result import Hybrid
from hystid.identification.prediction import Prediction, Role
from hystid.leastsquares import REASONS
from hystid.networks import TwoNetworkModel
from hystid.networks.ensemble import TrainedPair
from hystid.recording import Recording
from hystid.results import Result
from hystid.rotation import turned_code

_TIE = 1.01  # errors whose ratio is below count as the same


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
    starts: Sequence[TrainedPair]
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
        """Why the model is of no use, "" where it is: worse than a linear fit, or no better than no model at all.

        An NRMSE of 100 % is what a constant force has, and a displacement of zero. Medians over ``judged``. A tie with
        no model counts against it; one with the linear fit does not, as on a linear structure the two are the same.
        """
        force, linear = (
            float(np.median([prediction.force_nrmse for prediction in group]))
            for group in ([c.network for c in self.judged], [c.linear for c in self.judged])
        )
        if _TIE * force > 1.0:
            return f"the force is as unexplained ({100 * force:.3g} %) as without any model"
        if force > _TIE * linear:
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

    def written(self, folder: Path) -> Identification:
        """Write surrogate.onnx, surrogate.fmu, oscillator.fmu (where there is a mass), hybrid.mo and hybrid.fmu (where
        one is offered) and identification.json.

        Returns the result with ``files`` filled in. identification.json comes last: where it stands, all is whole.
        """
        from hystid.fmu import build
        from hystid.modelica import compile_model
        from hystid.networks import onnx
        from hystid.surrogate import oscillator_code, surrogate_code

        folder.mkdir(parents=True, exist_ok=True)
        files = {"onnx": folder / "surrogate.onnx", "surrogate": folder / "surrogate.fmu"}
        onnx.write(self.model, files["onnx"])
        build(surrogate_code(files["onnx"]), files["surrogate"])
        if self.model.mass:
            files["oscillator"] = folder / "oscillator.fmu"
            build(oscillator_code(files["onnx"]), files["oscillator"])
        if self.hybrid and self.hybrid.offered:
            files |= {"hybrid_package": folder / "hybrid.mo", "hybrid": folder / "hybrid.fmu"}
            with atomic(files["hybrid_package"]) as beside:
                beside.write_text(self.hybrid.text, encoding="utf-8")
            code = compile_model(f"{files['hybrid_package']}:{OSCILLATOR}")
            build(turned_code(code) if self.rotational else code, files["hybrid"])
        result = replace(self, files=files)
        write_json(folder / "identification.json", result.as_dict())
        return result

    def _write(self, folder: Path) -> None:
        self.written(folder)

    def _training(self, start: TrainedPair) -> dict[str, Any]:
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
