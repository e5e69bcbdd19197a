"""Recordings that begin in mid-motion: what a law with memory remembers of the time before is not in the recording.

The state of a contact at the first sample depends on where it stuck last. Laws with inner states forget that with the
first full stroke; until then their force may be anything within the loop, and the samples say nothing about the law.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from hystid.diagnosis.model.baseline import Baseline
from hystid.diagnosis.prepare.refused import SHORTEST
from hystid.diagnosis.prepare.segments import Part
from hystid.diagnosis.prepare.whitening import longest_trim
from hystid.numeric import Array

_FIRST_SAMPLES = 8  # samples whose mean shows whether a recording begins at rest
_AT_REST, _STILL = 4.0, 0.05  # standard errors of that mean, and share of the spread of a channel, that are still rest
_VISIBLE = 0.5  # noise units: force of another past that is seen, of all samples together
_STROKE = 60  # samples of a stroke that is put before a recording
_NEAR_END, _LAST = 0.03, 20  # share of the stroke that is near an end, and part of a recording that has forgotten most


def beginning(
    parts: Sequence[Part], baseline: Baseline, values: Mapping[str, float], *, holding: bool = False
) -> tuple[list[Part], tuple[int, ...], list[str]]:
    """The parts with a past where they begin in mid-motion, and their first samples not valid while the law still knows
    of it; numbers of the recordings in which a contact keeps a force of that time; sentences.

    values: parameters of the law. holding: contacts may hold a force where a recording begins still, if nothing denies
    it. Parts that were begun before, at other values, leave out what either says.
    """
    if baseline.memoryless:
        return list(parts), (), []
    found, kept, told = list(parts), [], []
    for number, part in enumerate(parts):
        if (rest := _rests(part, baseline.mass)) or (rest is None and not holding):
            continue
        past = _past(part)
        lasting, keeps = _remembered(replace(part, past=past), baseline, values)
        valid = np.ones(len(part), dtype=bool) if part.valid is None else part.valid.copy()
        most = max(len(part) - longest_trim(len(part)) - SHORTEST, 0)  # rows have to be left
        left_out = max(min(lasting, most), int(np.argmax(valid)) if part.past else 0)
        valid[:left_out] = False
        found[number] = replace(part, valid=valid, past=past)
        kept += [number] if keeps else []
        told.append(
            f"{part.name} begins in mid-motion, and what was before is not recorded: its first "
            f"{left_out * part.dt:.3g} s, whose force depends on it, are left out"
            + (", and so is a constant force of contacts that never slip" if keeps else "")
        )
    return found, tuple(kept), told


def maybe_holding(parts: Sequence[Part], baseline: Baseline) -> bool:
    """Whether contacts may hold a force at the first sample of any part."""
    return not baseline.memoryless and any(_rests(part, baseline.mass) is None for part in parts)


def _rests(part: Part, mass: float) -> bool | None:
    """Whether a recording begins without velocity and, but for noise and a small offset, without displacement and
    restoring force, or without force and acceleration: a free vibration turns without force.

    A contact that a stronger motion left off its middle holds a force where nothing is accelerated: None where there
    is a force, which may as well be constant, or noise hides one. What a constant force moves from there on is not yet
    in motion at the first sample: the velocity is that of then.
    """
    since = 0.5 * (_FIRST_SAMPLES - 1) * part.dt

    def velocity(v: NDArray[np.floating], a: NDArray[np.floating]) -> float:
        return float(np.mean(v[:_FIRST_SAMPLES]) - since * np.mean(a[:_FIRST_SAMPLES]))

    draws = part.jitter.first()
    slow, quick = (
        float(np.sqrt(np.mean(np.square(errors))))
        for errors in zip(*((velocity(dv, da), np.mean(da[:_FIRST_SAMPLES])) for _, dv, da, _ in draws), strict=True)
    )
    if not _is_small(velocity(part.v, part.a), part.v, slow):
        return False
    still = "x" in part.noise and _begins_small(part.measured["x"], part.noise["x"] / np.sqrt(_FIRST_SAMPLES))
    if "F" not in part.noise:
        return still
    error = part.noise["F"] / np.sqrt(_FIRST_SAMPLES)
    still |= _begins_small(part.measured["F"], error) and _begins_small(part.a, quick)
    restoring, error = part.F - mass * part.a, float(np.hypot(error, mass * quick))
    if not still:
        return False
    if _begins_small(restoring, error):
        return True if _AT_REST * error < _STILL * float(np.std(restoring)) else None
    return None if _begins_small(part.a, quick) else True  # what is accelerated has just been let go


def _begins_small(channel: Array, error: float) -> bool:
    return _is_small(float(np.mean(channel[:_FIRST_SAMPLES])), channel, error)


def _is_small(value: float, channel: Array, error: float) -> bool:
    return abs(value) < _AT_REST * error + _STILL * float(np.std(channel))


def _past(part: Part) -> int:
    """Samples until the motion has come near both of its ends: that long a past wipes out what was before."""
    low, high = float(np.min(part.x)), float(np.max(part.x))
    margin = _NEAR_END * (high - low)
    ends = np.argmax(part.x >= high - margin), np.argmax(part.x <= low + margin)  # first samples there
    return int(np.clip(max(ends), 1, len(part) - 1))


def _remembered(part: Part, baseline: Baseline, values: Mapping[str, float]) -> tuple[int, bool]:
    """Samples from the first one to the last at which the past changes the force, and whether it leaves a constant:
    from rest at the first sample, through the part's past, or at the end of a full stroke of either sense."""
    pasts = [part.led_in(part.x, part.v), *(_after_stroke(part, sense) for sense in (-1.0, 1.0))]
    there, _ = baseline.force(part.x, part.v, part.dt, values)
    noise, lasting, keeps = part.balance_noise(baseline.mass), 0, False
    for x, v in pasts:
        apart = baseline.force(x, v, part.dt, values)[0][-len(part) :] - there
        constant = float(np.median(apart[-len(apart) // _LAST :]))
        later = np.cumsum(np.square((apart - constant)[::-1]))[::-1]  # what it changes from a sample on
        lasting = max(lasting, int(np.count_nonzero(later > (_VISIBLE * noise) ** 2)))
        keeps |= abs(constant) > _VISIBLE * noise
    return lasting, keeps


def _after_stroke(part: Part, sense: float) -> tuple[Array, Array]:
    """The motion with a stroke of its whole range before it, which slows down to its first point."""
    left = np.linspace(1.0, 0.0, _STROKE, endpoint=False)
    x = part.x[0] + sense * float(np.ptp(part.x)) * left**2
    v = np.gradient(x, part.dt)
    return np.concatenate([x, part.x]), np.concatenate([v, part.v])
