"""Devices with further inputs: force on recordings that were not trained on, beside a linear fit and the marks.

    python benchmarks/devices.py [CASE ...] [--data DATA] [--starts N] [--seed S] [--model RIG]

CASE: any of those that ``--list`` prints; all by default. Every case states what is trained on and what is held out;
no model sees a measured force of a held-out recording. Prints one row per held-out recording: NRMSE of the force and,
where there is a mass, of the displacement in free run; the linear fit beside it; the mark that we want to reach; the
share of the samples within the 90 % band, of those within the training range; rms error over rms force F, as the
authors of EMPS count it; wall time and processor time. With --model, those of the law in RIG plus networks.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hystid.identification import identify
from hystid.identification.hybrid.result import HybridComparison
from hystid.networks import TwoNetworkModel
from hystid.networks.trust import BAND
from hystid.recording import Recording, read, with_column

DATA = Path(__file__).parents[1].parent / "shared" / "data"


@dataclass(frozen=True)
class Case:
    """train, unseen: recordings; mark: NRMSE of the force that is wanted; settings: arguments of ``identify``."""

    train: Sequence[Recording]
    unseen: Sequence[Recording]
    mark: float | None
    settings: dict[str, Any]


def thinned(recording: Recording, start: int = 0, stop: int | None = None, every: int = 1, name: str = "") -> Recording:
    """Every so many samples from start to stop, further columns too."""
    rows = slice(start, stop, every)
    cut = {c: getattr(recording, c) for c in ("F", "x", "v", "a", "R")}
    cut = {c: None if values is None else values[rows] for c, values in cut.items()}
    extra = {c: values[rows] for c, values in recording.extra.items()}
    t = recording.t[rows] - recording.t[start]
    return replace(recording, name=name or recording.name, t=t, extra=extra, **cut)


def dyke(data: Path) -> Case:
    whole = read(data / "mr_damper_dyke" / "mr_damper_dyke_ranran50.csv")
    middle = len(whole) // 2
    first, second = thinned(whole, 0, middle, 4, "first half"), thinned(whole, middle, None, 4, "second half")
    return Case([first], [second], 0.10, {"inputs": ["u_mr"], "layers": (8, 8)})  # rich in motion and voltage


def utfsm(data: Path, train: Sequence[str], unseen: Sequence[str]) -> Case:
    def one(name: str) -> Recording:
        current = float(name.split("_")[1].rstrip("A").replace("p", "."))
        return with_column(read(data / "mr_damper_utfsm" / f"mr_{name}.csv"), "current", current, "A")

    if unseen:
        return Case([one(n) for n in train], [one(n) for n in unseen], 0.10, {"inputs": ["current"]})
    parts = [(r, len(r) // 2) for r in map(one, train)]
    first = [thinned(r, 0, middle, 1, f"{r.name}, first half") for r, middle in parts]
    second = [thinned(r, middle, None, 1, f"{r.name}, second half") for r, middle in parts]
    return Case(first, second, 0.10, {"inputs": ["current"]})


def pneumatic(data: Path, train: Sequence[int], unseen: int) -> Case:
    def one(bar: int) -> Recording:
        return read(data / "pneumatic_cylinder_friction" / f"pneumatic_Circle_{bar}bar.csv")

    return Case([one(bar) for bar in train], [one(unseen)], 0.12, {"inputs": ["p"]})


def brfd(data: Path, train: Sequence[str], unseen: Sequence[str]) -> Case:
    def one(name: str) -> Recording:
        file = data / "brfd_friction_backlash" / f"brfd{name}.csv"
        tension = float(name.split("Hz")[1].split("lb")[0])
        return with_column(thinned(read(file), every=4), "tension", tension, "lbf")

    return Case([one(n) for n in train], [one(n) for n in unseen], 0.15, {"inputs": ["tension"]})


def emps(data: Path) -> Case:
    folder = data / "emps"
    train, pulses = read(folder / "emps_estimation.csv"), read(folder / "emps_validation_pulses.csv")
    settings = {"mass": 95.1, "layers": (5, 5), "band": (None, 100.0), "decimate": 10, "samples": 20_000}
    return Case([train], [pulses], None, settings)


_2022 = [f"2022_0.5Hz{lb}lbtension" for lb in (20, 35, 80)]
CASES: dict[str, Callable[[Path], Case]] = {
    "dyke": dyke,
    "utfsm": lambda data: utfsm(data, ["10mm2Hz_0A", "10mm2Hz_1A"], ["10mm2Hz_0p5A"]),
    "utfsm_halves": lambda data: utfsm(data, ["10mm2Hz_0A", "10mm2Hz_0p5A", "10mm2Hz_1A"], []),
    "pneumatic_157": lambda data: pneumatic(data, (1, 5, 7), 3),
    "pneumatic_15": lambda data: pneumatic(data, (1, 5), 3),
    "brfd_1Hz": lambda data: brfd(data, _2022, [name.replace("0.5Hz", "1Hz") for name in _2022]),
    "brfd_35": lambda data: brfd(data, [_2022[0], _2022[2], "2023_0.5Hz30lbtension1amplitude"], [_2022[1]]),
    "brfd_35_of_two": lambda data: brfd(data, [_2022[0], _2022[2]], [_2022[1]]),
    "emps": emps,
}


def covered(model: TwoNetworkModel, recording: Recording) -> NDArray[np.bool_]:
    """Which samples lie within the training range of the motion and the further inputs, shape (n,)."""
    columns = {"x": "x", "v": "v"} | {port.name: port.column for port in model.inputs}
    inside = np.ones(len(recording), bool)
    for name, column in columns.items():
        low, high = model.training_range[name]
        values = recording.channel(column)
        inside &= (low <= values) & (values <= high)
    return inside


def rows(name: str, case: Case, starts: int, seed: int, model: str | None) -> None:
    """Identify and print a row per held-out recording."""
    settings: dict[str, Any] = {"mass": 0.0, "layers": (5, 5)} | case.settings
    begin, used = time.perf_counter(), time.process_time()
    found = identify(case.train, holdout=case.unseen, ensemble=starts, seed=seed, model=model, **settings)
    spent = f"{time.perf_counter() - begin:.0f} ({time.process_time() - used:.0f})"
    lags = ", ".join(f"{lag.source} {1e3 * lag.time:.3g} ms" for lag in found.model.lags) or "none"
    pairs = found.hybrid.pairs if found.hybrid else found.comparisons
    for item, pair in zip(found.comparisons, pairs, strict=True):
        if item.role != "holdout":
            continue
        answer = pair.hybrid if isinstance(pair, HybridComparison) else pair.network
        run = answer.x_nrmse
        force = f"{answer.force_nrmse:.3f}" + (f", {run:.3f}" if run is not None else "")
        mark = "-" if case.mark is None else f"{case.mark:.2f}"
        R, here = item.recording.channel("R"), covered(found.model, item.recording)
        assert answer.spread is not None
        band = np.mean(np.abs(answer.R - R)[here] <= BAND * answer.spread[here])
        whole = np.hypot.reduce(answer.R - R) / np.hypot.reduce(item.recording.channel("F"))
        linear = item.linear.force_nrmse
        print(
            f"| {name} | {item.recording.name} | {force} | {linear:.3f} | {mark} | {band:.2f} | {whole:.3f} | {lags} |"
            f" {spent} |",
            flush=True,
        )


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("cases", nargs="*", metavar="CASE")
    parser.add_argument("--data", type=Path, default=DATA)
    parser.add_argument("--starts", type=int, default=30, help="trainings per case")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--model", metavar="RIG", help="physics beside the networks, as of hystid identify")
    parser.add_argument("--list", action="store_true", help="name the cases")
    given = parser.parse_args()
    if given.list:
        print("\n".join(CASES))
        return
    print("| case | held out | NRMSE | linear | mark | in the 90 % band | of rms F | lags | s (processor s) |")
    print("|---|---|---|---|---|---|---|---|---|")
    for name in given.cases or CASES:
        rows(name, CASES[name](given.data), given.starts, given.seed, given.model)


if __name__ == "__main__":
    main()
