"""The criterion: its limits, and what no amount of data may change."""

from __future__ import annotations

from collections.abc import Callable
from copy import copy
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.signal import lfilter

from hystid.diagnosis import Diagnosis, diagnose
from hystid.diagnosis.decide.criterion import (
    ACCURACY,
    SOUND,
    ZERO,
    Candidate,
    Criterion,
    FittedSet,
    Posterior,
    effective_states,
    variance_of_states,
    zero_probability,
)
from hystid.diagnosis.decide.hypotheses import Search
from hystid.diagnosis.decide.lawfree import wrong_forms
from hystid.diagnosis.decide.selection import _class, weigh
from hystid.diagnosis.decide.unseen import unseen_likelihood
from hystid.diagnosis.fit.hypothesis import Fit, Term, is_allowed
from hystid.diagnosis.fit.independence import _cells, _independent
from hystid.diagnosis.fit.problem import standing
from hystid.diagnosis.fit.search import scan, try_fit, try_term
from hystid.diagnosis.fit.windowscan import outside
from hystid.diagnosis.model.library import load_effects
from hystid.recording import Recording
from tests.test_diagnosis_windows import posed, recorded

MODEL = "HystId.Oscillators.Linear"
NOMINAL = {"m": 1.0, "B": 20.0, "Kl": 30000.0}


def rig(
    seed: int,
    level: float,
    cubic: float,
    *,
    seconds: float = 4.0,
    snr: float | None = 34.0,
    beside: Callable[[Any, Any], Any] = lambda x, v: 0.0 * x,
    until: float = np.inf,
) -> Recording:
    """A mass on a spring with a cubic part [N/m3], swept from 2 to 60 Hz at 1 kHz, by Runge-Kutta at 8 kHz.

    beside: a further force [N] of x and v. until: time [s] at which the cubic part ends.
    """
    rate, fine = 1000.0, 8
    t = np.arange(0.0, seconds, 1 / (rate * fine))
    force = level * np.sin(2 * np.pi * (2.0 * t + 0.5 * 58.0 / seconds * t**2))
    x, v, dt = np.zeros(len(t)), np.zeros(len(t)), t[1]

    hardening = np.where(t < until, cubic, 0.0)

    def slope(x: float, v: float, f: float) -> float:
        return f - 20.0 * v - 30000.0 * x - hardening[k] * x**3 - float(beside(x, v))

    for k in range(len(t) - 1):
        half, f0, f1 = 0.5 * dt, force[k], force[k + 1]
        mid = 0.5 * (f0 + f1)
        a1 = slope(x[k], v[k], f0)
        a2 = slope(x[k] + half * v[k], v[k] + half * a1, mid)
        a3 = slope(x[k] + half * (v[k] + half * a1), v[k] + half * a2, mid)
        a4 = slope(x[k] + dt * (v[k] + half * a2), v[k] + dt * a3, f1)
        x[k + 1] = x[k] + dt * (v[k] + dt / 6 * (a1 + a2 + a3))
        v[k + 1] = v[k] + dt / 6 * (a1 + 2 * a2 + 2 * a3 + a4)
    a = force - 20.0 * v - 30000.0 * x - hardening * x**3 - beside(x, v)
    channels = {"F": force, "x": x, "v": v, "a": a}
    rng = np.random.default_rng(seed)
    taken = {}
    for name, values in channels.items():
        sampled = values[::fine]
        scatter = 0.0 if snr is None else 10 ** (-snr / 20) * float(np.std(sampled))
        taken[name] = sampled + scatter * rng.standard_normal(len(sampled))
    return Recording(f"rig_{seed}", t=t[::fine], **taken)


def answer(tests: list[Recording], holdout: list[Recording] | None = None) -> Diagnosis:
    return diagnose(tests, model=MODEL, parameters=NOMINAL, holdout=holdout or [])


@pytest.fixture(scope="module")
def stiffening() -> Diagnosis:
    return answer([rig(1, 20.0, 2e9), rig(2, 35.0, 2e9)])


