"""Records of very many samples: rows at the pace of the motion, in stretches from the beginning to the end."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from hystid.compiled import CompiledModel
from hystid.diagnosis import diagnose
from hystid.diagnosis.prepare.reduction import Reduction
from hystid.diagnosis.prepare.segments import Part
from hystid.modelica import compile_model
from hystid.recording import Recording

Array = NDArray[np.float64]
DT = 1e-3
K3 = 1e9  # N/m3


def part(n: int, frequency: float, valid: NDArray[np.bool_] | None = None) -> Part:
    t = DT * np.arange(n)
    rate = 2 * np.pi * frequency
    x, v, a = np.sin(rate * t), rate * np.cos(rate * t), -(rate**2) * np.sin(rate * t)
    return Part("sine", t, DT, a, x, v, a, a, 0, {"F": 1.0, "a": 1.0}, {}, valid)


@pytest.mark.parametrize(("frequency", "block"), [(2.0, 18), (20.0, 6), (60.0, 2), (200.0, 2)])
def test_blocks_follow_the_quickest_motion(frequency: float, block: int) -> None:
    """300,000 samples: 18 a block for 16,000 rows, but at most an eighth of a period, 125 ms / f, and at least two."""
    assert Reduction([part(300_000, frequency)], 1.0).block == block


def test_rows_lie_all_along() -> None:
    one = part(600_000, 60.0)
    reduce = Reduction([one], 1.0)
    times = reduce.plain(0, one.t)
    assert 39_000 < len(times) < 41_000
    counts, _ = np.histogram(times, bins=24, range=(3.0, 597.0))  # a two-hundredth is trimmed at either end
    assert counts.min() > 0.9 * counts.max()  # each stretch as long as the others
    assert times[0] < 0.01 * one.t[-1] and times[-1] > 0.95 * one.t[-1]


def test_rows_of_short_records_are_all_there() -> None:
    one = part(8_000, 20.0)
    reduce = Reduction([one], 1.0)
    assert len(reduce.plain(0, one.t)) == 8_000 - 2 * 40  # trimmed by a two-hundredth at either end
    broken = np.ones(8_000, dtype=bool)
    broken[4000:4100] = False
    assert len(Reduction([part(8_000, 20.0, broken)], 1.0).plain(0, one.t)) == 8_000 - 2 * 40 - 100


def test_a_quarter_of_a_million_samples() -> None:
    """A cubic spring beside a slider in sweeps of 50 s: it is named alone. A free run of the slider was driven without
    it, and its force added. A tenth of it may go to other forms of the law."""
    n, rng = 250_000, np.random.default_rng(3)
    t = DT * np.arange(n)
    within = t % 50
    force = 25 * np.sin(2 * np.pi * (2 + 0.3 * within) * within)
    values = {"m": 1.0, "B": 10.0, "Kl": 2e4, "Ks": 1e4, "fc": 5.0}
    model = CompiledModel(compile_model("HystId.Oscillators.Jenkins"))
    run = model.simulate(
        {"F": force}, DT, parameters=values, outputs=["x", "v", "a"], interpolation="cubic", substeps=2
    )
    run["F"] = force + K3 * run["x"] ** 3  # what the same motion takes with the spring
    noisy = {name: u + 0.02 * np.std(u) * rng.standard_normal(n) for name, u in run.items()}
    found = diagnose(
        [Recording("long", t, **noisy)], model="HystId.Oscillators.Jenkins", parameters={**values, "Kl": 1.9e4}
    )
    (finding,) = found.findings
    assert finding.effect == "cubic_stiffness"
    k3 = finding.parameters["k3"]
    assert abs(k3.value - K3) < 3 * k3.stderr + 0.1 * K3
