"""How much of the Modelica Standard Library compiles, runs, and agrees with the published reference results.

Run ``python -m benchmarks.msl FOLDER RESULTS [SUBLIBRARY ...]``. FOLDER holds the library (``Modelica`` beside
``Complex.mo`` and ``ModelicaServices``), RESULTS its reference results (``Modelica/...``, one folder per example).
Every example with an experiment counts, and none is left out. Each is compiled and run in a process of its own.

A run counts as simulated when it reaches its stop time and halving the step changes no compared signal by more than a
tenth of the tolerance; where steps of fixed length do not get there (stiff models), FMPy's CVode runs the FMU in Model
Exchange. The step is never chosen by the reference.
A signal agrees when it stays within 1e-3 of its range from the reference, or between the reference's values up to one
sampling interval earlier and later: a switch may come one sample off. A discrete signal may switch earlier or later by
1e-3 of the run: the references come from solvers of finite tolerance, and its slope forgives no error of time. Modes
may be open where motions are not, as of two brakes that hold one shaft: where all continuous signals agree and a
discrete one does not, the example is counted apart ("but for modes").
"""

from __future__ import annotations

import argparse
import csv
import multiprocessing
import os
import re
import sys
import time
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from multiprocessing.connection import Connection
from pathlib import Path
from tempfile import TemporaryDirectory
from unittest.mock import patch

import numpy as np
import numpy.typing as npt

from hystid.compiled import CompiledModel
from hystid.errors import HystidError
from hystid.modelcode import ModelCode
from hystid.modelica import compile_model
from hystid.modelica.reach import classes
from hystid.modelica.sources import read

Array = npt.NDArray[np.float64]
SUBLIBRARIES = (
    "Mechanics.Translational", "Mechanics.Rotational", "Mechanics.MultiBody", "Blocks", "Electrical.Analog",
    "Electrical.Digital", "Electrical.Machines", "Magnetic.FluxTubes", "Thermal.HeatTransfer",
    "Thermal.FluidHeatFlow", "StateGraph", "Math", "Utilities",
)  # fmt: skip
TOLERANCE = 1e-3  # of a signal's range
SECONDS = 120.0  # for one example, compiling included
_HALVINGS = 7


@dataclass
class Outcome:
    """Of one example: what was reached, CPU seconds to build, largest deviation in parts of a range, and words."""

    name: str
    has_reference: bool = False
    compiled: bool = False
    simulated: bool = False
    agrees: bool = False
    but_modes: bool = False
    build: float = 0.0
    deviation: float = float("nan")
    words: str = ""


@dataclass(frozen=True)
class Reference:
    """Published result: times (n,) and signals (n,) by name."""

    time: Array
    signals: Mapping[str, Array]


def examples(folder: Path, sublibrary: str) -> list[str]:
    """Full names of the classes of a sub-library that state an experiment."""
    root = folder / "Modelica" / sublibrary.replace(".", "/")
    found = []
    for path in sorted(
        [*root.rglob("*.mo"), *([root.with_suffix(".mo")] if root.with_suffix(".mo").is_file() else [])]
    ):
        source = read(path)
        parts = path.relative_to(folder).with_suffix("").parts
        front = parts[:-1] if parts[-1] == "package" else parts
        outline = classes(source) or []
        for c in outline:
            inner = [d for d in outline if d.parent is c]
            text, at = "", c.body
            for d in inner:
                text, at = text + source.plain[at : d.start], d.end
            text += source.plain[at : c.end]
            named = [*front[:-1], *(a.name for a in reversed(list(c.around())))]
            if c.kind in ("model", "block", "class") and re.search(r"\bexperiment\s*\(", text) and "Examples" in named:
                found.append(".".join(named))
    return found


def reference(results: Path, name: str) -> Reference | None:
    """The published result of an example, None without one."""
    folder = results / name.replace(".", "/")
    files = sorted(folder.glob("*.csv"))
    if not files:
        return None
    with files[0].open(newline="") as file:
        names = next(csv.reader(file))
    table = np.loadtxt(files[0], delimiter=",", skiprows=1, ndmin=2)
    signals = {n.strip(): table[:, k] for k, n in enumerate(names) if k}
    return Reference(table[:, 0], signals)


