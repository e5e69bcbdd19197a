"""What the effect blocks promise: symmetry, dissipation, thresholds, and that every block is an effect."""

from functools import cache

import numpy as np
import pytest

from hystid.diagnosis import load_effects
from hystid.diagnosis.model.effects import Effect, Signals, effect_id

DT = 5e-4
T = np.arange(0, 1, DT)  # whole periods of 5 Hz
X = 2e-3 * np.sin(2 * np.pi * 5 * T)
V = 2e-3 * 2 * np.pi * 5 * np.cos(2 * np.pi * 5 * T)
A = -((2 * np.pi * 5) ** 2) * X
H = 3.0 * np.tanh(200 * V)


@cache
def library() -> dict[tuple[str, str], Effect]:
    return {(effect.id, effect.form): effect for effect in load_effects()}


def signals(sign: float = 1.0) -> Signals:
    return Signals(sign * X, sign * V, sign * A, sign * H, DT)


def ones(effect: Effect) -> dict[str, float]:
    return {name: 1.0 for name in effect.amplitudes} | {name: 1.0 for name in effect.choices}


DOCUMENTED = [
    "cubic_stiffness",
    "quadratic_stiffness",
    "bilinear_stiffness",
    "contact_loss",
    "impact",
    "two_sided_stop",
    "backlash",
    "coulomb_friction",
    "stribeck_friction",
    "asymmetric_friction",
    "hysteretic_friction",
    "position_dependent_friction",
    "quadratic_damping",
    "displacement_dependent_damping",
    "cyclic_degradation",
    "pinching",
    "viscoelastic_relaxation",
    "stiffness_drift",
    "preload",
    "added_mass",
    "hidden_mode",
]


def test_every_documented_id_has_a_block() -> None:
    assert set(DOCUMENTED) <= {ident for ident, _ in library()}


def test_names_become_ids() -> None:
    assert effect_id("HystId.Effects.ContactLoss__Hertz") == ("contact_loss", "Hertz")
    assert effect_id("mine.mo:TwoSidedStop") == ("two_sided_stop", "")


def test_every_form_has_amplitudes_and_vanishes_without_them() -> None:
    for effect in library().values():
        assert effect.amplitudes, effect.class_name
        zero = {**ones(effect), **dict.fromkeys(effect.amplitudes, 0.0)}
        assert not np.any(effect.force(signals(), zero)), effect.class_name


@pytest.mark.parametrize("ident", ["cubic_stiffness", "coulomb_friction", "quadratic_damping", "hysteretic_friction"])
def test_odd_laws(ident: str) -> None:
    for (name, _), effect in library().items():
        if name == ident:
            f, g = (effect.force(signals(sign), ones(effect)) for sign in (1.0, -1.0))
            # the inner state crosses the same values mirrored; integration is symmetric to rounding
            assert np.allclose(f, -g, atol=1e-9 * np.max(np.abs(f)) + 1e-300), effect.class_name


@pytest.mark.parametrize("ident", ["quadratic_stiffness", "preload"])
def test_even_laws(ident: str) -> None:
    for (name, _), effect in library().items():
        if name == ident:
            f, g = (effect.force(signals(sign), ones(effect)) for sign in (1.0, -1.0))
            assert np.allclose(f, g, atol=1e-9 * np.max(np.abs(f)))


@pytest.mark.parametrize(
    "ident", ["coulomb_friction", "stribeck_friction", "quadratic_damping", "hysteretic_friction", "impact"]
)
def test_dissipative_laws_take_energy_over_whole_cycles(ident: str) -> None:
    last = slice(len(T) // 5, len(T))  # four whole cycles, after the first loading
    for (name, form), effect in library().items():
        if name == ident and form != "Hardening":  # without a plateau the loop may run either way
            work = float(np.sum(effect.force(signals(), ones(effect))[last] * V[last]) * DT)
            assert work > 0, effect.class_name


@pytest.mark.parametrize("ident", ["cubic_stiffness", "two_sided_stop", "backlash", "quadratic_stiffness"])
def test_conservative_laws_give_the_energy_back(ident: str) -> None:
    for (name, _), effect in library().items():
        if name == ident:
            f = effect.force(signals(), ones(effect))
            # midpoint sums over whole periods are exact for smooth periodic integrands, 1e-6 for the kinks
            assert abs(np.sum(f * V)) < 1e-6 * np.sum(np.abs(f * V))


def test_thresholds_are_sharp() -> None:
    stop = library()[("two_sided_stop", "")]
    f = stop.force(signals(), {"k": 1e4, "gap": 1.5e-3})
    assert not np.any(f[np.abs(X) < 1.5e-3])
    assert np.allclose(f[X > 1.5e-3], 1e4 * (X[X > 1.5e-3] - 1.5e-3))


def test_free_play_and_stops_differ_by_a_spring() -> None:
    stop, play = library()[("two_sided_stop", "")], library()[("backlash", "")]
    values = {"k": 1e4, "gap": 1e-3}
    assert np.allclose(stop.force(signals(), values) - play.force(signals(), values), 1e4 * X, atol=1e-12)


def test_relaxation_follows_the_maxwell_response() -> None:
    """Stationary loss of a Maxwell branch per cycle: pi k X^2 w tau / (1 + (w tau)^2)."""
    branch = library()[("viscoelastic_relaxation", "")]
    w, tau, k = 2 * np.pi * 5, 0.02, 1e4
    f = branch.force(signals(), {"k": k, "tau": tau})
    last = slice(int(0.8 * len(T)), len(T))
    work = float(np.sum(f[last] * V[last]) * DT)
    exact = np.pi * k * (2e-3) ** 2 * w * tau / (1 + (w * tau) ** 2)
    assert abs(work / exact - 1) < 2e-3  # linear input between samples: (w dt)^2 / 12 = 2e-5, and the rest of the start


def test_a_spring_and_dashpot_that_meet_push_and_never_pull() -> None:
    effect = library()["impact", "KelvinVoigt"]
    values = {"k": 1e4, "gap": 1e-3, "tau": 0.02, "side": 1.0}
    force = effect.force(signals(), values)
    assert np.all(force >= 0.0)
    assert np.any((force == 0.0) & (X > 1e-3) & (V < 0.0))  # it parts before the gap is passed again
    assert np.sum(force * V) > 0.0
