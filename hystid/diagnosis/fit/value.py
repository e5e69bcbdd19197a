"""A fitted number with its error and unit."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np


@dataclass(frozen=True)
class Value:
    """A fitted parameter: value, standard error (NaN where the recordings do not determine it), unit."""

    value: float
    stderr: float
    unit: str

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        return {"value": self.value, "stderr": self.stderr if np.isfinite(self.stderr) else None, "unit": self.unit}
