"""Do the channels of a recording fit together: units, signs, clocks, columns, filters, and the mass."""

from hystid.consistency.align import aligned
from hystid.consistency.examine import admit, check, examine
from hystid.consistency.types import Balance, Channel, Examination, Examined, Finding, Relation

__all__ = [
    "Balance",
    "Channel",
    "Examination",
    "Examined",
    "Finding",
    "Relation",
    "admit",
    "aligned",
    "check",
    "examine",
]
