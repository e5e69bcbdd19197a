"""Make cases and ask the diagnosis: ``python -m benchmarks.proof.run --seed S --cases N [--kind K ...] -o DIR``.

Each case has a process of its own. ``DIR/results.jsonl`` gets one line per case; a second call goes on where the first
stopped. ``--only-make`` writes the cases and asks nothing.
"""

from __future__ import annotations

import argparse
import json
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from threading import Lock
from typing import Any

from benchmarks.proof.answer import asked
from benchmarks.proof.cases import KINDS, MIX, NoFairCase, make, write
from benchmarks.proof.decoys import DECOYS
from benchmarks.proof.effects import PHYSICS
from benchmarks.proof.plan import HOLDOUTS
from benchmarks.proof.strangers import STRANGERS

# Already laws of time, or with a motion of their own that no window stops.
WHOLE = ("cyclic_degradation", "stiffness_drift", "hidden_mode")
# Effect ids, strangers and decoys take their turns, so that a deck of any size holds them evenly.
TURNS = {
    "single": tuple(PHYSICS),
    "part_time": tuple(e for e in PHYSICS if e not in WHOLE),
    "pair": tuple(PHYSICS),
    "stranger": tuple(STRANGERS),
    "decoy": tuple(DECOYS),
    "sensor_and_physics": tuple(PHYSICS),
    "sensor": ("channel_delay", "force_gain", "force_drift", "sensor_saturation"),
}


def plan(kinds: list[str], count: int, seed: int) -> list[tuple[str, int, dict[str, Any]]]:
    """Kind, number and what is fixed of each case."""
    out: list[tuple[str, int, dict[str, Any]]] = []
    seen = dict.fromkeys(KINDS, 0)
    for i in range(count):
        kind = kinds[i % len(kinds)]
        number = seen[kind]
        seen[kind] += 1
        turns = TURNS.get(kind)
        out.append((kind, number, {"effect": turns[(number + 5 * seed) % len(turns)]} if turns else {}))
    return out


def main() -> None:
    """See the module's text."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, required=True)
    parser.add_argument("--cases", type=int, required=True, help="number of cases")
    parser.add_argument("--kind", nargs="*", choices=KINDS, default=[], help="default: a mix of all")
    parser.add_argument("--snr", help="dB for every case, or 'none'")
    parser.add_argument("--holdout", choices=HOLDOUTS, help="the one kind of held-out recording")
    parser.add_argument("--sensors", choices=("own",), help="any channels of motion, each with a noise of its own")
    parser.add_argument(
        "--ask", choices=("keep", "drop", "both"), default="keep", help="with held-out recordings, without, or both"
    )
    parser.add_argument("--jobs", type=int, choices=(1, 2), default=1)
    parser.add_argument("--only-make", action="store_true")
    parser.add_argument("-o", "--out", type=Path, required=True)
    given = parser.parse_args()
    fixed: dict[str, Any] = {}
    if given.snr:
        fixed["snr"] = None if given.snr == "none" else float(given.snr)
    if given.holdout:
        fixed["holdout"] = given.holdout
    if given.sensors:
        fixed["sensors"] = given.sensors
    given.out.mkdir(parents=True, exist_ok=True)
    results = given.out / "results.jsonl"
    done = (
        {(r["case"], r["holdouts"]) for r in map(json.loads, results.read_text().splitlines())}
        if results.exists()
        else set()
    )
    lock = Lock()

    def one(job: tuple[str, int, dict[str, Any]]) -> None:
        kind, number, turn = job
        name = f"{kind}_{given.seed}_{number:04d}"
        ways = [way for way in (("keep", "drop") if given.ask == "both" else (given.ask,)) if (name, way) not in done]
        if not ways:
            return
        folder = given.out / "cases" / name
        if not (given.out / "truth" / f"{name}.json").exists():
            try:
                write(make(kind, given.seed, number, **turn, **fixed), given.out)
            except NoFairCase as reason:
                print(f"{name}: {reason}", flush=True)
                return
        for way in ways if not given.only_make else ():
            said = asked(folder, way == "drop")
            with lock, results.open("a") as file:
                file.write(json.dumps({"case": name, "kind": kind, "holdouts": way, **said}) + "\n")
            verdict = said.get("answer", {}).get("verdict") or said.get("refused") or said.get("crashed")
            print(f"{name} {way}: {verdict} ({said['cpu'] or 0:.1f} s)", flush=True)

    with ThreadPoolExecutor(given.jobs) as pool:
        list(pool.map(one, plan(given.kind or list(MIX), given.cases, given.seed)))


if __name__ == "__main__":
    main()
