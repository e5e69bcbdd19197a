"""Two-network model: scaling, turning-point rule, chunk = whole, closed loop, C kernel against NumPy."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from benchmarks.lm import numpy_networks
from hystid.errors import NumericalError, UsageError
from hystid.networks import Member, Network, TwoNetworkModel, evaluation


def random_network(rng, hidden, scale=1.0):
    sizes = (3, *hidden, 1)
    layers = tuple((rng.normal(0, scale, (o, i)), rng.normal(0, scale, o)) for i, o in pairwise(sizes))
    return Network(layers, rng.normal(0, 0.3, 3), rng.uniform(0.5, 2, 3), 0.2, 1.7)


def random_model(seed=0, members=3, hidden=(5, 5), mass=1.0, band=0.0):
    rng = np.random.default_rng(seed)
    pairs = tuple(Member(random_network(rng, hidden), random_network(rng, hidden)) for _ in range(members))
    return TwoNetworkModel(pairs, mass, 1e3, {"x": (-1, 1), "v": (-1, 1), "R": (-1, 1)}, velocity_band=band)


def motion(n=400, seed=1):
    t = np.arange(n) * 1e-2
    rng = np.random.default_rng(seed)
    v = np.sin(7 * t) + 0.7 * np.sin(19 * t + 1) + 0.05 * rng.normal(size=n)
    v[50:60] = 0.0
    v[0] = -0.0
    return np.cumsum(v) * 1e-2, v


def literal_response(model, x, v):
    """The published rule, read word by word, in scalar Python (band 0)."""
    total = np.zeros(len(x))
    for member in model.members:
        x0 = rh0 = rh = 0.0
        for k in range(len(x)):
            if k == 0 or v[k - 1] * v[k] <= 0:
                x0, rh0 = x[k], rh
            rh = member.hysteresis(x[k], x0, rh0)[0]
            total[k] += member.restoring(x[k], v[k], rh)[0]
    return total / len(model.members)


def in_numpy(monkeypatch):
    for name in ("response", "free_run"):
        monkeypatch.setattr(evaluation, name, getattr(numpy_networks, name))


@pytest.fixture(params=["C", "NumPy"])
def path(request, monkeypatch):
    """The kernel, and the same written apart from it."""
    if request.param == "NumPy":
        in_numpy(monkeypatch)
    return request.param


@pytest.mark.parametrize("members", [1, 3, 9])
def test_response_is_the_published_rule(path, members):
    model = random_model(members=members)
    x, v = motion()
    # both sum some hundred terms of order 1 per sample in double precision, and the memory is a contraction here
    np.testing.assert_allclose(model.response(x, v)[0], literal_response(model, x, v), rtol=1e-10, atol=1e-12)


@settings(max_examples=60, deadline=None)
@given(
    v=st.lists(st.sampled_from([-1.5, -0.2, -1e-3, -0.0, 0.0, 1e-3, 0.3, 2.0]), min_size=1, max_size=40),
    cuts=st.lists(st.integers(0, 40), max_size=4),
    band=st.sampled_from([0.0, 1e-2]),
)
def test_chunk_by_chunk_is_the_whole(v, cuts, band):
    model = random_model(band=band)
    v = np.array(v)
    x = np.cumsum(v) * 0.1
    whole, end = model.response(x, v)
    state, parts = None, []
    for begin, stop in pairwise([0, *sorted(cuts), max(len(v), *cuts, 0)]):
        part, state = model.response(x[begin:stop], v[begin:stop], state)
        parts.append(part)
    assert np.array_equal(np.concatenate(parts), whole)
    assert np.array_equal(state, end)


def test_free_run_repeats_the_response_to_its_own_motion(path):
    """The closed loop calls the same law at its samples: open loop on the motion that it made gives the same R."""
    model = random_model(mass=2.0)
    force = np.sin(np.arange(150) * 0.05)
    run = model.free_run(force, 1e-2, 0.1, -0.2)
    np.testing.assert_allclose(model.response(run["x"], run["v"])[0], run["R"], rtol=0, atol=1e-13)
    np.testing.assert_allclose(model.mass * run["a"] + run["R"], force, rtol=0, atol=1e-13)
    assert run["x"][0] == 0.1 and run["v"][0] == -0.2


def test_free_run_in_numpy_and_c_agree(monkeypatch):
    model = random_model(mass=2.0)
    force = np.sin(np.arange(200) * 0.05)
    compiled = model.free_run(force, 1e-2)
    in_numpy(monkeypatch)
    plain = model.free_run(force, 1e-2)
    for name in compiled:  # rounding differs by units in the last place and grows little over 200 steps
        np.testing.assert_allclose(compiled[name], plain[name], rtol=0, atol=1e-10)


def linear_model(stiffness, damping, mass):
    """Restoring network without hidden layer: exactly R = stiffness x + damping v."""
    flat = Network(((np.zeros((1, 3)), np.zeros(1)),), np.zeros(3), np.ones(3), 0.0, 1.0)
    law = Network(((np.array([[stiffness, damping, 0.0]]), np.zeros(1)),), np.zeros(3), np.ones(3), 0.0, 1.0)
    return TwoNetworkModel((Member(flat, law),), mass, 1e3, {})


def test_free_run_is_of_fourth_order():
    """Free decay of a linear oscillator against the closed form: halving the step divides the error by 16."""
    mass, damping, stiffness = 2.0, 3.0, 800.0
    decay, rate = damping / (2 * mass), np.sqrt(stiffness / mass - (damping / (2 * mass)) ** 2)
    errors = []
    for n in (101, 201):
        t = np.linspace(0, 1, n)
        exact = 0.01 * np.exp(-decay * t) * (np.cos(rate * t) + decay / rate * np.sin(rate * t))
        run = linear_model(stiffness, damping, mass).free_run(np.zeros(n), t[1], 0.01)
        errors.append(np.abs(run["x"] - exact).max())
    assert 14 < errors[0] / errors[1] < 18


def test_a_diverging_free_run_is_a_named_outcome():
    with pytest.raises(NumericalError, match="diverged at t ="):
        linear_model(-1e6, -1e4, 1.0).free_run(np.ones(4000), 1e-2)


def test_scaling_is_folded_into_flat_weights():
    network = random_network(np.random.default_rng(3), (4,))
    weights, bias = network.flat[:12].reshape(4, 3), network.flat[12:16]
    u = np.array([0.3, -0.1, 0.9])
    expected = network.flat[16:20] @ np.tanh(weights @ u + bias) + network.flat[20]
    assert network(*u)[0] == pytest.approx(expected, rel=1e-13)


def test_bad_arguments_get_a_sentence():
    model = random_model()
    x, v = motion(10)
    with pytest.raises(UsageError, match="one length"):
        model.response(x, v[:5])
    with pytest.raises(UsageError, match="x is not finite at sample 3"):
        model.response(np.where(np.arange(10) == 3, np.nan, x), v)
    with pytest.raises(UsageError, match=r"state must have shape \(8,\)"):
        model.response(x, v, np.zeros(3))
    with pytest.raises(UsageError, match="mass above 0"):
        random_model(mass=0.0).free_run(x, 1e-3)
    with pytest.raises(UsageError, match="one structure"):
        TwoNetworkModel((*model.members, *random_model(hidden=(2,)).members), 1.0, 1e3, {})
