"""What the diagnosis keeps and runs together must give what it would compute anew, one by one."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from hystid.compiled import CompiledModel
from hystid.diagnosis.fit.descent import fit
from hystid.diagnosis.fit.hypothesis import Hypothesis, Term
from hystid.diagnosis.fit.problem import Problem
from hystid.diagnosis.model.baseline import Baseline, baseline_of
from hystid.diagnosis.model.effects import Effect, Scales, Signals
from hystid.diagnosis.model.library import load_effects
from hystid.diagnosis.model.memory import Memory
from hystid.diagnosis.prepare.differences import advanced, interpolated
from hystid.diagnosis.prepare.reduction import Reduction
from hystid.diagnosis.prepare.segments import Part, prepare_part
from hystid.modelica import compile_model
from hystid.recording import Recording

VALUES = {"m": 2.0, "B": 4.0, "Kl": 8e3, "alpha": 2e4, "beta": 300.0, "gamma": 0.6, "delta": 0.4, "nu": 1.2}


def measured(amplitude: float, seed: int, n: int = 1500, dt: float = 1e-3) -> Recording:
    """A free run of a Bouc-Wen oscillator with a little noise on all channels."""
    rng = np.random.default_rng(seed)
    t = np.arange(n) * dt
    force = amplitude * np.sin(2 * np.pi * 9 * t) + 0.4 * amplitude * np.sin(2 * np.pi * 23 * t + seed)
    model = CompiledModel(compile_model("HystId.Oscillators.BoucWen"))
    run = model.simulate({"F": force}, dt, parameters=VALUES, outputs=["x", "v", "a"], interpolation="cubic")
    noisy = {k: u + 1e-3 * np.std(u) * rng.standard_normal(n) for k, u in {**run, "F": force}.items()}
    return Recording(name=f"run {seed}", t=t, **noisy)


@pytest.fixture(scope="module")
def parts() -> list[Part]:
    tests = measured(40.0, 1), measured(90.0, 2, n=1100)
    return [prepare_part(replace(test, v=None, a=None)) for test in tests]


@pytest.fixture(scope="module")
def baseline() -> Baseline:
    return baseline_of("HystId.Oscillators.BoucWen", compile_model("HystId.Oscillators.BoucWen"), VALUES, weighed=True)


@pytest.fixture(scope="module")
def effects() -> dict[str, Effect]:
    return {effect.class_name.rpartition(".")[2]: effect for effect in load_effects()}


def problem_of(parts: list[Part], baseline: Baseline) -> Problem:
    x, v = (np.sort(np.concatenate([np.abs(getattr(p, name)) for p in parts])) for name in "xv")
    h = np.sort(np.concatenate([np.abs(baseline.force(p.x, p.v, p.dt, VALUES)[1]) for p in parts]))
    return Problem(parts, baseline, Scales(x, v, h, 1.5, 1e-3, (5.0, 30.0), 0.3))


TERMS = {
    "HystereticFriction__BoucWen": {"Fc": 3.0, "x_c": 4e-4, "n": 1.5, "gamma": 0.7},
    "CyclicDegradation": {"share": 0.2, "path_c": 0.1},
    "AsymmetricFriction": {"F_forward": 1.0, "F_backward": 0.4, "v_s": 0.01},
    "CubicStiffness": {"k3": 1e7},
}


def test_a_problem_that_remembers_is_one_that_does_not(
    parts: list[Part], baseline: Baseline, effects: dict[str, Effect]
) -> None:
    """Along a path through hypotheses with and without effects that read h: rows and Jacobians as of a new problem.

    A column that is the force over its amplitude differs from one that is evaluated by rounding alone: 1e-12 of it.
    """
    used = problem_of(parts, baseline)
    terms = tuple(Term(effects[name], values) for name, values in TERMS.items())
    moved = {**VALUES, "beta": 320.0, "Kl": 8.2e3}
    path = [
        Hypothesis(VALUES, terms),
        Hypothesis(moved, terms),
        Hypothesis(moved, (replace(terms[0], values={**terms[0].values, "Fc": 5.0}), *terms[1:])),
        Hypothesis(VALUES, terms, delay=0.2),
        Hypothesis(VALUES, terms[1:]),
        Hypothesis(VALUES, terms),
    ]
    for hypothesis in path:
        fresh, unknowns = problem_of(parts, baseline), used.unknowns(hypothesis)
        np.testing.assert_array_equal(used.rows(hypothesis), fresh.rows(hypothesis))
        one, other = used.jacobian(hypothesis, unknowns), fresh.jacobian(hypothesis, unknowns)
        law = [i for i, u in enumerate(unknowns) if u.key[0] == "base" and u.log]  # slopes are used again near by
        rest = [i for i in range(len(unknowns)) if i not in law]
        size = np.linalg.norm(other, axis=0)
        assert np.all(np.linalg.norm(one - other, axis=0)[rest] <= 1e-12 * size[rest])
        assert np.all(np.linalg.norm(one - other, axis=0)[law] <= 0.2 * size[law])  # over 4 % and more of a shape


@pytest.mark.parametrize("name", ["HystereticFriction", "ViscoelasticRelaxation", "Pinching", "CubicStiffness"])
def test_columns_of_a_second_scan_are_those_of_the_first(
    parts: list[Part], baseline: Baseline, effects: dict[str, Effect], name: str
) -> None:
    """Where the law has moved, what reads h is new and what does not is the same; both as computed anew."""
    problem, effect = problem_of(parts, baseline), effects[name]
    shapes = {shape.name: 2e-4 if shape.unit == "m" else 0.05 for shape in effect.shapes}
    first = problem.columns(effect, [shapes], problem.signals(Hypothesis(VALUES)))
    there = Hypothesis({**VALUES, "alpha": 2.5e4})
    second, anew = (p.columns(effect, [shapes], p.signals(there)) for p in (problem, problem_of(parts, baseline)))
    assert len(first.places) == len(second.places) == 1
    np.testing.assert_array_equal(second.scaled, anew.scaled)
    assert np.array_equal(first.scaled, second.scaled) == (name != "Pinching")


def test_rows_that_are_weighed_down_are_not_remembered_as_they_were(
    parts: list[Part], baseline: Baseline, effects: dict[str, Effect]
) -> None:
    problem, effect = problem_of(parts, baseline), effects["ViscoelasticRelaxation"]
    signals = problem.signals(Hypothesis(VALUES))
    before = problem.columns(effect, [{"tau": 0.05}], signals)
    jump = Term(effects["CoulombFriction"], {"Fc": 500.0, "v_s": 1e-6})  # noise of v decides its sign at each reversal
    assert problem.distrust(Hypothesis(VALUES, (jump,)))
    after = problem.columns(effect, [{"tau": 0.05}], signals)
    rows = problem.reduce(effect.forces(signals, effect.units_at({"tau": 0.05})[0]))
    again = after.scaled[0, 0] * after.lengths[0, 0]
    np.testing.assert_allclose(again, rows, rtol=1e-14)  # scaled and back: two roundings
    assert not np.array_equal(before.scaled, after.scaled)


def test_an_effect_is_given_only_what_its_equations_read(parts: list[Part], effects: dict[str, Effect]) -> None:
    """The inputs that are left out change nothing, for every effect of the library."""
    part = parts[0]
    rng = np.random.default_rng(3)
    h = 10.0 * np.sin(np.arange(len(part)) * 0.05)
    for effect in effects.values():
        values = {**dict.fromkeys(effect.amplitudes, 1.0)}
        seen = {name: getattr(part, name) if name != "h" else h for name in "xvah"}
        noise = {name: u if name in effect.reads else rng.standard_normal(len(part)) for name, u in seen.items()}
        if "v" not in effect.reads:  # the number of steps follows from v
            noise["v"] = seen["v"]
        one, other = (effect.force(Signals(**u, dt=part.dt), values) for u in (seen, noise))
        np.testing.assert_array_equal(one, other, err_msg=effect.class_name)


def test_steps_from_normal_equations_reach_the_least_squares_solution(
    parts: list[Part], baseline: Baseline, effects: dict[str, Effect], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of a hypothesis that is linear in its unknowns: the mean square is that of an orthogonal projection."""
    held = replace(baseline, free=("B", "Kl"), linear=("B", "Kl"), weighed=False)
    problem = problem_of(parts, held)
    start = Hypothesis(VALUES, (Term(effects["CubicStiffness"], {"k3": 0.0}),))
    monkeypatch.setattr(
        "hystid.diagnosis.fit.descent._SMALL_FALL", 1e-12
    )  # the search stops early, and a minimum is asked
    found = fit(problem, start)
    jacobian = problem.jacobian(found.hypothesis, found.unknowns)
    scaled = jacobian / np.linalg.norm(jacobian, axis=0)
    left = found.residual - scaled @ np.linalg.lstsq(scaled, found.residual, rcond=None)[0]
    assert found.rss <= float(left @ left) * (1 + 1e-6)  # the delay is not linear: its last step is not 0


