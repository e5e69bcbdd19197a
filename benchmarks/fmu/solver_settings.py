"""What an importer's solver gives at its default settings: oscillators in Model Exchange, error against fine steps.

    python -m benchmarks.fmu.solver_settings

FMPy's CVode takes tolerance and nominal values from the FMU. Two cases, half a second: a constant force of 60 N from
rest, and free motion from 5 mm. Error: rms of the difference in x, v and R over the standard deviation of the
reference, the worst of the three, in per cent. Reference: the same FMU, Runge-Kutta steps of 1e-5 s, events located.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from pathlib import Path

import fmpy
import numpy as np

from hystid.fmu import Driver, build_model

LIBRARY = Path(__file__).parents[2] / "modelica" / "HystId" / "Oscillators"
CASES = {"constant force": {"F": 60.0}, "free motion": {"x_start": 5e-3}}
NAMES = ["x", "v", "R"]
STOP, ROWS, FINE = 0.5, 501, 100


def errors(path: Path) -> Iterator[tuple[str, float]]:
    """Case and error in per cent."""
    driver = Driver(path)
    for case, start in CASES.items():
        t = np.linspace(0, STOP, (ROWS - 1) * FINE + 1)
        force = np.full(len(t), start.get("F", 0.0))
        settings = {name: value for name, value in start.items() if name != "F"}
        ours = driver.simulate(t, {"F": force}, parameters=settings, outputs=NAMES)
        theirs = fmpy.simulate_fmu(
            str(path), fmi_type="ModelExchange", stop_time=STOP, output_interval=STOP / (ROWS - 1),
            start_values=start, output=NAMES, record_events=False,
        )  # fmt: skip
        worst = max(
            float(np.sqrt(np.mean((theirs[name][:ROWS] - ours[name][::FINE]) ** 2)) / np.std(ours[name]))
            for name in NAMES
        )
        yield case, 100 * worst


def main() -> None:
    """Print the table."""
    print("| model | FMI | " + " | ".join(CASES) + " |\n|---|---|" + "---|" * len(CASES))
    with tempfile.TemporaryDirectory() as folder:
        for model in sorted(p.stem for p in LIBRARY.glob("*.mo") if p.stem != "package"):
            for version in (2, 3):
                turn = {"v_turn": 1e-2} if model == "PecorariSolodov" else {}  # as published it jumps at rest
                path = build_model(
                    f"HystId.Oscillators.{model}", Path(folder) / "m.fmu", fmi=version, parameters=turn,
                ).path  # type: ignore[arg-type]  # fmt: skip
                found = dict(errors(path))
                print(f"| {model} | {version}.0 | " + " | ".join(f"{found[c]:.3g} %" for c in CASES) + " |", flush=True)


if __name__ == "__main__":
    main()
