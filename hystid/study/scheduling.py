"""Running the tasks of a study: those without a file yet, side by side here or on a Dask cluster."""

from __future__ import annotations

import threading
import warnings
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from hystid.errors import NumericalError, UsageError
from hystid.networks.ensemble import side_by_side
from hystid.progress import track
from hystid.study.work import Payload, Task, TrainingResult, load, run, save


def complete(
    payload: Payload, tasks: Sequence[Task], folder: Path, *, workers: int | None = None, scheduler: str | None = None
) -> list[TrainingResult]:
    """Outcomes of all tasks, in their order. Each is stored in ``folder`` as soon as it is there.

    A stored outcome is not computed again, so a killed study resumes. The outcome of a task depends on payload and task
    alone. Ctrl-C: KeyboardInterrupt after the finished ones were stored.
    Raises NumericalError where one left no outcome.
    """
    folder.mkdir(parents=True, exist_ok=True)
    missing = [task for task in tasks if load(task, folder) is None]
    if missing and scheduler:
        _on_cluster(payload, missing, folder, scheduler)
    elif missing:
        _here(payload, missing, folder, workers)
    outcomes = [load(task, folder) for task in tasks]
    lost = [task.name for task, outcome in zip(tasks, outcomes, strict=True) if outcome is None]
    if lost:
        raise NumericalError(f"{len(lost)} trainings of the study have no result, the first is {lost[0]}; run it again")
    return [outcome for outcome in outcomes if outcome is not None]


def _here(payload: Payload, tasks: Sequence[Task], folder: Path, workers: int | None) -> None:
    def job(task: Task) -> Callable[[threading.Event], None]:
        def work(stop: threading.Event) -> None:
            if not stop.is_set():
                save(run(payload, task), folder)

        return work

    _, whole = side_by_side("trainings", [job(task) for task in tasks], workers)
    if not whole:
        raise KeyboardInterrupt


def _on_cluster(payload: Payload, tasks: Sequence[Task], folder: Path, address: str) -> None:
    """Send the tasks to a Dask scheduler. Workers need hystid, but no common file system: results come back here.

    A task whose worker is lost is given to another one.
    """
    distributed = _dask()
    try:
        client = distributed.Client(address, timeout=10)
    except (OSError, ValueError) as error:
        raise UsageError(f"no Dask scheduler answers at {address}: start one with 'dask scheduler' ({error})") from None
    with client, track("trainings", len(tasks)) as step:
        with warnings.catch_warnings():
            # The recordings go to the scheduler once, as a task of their own: data that were only scattered to workers
            # would be lost with them. Dask would rather have them read from files that all machines share.
            warnings.filterwarnings("ignore", "Sending large graph", UserWarning)
            everywhere = client.submit(_same, payload, pure=False)
        futures = [client.submit(run, everywhere, task, pure=False, retries=2) for task in tasks]
        for future in distributed.as_completed(futures):
            save(future.result(), folder)
            future.release()
            step()


def _same(payload: Payload) -> Payload:
    return payload


def _dask() -> Any:
    try:
        import distributed
    except ImportError:
        raise UsageError("a study on a cluster needs Dask: install hystid[cluster]") from None
    return distributed
