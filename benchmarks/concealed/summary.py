"""Rates with Wilson intervals, medians, and the confusion matrix of graded cases."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from benchmarks.concealed.grade import Grade

ONE = ("single", "part_time")


@dataclass(frozen=True)
class Figure:
    """One line of the table: text, what was reached, its interval, how many cases, the goal and whether it is met."""

    name: str
    value: float | None
    interval: tuple[float, float] | None
    cases: int
    goal: str
    met: bool | None
    percent: bool = True


def wilson(hits: int, cases: int, z: float = 1.96) -> tuple[float, float]:
    """95 % interval of a rate (Wilson, 1927)."""
    if cases == 0:
        return 0.0, 1.0
    p, n = hits / cases, cases
    centre, half = p + z * z / (2 * n), z * np.sqrt(p * (1 - p) / n + z * z / (4 * n * n))
    return max(0.0, float((centre - half) / (1 + z * z / n))), min(1.0, float((centre + half) / (1 + z * z / n)))


def figures(grades: Sequence[Grade]) -> list[Figure]:
    """The table of a standard deck."""
    one = [g for g in grades if g.group in ONE]
    physics = [g for g in grades if g.group in (*ONE, "pair")]
    nulls, decoys = ([g for g in grades if g.group == name] for name in ("null", "decoy"))
    strangers = [g for g in grades if g.group == "stranger"]
    kin = [g for g in grades if g.group in ("relative", "wrong_baseline")]
    stated = [p for g in grades for p in g.parameters]
    return [
        _rate("class right, one effect", (g.class_right for g in one), 0.95),
        _rate("name right, one effect", (g.name_right for g in one), 0.90),
        _rate("wrong name, one effect", (g.wrong_name for g in one), 0.02, most=True),
        _rate("wrong name, all cases", (g.wrong_name for g in grades), 0.02, most=True),
        _rate("false alarm, nulls", (g.false_alarm for g in nulls), 0.01, most=True),
        _rate("false alarm, decoys", (g.false_alarm for g in decoys), 0.03, most=True),
        _rate("unknown as unknown, strangers", (g.verdict == "unknown_physics" for g in strangers), 0.90),
        _rate("unknown or family, relatives and wrong baselines", (g.class_right for g in kin), None),
        _rate("both of two effects, by class", (g.class_right for g in grades if g.group == "pair"), 0.75),
        _rate("both of two effects, by name", (g.name_right for g in grades if g.group == "pair"), None),
        _median("held-out gain over the oracle's, median", (g.gain for g in physics), 0.97),
        _median("localisation AUC, median", (g.auc for g in physics), 0.95),
        _median("parameter error, median", (p[1] for p in stated), 0.10, most=True, percent=True),
        _band("90 % intervals that cover", [p[2] for p in stated], 0.85, 0.95),
        _median("processor time per case [s], median", (g.cpu_s for g in grades), 10.0, most=True),
        _largest("processor time per case [s], largest", (g.cpu_s for g in grades)),
        _largest("memory [MB], largest", (g.memory_MB for g in grades)),
        _rate("no answer (error or time limit)", (g.status != "answered" for g in grades), None),
    ]


def hard_figures(grades: Sequence[Grade]) -> list[Figure]:
    """The table of one hard variant."""
    one = [g for g in grades if g.group in ONE]
    quiet = [g for g in grades if g.group in ("null", "decoy")]
    return [
        _rate("class right, one effect", (g.class_right for g in one), 0.80),
        _rate("name right, one effect", (g.name_right for g in one), None),
        _rate("wrong name, one effect", (g.wrong_name for g in one), 0.05, most=True),
        _rate("false alarm, nulls and decoys", (g.false_alarm for g in quiet), None),
    ]


def confusion(grades: Sequence[Grade]) -> dict[str, Counter[str]]:
    """Concealed id -> how often which first answer; abstentions by verdict. Single effects, nulls and decoys."""
    table: dict[str, Counter[str]] = {}
    for g in grades:
        if g.group not in (*ONE, "null", "decoy", "stranger", "relative"):
            continue
        truth = {"null": "(nothing)", "decoy": f"({g.truth[0]})" if g.truth else "(decoy)"}.get(g.group) or g.truth[0]
        table.setdefault(truth, Counter())[g.answer[0] if g.answer else f"({g.verdict})"] += 1
    return table


def _rate(name: str, hits: Iterable[bool | None], goal: float | None, most: bool = False) -> Figure:
    known = [h for h in hits if h is not None]
    share = float(np.mean(known)) if known else None
    text = "" if goal is None else f"{'<=' if most else '>='} {100 * goal:.0f} %"
    met = None if goal is None or share is None else (share <= goal if most else share >= goal)
    return Figure(name, share, wilson(sum(known), len(known)), len(known), text, met)


def _median(
    name: str, values: Iterable[float | None], goal: float, most: bool = False, percent: bool = False
) -> Figure:
    known = [v for v in values if v is not None]
    value = float(np.median(known)) if known else None
    text = f"{'<=' if most else '>='} {f'{100 * goal:.0f} %' if percent else f'{goal:g}'}"
    quartiles = (float(np.percentile(known, 25)), float(np.percentile(known, 75))) if known else None
    met = None if value is None else (value <= goal if most else value >= goal)
    return Figure(name, value, quartiles, len(known), text, met, percent)


def _band(name: str, hits: Sequence[bool], low: float, high: float) -> Figure:
    share = float(np.mean(hits)) if hits else None
    met = None if share is None else low <= share <= high
    return Figure(name, share, wilson(sum(hits), len(hits)), len(hits), f"{100 * low:.0f}-{100 * high:.0f} %", met)


def _largest(name: str, values: Iterable[float | None]) -> Figure:
    known = [v for v in values if v is not None]
    return Figure(name, max(known) if known else None, None, len(known), "", None, percent=False)
