"""``docs/concealed-first.md`` from graded cases: a pure function of results."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from benchmarks.concealed.deck import HARD
from benchmarks.concealed.grade import RULES, Grade
from benchmarks.concealed.oracle import LEAST_MISMATCH
from benchmarks.concealed.summary import Figure, confusion, figures, hard_figures
from hystid.files import write_text

INTRODUCTION = """\
# Physics concealed by the first generator

A virtual rig with its own laws and its own integrator (`benchmarks/concealed/laws.c`: no code shared with the
diagnosis or with the Modelica library, and mostly other forms of the effects than the library fits with) is run
with random parameters. The diagnosis gets four recordings of 8,000 samples, a baseline whose parameters are wrong
by up to 20 % (damping 40 %), and nothing else; the truth stays in sealed files. Strengths are drawn so that the
noise-free mismatch that survives a refit of the baseline is {least} to about 2.5 times the noise of F - m a: cases
below {least} are drawn again, so that none is impossible by noise alone, and so are added masses below 4.5 %, since a
mass that is given counts as weighed to 3.5 %. All channels pass one anti-aliasing filter
and carry white noise of 34 dB (hard variants: see there).

`make concealed` draws a fresh deck and writes this page. This one: `{command}`.
"""

COVERAGE = """\
Of a wave of 51 cases, 25 conceal one effect (every id once), 5 nothing (a null per baseline), 5 are decoys (held
force, 0.3 samples of delay, coloured noise, mains hum, coarse quantisation), 4 pairs, 2 effects that act in a
window only, 2 baselines of the wrong family, 5 physics from outside the catalogue (strangers) and 3 relatives of a
class in a form of their own.

