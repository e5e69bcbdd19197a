"""The concealed-case generator against closed forms, SciPy, energy balance and convergence."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from benchmarks.concealed import baselines, cases
from benchmarks.concealed.chain import Chain, Fault, measure, take
from benchmarks.concealed.deck import CaseSpec, deck
from benchmarks.concealed.excitation import Test as Excitation
from benchmarks.concealed.excitation import force
from benchmarks.concealed.generate import generate
from benchmarks.concealed.oracle import LEAST_MISMATCH
from benchmarks.concealed.rig import Diverged, Element, Rig, clamp, run
from hystid.compiled import CompiledModel
from hystid.modelica import compile_model

K = (2 * np.pi * 20) ** 2  # 20 Hz for 1 kg [N/m]
X = 1e-3


def ringing(elements: tuple[Element, ...], steps: int, duration: float = 0.5, start: float = 1.5 * X) -> np.ndarray:
    """Free vibration from a displaced start: displacement at steps + 1 instants [m]."""
    return run(Rig(1.0, 2.0, K, elements), np.zeros(2 * steps + 1), duration / steps, (start, 0.0)).x


def test_linear_oscillator_follows_the_closed_form() -> None:
    steps, duration = 4000, 0.5
    t = np.linspace(0, duration, steps + 1)
    damped = np.sqrt(K - 1.0)
    exact = 1.5 * X * np.exp(-t) * (np.cos(damped * t) + np.sin(damped * t) / damped)
    # Runge-Kutta 4: (omega dt)^4 / 120 per radian is 1e-9 here; 63 radians are run
    assert np.max(np.abs(ringing((), steps) - exact)) < 1e-7 * X


@pytest.mark.parametrize(
    ("element", "law"),
    [
        (Element("odd_power", (X, 3.0), 20.0), lambda x, v: 20.0 * (x / X) ** 3),
        (Element("place_damping", (X, 0.1, 0), 5.0), lambda x, v: 5.0 * (x / X) ** 2 * v / 0.1),
        (Element("drag", (0.1, 2.0), 4.0), lambda x, v: 4.0 * v * abs(v) / 0.01),
        (Element("exponential", (2 * X,), 10.0), lambda x, v: 10.0 * (np.exp(x / 2 / X) - 1 - x / 2 / X)),
        (Element("magnet", (3 * X,), 3.0), lambda x, v: -3.0 * ((1 - x / 3 / X) ** -2 - 1 - 2 * x / 3 / X)),
        (Element("centrifugal", (X, 0.1), 3.0), lambda x, v: 3.0 * (x / X) * (v / 0.1) ** 2),
    ],
)
def test_smooth_laws_against_scipy(element: Element, law: object) -> None:
    def slope(t: float, y: np.ndarray) -> list[float]:
        return [y[1], -2.0 * y[1] - K * y[0] - law(y[0], y[1])]  # type: ignore[operator]

    exact = solve_ivp(slope, (0, 0.5), [1.5 * X, 0.0], method="DOP853", rtol=1e-11, atol=1e-14).y[0, -1]
    # truncation of 4000 Runge-Kutta steps, see the linear case
    assert abs(ringing((element,), 4000)[-1] - exact) < 1e-6 * X


def test_inner_states_against_scipy() -> None:
    """Hidden mass and relaxation branch: a four-state and a three-state linear system."""
    w, zeta, m2, tau, k = 2 * np.pi * 30, 0.02, 0.05, 0.01, 3e3

    def hidden(t: float, y: np.ndarray) -> list[float]:
        g = w * w * (y[0] - y[2]) + 2 * zeta * w * (y[1] - y[3])
        return [y[1], -2.0 * y[1] - K * y[0] - m2 * g, y[3], g]

    def relaxing(t: float, y: np.ndarray) -> list[float]:
        return [y[1], -2.0 * y[1] - K * y[0] - k * y[2], y[1] - y[2] / tau]

    for slope, states, element in (
        (hidden, 4, Element("hidden", (w, zeta), m2)),
        (relaxing, 3, Element("maxwell", (X, 1, 1.0, tau), k * X)),
    ):
        start = [1.5 * X, *[0.0] * (states - 1)]
        exact = solve_ivp(slope, (0, 0.5), start, method="DOP853", rtol=1e-11, atol=1e-14).y[0, -1]
        assert abs(ringing((element,), 4000)[-1] - exact) < 1e-6 * X


def test_carried_mass_lowers_the_frequency() -> None:
    """With m + dm in place of m: the same motion."""
    heavy = run(Rig(1.2, 2.0, K), np.zeros(4001), 1e-4, (X, 0.0)).x
    carried = run(Rig(1.0, 2.0, K, (Element("mass", (), 0.2),)), np.zeros(4001), 1e-4, (X, 0.0)).x
    np.testing.assert_allclose(carried, heavy, atol=1e-15)


def test_slider_dissipates_four_fc_times_slip_per_cycle() -> None:
    """Steady loop of amplitude A: W = 4 fc (A - fc / Ks), whatever the rate (Jenkins element)."""
    Ks, fc, A = 1e5, 40.0, X
    t = np.linspace(0, 2, 40001)
    x, v = A * np.sin(2 * np.pi * t), 2 * np.pi * A * np.cos(2 * np.pi * t)
    h, _ = clamp((Element("jenkins", (Ks, fc)),), x, v, -((2 * np.pi) ** 2) * x, t[1])
    cycle = slice(20000, 40001)
    loss = np.trapezoid(h[cycle], x[cycle])
    assert loss == pytest.approx(4 * fc * (A - fc / Ks), rel=1e-6)  # trapezoid over 20000 points


@pytest.mark.parametrize(
    "element",
    [
        Element("coulomb", (2e-3, 0), 3.0),
        Element("stribeck", (2e-3, 1, 0.02, 1.0), 3.0),
        Element("asymmetric", (2e-3, 2, 0.4), 3.0),
        Element("loop", (0.2 * X, 1.5, 0.6), 3.0),
        Element("duhem", (0.2 * X, 1.0), 3.0),
        Element("stop", (0.5 * X, 1.0, X, 3.0, 1.5), 60.0),
        Element("place_friction", (2e-3, 0, X, 1), 3.0),
        Element("drag", (0.1, 2.2), 4.0),
        Element("maxwell", (X, 2, 0.5, 1e-3, 0.5, 1e-2), 10.0),
    ],
    ids=lambda e: e.kind,
)
def test_passive_effects_take_energy_from_closed_motions(element: Element) -> None:
    t = np.linspace(0, 0.4, 16001)
    x = X * np.sin(2 * np.pi * 20 * t)
    v, a = np.gradient(x, t), -K * x
    _, each = clamp((element,), x, v, a, t[1])
    cycle = slice(8000, 16001)  # four whole cycles after the transients of the inner states
    assert np.trapezoid(each[0][cycle], x[cycle]) > 0


@pytest.mark.parametrize("family", list(baselines.MODELS))
def test_energy_balance_and_convergence(family: str) -> None:
    """Work of F = change of kinetic energy + work on R, and halving the step leaves the record unchanged."""
    b = baselines.draw(family, np.random.default_rng(5), 1.0)
    drive = Excitation("chirp", (5.0, 2 * b.scale.f0), 0.02 * b.scale.force, 1)
    records = []
    for steps in (16000, 32000):
        F = force(drive, 1.0, 2 * steps + 1)
        motion = run(b.rig(), F, 1.0 / steps)
        R = b.parameters["B"] * motion.v + b.parameters["Kl"] * motion.x + motion.h
        dt = 1.0 / steps
        power = (F[::2] - R) * motion.v
        gained = np.concatenate([[0.0], np.cumsum(0.5 * (power[1:] + power[:-1]) * dt)])
        kinetic = 0.5 * b.parameters["m"] * motion.v**2
        # second-order quadrature and, at force jumps of the memoryless law, first-order at single steps
        assert np.max(np.abs(gained - kinetic)) < 3e-3 * np.max(kinetic)
        records.append(motion.x[:: steps // 1000])
    # turns and yields inside a step cost second order; 1e-3 of the peak is 20 times below the noise of the deck
    assert np.max(np.abs(records[0] - records[1])) < 1e-3 * np.max(np.abs(records[1]))


def test_divergence_is_named() -> None:
    with pytest.raises(Diverged, match="no finite motion"):
        run(Rig(1.0, 0.0, K, (Element("odd_power", (X, 3.0), -1e3),)), np.full(20001, 50.0), 1e-4)


def test_gate_closes_the_effect() -> None:
    x = np.full(1001, X)
    _, each = clamp((Element("constant", (), 2.0, (0.3, 0.6, 0.05)),), x, 0 * x, 0 * x, 1e-3)
    assert np.all(each[0][:300] == 0) and np.all(each[0][601:] == 0)
    np.testing.assert_allclose(each[0][350:551], 2.0)


def test_recording_is_band_limited_and_aligned() -> None:
    """All channels pass one linear-phase filter: the linear balance m a + B v + Kl x = F survives sampling."""
    rig, chain = Rig(1.0, 5.0, K), Chain(1000.0, 2000, 34.0)
    r = take(rig, Excitation("multisine", (2, 60), 10.0, 3), chain, 0).true
    # filter edges: the record starts from rest, so only rounding and the ends of the padded filter are left
    assert np.max(np.abs(r["F"] - r["a"] - 5 * r["v"] - K * r["x"])) < 1e-6 * np.max(np.abs(r["F"]))


def test_noise_level_and_faults() -> None:
    rig, chain = Rig(1.0, 20.0, K), Chain(1000.0, 4000, 28.0)
    test = Excitation("multisine", (2, 60), 10.0, 3)
    clean = take(rig, test, chain, 0)
    spread = {c: float(np.std(y)) for c, y in clean.true.items()}
    noisy = measure(clean, chain, np.random.default_rng(0), spread)
    for c, y in noisy.measured.items():
        # 4000 samples: the standard deviation scatters by 1.1 %, four times that is allowed
        assert np.std(y - clean.true[c]) == pytest.approx(spread[c] * 10 ** (-28 / 20), rel=0.045)
    late = take(rig, test, replace(chain, fault=Fault("channel_delay", "F", 2.0)), 0)
    np.testing.assert_allclose(late.clean["F"][2:], clean.true["F"][:-2], atol=1e-9)  # whole samples: an exact shift
    clipped = take(rig, test, replace(chain, fault=Fault("sensor_saturation", "x", 1e-4)), 0)
    assert np.max(np.abs(clipped.clean["x"])) == 1e-4


def test_deck_is_reproducible_and_complete() -> None:
    specs = deck(7, 153)
    assert specs == deck(7, 153) and specs != deck(8, 153)
    groups = {spec.group for spec in specs}
    assert groups == {"single", "null", "decoy", "pair", "part_time", "wrong_baseline", "stranger", "relative"}
    assert len({name for spec in specs if spec.group == "single" for name in spec.ids}) == 25
    assert {spec.family for spec in specs if spec.group == "null"} == set(baselines.MODELS)
    with pytest.raises(ValueError, match="nothing in the deck is called cubik"):
        deck(7, 5, only=["cubik"])


def test_case_is_visible_yet_concealed_and_sealed(tmp_path: Path) -> None:
    spec = CaseSpec("single", ("contact_loss",), "jenkins", "jenkins")
    (folder,) = generate(tmp_path, 11, [spec])
    truth = json.loads((tmp_path / "sealed" / "case_0000.json").read_text())
    assert truth["ids"] == ["contact_loss"] and truth["accepted"] == ["contact_loss"]
    assert truth["mismatch"]["visible"] >= LEAST_MISMATCH > truth["mismatch"]["truth"]
    assert truth["share_of_R"] < 0.6
    assert truth["oracle"]["holdout_truth"] < truth["oracle"]["holdout_refit"]
    handed = json.loads((folder / "case.json").read_text())
    assert handed["model"] == "HystId.Oscillators.Jenkins" and "contact" not in (folder / "case.json").read_text()
    assert {p.name for p in folder.iterdir()} == {
        *handed["recordings"], "holdout.csv", "case.json", "parameters.json",
    }  # fmt: skip
    table = np.loadtxt(folder / "rec_1.csv", delimiter=",", skiprows=1)
    assert table.shape == (8000, 5) and np.all(np.isfinite(table))
    strength = np.load(tmp_path / "sealed" / "case_0000_rec_1.npy")
    assert strength.shape == (8000,) and np.all(strength >= 0)


def test_null_is_explained_by_a_refit() -> None:
    case = cases.draw(CaseSpec("null", (), "boucwen", "boucwen"), np.random.default_rng(3))
    assert case.mismatch.before < 0.05  # noise-free channels: what is left is sampling of the loop
    true = case.baseline.parameters
    assert any(abs(case.nominal[name] / true[name] - 1) > 0.02 for name in true)
    assert case.nominal["m"] == true["m"]


def test_lab_rig_in_modelica_agrees_with_the_generator() -> None:
    """The public rig, compiled from Modelica, against the same physics by the generator's own laws and integrator."""
    dt, rows = 1e-4, 6001
    t = np.linspace(0, (rows - 1) * dt, 20 * (rows - 1) + 1)
    law = (Element("jenkins", (5e4, 37.5)), Element("friction_release", (1.2e-3, 1.0, 1e-4), 0.9))
    own = run(Rig(1.0, 10.0, 1e4, law), 80 * np.sin(2 * np.pi * 30 * t), dt / 10).x[::10]
    model = CompiledModel(compile_model("HystId.Examples.LabRig"))
    force_table = 80 * np.sin(2 * np.pi * 30 * t[::20])
    theirs = model.simulate({"F": force_table}, dt, outputs=("x",), interpolation="cubic", substeps=2)["x"]
    # located events on one side, return map within fine steps on the other: agreement to 1e-6 was measured
    assert np.max(np.abs(own - theirs)) < 1e-5 * np.max(np.abs(own))


@pytest.mark.parametrize(("name", "family"), [("impact", "jenkins"), ("stribeck_friction", "pecorari")])
def test_recordings_do_not_depend_on_the_inner_step(name: str, family: str) -> None:
    """Sixteen steps per sample against sixty-four, with stops and reversals.

    2e-3 is ten times below the noise of the deck; the force jumps of the memoryless law make it first order.
    """
    case = cases.draw(CaseSpec("single", (name,), family, family), np.random.default_rng(2))
    rig = replace(case.baseline.rig(), elements=(*case.baseline.rig().elements, *(e.element for e in case.effects)))
    coarse, fine = (take(rig, case.tests[2], case.chain, 2, steps).true for steps in (16, 64))
    for channel in "xva":
        assert np.std(coarse[channel] - fine[channel]) < 2e-3 * np.std(fine[channel])
