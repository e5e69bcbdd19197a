"""Excitation forces from one line of text.

    chirp:0-100Hz@60N,5s          linear sweep of constant amplitude 60 N
    harmonic:20Hz@80N,2s          sine
    multisine:5-80Hz@30Nrms,4s    all multiples of 1/4 Hz in the band, random phases (seeded), 30 N rms
    multisine-odd:5-80Hz@30Nrms,4s   odd multiples only, so that even harmonics of the answer show by themselves

Prefixes are understood (``1.5kN``, ``800ms``, ``2kHz``). Anything else is taken as the name of a recording.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, cast

import numpy as np

from hystid.errors import UsageError
from hystid.limits import FORCE_SAMPLES, check_whole
from hystid.numeric import Array
from hystid.units import to_si

Kind = Literal["chirp", "harmonic", "multisine", "multisine-odd"]
EXAMPLES = "chirp:0-100Hz@60N,5s or harmonic:20Hz@80N,2s or multisine:5-80Hz@30Nrms,4s"

_NUMBER = r"[+]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?"
_SPEC = re.compile(
    rf"^(?P<kind>[a-z-]+):(?P<low>{_NUMBER})(?:-(?P<high>{_NUMBER}))?(?P<fu>[kM]?Hz)"
    rf"@(?P<level>{_NUMBER})(?P<lu>[mkM]?N)(?P<rms>rms)?,(?P<time>{_NUMBER})(?P<tu>m?s|min)$"
)


@dataclass(frozen=True)
class Excitation:
    """A force over time.

    low, high [Hz], equal for a harmonic; level [N]: largest value, or rms where ``rms`` is set; duration [s].
    """

    kind: Kind
    low: float
    high: float
    level: float
    rms: bool
    duration: float

    def force(self, dt: float, seed: int = 0) -> Array:
        """The force [N] at 0, dt, ..., shape (round(duration / dt),). seed: of the phases of a multisine.

        Raises UsageError when the highest frequency has fewer than two samples a period.
        """
        if self.duration > FORCE_SAMPLES.value * dt:
            raise UsageError(
                f"{self.duration:g} s in steps of {dt:g} s are more than {FORCE_SAMPLES}; take longer steps"
            )
        check_whole("--seed", seed, 0)
        n = round(self.duration / dt)
        if n < 2 or self.high >= 0.5 / dt:
            raise UsageError(
                f"a step of {dt:g} s cannot carry {self.high:g} Hz for {self.duration:g} s;"
                f" use at most {0.05 / self.high:.3g} s"
            )
        shape = _SHAPES[self.kind](self, dt * np.arange(n, dtype=np.float64), seed)
        size = np.sqrt(np.mean(shape**2)) if self.rms else np.max(np.abs(shape)) if "multisine" in self.kind else 1.0
        return np.asarray(self.level / size * shape, dtype=np.float64)


def is_specification(text: str) -> bool:
    """Whether text is meant as a specification rather than a file: it starts with a kind and a colon."""
    return text.partition(":")[0].strip().lower() in _SHAPES and ":" in text


def parse(text: str) -> Excitation:
    """Read a specification. Raises UsageError in one sentence with an example."""
    match = _SPEC.match(re.sub(r"\s+", "", text))
    if not match or match["kind"] not in _SHAPES:
        asked = text.partition(":")[0]
        known = "" if asked in _SHAPES else f" (kinds are {', '.join(_SHAPES)})"
        raise UsageError(f"force '{text}' cannot be read{known}; write it as {EXAMPLES}")
    hertz = to_si(match["fu"], "Hz")[0]
    low = float(match["low"]) * hertz
    high = float(match["high"]) * hertz if match["high"] else low
    level = float(match["level"]) * to_si(match["lu"], "N")[0]
    duration = float(match["time"]) * to_si(match["tu"], "s")[0]
    kind = cast(Kind, match["kind"])
    return _checked(text, Excitation(kind, low, high, level, bool(match["rms"]), duration))


def _checked(text: str, asked: Excitation) -> Excitation:
    band = asked.kind != "harmonic"
    rules = (
        (asked.duration > 0, "the duration must be more than 0 s"),
        (asked.level > 0, "the force must be more than 0 N"),
        (not band or asked.high > asked.low, "two frequencies are needed, the lower one first"),
        (band or asked.high == asked.low > 0, "one frequency above 0 Hz is needed"),
        (math.isfinite(asked.level * asked.duration * asked.high), "the numbers must be finite"),
    )
    for holds, rule in rules:
        if not holds:
            raise UsageError(f"force '{text}': {rule}; write it as {EXAMPLES}")
    return asked


def _chirp(asked: Excitation, t: Array, seed: int) -> Array:
    rate = (asked.high - asked.low) / asked.duration
    return np.asarray(np.sin(2 * np.pi * (asked.low * t + 0.5 * rate * t**2)))


def _harmonic(asked: Excitation, t: Array, seed: int) -> Array:
    return np.asarray(np.sin(2 * np.pi * asked.low * t))


def _multisine(asked: Excitation, t: Array, seed: int) -> Array:
    """Sum of equal cosines at multiples of 1/duration with random phases."""
    n, resolution = t.size, 1 / (t.size * (t[1] - t[0]))
    lines = np.arange(max(math.ceil(asked.low / resolution), 1), math.floor(asked.high / resolution) + 1)
    if asked.kind == "multisine-odd":
        lines = lines[lines % 2 == 1]
    if not lines.size:
        raise UsageError(f"the band {asked.low:g}-{asked.high:g} Hz holds no line of {resolution:g} Hz; make it longer")
    spectrum = np.zeros(n // 2 + 1, dtype=np.complex128)
    spectrum[lines] = np.exp(2j * np.pi * np.random.default_rng(seed).random(lines.size))
    return np.asarray(np.fft.irfft(spectrum, n))


_SHAPES: dict[str, Callable[[Excitation, Array, int], Array]] = {
    "chirp": _chirp,
    "harmonic": _harmonic,
    "multisine": _multisine,
    "multisine-odd": _multisine,
}
