"""Overproduce and choose: many starts of the two-network pair, trained side by side, the best kept and averaged.

Each start depends on the seed and its own number only, so that the result does not depend on how many run at a time.
"""

from __future__ import annotations

import os
import threading
from collections.abc import Callable, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np

from hystid.errors import NumericalError
from hystid.leastsquares import Rule
from hystid.networks.batched import train_batch
from hystid.networks.joint import Sequences, train_jointly
from hystid.networks.normal_equations import Precision
from hystid.networks.perceptron import Member, Network
from hystid.networks.training import RULES, Data, Training, draw, initial_weights, train
from hystid.progress import tell, track
from hystid.recording import Array

Result = TypeVar("Result")


@dataclass(frozen=True, eq=False)
class Samples:
    """Regression samples of the two-network method, each of shape (n,), SI units.

    x0, R0: displacement and measured force at the latest turning point (``TurningPoints.hold``). further: the further
    inputs and lags, shape (inputs + lags, n); inputs: how many of them are inputs.
    """

    x: Array
    v: Array
    x0: Array
    R0: Array
    R: Array
    further: Array
    inputs: int = 0

    @property
    def quiet(self) -> slice:
        """Inputs of both networks that are further inputs: they start without effect, and are held to little."""
        return slice(3, 3 + self.inputs)

    def subset(self, count: int, seed: int) -> Samples:
        """The samples of ``draw``."""
        pick = draw(len(self.x), count, seed)
        rows = {name: getattr(self, name)[..., pick] for name in ("x", "v", "x0", "R0", "R", "further")}
        return replace(self, **rows)


@dataclass(frozen=True, eq=False)
class TrainedPair:
    """One trained pair; joint: its training in simulation (``train_jointly``), where there was one."""

    number: int
    member: Member
    hysteresis: Training
    restoring: Training
    joint: Training | None = None

    @property
    def error(self) -> float:
        """Least validation error, scaled mean square: of the simulated force, or of the restoring network by itself."""
        return self.joint.best if self.joint else self.restoring.best


def train_pair(
    samples: Samples,
    hidden: Sequence[int],
    number: int,
    *,
    seed: int = 0,
    rule: Rule = RULES["fast"],
    precision: Precision = "float64",
    stop: threading.Event | None = None,
) -> TrainedPair:
    """Hysteresis network on (x, x0, R0) -> R, then restoring network on (x, v, its output) -> R, on one split."""
    first, second = _weights(samples, hidden, seed, number)
    quiet = samples.quiet
    outer = _outer_data(samples, seed)
    hysteresis = train(outer, hidden, first, rule=rule, precision=precision, further=quiet, stop=stop)
    network = outer.network(hysteresis.w, hidden)
    inner = _inner_data(samples, network, seed)
    restoring = train(inner, hidden, second, rule=rule, precision=precision, further=quiet, stop=stop)
    return TrainedPair(number, Member(network, inner.network(restoring.w, hidden)), hysteresis, restoring)


def _weights(samples: Samples, hidden: Sequence[int], seed: int, number: int) -> tuple[Array, Array]:
    """Starting weights of both networks of one start."""
    rng, sizes = np.random.default_rng([seed, number]), (3 + len(samples.further), *hidden, 1)
    return initial_weights(sizes, rng, samples.quiet), initial_weights(sizes, rng, samples.quiet)


def _outer_data(samples: Samples, seed: int) -> Data:
    return Data.split(np.stack([samples.x, samples.x0, samples.R0, *samples.further]), samples.R, seed)


def _inner_data(samples: Samples, hysteresis: Network, seed: int) -> Data:
    Rh = hysteresis(samples.x, samples.x0, samples.R0, *samples.further)
    return Data.split(np.stack([samples.x, samples.v, Rh, *samples.further]), samples.R, seed)


def workers_of(workers: int | None) -> int:
    """Number of trainings at a time: the given one, or one per processor that this process may use."""
    return max(1, workers if workers else len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else 1)


