"""Replay the reference results that an FMU carries, and compare by a tolerance tube."""

from __future__ import annotations

import zipfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from xml.etree import ElementTree as ET

import numpy as np
from numpy.typing import NDArray

from hystid.comparison import Tube, tube
from hystid.errors import FmuError
from hystid.fmu.build import write_zip
from hystid.fmu.driver import Driver
from hystid.fmu.picture import difference_picture
from hystid.fmu.reference import FOLDER, INPUT_ROLE, RESULT_ROLE, read_table, table_text

Array = NDArray[np.float64]


@dataclass(frozen=True)
class SignalResult:
    """One signal: new values (n,) beside the reference (n,), and the tube around the latter."""

    name: str
    values: Array
    reference: Array
    tube: Tube

    @property
    def first_outside(self) -> int | None:
        """First sample outside the tube, None where all are inside."""
        return int(np.argmax(self.tube.outside)) if np.any(self.tube.outside) else None


@dataclass(frozen=True)
class RegressionResult:
    """What a replay showed. Signals in the order of the reference; skipped: names in the reference that were not
    compared; updated: whether the reference was written anew."""

    path: Path
    t: Array
    signals: tuple[SignalResult, ...]
    skipped: tuple[str, ...] = ()
    updated: bool = False

    @property
    def passed(self) -> bool:
        """Whether every continuous signal stayed in its tube."""
        return self.updated or all(signal.tube.holds for signal in self.signals)

    def text(self) -> str:
        """One line per signal, worst first where something failed."""
        lines = [
            f"{self.path.name}: {'reference updated' if self.updated else 'as before' if self.passed else 'differs'}"
        ]
        for signal in sorted(self.signals, key=lambda s: -s.tube.worst):
            first = signal.first_outside
            state = "within the tube"
            if first is not None:
                state = f"leaves the tube at t = {self.t[first]:.6g} s, by up to {signal.tube.worst:.3g}"
            lines.append(f"  {signal.name}: {state}")
        if self.skipped and not self.updated:
            lines.append(f"  not compared, being discrete or no plain numbers: {', '.join(self.skipped)}")
        return "\n".join(lines)

    def picture(self) -> str:
        """SVG of reference, tube and new values; the signals that left the tube first."""
        return difference_picture(self)


def regress(path: Path, *, update: bool = False, relative: float = 1e-3, samples: int = 1) -> RegressionResult:
    """Simulate an FMU with the input that it carries and compare with the result that it carries.

    The reference lies in the FMU (``extra/org.fmi-standard.fmi-ls-ref``) or beside it as ``<file>_out.csv`` (and
    ``<file>_in.csv``). Tube: half height relative * range of the signal, half width ``samples`` rows; discrete signals
    are compared only where there are no others: tools may order simultaneous events differently without being wrong.
    update: write the new result in place of the old. Raises FmuError where there is nothing to compare with.
    """
    path = Path(path)
    driver = Driver(path)
    kept = _Kept.of(path)
    t, columns = _table(path, kept.result_text)
    reference = {name: values for name, values in columns.items() if values is not None}
    inputs = _inputs(path, kept.input_text)
    known = {v.name: v for v in driver.model.variables}
    unknown = [name for name in columns if not driver.lists(name)]
    if unknown:
        raise FmuError(f"{path.name}: its reference names '{unknown[0]}', which is no variable of the FMU")
    for name in known.keys() & (columns.keys() - reference.keys()):
        raise FmuError(f"{path.name}: its reference results cannot be read: the column '{name}' holds no numbers")
    usable = [name for name in reference if name in known]
    names = [name for name in usable if known[name].variability == "continuous"] or usable
    if not names:
        raise FmuError(f"{path.name}: its reference holds no numbers that could be compared ({', '.join(columns)})")
    skipped = tuple(name for name in columns if name not in names)
    if update:
        names = list(columns)
        if len(usable) < len(columns):
            raise FmuError(f"{path.name}: its reference holds texts or arrays, which cannot be written anew")
    results = driver.simulate(t, inputs, outputs=names)
    signals = tuple(
        SignalResult(name, results[name], reference[name], _tube(results[name], reference[name], relative, samples))
        for name in names
    )
    if update:
        kept.replace(path, table_text(t, results))
    return RegressionResult(path, t, signals, skipped, updated=update)


def _inputs(path: Path, text: str) -> dict[str, Array]:
    found = _table(path, text)[1] if text else {}
    for name, values in found.items():
        if values is None:
            raise FmuError(f"{path.name}: the input '{name}' that it carries holds texts or arrays")
    return {name: values for name, values in found.items() if values is not None}


def _tube(values: Array, reference: Array, relative: float, samples: int) -> Tube:
    rounding = 1e-12 * float(np.max(np.abs(reference), initial=0.0))  # a constant signal has no range
    return tube(values, reference, relative=relative, absolute=rounding, samples=samples)


@dataclass(frozen=True)
class _Kept:
    """Where the reference is kept: the entry inside the zip file, or the file beside it."""

    result_name: str
    result_text: str
    input_text: str
    inside: bool

    @staticmethod
    def of(path: Path) -> _Kept:
        beside = path.with_name(f"{path.stem}_out.csv")
        if beside.is_file():
            stimulus = path.with_name(f"{path.stem}_in.csv")
            return _Kept(str(beside), beside.read_text(), stimulus.read_text() if stimulus.is_file() else "", False)
        with zipfile.ZipFile(path) as archive:
            names = set(archive.namelist())
            if f"{FOLDER}/fmi-ls-manifest.xml" not in names:
                raise FmuError(f"{path.name}: it carries no reference results, and {beside.name} is not beside it")
            related = _related(path, archive.read(f"{FOLDER}/fmi-ls-manifest.xml"))
            result = next((n for role, n in related if role == RESULT_ROLE and n in names), None)
            if result is None:
                raise FmuError(f"{path.name}: the manifest of its reference results names no result that is there")
            stimulus_name = next((n for role, n in related if role == INPUT_ROLE and n in names), None)
            stimulus_text = archive.read(stimulus_name).decode() if stimulus_name else ""
            return _Kept(result, archive.read(result).decode(), stimulus_text, True)

    def replace(self, path: Path, text: str) -> None:
        """Write a new result table."""
        if not self.inside:
            Path(self.result_name).write_text(text)
            return
        with zipfile.ZipFile(path) as archive:
            content = {name: archive.read(name) for name in archive.namelist() if not name.endswith("/")}
        write_zip(path, {**content, self.result_name: text.encode()})


def _related(path: Path, manifest: bytes) -> list[tuple[str, str]]:
    try:
        root = ET.fromstring(manifest)
    except ET.ParseError as error:
        raise FmuError(f"{path.name}: the manifest of its reference results is not well-formed: {error}") from None
    found = [(e.get("role", ""), e.get("source", "")) for e in root.iter("Related") if e.get("type") == "text/csv"]
    return [(role, str(PurePosixPath(FOLDER, source))) for role, source in found]


def _table(path: Path, text: str) -> tuple[Array, Mapping[str, Array | None]]:
    try:
        return read_table(text)
    except ValueError as error:
        raise FmuError(f"{path.name}: its reference results cannot be read: {error}") from None
