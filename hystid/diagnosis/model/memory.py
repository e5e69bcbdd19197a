"""What was computed lately, kept within a number of bytes."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Hashable

from hystid.numeric import Array

_LEAST_ENTRIES = 2  # entries that stay whatever their size: what is asked for twice in a row


class Memory:
    """Arrays by key. What was not asked for longest goes first when all exceed a number of bytes.

    cyclic: all is asked for in turn, again and again: then what came last goes first, or nothing would be found again.
    The arrays are shared, not copied, and made read-only.
    """

    def __init__(self, most: int, *, cyclic: bool = False) -> None:
        self._most, self._cyclic = most, cyclic
        self._kept: OrderedDict[Hashable, tuple[Array, ...]] = OrderedDict()
        self._size = 0

    def get(self, key: Hashable, make: Callable[[], tuple[Array, ...]]) -> tuple[Array, ...]:
        """The arrays of a key, made where they are not known. What ``make`` raises is passed on."""
        if key in self._kept:
            self._kept.move_to_end(key)
            return self._kept[key]
        made = self._kept[key] = make()
        for array in made:
            array.flags.writeable = False
        self._size += _bytes(made)
        while self._size > self._most and len(self._kept) > _LEAST_ENTRIES:
            self._size -= _bytes(self._kept.popitem(last=self._cyclic)[1])
        return made

    def clear(self) -> None:
        """Forget everything."""
        self._kept.clear()
        self._size = 0


def _bytes(arrays: tuple[Array, ...]) -> int:
    return sum(array.nbytes for array in arrays)
