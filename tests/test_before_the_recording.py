"""What contacts keep of the time before a recording, beside a law that is missing."""

from dataclasses import replace

import numpy as np
import pytest

from hystid.compiled import CompiledModel
from hystid.diagnosis import diagnose
from hystid.diagnosis.fit.case import swings_of_the_past
from hystid.diagnosis.fit.refit import refit_again
from hystid.modelica import compile_model
from hystid.recording import Recording
from tests.test_diagnosis_windows import posed, recorded

GIVEN = {"m": 2.0, "B": 6.0, "Kl": 2500.0, "Ks": 5000.0, "fc": 6.0}


@pytest.mark.parametrize(("before", "channels"), [(-2.5, "Fx"), (2.5, "Fxa")])
def test_a_contact_that_slips_late_hides_no_spring(before: float, channels: str) -> None:
    """A slider stood elsewhere before the first sample, and slips late in a motion that grows. The refit without the
    spring that is missing leaves much all along, and cannot tell whether the slider was at rest."""
    t = np.arange(5000) * 1e-3
    x = 1e-3 * (0.25 + 0.75 * t / t[-1]) * (np.sin(9.0 * t + 0.7) + 0.4 * np.sin(23.0 * t))
    v = np.gradient(x, 1e-3, edge_order=2)
    a = np.gradient(v, 1e-3, edge_order=2)
    h = np.full_like(x, before)
    for i in range(1, len(x)):
        h[i] = np.clip(h[i - 1] + 4000.0 * (x[i] - x[i - 1]), -3.0, 3.0)
    rng = np.random.default_rng(3)
    clean = {"F": 2.0 * a + 5.0 * v + 3000.0 * x + h + 8e9 * x**3, "x": x, "a": a}
    noisy = {k: u + 2e-3 * np.std(u) * rng.standard_normal(len(u)) for k, u in clean.items() if k in channels}
    found = diagnose(Recording("by_hand", t, **noisy), model="HystId.Oscillators.Jenkins", parameters=GIVEN)
    assert [finding.effect for finding in found.findings] == ["cubic_stiffness"]
    assert found.findings[0].confidence > 0.9
    assert any("whose force depends on it, are left out" in note for note in found.notes)


def test_a_free_vibration_that_turns_is_not_at_rest() -> None:
    """A slider holds the structure off its middle, where it still rings at the first sample: no velocity and no force
    there, but an acceleration."""
    t, held = np.arange(5000) * 1e-3, 1.0
    grows = np.minimum(t, 2.5) ** 2 / 2.5**2
    ring = 1e-4 * np.exp(-1.25 * t) * np.cos(np.sqrt(3500.0) * t)
    x = 1e-3 * grows * (np.sin(9.0 * t + 0.7) + 0.4 * np.sin(23.0 * t)) - held / 3000.0 + ring
    v = np.gradient(x, 1e-3, edge_order=2)
    a = np.gradient(v, 1e-3, edge_order=2)
    h = np.full_like(x, held + 4000.0 * ring[0])
    for i in range(1, len(x)):
        h[i] = np.clip(h[i - 1] + 4000.0 * (x[i] - x[i - 1]), -3.0, 3.0)
    rng = np.random.default_rng(3)
    clean = {"F": 2.0 * a + 5.0 * v + 3000.0 * x + h + 4e9 * x**3, "x": x, "v": v, "a": a}
    noisy = {k: u + 2e-3 * np.std(u) * rng.standard_normal(len(u)) for k, u in clean.items()}
    found = diagnose(Recording("by_hand", t, **noisy), model="HystId.Oscillators.Jenkins", parameters=GIVEN)
    assert [finding.effect for finding in found.findings] == ["cubic_stiffness"]
    assert any("whose force depends on it, are left out" in note for note in found.notes)


@pytest.mark.parametrize("seed", range(3))
def test_sliders_that_were_not_at_rest_are_no_fault_of_the_force_channel(seed: int) -> None:
    """Sliders that a stronger motion has left off their middle, in loud noise: the model at rest before the recording
    leaves little more than noise, and a slow change of the force, as of an AC-coupled channel."""
    law, rng = "HystId.Oscillators.Iwan", np.random.default_rng(seed)
    true = {"m": 14.906, "B": 39.12, "Kl": 52688.0, "Ks": 45862.0, "fc": 0.675}
    rig, runs = CompiledModel(compile_model(law)), []
    for rate, kept, cut, middle, pace, phase, size in (
        (1090.0, 2633, 0, 11.05, 0.406, 3.64, 0.507),
        (691.0, 7131, 1426, 17.01, 0.06, 5.48, 1.0),
    ):
        t = np.arange(kept + cut) / rate
        turns = np.cumsum(middle + 1.94 * np.sin(2 * np.pi * pace * t + phase)) / rate
        force = size * np.sin(2 * np.pi * turns)
        moved = rig.simulate({"F": force}, 1 / rate, parameters=true, outputs=["x", "v", "a"], interpolation="cubic")
        clean = {"F": force, **{name: moved[name] for name in "xva"}}
        noisy = {name: u + 0.1 * np.std(u) * rng.standard_normal(len(u)) for name, u in clean.items()}
        runs.append(Recording(f"run_{len(runs)}", t[:kept], **{name: u[cut:] for name, u in noisy.items()}))
    given = {"m": 14.78, "B": 32.8, "Kl": 49377.0, "Ks": 57344.0, "fc": 0.965, "N": 8}
    assert diagnose(runs, model=law, parameters=given).findings == ()


