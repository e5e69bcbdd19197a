"""Processor time of a diagnosis, after compilation, as a multiple of one evaluation of the baseline's law.

Run ``python -m benchmarks.diagnosis_cost``; ``--profile`` adds where the time goes. One case of four recordings of 8000
samples per family of baselines and kind of answer is drawn by the blind benchmark's generator. The floor, measured
before and after each case, is the law along the four recordings one by one, as a single call of ``clamp`` runs it:
seconds depend on the machine and on what else runs on it, the ratio less so. The promise is 10 s of one core.
"""

# ruff: noqa: E402 - the imports below load numpy, whose threads have to be limited first
from __future__ import annotations

import argparse
import cProfile
import json
import os
import pstats
import tempfile
import time
from pathlib import Path

for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):  # before numpy: threads that wait count as processor time
    os.environ.setdefault(_name, "1")

import numpy as np

from benchmarks.concealed.cases import draw
from benchmarks.concealed.deck import CaseSpec
from benchmarks.concealed.generate import write_case
from hystid.compiled import CompiledModel
from hystid.diagnosis import Diagnosis, diagnose
from hystid.modelica import compile_model
from hystid.recording import Recording, read_all

CASES = (
    ("null", (), "iwan"),
    ("null", (), "boucwen"),
    ("single", ("cubic_stiffness",), "linear"),
    ("single", ("impact",), "jenkins"),
    ("single", ("coulomb_friction",), "boucwen"),
    ("single", ("quadratic_damping",), "iwan"),
    ("single", ("hidden_mode",), "pecorari"),
    ("pair", ("hidden_mode", "position_dependent_friction"), "linear"),
    ("pair", ("impact", "coulomb_friction"), "jenkins"),
    ("stranger", ("cogging",), "jenkins"),
    ("stranger", ("inertial_nonlinearity",), "iwan"),
)
STAGES = {  # function -> what it stands for; the last two lie within the others
    "prepare_part": "smoothing",
    "_refit": "refit of the baseline",
    "scan": "scans",
    "fit": "fits, of which some in the refit",
    "run_all": "laws and effects, within all of these",
}
FLOORS = 5


def opened(place: Path) -> tuple[dict[str, object], list[Recording], dict[str, float]]:
    """What a case hands out: its description, its recordings, and the given parameters as numbers."""
    handed = json.loads((place / "case.json").read_text())
    known = json.loads((place / handed["parameters"]).read_text())
    values = {name: float(v["value"] if isinstance(v, dict) else v) for name, v in known.items()}
    return handed, read_all([place / name for name in handed["recordings"]]), values


def floor(model: str, recordings: list[Recording], values: dict[str, float]) -> float:
    """Processor time [s] of the law along all recordings, one by one; the least of a few."""
    compiled = CompiledModel(compile_model(model))
    known = {variable.name for variable in compiled.code.variables}
    parameters = {name: value for name, value in values.items() if name in known}
    taken = []
    for _ in range(FLOORS):
        begin = time.process_time()
        for r in recordings:
            compiled.clamp({"x": r.channel("x"), "v": r.channel("v")}, {}, r.dt, parameters=parameters, outputs=["R"])
        taken.append(time.process_time() - begin)
    return min(taken)


def answered(place: Path) -> Diagnosis:
    """The diagnosis of a case."""
    handed = json.loads((place / "case.json").read_text())
    recordings, holdout = ([place / name for name in handed[kind]] for kind in ("recordings", "holdout"))
    return diagnose(recordings, model=handed["model"], parameters=place / handed["parameters"], holdout=holdout)


def stages(place: Path) -> str:
    """Shares of the stages in a profiled run."""
    profile = cProfile.Profile()
    profile.runcall(answered, place)
    found = pstats.Stats(profile).stats  # type: ignore[attr-defined]  # the stub does not declare it, the class has it
    whole = max(entry[3] for entry in found.values())
    sums = dict.fromkeys(STAGES, 0.0)
    for (file, _, name), entry in found.items():
        if name in sums and "hystid" in file:
            sums[name] += entry[3]
    return ", ".join(f"{STAGES[name]} {100 * share / whole:.0f} %" for name, share in sums.items())


def main() -> None:
    """Print one line per case."""
    arguments = argparse.ArgumentParser(description=__doc__)
    arguments.add_argument("--profile", action="store_true", help="where the time goes, from a second run")
    arguments.add_argument("--seed", type=int, default=5)
    chosen = arguments.parse_args()
    with tempfile.TemporaryDirectory() as name:
        worst = 0.0
        for number, (group, ids, family) in enumerate(CASES):
            folder = Path(name, str(number))
            rng = np.random.default_rng((chosen.seed, number))
            place = folder / "case_0000"
            write_case(draw(CaseSpec(group, ids, family, family, "standard"), rng), place, folder / "sealed")
            handed, recordings, values = opened(place)
            if number == 0:
                answered(place)  # compiles what is not in the cache
            floors = [floor(str(handed["model"]), recordings, values)]
            begin = time.process_time()
            found = answered(place)
            taken = time.process_time() - begin
            floors.append(floor(str(handed["model"]), recordings, values))
            worst = max(worst, taken)
            named = "+".join(finding.effect for finding in found.findings) or found.verdict
            told = f"{family:9s}{group:9s}{'+'.join(ids):42s} {taken:6.1f} s {taken / min(floors):7.0f} floors  {named}"
            print(told, flush=True)
            if chosen.profile:
                print(f"{'':18s}{stages(place)}", flush=True)
    print(f"worst {worst:.1f} s of one core; promised 10 s")


if __name__ == "__main__":
    main()
