"""From a choice to the result: free runs, errors of every recording, notes, headline."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from hystid.diagnosis.decide.answer import Answer, Verdict, refit_values
from hystid.diagnosis.decide.selection import Choice
from hystid.diagnosis.fit.case import Case
from hystid.diagnosis.fit.extended import skeleton_of
from hystid.diagnosis.fit.periodic import periodic_forces
from hystid.diagnosis.fit.problem import Problem
from hystid.diagnosis.fit.windows import for_recording, has_windows, whole_recordings
from hystid.diagnosis.fit.zeros import zeros_instead
from hystid.diagnosis.model.adapters import FmuModel
from hystid.diagnosis.model.channel_effects import wanders
from hystid.diagnosis.model.freerun import errors
from hystid.diagnosis.prepare.faults import DELAY, Fault
from hystid.diagnosis.prepare.recordings import Taken
from hystid.diagnosis.prepare.resonances import resonances, several_masses
from hystid.diagnosis.prepare.rest import resting
from hystid.diagnosis.prepare.segments import prepare_parts
from hystid.diagnosis.prove.runs import Run, Runs, free_runs, led_away
from hystid.diagnosis.tell import locate
from hystid.diagnosis.tell.advice import next_experiment
from hystid.diagnosis.tell.alone import CLEAR, REST, SKEW, changes
from hystid.diagnosis.tell.dependence import dependences
from hystid.diagnosis.tell.findings import findings, headline
from hystid.diagnosis.tell.result import Diagnosis, Errors, Traces
from hystid.numeric import Flags

_WANDERS = (
    "F and the motion differ by a slow force that no law follows: a zero that wanders, or a high-pass filter or a "
    "baseline correction of one of the channels; give them as recorded, if you have them"
)
_UNRECORDED = (
    "no force was recorded, and it is taken to be zero: one that acted all the same leaves as much; record F, or give "
    "the free decay alone"
)
_CLOSE = 0.02  # error of a free run that integration and interpolation alone may leave


def conclude(case: Case, choice: Choice) -> tuple[Diagnosis, str | None]:
    """The result, and the extended model as text where something is named."""
    case = _fitted_lag(case, choice)
    runs = _runs(case, choice)
    away = led_away(runs.answer.choice, runs) if choice.named else ""
    if away:
        runs = _runs(case, choice.without_names())
    answer, choice, (before, after) = runs.answer, runs.answer.choice, (runs.before, runs.after)
    found = findings(answer)
    names = [part.name for part in case.problem.parts]
    force = _force_errors(case, choice)
    listed = tuple(Errors(n, f, (b[1], a[1])) for n, f, b, a in zip(names, force[0], before[0], after[0], strict=True))
    unseen = tuple(
        Errors(p.name, f, (b[1], a[1])) for p, f, b, a in zip(case.unseen, force[1], before[1], after[1], strict=True)
    )
    verdict = answer.verdict()
    told = _not_borne_out(choice, unseen) if choice.named else [away] if away else []
    changed = changes(case.problem, choice.before) if choice.unknown or _differ(case, choice) else ""
    told += [changed] if changed else []
    told += [_UNRECORDED] if choice.unknown and case.problem.unforced else []
    depends = tuple(dependences(case.problem, choice.after.hypothesis, choice.before.hypothesis))
    remains = _rest(choice)
    masses = several_masses(resonances(case.problem.parts)) if remains or choice.unknown else []
    masses += _place(case) if remains or choice.unknown else []
    masses += zeros_instead(case.problem, choice.after.hypothesis)
    remains += [_WANDERS] if any(wanders(term.effect) for term in choice.after.hypothesis.terms) else []
    lines = periodic_forces(choice.after)
    said = (
        *(line.sentence() for line in lines), *case.notes, *_late(case, choice), *runs.notes, *told, *remains, *masses,
        *(one.sentence() for one in depends),
    )  # fmt: skip
    unknown = None
    if choice.unknown:
        residual = case.problem.balance_shown(choice.after.hypothesis)
        unknown = locate.where_unknown(case.problem, residual, _noise(case))
    last = choice.after.hypothesis
    named = {name for finding in found for name in finding.alike}  # another form of the same id may be absorbed
    hidden = tuple(name for name in choice.untestable if name not in named)
    diagnosis = Diagnosis(
        verdict, "", case.baseline.name, dict(case.baseline.nominal), refit_values(answer, choice.before), found,
        listed, unseen, hidden, "", (_mean(force[0], 0), _mean(force[0], 1)), _floor(case, choice, force[0]), unknown,
        tuple(dict.fromkeys(said)),
        {"lags": case.consistency, "delay": last.delay, "mass_error": last.mass_error},
        _traces(case, choice, answer, before, after), choice, case.problem, choice.after, choice.posterior,
        dependence=depends, catalogue=case.catalogue, values=refit_values(answer, choice.after),
        lines=lines, changed=changed,
    )  # fmt: skip
    worded = replace(diagnosis, headline=headline(diagnosis), next_experiment=next_experiment(diagnosis))
    return worded, runs.text


def free_run_only(fmu: FmuModel, taken: Taken, model: str) -> Diagnosis:
    """All that an FMU with co-simulation only can show: how far its free run is from the measured displacement."""
    tests, values = [*taken.tests, *taken.unseen], taken.given.values
    parts = prepare_parts(tests)
    found = errors(fmu, parts, values)
    worst = max((e if e is not None else np.inf for _, e in found), default=np.inf)
    noise = max(p.noise["x"] / float(np.std(p.measured["x"])) if "x" in p.noise else 0.0 for p in parts)
    agrees = worst < max(_CLOSE, 3 * noise)
    limits = (
        "this FMU offers co-simulation only, so that its states cannot be held to the motion: nothing is refitted, "
        "located or named; export it with Model Exchange for that"
    )
    told = f"error of the displacement in free run {100 * worst:.3g} %" if np.isfinite(worst) else "no finite free run"
    nothing = float("nan"), float("nan")
    listed = tuple(Errors(p.name, nothing, (e, e)) for p, (_, e) in zip(parts, found, strict=True))
    verdict: Verdict = "consistent" if agrees else "not_applicable"
    advice = "Export the FMU with Model Exchange, or give the model as Modelica."
    return Diagnosis(verdict, f"{told}; {limits}", model, dict(values), {}, errors=listed, next_experiment=advice)


def _not_borne_out(choice: Choice, unseen: Sequence[Errors]) -> list[str]:
    """A sentence for each held-out recording whose force is no better explained with what is named than without."""
    parted = has_windows(choice.after.hypothesis)
    why = "when it acts there is not known" if parted else "it may be of another state of the structure"
    return [
        f"{e.name} was held out and is not better explained with what is named (force error {100 * e.force[0]:.3g} % "
        f"without, {100 * e.force[1]:.3g} % with it): {why}"
        for e in unseen
        if e.force[1] >= e.force[0]
    ]


def _differ(case: Case, choice: Choice) -> bool:
    """Whether what is named acts in some recordings from beginning to end, and not in the others."""
    each = (whole_recordings(case.problem, term) for term in choice.after.hypothesis.terms)
    return any(0 < len(whole) < len(case.problem.parts) for whole in each)


def _rest(choice: Choice) -> list[str]:
    """A sentence where what is named leaves clearly more than noise."""
    left = float(np.sqrt(choice.after.chi2 / max(choice.floor_after, 1e-300)))
    if not choice.named or left < REST:
        return []
    return [f"what is named leaves {left:.2g} times the noise: something smaller has no name yet"]


def _late(case: Case, choice: Choice) -> list[str]:
    """A sentence on a force that is late or early: by a fault, or by less where that is clear."""
    if moved := [fault.sentence() for fault in case.faults if _is_late_force(fault)]:
        return moved
    here, dt = choice.after.hypothesis, case.problem.parts[0].dt
    size, error = abs(here.delay), choice.after.stderr(("chain", "delay"))
    if here.late or size < SKEW or not size > CLEAR * error:
        return []
    side = "late" if here.delay > 0 else "early"
    return [
        f"F is {1e3 * size * dt:.3g} ms ({size:.2g} samples) {side}, as channels that are sampled one after the other: "
        "the fit allows for it"
    ]


def _is_late_force(fault: Fault) -> bool:
    return fault.id == DELAY and fault.channel == "F"


def _fitted_lag(case: Case, choice: Choice) -> Case:
    """The case with a late force as the fit found it: it was moved by whole samples, and the rest was fitted."""
    dt, error = case.problem.parts[0].dt, choice.after.stderr(("chain", "delay"))
    if not np.isfinite(error):
        return case
    faults = []
    for fault in case.faults:
        if _is_late_force(fault):
            step = fault.seconds / fault.size
            seconds = round(fault.size) * step + choice.after.hypothesis.delay * dt
            fault = replace(fault, size=seconds / step, stderr=error * dt / step, seconds=seconds)
        faults.append(fault)
    return replace(case, faults=tuple(faults))


def _place(case: Case) -> list[str]:
    """What recordings without a displacement do not say, where something is left that may depend on it."""
    from_rates = [part for part in case.problem.parts if part.lowest]
    if not from_rates:
        return []
    slow = f"motion slower than {max(part.first_Hz for part in from_rates):.2g} Hz"
    law = "a law of the place, as a gap or a stop, may be misread or missed"
    return [f"x was not measured: where the structure stands, and {slow}, is not known; {law}"]


def _runs(case: Case, choice: Choice) -> Runs:
    """Free runs before and after what was named, and the answer that comes of them."""
    answer = Answer(case.problem, case.baseline, choice, case.nominal_chi2, case.faults, case.catalogue)
    return free_runs(answer, skeleton_of(case.baseline), case.unseen)


def _noise(case: Case) -> float:
    return float(np.mean([part.balance_noise(case.baseline.mass) for part in case.problem.parts]))


def _floor(case: Case, choice: Choice, left: Sequence[tuple[float, float]]) -> float:
    """Share of the force that is noise: NRMSE that a perfect model would reach. Noise of the motion is in the inertia
    and, through the law, in the restoring force.

    left: NRMSE before and after, per recording. The noise is no louder: a law that has no name may pass for some.
    """
    mass, drawn = case.baseline.mass, list(case.problem.moved(choice.after.hypothesis))
    shares = []
    for i, part in enumerate(case.problem.parts):
        inertia = 3 if part.inertia_order == 0 else 2  # as measured, or smoothed: see Problem.balance_shown
        errors = [moved[i] + mass * draw[inertia] for moved, draw in zip(drawn, part.jitter.first(), strict=True)]
        told = _told(case.problem, i)
        seen = [(error - part.slow(error) if part.lowest else error)[told] for error in errors]
        noise = np.sqrt(part.noise["F"] ** 2 + np.mean(np.square(seen)))
        shares.append(min(float(noise / np.std(part.F - mass * part.a)), *left[i]))
    return float(np.mean(shares))


def _mean(force: Sequence[tuple[float, float]], which: int) -> float:
    return float(np.mean([pair[which] for pair in force]))


def _force_errors(case: Case, choice: Choice) -> tuple[list[tuple[float, float]], list[tuple[float, float]]]:
    """NRMSE of the force balance before and after, per training and held-out recording, where the law says what the
    force is: not where a contact remembers what was before, nor at rest, where friction holds any force."""
    problem, found = case.problem, []
    groups = [(problem, choice.after.hypothesis)]
    if case.unseen:
        groups.append((problem.of(case.unseen), for_recording(choice.after.hypothesis)))
    for group, last in groups:
        seen = [_told(group, i) for i in range(len(group.parts))]
        residuals = [
            [residual[at] for residual, at in zip(group.balance_shown(h), seen, strict=True)]
            for h in (choice.before.hypothesis, last)
        ]
        mass = choice.after.hypothesis.mass()
        spread = [float(np.std(p.F - mass * p.a)) or 1.0 for p in group.parts]
        found.append([(float(np.std(b)) / s, float(np.std(a)) / s) for b, a, s in zip(*residuals, spread, strict=True)])
    return found[0], found[1] if case.unseen else []


def _told(problem: Problem, index: int) -> Flags:
    """Samples of one recording, (n,), in which the law says what the force is; all of them where none is left. Near the
    ends of one without x the place is not known well enough."""
    part = problem.parts[index]
    told = np.ones(len(part), dtype=bool) if part.valid is None else part.valid
    told = told & ~resting(part) if part.timed else told
    told = told & problem.reduce.used(index) if part.lowest else told
    return told if np.any(told) else np.ones(len(part), dtype=bool)


def _traces(
    case: Case, choice: Choice, answer: Answer, before: tuple[Run, Run], after: tuple[Run, Run]
) -> tuple[Traces, ...]:
    problem = case.problem
    mass = choice.after.hypothesis.mass()
    residual, left = (problem.balance_shown(f.hypothesis) for f in (choice.before, choice.after))
    acting, law = answer.acting(), answer.law()
    made = []
    for i, part in enumerate(problem.parts):
        noise = part.balance_noise(case.baseline.mass)
        named = acting is not None
        force = acting[i] if acting is not None else np.zeros(len(part))
        score = locate.score(force, noise) if named else locate.unknown_score(residual[i], noise)
        made.append(
            Traces(
                part.name, part.t, part.x, part.v, part.F - mass * part.shown_acceleration,
                residual[i], left[i], law[i], score, noise, before[0][i][0], after[0][i][0],
            )
        )  # fmt: skip
    return tuple(made)
