"""Unit strings: SI factors, offsets, exponents."""

from __future__ import annotations

import subprocess
import sys

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hystid.errors import UsageError
from hystid.units import BASES, STANDARD_GRAVITY, exponents, parse, to_si

# unit -> (factor, offset, exponents other than 0), from the SI brochure's definitions
KNOWN = {
    "N.s/m": (1, 0, {"kg": 1, "s": -1}),
    "m/s2": (1, 0, {"m": 1, "s": -2}),
    "rad/s": (1, 0, {"rad": 1, "s": -1}),
    "1": (1, 0, {}),
    "": (1, 0, {}),
    "kg.m2": (1, 0, {"kg": 1, "m": 2}),
    "J/(kg.K)": (1, 0, {"m": 2, "s": -2, "K": -1}),
    "N.m/(rad.s)": (1, 0, {"kg": 1, "m": 2, "s": -3, "rad": -1}),
    "degC": (1, 273.15, {"K": 1}),
    "kN": (1e3, 0, {"kg": 1, "m": 1, "s": -2}),
    "µm": (1e-6, 0, {"m": 1}),
    "mm2": (1e-6, 0, {"m": 2}),
    "V": (1, 0, {"kg": 1, "m": 2, "s": -3, "A": -1}),
    "lbf": (4.4482216152605, 0, {"kg": 1, "m": 1, "s": -2}),
    "in": (0.0254, 0, {"m": 1}),
    "N•m": (1, 0, {"kg": 1, "m": 2, "s": -2}),
    "psi": (6894.757293168361, 0, {"kg": 1, "m": -1, "s": -2}),
    "m*s**-2": (1, 0, {"m": 1, "s": -2}),
}


@pytest.mark.parametrize("unit", KNOWN)
def test_factor_offset_and_exponents(unit: str) -> None:
    factor, offset, powers = KNOWN[unit]
    found = exponents(unit)
    assert found[0] == pytest.approx(factor, rel=1e-14)  # products of decimal factors round in the last bit
    assert found[1] == offset
    assert found[2] == {base: powers.get(base, 0) for base in BASES}


@pytest.mark.parametrize(
    ("unit", "quantity", "factor"),
    [
        ("g", "m/s2", STANDARD_GRAVITY),
        ("g", "kg", 1e-3),
        ("mg", "m/s2", 1e-3 * STANDARD_GRAVITY),
        ("lb", "N", 4.4482216152605),
        ("kip", "N", 4448.2216152605),
        ("mm/s", "m/s", 1e-3),
        ("m/s²", "m/s2", 1.0),
        ("ms", "s", 1e-3),
        ("min", "s", 60.0),
    ],
)
def test_a_unit_is_read_in_the_context_of_its_channel(unit: str, quantity: str, factor: float) -> None:
    assert to_si(unit, quantity) == (pytest.approx(factor, rel=1e-14), 0.0)


@pytest.mark.parametrize(("unit", "quantity"), [("mm", "N"), ("kg", "N"), ("s", "m"), ("nonsense", "m"), ("m//s", "m")])
def test_a_wrong_unit_is_refused_by_name(unit: str, quantity: str) -> None:
    with pytest.raises(UsageError, match=unit.replace("/", "/")):
        to_si(unit, quantity)


@given(
    st.sampled_from(["m", "N", "s", "kg", "rad", "V"]),
    st.integers(1, 3),
    st.sampled_from(["s", "m", "A"]),
    st.integers(1, 2),
)
def test_exponents_add_over_products_and_quotients(above: str, power: int, below: str, root: int) -> None:
    whole, up, down = parse(f"{above}{power}/{below}{root}"), parse(above), parse(below)
    for base in BASES:
        expected = power * up.exponents.get(base, 0) - root * down.exponents.get(base, 0)
        assert whole.exponents.get(base, 0) == expected


def test_si_units_need_no_pint() -> None:
    """Commands must start at once, and pint's registry takes longer than the rest of a start."""
    code = "import sys; from hystid.units import exponents; exponents('N.s/m'); assert 'pint' not in sys.modules"
    subprocess.run([sys.executable, "-c", code], check=True)


@pytest.mark.parametrize("unit", ["?m", "\ufffdm", "$m", "m;", "&N", "k?"])
def test_a_sign_that_no_unit_has_is_refused(unit: str) -> None:
    """A code page puts such a sign in the place of a prefix: µm became m."""
    with pytest.raises(UsageError, match="is not known"):
        parse(unit)
