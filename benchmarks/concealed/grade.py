"""Comparing one answer with its sealed truth. The rules stand in ``RULES`` and are printed with every result."""

from __future__ import annotations

import csv
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.concealed.answers import SUMS, same_family, same_name

RULES = """\
- *Name right*: every concealed id is named (an exact equivalent counts: stop and free play, added mass and force
  gain), and nothing outside its family is named. Dry friction plus preload counts for asymmetric friction.
- *Class right*: every concealed id is covered by a finding of its family or by a finding that lists it in `class`.
- *Wrong name*: at least one finding that is neither a concealed id nor of its family, and does not list it in
  `class`. On physics from outside the catalogue any name is wrong, unless the physics is a relative of a family.
- *False alarm*: any verdict but `consistent` and `recalibrated` where nothing is concealed. A channel delay found
  on a decoy that has one (0.3 samples; held force, which is half a sample late) is not one.
- *Unknown as unknown*: the verdict `unknown_physics` on physics from outside the catalogue.
- *Gain*: (before - after) / (before - oracle), free-run NRMSE of x on the held-out test; before and after from the
  answer, oracle from the true structure under the same measured force; cases where before - oracle < 0.005 are left
  out.
- *AUC*: score column of the mismatch files against "the effect acts with more than 20 % of its largest force";
  left out where that holds for less than 0.1 % or more than 90 % of the samples.
- *Parameters*: where the concealed form has the quantity under the block's own meaning; an interval of 90 % is
  value +- 1.645 standard errors."""

FOUND = ("missing_physics", "sensor_fault")
QUIET = ("consistent", "recalibrated")
LEAST_ROOM = 0.005


@dataclass(frozen=True)
class Grade:
    """One graded case. Quantities that do not apply are None."""

    case: str
    group: str
    variant: str
    truth: tuple[str, ...]
    answer: tuple[str, ...]
    verdict: str
    status: str = "answered"
    name_right: bool | None = None
    class_right: bool | None = None
    wrong_name: bool = False
    false_alarm: bool | None = None
    unknown_right: bool | None = None
    gain: float | None = None
    auc: float | None = None
    parameters: tuple[tuple[str, float, bool], ...] = ()
    cpu_s: float | None = None
    memory_MB: float | None = None
    notes: tuple[str, ...] = field(default=())


def grade(case: str, truth: Mapping[str, Any], answer: Mapping[str, Any], folder: Path, sealed: Path) -> Grade:
    """Grade an answer. answer: diagnosis.json; folder: of its mismatch files; sealed: of the strengths."""
    findings = answer["findings"]
    names = tuple(f["effect"] for f in findings)
    base = {
        "case": case,
        "group": truth["group"],
        "variant": truth["variant"],
        "answer": names,
        "verdict": answer["verdict"],
    }
    base["truth"] = tuple(truth["ids"]) or ((truth["decoy"],) if truth["decoy"] else ())
    group, verdict = truth["group"], answer["verdict"]
    accepted = truth["accepted"]
    if group in ("null", "decoy"):
        forgiven = bool(findings) and all(name in accepted for name in names)
        alarm = verdict not in QUIET and not forgiven
        return Grade(**base, false_alarm=alarm, wrong_name=alarm and bool(findings))
    if group in ("stranger", "relative", "wrong_baseline"):
        fair = [name for name in accepted if name != "unknown_physics"]
        covered = bool(findings) and all(any(_covers(f, name) for name in fair) for f in findings)
        unknown = verdict == "unknown_physics"
        return Grade(
            **base,
            unknown_right=unknown or covered,
            class_right=(covered or unknown) if fair else None,
            wrong_name=bool(findings) and not covered,
            auc=_auc(truth, case, folder, sealed) if group != "wrong_baseline" else None,
            gain=_gain(truth, answer),
        )
    ids = truth["ids"]
    right_class = verdict in FOUND and all(any(_covers(f, name) for f in findings) for name in ids)
    wrong = any(not any(_covers(f, name) for name in ids) and not _part_of(f["effect"], ids, names) for f in findings)
    right_name = verdict in FOUND and not wrong and all(_named(name, names) for name in ids)
    return Grade(
        **base,
        name_right=right_name,
        class_right=right_class or right_name,
        wrong_name=wrong,
        gain=_gain(truth, answer),
        auc=_auc(truth, case, folder, sealed),
        parameters=_parameters(truth, findings),
    )


def failed(case: str, truth: Mapping[str, Any], status: str) -> Grade:
    """Grade of a case without an answer: it counts against every rate that it belongs to."""
    group = truth["group"]
    ids = tuple(truth["ids"]) or ((truth["decoy"],) if truth["decoy"] else ())
    known = group in ("single", "pair", "part_time")
    return Grade(
        case, group, truth["variant"], ids, (), "none", status,
        name_right=False if known else None, class_right=False if known else None,
        false_alarm=True if group in ("null", "decoy") else None,
        unknown_right=None if known or group in ("null", "decoy") else False,
    )  # fmt: skip


