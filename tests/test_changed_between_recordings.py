"""A contact that was tightened between two tests: each test agrees with the model, and all together do not."""

import re

import numpy as np
import pytest

from hystid.compiled import CompiledModel
from hystid.diagnosis import Diagnosis, diagnose
from hystid.diagnosis.tell.alone import changes
from hystid.modelica import compile_model
from hystid.recording import Recording

MODEL = "HystId.Oscillators.Jenkins"
TRUE = {"m": 2.0, "B": 10.0, "Kl": 2e4, "Ks": 1.2e4, "fc": 2.4}
RATE, COUNT = 1200.0, 5000
NOISE = 10 ** (-34 / 20)
LEVELS = (2.0, 4.0, 3.2)  # N


def asked(slips: tuple[float, ...], spring: float = 0.0, late: int = 0) -> Diagnosis:
    """Three sweeps over the resonance with a force of slip [N] each. spring: of the third order, not in the model.
    late: samples by which F is late in the second one."""
    rng = np.random.default_rng(3)
    t = np.arange(COUNT) / RATE
    model, tests = CompiledModel(compile_model(MODEL)), []
    for number, (level, fc) in enumerate(zip(LEVELS, slips, strict=True)):
        F = level * np.sin(2 * np.pi * (8 * t + 12 * t**2 / t[-1]))
        y = model.simulate({"F": F}, 1 / RATE, parameters={**TRUE, "fc": fc}, outputs=("x", "v", "a"))
        measured = np.concatenate([np.zeros(late), F[: COUNT - late]]) if number == 1 else F
        told = {"F": measured + spring * y["x"] ** 3, "x": y["x"], "v": y["v"], "a": y["a"]}
        noisy = {name: u + NOISE * np.std(u) * rng.standard_normal(COUNT) for name, u in told.items()}
        tests.append(Recording(f"test_{number + 1}", t, **noisy))
    return diagnose(tests, model=MODEL, parameters={name: 1.1 * v if name != "m" else v for name, v in TRUE.items()})


def test_the_parameter_that_differs_is_told() -> None:
    found = asked((2.4, 3.3, 2.4))
    assert found.verdict == "unknown_physics"
    [told] = [note for note in found.notes if note.startswith("each recording by itself agrees with the model")]
    assert "fc is" in told
    assert found.headline.lower() == told.lower()
    assert found.next_experiment.startswith("Diagnose each recording by itself")


def test_a_delay_that_differs_is_told_with_its_time() -> None:
    found = asked((2.4, 2.4, 2.4), late=3)
    assert found.verdict == "unknown_physics"
    [told] = [note for note in found.notes if note.startswith("each recording by itself agrees with the model")]
    [late] = re.findall(r"([\d.]+) ms in test_2", told)
    assert float(late) == pytest.approx(1e3 * 3 / RATE, rel=0.02)  # a tenth of the time from one sample to the next
    assert "is late by" in told
    assert "fc is" not in told


@pytest.mark.parametrize("spring", [0.0, 2e10])
def test_nothing_is_told_where_one_law_holds_in_all(spring: float) -> None:
    found = asked((2.4, 2.4, 2.4), spring)
    assert found.problem is not None
    assert found.choice is not None
    assert changes(found.problem, found.choice.before) == ""
