"""Slow motion that no channel shows, where a structure was recorded by its velocity or acceleration alone.

A law with memory depends on it: a contact that was pushed to another place holds another force. What moves the
structure there is the measured force, and the law itself says how far.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from hystid.diagnosis.fit.hypothesis import Fit
from hystid.diagnosis.model.baseline import Baseline
from hystid.diagnosis.model.freerun import free_run
from hystid.diagnosis.prepare.segments import Part
from hystid.numeric import Array

OCTAVES = 4  # above the lowest visible frequency in which noise may hide the motion: it falls by 12 dB in each
Runs = Callable[[Part], Array | None]  # displacement (n,) of a free run under the measured force, where it is finite


def with_slow_motion(parts: Sequence[Part], run: Runs, octaves: int = 0) -> list[Part]:
    """Parts whose motion below the lowest visible frequency is that of a free run. octaves: how far above that
    frequency as well, as noise is loud there."""
    runs = [run(_begun(part)) if part.lowest else None for part in parts]
    return [part if one is None else _moved(part, one, octaves) for part, one in zip(parts, runs, strict=True)]


def runs_of(baseline: Baseline, fit: Fit) -> Runs:
    """Free runs of a baseline with the parameters of a fit."""
    values, delay = baseline.settings(fit.hypothesis.parameters()), fit.hypothesis.delay
    return lambda part: free_run(baseline.model, part, values, delay)


def told_of(parts: Sequence[Part], octaves: int) -> str:
    """What was done, as a sentence."""
    below = 2**octaves * max(part.first_Hz for part in parts if part.lowest)
    return f"x was not measured: motion below {below:.2g} Hz is what the model does under the measured force"


def _begun(part: Part) -> Part:
    """A part that begins at rest where it was: what is seen of the motion at the first sample lacks the slow part."""
    return part if part.past else replace(part, x=part.x - part.x[0], v=part.v - part.v[0])


def _moved(part: Part, run: Array, octaves: int) -> Part:
    slow = part.slow(run - part.x, octaves)
    return replace(part, x=part.x + slow, v=part.v + np.gradient(slow, part.dt))