def contract_problems(answer: Mapping[str, Any]) -> list[str]:
    """Where diagnosis.json departs from its contract; empty when it keeps it."""
    problems = [
        f"{key} is missing"
        for key in ("verdict", "baseline", "findings", "fit", "untestable", "next_experiment")
        if key not in answer
    ]
    if problems:
        return problems
    verdicts = (*FOUND, *QUIET, "unknown_physics", "not_applicable")
    if answer["verdict"] not in verdicts:
        problems.append(f"verdict {answer['verdict']} is none of the six")
    if bool(answer["findings"]) != (answer["verdict"] in FOUND):
        problems.append(f"{len(answer['findings'])} findings with the verdict {answer['verdict']}")
    for finding in answer["findings"]:
        missing = {"effect", "class", "confidence", "parameters", "where", "evidence"} - set(finding)
        problems += [f"finding without {key}" for key in sorted(missing)]
        if not 0 <= finding.get("confidence", 0) <= 1:
            problems.append("confidence outside 0..1")
    problems += [
        f"fit without {key}" for key in ("force_nrmse", "free_run_x_nrmse", "holdout") if key not in answer["fit"]
    ]
    return problems


def _covers(finding: Mapping[str, Any], name: str) -> bool:
    return same_family(finding["effect"], name) or name in finding["class"]


def _named(name: str, answers: Sequence[str]) -> bool:
    whole = any(same_name(answer, name) for answer in answers)
    return whole or (name in SUMS and SUMS[name] <= set(answers))


def _part_of(effect: str, ids: Sequence[str], names: Sequence[str]) -> bool:
    return any(effect in SUMS[name] and SUMS[name] <= set(names) for name in ids if name in SUMS)


def _gain(truth: Mapping[str, Any], answer: Mapping[str, Any]) -> float | None:
    oracle, held = truth["oracle"]["holdout_truth"], answer["fit"].get("holdout") or []
    if oracle is None or not held or held[0].get("before") is None or held[0].get("after") is None:
        return None
    before, after = held[0]["before"], held[0]["after"]
    return None if before - oracle < LEAST_ROOM else (before - after) / (before - oracle)


def _parameters(truth: Mapping[str, Any], findings: Sequence[Mapping[str, Any]]) -> tuple[tuple[str, float, bool], ...]:
    """(id.quantity, relative error, covered by the 90 % interval) for quantities that the answer states as well."""
    compared = []
    for effect in truth["effects"]:
        for finding in findings:
            if finding["effect"] != effect["id"]:
                continue
            for name, (value, _unit) in effect["quantities"].items():
                stated = finding["parameters"].get(name)
                if stated is None or stated.get("value") is None:
                    continue
                error = abs(stated["value"]) - abs(value) if name == "gap" else stated["value"] - value
                width = 1.645 * (stated.get("stderr") or 0.0)
                compared.append((f"{effect['id']}.{name}", abs(error / value), abs(error) <= width))
    return tuple(compared)


def _auc(truth: Mapping[str, Any], case: str, folder: Path, sealed: Path) -> float | None:
    strengths, scores = [], []
    for name in truth["strength"]:
        file = folder / f"mismatch_{name}.csv"
        strength = np.load(sealed / f"{case}_{name}.npy")
        if not file.exists():
            return None
        score = _column(file, "score")
        if len(score) != len(strength):
            return None
        strengths.append(strength)
        scores.append(score)
    acts = np.concatenate(strengths)
    acts = acts > 0.2 * np.max(acts)
    if not 0.001 < acts.mean() < 0.9:
        return None
    return area_under_curve(np.concatenate(scores), acts)


def _column(file: Path, name: str) -> np.ndarray[Any, np.dtype[np.float64]]:
    with file.open(encoding="utf-8", newline="") as text:
        header = next(csv.reader(text))
        index = next(i for i, title in enumerate(header) if title.split("[")[0].strip() == name)
        return np.loadtxt(text, delimiter=",", usecols=index, ndmin=1)


def area_under_curve(score: np.ndarray[Any, Any], positive: np.ndarray[Any, Any]) -> float:
    """Probability that a positive sample has the higher score (ties count half)."""
    from scipy.stats import rankdata

    ranks = rankdata(np.nan_to_num(score))
    n, m = int(np.sum(positive)), int(np.sum(~positive))
    return float((np.sum(ranks[positive]) - n * (n + 1) / 2) / (n * m))
