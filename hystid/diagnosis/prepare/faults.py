"""Faults of one channel: what they are, and how they are told."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

UNITS = {"x": "m", "v": "m/s", "a": "m/s2", "F": "N"}
DELAY, GAIN, ZERO, DEAD, SATURATION, COUPLED = (
    "channel_delay",
    "channel_gain",
    "channel_zero",
    "dead_channel",
    "sensor_saturation",
    "ac_coupled_channel",
)
CALIBRATION = 0.035  # relative gain that calibration and weighing leave: class 3 accelerometers; more is a fault


@dataclass(frozen=True)
class Fault:
    """A fault of one channel.

    size: delay in samples; level at which the channel stops, or its zero (its unit); gain; largest correlation with the
    other channels where it is dead; corner of its AC coupling [rad/s]. stderr: its standard error, from the scatter
    between sections of the recordings. share: share of the samples that it touches; of a zero, its size over the
    standard deviation of the channel. seconds: delay in seconds. left_out: whether the channel is left out for it.
    """

    id: str
    channel: str
    size: float
    stderr: float
    share: float = 1.0
    seconds: float = 0.0
    left_out: bool = False

    def sentence(self) -> str:
        """What was done about it, for people."""
        name, unit = self.channel, UNITS[self.channel]
        if self.id == DELAY:
            error = self.stderr * abs(self.seconds / self.size) if self.size else 0.0
            side = "late" if self.seconds > 0 else "early"
            return (
                f"channel {name} is {1e3 * abs(self.seconds):.4g} ms ({1e3 * error:.2g}) {side} against the other "
                f"channels, {abs(self.size):.3g} samples: moved back"
            )
        if self.id == GAIN:
            return (
                f"channel {name} reads {self.size:.4g} ({self.stderr:.2g}) times what the other channels say: divided"
            )
        if self.id == ZERO:
            return (
                f"channel {name} has a zero of {self.size:.3g} {unit} ({self.stderr:.2g}), {100 * self.share:.2g} % of "
                "its standard deviation, which the other channels do not show: taken out"
            )
        if self.id == COUPLED:
            corner, error = (value / (2 * np.pi) for value in (self.size, self.stderr))
            known = f" ({error:.1g})" if error > 1e-6 * corner else ""  # what was computed from another is exact
            done = "left out" if self.left_out else "what it lost is put back"
            return f"channel {name} leads as an AC-coupled sensor does, with a corner at {corner:.3g}{known} Hz: {done}"
        if self.id == DEAD:
            return f"channel {name} does not follow the motion that the other channels agree on: left out"
        return f"channel {name} stops at {self.size:.4g} {unit}, in {100 * self.share:.2g} % of the samples"
