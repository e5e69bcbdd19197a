"""Evaluation of a two-network model, sample by sample, in compiled C."""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np

from hystid.errors import NumericalError, UsageError
from hystid.networks.level import Level
from hystid.networks.normal_equations import aligned, pointer
from hystid.networks.perceptron import Member, Network
from hystid.networks.ports import Polyline
from hystid.networks.trust import Tail
from hystid.recording import Array
from hystid.toolchain import shared_library

_LANES = 8  # members per vector: 64 bytes of float64
_FLAGS = ("-O3", "-march=native", "-ffp-contract=fast", "-DVECTOR_BYTES=64", "-Wno-psabi")


@dataclass(frozen=True, eq=False)
class Ends:
    """Least and greatest value of x, v and the further inputs, shape (2 + inputs, 2), and what acts beyond."""

    limits: Array
    tail: Tail

    def numbers(self) -> Array:
        """stiffness, damping, then the limits row by row."""
        return np.array([self.tail.stiffness, self.tail.damping, *self.limits.ravel()])


@dataclass(frozen=True, eq=False)
class Ensemble:
    """The pairs of networks of a model, all of one structure, and the velocity band of its turning points [m/s].

    sources, shares: of the lags, which the networks see after the further inputs: number of the further input that a
    lag follows, -1 for the velocity, and what it makes up of the difference in one sample (``Lag.share``).
    level: what the networks' force is scaled by. ends: of the training range. curves: of the further inputs, None for
    those without one; empty for none at all.
    """

    members: tuple[Member, ...]
    band: float
    sources: tuple[int, ...] = ()
    shares: tuple[float, ...] = ()
    level: Level | None = None
    ends: Ends | None = None
    curves: tuple[Polyline | None, ...] = ()

    @property
    def state_size(self) -> int:
        """Length of the state: v_last, x0, Rh and Rh0 of each member, the lags."""
        return 2 + 2 * len(self.members) + len(self.sources)


@dataclass(frozen=True, eq=False)
class Start:
    """A free run's mass [kg], step [s], displacement [m] and velocity [m/s] at the first row, and state before it."""

    mass: float
    dt: float
    x: float
    v: float
    state: Array


def response(ensemble: Ensemble, x: Array, v: Array, further: Array, state: Array) -> tuple[Array, Array, Array]:
    """R [N], shape (n,), each member's own R, shape (n, members), and the state after; further: shape (n, inputs)."""
    x, v, state = (np.ascontiguousarray(values, dtype=np.float64) for values in (x, v, state))
    _check(ensemble, state, x=x, v=v)
    members = len(ensemble.members)
    state, force, each = state.copy(), np.empty(len(x)), np.empty((len(x), members))
    arrays = (pointer(values) for values in (x, v, further, state, force, each))
    _done(_library().hystid_response(*_description(ensemble), ctypes.c_long(len(x)), *arrays))
    return force, each, state


def free_run(ensemble: Ensemble, force: Array, further: Array, start: Start) -> dict[str, Array]:
    """x, v, a, R of the closed loop, each of shape (n,); see ``TwoNetworkModel.free_run``, its errors too."""
    force, state = (np.ascontiguousarray(values, dtype=np.float64) for values in (force, start.state))
    _check(ensemble, state, force=force)
    if not start.dt > 0:
        raise UsageError(f"the time step must be above 0 s, found {start.dt}")
    rows = {name: np.zeros(len(force)) for name in ("x", "v", "a", "R")}
    if not len(force):
        return rows
    rows["x"][0], rows["v"][0] = start.x, start.v
    state = state.copy()
    arrays = (pointer(values) for values in (force, further, state, *rows.values()))
    numbers = (ctypes.c_double(start.mass), ctypes.c_double(start.dt), ctypes.c_long(len(force)))
    done = _done(_library().hystid_free_run(*_description(ensemble), *numbers, *arrays))
    if done < len(force):
        raise NumericalError(
            f"the free run of the surrogate diverged at t = {done * start.dt:.6g} s: the force drives it outside "
            f"the motion it was trained on, or the step of {start.dt:.3g} s is too long"
        )
    return rows


def _check(ensemble: Ensemble, state: Array, **signals: Array) -> None:
    shapes = {name: values.shape for name, values in signals.items()}
    if any(len(shape) != 1 for shape in shapes.values()) or len(set(shapes.values())) != 1:
        raise UsageError(f"{' and '.join(shapes)} must be one-dimensional and of one length, found {shapes}")
    if state.shape != (ensemble.state_size,):
        raise UsageError(f"the state must have shape ({ensemble.state_size},), found {state.shape}")
    for name, values in signals.items():
        bad = np.flatnonzero(~np.isfinite(values))
        if len(bad):
            raise UsageError(f"{name} is not finite at sample {bad[0]}")


@cache
def _library() -> ctypes.CDLL:
    folder = Path(__file__).parent / "kernel"
    sources = {name: (folder / name).read_text() for name in ("evaluate.c", "vector.h")}
    library = ctypes.CDLL(str(shared_library(sources, main=["evaluate.c"], flags=_FLAGS)))
    for function in (library.hystid_response, library.hystid_free_run):
        function.restype = ctypes.c_long
    return library


def _done(rows: int) -> int:
    if rows < 0:
        raise NumericalError("not enough memory to evaluate the model")
    return rows


def _description(ensemble: Ensemble) -> tuple[object, ...]:
    first = ensemble.members[0]
    sizes = np.array([*first.hysteresis.sizes, *first.restoring.sizes], dtype=np.int32)
    return (
        len(ensemble.members),
        pointer(sizes),
        len(first.hysteresis.layers),
        len(first.restoring.layers),
        pointer(interleaved([member.hysteresis for member in ensemble.members])),
        pointer(interleaved([member.restoring for member in ensemble.members])),
        ctypes.c_double(ensemble.band),
        len(ensemble.sources),
        pointer(np.array(ensemble.sources, dtype=np.int32)),
        pointer(np.array(ensemble.shares, dtype=np.float64)),
        pointer(np.array(ensemble.level.numbers())) if ensemble.level else None,
        pointer(ensemble.ends.numbers()) if ensemble.ends else None,
        pointer(_curves(ensemble)) if ensemble.curves else None,
    )


def _curves(ensemble: Ensemble) -> Array:
    """Of each further input: number of points, at, to."""
    rows = [[0.0] if curve is None else [len(curve.at), *curve.at, *curve.to] for curve in ensemble.curves]
    return np.array([value for row in rows for value in row])


def interleaved(networks: Sequence[Network]) -> Array:
    """Weights of networks of one structure as [group][parameter][lane], 64-byte aligned, zero in unused lanes."""
    flat = np.stack([network.flat for network in networks])
    groups = -(-len(flat) // _LANES)
    padded = np.zeros((groups * _LANES, flat.shape[1]))
    padded[: len(flat)] = flat
    values = padded.reshape(groups, _LANES, -1).transpose(0, 2, 1).ravel()
    held = aligned(values.shape, "float64")
    held[:] = values
    return np.asarray(held, np.float64)
