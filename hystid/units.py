"""Units: unit strings to SI factors, offsets and SI exponents.

Two spellings are read. Modelica's and FMI's ("N.s/m", "m/s2", "kg.m2", "rad/s", "1") is parsed here from a table of SI
symbols, without any import. Whatever is not in that grammar ("in", "lbf", "psi", "m*s**-1") goes to pint, which is
imported only then because building its registry costs more than the rest of a start.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache, lru_cache
from typing import Any

from hystid.errors import UsageError, printable

BASES = ("kg", "m", "s", "A", "K", "mol", "cd", "rad")
STANDARD_GRAVITY = 9.80665  # m/s2, exact by definition (CGPM 1901)

# symbol -> (factor to SI, exponents); a prefix may stand before every one of them
_SYMBOLS: dict[str, tuple[float, dict[str, int]]] = {
    **{base: (1.0, {base: 1}) for base in BASES if base != "kg"},
    "g": (1e-3, {"kg": 1}),
    "Hz": (1.0, {"s": -1}),
    "N": (1.0, {"kg": 1, "m": 1, "s": -2}),
    "Pa": (1.0, {"kg": 1, "m": -1, "s": -2}),
    "J": (1.0, {"kg": 1, "m": 2, "s": -2}),
    "W": (1.0, {"kg": 1, "m": 2, "s": -3}),
    "V": (1.0, {"kg": 1, "m": 2, "s": -3, "A": -1}),
    "C": (1.0, {"A": 1, "s": 1}),
    "F": (1.0, {"kg": -1, "m": -2, "s": 4, "A": 2}),
    "Ohm": (1.0, {"kg": 1, "m": 2, "s": -3, "A": -2}),
    "Wb": (1.0, {"kg": 1, "m": 2, "s": -2, "A": -1}),
    "T": (1.0, {"kg": 1, "s": -2, "A": -1}),
    "H": (1.0, {"kg": 1, "m": 2, "s": -2, "A": -2}),
}
# taken whole: no prefix is allowed before these
_WHOLE: dict[str, tuple[float, dict[str, int]]] = {
    "1": (1.0, {}),
    "%": (1e-2, {}),
    "deg": (math.pi / 180, {"rad": 1}),
    "min": (60.0, {"s": 1}),
    "h": (3600.0, {"s": 1}),
    "rev": (2 * math.pi, {"rad": 1}),
    "bar": (1e5, {"kg": 1, "m": -1, "s": -2}),
    "kip": (4448.2216152605, {"kg": 1, "m": 1, "s": -2}),  # 1000 lbf; pint knows it as a force too, but slower
}
# Customary units that loggers write; no Modelica units. Exact by definition (yard and pound agreement of 1959).
_POUND, _INCH = 0.45359237, 0.0254
_FORCE = {"kg": 1, "m": 1, "s": -2}
_CUSTOMARY: dict[str, tuple[float, dict[str, int]]] = {
    "in": (_INCH, {"m": 1}),
    "inch": (_INCH, {"m": 1}),
    "ft": (12 * _INCH, {"m": 1}),
    "mil": (1e-3 * _INCH, {"m": 1}),
    "thou": (1e-3 * _INCH, {"m": 1}),
    "lb": (_POUND, {"kg": 1}),
    "t": (1e3, {"kg": 1}),
    "lbf": (_POUND * STANDARD_GRAVITY, _FORCE),
    "ozf": (_POUND / 16 * STANDARD_GRAVITY, _FORCE),
    "kgf": (STANDARD_GRAVITY, _FORCE),
    "kp": (STANDARD_GRAVITY, _FORCE),
    "gf": (1e-3 * STANDARD_GRAVITY, _FORCE),
    "daN": (10.0, _FORCE),
    "Nm": (1.0, {"kg": 1, "m": 2, "s": -2}),
    "mNm": (1e-3, {"kg": 1, "m": 2, "s": -2}),
    "kNm": (1e3, {"kg": 1, "m": 2, "s": -2}),
    "Nmm": (1e-3, {"kg": 1, "m": 2, "s": -2}),
    "Ncm": (1e-2, {"kg": 1, "m": 2, "s": -2}),
    "sec": (1.0, {"s": 1}),
    "msec": (1e-3, {"s": 1}),
    "°": (math.pi / 180, {"rad": 1}),
    "degree": (math.pi / 180, {"rad": 1}),
    "degrees": (math.pi / 180, {"rad": 1}),
    "turn": (2 * math.pi, {"rad": 1}),
    "arcmin": (math.pi / 180 / 60, {"rad": 1}),
    "arcsec": (math.pi / 180 / 3600, {"rad": 1}),
    "rpm": (2 * math.pi / 60, {"rad": 1, "s": -1}),
}
_SPOKEN = {
    "U/min": "rpm", "tr/min": "rpm", "r/min": "rpm", "rev/min": "rpm", "ft-lb": "ft.lbf", "ft.lb": "ft.lbf",
    "lb-ft": "ft.lbf", "lb.ft": "ft.lbf", "in-lb": "in.lbf", "in.lb": "in.lbf", "lb-in": "in.lbf", "lb.in": "in.lbf",
    "ft-lbf": "ft.lbf", "in-lbf": "in.lbf", "lbf-ft": "ft.lbf", "lbf-in": "in.lbf", "N-m": "N.m", "kN-m": "kN.m",
    "Gal": "cm/s2", "μm": "um",
}  # fmt: skip
_PREFIXES = {
    "G": 1e9,
    "M": 1e6,
    "k": 1e3,
    "d": 1e-1,
    "c": 1e-2,
    "m": 1e-3,
    "u": 1e-6,
    "µ": 1e-6,
    "μ": 1e-6,
    "n": 1e-9,
    "p": 1e-12,
}
_FACTOR = re.compile(r"^([A-Za-zµμ%°]+|1)\^?([+-]?\d+)?$")


# pint computes what stands in a unit: powers of powers, as 9**9**9, take hours
_LONGEST_UNIT = 60  # characters, twice as long as any unit of the standards
_RAISED = re.compile(r"[\d)]\s*(?:\*\*|\^)")
_DOTS = dict.fromkeys(map(ord, "⋅∙•‧"), "·")
_NO_UNIT = re.compile(r"[^\w\s.*/^()+\-−%‰°′\"·×µμ⁰¹²³⁴-⁹⁺⁻]")  # pint passes over such signs: ?m would be m
_DIGITS = re.compile(r"\d{7}|(?:\*\*|\^)\s*\(?\s*[+-]?\s*\d{3}|[eE]\s*[+-]?\s*\d{3}")


@dataclass(frozen=True)
class Unit:
    """What one unit is in SI: value_SI = factor * value + offset; exponents over ``BASES`` (zeros left out)."""

    text: str
    factor: float
    offset: float
    exponents: Mapping[str, int]


class _NotSi(Exception):
    pass


@lru_cache(maxsize=1024)
def parse(text: str) -> Unit:
    """Read a unit string. "" and "1" are dimensionless.

    Raises UsageError when neither the SI grammar nor pint knows it.
    """
    stripped = text.strip().translate(_DOTS)
    if len(stripped) > _LONGEST_UNIT or len(_RAISED.findall(stripped)) > 1 or _DIGITS.search(stripped):
        raise UsageError(f"unit '{printable(stripped, 40)}' is not known; write it like N, kN, mm, m/s2, N.s/m or lbf")
    if stripped in ("", "-"):
        return Unit(text, 1.0, 0.0, {})
    if stripped == "degC":
        return Unit(text, 1.0, 273.15, {"K": 1})
    plain = stripped.replace("·", ".").replace("**", "^").replace("*", ".")
    plain = _SPOKEN.get(plain, plain)
    for extra in ({}, _CUSTOMARY):
        try:
            factor, exponents = _product(plain, extra)
            if not 0 < factor < math.inf:
                raise _NotSi
            break
        except (_NotSi, ArithmeticError):
            continue
    else:
        return _by_pint(stripped)
    return Unit(text, factor, 0.0, {base: power for base, power in exponents.items() if power})


def exponents(unit: str) -> tuple[float, float, dict[str, int]]:
    """(factor, offset, {kg, m, s, A, K, mol, cd, rad}) of a Modelica unit string, as FMI's unit definitions want it.

    value_SI = factor * value + offset. All eight exponents are present.
    """
    known = parse(unit)
    return known.factor, known.offset, {base: known.exponents.get(base, 0) for base in BASES}


def si_name(unit: str) -> str:
    """The SI unit of what ``unit`` measures, in Modelica's spelling: "Pa" for bar, "N" for lbf, "1" for a plain number.

    Raises UsageError when the unit is unknown.
    """
    found = dict(parse(unit).exponents)
    if not found:
        return "1"
    for symbol in ("N", "Pa", "V", "A", "K", "J", "W", "m", "s", "kg", "rad", "Hz", "Ohm", "T", "Wb", "H", "C", "F"):
        if found == ({"kg": 1} if symbol == "kg" else dict(_SYMBOLS[symbol][1])):
            return symbol
    above, below = ([f"{b}{abs(p) if abs(p) > 1 else ''}" for b, p in found.items() if p * s > 0] for s in (1, -1))
    head = ".".join(above) or "1"
    return f"{head}/{below[0]}" if len(below) == 1 else f"{head}/({'.'.join(below)})" if below else head


def is_modelica(unit: str) -> bool:
    """Whether a unit string is in Modelica's grammar with the symbols known here, so that its meaning is certain."""
    try:
        _product(unit.strip())
    except (_NotSi, ArithmeticError):
        return unit.strip() in ("", "degC")
    return True


