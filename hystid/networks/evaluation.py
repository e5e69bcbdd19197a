"""Evaluation of a two-network model, sample by sample: compiled C where there is a compiler, NumPy otherwise."""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from hystid import toolchain
from hystid.errors import NumericalError, ToolchainError, UsageError
from hystid.recording import Array

if TYPE_CHECKING:
    from hystid.networks.network import Network, TwoNetworkModel

_LANES = 8  # members per vector: 64 bytes of float64
_HUGE_MOTION = 1e100  # far beyond any motion in SI units, and its square still finite
_FLAGS = ("-O3", "-march=native", "-ffp-contract=fast", "-DVECTOR_BYTES=64", "-Wno-psabi")


def response(model: TwoNetworkModel, x: Array, v: Array, state: Array) -> tuple[Array, Array]:
    """See ``TwoNetworkModel.response``."""
    force, _, after = response_with_members(model, x, v, state)
    return force, after


def response_with_members(model: TwoNetworkModel, x: Array, v: Array, state: Array) -> tuple[Array, Array, Array]:
    """As ``response``, with each member's hysteretic force Rh between, shape (n, members)."""
    x, v, state = (np.ascontiguousarray(values, dtype=np.float64) for values in (x, v, state))
    _check(model, state, x=x, v=v)
    members = len(model.members)
    state, force, hysteretic = state.copy(), np.empty(len(x)), np.empty((len(x), members))
    library = _library()
    if library is None:
        _response_numpy(model, x, v, state, force, hysteretic)
    else:
        arrays = (_pointer(values) for values in (x, v, state, force, hysteretic))
        _done(library.hystid_response(*_description(model), ctypes.c_long(len(x)), *arrays))
    return force, hysteretic, state


def free_run(
    model: TwoNetworkModel, force: Array, dt: float, start: tuple[float, float], state: Array
) -> dict[str, Array]:
    """See ``TwoNetworkModel.free_run``."""
    force, state = (np.ascontiguousarray(values, dtype=np.float64) for values in (force, state))
    _check(model, state, force=force)
    if not model.mass > 0:
        raise UsageError("a free run needs a mass above 0 kg; this model was identified with F as the restoring force")
    if not dt > 0:
        raise UsageError(f"the time step must be above 0 s, found {dt}")
    rows = {name: np.zeros(len(force)) for name in ("x", "v", "a", "R")}
    if not len(force):
        return rows
    rows["x"][0], rows["v"][0] = start
    state = state.copy()
    library = _library()
    if library is None:
        with np.errstate(over="ignore", invalid="ignore"):  # divergence is found and named below
            done = _free_run_numpy(model, force, dt, state, **rows)
    else:
        arrays = (_pointer(values) for values in (force, state, *rows.values()))
        numbers = (ctypes.c_double(model.mass), ctypes.c_double(dt), ctypes.c_long(len(force)))
        done = _done(library.hystid_free_run(*_description(model), *numbers, *arrays))
    if done < len(force):
        raise NumericalError(
            f"the free run of the surrogate diverged at t = {done * dt:.6g} s: the force drives it outside "
            f"the motion it was trained on, or the step of {dt:.3g} s is too long"
        )
    return rows


def _check(model: TwoNetworkModel, state: Array, **signals: Array) -> None:
    shapes = {name: values.shape for name, values in signals.items()}
    if any(len(shape) != 1 for shape in shapes.values()) or len(set(shapes.values())) != 1:
        raise UsageError(f"{' and '.join(shapes)} must be one-dimensional and of one length, found {shapes}")
    if state.shape != (2 + 2 * len(model.members),):
        raise UsageError(f"the state must have shape ({2 + 2 * len(model.members)},), found {state.shape}")
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


def _pointer(values: Array) -> ctypes.c_void_p:
    return values.ctypes.data_as(ctypes.c_void_p)


def _description(model: TwoNetworkModel) -> tuple[object, ...]:
    first = model.members[0]
    sizes = np.array([*first.hysteresis.sizes, *first.restoring.sizes], dtype=np.int32)
    return (
        len(model.members),
        sizes.ctypes.data_as(ctypes.c_void_p),
        len(first.hysteresis.layers),
        len(first.restoring.layers),
        _pointer(interleaved([member.hysteresis for member in model.members])),
        _pointer(interleaved([member.restoring for member in model.members])),
        ctypes.c_double(model.velocity_band),
    )


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
    """One model in NumPy, step by step; ``state`` is changed in place. The C kernel does the same."""

    def __init__(self, model: TwoNetworkModel, state: Array) -> None:
        members = len(model.members)
        self.model, self.memory = model, state[:2]
        self.latest, self.held = state[2 : 2 + members], state[2 + members :]

    def evaluate(self, x: float, v: float) -> tuple[float, Array]:
        """R and each member's Rh with the memory as it stands."""
        x0, members = self.memory[1], self.model.members
        hysteretic = np.array([m.hysteresis(x, x0, h)[0] for m, h in zip(members, self.held, strict=True)])
        forces = [m.restoring(x, v, h)[0] for m, h in zip(members, hysteretic, strict=True)]
        return float(np.mean(forces)), hysteretic

    def accept(self, x: float, v: float) -> float:
        """Renew the memory at a sample and return R there."""
        last, fast = self.memory[0], abs(v) >= self.model.velocity_band
        if last == 0 or (fast and last * v <= 0):
            self.memory[1] = x
            self.held[:] = self.latest
        if fast:
            self.memory[0] = v
        force, self.latest[:] = self.evaluate(x, v)
        return force


def _response_numpy(model: TwoNetworkModel, x: Array, v: Array, state: Array, force: Array, hysteretic: Array) -> None:
    stepper = _Stepper(model, state)
    for k in range(len(x)):
        force[k] = stepper.accept(x[k], v[k])
        hysteretic[k] = stepper.latest


def _free_run_numpy(
    model: TwoNetworkModel, force: Array, dt: float, state: Array, x: Array, v: Array, a: Array, R: Array
) -> int:
    stepper, mass = _Stepper(model, state), model.mass
    for k in range(len(force)):
        R[k] = stepper.accept(x[k], v[k])
        a[k] = (force[k] - R[k]) / mass
        if not np.abs([x[k], v[k], a[k]]).max() < _HUGE_MOTION:
            return k
        if k + 1 == len(force):
            break
        middle = 0.5 * (force[k] + force[k + 1])
        v1, a1 = v[k], a[k]
        v2 = v1 + 0.5 * dt * a1
        a2 = (middle - stepper.evaluate(x[k] + 0.5 * dt * v1, v2)[0]) / mass
        v3 = v1 + 0.5 * dt * a2
        a3 = (middle - stepper.evaluate(x[k] + 0.5 * dt * v2, v3)[0]) / mass
        v4 = v1 + dt * a3
        a4 = (force[k + 1] - stepper.evaluate(x[k] + dt * v3, v4)[0]) / mass
        x[k + 1] = x[k] + dt / 6 * (v1 + 2 * (v2 + v3) + v4)
        v[k + 1] = v1 + dt / 6 * (a1 + 2 * (a2 + a3) + a4)
    return len(force)
