"""Names that a fit alone would give: laws at the limit of their parameters, windows that are wear, wrong forms."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from hystid.diagnosis import diagnose
from hystid.diagnosis.decide.limits import blames_in_vain, is_itself
from hystid.diagnosis.fit.case import pose
from hystid.diagnosis.fit.descent import fit
from hystid.diagnosis.fit.hypothesis import Fit, Term
from hystid.diagnosis.fit.problem import Problem, standing
from hystid.diagnosis.fit.windows import Window, has_edges, windowed
from hystid.diagnosis.model.effects import Effect
from hystid.diagnosis.model.library import load_effects
from hystid.diagnosis.prepare.given import given_parameters
from hystid.diagnosis.prepare.recordings import Taken
from hystid.diagnosis.tell.locate import _rate
from hystid.numeric import Array
from hystid.recording import Recording, loaded
from tests.test_diagnosis import LINEAR, case, run, spec


def prepared(folder: Path, ident: str, seed: int) -> tuple[Problem, Fit]:
    """Problem and refit of a linear baseline with one concealed effect, or none."""
    ids = (ident,) if ident else ()
    place, _ = case(folder, spec("single" if ident else "null", ids, LINEAR), seed)
    tests = loaded(sorted(place.glob("rec_*.csv")))
    made = pose(Taken(tests, [], given_parameters(place / "parameters.json"), ()), "HystId.Oscillators.Linear")
    return made.problem, made.refit


@pytest.fixture(scope="module")
def sound(tmp_path_factory: pytest.TempPathFactory) -> tuple[Problem, Fit]:
    return prepared(tmp_path_factory.mktemp("sound"), "", 72)


def law(ident: str, form: str = "") -> Effect:
    return next(e for e in load_effects() if e.id == ident and e.form == form)


def test_a_contact_that_damps_more_than_it_carries_is_none(sound: tuple[Problem, Fit]) -> None:
    problem, fitted = sound
    signals = problem.signals(fitted.hypothesis)
    speed, top = problem.scales.v[-1], problem.scales.x[-1]
    contact = {"k": 1e4, "gap": 0.3 * top, "side": 0.0}
    for form in ("", "Linear"):
        damped = 1e4 / speed
        assert is_itself(problem, Term(law("impact", form), {**contact, "c": 0.1 * damped}), signals)
        assert not is_itself(problem, Term(law("impact", form), {**contact, "k": 0.0, "c": damped}), signals)
    spring, damper = ({**contact, "tau": share / (2 * np.pi * problem.scales.band[0])} for share in (0.1, 1.0))
    assert is_itself(problem, Term(law("impact", "KelvinVoigt"), spring), signals)
    assert not is_itself(problem, Term(law("impact", "KelvinVoigt"), damper), signals)


def test_no_mass_is_blamed_that_leaves_the_force_as_it_is(sound: tuple[Problem, Fit]) -> None:
    """Without mass, spring and damper the balance is F: nothing of it is explained, however large the inertia was."""
    problem, fitted = sound
    effect, mass = law("added_mass"), fitted.hypothesis.values["m"]
    name = effect.semantics.mass
    heavier = replace(fitted.hypothesis, terms=(Term(effect, {name: 0.05 * mass}),))
    lost = replace(
        fitted.hypothesis,
        values={**fitted.hypothesis.values, "B": 0.0, "Kl": 0.0},
        terms=(Term(effect, {name: -0.98 * mass}),),
    )
    assert blames_in_vain(problem, standing(problem, lost))
    assert not blames_in_vain(problem, standing(problem, heavier))
    assert not blames_in_vain(problem, fitted)


@pytest.mark.parametrize(("name", "form"), [("bilinear_stiffness", "Rough"), ("contact_loss", "Smooth")])
def test_a_kink_wider_than_the_stroke_is_none(sound: tuple[Problem, Fit], name: str, form: str) -> None:
    problem, fitted = sound
    signals, top = problem.signals(fitted.hypothesis), problem.scales.x[-1]
    kink = {"k": 1e4, "gap": 0.3 * top, "side": 1.0}
    effect = law(name, form)
    kink = {key: value for key, value in kink.items() if key in effect.units}
    assert is_itself(problem, Term(effect, {**kink, "w": 0.1 * top}), signals)
    assert not is_itself(problem, Term(effect, {**kink, "w": 1.4 * top}), signals)
    square = Term(law("bilinear_stiffness", "Smooth"), {"k": 1e4, "w": 1.4 * top})  # presses nothing at rest
    assert is_itself(problem, square, signals)


@pytest.mark.parametrize("form", ["", "Lorentz"])
def test_a_pinched_region_that_a_few_samples_pass_is_none(sound: tuple[Problem, Fit], form: str) -> None:
    problem, fitted = sound
    signals, top = problem.signals(fitted.hypothesis), problem.scales.x[-1]
    assert is_itself(problem, Term(law("pinching", form), {"share": 0.5, "w": 0.1 * top}), signals)
    assert not is_itself(problem, Term(law("pinching", form), {"share": 0.5, "w": 1e-3 * top}), signals)


def test_a_mode_resonates_in_the_band(sound: tuple[Problem, Fit]) -> None:
    problem, fitted = sound
    signals, band = problem.signals(fitted.hypothesis), problem.scales.band
    mode = {"m2": 0.1, "zeta": 0.02, "f2": 0.8 * band[1]}
    assert is_itself(problem, Term(law("hidden_mode"), mode), signals)
    for limit in ({"zeta": 1.5}, {"f2": 2 * band[1]}, {"f2": 0.5 * band[0]}):
        assert not is_itself(problem, Term(law("hidden_mode"), {**mode, **limit}), signals)


@pytest.mark.parametrize(("ramp", "sharp"), [(0.02, True), (0.6, False)])
def test_windows_have_edges(sound: tuple[Problem, Fit], ramp: float, sharp: bool) -> None:
    """A force added to the measured one, in a window that opens at once, and in one that comes and goes."""
    problem, _ = sound
    span = float(problem.parts[0].t[-1])
    preload, window = law("preload"), Window(0.3 * span, 0.7 * span)
    level = 5 * problem.parts[0].balance_noise(problem.baseline.mass)
    parts = []
    for part in problem.parts:
        edges = [(part.t - window.begin) / (ramp * 0.4 * span), (window.end - part.t) / (ramp * 0.4 * span)]
        parts.append(replace(part, F=part.F + level * np.clip(np.minimum(*edges), 0, 1)))
    shifted = problem.of(parts)
    start = windowed(preload, window)
    term = Term(start, {"f0": level, **start.near})
    fitted = fit(shifted, replace(sound[1].hypothesis, terms=(term,)), iterations=60)
    assert has_edges(fitted) is sharp
    on, off, _ = start.names(0)
    values = fitted.hypothesis.terms[-1].values
    closed = replace(term, values={**values, off: values[on]})
    assert not has_edges(replace(fitted, hypothesis=replace(fitted.hypothesis, terms=(closed,))))


@pytest.mark.parametrize(
    ("ident", "seed", "family"),
    [
        ("preload", 3, {"preload", "asymmetric_friction", "force_drift"}),
        ("displacement_dependent_damping", 3, {"quadratic_damping"}),
        ("added_mass", 3, {"force_gain", "force_range"}),  # a gain of the force, or of it where the mass shows
        ("two_sided_stop", 3, {"backlash", "cubic_stiffness", "impact", "contact_loss"}),
    ],
)
def test_without_the_true_law_no_unrelated_name(tmp_path: Path, ident: str, seed: int, family: set[str]) -> None:
    place, _ = case(tmp_path, spec("single", (ident,), LINEAR), seed)
    found = run(place, exclude=(ident,))
    assert all(finding.effect in family or ident in finding.alike for finding in found.findings)


def test_a_law_that_leads_the_structure_away_has_no_name() -> None:
    """The inertia of a linkage depends on the place. A nonlinear spring takes most of the force that is missing, and
    the model with it runs off by four times as much as without."""
    m, damping, stiffness, lever, t = 2.0, 15.0, 4.8e4, 36.0, np.arange(6000) * 1e-3
    rng, tests = np.random.default_rng(0), []
    for name, size, low, high in (("strong", 30.0, 5, 45), ("weak", 18.0, 10, 60)):

        def force(at: Array, size: float = size, low: float = low, high: float = high) -> Array:
            return size * np.sin(2 * np.pi * (low + (high - low) * at / 12) * at)

        def moved(at: float, state: Array) -> list[Any]:
            x, v = state
            rest = force(np.asarray(at)) - damping * v - stiffness * x - 0.5 * lever * v**2
            return [v, rest / (m + lever * x)]

        path = solve_ivp(moved, (0, t[-1]), [0, 0], t_eval=t, rtol=1e-7, atol=1e-10, max_step=0.002).y
        clean = {"F": force(t), "x": path[0], "v": path[1], "a": np.asarray(moved(t, path)[1])}
        noisy = {k: u + 0.02 * np.std(u) * rng.standard_normal(len(t)) for k, u in clean.items()}
        tests.append(Recording(name, t, **noisy))
    given = {"m": m, "B": damping, "Kl": stiffness}
    found = diagnose(tests, model="HystId.Oscillators.Linear", parameters=given)
    assert found.verdict == "unknown_physics" and not found.findings
    assert any("spring would explain" in note and "not named" in note for note in found.notes)
    assert found.posterior is not None and found.posterior.candidates[0].explained > 0.5


def test_what_rests_at_one_place_has_no_speeds_to_compare(sound: tuple[Problem, Fit]) -> None:
    """Most of a recording stands where it is furthest from zero: to tell the rate of an unknown force was a
    traceback."""
    problem, _ = sound
    still = replace(problem.parts[0], x=np.full(len(problem.parts[0]), 1e-3))
    assert _rate(problem.of([still]), [np.ones(len(still))]) == "not rate dependent"
