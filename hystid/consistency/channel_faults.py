"""What sets two channels of one motion apart: another clock, a filter, drift, or another motion altogether."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from hystid.consistency import words
from hystid.consistency.filters import MATTERS, Form
from hystid.consistency.force import examine_force, is_late
from hystid.consistency.kinematics import ORDER, Pair, hertz, main_frequency, motion, spectrum
from hystid.consistency.slips import Slip
from hystid.consistency.types import Mismatch
from hystid.recording import Recording

_SIGMAS = 6.9  # standard errors of a lag, from six sections: one sound pair in a thousand (Student, 5 degrees)
_LOST = 0.7  # response over the gain below which a channel does not count (3 dB)
_STANDS_OUT = 10.0  # motion over noise from which two channels are coherent, whatever else differs
_DRIFT = 0.01  # share of the power of a channel
CERTAIN = 0.8  # coherence at which a response is read band by band
PHASE = 0.5  # radians of the main motion beyond which a lag spoils the balance: an eighth of the force moves over


@dataclass(frozen=True)
class Late:
    """A channel of the motion on another clock: by how much it comes later [s], and the pair that shows it best. sure:
    whether a third channel or the force tells that it is this one."""

    channel: str
    lag: float
    shown: Pair
    sure: bool


def channel_faults(
    recording: Recording,
    compared: Sequence[Pair],
    whole: Sequence[Pair],
    slips: Sequence[Slip],
    forms: Mapping[tuple[str, str], Form],
    late: Late | None,
) -> list[Mismatch]:
    """Findings about pairs of channels besides the slips. whole: pairs of which no channel is cut off."""
    found = []
    if not any(slip.kind == "exchanged" for slip in slips):
        if late is not None:
            severe = main_frequency(recording) * abs(late.lag) > PHASE
            found.append(
                words.channel_late(recording.name, late.channel, late.shown, late.lag, severe=severe, sure=late.sure)
            )
        # a channel that is cut off loses motion where that is large, not by frequency
        found += _filters(recording, whole, forms)
    return found + ([] if slips else _unrelated(recording, compared))


def late_channel(recording: Recording, compared: Sequence[Pair], forms: Mapping[tuple[str, str], Form]) -> Late | None:
    """A channel of the motion on another clock; of several, the one that all others disagree with, F included."""
    filtered = {form.channel for form in forms.values()}  # one filter shows in all pairs of its channel
    late = [p for p in compared if _pair_is_late(p, recording) and not filtered & {p.low, p.high}]
    if not late:
        return None
    names = list(motion(recording))
    blamed = late[0].high if len(late) == 1 else max(names, key=lambda n: sum(n in (p.low, p.high) for p in late))
    sure = len(names) > 2
    if not sure:
        without = {name: examine_force(recording.with_channels({name: None})) for name in names}
        off = {name: force is not None and is_late(recording, force) for name, force in without.items()}
        sure = off[late[0].low] != off[late[0].high]
        blamed = late[0].low if sure and off[late[0].high] else late[0].high
    shown = max((p for p in late if blamed in (p.low, p.high)), key=lambda p: abs(p.lag) / max(p.lag_error, 1e-12))
    return Late(blamed, shown.lag if shown.high == blamed else -shown.lag, shown, sure)


def _pair_is_late(p: Pair, recording: Recording) -> bool:
    if not p.is_one_motion or not math.isfinite(p.lag_error):
        return False
    least = (
        0.75 * recording.dt if p.computed is None else 1.5 * recording.dt
    )  # differences are half a sample off per order
    return abs(p.lag) > least and abs(p.lag) > _SIGMAS * max(p.lag_error, 0.02 * recording.dt)


def _filters(recording: Recording, compared: Sequence[Pair], forms: Mapping[tuple[str, str], Form]) -> list[Mismatch]:
    """Channels that lose low or high frequencies which another one shows, and integrated channels that drift."""
    found: dict[tuple[str, str], Mismatch] = {}
    told: dict[tuple[str, str], Mismatch] = {}
    for p in compared:
        if p.is_one_motion and (drifting := _drift(p, recording) or _wandering(p, recording)) is not None:
            name, share = drifting
            told.setdefault((name, "drift"), words.drift(recording.name, name, share, hertz(p.band)[0]))
    for p in sorted(compared, key=lambda p: -forms[p.low, p.high].odds if (p.low, p.high) in forms else 0.0):
        form = forms.get((p.low, p.high))
        if form is not None:
            if not any(name in (p.low, p.high) for name, _ in found):  # one filter shows in all pairs of its channel
                limit = form.corner / (2 * math.pi)
                found[form.channel, form.side] = words.filtered(recording.name, form.channel, form.side, limit, p)
            continue
        if not p.is_one_motion or p.computed is not None:
            continue
        sure = p.bands.seen & (p.bands.coherence > CERTAIN)
        size = np.abs(p.bands.response) / p.gain
        slow = np.maximum(p.bands.low, p.bands.high) / np.maximum(p.bands.omega, 1e-300) ** (2 * ORDER[p.high])
        for side, beyond in (("low", p.bands.omega < p.band[0]), ("high", p.bands.omega > p.band[1])):
            at = np.flatnonzero(sure & beyond)
            power = slow if side == "low" else np.maximum(p.bands.low * p.gain**2, p.bands.high)
            if len(at) < 3 or np.sum(power[at]) < MATTERS * np.sum(power):
                continue
            limit = hertz(p.band)[0 if side == "low" else 1]
            lost, gained = np.median(size[at]) < _LOST, np.median(size[at]) > 1 / _LOST
            if lost or gained:
                name = p.high if lost else p.low
                found.setdefault((name, side), words.filtered(recording.name, name, side, limit, p))
    return [*told.values(), *found.values()]


def _drift(p: Pair, recording: Recording) -> tuple[str, float] | None:
    """A channel with slow power of its own: up to the main motion, above its noise, and not in the other one."""
    if p.high == "a":
        return _drift_below(p, recording) if recording.x is None else None
    main = int(np.argmax(p.bands.high * p.bands.seen))
    held = spectrum(motion(recording)[p.high], recording.dt)
    rising = np.interp(p.bands.omega, held.omega, held.density) > 100 * held.level
    own = (1.0 - p.bands.coherence) * p.bands.high * rising
    at = int(np.argmax(own))
    slow = at <= main and float(np.sum(own[: main + 1])) > 0.5 * float(np.sum(own))
    share = float(np.sum(own[: main + 1])) / float(np.sum(p.bands.high))
    more = p.bands.high[at] > p.bands.low[at] * p.gain**2  # else the other channel has it
    return (p.high, share) if share > _DRIFT and slow and more else None


def _drift_below(p: Pair, recording: Recording) -> tuple[str, float] | None:
    """As ``_drift``, for v beside a alone: slow power of v of which a shows less than a quarter, noise included."""
    low = p.bands.low / np.maximum(p.bands.omega, 1e-300) ** 2
    main = int(np.argmax(low * p.bands.seen))
    held = spectrum(motion(recording)[p.low], recording.dt)
    rising = np.interp(p.bands.omega, held.omega, held.density) > 100 * held.level
    own = (1.0 - p.bands.coherence) * low * rising * (p.bands.low * p.gain**2 > 4.0 * p.bands.high)
    share = float(np.sum(own[: main + 1])) / float(np.sum(low))
    return (p.low, share) if share > _DRIFT and share * float(np.sum(low)) > 0.5 * float(np.sum(own)) else None


def _wandering(p: Pair, recording: Recording) -> tuple[str, float] | None:
    """As ``_drift``, for waves as long as the recording, which the spectra of its sections do not hold: those slower
    than all on which v and the other channel agree, above noise, of which the other one shows less than a quarter."""
    held = motion(recording)
    if "v" not in (p.low, p.high) or p.computed is not None or (p.high == "a" and "x" in held):
        return None
    taper, dt = np.hanning(len(recording)), recording.dt
    # derivatives before the taper, whose own slope would count as motion
    low, high = np.gradient(held[p.low]) / dt, held[p.high]
    shown, own_motion = (low * p.gain, high) if p.high == "v" else (high / p.gain, low)
    omega = 2 * np.pi * np.fft.rfftfreq(len(taper), dt)[1:]
    other, v = (np.abs(np.fft.rfft((u - np.average(u, weights=taper)) * taper))[1:] ** 2 for u in (shown, own_motion))
    if p.high == "a":
        other, v = other / omega**2, v / omega**2
    noise = spectrum(held["v"], dt).noise ** 2 * float(taper @ taper)
    own = np.where((omega < p.band[0]) & (v > 4.0 * other) & (v > 100 * noise), v, 0.0)
    share = float(np.sum(own) / np.sum(v))
    return ("v", share) if share > _DRIFT else None


def _unrelated(recording: Recording, compared: Sequence[Pair]) -> list[Mismatch]:
    return [
        words.unrelated(recording.name, p) for p in compared if not p.is_one_motion and _ought_to_agree(recording, p)
    ]


def _ought_to_agree(recording: Recording, p: Pair) -> bool:
    """Whether the motion of the higher channel stands out of the noise of the derivative of the lower one, and the two
    are nevertheless unlike there: what noise hides is no other motion."""
    low, high = (spectrum(motion(recording)[name], recording.dt) for name in (p.low, p.high))
    hidden = np.maximum(high.level, low.level * high.omega ** (2 * p.order))
    shown = np.interp(p.bands.omega, high.omega, high.density / np.maximum(hidden, 1e-300)) > _STANDS_OUT
    return bool(np.any(shown)) and float(np.median(p.bands.coherence[shown])) < 0.5
