"""Results of studies: figures per structure, the choice with its reason, and their JSON."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from hystid.networks.normal_equations import parameter_count
from hystid.results import Result
from hystid.study.work import TrainingResult

_NEAR_LEAST = 1.1  # medians within this factor of the least count as equally good
_USELESS = 0.5  # NRMSE: a displacement of zero has 1
_DIVERGED = 1e300  # stands for infinity between which and a number there is a number


@dataclass(frozen=True)
class Quartiles:
    """Box-plot figures of values (NRMSE, fractions), as the report draws them; infinity where what counts diverged."""

    best: float
    lower: float
    median: float
    upper: float
    worst: float
    values: tuple[float, ...]

    @staticmethod
    def of(values: Sequence[float]) -> Quartiles:
        """Figures of at least one value; NaN (no free run) stays NaN."""
        array = np.array(values, dtype=float)
        levels = [float("nan")] * 5
        if not np.isnan(array).any():
            levels = np.quantile(np.minimum(array, _DIVERGED), [0, 0.25, 0.5, 0.75, 1], method="hazen").tolist()
            levels = [level if level < 1e-3 * _DIVERGED else np.inf for level in levels]
        best, lower, median, upper, worst = levels
        return Quartiles(best, lower, median, upper, worst, tuple(values))

    def as_dict(self) -> dict[str, Any]:
        """JSON-like; infinity becomes null."""
        return asdict(self)


@dataclass(frozen=True, eq=False)
class GridCell:
    """All starts of one structure at one mass.

    force, free_run: spread over the starts of each one's median error over the held-out recordings. ensemble: errors of
    the mean of the best tenth (by validation error, which knows nothing of the held-out recordings); single: errors of
    the start of the least validation error. Each is {"force_nrmse", "x_nrmse"}, medians over the held-out recordings.
    """

    layers: tuple[int, ...]
    mass: float
    outcomes: Sequence[TrainingResult]
    force: Quartiles
    free_run: Quartiles
    ensemble: Mapping[str, float]
    single: Mapping[str, float]

    @property
    def parameters(self) -> int:
        """Weights of both networks together."""
        return 2 * parameter_count((3, *self.layers, 1))

    @property
    def stopped(self) -> dict[str, dict[str, int]]:
        """For each network of the pair: why its trainings ended, and how many of them for that reason."""
        reasons = {name: [outcome.stopped[name] for outcome in self.outcomes] for name in ("hysteresis", "restoring")}
        return {name: dict(sorted(Counter(texts).items())) for name, texts in reasons.items()}

    @property
    def name(self) -> str:
        """Such as 5-5."""
        return "-".join(map(str, self.layers))

    def as_dict(self) -> dict[str, Any]:
        """Entry of ``cells`` in the JSON file."""
        return {
            "layers": list(self.layers),
            "mass": self.mass,
            "parameters": self.parameters,
            "force_nrmse": self.force.as_dict(),
            "free_run_x_nrmse": self.free_run.as_dict(),
            "ensemble": dict(self.ensemble),
            "single": dict(self.single),
            "stopped": self.stopped,
        }


@dataclass(frozen=True, eq=False)
class GridResult(Result, report="study", json="study.json"):
    """Result of ``grid``. cells: one per structure, in the order asked for; chosen: place of the best; reason: why."""

    cells: Sequence[GridCell]
    chosen: int
    reason: str
    settings: Mapping[str, Any]
    files: Mapping[str, Path] = field(default_factory=dict)

    @property
    def best(self) -> GridCell:
        """The chosen structure."""
        return self.cells[self.chosen]

    @property
    def failure(self) -> str:
        """That no structure is of use, "" where one is: half of the motion is beyond the chosen one's median start."""
        free = not np.isnan(self.best.free_run.median)
        error = self.best.free_run.median if free else self.best.force.median
        if error < _USELESS:
            return ""
        found = f"is off by {_percent(error)}" if np.isfinite(error) else "diverges"
        return f"no structure is of use: the {'free-run displacement' if free else 'force'} {found} at best"

    def as_dict(self) -> dict[str, Any]:
        """Content of study.json."""
        return {
            "study": "grid",
            "settings": dict(self.settings),
            "cells": [cell.as_dict() for cell in self.cells],
            "best": {"layers": list(self.best.layers), "reason": self.reason},
            "failure": self.failure,
        }


@dataclass(frozen=True, eq=False)
class MassResult(Result, report="study", json="study.json"):
    """Result of ``mass``: cells for each size and assumed mass. offsets: fractions of the nominal mass."""

    cells: Sequence[GridCell]
    nominal: float
    offsets: tuple[float, ...]
    settings: Mapping[str, Any]
    files: Mapping[str, Path] = field(default_factory=dict)

    def row(self, layers: tuple[int, ...]) -> list[GridCell]:
        """Cells of one structure, in the order of the offsets."""
        return [cell for cell in self.cells if cell.layers == layers]

    def as_dict(self) -> dict[str, Any]:
        """Content of study.json."""
        return {
            "study": "mass",
            "settings": dict(self.settings),
            "nominal": self.nominal,
            "offsets": list(self.offsets),
            "cells": [cell.as_dict() for cell in self.cells],
        }


def choose(cells: Sequence[GridCell]) -> tuple[int, str]:
    """The smallest structure whose median held-out error is within a tenth of the least, and a sentence saying so.

    The error is the free-run displacement's where there is a mass, else the force's.
    """
    free = not any(np.isnan(cell.free_run.median) for cell in cells)
    kind = "free-run displacement" if free else "force"
    medians = [(cell.free_run if free else cell.force).median for cell in cells]
    least = int(np.argmin(medians))
    near = [k for k, median in enumerate(medians) if median <= _NEAR_LEAST * medians[least]]
    chosen = min(near, key=lambda k: (cells[k].parameters, k)) if near else least
    what = f"median {kind} NRMSE over the starts"
    if chosen == least:
        found = _percent(medians[least])
        text = f"{cells[chosen].name}: least {what} ({found}), and no smaller structure within 10 % of it"
    else:
        text = (
            f"{cells[chosen].name}: the smallest of {len(near)} structures whose {what} lies within 10 % of the least "
            f"({_percent(medians[least])} with {cells[least].name}); its own is {_percent(medians[chosen])}"
        )
    return chosen, text


def _percent(fraction: float) -> str:
    return f"{100 * fraction:.3g} %" if np.isfinite(fraction) else "none finite"
