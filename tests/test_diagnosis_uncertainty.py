"""Standard errors, minima behind ridges, and laws that the motion cannot show."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from hystid.diagnosis.decide.trials import are_reached
from hystid.diagnosis.fit.case import pose
from hystid.diagnosis.fit.descent import fit
from hystid.diagnosis.fit.hypothesis import Fit, Term
from hystid.diagnosis.fit.problem import Problem
from hystid.diagnosis.fit.search import downhill
from hystid.diagnosis.fit.uncertainty import with_robust_errors
from hystid.diagnosis.model.library import load_effects
from hystid.diagnosis.prepare.given import given_parameters
from hystid.diagnosis.prepare.recordings import Taken
from hystid.recording import loaded
from tests.test_diagnosis import JENKINS, case, spec


@pytest.fixture(scope="module")
def healthy(tmp_path_factory: pytest.TempPathFactory) -> tuple[Problem, Fit]:
    place, _ = case(tmp_path_factory.mktemp("healthy"), spec("null", (), JENKINS), 72)
    tests = loaded(sorted(place.glob("rec_*.csv")))
    made = pose(Taken(tests, [], given_parameters(place / "parameters.json"), ()), "HystId.Oscillators.Jenkins")
    return made.problem, made.refit


def test_standard_errors_are_not_below_those_of_least_squares(healthy: tuple[Problem, Fit]) -> None:
    problem, fitted = healthy
    wide = with_robust_errors(problem, fitted)
    for unknown in fitted.unknowns:
        assert wide.stderr(unknown.key) >= (1 - 1e-9) * fitted.stderr(unknown.key)
        assert wide.stderr(unknown.key) < 30 * fitted.stderr(unknown.key)  # wider, not meaningless
    assert wide.hypothesis is fitted.hypothesis


def test_a_residual_that_keeps_its_sign_widens_the_errors(healthy: tuple[Problem, Fit]) -> None:
    """Errors that are alike over long stretches count as few: the same mean square, far larger standard errors."""
    problem, fitted = healthy
    rng = np.random.default_rng(0)
    columns = problem.jacobian(fitted.hypothesis, fitted.unknowns)
    slow = np.repeat(rng.standard_normal(40), -(-len(fitted.residual) // 40))[: len(fitted.residual)]
    column = next(i for i, u in enumerate(fitted.unknowns) if u.key == ("base", "Kl"))
    alike = slow * np.sign(columns[:, column])  # what a stiffness that wanders would leave
    alike *= np.sqrt(fitted.chi2 / np.mean(alike**2))
    key = ("base", "Kl")
    white = with_robust_errors(problem, fitted).stderr(key)
    wandering = with_robust_errors(
        problem, Fit(fitted.hypothesis, alike, fitted.chi2, fitted.unknowns, fitted.covariance)
    )
    assert wandering.stderr(key) > 3 * white


def test_noise_of_the_motion_once_more_is_of_the_same_size(healthy: tuple[Problem, Fit]) -> None:
    problem, fitted = healthy
    for sign in (1.0, -1.0):
        again = problem.with_noise_again(0, sign)
        assert again.reduce is problem.reduce
        moved = [a.x - b.x for a, b in zip(again.parts, problem.parts, strict=True)]
        # Smoothing leaves less than the noise of the channel, but of its order.
        for part, dx in zip(problem.parts, moved, strict=True):
            assert 0.05 * part.noise["x"] < float(np.std(dx)) < part.noise["x"]
        assert float(np.mean(again.rows(fitted.hypothesis) ** 2)) > 1.5 * fitted.chi2  # twice the noise in F - m a


def test_friction_that_never_slides_is_none(healthy: tuple[Problem, Fit]) -> None:
    problem, fitted = healthy
    friction = next(effect for effect in load_effects() if effect.class_name.endswith(".CoulombFriction"))
    top = float(problem.scales.v[-1])
    for share, kept in ((0.02, True), (0.4, True), (0.6, False)):
        there = replace(fitted.hypothesis, terms=(Term(friction, {"Fc": 1.0, "v_s": share * top}),))
        assert are_reached(problem, replace(fitted, hypothesis=there)) == kept


def test_the_tail_of_a_contact_is_none(healthy: tuple[Problem, Fit]) -> None:
    """Touched at the largest displacements alone, and as wide as the way there, it is a curve and no contact."""
    problem, fitted = healthy
    rough = next(effect for effect in load_effects() if effect.class_name.endswith(".ContactLoss__Smooth"))
    top = max(float(np.max(part.x)) for part in problem.parts)
    for gap, width, kept in ((0.3, 0.1, True), (0.9, 0.05, True), (0.9, 0.8, False)):
        contact = Term(rough, {"k": 1.0, "gap": gap * top, "w": width * top, "side": 1.0})
        there = replace(fitted.hypothesis, terms=(contact,))
        assert are_reached(problem, replace(fitted, hypothesis=there)) == kept


def test_a_fit_in_a_local_minimum_is_led_out(tmp_path: Path) -> None:
    """Few sliders make minima along the stiffness and strength of a group; a simplex across them finds the deeper."""
    place, _ = case(tmp_path, spec("null", (), "iwan"), 87)
    tests = loaded(sorted(place.glob("rec_*.csv")))
    made = pose(Taken(tests, [], given_parameters(place / "parameters.json"), ()), "HystId.Oscillators.Iwan")
    problem, best = made.problem, made.refit
    values = dict(best.hypothesis.values)
    start = replace(best.hypothesis, values={**values, "fc": 0.65 * values["fc"], "Ks": 0.82 * values["Ks"]})
    aside = fit(problem, start)
    assert aside.chi2 > 1.02 * best.chi2  # a descent alone does not come out
    ends = [fit(problem, h).chi2 for h in downhill(problem, aside)]
    assert ends and min(ends) < aside.chi2