def fits(found: Diagnosis, misfit: float) -> tuple[Criterion, FittedSet]:
    """A criterion on the rows of a diagnosis, and a made-up hypothesis that leaves a misfit of the same shape."""
    assert found.choice is not None and found.problem is not None
    before, noise = found.choice.before, found.choice.after.residual
    criterion = Criterion(found.problem, before, 20)
    share = misfit / (before.chi2 - criterion.floor)
    residual = noise + np.sqrt(share) * (before.residual - noise)
    fit = replace(before, residual=residual, chi2=criterion.floor + misfit)
    return criterion, FittedSet(("cubic_stiffness",), 1, fit)


def test_probabilities_add_up_to_one(stiffening: Diagnosis) -> None:
    found = stiffening.posterior
    assert found is not None
    total = found.nothing + found.unknown + sum(c.probability for c in found.candidates)
    assert total == pytest.approx(1.0, abs=1e-9)  # rounding of a sum of twenty terms
    assert [f.effect for f in stiffening.findings] == ["cubic_stiffness"]
    assert stiffening.findings[0].confidence > 0.9
    assert stiffening.findings[0].explained > 0.9


def test_a_noise_level_that_is_off_is_no_unknown_law(stiffening: Diagnosis) -> None:
    criterion, _ = fits(stiffening, 0.0)
    loud, quiet = copy(criterion), copy(criterion)
    loud.force, quiet.force = 1.0, 1e9  # in units of the noise
    assert criterion.doubt(0.0, 0.0) == 0.0
    # A level that is off by one, two and three standard deviations, and a force too weak to show a wrong form.
    for off in (1.0, 2.0, 3.0):
        assert loud.doubt(off * loud.slack, 0.0) == pytest.approx(0.5 * off**2, rel=0.01)
    # What stands in the means over the states is no noise, whatever its level.
    assert loud.doubt(loud.slack, loud.slack) == pytest.approx(0.5 * loud.slack / SOUND**2)
    louder = loud.at(loud.slack)
    # The same misfit beside what better laws leave, if the level is off by a standard deviation with them as well.
    assert louder.doubt(louder.slack, 0.0) == pytest.approx(0.5 * (2**2 - 1), rel=0.1)
    # Where noise is nothing beside the force, what is left is a wrong form or an unknown law.
    sound = SOUND**2 * quiet.force
    assert quiet.doubt(4 * sound, 0.0) == pytest.approx(0.5 * 4, rel=0.01)
    found = [criterion.doubt(misfit, 0.0) for misfit in np.linspace(0.0, 1.0, 50)]
    assert np.all(np.diff(found) > 0)


def test_noise_that_a_law_is_said_to_add_explains_nothing(stiffening: Diagnosis) -> None:
    assert stiffening.choice is not None
    before = stiffening.choice.before
    criterion, hypothesis = fits(stiffening, 0.0)
    noise = hypothesis.fit
    quieter, louder = (criterion.misfit(noise, share * criterion.floor) for share in (1.0, 1.5))
    assert louder == quieter  # what is left shows none of it
    # A law so uncertain that all it leaves could be its noise: a spring's force stays in the means over states, far
    # above what the noise level leaves open.
    assert criterion.misfit(before, before.chi2) > 10 * criterion.slack


def test_noise_that_a_law_adds_counts_at_the_level_that_noise_has(stiffening: Diagnosis) -> None:
    criterion, hypothesis = fits(stiffening, 0.0)
    below, added = 0.1 * criterion.floor, 0.05 * criterion.floor
    plain, noisy = (replace(hypothesis.fit, chi2=criterion.floor + more - below) for more in (0.0, added))
    quiet = criterion.at(-below)  # the noise is a tenth less than the channels show
    assert quiet.misfit(plain, criterion.floor) == pytest.approx(0.0, abs=1e-12)  # rounding
    assert quiet.misfit(noisy, criterion.floor + added) == pytest.approx(0.0, abs=1e-12)  # as good as the other


def test_what_noise_adds_grows_without_a_jump(stiffening: Diagnosis) -> None:
    """Two fits of one law differ in the last digits: neither is believed to be much louder than the other."""
    criterion, hypothesis = fits(stiffening, 0.0)
    drawn = criterion.problem.noise_added(hypothesis.fit.hypothesis, 3)
    spread = np.array([-1.0, 0.0, 1.0])

    def added(mean: float) -> float:
        criterion._added = drawn - (mean + spread)
        return criterion.floor_of(hypothesis.fit) - criterion.floor

    # Student's t of three draws: means of 4.30 standard errors (1 / sqrt(3) each) agree by chance once in twenty
    limit = 4.30 / np.sqrt(3)
    assert added(0.9 * limit) == added(-0.9 * limit) == 0.0
    assert 0.0 < added(1.01 * limit) < 0.05 * limit
    assert added(100 * limit) == pytest.approx(100 * limit, rel=1e-3)


