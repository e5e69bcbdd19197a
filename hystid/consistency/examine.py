"""Do the channels of a recording fit together? The one place that decides it, for every command."""

from __future__ import annotations

import logging
import math
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import combinations
from numbers import Real
from pathlib import Path

import numpy as np

from hystid.consistency import words
from hystid.consistency.bad_samples import bad_samples, without_bad_samples
from hystid.consistency.channel_faults import PHASE, channel_faults, late_channel
from hystid.consistency.cut_off import kept_size, with_full_sizes
from hystid.consistency.exchanged import exchanged_force, exchanged_motion
from hystid.consistency.filters import MATTERS, Form, filtered
from hystid.consistency.force import EXPLAINED, GIVEN, SIGMAS_SIGN, Force, examine_force, is_late, off_weighing
from hystid.consistency.kinematics import (
    ORDER,
    ChannelSpectrum,
    Formula,
    Pair,
    formula,
    hertz,
    main_frequency,
    motion,
    pairs,
    spectrum,
)
from hystid.consistency.situations import CLEAR, explanation_of, sign_odds, situation_of
from hystid.consistency.slips import (
    PRIOR_SLIP,
    SURE,
    Explanation,
    Situation,
    clock_is_likelier,
    doubtful_units,
    misfit_limit,
)  # fmt: skip
from hystid.consistency.types import SHORTEST, Agreement, Balance, Channel, Examination, Examined, Mismatch
from hystid.errors import UsageError
from hystid.recording import Array, Recording, Sources, loaded, own_mass

_log = logging.getLogger("hystid")

# Beyond any structure's vibration [m, m/s, m/s2], but below what a thousandfold error of the unit makes of it.
_LARGEST = {"x": 10.0, "v": 100.0, "a": 1e5}


def admit(recordings: Sequence[Recording], mass: float | None = None, accept: Collection[str] = ()) -> list[Recording]:
    """The recordings, with what is doubtful about them among their warnings, after the door of every command: bad
    samples of a data link are bridged.

    accept: slips whose findings are warnings here. Raises RecordingError with one line per finding that is none.
    """
    taken = {recording.name: {*accept, *recording.accepted} for recording in recordings}
    found = examine(recordings, mass).accepting(taken)
    found.admit()
    told = {name: tuple(str(n) for n in found.notes if n.recording == name) for name in {r.name for r in recordings}}
    for note in found.notes:
        _log.warning("hystid: warning: %s", note)
    whole = [without_bad_samples(recording) for recording in recordings]
    return [replace(r, warnings=(*r.warnings, *told[r.name])) if told[r.name] else r for r in whole]


def examine(recordings: Sequence[Recording], mass: float | None = None) -> Examination:
    """Whether force and motion of each recording fit together, and which slip explains it where they do not.

    mass [kg, or kg.m2 where rotational]: the moving mass as given, None where nobody knows it; 0 (F is the restoring
    force itself) lets inertia out of it. Recordings that are too short to say anything have no findings.
    """
    if mass is not None and not (math.isfinite(mass) and mass >= 0):
        mass = None  # every command refuses such a mass in its own words
    found, findings = [], []
    for recording in recordings:
        bad = bad_samples(recording)
        examined, several = _one(without_bad_samples(recording, bad), mass and own_mass(recording, mass))
        found.append(examined)
        findings += several
        findings += [words.bad_samples(recording.name, c, len(at), float(recording.t[at[0]])) for c, at in bad.items()]
    return Examination(found, findings, tuple(recordings))


def check(
    recordings: Sources, mass: float | None = None, accept: Collection[str] = (), out: str | Path | None = None
) -> Examination:
    """What ``hystid check`` does: read recordings, if need be, and examine them.

    mass: as for ``examine``. accept: rules whose findings are notes. out: folder for check.json and report.html.
    Raises RecordingError for a file that cannot be read; slips are findings.

    >>> import hystid
    >>> fmu = hystid.build("HystId.Oscillators.Linear", "linear.fmu")
    >>> sweep = hystid.simulate(fmu, "chirp:1-40Hz@40N,2s", dt=1e-3, noise_snr=40)
    >>> hystid.check(sweep, mass=1.0).findings
    []
    """
    if mass is not None and not (isinstance(mass, Real) and 0 <= mass < np.inf):
        raise UsageError(f"mass must be a number of at least 0 kg, found {mass!r}")
    read = loaded(recordings, accept)
    found = examine(read, mass).accepting({recording.name: {*accept, *recording.accepted} for recording in read})
    if out is not None:
        found.save(out)
    return found


