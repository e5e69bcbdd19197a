"""Small SVG pictures for the documentation: panels with lines, dots, boxes and a legend, no library behind them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from html import escape
from pathlib import Path

import numpy as np

INK, GRID = "#3c4650", "#e8ebee"
COLOURS = {"measured": "#9aa5b1", "refined": "#c2410c", "published": "#2563eb", "third": "#15803d", "fourth": "#7e22ce",
           "fifth": "#b45309", "linear": "#6b7280"}  # fmt: skip
FONT = 'font-family="system-ui, sans-serif"'
LEFT, RIGHT, TOP, BOTTOM = 58, 12, 26, 40


@dataclass
class Panel:
    """One set of axes. Positions and values in the units of the labels; logarithmic axes take values above 0."""

    title: str
    x: str = ""
    y: str = ""
    log_x: bool = False
    log_y: bool = False
    ticks: Sequence[str] | None = None
    limits: tuple[float, float] | None = None
    lines: list[tuple[np.ndarray, np.ndarray, str, str, str]] = field(default_factory=list)
    boxes: list[tuple[float, np.ndarray, str]] = field(default_factory=list)

    def line(self, x: Sequence[float], y: Sequence[float], colour: str, label: str = "", dash: str = "") -> Panel:
        """Points joined by a line; dash "dots" draws the points alone."""
        self.lines.append((np.asarray(x, float), np.asarray(y, float), colour, label, dash))
        return self

    def box(self, at: float, values: Sequence[float], colour: str = "published") -> Panel:
        """Quartile box with whiskers to the least and the greatest finite value."""
        finite = np.asarray(values, float)
        self.boxes.append((at, finite[np.isfinite(finite)], colour))
        return self

    def _range(self) -> tuple[tuple[float, float], tuple[float, float]]:
        xs = [line[0] for line in self.lines] + [np.array([at - 0.6, at + 0.6]) for at, _, _ in self.boxes]
        ys = [line[1] for line in self.lines] + [values for _, values, _ in self.boxes]
        flat_x, flat_y = np.concatenate(xs), np.concatenate(ys)
        flat_y = flat_y[np.isfinite(flat_y)]
        low, high = self.limits or (float(flat_y.min()), float(flat_y.max()))
        side = 0.0 if self.log_x or self.boxes else 0.03 * float(np.ptp(flat_x))
        across = (float(flat_x.min()) - side, float(flat_x.max()) + side)
        if self.log_y:
            return across, (low / 1.1, high * 1.1)
        margin = 0.0 if self.limits else 0.05 * ((high - low) or 1.0)
        return across, (low - margin, high + margin)

    def draw(self, left: float, top: float, width: float, height: float, name: str) -> list[str]:
        """SVG elements of the panel in the given rectangle; name: unique id of its clip path."""
        (x0, x1), (y0, y1) = self._range()
        inner_w, inner_h = width - LEFT - RIGHT, height - TOP - BOTTOM
        ox, oy = left + LEFT, top + TOP

        def px(value: np.ndarray) -> np.ndarray:
            a, b, v = (np.log10(x0), np.log10(x1), np.log10(value)) if self.log_x else (x0, x1, value)
            return ox + inner_w * (v - a) / ((b - a) or 1.0)

        def py(value: np.ndarray) -> np.ndarray:
            a, b, v = (np.log10(y0), np.log10(y1), np.log10(value)) if self.log_y else (y0, y1, value)
            return oy + inner_h * (1 - (v - a) / ((b - a) or 1.0))

        parts = [text(left + LEFT, top + 16, self.title, 12, weight=600)]
        for value in ticks(y0, y1, self.log_y):
            at = float(py(np.array(value)))
            parts += [f'<path d="M{ox:.1f} {at:.1f}h{inner_w:.1f}" stroke="{GRID}"/>']
            parts += [text(ox - 5, at + 3.5, f"{value:g}", 10, "end")]
        if self.ticks is None:
            for value in ticks(x0, x1, self.log_x):
                at = float(px(np.array(value)))
                parts += [f'<path d="M{at:.1f} {oy:.1f}v{inner_h:.1f}" stroke="{GRID}"/>']
                parts += [text(at, oy + inner_h + 14, f"{value:g}", 10, "middle")]
        else:
            for at, label in zip(np.unique([at for at, _, _ in self.boxes]), self.ticks, strict=True):
                parts += [text(float(px(np.array(at))), oy + inner_h + 14, label, 10, "middle")]
        parts += [text(ox + inner_w / 2, oy + inner_h + 30, self.x, 11, "middle")]
        centre = f"{left + 13:.1f} {oy + inner_h / 2:.1f}"
        parts += [
            f'<text transform="translate({centre}) rotate(-90)" text-anchor="middle" font-size="11" {FONT} '
            f'fill="{INK}">{escape(self.y)}</text>',
            f'<clipPath id="{name}"><rect x="{ox:.1f}" y="{oy:.1f}" width="{inner_w:.1f}" height="{inner_h:.1f}"/>'
            f'</clipPath><g clip-path="url(#{name})">',
        ]
        for x, y, colour, _, dash in self.lines:
            keep = np.isfinite(y) & ((y > 0) | (not self.log_y))
            points = thinned(px(x[keep]), py(y[keep]), every=dash == "dots")
            if dash == "dots":
                parts += [f'<circle cx="{a:.1f}" cy="{b:.1f}" r="1.7" fill="{COLOURS[colour]}"/>' for a, b in points]
                continue
            path = "M" + "L".join(f"{a:.1f} {b:.1f}" for a, b in points)
            style = f' stroke-dasharray="{dash}"' if dash else ""
            parts += [f'<path d="{path}" fill="none" stroke="{COLOURS[colour]}" stroke-width="1.5"{style}/>']
        for at, values, colour in self.boxes:
            parts += self._box(float(px(np.array(at))), py(np.quantile(values, [0, 0.25, 0.5, 0.75, 1])), colour)
        return [*parts, "</g>"]

    def _box(self, at: float, levels: np.ndarray, colour: str) -> list[str]:
        least, lower, median, upper, most = levels
        stroke = f'stroke="{COLOURS[colour]}" stroke-width="1.3"'
        return [
            f'<path d="M{at:.1f} {least:.1f}V{lower:.1f}M{at:.1f} {upper:.1f}V{most:.1f}" {stroke}/>',
            f'<rect x="{at - 8:.1f}" y="{upper:.1f}" width="16" height="{lower - upper:.1f}" fill="#fff" {stroke}/>',
            f'<path d="M{at - 8:.1f} {median:.1f}h16" {stroke.replace("1.3", "2.6")}/>',
        ]


def text(x: float, y: float, content: str, size: int, anchor: str = "start", weight: int = 400) -> str:
    """One line of text."""
    return (f'<text x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}" font-size="{size}" font-weight="{weight}" {FONT} '
            f'fill="{INK}">{escape(content)}</text>')  # fmt: skip


def ticks(low: float, high: float, log: bool) -> list[float]:
    """Three to eight round values within the limits."""
    if log:
        decades = range(int(np.floor(np.log10(low))), int(np.ceil(np.log10(high))) + 1)
        for steps in ((1,), (1, 3), (1, 2, 5), (1, 2, 3, 5, 7)):
            found = [s * 10.0**d for d in decades for s in steps if low <= s * 10.0**d <= high]
            if len(found) >= 4:
                return found
        return found
    raw = (high - low) / 5 or 1.0
    base = 10.0 ** np.floor(np.log10(raw))
    step = next(m * base for m in (1, 2, 5, 10) if m * base >= raw)
    return [float(round(k * step, 12)) for k in range(int(np.ceil(low / step)), int(np.floor(high / step)) + 1)]


def thinned(x: np.ndarray, y: np.ndarray, every: bool) -> list[tuple[float, float]]:
    """Points in the picture, without those that lie within 0.15 of a pixel of the line through their neighbours."""
    points = list(zip(x.tolist(), y.tolist(), strict=True))
    if every or len(points) < 3:
        return points
    kept, begin = [points[0]], 0
    for k in range(2, len(points)):
        (ax, ay), (bx, by) = points[begin], points[k]
        length = np.hypot(bx - ax, by - ay) or 1e-9
        between = points[begin + 1 : k]
        off = max(abs((bx - ax) * (ay - cy) - (ax - cx) * (by - ay)) / length for cx, cy in between)
        back = max(np.hypot(cx - ax, cy - ay) for cx, cy in between) > length + 0.4
        if off > 0.15 or back or len(between) > 200:
            kept.append(points[k - 1])
            begin = k - 1
    return [*kept, points[-1]]


def write(path: Path, title: str, panels: Sequence[Panel], columns: int, size: tuple[int, int] = (360, 240)) -> None:
    """Write the panels row by row, with one legend of all labels under the title."""
    labels: dict[str, tuple[str, str]] = {}
    for panel in panels:
        for _, _, colour, label, dash in panel.lines:
            if label:
                labels.setdefault(label, (colour, dash))
    rows, head = -(-len(panels) // columns), 50 if labels else 30
    width, height = columns * size[0], head + rows * size[1]
    parts = [f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" role="img">',
             f"<title>{escape(title)}</title>", f'<rect width="{width}" height="{height}" fill="#ffffff"/>',
             text(14, 20, title, 14, weight=600)]  # fmt: skip
    at = 14.0
    for label, (colour, dash) in labels.items():
        style = f' stroke-dasharray="{dash}"' if dash not in ("", "dots") else ""
        parts += [f'<path d="M{at:.0f} 38h20" stroke="{COLOURS[colour]}" stroke-width="2.5"{style}/>']
        parts += [text(at + 26, 42, label, 12)]
        at += 46 + 7 * len(label)
    for k, panel in enumerate(panels):
        corner = (k % columns * size[0], head + k // columns * size[1])
        parts += panel.draw(*corner, *size, f"p{k}")
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("\n".join([*parts, "</svg>"]) + "\n", encoding="utf-8")
