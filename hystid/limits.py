"""What a file of unknown origin may cost. Each limit has a name; an environment variable of that name raises it."""

from __future__ import annotations

import os
from dataclasses import dataclass

from hystid.errors import UsageError


@dataclass(frozen=True)
class Limit:
    """A budget. name: of the environment variable; unit: "" for a plain number."""

    name: str
    usual: float
    unit: str
    bounds: str

    @property
    def value(self) -> float:
        """What holds now. Raises UsageError where the environment variable is no positive number."""
        text = os.environ.get(self.name)
        if text is None:
            return self.usual
        try:
            value = float(text)
        except ValueError:
            value = 0.0
        if not value > 0:
            raise UsageError(f"{self.name}={text}: a positive number is needed")
        return value

    def __str__(self) -> str:
        return f"{self.value:g}{f' {self.unit}' if self.unit else ''} ({self.name} raises this)"


# Set by what they cost, with room above what tools write: 32 MB of description are some 100,000 variables and take ten
# seconds to read; 512 MB fit into the memory of any machine that has its temporary folder there.
FMU_DESCRIPTION = Limit("HYSTID_FMU_DESCRIPTION_MB", 32, "MB", "modelDescription.xml")
FMU_UNPACKED = Limit("HYSTID_FMU_UNPACKED_MB", 512, "MB", "all entries of an FMU, unpacked")
FMU_ENTRIES = Limit("HYSTID_FMU_ENTRIES", 10_000, "", "entries of an FMU")
FMU_ELEMENTS = Limit("HYSTID_FMU_ELEMENTS", 1_000_000, "", "numbers in the variables of an FMU, arrays included")
# A call of a model takes micro- to milliseconds; nobody waits half a minute for one without thinking it hangs.
CHILD_SECONDS = Limit("HYSTID_CHILD_SECONDS", 30, "s", "one call into a foreign FMU, or one file of a binary format")
CHILD_MEMORY = Limit("HYSTID_CHILD_MEMORY_MB", 8192, "MB", "memory of a foreign FMU, or of a reader of binary files")
