"""Recordings: motion and force of one test, on one uniform time grid, in SI units.

Measured and simulated data are the same type. m a + R = F; a = dv/dt; R opposes motion as a spring does.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

PSEUDO_TIME = "sample numbers, not a measured time"

CHANNELS = {"F": "N", "x": "m", "v": "m/s", "a": "m/s2", "R": "N"}


@dataclass(frozen=True)
class Recording:
    """One test. All arrays have shape (n,), float64, SI units, and share the uniform grid ``t`` [s].

    Channels that were not recorded are None until derived; ``origin`` says of each channel whether it was
    "measured" or how it was derived; ``notes`` lists what was done to the data, in order, in sentences;
    ``warnings`` lists what is doubtful about the data, in sentences.
    ``extra`` keeps further columns of the file (SI where the unit was known).
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

    def __len__(self) -> int:
        return len(self.t)

    @property
    def dt(self) -> float:
        """Time between two samples [s]."""
        return float((self.t[-1] - self.t[0]) / (len(self.t) - 1))

    @property
    def sample_rate(self) -> float:
        """Samples per second [Hz]."""
        return 1.0 / self.dt

    @property
    def quasi_static(self) -> bool:
        """Whether ``t`` only numbers the samples: rates then have no physical scale and inertia cannot be had."""
        return self.origin.get("t") == PSEUDO_TIME

    def channel(self, name: str) -> Array:
        """The named channel, shape (n,); KeyError-free: raises RecordingError naming the recording when absent."""
        from hystid.errors import RecordingError

        values = getattr(self, name, None) if name in CHANNELS else self.extra.get(name)
        if values is None:
            raise RecordingError(f"{self.name}: channel {name} is needed here but neither recorded nor derived")
        return np.asarray(values)