def to_si(unit: str, quantity: str) -> tuple[float, float]:
    """(factor, offset) from ``unit`` to the SI unit ``quantity`` ("m", "N", "m/s2", ...).

    "g" means standard gravity where an acceleration is expected, "lb" pound-force where a force is.
    Angles count as dimensionless. Raises UsageError when the unit is unknown or of another dimension.
    """
    target = parse(quantity)
    spoken = _in_context(unit, target)
    if not _same_dimension(spoken, target):
        raise UsageError(f"unit '{unit}' cannot be converted to {quantity}: it measures something else")
    return spoken.factor / target.factor, (spoken.offset - target.offset) / target.factor


def _in_context(unit: str, target: Unit) -> Unit:
    text = unit.strip()
    scale = {"g": 1.0, "gn": 1.0, "g0": 1.0, "G": 1.0, "mg": 1e-3, "ug": 1e-6}.get(text)
    if target.exponents == {"m": 1, "s": -2} and scale is not None:
        return Unit(unit, scale * STANDARD_GRAVITY, 0.0, target.exponents)
    if target.exponents == {"kg": 1, "m": 1, "s": -2} and text in ("lb", "lbs"):
        return parse("lbf")
    return parse(text)


def _same_dimension(one: Unit, other: Unit) -> bool:
    return all(one.exponents.get(base, 0) == other.exponents.get(base, 0) for base in BASES if base != "rad")


