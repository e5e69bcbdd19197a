"""The batch entry of a compiled library: a table of inputs in, a table of outputs out."""

from __future__ import annotations

import ctypes
import logging
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hystid.errors import NumericalError
from hystid.numeric import Array

_VERSION, _HOLD, _LINEAR, _HERMITE = 1, 0, 1, 2  # as in hy_table.h
_OUTCOMES = {1: "found no answer", 2: "failed"}
_log = logging.getLogger("hystid")


class _Table(ctypes.Structure):
    """``hy_table`` of hy_table.h, field by field."""

    _fields_ = (
        ("version", ctypes.c_int),
        ("rows", ctypes.c_int),
        ("start_time", ctypes.c_double),
        ("dt", ctypes.c_double),
        ("substeps", ctypes.c_int),
        ("n_settings", ctypes.c_int),
        ("setting_slots", ctypes.c_void_p),
        ("settings", ctypes.c_void_p),
        ("n_columns", ctypes.c_int),
        ("column_slots", ctypes.c_void_p),
        ("column_modes", ctypes.c_void_p),
        ("samples", ctypes.c_void_p),
        ("slopes", ctypes.c_void_p),
        ("n_outputs", ctypes.c_int),
        ("output_slots", ctypes.c_void_p),
        ("outputs", ctypes.c_void_p),
        ("n_seeds", ctypes.c_int),
        ("seed_slots", ctypes.c_void_p),
        ("gradients", ctypes.c_void_p),
        ("failed_row", ctypes.c_int),
        ("failure", ctypes.c_char * 400),
        ("warning", ctypes.c_char * 400),
    )


@dataclass(frozen=True)
class GivenSignal:
    """One given signal: samples (n,) and how it runs between them; slopes (n,) [unit/s] make it a cubic Hermite."""

    slot: int
    samples: Array
    held: bool = False
    slopes: Array | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "samples", np.ascontiguousarray(self.samples, np.float64))
        if self.slopes is not None:
            object.__setattr__(self, "slopes", np.ascontiguousarray(self.slopes, np.float64))

    @cached_property
    def pointers(self) -> tuple[int, int]:
        """Addresses of samples and slopes, as long as the column lives."""
        first = _place(self.samples)
        return first, first if self.slopes is None else _place(self.slopes)


class GivenSignals(tuple[GivenSignal, ...]):
    """Given signals as the C side reads them; many runs share them."""

    @cached_property
    def _arrays(self) -> tuple[NDArray[Any], ...]:
        slots, modes = np.array([c.slot for c in self], np.intc), np.array([_mode(c) for c in self], np.intc)
        samples, slopes = np.array([c.pointers for c in self], np.uintp).reshape(-1, 2).T.copy()
        return slots, modes, samples, slopes

    @cached_property
    def addresses(self) -> tuple[int, ...]:
        """Addresses of slots, modes, samples and slopes, as long as these columns live."""
        return tuple(map(_place, self._arrays))


@dataclass(frozen=True)
class Settings:
    """What is set before the start: value references (k,) and the values there."""

    slots: NDArray[np.intc]
    values: Array

    @cached_property
    def addresses(self) -> tuple[int, int]:
        """Addresses of slots and values, as long as these settings live."""
        return _place(self.slots), _place(self.values)


@dataclass(frozen=True)
class Motion:
    """States that follow a motion, and inputs, as a model takes them; ``CompiledModel.motion`` makes one.

    dt: sample time [s]. substeps: Runge-Kutta steps per sample. start_time: of the first sample [s].
    """

    columns: GivenSignals = field(repr=False)
    rows: int
    dt: float
    substeps: int = 1
    start_time: float = 0.0


@dataclass(frozen=True)
class Run:
    """One table for the runner."""

    motion: Motion
    settings: Settings


@dataclass(frozen=True)
class Responses:
    """Outputs (n_outputs, rows) and, where seeds were asked for, gradients (n_outputs, n_seeds, rows).

    is_finite: whether every number of the call is; it says nothing where false.
    """

    outputs: Array
    gradients: Array
    is_finite: bool


