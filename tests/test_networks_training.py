"""Levenberg-Marquardt: kernel against NumPy, MATLAB's rule against an oracle and known counts, simulation Jacobian."""

import importlib.util
import threading
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchmarks.lm.numpy_networks import NumpyNormal
from hystid.errors import NumericalError, UsageError
from hystid.leastsquares import REASONS
from hystid.networks import ensemble, joint, training
from hystid.networks.normal_equations import CompiledNormal, parameter_count, unflatten
from hystid.turning_points import TurningPoints

BENCH = Path(__file__).parents[1].parent / "shared" / "bench" / "lm"


def problem(n=1500, seed=0):
    """A smooth target of three inputs with a little noise, scaled to about [-1, 1]."""
    rng = np.random.default_rng(seed)
    x = rng.uniform(-1, 1, (3, n))
    return x, np.tanh(3 * x[0] - x[1]) * 0.6 + 0.3 * x[2] + 0.01 * rng.normal(size=n)


def plain_trainlm(x, y, w, sizes, iterations):
    """MATLAB's rule in the plainest NumPy: whole Jacobian, mu damps J'J / N, x10 / x0.1."""

    def forward(w):
        acts = [x]
        *hidden, last = unflatten(w, sizes)
        for weights, bias in hidden:
            acts.append(np.tanh(weights @ acts[-1] + bias[:, None]))
        return acts, (last[0] @ acts[-1] + last[1][:, None])[0]

    def jacobian(w):
        acts, out = forward(w)
        delta, blocks = np.ones((1, len(y))), []
        for (weights, _), below in zip(reversed(unflatten(w, sizes)), reversed(acts), strict=True):
            blocks[:0] = [np.einsum("on,in->oin", delta, below).reshape(-1, len(y)), delta]
            delta = (weights.T @ delta) * (1 - below**2)
        return np.concatenate(blocks).T, out - y

    mu, history = 1e-3, []
    for _ in range(iterations):
        J, e = jacobian(w)
        history.append(np.mean(e**2))
        while True:
            trial = w - np.linalg.solve(J.T @ J / len(y) + mu * np.eye(len(w)), J.T @ e / len(y))
            if np.mean((forward(trial)[1] - y) ** 2) < history[-1]:
                w, mu = trial, mu * 0.1
                break
            mu *= 10
    return np.array(history)


@pytest.mark.parametrize("kind", [CompiledNormal, NumpyNormal])
def test_trainlm_takes_the_path_of_the_plain_rule(kind):
    x, y = problem()
    sizes = (3, 5, 5, 1)
    w = training.initial_weights(sizes, np.random.default_rng(1))
    rule = replace(training.RULES["trainlm"], max_iterations=30, max_fails=100)
    result = training.descend(kind(sizes, x, y), kind(sizes, x, y), w, rule)
    # same arithmetic in another order: paths agree until rounding is amplified, far beyond 30 iterations
    np.testing.assert_allclose(result.train[:30], plain_trainlm(x, y, w, sizes, 30), rtol=1e-6)


@pytest.mark.parametrize("hidden", [(1,), (5, 5), (13, 13, 13), (2, 7)])
@pytest.mark.parametrize("samples", [7, 512, 1300])
def test_kernel_builds_the_normal_equations(hidden, samples):
    x, y = problem(samples)
    sizes = (3, *hidden, 1)
    w = np.random.default_rng(2).normal(0, 0.7, parameter_count(sizes))
    compiled, plain = CompiledNormal(sizes, x, y), NumpyNormal(sizes, x, y)
    assert compiled.build(w) == pytest.approx(plain.build(w), rel=1e-12)
    assert compiled.squares(w) == pytest.approx(plain.squares(w), rel=1e-12)
    for part in ("diagonal", "gradient"):
        a, b = getattr(compiled, part)(), getattr(plain, part)()
        np.testing.assert_allclose(a, b, rtol=0, atol=1e-12 * np.abs(b).max())  # sums of 1300 terms in double
    damping = 1e-3 * plain.diagonal() + 1e-6 * samples
    step, expected = compiled.solve(damping), plain.solve(damping)
    np.testing.assert_allclose(step, expected, rtol=0, atol=1e-7 * np.abs(expected).max())  # condition of about 1e8


def test_single_precision_kernel_is_close():
    x, y = problem(5000)
    sizes = (3, 5, 5, 1)
    w = np.random.default_rng(2).normal(0, 0.7, parameter_count(sizes))
    single, double = CompiledNormal(sizes, x, y, "float32"), CompiledNormal(sizes, x, y)
    assert single.build(w) == pytest.approx(double.build(w), rel=1e-5)  # float32 has 6e-8 per operation
    double.build(w)
    np.testing.assert_allclose(
        single.gradient(), double.gradient(), rtol=0, atol=1e-5 * np.abs(double.gradient()).max()
    )


