"""Figures as data: what is drawn is stated here in physical terms, and turned into plotly's JSON.

A ``Plot`` has two axes with quantity and unit, series of a few kinds, and a caption. Values are given in SI; the axis
chooses a prefix (mm, kN) from what is shown. Long series are thinned block by block so that every peak stays.
"""

from __future__ import annotations

import base64
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Literal, cast

import numpy as np

from hystid.errors import UsageError
from hystid.numeric import Array
from hystid.rotation import turned_text, turned_unit

COLOURS = {
    "measured": "#2b3440",
    "reference": "#2b3440",
    "model": "#1668c7",
    "after": "#1668c7",
    "before": "#d9730d",
    "good": "#12805c",
    "bad": "#c8372d",
    "third": "#7b4fc9",
    "muted": "#98a2ae",
}
DARK = {
    "measured": "#dfe6ee",
    "reference": "#dfe6ee",
    "model": "#6cb2ff",
    "after": "#6cb2ff",
    "before": "#ffa657",
    "good": "#4fcf9b",
    "bad": "#ff7b72",
    "third": "#c8a6ff",
    "muted": "#7d8894",
}
"""The colours of ``COLOURS`` on a dark ground."""
_CYCLE = ("#1668c7", "#d9730d", "#12805c", "#7b4fc9", "#c8372d", "#0c8599", "#9c6500", "#5c677a")
_NAMED = {colour: f"@{role}" for role, colour in COLOURS.items()} | {"#f7f8fa": "@ground"}
_MOST_POINTS = 2000  # a screen has fewer columns; more only makes the file heavy
_PREFIXES = ((1e9, "G"), (1e6, "M"), (1e3, "k"), (1.0, ""), (1e-3, "m"), (1e-6, "µ"), (1e-9, "n"))
_PREFIXABLE = {"m", "N", "s", "J", "W", "Hz", "m/s", "N/m", "Pa", "V", "rad", "rad/s", "N.m", "N.m/rad"}

Role = Literal["measured", "reference", "model", "after", "before", "good", "bad", "third", "muted"]


@dataclass(frozen=True)
class Axis:
    """Quantity and SI unit of an axis; "" is a number without unit. Every axis needs a label.

    bounds: (lowest, highest) in SI to show, None to fit the data.
    """

    label: str
    unit: str = ""
    log: bool = False
    bounds: tuple[float, float] | None = None
    prefix: bool = True


@dataclass(frozen=True)
class Line:
    """A curve through x and y, shape (n,), SI units. Without a role the colour is the next of the cycle."""

    x: Array
    y: Array
    name: str = ""
    role: Role | None = None
    dash: Literal["solid", "dash", "dot"] = "solid"
    width: float = 1.8
    opacity: float = 1.0


@dataclass(frozen=True)
class Points:
    """Markers at x and y, shape (n,), SI units; labels are shown when pointing at them."""

    x: Array
    y: Array
    name: str = ""
    role: Role | None = None
    labels: Sequence[str] = ()
    size: float = 7.0
    opacity: float = 0.9


@dataclass(frozen=True)
class Bars:
    """One bar per label. base: where the bars start."""

    labels: Sequence[str]
    values: Array
    name: str = ""
    role: Role | None = None
    horizontal: bool = False
    base: float = 0.0


@dataclass(frozen=True)
class Band:
    """A shaded area between lower and upper over x, all of shape (n,)."""

    x: Array
    lower: Array
    upper: Array
    name: str = ""
    role: Role | None = None


@dataclass(frozen=True)
class Boxes:
    """A box (quartiles, whiskers of 1.5 interquartile ranges, outliers) per label; values: one array per label."""

    labels: Sequence[str]
    values: Sequence[Array]
    name: str = ""
    role: Role | None = None


@dataclass(frozen=True)
class Heat:
    """A map z of shape (len(y), len(x)) over the centres x and y; NaN cells stay empty. label [unit] names z."""

    x: Array
    y: Array
    z: Array
    label: str
    unit: str = ""


Series = Line | Points | Bars | Band | Boxes | Heat


@dataclass(frozen=True)
class Mark:
    """A straight mark across the plot at ``at`` on the named axis, in SI units."""

    at: float
    axis: Literal["x", "y"] = "x"
    text: str = ""
    role: Role = "muted"


@dataclass(frozen=True)
class Plot:
    """One figure. title says what is shown, caption what to see in it.

    marks: limits and thresholds. height in pixels.
    """

    title: str
    x: Axis
    y: Axis
    series: Sequence[Series]
    caption: str = ""
    marks: Sequence[Mark] = field(default_factory=tuple)
    height: int = 340


