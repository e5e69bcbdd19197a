"""Columns that stand under each other's names: those of the motion, and that of the force with one of the motion."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import permutations

import numpy as np

from hystid.consistency import words
from hystid.consistency.channel_faults import CERTAIN
from hystid.consistency.force import EXPLAINED, SIGMAS_FORCE, examine_force
from hystid.consistency.kinematics import Pair, motion, pairs
from hystid.consistency.situations import CLEAR, explanation_of, situation_of
from hystid.consistency.slips import PRIOR_SLIP, SURE, Explanation, Slip, label_scales
from hystid.consistency.types import Mismatch
from hystid.recording import Recording

_FAR = 2 * SIGMAS_FORCE  # standard errors by which a mass is out of the question, for units of a usual size too


def exchanged_motion(recording: Recording, compared: Sequence[Pair]) -> Explanation | None:
    """Columns of the motion that show one motion only after an exchange: noise hides one of slow channels where it is
    differentiated, and with it the response by which an exchange is seen otherwise."""
    names = motion(recording)
    if all(p.is_one_motion for p in compared):
        return None
    for order in permutations(names):
        moves = {held: name for held, name in zip(names, order, strict=True) if held != name}
        for moved, scales in _moved(recording, moves) if moves else ():
            again = pairs(moved)
            if not all(p.is_one_motion and p.coherence > CERTAIN for p in again):
                break
            other = explanation_of(situation_of(moved, again, None, None))
            if other.sound:
                mapped = tuple(f"{held}={name}" for held, name in moves.items())
                return replace(other, slips=(Slip("exchanged", mapped, PRIOR_SLIP, scales=scales),))
    return None


def _moved(recording: Recording, moves: Mapping[str, str]) -> Iterator[tuple[Recording, tuple[tuple[str, float], ...]]]:
    """The recording with columns exchanged, as they are, and with the units of the labels that went with the names.

    moves: channel -> the one that it holds.
    """
    held = recording.channels("Fxva")
    yield recording.with_channels({name: held[channel] for channel, name in moves.items()}), ()
    if scales := label_scales(recording.units, moves, rotational=recording.rotational):
        yield recording.with_channels({moves[channel]: held[channel] / ratio for channel, ratio in scales}), scales


def exchanged_force(
    recording: Recording, compared: Sequence[Pair], best: Explanation, mass: float | None
) -> Mismatch | None:
    """The column of F follows the motion, and that of a motion channel does not."""
    names = motion(recording)
    if recording.F is None or not np.ptp(recording.F):
        return None
    if len(names) < 2:
        return _force_for_x(recording, mass)
    if best.sound and all(p.is_one_motion for p in compared):
        return None
    found = []
    for name in names:
        for moved, scales in _moved(recording, {"F": name, name: "F"}):
            again = pairs(moved)
            if not all(p.is_one_motion for p in again):
                break
            other = explanation_of(situation_of(moved, again, None, None))
            fits = min(abs(p.correlation) for p in again if name in (p.low, p.high))
            if other.sound and (other.score - best.score > -PRIOR_SLIP + SURE or not _all_one_motion(compared, name)):
                finding = words.force_exchanged(recording.name, name, fits, with_units=bool(scales))
                found.append((other.score, finding))
    return max(found, key=lambda item: item[0])[1] if found else None


def _all_one_motion(compared: Sequence[Pair], name: str) -> bool:
    return all(p.is_one_motion for p in compared if name in (p.low, p.high))


def _force_for_x(recording: Recording, mass: float | None) -> Mismatch | None:
    """With x alone: the exchange makes the structure give out energy, and F a length; or the mass is far off as the
    columns are called, and right the other way."""
    x, F = recording.x, recording.F
    if x is None or F is None or list(motion(recording)) != ["x"]:
        return None
    largest = float(np.max(np.abs(x - np.median(x))))
    here = examine_force(recording)
    others = [(examine_force(moved), bool(scales)) for moved, scales in _moved(recording, {"F": "x", "x": "F"})]
    there = others[0][0]
    if here is None or there is None or recording.rotational:
        return None
    for other, with_units in others if mass and not here.is_of(mass, _FAR) else ():
        weighs = other is not None and mass and other.moves_mass and other.is_of(mass)
        if other is not None and weighs and other.share > max(here.share, EXPLAINED):
            return words.force_exchanged(recording.name, "x", other.share, with_units=with_units)
    active = 0.5 * here.samples * math.log(max(1 - here.reversed_share, 1e-9) / max(1 - here.share, 1e-9)) < -CLEAR
    if (active or largest > 1.0) and there.share > max(here.share, 0.5) and float(np.std(F)) < 0.1 and largest > 1.0:
        return words.force_exchanged(recording.name, "x", there.share)
    return None