def deviation(got: Array, at: Array, wanted: Reference, name: str, discrete: bool = False) -> float:
    """Largest distance of a signal (n,) at times (n,) from the band around the reference, in parts of its range."""
    t, y = wanted.time, wanted.signals[name]
    scale = max(float(np.ptp(y)), 1e-6 * float(np.abs(y).max()), 1e-12)
    steps = np.diff(t)
    near = float(np.median(steps[steps > 0])) * (1 + 1e-9)  # events add samples between those of the grid
    near = max(near, TOLERANCE * float(t[-1] - t[0])) if discrete else near
    first, last = np.searchsorted(t, at - near) - 1, np.searchsorted(t, at + near, "right")
    low, high = np.full(len(at), np.inf), np.full(len(at), -np.inf)
    for shift in range(int((last - first).max()) + 1):
        values = y[np.clip(np.minimum(first + shift, last), 0, len(t) - 1)]
        low, high = np.minimum(low, values), np.maximum(high, values)
    return float((np.maximum(low - got, got - high).clip(0) / scale).max())


def largest_deviation(
    got: Mapping[str, Array], at: Array, wanted: Reference, discrete: Collection[str]
) -> tuple[float, str]:
    """The signal that is farthest off, and by how much."""
    found = [(deviation(got[n], at, wanted, n, n in discrete), n) for n in wanted.signals]
    return max(found, default=(0.0, ""))


def fixed_steps(
    code: ModelCode, names: Sequence[str], start: float, stop: float, interval: float
) -> Mapping[str, Array]:
    """Signals on the grid of the interval, with steps small enough that half of them change nothing that matters."""
    model = CompiledModel(code)
    rows = round((stop - start) / interval) + 1
    last: Mapping[str, Array] | None = None
    failure = ""
    for k in range(_HALVINGS):
        try:
            now = model.simulate({}, interval, rows=rows, start_time=start, outputs=list(names), substeps=2**k)
        except HystidError as error:
            last, failure = None, str(error)
            continue
        if last is not None and all(_close(now[n], last[n]) for n in names):
            return now
        last, failure = now, "halving the step goes on to change the result"
    raise HystidError(failure)


def _close(a: Array, b: Array) -> bool:
    """Whether two runs agree but for samples beside a jump, where each may have switched already or not yet."""
    scale = max(float(np.ptp(a)), 1e-6 * float(np.abs(a).max()), 1e-12)
    low = np.minimum(np.minimum(np.roll(b, 1), b), np.roll(b, -1))
    high = np.maximum(np.maximum(np.roll(b, 1), b), np.roll(b, -1))
    low[[0, -1]], high[[0, -1]] = b[[0, -1]], b[[0, -1]]
    return bool((np.maximum(low - a, a - high) / scale).max() <= 0.1 * TOLERANCE)


def variable_steps(
    code: ModelCode, names: Sequence[str], start: float, stop: float, interval: float
) -> tuple[Array, Mapping[str, Array]]:
    """The same through the FMU in Model Exchange, with the multistep method of FMPy."""
    import fmpy
    from fmpy import sundials

    from hystid.fmu.build import build

    # FMPy lets its solver take 500 steps from one output to the next, too few for a ringing of 5 ns shown each 200 us
    patient = partial(sundials.CVodeSolver, maxNumSteps=10_000_000)
    with TemporaryDirectory() as folder, patch.object(sundials, "CVodeSolver", patient):
        fmu = build(code, Path(folder, "model.fmu")).path
        got = fmpy.simulate_fmu(
            str(fmu), fmi_type="ModelExchange", start_time=start, stop_time=stop, output_interval=interval,
            relative_tolerance=1e-7, output=list(names), timeout=SECONDS,
        )  # fmt: skip
    if got["time"][-1] < stop - 1e-6 * (stop - start) or not all(np.isfinite(got[n]).all() for n in names):
        raise HystidError("the solver stopped early")
    return got["time"], {n: got[n].astype(float) for n in names}


