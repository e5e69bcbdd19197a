"""A baseline whose bristles fade faster than the motion is sampled: 20 times per sample and more where it is fast."""

import numpy as np
import pytest

from hystid.compiled import CompiledModel
from hystid.diagnosis import diagnose
from hystid.diagnosis.decide.criterion import ACCURACY
from hystid.diagnosis.model.baseline import baseline_of
from hystid.modelica import compile_model
from hystid.recording import Recording

MODEL = "HystId.Oscillators.LuGre"
TRUE = {"m": 2.0, "B": 5.0, "Kl": 7900.0, "sigma0": 1.6e4, "sigma1": 15.0, "fc": 3.0, "fs": 4.5, "vs": 0.02}
DT = 1e-3
T = DT * np.arange(4000)


def recorded(seed: int, size: float, cubic: float = 0.0) -> Recording:
    """The rig under a force of many frequencies, in noise of 40 dB; cubic: of a spring that the model lacks [N/m3]."""
    rng = np.random.default_rng(seed)
    F = sum(size * np.sin(2 * np.pi * f * T + rng.uniform(0, 2 * np.pi)) for f in rng.uniform(2, 25, 40))
    rig = CompiledModel(compile_model(MODEL))
    found = rig.simulate({"F": F}, DT, parameters=TRUE, outputs=("x", "v", "a"), interpolation="cubic", substeps=100)
    channels = {"x": found["x"], "a": found["a"], "F": F + cubic * found["x"] ** 3}
    return Recording(
        str(seed), T, **{k: u + 0.01 * np.std(u) * rng.standard_normal(len(u)) for k, u in channels.items()}
    )


def test_the_force_of_bristles_is_that_of_fine_steps() -> None:
    """In one step per sample it has no finite value. What steps leave must be less than counts as exact."""
    code = compile_model(MODEL)
    x = 0.03 * np.sin(2 * np.pi * 9 * T)
    v = 0.03 * 2 * np.pi * 9 * np.cos(2 * np.pi * 9 * T)
    base = baseline_of(MODEL, code, TRUE)
    fine = CompiledModel(code).clamp(
        base.reading.motion(x, v), {}, DT, parameters=TRUE, outputs=("f_h",), substeps=500
    )["f_h"]
    for h in (base.force(x, v, DT, TRUE)[1], base.forces([base.held(x, v, DT)], TRUE)[0][1]):
        assert np.sqrt(np.mean((h - fine) ** 2)) < ACCURACY * np.std(fine)


@pytest.mark.parametrize(("cubic", "names"), [(0.0, []), (4e7, ["cubic_stiffness"])])
def test_bristles_that_fade_fast_are_no_reason_for_no_answer(cubic: float, names: list[str]) -> None:
    """What is given is the mass alone, as on a rig."""
    recordings = [recorded(seed, size, cubic) for seed, size in ((1, 3.0), (2, 8.0))]
    found = diagnose(recordings, model=MODEL, parameters={"m": 2.0})
    assert [finding.effect for finding in found.findings] == names