def test_a_law_without_a_jump_stands_somewhere_in_every_row() -> None:
    found = answer([rig(9, 20.0, 0.0, snr=20.0)])
    assert found.problem is not None and found.problem.reduce.told().all()  # rounding is no jump


def test_noise_counts_once_where_nobody_knows_where_a_law_stands(stiffening: Diagnosis) -> None:
    """What rows leave there is said to be unknown: noise of the motion in it is a part of that."""
    criterion, hypothesis = fits(stiffening, 0.0)
    problem, here = criterion.problem, hypothesis.fit.hypothesis
    draws, nothing = [problem.reduce(moved) for moved in problem.moved(here)], np.zeros(1)
    assert np.all(problem.noise_added(here) != 0.0)
    try:
        problem.reduce.distrust(draws, nothing, np.ones(problem.reduce.count))
        assert np.all(problem.noise_added(replace(here)) == 0.0)
    finally:
        problem.reduce.trust()


def test_a_law_pays_for_dragging_the_baseline_along(stiffening: Diagnosis) -> None:
    criterion, hypothesis = fits(stiffening, 0.0)
    here = hypothesis.fit.hypothesis

    def cost(damping: float) -> float:
        moved = replace(here, values={**here.values, "B": damping})
        return criterion.departure(replace(hypothesis.fit, hypothesis=moved))

    # damping at nought against that of a factor of 2.5: nobody gives parameters that are 50 times off
    assert cost(NOMINAL["B"]) < cost(2.5 * NOMINAL["B"]) < 2.0 < cost(0.0)


def test_a_mass_that_vanishes_pays_for_it() -> None:
    """Of a mass that was weighed a twentieth may be left as rarely as of a spring that was given; a tenth more of it
    costs nothing that counts."""
    case, library = posed([recorded(1, 40.0, lambda t, x, v: 0.0 * x)])
    effect = next(effect for effect in library if effect.id == "added_mass")
    criterion = Criterion(case.problem, case.refit, 20)

    def paid(share: float) -> float:
        term = Term(effect, {"dm": share * case.baseline.mass})
        here = replace(case.refit.hypothesis, terms=())
        with_it, without = (standing(case.problem, h) for h in (replace(here, terms=(term,)), here))
        return criterion.departure(with_it) - criterion.departure(without)

    assert paid(-0.95) == pytest.approx(np.log1p(np.log2(0.05) ** 2), rel=1e-6)
    assert 0 < paid(0.1) < 0.02


def test_the_better_a_law_fits_the_more_probable_it_is(stiffening: Diagnosis) -> None:
    assert stiffening.choice is not None
    whole = stiffening.choice.before.chi2 - stiffening.choice.floor_before
    seen = []
    for share in (0.9, 0.6, 0.3, 0.1, 0.01):
        criterion, hypothesis = fits(stiffening, share * whole)
        (candidate,) = criterion.posterior([hypothesis], is_noise=False).candidates
        seen.append(candidate.probability)
    assert seen == sorted(seen)
    assert seen[0] < 0.1 and seen[-1] > 0.9


def test_a_law_is_the_more_probable_the_less_it_leaves_down_to_nothing(stiffening: Diagnosis) -> None:
    """Recordings of 100 dB show shares of 1e-8: leaving that little never speaks against a law."""
    criterion, _ = fits(stiffening, 0.0)
    whole = 1e10 * criterion.slack
    for exact in (False, True):
        forms = [
            criterion.form(share * whole, whole, exact=exact) for share in (0, 1e-8, 1e-6, 1e-4, 1e-2, 0.1, 0.5, 1)
        ]
        assert forms == sorted(forms, reverse=True)
        assert forms[0] > 5.0 and forms[-1] < 0.0


