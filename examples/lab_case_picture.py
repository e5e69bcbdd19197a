"""Draw the force-displacement loops of the lab case: measured, refitted stick-slip, and with what was named.

Run: ``python examples/lab_case_picture.py [-o FILE]``. Everything in the picture is computed here: the rig is recorded,
``hystid diagnose`` names what is left out, and both models are held to the measured motion of the strongest chirp.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from lab_case import BELIEVED, NOMINAL, record
from numpy.typing import NDArray

from hystid.diagnosis import Diagnosis, Traces, diagnose
from hystid.files import write_text

Array = NDArray[np.float64]
LOOPS = 2  # periods shown
WIDTH, HEIGHT, LEFT, RIGHT, TOP, BOTTOM = 720, 420, 70, 24, 64, 52
FONT = 'font-family="system-ui, sans-serif"'
COLOURS = {"measured": "#9aa5b1", "stick-slip, refitted": "#d1495b", "with what was named": "#00798c"}


def widest(trace: Traces) -> slice:
    """Two periods from the largest displacement on, from zero crossing to zero crossing."""
    top = int(np.argmax(np.abs(trace.x)))
    crossings = np.flatnonzero((trace.x[:-1] < 0) & (trace.x[1:] >= 0))
    start = min(int(np.searchsorted(crossings, top)), len(crossings) - LOOPS - 1)
    return slice(int(crossings[start - 1]), int(crossings[start - 1 + LOOPS]) + 1)


def ticks(low: float, high: float) -> Array:
    """Round values between two bounds, about five."""
    rough = (high - low) / 5
    power = 10.0 ** np.floor(np.log10(rough))
    step = power * min((1.0, 2.0, 5.0, 10.0), key=lambda k: abs(k * power - rough))
    return np.asarray(np.arange(np.ceil(low / step), np.floor(high / step) + 1) * step)


class Frame:
    """From displacement [mm] and force [N] to pixels."""

    def __init__(self, x: Array, force: Array) -> None:
        def padded(u: Array) -> tuple[float, float]:
            pad = 0.06 * float(np.ptp(u))
            return float(np.min(u)) - pad, float(np.max(u)) + pad

        self.x, self.force = padded(x), padded(force)

    def at(self, x: Any, force: Any) -> tuple[Any, Any]:
        """Pixels of a point or of arrays."""
        across = LEFT + (x - self.x[0]) / (self.x[1] - self.x[0]) * (WIDTH - LEFT - RIGHT)
        down = HEIGHT - BOTTOM - (force - self.force[0]) / (self.force[1] - self.force[0]) * (HEIGHT - TOP - BOTTOM)
        return across, down

    def axes(self) -> list[str]:
        """Grid, numbers and titles."""
        text = []
        for value in ticks(*self.x):
            across, _ = self.at(value, 0.0)
            text.append(f'<path d="M{across:.1f} {TOP}V{HEIGHT - BOTTOM}" stroke="#e8ebee"/>')
            text.append(label(across, HEIGHT - BOTTOM + 18, f"{value:.3g}", "middle"))
        for value in ticks(*self.force):
            _, down = self.at(0.0, value)
            text.append(f'<path d="M{LEFT} {down:.1f}H{WIDTH - RIGHT}" stroke="#e8ebee"/>')
            text.append(label(LEFT - 8, down + 4, f"{value:.3g}", "end"))
        text.append(label((LEFT + WIDTH - RIGHT) / 2, HEIGHT - 12, "displacement [mm]", "middle"))
        turned = f'transform="rotate(-90 18 {HEIGHT / 2})"'
        text.append(label(18, HEIGHT / 2, "restoring force [N]", "middle", turned))
        return text


def label(x: float, y: float, text: str, anchor: str, more: str = "", size: int = 12) -> str:
    """One line of text."""
    place = f'x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}" font-size="{size}"'
    return f'<text {place} {FONT} fill="#3c4650" {more}>{text}</text>'


def curve(frame: Frame, x: Array, force: Array, colour: str, width: float) -> str:
    """One loop as a line."""
    across, down = frame.at(x, force)
    points = " ".join(f"{a:.1f},{d:.1f}" for a, d in zip(across, down, strict=True))
    line = 'fill="none" stroke-linejoin="round"'
    return f'<polyline points="{points}" {line} stroke="{colour}" stroke-width="{width}"/>'


def picture(found: Diagnosis) -> str:
    """The whole SVG."""
    trace = max(found.traces, key=lambda t: float(np.max(np.abs(t.x))))
    part = widest(trace)
    x, force = 1e3 * trace.x[part], trace.R[part]
    forces = (force, force - trace.residual[part], force - trace.left[part])
    frame = Frame(x, np.concatenate(forces))
    lines = [f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {HEIGHT}" role="img">']
    lines += [f"<title>{found.headline}</title>", f'<rect width="{WIDTH}" height="{HEIGHT}" fill="#ffffff"/>']
    named = " and ".join(f.effect.replace("_", " ") for f in found.findings) or "nothing"
    before, after = (100 * error for error in found.force_nrmse)
    head = f"Named: {named}. Force error {before:.3g} % with stick-slip alone, {after:.2g} % with it"
    lines += [label(LEFT, 24, head, "start", 'font-weight="600"', 14), *frame.axes()]
    for i, ((name, colour), values) in enumerate(zip(COLOURS.items(), forces, strict=True)):
        lines.append(curve(frame, x, values, colour, 4.0 if i == 0 else 1.8))
        across = LEFT + 170 * i
        lines.append(f'<path d="M{across} 46h22" stroke="{colour}" stroke-width="{4 if i == 0 else 2}"/>')
        lines.append(label(across + 28, 50, name, "start"))
    return "\n".join([*lines, "</svg>"]) + "\n"


def main(arguments: Sequence[str] | None = None) -> int:
    """Command line."""
    parser = argparse.ArgumentParser(description="Draw the loops of the lab case.")
    parser.add_argument("-o", dest="out", type=Path, default=Path("docs/lab-case.svg"))
    out = parser.parse_args(arguments).out
    found = diagnose(record()[0], model=BELIEVED, parameters=NOMINAL)
    write_text(out, picture(found))
    print(f"{found.sentence()}\n{out}")
    return 0 if found.findings else 1


if __name__ == "__main__":
    raise SystemExit(main())
