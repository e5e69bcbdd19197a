"""Replay the reference results that an FMU carries, and compare by a tolerance tube."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hystid.errors import FmuError, UsageError
from hystid.files import file_named
from hystid.fmu.compared import SignalResult, Tolerance, compared
from hystid.fmu.driver import Driver
from hystid.fmu.kept import Kept
from hystid.fmu.picture import difference_picture
from hystid.fmu.reference import cells_text, read_cells
from hystid.fmu.signals import Signal
from hystid.numeric import Array
from hystid.results import Result


@dataclass(frozen=True)
class RegressionResult(Result, report="regression", json="regression.json"):
    """What a replay showed. Signals in the order of the reference, arrays element by element.

    skipped: names in the reference that could not be compared; new: outputs that the reference does not have; unset:
    inputs that it does not give, which kept their start values; updated: whether the reference was written anew.
    """

    path: Path
    t: Array
    signals: tuple[SignalResult, ...]
    skipped: tuple[str, ...] = ()
    new: tuple[str, ...] = ()
    unset: tuple[str, ...] = ()
    updated: bool = False

    @property
    def passed(self) -> bool:
        """Whether something was compared and every signal agreed."""
        return self.updated or (bool(self.signals) and all(signal.tube.holds for signal in self.signals))

    def as_dict(self) -> dict[str, Any]:
        """Content of regression.json."""
        signals = [
            {"name": s.name, "unit": s.unit, "agrees": s.tube.holds, "outcome": s.text(self.t)} for s in self.signals
        ]
        kept = {"skipped": list(self.skipped), "new": list(self.new), "unset": list(self.unset)}
        return {"fmu": self.path.name, "passed": self.passed, "signals": signals, **kept, "updated": self.updated}

    def summary(self) -> str:
        """One line per signal, worst first where something failed."""
        lines = [
            f"{self.path.name}: {'reference updated' if self.updated else 'as before' if self.passed else 'differs'}"
        ]
        if not self.signals:
            lines = [f"{self.path.name}: nothing could be compared"]
        for signal in sorted(self.signals, key=lambda s: (s.tube.holds, -s.tube.worst)):
            lines.append(f"  {signal.name}: {signal.text(self.t)}")
        if self.skipped and not self.updated:
            lines.append(f"  not compared: {', '.join(self.skipped)} (clocks, or texts in model exchange)")
        if self.new and not self.updated:
            lines.append(f"  not compared, for the reference does not have them: {', '.join(self.new)}")
        if self.unset:
            lines.append(f"  at their start values, for the reference gives no input: {', '.join(self.unset)}")
        return "\n".join(lines)

    def picture(self) -> str:
        """SVG of reference, tube and new values; the signals that left the tube first."""
        return difference_picture(self.path.name, self.t, self.signals)


def regress(
    path: str | os.PathLike[str],
    *,
    update: bool = False,
    relative: float = 1e-3,
    samples: int = 1,
    reference: Path | None = None,
) -> RegressionResult:
    """Simulate an FMU with the input of its reference and compare with the result of its reference.

    The reference lies in the FMU (``extra/org.fmi-standard.fmi-ls-ref``) or beside it as ``<file>_out.csv`` (and
    ``<file>_in.csv``); reference: another FMU that carries one, a folder that holds such tables or the FMU of the same
    name, or a table. Without a table of inputs, columns of the result that are inputs drive the FMU.
    Everything else that the reference has is compared. Real numbers stay in a tube: half height relative * range of the
    signal, half width ``samples`` rows. Integers, enumerations, truth values, texts and binary data must be those of
    one of these rows. update: write the new result in place of the old.
    Raises FmuError where there is nothing to compare with, UsageError where it cannot be updated.

    >>> import hystid
    >>> fmu = hystid.build("HystId.Oscillators.Jenkins", "jenkins.fmu")
    >>> hystid.regress(fmu).passed
    True
    """
    path = file_named(path, "an FMU")
    driver = Driver(path)
    kept = Kept.of(path, Path(reference) if reference is not None else None)
    if update and kept.entry and kept.place != path:
        raise UsageError(f"--update would change {kept.place}, which is another FMU; update a table or the FMU itself")
    rows = _Table.of(kept.place, driver, kept.result)
    t, first, back = np.unique(rows.t, return_index=True, return_inverse=True)  # rows around an event have one time
    drive = _inputs(path, driver, kept, t)
    driving: set[str] = set()  # columns of the result that drive the FMU, which are no answer of it
    if not kept.input:
        drive = {name: rows.columns[name][first] for name in rows.names if driver.signals[name].causality == "input"}
        driving = set(drive)
    results = {name: values[back] for name, values in _replay(driver, t, drive, rows.names)}
    tolerance = Tolerance(relative, samples)
    signals = tuple(
        result
        for name in rows.names
        if name not in driving
        for result in compared(driver.signals[name], results[name], rows.columns[name], tolerance)
    )
    if update:
        if rows.skipped:
            raise FmuError(f"{path.name}: '{rows.skipped[0]}' of its reference cannot be written anew")
        cells = {name: driver.signals[name].written(results[name]) for name in rows.names}
        kept.replaced(cells_text(rows.t, cells))
    named = {*rows.names, *rows.skipped}
    new = tuple(s.name for s in driver.signals.values() if s.causality == "output" and s.name not in named)
    unset = tuple(s.name for s in driver.signals.values() if s.causality == "input" and s.name not in drive)
    return RegressionResult(path, rows.t, signals, rows.skipped, new, unset, updated=update)


@dataclass(frozen=True)
class _Table:
    """A reference: times (n,), not falling, and name -> values."""

    t: Array
    columns: Mapping[str, NDArray[Any]]
    skipped: tuple[str, ...]

    @property
    def names(self) -> list[str]:
        return list(self.columns)

    @staticmethod
    def of(place: Path, driver: Driver, text: str) -> _Table:
        try:
            t, cells = read_cells(text)
            unknown = [name for name in cells if not driver.lists(name)]
            if unknown:
                raise FmuError(f"{place.name}: the reference names '{unknown[0]}', which is no variable of the FMU")
            usable = {name: driver.signals[name] for name in cells if _can_be_read(driver, name)}
            columns = {name: signal.parsed(cells[name]) for name, signal in usable.items()}
        except ValueError as error:
            raise FmuError(f"{place.name}: the reference results cannot be read: {error}") from None
        return _Table(t, columns, tuple(name for name in cells if name not in usable))


def _can_be_read(driver: Driver, name: str) -> bool:
    return name in driver.signals and (driver.reads_texts or not driver.signals[name].is_text)


def _replay(
    driver: Driver, t: Array, inputs: Mapping[str, NDArray[Any]], names: Sequence[str]
) -> list[tuple[str, NDArray[Any]]]:
    if not names:
        return []
    found: Mapping[str, NDArray[Any]]
    if driver.is_own:
        found = driver.simulate(t, inputs, outputs=names)
        return [(name, _as_type(driver.signals[name], values)) for name, values in found.items()]
    return list(driver.record(t, inputs, outputs=names).items())


def _as_type(signal: Signal, values: Array) -> NDArray[Any]:
    return values if signal.is_real else np.rint(values).astype(signal.dtype)


def _inputs(path: Path, driver: Driver, kept: Kept, t: Array) -> dict[str, NDArray[Any]]:
    """Inputs at the times t: where their table has other times, continuous ones run straight, others are held."""
    if not kept.input:
        return {}
    try:
        given, cells = read_cells(kept.input)
        for name in cells:
            if name not in driver.signals:
                raise FmuError(f"{path.name}: its reference gives an input '{name}', which the FMU does not have")
        table = {name: (driver.signals[name], driver.signals[name].parsed(rows)) for name, rows in cells.items()}
    except ValueError as error:
        raise FmuError(f"{path.name}: the input of its reference cannot be read: {error}") from None
    if np.array_equal(given, t):
        return {name: values for name, (_, values) in table.items()}
    return {name: signal.resampled(t, given, values) for name, (signal, values) in table.items()}
