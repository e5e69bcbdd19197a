"""An outsider's look at the answers: ``extended.fmu`` in FMPy, on the held-out test, against the error that is claimed.

``python -m benchmarks.concealed.verify DECK`` lists every answered case with a finding: before, after as claimed, after
as FMPy finds it. A channel delay is no part of the extended model: there the two differ by its effect.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.interpolate import CubicSpline

OVERSAMPLING = 8


@dataclass(frozen=True)
class Check:
    """Free-run NRMSE of x on the held-out test: refitted baseline, extended model as claimed, and as found by FMPy."""

    case: str
    before: float
    claimed: float
    found: float


def extended_error(fmu: Path, holdout: Path) -> float:
    """NRMSE of x of a co-simulation FMU (F in, x out) under the recorded force, band-limited between samples."""
    from fmpy import simulate_fmu

    with holdout.open(encoding="utf-8") as text:
        names = [title.split()[0] for title in text.readline().split(",")]
        data = dict(zip(names, np.loadtxt(text, delimiter=",").T, strict=True))
    t = data["t"]
    fine = np.linspace(t[0], t[-1], (len(t) - 1) * OVERSAMPLING + 1)
    forces = CubicSpline(t, data["F"])(fine)
    table = np.array(list(zip(fine, forces, strict=True)), dtype=[("time", np.float64), ("F", np.float64)])
    found = simulate_fmu(
        str(fmu),
        start_time=0.0,
        stop_time=float(t[-1]),
        input=table,
        output=["x"],
        output_interval=float(fine[1]),
        start_values={"x_start": float(data["x"][0])},
        fmi_type="CoSimulation",
    )
    x = np.interp(t, found["time"], found["x"])
    return float(np.sqrt(np.mean((x - data["x"]) ** 2)) / np.std(data["x"]))


def checks(deck: Path) -> Iterator[Check]:
    """Every answer of a scored deck that named something."""
    for answer in sorted((deck / "answers").glob("case_*/diagnosis.json")):
        told = json.loads(answer.read_text(encoding="utf-8"))
        held = (told["fit"].get("holdout") or [{}])[0]
        if told["findings"] and held.get("after") is not None:
            name = answer.parent.name
            found = extended_error(answer.with_name("extended.fmu"), deck / name / "holdout.csv")
            yield Check(name, held["before"], held["after"], found)


def main(arguments: Sequence[str] | None = None) -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description="Check claimed held-out errors in FMPy.")
    parser.add_argument("deck", type=Path)
    for check in checks(parser.parse_args(arguments).deck):
        print(f"{check.case} before {check.before:.4f} claimed {check.claimed:.4f} found {check.found:.4f}")


if __name__ == "__main__":
    main()
