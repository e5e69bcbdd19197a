"""What a surrogate does where it is not compared with anything: does it dissipate, does it forget how it started.

A restoring force of friction and hysteresis takes energy out of every closed cycle. A network knows nothing of that:
one that feeds energy in drives an oscillator away, however small its error on recordings (passivity; Willems, 1972).
Harmonic cycles over the training range are a necessary test, not a proof for every motion.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from hystid.comparison import loop_energy
from hystid.recording import Recording
from hystid.validation.surrogate import Surrogate

_SHARES = (0.1, 0.3, 0.6, 0.95)  # of the displacement range, whose very ends would make the file warn
_SPEEDS = (0.1, 0.3, 0.95)  # of the velocity range
_LEVELS = (0.5, 0.0, 1.0)  # of the ranges of the further inputs, where there are any
_CYCLES = 4
_LONGEST_CYCLE, _SHORTEST_CYCLE = 20_000, 40  # samples per cycle
_LOSSLESS = -1e-3  # of pi x amplitude x force: below, energy is fed in; above, it is rounding or a lossless law


@dataclass(frozen=True)
class Cycle:
    """One steady harmonic motion. amplitude [m], frequency [Hz], energy [J] taken out in the last cycle; further: where
    the further inputs stood, as a fraction of their training range.

    loss: energy over pi * amplitude * greatest force of the cycle: 1 for a force in phase with the velocity, 0 for a
    spring, negative where energy is fed in.
    """

    amplitude: float
    frequency: float
    energy: float
    loss: float
    further: float = 0.5


@dataclass(frozen=True)
class Stability:
    """cycles: over the training range; remembered: what is left, after four cycles at full amplitude, of a difference
    of the starting force as large as the training range (fraction), NaN where the file has no range of the force."""

    cycles: tuple[Cycle, ...]
    remembered: float

    @property
    def least(self) -> Cycle:
        """The cycle that dissipates least."""
        return min(self.cycles, key=lambda cycle: cycle.loss)

    @property
    def feeding(self) -> tuple[Cycle, ...]:
        """Cycles in which energy is fed in."""
        return tuple(cycle for cycle in self.cycles if cycle.loss < _LOSSLESS)

    def as_dict(self) -> dict[str, Any]:
        """Entry ``stability`` in validation.json."""
        keys = ("amplitude", "frequency", "loss", "further")
        columns = {key: [getattr(cycle, key) for cycle in self.cycles] for key in keys}
        return {**columns, "feeding": len(self.feeding), "remembered": self.remembered}


def stability(model: Surrogate) -> Stability | None:
    """Harmonic motions over the surrogate's training range; None where the file does not tell one."""
    limits = model.training_range
    if not {"x", "v"} <= set(limits) or model.sample_rate is None:
        return None
    x_most, v_most = (min(abs(bound) for bound in limits[name]) for name in ("x", "v"))
    if not (x_most > 0 and v_most > 0):
        return None
    cycles = []
    for amplitude in (share * x_most for share in _SHARES):
        wanted = [model.sample_rate * 2 * np.pi * amplitude / (speed * v_most) for speed in _SPEEDS]
        for samples in sorted({round(float(np.clip(count, _SHORTEST_CYCLE, _LONGEST_CYCLE))) for count in wanted}):
            cycles += [
                _cycle(model, amplitude, samples, level) for level in _LEVELS[: len(_LEVELS) if model.inputs else 1]
            ]
    return Stability(tuple(cycles), _remembered(model, _SHARES[-1] * x_most))


def _motion(model: Surrogate, amplitude: float, samples: int, start: float = 0.0, level: float = 0.5) -> Recording:
    assert model.sample_rate is not None
    dt = 1 / model.sample_rate
    phase = 2 * np.pi * np.arange(_CYCLES * samples + 1) / samples
    v = amplitude * 2 * np.pi / (samples * dt) * np.cos(phase)
    rest = np.full(phase.size, start)
    t = np.asarray(dt * np.arange(phase.size), dtype=np.float64)
    limits = {port: model.training_range.get(port.name, (0.0, 0.0)) for port in model.inputs}
    extra = {port.column: np.full(phase.size, low + level * (high - low)) for port, (low, high) in limits.items()}
    units = {port.column: port.unit for port in model.inputs}
    return Recording("cycle", t, x=amplitude * np.sin(phase), v=v, R=rest, F=0 * rest, extra=extra, units=units)


def _cycle(model: Surrogate, amplitude: float, samples: int, level: float) -> Cycle:
    motion = _motion(model, amplitude, samples, level=level)
    last = slice(-samples - 1, None)
    force = model.force(motion)[last]
    energy = loop_energy(motion.channel("x")[last], force)
    swing = float(np.ptp(force)) / 2
    loss = energy / (np.pi * amplitude * swing) if swing else 0.0
    return Cycle(amplitude, motion.sample_rate / samples, energy, float(loss), level)


def _remembered(model: Surrogate, amplitude: float) -> float:
    if "R" not in model.training_range:
        return float("nan")
    low, high = model.training_range["R"]
    assert model.sample_rate is not None
    v_most = _SPEEDS[-1] * min(abs(bound) for bound in model.training_range["v"])
    samples = round(float(np.clip(model.sample_rate * 2 * np.pi * amplitude / v_most, _SHORTEST_CYCLE, _LONGEST_CYCLE)))
    forces = [model.force(_motion(model, amplitude, samples, start)) for start in (low, high)]
    last = slice(-samples, None)
    return float(np.max(np.abs(forces[1][last] - forces[0][last])) / (high - low))
