"""Write a deck: ``python -m benchmarks.concealed.generate --seed S --cases N [--only id,...] [--variant ...] -o DIR``.

``DIR/case_0000`` holds what the diagnosis may see: ``rec_1.csv`` .. ``rec_4.csv``, ``holdout.csv``, ``parameters.json``
(nominal values, wrong on purpose) and ``case.json`` (the model, the channels). ``DIR/sealed`` holds the truths.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.concealed import outsiders
from benchmarks.concealed.cases import Case, draw
from benchmarks.concealed.chain import Taken
from benchmarks.concealed.deck import VARIANTS, CaseSpec, deck
from hystid.files import write_json, write_text
from hystid.progress import track

UNITS = {"x": "m", "v": "m/s", "a": "m/s2", "F": "N"}


def generate(folder: Path, seed: int, specs: Sequence[CaseSpec]) -> Iterator[Path]:
    """Write the cases one by one and yield their folders; cases whose truth is already there are left as they are."""
    for index, spec in enumerate(specs):
        place = folder / f"case_{index:04d}"
        if not (folder / "sealed" / f"{place.name}.json").exists():
            write_case(draw(spec, np.random.default_rng([seed, 2, index])), place, folder / "sealed")
        yield place


def write_case(case: Case, folder: Path, sealed: Path) -> None:
    """Write recordings and truth of one case; the truth last: its presence says that the case is complete."""
    channels = ("x", "F") if case.spec.variant == "x_and_F" else ("x", "v", "a", "F")
    names = [f"rec_{i + 1}" for i in range(len(case.recordings))]
    for name, recording in zip([*names, "holdout"], [*case.recordings, case.holdout], strict=True):
        write_recording(folder / f"{name}.csv", recording, channels)
    write_json(folder / "parameters.json", case.nominal)
    handed = {"model": case.baseline.model, "recordings": [f"{n}.csv" for n in names], "holdout": ["holdout.csv"]}
    write_json(folder / "case.json", handed | {"channels": list(channels), "parameters": "parameters.json"})
    for name, recording in zip(names, case.recordings, strict=True):
        sealed.mkdir(parents=True, exist_ok=True)
        np.save(sealed / f"{folder.name}_{name}.npy", strength(case, recording).astype(np.float32))
    write_json(sealed / f"{folder.name}.json", truth(case, names))


def write_recording(path: Path, recording: Taken, channels: Sequence[str]) -> None:
    """One CSV with ``name [unit]`` headers, SI units, seven digits."""
    header = ",".join(["t [s]", *(f"{c} [{UNITS[c]}]" for c in channels)])
    table = np.column_stack([recording.t, *(recording.measured[c] for c in channels)])
    lines = [header, *(",".join(f"{value:.8g}" for value in row) for row in table)]
    write_text(path, "\n".join(lines) + "\n")


def strength(case: Case, recording: Taken) -> np.ndarray[Any, np.dtype[np.float64]]:
    """How strongly the concealed thing acts at each sample [N]; channel errors as the force that they feign."""
    force = np.sum(np.abs(recording.effects), axis=0) if len(recording.effects) else np.zeros(len(recording.t))
    feigned = {"F": 1.0, "a": case.nominal["m"], "x": case.baseline.scale.K, "v": 0.0}
    return np.asarray(force + sum(w * np.abs(recording.clean[c] - recording.true[c]) for c, w in feigned.items()))


def truth(case: Case, names: Sequence[str]) -> dict[str, Any]:
    """Everything that the diagnosis must not see."""
    spec, fault = case.spec, case.chain.fault
    effects = [
        {"id": e.id, "form": e.form, "element": asdict(e.element), "quantities": e.quantities(e.element)}
        for e in case.effects
    ]
    return {
        "group": spec.group,
        "ids": [*(e.id for e in case.effects), *([fault.id] if fault else [])],
        "accepted": accepted(case),
        "variant": spec.variant,
        "snr": case.chain.snr,
        "true_family": spec.family,
        "given_family": spec.given,
        "parameters": case.baseline.parameters if spec.family == spec.given else None,
        "effects": effects,
        "fault": asdict(fault) if fault else None,
        "decoy": case.chain.decoy,
        "share_of_R": case.share,
        "mismatch": {"before": case.mismatch.before, "truth": case.mismatch.truth, "visible": case.mismatch.visible},
        "identifiable": case.identifiable,
        "oracle": case.oracle,
        "tests": [asdict(t) for t in case.tests],
        "strength": list(names),
    }


def accepted(case: Case) -> list[str]:
    """Ids, or the verdict unknown_physics, that are right answers, the best first. Empty: nothing is to be found."""
    spec = case.spec
    if spec.group == "wrong_baseline":
        return ["hysteretic_friction", "unknown_physics"]
    if spec.group == "relative":
        return [outsiders.RELATIVES[spec.ids[0]][0], "unknown_physics"]
    if spec.group == "stranger":
        return ["unknown_physics"]
    if spec.group == "decoy":
        return ["channel_delay"] if case.chain.decoy in ("small_delay", "hold") else []
    return list(spec.ids)


def main(arguments: Sequence[str] | None = None) -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description="Write a deck of concealed cases with sealed truths.")
    parser.add_argument("--seed", type=int, required=True)
    parser.add_argument("--cases", type=int, default=51)
    parser.add_argument("--only", default="", help="ids, groups or baseline families, separated by commas")
    parser.add_argument("--variant", default="", help=f"used in turn: {', '.join(VARIANTS)}")
    parser.add_argument("-o", dest="folder", type=Path, required=True)
    chosen = parser.parse_args(arguments)
    only, variants = ([part for part in text.split(",") if part] for text in (chosen.only, chosen.variant))
    unknown = set(variants) - set(VARIANTS)
    if unknown:
        parser.error(f"--variant {', '.join(sorted(unknown))} is not one of {', '.join(VARIANTS)}")
    specs = deck(chosen.seed, chosen.cases, only, variants)
    with track("concealed cases", len(specs)) as step:
        for place in generate(chosen.folder, chosen.seed, specs):
            step(text=place.name)


if __name__ == "__main__":
    main()
