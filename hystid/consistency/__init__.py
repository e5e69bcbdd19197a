"""Do the channels of a recording fit together: units, signs, clocks, columns, filters, and the mass."""

from hystid.consistency.align import aligned
from hystid.consistency.examine import admit, check, examine
from hystid.consistency.types import Agreement, Balance, Channel, Examination, Examined, Mismatch

__all__ = [
    "Agreement",
    "Balance",
    "Channel",
    "Examination",
    "Examined",
    "Mismatch",
    "admit",
    "aligned",
    "check",
    "examine",
]
