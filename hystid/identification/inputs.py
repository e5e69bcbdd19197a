"""Further inputs of a model: which columns of the recordings they are, and whether an unused one should be one."""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np

from hystid.errors import RecordingError, UsageError
from hystid.networks import FurtherInput, Lag
from hystid.networks.training import draw
from hystid.recording import CHANNELS, Array, Recording

_TAKEN = {"t", "time", *CHANNELS, "m", "state", "state_next", "R_spread", "x_start", "v_start", "R_start"}
_BLOCKS = 10  # of each recording, left out in turn
_SAMPLES = 50_000  # of all recordings: thousands for each coefficient
_WORTH = 0.1  # of the residual's power: an input that explains less lowers the NRMSE by less than a twentieth of itself
_SAME_FORCE = 1e-3  # of the force's power: what is left when force is a linear function of motion and column


def resolve(recordings: Sequence[Recording], names: Sequence[str]) -> tuple[FurtherInput, ...]:
    """The further inputs that columns of the recordings are; checked in all of them.

    Raises UsageError (a channel, twice, no such column, no unit) and RecordingError (not finite).
    """
    ports: list[FurtherInput] = []
    for name in names:
        if name in CHANNELS:
            raise UsageError(f"--input {name}: this is a channel of every recording, not a further input")
        port = FurtherInput(_identifier(name), _unit(recordings, name), name)
        if port.name in {other.name for other in ports}:
            raise UsageError(f"--input {name}: given twice, or it reads like another input ({port.name})")
        for recording in recordings:
            bad = np.flatnonzero(~np.isfinite(recording.extra[name]))
            if len(bad):
                raise RecordingError(f"{recording.name}: {name} is not finite at sample {bad[0]}")
        ports.append(port)
    return tuple(ports)


def check_range(training: Sequence[Recording], inputs: Sequence[FurtherInput]) -> None:
    """Raise UsageError for an input with one value only in all training recordings."""
    for port in inputs:
        values = [recording.extra[port.column] for recording in training]
        if min(v.min() for v in values) == max(v.max() for v in values):
            raise UsageError(
                f"--input {port.column}: it is {values[0][0]:g} {port.unit} throughout the training recordings, so "
                "there is nothing to learn from it; add recordings at other values, or leave it out"
            )


def check_lags(lags: Sequence[Lag], inputs: Sequence[FurtherInput]) -> None:
    """Raise UsageError for a lag of something that is no input, or with a time that is none."""
    known = {"v", *(port.name for port in inputs)}
    for lag in lags:
        if lag.source not in known or not 0 < lag.time < np.inf:
            raise UsageError(
                f"a lag of {lag.source} by {lag.time:g} s: it needs a time above 0 s and one of "
                f"{', '.join(sorted(known))}"
            )


def columns_of(recording: Recording, inputs: Sequence[FurtherInput]) -> dict[str, Array]:
    """Values of the further inputs by port name, shape (n,) each, in their units."""
    return {port.name: recording.channel(port.column) for port in inputs}


def table_of(recording: Recording, inputs: Sequence[FurtherInput], lags: Sequence[Lag] = ()) -> Array:
    """What the networks see of them, and then the lags, as rows: shape (inputs + lags, n)."""
    sources = {port.name: port.seen(recording.channel(port.column)) for port in inputs}
    rows = [*sources.values()]
    rows += [
        lag.follow(recording.channel("v") if lag.source == "v" else sources[lag.source], recording.dt) for lag in lags
    ]
    return np.stack(rows) if rows else np.zeros((0, len(recording)))


def _identifier(name: str) -> str:
    plain = re.sub(r"\W", "_", name, flags=re.ASCII).strip("_") or "input"
    plain = plain if not plain[0].isdigit() else f"input_{plain}"
    return f"{plain}_input" if plain in _TAKEN else plain