def turned_plot(plot: Plot) -> Plot:
    """The figure of a rig that turns: of angle and torque."""
    series = tuple(_turned_series(one) for one in plot.series)
    marks = tuple(replace(mark, text=turned_text(mark.text)) for mark in plot.marks)
    x, y = turned_axis(plot.x), turned_axis(plot.y)
    title, caption = turned_text(plot.title), turned_text(plot.caption)
    return replace(plot, title=title, x=x, y=y, series=series, caption=caption, marks=marks)


def turned_axis(axis: Axis) -> Axis:
    """The axis of a rig that turns."""
    unit = turned_text(axis.unit) if " " in axis.unit else turned_unit(axis.unit)
    return replace(axis, label=turned_text(axis.label), unit=unit)


def _turned_series(series: Series) -> Series:
    if isinstance(series, Heat):
        return replace(series, label=turned_text(series.label), unit=turned_unit(series.unit))
    return replace(series, name=turned_text(series.name))


def figure(plot: Plot) -> dict[str, Any]:
    """plotly's figure {"data": [...], "layout": {...}} of a plot. Deterministic."""
    (sx, x_title), (sy, y_title) = _scaled(plot, "x"), _scaled(plot, "y")
    colours = iter(_CYCLE * (1 + len(plot.series) // len(_CYCLE)))
    data: list[dict[str, Any]] = []
    for series in plot.series:
        role = getattr(series, "role", None)
        colour = COLOURS[role] if role else next(colours)
        data += _TRACES[type(series)](series, colour, sx, sy)
    named = sum(bool(getattr(series, "name", "")) for series in plot.series)
    layout: dict[str, Any] = {
        "xaxis": _axis(plot.x, x_title, sx) | _log_ticks(plot, "x"),
        "yaxis": _axis(plot.y, y_title, sy) | _log_ticks(plot, "y"),
        "height": plot.height,
        "showlegend": named > 1 or (named == 1 and len(plot.series) > 1),
        "shapes": [_shape(mark, sx, sy) for mark in plot.marks],
        "annotations": [_annotation(mark, sx, sy) for mark in plot.marks if mark.text],
    }
    for series in plot.series:
        if isinstance(series, Bars | Boxes):
            across = "yaxis" if isinstance(series, Bars) and series.horizontal else "xaxis"
            layout[across] |= {"type": "category"}
    if sum(isinstance(series, Bars) for series in plot.series) > 1:
        layout["barmode"] = "group"
    if sum(isinstance(series, Boxes) for series in plot.series) > 1:
        layout["boxmode"] = "group"
    return {"data": data, "layout": layout}


_DECADES = 1e3  # ratio of positive values beyond which even steps would not resolve the small ones


def compact(plot: Plot) -> dict[str, Any]:
    """``figure`` for a page of ours: colours by role, so that they suit the ground, and values of 16 bits.

    Arrays become {"q": base64 of little-endian unsigned 16-bit numbers, "lo", "hi", "log"}: 0 is lo, 65534 is hi, 65535
    is a gap; "log" where the steps are those of the logarithm, as for spectra. A figure that is 600 pixels high and
    zoomed in by 100 still shows every step of the screen.
    """
    return cast("dict[str, Any]", _compacted(figure(plot)))


def packed(values: Array) -> dict[str, Any]:
    """Values as ``compact`` has them."""
    finite = values[np.isfinite(values)]
    lo, hi = (float(finite.min()), float(finite.max())) if finite.size else (0.0, 0.0)
    levels = np.full(values.shape, 65535, dtype="<u2")
    steep = lo > 0 and _DECADES * lo < hi < 1e300 * lo  # beyond, the quotient is no number
    place = np.log(finite / lo) / np.log(hi / lo) if steep else (finite - lo) / (hi - lo) if hi > lo else 0.0 * finite
    levels[np.isfinite(values)] = np.round(65534 * place).astype("<u2")
    found = {"q": base64.b64encode(levels.tobytes()).decode("ascii"), "lo": lo, "hi": hi}
    return {**found, "log": True} if steep else found


def _compacted(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        return packed(value)
    if isinstance(value, dict):
        return {key: _compacted(item) for key, item in value.items()}
    if isinstance(value, list):
        return [_compacted(item) for item in value]
    if isinstance(value, str) and value.startswith(("#", "rgba(")):
        return _NAMED.get(value, value) if value.startswith("#") else _named_translucent(value)
    return value


def _named_translucent(value: str) -> str:
    *rgb, alpha = value.removeprefix("rgba(").removesuffix(")").split(",")
    name = _NAMED.get("#" + "".join(f"{int(part):02x}" for part in rgb))
    return f"{name}/{alpha}" if name else value


def thin(x: Array, y: Array, most: int = _MOST_POINTS) -> tuple[Array, Array]:
    """At most about ``most`` of the samples, in order, with the extremes of x and of y of every block kept."""
    n = x.size
    if n <= most:
        return x, y
    keys = (y,) if np.all(np.diff(x) >= 0) else (x, y)
    block = math.ceil(n * 2 * len(keys) / most)
    full = n // block
    kept = [np.array([0, n - 1])]
    for key in keys:
        rows = np.where(np.isfinite(key), key, 0.0)[: full * block].reshape(full, block)
        kept += [np.arange(full) * block + rows.argmin(axis=1), np.arange(full) * block + rows.argmax(axis=1)]
        if full * block < n:
            tail = key[full * block :]
            kept.append(full * block + np.array([int(np.argmin(tail)), int(np.argmax(tail))]))
    index = np.unique(np.concatenate(kept))
    return x[index], y[index]


def prefix_for(largest: float, unit: str) -> tuple[float, str]:
    """(divisor, unit with prefix) that brings ``largest`` between 1 and 1000."""
    if unit not in _PREFIXABLE or not math.isfinite(largest) or largest <= 0:
        return 1.0, unit
    scale, letter = next(((s, p) for s, p in _PREFIXES if largest >= 0.9999 * s), _PREFIXES[-1])
    return scale, letter + unit


def _scaled(plot: Plot, which: str) -> tuple[float, str]:
    axis: Axis = getattr(plot, which)
    largest = 0.0
    for series in plot.series:
        for values in _values(series, which):
            finite = np.abs(values[np.isfinite(values)])
            largest = max(largest, float(finite.max(initial=0.0)))
    if axis.bounds:
        largest = max(abs(bound) for bound in axis.bounds)
    scale, unit = prefix_for(largest, axis.unit) if axis.prefix and not axis.log else (1.0, axis.unit)
    return scale, f"{axis.label} [{unit}]" if unit else axis.label


def _values(series: Series, which: str) -> list[Array]:
    if isinstance(series, Bars):
        return [series.values] if (which == "x") == series.horizontal else []
    if isinstance(series, Boxes):
        return list(series.values) if which == "y" else []
    if isinstance(series, Band) and which == "y":
        return [series.lower, series.upper]
    return [getattr(series, which)]


def _axis(axis: Axis, title: str, scale: float) -> dict[str, Any]:
    settings: dict[str, Any] = {"title": {"text": title}}
    if axis.log:
        settings["type"] = "log"
    if axis.bounds:
        low, high = (bound / scale for bound in axis.bounds)
        settings["range"] = [math.log10(low), math.log10(high)] if axis.log else [low, high]
    return settings


def _log_ticks(plot: Plot, which: str) -> dict[str, Any]:
    """Powers of ten over three decades and more, 1, 2 and 5 over one: plotly writes 2 to 9 over each other."""
    if not getattr(plot, which).log:
        return {}
    found = [u[np.isfinite(u) & (u > 0)] for series in plot.series for u in _values(series, which)]
    seen = np.concatenate([np.zeros(0), *found])
    decades = math.log10(float(seen.max()) / float(seen.min())) if seen.size else 0.0
    return {"dtick": 1} if decades >= 3 else {"dtick": "D2"} if decades >= 1 else {}


def _line(series: Line, colour: str, sx: float, sy: float) -> list[dict[str, Any]]:
    x, y = thin(np.asarray(series.x, dtype=float), np.asarray(series.y, dtype=float))
    style = {"color": colour, "width": series.width, "dash": series.dash}
    common = {"type": "scatter", "mode": "lines", "name": series.name, "line": style, "opacity": series.opacity}
    return [{**common, "x": x / sx, "y": y / sy}]


def _points(series: Points, colour: str, sx: float, sy: float) -> list[dict[str, Any]]:
    x, y = np.asarray(series.x, dtype=float), np.asarray(series.y, dtype=float)
    if not series.labels:
        x, y = thin(x, y)
    style = {"color": colour, "size": series.size, "opacity": series.opacity}
    trace = {"type": "scatter", "mode": "markers", "name": series.name, "marker": style}
    if series.labels:
        trace |= {"text": list(series.labels), "hovertemplate": "%{text}<br>%{x:.4g}, %{y:.4g}<extra></extra>"}
    return [{**trace, "x": x / sx, "y": y / sy}]


def _bars(series: Bars, colour: str, sx: float, sy: float) -> list[dict[str, Any]]:
    scale = sx if series.horizontal else sy
    values = [_number((value - series.base) / scale) for value in series.values]
    along, across = ("x", "y") if series.horizontal else ("y", "x")
    trace: dict[str, Any] = {"type": "bar", "name": series.name, "marker": {"color": colour}}
    trace |= {along: values, across: list(series.labels)}
    if series.horizontal:
        trace["orientation"] = "h"
    if series.base:
        trace["base"] = series.base / scale
    return [trace]


def _band(series: Band, colour: str, sx: float, sy: float) -> list[dict[str, Any]]:
    edges = [thin(np.asarray(series.x, dtype=float), np.asarray(edge)) for edge in (series.lower, series.upper)]
    common = {"type": "scatter", "mode": "lines", "line": {"width": 0}, "hoverinfo": "skip"}
    lower, upper = ({**common, "x": x / sx, "y": y / sy} for x, y in edges)
    fill = {"fill": "tonexty", "fillcolor": _translucent(colour, 0.18), "name": series.name}
    return [{**lower, "showlegend": False}, {**upper, **fill, "showlegend": bool(series.name)}]


def _boxes(series: Boxes, colour: str, sx: float, sy: float) -> list[dict[str, Any]]:
    labels = [label for label, group in zip(series.labels, series.values, strict=True) for _ in range(len(group))]
    values = np.concatenate([np.asarray(group, dtype=float) for group in series.values]) / sy
    style = {"marker": {"color": colour, "size": 4}, "line": {"width": 1.4}, "boxpoints": "outliers"}
    return [{"type": "box", "name": series.name, "x": labels, "y": [_number(v) for v in values], **style}]


def _heat(series: Heat, colour: str, sx: float, sy: float) -> list[dict[str, Any]]:
    finite = np.abs(series.z[np.isfinite(series.z)])
    largest = float(finite.max(initial=0.0))
    scale, unit = prefix_for(largest, series.unit)
    rows = [[_number(cell / scale) for cell in row] for row in series.z]
    title = f"{series.label} [{unit}]" if unit else series.label
    bar = {"title": {"text": title, "side": "right"}, "thickness": 12, "outlinewidth": 0}
    trace: dict[str, Any] = {"type": "heatmap", "z": rows, "colorbar": bar, "hoverongaps": False}
    trace |= {"x": [_number(v / sx) for v in series.x], "y": [_number(v / sy) for v in series.y]}
    scales = [[0.0, "#1668c7"], [0.5, "#f7f8fa"], [1.0, "#d9730d"]]
    return [{**trace, "zmin": -largest / scale, "zmax": largest / scale, "colorscale": scales}]


_TRACES: dict[type, Callable[..., list[dict[str, Any]]]] = {
    Line: _line,
    Points: _points,
    Bars: _bars,
    Band: _band,
    Boxes: _boxes,
    Heat: _heat,
}


def _number(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None


def _translucent(colour: str, alpha: float) -> str:
    red, green, blue = (int(colour[k : k + 2], 16) for k in (1, 3, 5))
    return f"rgba({red},{green},{blue},{alpha})"


def _shape(mark: Mark, sx: float, sy: float) -> dict[str, Any]:
    scale, other = (sx, "y") if mark.axis == "x" else (sy, "x")
    ends = {f"{mark.axis}0": mark.at / scale, f"{mark.axis}1": mark.at / scale, f"{other}0": 0, f"{other}1": 1}
    line = {"color": COLOURS[mark.role], "width": 1.3, "dash": "dot"}
    return {"type": "line", **ends, f"{other}ref": "paper", "line": line}


def _annotation(mark: Mark, sx: float, sy: float) -> dict[str, Any]:
    style = {"text": mark.text, "showarrow": False, "font": {"size": 11, "color": COLOURS[mark.role]}}
    if mark.axis == "x":
        return {**style, "x": mark.at / sx, "y": 1, "yref": "paper", "xanchor": "left", "yanchor": "top"}
    return {**style, "y": mark.at / sy, "x": 1, "xref": "paper", "xanchor": "right", "yanchor": "bottom"}


def chosen(plots: Sequence[Plot], title: str = "") -> Any:
    """The first plot whose title begins with ``title``, as ``plotly.graph_objects.Figure``. Raises UsageError."""
    found = [plot for plot in plots if plot.title.lower().startswith(title.lower())]
    if not found:
        listed = "; ".join(plot.title for plot in plots) or "none"
        raise UsageError(f"there is no figure '{title}'; the figures are: {listed}")
    from plotly.graph_objects import Figure

    drawn = Figure(figure(found[0]))
    return drawn.update_layout(title=found[0].title, template="simple_white")