def test_each_further_law_may_draw_a_part_of_an_unknown_one(stiffening: Diagnosis) -> None:
    assert stiffening.choice is not None
    whole = stiffening.choice.before.chi2 - stiffening.choice.floor_before
    criterion, _ = fits(stiffening, 0.0)
    for share in (0.0, 0.01, 0.1):
        one, two, three = (criterion.form(share * whole, whole, laws=laws) for laws in (1, 2, 3))
        assert one > two > three


@pytest.mark.parametrize(("share", "tried"), [(0.7, True), (0.4, False)])
def test_what_a_sound_rig_does_not_leave_is_looked_at(stiffening: Diagnosis, share: float, tried: bool) -> None:
    """A scan is linear: a law that bends gains up to twice what it sees."""
    problem, choice = stiffening.problem, stiffening.choice
    assert problem is not None and choice is not None
    search = Search(problem, choice.before, load_effects(), lambda: None, ())
    least = SOUND**2 * search.criterion.force * search.criterion.rows
    seen = [replace(search.candidates[0], gain=share * least)]
    assert search._may_gain(seen, 0.5 * search.criterion.slack) is tried


def test_laws_that_are_about_as_probable_are_one_answer(stiffening: Diagnosis) -> None:
    assert stiffening.choice is not None
    whole = stiffening.choice.before.chi2 - stiffening.choice.floor_before
    criterion, leading = fits(stiffening, 0.0)
    _, rival = fits(stiffening, 0.5 * whole)  # predicts something else
    for odds, together in ((2.0, ("cubic_stiffness", "backlash")), (5.0, ("cubic_stiffness",))):
        first = Candidate(("cubic_stiffness",), 0.4, 0.9, leading)
        second = Candidate(("backlash",), 0.4 / odds, 0.9, replace(rival, names=("backlash",)))
        found = Posterior(0.0, 0.6 - 0.4 / odds, (first, second))
        assert _class(criterion, found, first, "cubic_stiffness") == (together, 0.4 * (1 + (len(together) - 1) / odds))


def test_where_the_noise_is_louder_what_a_law_leaves_counts_for_less(stiffening: Diagnosis) -> None:
    """A misfit is measured against the noise that there is, not against what a channel shows above the motion."""
    criterion, hypothesis = fits(stiffening, 30.0)
    signal = hypothesis.fit
    noise = np.sqrt(signal.chi2) * np.random.default_rng(1).standard_normal(len(signal.residual))
    louder = criterion.at(20.0)
    assert louder.misfit(replace(signal, residual=noise), np.nan) == pytest.approx(10.0)
    assert louder.misfit(signal, np.nan) > 10.0  # what stands in the means over the states is no noise
    rates = [c.likelihood(0.0) - c.likelihood(10.0) for c in (criterion, louder)]
    assert rates[1] < rates[0]
    assert louder.least == pytest.approx(criterion.least + 20.0)


def test_a_further_law_is_no_name_where_noise_hides_what_it_leaves(stiffening: Diagnosis) -> None:
    """What others leave by their form is taken down to the noise by anything, if the noise is louder than that."""
    criterion, _ = fits(stiffening, 0.0)
    hidden = 0.5 * criterion.slack
    assert not criterion.is_worth_a_name(0.0, hidden, 20 * hidden)
    assert criterion.is_worth_a_name(0.0, hidden, 2 * hidden)  # no form leaves half of all
    clear = 1e4 * criterion.slack
    assert criterion.is_worth_a_name(0.0, clear, 20 * clear)
    assert not criterion.is_worth_a_name(0.5 * clear, clear, 20 * clear)  # nor does what leaves half of the rest


def test_a_small_further_law_has_a_name_where_it_leaves_next_to_nothing(stiffening: Diagnosis) -> None:
    """A two-hundredth of all may be what is wrong with a form; but other laws take any share of that, and seldom all:
    by the stated odds of one effect against two, a right law leaves less than 3 % of it."""
    criterion, _ = fits(stiffening, 0.0)
    small = 1e4 * criterion.slack
    assert criterion.is_worth_a_name(0.01 * small, small, 200 * small)
    assert not criterion.is_worth_a_name(0.1 * small, small, 200 * small)


