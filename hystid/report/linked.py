"""Several views of the same samples: time, loop and phase plane with one cursor, and a slider through the recording.

All views of a window share its samples, so that the sample under the cursor in one view is marked in the others. A
long recording is shown in windows of full resolution; the slider moves from one to the next.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hystid.recording import Array
from hystid.report.curves import FORCE, R_AXIS, T_AXIS, V_AXIS, X_AXIS
from hystid.report.plots import Axis, Line, Plot, Points, Role, packed, prefix_for, turned_axis
from hystid.rotation import turned_text

_WINDOWS = 7  # stretches of a long recording
_DENSE = 300  # samples in one of them: dense enough for a loop, light enough for a page
_REVERSALS = 7  # in one of them: three loops
_WHOLE = 3000  # samples up to which a recording is shown as one window


@dataclass(frozen=True)
class Series:
    """Values over the samples of a recording, shape (n,), SI; role and name in the figures. dots: shown as points."""

    name: str
    values: Array
    role: Role
    dots: bool = False


@dataclass(frozen=True)
class Panel:
    """One figure: signals over one signal. x, y: axes in SI units."""

    title: str
    x: Axis
    over: Array
    y: Axis
    signals: Sequence[Series]


@dataclass(frozen=True)
class Linked:
    """Views of one recording over the same samples. t [s], shape (n,). first: window to begin with."""

    t: Array
    views: Sequence[Panel]
    windows: Sequence[slice]
    first: int = 0

    @staticmethod
    def of(
        motion: tuple[Array, Array, Array],
        forces: Sequence[Series],
        residual: Sequence[Series],
        weight: Array | None = None,
    ) -> Linked:
        """The usual views: loop, phase plane, force over time and, where there is any, its residual over time.

        motion: t [s], x [m] and v [m/s], shape (n,). forces [N]: first the measured one. weight: see ``windows``.
        """
        t, x, v = motion
        made = [
            Panel("Loop", X_AXIS, x, R_AXIS, forces),
            Panel("Phase plane", X_AXIS, x, V_AXIS, [Series("measured", v, "measured")]),
            Panel("Force over time", T_AXIS, t, R_AXIS, forces),
        ]
        made += [Panel("Residual over time", T_AXIS, t, FORCE, residual)] if residual else []
        return Linked(t, made, *windows(x, weight))

    def turned(self) -> Linked:
        """The views of a rig that turns: of angle and torque."""
        views = [
            replace(view, title=turned_text(view.title), x=turned_axis(view.x), y=turned_axis(view.y))
            for view in self.views
        ]
        return replace(self, views=views)

    def plots(self) -> list[Plot]:
        """The views of the first window as plain figures."""
        part = self.windows[self.first]
        return [
            Plot(
                view.title, view.x, view.y,
                [
                    Points(view.over[part], s.values[part], s.name, s.role, size=3.5)
                    if s.dots else Line(view.over[part], s.values[part], s.name, s.role, width=1.3)
                    for s in view.signals
                ],
            )
            for view in self.views
        ]  # fmt: skip

    def data(self) -> dict[str, Any]:
        """What the page needs to draw every window of every view."""
        views = []
        for view in self.views:
            (sx, x_title), (sy, y_title) = (
                _scale(axis, values, self.windows)
                for axis, values in ((view.x, [view.over]), (view.y, [s.values for s in view.signals]))
            )
            series = [
                {"name": s.name, "role": f"@{s.role}", "dots": s.dots,
                 "y": [packed(s.values[part] / sy) for part in self.windows]}
                for s in view.signals
            ]  # fmt: skip
            over = [packed(view.over[part] / sx) for part in self.windows]
            views.append({"x": over, "xtitle": x_title, "ytitle": y_title, "series": series})
        spans = [f"{self.t[part][0]:.4g} to {self.t[part][-1]:.4g} s" for part in self.windows]
        return {"views": views, "spans": spans, "first": self.first}


def windows(x: Array, weight: Array | None = None) -> tuple[list[slice], int]:
    """Stretches of a recording to look at, in order of time, and the number of the most telling one.

    x: displacement (n,). weight: how telling each sample is, (n,), by default the square of x. A short recording is one
    stretch. Each holds about three loops, every so manyth sample where these are long.
    """
    n = x.size
    if n <= _WHOLE:
        step = max(1, -(-n // _WHOLE))
        return [slice(0, n, step)], 0
    told = (x - x.mean()) ** 2 if weight is None else weight
    turns = _reversals(x)
    parts = []
    for middle in np.linspace(0, n, _WINDOWS + 2)[1:-1].astype(int):
        near = int(np.searchsorted(turns, middle))
        inside = turns[max(near - _REVERSALS // 2, 0) : near + _REVERSALS // 2 + 1]
        start, stop = (
            (int(inside[0]), int(inside[-1])) if inside.size > 2 else (middle - _DENSE // 2, middle + _DENSE // 2)
        )
        start, stop = max(start, 0), min(stop + 1, n)
        parts.append(slice(start, stop, max(1, -(-(stop - start) // _DENSE))))
    score = [float(np.mean(told[part])) for part in parts]
    return parts, int(np.argmax(score))


def _reversals(x: Array) -> NDArray[np.int64]:
    """Samples at which the displacement turns by more than a twentieth of its range."""
    from scipy.signal import find_peaks

    least = 0.05 * float(np.ptp(x)) + 1e-300
    return np.sort(np.concatenate([find_peaks(sign * x, prominence=least)[0] for sign in (1.0, -1.0)]))


def _scale(axis: Axis, values: Sequence[Array], parts: Sequence[slice]) -> tuple[float, str]:
    shown = np.concatenate([v[part] for v in values for part in parts])
    largest = float(np.max(np.abs(shown[np.isfinite(shown)]), initial=0.0))
    scale, unit = prefix_for(largest, axis.unit) if axis.prefix else (1.0, axis.unit)
    return scale, f"{axis.label} [{unit}]" if unit else axis.label
