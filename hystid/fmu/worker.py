"""What a process that runs a foreign FMU is asked: the calls of ``Driver`` with the FMU unpacked already."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from hystid.fmu.coupling import simulate_with_effects
from hystid.fmu.door import opened_from
from hystid.fmu.driver import Driver

Table = dict[str, NDArray[Any]]


@lru_cache(maxsize=4)
def _driver(path: str, folder: str) -> Driver:
    return Driver(path, unpacked=Path(folder))


def has_batch_entry(path: str, folder: str) -> bool:
    """Load the library; whether it has our batch entry."""
    return _driver(path, folder).is_own


def simulate(path: str, folder: str, **arguments: Any) -> Table:
    """``Driver.simulate``."""
    return dict(_driver(path, folder).simulate(**arguments))


def record(path: str, folder: str, **arguments: Any) -> Table:
    """``Driver.record``."""
    return _driver(path, folder).record(**arguments)


def clamp(path: str, folder: str, **arguments: Any) -> Table:
    """``Driver.clamp``."""
    return dict(_driver(path, folder).clamp(**arguments))


def coupled(path: str, folder: str, effects: str | None, **arguments: Any) -> Table:
    """``simulate_with_effects``. effects: folder of the second FMU, unpacked."""
    rig = opened_from(Path(path), Path(folder))
    beside = None if effects is None else opened_from(Path("effects.fmu"), Path(effects))
    return {"x": simulate_with_effects(rig, beside, **arguments)}