def _one(recording: Recording, mass: float | None) -> tuple[Examined, list[Mismatch]]:
    findings: list[Mismatch] = []
    moves = all(np.ptp(values) > 0 for values in motion(recording).values())  # a constant channel is told as such
    timed = not recording.quasi_static and len(recording) >= SHORTEST and moves
    kept = {name: kept_size(values) for name, values in motion(recording).items()} if timed else {}
    compared = with_full_sizes(pairs(recording), kept) if timed else []
    channels = _channels(recording, compared)
    force = examine_force(_as_measured(recording, channels, kept)) if len(recording) >= SHORTEST and moves else None
    inertia = _inertia(recording, force, mass)
    forms = {(p.low, p.high): form for p in compared if (form := _form(recording, p, inertia)) is not None}
    late = late_channel(recording, compared, forms)
    moved = set() if late is None else {late.channel}
    if moved and force is not None:
        force = examine_force(_as_measured(recording, channels, kept, moved))
    # what looks like a filter may still be an exchange of columns: slips come first
    spoiled = moved | {form.channel for form in forms.values()}
    situation, best = _best(recording, compared, forms, force, mass)
    copied = _copied(recording, mass) if moves else []
    exchanged = exchanged_force(recording, compared, best, mass) if timed and not copied else None
    if copied:
        findings += copied
    elif exchanged is not None:
        findings.append(exchanged)
    elif best.misfit > misfit_limit(situation) and not best.sound and all(s.kind != "exchanged" for s in best.slips):
        # beside exchanged columns sizes follow from one frequency, too roughly for that
        findings.append(words.unexplained(recording.name, situation.pairs))
    elif (loose := _without_ratio(best, compared)) is not None:
        findings.append(words.no_fixed_ratio(recording.name, loose))
    else:
        judged: list[Mismatch] = []
        readable = not any(slip.kind == "exchanged" for slip in best.slips)
        for tried in (best, *_other_signs(best, compared)) if readable else ():
            best, mended = tried, _mended(recording, tried)
            if (best.slips or forms) and force is not None:
                force = examine_force(_as_measured(mended, channels, kept, spoiled))
            judged = _judged_force(mended, force)
            if not any(finding.slip == "swapped_sign" for finding in judged):
                break
        findings += words.slips(recording.name, best, compared, recording.rotational, mass) + judged
        if readable:
            findings += [] if findings else _sizes(mended)
            left_out = (["x", "v"], _computed(channels))
            if (
                mass and not findings and force is not None and force.denies(mass)
                and all(_denied_without(others, mended, mass) for others in left_out)
            ):  # fmt: skip
                findings.append(words.no_inertia(recording, force, mass))
            if mass and not findings and (ratio := _mass_apart(situation)):
                findings.append(words.mass_apart(recording, mass, ratio))
        whole = [p for p in compared if kept[p.low] == kept[p.high] == 1.0]
        findings += channel_faults(recording, compared, whole, best.slips, forms, late)
    relations = [
        Agreement(p.low, p.high, p.gain, p.error, p.sign, p.lag, p.lag_error, hertz(p.band), p.coherence)
        for p in compared
    ]
    balance = None
    if force is not None:
        balance = Balance(
            force.share,
            force.reversed_share,
            force.power,
            force.mass,
            force.mass_error,
            force.lag,
            force.lag_error,
            force.law,
        )
    name, rate = recording.name, recording.sample_rate
    doubts = _undecided(recording, situation, force)
    return Examined(name, len(recording), rate, recording.rotational, channels, relations, balance, doubts), findings


