"""Recordings: motion and force of one test, on one uniform time grid, in SI units.

Measured and simulated data are the same type. m a + R = F; a = dv/dt; R opposes motion as a spring does.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from hystid.errors import RecordingError, printable
from hystid.files import atomic
from hystid.numeric import Array
from hystid.results import Result

PSEUDO_TIME = "sample numbers, not a measured time"

CHANNELS = {"F": "N", "x": "m", "v": "m/s", "a": "m/s2", "R": "N"}
ROTATIONAL = {"F": "N.m", "x": "rad", "v": "rad/s", "a": "rad/s2", "R": "N.m"}


@dataclass(frozen=True)
class Recording(Result, report="recording"):
    """One test. All arrays have shape (n,), float64, SI units, and share the uniform grid ``t`` [s].

    Channels that were not recorded are None until derived; ``origin`` says of each channel whether it was
    "measured" or how it was derived; ``notes`` lists what was done to the data, in order, in sentences;
    ``warnings`` lists what is doubtful about the data, in sentences.
    ``extra`` keeps further columns of the file (SI where the unit was known). ``name`` is one line that prints.
    ``rotational``: F is a torque [N.m], x an angle [rad], R a torque, and the mass an inertia [kg.m2]; the equations
    stay. ``units``: per channel the unit that the file states, "" where it states none; per further column the SI unit
    of its values ("1" for a plain number), where its unit is known. ``accepted``: rules of the door whose errors are
    warnings for this recording.
    """

    name: str
    t: Array
    F: Array | None = None
    x: Array | None = None
    v: Array | None = None
    a: Array | None = None
    R: Array | None = None
    extra: Mapping[str, Array] = field(default_factory=dict)
    origin: Mapping[str, str] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()
    rotational: bool = False
    units: Mapping[str, str] = field(default_factory=dict)
    accepted: frozenset[str] = frozenset()

    def __post_init__(self) -> None:
        object.__setattr__(self, "name", printable(str(self.name), 200))
        for column in ("t", *CHANNELS):
            object.__setattr__(self, column, _as_array(getattr(self, column)))
        object.__setattr__(self, "extra", {name: _as_array(values) for name, values in self.extra.items()})

    def __len__(self) -> int:
        return len(self.t)

    def save(self, path: str | Path, command: str = "") -> Path:
        """Write the recording as CSV with units in its headers (``write_csv``); returns the path."""
        write_csv(self, path, comments=(command,) if command else ())
        return Path(path)

    @property
    def dt(self) -> float:
        """Time between two samples [s]. Raises RecordingError where there are fewer than two."""
        if len(self.t) < 2:
            raise RecordingError(f"{self.name}: at least two samples are needed for a time step, found {len(self.t)}")
        return float((self.t[-1] - self.t[0]) / (len(self.t) - 1))

    @property
    def sample_rate(self) -> float:
        """Samples per second [Hz]."""
        return 1.0 / self.dt

    @property
    def quasi_static(self) -> bool:
        """Whether ``t`` only numbers the samples: rates then have no physical scale and inertia cannot be had."""
        return self.origin.get("t") == PSEUDO_TIME

    def direct(self, name: str) -> bool:
        """Whether the channel is there as a sensor or a simulation gave it, and not derived from other channels."""
        origin = self.origin.get(name, "measured")
        return getattr(self, name) is not None and origin.startswith(("measured", "simulated"))

    def unit(self, name: str) -> str:
        """SI unit of a channel: "N" or "N.m" for F, "s" for t."""
        return {"t": "s", **(ROTATIONAL if self.rotational else CHANNELS)}[name]

    def channel(self, name: str) -> Array:
        """The named channel, shape (n,); KeyError-free: raises RecordingError naming the recording when absent."""
        values = getattr(self, name, None) if name in CHANNELS else self.extra.get(name)
        if values is None:
            raise RecordingError(f"{self.name}: channel {name} is needed here but neither recorded nor derived")
        return np.asarray(values)

    def channels(self, names: Iterable[str] = CHANNELS) -> dict[str, Array]:
        """Those of the named channels that are there, shape (n,) each."""
        held = {name: getattr(self, name) for name in names}
        return {name: np.asarray(values, np.float64) for name, values in held.items() if values is not None}

    def with_channels(self, channels: Mapping[str, Array | None], *notes: str) -> Recording:
        """The same with other values of some channels (None: without it), and further notes."""
        return replace(self, notes=(*self.notes, *notes), **channels)  # type: ignore[arg-type]  # names of channels

    def part(self, kept: slice, *notes: str) -> Recording:
        """The samples of a slice, in all channels and further columns, with further notes."""
        extra = {name: values[kept] for name, values in self.extra.items()}
        cut = {name: values[kept] for name, values in self.channels().items()}
        return replace(self, t=self.t[kept], extra=extra).with_channels(cut, *notes)


def _as_array(values: Any) -> Any:
    """Numbers of a list, a data frame's column or a narrower array as float64; what holds none is left for
    ``validated`` to refuse. Masked samples are no numbers."""
    if values is None or np.asarray(values).dtype.kind not in "fiub":
        return values
    if isinstance(values, np.ma.MaskedArray):
        return np.ma.filled(values.astype(np.float64), np.nan)
    return np.asarray(values, np.float64)


def write_csv(recording: Recording, path: str | Path, *, comments: tuple[str, ...] = ()) -> None:
    """Write ``t`` and every channel that is there, then the extra columns, atomically.

    Numbers are written with 17 significant digits, so that reading gives the same float64 values back for every
    channel. comments, the recording's notes and the origin of derived channels stand in lines that start with "#".
    """
    present = recording.channels()
    time = "t_pseudo" if recording.quasi_static else "t"
    headers = [f"{time} [s]", *(f"{name} [{recording.unit(name)}]" for name in present), *_extra_headers(recording)]
    columns = [recording.t, *present.values(), *recording.extra.values()]
    derived = [f"{name}: {text}" for name, text in recording.origin.items() if text != "measured"]
    lines = [recording.name, *comments, *recording.notes, *derived]
    with atomic(Path(path)) as beside, beside.open("w", encoding="utf-8", newline="\n") as file:
        file.writelines(f"# {part}\n" for text in lines for part in text.splitlines())
        file.write(",".join(headers) + "\n")
        np.savetxt(file, np.column_stack(columns), fmt="%.17g", delimiter=",")


def _extra_headers(recording: Recording) -> list[str]:
    return [f"{name} [{recording.units[name]}]" if name in recording.units else name for name in recording.extra]
