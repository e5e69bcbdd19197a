"""``der(c[k].x)`` in a for-equation, put into an if-equation, where rumoca 0.10 takes it.

It breaks down on the derivative of a component's variable where the subscript is an index of a loop:
``if true then der(c[k].x) = ...; else ...; end if`` is the same equation, and it reads that.
"""

from __future__ import annotations

import re
from collections import deque
from collections.abc import Iterator

from hystid.modelica.sources import Source
from hystid.modelica.workarounds.edits import Edit, edited

_DERIVATIVE = re.compile(r"\bder\s*\(\s*[A-Za-z_][\w.]*\s*\[([^\[\]]*[A-Za-z_][^\[\]]*)\]\s*\.")
_SECTION = re.compile(r"\b(?:equation|algorithm|public|protected|(?:model|block|class|function)\s+\w+)\b")
_HEAD = re.compile(r"\s*(?:(?P<until>for|if|elseif|when|elsewhen)\b|(?:initial\s+)?equation\b|else\b)")
_END = {"for": "loop", "if": "then", "elseif": "then", "when": "then", "elsewhen": "then"}


def with_derivatives_in_branches(source: Source) -> Source:
    """The text with such equations rewritten; lines stay where they are."""
    return edited(source, _derivatives(source.plain))


def _derivatives(plain: str) -> Iterator[Edit]:
    """Each equation as it is becomes the second branch, a copy on one line the first."""
    for start, end in dict.fromkeys(_equations(plain)):
        yield start, start, f"if true then {' '.join(plain[start:end].split())}; else "
        yield end, end, "; end if"


def _equations(plain: str) -> Iterator[tuple[int, int]]:
    """Offsets of the equations, up to their semicolons."""
    for found in _DERIVATIVE.finditer(plain):
        section = deque(_SECTION.finditer(plain, 0, found.start()), maxlen=1)
        if not section or section[0].group() != "equation":
            continue
        start = plain.rfind(";", 0, found.start()) + 1
        end = plain.find(";", found.end())
        while head := _HEAD.match(plain, start, found.start()):
            start = head.end()
            if head["until"]:
                stop = re.compile(rf"\b{_END[head['until']]}\b").search(plain, start, found.start())
                if stop is None:
                    break
                start = stop.end()
        start += len(plain[start:end]) - len(plain[start:end].lstrip())
        if end > 0:
            yield start, end
