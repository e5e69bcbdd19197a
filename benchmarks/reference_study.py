"""The reference study on the simulated stick-slip oscillator: laws, structures, mass, accuracy, noise, amplitude.

    python benchmarks/reference_study.py OUT [PART ...] [--workers N] [--doc]

Parts: laws division grid mass accuracy noise amplitude lab; all of them without a name. Each writes its tables to
OUT/PART.md and its pictures to OUT/reference-PART*.svg. --doc puts what OUT holds into docs/reference-study.md, between
the markers of each part, and beside it. Every part can be stopped and started again on the same OUT; what another
version of the engine left there is not used. noise:28 and the like do one condition of a part and print nothing.
"""

from __future__ import annotations

import argparse
import hashlib
import pickle
import re
import shutil
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
import oracle
from pictures import Panel, write
from scipy.signal import welch

import hystid
from hystid import study
from hystid.comparison import harmonics
from hystid.files import atomic
from hystid.identification import Comparison, identify
from hystid.networks.training import split_indices
from hystid.processing import prepare
from hystid.recording import Recording

DOCUMENT = Path(__file__).parents[1] / "docs" / "reference-study.md"
MASS_STARTS = 5
ENGINE = ("networks", "identification", "smoothing", "turning_points.py", "processing.py")


@dataclass
class Part:
    """Where a part writes, and the lines of its table so far."""

    name: str
    out: Path
    workers: int | None
    only: tuple[int, ...] = ()
    lines: list[str] = field(default_factory=list)

    def say(self, line: str = "") -> None:
        """One more line of the part's text."""
        print(line, flush=True)
        self.lines.append(line)

    def picture(self, suffix: str, title: str, panels: Sequence[Panel], columns: int, **more: tuple[int, int]) -> None:
        """A picture of the part, named after it."""
        write(self.out / f"reference-{self.name}{suffix}.svg", title, panels, columns, **more)
        self.say(f"\n![{title}](reference-{self.name}{suffix}.svg)\n")


@cache
def engine() -> str:
    """Version and a digest of the sources that the figures depend on."""
    root, digest = Path(hystid.__file__).parent, hashlib.sha256()
    for name in ENGINE:
        whole = root / name
        for path in sorted(whole.rglob("*")) if whole.is_dir() else [whole]:
            if path.suffix in (".py", ".c", ".h"):
                digest.update(path.read_bytes())
    return f"{version('hystid')}-{digest.hexdigest()[:8]}"


def laws(part: Part) -> None:
    """Loops and spectra of R under a 20 Hz force: stick-slip and Bouc-Wen have odd harmonics only."""
    dt, t, panels = 1e-4, np.arange(40_000) * 1e-4, []
    part.say("| law | " + " | ".join(str(k) for k in range(2, 10)) + " |\n|" + "---|" * 9)
    for name, newtons, law in (("stick-slip, 80 N", 80, oracle.JENKINS), ("Bouc-Wen, 40 N", 40, oracle.BOUC_WEN)):
        run = oracle.simulate(name, newtons * np.sin(2 * np.pi * 20 * t), dt, law)
        steady, last = run.R[20_000:], slice(-501, None)
        level = 20 * np.log10(harmonics(steady, dt, 20.0, count=9).amplitude)
        part.say(f"| {name} | " + " | ".join(f"{level[k] - level[0]:.0f}" for k in range(1, 9)) + " |")
        panels.append(Panel(f"{name}: last loop", "x [mm]", "R [N]").line(1e3 * run.x[last], run.R[last], "refined"))
        frequency, power = spectrum(steady, dt)
        shown = frequency <= 200
        panel = Panel(f"{name}: spectrum", "frequency [Hz]", "R [dB re its largest line]", limits=(-120, 0))
        panels.append(panel.line(frequency[shown], power[shown] - power.max(), "refined"))
    part.picture("", "Loops of the laws at 20 Hz, and what they put into the spectrum", panels, 2)