def test_a_set_is_compared_with_what_it_is_without_an_idle_member(stiffening: Diagnosis) -> None:
    assert stiffening.choice is not None and stiffening.problem is not None
    problem, choice = stiffening.problem, stiffening.choice
    preload = next(e for e in load_effects([]) if e.id == "preload" and e.size == 1)
    idle = Term(preload, dict.fromkeys(preload.amplitudes, 0.0))
    both = standing(problem, replace(choice.after.hypothesis, terms=(*choice.after.hypothesis.terms, idle)))
    search = Search(problem, choice.before, [], lambda: None, ())
    rests = {
        rest.names: counts
        for rest, counts in search.without_one(FittedSet(("cubic_stiffness", "preload"), 2, both), search.criterion)
    }
    assert rests == {("cubic_stiffness",): False, ("preload",): True}


def test_a_law_that_another_assumption_hid_is_asked_beside_its_rivals(stiffening: Diagnosis) -> None:
    """Friction that falls with speed was taken for Coulomb friction where rest was not looked at, and had no chance."""
    assert stiffening.choice is not None and stiffening.problem is not None
    problem, before, library = stiffening.problem, stiffening.choice.before, load_effects([])
    stops = [e for e in library if e.id == "two_sided_stop"]
    rival = next(made for c in scan(problem, before, stops) if (made := try_term(problem, before, c.term)) is not None)
    found = weigh(problem, before, library, [FittedSet(("two_sided_stop",), 2, rival)])
    assert found.candidates[0].names == ("cubic_stiffness",)


def test_a_member_is_no_surer_than_one_that_explains_as_much_and_does_not_count(stiffening: Diagnosis) -> None:
    """The set of the idle one was left out, and the other had its probability: 93 % of a wrong name."""
    criterion, alone = fits(stiffening, 100.0)
    _, both = fits(stiffening, 0.0)
    named, idle = (replace(both, names=("cubic_stiffness", name), size=2, laws=2) for name in ("preload", "added_mass"))
    sure = criterion.posterior([alone, named], is_noise=False)
    asked = criterion.posterior([alone, named, replace(idle, counting=frozenset(alone.names))], is_noise=False)
    assert sure.of(["preload"]) > 0.9
    assert asked.of(["preload"]) == pytest.approx(0.5, abs=0.05)  # as much as the other one, and a bit is unknown
    assert asked.of(["cubic_stiffness"]) > 0.9
    assert asked.of(["added_mass"]) == 0.0


def test_the_same_recording_twice_makes_nothing_more_certain() -> None:
    once = rig(1, 20.0, 1.5e8)
    again = replace(once, name="again", t=once.t + 1e-9)
    single, double = answer([once]), answer([once, again])
    assert single.problem is not None and double.problem is not None
    assert effective_states(double.problem) == effective_states(single.problem)
    assert single.verdict == double.verdict
    assert single.posterior is not None and double.posterior is not None
    # what the criterion cannot know is that the noise is the same; the price of a parameter grows with its logarithm
    assert double.posterior.something <= single.posterior.something + 0.1


def test_a_held_out_recording_of_the_same_states_proves_no_form(stiffening: Diagnosis) -> None:
    """It repeats the model error that the recordings in use have shown; what it adds to both hypotheses is alike."""
    assert stiffening.choice is not None and stiffening.problem is not None
    problem, before, after = stiffening.problem, stiffening.choice.before, stiffening.choice.after
    criterion = Criterion(problem, before, 20)
    floor = criterion.floor
    seen = criterion.likelihood(after.chi2 - floor) - criterion.likelihood(before.chi2 - floor)
    told = unseen_likelihood(problem, problem.parts[1:])(before, after)
    assert seen > 20.0
    assert told == pytest.approx(0.0, abs=1e-12)  # rounding: no state of this recording is new


@pytest.mark.parametrize(("factor", "least", "most"), [(0.9, 0.0, np.inf), (1.1, 0.0, np.inf), (-1.0, -2.5, -1.0)])
def test_a_held_out_recording_contradicts_only_what_does_worse_than_no_law(
    stiffening: Diagnosis, factor: float, least: float, most: float
) -> None:
    """A law that is a tenth off leaves a hundredth of the misfit of any recording, however quiet it is. One of the
    wrong sign leaves four times as much; one recording in ten is of another state, hence no less than log(0.1)."""
    assert stiffening.choice is not None and stiffening.problem is not None
    problem, before, after = stiffening.problem, stiffening.choice.before, stiffening.choice.after
    (term,) = after.hypothesis.terms
    scaled = {n: v * (factor if n in term.effect.amplitudes else 1.0) for n, v in term.values.items()}
    off = standing(problem, replace(after.hypothesis, terms=(replace(term, values=scaled),)))
    for parts in (problem.parts[:1], problem.parts[1:]):
        assert least <= unseen_likelihood(problem, parts)(before, off) <= most


