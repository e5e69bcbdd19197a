"""The table of a deck: ``python -m benchmarks.proof.score DIR ... [--json FILE] [--picture FILE.svg]``.

Every share stands with its count and the interval of Wilson at 95 %.
"""

from __future__ import annotations

import argparse
import json
from collections import defaultdict
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.pictures import Panel, write

NAMING = ("missing_physics", "sensor_fault")
ALARMS = (*NAMING, "unknown_physics")


@dataclass(frozen=True)
class Grade:
    """One answer against the truth. ``matched``, ``exact``: truth names that were met by class and by name; ``wrong``:
    names that are neither right nor allowed; ``rated``: (confidence, right by class) of every name."""

    case: str
    kind: str
    truth: dict[str, Any]
    result: dict[str, Any]
    verdict: str
    names: int
    matched: int
    exact: int
    wrong: tuple[str, ...]
    rated: tuple[tuple[float, bool], ...]

    @property
    def right_class(self) -> bool:
        """Every concealed effect met by class, and nothing wrong beside it."""
        return self.names > 0 and self.matched == self.names and not self.wrong

    @property
    def right_name(self) -> bool:
        """Every concealed effect met by its own name."""
        return self.right_class and self.exact == self.names

    @property
    def alarm(self) -> bool:
        """Something said to be missing that the truth does not allow."""
        return bool(self.wrong) or (
            self.verdict in ALARMS and self.verdict not in self.truth["expect"]["verdicts"] and not self._excused
        )

    @property
    def _excused(self) -> bool:
        findings = self.result.get("answer", {}).get("findings", [])
        return bool(findings) and self.verdict in NAMING and not self.wrong


def grade(truth: dict[str, Any], result: dict[str, Any]) -> Grade:
    """The answer of one line of ``results.jsonl`` against its truth."""
    answer = result.get("answer") or {}
    verdict = answer.get("verdict") or ("refused" if "refused" in result else "crashed")
    findings = answer.get("findings", []) if verdict in NAMING else []
    expected, allowed = truth["expect"]["names"], set(truth["expect"]["allowed"])
    said = [f["effect"] for f in findings]
    matched, exact, used = 0, 0, set()
    for name in expected:
        for k, finding in enumerate(findings):
            if k not in used and _meets(name, finding):
                used.add(k)
                matched += 1
                exact += finding["effect"] == name["effect"]
                break
        else:
            for both in (c.split("+") for c in name["class"] if "+" in c):
                if all(effect in said for effect in both):
                    used |= {said.index(effect) for effect in both}
                    matched += 1
    rated, wrong = [], []
    for k, finding in enumerate(findings):
        if k not in used and finding["effect"] in allowed:
            continue
        rated.append((float(finding["confidence"]), k in used))
        if k not in used:
            wrong.append(finding["effect"])
    return Grade(
        truth["case"], truth["kind"], truth, result, verdict, len(expected), matched, exact, tuple(wrong), tuple(rated)
    )


def _meets(name: dict[str, Any], finding: dict[str, Any]) -> bool:
    return finding["effect"] in name["class"] or name["effect"] in finding.get("class", [])


def wilson(hits: int, n: int) -> tuple[float, float]:
    """Interval of a share at 95 %."""
    if n == 0:
        return 0.0, 1.0
    z, p = 1.96, hits / n
    middle = (p + z * z / (2 * n)) / (1 + z * z / n)
    half = z * np.sqrt(p * (1 - p) / n + z * z / (4 * n * n)) / (1 + z * z / n)
    return max(0.0, middle - half), min(1.0, middle + half)


def calibration(rated: Iterable[tuple[float, bool]], bins: int = 10) -> tuple[float, list[dict[str, float]]]:
    """Expected calibration error, and the bins of the reliability diagram."""
    pairs = list(rated)
    total, out, error = len(pairs), [], 0.0
    for k in range(bins):
        inside = [(c, ok) for c, ok in pairs if k / bins <= c < (k + 1) / bins or (k == bins - 1 and c >= 1)]
        if inside:
            said, right = float(np.mean([c for c, _ in inside])), float(np.mean([ok for _, ok in inside]))
            error += len(inside) / total * abs(said - right)
            out.append({"count": len(inside), "said": said, "right": right})
    return error, out


