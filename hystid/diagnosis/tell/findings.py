"""From an answer to words: findings with parameters, location and confidence, the headline, and what to do next."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Mapping
from typing import Any

import numpy as np

from hystid.diagnosis.decide.answer import GAIN, Answer, describe
from hystid.diagnosis.fit.value import Value
from hystid.diagnosis.fit.windows import Windowed, lasting
from hystid.diagnosis.fit.zeros import drift_of_x
from hystid.diagnosis.model.channel_effects import wanders
from hystid.diagnosis.model.semantics import Semantics
from hystid.diagnosis.prepare.faults import DELAY, Fault
from hystid.diagnosis.tell.locate import where_term
from hystid.diagnosis.tell.result import Diagnosis, Finding, Where


def findings(answer: Answer) -> tuple[Finding, ...]:
    """Everything that was found, strongest first."""
    made = [_fault_finding(answer, fault) for fault in answer.faults]
    weights = [1e300] * len(made)
    signals = answer.problem.signals(answer.choice.after.hypothesis)
    choice = answer.choice
    pairs = zip(choice.named, choice.classes, choice.probabilities, choice.shares, strict=True)
    for name, alike, probability, share in pairs:
        finding, weight = _finding(answer, name, alike, (probability, share), signals)
        made.append(finding)
        weights.append(weight)
    return tuple(made[i] for i in np.argsort([-w for w in weights], kind="stable"))


def _finding(
    answer: Answer, name: str, alike: tuple[str, ...], worth: tuple[float, float], signals: Any
) -> tuple[Finding, float]:
    choice, fit = answer.choice, answer.choice.after
    shown = answer.rename(name)
    together = tuple(dict.fromkeys((shown, *alike, *_equivalents(shown, answer), *_not_told(answer, name))))
    evidence = {
        "explained": worth[1], "chi2_before": choice.before.chi2, "chi2_after": fit.chi2,
        "floor": choice.floor_after,
        "tried": [
            {"effect": t.name, "form": t.form, "chi2": t.chi2, "absorbed": t.absorbed} for t in choice.trials[:12]
        ],
    }  # fmt: skip
    sure, share = worth
    term = answer.term(name)
    said = term.effect.semantics if term is not None else Semantics()
    title = said.title if together == (name,) and said.title else answer.catalogue.class_title(together)
    model = term.effect.model if term is not None else None
    sentence = said.sentence or (model.code.description if model is not None else "")

    def told(parameters: Mapping[str, Value], where: Where) -> Finding:
        roles = {"threshold": said.threshold, "switch": said.switch}
        return Finding(shown, together, sure, parameters, where, evidence, share, title, roles, sentence)

    if term is None:
        delay = Value(fit.hypothesis.delay, fit.stderr(("chain", "delay")), "1")
        seconds = Value(delay.value * answer.problem.parts[0].dt, delay.stderr * answer.problem.parts[0].dt, "s")
        where = Where("the force channel is late as a whole", (0, 0), (0, 0), {}, {}, "no harmonics")
        return told({"samples": delay, "delay": seconds}, where), 1e299
    if drift_of_x(answer.problem, fit.hypothesis, term) is not None:
        title += ", or of the displacement sensor"
    where = where_term(answer.problem, term, signals)
    weight = float(np.sqrt(np.mean(np.concatenate([term.effect.force(s, term.values) for s in signals]) ** 2)))
    evidence |= {"form": term.effect.form, "class_name": term.effect.class_name, "rms_force": weight}
    if shown == GAIN:
        parameters = {"gain": Value(1 + answer.gain(), answer.gain_error(), "1")}
        return told(parameters, where), weight
    fitted = answer.at_the_structure(term, answer.stated(fit.hypothesis.terms.index(term), term))
    fitted |= {name: Value(last, math.nan, "s") for name, last in lasting(answer.problem, term).items()}
    return told(_summed(fitted) if wanders(term.effect) else fitted, where), weight


def _summed(values: Mapping[str, Value]) -> dict[str, Value]:
    """Parameters for people: of Legendre polynomials of a drift the standard deviation that they make together, whose
    squares have a mean of 1 / (2 degree + 1)."""
    told, squares, errors = dict[str, Value](), defaultdict[str, float](float), defaultdict[str, float](float)
    for name, value in values.items():
        kind, _, number = name.partition("_")
        if not kind.startswith("degree"):
            told[name] = value
            continue
        share = 1 / (2 * int(kind.removeprefix("degree")) + 1)
        squares[number] += share * value.value**2
        errors[number] += (share * value.value * value.stderr) ** 2
    swings = {n: Value(math.sqrt(s), math.sqrt(errors[n] / s), "N") for n, s in squares.items() if s}
    return told | {f"swing_{number}": swing for number, swing in swings.items()}


def _equivalents(name: str, answer: Answer) -> tuple[str, ...]:
    """Ids that are the same by algebra, where a law acts all the time."""
    term = answer.term(name)
    if (name == GAIN and answer.gain() < 0) or (term is not None and isinstance(term.effect, Windowed)):
        return ()  # there is no negative mass, and what comes or goes is seen beside the time in which it does not
    return answer.catalogue.equal(name, answer.choice.named)


def _not_told(answer: Answer, name: str) -> tuple[str, ...]:
    """Laws to which these recordings do not tell the difference: a length below what they resolve, for example."""
    term = answer.term(name)
    return () if term is None else tuple(end.law for end in answer.ends(term) if end.fit == "equivalent")


def _fault_finding(answer: Answer, fault: Fault) -> Finding:
    dt = answer.problem.parts[0].dt
    if fault.id == DELAY:
        parameters = {
            "samples": Value(fault.size, fault.stderr, "1"),
            "delay": Value(fault.size * dt, fault.stderr * dt, "s"),
        }
    else:
        unit = {"x": "m", "v": "m/s", "a": "m/s2", "F": "N"}[fault.channel]
        parameters = {"level": Value(fault.size, fault.stderr, unit)}
    where = Where(describe(fault), (0, 0), (0, 0), {}, {}, "odd harmonics" if fault.id != DELAY else "no harmonics")
    evidence = {"channel": fault.channel, "share_of_samples": fault.share}
    title = answer.catalogue.title(fault.id)
    return Finding(fault.id, (fault.id,), 0.95, parameters, where, evidence, title=title)


def headline(diagnosis: Diagnosis) -> str:
    """One sentence: what, where, how sure, how much better."""
    if diagnosis.verdict in {"consistent", "recalibrated"}:
        needed = ["its parameters are refitted"] if diagnosis.verdict == "recalibrated" else []
        needed += [f"{' and '.join(line.told() for line in diagnosis.lines)} is taken out"] if diagnosis.lines else []
        once = f" once {' and '.join(needed)}" if needed else ""
        return f"The model agrees with the recordings down to their noise{once}{_where_known(diagnosis)}"
    named = " and ".join(_told(finding) for finding in diagnosis.findings)
    if diagnosis.unknown is not None:
        unnamed = f"something is missing that no effect of the library explains: {diagnosis.unknown.text}"
        rest = diagnosis.changed or unnamed
        return f"{named}; beside it, {rest}" if named else rest[:1].upper() + rest[1:]
    return f"{named}; {_better(diagnosis)}"


def _where_known(diagnosis: Diagnosis) -> str:
    """In how many samples a fit proves something: where noise of the motion moves the force of a law by more than that
    of its channel, or nobody knows on which side of a jump it stands, it does not."""
    percent = 100 if diagnosis.problem is None else round(100 * float(np.mean(diagnosis.problem.reduce.sure())))
    others = "in the others the motion is not known well enough to tell its force"
    if percent == 0:
        return ", as far as the noise of the motion lets its force be told"
    return f", in {percent} % of the samples; {others}" if percent < 100 else ""


def _told(finding: Finding) -> str:
    return f"{finding.title} (probability {100 * finding.confidence:.0f} %, {finding.where.text})"


def _better(diagnosis: Diagnosis) -> str:
    listed = diagnosis.holdout or diagnosis.errors
    pairs = [e.free_run for e in listed if e.free_run[0] is not None and e.free_run[1] is not None]
    alone = [e.free_run[1] for e in listed if e.free_run[1] is not None]
    kind = "held-out free-run" if diagnosis.holdout else "free-run"
    if pairs:
        before, after = (float(np.mean([pair[i] for pair in pairs])) for i in (0, 1))
        return f"{kind} error of the displacement {100 * before:.3g} % before, {100 * after:.3g} % after"
    if alone:
        return f"{kind} error of the displacement {100 * float(np.mean(alone)):.3g} %, and no finite free run before"
    before, after = diagnosis.force_nrmse
    return f"force error {100 * before:.3g} % before, {100 * after:.3g} % after"
