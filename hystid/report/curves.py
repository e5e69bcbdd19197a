"""Figures that several reports share: loops, time responses, spectra, harmonics, error bars per recording."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from hystid.comparison import Harmonics, harmonics, spectrum
from hystid.errors import UsageError
from hystid.recording import Array, Recording
from hystid.report.plots import Axis, Bars, Line, Plot, Role, Series, thin

X_AXIS = Axis("Displacement x", "m")
V_AXIS = Axis("Velocity v", "m/s")
R_AXIS = Axis("Restoring force R", "N")
FORCE = Axis("Force", "N")
T_AXIS = Axis("Time t", "s", prefix=False)

_BROAD, _THIN = 4.5, 1.6  # pixels
_CURVES = 6  # of levels in one figure: more cannot be told apart
_BOTTOM = -80.0  # dB below the fundamental, where bars of harmonics start


@dataclass(frozen=True)
class Curve:
    """One signal over another, shape (n,) each, SI units, with its name and role in the figure."""

    name: str
    x: Array
    y: Array
    role: Role
    dash: bool = False

    def line(self) -> Line:
        """As a series of a plot; a reference is a broad line, so that it shows beneath what follows it."""
        width = _BROAD if self.role in ("reference", "muted") else _THIN
        return Line(self.x, self.y, self.name, self.role, "dash" if self.dash else "solid", width=width)


def raw(title: str, t: Array, axis: Axis, values: Array, height: int = 200) -> Plot:
    """One channel over the whole time [s], shape (n,), as a flat figure."""
    return Plot(title, T_AXIS, axis, [Line(t, values, "", "measured", width=1.0)], height=height)


def loops(title: str, curves: Sequence[Curve], caption: str = "") -> Plot:
    """Restoring force over displacement."""
    return Plot(title, X_AXIS, R_AXIS, [curve.line() for curve in curves], caption)


def over_time(
    title: str, axis: Axis, curves: Sequence[Curve], caption: str = "", window: slice | None = None, height: int = 340
) -> Plot:
    """Signals over time; window: the samples to show at first, the rest comes into view by zooming out."""
    time = T_AXIS
    if window is not None:
        t = curves[0].x[window]
        time = Axis(T_AXIS.label, "s", prefix=False, bounds=(float(t[0]), float(t[-1])))
        caption = f"{caption} Double-click shows the whole test.".strip()
    return Plot(title, time, axis, [_windowed(curve, window).line() for curve in curves], caption, height=height)


def _windowed(curve: Curve, window: slice | None) -> Curve:
    """Every sample within the window, the rest thinned: what is seen first is exact."""
    if window is None or curve.x.size <= 4000:
        return curve
    start, stop = window.start, min(window.stop, window.start + 2500)
    before, after = thin(curve.x[:start], curve.y[:start], 700), thin(curve.x[stop:], curve.y[stop:], 700)
    x = np.concatenate([before[0], curve.x[start:stop], after[0]])
    y = np.concatenate([before[1], curve.y[start:stop], after[1]])
    return replace(curve, x=x, y=y)


def window_of(F: Array, x: Array, dt: float) -> slice:
    """Samples worth looking at closely: the last periods of a harmonic test, else the largest motion."""
    n = x.size
    f = fundamental_of(steady(F), dt)
    if f is not None:
        return slice(max(n - max(round(4 / (f * dt)), 40), 0), n)
    size = min(n, 2000)
    peak = int(np.argmax(np.abs(x - x.mean())))
    start = min(max(peak - size // 2, 0), n - size)
    return slice(start, start + size)


def highest_frequency(values: Array, dt: float) -> float:
    """Ten times the frequency below which 95 % of the power lies, at most half the sample rate."""
    found = spectrum(values, dt)
    share = np.cumsum(found.density) / np.sum(found.density)
    return float(min(10 * found.frequency[int(np.searchsorted(share, 0.95))] + 10 * found.frequency[1], 0.5 / dt))


def spectra(title: str, unit: str, curves: Sequence[Curve], highest: float, caption: str = "") -> Plot:
    """Power spectral densities in dB up to ``highest`` [Hz]; the x of each curve is its time [s]."""
    series: list[Series] = []
    top = -np.inf
    for curve in curves:
        found = spectrum(curve.y, float(curve.x[1] - curve.x[0]))
        part = slice(1, int(np.searchsorted(found.frequency, highest, side="right")))
        level = 10 * np.log10(np.maximum(found.density[part], 1e-300))
        top = max(top, float(level.max(initial=-300.0)))
        series.append(Line(found.frequency[part], level, curve.name, curve.role, "dash" if curve.dash else "solid"))
    density = Axis("Power density", f"dB re 1 {unit}²/Hz", bounds=(top - 100, top + 8), prefix=False)
    return Plot(title, Axis("Frequency", "Hz", prefix=False), density, series, caption)


def response(cause: Array, effect: Array, dt: float) -> tuple[Array, Array]:
    """Gain |effect/cause| over frequency [Hz], where the cause has power: H1 estimate by Welch's method.

    Lines with less than a thousandth of the strongest power of the cause are left out: there the quotient is noise.
    """
    from scipy.signal import csd, welch

    length = min(len(cause), max(256, 2 ** int(np.log2(max(len(cause) // 6, 1)))))
    frequency, power = welch(cause, 1 / dt, nperseg=length)
    cross = csd(cause, effect, 1 / dt, nperseg=length)[1]
    known = (power > 1e-3 * power.max()) & (frequency > 0)
    return frequency[known], np.abs(cross[known]) / power[known]


def responses(records: Sequence[Recording]) -> Plot | None:
    """Receptance |x/F| over frequency, one curve per level of force; None where no band is excited."""
    known = [r for r in records if r.x is not None and r.F is not None and not r.quasi_static]
    order = sorted(known, key=lambda r: float(np.std(r.channel("F"))))
    curves: list[Series] = []
    for record in order[:: max(1, len(order) // _CURVES)]:
        frequency, gain = response(record.channel("F"), record.channel("x"), record.dt)
        if frequency.size > 3:
            name = f"{float(np.std(record.channel('F'))):.3g} N rms, {record.name}"
            curves.append(Line(frequency, gain, name, width=1.3))
    if not curves:
        return None
    axes = Axis("Frequency", "Hz", log=True, prefix=False), Axis("|x/F|", "m/N", log=True)
    caption = "By level of force. A linear structure gives one curve; where the curves differ, it is not linear."
    return Plot("Frequency response by level", *axes, curves, caption)


def harmonic_bars(title: str, signals: Sequence[tuple[str, Role, Harmonics]], caption: str = "") -> Plot:
    """Levels of the harmonics of signals (name, role) from the second on, re the fundamental.

    Bars start at -80 dB, so that a longer bar is a stronger harmonic.
    """
    series = [
        Bars([f"{n:.0f}" for n in found.order[1:]], np.maximum(found.level_db[1:], _BOTTOM), name, role, base=_BOTTOM)
        for name, role, found in signals
    ]
    level = Axis("Level re fundamental", "dB", bounds=(_BOTTOM, 0), prefix=False)
    return Plot(title, Axis("Harmonic order"), level, series, caption)


def fundamental_of(force: Array, dt: float) -> float | None:
    """Frequency [Hz] of a harmonic test, refined by least squares; None where the force is not one sine."""
    n = force.size
    power = np.abs(np.fft.rfft((force - force.mean()) * np.hanning(n))) ** 2
    peak = int(np.argmax(power))
    if peak < 2 or power[peak - 2 : peak + 3].sum() < 0.9 * power.sum():
        return None
    low, high = (peak - 1) / (n * dt), (peak + 1) / (n * dt)
    for _ in range(40):  # golden-section search of the least residual
        a, b = low + 0.382 * (high - low), low + 0.618 * (high - low)
        low, high = (low, b) if _misfit(force, dt, a) < _misfit(force, dt, b) else (a, high)
    return 0.5 * (low + high)


def _misfit(force: Array, dt: float, frequency: float) -> float:
    try:
        return harmonics(force, dt, frequency, count=1).residual
    except UsageError:
        return np.inf


def steady(values: Array) -> Array:
    """The second half of a signal, where the start has died out."""
    return values[values.size // 2 :]