def spectrum(values: np.ndarray, dt: float) -> tuple[np.ndarray, np.ndarray]:
    """Frequency [Hz] and power spectral density [dB], four segments with a window of low leakage."""
    frequency, power = welch(values, 1 / dt, window="blackmanharris", nperseg=len(values) // 2)
    return frequency[1:], 10 * np.log10(power[1:] + 1e-300)


def division(part: Part) -> None:
    """The random division of the training samples."""
    recordings = [prepare(recording, mass=1.0) for recording in oracle.chirps()]
    R = np.concatenate([recording.R for recording in recordings])
    x = np.concatenate([recording.x for recording in recordings])
    drawn = np.sort(np.random.default_rng(0).choice(len(R), 50_000, replace=False))
    parts = {name: drawn[index] for name, index in split_indices(len(drawn), 0).items()}
    part.say("| part | samples | R: mean [N] | deviation [N] | least [N] | greatest [N] |\n|---|---|---|---|---|---|")
    for name, index in parts.items():
        values = R[index]
        cells = (values.mean(), values.std(), values.min(), values.max())
        part.say(f"| {name} | {len(index)} | " + " | ".join(f"{value:.2f}" for value in cells) + " |")
    colours = {"train": "measured", "validation": "refined", "test": "published"}
    begin = sum(len(recording.t) for recording in recordings[:4]) + 11_000  # 75 N, as the chirp passes resonance
    panels = [
        Panel("75 N chirp, 22 Hz", "t [s]", "R [N]"),
        Panel("the same in the plane of the loop", "x [mm]", "R [N]"),
    ]
    for name, index in parts.items():
        some = index[(index >= begin) & (index < begin + 1500)]
        time = (some - begin) * 1e-4 + 1.1
        panels[0].line(time, R[some], colours[name], name, "dots")
        panels[1].line(1e3 * x[some], R[some], colours[name], name, "dots")
    part.picture("", "Division of the samples: 70 % train, 15 % stop early, 15 % test", panels, 2)


def grid(part: Part) -> None:
    """Fifteen structures, thirty starts of each."""
    result = study.grid(
        list(oracle.chirps()), mass=1.0, holdout=list(oracle.harmonics(duration=1.0)), workers=part.workers,
        out=part.out / "grid",
    )  # fmt: skip
    seconds = sum(outcome.seconds for cell in result.cells for outcome in cell.outcomes)
    count = 2 * sum(len(cell.outcomes) for cell in result.cells)
    part.say(f"{count} trainings on 35,000 samples, tests included: {seconds:.0f} s of processor time, that is "
             f"{seconds / 120:.1f} minutes on two cores.\n")  # fmt: skip
    part.say(
        "| layers | weights | force: best / lower quartile / median / upper / worst | ensemble | single "
        "| free-run x: best / lower / median / upper / worst | ensemble | single |\n|---|---|---|---|---|---|---|---|"
    )
    for cell in result.cells:
        part.say(f"| {cell.name} | {cell.parameters} | {row(cell.force)} | {cell.ensemble['force_nrmse']:.4f} "
                 f"| {cell.single['force_nrmse']:.4f} | {row(cell.free_run)} | {cell.ensemble['x_nrmse']:.4f} "
                 f"| {cell.single['x_nrmse']:.4f} |")  # fmt: skip
    better = {key: sum(c.ensemble[key] < c.single[key] for c in result.cells) for key in ("force_nrmse", "x_nrmse")}
    averaged = min(result.cells, key=lambda cell: cell.ensemble["x_nrmse"])
    part.say(f"\nChosen: {result.reason}.")
    part.say(f"Best ensemble in free run: {averaged.name} ({averaged.ensemble['x_nrmse']:.4f}). The ensemble beats the "
             f"best single network in force for {better['force_nrmse']} of {len(result.cells)} structures, "
             f"in free run for {better['x_nrmse']}.")  # fmt: skip
    reasons: dict[str, int] = {}
    for cell in result.cells:
        for counts in cell.stopped.values():
            for reason, number in counts.items():
                reasons[reason] = reasons.get(reason, 0) + number
    part.say("Why the trainings ended: " + "; ".join(f"{reason}: {number}" for reason, number in reasons.items()) + ".")
    panels = []
    for kind, label in (("force", "force NRMSE"), ("free_run", "free-run x NRMSE")):
        panel = Panel(
            label, "hidden neurons of both networks", "NRMSE", log_y=True, ticks=[c.name for c in result.cells]
        )
        for k, cell in enumerate(result.cells):
            panel.box(k, getattr(cell, kind).values)
        panels.append(panel)
    part.picture("", "Held-out errors of 30 starts of each structure (published method)", panels, 1, size=(960, 260))


def row(spread: study.Quartiles) -> str:
    levels = (spread.best, spread.lower, spread.median, spread.upper, spread.worst)
    return " / ".join("diverged" if np.isinf(level) else f"{level:.4f}" for level in levels)


def mass(part: Part) -> None:
    """What a wrong mass costs."""
    result = study.mass(
        list(oracle.chirps()), mass=1.0, holdout=list(oracle.harmonics(duration=1.0)), starts=MASS_STARTS,
        workers=part.workers, out=part.out / "mass",
    )  # fmt: skip
    panels = [Panel(label, "error of the mass [%]", "NRMSE, median over the starts", log_y=True)
              for label in ("force", "free-run displacement")]  # fmt: skip
    colours = ("published", "refined", "third", "fourth", "fifth")
    offsets = [100 * offset for offset in result.offsets]
    for kind, label, panel in (("force", "force", panels[0]), ("free_run", "free-run x", panels[1])):
        part.say(f"| {label}, layers | " + " | ".join(f"{offset:+.0f} %" for offset in offsets) + " |")
        part.say("|" + "---|" * (len(offsets) + 1))
        for colour, size in zip(colours, (2, 5, 8, 10, 13), strict=True):
            medians = [getattr(cell, kind).median for cell in result.row((size, size))]
            part.say(f"| {size}-{size} | " + " | ".join(f"{median:.3f}" for median in medians) + " |")
            panel.line(offsets, medians, colour, f"{size}-{size}")
        part.say()
    part.picture("", f"What an error of the weighed mass costs ({MASS_STARTS} starts each)", panels, 2, size=(460, 280))


def held_out(part: Part, key: object, train: Sequence[Recording], held: Sequence[Recording],
             **settings: Any) -> tuple[list[Comparison], tuple[str, ...]]:  # fmt: skip
    """Comparisons on the held-out recordings and the notes of one identification; done once for each engine."""
    path = part.out / "identified" / f"{part.name}-{key}-{engine()}.pickle"
    if not path.exists():
        result = identify(train, mass=1.0, holdout=held, workers=part.workers, **settings)
        path.parent.mkdir(exist_ok=True)
        kept = ([c for c in result.comparisons if c.role == "holdout"], result.notes)
        with atomic(path) as beside:
            beside.write_bytes(pickle.dumps(kept))
    found: tuple[list[Comparison], tuple[str, ...]] = pickle.loads(path.read_bytes())
    return found


HEAD = ("| {} | refined: force median / worst | free-run x median / worst | published: force median / worst "
        "| free-run x median / worst |\n|---|---|---|---|---|")  # fmt: skip


def errors_of(comparisons: Sequence[Comparison], names: str = "") -> np.ndarray:
    """Errors of shape (models, cases, 2): refined, published; recordings of such names; force, free-run x."""
    rows = [[[p.force_nrmse, np.inf if p.x_nrmse is None else p.x_nrmse] for p in (c.network, c.published or c.network)]
            for c in comparisons if c.recording.name.endswith(names)]  # fmt: skip
    return np.array(rows).transpose(1, 0, 2)


def line(part: Part, label: str, errors: np.ndarray) -> None:
    cells = [f"{np.median(e[:, k]):.4f} / {e[:, k].max():.4f}" for e in errors for k in (0, 1)]
    part.say(f"| {label} | " + " | ".join(cells) + " |")


def accuracy(part: Part) -> None:
    """Eight harmonic cases with three seeds of noise and starts, and pictures of the first."""
    found = {}
    for seed in part.only or (1, 2, 3):
        chirps, cases = list(oracle.chirps(seed=seed)), list(oracle.harmonics())
        found[seed], _ = held_out(part, seed, chirps, cases, seed=seed)
    if part.only:
        return
    part.say(HEAD.format("seed"))
    for seed, comparisons in found.items():
        line(part, str(seed), errors_of(comparisons))
    held = found[1]
    part.say("\nSeed 1, case by case (force / free-run x):\n\n| case | refined | published |\n|---|---|---|")
    for c, refined, published in zip(held, *errors_of(held), strict=True):
        cells = [f"{force:.4f} / {free:.4f}" for force, free in (refined, published)]
        part.say(f"| {c.recording.name.replace('_', ' ')} | " + " | ".join(cells) + " |")
    part.say(
        "\nOdd harmonics of R in steady free run, refined, dB from the reference (above -60 dB of the fundamental):\n"
    )
    for c in held:
        part.say(f"- {c.recording.name.replace('_', ' ')}: {odd_harmonics(c.recording, c.network.free_run['R'])}")
    panels: dict[str, list[Panel]] = {"loops": [], "time": [], "spectra": []}
    for c in held:
        title, dt = c.recording.name.replace("_", " "), c.recording.dt
        period = round(1 / (tone(c.recording) * dt))
        last, both = slice(-period - 1, None), slice(-2 * period - 1, None)
        loop = Panel(title, "x [mm]", "R [N]")
        motion = Panel(title, "t [ms]", "x [mm]")
        lines = Panel(title, "frequency [Hz]", "PSD of R [dB re N2/Hz]", limits=(-90, 50))
        reference = {"x": c.recording.x, "R": c.recording.R}
        runs = (("measured", "reference", reference), ("published", "published", c.published.free_run),
                ("refined", "refined", c.network.free_run))  # fmt: skip
        for colour, label, run in runs:
            dash = "" if colour == "measured" else "4 3"
            loop.line(1e3 * run["x"][last], run["R"][last], colour, label, dash)
            time = 1e3 * dt * np.arange(2 * period + 1)
            motion.line(time, 1e3 * run["x"][both], colour, label, dash)
            frequency, power = spectrum(run["R"][len(run["R"]) // 2 :], dt)
            lines.line(frequency[frequency <= 500], power[frequency <= 500], colour, label, dash)
        for kind, panel in zip(panels, (loop, motion, lines), strict=True):
            panels[kind].append(panel)
    for kind, title in (("loops", "Last loop in free run"), ("time", "Last two periods in free run"),
                        ("spectra", "Power spectra of R in free run, last second")):  # fmt: skip
        part.picture(f"-{kind}", title, panels[kind], 4, size=(250, 220))


def tone(recording: Recording) -> float:
    return float(recording.name.split("_")[1].removesuffix("Hz"))


def odd_harmonics(recording: Recording, force: np.ndarray) -> str:
    """Level differences of the odd harmonics 1 to 9 that stand above -60 dB of the fundamental in the reference."""
    half = len(recording) // 2
    reference, model = (
        harmonics(values[half:], recording.dt, tone(recording), count=9) for values in (recording.R, force)
    )
    levels = [20 * np.log10(np.abs(h.amplitude)) for h in (reference, model)]
    kept = [k for k in range(0, 9, 2) if levels[0][k] > levels[0][0] - 60]
    return ", ".join(f"{k + 1}: {levels[1][k] - levels[0][k]:+.2f}" for k in kept)


def curves(part: Part, title: str, label: str, at: Sequence[float], errors: Sequence[np.ndarray]) -> None:
    """Median (solid) and worst (dashed) case over a condition, refined and published."""
    panels = [Panel(name, label, "NRMSE", log_y=True) for name in ("force", "free-run displacement")]
    for k, panel in enumerate(panels):
        for m, method in enumerate(("refined", "published")):
            panel.line(at, [np.median(e[m, :, k]) for e in errors], method, f"{method}, median")
            panel.line(at, [e[m, :, k].max() for e in errors], method, f"{method}, worst", "5 3")
    part.picture("", title, panels, 2, size=(420, 280))


def noise(part: Part) -> None:
    """Training recordings with more and more noise, the same cases without."""
    levels, cases = (50, 40, 34, 28, 20), list(oracle.harmonics())
    found = [held_out(part, snr, list(oracle.chirps(snr)), cases)[0] for snr in part.only or levels]
    if part.only:
        return
    errors = [errors_of(comparisons) for comparisons in found]
    part.say(HEAD.format("SNR [dB]"))
    for snr, each in zip(levels, errors, strict=True):
        line(part, str(snr), each)
    curves(part, "Noise in the training recordings", "signal-to-noise ratio [dB]", levels, errors)


def amplitude(part: Part) -> None:
    """Trained to 60 N, tested above."""
    part.say(HEAD.format("tested on"))
    tested = (45, 60, 75, 90, 105)
    held = list(oracle.harmonics(duration=1.0, amplitudes=tested))
    train = list(oracle.chirps(amplitudes=(15, 30, 45, 60)))
    comparisons, _ = held_out(part, "60N", train, held)
    errors = [errors_of(comparisons, f"_{newtons}N") for newtons in tested]
    for newtons, found in zip(tested, errors, strict=True):
        line(part, f"{newtons} N", found)
    curves(part, "Trained up to 60 N, driven further", "force amplitude of the test [N]", tested, errors)


def lab(part: Part) -> None:
    """As recorded in a laboratory: force and acceleration only, harmonic tests with rising amplitude."""
    rng, dt = np.random.default_rng(5), 1e-4
    t = np.arange(40_000) * dt
    recordings = []
    for frequency in (15, 20, 25, 30, 35, 40, 45, 50, 60):
        steps = 10.0 * (1 + np.minimum(np.floor(t / 0.4), 9))  # 10 to 100 N in steps of 0.4 s
        clean = oracle.simulate(f"rising_{frequency}Hz", steps * np.sin(2 * np.pi * frequency * t), dt, oracle.JENKINS)
        noisy = oracle.noisy(clean, 34.0, rng)
        recordings.append(Recording(clean.name, clean.t, F=noisy.F, a=noisy.a))
    train = [r for r in recordings if tone(r) not in (20, 40)]
    held = [r for r in recordings if tone(r) in (20, 40)]
    comparisons, notes = held_out(part, "rising", train, held, band=(5.0, 500.0), decimate=4)
    part.say("| held out | refined: force | free-run x | published: force | free-run x | linear: force | free-run x |\n"
             "|---|---|---|---|---|---|---|")  # fmt: skip
    panels = []
    for c in comparisons:
        models = (c.network, c.published or c.network, c.linear)
        cells = [f"{p.force_nrmse:.4f} | " + ("diverged" if p.x_nrmse is None else f"{p.x_nrmse:.4f}") for p in models]
        part.say(f"| {c.recording.name.replace('_', ' ')} | " + " | ".join(cells) + " |")
        panel = Panel(c.recording.name.replace("_", " "), "x [mm]", "R [N]")
        period = round(1 / (tone(c.recording) * c.recording.dt))
        for step in (2, 5, 8):  # times, as processing leaves the ends of a recording out
            end = int(np.searchsorted(c.recording.t, 0.4 * (step + 1) - 0.02))
            last = slice(end - period, end + 1)
            panel.line(1e3 * c.recording.x[last], c.recording.R[last], "measured", "processed recording")
            panel.line(1e3 * c.recording.x[last], c.network.R[last], "refined", "refined", "4 3")
        panels.append(panel)
    for note in notes:
        part.say(f"\n{note}")
    part.picture("", "Rising amplitude: loops at 30, 60 and 90 N, held-out frequencies", panels, 2)


PARTS = {f.__name__: f for f in (laws, division, grid, mass, accuracy, noise, amplitude, lab)}


def document(out: Path) -> None:
    """Put the tables that ``out`` holds between their markers in the document, and the pictures beside it."""
    content = DOCUMENT.read_text(encoding="utf-8")
    for name in PARTS:
        path = out / f"{name}.md"
        if path.exists():
            body = path.read_text(encoding="utf-8").strip()
            begin, end = f"<!-- {name} -->", f"<!-- /{name} -->"
            table = f"{begin}\n{body}\n{end}"
            content, found = re.subn(f"{begin}.*?{end}", table.replace("\\", r"\\"), content, flags=re.S)
            assert found == 1, f"{DOCUMENT} has no markers for {name}"
    DOCUMENT.write_text(content, encoding="utf-8")
    for picture in out.glob("reference-*.svg"):
        shutil.copy(picture, DOCUMENT.parent / picture.name)


def main() -> None:
    """Read the command line and run the parts."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path)
    parser.add_argument("parts", nargs="*", metavar="PART", help=" ".join(PARTS))
    parser.add_argument("--workers", type=int)
    parser.add_argument("--doc", action="store_true")
    given = parser.parse_args()
    engine()  # of the sources as they are loaded
    unknown = {name.partition(":")[0] for name in given.parts} - set(PARTS)
    if unknown:
        parser.error(f"no such part: {', '.join(sorted(unknown))}")
    given.out.mkdir(parents=True, exist_ok=True)
    for name in given.parts or ([] if given.doc else PARTS):
        print(f"\n## {name}\n")
        name, _, key = name.partition(":")
        part = Part(name, given.out, given.workers, (int(key),) if key else ())
        PARTS[name](part)
        if key:
            continue
        text = "\n".join([*part.lines, "", f"Engine {engine()}: `python benchmarks/reference_study.py OUT {name}`"])
        (given.out / f"{name}.md").write_text(text + "\n", encoding="utf-8")
    if given.doc:
        document(given.out)


if __name__ == "__main__":
    main()
