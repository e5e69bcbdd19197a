"""Effects that act for a part of the time: the window, the law in it, the model that is written."""

import json
from pathlib import Path

import numpy as np
import pytest

from hystid.compiled import CompiledModel
from hystid.diagnosis import diagnose
from hystid.modelica import compile_model
from hystid.recording import Recording
from tests.test_diagnosis import JENKINS, case, run, spec

MODEL, NOMINAL = "HystId.Oscillators.Linear", {"m": 2.0, "B": 15.0, "Kl": 4.8e4}
FS, MASS, DAMPING, STIFFNESS = 1000.0, 2.0, 20.0, 5e4


def rig(window: tuple[float, float], k2: float, seed: int, level: float) -> Recording:
    """A linear oscillator with a quadratic spring that acts between two times, in a noisy force, by its own integrator:
    Runge-Kutta of order four at a fifth of the sample time."""
    rng = np.random.default_rng(seed)
    n, sub = 6000, 5
    t = np.arange(n * sub) / (FS * sub)
    lines = rng.uniform(0, 2 * np.pi, 40)
    force = level * sum(np.sin(2 * np.pi * (2 + 1.2 * i) * t + phase) for i, phase in enumerate(lines)) / 6

    def rate(state: np.ndarray, at: float, f: float) -> np.ndarray:
        on = k2 * state[0] ** 2 if window[0] < at < window[1] else 0.0
        return np.array([state[1], (f - DAMPING * state[1] - STIFFNESS * state[0] - on) / MASS])

    state, h = np.zeros(2), 1 / (FS * sub)
    kept = np.empty((n, 3))
    for i in range(n * sub):
        first = rate(state, t[i], force[i])
        if i % sub == 0:
            kept[i // sub] = state[0], state[1], first[1]
        middle = force[i] if i + 1 == n * sub else (force[i] + force[i + 1]) / 2
        last = force[i] if i + 1 == n * sub else force[i + 1]
        second = rate(state + h / 2 * first, t[i] + h / 2, middle)
        third = rate(state + h / 2 * second, t[i] + h / 2, middle)
        fourth = rate(state + h * third, t[i] + h, last)
        state = state + h / 6 * (first + 2 * second + 2 * third + fourth)
    noisy = [u + 0.015 * np.std(u) * rng.standard_normal(n) for u in (*kept.T, force[::sub])]
    x, v, a, F = noisy
    return Recording(f"rig_{seed}", t[::sub], F=F, x=x, v=v, a=a)


def test_a_window_is_a_trapezium() -> None:
    model = CompiledModel(compile_model("HystId.Components.TimeWindow"))
    times = {"t_on": 0.5, "t_off": 1.5, "t_ramp": 0.2}
    y = model.simulate({}, 0.05, parameters=times, outputs=("y",), rows=41)["y"]
    t = np.arange(41) * 0.05
    np.testing.assert_allclose(y, np.clip(np.minimum((t - 0.5) / 0.2, (1.5 - t) / 0.2), 0, 1), atol=1e-12)


def test_a_law_and_its_window_are_found_and_written(tmp_path: Path) -> None:
    tests = [rig((2.0, 4.2), 4e6, seed, level) for seed, level in ((1, 20.0), (2, 32.0))]
    unseen = rig((2.0, 4.2), 4e6, 3, 26.0)
    found = diagnose(tests, model=MODEL, parameters=NOMINAL, holdout=[unseen], out=tmp_path)
    (finding,) = found.findings
    assert finding.effect == "quadratic_stiffness"
    # Ramps of the model are as short as a fit makes them; the truth has none. Half a period of the motion is 0.02 s.
    assert finding.parameters["t_on"].value == pytest.approx(2.0, abs=0.05)
    assert finding.parameters["t_off"].value == pytest.approx(4.2, abs=0.05)
    assert finding.parameters["k2"].value == pytest.approx(4e6, rel=0.05)
    assert f"from {finding.parameters['t_on'].value:.3g} s to" in finding.where.text
    for spans in finding.where.t.values():
        assert spans and all(1.9 < begin < end < 4.3 for begin, end in spans)
    before, after = found.holdout[0].free_run
    assert before is not None and after is not None and after < 0.5 * before
    text = (tmp_path / "extended.mo").read_text()
    assert "HystId.Components.TimeWindow quadraticStiffnessWindow(" in text
    assert "f_effects = quadraticStiffnessWindow.y*quadraticStiffness.f" in text
    written = CompiledModel(compile_model(f"{tmp_path / 'extended.mo'}:Extended"))
    moved = {"F": np.full(6000, 50.0)}
    free = written.simulate(moved, 1 / FS, outputs=("x", "R"))
    assert np.all(np.isfinite(free["x"]))
    stored = json.loads((tmp_path / "diagnosis.json").read_text())
    assert stored["findings"][0]["parameters"]["t_on"]["unit"] == "s"


def test_windows_may_differ_and_be_absent(tmp_path: Path) -> None:
    """Two recordings with windows of their own, one with a sound structure."""
    windows = ((1.0, 3.0), (3.5, 5.5), (9.0, 9.5))
    tests = [rig(w, 4e6, seed, level) for w, seed, level in zip(windows, (1, 2, 4), (24.0, 32.0, 28.0), strict=True)]
    found = diagnose(tests, model=MODEL, parameters=NOMINAL, out=tmp_path)
    (finding,) = found.findings
    assert finding.effect == "quadratic_stiffness"
    assert {name for name in finding.parameters if name.startswith("t_o")} == {"t_on_1", "t_off_1", "t_on_2", "t_off_2"}
    for number, (begin, end) in enumerate(windows[:2]):
        assert finding.parameters[f"t_on_{number + 1}"].value == pytest.approx(begin, abs=0.05)
        assert finding.parameters[f"t_off_{number + 1}"].value == pytest.approx(end, abs=0.05)
    assert finding.where.t["rig_4"] == []
    before, after = zip(*(e.free_run for e in found.errors), strict=True)
    assert all(a < 0.5 * b for b, a in zip(before, after, strict=True))  # the refit suffers where nothing acts, too
    text = (tmp_path / "extended.mo").read_text()
    assert "differs from recording to recording" in text and "HystId.Components.TimeWindow" in text
    assert "t_on_1" not in text


def test_an_effect_may_be_in_some_recordings_only() -> None:
    tests = [rig(w, 4e6, seed, 26.0) for w, seed in (((-1.0, 99.0), 1), ((9.0, 9.5), 2), ((9.0, 9.5), 4))]
    found = diagnose(tests, model=MODEL, parameters=NOMINAL)
    (finding,) = found.findings
    assert finding.effect == "quadratic_stiffness"
    assert finding.where.t["rig_2"] == finding.where.t["rig_4"] == []
    assert finding.where.t["rig_1"]


def test_an_effect_that_acts_all_the_time_gets_no_window() -> None:
    tests = [rig((-1.0, 99.0), 4e6, seed, level) for seed, level in ((1, 20.0), (2, 32.0))]
    found = diagnose(tests, model=MODEL, parameters=NOMINAL)
    (finding,) = found.findings
    assert finding.effect == "quadratic_stiffness"
    assert "t_on" not in finding.parameters


def test_a_concealed_effect_of_a_part_of_the_time_is_named(tmp_path: Path) -> None:
    place, _ = case(tmp_path, spec("part_time", ("quadratic_damping",), JENKINS), 76)
    found = run(place)
    assert "quadratic_damping" in {name for finding in found.findings for name in finding.alike}
    assert all(any(name.startswith("t_off") for name in f.parameters) for f in found.findings)
