"""Libraries of others run in a process of their own: a crash, a hang or a leak over there is one sentence here.

An FMU whose library was built here, by this user, is trusted and runs in this process. What tells it is the hash of the
library, not what the FMU says about itself.
"""

from __future__ import annotations

import weakref
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hystid import cache
from hystid.child import Child, ChildError, is_child
from hystid.errors import FmuError
from hystid.fmu.door import OpenedFmu

_ROWS = 10_000  # a second of these from any model: a run gets so much more time as it is longer
_running: dict[str, Foreign] = {}


def runs_here(fmu: OpenedFmu) -> bool:
    """Whether the FMU's libraries may be loaded into this process: they were built here, or this process is for it."""
    kinds = [kind for kind in (fmu.co_simulation, fmu.model_exchange) if kind is not None]
    return is_child() or all(cache.holds(kind.library.read_bytes(), kind.library.suffix) for kind in kinds)


class Foreign:
    """An FMU over there. Calls are those of ``hystid.fmu.worker``."""

    def __init__(self, fmu: OpenedFmu) -> None:
        self._child = Child(fmu.folder)
        self._name = fmu.name
        self._where = {"path": str(fmu.path), "folder": str(fmu.folder)}

    @staticmethod
    def of(fmu: OpenedFmu) -> Foreign:
        """The process of an FMU: one as long as the FMU is open."""
        key = str(fmu.folder)
        if key not in _running:
            _running[key] = Foreign(fmu)
            weakref.finalize(fmu, _running.pop, key, None)
        return _running[key]

    def has_batch_entry(self) -> bool:
        """Whether the library offers our batch entry. Raises FmuError where it cannot be loaded."""
        return bool(self._ask("has_batch_entry", 0))

    def table(self, call: str, rows: int, names: Iterable[str] | None, **arguments: Any) -> dict[str, NDArray[Any]]:
        """name -> values (rows,) or (rows, size) from a call. names: which must come, None where the FMU decides."""
        found = self._ask(call, rows, **arguments)
        known = isinstance(found, Mapping) and all(
            isinstance(values, np.ndarray) and values.shape[:1] == (rows,) for values in found.values()
        )
        if not known or (names is not None and list(found) != list(names)):
            raise FmuError(f"{self._name}: its process answered what was not asked")
        return dict(found)

    def _ask(self, call: str, rows: int, **arguments: Any) -> Any:
        try:
            return self._child.ask(f"hystid.fmu.worker:{call}", 1.0 + rows / _ROWS, **self._where, **arguments)
        except ChildError as fate:
            raise FmuError(f"{self._name}: its library {fate}") from None
