"""How far a model is from a recording: the one source of the errors that identify, validate and diagnose report."""

from __future__ import annotations

from collections.abc import Mapping

from hystid.comparison import mse, nrmse
from hystid.errors import NumericalError, RecordingError
from hystid.recording import Array, Recording


def start_of(record: Recording) -> dict[str, float]:
    """x [m], v [m/s] and R [N] of the first sample, as recorded: where every model begins."""
    return {name: float(record.channel(name)[0]) for name in ("x", "v", "R")}


def force_error(record: Recording, R: Array) -> float:
    """NRMSE of a force (n,) on the recorded motion. Raises RecordingError where R of the recording is constant."""
    return _nrmse(record, R, "R")


def run_errors(record: Recording, run: Mapping[str, Array]) -> dict[str, float]:
    """Errors of a free run: NRMSE and mean square of x and R, every sample alike. Errors as for ``force_error``."""
    return {
        "x_nrmse": _nrmse(record, run["x"], "x"),
        "R_nrmse": _nrmse(record, run["R"], "R"),
        "x_mse": mse(run["x"], record.channel("x")),
        "R_mse": mse(run["R"], record.channel("R")),
    }


def _nrmse(record: Recording, values: Array, channel: str) -> float:
    try:
        return nrmse(values, record.channel(channel))
    except NumericalError as error:
        raise RecordingError(f"{record.name}: channel {channel}: {error}") from error
