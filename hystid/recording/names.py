"""What column headers mean: words in several languages, units beside them. The words stand in ``names.toml``."""

from __future__ import annotations

import re
import tomllib
import unicodedata
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import Any

from hystid.errors import UsageError
from hystid.units import parse

_WORDS = Path(__file__).with_name("names.toml")
_LONGEST_HEADER = 300  # characters of a header: time that its expressions take grows with their square
_BRACKETS = re.compile(r"^(?P<name>.*?)(?:\[(?P<square>[^\]]*)\]|\((?P<round>[^)]*)\)|\{(?P<curly>[^}]*)\})?$")
_PARTED = re.compile(r"\s+(?:in|en|im|i)\s+|\s*/\s*|\s*,\s*|\s*:\s*|_")  # name from unit: "Kraft in N", "F / kN"

_WIDE = {wide: wide - 0xFEE0 for wide in range(0xFF01, 0xFF5F)}  # Japanese keyboards: "変位（ｍｍ）"

_NUMBERED = re.compile(r"^(.*[^\W\d_].*?)[\s_.\-#]*\d{1,3}$")


@cache
def _words() -> dict[str, Any]:
    return tomllib.loads(_WORDS.read_text(encoding="utf-8"))


@cache
def _channels() -> dict[str, tuple[str, bool]]:
    """Plain word -> (channel, whether it says that the rig turns)."""
    words = _words()
    found = {_plain(word): (channel, False) for channel, listed in words["linear"].items() for word in listed}
    return found | {_plain(word): (channel, True) for channel, listed in words["angular"].items() for word in listed}


def _plain(text: str) -> str:
    return re.sub(r"[\s_.\-]+", " ", unicodedata.normalize("NFKC", text)).strip().casefold()


def _found(name: str) -> tuple[str, bool] | None:
    """Channel and whether the rig turns, of a word, or of a word with a sensor's behind it, as "Kraftaufnehmer"."""
    plain, known = _plain(name), _channels()
    if plain in known:
        return known[plain]
    for sensor in _words()["sensors"]["words"]:
        word = plain.removesuffix(sensor).rstrip()
        if len(word) > 1 and word != plain:
            return known.get(word) or known.get(word.removesuffix("s"))  # German joins words with an s
    return None


def known_name(name: str) -> str | None:
    """The channel (t, F, x, v, a, R) that a column of this name holds, None when hystid has no meaning for it."""
    found = _found(name)
    return found[0] if found else None


def meant(name: str, unit: str | None) -> str | None:
    """The channel of a column: T in degC is a temperature, and no time."""
    channel = known_name(name)
    return None if channel == "t" and unit and _is_temperature(unit) else channel


def _is_temperature(unit: str) -> bool:
    try:
        return parse(unit_symbol(unit)).exponents == {"K": 1}
    except UsageError:
        return False


def decoded(text: bytes) -> str:
    """A text of a binary format: UTF-8, or else the code page of Windows in which older programs wrote."""
    try:
        return text.decode()
    except UnicodeDecodeError:
        return text.decode("cp1252", errors="replace")


def turns(name: str) -> bool:
    """Whether the name alone says that the rig turns, as "torque" does."""
    found = _found(name)
    return bool(found and found[1])


def numbered(names: Sequence[str]) -> dict[str, str]:
    """Name -> word, of known words with a number behind them, as "Load cell 1", where a channel has but one column."""
    short = [name for name in names if len(name) <= _LONGEST_HEADER and not known_name(name)]
    words = {name: match[1] for name in short if (match := _NUMBERED.match(name))}
    channels = [known_name(words.get(name, name)) for name in names]
    once = {channel for channel in channels if channel not in (None, "R") and channels.count(channel) == 1}
    return {name: word for name, word in words.items() if known_name(word) in once}


def unit_symbol(text: str) -> str:
    """The symbol of a unit that may be written in words: "Sekunden" -> "s", "Grad" -> "deg"; others as they are."""
    text = unicodedata.normalize("NFC", text.translate(_WIDE).strip().strip("[](){}"))
    for symbol, listed in _words()["units"].items():
        if text.casefold().rstrip(".") in {word.casefold() for word in listed} and text != "nm":
            return str(symbol)
    return text


def is_unit(text: str) -> bool:
    """Whether a cell is a unit and nothing else."""
    stripped = text.strip().strip("[](){}")
    if stripped in ("", "-"):
        return True
    if re.fullmatch(r"[-+]?[\d.,eE+-]+", stripped) and stripped != "1":
        return False
    if any(mark in stripped for mark in "[]{}"):  # a name with its unit; to ask pint for it costs half a second
        return False
    try:
        parse(unit_symbol(stripped))
    except UsageError:
        return False
    return True


def split_header(text: str) -> tuple[str, str | None]:
    """``"x [mm]"``, ``"Weg (mm)"``, ``"Kraft in N"`` or ``"F / kN"`` -> (name, unit); ``"x"`` -> ("x", None)."""
    stripped = text.translate(_WIDE).strip().strip('"').strip("'").strip()
    if len(stripped) > _LONGEST_HEADER:
        return stripped, None
    if match := _BRACKETS.match(stripped):
        unit = next((match[kind] for kind in ("square", "round", "curly") if match[kind] is not None), None)
        if unit is not None and match["name"]:
            return match["name"].rstrip().rstrip(" /,:"), unit.strip()
    if known_name(stripped) is None:
        for mark in _PARTED.finditer(stripped):  # the first that fits: units have strokes of their own
            name, unit = stripped[: mark.start()], stripped[mark.end() :].strip("()")
            if known_name(name) and unit and is_unit(unit):
                return name, unit
    return stripped, None


def scales(word: str) -> bool:
    """Whether a word at the start of a row above the samples says that the row holds factors of the columns."""
    return _is_label(word, "scaling")


def shifts(word: str) -> bool:
    """Whether a word beside a channel says that a constant is to be added to it."""
    return _is_label(word, "offset")


def labels_units(word: str) -> bool:
    """Whether a word at the start of a row above the samples says that the row holds the units of the columns."""
    return _is_label(word, "units row")


def _is_label(word: str, kind: str) -> bool:
    return _plain(word).rstrip(" :=") in {_plain(known) for known in _words()["labels"][kind]}


def announced(line: str) -> float | None:
    """Sample rate [Hz] that a line above the table states, as "Abtastrate: 1 kHz"; None where it states none."""
    text = unicodedata.normalize("NFKC", line).casefold().lstrip("#% ")
    for kind, listed in _words()["announced"].items():
        for word in listed:
            match = re.match(
                rf"{re.escape(word.casefold())}\s*(?:[\[(](\S+?)[\])])?[\s:;=,]*([\d.,]+(?:e[+-]?\d+)?)[\s;,]*(\S*)",
                text,
            )
            if match:
                unit = "" if match[3][:1].isdigit() else match[3]  # the same for the next channel
                return _rate(kind, match[2].rstrip(","), unit or match[1] or "")
    return None


def _rate(kind: str, number: str, unit: str) -> float | None:
    symbols = {"hz": 1.0, "khz": 1e3, "mhz": 1e6, "s": 1.0, "ms": 1e-3, "us": 1e-6, "µs": 1e-6, "": 1.0, "sec": 1.0}
    symbols |= {"1/s": 1.0, "sps": 1.0, "ks/s": 1e3, "s/s": 1.0, "samples/s": 1.0}
    try:
        value = float(number.replace(",", ".")) * symbols[unit.strip("[]()")]
    except (ValueError, KeyError):
        return None
    return None if value <= 0 else value if kind == "rate" else 1.0 / value
