"""An outsider's look at an answer: its ``extended.fmu`` in FMPy, on the held-out test, against the error it claims."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from scipy.interpolate import CubicSpline

OVERSAMPLING = 8


def extended_error(fmu: Path, holdout: Path) -> float:
    """NRMSE of x of a co-simulation FMU (F in, x out) under the recorded force, band-limited between samples."""
    from fmpy import simulate_fmu

    with holdout.open(encoding="utf-8") as text:
        names = [title.split()[0] for title in text.readline().split(",")]
        data = dict(zip(names, np.loadtxt(text, delimiter=",").T, strict=True))
    t = data["t"]
    n = (len(t) - 1) * OVERSAMPLING + 1
    fine = np.linspace(t[0], t[-1], n)
    table = np.array(
        list(zip(fine, CubicSpline(t, data["F"])(fine), strict=True)), dtype=[("time", np.float64), ("F", np.float64)]
    )
    step = float(fine[1])
    found = simulate_fmu(
        str(fmu), start_time=0.0, stop_time=float(t[-1]), input=table, output=["x"], output_interval=step,
        start_values={"x_start": float(data["x"][0])}, fmi_type="CoSimulation",
    )  # fmt: skip
    x = np.interp(t, found["time"], found["x"])
    return float(np.sqrt(np.mean((x - data["x"]) ** 2)) / np.std(data["x"]))
