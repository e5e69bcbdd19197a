"""Cost of one Levenberg-Marquardt iteration against the machine's floor, and of a training against torch: one run.

    OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 python benchmarks/lm/cost.py

Floor of an iteration: flops of one Jacobian pass and two trial passes at the measured DGEMM rate, and NumPy's tanh per
neuron. Everything single-threaded, processor time, best of several, candidates in turn. Own task: 35,000 samples of the
simulated stick-slip oscillator with measured turning points.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))

import oracle
from numpy_networks import NumpyNormal

from hystid.identification.data import samples
from hystid.networks import batched, training
from hystid.networks.normal_equations import CompiledNormal, KernelSums, parameter_count
from hystid.processing import with_restoring_force
from hystid.turning_points import TurningPoints

N = 35_000


def best(functions: Sequence[Callable[[], object]], rounds: int) -> list[float]:
    """Least processor time [ms] of each, taken in turn."""
    times = [[] for _ in functions]
    for _ in range(rounds):
        for kept, function in zip(times, functions, strict=True):
            begin = time.thread_time()
            function()
            kept.append(1e3 * (time.thread_time() - begin))
    return [min(kept) for kept in times]


def machine() -> tuple[float, float]:
    """DGEMM rate [flop/ms] and NumPy's tanh [ms per value]."""
    a, z = np.random.default_rng(0).random((768, 768)), np.random.default_rng(0).normal(size=16384)
    product, tanh = best([lambda: a @ a, lambda: np.tanh(z)], 60)
    return 2 * 768**3 / product, tanh / len(z)


def floor(sizes: Sequence[int], gemm: float, tanh: float) -> float:
    """ms of one Jacobian pass and two trial passes."""
    count, hidden = parameter_count(sizes), sum(sizes[1:-1])
    forward = 2 * sum(i * o for i, o in pairwise(sizes))
    backward = 2 * sum(i * o for i, o in pairwise(sizes[1:])) + 3 * hidden
    jacobian = forward + backward + count + count * (count + 1) + 2 * count
    return N * ((jacobian + 2 * forward) / gemm + 3 * hidden * tanh)


def iteration(normal: KernelSums | NumpyNormal, w: np.ndarray) -> Callable[[], None]:
    """One Jacobian pass, one solution and two trial passes."""

    def run() -> None:
        normal.build(w)
        normal.solve(1e-3 * normal.diagonal())
        normal.squares(w)
        normal.squares(w)

    return run


def main() -> None:
    ready = [with_restoring_force(recording, 1.0) for recording in oracle.chirps()]
    drawn = samples(ready, TurningPoints()).subset(50_000, 0)
    data = training.Data.split(np.stack([drawn.x, drawn.x0, drawn.R0]), drawn.R, 0)
    inputs, target = data.parts["train"]
    gemm, tanh = machine()
    print(f"DGEMM {gemm / 1e6:.0f} Gflop/s, tanh {1e6 * tanh:.2f} ns\n")
    print(
        "| structure | floor ms | C float64 | x floor | C float32 | x floor | NumPy | x floor "
        "| torch (batch of 1) | x floor |"
    )
    print("|---|---|---|---|---|---|---|---|---|---|")
    for hidden in ((5,), (5, 5), (8, 8, 8), (13, 13), (13, 13, 13)):
        sizes = (3, *hidden, 1)
        w = training.initial_weights(sizes, np.random.default_rng(0))
        normals = [CompiledNormal(sizes, inputs, target), CompiledNormal(sizes, inputs, target, "float32")]
        normals.append(NumpyNormal(sizes, inputs, target))
        candidates = [iteration(normal, w) for normal in normals] + [torch_iteration(sizes, inputs, target, w)]
        least = floor(sizes, gemm, tanh)
        times = best(candidates, 6 if parameter_count(sizes) > 200 else 15)
        cells = " | ".join(f"{t:.2f} | {t / least:.2f}" for t in times)
        print(f"| {'-'.join(map(str, sizes))} | {least:.2f} | {cells} |", flush=True)
    training_cost(data)
    draft_gain(data)


def draft_gain(data: training.Data) -> None:
    """Time and validation error of 60 + 20 iterations with a draft against 60 on all samples."""
    print("\n| structure | seed | time with draft / without | validation error with / without |\n|---|---|---|---|")
    for hidden in ((5, 5), (10, 10), (10, 10, 10), (13, 13, 13)):
        for seed in range(3):
            w, found = training.initial_weights((3, *hidden, 1), np.random.default_rng([0, seed])), []
            for iterations, share in ((80, 0.2), (60, 0.0)):
                rule = replace(training.RULES["fast"], max_iterations=iterations, draft=share)
                begin = time.thread_time()
                best_error = training.train(data, hidden, w, rule=rule).best
                found.append((time.thread_time() - begin, best_error))
            (quick, with_draft), (slow, without) = found
            name = "-".join(map(str, hidden))
            print(f"| {name} | {seed} | {quick / slow:.2f} | {with_draft / without:.3f} |", flush=True)


def torch_iteration(sizes: Sequence[int], inputs: np.ndarray, target: np.ndarray, w: np.ndarray) -> Callable[[], None]:
    import torch

    torch.set_num_threads(1)
    batch = batched._Batch(sizes, torch.tensor(inputs[None]), torch.tensor(target[None]))
    start = torch.tensor(w[None])

    def run() -> None:
        batch.build(start)
        batch.squares(start)
        batch.squares(start)

    return run


def training_cost(data: training.Data) -> None:
    """Processor time of a training of 3-5-5-1 to the validation error that the trainlm rule has after 60 iterations."""
    sizes, hidden = (3, 5, 5, 1), (5, 5)
    print("\n| seed | level | trainlm iterations / s | fast iterations / s |\n|---|---|---|---|")
    for seed in range(3):
        w, cells, level = training.initial_weights(sizes, np.random.default_rng(seed)), [], None
        for mode in ("trainlm", "fast"):
            rule = replace(training.RULES[mode], max_iterations=60, max_fails=99, progress=0.0, draft=0.0)
            begin = time.thread_time()
            result = training.train(data, hidden, w, rule=rule)
            spent = (time.thread_time() - begin) / (len(result.validation) - 1)
            level = level or 1.02 * result.best
            reached = int(np.argmax(result.validation <= level)) if result.best <= level else 60
            cells.append(f"{reached} / {reached * spent:.3f}")
        print(f"| {seed} | {level:.3g} | {' | '.join(cells)} |", flush=True)


if __name__ == "__main__":
    main()
