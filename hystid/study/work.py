"""One unit of a study: one pair of networks trained and tested, and its file."""

from __future__ import annotations

import json
import time
import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from hystid import processing
from hystid.errors import HystidError
from hystid.files import atomic, plain
from hystid.identification import predict
from hystid.identification.data import samples
from hystid.leastsquares import REASONS, Rule
from hystid.networks import Member, Network, TwoNetworkModel
from hystid.networks.ensemble import Samples, TrainedPair, train_pair
from hystid.networks.normal_equations import Precision, flattened, layers_of
from hystid.recording import Array, Recording
from hystid.turning_points import TurningPoints

_NETWORKS = ("hysteresis", "restoring")


@dataclass(frozen=True)
class Task:
    """One training: hidden layers, number of the start, mass [kg] that R is computed with."""

    layers: tuple[int, ...]
    start: int
    mass: float

    @property
    def name(self) -> str:
        """Name of its file, without ending."""
        return f"{'-'.join(map(str, self.layers))}_m{self.mass:.9g}_s{self.start:04d}"


@dataclass(frozen=True, eq=False)
class Payload:
    """What every task of a study needs: prepared recordings (F, x, v, a; R not yet formed) and how to train."""

    training: tuple[Recording, ...]
    holdout: tuple[Recording, ...]
    rule: Rule
    precision: Precision
    samples: int
    seed: int

    def drawn(self, mass: float) -> Samples:
        """Training samples for one mass."""
        return _drawn(self, mass)

    def tested(self, mass: float) -> list[Recording]:
        """Held-out recordings with R for one mass."""
        return [processing.with_restoring_force(recording, mass) for recording in self.holdout]


@lru_cache(maxsize=2)
def _drawn(payload: Payload, mass: float) -> Samples:
    ready = [processing.with_restoring_force(recording, mass) for recording in payload.training]
    return samples(ready, TurningPoints()).subset(payload.samples, payload.seed)


@dataclass(frozen=True, eq=False)
class TrainingResult:
    """A finished task. errors: for each held-out recording {"name", "force_nrmse", "x_nrmse"}; x_nrmse is NaN without a
    mass, infinity where the free run diverged. validation: least validation error of the restoring network (scaled).
    stopped: why each network's training ended. seconds: processor time of training and testing."""

    task: Task
    member: Member
    validation: float
    errors: tuple[Mapping[str, Any], ...]
    stopped: Mapping[str, str]
    curves: Mapping[str, Array]
    seconds: float = float("nan")

    @property
    def force(self) -> float:
        """Median force NRMSE over the held-out recordings."""
        return float(np.median([error["force_nrmse"] for error in self.errors]))

    @property
    def free_run(self) -> float:
        """Median free-run displacement NRMSE over the held-out recordings."""
        return float(np.median([error["x_nrmse"] for error in self.errors]))


def model_of(members: Sequence[Member], mass: float, payload: Payload) -> TwoNetworkModel:
    """Members of a study as one model."""
    return TwoNetworkModel(tuple(members), mass, payload.training[0].sample_rate, {})


def errors_of(model: TwoNetworkModel, recordings: Sequence[Recording]) -> tuple[Mapping[str, Any], ...]:
    """Held-out errors of a model, one entry per recording."""
    entries = []
    for recording in recordings:
        prediction = predict(model, recording)
        lost = float("inf") if prediction.diverged else float("nan")
        free = lost if prediction.x_nrmse is None else prediction.x_nrmse
        entries.append({"name": recording.name, "force_nrmse": prediction.force_nrmse, "x_nrmse": free})
    return tuple(entries)


def run(payload: Payload, task: Task) -> TrainingResult:
    """Train one pair and test it on the held-out recordings. All but its ``seconds`` depends on the arguments only."""
    begin = time.thread_time()
    start = train_pair(
        payload.drawn(task.mass),
        task.layers,
        task.start,
        seed=payload.seed,
        rule=payload.rule,
        precision=payload.precision,
    )
    model = model_of([start.member], task.mass, payload)
    errors = errors_of(model, payload.tested(task.mass))
    stopped = {"hysteresis": REASONS[start.hysteresis.reason], "restoring": REASONS[start.restoring.reason]}
    seconds = time.thread_time() - begin
    return TrainingResult(task, start.member, start.error, errors, stopped, _curves(start), seconds)


def _curves(start: TrainedPair) -> dict[str, Array]:
    return {
        f"{network}_{part}": getattr(getattr(start, network), part)
        for network in _NETWORKS
        for part in ("train", "validation")
    }


def save(outcome: TrainingResult, folder: Path) -> None:
    """Write one outcome as NAME.npz, whole or not at all."""
    arrays: dict[str, Any] = dict(outcome.curves)
    for name in _NETWORKS:
        network: Network = getattr(outcome.member, name)
        arrays[f"{name}_w"] = flattened(network.layers)
        arrays[f"{name}_inputs"] = np.stack([network.input_offset, network.input_gain])
        arrays[f"{name}_output"] = np.array([network.output_offset, network.output_gain])
    rest = {"validation": outcome.validation, "stopped": dict(outcome.stopped), "seconds": outcome.seconds}
    arrays["errors"] = np.array([[error["force_nrmse"], error["x_nrmse"]] for error in outcome.errors])
    arrays["names"] = np.array([error["name"] for error in outcome.errors])
    arrays["rest"] = np.array(json.dumps(plain(rest)))
    with atomic(folder / f"{outcome.task.name}.npz") as beside:
        np.savez(beside, **arrays)


def load(task: Task, folder: Path) -> TrainingResult | None:
    """The stored outcome of a task; None where there is none, or where its file cannot be read (it is trained anew)."""
    path = folder / f"{task.name}.npz"
    if not path.exists():
        return None
    try:
        with path.open("rb") as file, np.load(file, allow_pickle=False) as stored:
            values = {name: stored[name] for name in stored.files}
        return _outcome(task, values)
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile, HystidError):
        return None


def _outcome(task: Task, values: Mapping[str, Any]) -> TrainingResult:
    rest = json.loads(str(values["rest"]))
    networks = [_network(task, values, name) for name in _NETWORKS]
    errors = tuple(
        {"name": str(name), "force_nrmse": float(force), "x_nrmse": float(free)}
        for name, (force, free) in zip(values["names"], values["errors"], strict=True)
    )
    curves = {name: array for name, array in values.items() if name.endswith(("_train", "_validation"))}
    validation, seconds = float(rest["validation"]), float(rest["seconds"])
    return TrainingResult(task, Member(*networks), validation, errors, rest["stopped"], curves, seconds)


def _network(task: Task, values: Mapping[str, Any], name: str) -> Network:
    sizes = (values[f"{name}_inputs"].shape[1], *task.layers, 1)
    layers = layers_of(values[f"{name}_w"], sizes)
    offset, gain = values[f"{name}_inputs"]
    output_offset, output_gain = (float(value) for value in values[f"{name}_output"])
    return Network(layers, offset, gain, output_offset, output_gain)


def prepared(
    recordings: Sequence[Recording], *, band: processing.Band | None, decimate: int, mass: float, fixed_force: bool
) -> tuple[Recording, ...]:
    """Recordings after ``processing.prepare``. fixed_force: keep a recorded R; else R is formed anew for each mass."""
    ready = []
    for recording in recordings:
        keep = fixed_force and recording.R is not None
        source = recording if keep else replace(recording, R=None)
        made = processing.prepare(source, band=band, decimate=decimate, mass=mass)
        ready.append(made if keep else replace(made, R=None))
    return tuple(ready)