def reliability(rated: Sequence[tuple[float, bool]]) -> Panel:
    """How often names are right over how sure they are said to be, with intervals of 95 % and the number of names."""
    error, bins = calibration(rated)
    panel = Panel(f"{len(rated)} names, calibration error {error:.3f}", "probability as stated", "share that is right")
    panel.limits = (0.4, 1.05)
    panel.line([0.5, 1.0], [0.5, 1.0], "linear", "as stated", dash="4 3")
    for one in bins:
        count = int(one["count"])
        low, high = wilson(round(one["right"] * count), count)
        panel.line([one["said"], one["said"]], [low, high], "published")
    panel.line([one["said"] for one in bins], [one["right"] for one in bins], "published", "found", dash="dots")
    return panel


def gains(grades: Iterable[Grade]) -> list[tuple[float, bool]]:
    """(before - after)/(before - oracle) of the force error, for right answers, per recording with an oracle; and
    whether a fit can know that recording: not where it is of another tension, or where an effect acts at its own times.
    """
    out = []
    for g in grades:
        answer = g.result.get("answer") or {}
        oracle = {o["recording"]: o["force_nrmse"] for o in g.truth["oracle"] if o["force_nrmse"] is not None}
        listed = answer.get("fit", {}).get("holdout", []) if g.right_class else []
        for kind, held in zip(g.truth["holdouts"], listed, strict=False):
            before, after = held.get("force_before"), held.get("force_after")
            best = oracle.get(held["name"])
            if None not in (before, after, best) and before > 1.2 * best:
                known = kind != "other_tension" and g.kind != "part_time"
                out.append(((before - after) / (before - best), known))
    return out


def covered(grades: Iterable[Grade]) -> list[bool]:
    """Whether intervals of 90 % hold the true value: parameters of right names whose law is the library's own."""
    out = []
    for g in grades:
        findings = (g.result.get("answer") or {}).get("findings", []) if g.right_name else []
        for name in g.truth["expect"]["names"]:
            for finding in findings:
                if finding["effect"] != name["effect"] or (finding.get("evidence") or {}).get("form"):
                    continue
                for parameter, true in name["parameters"].items():
                    told = finding["parameters"].get(parameter)
                    if told and told.get("stderr"):
                        out.append(bool(abs(told["value"] - true) <= 1.645 * told["stderr"]))
    return out


def _share(label: str, grades: list[Grade], test: Callable[[Grade], bool], mark: str = "") -> str:
    hits = sum(test(g) for g in grades)
    lo, hi = wilson(hits, len(grades))
    value = (
        f"{100 * hits / len(grades):.1f} % ({hits}/{len(grades)}, {100 * lo:.0f} to {100 * hi:.0f})"
        if grades
        else "no case"
    )
    return f"| {label} | {value} | {mark} |"


def noise_level(truth: dict[str, Any]) -> str:
    """The deck's noise level in words."""
    return "none" if truth["snr"] is None else f"{truth['snr']:g} dB"


def kept(grades: list[Grade], alone: list[Grade]) -> list[tuple[str, bool]]:
    """(kind of held-out recording, whether a right answer without held-out recordings stands with them)."""
    without = {g.case: g for g in alone if g.right_class}
    out = []
    for g in grades:
        if g.case in without:
            same = {f["effect"] for f in g.result.get("answer", {}).get("findings", [])}
            before = {f["effect"] for f in without[g.case].result["answer"]["findings"]}
            out += [(holdout, g.verdict in NAMING and same == before) for holdout in g.truth["holdouts"]]
    return out