def test_an_indefinite_matrix_is_refused_not_factored():
    x, y = problem(50)
    normal = CompiledNormal((3, 2, 1), x, y)
    normal.build(np.zeros(11))
    assert normal.solve(np.full(11, -1e6)) is None


@pytest.mark.skipif(
    not (BENCH / "make_task.py").exists(), reason="the shared training benchmark is not beside the project"
)
def test_recorded_iteration_counts_of_trainlm(tmp_path, monkeypatch):
    """Seed 1 of the shared task: validation error 3e-4, 2e-4, 1.4e-4 at iterations 29, 35, 53, as three other
    implementations of the rule take; one iteration of slack for rounding."""
    monkeypatch.syspath_prepend(str(BENCH))
    spec = importlib.util.spec_from_file_location("lm_task", BENCH / "make_task.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    module.main(str(tmp_path / "task.npz"))
    common = importlib.import_module("common")
    task = np.load(tmp_path / "task.npz")
    fit, check = (CompiledNormal((3, 5, 5, 1), task["x" + part].T, task["y" + part]) for part in ("tr", "va"))
    rule = replace(training.RULES["trainlm"], max_iterations=55, max_fails=100)
    result = training.descend(fit, check, common.init_nw(1), rule)
    reached = [int(np.argmax(result.validation <= level)) for level in (3e-4, 2e-4, 1.4e-4)]
    assert np.abs(np.array(reached) - (29, 35, 53)).max() <= 1
    assert result.validation[53] == pytest.approx(1.398e-4, rel=5e-4)  # three digits
    fast = training.descend(fit, check, common.init_nw(1), replace(training.RULES["fast"], max_fails=100))
    assert int(np.argmax(fast.validation <= 1.4e-4)) <= 53 // 3


def test_a_training_says_why_it_stopped():
    x, y = problem(400)
    data = training.Data.split(x, y, 0)
    w = training.initial_weights((3, 4, 1), np.random.default_rng(0))
    rule = training.RULES["trainlm"]

    def reason(rule, stop=None):
        return training.train(data, (4,), w, rule=rule, stop=stop).reason

    assert reason(replace(rule, max_iterations=3)) == "iterations"
    assert reason(replace(rule, max_fails=1)) == "validation"
    assert reason(replace(rule, min_gradient=1e3)) == "gradient"
    assert reason(replace(rule, mu=1e9, mu_max=1e-3)) == "damping"
    assert reason(replace(rule, progress=0.9, window=2)) == "stalled"
    event = threading.Event()
    event.set()
    assert reason(rule, event) == "interrupted"
    assert set(REASONS) == {"iterations", "validation", "gradient", "damping", "stalled", "interrupted"}


def test_answer_is_the_iterate_of_least_validation_error():
    x, y = problem(120)
    data = training.Data.split(x, y, 0)
    w = training.initial_weights((3, 8, 1), np.random.default_rng(3))
    result = training.train(data, (8,), w)
    inputs, target = data.parts["validation"]
    network = data.network(result.w, (8,))
    physical = (inputs / data.inputs.gain[:, None]) + data.inputs.offset[:, None]
    scaled = (network(*physical) - network.output_offset) / network.output_gain
    assert np.mean((scaled - target) ** 2) == pytest.approx(result.validation.min(), rel=1e-9)
    assert result.validation[result.iteration] == result.best


def test_split_is_a_partition_of_70_15_15():
    parts = training.split_indices(1001, 5)
    assert [len(part) for part in parts.values()] == [701, 150, 150]
    assert np.array_equal(np.sort(np.concatenate(list(parts.values()))), np.arange(1001))


def test_bad_data_and_modes_are_named():
    with pytest.raises(UsageError, match="mode must be one of trainlm, fast, found 'sgd'"):
        training.rule_of("sgd")
    x, y = problem(100)
    with pytest.raises(NumericalError, match="not finite at its starting weights"):
        training.train(training.Data.split(x, np.where(y == y[3], np.nan, y), 0), (2,), np.zeros(11))


@pytest.fixture(scope="module", params=[0, 2], ids=["motion alone", "two further inputs"])
def sequences(request):
    t = np.arange(600) * 0.01
    rng = np.random.default_rng(0)
    motions = []
    for scale in (1.0, 0.5):
        x = scale * (np.sin(9 * t) + 0.4 * np.sin(23 * t))
        v = np.gradient(x, t)
        level = 1 + 0.5 * np.sin(2 * t)  # of the friction: the first further input; the second has no effect
        further = np.stack([level, np.cos(5 * t)])[: request.param]
        R = 3 * x + 0.1 * v + (level if request.param else 1) * np.tanh(2 * v) + 0.01 * rng.normal(size=len(t))
        motions.append(joint.Trajectory(x, v, R, further))
    return joint.Sequences.of(motions, TurningPoints())


@pytest.fixture(scope="module")
def pair(sequences):
    s = sequences
    held = s.x0[s.segment]
    force = s.R[np.searchsorted(s.segment, s.segment)]
    return ensemble.train_pair(ensemble.Samples(s.x, s.v, held, force, s.R, s.further), (3,), 0).member


def test_simulated_error_is_that_of_the_model(sequences, pair):
    """The joint problem's sum of squares is that of the model's own response, recording by recording."""
    from hystid.networks import FurtherInput, TwoNetworkModel

    ports = tuple(FurtherInput(name, "1", name) for name in ("level", "idle")[: pair.further])
    model = TwoNetworkModel((pair,), 0.0, 100.0, {}, inputs=ports)
    total = 0.0
    for part in (slice(0, 600), slice(600, 1200)):
        x, v, R = sequences.x[part], sequences.v[part], sequences.R[part]
        further = {port.name: values for port, values in zip(ports, sequences.further[:, part], strict=True)}
        response, _ = model.response(x, v, model.initial_state(R[0]), further)
        total += np.sum(((response - R) / pair.restoring.output_gain) ** 2)
    normal = joint.JointNormal(pair, sequences)
    assert normal.squares(joint.parameters_of(pair)) == pytest.approx(total, rel=1e-10)


def test_simulation_jacobian_is_exact(sequences, pair):
    """J'e is half the derivative of the sum of squares; central differences with a step of 1e-6 are good to 1e-6."""
    normal, w = joint.JointNormal(pair, sequences), joint.parameters_of(pair)
    normal.build(w)
    gradient = normal.gradient()
    for k in range(0, len(w), 3):
        step = 1e-6 * (np.arange(len(w)) == k)
        slope = (normal.squares(w + step) - normal.squares(w - step)) / 4e-6
        assert gradient[k] == pytest.approx(slope, rel=1e-4, abs=1e-6 * np.abs(gradient).max())


def test_branches_begin_where_the_one_before_ended(sequences, pair):
    """With what is asked of beginnings J'e stays exact; where g(x0, x0, Rh0) is Rh0 nothing is asked."""
    normal, w = joint.JointNormal(pair, sequences, continuous=True), joint.parameters_of(pair)
    normal.build(w)
    gradient = normal.gradient()
    for k in range(0, len(w), 3):
        step = 1e-6 * (np.arange(len(w)) == k)
        slope = (normal.squares(w + step) - normal.squares(w - step)) / 4e-6
        assert gradient[k] == pytest.approx(slope, rel=1e-4, abs=1e-6 * np.abs(gradient).max())

    def asked(member):
        """What the beginnings add to the sum of squares."""
        at = joint.parameters_of(member)
        both, plain = joint.JointNormal(member, sequences, continuous=True), joint.JointNormal(member, sequences)
        return both.squares(at) - plain.squares(at)

    g = pair.hysteresis
    weights, bias = np.zeros((1, g.sizes[0])), np.array([(g.input_offset[2] - g.output_offset) / g.output_gain])
    weights[0, 2] = 1 / (g.input_gain[2] * g.output_gain)  # g(x, x0, Rh0) = Rh0
    holding = replace(pair, hysteresis=replace(g, layers=((weights, bias),)))
    assert asked(holding) == pytest.approx(0.0, abs=1e-9) and asked(pair) > 1e-3


def test_wanted_answers_are_trained_beside_the_data(sequences, pair):
    """Answers half as great as the data's: training on both moves the pair towards them."""
    own, w = joint.JointNormal(pair, sequences), joint.parameters_of(pair)
    wanted = replace(sequences, R=0.5 * sequences.R)
    found = joint.parameters_of(joint.train_beside(pair, (sequences, sequences), wanted, training.RULES["fast"]))
    asked = joint.JointNormal(pair, wanted)
    assert asked.squares(found) < asked.squares(w)
    twice = joint.JointNormal(pair, sequences.joined(sequences.weighted(2.0)))
    assert twice.squares(w) == pytest.approx(5 * own.squares(w), rel=1e-12)


def test_joint_training_lowers_the_simulated_error(sequences, pair):
    better, result = joint.train_jointly(pair, sequences, training.RULES["fast"])
    assert result.best < result.validation[0]
    whole = joint.JointNormal(pair, sequences)
    assert whole.squares(joint.parameters_of(better)) < whole.squares(joint.parameters_of(pair))


def test_picked_samples_keep_the_memory_of_all(sequences, pair):
    """Fitting a few samples simulates the same turning points: the squares of two halves add up."""
    w, order = joint.parameters_of(pair), np.random.default_rng(0).permutation(len(sequences.x))
    halves = [joint.JointNormal(pair, sequences.pick(part)).squares(w) for part in (order[:500], order[500:])]
    assert sum(halves) == pytest.approx(joint.JointNormal(pair, sequences).squares(w), rel=1e-12)


def test_fewer_branches_are_runs_of_all_that_begin_as_measured(sequences, pair):
    count = len(sequences.x0) // 2
    fewer, kept = sequences.thinned(count)
    assert 16 <= len(fewer.x0) <= count and np.array_equal(fewer.x, sequences.x[kept])
    assert np.array_equal(fewer.x0[fewer.segment], sequences.x0[sequences.segment[kept]])  # each sample on its branch
    begins = np.flatnonzero(kept & ~np.concatenate([[False], kept[:-1]]))[1:]  # of runs, but that of the recording
    at = fewer.segment[np.searchsorted(np.flatnonzero(kept), begins)]
    assert fewer.fresh[at].all() and np.array_equal(fewer.start[at], sequences.R[begins - 1])
    assert np.isfinite(joint.JointNormal(pair, fewer).build(joint.parameters_of(pair)))
    whole, rows = sequences.thinned(len(sequences.x0))
    assert whole is sequences and rows.all()


def test_weights_multiply_errors_and_their_derivatives(sequences, pair):
    """Weights 2 and 3 on two recordings: J'e and e'e are those of either recording, times 4 and 9."""
    w, weight = joint.parameters_of(pair), np.repeat([2.0, 3.0], 600)
    whole = joint.JointNormal(pair, replace(sequences, weight=weight))
    parts = [joint.JointNormal(pair, sequences.pick(np.arange(600) + begin)) for begin in (0, 600)]
    squares = [part.build(w) for part in parts]
    assert whole.build(w) == pytest.approx(4 * squares[0] + 9 * squares[1], rel=1e-12)
    expected = 4 * parts[0].gradient() + 9 * parts[1].gradient()
    np.testing.assert_allclose(whole.gradient(), expected, rtol=1e-9, atol=1e-9 * np.abs(expected).max())


def test_branches_are_divided_the_same_way_for_any_draw_of_samples(sequences):
    """Else a training that goes on with other samples would be stopped by branches that it was trained on."""
    few = sequences.pick(np.arange(0, len(sequences.x), 3))
    for name, chosen in sequences.split(1).items():
        assert set(few.segment[few.split(1)[name]]) <= set(sequences.segment[chosen])


def test_a_draft_sees_few_samples_and_the_answer_fits_all():
    """10,500 training samples, 21 weights: a fifth of the samples in the draft; errors after it are those of all."""
    rng = np.random.default_rng(5)
    inputs = rng.uniform(-1, 1, (3, 15_000))
    target = np.tanh(2 * inputs[0]) + 0.3 * inputs[1] * inputs[2] + 0.01 * rng.standard_normal(15_000)
    data, rule = training.Data.split(inputs, target, 0), training.RULES["fast"]
    (few, draft), (every, last) = training.stages(len(data.parts["train"][1]), 21, rule)
    assert few == 2100 and every == 10_500 and draft.max_iterations + last.max_iterations == rule.max_iterations
    w = training.initial_weights((3, 4, 1), np.random.default_rng(0))
    with_draft, without = (training.train(data, (4,), w, rule=r) for r in (rule, replace(rule, draft=0.0)))
    whole = CompiledNormal((3, 4, 1), *data.parts["train"])
    assert whole.squares(with_draft.w) / 10_500 == pytest.approx(with_draft.train[with_draft.iteration], rel=1e-9)
    assert with_draft.validation[with_draft.iteration] == with_draft.best
    assert with_draft.best < 1.1 * without.best  # another path, an answer as good
    assert training.stages(2100, 21, rule) == [(2100, rule)]  # soon done anyhow
    assert training.stages(20_000, 1500, rule) == [(20_000, rule)]  # ten per weight would be more than half of them
