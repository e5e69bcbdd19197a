"""Inputs and outputs of a network as array variables of FMI 3.0: ``x`` in place of ``x[1]``, ``x[2]``."""

from __future__ import annotations

import re
import uuid
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import groupby

import numpy as np

from hystid.modelcode import ModelCode, Variable

_ELEMENT = re.compile(r"(?P<stem>.+)\[(?P<index>\d+(,\d+)*)\]")


@dataclass(frozen=True)
class ArrayOf:
    """One array variable. elements: in row-major order, side by side in the value block."""

    name: str
    shape: tuple[int, ...]
    elements: tuple[Variable, ...]


def with_arrays(code: ModelCode) -> ModelCode:
    """The same model whose inputs and outputs are listed as arrays; its token is another, as its interface is."""
    token = "{" + str(uuid.uuid5(uuid.UUID(code.token.strip("{}")), "arrays")) + "}"
    sources = {name: text.replace(code.token, token) for name, text in code.sources.items()}
    return replace(code, arrays=True, token=token, sources=sources)


def arrays_of(variables: Iterable[Variable]) -> Mapping[int, ArrayOf]:
    """Slot of the first element -> array, of the inputs and outputs that are the elements of one."""
    listed = [v for v in variables if v.causality in ("input", "output") and _ELEMENT.fullmatch(v.name)]
    found = {}
    for name, group in groupby(listed, key=lambda v: _parts(v)[0]):
        elements = tuple(group)
        shape = tuple(int(n) for n in np.max([_parts(v)[1] for v in elements], axis=0))
        if _are_whole(elements, shape):
            found[elements[0].slot] = ArrayOf(name, shape, elements)
    return found


def _are_whole(elements: Sequence[Variable], shape: tuple[int, ...]) -> bool:
    """Every element once and in its place, side by side, and alike but for name, start and description."""
    alike = {replace(v, name="", slot=0, start=None, description="") for v in elements}
    places = [tuple(i + 1 for i in index) for index in np.ndindex(*shape)]
    slots = range(elements[0].slot, elements[0].slot + len(elements))
    return len(alike) == 1 and places == [_parts(v)[1] for v in elements] and [*slots] == [v.slot for v in elements]


def _parts(v: Variable) -> tuple[str, tuple[int, ...]]:
    found = _ELEMENT.fullmatch(v.name)
    assert found is not None
    return found["stem"], tuple(int(i) for i in found["index"].split(","))