def _unit(recordings: Sequence[Recording], name: str) -> str:
    units = {}
    for recording in recordings:
        if name not in recording.extra:
            known = ", ".join(recording.extra) or "none"
            raise UsageError(
                f"--input {name}: {recording.name} has no such column (its further columns: {known}); "
                f"give its value as --input {name}={recording.name}:VALUE"
            )
        if name not in recording.units:
            raise UsageError(f"--input {name}: the column has no known unit in {recording.name}: write '{name} [unit]'")
        units[recording.units[name]] = recording.name
    if len(units) > 1:
        (one, first), (two, second), *_ = units.items()
        raise UsageError(f"--input {name}: it is in {one} in {first} but in {two} in {second}")
    return next(iter(units))


def unused_columns(
    recordings: Sequence[Recording], forces: Sequence[Array], inputs: Sequence[FurtherInput]
) -> tuple[str, ...]:
    """Sentences on columns that are no inputs but explain the model's residual; forces: R of the model [N].

    The residual is fitted by u, u^2, and their products with the model's force, velocity and its sign, where u is the
    column, with blocks of the recordings left out in turn. A column counts where the fit explains a tenth of the
    residual's power on the blocks that it has not seen.
    A column that, with the motion, gives the measured force exactly is the force in other units, or commands it.
    """
    used = {port.column for port in inputs}
    shared = [name for name in recordings[0].extra if name not in used and all(name in r.units for r in recordings)]
    found = []
    for name in shared:
        columns = [recording.extra[name] for recording in recordings]
        values = np.concatenate(columns)
        if not np.isfinite(values).all() or np.ptp(values) == 0 or _is_force(recordings, values):
            continue
        share = _explained(recordings, forces, columns)
        if share >= _WORTH:
            found.append((share, name))
    return tuple(
        f"column {name} explains {100 * share:.0f} % of what the model leaves (left-out stretches): if it acts on the "
        f"device, and is no answer of it, add --input {name}"
        for share, name in sorted(found, reverse=True)
    )


def _is_force(recordings: Sequence[Recording], values: Array) -> bool:
    R = np.concatenate([recording.channel("R") for recording in recordings])
    force = [r.F if r.F is not None else r.channel("R") for r in recordings]
    motion = [np.concatenate([recording.channel(name) for recording in recordings]) for name in ("x", "v")]
    table = np.stack([values, *motion, np.ones_like(values)])
    for target in (np.concatenate(force), R):
        left = target - _fitted(table, target, table)
        if np.mean(left**2) < _SAME_FORCE * np.var(target):
            return True
    return False


def _explained(recordings: Sequence[Recording], forces: Sequence[Array], columns: Sequence[Array]) -> float:
    """Share of the residual's power that the column explains on blocks that were left out."""
    some = draw(sum(len(recording) for recording in recordings), _SAMPLES, 0)
    left_over = [r.channel("R") - force for r, force in zip(recordings, forces, strict=True)]
    blocks = [np.arange(len(r)) * _BLOCKS // len(r) for r in recordings]
    speeds = [r.channel("v") for r in recordings]
    residual, v, force, u, block = (
        np.concatenate(parts)[some] for parts in (left_over, speeds, list(forces), list(columns), blocks)
    )
    centred = (u - u.mean()) / np.ptp(u)
    plain = np.stack([np.ones_like(u), v / np.std(v), np.sign(v), force / (np.std(force) or 1.0)])
    table = np.concatenate([plain, centred * plain, centred**2 * plain])
    left = {"with": 0.0, "without": 0.0}
    for k in range(_BLOCKS):
        out = block == k
        for name, rows in (("with", table), ("without", plain)):
            left[name] += float(np.sum((residual[out] - _fitted(rows[:, ~out], residual[~out], rows[:, out])) ** 2))
    return (left["without"] - left["with"]) / float(np.sum(residual**2))


def _fitted(rows: Array, target: Array, at: Array) -> Array:
    """Values of the linear fit of target on rows, shape (features, n), at the columns of ``at``."""
    scale = np.abs(rows).max(axis=1)
    scale[scale == 0] = 1.0
    solution = np.linalg.lstsq((rows / scale[:, None]).T, target, rcond=None)[0]
    return np.asarray((solution / scale) @ at)