def side_by_side(
    title: str, jobs: Sequence[Callable[[threading.Event], Result]], workers: int | None = None
) -> tuple[list[Result], bool]:
    """Results of the jobs in their order, and whether all ran.

    Ctrl-C ends the running jobs (through their event) and starts no more; what was finished before is returned,
    and where nothing was, KeyboardInterrupt is raised, as are the errors of jobs.
    The work is in compiled code that runs beside Python, so threads serve as well as processes and copy no data.
    """
    stop = threading.Event()
    done: dict[int, Result] = {}
    with track(title, len(jobs)) as step, ThreadPoolExecutor(workers_of(workers)) as pool:
        futures: dict[Future[Result], int] = {pool.submit(job, stop): k for k, job in enumerate(jobs)}
        try:
            pending = set(futures)
            while pending:
                finished, pending = wait(pending, return_when=FIRST_COMPLETED)
                for future in finished:
                    done[futures[future]] = future.result()
                    step()
        except BaseException as error:
            ready = [future for future in futures if future.done() and not future.cancelled()]
            stop.set()  # what ends from here on is not a finished training
            done |= {futures[future]: future.result() for future in ready if not future.exception()}
            if isinstance(error, KeyboardInterrupt) and done:
                tell(f"{title}: stopping with the {len(done)} of {len(jobs)} that finished; Ctrl-C again ends at once")
            pool.shutdown(wait=True, cancel_futures=True)
            if not isinstance(error, KeyboardInterrupt) or not done:
                raise
    return [done[k] for k in sorted(done)], len(done) == len(jobs)


def train_ensemble(
    samples: Samples,
    hidden: Sequence[int],
    count: int,
    *,
    seed: int = 0,
    rule: Rule = RULES["fast"],
    precision: Precision = "float64",
    workers: int | None = None,
) -> list[TrainedPair]:
    """``count`` starts, in order of their number; fewer after Ctrl-C, then those finished. ``workers`` at a time."""

    def job(number: int) -> Callable[[threading.Event], TrainedPair]:
        return lambda stop: train_pair(samples, hidden, number, seed=seed, rule=rule, precision=precision, stop=stop)

    return side_by_side("training", [job(number) for number in range(count)], workers)[0]


def train_on(
    device: str, samples: Samples, hidden: Sequence[int], count: int, *, seed: int, rule: Rule
) -> list[TrainedPair]:
    """As ``train_ensemble``, all at once on a torch device such as "cuda", in double precision."""
    weights = [_weights(samples, hidden, seed, number) for number in range(count)]
    outer = _outer_data(samples, seed)
    firsts = train_batch([outer] * count, hidden, np.stack([w for w, _ in weights]), rule=rule, device=device)
    networks = [outer.network(first.w, hidden) for first in firsts]
    inner = [_inner_data(samples, network, seed) for network in networks]
    seconds = train_batch(inner, hidden, np.stack([w for _, w in weights]), rule=rule, device=device)
    members = [
        Member(network, part.network(second.w, hidden))
        for network, part, second in zip(networks, inner, seconds, strict=True)
    ]
    return [TrainedPair(k, *parts) for k, parts in enumerate(zip(members, firsts, seconds, strict=True))]


def refine_ensemble(
    starts: Sequence[TrainedPair],
    data: Sequences,
    *,
    seed: int = 0,
    rule: Rule,
    share: float = 1.0,
    workers: int | None = None,
) -> list[TrainedPair]:
    """The starts after training in simulation, in their order; fewer after Ctrl-C, then those finished.

    A start that was trained in simulation before goes on from there; its ``joint`` then tells of both trainings. share:
    see ``train_jointly``.
    """

    def job(start: TrainedPair) -> Callable[[threading.Event], TrainedPair]:
        def run(stop: threading.Event) -> TrainedPair:
            member, joint = train_jointly(start.member, data, rule, seed=seed, share=share, stop=stop)
            return replace(start, member=member, joint=joint.after(start.joint) if start.joint else joint)

        return run

    return side_by_side("training in simulation", [job(start) for start in starts], workers)[0]


def best(starts: Sequence[TrainedPair], count: int) -> list[TrainedPair]:
    """The ``count`` starts (at least one) of the least validation error, best first."""
    finite = sorted((start for start in starts if np.isfinite(start.error)), key=lambda start: start.error)
    if not finite:
        raise NumericalError("no training ended with a finite error: is the target constant, or the data corrupted?")
    return finite[: max(1, count)]