def table(grades: list[Grade], alone: list[Grade]) -> str:
    """The figures of the proof, in Markdown."""
    of = {kind: [g for g in grades if g.kind == kind] for kind in dict.fromkeys(g.kind for g in grades)}
    standard = [g for g in of.get("single", []) if g.truth["snr"] == 34]
    rows = ["| figure | reached (95 % interval) | mark |", "|---|---|---|"]
    for label, some in (("34 dB", standard), ("all noise levels", of.get("single", []))):
        rows.append(_share(f"one effect, class right, {label}", some, lambda g: g.right_class, ">= 97 %"))
        rows.append(_share(f"one effect, exact name, {label}", some, lambda g: g.right_name, ">= 93 %"))
    rows.append(_share("wrong name, all cases", grades, lambda g: bool(g.wrong), "<= 0.5 %"))
    rows.append(_share("false alarm, nulls", of.get("null", []), lambda g: g.alarm, "<= 0.5 %"))
    rows.append(_share("false alarm, decoys", of.get("decoy", []), lambda g: g.alarm, "<= 2 %"))
    rows.append(
        _share("unknown as unknown", of.get("stranger", []), lambda g: g.verdict == "unknown_physics", ">= 95 %")
    )
    rows.append(_share("two effects, both by class", of.get("pair", []), lambda g: g.right_class, ">= 85 %"))
    rows.append(
        _share("two effects, at least one, none wrong", of.get("pair", []), lambda g: g.matched > 0 and not g.wrong)
    )
    rows.append(_share("part-time effect, by class", of.get("part_time", []), lambda g: g.right_class, ">= 85 %"))
    rows.append(_share("sensor fault, by class", of.get("sensor", []), lambda g: g.right_class))
    rows.append(_share("sensor fault beside physics, both", of.get("sensor_and_physics", []), lambda g: g.right_class))
    stays = kept(grades, alone)
    hits = sum(same for _, same in stays)
    lo, hi = wilson(hits, len(stays))
    rows.append(
        f"| kept under held-out recordings | {hits}/{len(stays)} ({100 * lo:.0f} to {100 * hi:.0f} %) | >= 98 % |"
    )
    rated = [pair for g in grades for pair in g.rated]
    error, bins = calibration(rated)
    rows.append(f"| calibration error (ECE), {len(rated)} names | {error:.3f} | <= 0.05 |")
    gained, inside = gains(grades), covered(grades)
    for what, some in (("", [g for g, _ in gained]), (" that a fit can know", [g for g, known in gained if known])):
        median = np.median(some or [np.nan])
        rows.append(f"| gain over the oracle's, median of {len(some)}{what} | {median:.4f} | >= 0.99 |")
    share_inside = 100 * np.mean(inside) if inside else float("nan")
    rows.append(
        f"| intervals of 90 % that hold the truth, {len(inside)} parameters | {share_inside:.0f} % | 86 to 94 % |"
    )
    time = [g.result["cpu"] for g in grades if g.result.get("cpu")]
    rows.append(
        f"| processor time, median / largest | {np.median(time):.1f} s / {max(time):.1f} s | <= 4 s / <= 12 s |"
    )
    rows.append(_share("refused at the door", grades, lambda g: g.verdict == "refused"))
    rows.append(_share("crashed", grades, lambda g: g.verdict == "crashed"))
    parts = ["\n".join(rows)]
    parts.append(_split("one effect, by noise", of.get("single", []), lambda g: noise_level(g.truth)))
    parts.append(_split("one effect, by id", of.get("single", []), lambda g: g.truth["expect"]["names"][0]["effect"]))
    parts.append(
        _split("one effect, by share of R", of.get("single", []), lambda g: _bin(g.truth["concealed"][0]["share_of_R"]))
    )
    parts.append(_split("one effect, by rms over noise", of.get("single", []), _over_noise))
    parts.append(
        _split(
            "one effect, by what the best other law takes",
            of.get("single", []),
            lambda g: _bin(g.truth["concealed"][0]["rival_takes"]),
        )
    )
    parts.append(_split("one effect, by channels", of.get("single", []), _channels))
    parts.append(_split("one effect, by chain", of.get("single", []), lambda g: g.truth["chain"]))
    parts.append(
        _split(
            "nulls, by noise (right: no alarm)",
            of.get("null", []),
            lambda g: noise_level(g.truth),
            lambda g: not g.alarm,
        )
    )
    parts.append(
        _split("decoys (right: no alarm)", of.get("decoy", []), lambda g: g.truth["decoy"], lambda g: not g.alarm)
    )
    parts.append(
        _split(
            "strangers (right: unknown)",
            of.get("stranger", []),
            lambda g: g.truth["stranger"],
            lambda g: g.verdict == "unknown_physics",
        )
    )
    by_holdout: dict[str, list[bool]] = defaultdict(list)
    for holdout, same in stays:
        by_holdout[holdout].append(same)
    if by_holdout:
        parts.append(
            "Kept, by kind of held-out recording: "
            + ", ".join(f"{k} {sum(v)}/{len(v)}" for k, v in sorted(by_holdout.items()))
        )
    parts.append(
        "Reliability (said: right, count): "
        + ", ".join(f"{b['said']:.2f}: {b['right']:.2f} ({b['count']:.0f})" for b in bins)
    )
    return "\n\n".join(part for part in parts if part)


