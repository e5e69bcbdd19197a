"""Requests and answers as bytes: JSON, and arrays beside it."""

from __future__ import annotations

import json
import math
import struct
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import IO, Any

import numpy as np

_HEADER = struct.Struct("<QQ")  # bytes of JSON, bytes of arrays


def encoded(value: Mapping[str, Any]) -> list[memoryview]:
    """Blocks of one request or answer."""
    arrays = _Arrays()
    text = json.dumps(_packed(dict(value), arrays)).encode()
    data = b"".join([_HEADER.pack(len(text), arrays.size), text])
    return [memoryview(data), *(memoryview(array).cast("B") for array in arrays if array.nbytes)]


def write(file: IO[bytes], blocks: Sequence[memoryview]) -> None:
    """Write blocks into a pipe, whole."""
    for rest in blocks:
        while rest:
            rest = rest[file.write(rest) :]


def receive(file: IO[bytes], most_text: int, most_data: int) -> Any:
    """The next value of a pipe. Raises EOFError at its end, ValueError for more bytes than allowed or nonsense."""
    n_text, n_data = _HEADER.unpack(_exactly(file, _HEADER.size))
    if n_text > most_text or n_data > most_data:
        raise ValueError("an answer that is too long")
    text = json.loads(bytes(_exactly(file, n_text)))
    data = _exactly(file, n_data)
    return _unpacked(text, memoryview(data))


def _exactly(file: IO[bytes], n: int) -> bytearray:
    data = bytearray(n)
    view = memoryview(data)
    while view:
        count = file.readinto(view)  # type: ignore[attr-defined]  # binary pipes have it
        if not count:
            raise EOFError
        view = view[count:]
    return data


class _Arrays(list[Any]):
    """Arrays that follow one another, and their size in bytes."""

    size = 0

    def add(self, array: Any) -> int:
        begin = self.size
        self.append(array)
        self.size += array.nbytes
        return begin


def _packed(value: Any, arrays: _Arrays) -> Any:
    """Scalars as they are, everything else as [kind, ...]; arrays of numbers are put aside."""
    if isinstance(value, np.ndarray):
        if value.dtype.kind in "fiub":
            return ["array", arrays.add(np.ascontiguousarray(value)), value.dtype.str, list(value.shape)]
        return ["texts", [str(item) for item in value.ravel()], list(value.shape)]
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, Mapping):
        return ["map", [[str(key), _packed(item, arrays)] for key, item in value.items()]]
    if isinstance(value, Sequence) and not isinstance(value, str | bytes):
        return ["list", [_packed(item, arrays) for item in value]]
    return str(value) if isinstance(value, Path) else value


def _unpacked(value: Any, data: memoryview) -> Any:
    if not isinstance(value, list):
        return value
    if value[0] == "map":
        return {str(key): _unpacked(item, data) for key, item in value[1]}
    if value[0] == "list":
        return [_unpacked(item, data) for item in value[1]]
    if value[0] == "texts":
        texts = np.empty(len(value[1]), object)
        texts[:] = value[1]
        return texts.reshape(value[2])
    _, begin, name, shape = value
    dtype = np.dtype(name)
    if dtype.kind not in "fiub" or begin < 0 or any(n < 0 for n in shape):
        raise ValueError("an array of a type that is never sent")
    return np.frombuffer(data, dtype, math.prod(shape), begin).reshape(shape).copy()
