"""Force laws and their motion: ``motion.c``, compiled once for a machine and called through ctypes."""

from __future__ import annotations

import ctypes
import hashlib
import os
import shutil
import subprocess
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
SOURCE = Path(__file__).with_name("motion.c")
KINDS = [
    "sliders",
    "boucwen",
    "pecorari",
    "power",
    "exponential",
    "string",
    "sine",
    "ripple",
    "onesided",
    "unloaded",
    "hunt",
    "kelvin",
    "stops",
    "play",
    "friction",
    "drag",
    "xdamping",
    "weakening",
    "pinch",
    "maxwell",
    "constant",
    "mass",
    "hidden",
    "delayed",
    "lever",
    "flag",
    "softgel",
    "late_friction",
]
BASELINE, HYSTERETIC, CONCEALED = 0, 1, 2
MOST_TERMS, MOST_SLIDERS, N_PARAMETERS = 16, 48, 12


@dataclass(frozen=True)
class Term:
    """One force law: ``p[0]`` is its amplitude, the force is proportional to it (see ``law`` in motion.c).

    ``gate``: factor in time on the half-step grid, shape (2 n + 1,). ``table``: (stiffness, limit) of sliders.
    """

    kind: str
    p: tuple[float, ...]
    group: int = CONCEALED
    gate: Array | None = None
    table: tuple[tuple[float, float], ...] = ()

    def times(self, factor: float) -> Term:
        """The same law with ``factor`` times the amplitude."""
        return replace(self, p=(self.p[0] * factor, *self.p[1:]))


@dataclass(frozen=True)
class Motion:
    """Time, motion and forces on the step grid, SI units; ``h`` is the hysteretic force, ``f`` the concealed one."""

    t: Array
    x: Array
    v: Array
    a: Array
    F: Array
    h: Array
    f: Array
    R: Array
    before: dict[str, Array] = field(default_factory=dict)  # x, v, a and F of what was cut away at the beginning

    def every(self, step: int, start: int = 0) -> Motion:
        """Each ``step``-th sample from ``start`` on; time starts at zero again."""
        cut = [getattr(self, name)[start::step] for name in "xvaFhfR"]
        before = {name: getattr(self, name)[:start] for name in "xvaF"}
        return Motion((self.t[start::step] - self.t[start]).copy(), *cut, before)


class Diverged(ValueError):
    """The motion left its limit."""


class _Term(ctypes.Structure):
    _fields_ = (
        ("kind", ctypes.c_int),
        ("group", ctypes.c_int),
        ("count", ctypes.c_int),
        ("p", ctypes.c_double * N_PARAMETERS),
        ("gate", ctypes.c_void_p),
        ("table", ctypes.c_void_p),
    )


def drive(
    terms: Sequence[Term],
    mass: float,
    h: float,
    force: Array,
    start: tuple[float, float] = (0.0, 0.0),
    limit: float = np.inf,
    shaker: float = 0.0,
) -> Motion:
    """The motion under ``force`` [N] on the half-step grid, shape (2 n + 1,), with steps of ``h`` [s].

    ``shaker`` [N s/m] is the damping of an electrodynamic shaker: the force that reaches the mass falls by it times v.
    Raises :class:`Diverged` where |x| passes ``limit`` [m].
    """
    n = (len(force) - 1) // 2
    packed, keep = _pack(terms)
    xs, vs, out = np.zeros(n + 1), np.zeros(n + 1), np.zeros((n + 1, 7))
    force = np.ascontiguousarray(force, dtype=float)
    done = _library().drive(
        packed, len(terms), mass, shaker, h, n, _at(force), start[0], start[1], limit, _at(xs), _at(vs), _at(out)
    )
    if done < n:
        raise Diverged(f"|x| passed {limit:g} m after {done * h:g} s")
    del keep
    return Motion(h * np.arange(n + 1), *out.T.copy())


def follow(terms: Sequence[Term], mass: float, h: float, x: Array, v: Array, a: Array) -> Motion:
    """The force that a prescribed motion needs; ``x``, ``v``, ``a`` on the half-step grid, shape (2 n + 1,)."""
    n = (len(x) - 1) // 2
    packed, keep = _pack(terms)
    xs, vs, out = np.zeros(n + 1), np.zeros(n + 1), np.zeros((n + 1, 7))
    x, v, a = (np.ascontiguousarray(y, dtype=float) for y in (x, v, a))
    _library().follow(packed, len(terms), mass, h, n, _at(x), _at(v), _at(a), _at(xs), _at(vs), _at(out))
    del keep
    return Motion(h * np.arange(n + 1), *out.T.copy())


def _at(y: Array) -> ctypes.c_void_p:
    return ctypes.c_void_p(y.ctypes.data)


def _pack(terms: Sequence[Term]) -> tuple[ctypes.Array[_Term], list[Array]]:
    if len(terms) > MOST_TERMS or any(len(term.table) > MOST_SLIDERS for term in terms):
        raise ValueError(f"at most {MOST_TERMS} terms of at most {MOST_SLIDERS} sliders")
    keep: list[Array] = []
    packed = (_Term * len(terms))()
    for place, term in zip(packed, terms, strict=True):
        place.kind, place.group, place.count = KINDS.index(term.kind), term.group, len(term.table)
        place.p = (ctypes.c_double * N_PARAMETERS)(*term.p)
        for name, values in (("gate", term.gate), ("table", term.table or None)):
            if values is not None:
                keep.append(np.ascontiguousarray(values, dtype=float).ravel())
                setattr(place, name, keep[-1].ctypes.data)
    return packed, keep


@cache
def _library() -> ctypes.CDLL:
    """The compiled ``motion.c``; compiled into the user's cache where its text is new."""
    text = SOURCE.read_bytes()
    root = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "hystid-proof"
    path = root / f"motion-{hashlib.sha256(text).hexdigest()[:16]}.so"
    if not path.exists():
        compiler = shutil.which("cc")
        if compiler is None:
            raise RuntimeError("no C compiler 'cc' found: the generator of proof cases needs one")
        root.mkdir(parents=True, exist_ok=True)
        beside = path.with_suffix(f".{os.getpid()}")
        subprocess.run(
            [compiler, "-O2", "-std=c11", "-shared", "-fPIC", str(SOURCE), "-o", str(beside), "-lm"], check=True
        )
        beside.replace(path)
    library = ctypes.CDLL(str(path))
    number, pointer, count = ctypes.c_double, ctypes.c_void_p, ctypes.c_long
    library.drive.restype = library.follow.restype = count
    library.drive.argtypes = [
        pointer,
        ctypes.c_int,
        number,
        number,
        number,
        count,
        pointer,
        number,
        number,
        number,
        pointer,
        pointer,
        pointer,
    ]
    library.follow.argtypes = [
        pointer,
        ctypes.c_int,
        number,
        number,
        count,
        pointer,
        pointer,
        pointer,
        pointer,
        pointer,
        pointer,
    ]
    return library
