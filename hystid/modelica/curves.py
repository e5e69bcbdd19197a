"""Tables as piecewise cubic polynomials: the lookup tables of the Modelica Standard Library.

A curve is kept as a text of numbers, so that it can stand inside an expression: how it goes on outside (a code), the
breaks, and four coefficients for each stretch between two of them, of powers of the distance from its left end.
Smoothness and extrapolation are those of ``Modelica.Blocks.Types``: Akima (1970), Fritsch and Butland (1984), Steffen
(1990), and the modified weights of Akima's method as in MATLAB's makima.
"""

from __future__ import annotations

import json
import math
import sys
from bisect import bisect_left, bisect_right
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from hystid.numeric import Array

LINEAR, AKIMA, CONSTANT, MONOTONE, STEFFEN, MODIFIED = 1, 2, 3, 4, 5, 6  # Modelica.Blocks.Types.Smoothness
HOLD, TANGENT, PERIODIC, NONE = 1, 2, 3, 4  # Modelica.Blocks.Types.Extrapolation
NEVER = sys.float_info.max  # a time event that does not come
_NEAR_BREAK = 1e-9  # of a stretch: by which a step may fall short of the break that it aims at


@dataclass(frozen=True)
class Spline:
    """breaks (n,), not falling; coefficients (n - 1, 4); outside: one of the codes of extrapolation.

    first: 0 before this abscissa (the start time of a time table), minus infinity for none.
    events: abscissas at which a time table makes events.
    """

    breaks: tuple[float, ...]
    coefficients: tuple[tuple[float, ...], ...]
    outside: int
    first: float = -math.inf
    events: tuple[float, ...] = ()

    @property
    def text(self) -> str:
        """All numbers in one text."""
        return json.dumps([self.breaks, self.coefficients, self.outside, self.first, self.events])

    @staticmethod
    @lru_cache(maxsize=256)
    def read(text: str) -> Spline:
        """The curve that a text holds."""
        breaks, coefficients, outside, first, events = json.loads(text)
        return Spline(tuple(breaks), tuple(map(tuple, coefficients)), int(outside), first, tuple(events))

    @property
    def period(self) -> float:
        """Length of what is repeated."""
        return self.breaks[-1] - self.breaks[0]

    def value(self, x: float, order: int = 0, before: float = math.inf) -> float:
        """Value or derivative at x. before: of a time table the next event; what lies behind it is not seen yet."""
        b = self.breaks
        if before <= self.first or (x < self.first and not self._is_near(x, self.first, before)):
            return 0.0
        shift = 0.0
        if self.outside == PERIODIC:
            before -= _NEAR_BREAK * self.period  # more than shifts are rounded by
            shift = self._turns(x, before) * self.period
        k = self._stretch(x - shift, before - shift)
        inside = b[0] <= x - shift <= b[-1]
        s = x - shift - b[k]
        if not inside and self.outside in (HOLD, NONE):
            s = (b[0] if x < b[0] else b[-1]) - b[k]
            return self._polynomial(k, s, 0) if order == 0 else 0.0
        if not inside and self.outside == TANGENT:
            edge = (b[0] if x < b[0] else b[-1]) - b[k]
            slope = self._polynomial(k, edge, 1)
            return self._polynomial(k, edge, 0) + slope * (s - edge) if order == 0 else slope if order == 1 else 0.0
        return self._polynomial(k, s, order)

    def _turns(self, x: float, before: float) -> int:
        """How many periods lie in front of what is seen at x."""
        b = self.breaks
        if x >= before:
            return math.ceil((before - b[0]) / self.period) - 1
        turns = math.floor((x - b[0]) / self.period)
        end = b[0] + (turns + 1) * self.period
        return turns + (end < before < math.inf and end - x <= _NEAR_BREAK * (b[-1] - b[-2]))

    def _is_near(self, x: float, instant: float, before: float) -> bool:
        return instant < before and instant - x <= _NEAR_BREAK * self.period

    def _stretch(self, x: float, before: float) -> int:
        """Number of the stretch that holds x."""
        b = self.breaks
        k = bisect_right(b, x) - 1
        if x >= before:
            k = bisect_left(b, before) - 1
        elif 0 <= k < len(b) - 1 and b[k + 1] < before < math.inf and b[k + 1] - x <= _NEAR_BREAK * (b[k + 1] - b[k]):
            k = bisect_right(b, b[k + 1]) - 1
        return min(max(k, 0), len(b) - 2)

    def _polynomial(self, k: int, s: float, order: int) -> float:
        c0, c1, c2, c3 = self.coefficients[k]
        if order == 0:
            return c0 + s * (c1 + s * (c2 + s * c3))
        return (c1 + s * (2 * c2 + s * 3 * c3), 2 * c2 + s * 6 * c3, 6 * c3, 0.0)[min(order, 4) - 1]

    def next_event(self, x: float) -> float:
        """The first event behind x, NEVER without one."""
        behind = x + 1e-13 * abs(x)  # an event at x, reached to rounding, is over
        found = [e for e in (self.first, *self.events) if e > behind] if self.outside != PERIODIC else []
        if self.outside == PERIODIC and self.events:
            if self.first > behind:
                return self.first
            n = math.floor((behind - self.breaks[0]) / self.period)
            found = [e + m * self.period for m in (n, n + 1) for e in self.events if e + m * self.period > behind]
        return min(found, default=NEVER)


