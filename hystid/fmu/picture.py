"""Picture of a regression: reference with its tube, new values, one panel per signal, as SVG without dependencies."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape

import numpy as np
from numpy.typing import NDArray

from hystid.fmu.compared import SignalResult

Array = NDArray[np.float64]

_WIDTH, _HEIGHT, _LEFT, _TOP, _GAP = 760, 180, 90, 30, 60
_MOST_PANELS = 6


def difference_picture(title: str, t: Array, signals: Sequence[SignalResult]) -> str:
    """SVG text; the signals that left their tube come first, furthest ahead. t: times (n,) [s]."""
    chosen = sorted(signals, key=lambda s: (s.tube.holds, -s.tube.worst))[:_MOST_PANELS]
    height = _TOP + len(chosen) * (_HEIGHT + _GAP)
    body = [_panel(t, signal, _TOP + i * (_HEIGHT + _GAP)) for i, signal in enumerate(chosen)]
    style = "text{font:13px sans-serif;fill:#222}"
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{_WIDTH + _LEFT + 20}" height="{height}">'
        f"<title>{escape(title)}</title><style>{style}</style>"
        f'<rect width="100%" height="100%" fill="white"/>{"".join(body)}</svg>\n'
    )


def _panel(t: Array, signal: SignalResult, top: int) -> str:
    low, high = _limits((signal.tube.lower, signal.tube.upper, signal.values))

    def points(values: Array) -> list[str]:
        x = _LEFT + _WIDTH * (t - t[0]) / max(t[-1] - t[0], 1e-300)
        y = top + _HEIGHT * (high - np.clip(np.nan_to_num(values, nan=low), low, high)) / (high - low)
        return [f"{a:.1f},{b:.1f}" for a, b in zip(x, y, strict=True)]

    band = " ".join(points(signal.tube.upper) + points(signal.tube.lower)[::-1])
    marks = "".join(
        f'<circle cx="{point.split(",")[0]}" cy="{point.split(",")[1]}" r="2.5" fill="#c00"/>'
        for point, outside in zip(points(signal.values), signal.tube.outside, strict=True)
        if outside
    )
    lines = "".join(
        f'<polyline points="{" ".join(points(values))}" fill="none" stroke="{colour}" stroke-width="1.2"/>'
        for values, colour in ((signal.reference, "#555"), (signal.values, "#06c"))
    )
    words = escape(f"{signal.name}: {signal.text(t)} (grey: reference, blue: now)")
    return (
        f'<text x="{_LEFT}" y="{top - 8}">{words}</text>'
        f'<rect x="{_LEFT}" y="{top}" width="{_WIDTH}" height="{_HEIGHT}" fill="none" stroke="#999"/>'
        f'<polygon points="{band}" fill="#ddd"/>{lines}{marks}'
        f'<text x="{_LEFT - 8}" y="{top + 12}" text-anchor="end">{high:.3g}</text>'
        f'<text x="{_LEFT - 8}" y="{top + _HEIGHT}" text-anchor="end">{low:.3g}</text>'
        f'<text x="{_LEFT}" y="{top + _HEIGHT + 18}">{t[0]:.3g} s</text>'
        f'<text x="{_LEFT + _WIDTH}" y="{top + _HEIGHT + 18}" text-anchor="end">{t[-1]:.3g} s</text>'
    )


def _limits(rows: Sequence[Array]) -> tuple[float, float]:
    finite = np.concatenate([row[np.isfinite(row)] for row in rows])
    low, high = (float(finite.min()), float(finite.max())) if len(finite) else (0.0, 1.0)
    margin = 0.05 * (high - low) or 1.0
    return low - margin, high + margin
