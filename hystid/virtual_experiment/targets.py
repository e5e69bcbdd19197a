"""Targets of the demo and what was reached."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hystid.report.page import columns


@dataclass(frozen=True)
class Check:
    """One target. value and limit in ``unit``: "" for a count or a ratio, "yes" where 1 is yes and 0 is no.

    least: the value must not be below the limit.
    """

    part: str
    what: str
    value: float
    limit: float
    unit: str = ""
    least: bool = False

    @property
    def passed(self) -> bool:
        """Whether the target is met; NaN does not meet any."""
        return self.value >= self.limit if self.least else self.value <= self.limit

    @property
    def value_text(self) -> str:
        """The value with its unit."""
        if self.unit == "yes":
            return "yes" if self.value == 1 else "no"
        return f"{self.value:.3g} {self.unit}".strip()

    @property
    def limit_text(self) -> str:
        """The limit with its sense."""
        if self.unit == "yes":
            return "yes"
        return f"{'at least' if self.least else 'at most'} {self.limit:.3g} {self.unit}".strip()


@dataclass(frozen=True)
class Outcome:
    """All targets of a run, and where its files are."""

    folder: Path
    checks: tuple[Check, ...]

    @property
    def passed(self) -> bool:
        """Whether every target is met."""
        return all(check.passed for check in self.checks)

    def summary(self) -> str:
        """Table for the terminal."""
        rows = [("target", "reached", "asked", "")]
        rows += [(c.what, c.value_text, c.limit_text, "met" if c.passed else "MISSED") for c in self.checks]
        met = sum(check.passed for check in self.checks)
        return f"{columns(rows)}\n{met} of {len(rows) - 1} targets met; open {self.folder / 'report.html'}"

    def as_dict(self) -> dict[str, Any]:
        """Content of demo.json."""
        return {
            "passed": self.passed,
            "checks": [
                {
                    "part": check.part,
                    "what": check.what,
                    "value": check.value,
                    "limit": check.limit,
                    "unit": check.unit,
                    "sense": "at least" if check.least else "at most",
                    "passed": check.passed,
                }
                for check in self.checks
            ],
        }