@pytest.mark.parametrize("snr", [20.0, 34.0, 60.0, 80.0, 100.0, None])
def test_nothing_is_missing_at_any_noise(snr: float | None) -> None:
    found = answer([rig(3, 20.0, 0.0, snr=snr), rig(4, 35.0, 0.0, snr=snr)])
    assert found.findings == ()
    assert found.verdict in ("consistent", "recalibrated")
    assert found.posterior is not None and found.posterior.nothing > 0.5


@pytest.mark.parametrize("snr", [20.0, 60.0, 100.0, None])
def test_a_clear_law_is_named_at_any_noise(snr: float | None) -> None:
    found = answer([rig(5, 20.0, 2e9, snr=snr), rig(6, 35.0, 2e9, snr=snr)])
    assert [f.effect for f in found.findings] == ["cubic_stiffness"]


def test_more_data_keep_a_clear_answer() -> None:
    for seconds in (0.6, 2.0, 8.0):
        found = answer([rig(7, 30.0, 2e9, seconds=seconds)])
        assert {n for f in found.findings for n in f.alike} & {"cubic_stiffness"}, seconds


@pytest.mark.parametrize("snr", [34.0, 80.0, None])
@pytest.mark.parametrize("seconds", [1.0, 4.0])
def test_a_held_out_recording_of_any_noise_and_length_keeps_a_right_name(snr: float | None, seconds: float) -> None:
    held = rig(9, 25.0, 2e9, seconds=seconds, snr=snr)
    found = answer([rig(1, 20.0, 2e9), rig(2, 35.0, 2e9)], [held])
    assert [f.effect for f in found.findings] == ["cubic_stiffness"]


def test_a_held_out_recording_of_another_state_is_told() -> None:
    tests = [rig(1, 20.0, 2e9), rig(2, 35.0, 2e9)]
    borne_out, against = answer(tests, [rig(9, 35.0, 2e9)]), answer(tests, [rig(9, 35.0, 0.0)])
    assert any("rig_9 was held out and is not better explained" in note for note in against.notes)
    assert not any("held out and is not" in note for note in borne_out.notes)
    # it may be right all the same, as one held-out recording in ten is of another state: ten times the doubt
    doubt, none = (1 - found.findings[0].confidence for found in (against, borne_out))
    assert doubt > 3 * none


def test_the_error_of_the_preparation_is_no_physics(stiffening: Diagnosis) -> None:
    """A misfit of the size that smoothing leaves makes no name probable, however many rows there are."""
    criterion, _ = fits(stiffening, 0.0)
    gain = criterion.likelihood(0.0) - criterion.likelihood(0.3 * ACCURACY**2 * criterion.force)
    assert gain < criterion.price(1, 0.0)


def test_fits_are_what_hypotheses_hold(stiffening: Diagnosis) -> None:
    assert stiffening.posterior is not None
    assert all(isinstance(c.hypothesis.fit, Fit) for c in stiffening.posterior.candidates)


@pytest.mark.parametrize(("share", "named"), [(0.0, ""), (0.03, ""), (0.5, "preload")])
def test_a_small_constant_force_is_the_zero_of_a_sensor(share: float, named: str) -> None:
    """A displacement sensor that is off by 3 % of the motion is no preload; half of the motion is one."""
    tests = [rig(seed, level, 0.0) for seed, level in ((11, 30.0), (12, 15.0))]
    spread = float(np.std(np.concatenate([test.channel("x") for test in tests])))
    found = answer([replace(test, x=test.channel("x") + share * spread) for test in tests])
    assert [finding.effect for finding in found.findings] == ([named] if named else [])
    assert found.verdict == ("missing_physics" if named else "recalibrated" if share else found.verdict)
    assert any("zero of the displacement sensor" in note for note in found.notes) == (share > 0)