def _split(
    title: str, grades: list[Grade], by: Callable[[Grade], str], right: Callable[[Grade], bool] | None = None
) -> str:
    groups: dict[str, list[Grade]] = defaultdict(list)
    for g in grades:
        groups[by(g)].append(g)
    test = right or (lambda g: g.right_class)
    lines = [f"{title}:"] if groups else []
    for key, some in sorted(groups.items()):
        hits = sum(test(g) for g in some)
        wrong = sorted({f"{g.case}: {', '.join(g.wrong)}" for g in some if g.wrong})
        lo, hi = wilson(hits, len(some))
        line = f"- {key}: {hits}/{len(some)} right ({100 * lo:.0f} to {100 * hi:.0f} %)"
        lines.append(line + (f"; wrong names: {'; '.join(wrong)}" if wrong else ""))
    return "\n".join(lines)


def _bin(value: float) -> str:
    for edge in (0.05, 0.1, 0.2, 0.4, 0.7, 0.9, 0.97):
        if value < edge:
            return f"below {100 * edge:02.0f} %"
    return "from 97 %"


def _channels(g: Grade) -> str:
    made = f" ({g.truth['derived']})" if g.truth["derived"] else ""
    return "".join(g.truth["channels"][1:]) + made


def _over_noise(g: Grade) -> str:
    value = g.truth["concealed"][0]["to_noise"]
    return "no noise" if value is None else next((f"below {e:g}" for e in (0.3, 1, 3, 10) if value < e), "from 10")


def read(folders: Iterable[Path]) -> tuple[list[Grade], list[Grade]]:
    """Grades with held-out recordings, and without where they were asked both ways."""
    keep, drop = [], []
    for folder in folders:
        for line in (folder / "results.jsonl").read_text().splitlines():
            result = json.loads(line)
            truth = json.loads((folder / "truth" / f"{result['case']}.json").read_text())
            (keep if result["holdouts"] == "keep" else drop).append(grade(truth, result))
    return (keep, drop) if keep else (drop, [])


def main() -> None:
    """See the module's text."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folders", type=Path, nargs="+")
    parser.add_argument("--json", type=Path, help="also one line per case: verdict, right by class, exact, wrong names")
    parser.add_argument("--picture", type=Path, help="also the reliability diagram of the names")
    given = parser.parse_args()
    grades, alone = read(given.folders)
    print(table(grades, alone))
    if given.picture:
        panel = reliability([pair for g in grades for pair in g.rated])
        write(given.picture, "How sure, and how often right", [panel], 1, (460, 340))
    if given.json:
        given.json.write_text(
            "".join(
                json.dumps(
                    {
                        "case": g.case,
                        "verdict": g.verdict,
                        "right_class": g.right_class,
                        "right_name": g.right_name,
                        "wrong": g.wrong,
                        "alarm": g.alarm,
                        "rated": g.rated,
                    }
                )
                + "\n"
                for g in grades
            )
        )


if __name__ == "__main__":
    main()
