"""What the generator knows and a diagnosis cannot: what a refit leaves of the effect, and how well the truth predicts.

Rule, stated before any diagnosis was scored: a case counts as identifiable when the noise-free mismatch that is left
after refitting the baseline exceeds that of the true structure by at least ``LEAST_MISMATCH`` in units of the noise of
F - m a (root mean square over all samples, each recording weighted by its noise).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.optimize import least_squares

from benchmarks.concealed.baselines import Baseline, rig_of
from benchmarks.concealed.chain import Taken
from benchmarks.concealed.rig import Array, Diverged, Element, Rig, clamp, run

LEAST_MISMATCH = 0.3
MASS_AND_LINEAR = ("m", "B", "Kl")
OVERSAMPLING = 8


@dataclass(frozen=True)
class Mismatch:
    """refit: parameters that hide the effect best; before, truth: root mean square residuals in noise units."""

    refit: dict[str, float]
    before: float
    truth: float

    @property
    def visible(self) -> float:
        """What the refit leaves beyond the true structure, in noise units."""
        return float(np.sqrt(max(0.0, self.before**2 - self.truth**2)))


def mismatch(baseline: Baseline, rig: Rig, taken: Sequence[Taken], mass: float) -> Mismatch:
    """Refit the baseline to the noise-free channels with the mass fixed, and compare with the true structure."""
    dt = float(taken[0].t[1])
    weights = [1 / np.hypot(r.noise["F"], mass * r.noise["a"]) for r in taken]
    fitted, left = refit(baseline, [r.clean for r in taken], weights, mass, dt)
    truth = np.concatenate([w * _truth_residual(rig, r, dt) for r, w in zip(taken, weights, strict=True)])
    return Mismatch(fitted, _rms(left), _rms(truth))


def _truth_residual(rig: Rig, r: Taken, dt: float) -> Array:
    law, each = clamp(rig.elements, r.true["x"], r.true["v"], r.true["a"], dt, substeps=4)
    concealed = sum((row for row, e in zip(each, rig.elements, strict=True) if e.concealed), np.zeros_like(law))
    return np.asarray(r.true["F"] - rig.m * r.true["a"] - rig.B * r.true["v"] - rig.Kl * r.true["x"] - law - concealed)


def refit(
    baseline: Baseline, data: Sequence[Mapping[str, Array]], weights: Sequence[float], mass: float, dt: float
) -> tuple[dict[str, float], Array]:
    """Least squares of F - m a over the free parameters, started at the baseline's: (parameters, weighted residual).

    data: channels x, v, a, F of each recording. B and Kl are linear and projected out; the others are searched by
    logarithm.
    """
    names = [name for name in baseline.parameters if name not in MASS_AND_LINEAR]
    target = np.concatenate([w * (c["F"] - mass * c["a"]) for c, w in zip(data, weights, strict=True)])
    columns = np.concatenate([w * np.column_stack([c["v"], c["x"]]) for c, w in zip(data, weights, strict=True)])

    def project(logs: Array) -> tuple[Array, Array]:
        elements = _elements(baseline, names, logs)
        laws = (
            [clamp(elements, c["x"], c["v"], c["a"], dt)[0] for c in data]
            if names
            else [np.zeros_like(c["x"]) for c in data]
        )
        rest = target - np.concatenate([w * h for h, w in zip(laws, weights, strict=True)])
        rest = np.nan_to_num(rest, nan=1e6, posinf=1e6, neginf=-1e6)
        linear = np.linalg.lstsq(columns, rest, rcond=None)[0]
        return linear, rest - columns @ linear

    def left(logs: Array) -> Array:
        return project(logs)[1]

    start = np.log([baseline.parameters[name] for name in names])
    logs = start
    if names:
        logs = least_squares(left, start, bounds=(start - 2, start + 2), x_scale=0.1, max_nfev=25, diff_step=[1e-4]).x
    linear, rest = project(logs)
    fitted = {"m": mass, "B": float(linear[0]), "Kl": float(linear[1])}
    return fitted | {name: float(np.exp(u)) for name, u in zip(names, logs, strict=True)}, rest


def _elements(baseline: Baseline, names: list[str], logs: Array) -> tuple[Element, ...]:
    p = baseline.parameters | {name: float(np.exp(u)) for name, u in zip(names, logs, strict=True)}
    return rig_of(baseline.family, p, baseline.scale.V).elements


def free_run_error(rig: Rig, recording: Taken, gain: float = 1.0) -> float | None:
    """NRMSE of x in a free run under the measured force, None where the run diverges.

    The force is taken as band-limited (cubic spline); the run starts from the recording's first noise-free state.
    """
    q, t = OVERSAMPLING, recording.t
    n = (len(t) - 1) * q
    fine = CubicSpline(t, recording.measured["F"] / gain)(np.linspace(0, t[-1], 2 * n + 1))
    try:
        x = run(rig, fine, t[-1] / n, (recording.true["x"][0], recording.true["v"][0])).x[::q]
    except Diverged:
        return None
    error = _rms(x - recording.measured["x"]) / float(np.std(recording.measured["x"]))
    return error if error < 10 else None


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))