def curve(x: Array, y: Array, smoothness: int, outside: int) -> Spline:
    """The curve through points (n,). Raises ValueError, with a reason, for what is no table."""
    if len(x) == 1:
        return Spline((float(x[0]), float(x[0]) + 1.0), ((float(y[0]), 0.0, 0.0, 0.0),), HOLD)
    if np.any(np.diff(x) < 0):
        raise ValueError("the first column falls")
    if smoothness == CONSTANT:
        return _of_constants(x, y, outside)
    if smoothness not in (LINEAR, AKIMA, MONOTONE, STEFFEN, MODIFIED):
        raise ValueError(f"smoothness {smoothness} is not known")
    if smoothness != LINEAR and np.any(np.diff(x) <= 0):
        raise ValueError("the first column must rise for a smooth curve")
    h = np.diff(x)
    with np.errstate(divide="ignore", invalid="ignore"):
        d = np.where(h > 0, np.diff(y) / np.where(h > 0, h, 1.0), 0.0)
    if smoothness == LINEAR or len(x) == 2:
        rows = [(float(a), float(s), 0.0, 0.0) for a, s in zip(y[:-1], d, strict=True)]
        return Spline(tuple(map(float, x)), tuple(rows), outside)
    t = _SLOPES[smoothness](h, d, outside == PERIODIC)
    c2 = (3 * d - 2 * t[:-1] - t[1:]) / h
    c3 = (t[:-1] + t[1:] - 2 * d) / h**2
    table = np.column_stack([y[:-1], t[:-1], c2, c3])
    return Spline(tuple(map(float, x)), tuple(tuple(map(float, row)) for row in table), outside)


def _of_constants(x: Array, y: Array, outside: int) -> Spline:
    """The value of the point before; at its end the last one, on a stretch of its own."""
    rows = [(float(a), 0.0, 0.0, 0.0) for a in y[:-1]]
    breaks = list(map(float, x))
    if outside != PERIODIC:
        slope = (y[-1] - y[-2]) / (x[-1] - x[-2]) if outside == TANGENT and x[-1] > x[-2] else 0.0
        rows.append((float(y[-1]), float(slope), 0.0, 0.0))
        breaks.append(breaks[-1] + (breaks[-1] - breaks[0] or 1.0))
    if outside == TANGENT and x[1] > x[0]:
        slope = float((y[1] - y[0]) / (x[1] - x[0]))
        width = breaks[-1] - breaks[0]
        rows.insert(0, (float(y[0]) - slope * width, slope, 0.0, 0.0))
        breaks.insert(0, breaks[0] - width)
    return Spline(tuple(breaks), tuple(rows), outside)


def _extended(d: Array, periodic: bool) -> Array:
    """Two slopes more on either side: of the repeated table, or on straight lines."""
    if periodic:
        return np.concatenate([d[-2:], d, d[:2]])
    first, last = 2 * d[0] - d[1], 2 * d[-1] - d[-2]
    return np.concatenate([[2 * first - d[0], first], d, [last, 2 * last - d[-1]]])


def _akima(h: Array, d: Array, periodic: bool) -> Array:
    e = _extended(d, periodic)
    return _weighted(e, np.abs(np.diff(e)))


def _modified(h: Array, d: Array, periodic: bool) -> Array:
    e = _extended(d, periodic)
    return _weighted(e, np.abs(np.diff(e)) + 0.5 * np.abs(e[1:] + e[:-1]))


def _weighted(e: Array, w: Array) -> Array:
    left, right = w[2:], w[:-2]
    total = left + right
    safe = np.where(total > 0, total, 1.0)
    mean = np.where(total > 0, (left * e[1:-2] + right * e[2:-1]) / safe, 0.5 * (e[1:-2] + e[2:-1]))
    return np.asarray(mean)


def _fritsch_butland(h: Array, d: Array, periodic: bool) -> Array:
    def inner(h1: float, h2: float, d1: float, d2: float) -> float:
        if d1 * d2 <= 0:
            return 0.0
        part = (h1 + 2 * h2) / (3 * (h1 + h2))
        return d1 * d2 / (part * d2 + (1 - part) * d1)

    return _monotone(inner, h, d, periodic)


def _steffen(h: Array, d: Array, periodic: bool) -> Array:
    def inner(h1: float, h2: float, d1: float, d2: float) -> float:
        p = (d1 * h2 + d2 * h1) / (h1 + h2)
        return float((np.sign(d1) + np.sign(d2)) * min(abs(d1), abs(d2), 0.5 * abs(p)))

    return _monotone(inner, h, d, periodic)


