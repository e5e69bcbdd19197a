"""Turning-point block: the memory that turns a static network into a hysteresis model.

At each sample the block holds the displacement x0 and the force Rh0 at the last reversal of the motion. The branch of a
rate-independent loop starts there (Masing, 1926), so x, x0 and Rh0 together tell where on which branch the motion is.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hystid.errors import UsageError
from hystid.recording import Array


@dataclass(frozen=True)
class TurningPoints:
    """Rule by which the memory (x0, Rh0) is renewed.

    Sample k is a turning point where ``v_last * v[k] <= 0``; there x0 := x[k] and Rh0 := Rh[k-1], else both are held.
    v_last is v[k-1].

    Edge rules, which follow from the one above:

    * First sample: the state starts from zeros, so v_last = 0 and sample 0 is a turning point with x0 = x[0] and
      Rh0 = the force in the start state (0 N: relaxed).
    * Plateau v = 0: every sample of it is a turning point; x0 follows x, and Rh0 the force one sample before.
    * A single exact zero between +v and -v gives two turning points, at the zero and at the sample after it.
    * -0.0 counts as 0.

    velocity_band [m/s], at least 0, makes the rule robust to noise: samples with |v| < velocity_band are no turning
    points and do not enter v_last (but as long as v_last is 0, every sample is one, so that the memory starts where the
    motion does). 0 is the published rule, to the bit.
    """

    velocity_band: float = 0.0

    def __post_init__(self) -> None:
        if not (np.isfinite(self.velocity_band) and self.velocity_band >= 0):
            raise UsageError(f"velocity_band must be a number of at least 0 m/s, found {self.velocity_band}")

    def find(self, v: Array, v_last: float = 0.0) -> tuple[NDArrayBool, float]:
        """Turning points among the samples of v [m/s], shape (n,), after a sample whose velocity was v_last.

        Returns the mask, shape (n,), and v_last for the next call: chunk by chunk gives the same mask as all at once.
        """
        v = np.asarray(v, dtype=np.float64)
        fast = np.abs(v) >= self.velocity_band
        known = np.flatnonzero(fast)
        before = np.concatenate(([v_last], v[known]))  # v_last as it stands after 0, 1, 2, ... of the fast samples
        last = before[np.cumsum(fast) - fast]
        return (last == 0) | (fast & (last * v <= 0)), float(before[-1])

    def hold(self, x: Array, v: Array, force: Array) -> tuple[Array, Array]:
        """Memory (x0, Rh0) at each sample of one recording, with the measured force in the place of Rh: for training.

        x [m], v [m/s], force [N]: shape (n,). At sample 0 the memory is (x[0], force[0]), as there is no sample before.
        """
        turn, _ = self.find(v)
        turn[:1] = True
        latest = np.maximum.accumulate(np.where(turn, np.arange(len(turn)), 0))
        return x[latest], force[np.maximum(latest - 1, 0)]


NDArrayBool = np.ndarray[tuple[int], np.dtype[np.bool_]]
