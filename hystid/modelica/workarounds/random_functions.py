"""The functions of ``Modelica.Math.Random`` that start its generators are written as functions in C.

rumoca 0.10 refuses the size of what they call, ``output Integer[nState] state`` with an input nState, and the impure
function inside one of them. What they give is known here, see ``random_numbers.py``. Integers from a call it takes in
no initial equation, ``pre(state) = initialState(...)``, unless they are made Reals.
"""

from __future__ import annotations

import re
from collections.abc import Iterator

from hystid.modelica.sources import Source
from hystid.modelica.workarounds.edits import Edit, edited

_CALLS = {
    "initialState": "initialState(localSeed, globalSeed, state)",
    "initializeImpureRandom": "id = initializeImpureRandom(seed)",
}
_STARTS = re.compile(rf"\bfunction\s+({'|'.join(_CALLS)})\b")
_FIRST = re.compile(r"(?<![\w.])(pre\s*\(\s*\w+\s*\))\s*=\s*([\w.]+\.initialState\s*\()")
_BODY = re.compile(r"\b(?:protected|algorithm)\b")


def with_known_starts(source: Source) -> Source:
    """The text with the bodies of these functions left out; lines stay where they are."""
    plain = source.plain
    known = re.search(r"\bpackage\s+Random\b", plain) and re.match(r"\s*within\s+Modelica\.Math\s*;", plain)
    return edited(source, [*(_bodies(plain) if known else ()), *_as_reals(plain)])


def _as_reals(plain: str) -> Iterator[Edit]:
    for found in _FIRST.finditer(plain):
        yield from ((found.start(k), found.start(k), "1.0*") for k in (1, 2))


def _bodies(plain: str) -> Iterator[Edit]:
    for found in _STARTS.finditer(plain):
        end = plain.find(f"end {found.group(1)};", found.end())
        body = _BODY.search(plain, found.end(), end) if end > 0 else None
        if body is not None:
            yield (
                body.start(),
                end,
                f'external "C" {_CALLS[found.group(1)]};' + "\n" * plain.count("\n", body.start(), end),
            )
