"""``grid`` and ``mass``: the reference study of structures, and how a wrong mass shows."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np

from hystid import processing
from hystid.consistency import admit
from hystid.errors import UsageError
from hystid.files import plain, write_json
from hystid.identification.data import check, check_counts
from hystid.leastsquares import Rule
from hystid.networks.normal_equations import Precision
from hystid.networks.training import Mode, rule_of
from hystid.recording import CHANNELS, Recording, Sources, check_together, loaded
from hystid.study.cells import GridCell, GridResult, MassResult, Quartiles, choose
from hystid.study.scheduling import complete
from hystid.study.work import Payload, Task, TrainingResult, errors_of, model_of, prepared

DEFAULT_SIZES = (2, 5, 8, 10, 13)
DEFAULT_STRUCTURES = tuple((size,) * depth for depth in (1, 2, 3) for size in DEFAULT_SIZES)
DEFAULT_OFFSETS = tuple(round(0.05 * k, 2) for k in range(-4, 5))


def grid(
    recordings: Sources,
    *,
    mass: float,
    holdout: Sources,
    structures: Sequence[Sequence[int]] = DEFAULT_STRUCTURES,
    starts: int = 30,
    iterations: int = 80,
    band: processing.Band | None = None,
    decimate: int = 1,
    seed: int = 0,
    mode: Mode = "fast",
    precision: Precision = "float64",
    samples: int = 50_000,
    workers: int | None = None,
    scheduler: str | None = None,
    out: Path,
) -> GridResult:
    """Train many starts of each structure by the published method and test each on held-out recordings.

    structures: hidden layers of both networks, by default 1, 2, 3 layers of 2, 5, 8, 10, 13 neurons. starts: pairs of
    networks per structure. iterations: at most so many in each training. scheduler: address of a Dask scheduler.
    out: folder; every finished training is stored there at once, and the same call on the same folder goes on where an
    earlier one was stopped, with the same result. study.json comes last. Further arguments: as for ``identify``.
    Raises UsageError where the folder holds another study, or without held-out recordings; RecordingError.

    >>> import hystid
    >>> fmu = hystid.build("HystId.Oscillators.Jenkins", "jenkins.fmu")
    >>> sweep = hystid.simulate(fmu, "chirp:0-60Hz@60N,2s", dt=1e-3, noise_snr=40)
    >>> tone = hystid.simulate(fmu, "harmonic:20Hz@60N,1s", dt=1e-3, noise_snr=40)
    >>> few = dict(starts=2, iterations=10, workers=1)
    >>> found = hystid.study.grid(sweep, mass=1.0, holdout=tone, structures=[(2,), (5,)], out="grid", **few)
    >>> [cell.name for cell in found.cells]
    ['2', '5']
    """
    if not (np.isfinite(mass) and mass >= 0):
        raise UsageError(f"mass must be a number of at least 0 kg, found {mass}")
    check_counts(starts, samples, seed, workers, "starts")
    layers = [tuple(int(neurons) for neurons in structure) for structure in structures]
    groups = _prepared(recordings, holdout, mass, band, decimate, fixed_force=True)
    payload = Payload(*groups, _rule(mode, iterations), precision, samples, seed)
    tasks = [Task(structure, start, float(mass)) for structure in layers for start in range(starts)]
    settings = {"kind": "grid", "mass": mass, "structures": layers, "starts": starts}
    cells = _cells(payload, tasks, settings, Path(out), starts, workers, scheduler)
    chosen, reason = choose(cells)
    result = GridResult(cells, chosen, reason, settings, {"study": Path(out) / "study.json"})
    write_json(result.files["study"], result.as_dict())
    return result


def mass(
    recordings: Sources,
    *,
    mass: float,
    holdout: Sources,
    offsets: Sequence[float] = DEFAULT_OFFSETS,
    sizes: Sequence[int] = DEFAULT_SIZES,
    starts: int = 30,
    iterations: int = 80,
    band: processing.Band | None = None,
    decimate: int = 1,
    seed: int = 0,
    mode: Mode = "fast",
    precision: Precision = "float64",
    samples: int = 50_000,
    workers: int | None = None,
    scheduler: str | None = None,
    out: Path,
) -> MassResult:
    """How much an error of the weighed mass costs: two hidden layers, R = F - m a with m off by ``offsets``.

    offsets: fractions of the mass, by default -20 % to +20 % in steps of 5 %. sizes: neurons of both hidden layers.
    Training and free run use the assumed mass; the displacement is compared with the recorded one, the force with
    F - m a of the assumed mass; a recorded R is not used. Further arguments and errors: as for ``grid``.

    >>> import hystid
    >>> fmu = hystid.build("HystId.Oscillators.Jenkins", "jenkins.fmu")
    >>> sweep = hystid.simulate(fmu, "chirp:0-60Hz@60N,2s", dt=1e-3, noise_snr=40)
    >>> tone = hystid.simulate(fmu, "harmonic:20Hz@60N,1s", dt=1e-3, noise_snr=40)
    >>> few = dict(starts=2, iterations=10, workers=1)
    >>> found = hystid.study.mass(sweep, mass=1.0, holdout=tone, offsets=(-0.1, 0, 0.1), sizes=(2,), out="mass", **few)
    >>> [round(cell.mass, 2) for cell in found.cells]
    [0.9, 1.0, 1.1]
    """
    if not 0 < mass < np.inf:
        raise UsageError(f"a study of the mass needs a mass above 0 kg, found {mass}")
    check_counts(starts, samples, seed, workers, "starts")
    groups = _prepared(recordings, holdout, mass, band, decimate, fixed_force=False)
    payload = Payload(*groups, _rule(mode, iterations), precision, samples, seed)
    masses = [float(mass * (1 + offset)) for offset in offsets]
    tasks = [Task((size, size), start, m) for size in sizes for m in masses for start in range(starts)]
    settings = {"kind": "mass", "mass": mass, "offsets": list(offsets), "sizes": list(sizes), "starts": starts}
    cells = _cells(payload, tasks, settings, Path(out), starts, workers, scheduler)
    result = MassResult(cells, float(mass), tuple(offsets), settings, {"study": Path(out) / "study.json"})
    write_json(result.files["study"], result.as_dict())
    return result


def _prepared(
    recordings: Sources,
    holdout: Sources,
    mass: float,
    band: processing.Band | None,
    decimate: int,
    *,
    fixed_force: bool,
) -> tuple[tuple[Recording, ...], tuple[Recording, ...]]:
    """The recordings to train on and those held out."""
    if not holdout:
        raise UsageError("a study tests on held-out recordings: name at least one with --holdout")
    read = loaded(recordings), loaded(holdout)
    check_together(*read)
    used, held = (
        prepared(admit(group, mass), band=band, decimate=decimate, mass=mass, fixed_force=fixed_force) for group in read
    )
    check(*([processing.with_restoring_force(recording, mass) for recording in group] for group in (used, held)))
    return used, held


def _rule(mode: Mode, iterations: int) -> Rule:
    if iterations < 1:
        raise UsageError(f"iterations must be at least 1, found {iterations}")
    return replace(rule_of(mode), max_iterations=iterations)


def _cells(
    payload: Payload,
    tasks: Sequence[Task],
    settings: Mapping[str, Any],
    out: Path,
    starts: int,
    workers: int | None,
    scheduler: str | None,
) -> list[GridCell]:
    """A cell for each so many starts, in the order of the tasks."""
    _claim(out, {**settings, "data": _fingerprint(payload)})
    outcomes = complete(payload, tasks, out / "trainings", workers=workers, scheduler=scheduler)
    return [_cell(outcomes[k : k + starts], payload) for k in range(0, len(outcomes), starts)]


def _claim(out: Path, identity: Mapping[str, Any]) -> None:
    """Write what the folder's study is, or make sure that it is the same."""
    path, text = out / "settings.json", json.dumps(plain(dict(identity)), sort_keys=True)
    if path.exists():
        try:
            stored = json.dumps(json.loads(path.read_text(encoding="utf-8")), sort_keys=True)
        except ValueError:
            stored = ""
        if stored != text:
            raise UsageError(f"{out} holds a study of other recordings or settings; choose another folder or delete it")
    else:
        write_json(path, identity)