@pytest.mark.parametrize(("until", "level", "seed"), [(4.5, 0.1, 1), (4.5, 0.1, 2), (5.5, 0.03, 0)])
def test_sliders_that_let_go_late_are_no_drift_of_the_force_channel(until: float, level: float, seed: int) -> None:
    """A motion that grows from nearly nothing, with sliders that a stronger one has left off their middle. In loud
    noise their force does not show at the first sample; and the last of them let go little at a time, for long."""
    law, true = "HystId.Oscillators.Iwan", {"m": 0.0, "Ks": 2e4, "fc": 12.0, "Kl": 1e4}
    dt, rng = 1e-3, np.random.default_rng(seed)
    t = dt * np.arange(-1000, 6000)
    x = 1e-3 * np.interp(t, [-1.0, 0.0, until, 7.0], [1.5, 0.1, 1.0, 1.0]) * (np.sin(60 * t) + 0.3 * np.sin(97 * t + 1))
    rig = CompiledModel(compile_model(law))
    force = rig.clamp({"x": x, "v": np.gradient(x, dt)}, {}, dt, parameters=true, outputs=("R",))["R"]
    seen = t > -dt / 2
    F, x = (u[seen] + level * np.std(u) * rng.standard_normal(np.count_nonzero(seen)) for u in (force, x))
    assert diagnose(Recording("grows", t[seen], F=F, x=x), model=law, parameters=true).findings == ()


def test_what_no_past_explains_is_not_left_out_with_the_past() -> None:
    """A slider stood elsewhere and slips late; before it does, a mass is added for a second. Its force swings with the
    motion, which no force of a slider that sticks does: with these samples left out nothing would be missing."""
    t = np.arange(5000) * 1e-3
    x = 1e-3 * (0.25 + 0.75 * t / t[-1]) * (np.sin(9.0 * t + 0.7) + 0.4 * np.sin(23.0 * t))
    v = np.gradient(x, 1e-3, edge_order=2)
    a = np.gradient(v, 1e-3, edge_order=2)
    h = np.full_like(x, 1.0)
    for i in range(1, len(x)):
        h[i] = np.clip(h[i - 1] + 4000.0 * (x[i] - x[i - 1]), -3.0, 3.0)
    added = 1.5 * a * ((t > 0.6) & (t < 1.6))
    rng = np.random.default_rng(3)
    clean = {"F": 2.0 * a + 5.0 * v + 3000.0 * x + h + added, "x": x, "a": a}
    noisy = {k: u + 1e-3 * np.std(u) * rng.standard_normal(len(u)) for k, u in clean.items()}
    found = diagnose(Recording("by_hand", t, **noisy), model="HystId.Oscillators.Jenkins", parameters=GIVEN)
    assert found.verdict in {"missing_physics", "unknown_physics"}  # the slider's force is still in these samples
    assert any("no past does" in note for note in found.notes)


def swings(seed: int, step: float, colour: tuple[float, float]) -> float:
    """What is said to swing in the first 0.3 s of a sound rig, where a force [N] stays for half of that."""
    case, _ = posed([recorded(seed, 1.0, lambda t, x, v: step * (t < 0.15))])
    part = replace(case.problem.parts[0], colour=colour)
    later = np.arange(len(part)) >= 300
    kept = case.problem.of([replace(part, valid=later)])
    return swings_of_the_past(case.problem.of([part]), kept, refit_again(kept, [case.refit])[0])


def test_noise_alone_does_not_swing() -> None:
    """What is left where contacts still remember is noise, in ten sections of thirty samples: what their variances
    have above that of the noise is made up for by what others have below."""
    found = [swings(seed, 0.0, (0.0, 0.0)) for seed in range(16)]
    error = np.sqrt(2 / 270) / np.sqrt(len(found))  # of their mean: the variance of 270 normal values, 16 times
    assert np.mean(found) < 3 * error


def test_what_a_filter_against_slow_noise_makes_of_a_contact_that_lets_go_does_not_swing() -> None:
    """A force that stays, and goes, falls below zero behind such a filter, and comes back."""
    assert swings(2, 5.0, (0.02, 0.0)) < 3 * np.sqrt(2 / 270)  # as above, of one recording