def run(name: str, folder: Path, results: Path) -> Iterator[Outcome]:
    """Outcomes of one example, each going further than the last."""
    wanted = reference(results, name)
    outcome = Outcome(name, has_reference=wanted is not None)
    yield outcome
    began = _seconds()
    try:
        code = compile_model(name, libraries=[folder])
        outcome.build = _seconds() - began
        outcome.compiled = True
        yield outcome
        known = {v.name for v in code.variables}
        names = [n for n in (wanted.signals if wanted else ()) if n in known]
        every = [v.name for v in code.variables if v.variability == "continuous" and v.causality != "independent"]
        e = code.experiment
        steps = np.diff(wanted.time) if wanted else np.full(1, (e.stop - e.start) / 500)
        interval = float(np.median(steps[steps > 0]))
        stop = float(wanted.time[-1]) if wanted else e.stop
        grid = e.start + interval * np.arange(round((stop - e.start) / interval) + 1)
        try:
            got: Mapping[str, Array] = fixed_steps(code, names or every[:20], e.start, stop, interval)
        except HystidError as error:
            outcome.words = str(error)
            grid, got = variable_steps(code, names or every[:20], e.start, stop, interval)
        outcome.simulated, outcome.words = True, ""
        if wanted is not None:
            missing = [n for n in wanted.signals if n not in known]
            if missing:
                outcome.words = f"no variable {missing[0]}"
                wanted = Reference(wanted.time, {n: wanted.signals[n] for n in names})
            discrete = {v.name for v in code.variables if v.variability == "discrete"}
            outcome.deviation, worst = largest_deviation(got, grid, wanted, discrete)
            outcome.agrees = outcome.deviation <= TOLERANCE and not missing
            running = Reference(wanted.time, {n: s for n, s in wanted.signals.items() if n not in discrete})
            worst_motion, _ = largest_deviation(got, grid, running, discrete)
            outcome.but_modes = bool(running.signals) and not (outcome.agrees or missing) and worst_motion <= TOLERANCE
            outcome.words = outcome.words or ("" if outcome.agrees else f"{worst} is off")
    except HystidError as error:
        outcome.words = str(error)
    except Exception as error:  # a finding of its own: no example may end in a traceback
        outcome.words = f"{outcome.words} | {type(error).__name__}: {error}"
    outcome.build = outcome.build or _seconds() - began
    yield outcome


def _seconds() -> float:
    """CPU time of this process and of those that it waited for: other work on the machine does not count."""
    now = os.times()
    return now.user + now.system + now.children_user + now.children_system


def _worker(name: str, folder: Path, results: Path, end: Connection) -> None:
    for outcome in run(name, folder, results):
        end.send(asdict(outcome))


def measured(name: str, folder: Path, results: Path) -> Outcome:
    """The outcome of one example in a process of its own."""
    here, there = multiprocessing.Pipe(duplex=False)
    process = multiprocessing.get_context("fork").Process(target=_worker, args=(name, folder, results, there))
    process.start()
    there.close()
    outcome = Outcome(name)
    until = time.monotonic() + SECONDS
    try:
        while here.poll(max(until - time.monotonic(), 0)):
            outcome = Outcome(**here.recv())
    except EOFError:
        process.join()
        return outcome
    process.kill()
    process.join()
    outcome.words = f"no answer within {SECONDS:g} s"
    return outcome


def main() -> None:
    """Prints a line per example and the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("folder", type=Path, help="folder with Modelica, Complex.mo and ModelicaServices")
    parser.add_argument("results", type=Path, help="folder with the reference results, Modelica/... below it")
    parser.add_argument(
        "sublibraries", nargs="*", default=SUBLIBRARIES, help="e.g. Mechanics.Translational, or one example"
    )
    given = parser.parse_args()
    if not (given.results / "Modelica").is_dir():
        parser.error(f"{given.results} holds no folder Modelica with reference results")
    table: dict[str, list[Outcome]] = {}
    for sublibrary in given.sublibraries:
        names = examples(given.folder, sublibrary.removeprefix("Modelica.").partition(".Examples")[0])
        only = sublibrary if ".Examples" in sublibrary else ""
        for name in (n for n in names if only in n):
            outcome = measured(name, given.folder, given.results)
            table.setdefault(sublibrary, []).append(outcome)
            print(_line(outcome), flush=True)
    print("\n| sub-library | examples | compiled | simulated | with a reference ", end="")
    print("| within 1e-3 | but for modes | slowest build [s] |")
    print("|---|---|---|---|---|---|---|---|")
    for sublibrary, found in table.items():
        built = [o.build for o in found if o.compiled]
        cells = [
            len(found), sum(o.compiled for o in found), sum(o.simulated for o in found),
            sum(o.has_reference for o in found), sum(o.agrees for o in found), sum(o.but_modes for o in found),
        ]  # fmt: skip
        print(f"| {sublibrary} | {' | '.join(map(str, cells))} | {max(built, default=0):.1f} |")
    sys.exit(0)


def _line(o: Outcome) -> str:
    reached = [
        (o.agrees, "agrees"),
        (o.but_modes, "modes"),
        (o.simulated and o.has_reference, "OFF"),
        (o.simulated, "runs"),
    ]
    how = next((word for is_so, word in [*reached, (o.compiled, "no run")] if is_so), "refused")
    return f"{how:8} {o.build:5.1f} s {o.deviation:8.1e} {o.name}  {o.words}"


if __name__ == "__main__":
    main()
