"""Picture of a regression: reference with its tube, new values, one panel per signal, as SVG without dependencies."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape

import numpy as np

from hystid.fmu.compared import SignalResult
from hystid.numeric import Array

_WIDTH, _HEIGHT, _STRIP, _LEFT, _TOP, _GAP = 720, 150, 44, 130, 104, 84
_MOST_PANELS = 6
_GREATEST = 1e300  # drawn; the range of greater values is no number
_STYLE = (
    "text{font:13px sans-serif;fill:#222}.head{font-size:17px;font-weight:bold}"
    "@media(max-width:600px){text{font-size:22px}.head{font-size:26px}}"  # the drawing shrinks there, its words do not
)


def difference_picture(title: str, t: Array, signals: Sequence[SignalResult]) -> str:
    """SVG text; the signals that left their tube come first, furthest ahead. t: times (n,) [s].

    Each has two panels: the signal with its tube, and how far outside it is.
    """
    chosen = sorted(signals, key=lambda s: (s.tube.holds, -s.tube.worst))[:_MOST_PANELS]
    width, height = _LEFT + _WIDTH + 20, _TOP + len(chosen) * (_HEIGHT + _STRIP + _GAP)
    body = [_panels(t, signal, _TOP + i * (_HEIGHT + _STRIP + _GAP)) for i, signal in enumerate(chosen)]
    outside = sum(not s.tube.holds for s in signals)
    words = f"{outside} of {len(signals)} signals differ. Grey: reference and its tube; blue: now; red: outside"
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" width="100%" '
        f'preserveAspectRatio="xMidYMin" style="max-width:{width}px;display:block;margin:auto">'
        f"<title>{escape(title)}</title><style>{_STYLE}</style>"
        f'<rect width="100%" height="100%" fill="white"/><text class="head" x="14" y="24">{escape(title)}</text>'
        f'<text x="14" y="50">{words}</text>{"".join(body)}</svg>\n'
    )


def _panels(t: Array, signal: SignalResult, top: int) -> str:
    """The signal and, below it, how far it is outside its tube."""
    tube, below = signal.tube, top + _HEIGHT
    reference, values = (np.asarray(row, np.float64) for row in (signal.reference, signal.values))
    x = _LEFT + _WIDTH * (t - t[0]) / max(t[-1] - t[0], 1e-300)
    beyond = np.nan_to_num(np.maximum(0.0, np.maximum(values - tube.upper, tube.lower - values)))
    nothing, unit = np.zeros(len(x)), f" [{signal.unit}]" if signal.unit else ""
    first = signal.first_outside
    mark = "" if first is None else _line(x[first], top, x[first], below + _STRIP, "#c00", dashes="4 3")
    return (
        f'<text x="{_LEFT}" y="{top - 8}">{escape(f"{signal.name}{unit}: {signal.text(t)}")}</text>'
        + _panel(x, (top, _HEIGHT), (tube.lower, tube.upper), (reference, values), tube.outside)
        + _panel(x, (below, _STRIP), (nothing, beyond), (beyond,), tube.outside)
        + f'{mark}<text x="14" y="{below + _STRIP // 2 + 5}">outside by</text>'
        f'<text x="{_LEFT}" y="{below + _STRIP + 24}">{t[0]:.3g} s</text>'
        f'<text x="{_LEFT + _WIDTH}" y="{below + _STRIP + 24}" text-anchor="end">{t[-1]:.3g} s</text>'
    )


def _panel(x: Array, place: tuple[int, int], tube: tuple[Array, Array], rows: tuple[Array, ...], outside: Array) -> str:
    """A frame with a band and lines, the last of them marked where it is outside. place: top and height."""
    top, height = place
    low, high = _limits((*tube, *rows))

    def points(values: Array) -> list[str]:
        y = top + height * (high - np.clip(np.nan_to_num(values, nan=low), low, high)) / (high - low)
        return [f"{a:.1f},{b:.1f}" for a, b in zip(x, y, strict=True)]

    band = " ".join(points(tube[1]) + points(tube[0])[::-1])
    marks = "".join(
        f'<circle cx="{point.split(",")[0]}" cy="{point.split(",")[1]}" r="2.5" fill="#c00"/>'
        for point, wrong in zip(points(rows[-1]), outside, strict=True)
        if wrong
    )
    lines = "".join(
        f'<polyline points="{" ".join(points(values))}" fill="none" stroke="{colour}" stroke-width="1.4"/>'
        for values, colour in zip(rows, ("#555", "#06c")[-len(rows) :], strict=True)
    )
    level = float(points(np.zeros(len(x)))[0].split(",")[1])
    zero = _line(_LEFT, level, _LEFT + _WIDTH, level, "#bbb") if low < 0 < high else ""
    named = "" if len(rows) == 1 else "".join(
        f'<text x="{_LEFT - 8}" y="{y}" text-anchor="end">{value:.3g}</text>'
        for y, value in ((top + 14, high), (top + height - 2, low))
    )  # fmt: skip
    return (
        f'<rect x="{_LEFT}" y="{top}" width="{_WIDTH}" height="{height}" fill="none" stroke="#999"/>'
        f'<polygon points="{band}" fill="#ddd"/>{zero}{lines}{marks}{named}'
    )


def _line(x1: float, y1: float, x2: float, y2: float, colour: str, dashes: str = "none") -> str:
    return (
        f'<line x1="{x1:.1f}" y1="{y1:.1f}" x2="{x2:.1f}" y2="{y2:.1f}" stroke="{colour}" stroke-dasharray="{dashes}"/>'
    )


def _limits(rows: Sequence[Array]) -> tuple[float, float]:
    finite = np.concatenate([row[np.isfinite(row)] for row in rows], dtype=np.float64)
    finite = np.clip(finite, -_GREATEST, _GREATEST)
    low, high = (float(finite.min()), float(finite.max())) if len(finite) else (0.0, 1.0)
    margin = 0.05 * (high - low) or max(1.0, 0.05 * abs(high))
    return low - margin, high + margin
