"""The demo's page: the story in order, with the targets on top."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from hystid.diagnosis import Traces
from hystid.recording import Recording
from hystid.report.curves import X_AXIS, Curve, loops, over_time
from hystid.report.diagnosis import value_text
from hystid.report.page import Cell, Fact, Page, Table, Verdict, number, percent
from hystid.report.plots import Axis, Band, Bars, Line, Plot, Role, Series
from hystid.report.validation import content
from hystid.validation import ValidationCase
from hystid.virtual_experiment.lab import LabCase, UnseenTest
from hystid.virtual_experiment.reference_study import (
    BAND,
    CHIRPS,
    DT,
    EVERY,
    LAYERS,
    MODEL,
    NOISE_DB,
    TESTS,
    ReferenceStudy,
)
from hystid.virtual_experiment.targets import Outcome

_TRUE_GAP = 1.2e-3


def write_page(study: ReferenceStudy, lab: LabCase, outcome: Outcome, path: Path) -> Path:
    """Write the page."""
    met = sum(check.passed for check in outcome.checks)
    total = len(outcome.checks)
    page = Page(
        "From recordings to a checked model, and to the physics that it lacks",
        subtitle="A virtual experiment, end to end: everything below was computed in this run",
        command="hystid demo",
        verdict=Verdict("good" if outcome.passed else "bad", f"{met} of {total} targets met", _summary(study, lab)),
        facts=_facts(study, lab),
    )
    _targets(page, outcome)
    _experiment(page, study)
    _surrogate(page, study)
    _concealed(page, lab)
    _diagnosis(page, lab)
    _prediction(page, lab)
    _files(page, lab)
    return page.write(path)


def _summary(study: ReferenceStudy, lab: LabCase) -> str:
    force = float(np.median(study.validation.figures("force_nrmse")))
    if not lab.named:
        found = f"The diagnosis says: {lab.diagnosis.verdict.replace('_', ' ')}."
    else:
        found = "A loss of contact, concealed from the model, is found, named, located and written as Modelica."
    return f"A surrogate FMU learned from noisy chirps follows unseen tests to {percent(force)} of the force. {found}"


def _facts(study: ReferenceStudy, lab: LabCase) -> list[Fact]:
    force, motion = study.validation.figures("force_nrmse"), study.validation.figures("x_nrmse")
    before, after = (float(np.median([test.error(kind) for test in lab.tests])) for kind in ("refitted", "extended"))
    size = (study.reference.parent / "identification" / "surrogate.fmu").stat().st_size
    found = lab.diagnosis.findings[0].title if lab.diagnosis.findings else "nothing"
    worst = f"worst {percent(float(force.max()))}"
    return [
        Fact("Surrogate: force NRMSE", percent(float(np.median(force))), f"median of {force.size} tests, {worst}"),
        Fact(
            "Surrogate: free run, x NRMSE", percent(float(np.median(motion))), f"worst {percent(float(motion.max()))}"
        ),
        Fact("Surrogate FMU", f"{size / 1000:.0f} kB", "plain C inside, no runtime"),
        Fact("Diagnosed", found, "concealed: contact loss"),
        Fact("Unseen free run", f"{percent(before)} → {percent(after)}", "stick-slip model → diagnosed model, median"),
    ]


def _targets(page: Page, outcome: Outcome) -> None:
    page.section("Targets", "What this run had to reach, and what it reached.")
    rows: list[list[str | Cell]] = [
        [check.part, check.what, Cell(check.value_text, "good" if check.passed else "bad"), check.limit_text]
        for check in outcome.checks
    ]
    page.table(Table("Results against targets", ["part", "target", "reached", "asked"], rows))


def _experiment(page: Page, study: ReferenceStudy) -> None:
    page.section(
        "1  A virtual rig from Modelica",
        f"{MODEL} is one mass on a spring, a damper and a contact that sticks and slips:"
        f" m\u00a0a\u00a0+\u00a0R\u00a0=\u00a0F. It was compiled from Modelica to an FMU and shaken by {len(CHIRPS)}"
        f" chirps of 0 to 100 Hz. F, x, v and a were recorded every {DT * 1e3:g} ms with"
        f" {NOISE_DB:g} dB of noise. Nothing else goes into the training.",
    )
    chirps = [
        over_time(
            f"{label} chirp: displacement", X_AXIS, [Curve("x", r.t, r.channel("x"), "measured")], r.name, height=260
        )
        for label, r in (("Weakest", study.recordings[0]), ("Strongest", study.recordings[-1]))
    ]
    page.plots(*chirps)


def _surrogate(page: Page, study: ReferenceStudy) -> None:
    found = study.identification
    page.section(
        "2  The surrogate follows tests that it has not seen",
        f"The recordings were band-limited to {BAND[1]:g} Hz without phase shift and reduced by {EVERY}."
        f" Two networks ({'-'.join(map(str, LAYERS))} neurons each) learned the restoring force with its memory;"
        f" {len(found.chosen)} of {len(found.starts)} trainings are averaged. Surrogate and reference FMU were then"
        f" driven by {len(TESTS)} harmonic forces without noise.",
    )
    cases = study.validation.cases
    names = [_short(case.name) for case in cases]
    bars = [
        Bars(names, 100 * study.validation.figures("force_nrmse"), "force on the reference motion", "model"),
        Bars(names, 100 * study.validation.figures("x_nrmse"), "displacement, free run", "third"),
    ]
    page.plots(Plot("Error of every unseen test", Axis("Test"), Axis("NRMSE", "%"), bars, "Shorter is better."))
    page.text("Last cycles of every test, surrogate in free run with the mass:")
    page.plots(*(_loop(case) for case in cases))
    page.text("Harmonics of the restoring force, at the lowest and the highest frequency:")
    page.plots(content(cases[0]), content(cases[-1]))


def _loop(case: ValidationCase) -> Plot:
    record = case.reference
    last = slice(-round(0.1 / record.dt), None)
    run = case.free_run
    x, R = (run.x, run.R) if run else (record.channel("x"), case.force)
    curves = [
        Curve("reference", record.channel("x")[last], record.channel("R")[last], "reference"),
        Curve("surrogate", x[last], R[last], "model"),
    ]
    caption = f"Force NRMSE {percent(case.force_nrmse)}, free-run x {percent(run.x_nrmse if run else None)}."
    return replace(loops(_short(case.name), curves, caption), height=280)


def _concealed(page: Page, lab: LabCase) -> None:
    page.section(
        "3  A rig that conceals something",
        "The second rig is believed to be the same stick-slip joint. It is not: beyond a certain displacement its"
        " surfaces lift off on one side. Its recordings show it as even harmonics, which no stick-slip joint can give,"
        " because such a joint answers push and pull alike. A surrogate network trained on the same recordings"
        " reproduces the even harmonics: it fits, but it says nothing about their cause.",
    )
    names = [_short(test.recorded.name) for test in lab.tests]
    floor = -90.0
    kinds: list[tuple[str, str, Role]] = [
        ("recorded", "recorded", "measured"),
        ("refitted", "stick-slip model, refitted", "before"),
        ("network", "surrogate network", "third"),
    ]
    bars = []
    for kind, label, role in kinds:
        levels = np.array([test.even_db(kind) for test in lab.tests])
        bars.append(Bars(names, np.fmax(levels, floor), label, role, base=floor))
    axis = Axis("Level re fundamental", "dB", bounds=(floor, 0), prefix=False)
    caption = "Longer bars are stronger. The refitted stick-slip model has next to none."
    page.plots(Plot("Even harmonics on the unseen tests", Axis("Test"), axis, bars, caption))


def _diagnosis(page: Page, lab: LabCase) -> None:
    found = lab.diagnosis
    page.section("4  What the diagnosis says")
    said = f"{found.verdict.replace('_', ' ').capitalize()}: {found.headline}"
    page.verdict(Verdict("good" if lab.named else "bad", said))
    for finding in found.findings:
        truth = {"gap": number(_TRUE_GAP, "m"), "share": "0.9", "w": number(1e-4, "m"), "side": "+1 (x > 0)"}
        rows = [[name, value_text(finding, name), truth.get(name, "")] for name in finding.parameters]
        title = finding.title.capitalize()
        page.table(
            Table(title, ["parameter", "found ± standard error", "concealed truth"], rows, f"It {finding.where.text}.")
        )
    traces = [trace for trace in found.traces if not trace.held_out]
    if traces:
        page.plots(_missing_force(max(traces, key=lambda trace: float(np.max(np.abs(trace.x))))))
    model = lab.folder / "extended.mo"
    if model.exists():
        page.text("The extended model, as the diagnosis wrote it:")
        page.code(model.read_text(encoding="utf-8"))


def _missing_force(trace: Traces) -> Plot:
    """Mean and scatter of what the baseline leaves, over displacement."""
    edges = np.quantile(trace.x, np.linspace(0, 1, 121))
    bin_of = np.clip(np.searchsorted(edges, trace.x, side="right") - 1, 0, 119)
    count = np.maximum(np.bincount(bin_of, minlength=120), 1)
    x, left, named, square = (
        np.bincount(bin_of, weights=values, minlength=120) / count
        for values in (trace.x, trace.residual, trace.effect, trace.residual**2)
    )
    scatter = np.sqrt(np.maximum(square - left**2, 0.0))
    series: list[Series] = [
        Band(x, left - scatter, left + scatter, "its scatter (one standard deviation)", "muted"),
        Line(x, left, "left by the refitted stick-slip model, mean", "before"),
        Line(x, named, "force of the named effect, mean", "after"),
    ]
    caption = f"{trace.name}, in 120 classes of displacement with equally many samples."
    return Plot("Missing force over displacement", X_AXIS, Axis("Force", "N"), series, caption)


def _prediction(page: Page, lab: LabCase) -> None:
    page.section(
        "5  The extended model predicts unseen tests",
        "Each model is driven by the recorded force alone, from rest. The oracle is the rig's own set of equations:"
        " what it leaves comes from the noise of the recording and of its force, and no model can do better.",
    )
    names = [_short(test.recorded.name) for test in lab.tests]
    kinds: list[tuple[str, str, Role]] = [
        ("refitted", "stick-slip model, refitted", "before"),
        ("network", "surrogate network", "third"),
        ("extended", "diagnosed model", "after"),
        ("oracle", "oracle", "muted"),
    ]
    rows = [
        [name, *(percent(test.error(kind), 3) for kind, _, _ in kinds), f"{ratio:.3f}"]
        for name, test, ratio in zip(names, lab.tests, lab.ratios(), strict=True)
    ]
    columns = ["unseen test", *(label for _, label, _ in kinds), "diagnosed / oracle"]
    page.table(Table("Free-run NRMSE of the displacement", columns, rows))
    bars = [
        Bars(names, np.array([100 * test.error(kind) for test in lab.tests]), label, role)
        for kind, label, role in kinds
    ]
    error = Axis("x NRMSE", "%", log=True)
    caption = "Logarithmic. Shorter is better."
    page.plots(Plot("Free run on unseen tests", Axis("Test"), error, bars, caption))
    for test in (lab.tests[0], lab.tests[-1]):
        page.plots(*_before_and_after(test))


def _before_and_after(test: UnseenTest) -> tuple[Plot, Plot]:
    last = slice(-round(2 / (test.frequency * test.recorded.dt)), None)

    def cycle(name: str, record: Recording, role: Role) -> Curve:
        return Curve(name, record.channel("x")[last], record.channel("R")[last], role)

    name = _short(test.recorded.name)
    measured = cycle("recorded", test.recorded, "muted")
    before = loops(
        f"{name}: before", [measured, cycle("stick-slip model, refitted", test.refitted, "before")],
        f"Free-run x NRMSE {percent(test.error('refitted'))}.",
    )  # fmt: skip
    after = loops(
        f"{name}: after", [measured, cycle("diagnosed model", test.extended, "after")],
        f"Free-run x NRMSE {percent(test.error('extended'))}.",
    )  # fmt: skip
    return before, after


def _files(page: Page, lab: LabCase) -> None:
    page.section(
        "Everything that was made", "Open these for the details; every file can be read, run or imported elsewhere."
    )
    page.links(
        [
            ("identification/report.html", "how the surrogate was trained, recording by recording"),
            ("validation/report.html", "surrogate against reference FMU, test by test"),
            ("lab/report.html", "the diagnosis in full"),
            ("jenkins.fmu", "the reference oscillator, from Modelica"),
            ("identification/surrogate.fmu", "the surrogate: x, v in, R out"),
            ("identification/oscillator.fmu", "the surrogate with its mass: F in, x, v, a, R out"),
            ("identification/surrogate.onnx", "the same for any ONNX runtime"),
            ("lab/extended.mo", "the diagnosed model"),
            ("lab/diagnosis.json", "the diagnosis as data"),
            ("demo.json", "targets and results as data"),
        ]
    )
    page.reproduce("hystid demo -o hystid-demo")


def _short(name: str) -> str:
    """``harmonic:20Hz@80N,2s`` and ``harmonic_20Hz_80N`` -> ``20 Hz, 80 N``."""
    tone = name.replace("harmonic:", "").replace("harmonic_", "").partition(",")[0].replace("@", "_")
    return tone.replace("Hz_", " Hz, ").replace("N", " N")
