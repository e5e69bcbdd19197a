"""One signal of a replay beside its reference: real numbers in a tolerance tube, everything else value by value."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hystid.comparison import Tube, neighbours, tube
from hystid.errors import printable
from hystid.fmu.signals import Signal
from hystid.numeric import Array

_DIGITS = 5e-7  # a reference is written with seven digits: half a unit of the last, relative to the value


@dataclass(frozen=True)
class Tolerance:
    """relative: half height of the tube, as part of the signal's range. samples: its half width in rows; a discrete
    signal may take the value of any of these rows."""

    relative: float = 1e-3
    samples: int = 1


@dataclass(frozen=True)
class SignalResult:
    """One signal: new values (n,) beside the reference (n,), and the tube around the latter.

    unit: of the values. labels: of a signal of texts, whose values are places in this list. exact: compared value by
    value.
    """

    name: str
    values: Array
    reference: Array
    tube: Tube
    exact: bool = False
    labels: tuple[str, ...] = ()
    unit: str = ""

    @property
    def first_outside(self) -> int | None:
        """First sample outside the tube, None where all are inside."""
        return int(np.argmax(self.tube.outside)) if np.any(self.tube.outside) else None

    def text(self, t: Array) -> str:
        """What became of the signal, in words; t: the times (n,) [s]."""
        first = self.first_outside
        if first is None:
            return "as in the reference" if self.exact else "within the tube"
        if self.exact:
            now, then = self._shown(self.values[first]), self._shown(self.reference[first])
            return f"is {now} at t = {t[first]:.6g} s, where the reference has {then}"
        return f"leaves the tube at t = {t[first]:.6g} s, by up to {self.tube.worst:.3g} {self.unit}".rstrip()

    def _shown(self, value: float) -> str:
        return f"'{printable(self.labels[int(value)], 200)}'" if self.labels else f"{value:.17g}"


def compared(
    signal: Signal, values: NDArray[Any], reference: NDArray[Any], tolerance: Tolerance
) -> Iterator[SignalResult]:
    """One result per element; values and reference are (n,), of an array (n, size)."""
    names = [signal.name] if not signal.shape or signal.is_text else [v.name for v in signal.elements()]
    n = len(reference)
    for name, new, old in zip(names, values.reshape(n, -1).T, reference.reshape(n, -1).T, strict=True):
        if signal.is_real:
            rounding = _DIGITS * float(np.max(np.abs(old), where=np.isfinite(old), initial=0.0))
            band = tube(new, old, relative=tolerance.relative, absolute=rounding, samples=tolerance.samples)
            yield SignalResult(name, new, old, band, unit="" if signal.unit == "1" else signal.unit)
        else:
            yield _exactly(name, new, old, tolerance.samples)


def _exactly(name: str, values: NDArray[Any], reference: NDArray[Any], samples: int) -> SignalResult:
    outside = ~np.any(neighbours(reference, samples) == values[:, None], axis=1)
    labels: tuple[str, ...] = ()
    if reference.dtype == object:
        labels = tuple(sorted({*map(str, values), *map(str, reference)}))
        places = {label: float(i) for i, label in enumerate(labels)}
        values = np.array([places[str(v)] for v in values])
        reference = np.array([places[str(v)] for v in reference])
    new, old = values.astype(np.float64), reference.astype(np.float64)
    windows = neighbours(old, samples)
    band = Tube(windows.min(axis=1), windows.max(axis=1), outside, float(np.sum(outside)))
    return SignalResult(name, new, old, band, exact=True, labels=labels)
