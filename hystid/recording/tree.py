"""Nested containers (MATLAB structs, HDF5 groups) to tables.

A container that holds vectors of one length under names that hystid knows is one test; containers inside containers are
searched, so that a struct array or one group per test gives one table each. The unit of a vector is looked for, in this
order: an attribute of the vector itself, ``units.<name>``, ``<name>_unit``, and the end of the name (``x_mm``,
``F_kN``). A scalar ``fs`` or ``sample_rate`` [Hz] or ``dt`` [s] stands in for a time vector.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from hystid.errors import RecordingError, UsageError, printable
from hystid.numeric import Array
from hystid.recording.names import known_name, meant, scales, shifts, split_header
from hystid.recording.problems import RecordingProblem
from hystid.recording.table import Column, RawTable
from hystid.units import parse

_RATES = ("fs", "sample_rate", "samplerate", "samplingrate", "sampling_rate", "samplefrequency")
_STEPS = ("dt", "delta_t", "sample_time")


@dataclass(frozen=True)
class Vector:
    """A vector with the unit that the format itself attaches to it.

    values: shape (n,). counts: stored as whole numbers.
    """

    values: Array
    unit: str | None = None
    counts: bool = False


def tables_of(tree: Any, file: str, name: str) -> list[RawTable]:
    """Every test in a tree of mappings, sequences, ``Vector``, arrays, numbers and texts.

    Where no name is known, vectors of one length that stand together are taken, for a user may say what they hold.
    """
    found = _tables(tree, file, name, known=True) or _tables(tree, file, name, known=False)
    if not found:
        _refuse_matrices(tree, file)
    return found


def _tables(tree: Any, file: str, name: str, *, known: bool) -> list[RawTable]:
    if isinstance(tree, Sequence) and not isinstance(tree, str | bytes):
        many = len(tree) > 1
        parts = [
            _tables(item, file, f"{name}-{k}" if many else name, known=known) for k, item in enumerate(tree, start=1)
        ]
        return [table for part in parts for table in part]
    if not isinstance(tree, Mapping):
        return []
    table = _table(tree, file, name) if known else _unnamed(tree, file, name)
    if table is not None:
        return [table]
    inner = {key: item for key, item in tree.items() if isinstance(item, Mapping | list | tuple) and key != "units"}
    names = {key: key if len(inner) > 1 else name for key in inner}
    return [t for key, item in inner.items() for t in _tables(item, file, names[key], known=known)]


def _table(tree: Mapping[str, Any], file: str, name: str) -> RawTable | None:
    vectors = {key: vector for key, item in tree.items() if (vector := _vector(item)) is not None}
    columns = [_column(key, vector, tree) for key, vector in vectors.items()]
    known = [column for column in columns if meant(column.name, column.unit)]
    rate = _rate(tree)
    if len(known) < 2 and not (known and rate):
        return None
    _refuse_scales(tree, file)
    if any(column.unit is None for column in known):
        _refuse_listed_units(tree, file)
    _refuse_tables(tree, vectors, {known_name(column.name) for column in known}, file)
    longest = max(column.values.size for column in known)
    kept = tuple(column for column in columns if column in known or column.values.size == longest)
    return RawTable(file, kept, name, sample_rate=rate)


def _unnamed(tree: Mapping[str, Any], file: str, name: str) -> RawTable | None:
    columns = [_column(key, vector, tree) for key, item in tree.items() if (vector := _vector(item)) is not None]
    sizes = [column.values.size for column in columns]
    usual = max(sizes, key=lambda size: (sizes.count(size), size), default=0)
    kept = tuple(column for column in columns if column.values.size == usual)
    return RawTable(file, kept, name, sample_rate=_rate(tree)) if len(kept) > 1 else None


def _vector(item: Any) -> Vector | None:
    if isinstance(item, Vector):
        return item if item.values.size > 1 else None
    if not isinstance(item, np.ndarray) or item.dtype.kind not in "fiub" or item.size < 2:
        return None
    values = np.asarray(item, dtype=np.float64).ravel()
    return Vector(values, counts=item.dtype.kind in "iu") if max(item.shape) == item.size else None


def _column(key: str, vector: Vector, tree: Mapping[str, Any]) -> Column:
    name, unit = split_header(key)
    stated = vector.unit or unit or _text(_units(tree).get(key)) or _text(tree.get(f"{key}_unit"))
    if stated:
        return Column(name, stated, vector.values, vector.counts)
    head, _, tail = name.rpartition("_")
    if head and known_name(head) and not known_name(name) and _is_unit(tail):
        return Column(head, tail, vector.values, vector.counts)
    return Column(name, None, vector.values, vector.counts)


def refuse_scale(file: str, name: str, scale: str, value: object) -> None:
    """Raise RecordingError where a factor stands beside a channel: nobody knows whether it has been applied."""
    factor = _scalar(value)
    neutral = (None, 0.0) if shifts(scale) else (None, 0.0, 1.0)
    if known_name(split_header(name)[0]) and (scales(scale) or shifts(scale)) and factor not in neutral:
        found = f"{scale} = {factor:g} stands beside {name}, and is not applied"
        action = f"write {name} in its unit and leave {scale} out"
        raise RecordingError(str(RecordingProblem(file, "columns", found, action, name)))


def _refuse_scales(tree: Mapping[str, Any], file: str) -> None:
    for key, item in tree.items():
        if (scales(key) or shifts(key)) and isinstance(item, Mapping):  # scale.F
            for name, value in item.items():
                refuse_scale(file, name, key, value)
        head, _, tail = key.partition("_")  # F_scale
        if head in tree:
            refuse_scale(file, head, tail, item)


def _refuse_listed_units(tree: Mapping[str, Any], file: str) -> None:
    units = tree.get("units", tree.get("unit"))
    if isinstance(units, Sequence | np.ndarray) and not isinstance(units, str) and len(units):
        told = ", ".join(printable(str(unit), 20) for unit in units[:6])
        found = f"units is a list ({told}), which does not say of which channel each is"
        raise RecordingError(str(RecordingProblem(file, "columns", found, "write units.F = 'N' for each channel")))


def _refuse_matrices(tree: Any, file: str) -> None:
    """Of a tree without a test: say where a channel is no vector."""
    if isinstance(tree, Mapping):
        _refuse_tables(tree, (), (), file)
    inner = tree.values() if isinstance(tree, Mapping) else tree if isinstance(tree, list | tuple) else ()
    for item in inner:
        _refuse_matrices(item, file)


def _refuse_tables(tree: Mapping[str, Any], vectors: Collection[str], found: Collection[str | None], file: str) -> None:
    """Channels that no vector holds, and that a table or complex numbers are called by."""
    for key, item in tree.items():
        name = split_header(key)[0]
        if key in vectors or not isinstance(item, np.ndarray) or item.size < 2 or known_name(name) in (None, *found):
            continue
        shape = " by ".join(map(str, item.shape))
        what = {"c": "complex numbers", "S": "texts", "U": "texts", "O": "texts"}.get(
            item.dtype.kind, f"{shape} numbers"
        )
        action = "save the measured values as one vector for each channel"
        raise RecordingError(
            str(RecordingProblem(file, "columns", f"{key} holds {what}", action, known_name(name) or ""))
        )


def _is_unit(text: str) -> bool:
    try:
        parse(text)
    except UsageError:
        return False
    return True


def _units(tree: Mapping[str, Any]) -> Mapping[str, Any]:
    units = tree.get("units", tree.get("unit"))
    return units if isinstance(units, Mapping) else {}


def _text(value: Any) -> str | None:
    return value.strip() if isinstance(value, str) and value.strip() else None


def _rate(tree: Mapping[str, Any]) -> float | None:
    numbers = {key.lower(): value for key, item in tree.items() if (value := _scalar(item)) is not None}
    for key in _RATES:
        if numbers.get(key, 0.0) > 0:
            return numbers[key]
    steps = [numbers[key] for key in _STEPS if numbers.get(key, 0.0) > 0]
    return 1 / steps[0] if steps else None


def _scalar(item: Any) -> float | None:
    if isinstance(item, Vector):
        item = item.values
    if isinstance(item, bool | str | bytes) or not isinstance(item, int | float | np.number | np.ndarray):
        return None
    array = np.asarray(item)
    return float(array.ravel()[0]) if array.size == 1 and array.dtype.kind in "fiu" else None
