"""Channels that a user took a straight line off: neither their mean nor their slope is left."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from hystid.consistency.kinematics import ORDER
from hystid.numeric import Array
from hystid.recording import Recording

_EXACT = 1e-5  # of the standard deviation: rounding to five digits leaves less in 100 samples; a thousand independent
# samples have a mean and a slope as small in one recording of ten million
_HOW = "measured, less a straight line"
_TOLD = (
    "{0}: a straight line was taken off {1}; what is constant, or runs with the time, cannot be told. "
    "Give {1} as recorded, if you have it"
)


def with_lines_told(test: Recording) -> Recording:
    """A recording that says of which of its channels a straight line was taken off, with a note."""
    found = [name for name, values in test.channels("Fxva").items() if test.direct(name) and _has_no_line(values)]
    if not found:
        return test
    origin, note = {**test.origin, **dict.fromkeys(found, _HOW)}, _TOLD.format(test.name, " and ".join(found))
    return replace(test, origin=origin, notes=(*test.notes, note))


def unknown_degree(test: Recording) -> int:
    """Degree of the polynomial of time that nobody knows in the force balance, as ``with_lines_told`` says: that of a
    straight line, integrated to a displacement; 0 where none was taken off."""
    return max((1 + ORDER.get(name, 0) for name, how in test.origin.items() if how == _HOW), default=0)


def _has_no_line(values: Array) -> bool:
    line, least = np.linspace(-1.0, 1.0, len(values)), _EXACT * float(np.std(values))
    slope = float(line @ values) / float(line @ line)
    return bool(least > 0 and abs(float(np.mean(values))) < least and abs(slope) < least)