What the deck does not show: records start from rest and wear starts anew with each of them (variant `running` cuts
records from a moving test, and is not part of the figures); noise is white but in the decoy; friction at reversals
and contact shocks are sampled through a sharp filter, whose ringing is part of the data; one degree of freedom
only.
"""

LAB_CASE = """\
`python examples/lab_case.py`: a virtual rig with stick-slip and a concealed loss of contact (its own Modelica
model, which is no effect block of the library), chirps with 34 dB of noise, a stick-slip baseline with wrong
parameters, and unseen harmonics at 20, 30, 40, 50 Hz.
"""


def table(rows: Sequence[Figure]) -> str:
    """Markdown table of figures."""
    lines = ["| figure | reached | 95 % interval or quartiles | cases | goal | met |", "|---|---|---|---|---|---|"]
    for f in rows:
        met = {None: "", True: "yes", False: "**no**"}[f.met]
        spread = (
            "" if f.interval is None or not f.cases else f"{_number(f, f.interval[0])} to {_number(f, f.interval[1])}"
        )
        lines.append(f"| {f.name} | {_number(f, f.value)} | {spread} | {f.cases} | {f.goal} | {met} |")
    return "\n".join(lines)


def _number(figure: Figure, value: float | None) -> str:
    if value is None:
        return "-"
    return f"{100 * value:.1f} %" if figure.percent else f"{value:.3g}"


def confusion_table(grades: Sequence[Grade]) -> str:
    """Concealed id against first answers, one line per id."""
    lines = ["| concealed | answers (times) |", "|---|---|"]
    for truth, answers in sorted(confusion(grades).items()):
        said = ", ".join(f"{name} {count}" for name, count in answers.most_common())
        lines.append(f"| {truth} | {said} |")
    return "\n".join(lines)


def failures(grades: Sequence[Grade]) -> str:
    """Every case that is not fully right."""
    lines = ["| case | group | concealed | verdict | named | what is wrong |", "|---|---|---|---|---|---|"]
    for g in grades:
        wrong = complaint(g)
        if wrong:
            row = (
                g.case,
                f"{g.group} {g.variant}",
                ", ".join(g.truth) or "-",
                g.verdict,
                ", ".join(g.answer) or "-",
                wrong,
            )
            lines.append("| " + " | ".join(row) + " |")
    return "\n".join(lines) if len(lines) > 2 else "None."


def complaint(g: Grade) -> str:
    """What is wrong with an answer, in a few words; empty when nothing is."""
    if g.status != "answered":
        return f"no answer: {g.status}"
    if g.false_alarm:
        return "false alarm"
    if g.wrong_name:
        return "wrong name"
    if g.class_right is False or g.unknown_right is False:
        return "missed"
    return "class only" if g.name_right is False else ""


def write_document(
    path: Path, seed: int, standard: Sequence[Grade], hard: Sequence[Grade], folder: Path, note: str = ""
) -> None:
    """Write the page; rivals and the deck without the true ids are added where their results lie in the folder."""
    options = f"--cases {len(standard)}" + (f" --hard {len(hard)}" if hard else "")
    command = f"python -m benchmarks.concealed.score --seed {seed} {options} -o build/concealed --doc"
    parts = [
        INTRODUCTION.format(least=LEAST_MISMATCH, command=command, seed=seed),
        *([note + "\n"] if note else []),
        COVERAGE,
        "## Rules\n",
        RULES,
        "\n## Result at 34 dB\n",
    ]
    parts.append(table(figures(standard)))
    parts.append("\n## Hard variants\n" if hard else "\nThe hard variants were not run for this page.\n")
    for variant in HARD:
        chosen = [g for g in hard if g.variant == variant]
        if chosen:
            parts += [f"### {variant}\n", table(hard_figures(chosen)), ""]
    if hard:
        parts += ["### all four together\n", table(hard_figures(hard)), ""]
    parts += [
        "## Confusion at 34 dB\n",
        "First finding of each answer; verdicts without a name in brackets.\n",
        confusion_table(standard),
    ]
    parts += ["\n## Every case that is not fully right\n", failures([*standard, *hard])]
    parts += _more(folder)
    write_text(path, "\n".join(parts) + "\n")


def _more(folder: Path) -> list[str]:
    parts: list[str] = []
    blind = folder / "results_without_truth.json"
    if blind.exists():
        parts += [
            "\n## The true id removed from the library\n",
            _without_truth(json.loads(blind.read_text(encoding="utf-8"))),
        ]
    rivals = folder / "rivals.json"
    if rivals.exists():
        parts += ["\n## Rivals on the same deck\n", rivals_table(json.loads(rivals.read_text(encoding="utf-8")))]
    lab = folder.parent / "lab_case" / "lab_case.txt"
    if lab.exists():
        parts += ["\n## The lab case\n", LAB_CASE, "```", lab.read_text(encoding="utf-8").rstrip(), "```"]
    return parts


def _without_truth(results: Mapping[str, Any]) -> str:
    cases = [g for g in results["standard"] if g["group"] in ("single", "part_time") and g["status"] == "answered"]
    unknown = sum(g["verdict"] == "unknown_physics" for g in cases)
    family = sum(bool(g["class_right"]) and not g["wrong_name"] for g in cases)
    wrong = sum(bool(g["wrong_name"]) for g in cases)
    rest = len(cases) - unknown - family - wrong
    return (
        f"{len(cases)} single effects, each diagnosed with its own id taken out of the library: {unknown} answered "
        f"unknown, {family} named a member of the class, {wrong} gave an unrelated name (some of them beside a member "
        f"of the class), {rest} found nothing missing."
    )


def rivals_table(results: Mapping[str, Any]) -> str:
    """Markdown table of rivals: share of right names, wrong names, false alarms, gain, time."""
    lines = [
        "| method | name right | class right | wrong name | false alarms | gain, median | CPU [s], median | cases |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for name, row in results.items():
        cells = [name]
        for key in ("name_right", "class_right", "wrong_name", "false_alarm"):
            cells.append("-" if row[key] is None else f"{100 * row[key]:.0f} %")
        cells += ["-" if row[key] is None else f"{row[key]:.2f}" for key in ("gain", "cpu_s")]
        cells.append(str(row["cases"]))
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines)