def test_the_zero_of_a_sensor_is_as_probable_as_sensors_are_off() -> None:
    shares = np.array([0.0, ZERO, 2 * ZERO, 5 * ZERO, 0.9])
    told = [zero_probability(share) for share in shares]
    assert told == sorted(told, reverse=True) and told[0] > 0.95 and told[-2] < 0.05


def test_a_small_law_beside_one_that_explains_nearly_all_is_told() -> None:
    """Dry friction that takes a hundredth of what a stop takes, and leaves noise alone: no form of a stop does that."""

    def gap_and_friction(x: Any, v: Any) -> Any:
        return 60000.0 * np.maximum(x - 0.4e-3, 0.0) + 0.5 * np.tanh(v / 1e-3)

    tests = [rig(seed, level, 0.0, snr=45.0, beside=gap_and_friction) for seed, level in ((21, 60.0), (22, 25.0))]
    found = answer(tests)
    assert found.verdict == "missing_physics"
    first, second = (finding.effect for finding in found.findings)
    assert first in {"contact_loss", "impact"} and second.endswith("friction")
    share = [finding.explained for finding in found.findings]
    assert share[0] > 0.9 and share[1] < 0.1  # else the case would show nothing


@pytest.mark.parametrize(("slow", "known", "shown"), [(1, 4000, True), (400, 4000, False), (1, 71, False)])
def test_a_rest_of_few_independent_samples_shows_nothing(slow: int, known: int, shown: bool) -> None:
    """White noise is shown to be independent of the motion; noise of which ten values are independent is not, nor noise
    of which next to all is where the law is not sure: as many rows as cells."""
    rng = np.random.default_rng(5)
    t = np.arange(4000) * 1e-3
    rest = np.convolve(rng.standard_normal(len(t) + slow), np.ones(slow), mode="same")[: len(t)]
    rest = (rest - np.mean(rest)) / np.std(rest)
    sure = np.zeros(len(t), dtype=bool)
    sure[rng.choice(len(t), known, replace=False)] = True
    cells = _cells(np.sin(9 * t), np.cos(9 * t))
    assert _independent([rest * sure], [sure], [cells], 0.08 * known, 0.08 * known) == shown


def test_few_samples_of_noise_may_be_loud(stiffening: Diagnosis) -> None:
    """A rest of 500 samples is a tenth louder than its noise in one case of twenty (chi-squared: 2 / n)."""
    criterion, _ = fits(stiffening, 0.0)
    assert criterion.noise_of(500) == pytest.approx((1 + 1.645 * np.sqrt(2 / 500)) * criterion.floor, rel=0.01)
    assert criterion.floor < criterion.noise_of(10**6) < 1.01 * criterion.floor


def test_no_share_of_a_force_is_more_than_all_of_it() -> None:
    """A fit may pass through larger shares, and ends within what the block allows."""
    found = answer([rig(7, 30.0, 0.0, beside=lambda x, v: 6.0 * np.tanh(v / 0.005))])
    assert found.problem is not None and found.choice is not None
    weakening = next(e for e in load_effects([]) if e.id == "cyclic_degradation" and e.form == "Energy")
    assert weakening.highest == {"share": 1.0}
    start = replace(found.choice.before.hypothesis, terms=(Term(weakening, {"share": 3.0, "E_c": 1.0}),))
    unknowns = {u.key: u for u in found.problem.unknowns(start, most=True)}
    assert unknowns["0", "share"].high == 1.0 and found.problem.unknowns(start)[-2].high > 1.0
    assert not is_allowed(start)


def test_a_damper_of_one_direction_is_no_friction() -> None:
    """Friction of different slopes in the two directions fits it, with nothing left of the friction."""
    found = answer(
        [rig(s, level, 0.0, beside=lambda x, v: 12.0 * v * abs(v) * (v > 0)) for s, level in ((21, 20.0), (22, 40.0))]
    )
    assert "asymmetric_friction" not in [finding.effect for finding in found.findings]
    assert found.verdict not in ("consistent", "recalibrated")


