"""Evaluation of a two-network model, sample by sample: compiled C where there is a compiler, NumPy otherwise."""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from hystid import toolchain
from hystid.errors import NumericalError, ToolchainError, UsageError
from hystid.networks.level import Level
from hystid.networks.perceptron import Member, Network
from hystid.networks.ports import Curve
from hystid.networks.trust import Tail
from hystid.recording import Array

_LANES = 8  # members per vector: 64 bytes of float64
_HUGE_MOTION = 1e100  # far beyond any motion in SI units, and its square still finite
_FLAGS = ("-O3", "-march=native", "-ffp-contract=fast", "-DVECTOR_BYTES=64", "-Wno-psabi")


@dataclass(frozen=True, eq=False)
class Ends:
    """Least and greatest value of x, v and the further inputs, shape (2 + inputs, 2), and what acts beyond."""

    limits: Array
    tail: Tail

    def inside(self, x: float, v: float, further: Array) -> tuple[float, float, Array, float]:
        """The nearest x, v and further inputs inside, and the force of the tail."""
        signals = np.array([x, v, *further])
        near = np.clip(signals, self.limits[:, 0], self.limits[:, 1])
        force = self.tail.stiffness * (x - near[0]) + self.tail.damping * (v - near[1])
        return near[0], near[1], near[2:], float(force)

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
    curves: tuple[Curve | None, ...] = ()

    def seen(self, x: float, v: float, further: Array) -> tuple[float, float, Array, float]:
        """What the networks see of x, v and the further inputs, and the force of the tail."""
        force = 0.0
        if self.ends is not None:
            x, v, further, force = self.ends.inside(x, v, further)
        if self.curves:
            bent = zip(further, self.curves, strict=True)
            further = np.array([u if curve is None else float(curve(u)) for u, curve in bent])
        return x, v, further, force

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
    library = _library()
    if library is None:
        stepper = _Stepper(ensemble, state)
        for k in range(len(x)):
            force[k], each[k] = stepper.accept(x[k], v[k], further[k])
    else:
        arrays = (_pointer(values) for values in (x, v, further, state, force, each))
        _done(library.hystid_response(*_description(ensemble), ctypes.c_long(len(x)), *arrays))
    return force, each, state


def free_run(ensemble: Ensemble, force: Array, further: Array, start: Start) -> dict[str, Array]:
    """x, v, a, R of the closed loop, each of shape (n,); see ``TwoNetworkModel.free_run``."""
    force, state = (np.ascontiguousarray(values, dtype=np.float64) for values in (force, start.state))
    _check(ensemble, state, force=force)
    if not start.dt > 0:
        raise UsageError(f"the time step must be above 0 s, found {start.dt}")
    rows = {name: np.zeros(len(force)) for name in ("x", "v", "a", "R")}
    if not len(force):
        return rows
    rows["x"][0], rows["v"][0] = start.x, start.v
    state = state.copy()
    library = _library()
    if library is None:
        with np.errstate(over="ignore", invalid="ignore"):  # divergence is found and named below
            done = _free_run_numpy(_Stepper(ensemble, state), force, further, start, rows)
    else:
        arrays = (_pointer(values) for values in (force, further, state, *rows.values()))
        numbers = (ctypes.c_double(start.mass), ctypes.c_double(start.dt), ctypes.c_long(len(force)))
        done = _done(library.hystid_free_run(*_description(ensemble), *numbers, *arrays))
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
def _library() -> ctypes.CDLL | None:
    folder = Path(__file__).parent / "kernel"
    sources = {name: (folder / name).read_text() for name in ("evaluate.c", "vector.h")}
    try:
        library = ctypes.CDLL(str(toolchain.shared_library(sources, main=["evaluate.c"], flags=_FLAGS)))
    except ToolchainError:
        return None
    for function in (library.hystid_response, library.hystid_free_run):
        function.restype = ctypes.c_long
    return library


def _done(rows: int) -> int:
    if rows < 0:
        raise NumericalError("not enough memory to evaluate the model")
    return rows


def _pointer(values: np.ndarray[Any, Any]) -> ctypes.c_void_p:
    return values.ctypes.data_as(ctypes.c_void_p)


