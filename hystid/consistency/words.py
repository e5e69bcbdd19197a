"""Findings as sentences: what was seen, in numbers, and how to mend it."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

from hystid.consistency.bad_samples import alone
from hystid.consistency.force import Force
from hystid.consistency.kinematics import Pair
from hystid.consistency.slips import CALIBRATION, LINEAR, USUAL, Explanation, Slip
from hystid.consistency.types import Mismatch
from hystid.recording import Array, Recording
from hystid.units import to_si

_DERIVATIVES = {("x", "v"): "dx/dt", ("x", "a"): "the second derivative of x", ("v", "a"): "dv/dt"}


def slips(
    name: str, best: Explanation, compared: Sequence[Pair], rotational: bool, mass: float | None
) -> list[Mismatch]:
    """One finding per slip of an explanation, and one for each slip that would explain as much instead."""
    if best.readings:
        return [_several_units(name, best.readings, compared)]
    exchanged = [_exchanged(name, slip, compared) for slip in best.slips if slip.kind == "exchanged"]
    if exchanged and len(best.slips) > 1:  # sizes after an exchange follow from one frequency, too roughly for a unit
        return [
            replace(item, mend=f"{item.mend}, and check again: something else is wrong as well") for item in exchanged
        ]
    if best.alike and best.slips[0].kind == "unit":
        found = [_unit(name, best.slips[0], compared, best.alike)]
    elif best.alike:
        found = [_time(name, best.slips[0], compared, best.alike)]
    else:
        found = [_slip(name, slip, compared, rotational, mass) for slip in best.slips]
    if not best.instead:
        return found
    others = [_slip(name, slip, compared, rotational, mass) for slip in best.instead]
    others = [replace(item, sentence=f"or else {item.sentence}") for item in others]
    return [replace(item, repair={}) for item in (*found, *others)]  # nobody knows which one mends it


def _slip(name: str, slip: Slip, compared: Sequence[Pair], rotational: bool, mass: float | None) -> Mismatch:
    if slip.kind == "exchanged":
        return _exchanged(name, slip, compared)
    if slip.kind == "reversed":
        return _reversed(name, slip, compared)
    if slip.channels[0] == "m":
        return _mass(name, slip, rotational, mass)
    if slip.kind == "time":
        return _time(name, slip, compared)
    return _unit(name, slip, compared)


def _evidence(channel: str, compared: Sequence[Pair]) -> tuple[str, dict[str, float]]:
    told, seen = [], {}
    for p in compared:
        if channel in (p.low, p.high, "") and math.isfinite(p.gain):
            seen[f"{p.high} over {_DERIVATIVES[p.low, p.high]}"] = p.sign * p.gain
            told.append(f"{p.high} is {_number(p.sign * p.gain)} times {_DERIVATIVES[p.low, p.high]}")
    return " and ".join(told), seen


def _unit(name: str, slip: Slip, compared: Sequence[Pair], alike: Sequence[str] = ()) -> Mismatch:
    channel = slip.channels[0]
    told, seen = _evidence(channel, compared)
    seen["times too large"] = slip.factor
    times = max(slip.factor, 1 / slip.factor)
    size = f"about {float(f'{times:.2g}'):g}" if alike else _number(times)
    size += " times too large" if slip.factor > 1 else " times too small"
    others = "the motion" if channel == "F" else "the other channels" if told else "the force and the mass"
    sentence = f"{channel} is {size} for {others}" + (f" ({told})" if told else "")
    if channel == "F":
        sentence += ", judged by the mass and the acceleration"
    if slip.kind == "gain":
        sentence += ", which fits no unit"
        mend = f"check the sensor's factor, as --sensitivity {channel}=..., or the column of {channel}"
        if len(compared) == 1 and channel != "F":
            rate = times ** (1 / compared[0].order)
            mend += f"; a sample rate that is wrong by a factor of {_number(rate)} looks the same"
        return Mismatch(name, channel, "wrong_unit", sentence, mend, "refuse", seen)
    sentence += f": it looks like {' or '.join([slip.units[1], *alike])}"
    mend = f"write '{channel} [{slip.units[1]}]' in the header or give --unit {channel}={slip.units[1]}"
    mend += "; else the mass is wrong" if channel == "F" or not told else ""
    repair = {} if alike else {"unit": f"{channel}={slip.units[1]}"}  # the only reading that fits, or none
    return Mismatch(name, channel, "wrong_unit", sentence, mend, "refuse", seen, repair)


def _time(name: str, slip: Slip, compared: Sequence[Pair], alike: Sequence[str] = ()) -> Mismatch:
    told, seen = _evidence("", compared)
    seen["times too large"] = slip.factor
    size = f"{_number(slip.factor)} times too slow" if slip.factor > 1 else f"{_number(1 / slip.factor)} times too fast"
    repair: dict[str, str] = {}
    if slip.units[1] == "samples":
        looks = f"t numbers the samples; the sample rate would be {_number(slip.factor)} Hz"
        mend = f"divide t by the sample rate in Hz (about {_number(slip.factor)}), or write the time in s"
    elif slip.units[1] == "rate":
        looks = f"the sample rate would be {_number(slip.factor)} times as high, which fits no unit of t"
        mend = "check the sample rate that was entered for this file, and correct t by it"
    else:
        looks = f"t looks like {' or '.join([slip.units[1], *alike])}"
        mend = f"write 't [{slip.units[1]}]' in the header or give --unit t={slip.units[1]}"
        repair = {} if alike else {"unit": f"t={slip.units[1]}"}
    judged = told or "judged by the mass and the force"
    sentence = f"time runs {size} for the motion ({judged}): {looks}"
    return Mismatch(name, "t", "wrong_unit", sentence, mend, "refuse", seen, repair)


def _several_units(name: str, readings: Sequence[Sequence[Slip]], compared: Sequence[Pair]) -> Mismatch:
    """Columns without units, of which several are in other units at once."""
    told, seen = _evidence("", compared)
    order = "tFxva"
    units = [
        sorted(((s.channels[0], s.units[1]) for s in slips), key=lambda u: order.index(u[0])) for slips in readings
    ]
    each = [_listed([f"{channel} in {unit}" for channel, unit in one]) for one in units]
    channels = sorted({channel for one in units for channel, _ in one}, key=order.index)
    sentence = f"{_listed(channels)} have no units, and do not fit together in SI units"
    sentence += f" ({told or 'judged by the mass and the force'}): {'; or '.join(each)} would fit"
    mend = "write the units in the header"
    if len(units) == 1:
        mend += ", or give --unit " + " ".join(f"{channel}={unit}" for channel, unit in units[0]) + " if that is so"
    else:
        mend += " or give them with --unit: the data alone do not tell which"
    mend += "; else the mass is wrong" if "F" in channels else ""
    return Mismatch(name, _listed(channels), "wrong_unit", sentence, mend, "refuse", seen)


def _listed(words: Sequence[str]) -> str:
    return " and ".join([", ".join(words[:-1]), words[-1]] if len(words) > 1 else words)


def _mass(name: str, slip: Slip, rotational: bool, mass: float | None) -> Mismatch:
    given, unit = mass or 0.0, "kg.m2" if rotational else "kg"
    word = "an inertia" if rotational else "a mass"
    true = given / slip.factor
    sentence = f"F over a at high frequency says {word} of {_number(true)} {unit}, not {_number(given)} {unit}"
    if slip.kind == "unit":
        sentence += f": it looks like {slip.units[1]}"
    seen = {"apparent mass": true, "given mass": given}
    same = [f"{channel} in {unit}" for channel, power in (("F", 1), ("a", -1)) for unit in _units(channel, slip, power)]
    mend = f"give --mass {_number(true)} if it was weighed so, or check the units of F and a"
    mend += f", for {' or '.join(same)} would look the same" if same and not rotational else ""
    return Mismatch(name, "m", "wrong_mass", sentence, mend, "refuse", seen)


def mass_apart(recording: Recording, mass: float, ratio: float) -> Mismatch:
    """A mass that F over a shows, further off the given one than fixtures and springs, and no unit. ratio: of both."""
    told = _mass(recording.name, Slip("gain", ("m",), 0.0, 1.0 / ratio), recording.rotational, mass)
    return replace(told, severity="note")


def no_inertia(recording: Recording, force: Force, mass: float) -> Mismatch:
    """The force follows the motion without the mass that was given."""
    word, unit = ("inertia", "kg.m2") if recording.rotational else ("mass", "kg")
    sentence = (
        f"F shows no {word}: {_number(mass)} {unit} would change it by {100 * mass * force.weight:.0f} %, and laws"
    )
    sentence += f" of x and v explain {100 * force.free_share:.4g} % of it without any"
    mend = f"give the {word} as 0 where F is measured behind the moving parts, or check that all channels are measured"
    return Mismatch(
        recording.name, "m", "wrong_mass", sentence, mend, "refuse", {"apparent mass": force.mass, "given mass": mass}
    )


def _units(channel: str, slip: Slip, power: int) -> list[str]:
    """Usual units of a linear channel that would make the same of F over a as a slip of the mass."""
    listed = LINEAR[channel]
    return [u for u in listed[1:USUAL] if abs(math.log(to_si(u, listed[0])[0] ** power / slip.factor)) < CALIBRATION]


def _reversed(name: str, slip: Slip, compared: Sequence[Pair]) -> Mismatch:
    channel = slip.channels[0]
    told, seen = _evidence(channel, compared)
    sentence = f"{channel} has the wrong sign ({told})"
    if len({n for p in compared for n in (p.low, p.high)}) == 2:
        other = next(n for p in compared for n in (p.low, p.high) if n != channel)
        sentence = f"{channel} or {other} has the wrong sign ({told})"
    mend = f"reverse it with --reverse {channel}"
    return Mismatch(name, channel, "swapped_sign", sentence, mend, "refuse", seen, {"reverse": channel})


_HEADER = "correct the header: names and units of these columns are exchanged"


def _exchanged(name: str, slip: Slip, compared: Sequence[Pair]) -> Mismatch:
    moves = dict(item.split("=") for item in slip.channels)
    seen = {f"exponent of {p.high} over {_DERIVATIVES[p.low, p.high]}": p.slope for p in compared}
    p = compared[0]
    held = ", ".join(f"{a} holds {b}" for a, b in moves.items())
    sentence = f"the columns are exchanged: {held} ({p.high} over {_DERIVATIVES[p.low, p.high]} changes with frequency"
    sentence += f" as its power {p.slope:.1f})" if math.isfinite(p.slope_error) else " does not fit otherwise)"
    mend = "choose the columns with " + " ".join(f"--channel {b}=<column of {a}>" for a, b in moves.items())
    mend = _HEADER if slip.scales else mend
    return Mismatch(name, " and ".join(moves), "swapped_channels", sentence, mend, "refuse", seen)


def copied(name: str, one: str, other: str) -> Mismatch:
    """Two channels that hold the same numbers."""
    sentence = f"{one} and {other} hold the same numbers, sample by sample: one column was copied or chosen twice"
    mend = f"look which of the two it is, and choose the other with --channel {one}=COLUMN or --channel {other}=COLUMN"
    if one == "F":
        mend += "; accept a law whose factor is exactly 1 with --accept swapped_channels"
    return Mismatch(name, f"{one} and {other}", "swapped_channels", sentence, mend)


def force_exchanged(name: str, channel: str, correlation: float, *, with_units: bool = False) -> Mismatch:
    """F holds a channel of the motion, and that channel the force. with_units: as the units of their labels say."""
    sentence = f"F and {channel} are exchanged: the column of F moves as {channel} must, that of {channel} does not"
    mend = f"choose the columns with --channel F=<column of {channel}> --channel {channel}=<column of F>"
    mend = _HEADER if with_units else mend
    return Mismatch(
        name, f"F and {channel}", "swapped_channels", sentence, mend, "refuse", {"correlation": correlation}
    )  # fmt: skip


def force_reversed(name: str, force: Force, other: float, share: float, names: Mapping[str, Array]) -> Mismatch:
    """The structure would give out energy, or have a negative mass."""
    told = [f"the mean power F v is {_number(100 * force.power)} % of what it could be"] if force.power < 0 else []
    if force.mass < -3 * force.mass_error:
        told.append(f"F over a says a mass of {_number(force.mass)}")
    if force.correlation < -0.8:
        told.append(f"F falls as x grows (correlation {force.correlation:.2f})")
    why = ", ".join(told) or "mass and damping would be negative"
    motions = " or ".join(names)
    alone = f" or {motions}" if len(names) == 1 else ""  # which of the two, nothing says
    sentence = (
        f"F{alone} has the wrong sign against {'the other' if alone else 'the motion'}: {why}; a structure that takes "
        f"up energy explains {100 * share:.0f} % of F, and {100 * other:.0f} % of the reversed one"
    )
    seen = {"power": force.power, "mass": force.mass, "correlation": force.correlation, "explained": share}
    mend = "reverse it with --reverse F, or accept a structure that is driven from inside with --accept swapped_sign"
    return Mismatch(name, "F", "swapped_sign", sentence, mend, "refuse", seen, {"reverse": "F"})


def force_late(name: str, force: Force, *, severe: bool) -> Mismatch:
    """The force runs on another clock."""
    word = "later" if force.lag > 0 else "earlier"
    sentence = f"F comes {milliseconds(abs(force.lag))} {word} than the motion, all through the test"
    sentence += f" ({100 * force.share:.0f} % of F fits as it stands, {100 * force.lag_share:.0f} % aligned)"
    aligned = max(force.lag_share, force.lag_reversed, force.free_lag_share)
    seen = {"lag": force.lag, "lag_error": force.lag_error, "explained": aligned}
    mend = "were they logged by two devices? align them with --align F"
    return Mismatch(name, "F", "lag", sentence, mend, "refuse" if severe else "note", seen, {"align": "F"})


def channel_late(name: str, channel: str, p: Pair, lag: float, *, severe: bool, sure: bool) -> Mismatch:
    """A channel of the motion runs on another clock. sure: whether it is this one of the two."""
    word, other = "later" if lag > 0 else "earlier", p.low if channel == p.high else p.high
    sentence = f"{channel} comes {milliseconds(abs(lag))} {word} than {other} shows, all through the test"
    seen = {"lag": lag, "lag_error": p.lag_error}
    mend = f"align it with --align {channel}, or check the filter of its amplifier"
    if not sure:
        mend = f"which of the two is off does not show: align it with --align {channel} or --align {other}, or check"
        mend += " the filters of their amplifiers"
    repair = {"align": channel} if sure else {}
    return Mismatch(name, channel, "lag", sentence, mend, "refuse" if severe else "note", seen, repair)


def filtered(name: str, channel: str, side: str, limit: float, p: Pair) -> Mismatch:
    """A channel counts only on one side of a frequency."""
    other = p.low if channel == p.high else p.high
    where = f"below {limit:.3g} Hz" if side == "low" else f"above {limit:.3g} Hz"
    why = "an AC-coupled sensor or a high-pass filter" if side == "low" else "a low-pass filter"
    counts = f"it counts from {limit:.3g} Hz on" if side == "low" else f"it counts up to {limit:.3g} Hz"
    lost = "lost below" if side == "low" else "lost above"
    sentence = f"{channel} loses motion {where} that {other} shows, as {why} does: {counts}"
    mend = f"leave {channel} out where slower motion matters, or state --band" if side == "low" else (
        f"leave {channel} out, or state --band -{limit:.3g}Hz"
    )  # fmt: skip
    return Mismatch(name, channel, "filtered", sentence, mend, "note", {lost: limit})


def drift(name: str, channel: str, share: float, limit: float) -> Mismatch:
    """A slow wandering that no other channel shows."""
    sentence = f"{channel} drifts: {100 * share:.0f} % of its power is slow and in no other channel, as if integrated"
    mend = f"leave {channel} out, or state --band {limit:.3g}-...Hz; it counts from {limit:.3g} Hz on"
    return Mismatch(name, channel, "drift", sentence, mend, "note", {"share": share, "limit": limit})


def bad_samples(name: str, channel: str, number: int, first: float) -> Mismatch:
    """Single samples that stand alone. first: time of the first one [s]."""
    sentence = f"{alone(number, first)}, as errors of a data link do"
    mend = "diagnose, identify and validate bridge such samples; look at the cable and the range of the recorder"
    return Mismatch(name, channel, "bad_samples", sentence, mend, "note", {"samples": number, "first": first})


def unexplained(name: str, compared: Sequence[Pair]) -> Mismatch:
    """Ratios that neither one slip nor two explain."""
    told, seen = _evidence("", compared)
    sentence = f"the channels do not fit together, and no slip explains it: {told}"
    mend = "several things are wrong: check the columns, the units and the sample rate one by one, and check again"
    return Mismatch(name, "", "not_one_motion", sentence, mend, "refuse", seen)


def no_fixed_ratio(name: str, p: Pair) -> Mismatch:
    """Two channels whose ratio no factor explains, as a force in the column of a motion leaves it."""
    derivative = _DERIVATIVES[p.low, p.high]
    sentence = (
        f"{p.high} is no fixed multiple of {derivative}: their ratio is level for {100 * p.level:.0f} % of its power"
    )
    mend = f"check that the columns of {p.low} and {p.high} hold what they are called; does one of them hold F?"
    return Mismatch(name, p.high, "not_one_motion", sentence, mend, "refuse", {"level": p.level})


def unrelated(name: str, p: Pair) -> Mismatch:
    """Two channels that have nothing in common."""
    sentence = f"{p.high} does not follow {_DERIVATIVES[p.low, p.high]} (both move alike in no band)"
    mend = "check that both columns belong to one test and one point, and are the channels that they are called"
    return Mismatch(name, p.high, "not_one_motion", sentence, mend, "note", {"correlation": p.correlation})


def too_large(name: str, channel: str, seen: str, size: float, alone: bool, slow: bool = False) -> Mismatch:
    """A size that no structure has.

    alone: whether no other channel of the motion is there. slow: whether the time axis is more likely at fault.
    """
    sentence = f"{channel} {seen}, which no structure of this kind does"
    unit = {"x": "mm", "v": "mm/s", "a": "mm/s2"}[channel]
    first, second = ("t", channel) if slow else (channel, "t")
    mend = f"correct the unit of {first} or of {second} in the header, or give --unit "
    mend += "t=ms" if slow else f"{channel}={unit}"
    mend += f"; or are F and {channel} exchanged?" if alone else ""
    return Mismatch(name, channel, "wrong_unit", sentence, mend, "refuse", {"size": size})


def _number(value: float) -> str:
    return f"{value:.4g}" if 1e-3 <= abs(value) < 1e5 else f"{value:.3e}"


def milliseconds(seconds: float) -> str:
    """A time in ms, or in s where it is longer than that."""
    return f"{1e3 * seconds:.3g} ms" if seconds < 1 else f"{seconds:.3g} s"
