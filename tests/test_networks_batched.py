"""Batched training in torch takes the path of the compiled kernel, network by network."""

import sys
from dataclasses import replace

import numpy as np
import pytest

from hystid.errors import UsageError
from hystid.leastsquares import REASONS
from hystid.networks import batched, ensemble, training


def data(seed, n=600):
    rng = np.random.default_rng(seed)
    x = rng.uniform(-1, 1, (3, n))
    return training.Data.split(x, np.tanh(3 * x[0] - x[1]) * 0.6 + 0.3 * x[2] + 0.01 * rng.normal(size=n), 0)


@pytest.mark.parametrize("mode", ["trainlm", "fast"])
def test_each_network_of_a_batch_is_trained_as_by_itself(mode):
    sets = [data(seed) for seed in range(3)]
    starts = np.stack([training.initial_weights((3, 4, 3, 1), np.random.default_rng(seed)) for seed in range(3)])
    rule = replace(training.RULES[mode], max_iterations=6)
    together = batched.train_batch(sets, (4, 3), starts, rule=rule)
    for one, w, result in zip(sets, starts, together, strict=True):
        alone = training.train(one, (4, 3), w, rule=rule)
        # the same steps with sums in another order: rounding of 1e-16 times the condition of the damped systems, which
        # grows as mu falls by 10 a step; after six steps it is about 1e8
        np.testing.assert_allclose(result.train, alone.train, rtol=1e-5)
        np.testing.assert_allclose(result.validation, alone.validation, rtol=1e-5)
        assert (result.reason, result.iteration) == (alone.reason, alone.iteration)
        assert result.test == pytest.approx(alone.test, rel=1e-5)


def test_networks_of_a_batch_stop_for_their_own_reasons():
    sets = [data(seed, 80) for seed in range(6)]
    starts = np.stack([training.initial_weights((3, 6, 1), np.random.default_rng(seed)) for seed in range(6)])
    rule = replace(training.RULES["trainlm"], max_iterations=60, max_fails=3)
    results = batched.train_batch(sets, (6,), starts, rule=rule)
    assert len({len(result.train) for result in results}) > 1
    for result in results:
        assert result.reason in REASONS
        assert result.validation[result.iteration] == result.validation.min()
        assert np.all(np.diff(result.train) < 0)


def test_ensemble_on_a_device_equals_the_ensemble_on_the_kernel():
    rng = np.random.default_rng(0)
    x, v = rng.uniform(-1, 1, (2, 500))
    x0 = np.repeat(rng.uniform(-1, 1, 25), 20)
    R = x + 0.2 * v + np.tanh(2 * (x - x0))
    samples = ensemble.Samples(x, v, x0, np.tanh(x0), R, np.zeros((0, len(x))))
    rule = replace(training.RULES["fast"], max_iterations=8)
    kernel = ensemble.train_ensemble(samples, (3,), 3, rule=rule)
    device = ensemble.train_on("cpu", samples, (3,), 3, seed=0, rule=rule)
    for a, b in zip(kernel, device, strict=True):
        assert a.number == b.number
        np.testing.assert_allclose(b.restoring.train, a.restoring.train, rtol=1e-6)
        np.testing.assert_allclose(b.member.restoring.flat, a.member.restoring.flat, rtol=1e-3, atol=1e-5)


def test_missing_torch_or_device_is_named(monkeypatch):
    sets, starts = [data(0, 60)], np.zeros((1, 11))
    with pytest.raises(UsageError, match="device 'nonsense' cannot be used"):
        batched.train_batch(sets, (2,), starts, rule=training.RULES["fast"], device="nonsense")
    monkeypatch.setitem(sys.modules, "torch", None)
    with pytest.raises(UsageError, match=r"install hystid\[train\]"):
        batched.train_batch(sets, (2,), starts, rule=training.RULES["fast"])