def _best(
    recording: Recording,
    compared: Sequence[Pair],
    forms: Mapping[tuple[str, str], Form],
    force: Force | None,
    mass: float | None,
) -> tuple[Situation, Explanation]:
    """What the slips are judged by, and the best of them: with gains and signs as filters, and formulas that smooth,
    leave them, if that is more probable than slips without."""
    plain = situation_of(recording, compared, force, mass)
    best = explanation_of(plain)
    if best.sound:
        return plain, exchanged_motion(recording, compared) or best
    known = _formulas(recording, compared)
    responses = {pair: response for pair in known if (response := known[pair] or forms.get(pair)) is not None}
    if not responses:
        return plain, best
    passed = [
        replace(p, gain=response.gain, sign=response.sign, slope=0.0)
        if (response := responses.get((p.low, p.high)))
        else p
        for p in compared
    ]
    other = situation_of(recording, passed, force, mass)
    filtered_best = explanation_of(other)
    channels = {form.channel for pair, form in forms.items() if known[pair] is None}  # a formula is a fact
    score = filtered_best.score + PRIOR_SLIP * len(channels)
    return (other, filtered_best) if score > best.score + SURE else (plain, best)


def _formulas(recording: Recording, compared: Sequence[Pair]) -> dict[tuple[str, str], Formula | None]:
    """The formula of each pair by which one of it, or both of a third channel, were computed; None where none was."""
    held = motion(recording)
    found = {(p.low, p.high): formula(held[p.low], held[p.high], p.order, recording.dt) for p in compared}
    one, other = found.get(("x", "v")), found.get(("x", "a"))
    if one is not None and other is not None and found.get(("v", "a"), one) is None:
        found["v", "a"] = Formula(other.gain / one.gain, other.sign * one.sign)
    return found


def _undecided(recording: Recording, situation: Situation, force: Force | None) -> dict[str, str]:
    """What no other channel of the recording can confirm."""
    if len(recording) < SHORTEST:
        return {}  # nothing was examined
    found = {}
    clock = [] if recording.quasi_static or "t" not in recording.units else ["t"]
    weighed = ["m"] if situation.mass else []
    rest = "F over a shows the mass too roughly" if situation.mass else "the mass is not known"
    if situation.mass_ratio is not None and situation.mass_ratio[1] <= GIVEN:  # the scale is the rougher one
        rest = "fixtures and springs may weigh as much as the unit would change"
    why = {"t": f"only rates against each other show it, and {rest}", "m": rest, "F": rest}
    for name in [*clock, *weighed, *(["F"] if recording.F is not None else []), *motion(recording)]:
        doubtful = doubtful_units(situation, name)
        if doubtful:
            reason = why.get(name, f"{_why_alone(recording, situation, name)}, and {rest}")
            called = "the mass" if name == "m" else name
            found[name] = f"whether {called} is in {', '.join(doubtful)} does not show: {reason}"
    if recording.x is None and not recording.quasi_static and motion(recording):
        place = (
            "where the structure stands does not show, nor slow motion: gaps and stops may be misread; record x as well"
        )
        found["x"] = place
    hidden = 0.0 if force is None or recording.quasi_static else force.hidden_lag
    if hidden > 1.5 * recording.dt and (main_frequency(recording) * hidden) ** 2 > MATTERS:
        late = f"a lag of F below {words.milliseconds(hidden)} does not show: hysteresis explains F as well"
        found["F"] = f"{found['F']}; {late}" if "F" in found else late
    return found


def _why_alone(recording: Recording, situation: Situation, name: str) -> str:
    """Why no other channel of the motion tells the unit of one."""
    if len(motion(recording)) < 2:
        return "no other channel of the motion is there"
    if recording.quasi_static:
        return "without a time no rate can be compared with it"
    if any(name in (p.low, p.high) for p in situation.pairs):
        return "the other channels of the motion show it too roughly"
    return "it does not follow the other channels of the motion"


def _copied(recording: Recording, mass: float | None) -> list[Mismatch]:
    """Channels that hold the very numbers of another one. A mass of one, simulated, makes F of a; nothing else does."""
    held = {name: values for name, values in recording.channels("Fxva").items() if np.ptp(values) > 0}
    for one, other in combinations(held, 2):
        if np.array_equal(held[one], held[other]) and ((one, other) != ("F", "a") or mass not in (None, 1.0)):
            return [words.copied(recording.name, one, other)]
    return []


