"""Examples of the MSL whose published results are too large to be had everywhere, against integrations of their own.

Run ``python -m benchmarks.msl_unpublished FOLDER``, where FOLDER holds the library as for ``benchmarks.msl``. The
equations of each example are written again by hand from the texts of its components, and integrated by scipy: nothing
is shared with the compiler. Dry friction and the one-way clutch are steep smooth laws here, where the library has
modes: the steeper they are, the nearer the two must come.
"""

from __future__ import annotations

import argparse
import itertools
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt
from scipy.integrate import solve_ivp

from hystid.compiled import CompiledModel
from hystid.modelica import compile_model

Array = npt.NDArray[np.float64]
SMOOTHED = (1e-5, 1e-6, 1e-7)  # speed at which dry friction has three quarters of its full torque [rad/s]
_EXAMPLES = "Modelica.Mechanics.Rotational.Examples", "Modelica.Thermal.HeatTransfer.Examples"


def heat_losses(t: Array, smoothed: float) -> Mapping[str, Array]:
    """Continuous signals of Rotational.Examples.HeatLosses that the library compares, at times t (n,) [s]."""

    def sign(w: float) -> float:
        return float(np.tanh(w / smoothed))

    def backlash(d: float, w: float) -> float:
        if abs(d) <= 5e-4:
            return 0.0
        side = 1.0 if d > 0 else -1.0
        spring, damper = 1e5 * (abs(d) - 5e-4), 100 * side * w
        return side * (spring + min(spring, damper)) if spring + damper > 0 else 0.0

    def gear(w: float, out: float) -> float:
        """Torque on the shaft that drives: half of what leaves, and the losses, by the side that drives."""
        share, friction, half = 0.8 - 0.1 * abs(w), 1 + abs(w), -out / 2
        rolling = []
        for side in (1, -1):
            x = side * half + friction
            rolling.append(side * (x / share if x >= 0 else share * x))
        part = (1 + sign(w)) / 2
        return part * rolling[0] + (1 - part) * rolling[1]

    def slopes(now: float, s: Array) -> Array:
        phi, w = s[0::2], s[1::2]
        pressed = np.sin(2 * np.pi * 0.2 * now)
        shaft = 1e4 * (phi[1] - phi[0]) + 20 * (w[1] - w[0])
        contact = backlash(phi[2] - phi[1], w[2] - w[1])
        spring = 1e4 * (phi[3] - phi[2])
        clutch = 5 * pressed * sign(w[4] - w[3] / 2)
        ahead = w[5] - w[4]
        one_way = 0.5 * pressed * sign(ahead) + min(ahead, 0.0) * 5 / smoothed
        torques = (
            20 * np.sin(2 * np.pi * 5 * now) - 10 * w[0] + shaft, contact - shaft, spring - contact - sign(w[2]),
            -spring - gear(w[3], clutch), one_way - clutch, -one_way - pressed * sign(w[5]),
        )  # fmt: skip
        made = np.empty(12)
        made[0::2], made[1::2] = w, np.array(torques) / 2
        return made

    phi, w = _integrated(slopes, t, np.zeros(12), 2e-3).reshape(6, 2, -1).transpose(1, 0, 2)
    pairs: Mapping[str, Callable[[Array], Array]] = {
        "clutch.{}_rel": lambda q: q[4] - q[3] / 2,
        "damper.{}_rel": lambda q: q[0],
        "elastoBacklash.{}_rel": lambda q: q[2] - q[1],
        "inertia5.{}": lambda q: q[4],
        "oneWayClutch.{}_rel": lambda q: q[5] - q[4],
        "springDamper.{}_rel": lambda q: q[1] - q[0],
    }
    return {n.format(kind): of(q) for n, of in pairs.items() for kind, q in (("phi", phi), ("w", w))}


def motor(t: Array, _: float) -> Mapping[str, Array]:
    """Temperatures of HeatTransfer.Examples.Motor at times t (n,) [s]; the losses jump at 360 s and 600 s of each ten
    minutes."""
    ambient = 293.15

    def slopes(losses: float) -> Callable[[float, Array], Array]:
        def made(_: float, temperature: Array) -> Array:
            winding, core = temperature
            heat = losses * (1 + 3.03e-3 * (winding - 368.15))
            across = 10 * (winding - core)
            return np.array([(heat - across) / 2500, (500 + across - 25 * (core - ambient)) / 25000])

        return made

    found, last = [], np.full(2, ambient)
    corners = sorted({t[0], t[-1], *(c for k in range(20) for c in (600.0 * k, 600.0 * k + 360) if t[0] < c < t[-1])})
    for begin, end in itertools.pairwise(corners):
        inside = np.append(t[(t >= begin) & (t < end)], end)
        values = _integrated(slopes(1000.0 if (begin + end) / 2 % 600 > 360 else 100.0), inside, last, 1.0)
        found.append(values[:, :-1])
        last = values[:, -1]
    joined = np.concatenate([*found, last[:, None]], axis=1)
    return {"winding.T": joined[0], "core.T": joined[1]}


def _integrated(slopes: Callable[[float, Array], Array], t: Array, start: Array, longest: float) -> Array:
    """States (states, n) at times t (n,)."""
    run = solve_ivp(
        slopes, (float(t[0]), float(t[-1])), start, method="Radau", t_eval=t, rtol=1e-8, atol=1e-10, max_step=longest
    )
    assert run.success, run.message
    states: Array = run.y
    return states


def deviations(
    name: str, own: Callable[[Array, float], Mapping[str, Array]], t: Array, folder: Path
) -> list[tuple[float, float, str]]:
    """For each speed of ``SMOOTHED``: it, the largest deviation in parts of a signal's range, and that signal."""
    model = CompiledModel(compile_model(name, libraries=[folder]))
    found = []
    for smoothed in SMOOTHED:
        wanted = own(t, smoothed)
        got = model.simulate({}, float(t[1] - t[0]), rows=len(t), outputs=list(wanted), substeps=10)
        worst = max((float(np.abs(got[n] - wanted[n]).max() / np.ptp(wanted[n])), n) for n in wanted)
        found.append((smoothed, *worst))
    return found


def main(arguments: Sequence[str] | None = None) -> None:
    """Prints a line per example and steepness."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("folder", type=Path, help="folder with Modelica, Complex.mo and ModelicaServices")
    folder = parser.parse_args(arguments).folder
    examples = (
        (f"{_EXAMPLES[0]}.HeatLosses", heat_losses, np.linspace(0, 1, 1001)),
        (f"{_EXAMPLES[1]}.Motor", motor, np.linspace(0, 7200, 7201)),
    )
    for name, own, t in examples:
        for smoothed, worst, signal in deviations(name, own, t, folder):
            print(f"{name}: {worst:.1e} ({signal}), friction smoothed over {smoothed:g} rad/s", flush=True)


if __name__ == "__main__":
    main()
