"""What an importer's solver gives at its default settings: oscillators in Model Exchange, error against fine steps.

    python -m benchmarks.fmu.solver_settings [--fmusim PROGRAM] [--as-fmusim]

FMPy's CVode takes tolerance and nominal values from the FMU, and so does PyFMI, which runs where it is installed. The
fmusim in C, where it is named, runs Co-Simulation by default. In Model Exchange it takes the Euler method, or CVode
where that is asked for, with a tolerance of its own (1e-4) and the FMU's nominal values. --as-fmusim: what nominal
values can do about that, by the same method in FMPy (BDF, absolute tolerances of 1e-4 of the nominal values) with the
FMU's nominal values, a tenth, a hundredth and a thousandth of them.

Two cases, half a second: a constant force of 60 N from rest, and free motion from 5 mm. Error: rms of the difference in
x, v and R over the standard deviation of the reference, the worst of the three, in per cent. Reference: the same FMU,
Runge-Kutta steps of 1e-5 s, events located.
"""

from __future__ import annotations

import argparse
import subprocess
import tempfile
from collections.abc import Callable, Iterator, Mapping
from importlib.util import find_spec
from pathlib import Path

import fmpy
import fmpy.sundials as sundials
import numpy as np

from hystid.fmu import Driver, build_model

LIBRARY = Path(__file__).parents[2] / "modelica" / "HystId" / "Oscillators"
CASES = {"constant force": {"F": 60.0}, "free motion": {"x_start": 5e-3}}
NAMES = ["x", "v", "R"]
STOP, ROWS, FINE = 0.5, 501, 100


Rows = Mapping[str, np.ndarray]
Client = Callable[[Path, Mapping[str, float]], Rows]


def by_fmpy(path: Path, start: Mapping[str, float], **further: float) -> Rows:
    """CVode of FMPy."""
    return fmpy.simulate_fmu(  # type: ignore[no-any-return]
        str(path), fmi_type="ModelExchange", stop_time=STOP, output_interval=STOP / (ROWS - 1),
        start_values=dict(start), output=NAMES, record_events=False, **further,
    )  # fmt: skip


def as_fmusim(share: float) -> Client:
    """CVode of FMPy at the tolerance of fmusim, with a share of the FMU's nominal values."""

    def run(path: Path, start: Mapping[str, float]) -> Rows:
        def scaled(memory: object, relative: float, absolute: object) -> int:
            values = sundials.NV_DATA_S(absolute)
            for i in range(n):
                values[i] *= share
            return usual(memory, relative, absolute)  # type: ignore[no-any-return]

        n, usual = len(Driver(path).model.states), sundials.CVodeSVtolerances
        sundials.CVodeSVtolerances = scaled
        try:
            return by_fmpy(path, start, relative_tolerance=1e-4)
        finally:
            sundials.CVodeSVtolerances = usual

    return run


def by_fmusim(program: Path, *further: str) -> Client:
    """The fmusim that came with the Reference FMUs until version 0.0.39."""

    def run(path: Path, start: Mapping[str, float]) -> Rows:
        table = path.with_suffix(".csv")
        command = [program, "--stop-time", STOP, "--output-file", table, *further]
        for name in NAMES:
            command += ["--output-variable", name]
        for name, value in start.items():
            command += ["--start-value", name, value]
        subprocess.run([str(word) for word in (*command, path)], check=True, capture_output=True)
        found = np.genfromtxt(table, delimiter=",", names=True, deletechars="")
        grid = np.linspace(0, STOP, ROWS)  # it adds rows at events
        return {name: np.interp(grid, found["time"], found[name]) for name in NAMES}

    return run


def by_pyfmi(path: Path, start: Mapping[str, float]) -> Rows:
    """The default solver of PyFMI."""
    from pyfmi import load_fmu

    model = load_fmu(str(path), kind="ME", log_level=0)
    for name, value in start.items():
        model.set(name, value)
    options = model.simulate_options()
    options["ncp"], options["result_handling"] = ROWS - 1, "memory"
    options[f"{options['solver']}_options"]["verbosity"] = 50
    found = model.simulate(final_time=STOP, options=options)
    grid = np.linspace(0, STOP, ROWS)
    return {name: np.interp(grid, found["time"], found[name]) for name in NAMES}


def errors(path: Path, client: Client) -> Iterator[float]:
    """Error in per cent of each case."""
    driver = Driver(path)
    for start in CASES.values():
        t = np.linspace(0, STOP, (ROWS - 1) * FINE + 1)
        force = np.full(len(t), start.get("F", 0.0))
        settings = {name: value for name, value in start.items() if name != "F"}
        ours = driver.simulate(t, {"F": force}, parameters=settings, outputs=NAMES)
        theirs = client(path, start)
        yield 100 * max(
            float(np.sqrt(np.mean((theirs[name][:ROWS] - ours[name][::FINE]) ** 2)) / np.std(ours[name]))
            for name in NAMES
        )


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--fmusim", type=Path, help="the program, where it is at hand")
    parser.add_argument(
        "--as-fmusim", action="store_true", help="FMPy at the tolerance of fmusim, nominal values varied"
    )
    given = parser.parse_args()
    program = given.fmusim
    clients: dict[str, Client] = {"FMPy": by_fmpy}
    if given.as_fmusim:
        clients |= {f"as fmusim, nominal x {share:g}": as_fmusim(share) for share in (1, 0.1, 0.01, 0.001)}
    if program:
        cvode = ("--interface-type", "me", "--solver", "cvode")
        clients |= {
            "fmusim": by_fmusim(program),
            "fmusim, Euler": by_fmusim(program, "--interface-type", "me"),
            "fmusim, CVode": by_fmusim(program, *cvode),
            "fmusim, CVode --tolerance 1e-6": by_fmusim(program, *cvode, "--tolerance", "1e-6"),
        }
    clients |= {"PyFMI": by_pyfmi} if find_spec("pyfmi") else {}
    columns = [f"{client}, {case}" for client in clients for case in CASES]
    print("| model | FMI | " + " | ".join(columns) + " |\n|---|---|" + "---|" * len(columns))
    with tempfile.TemporaryDirectory() as folder:
        for model in sorted(p.stem for p in LIBRARY.glob("*.mo") if p.stem != "package"):
            for version in (2, 3):
                turn = {"v_turn": 1e-2} if model == "PecorariSolodov" else {}  # as published it jumps at rest
                path = build_model(
                    f"HystId.Oscillators.{model}", Path(folder) / "m.fmu", fmi=version, parameters=turn,
                ).path  # type: ignore[arg-type]  # fmt: skip
                cells = [f"{error:.2g} %" for client in clients.values() for error in errors(path, client)]
                print(f"| {model} | {version}.0 | " + " | ".join(cells) + " |", flush=True)


if __name__ == "__main__":
    main()