def _mass_apart(situation: Situation) -> float:
    """Apparent over given mass, where they differ by more than weighing and the error of the test explain; else 0."""
    ratio, error = situation.mass_ratio or (0.0, 0.0)
    return ratio if ratio > 0 and off_weighing(ratio, error) > SIGMAS_SIGN else 0.0


def _mended(recording: Recording, best: Explanation) -> Recording:
    """The recording as it would be without the slips."""
    changed: dict[str, Array] = {}
    held, t = recording.channels("xvaF"), recording.t
    for slip in best.slips:
        if slip.kind in ("unit", "gain") and slip.channels[0] in held:
            name = slip.channels[0]
            changed[name] = changed.get(name, held[name]) / slip.factor
        elif slip.kind == "reversed":
            name = slip.channels[0]
            changed[name] = -changed.get(name, held[name])
        elif slip.kind == "time" and math.isfinite(slip.factor):
            t = t / slip.factor
    return replace(recording, t=t).with_channels(changed)


def _without_ratio(best: Explanation, compared: Sequence[Pair]) -> Pair | None:
    """A pair that only a gain of any size explains, which is not the ratio in most of its power: that is no gain."""
    if any(slip.kind == "exchanged" for slip in best.slips):
        return None
    gains = {slip.channels[0] for slip in best.slips if slip.kind == "gain"}
    loose = [p for p in compared if gains & {p.low, p.high} and p.is_one_motion and p.level < EXPLAINED]
    return min(loose, key=lambda p: p.level, default=None)


def _other_signs(best: Explanation, compared: Sequence[Pair]) -> Iterator[Explanation]:
    """The same with the other one of two channels reversed: which of them it is, the force tells."""
    if len(compared) == 1:
        for slip in best.slips:
            if slip.kind == "reversed":
                (other,) = {compared[0].low, compared[0].high} - set(slip.channels)
                yield replace(best, slips=tuple(replace(s, channels=(other,)) if s is slip else s for s in best.slips))


def _computed(channels: Mapping[str, Channel]) -> list[str]:
    """Channels of the motion that were computed from another one."""
    return [name for name, channel in channels.items() if name in "xva" and not channel.measured]


def _as_measured(
    recording: Recording, channels: Mapping[str, Channel], kept: Mapping[str, float], spoiled: Collection[str] = ()
) -> Recording:
    """The recording without channels of the motion that were computed, or stop at a level, where others are left: a
    displacement that wanders, as an integral of the acceleration, belongs to no force, and beyond the level of one the
    force of a spring follows the acceleration, as that of a negative mass. kept: share of its size that each keeps.
    spoiled: those with another clock or a filter, which move the force against them."""
    computed, cut = _computed(channels), [name for name, share in kept.items() if share < 1]
    for left_out in ({*computed, *cut, *spoiled}, {*computed, *spoiled}, {*computed, *cut}, {*computed}):
        if set(motion(recording)) - left_out:
            return recording.with_channels(dict.fromkeys(left_out))
    return recording


def _judged_force(recording: Recording, force: Force | None) -> list[Mismatch]:
    """Sign and clock of the force."""
    if force is None:
        return []
    names = motion(recording)
    found = []
    shifted = is_late(recording, force)
    share, other = (force.lag_share, force.lag_reversed) if shifted else (force.share, force.reversed_share)
    odds = sign_odds(force, share, other)
    elastic = recording.quasi_static or "a" not in names
    if elastic and abs(force.correlation) > 0.9 and abs(odds) < 20 * CLEAR:  # the slope of a spring says it
        odds += CLEAR * 2 * math.copysign(1.0, force.correlation) if recording.quasi_static else 0.0
    # energy that is taken up, and a mass, speak against a reversed force, whatever drift and decays make of the rest
    takes_up = not shifted and force.power > force.power_known
    moves_mass = not shifted and force.moves_mass
    if odds < -CLEAR and other > 0.2 and not (takes_up or moves_mass):
        found.append(words.force_reversed(recording.name, force, other, share, names))
    if shifted:
        severe = main_frequency(recording) * abs(force.lag) > PHASE and _fits_aligned(force)
        found.append(words.force_late(recording.name, force, severe=severe))
    return found


