"""Output-error fit: what it reaches, and that it keeps its hands off what it cannot improve."""

from pathlib import Path

import numpy as np
import pytest

from hystid.compiled import CompiledModel
from hystid.diagnosis.fit.hypothesis import Hypothesis, Unknown
from hystid.diagnosis.model.freerun import error, free_run
from hystid.diagnosis.prepare.segments import Part, prepare_part
from hystid.diagnosis.prove.output_error import output_error_fit
from hystid.modelica import compile_model
from hystid.recording import Recording, read

BENCHMARK = Path(__file__).parents[2] / "shared" / "data" / "boucwen_benchmark"
TRUE = {"m": 2.0, "B": 10.0, "Kl": 5e4, "alpha": 5e4, "beta": 1e3, "gamma": 0.8, "delta": -1.1, "nu": 1.0}
FREE = ("B", "Kl", "alpha", "gamma", "delta")
NOISE = 0.01  # of the displacement, 40 dB


@pytest.fixture(scope="module")
def model() -> CompiledModel:
    return CompiledModel(compile_model("HystId.Oscillators.BoucWen"))


def unknowns(names: tuple[str, ...] = FREE) -> list[Unknown]:
    return [Unknown(("base", name), name in ("B", "Kl", "alpha"), linear=True) for name in names]


def recorded(model: CompiledModel, seed: int, n: int = 4000, dt: float = 1 / 750) -> Part:
    """A noise-driven oscillator from rest, with noise on the displacement."""
    rng = np.random.default_rng(seed)
    force = np.convolve(rng.standard_normal(n + 20), np.hanning(21) / np.sqrt(8.0), mode="valid") * 50.0
    x = model.simulate({"F": force}, dt, parameters=TRUE, outputs=("x",), interpolation="cubic", substeps=8)["x"]
    noisy = x + NOISE * np.std(x) * rng.standard_normal(n)
    return prepare_part(Recording("made", np.arange(n) * dt, F=force, x=noisy))


def test_biased_parameters_come_back_to_the_truth(model: CompiledModel) -> None:
    parts = [recorded(model, seed) for seed in (1, 2)]
    start = Hypothesis({**TRUE, "Kl": 5.1e4, "alpha": 4.85e4, "B": 11.0, "gamma": 0.84})
    found = output_error_fit(model, start, unknowns(), parts, lambda h: h.values)
    assert found is not None and found.after < 0.5 * found.before
    # with 1 % noise and thousands of samples the stiffness is known to 0.1 %, the damping to some per cent
    assert found.hypothesis.values["Kl"] == pytest.approx(TRUE["Kl"], rel=5e-3)
    assert found.hypothesis.values["alpha"] == pytest.approx(TRUE["alpha"], rel=5e-3)


def test_standard_errors_are_those_of_repeated_measurements(model: CompiledModel) -> None:
    """Six tests of five parameters; the residual is coloured, as noise of the smoothed start and of the run add up."""
    start = Hypothesis({**TRUE, "Kl": 5.1e4, "alpha": 4.85e4, "B": 11.0, "gamma": 0.84})
    pairs = [[recorded(model, seed), recorded(model, seed + 1)] for seed in range(100, 112, 2)]
    found = [output_error_fit(model, start, unknowns(), pair, lambda h: h.values) for pair in pairs]
    off = []
    for one in found:
        assert one is not None
        for i, unknown in enumerate(unknowns()):
            value, true = one.hypothesis.values[unknown.key[1]], TRUE[unknown.key[1]]
            off.append((np.log(value / true) if unknown.log else value - true) / np.sqrt(one.covariance[i, i]))
    # 30 ratios that should be of standard normal size, those of one test correlated: 0.6 to 1.5 is three sigma
    assert 0.6 < np.sqrt(np.mean(np.square(off))) < 1.5


def test_true_parameters_stay(model: CompiledModel) -> None:
    assert output_error_fit(model, Hypothesis(TRUE), unknowns(), [recorded(model, 3)], lambda h: h.values) is None


def test_what_does_not_help_on_samples_kept_back_is_not_taken(model: CompiledModel) -> None:
    """The last quarter belongs to another structure, so that a better fit of the first three is no gain there."""
    part = recorded(model, 4)
    other = {**TRUE, "Kl": 5.4e4}
    force = {"F": part.F}
    x = model.simulate(force, part.dt, parameters=other, outputs=("x",), interpolation="cubic", substeps=4)["x"]
    mixed = np.where(np.arange(len(x)) < 0.75 * len(x), part.measured["x"], x)
    made = prepare_part(Recording("mixed", part.t, F=part.F, x=mixed))
    assert output_error_fit(model, Hypothesis(other), unknowns(), [made], lambda h: h.values) is None


def test_the_work_is_bounded(model: CompiledModel) -> None:
    """Too little work for four steps over 1000 samples: nothing is begun."""
    start = Hypothesis({**TRUE, "Kl": 5.2e4})
    assert output_error_fit(model, start, unknowns(), [recorded(model, 5)], lambda h: h.values, work=10_000) is None


def test_a_period_of_steady_motion_runs_twice(model: CompiledModel) -> None:
    """Inner states at the start of a steady period are not zero; a second pass finds them."""
    n, dt, period = 1500, 1 / 750, 1500
    phase = np.random.default_rng(6).uniform(0, 2 * np.pi, 60)
    t = np.arange(n) * dt
    force = np.sum([6 * np.cos(2 * np.pi * (k + 10) / (period * dt) * t + p) for k, p in enumerate(phase)], axis=0)
    three = {"F": np.tile(force, 3)}
    x = model.simulate(three, dt, parameters=TRUE, outputs=("x",), interpolation="cubic", substeps=8)["x"][-n:]
    part = prepare_part(Recording("steady", t, F=force, x=x))
    found = error(free_run(model, part, TRUE), part)
    assert found is not None and found < 2e-3  # steps of a quarter of a sample


@pytest.mark.skipif(not BENCHMARK.is_dir(), reason="the Bouc-Wen benchmark is not beside this checkout")
def test_benchmark_from_parameters_of_the_balance(model: CompiledModel) -> None:
    """From parameters that are off by what a force balance leaves, 2e-6 m on the official multisine."""
    train, test = (
        prepare_part(read(BENCHMARK / f"boucwen_{name}.csv")) for name in ("train_multisine_forgione", "test_multisine")
    )
    start = Hypothesis({**TRUE, "Kl": 4.95e4, "alpha": 5.03e4, "gamma": 0.81, "delta": -1.12}, delay=0.025)
    moved = [*unknowns(), Unknown(("chain", "delay"), low=-0.5, high=0.5)]
    found = output_error_fit(model, start, moved, [train], lambda h: h.values)
    assert found is not None
    run = free_run(model, test, found.hypothesis.values, found.hypothesis.delay)
    assert run is not None
    assert np.sqrt(np.mean((run - test.measured["x"]) ** 2)) < 2e-6
