"""The rig: elements with their own laws (``laws.c``) on one mass, run freely or evaluated on a given motion."""

from __future__ import annotations

import ctypes
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hystid.toolchain import shared_library

Array = NDArray[np.float64]

_TEXT = Path(__file__).with_name("laws.c").read_text(encoding="utf-8")
# The names of the laws stand once, in the enumeration of the C text.
KINDS = {name.lower(): int(number) for name, number in re.findall(r"\b([A-Z_0-9]+) = (\d+)", _TEXT)}
BASELINE_KINDS = frozenset({"jenkins", "sliders", "boucwen", "pecorari"})
ALWAYS = (-1e9, 1e9, 0.0)
MOST_STATES = 130


class Diverged(Exception):
    """The motion left the finite numbers: the drawn case cannot exist."""


@dataclass(frozen=True)
class Element:
    """One law. Baseline kinds take ``shape`` alone; effects take strength and shape, and act while the gate is open.

    gate: on, off, rise [s]. strength: force, mass or share, see ``laws.c``.
    """

    kind: str
    shape: tuple[float, ...] = ()
    strength: float = 0.0
    gate: tuple[float, float, float] = ALWAYS

    @property
    def concealed(self) -> bool:
        """Whether the element is an effect rather than part of the baseline."""
        return self.kind not in BASELINE_KINDS

    def numbers(self) -> tuple[float, ...]:
        """Parameters in the order of ``laws.c``."""
        return (*self.gate, self.strength, *self.shape) if self.concealed else self.shape

    def scaled(self, factor: float) -> Element:
        """The same law, stronger by the factor."""
        return replace(self, strength=self.strength * factor)


@dataclass(frozen=True)
class Rig:
    """Mass [kg], viscous coefficient B [N.s/m], spring Kl [N/m], and the elements."""

    m: float
    B: float
    Kl: float
    elements: tuple[Element, ...] = ()

    def without_effects(self) -> Rig:
        """The rig that the experimenter believes in."""
        return replace(self, elements=tuple(e for e in self.elements if not e.concealed))


@dataclass(frozen=True)
class Motion:
    """Motion on a uniform grid: x [m], v [m/s], a [m/s2], h [N] baseline law, each [N] one row per element."""

    dt: float
    x: Array
    v: Array
    a: Array
    h: Array
    each: Array


def run(rig: Rig, force: Array, dt: float, start: Sequence[float] = (0.0, 0.0)) -> Motion:
    """Free run from (x, v) with empty memories. force: 2n+1 values [N] at half steps. Raises Diverged."""
    n = (len(force) - 1) // 2
    state = np.zeros(MOST_STATES)
    state[:2] = start
    x, v, a, h = (np.empty(n + 1) for _ in range(4))
    each = np.empty((max(len(rig.elements), 1), n + 1))
    head, keep = _pack(rig.elements)
    failed = _library().concealed_run(
        *head,
        rig.m,
        rig.B,
        rig.Kl,
        n,
        dt,
        *(_pointer(y) for y in (np.ascontiguousarray(force), state, x, v, a, h, each)),
    )
    del keep
    if failed:
        raise Diverged(f"no finite motion at step {failed} of {n}")
    return Motion(dt, x, v, a, h, each[: len(rig.elements)])


def clamp(
    elements: tuple[Element, ...], x: Array, v: Array, a: Array, dt: float, substeps: int = 1
) -> tuple[Array, Array]:
    """Forces on a given motion: (baseline law, shape (n,); each element, shape (elements, n)) [N].

    substeps: steps per sample, for loops that are short against the motion of one sample.
    """
    x, v, a = (np.ascontiguousarray(y, dtype=float) for y in (x, v, a))
    h, each = np.empty(len(x)), np.empty((max(len(elements), 1), len(x)))
    head, keep = _pack(elements)
    _library().concealed_clamp(*head, len(x) - 1, dt, substeps, *(_pointer(y) for y in (x, v, a, h, each)))
    del keep
    return h, each[: len(elements)]


def _pack(elements: tuple[Element, ...]) -> tuple[tuple[object, ...], tuple[NDArray[np.generic], ...]]:
    numbers = [e.numbers() for e in elements]
    kinds = np.array([KINDS[e.kind] for e in elements] or [0], dtype=np.int32)
    roles = np.array([int(e.concealed) for e in elements] or [0], dtype=np.int32)
    first = np.array([0, *np.cumsum([len(p) for p in numbers])], dtype=np.int32)
    flat = np.array([value for p in numbers for value in p] or [0.0], dtype=float)
    return (len(elements), *(_pointer(y) for y in (kinds, roles, first, flat))), (kinds, roles, first, flat)


def _pointer(values: NDArray[np.generic]) -> ctypes.c_void_p:
    return ctypes.c_void_p(values.ctypes.data)


@cache
def _library() -> ctypes.CDLL:
    library = ctypes.CDLL(str(shared_library({"laws.c": _TEXT}, main=["laws.c"])))
    whole, real, address, small = ctypes.c_long, ctypes.c_double, ctypes.c_void_p, ctypes.c_int
    library.concealed_run.argtypes = [small, *[address] * 4, real, real, real, whole, real, *[address] * 7]
    library.concealed_clamp.argtypes = [small, *[address] * 4, whole, real, small, *[address] * 5]
    library.concealed_run.restype = library.concealed_clamp.restype = whole
    return library
