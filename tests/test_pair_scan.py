"""Two effects that hide each other: the scan of both together."""

from dataclasses import replace

import numpy as np
import pytest

from hystid.diagnosis.fit.case import Case
from hystid.diagnosis.fit.hypothesis import Hypothesis
from hystid.diagnosis.fit.pairscan import TermPair, scan_pairs
from hystid.diagnosis.fit.search import complement, try_fit
from hystid.diagnosis.model.effects import Effect
from tests.test_diagnosis_windows import STIFFNESS, motion, posed, recorded

LEVELS = (60.0, 45.0)
GAP = 0.4 * float(np.max(motion(1, LEVELS[0])[1]))  # of a stop on one side
SQUARE = -STIFFNESS / (5 * GAP)  # of a spring that is softer there: the stop hides it, and it the stop
CONTACT = 0.4 * STIFFNESS


def _force(t: np.ndarray, x: np.ndarray, v: np.ndarray) -> np.ndarray:
    return SQUARE * x**2 + CONTACT * np.maximum(x - GAP, 0.0)


@pytest.fixture(scope="module")
def rig() -> tuple[Case, list[Effect]]:
    return posed([recorded(seed, level, _force, noise=1e-3) for seed, level in enumerate(LEVELS, 1)])


def _with(here: Hypothesis, pair: TermPair) -> Hypothesis:
    return replace(here, terms=(*here.terms, *pair.terms))


def _by_gain(gain: float, size: int) -> float:
    return gain


def test_the_gain_of_a_pair_is_that_of_least_squares(rig: tuple[Case, list[Effect]]) -> None:
    """The blocks give what the plain least squares problem of both columns gives, beside the baseline."""
    case, effects = rig
    some = [effect for effect in effects if effect.id in ("contact_loss", "quadratic_stiffness", "quadratic_damping")]
    pairs = scan_pairs(case.problem, case.refit, some, _by_gain, 50)
    assert {len(pair.ids) for pair in pairs} == {2}
    outside, signals = complement(case.problem, case.refit), case.problem.signals(case.refit.hypothesis)
    residual = outside(case.refit.residual)
    for pair in pairs:
        points = [(term.effect, at) for term in pair.terms for at in term.effect.units_at(term.values)]
        columns = [case.problem.reduce(effect.forces(signals, at)) for effect, at in points]
        beyond = outside(np.transpose([column / np.linalg.norm(column) for column in columns]))
        _, left, _, _ = np.linalg.lstsq(beyond, residual, rcond=None)
        # the scan looks at every row, or at every second: sums of squares of 5,000 rows agree to some per cent
        assert pair.gain == pytest.approx(float(residual @ residual - left[0]), rel=0.05)


def test_two_laws_that_hide_each_other_are_found_with_their_parameters(rig: tuple[Case, list[Effect]]) -> None:
    """Both laws, fitted from the best pairs, leave the noise; and their parameters are those of the rig."""
    case, effects = rig
    rows = len(case.refit.residual)
    pairs = scan_pairs(case.problem, case.refit, effects, lambda gain, size: gain - 0.5 * size * np.log(rows), 24)
    here = case.refit.hypothesis
    both = [pair for pair in pairs if pair.ids == {"contact_loss", "quadratic_stiffness"}]
    fits = [try_fit(case.problem, _with(here, pair), 25) for pair in both]
    best = min((fit for fit in fits if fit is not None), key=lambda fit: fit.chi2)
    assert best.chi2 < 1.1 * case.problem.floor(best)  # the level of the noise is known to a few per cent
    values = {term.effect.id: term.values for term in best.hypothesis.terms}
    assert values["contact_loss"]["gap"] == pytest.approx(GAP, rel=0.05)
    assert values["quadratic_stiffness"]["k2"] == pytest.approx(SQUARE, rel=0.05)
