"""Diagnosis of the recordings of other laboratories, against the answer that each source supports.

    python -m benchmarks.real_answers ../shared/data -o ../real [--only NAME ...]

The answers were written from the sources' own descriptions (the README beside each set), before any was asked for.
Each case runs in a process of its own; a second call goes on where the first stopped. The table is printed in the end:
right (every known effect by its name), right class (some of them, or by another name of their class, and nothing that
the source does not support), abstained, wrong.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.proof.answer import asked

LINEAR, JENKINS, BOUC_WEN = (f"HystId.Oscillators.{name}" for name in ("Linear", "Jenkins", "BoucWen"))
CALM = ("consistent", "recalibrated")
NO_ANSWER = ("unknown_physics", "not_applicable", "refused")
FRICTION = ("coulomb_friction", "hysteretic_friction", "stribeck_friction", "asymmetric_friction")
OFFSET = ("preload", "force_drift")


@dataclass(frozen=True)
class Known:
    """What a source supports.

    ``effects``: for each known effect the ids that are its name; ``near``: ids of their classes, right but less than
    the name; ``open``: ids that the source neither shows nor rules out; ``quiet``: verdicts without names that are
    right; ``word``: what the answer must mention to be right in full; ``knowable``: whether abstaining loses anything.
    """

    effects: tuple[tuple[str, ...], ...] = ()
    near: tuple[str, ...] = ()
    open: tuple[str, ...] = ()
    quiet: tuple[str, ...] = ()
    word: str = ""
    knowable: bool = True


@dataclass(frozen=True)
class Case:
    """Recordings, what the user knows, and what is known. ``rows``: (first, last, step) as shares and a step."""

    name: str
    used: tuple[str, ...]
    known: Known
    held: tuple[str, ...] = ()
    parameters: tuple[tuple[str, Any], ...] = (("m", 0),)
    model: str = LINEAR
    rows: tuple[float, float, int] = (0.0, 1.0, 1)
    columns: tuple[tuple[str, str], ...] = ()
    factors: tuple[tuple[str, float], ...] = ()


def cases() -> Iterator[Case]:
    """All cases with their variants."""
    for case in _plain():
        yield case
        if case.name in _VARIED:
            yield replace(case, name=f"{case.name}, every 2nd sample", rows=(0.0, 1.0, 2))
            yield replace(case, name=f"{case.name}, first half", rows=(0.0, 0.5, 1))
            yield replace(case, name=f"{case.name}, second half", rows=(0.5, 1.0, 1))
            yield replace(case, name=f"{case.name}, F reversed", factors=(("F", -1.0),), known=_or_refused(case.known))


def _or_refused(known: Known) -> Known:
    """A reversed channel may be read with a note, or refused with a reason."""
    return replace(known, quiet=(*known.quiet, "refused", "not_applicable"))


# Sets that are also asked in halves, decimated, and with the sign of F reversed.
_VARIED = (
    "emps",
    "brfd 30 lb",
    "brfd 80 lb",
    "pneumatic 3 bar",
    "mr utfpr 0 V",
    "mr utfsm 1 A",
    "cyberdiver 10 N",
    "boucwen",
    "cycloidal baseline alloy",
    "pendulum swing-up",
)


def _plain() -> Iterator[Case]:
    yield from _ball_screw()
    yield from _dampers()
    yield from _springs_and_slack()
    yield from _structures()
    yield from _pendulums()
    yield from _no_force()


def _ball_screw() -> Iterator[Case]:
    no_spring = (("Kl", {"value": 0, "fixed": True}),)
    # Coulomb and offset, then different levels and slopes of the directions; pulses show a flexibility besides.
    known = Known((("asymmetric_friction",),), near=("coulomb_friction", "hysteretic_friction"), open=OFFSET)
    emps, pulses = "emps/emps_estimation", "emps/emps_validation_pulses"
    yield Case("emps", (emps,), known, parameters=no_spring)
    yield Case("emps, held out: pulses", (emps,), known, (pulses,), no_spring)
    yield Case("emps, mass 95 kg", (emps,), known, parameters=(*no_spring, ("m", 95.1)))
    yield Case("emps, spring left free", (emps,), known, parameters=())
    flexible = replace(known, open=(*OFFSET, "hidden_mode", "viscoelastic_relaxation"))
    yield Case("emps pulses", (pulses,), flexible, parameters=no_spring)


def _dampers() -> Iterator[Case]:
    # Dry friction with a rise before sliding, slack at each reversal, Stribeck effect, unequal directions.
    band = Known(
        (("hysteretic_friction",), ("backlash", "pinching")),
        near=("coulomb_friction",),
        open=("stribeck_friction", "asymmetric_friction", *OFFSET),
    )
    old, new = "brfd_friction_backlash/brfd2022_{}lbtension", "brfd_friction_backlash/brfd2023_{}amplitude"
    for tension in (20, 35, 80):
        slow, fast = old.format(f"0.5Hz{tension}"), old.format(f"1Hz{tension}")
        yield Case(f"brfd {tension} lb", (slow,), band)
        yield Case(f"brfd {tension} lb, held out: 1 Hz", (slow,), band, (fast,))
        yield Case(f"brfd {tension} lb, 1 Hz", (fast,), band)
    one = new.format("0.5Hz30lbtension1")
    yield Case("brfd 30 lb", (one,), band)
    yield Case(
        "brfd 30 lb, held out: 1.5 in",
        (one, new.format("0.5Hz30lbtension0.5")),
        band,
        (new.format("0.5Hz30lbtension1.5"),),
    )
    yield Case("brfd 30 lb, held out: 80 lb", (one,), band, (old.format("0.5Hz80"),))
    yield Case("brfd 30 lb, 0.25 Hz", (new.format("0.25Hz30lbtension1"),), band)
    chatter = replace(band, open=(*band.open, "hidden_mode"), knowable=False)
    yield Case("brfd 30 lb, 2 Hz, chatter", (new.format("2Hz30lbtension0.5"),), chatter)
    beyond = Known((("backlash", "pinching"),), near=("hysteretic_friction",), open=("coulomb_friction", *band.open))
    yield Case("brfd 30 lb, model Jenkins", (one,), beyond, model=JENKINS)

    # Dahl's law and a viscous part; the knee shows in one quadrant only.
    dahl = Known((("hysteretic_friction",),), near=("coulomb_friction",), open=("asymmetric_friction", *OFFSET))
    for label, file in (("0 V", "0V"), ("0.88 V", "0.88V"), ("third setting", "third_setting")):
        yield Case(f"mr utfpr {label}", (f"mr_damper_utfpr/mr_damper_{file}",), dahl)
    already = Known(quiet=CALM, open=("asymmetric_friction", "hysteretic_friction", *OFFSET), knowable=False)
    yield Case("mr utfpr 0 V, model BoucWen", ("mr_damper_utfpr/mr_damper_0V",), already, model=BOUC_WEN)
    for label, file in (
        ("0 A", "10mm2Hz_0A"),
        ("0.5 A", "10mm2Hz_0p5A"),
        ("1 A", "10mm2Hz_1A"),
        ("0 A, 25 mm", "25mm0x5Hz_0A"),
        ("1 A, 25 mm", "25mm0x5Hz_1A"),
    ):
        yield Case(f"mr utfsm {label}", (f"mr_damper_utfsm/mr_{file}",), dahl)
    yield Case(
        "mr utfsm 1 A, held out: 25 mm", ("mr_damper_utfsm/mr_10mm2Hz_1A",), dahl, ("mr_damper_utfsm/mr_25mm0x5Hz_1A",)
    )
    mixed = replace(dahl, knowable=False)  # two currents are two laws
    yield Case("mr utfsm 0 A and 1 A", ("mr_damper_utfsm/mr_10mm2Hz_0A", "mr_damper_utfsm/mr_10mm2Hz_1A"), mixed)
    dyke = Known(
        (("hysteretic_friction",),), near=("coulomb_friction",), open=("asymmetric_friction", *OFFSET), word="u_mr"
    )
    random = "mr_damper_dyke/mr_damper_dyke_ranran50"
    yield Case("mr dyke", (random,), dyke, columns=(("a_raw", ""),))
    yield Case(
        "mr dyke, voltage not in the file", (random,), replace(dyke, word=""), columns=(("a_raw", ""), ("u_mr", ""))
    )

    # Pressure times area, and dry friction of the seals; the force overshoots after a reversal.
    seal = Known(
        (OFFSET, ("coulomb_friction",)),
        near=("hysteretic_friction", "asymmetric_friction"),
        open=("stribeck_friction",),
    )
    for bar in (1, 3, 5, 7):
        yield Case(f"pneumatic {bar} bar", (f"pneumatic_cylinder_friction/pneumatic_Circle_{bar}bar",), seal)
    several = replace(seal, word="depends on p", knowable=False)
    yield Case(
        "pneumatic 1 and 5 bar",
        tuple(f"pneumatic_cylinder_friction/pneumatic_Circle_{bar}bar" for bar in (1, 5)),
        several,
    )


def _springs_and_slack() -> Iterator[Case]:
    folder = "cyberdiver_bilinear/static_{}_trial{}"
    straight = Known(quiet=CALM, open=OFFSET)
    yields = Known((("bilinear_stiffness",),), near=("contact_loss", "two_sided_stop", "backlash"), open=OFFSET)
    for name, label, known in (("15npmm", "15 N/mm", straight), ("10n_threshold", "10 N", yields)):
        first, second, third = (folder.format(name, i) for i in (1, 2, 3))
        yield Case(f"cyberdiver {label}", (first, second), known, (third,))
        yield Case(f"cyberdiver {label}, one trial", (third,), known)
    # Ordinary drives have a gap and friction; preloaded ones friction, and little play.
    loose = Known(
        (("backlash", "two_sided_stop"), ("hysteretic_friction", "coulomb_friction")),
        near=FRICTION,
        open=("pinching", *OFFSET),
    )
    tight = Known(
        (("hysteretic_friction",),),
        near=("coulomb_friction",),
        open=("backlash", "two_sided_stop", "pinching", *OFFSET),
    )
    for label, file, known in (
        ("baseline alloy", "baseline_alloy910_pos5", loose),
        ("baseline onyx", "baseline_onyx_runin_pos1", loose),
        ("preload 1", "conic_pccf_preload1_pos1", tight),
        ("preload 5", "conic_pccf_preload5_pos5", tight),
        ("preload 12", "split_onyx_preload12_pos1", tight),
    ):
        yield Case(f"cycloidal {label}", (f"cycloidal_drive_play/{file}",), known)


def _structures() -> Iterator[Case]:
    # Hysteresis whose strength and stiffness wear, pinched. No clock: time numbers the samples.
    worn = Known((("hysteretic_friction",), ("cyclic_degradation",), ("pinching",)), open=("backlash",))
    later = Known((("cyclic_degradation",), ("pinching",)), open=("hysteretic_friction", "backlash"))
    for label, file in (("rc column", "rc_column_gill"), ("ferrocement wall", "ferrocement_wall_bedoya")):
        yield Case(label, (f"rc_cyclic/{file}",), worn)
        yield Case(f"{label}, model BoucWen", (f"rc_cyclic/{file}",), later, model=BOUC_WEN)
    folder = "boucwen_benchmark/boucwen_"
    smooth = Known((("hysteretic_friction",),))
    mass = (("m", 2.0),)
    train, multisine, sweep = folder + "train_multisine_forgione", folder + "test_multisine", folder + "test_sinesweep"
    yield Case("boucwen", (multisine,), smooth, parameters=mass)
    yield Case("boucwen, held out: multisine", (train,), smooth, (multisine,), mass)
    yield Case("boucwen, sweep", (sweep,), smooth, parameters=mass, rows=(0.3, 0.6, 1))
    yield Case("boucwen, model BoucWen", (multisine,), Known(quiet=CALM), parameters=mass, model=BOUC_WEN)
    # A Jenkins element is hysteresis of another shape: a second hysteretic law may fill the difference, or nothing.
    yield Case("boucwen, model Jenkins", (multisine,), replace(smooth, knowable=False), parameters=mass, model=JENKINS)
    # Ring-down: hardening, and damping that grows with the amplitude. F = 0 after 12.2 s, mass normalised.
    decay = Known((("cubic_stiffness",), ("quadratic_damping", "displacement_dependent_damping")))
    named = (("x_strain", "x [m]"), ("x_clock_beam_strain", ""), ("drive_cmd", ""))
    beam = "magneto_elastic_decay/magnet_beam_ringdown"
    unit = (("m", {"value": 1, "fixed": True}),)
    yield Case("ring-down, F absent", (beam,), decay, columns=named, parameters=unit, rows=(0.4207, 0.8, 1))
    zero = (("x_strain", "x [m]"), ("x_clock_beam_strain", ""), ("drive_cmd", "F [N]"))
    yield Case("ring-down, F zero", (beam,), decay, columns=zero, parameters=unit, rows=(0.4207, 0.8, 1))


def _pendulums() -> Iterator[Case]:
    # Friction that grows with the load of the gear, torque computed from the voltage with a scale that is not certain;
    # sin x beside a linear spring is softening. v is the servo's own estimate, late by what its source says.
    gear = Known(
        (("cubic_stiffness",), (*FRICTION, "position_dependent_friction")),
        open=("force_gain", "added_mass", "channel_delay", *OFFSET),
        knowable=False,
    )
    dry = replace(gear, effects=gear.effects[1:], open=(*gear.open, "cubic_stiffness"), knowable=True)
    inertia = (("m", 0.0068),)
    extra = (("torque_on", ""),)
    for label, file, known in (
        ("sin sin", "sin_sin_kp200", dry),
        ("sin sin stiff", "sin_sin_kp800", dry),
        ("sin of time squared", "sin_time_square_kp400", dry),
        ("sin of time squared, stiff", "sin_time_square_kp800", dry),
        ("up and down", "up_and_down_kp200", gear),
        ("lift and drop", "lift_and_drop_kp100", gear),
        ("lift and drop, stiff", "lift_and_drop_kp400", gear),
    ):
        yield Case(f"servo {label}", (f"servo_pendulum_bam/xl330_{file}",), known, parameters=inertia, columns=extra)
    swing = Known((FRICTION, ("cubic_stiffness",)), open=("force_gain", "added_mass", *OFFSET))
    folder = "torque_pendulum_dfki/"
    documented = (("m", 0.1495),)
    yield Case("pendulum swing-up", (folder + "swingup_ddp",), swing, parameters=documented)
    late = replace(swing, open=(*swing.open, "channel_delay"))
    yield Case("pendulum swing-up, 50 Hz", (folder + "swingup_ilqr_50Hz",), late, parameters=documented)
    turns = Known(open=(*FRICTION, *OFFSET), quiet=("unknown_physics", "not_applicable"), knowable=False)
    yield Case("pendulum, full turns", (folder + "swingup_sac_spins",), turns, parameters=documented)
    bad = Known(open=(*FRICTION, *OFFSET, "cubic_stiffness", "sensor_saturation"), quiet=NO_ANSWER, knowable=False)
    yield Case("pendulum, bad recording", (folder + "pd_identification",), bad, parameters=documented)


def _no_force() -> Iterator[Case]:
    refused = Known(quiet=("refused", "not_applicable"))
    for state in ("normal", "backlash1", "lackLubrication1"):
        yield Case(
            f"actuator {state}", (f"linear_actuator_faults/{state}_load20kgf_run1_rep0",), refused, parameters=()
        )


def lay_out(case: Case, data: Path, folder: Path) -> None:
    """The files of one case, as a user would hand them in, and what the user knows."""
    folder.mkdir(parents=True, exist_ok=True)
    for label, names in (("train", case.used), ("hold", case.held)):
        for i, name in enumerate(names, 1):
            source = data / f"{name}.csv"
            header = source.read_text().split("\n", 1)[0].split(",")
            table = np.genfromtxt(source, delimiter=",", skip_header=1)
            lo, hi, step = case.rows if label == "train" else (0.0, 1.0, 1)
            table = table[int(lo * len(table)) : int(hi * len(table)) : step]
            renamed = dict(case.columns)
            factors = dict(case.factors)
            keep, heads = [], []
            for k, head in enumerate(header):
                short = head.split(" [")[0]
                new = renamed.get(short, head)
                if new:
                    keep.append(table[:, k] * factors.get(short, 1.0))
                    heads.append(new)
            np.savetxt(
                folder / f"{label}_{i}.csv",
                np.stack(keep, axis=1),
                fmt="%.12g",
                delimiter=",",
                header=",".join(heads),
                comments="",
            )
    (folder / "question.json").write_text(json.dumps({"model": case.model, "parameters": dict(case.parameters)}))


def judge(known: Known, result: dict[str, Any]) -> tuple[str, float]:
    """One of right, right class, abstained, missed, wrong, crashed; and the confidence of the surest name behind it."""
    answer = result.get("answer") or {}
    verdict = answer.get("verdict") or ("refused" if "refused" in result else "crashed")
    if verdict == "crashed":
        return "crashed", 0.0
    findings = answer.get("findings", []) if verdict in ("missing_physics", "sensor_fault") else []
    names = {finding["effect"]: float(finding["confidence"]) for finding in findings}
    classes = {finding["effect"]: {finding["effect"], *finding.get("class", [])} for finding in findings}
    every = {effect for group in known.effects for effect in group}
    right = {name for name in names if classes[name] & every or name in known.near}
    wrong = {name for name in names if name not in right and name not in known.open}
    if wrong:
        return "wrong", max(names[name] for name in wrong)
    if not names:
        if verdict in known.quiet:
            return "right", 0.0
        return ("missed" if verdict in CALM and known.effects and known.knowable else "abstained"), 0.0
    confidence = max(names.values())
    told = json.dumps(answer) if known.word else ""
    full = all(any(name in group for name in names) for group in known.effects) and known.word in told
    return ("right" if full else "right class" if right or not known.effects else "abstained"), confidence


def report(data: list[tuple[Case, dict[str, Any]]]) -> str:
    """The table, and the sums over what can be known."""
    lines = ["| case | verdict | named (confidence) | judged | confidence | CPU |", "|---|---|---|---|---|---|"]
    sums: dict[str, int] = {}
    sure = 0
    for case, result in data:
        judged, confidence = judge(case.known, result)
        answer = result.get("answer") or {}
        named = ", ".join(f"{f['effect']} ({f['confidence']:.2f})" for f in answer.get("findings", [])) or "-"
        verdict = answer.get("verdict") or ("refused" if "refused" in result else "crashed")
        if case.known.knowable:
            sums[judged] = sums.get(judged, 0) + 1
        sure += judged == "wrong" and confidence >= 0.5
        judged += "" if case.known.knowable else " (cannot be known)"
        cpu = result.get("cpu") or 0.0
        lines.append(f"| {case.name} | {verdict} | {named} | {judged} | {confidence:.2f} | {cpu:.0f} s |")
    total = sum(sums.values())
    good = sums.get("right", 0) + sums.get("right class", 0)
    lines += ["", f"Knowable: {total}; " + ", ".join(f"{name} {n}" for name, n in sorted(sums.items()))]
    lines.append(
        f"Right or right class: {100 * good / max(total, 1):.0f} %. Wrong at confidence 0.5 or more, all cases: {sure}."
    )
    return "\n".join(lines)


def main() -> None:
    """See the module's text."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("data", type=Path)
    parser.add_argument("-o", "--out", type=Path, required=True)
    parser.add_argument("--only", nargs="*", default=[], help="cases whose names begin so")
    given = parser.parse_args()
    given.out.mkdir(parents=True, exist_ok=True)
    done = []
    for case in cases():
        if given.only and not case.name.startswith(tuple(given.only)):
            continue
        folder = given.out / case.name.replace(" ", "_").replace(",", "").replace(":", "")
        kept = folder / "answer.json"
        if not kept.exists():
            lay_out(case, given.data, folder)
            kept.write_text(json.dumps(asked(folder)))
        done.append((case, json.loads(kept.read_text())))
        print(f"{case.name}: {judge(case.known, done[-1][1])[0]}", file=sys.stderr, flush=True)
    print(report(done))


if __name__ == "__main__":
    main()