def _monotone(inner, h: Array, d: Array, periodic: bool) -> Array:  # type: ignore[no-untyped-def]
    slopes = [inner(*q) for q in zip(h[:-1], h[1:], d[:-1], d[1:], strict=True)]
    edge = inner(h[-1], h[0], d[-1], d[0])
    ends = (edge, edge) if periodic else (d[0], d[-1])
    return np.array([ends[0], *slopes, ends[1]])


_SLOPES = {AKIMA: _akima, MONOTONE: _fritsch_butland, STEFFEN: _steffen, MODIFIED: _modified}


def literal(text: str) -> Sequence[float]:
    """The numbers of a curve in the order in which the C function ``hy_curve`` reads them."""
    c = Spline.read(text)
    head = [len(c.breaks), c.outside, c.first, len(c.events)]
    return [float(v) for v in (*head, *c.breaks, *c.events, *(v for row in c.coefficients for v in row))]


C_TEXT = """\
/* A table as cubic polynomials: number of breaks, how it goes on outside (1 holds, 2 along the tangent, 3 repeats, 4
   not at all), what it is 0 before, number of events, breaks, events, four coefficients per stretch.
   before: the next event of a time table. What lies behind it is not seen yet; a break in front of it, reached to
   rounding, is. */
static double hy_polynomial(const double *c, double s, int order)
{
    if (order == 0) return c[0] + s * (c[1] + s * (c[2] + s * c[3]));
    if (order == 1) return c[1] + s * (2 * c[2] + s * 3 * c[3]);
    return order == 2 ? 2 * c[2] + s * 6 * c[3] : order == 3 ? 6 * c[3] : 0;
}

static int hy_up_to(const double *b, int n, double x, int with_x) /* how many are below x, or not above it */
{
    int low = 0, high = n;
    while (low < high) {
        const int middle = (low + high) / 2;
        if (with_x ? b[middle] <= x : b[middle] < x) low = middle + 1;
        else high = middle;
    }
    return low;
}

static double hy_curve(const double *data, double x, int order, double before)
{
    const int n = (int)data[0], outside = (int)data[1];
    const double first = data[2], *b = data + 4, *c = b + n + (int)data[3], width = b[n - 1] - b[0];
    double edge, s, at;
    int k;
    if (before <= first || (x < first && !(first < before && first - x <= 1e-9 * width))) return 0;
    if (outside == 3) {
        double turns = floor((x - b[0]) / width);
        const double end = b[0] + (turns + 1) * width;
        before -= 1e-9 * width; /* more than shifts are rounded by */
        if (x >= before) turns = ceil((before - b[0]) / width) - 1;
        else if (end < before && before < INFINITY && end - x <= 1e-9 * (b[n - 1] - b[n - 2])) turns += 1;
        x -= turns * width;
        before -= turns * width;
    }
    k = hy_up_to(b, n, x, 1) - 1;
    if (x >= before) k = hy_up_to(b, n, before, 0) - 1;
    else if (k >= 0 && k < n - 1 && b[k + 1] < before && before < INFINITY && b[k + 1] - x <= 1e-9 * (b[k + 1] - b[k]))
        k = hy_up_to(b, n, b[k + 1], 1) - 1;
    k = k < 0 ? 0 : k > n - 2 ? n - 2 : k;
    at = fmin(fmax(x, b[0]), b[n - 1]);
    s = x - b[k];
    edge = at - b[k];
    if (at == x || outside == 3) return hy_polynomial(c + 4 * k, s, order);
    if (outside != 2) return order == 0 ? hy_polynomial(c + 4 * k, edge, 0) : 0;
    if (order == 0) return hy_polynomial(c + 4 * k, edge, 0) + hy_polynomial(c + 4 * k, edge, 1) * (s - edge);
    return order == 1 ? hy_polynomial(c + 4 * k, edge, 1) : 0;
}

"""

NEXT_TEXT = """\
static double hy_next_break(const double *data, double x) /* first event behind x */
{
    const int n = (int)data[0], n_events = (int)data[3];
    const double first = data[2], *b = data + 4, *e = b + n, width = b[n - 1] - b[0], behind = x + 1e-13 * fabs(x);
    double next = first > behind ? first : 1.7976931348623157e308;
    if ((int)data[1] == 3) {
        const double shift = floor((behind - b[0]) / width) * width;
        if (first > behind) return first;
        for (int i = 0; i < n_events; i++)
            for (int m = 0; m < 2; m++)
                if (e[i] + shift + m * width > behind) next = fmin(next, e[i] + shift + m * width);
        return next;
    }
    for (int i = 0; i < n_events; i++)
        if (e[i] > behind) next = fmin(next, e[i]);
    return next;
}
"""