def _fingerprint(payload: Payload) -> str:
    """Hash of everything that an outcome depends on besides its task."""
    digest = hashlib.sha256()
    rest = {**asdict(payload.rule), "precision": payload.precision, "samples": payload.samples, "seed": payload.seed}
    digest.update(json.dumps(rest, sort_keys=True).encode())
    for recording in (*payload.training, *payload.holdout):
        digest.update(recording.name.encode())
        for name in CHANNELS:
            values = getattr(recording, name)
            digest.update(b"-" if values is None else np.ascontiguousarray(values).tobytes())
    return digest.hexdigest()[:32]


def _cell(outcomes: Sequence[TrainingResult], payload: Payload) -> GridCell:
    task = outcomes[0].task
    ranked = sorted(outcomes, key=lambda outcome: outcome.validation)
    tenth = ranked[: max(1, round(len(ranked) / 10))]
    model = model_of([outcome.member for outcome in tenth], task.mass, payload)
    averaged = errors_of(model, payload.tested(task.mass))
    return GridCell(
        task.layers,
        task.mass,
        outcomes,
        Quartiles.of([outcome.force for outcome in outcomes]),
        Quartiles.of([outcome.free_run for outcome in outcomes]),
        {key: float(np.median([error[key] for error in averaged])) for key in ("force_nrmse", "x_nrmse")},
        {"force_nrmse": ranked[0].force, "x_nrmse": ranked[0].free_run},
    )
