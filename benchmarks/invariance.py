"""Does the answer stand under changes that do not change the physics?

    python -m benchmarks.invariance -o ../invariance --seed 7 [--cases 20] [--change NAME ...] [--jobs 2]

Twenty cases of ``benchmarks/proof`` (16 single effects, three healthy rigs, one pair) at 45 dB with all channels
measured; each is asked as it is, and under every change. What counts: of the cases that are answered rightly as they
are, how many stay right. A second call goes on where the first stopped.
"""

from __future__ import annotations

import argparse
import json
from collections import defaultdict
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from pathlib import Path
from threading import Lock
from typing import Any

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.signal import butter, savgol_filter, sosfiltfilt

from benchmarks.proof.answer import asked
from benchmarks.proof.cases import Case, NoFairCase, make
from benchmarks.proof.chain import UNITS
from benchmarks.proof.plan import HOLDOUTS
from benchmarks.proof.score import Grade, grade, wilson

Columns = dict[str, np.ndarray]
EFFECTS = (
    "cubic_stiffness", "quadratic_stiffness", "bilinear_stiffness", "contact_loss", "impact", "two_sided_stop",
    "backlash", "coulomb_friction", "stribeck_friction", "asymmetric_friction", "hysteretic_friction",
    "position_dependent_friction",
    "quadratic_damping", "displacement_dependent_damping", "viscoelastic_relaxation", "hidden_mode",
)  # fmt: skip
# Each half of each recording holds at least this part of the effect's share of R in all, so that cutting takes no
# evidence away; fairness is judged at 20 dB, so that noise takes none.
EVERYWHERE = 0.4


@dataclass(frozen=True)
class Asked:
    """What is handed in: recordings in the units of the header, held-out recordings, and what the user believes."""

    training: list[Columns]
    holdout: list[Columns]
    parameters: dict[str, Any]
    units: dict[str, tuple[str, float]] = field(default_factory=dict)
    resample: bool = False


Change = Callable[[Asked, Case, np.random.Generator], Asked]


def _each(change: Callable[[Columns], Columns]) -> Change:
    return lambda a, case, rng: replace(a, training=[change(dict(c)) for c in a.training])


def _scaled(time: float = 1, length: float = 1, force: float = 1) -> Change:
    """Another rig of the same physics: every quantity times its powers of the three scales."""
    by = {"t": time, "x": length, "v": length / time, "a": length / time**2, "F": force}
    stiff = force / length
    of = {
        "m": stiff * time**2,
        "B": stiff * time,
        "Kl": stiff,
        "Ks": stiff,
        "fc": force,
        "alpha": stiff,
        "x0": length,
        "x1": length,
    }

    def change(a: Asked, case: Case, rng: np.random.Generator) -> Asked:
        p = {name: value * of.get(name, 1.0) for name, value in a.parameters.items()}
        if "beta" in p:  # z' = alpha v - beta z^nu v: beta is alpha over force to the power nu
            p["beta"] *= stiff / force ** a.parameters["nu"]
        return replace(a, training=[{c: y * by[c] for c, y in data.items()} for data in a.training], parameters=p)

    return change


def _mirrored(data: Columns) -> Columns:
    return {c: y if c == "t" else -y for c, y in data.items()}


def _rows(first: float, last: float, step: int = 1) -> Change:
    return _each(lambda data: {c: y[int(first * len(y)) : int(last * len(y)) : step] for c, y in data.items()})