def test_memory_forgets_what_was_not_asked_for_longest() -> None:
    made: list[str] = []
    memory = Memory(3 * 80)

    def get(name: str) -> float:
        def make() -> tuple[np.ndarray, ...]:
            made.append(name)
            return (np.full(10, float(ord(name))),)

        return float(memory.get(name, make)[0][0])

    for name in "abcabdabc":
        assert get(name) == ord(name)
    assert "".join(made) == "abcdc"  # d took the place of c, the only one that was not asked for again
    memory.clear()
    get("a")
    assert "".join(made) == "abcdca"


@pytest.mark.parametrize("total", [5_000, 40_000, 200_000])
def test_block_means_are_means(total: int) -> None:
    """Blocks of 1, 2 and 12 samples, with samples that do not count."""
    n = total // 2
    t = np.arange(n) * 1e-3
    rng = np.random.default_rng(1)
    part = Part("p", t, 1e-3, rng.standard_normal(n), t, t, t, t, 0, {"F": 1.0, "a": 1.0}, {}, np.arange(n) % 97 > 3)
    reduction, column = Reduction([part, part], 1.0), rng.standard_normal(n)
    block, trim = reduction.block, max(5, n // 200)
    rows = (n - 2 * trim) // block
    starts = [trim + k * block for k in range(rows)]
    kept = [s for s in starts if np.all(part.valid[s : s + block])]
    expected = [np.mean(column[s : s + block]) for s in kept]
    np.testing.assert_allclose(reduction.plain(0, column), expected, rtol=0, atol=1e-15)  # order of the sums


@pytest.mark.parametrize(("move", "atol"), [(advanced, 1e-12), (interpolated, 1e-12)])
@pytest.mark.parametrize("samples", [0.37, -0.37, 2.6, -7.5, 0.0])
def test_a_signal_is_moved_as_its_formula_says(move: Callable[..., np.ndarray], atol: float, samples: float) -> None:
    """cos(w t) over an even number of half periods is its own mirrored continuation; the edges are kept. The next power
    of w, 0.16 to the 13th, and its factor for half a sample, 3e-5, are below 1e-14."""
    n = 400
    t = np.arange(n) + 0.5
    moved = move(np.cos(np.pi * 20 * t / n), samples)
    inner = slice(16, -16)
    np.testing.assert_allclose(moved[inner], np.cos(np.pi * 20 * (t + samples) / n)[inner], atol=atol)
    np.testing.assert_array_equal(moved[[0, -1]], np.cos(np.pi * 20 * t / n)[[0, -1]])
