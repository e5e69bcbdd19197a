"""Variables of an FMU of any origin as they are: every type of FMI 2.0 and 3.0, single or arrays.

Numbers of all sizes, enumerations, truth values, texts and binary data can be read and set; clocks cannot.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hystid.fmu.si import unit_of
from hystid.modelcode import Causality, Variability, Variable
from hystid.numeric import Array

_TRUTH = {"false": False, "true": True, "0": False, "1": True}
_REALS = ("Real", "Float64", "Float32")
_DTYPES: dict[str, type[np.generic]] = {
    "Float64": np.float64, "Float32": np.float32, "Int8": np.int8, "UInt8": np.uint8, "Int16": np.int16,
    "UInt16": np.uint16, "Int32": np.int32, "UInt32": np.uint32, "Int64": np.int64, "UInt64": np.uint64,
}  # fmt: skip
# FMI type -> what its functions are called, and how one element lies in memory; texts and binary data by address
_WIRE: dict[int, dict[str, tuple[str, type[np.generic]]]] = {
    2: {"Real": ("Real", np.float64), "Integer": ("Integer", np.int32), "Enumeration": ("Integer", np.int32),
        "Boolean": ("Boolean", np.int32), "String": ("String", np.uintp)},
    3: {**{name: (name, dtype) for name, dtype in _DTYPES.items()}, "Enumeration": ("Int64", np.int64),
        "Boolean": ("Boolean", np.bool_), "String": ("String", np.uintp), "Binary": ("Binary", np.uintp)},
}  # fmt: skip


@dataclass(frozen=True)
class Signal:
    """One variable. suffix: of the functions that get and set it, as "Int64". shape: of an array, () of one value.

    unit: "" without one.
    """

    name: str
    reference: int
    type: str
    suffix: str
    dtype: np.dtype[Any]
    shape: tuple[int, ...]
    causality: str
    variability: str
    unit: str = ""

    @property
    def size(self) -> int:
        """Number of its elements."""
        return math.prod(self.shape)

    def elements(self) -> tuple[Variable, ...]:
        """The elements of an array of real numbers as single ones, which follow one another from its reference on."""
        places = [f"{self.name}[{','.join(str(i + 1) for i in index)}]" for index in np.ndindex(*self.shape)]
        return tuple(
            Variable(place, self.reference + k, cast(Causality, self.causality), cast(Variability, self.variability))
            for k, place in enumerate(places)
        )

    @property
    def is_text(self) -> bool:
        """Whether its values are texts or binary data."""
        return self.suffix in ("String", "Binary")

    @property
    def is_continuous(self) -> bool:
        """Whether it is a real number that changes between events, too."""
        return self.type in _REALS and self.variability == "continuous"

    @property
    def is_real(self) -> bool:
        """Whether it is a floating-point number."""
        return self.type in _REALS

    def parsed(self, cells: Sequence[str]) -> NDArray[Any]:
        """Texts of a table as values (n,), of arrays (n, size). Raises ValueError with the first text that is none."""
        rows = [self._row(cell) for cell in cells]
        kind = object if self.is_text else np.bool_ if self.type == "Boolean" else self.dtype
        values = np.array(rows, kind)
        return values.reshape(len(rows), self.size) if self.shape else values[:, 0]

    def _row(self, cell: str) -> list[Any]:
        parts = cell.split() if self.shape and not self.is_text else [cell]
        if len(parts) != self.size:
            raise ValueError(f"'{self.name}' has {self.size} elements, '{cell[:40]}' has {len(parts)}")
        try:
            return [self._value(part) for part in parts]
        except (ValueError, KeyError, OverflowError):
            raise ValueError(f"'{cell[:40]}' is no value of '{self.name}', which is of type {self.type}") from None

    def _value(self, text: str) -> Any:
        if self.is_text:
            return text
        if self.type == "Boolean":
            return _TRUTH[text.strip().lower()] if text.strip().lower() in _TRUTH else bool(_whole(text))
        if self.type in _REALS:
            return float(text)
        value, limits = _whole(text), np.iinfo(self.dtype)
        if not limits.min <= value <= limits.max:
            raise ValueError
        return value

    def written(self, values: NDArray[Any]) -> list[str]:
        """Values as texts that ``parsed`` takes."""
        if self.is_text:
            return [str(value) for value in values]
        rows = values.reshape(len(values), -1)
        return [" ".join(map(self._text, row)) for row in rows.tolist()]

    def _text(self, value: Any) -> str:
        if self.type == "Boolean":
            return "true" if value else "false"
        return f"{value:.7g}" if self.type in _REALS else str(value)

    def samples(self, values: ArrayLike) -> NDArray[Any]:
        """Values as they are set, (n,) or (n, size) like the argument. Raises ValueError for one that has no place."""
        if self.is_text:
            return np.asarray(values, object)
        given = np.asarray(values)
        if self.type == "Boolean":
            return np.ascontiguousarray(given != 0, self.dtype)
        if self.type in _REALS:
            return np.ascontiguousarray(given, self.dtype)
        limits = np.iinfo(self.dtype)
        wrong = (given != np.round(given)) | (given < limits.min) | (given > limits.max) if given.size else given != 0
        if np.any(wrong):
            first = int(np.argmax(wrong.reshape(len(given), -1).any(axis=1))) if given.ndim else 0
            raise ValueError(f"is {given.flat[np.argmax(wrong)]} at sample {first}, which {self.type} cannot hold")
        return np.ascontiguousarray(given, self.dtype)

    def resampled(self, t: Array, given: Array, values: NDArray[Any], slack: float = 0.0) -> NDArray[Any]:
        """Values (m,) or (m, size) of the times ``given``, at the times t (n,): between them straight lines, or the
        latest one where it is not continuous, which may be late by the slack [s]."""
        if not self.is_continuous:
            return np.asarray(values[np.maximum(np.searchsorted(given, t + slack, side="right") - 1, 0)])
        columns = [np.interp(t, given, column) for column in values.reshape(len(values), -1).T]
        return np.stack(columns, axis=1).reshape(len(t), *values.shape[1:])


def _whole(text: str) -> int:
    try:
        return int(text)
    except ValueError:
        number = float(text)
        if number != int(number):
            raise
        return int(number)


def signals_of(variables: Sequence[Any], version: int) -> Mapping[str, Signal]:
    """name -> signal, of what FMPy has read; clocks are left out."""
    wire = _WIRE[version]
    return {
        v.name: Signal(
            v.name,
            v.valueReference,
            v.type,
            wire[v.type][0],
            np.dtype(wire[v.type][1]),
            tuple(v.shape or ()),
            v.causality or "local",
            v.variability or ("continuous" if v.type in _REALS else "discrete"),
            unit_of(v),
        )
        for v in variables
        if v.type in wire
    }