class TableRunner:
    """The batch entry of a library that holds the shell, ours in this process or an FMU's."""

    def __init__(self, library: ctypes.CDLL, name: str) -> None:
        self._run = library.hy_run_table
        self._run.argtypes = [ctypes.POINTER(_Table)]
        self._run.restype = ctypes.c_int
        self._run_all = getattr(library, "hy_run_tables", None)  # an FMU has none
        if self._run_all is not None:
            self._run_all.argtypes = [ctypes.POINTER(_Table), ctypes.c_int, ctypes.POINTER(ctypes.c_int)]
            self._run_all.restype = None
        self._library = library
        self._name = name

    def run_all(self, runs: Sequence[Run], outputs: Sequence[int], seeds: Sequence[int] = ()) -> list[Responses]:
        """Run tables, side by side where the model integrates: half the time of one by one, and the same bits.

        outputs, seeds: value references. Raises NumericalError with the model's own words where a step fails or an
        output is not finite: that of the first table that fails.
        """
        wanted = _Wanted(runs, outputs, seeds)
        tables = wanted.tables()
        if self._run_all is None or len(runs) == 1:
            outcomes = [self._run(ctypes.byref(table)) for table in tables]
        else:
            codes = (ctypes.c_int * len(runs))()
            self._run_all(tables, len(runs), codes)
            outcomes = list(codes)
        for table, run, code in zip(tables, runs, outcomes, strict=True):
            if table.warning:
                _log.warning("%s: %s", self._name, table.warning.decode(errors="replace"))
            if code:
                time = run.motion.start_time + table.failed_row * run.motion.dt
                raise NumericalError(self._sentence(code, table, time))
        return wanted.outcomes()

    def _sentence(self, outcome: int, table: _Table, time: float) -> str:
        reason = table.failure.decode(errors="replace") or "its equations have no answer at these values"
        where = f"sample {table.failed_row} (t = {time:.9g} s)"
        return f"{self._name}: the model {_OUTCOMES.get(outcome, 'failed')} at {where}: {reason}"


def _mode(column: GivenSignal) -> int:
    return _HOLD if column.held else _LINEAR if column.slopes is None else _HERMITE


class _Wanted:
    """What is asked of the runs of one call. The C side reads and writes its arrays, which live as long as it does."""

    def __init__(self, runs: Sequence[Run], outputs: Sequence[int], seeds: Sequence[int]) -> None:
        self._runs = runs
        self._counts = len(outputs), len(seeds)
        self._slots = np.array(outputs, np.intc), np.array(seeds, np.intc)
        self._each = len(outputs) * (1 + len(seeds))
        self._block = np.empty(self._each * sum(run.motion.rows for run in runs))  # one run after another
        first, addresses = _place(self._block), []
        for run in runs:
            rows = run.motion.rows
            addresses += [first + 8 * i * rows for i in range(self._each)]  # of outputs, then of gradients
            first += 8 * self._each * rows
        self._rows = np.array(addresses, np.uintp)

    def outcomes(self) -> list[Responses]:
        """What the C side has written."""
        (n, seeds), first, found = self._counts, 0, []
        finite = bool(np.isfinite(np.add.reduce(self._block)))
        for run in self._runs:
            rows = run.motion.rows
            part = self._block[first : first + self._each * rows]
            gradients = part[n * rows :].reshape(n, seeds, rows)
            found.append(Responses(part[: n * rows].reshape(n, rows), gradients, finite))
            first += len(part)
        return found

    def tables(self) -> ctypes.Array[_Table]:
        """The runs as the C side takes them."""
        (n, seeds), made = self._counts, (_Table * len(self._runs))()
        first = _place(self._rows)
        wanted, carried = (_place(slots) for slots in self._slots)
        for i, (table, run) in enumerate(zip(made, self._runs, strict=True)):
            outputs, motion = first + 8 * i * self._each, run.motion
            table.version, table.rows, table.substeps = _VERSION, motion.rows, motion.substeps
            table.start_time, table.dt = motion.start_time, motion.dt
            table.n_settings = len(run.settings.slots)
            table.setting_slots, table.settings = run.settings.addresses
            table.n_columns = len(motion.columns)
            table.column_slots, table.column_modes, table.samples, table.slopes = motion.columns.addresses
            table.n_outputs, table.output_slots, table.outputs = n, wanted, outputs
            table.n_seeds, table.seed_slots, table.gradients = seeds, carried, outputs + 8 * n
        return made


def _place(array: NDArray[Any]) -> int:
    """Address of an array, in a third of the time that ``array.ctypes`` takes."""
    place: int = array.__array_interface__["data"][0]
    return place