def _halves(a: Asked, case: Case, rng: np.random.Generator) -> Asked:
    halves = [{c: y[part] for c, y in data.items()} for data in a.training
              for part in (slice(0, len(data["t"]) // 2), slice(len(data["t"]) // 2, None))]  # fmt: skip
    return replace(a, training=halves)


def _without(*channels: str) -> Change:
    return _each(lambda data: {c: y for c, y in data.items() if c not in channels})


def _to_rate(ratio: float) -> Change:
    """Another clock reads the same analogue signals: cubic interpolation."""

    def change(data: Columns) -> Columns:
        t = np.arange(data["t"][0], data["t"][-1], (data["t"][1] - data["t"][0]) / ratio)
        return {c: t if c == "t" else CubicSpline(data["t"], y)(t) for c, y in data.items()}

    return _each(change)


def _derived(how: str) -> Change:
    def change(data: Columns) -> Columns:
        dt, x = data["t"][1] - data["t"][0], data["x"]
        if how == "savgol":
            return data | {
                "v": savgol_filter(x, 11, 3, deriv=1, delta=dt),
                "a": savgol_filter(x, 11, 3, deriv=2, delta=dt),
            }
        if how == "lowpass":
            x = sosfiltfilt(butter(4, 0.3, output="sos"), x)
        v = np.gradient(x, dt)
        return data | {"x": x, "v": v, "a": np.gradient(v, dt)}

    return _each(change)


def _low_passed(data: Columns) -> Columns:
    """All channels through one filter, run both ways, as users do who dislike noise: flat up to seven times f0."""
    low_pass = butter(4, 0.3, output="sos")
    return {c: y if c == "t" else sosfiltfilt(low_pass, y) for c, y in data.items()}


def _zero(channel: str, share: float = 0.03) -> Change:
    return _each(lambda data: data | {channel: data[channel] + share * np.std(data[channel])})


def _bits(bits: int) -> Change:
    def change(data: Columns) -> Columns:
        out = dict(data)
        for c in "Fxva":
            step = 2 * np.max(np.abs(data[c])) / 2**bits
            out[c] = np.round(data[c] / step) * step
        return out

    return _each(change)


def _noise(db: float) -> Change:
    def change(a: Asked, case: Case, rng: np.random.Generator) -> Asked:
        def noisy(y: np.ndarray) -> np.ndarray:
            return y + np.std(y) * 10 ** (-db / 20) * rng.standard_normal(len(y))

        return replace(a, training=[{c: y if c == "t" else noisy(y) for c, y in data.items()} for data in a.training])

    return change


def _rows_lost(a: Asked, case: Case, rng: np.random.Generator) -> Asked:
    """1 % of the rows, in runs of up to five; the time stamps are true."""
    out = []
    for data in a.training:
        keep = np.ones(len(data["t"]), dtype=bool)
        for at in rng.integers(1, len(keep) - 6, len(keep) // 300):
            keep[at : at + int(rng.integers(1, 6))] = False
        out.append({c: y[keep] for c, y in data.items()})
    return replace(a, training=out, resample=True)


# The mass is weighed; numbers without a unit are the shape of a law, not a size.
SHAPES = ("m", "N", "nu", "gamma", "delta")


def _nominal(far: float) -> Change:
    def change(a: Asked, case: Case, rng: np.random.Generator) -> Asked:
        off = dict(a.parameters)
        for name in sorted(set(off) - set(SHAPES)):
            off[name] *= far ** rng.choice([-1, 1])
        return replace(a, parameters=off)

    return change


def _only_mass(a: Asked, case: Case, rng: np.random.Generator) -> Asked:
    return replace(a, parameters={n: v for n, v in a.parameters.items() if n in SHAPES})


def _units(**given: tuple[str, float]) -> Change:
    return lambda a, case, rng: replace(a, units=given)


def _held(kind: str) -> Change:
    return lambda a, case, rng: replace(a, holdout=[case.holdout[HOLDOUTS.index(kind)]])


def _reversed(a: Asked, case: Case, rng: np.random.Generator) -> Asked:
    turned = [{c: data[c] for c in ("t", "a", "F", "v", "x")} for data in a.training[::-1]]
    return replace(a, training=turned)


def _twice(a: Asked, case: Case, rng: np.random.Generator) -> Asked:
    """With another time of the day: the very same file is refused."""
    first = a.training[0]
    return replace(a, training=[*a.training, first | {"t": first["t"] + 3600.0}])


def _hot(data: Columns) -> Columns:
    place = np.linspace(0, 1, len(data["t"]))
    return data | {"temperature": 20 + 3 * place + 0.1 * np.sin(40 * place)}


CHANGES: dict[str, Change] = {
    "mm and kN": _units(x=("mm", 1e3), F=("kN", 1e-3)),
    "g and mm/s": _units(a=("g", 1 / 9.80665), v=("mm/s", 1e3)),
    "mirrored": _each(_mirrored),
    "time times 10": _scaled(time=10),
    "time over 20": _scaled(time=0.05),
    "force times 1000": _scaled(force=1000),
    "length times 0.01": _scaled(length=0.01),
    "cut in halves": _halves,
    "trimmed at both ends": _rows(0.1, 0.9),
    "first half only": _rows(0.0, 0.5),
    "second half only": _rows(0.5, 1.0),
    "first recording only": lambda a, case, rng: replace(a, training=a.training[:1]),
    "recordings and columns in another order": _reversed,
    "a recording handed in again as of an hour later": _twice,
    "every second sample": _rows(0, 1, 2),
    "rate times 0.77": _to_rate(0.77),
    "rate times 1.6": _to_rate(1.6),
    "nominal values 2.5 times off": _nominal(2.5),
    "nominal values 5 times off": _nominal(5.0),
    "only the mass given": _only_mass,
    "without v": _without("v"),
    "without a": _without("a"),
    "x and F only": _without("v", "a"),
    "a and F only": _without("x", "v"),
    "v and a by quotients": _derived("quotients"),
    "v and a by Savitzky-Golay": _derived("savgol"),
    "v and a after a low-pass": _derived("lowpass"),
    "all channels low-passed": _each(_low_passed),
    "zero of x off by 3 %": _zero("x"),
    "zero of F off by 3 %": _zero("F"),
    "zero of a off by 3 %": _zero("a"),
    "12 bits": _bits(12),
    "noise to 34 dB": _noise(34),
    "noise to 28 dB": _noise(28),
    "noise to 20 dB": _noise(20),
    "1 % of the rows lost": _rows_lost,
    "time starts at 4000 s": _each(lambda data: data | {"t": data["t"] + 4000.0}),
    "a column of temperature": _each(_hot),
    **{f"held out: {kind}": _held(kind) for kind in HOLDOUTS},
}  # fmt: skip
# Names besides the right ones that a change makes true.
TRUE_BESIDES = {"zero of x off by 3 %": ("preload", "force_drift"), "zero of F off by 3 %": ("preload", "force_drift"),
                "zero of a off by 3 %": ("preload", "force_drift")}  # fmt: skip


# Changes that take the evidence for an effect away: without x, the mean of x is anyone's guess.
BLIND = {"a and F only": {"preload"}}


def base(seed: int, count: int) -> list[Case]:
    """The cases as they are; each holds one held-out recording of every kind, used only where a change asks for it."""
    wanted: list[tuple[str, dict[str, Any]]] = [("single", {"effect": effect}) for effect in EFFECTS]
    wanted[4:4], wanted[9:9], wanted[14:14] = [("null", {})], [("null", {})], [("null", {})]
    wanted.append(("pair", {}))
    out = []
    for place, (kind, fixed) in enumerate(wanted[:count]):
        for trial in range(20):
            try:
                case = make(
                    kind, seed, 100 * place + trial, snr=45.0, fair_at=20.0, channels="Fxva", holdout="all", **fixed
                )
            except NoFairCase:
                continue
            if all(fact["weakest_half"] > EVERYWHERE for fact in case.truth["concealed"]):
                out.append(case)
                break
        else:
            print(f"{kind} {fixed}: no case that every change leaves answerable")
    return out


def lay_out(given: Asked, model: str, folder: Path) -> None:
    """The files of a user."""
    folder.mkdir(parents=True, exist_ok=True)
    for label, recordings in (("train", given.training), ("hold", given.holdout)):
        for i, data in enumerate(recordings, 1):
            unit = (
                {"temperature": ("degC", 1.0)}
                | {c: (u, 1.0) for c, u in UNITS.items()}
                | (given.units if label == "train" else {})
            )
            header = ",".join(f"{c} [{unit[c][0]}]" for c in data)
            table = np.stack([y * unit[c][1] for c, y in data.items()], axis=1)
            np.savetxt(folder / f"{label}_{i}.csv", table, fmt="%.11g", delimiter=",", header=header, comments="")
    question = {"model": model, "parameters": given.parameters, "resample": given.resample}
    (folder / "question.json").write_text(json.dumps(question))


def good(g: Grade) -> bool:
    """Right by class; a healthy rig: no alarm."""
    return not g.alarm if g.kind == "null" else g.right_class


def report(results: list[dict[str, Any]], truths: dict[str, dict[str, Any]]) -> str:
    """One line per change: how many right answers stay right, and what became of the others."""
    grades: dict[tuple[str, str], Grade] = {}
    for result in results:
        truth = json.loads(json.dumps(truths[result["case"]]))
        truth["expect"]["allowed"] += TRUE_BESIDES.get(result["change"], ())
        grades[result["case"], result["change"]] = grade(truth, result)
    before = {case for (case, change), g in grades.items() if change == "" and good(g)}
    lines = [f"Right as they are: {len(before)} of {sum(change == '' for _, change in grades)}.", "",
             "| change | stay right | lost to |", "|---|---|---|"]  # fmt: skip
    total: list[bool] = []
    by_change: dict[str, list[Grade]] = defaultdict(list)
    for (case, change), g in grades.items():
        if change and case in before:
            by_change[change].append(g)
    for change in (c for c in CHANGES if c in by_change):
        some = by_change[change]
        total += [good(g) for g in some]
        lost = ", ".join(f"{g.case} ({', '.join(g.wrong) or g.verdict})" for g in some if not good(g))
        lines.append(f"| {change} | {sum(map(good, some))}/{len(some)} | {lost} |")
    lo, hi = wilson(sum(total), len(total))
    lines.append(f"\nAll changes: {sum(total)}/{len(total)} stay right ({100 * lo:.1f} to {100 * hi:.1f} %).")
    return "\n".join(lines)


def main() -> None:
    """See the module's text."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("-o", "--out", type=Path, required=True)
    parser.add_argument("--seed", type=int, required=True)
    parser.add_argument("--cases", type=int, default=20)
    parser.add_argument("--change", nargs="*", choices=list(CHANGES), default=list(CHANGES))
    parser.add_argument("--jobs", type=int, choices=(1, 2), default=1)
    given = parser.parse_args()
    given.out.mkdir(parents=True, exist_ok=True)
    kept, lock = given.out / "results.jsonl", Lock()
    results = [json.loads(line) for line in kept.read_text().splitlines()] if kept.exists() else []
    done = {(r["case"], r["change"]) for r in results}
    cases = base(given.seed, given.cases)

    def one(job: tuple[str, Case]) -> None:
        change, case = job
        folder = given.out / case.name / (change.replace(" ", "_").replace("/", "_per_").replace(":", "") or "as_it_is")
        question = Asked(case.training, [], dict(case.parameters))
        rng = np.random.default_rng([given.seed, len(change), *change.encode()])
        lay_out(CHANGES[change](question, case, rng) if change else question, case.model, folder)
        result = {"case": case.name, "change": change, **asked(folder)}
        with lock:
            results.append(result)
            with kept.open("a") as file:
                file.write(json.dumps(result) + "\n")
            print(
                f"{case.name}, {change or 'as it is'}: {result.get('answer', {}).get('verdict', 'no answer')}",
                flush=True,
            )

    def blind(change: str, case: Case) -> bool:
        return bool(BLIND.get(change, set()) & {fact["effect"] for fact in case.truth["concealed"]})

    jobs = [
        (change, case)
        for change in ("", *given.change)
        for case in cases
        if (case.name, change) not in done and not blind(change, case)
    ]
    with ThreadPoolExecutor(given.jobs) as pool:
        list(pool.map(one, jobs))
    print(report(results, {case.name: case.truth for case in cases}))


if __name__ == "__main__":
    main()
