"""Was the motion under control? A test can be repeated slowly where it was; an earthquake cannot.

A sine, a sweep or a cycle of a machine has an envelope that hardly moves. That of Gaussian noise is spread by
sqrt(4 / pi - 1) = 0.52 of its mean (Rayleigh), that of an earthquake, a hammer blow or a free decay by more.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.signal import hilbert

from hystid.diagnosis.prepare.segments import Part
from hystid.numeric import Array

_SPREAD = 0.5 * np.sqrt(4 / np.pi - 1)  # half of that of noise: as far from a steady envelope as from noise
_ENDS = 0.05  # share of a recording at either end, where the envelope is not known
_MOST_SAMPLES = 100_000  # samples that are looked at: the transform costs as many logarithms more


def is_steered(parts: Sequence[Part]) -> bool:
    """Whether at least one recording was made on a rig that prescribes force or motion."""
    return any(not part.timed or min(_spread(part.F), _spread(part.x)) < _SPREAD for part in parts)


def _spread(values: Array) -> float:
    """Standard deviation of the envelope over its mean; infinite where there is no signal."""
    used = values[:_MOST_SAMPLES] - np.mean(values[:_MOST_SAMPLES])
    envelope = np.abs(hilbert(used))
    ends = int(_ENDS * len(envelope))
    inner = envelope[ends : len(envelope) - ends]
    mean = float(np.mean(inner))
    return float(np.std(inner)) / mean if mean > 0 else float("inf")
