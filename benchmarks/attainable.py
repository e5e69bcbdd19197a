"""How near a model could come to an unseen recording: what the recordings of a device share with each other.

    python benchmarks/attainable.py [CASE ...] [--data DATA]

Every figure is an rms over the standard deviation of the held-out force, as the NRMSE of ``devices.py`` is. No model is
trained; all but the last two use the held-out force itself, so that no model can do as well by knowing less.

- own loop: strokes over 90 % of the range and more, from their own mean loop, a curve over x either way, beside
  the further inputs that vary within it. What is left differs from cycle to cycle of one test.
- mixture: the same from the mixture of the mean loops of all trained recordings, beside the same columns, a constant
  and friction, that suits it best.
- same path: the mean loop against that of the trained recording at the same inputs.
- zero: how far the mean of both directions is from the straight line of the trained recordings over the input.
- passes: the force on passes through the middle of the stroke, against that of the trained passes of the same input and
  direction at the same speed, whatever their stroke.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmarks.devices import CASES, DATA, Case
from hystid.identification.methods import Recipe
from hystid.numeric import Array
from hystid.recording import Recording

_KNOTS = 60
_FULL = 0.9  # of the range of x: strokes that compare
NONE = float("nan")
_FAST = 0.5  # of the median speed: slower samples are at a reversal, where the force is on neither branch


@dataclass(frozen=True, eq=False)
class Loop:
    """Mean force over x [m] in either direction [N], shape (knots,) each, of one recording."""

    at: Array
    back: Array
    forth: Array

    def __call__(self, recording: Recording) -> Array:
        """The loop along another motion, shape (n,)."""
        x, v = recording.channel("x"), recording.channel("v")
        return np.where(v > 0, np.interp(x, self.at, self.forth), np.interp(x, self.at, self.back))


def beside(recording: Recording, inputs: Sequence[str]) -> list[Array]:
    """The further inputs that vary, without their means."""
    columns = [recording.channel(name) for name in inputs]
    return [values - values.mean() for values in columns if np.ptp(values)]


def fitted(columns: Sequence[Array], R: Array) -> tuple[Array, Array]:
    """Least squares of R on columns: coefficients and what is left."""
    table = np.stack(columns, axis=1)
    scale = np.abs(table).max(axis=0)
    scale[scale == 0] = 1.0
    found = np.linalg.lstsq(table / scale, R, rcond=None)[0] / scale
    return found, R - table @ found


def full(recording: Recording) -> Recording:
    """The strokes over nearly the whole range of x, one after the other."""
    x = recording.channel("x")
    ends, way = (
        [0],
        0,
    )  # the last is where x was farthest on its present way; it has turned when a tenth of the range back
    for k, value in enumerate(x):
        if way == 0 or way * (value - x[ends[-1]]) > 0:
            way, ends[-1] = way or int(np.sign(value - x[0])), k
        elif abs(value - x[ends[-1]]) > (1 - _FULL) * np.ptp(x):
            way, ends = -way, [*ends, k]
    strokes = [range(a, b) for a, b in pairwise(ends) if np.ptp(x[a:b]) > _FULL * np.ptp(x)]
    return picked(recording, np.concatenate([np.array(stroke) for stroke in strokes]))


def loop_of(recording: Recording, inputs: Sequence[str]) -> tuple[Loop, Array]:
    """The mean loop of a recording, and what it leaves of R [N]."""
    x, v, R = (recording.channel(name) for name in "xvR")
    at = np.unique(np.quantile(x, np.linspace(0.0, 1.0, _KNOTS)))  # a force in each direction near every one of them
    hats = [np.interp(x, at, row) for row in np.eye(len(at))]
    sides = [hat * side for side in (v <= 0, v > 0) for hat in hats]
    found, left = fitted([*sides, *beside(recording, inputs)], R)
    return Loop(at, found[: len(at)], found[len(at) : 2 * len(at)]), left


def zero_of(recording: Recording) -> float:
    """Mean of the median forces in either direction [N]."""
    v, R = recording.channel("v"), recording.channel("R")
    fast = np.abs(v) > _FAST * np.median(np.abs(v))
    return float(np.median(R[fast & (v > 0)]) + np.median(R[fast & (v < 0)])) / 2


def zero_gap(train: Sequence[Recording], held: Recording, inputs: Sequence[str]) -> float:
    """Zero of a recording less the straight line over the first input through those of the others [N]."""
    at = [float(np.mean(recording.channel(inputs[0]))) for recording in (*train, held)]
    zeros = [zero_of(recording) for recording in (*train, held)]
    return zeros[-1] - float(np.polyval(np.polyfit(at[:-1], zeros[:-1], 1), at[-1]))


def alike(train: Sequence[Recording], held: Recording, inputs: Sequence[str]) -> list[int]:
    """Which of the trained recordings have the further inputs of the held-out one, to 2 % in the mean."""

    def means(recording: Recording) -> list[float]:
        return [float(np.mean(recording.channel(name))) for name in inputs]

    return [k for k, one in enumerate(train) if np.allclose(means(one), means(held), rtol=0.02)]


def passes(recording: Recording, middle: float) -> Array:
    """Velocity [m/s] and force [N] at each pass of x through the middle, shape (2, passes)."""
    x, v, R = (recording.channel(name) for name in "xvR")
    at = np.flatnonzero((x[1:] - middle) * (x[:-1] - middle) < 0)
    return np.array([v[at], R[at]])


def pass_gap(train: Sequence[Recording], held: Recording, inputs: Sequence[str]) -> float:
    """rms difference of forces at passes through the middle, held out against trained, at equal speed [N]."""
    middle = float(np.mean([held.channel("x").min(), held.channel("x").max()]))
    known = [passes(train[k], middle) for k in alike(train, held, inputs)]
    if not known:
        return NONE
    (v, R), (speeds, forces) = passes(held, middle), np.concatenate(known, axis=1)
    gaps: list[float] = []
    for side in (-1, 1):
        same, mine = side * speeds > 0, side * v > 0
        order = np.argsort(np.abs(speeds[same]))
        if not same.any():
            continue
        expected = np.interp(np.abs(v[mine]), np.abs(speeds[same])[order], forces[same][order])
        low, high = (end(np.abs(speeds[same])) for end in (np.min, np.max))
        inside = (np.abs(v[mine]) >= low) & (np.abs(v[mine]) <= 1.02 * high)
        gaps += list((R[mine] - expected)[inside])
    return float(np.sqrt(np.mean(np.square(gaps)))) if gaps else NONE


def picked(recording: Recording, at: NDArray[np.intp]) -> Recording:
    """Some samples of a recording."""
    columns = {name: recording.channel(name)[at] for name in ("x", "v", "R")}
    extra = {name: values[at] for name, values in recording.extra.items()}
    return Recording(recording.name, np.arange(len(at)) * recording.dt, **columns, extra=extra, units=recording.units)


def rows(name: str, case: Case) -> None:
    """Print a row per held-out recording."""
    recipe = Recipe(
        case.settings.get("band"), case.settings.get("decimate", 1), case.settings.get("mass", 0.0), smoothing=True
    )
    inputs = case.settings.get("inputs", [])
    train, unseen = ([recipe.apply(recording) for recording in group] for group in (case.train, case.unseen))
    loops = [loop_of(full(recording), inputs)[0] for recording in train]
    for held in unseen:
        strokes, size = full(held), float(np.std(held.channel("R")))
        own, left = loop_of(strokes, inputs)
        others = [loop(strokes) for loop in loops]
        motion = [np.sign(strokes.channel("v")), np.ones(len(strokes))]
        mixed = fitted([*others, *beside(strokes, inputs), *motion], strokes.channel("R"))[1]
        same = [others[k] - own(strokes) for k in alike(train, held, inputs)] if inputs else []
        figures = [float(np.sqrt(np.mean(part**2))) for part in (left, mixed, *same[:1])]
        figures += [NONE] * (not same)
        figures.append(zero_gap(train, held, inputs) if len(train) > 1 and inputs and not same else NONE)
        figures.append(pass_gap(train, held, inputs))
        cells = " | ".join("-" if np.isnan(figure) else f"{figure / size:.3f}" for figure in figures)
        print(f"| {name} | {held.name} | {cells} |", flush=True)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("cases", nargs="*", metavar="CASE")
    parser.add_argument("--data", type=Path, default=DATA)
    given = parser.parse_args()
    print("| case | held out | own loop | mixture | same path | zero | passes |")
    print("|---|---|---|---|---|---|---|")
    for name in given.cases or CASES:
        rows(name, CASES[name](given.data))


if __name__ == "__main__":
    main()
