"""Identification on recordings that are not ours: held-out errors beside a linear fit and the published figures.

    python benchmarks/identification_real.py [DATA] [emps brfd mr_damper boucwen boucwen_noisy] [--pictures DIR]

DATA: folder of the shared recordings (default: ../shared/data beside the project). Prints one table per case; DIR gets
loops of measured and modelled force.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import oracle
from pictures import Panel, write
from scipy.signal import resample, resample_poly

from hystid.identification import Comparison, Identification, Prediction, identify
from hystid.recording import Recording, read

DATA = Path(__file__).parents[1].parent / "shared" / "data"


def models(c: Comparison) -> dict[str, Prediction]:
    """The model that identify returned, under the name of its method, and those beside it."""
    if c.published is None:
        return {"published (returned)": c.network, "linear": c.linear}
    return {"refined (returned)": c.network, "published": c.published, "linear": c.linear}


def show(title: str, result: Identification, seconds: float, note: str) -> None:
    """Errors of the returned model, of the published one where another was returned, and of the linear one."""
    names = " / ".join(models(result.comparisons[0]))
    print(f"\n## {title}  ({seconds:.0f} s)\n\n{note}\n")
    print(f"| recording | role | force NRMSE: {names} | free-run x NRMSE |\n|---|---|---|---|")
    for c in result.comparisons:
        force = " / ".join(f"{p.force_nrmse:.4f}" for p in models(c).values())
        free = " / ".join(
            "diverged" if p.diverged else "-" if p.x_nrmse is None else f"{p.x_nrmse:.3g}" for p in models(c).values()
        )
        print(f"| {c.recording.name} | {c.role} | {force} | {free} |", flush=True)


PICTURES: Path | None = None


def loops(name: str, title: str, comparisons: Sequence[Comparison], labels: Sequence[str], over: str = "x") -> None:
    """Picture of R over displacement or velocity, measured and as the models give it on the measured motion."""
    if PICTURES is None:
        return
    panels = []
    for c, label in zip(comparisons, labels, strict=True):
        panel = Panel(label, {"x": "x [mm]", "v": "v [mm/s]"}[over], "R [N]")
        across = 1e3 * c.recording.channel(over)
        panel.line(across, c.recording.R, "measured", "measured")
        panel.line(across, (c.published or c.network).R, "published", "published")
        if c.published is not None:
            panel.line(across, c.network.R, "refined", "refined")
        panels.append(panel)
    write(
        PICTURES / f"identification-{name}.svg",
        title,
        panels,
        min(len(panels), 3),
        (320, 260) if panels[1:] else (480, 300),
    )


def timed(*args, **kwargs) -> tuple[Identification, float]:
    begin = time.perf_counter()
    result = identify(*args, **kwargs)
    return result, time.perf_counter() - begin


def relative_force_error(comparison: Comparison, prediction: Prediction, mass: float) -> float:
    """||F - (m a + R)|| / ||F|| [%], the inverse-model error of the EMPS authors."""
    recording = comparison.recording
    error = recording.F - (mass * recording.a + prediction.R)
    return 100 * float(np.linalg.norm(error) / np.linalg.norm(recording.F))


def emps() -> None:
    folder = DATA / "emps"
    train, pulses = read(folder / "emps_estimation.csv"), read(folder / "emps_validation_pulses.csv")
    result, seconds = timed(
        [train], mass=95.1, layers=(5, 5), holdout=[pulses], band=(None, 100.0), decimate=10, samples=20_000
    )
    show(
        "EMPS, 95.1 kg, pulses record held out",
        result,
        seconds,
        "Low-pass 100 Hz and every 10th sample, as its authors.",
    )
    held = [c for c in result.comparisons if c.role == "holdout"]
    loops("emps", "EMPS, pulses (held out): friction force over velocity", held, ["low-pass 100 Hz, every 10th"], "v")
    print(
        "\nInverse-model force error [%] (authors: 4.08 symmetric, 3.11 asymmetric on the estimation record; "
        "5.98 on pulses):"
    )
    for c in result.comparisons:
        errors = {name: relative_force_error(c, p, 95.1) for name, p in models(c).items()}
        print(f"- {c.recording.name}: " + ", ".join(f"{name} {error:.2f}" for name, error in errors.items()))


def brfd() -> None:
    files = sorted((DATA / "brfd_friction_backlash").glob("*.csv"))
    for names, note in (
        (
            ["brfd2022_0.5Hz35lbtension"],
            "One recording trained on, all others held out (other tensions: other friction levels).",
        ),
        (["brfd2022_0.5Hz35lbtension", "brfd2023_0.5Hz30lbtension1amplitude"], "Two recordings trained on."),
    ):
        records = {path.stem: read(path) for path in files}
        train = [records.pop(name) for name in names]
        result, seconds = timed(train, mass=0.0, layers=(8, 8), holdout=list(records.values()))
        show(f"brfd_friction_backlash, {len(names)} recording(s)", result, seconds, note)
        if len(names) == 1:
            wanted = ("brfd2022_1Hz35lbtension", "brfd2023_0.5Hz30lbtension1amplitude", "brfd2022_0.5Hz20lbtension")
            shown = [next(c for c in result.comparisons if c.recording.name == name) for name in wanted]
            labels = ("1 Hz, 35 lb as trained", "other rig, 30 lb", "20 lb: friction never seen")
            loops("brfd", "Friction with backlash, trained on one record: held-out records", shown, labels)


def mr_damper() -> None:
    records = [read(path) for path in sorted((DATA / "mr_damper_utfpr").glob("*.csv"))]
    held = []
    for train in records:
        count = len(train) // 2
        halves = [part(train, 0, count, "first half"), part(train, count, len(train), "second half")]
        result, seconds = timed(halves[:1], mass=0.0, layers=(5, 5), holdout=halves[1:])
        show(f"mr_damper_utfpr, {train.name}", result, seconds, "First half trained on, second half held out.")
        held.append(result.comparisons[-1])
    loops("mr-damper", "MR damper: second halves, held out", held, [c.recording.name.split(",")[0] for c in held])


def part(recording: Recording, start: int, stop: int, label: str) -> Recording:
    """Samples start to stop - 1 under another name."""
    cut = {name: getattr(recording, name) for name in ("F", "x", "v", "a", "R")}
    cut = {name: None if values is None else values[start:stop] for name, values in cut.items()}
    return replace(recording, name=f"{recording.name}, {label}", t=recording.t[start:stop], extra={}, **cut)


def multisine(rms: float, seed: int, rate: float, seconds: float) -> np.ndarray:
    """Random-phase multisine, 5 to 150 Hz, periodic in 8192 / 750 s, as in the benchmark's own recipe."""
    rng, t = np.random.default_rng(seed), np.arange(round(rate * seconds)) / rate
    lines = np.arange(int(np.ceil(5 * 8192 / 750)), int(150 * 8192 / 750) + 1)
    spectrum = np.zeros(round(rate * 8192 / 750) // 2 + 1, dtype=complex)
    spectrum[lines] = np.exp(2j * np.pi * rng.random(len(lines)))
    period = np.fft.irfft(spectrum)
    return np.resize(period * rms / np.sqrt(np.mean(period**2)), len(t))


def boucwen() -> None:
    rate, factor = 7500.0, 10
    train = [
        oracle.simulate(f"multisine {rms} N rms", multisine(rms, seed, rate, 6.0), 1 / rate, oracle.BOUC_WEN, 4)
        for rms, seed in ((20, 1), (50, 2), (50, 3), (70, 4))
    ]
    t = np.arange(round(6 * rate)) / rate
    train += [
        oracle.simulate(f"chirp {a} N", a * np.sin(2 * np.pi * (20 * t + 5 * t**2)), 1 / rate, oracle.BOUC_WEN, 4)
        for a in (20, 40)
    ]
    result, seconds = timed(train, mass=2.0, layers=(8, 8), samples=60_000)
    show(
        "boucwen_benchmark, 2 kg", result, seconds, "Trained on own simulations at 7500 Hz; tests are official, 750 Hz."
    )
    official_tests(result, rate, factor)


def official_tests(result: Identification, rate: float, factor: int) -> None:
    """Free-run errors on the tests of the Bouc-Wen benchmark, at ``factor`` steps per sample."""
    print("\nFree-run RMSE [m] on the official tests (published, multisine: 1.87e-5 state space, 4.52e-5 dynoNet):")
    for name, periods in (("boucwen_test_multisine", 3), ("boucwen_test_sinesweep", 1)):
        test = read(DATA / "boucwen_benchmark" / f"{name}.csv")
        if periods > 1:
            force = np.tile(resample(test.F, factor * len(test)), periods)
        else:
            force = resample_poly(test.F, factor, 1, window=("kaiser", 12.0))
        run = result.model.free_run(force, 1 / rate)["x"][-factor * len(test) :: factor]
        rmse = float(np.sqrt(np.mean((run - test.x) ** 2)))
        print(f"- {name}: {rmse:.3g} (NRMSE {rmse / np.std(test.x):.3g})")


def boucwen_noisy() -> None:
    """The benchmark's own protocol: force and noisy displacement at 750 Hz, one multisine, nothing else.

    Five periods are averaged, which leaves a noise of 3.4e-6 m. Displacement and velocity are taken up to the highest
    line of the excitation, the acceleration, which is a target only, up to 200 Hz, where noise and response are alike.
    """
    periods, count, factor, rate = 5, 8192, 10, 750.0
    raw = read(DATA / "boucwen_benchmark" / "boucwen_train_multisine_forgione.csv")
    shown = raw.x.reshape(periods, count)
    noise = float(np.sqrt(np.mean(np.var(shown, axis=0, ddof=1))))
    lines = np.fft.rfftfreq(count, 1 / rate)
    force, motion = (np.fft.rfft(rows.reshape(periods, count).mean(axis=0)) for rows in (raw.F, raw.x))

    def finely(spectrum: np.ndarray, highest: float, order: int = 0) -> np.ndarray:
        whole = np.zeros(factor * count // 2 + 1, dtype=complex)
        whole[: len(lines)] = factor * spectrum * (2j * np.pi * lines) ** order * (lines <= highest)
        return np.fft.irfft(whole, factor * count)

    t = np.arange(factor * count) / (factor * rate)
    channels = {"F": finely(force, 375.0), "x": finely(motion, 151.0), "v": finely(motion, 151.0, 1)}
    train = Recording("multisine 50 N rms, noisy, 750 Hz", t, **channels, a=finely(motion, 200.0, 2))
    result, seconds = timed([train], mass=2.0, layers=(8, 8), samples=40_000)
    show("boucwen_benchmark, noisy, 750 Hz", result, seconds, f"Noise of the displacement: {noise:.3g} m.")
    official_tests(result, factor * rate, factor)


if __name__ == "__main__":
    arguments = sys.argv[1:]
    if "--pictures" in arguments:
        at = arguments.index("--pictures")
        PICTURES = Path(arguments[at + 1])
        del arguments[at : at + 2]
    if arguments and Path(arguments[0]).is_dir():
        DATA = Path(arguments.pop(0))
    cases = {"emps": emps, "brfd": brfd, "mr_damper": mr_damper, "boucwen": boucwen, "boucwen_noisy": boucwen_noisy}
    for case in arguments or cases:
        cases[case]()
