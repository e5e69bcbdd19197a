"""Which slip explains what the channels say about each other: candidates, priors and likelihood.

Every ratio that was measured is compared with what each slip predicts: another unit, a reversed or exchanged column, a
time axis in milliseconds. A slip is a simple statement with a prior; a gain that fits no unit is the dearest one. The
likelihood rests on the error of the ratio and on the spread of calibrations, never on a limit for the ratio itself.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import permutations

from hystid.consistency.force import GIVEN
from hystid.consistency.kinematics import ORDER, Pair
from hystid.errors import UsageError
from hystid.units import to_si

CALIBRATION = 0.05  # standard deviation of ln(gain) of sensors that nobody calibrated: makers state 5 to 10 %
_FILTERED = 1.0  # standard deviation of the exponent of a response, as filters at the edge of a band leave it
_WRONG_SIGN = 40.0  # chi square of a sign that is plainly the other one: certain, but for columns that nobody knows
PRIOR_SLIP = math.log(0.01)  # one channel in a hundred is mislabelled
_PRIOR_RARE = math.log(0.1)  # of those, a unit that is seldom used
_PRIOR_GAIN = math.log(1e-3)  # a gain of any size
_SCALES = ("unit", "time")  # slips whose size is that of a unit
_DECADES = math.log(1e12)  # range over which such a gain is as likely everywhere
SURE = math.log(20.0)  # odds beyond which a slip is refused: a wrong label costs a result, a false alarm one --accept

# Units that columns are written in; the first few are usual. What a value is multiplied by comes from ``units``.
LINEAR = {
    "F": ("N", "kN", "lbf", "kgf", "mN", "daN", "MN", "kip", "ozf"),
    "x": ("m", "mm", "in", "um", "cm", "ft", "mil", "nm", "km"),
    "v": ("m/s", "mm/s", "in/s", "ft/s", "cm/s", "km/h", "um/s"),
    "a": ("m/s2", "g", "mm/s2", "ft/s2", "in/s2", "cm/s2", "mg", "um/s2"),
    "R": ("N", "kN", "lbf"),
    "m": ("kg", "g", "lb", "t"),
}
ANGULAR = {
    "F": ("N.m", "N.mm", "N.cm", "kN.m", "lbf*ft", "lbf*in", "mN.m", "kgf*cm"),
    "x": ("rad", "deg", "mrad", "rev", "arcmin", "arcsec"),
    "v": ("rad/s", "deg/s", "rpm", "rev/s", "mrad/s"),
    "a": ("rad/s2", "deg/s2", "rev/s2", "mrad/s2"),
    "R": ("N.m", "N.mm"),
    "m": ("kg.m2", "g.cm2", "kg.cm2", "g.mm2", "kg.mm2"),
}
USUAL = 3  # of each list
TIME = {"ms": 1e-3, "us": 1e-6, "min": 60.0, "s": 1.0}
# Sizes that tests have: median and standard deviation in decades. They only choose between equal explanations.
_SIZES = {"x": (3e-3, 1.3), "v": (0.3, 1.3), "a": (20.0, 1.5), "F": (300.0, 1.5), "m": (3.0, 1.2), "rate": (1e3, 1.2)}
_ANGULAR_SIZES = {
    "x": (0.2, 0.8), "v": (2.0, 1.0), "a": (30.0, 1.3), "F": (3.0, 1.5), "m": (0.05, 1.5), "rate": (300.0, 1.0),
}  # fmt: skip


@dataclass(frozen=True)
class Slip:
    """One statement about a recording.

    kind: "unit", "time", "gain", "reversed", "exchanged". channels: those concerned. units: (written, true).
    factor: by which the numbers of the channel are too large. prior: ln of how often it happens. scales: of exchanged
    columns, by how much each is too large where the units of their labels went with the names.
    """

    kind: str
    channels: tuple[str, ...]
    prior: float
    factor: float = 1.0
    units: tuple[str, str] = ("", "")
    scales: tuple[tuple[str, float], ...] = ()


@dataclass(frozen=True)
class Situation:
    """What the candidates are judged by.

    pairs: of the motion. written: unit in the header per channel ("" for none). rms: size of each channel in SI.
    mass_ratio: apparent mass over the given one, with the standard error of its logarithm (of chance and of laws);
    None where unknown. bare: channels, and t, of which the header states no unit.
    """

    pairs: Sequence[Pair]
    written: Mapping[str, str]
    rms: Mapping[str, float]
    rate: float
    rotational: bool = False
    mass: float | None = None
    mass_ratio: tuple[float, float] | None = None
    mass_from: str = "a"
    fixed: frozenset[str] = field(default_factory=frozenset)
    bare: frozenset[str] = frozenset()


@dataclass(frozen=True)
class Explanation:
    """Slips together, ln of their posterior (not normalised), and what they leave unexplained (chi square).

    alike: other units of a single slip that these data do not tell from its own; instead: slips of unit of other
    channels that explain it as well, as a force in kN does a mass in g. odd: what unusual sizes count in the score.
    readings: of columns without units, choices of units for several at once that fit alike, the best one first.
    """

    slips: tuple[Slip, ...]
    score: float
    misfit: float
    alike: tuple[str, ...] = ()
    instead: tuple[Slip, ...] = ()
    odd: float = 0.0
    readings: tuple[tuple[Slip, ...], ...] = ()

    @property
    def sound(self) -> bool:
        """Whether nothing is wrong."""
        return not self.slips


def explain(situation: Situation) -> list[Explanation]:
    """Explanations, the most probable one first; the sound one is always among them."""
    single = list(_candidates(situation))
    nothing = judged(situation, ())
    found = [nothing, *(judged(situation, (slip,)) for slip in single)]
    best = max(found, key=lambda e: e.score)
    if best.misfit > misfit_limit(situation):  # two slips, where no single one is enough
        named = [s for s in single if s.kind != "gain"]
        found += [judged(situation, (a, b)) for i, a in enumerate(named) for b in named[i + 1 :] if _differ(a, b)]
        sized = [s for s in named if s.units[1] != "rate"]  # any rate and any gain explain everything
        found += [
            judged(situation, (a, b)) for a in sized for b in single if b.kind == "gain" and _differ(a, b)
        ]  # fmt: skip
    return sorted(found, key=lambda e: -e.score)


def with_alike(ordered: Sequence[Explanation]) -> Explanation:
    """The first explanation, with units of another size or of another channel that explain it at odds below 20.

    Unusual sizes alone rule out no other channel: a small rig under a hundredth of a newton has its mass in g as likely
    as a large one its force in kN, up to odds of 20 times 20. The time axis counts as a channel here: where v and F are
    all there is, a clock in ms makes of F over dv/dt what a mass in t does.
    """
    best = ordered[0]
    if len(best.slips) != 1 or best.slips[0].kind not in _SCALES:
        return best
    listed: dict[tuple[str, ...], list[Slip]] = {best.slips[0].channels: [best.slips[0]]}
    for other in ordered[1:]:
        lead = best.score - other.score
        elsewhere = len(other.slips) == 1 and other.slips[0].channels != best.slips[0].channels
        near = lead < SURE or (elsewhere and lead < 2 * SURE and lead + other.odd - best.odd < SURE)
        one = other.slips[0] if len(other.slips) == 1 and near else None
        if one is not None and one.kind in _SCALES and not _size_is_among(listed.setdefault(one.channels, []), one):
            listed[one.channels].append(one)
    own, *others = listed.values()
    alike = tuple(one.units[1] for one in own[1:] if one.units[1] != "rate")
    return replace(best, alike=alike, instead=tuple(slips[0] for slips in others if slips))


def _size_is_among(listed: Sequence[Slip], one: Slip) -> bool:
    """Whether a unit has the size of one that is listed, as mN.m has that of N.mm."""
    return any(abs(math.log(one.factor / other.factor)) < 1e-6 for other in listed)


def doubtful_units(situation: Situation, name: str) -> list[str]:
    """Units that a channel, or t, could be in unnoticed: the ratios neither speak for that of the header against them,
    at odds of 20, nor have them named."""
    table = ANGULAR if situation.rotational else LINEAR
    left = []
    for slip in _times(situation) if name == "t" else _units(name, table[name], situation):
        if not math.isfinite(slip.factor):
            continue
        shift = math.log(slip.factor)
        against = sum(
            _odds(math.log(pair.gain), _power(pair, slip) * shift, math.hypot(CALIBRATION, pair.error))
            for pair in situation.pairs
            if math.isfinite(pair.gain)
        )
        if situation.mass_ratio is not None:
            ratio, error = situation.mass_ratio
            against += _odds(math.log(abs(ratio)), _mass_power(situation, slip) * shift, math.hypot(GIVEN, error))
        if against < SURE and slip.prior - against < SURE:
            left.append(slip.units[1])
    return left


def _odds(seen: float, shift: float, error: float) -> float:
    """Logarithm of the odds for a ratio of 1 against one that a slip shifts, both as logarithms."""
    return 0.5 * ((seen - shift) ** 2 - seen**2) / error**2


def clock_is_likelier(name: str, rms: float, rate: float) -> bool:
    """Whether a motion too large for its frequency has a clock in ms, rather than a channel in thousandths.

    rms [SI] of the channel and sample rate [Hz], as written; judged by the sizes that tests have.
    """

    def odd(channel: str, value: float) -> float:
        middle, spread = _SIZES[channel]
        return float((math.log10(max(value, 1e-300) / middle) / spread) ** 2)

    return odd(name, rms) + odd("rate", 1e3 * rate) < odd(name, 1e-3 * rms) + odd("rate", rate)


def misfit_limit(situation: Situation) -> float:
    """Chi square beyond which an explanation does not fit the ratios."""
    return 12.0 + 4.0 * len(situation.pairs)  # five standard deviations of one of them


def _differ(one: Slip, other: Slip) -> bool:
    if one.kind in ("unit", "gain", "time") and other.kind in ("unit", "gain", "time"):
        return not set(one.channels) & set(other.channels)
    return one.kind != other.kind


def _candidates(situation: Situation) -> Iterator[Slip]:
    table = ANGULAR if situation.rotational else LINEAR
    involved = {name for pair in situation.pairs for name in (pair.low, pair.high)}
    force = {"F", "m"} if situation.mass_ratio is not None else set()
    if situation.mass_ratio is not None:
        involved = involved | {situation.mass_from}
    for name in sorted((involved | force) - situation.fixed):
        yield from _units(name, table[name], situation)
        yield Slip("gain", (name,), _PRIOR_GAIN + (_PRIOR_RARE if name == "m" else 0.0))
    for name in sorted(involved):
        yield Slip("reversed", (name,), PRIOR_SLIP)
    yield from _times(situation)
    present = sorted(involved, key=lambda name: ORDER[name])
    for order in permutations(present):
        moved = tuple(name for name, other in zip(present, order, strict=True) if name != other)
        if moved:
            pairs = [(a, b) for a, b in zip(present, order, strict=True) if a != b]
            mapped, prior = tuple(f"{a}={b}" for a, b in pairs), PRIOR_SLIP + (_PRIOR_RARE if len(moved) > 2 else 0.0)
            yield Slip("exchanged", mapped, prior)
            if scales := label_scales(situation.written, dict(pairs), rotational=situation.rotational):
                yield Slip("exchanged", mapped, prior, scales=scales)


def label_scales(
    written: Mapping[str, str], moves: Mapping[str, str], *, rotational: bool
) -> tuple[tuple[str, float], ...]:
    """By how much the numbers of exchanged columns are too large that belong under the label of another: g over mm, in
    SI; empty where all labels have units of one size.

    written: unit of each label. moves: channel -> the one that it holds.
    """
    found = tuple(
        (one, _size(written, one, rotational) / _size(written, other, rotational)) for one, other in moves.items()
    )
    return found if any(ratio != 1.0 for _, ratio in found) else ()


def _size(written: Mapping[str, str], name: str, rotational: bool) -> float:
    """Unit of a label in SI."""
    quantity = (ANGULAR if rotational else LINEAR)[name][0]
    try:
        return to_si(written.get(name) or quantity, quantity)[0]
    except UsageError:  # a voltage with a sensitivity is in SI by then
        return 1.0


def _units(name: str, units: Sequence[str], situation: Situation) -> Iterator[Slip]:
    quantity = units[0]
    written = situation.written.get(name) or quantity
    try:
        factor = to_si(written, quantity)[0]
    except UsageError:  # a voltage with a sensitivity: its SI unit is as good as any
        written, factor = quantity, 1.0
    for rank, unit in enumerate(units):
        ratio = factor / to_si(unit, quantity)[0]
        if abs(math.log(ratio)) > 1e-6:
            rare = _PRIOR_RARE if rank > USUAL else 0.0
            yield Slip("unit", (name,), PRIOR_SLIP + rare - 0.1 * rank, ratio, (written, unit))


def _times(situation: Situation) -> Iterator[Slip]:
    written = situation.written.get("t") or "s"
    try:
        factor = to_si(written, "s")[0]
    except UsageError:  # samples, or a unit of the user: seconds are as good as any
        factor = 1.0
    for unit, size in TIME.items():
        ratio = factor / size
        if abs(math.log(ratio)) > 1e-6:
            rare = 0.0 if unit in ("ms", "s") else 2 * _PRIOR_RARE
            yield Slip("time", ("t",), PRIOR_SLIP + rare, ratio, (written, unit))
    step = situation.rate
    if abs(step * factor - 1.0) < 1e-6:  # steps of exactly one: they may be sample numbers of any rate
        yield Slip("time", ("t",), PRIOR_SLIP, math.nan, (written, "samples"))
    elif len(situation.pairs) > 1:  # one ratio alone is as well that of a gain
        yield Slip("time", ("t",), _PRIOR_GAIN, math.nan, (written, "rate"))


def judged(situation: Situation, slips: tuple[Slip, ...]) -> Explanation:
    """Likelihood of what was measured under the slips; free factors take the value that fits best."""
    free = [s for s in slips if s.kind == "gain" or (s.kind == "time" and math.isnan(s.factor))]
    settled = tuple(_settled(situation, slips, s) if s in free else s for s in slips)
    misfit = sum(_pair_misfit(pair, settled) for pair in situation.pairs)
    misfit += _mass_misfit(situation, settled)
    odd = -0.5 * _implausible(situation, settled)
    score = -0.5 * misfit + sum(s.prior for s in slips) + odd
    for one in free:  # volume of the factors that fit over that of those that are possible
        rates = (_ANGULAR_SIZES if situation.rotational else _SIZES)["rate"][1] * math.log(10.0)
        possible = rates * math.sqrt(2 * math.pi) if one.kind == "time" else _DECADES
        score += math.log(CALIBRATION * math.sqrt(2 * math.pi) / possible)
    return Explanation(settled, score, misfit, odd=odd)


def _settled(situation: Situation, slips: tuple[Slip, ...], one: Slip) -> Slip:
    """The factor of a free slip that fits the ratios best (weighted mean of what each asks for)."""
    others = tuple(s for s in slips if s is not one)
    top, bottom = 0.0, 0.0
    for pair in situation.pairs:
        power = _power(pair, one)
        if power and math.isfinite(pair.gain):
            predicted, _, _ = _predicted(pair, others)
            weight = 1.0 / (pair.error**2 + CALIBRATION**2)
            top += weight * power * (math.log(pair.gain) - predicted)
            bottom += weight * power**2
    if situation.mass_ratio is not None and (power := _mass_power(situation, one)):
        weight = 1.0 / (situation.mass_ratio[1] ** 2 + GIVEN**2)
        wanted = math.log(abs(situation.mass_ratio[0])) - _mass_shift(situation, others)
        top, bottom = top + weight * power * wanted, bottom + weight * power**2
    factor = math.exp(min(max(top / bottom, -60.0), 60.0)) if bottom else 1.0
    return Slip(one.kind, one.channels, one.prior, factor, one.units)


def _power(pair: Pair, slip: Slip) -> float:
    if slip.kind == "time":
        return float(pair.order)
    if slip.kind in ("unit", "gain"):
        return float(slip.channels[0] == pair.high) - float(slip.channels[0] == pair.low)
    return 0.0


def _predicted(pair: Pair, slips: Sequence[Slip]) -> tuple[float, float, float]:
    """(ln gain, exponent, sign) of a pair under slips; for an odd exponent the sign is that of the turn."""
    orders = {name: ORDER[name] for name in ORDER}
    log_gain, sign = 0.0, 1.0
    for slip in slips:
        if slip.kind == "exchanged":
            orders |= {a: ORDER[b] for a, b in (item.split("=") for item in slip.channels)}
            scales = dict(slip.scales)
            log_gain += math.log(scales.get(pair.high, 1.0) / scales.get(pair.low, 1.0))
        elif slip.kind == "reversed":
            sign *= -1.0 if slip.channels[0] in (pair.low, pair.high) else 1.0
        elif math.isfinite(slip.factor):
            log_gain += _power(pair, slip) * math.log(slip.factor)
    exponent = orders[pair.high] - orders[pair.low] - pair.order
    sign *= (-1.0) ** (exponent // 2)
    main = float(pair.bands.omega[int((pair.bands.high * pair.bands.seen).argmax())]) if len(pair.bands.omega) else 1.0
    return log_gain + exponent * math.log(max(main, 1e-12)), float(exponent), sign


def _pair_misfit(pair: Pair, slips: Sequence[Slip]) -> float:
    if not math.isfinite(pair.gain):
        return 0.0
    log_gain, exponent, sign = _predicted(pair, slips)
    broad = CALIBRATION**2 + pair.error**2 + (0.1 * exponent) ** 2
    misfit = (math.log(pair.gain) - log_gain) ** 2 / broad
    misfit += (pair.slope - exponent) ** 2 / (_FILTERED**2 + pair.slope_error**2)
    if exponent % 2:  # a quarter of a period, ahead or behind
        return misfit + _WRONG_SIGN * pair.coherence * 0.5 * (1.0 - sign * pair.turn)
    return misfit + (0.0 if sign == pair.sign else _WRONG_SIGN * pair.coherence)


def _mass_power(situation: Situation, slip: Slip) -> float:
    """Exponent with which a slip of size enters the apparent over the given mass: F / a / m."""
    if slip.kind == "time":
        return float(2 - ORDER[situation.mass_from])
    if slip.kind in ("unit", "gain"):
        return {"F": 1.0, "m": -1.0}.get(slip.channels[0], -float(slip.channels[0] == situation.mass_from))
    return 0.0


def _mass_shift(situation: Situation, slips: Sequence[Slip]) -> float:
    finite = (s for s in slips if s.kind in ("unit", "gain", "time") and math.isfinite(s.factor))
    return sum(_mass_power(situation, s) * math.log(s.factor) for s in finite)


def _mass_misfit(situation: Situation, slips: Sequence[Slip]) -> float:
    if situation.mass_ratio is None or any(s.kind == "exchanged" for s in slips):
        return 0.0
    ratio, error = situation.mass_ratio
    return (math.log(abs(ratio)) - _mass_shift(situation, slips)) ** 2 / (GIVEN**2 + error**2)


def _implausible(situation: Situation, slips: Sequence[Slip]) -> float:
    """Chi square of the corrected sizes against those of usual tests."""
    sizes = _ANGULAR_SIZES if situation.rotational else _SIZES
    found = {**situation.rms, "rate": situation.rate}
    if situation.mass:
        found["m"] = situation.mass
    for slip in slips:
        if not math.isfinite(slip.factor):
            continue
        if slip.kind in ("unit", "gain") and slip.channels[0] in found:
            found[slip.channels[0]] /= slip.factor
        if slip.kind == "time":
            found["rate"] *= slip.factor
    total = 0.0
    for name, value in found.items():
        if name in sizes and value > 0:
            middle, spread = sizes[name]
            total += (math.log10(value / middle) / spread) ** 2
    return total
