"""The reference study in small: a stick-slip oscillator, its recordings, its surrogate, and how well that follows."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from hystid.fmu import Driver, build_model
from hystid.identification import Identification, identify
from hystid.recording import Recording, write_csv
from hystid.simulation import force_of, simulate
from hystid.validation import Validation, validate
from hystid.virtual_experiment.targets import Check

MODEL = "HystId.Oscillators.Jenkins"
MASS = 1.0  # kg, the model's own
NOISE_DB = 34.0
DT = 1e-4  # s
CHIRPS = tuple(f"chirp:0-100Hz@{level}N,5s" for level in (15, 30, 45, 60, 75, 105))
TESTS = tuple(f"harmonic:{f}Hz@{level}N,2s" for f in (20, 30, 40, 50) for level in (80, 90))
LAYERS = (5, 5)
BAND = (None, 1000.0)  # Hz; with the reduction that follows, the reference processing of the method
EVERY = 4


@dataclass(frozen=True)
class Size:
    """How much is trained. starts, lab_starts: network pairs; samples: of the training set; method: of ``identify``."""

    starts: int = 30
    lab_starts: int = 6
    samples: int = 50_000
    method: Literal["published", "refined"] = "refined"
    seed: int = 0


FULL = Size()


@dataclass(frozen=True, eq=False)
class ReferenceStudy:
    """Results of part 1. reference: the FMU; recordings: the chirps as recorded, with noise."""

    reference: Path
    recordings: tuple[Recording, ...]
    identification: Identification
    validation: Validation

    @property
    def checks(self) -> tuple[Check, ...]:
        """Targets of the reference study."""
        force = 100 * self.validation.figures("force_nrmse")
        motion = 100 * self.validation.figures("x_nrmse")
        odd = np.nan if self.validation.worst_odd_db is None else self.validation.worst_odd_db
        part, tests = "surrogate", f"{len(TESTS)} unseen harmonic tests"
        return (
            Check(part, f"force NRMSE, median of {tests}", float(np.median(force)), 3.0, "%"),
            Check(part, "force NRMSE, worst", float(np.max(force)), 6.0, "%"),
            Check(part, "free-run displacement NRMSE, median", float(np.median(motion)), 3.0, "%"),
            Check(part, "free-run displacement NRMSE, worst", float(np.max(motion)), 10.0, "%"),
            Check(part, "odd harmonics of R up to the 9th, worst difference", odd, 3.0, "dB"),
        )


def reference_study(out: Path, size: Size) -> ReferenceStudy:
    """Modelica -> FMU -> recordings -> surrogate -> co-simulation, each with its files and report below ``out``."""
    reference = out / "jenkins.fmu"
    build_model(MODEL, reference)
    recordings = record(reference, out / "recordings")
    found = identify(
        recordings,
        mass=MASS,
        layers=LAYERS,
        ensemble=size.starts,
        samples=size.samples,
        seed=size.seed,
        method=size.method,
        band=BAND,
        decimate=EVERY,
        out=out / "identification",
    )
    command = f"hystid identify recordings/*.csv --mass {MASS:g} --band 0-{BAND[1]:g}Hz --decimate {EVERY}"
    command += f" --ensemble {size.starts} --seed {size.seed} --method {size.method} -o identification"
    found.report(out / "identification" / "report.html", command)
    surrogate = out / "identification" / "surrogate.fmu"
    checked = validate(surrogate, reference=reference, forces=TESTS, dt=DT, out=out / "validation")
    command = f"hystid validate identification/surrogate.fmu --against jenkins.fmu --force {' '.join(TESTS)}"
    checked.report(out / "validation" / "report.html", f"{command} -o validation")
    return ReferenceStudy(reference, recordings, found, checked)


def record(fmu: Path, folder: Path) -> tuple[Recording, ...]:
    """The chirps, simulated with the FMU and recorded with noise; written as CSV below ``folder``."""
    driver = Driver(fmu)
    made = []
    for seed, text in enumerate(CHIRPS):
        recording = simulate(driver, force_of(text, DT), noise_snr=NOISE_DB, seed=seed)
        level = text.partition("@")[2].partition("N")[0]
        write_csv(recording, folder / f"chirp_{level}N.csv")
        made.append(recording)
    return tuple(made)