def _product(
    text: str, extra: Mapping[str, tuple[float, dict[str, int]]] | None = None
) -> tuple[float, dict[str, int]]:
    """Modelica's grammar: factors joined by ".", one "/" with an optional bracket after it; ``extra``: more symbols."""
    numerator, slash, denominator = text.partition("/")
    if slash and not denominator:
        raise _NotSi
    if denominator.startswith("(") and denominator.endswith(")"):
        denominator = denominator[1:-1]
    factor, powers = 1.0, dict.fromkeys(BASES, 0)
    for part, sign in ((numerator, 1), (denominator, -1)):
        for item in part.split(".") if part else ():
            scale, dims, power = _factor(item, extra or {})
            factor *= scale ** (sign * power)
            for base, exponent in dims.items():
                powers[base] += sign * power * exponent
    return factor, powers


def _factor(text: str, extra: Mapping[str, tuple[float, dict[str, int]]]) -> tuple[float, dict[str, int], int]:
    match = _FACTOR.match(text.strip().replace("²", "2").replace("³", "3"))
    if not match:
        raise _NotSi
    symbol, power = match[1], int(match[2] or 1)
    if symbol in extra:
        return *extra[symbol], power
    if symbol in _WHOLE:
        return *_WHOLE[symbol], power
    if symbol in _SYMBOLS:
        return *_SYMBOLS[symbol], power
    if symbol[0] in _PREFIXES and symbol[1:] in _SYMBOLS:
        factor, dims = _SYMBOLS[symbol[1:]]
        return _PREFIXES[symbol[0]] * factor, dims, power
    raise _NotSi


@cache
def _registry() -> Any:
    import pint

    return pint.UnitRegistry(cache_folder=None)


def _by_pint(text: str) -> Unit:
    try:
        if _NO_UNIT.search(text):
            raise _NotSi
        registry = _registry()
        at_zero, at_one = (registry.Quantity(value, text).to_base_units() for value in (0.0, 1.0))
        dims = at_one.dimensionality
    except Exception:  # pint raises its own, tokenize's and Python's syntax errors alike
        raise UsageError(f"unit '{text}' is not known; write it like N, kN, mm, m/s2, N.s/m or lbf") from None
    names = {
        "[mass]": "kg",
        "[length]": "m",
        "[time]": "s",
        "[current]": "A",
        "[temperature]": "K",
        "[substance]": "mol",
        "[luminosity]": "cd",
    }
    powers = {names[name]: int(power) for name, power in dims.items() if name in names and power == int(power)}
    if len(powers) != len(dims):
        raise UsageError(f"unit '{text}' has no SI exponents")
    offset = float(at_zero.magnitude)
    if not (math.isfinite(offset) and 0 < float(at_one.magnitude) - offset < math.inf):
        raise UsageError(f"unit '{text}' has no finite size in SI units")
    return Unit(text, float(at_one.magnitude) - offset, offset, powers)
