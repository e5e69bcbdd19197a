"""Equations in loops that hold the derivative of a component's variable, ``der(c[k].x)``: written so that the front end
reads them.

rumoca 0.10 refuses such a derivative in a for-equation, but takes it inside an if-equation there. So
``der(c[k].x) = c[k].v;`` is read as ``if true then der(c[k].x) = c[k].v; else der(c[k].x) = c[k].v; end if;``.
"""

from __future__ import annotations

import re
from collections import deque
from collections.abc import Iterator

from hystid.modelica.sources import Source

_DERIVATIVE = re.compile(r"\bder\s*\(\s*[A-Za-z_][\w.]*\s*\[([^\[\]]*[A-Za-z_][^\[\]]*)\]\s*\.")
_HEAD = re.compile(r"\s*(?:(?P<until>for|if|elseif|when|elsewhen)\b|(?:initial\s+)?equation\b|else\b)")
_SECTION = re.compile(r"\b(?:equation|algorithm|public|protected|(?:model|block|class|function)\s+\w+)\b")
_END = {"for": "loop", "if": "then", "elseif": "then", "when": "then", "elsewhen": "then"}


def with_readable_derivatives(source: Source) -> Source:
    """The text with such equations rewritten; lines stay where they are."""
    text = source.text
    for start, end in reversed(list(dict.fromkeys(_equations(source.plain)))):
        equation = source.plain[start:end]
        once = " ".join(equation.split())
        text = f"{text[:start]}if true then {once}; else {equation}; end if{text[end:]}"
    return source if text == source.text else Source(source.path, text)


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
