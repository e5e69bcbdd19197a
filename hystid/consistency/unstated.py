"""Columns of which the header states no unit: several may be in other units at once, of the few that are usual.

Whoever leaves the units out leaves them out for all columns. So the slip is one, and which units they are is a choice
among the usual ones: the ratios of the motion and the mass decide, and usual sizes between what fits alike.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import product

from hystid.consistency.slips import (
    ANGULAR,
    LINEAR,
    PRIOR_SLIP,
    SURE,
    USUAL,
    Explanation,
    Situation,
    Slip,
    judged,
    misfit_limit,
)  # fmt: skip
from hystid.units import to_si

_CLOCKS = {"s": 1.0, "ms": 1e-3}
_TOLD = 3  # readings that a sentence lists


def several_units(situation: Situation, ordered: Sequence[Explanation]) -> Explanation | None:
    """The best reading of columns without units, with all others at odds below 20, where several columns are in other
    units at once; None where another explanation is better, or SI fits.

    ordered: explanations by the slips of one or two columns. Sizes alone accuse nothing: the ratios have to deny SI.
    """
    nothing = next(item for item in ordered if item.sound)
    if len(situation.bare) < 2 or nothing.misfit <= misfit_limit(situation):
        return None
    found = sorted([*ordered, *_together(situation)], key=lambda e: -e.score)
    best = found[0]
    near = [item for item in found if best.score - item.score < SURE]
    if len(best.slips) < 2 and not all(_is_reading(item, situation) for item in near):
        return None  # a mass, or a sign, may be what is wrong
    near = [item for item in near if _is_reading(item, situation)]
    if not _is_reading(best, situation) or all(len(item.slips) < 2 for item in near):
        return None
    readings = list({_units(item): item.slips for item in reversed(near)}.values())[::-1]
    return replace(best, readings=tuple(readings[:_TOLD]))


def _is_reading(item: Explanation, situation: Situation) -> bool:
    return bool(item.slips) and all(s.kind in ("unit", "time") and s.channels[0] in situation.bare for s in item.slips)


def _units(item: Explanation) -> frozenset[tuple[str, str]]:
    return frozenset((slip.channels[0], slip.units[1]) for slip in item.slips)


def _together(situation: Situation) -> Iterator[Explanation]:
    """Every choice of usual units for the columns without units, of which two or more are not SI."""
    seen = {name for pair in situation.pairs for name in (pair.low, pair.high)}
    seen |= {"F", situation.mass_from} if situation.mass_ratio is not None else set()
    table = ANGULAR if situation.rotational else LINEAR
    choices = {name: {u: to_si(u, table[name][0])[0] for u in table[name][:USUAL]} for name in seen & situation.bare}
    choices |= {"t": _CLOCKS} if "t" in situation.bare else {}
    equally = -sum(math.log(len(units)) for units in choices.values())
    for units in product(*(units.items() for units in choices.values())):
        chosen = [(name, unit, size) for name, (unit, size) in zip(choices, units, strict=True) if size != 1.0]
        if len(chosen) > 1:
            prior = (PRIOR_SLIP + equally) / len(chosen)
            slips = (
                Slip("time" if name == "t" else "unit", (name,), prior, 1.0 / size, (_si(name, table), unit))
                for name, unit, size in chosen
            )
            yield judged(situation, tuple(slips))


def _si(name: str, table: dict[str, tuple[str, ...]]) -> str:
    return "s" if name == "t" else table[name][0]
