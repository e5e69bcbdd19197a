"""A periodic force that nobody measured is taken out and told; what the structure makes of its own force is not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import butter, lfilter

from hystid.diagnosis import diagnose
from hystid.diagnosis.fit.case import scales_of
from hystid.diagnosis.fit.descent import fit
from hystid.diagnosis.fit.hypothesis import Fit, Hypothesis
from hystid.diagnosis.fit.periodic import PeriodicForce, periodic_forces, without_periodic_forces
from hystid.diagnosis.fit.problem import Problem
from hystid.diagnosis.model.baseline import baseline_of
from hystid.diagnosis.prepare.segments import prepare_part
from hystid.modelica import compile_model
from hystid.recording import Recording

Array = np.ndarray
LINEAR = "HystId.Oscillators.Linear"
DT, N, M, B, K = 1e-3, 6000, 2.0, 20.0, 3e4
T = np.arange(N) * DT


def excitation(kind: str, rng: np.random.Generator) -> Array:
    if kind == "chirp":
        return 40 * np.sin(2 * np.pi * (2 * T + 4 * T**2))
    if kind == "sine":
        return 40 * np.sin(2 * np.pi * 17 * T)
    noise = lfilter(*butter(2, 60, fs=1 / DT), rng.standard_normal(N))
    return 30 * noise / np.std(noise)


def record(seed: int, kind: str, line: float = 0.0, size: float = 0.0, k3: float = 0.0) -> Recording:
    """A Duffing oscillator by fine leapfrog, with a hidden force of a frequency [Hz] and size [N]; 40 dB."""
    rng = np.random.default_rng(seed)
    F, phase, fine = excitation(kind, rng), rng.uniform(0, 2 * np.pi), 10
    x = v = 0.0
    h = DT / fine
    found = np.empty((N, 3))
    for i in range(N):
        step = F[min(i + 1, N - 1)] - F[i]
        push = F[i] + size * np.sin(2 * np.pi * line * i * DT + phase)
        found[i] = x, v, (push - B * v - K * x - k3 * x**3) / M
        for j in range(fine):  # kick by half, move, kick by half; damping taken implicitly
            for share, at in ((0.5, j), (0.5, j + 1)):
                push = F[i] + step * at / fine + size * np.sin(2 * np.pi * line * (i + at / fine) * DT + phase)
                v = (v + share * h * (push - K * x - k3 * x**3) / M) / (1 + share * h * B / M)
                x += h * v if share == 0.5 and at == j else 0.0
    motion = (found + 0.01 * np.std(found, axis=0) * rng.standard_normal((N, 3))).T
    force = F + 0.01 * np.std(F) * rng.standard_normal(N)
    return Recording(f"{kind}{seed}", T, F=force, x=motion[0], v=motion[1], a=motion[2])


def lines(*kinds: str, line: float = 0.0, size: float = 0.0, k3: float = 0.0) -> tuple[Fit, list[PeriodicForce]]:
    """Of two recordings, of one kind or of two."""
    pairs = zip((1, 2), (kinds[0], kinds[-1]), strict=True)
    return lines_of(*(record(seed, kind, line, size, k3) for seed, kind in pairs))


def lines_of(*records: Recording) -> tuple[Fit, list[PeriodicForce]]:
    parts = [prepare_part(one, seed) for seed, one in enumerate(records, 1)]
    baseline = baseline_of(LINEAR, compile_model(LINEAR), {"m": M, "B": B, "Kl": K}, frozenset({"m"}), length=1e-3)
    problem = Problem(parts, baseline, scales_of(parts, baseline))
    fitted = without_periodic_forces(problem, fit(problem, Hypothesis(dict(baseline.nominal))))
    return fitted, list(periodic_forces(fitted))


@pytest.mark.parametrize("kind", ["chirp", "sine", "noise"])
@pytest.mark.parametrize(("line", "size"), [(37.0, 3.0), (50.0, 1.0), (60.0, 6.0)])
def test_a_hidden_line_is_found_with_its_frequency_and_size(kind: str, line: float, size: float) -> None:
    fitted, (found,) = lines(kind, line=line, size=size)
    assert found.frequency == pytest.approx(line, abs=0.01)  # six seconds: a sixteenth of a line of 1/6 Hz
    assert found.is_mains == (line != 37.0)
    for amplitude, error in found.amplitudes:
        assert amplitude == pytest.approx(size, abs=5 * error + 0.02 * size) and error < 0.05 * size
    assert fitted.chi2 < 1.2


@pytest.mark.parametrize("kind", ["chirp", "sine", "noise"])
@pytest.mark.parametrize("k3", [0.0, 3e9])
def test_what_a_structure_makes_of_its_own_force_is_no_line(kind: str, k3: float) -> None:
    """Harmonics of a sine test, and whatever a cubic spring leaves of a sweep or of noise."""
    assert lines(kind, k3=k3)[1] == []


def test_sums_of_a_line_and_a_sine_test_are_not_taken_out() -> None:
    """The cubic spring mixes 37 Hz with 17 Hz: 71, 3 and 31 Hz belong to the spring."""
    found = lines("sine", line=37.0, size=3.0, k3=3e9)[1]
    assert [round(one.frequency) for one in found] == [37]


def test_a_line_that_one_recording_drives_is_found_in_another() -> None:
    """51 Hz is the third harmonic of the sine test, where no line could be told from what a spring makes of it."""
    _, (found,) = lines("sine", "noise", line=51.0, size=3.0)
    assert found.frequency == pytest.approx(51.0, abs=0.01)
    assert lines("sine", line=51.0, size=3.0)[1] == []


@pytest.mark.parametrize("kind", ["chirp", "noise"])
def test_hum_of_force_and_acceleration_is_taken_out(kind: str) -> None:
    """The line of F is hum as well, and has not made what the acceleration shows."""
    hum = 3 * np.sin(2 * np.pi * 150 * T)
    records = [record(seed, kind) for seed in (1, 2)]
    fitted, (found,) = lines_of(*(replace(one, F=one.F + hum, a=one.a - hum) for one in records))
    assert found.is_mains and found.frequency == pytest.approx(150.0, abs=0.01)
    for amplitude, error in found.amplitudes:
        assert 3 < amplitude < 3 + 3 * M and error < 0.05 * amplitude  # x and v deny the part of the acceleration
    assert fitted.chi2 < 1.2


def test_a_diagnosis_tells_the_line_and_names_no_physics() -> None:
    found = diagnose([record(seed, "noise", 37.0, 3.0) for seed in (1, 2)], model=LINEAR, parameters={"m": M})
    assert found.verdict in ("consistent", "recalibrated")
    assert any("a periodic force that no channel shows, 37 Hz" in note for note in found.notes)


def test_a_line_that_a_strong_law_hides_is_found_beside_it() -> None:
    """Beside all that a spring leaves hum does not stand out; it was noise beside the law, and widened its error."""
    hum, k3 = 1.5, 3e9
    tests = [record(seed, "noise", 50.0, hum, k3) for seed in (1, 2)]
    found = diagnose(tests, model=LINEAR, parameters={"m": M, "B": B, "Kl": K})
    assert [finding.effect for finding in found.findings] == ["cubic_stiffness"]
    [line] = found.lines
    assert line.is_mains and not any("no name yet" in note for note in found.notes)
    for size, error in line.amplitudes:
        assert size == pytest.approx(hum, abs=4 * error)  # four standard errors
    told = found.findings[0].parameters["k3"]
    assert told.value == pytest.approx(k3, abs=4 * told.stderr)
    assert told.stderr < 0.005 * k3


def test_noise_holds_no_line() -> None:
    """Thousands of frequencies are looked at, and neighbours tell the level of the noise to a quarter: in one recording
    of thirty, chance makes a line that stands out from them. It takes no more than the best of so many may."""
    quiet = record(0, "chirp")
    baseline = baseline_of(LINEAR, compile_model(LINEAR), {"m": M, "B": B, "Kl": K}, frozenset({"m"}), length=1e-3)
    for seed in range(20, 50):
        rng = np.random.default_rng(seed)
        channels = {
            name: u + 0.01 * np.std(u) * rng.standard_normal(N)
            for name in ("F", "x", "v", "a")
            if (u := quiet.channel(name)) is not None
        }
        part = prepare_part(Recording("noise", T, **channels), 1)
        problem = Problem([part], baseline, scales_of([part], baseline))
        fitted = without_periodic_forces(problem, fit(problem, Hypothesis(dict(baseline.nominal))))
        assert list(periodic_forces(fitted)) == [], seed