def test_friction_that_turns_quickly_is_dry_friction() -> None:
    """Its turn takes less than a thousandth of the peak speed; no fall with speed is needed for that."""
    tests = [
        rig(seed, level, 0.0, snr=45.0, beside=lambda x, v: 2.0 * np.tanh(v / 2e-4))
        for seed, level in ((31, 20.0), (32, 35.0))
    ]
    (finding,) = answer(tests).findings
    assert finding.effect == "coulomb_friction"
    # filters of a recording chain and the smoother round the jump; the level away from it stays
    assert finding.parameters["Fc"].value == pytest.approx(2.0, rel=0.02)


def test_what_acts_for_a_part_of_the_time_does_not_move_the_baseline() -> None:
    """The refit is pulled by the stiffer part of the time, the trimmed fit is not: half of the rows are free of it.
    These tell the stiffness within a standard error of 1.1e-3 (beyond the resonance); 4e-3 is four of them."""
    found = answer([rig(8, 35.0, 2e9, until=1.5), rig(9, 30.0, 2e9, until=1.5)])
    assert found.choice is not None and found.problem is not None
    fitted, left = outside(found.problem, found.choice.before)
    assert fitted.hypothesis.values["Kl"] == pytest.approx(30000.0, rel=4e-3)
    assert found.choice.before.hypothesis.values["Kl"] > 30300.0
    assert left < 1.05  # unit noise, of which the estimate is known to 5 %
    assert [f.effect for f in found.findings] == ["cubic_stiffness"]


def test_a_further_law_counts_where_no_wrong_form_takes_as_much(stiffening: Diagnosis) -> None:
    """A law that leaves a fifth is far off; what takes a tenth of that beside it may be what is wrong with its form."""
    criterion, _ = fits(stiffening, 0.0)
    without = 1e4 * criterion.slack
    assert not criterion.is_worth_a_name(0.13 * without, without, 25 * without)
    assert criterion.is_no_form(0.13 * without, without, 2, [0.1 * without])
    assert not criterion.is_no_form(0.13 * without, without, 2, [0.1 * without, 0.9 * without])


@pytest.mark.parametrize("relaxes", [False, True])
def test_wrong_forms_take_what_is_wrong_with_a_form_and_no_other_law(relaxes: bool) -> None:
    """Friction that turns over slowly beside the block's tanh: a curve over v knows how. Of a spring that relaxes in
    10 ms no curve over the state knows, as its force depends on the past."""

    def force(t: np.ndarray, x: np.ndarray, v: np.ndarray) -> np.ndarray:
        turn = v / 0.15
        if not relaxes:
            return 8.0 * turn / (1 + np.abs(turn) ** 1.3) ** (1 / 1.3)
        fades = float(np.exp(-(t[1] - t[0]) / 0.01))
        return 8.0 * np.tanh(turn) + lfilter([0.5e4], [1.0, -fades], np.diff(x, prepend=x[0]))

    tests = [recorded(seed, level, force, noise=0.001) for seed, level in enumerate((60.0, 45.0, 30.0), 1)]
    case, library = posed(tests)
    friction = next(effect for effect in library if effect.id == "coulomb_friction" and not effect.form)
    (start, *_) = scan(case.problem, case.refit, [friction])
    fit = try_fit(case.problem, replace(case.refit.hypothesis, terms=(start.term,)), 60)
    assert fit is not None
    left = fit.chi2 - case.problem.floor(fit)
    assert left > 0.5
    share = max(wrong_forms(case.problem, fit)) / left
    # Eight coefficients follow any smooth curve to some per cent; a relaxation is in quadrature with the motion.
    assert share < 0.1 if relaxes else share > 0.9


def test_a_noise_level_that_is_off_widens_no_interval(stiffening: Diagnosis) -> None:
    """What a law leaves beyond it does, as it comes again wherever the motion does."""
    criterion, hypothesis = fits(stiffening, 0.0)
    fit, problem = hypothesis.fit, criterion.problem

    def variance(left: float) -> float:
        return variance_of_states(problem, replace(fit, chi2=criterion.floor + left))

    assert variance(0.9 * criterion.slack) == variance(0.0) == pytest.approx(1.0)
    beyond = criterion.each * criterion.slack
    assert variance(3.0 * criterion.slack) == pytest.approx(1.0 + 2.0 * beyond, rel=0.05)
