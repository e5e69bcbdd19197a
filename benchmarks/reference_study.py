"""The reference study on the simulated stick-slip oscillator: structures, mass, noise, amplitude.

    python benchmarks/reference_study.py OUT [laws grid mass accuracy noise amplitude] [--workers N]

Prints the tables of docs/reference-study.md. grid and mass can be stopped and started again on the same OUT.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path

import numpy as np
import oracle

from hystid import study
from hystid.comparison import harmonics
from hystid.identification import Identification, identify
from hystid.recording import Recording


def laws(out: Path, workers: int | None) -> None:
    """Harmonics of R under a 20 Hz force: stick-slip and Bouc-Wen have odd ones only."""
    dt, t = 1e-4, np.arange(40_000) * 1e-4
    print("\n## Harmonics of R at 20 Hz, dB re the fundamental (last 2 s of 4 s)\n")
    print("| law | " + " | ".join(str(k) for k in range(2, 10)) + " |\n|" + "---|" * 9)
    for name, newtons, parameters in (
        ("stick-slip, 80 N", 80, oracle.JENKINS),
        ("Bouc-Wen, 40 N", 40, oracle.BOUC_WEN),
    ):
        R = oracle.simulate(name, newtons * np.sin(2 * np.pi * 20 * t), dt, parameters).R[20_000:]
        level = 20 * np.log10(harmonics(R, dt, 20.0, count=9).amplitude)
        print(f"| {name} | " + " | ".join(f"{level[k] - level[0]:.0f}" for k in range(1, 9)) + " |")


def grid(out: Path, workers: int | None) -> None:
    begin = time.process_time()
    result = study.grid(
        list(oracle.chirps()),
        mass=1.0,
        holdout=list(oracle.harmonics(duration=1.0)),
        iterations=80,
        workers=workers,
        out=out / "grid",
    )
    print(f"\n## Structures ({time.process_time() - begin:.0f} s of processor time in this run)\n")
    print("| layers | weights | force NRMSE best / lower / median / upper / worst | ensemble | single "
          "| free-run x NRMSE best / lower / median / upper / worst | ensemble | single |")  # fmt: skip
    print("|---|---|---|---|---|---|---|---|")
    for cell in result.cells:
        print(f"| {cell.name} | {cell.parameters} | {row(cell.force)} | {cell.ensemble['force_nrmse']:.4f} "
              f"| {cell.single['force_nrmse']:.4f} | {row(cell.free_run)} | {cell.ensemble['x_nrmse']:.4f} "
              f"| {cell.single['x_nrmse']:.4f} |")  # fmt: skip
    print(f"\nChosen: {result.reason}")


def row(spread: study.Spread) -> str:
    levels = (spread.best, spread.lower, spread.median, spread.upper, spread.worst)
    return " / ".join("diverged" if np.isinf(level) else f"{level:.4f}" for level in levels)


def mass(out: Path, workers: int | None) -> None:
    result = study.mass(
        list(oracle.chirps()), mass=1.0, holdout=list(oracle.harmonics(duration=1.0)), starts=6, workers=workers,
        iterations=50, out=out / "mass",
    )  # fmt: skip
    print("\n## Mass (median free-run x NRMSE over six starts; ensemble is the best of six)\n")
    print("| layers | " + " | ".join(f"{100 * offset:+.0f} %" for offset in result.offsets) + " |")
    print("|" + "---|" * (len(result.offsets) + 1))
    for size in (2, 5, 8, 10, 13):
        cells = result.row((size, size))
        print(f"| {size}-{size} | " + " | ".join(f"{cell.free_run.median:.3f}" for cell in cells) + " |")


def held_out(result: Identification, names: str) -> list[np.ndarray]:
    """Force and free-run errors, rows: held-out recordings of such names, of the refined and the published model."""
    rows = [[(p.force_nrmse, p.x_nrmse or np.nan) for p in (c.network, c.published)]
            for c in result.comparisons if c.role == "holdout" and c.recording.name.endswith(names)]  # fmt: skip
    return list(np.array(rows).transpose(1, 0, 2))


def line(label: str, result: Identification, names: str = "") -> None:
    cells = [f"{np.median(e[:, 0]):.4f} / {e[:, 0].max():.4f} | {np.median(e[:, 1]):.4f} / {e[:, 1].max():.4f}"
             for e in held_out(result, names)]  # fmt: skip
    print(f"| {label} | {' | '.join(cells)} |", flush=True)


HEAD = ("| {} | refined: force median / worst | free-run x median / worst | published: force median / worst "
        "| free-run x median / worst |\n|---|---|---|---|---|")  # fmt: skip


def accuracy(out: Path, workers: int | None) -> None:
    print("\n## Accuracy, eight harmonic cases, three seeds of noise and starts\n")
    print(HEAD.format("seed"))
    for seed in (1, 2, 3):
        result = identify(
            list(oracle.chirps(seed=seed)), mass=1.0, holdout=list(oracle.harmonics()), seed=seed, workers=workers
        )
        line(str(seed), result)
    print("\nOdd harmonics of R in steady state, free run, dB from the reference (first is the fundamental):\n")
    for c in result.comparisons:
        if c.role == "holdout":
            print(f"- {c.recording.name}: {odd_harmonics(c.recording, c.network.free_run['R'])}")


def odd_harmonics(recording: Recording, force: np.ndarray) -> str:
    """Level differences of the odd harmonics 1 to 9 that stand above -60 dB of the fundamental in the reference."""
    frequency = float(recording.name.split("_")[1].removesuffix("Hz"))
    half = len(recording) // 2
    reference, model = (harmonics(values[half:], recording.dt, frequency, count=9) for values in (recording.R, force))
    levels = [20 * np.log10(np.abs(h.amplitude)) for h in (reference, model)]
    kept = [k for k in range(0, 9, 2) if levels[0][k] > levels[0][0] - 60]
    return ", ".join(f"{k + 1}: {levels[1][k] - levels[0][k]:+.2f}" for k in kept)


def noise(out: Path, workers: int | None) -> None:
    print("\n## Noise ladder\n\n" + HEAD.format("SNR [dB]"))
    for snr in (50, 40, 34, 28, 20):
        line(str(snr), identify(list(oracle.chirps(snr)), mass=1.0, holdout=list(oracle.harmonics()), workers=workers))


def amplitude(out: Path, workers: int | None) -> None:
    print("\n## Amplitude: trained to 60 N\n\n" + HEAD.format("tested on"))
    train = list(oracle.chirps(amplitudes=(15, 30, 45, 60)))
    tested = (60, 75, 90, 105)
    held = list(oracle.harmonics(duration=1.0, amplitudes=tested))
    result = identify(train, mass=1.0, holdout=held, workers=workers)
    for newtons in tested:
        line(f"{newtons} N harmonics", result, f"_{newtons}N")


if __name__ == "__main__":
    arguments = sys.argv[1:]
    count = None
    if "--workers" in arguments:
        at = arguments.index("--workers")
        count = int(arguments[at + 1])
        del arguments[at : at + 2]
    parts = {"laws": laws, "grid": grid, "mass": mass, "accuracy": accuracy, "noise": noise, "amplitude": amplitude}
    for name in arguments[1:] or parts:
        parts[name](Path(arguments[0]), count)