def _denied_without(others: Sequence[str], recording: Recording, mass: float) -> bool:
    """Whether the force shows no mass without some channels of the motion either, if any are left, and beside dampers
    that follow the place.

    By the acceleration alone: a displacement that wanders, as an integral of it, explains the force worse with the mass
    than without. Without channels that were computed: their noise is not white, and not known to be noise.
    """
    x, v, a = (None if name in others else getattr(recording, name) for name in "xva")
    less = replace(recording, x=x, v=v, a=a)
    if not motion(less):
        return True
    force = examine_force(less, placed=True)
    return force is None or force.denies(mass)


def _sizes(recording: Recording) -> list[Mismatch]:
    """Motion that no structure makes, which needs no second channel to be seen."""
    names = motion(recording)
    if recording.rotational:
        return []
    alone = len(names) == 1 and recording.F is not None
    for name, values in names.items():
        largest = float(np.max(np.abs(values - np.median(values))))
        if largest > _LARGEST[name] and not (recording.quasi_static and name != "x"):
            return [
                words.too_large(recording.name, name, f"reaches {largest:.4g} {recording.unit(name)}", largest, alone)
            ]
    if list(names) == ["x"] and not recording.quasi_static:
        speed = float(np.std(names["x"])) * main_frequency(recording)
        if speed > _LARGEST["v"]:
            return [words.too_large(recording.name, "x", f"moves at about {speed:.3g} m/s", speed, alone)]
    if list(names) in (["v"], ["a"]) and not recording.quasi_static:  # a clock in ms says nothing else to these
        (name,) = names
        size = float(np.std(names[name])) / max(main_frequency(recording), 1e-12) ** ORDER[name]
        if size > _LARGEST["x"]:
            seen = f"means a displacement of about {size:.3g} m at the frequencies of this file"
            slow = clock_is_likelier(name, float(np.std(values)), recording.sample_rate)
            return [words.too_large(recording.name, name, seen, size, alone, slow)]
    return []


def _fits_aligned(force: Force) -> bool:
    """Whether the force belongs to the motion once it is aligned, and not before: an unknown law may look late, too."""
    before, after = max(force.share, force.reversed_share), max(force.lag_share, force.lag_reversed)
    return before < EXPLAINED < after


def _inertia(recording: Recording, force: Force | None, mass: float | None) -> float:
    """Mass, given or else the apparent one, over that share of F which does work [s2/m]; 0: unknown."""
    if force is None or recording.F is None or force.power <= 0 or force.share < EXPLAINED:
        return 0.0
    moving = mass if mass is not None else force.mass if force.mass > 3 * force.mass_error else 0.0
    return moving / (force.power * float(np.std(recording.F)))


def _form(recording: Recording, p: Pair, inertia: float) -> Form | None:
    """The filter between two channels that both are measured."""
    if not p.is_one_motion or p.computed is not None:
        return None
    return filtered(recording, p, inertia)


def _channels(recording: Recording, compared: Sequence[Pair]) -> dict[str, Channel]:
    made: dict[str, str] = {}
    for p in compared:
        name = p.computed
        if name is not None and name not in made:
            made[name] = p.high if name == p.low else p.low
    found = {}
    for name, values in recording.channels("Fxva").items():
        how = spectrum(values, recording.dt)
        band = _counts(name, how, compared)
        told = recording.origin.get(name, "measured")
        measured = told.startswith("measured") and name not in made
        origin = f"computed from {made[name]}" if name in made and told.startswith("measured") else told
        rms = float(np.std(values))
        ratio = 20 * math.log10(rms / how.noise) if how.noise > 0 and 0 < rms / how.noise < math.inf else math.inf
        found[name] = Channel(
            name, recording.unit(name), rms, float(values.min()), float(values.max()), how.noise, ratio, band,
            measured, origin, how.white,
        )  # fmt: skip
    return found


def _counts(name: str, how: ChannelSpectrum, compared: Sequence[Pair]) -> tuple[float, float]:
    band = hertz(how.signal_band())
    mine = [hertz(p.band) for p in compared if name in (p.low, p.high) and p.is_one_motion]
    if not mine:
        return band
    return min(b[0] for b in mine), max(b[1] for b in mine)