def _description(ensemble: Ensemble) -> tuple[object, ...]:
    first = ensemble.members[0]
    sizes = np.array([*first.hysteresis.sizes, *first.restoring.sizes], dtype=np.int32)
    return (
        len(ensemble.members),
        _pointer(sizes),
        len(first.hysteresis.layers),
        len(first.restoring.layers),
        _pointer(interleaved([member.hysteresis for member in ensemble.members])),
        _pointer(interleaved([member.restoring for member in ensemble.members])),
        ctypes.c_double(ensemble.band),
        len(ensemble.sources),
        _pointer(np.array(ensemble.sources, dtype=np.int32)),
        _pointer(np.array(ensemble.shares, dtype=np.float64)),
        _pointer(np.array(ensemble.level.numbers())) if ensemble.level else None,
        _pointer(ensemble.ends.numbers()) if ensemble.ends else None,
        _pointer(_curves(ensemble)) if ensemble.curves else None,
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
    room = np.empty(len(values) + _LANES)
    begin = (-room.ctypes.data // 8) % _LANES
    aligned = room[begin : begin + len(values)]
    aligned[:] = values
    return aligned


class _Stepper:
    """One ensemble in NumPy, step by step; ``state`` is changed in place. The C kernel does the same."""

    def __init__(self, ensemble: Ensemble, state: Array) -> None:
        members = len(ensemble.members)
        self.ensemble, self.memory = ensemble, state[:2]
        self.latest, self.held = state[2 : 2 + members], state[2 + members : 2 + 2 * members]
        self.late = state[2 + 2 * members :]

    def evaluate(self, x: float, v: float, further: Array) -> tuple[Array, Array]:
        """Each member's R and Rh with the memory as it stands."""
        x, v, further, beyond = self.ensemble.seen(x, v, further)
        x0, members = self.memory[1], self.ensemble.members
        further = np.concatenate([further, self.late])
        hysteretic = np.array([m.hysteresis(x, x0, h, *further)[0] for m, h in zip(members, self.held, strict=True)])
        forces = np.array([m.restoring(x, v, h, *further)[0] for m, h in zip(members, hysteretic, strict=True)])
        if self.ensemble.level is not None:
            level = self.ensemble.level
            forces = level.centre(np.array(x), further) + level.spread(further) * forces
        return forces + beyond, hysteretic

    def accept(self, x: float, v: float, further: Array) -> tuple[float, Array]:
        """Renew the memory at a sample; R there, and each member's."""
        last, fast = self.memory[0], abs(v) >= self.ensemble.band
        if last == 0 or (fast and last * v <= 0):
            self.memory[1] = self.ensemble.seen(x, v, further)[0]
            self.held[:] = self.latest
        if fast:
            self.memory[0] = v
        forces, self.latest[:] = self.evaluate(x, v, further)
        _, v, further, _ = self.ensemble.seen(x, v, further)
        sources = np.array([v if source < 0 else further[source] for source in self.ensemble.sources])
        self.late += np.array(self.ensemble.shares) * (sources - self.late)
        return float(np.mean(forces)), forces

    def between(self, x: float, v: float, further: Array) -> float:
        """R with the memory as it stands."""
        return float(np.mean(self.evaluate(x, v, further)[0]))


def _free_run_numpy(stepper: _Stepper, force: Array, further: Array, start: Start, rows: dict[str, Array]) -> int:
    x, v, a, R = (rows[name] for name in ("x", "v", "a", "R"))
    mass, dt = start.mass, start.dt
    for k in range(len(force)):
        R[k], _ = stepper.accept(x[k], v[k], further[k])
        a[k] = (force[k] - R[k]) / mass
        if not np.abs([x[k], v[k], a[k]]).max() < _HUGE_MOTION:
            return k
        if k + 1 == len(force):
            break
        middle, between = 0.5 * (force[k] + force[k + 1]), 0.5 * (further[k] + further[k + 1])
        v1, a1 = v[k], a[k]
        v2 = v1 + 0.5 * dt * a1
        a2 = (middle - stepper.between(x[k] + 0.5 * dt * v1, v2, between)) / mass
        v3 = v1 + 0.5 * dt * a2
        a3 = (middle - stepper.between(x[k] + 0.5 * dt * v2, v3, between)) / mass
        v4 = v1 + dt * a3
        a4 = (force[k + 1] - stepper.between(x[k] + dt * v3, v4, further[k + 1])) / mass
        x[k + 1] = x[k] + dt / 6 * (v1 + 2 * (v2 + v3) + v4)
        v[k + 1] = v1 + dt / 6 * (a1 + 2 * (a2 + a3) + a4)
    return len(force)
