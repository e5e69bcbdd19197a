"""Tables of values of an instance: one block per type, filled or read row by row in place."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hystid.fmu.native import Access, Instance, TextAccess


class Rows:
    """n rows of the named variables, of whatever type and shape."""

    def __init__(self, instance: Instance, names: Sequence[str], n: int) -> None:
        self._names = list(names)
        signals = [instance.signals[name] for name in names]
        self._numbers: list[tuple[Access, NDArray[Any]]] = [
            (access, np.zeros((n, access.count), access.dtype))
            for access in instance.access([s for s in signals if not s.is_text])
        ]
        self._texts: list[tuple[TextAccess, list[list[str]]]] = [
            (access, [[""] * len(access.names) for _ in range(n)])
            for access in instance.text_access([s for s in signals if s.is_text])
        ]
        self._places = [(a, block.ctypes.data, block.strides[0]) for a, block in self._numbers]

    def fill(self, table: Mapping[str, NDArray[Any]]) -> None:
        """Take the values from name -> (n,), of arrays (n, size)."""
        for access, block in self._numbers:
            for name, part in access.parts.items():
                block[:, part] = table[name].reshape(len(block), -1)
        for texts, rows in self._texts:
            for i, name in enumerate(texts.names):
                for row, value in zip(rows, table[name], strict=True):
                    row[i] = str(value)

    def set(self, row: int) -> None:
        """Set the instance to this row."""
        for access, address, stride in self._places:
            access.set(address + row * stride)
        for texts, rows in self._texts:
            texts.set(rows[row])

    def get(self, row: int) -> None:
        """Read this row from the instance."""
        for access, address, stride in self._places:
            access.get(address + row * stride)
        for texts, rows in self._texts:
            rows[row] = texts.get()

    def columns(self) -> dict[str, NDArray[Any]]:
        """name -> (n,), of arrays (n, size), in the order asked for; texts as objects."""
        found: dict[str, NDArray[Any]] = {}
        for access, block in self._numbers:
            for name, part in access.parts.items():
                found[name] = block[:, part] if access.shaped[name] else np.ascontiguousarray(block[:, part.start])
        for texts, rows in self._texts:
            for i, name in enumerate(texts.names):
                found[name] = np.array([row[i] for row in rows], object)
        return {name: found[name] for name in self._names}
